"""Between joints and constraint frames: velocities one way, forces the other.

A frame c on a joint with placement P has, in its own axes,

    v_c = P^-1 v_joint,    a_c = P^-1 a_joint,    f_joint = P* f_c

all constant maps, so that those of many frames are one matrix. The acceleration of a point is the
classical one, linear(a_c) + omega_c x linear(v_c).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.any_bound import AnyBound, OnFrames
from condyn_pin.constraints.rows.bound import POINT, Bound

_log6 = pin.log6

# (joint, placement) to the Jacobian (6, nv) of that frame, in its own axes.
FrameJacobian = Callable[[int, Any], Array]


class Joints:
    """Velocities and accelerations of some joints, side by side, after forward kinematics.

    `sources` are views into that memory, (6,) a joint, velocities first. The world may be among the
    joints: it does not move.
    """

    def __init__(self, data: Any, joints: set[int]) -> None:
        self.numbers = sorted(joints)
        self.place = {joint: slice(6 * i, 6 * i + 6) for i, joint in enumerate(self.numbers)}
        self.size = 6 * len(self.numbers)
        self._motion = np.zeros((2, self.size))
        self._flat = self._motion.reshape(-1)
        # views into data's own memory: to fetch one costs a third of a microsecond
        self.sources = [
            source[joint].vector if joint else np.zeros(6)
            for source in (data.v, data.a)
            for joint in self.numbers
        ]
        self._data = data  # keeps that memory alive

    def read(self) -> Array:
        """Return (2, size): velocities in the first row, accelerations in the second."""
        np.concatenate(self.sources, out=self._flat)
        return self._motion

    def maps(self, ends: Sequence[tuple[int, Any]]) -> tuple[Array, Array]:
        """Return the maps to linear and angular motion of frames (joint, placement)."""
        linear, angular = np.zeros((2, 3 * len(ends), self.size))
        for i, (joint, placement) in enumerate(ends):
            six = placement.toActionMatrixInverse()
            linear[3 * i : 3 * i + 3, self.place[joint]] = six[:3]
            angular[3 * i : 3 * i + 3, self.place[joint]] = six[3:]
        return linear, angular


class Centripetal:
    """omega x v of many frames from one product of `factors` with the joints' velocities."""

    def __init__(self, linear: Array, angular: Array) -> None:
        xyz = np.arange(len(linear)).reshape(-1, 3)
        one, two = xyz[:, [1, 2, 0]].ravel(), xyz[:, [2, 0, 1]].ravel()
        self.factors = np.vstack([angular[one], angular[two], linear[two], linear[one]])

    def of(self, velocities: Array) -> Array:
        """Return omega x v, three numbers a frame."""
        return centripetal(self.factors.dot(velocities))


def centripetal(crossed: Array) -> Array:
    """Return omega x v of many frames, of what the factors of `Centripetal` make of velocities.

    By components: omega_(i+1) v_(i+2) - omega_(i+2) v_(i+1).
    """
    w, v = crossed.reshape(2, 2, -1)
    products = w * v
    return products[0] - products[1]  # type: ignore[no-any-return]


