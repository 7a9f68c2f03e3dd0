"""Between joints and constraint frames: velocities one way, forces the other.

A frame c1 on joint 1 with placement P has, in its own axes,

    v_c1 = P^-1 v_joint,    a_c1 = P^-1 a_joint,    f_joint = P* f_c1

all constant maps, so that those of all contacts are one matrix each.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.binding import Bound
from condyn_pin.robot import Vector


class WorldContacts:
    """Velocity and acceleration of every contact with the world.

        J v         = X v_joints
        J a + gamma = X a_joints  (+ omega x v for points, whose acceleration is the classical one)

    Parameters
    ----------
    data : pin.Data
        Holds `v` and `a` of the joints after forward kinematics.
    bounds : sequence of Bound
        All constraints; those between two moving bodies are left out, their rows stay zero.
    width : int
        Number of columns of the result, at least the number of rows of the scene.
    """

    def __init__(self, data: Any, bounds: Sequence[Bound], width: int) -> None:
        contacts = [b for b in bounds if not b.joint2]
        joints = sorted({b.joint1 for b in contacts})
        place = {joint: slice(6 * i, 6 * i + 6) for i, joint in enumerate(joints)}
        X = np.zeros((width, 6 * len(joints)))
        points = [b for b in contacts if b.size == 3]
        v, omega = np.zeros((2, 3 * len(points), 6 * len(joints)))
        for b in contacts:
            X[b.rows, place[b.joint1]] = b.placement1.toActionMatrixInverse()[: b.size]
        for i, b in enumerate(points):
            six = b.placement1.toActionMatrixInverse()
            v[3 * i : 3 * i + 3, place[b.joint1]] = six[:3]
            omega[3 * i : 3 * i + 3, place[b.joint1]] = six[3:]
        self._XT = np.ascontiguousarray(X.T)
        # omega x v by components: omega_(i+1) v_(i+2) - omega_(i+2) v_(i+1)
        xyz = np.arange(3 * len(points)).reshape(-1, 3)
        first, second = np.roll(xyz, -1, axis=1).ravel(), np.roll(xyz, -2, axis=1).ravel()
        self._factors = np.vstack([omega[first], v[second], omega[second], v[first]])
        self._point_rows = np.concatenate(
            [np.arange(b.rows.start, b.rows.stop) for b in points] or [np.zeros(0, dtype=int)]
        )
        self._stacked = np.zeros((2, 6 * len(joints)))
        # references into data stay valid, and to fetch one costs half a microsecond
        self._sources = [
            (source[joint], self._stacked[row, place[joint]])
            for row, source in enumerate((data.v, data.a))
            for joint in joints
        ]

    def evaluate(self, out: Vector) -> None:
        """Write J v and J a + gamma into the two rows of `out` (2, width)."""
        for motion, place in self._sources:
            place[:] = motion.vector
        np.dot(self._stacked, self._XT, out=out)
        if self._point_rows.size:
            w1, v2, w2, v1 = self._factors.dot(self._stacked[0]).reshape(4, -1)
            out[1, self._point_rows] += w1 * v2 - w2 * v1


class Wrenches:
    """The constraint forces as wrenches on the joints: lam on joint 1, its opposite on joint 2."""

    def __init__(self, model: Any, bounds: Sequence[Bound]) -> None:
        self._loops = [(k, b) for k, b in enumerate(bounds) if b.joint2]
        joints = sorted({j for b in bounds for j in (b.joint1, b.joint2) if j})
        place = {joint: slice(6 * i, 6 * i + 6) for i, joint in enumerate(joints)}
        self._place = place
        self._on_joint1 = np.zeros((6 * len(joints), sum(b.size for b in bounds)))
        for b in bounds:
            dual = b.placement1.toDualActionMatrix()[:, : b.size]
            self._on_joint1[place[b.joint1], b.rows] = dual
        self._wrenches = pin.StdVec_Force()
        for _ in range(model.njoints):
            self._wrenches.append(pin.Force.Zero())
        self._targets = [(self._wrenches[joint], place[joint]) for joint in joints]

    def of(self, lam: Vector, c1Mc2: Sequence[Any]) -> Any:
        """Return the wrench on each joint, in its axes, in memory of this object.

        Parameters
        ----------
        lam : (m,) array
            On joint 1, in the axes of c1.
        c1Mc2 : sequence of pin.SE3
            Relative placements of the loops at the configuration.
        """
        stacked = self._on_joint1.dot(lam)
        for k, b in self._loops:
            dual = b.placement2.toDualActionMatrix()
            if b.size == 3:  # acts at the origin of c2, only turned
                opposite = dual[:, :3] @ (c1Mc2[k].rotation.T @ lam[b.rows])
            else:
                opposite = dual @ (c1Mc2[k].toActionMatrix().T @ lam[b.rows])
            stacked[self._place[b.joint2]] -= opposite
        for force, place in self._targets:
            force.vector = stacked[place]
        return self._wrenches