class WorldContacts:
    """Contacts with the world, and balls and welds on it: rows of the frame in its own axes.

        J v         = X v_joints
        J a + gamma = X a_joints  (+ omega x v for points)

    Their rows are a choice of the six of the frame; the frame itself turns with the robot. Where
    there is an anchor E2, a frame E1 is away from it by

        c = log6(E2^-1 E1),    for points c = -R1^T (p2 - p1).

    `motion` is where J v and J a + gamma of the scene are; what `evaluate` does not write it
    zeroes.
    """

    def __init__(self, data: Any, bounds: Sequence[Bound], motion: Array) -> None:
        self._joints, self._out = Joints(data, {b.joint1 for b in bounds}), motion
        points = [b for b in bounds if b.selection == POINT]
        self._points, self._has_points = rows_of(points), bool(points)
        linear, angular = self._joints.maps([(b.joint1, b.placement1) for b in points])
        self._centripetal = Centripetal(linear, angular)
        X = np.zeros((motion.shape[1], self._joints.size))
        X[self._points] = linear
        for b in bounds:
            if b.selection != POINT:
                six = b.placement1.toActionMatrixInverse()
                X[b.rows, self._joints.place[b.joint1]] = six[list(b.selection)]
        self._XT = np.ascontiguousarray(X.T)
        self._others = [b for b in bounds if not b.is_plain]
        anchored = [
            (b, data.oMi[b.joint1], b.placement1, b.placement2) for b in bounds if b.anchored
        ]
        self._anchored_points = [
            (b.rows, oMi, one, two.translation) for b, oMi, one, two in anchored if b in points
        ]
        self._anchored_frames = [
            (b.rows, oMi, one, two) for b, oMi, one, two in anchored if b not in points
        ]

    def evaluate(self, c: Array, _velocity: Array, acceleration: Array) -> None:
        """Write c of these rows, and J v and J a + gamma into all of `motion`."""
        motion = self._joints.read()
        np.dot(motion, self._XT, out=self._out)
        if self._has_points:
            acceleration[self._points] += self._centripetal.of(motion[0])
        for rows, oMi, one, p2 in self._anchored_points:
            c[rows] = -(oMi * one).actInv(p2)
        for rows, oMi, one, two in self._anchored_frames:
            c[rows] = _log6(two.actInv(oMi * one)).vector

    def stack(self, lam: Array, f1: Array, f2: Array) -> None:
        """Write nothing: f1 is lam already, and no body is behind c2."""

    def jacobian(self, J: Array, of_frame: FrameJacobian) -> None:
        """Write the rows into J (m, nv) that Pinocchio does not have."""
        for b in self._others:
            J[b.rows] = of_frame(b.joint1, b.placement1)[list(b.selection)]


def rows_of(bounds: Sequence[AnyBound]) -> NDArray[np.int_] | slice:
    """Return the row numbers of some constraints, one after the other; a slice where they are one.

    A slice is written to in a third of the time.
    """
    ranges = [range(b.rows.start, b.rows.stop) for b in bounds]
    numbers = [row for rows in ranges for row in rows]
    if numbers and numbers == list(range(numbers[0], numbers[-1] + 1)):
        return slice(numbers[0], numbers[-1] + 1)
    return np.array(numbers, dtype=np.int_)


class Wrenches:
    """The constraint forces as wrenches on the joints: f on joint 1, its opposite on joint 2.

    `places` say where the stacked force of a constraint is found, and which of the six components
    it has; `size` is that of the stacked forces.
    """

    def __init__(
        self, model: Any, places: Sequence[tuple[OnFrames, slice, tuple[int, ...]]], size: int
    ) -> None:
        joints = sorted({j for b, _, _ in places for j in (b.joint1, b.joint2) if j})
        place = {joint: slice(6 * i, 6 * i + 6) for i, joint in enumerate(joints)}
        # side by side, so that one product does for both ends
        self._on_joints = np.zeros((6 * len(joints), 2 * size))
        on_joint1, on_joint2 = self._on_joints[:, :size], self._on_joints[:, size:]
        for b, at, components in places:
            if b.joint1:
                dual = b.placement1.toDualActionMatrix()
                on_joint1[place[b.joint1], at] = dual[:, list(components)]
            if b.joint2:
                dual = b.placement2.toDualActionMatrix()
                on_joint2[place[b.joint2], at] = -dual[:, list(components)]
        self.all = pin.StdVec_Force(model.njoints, pin.Force.Zero())
        self._stacked = np.zeros(6 * len(joints))
        # views into the memory of the wrenches, and what goes there
        self._targets = [(self.all[j].vector, self._stacked[place[j]]) for j in joints]

    def of(self, forces: Array) -> Any:
        """Return the wrench on each joint, in its axes, in memory of this object.

        `forces` (2 size,) are the stacked ones in the axes and at the origin of c1, and the same of
        c2.
        """
        self._on_joints.dot(forces, self._stacked)
        for wrench, force in self._targets:
            wrench[:] = force
        return self.all
