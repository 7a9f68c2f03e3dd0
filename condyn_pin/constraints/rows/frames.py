"""Rows of points, cut joints and rods between two frames, evaluated all at once.

Between joints and constraint frames: velocities one way, forces the other.

A frame c on a joint with placement P has, in its own axes,

    v_c = P^-1 v_joint,    a_c = P^-1 a_joint,    f_joint = P* f_c

all constant maps, so that those of many frames are one matrix. The acceleration of a point is the
classical one, linear(a_c) + omega_c x linear(v_c).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import pin, placement_view
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import (
    POINT,
    BoundBetweenFrames,
    BoundConstraint,
    TwoFrameConstraint,
)

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.equations import ManyEnds


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
        """Motions (2, size): velocities in the first row, accelerations in the second."""
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
    """Centripetal terms omega x v of many frames: products of `factors` with joint velocities."""

    def __init__(self, linear: Array, angular: Array) -> None:
        xyz = np.arange(len(linear)).reshape(-1, 3)
        one, two = xyz[:, [1, 2, 0]].ravel(), xyz[:, [2, 0, 1]].ravel()
        self.factors = np.vstack([angular[one], angular[two], linear[two], linear[one]])

    def of(self, velocities: Array) -> Array:
        """Centripetal terms omega x v, three numbers a frame."""
        return centripetal(self.factors.dot(velocities))


def centripetal(crossed: Array) -> Array:
    """Centripetal terms omega x v of many frames, by the products of the factors of `Centripetal`.

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

    def __init__(self, data: Any, bounds: Sequence[BoundBetweenFrames], motion: Array) -> None:
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
        """Write nothing: f1 is lam already, and c2 is on no body."""

    def jacobian(self, J: Array, of_frame: FrameJacobian) -> None:
        """Write the rows that Pinocchio does not have into J (m, nv)."""
        for b in self._others:
            J[b.rows] = of_frame(b.joint1, b.placement1)[list(b.selection)]


def rows_of(bounds: Sequence[BoundConstraint]) -> NDArray[np.int_] | slice:
    """Row numbers of some constraints, one after the other; a slice if they are consecutive."""
    ranges = [range(b.rows.start, b.rows.stop) for b in bounds]
    return indices([row for rows in ranges for row in rows])


def indices(numbers: list[int]) -> NDArray[np.int_] | slice:
    """Numbers as an index; a slice, which is written to in a third of the time, if consecutive."""
    if numbers and numbers == list(range(numbers[0], numbers[-1] + 1)):
        return slice(numbers[0], numbers[-1] + 1)
    return np.array(numbers, dtype=np.int_)


class JointWrenches:
    """Constraint forces as wrenches on the joints: f on joint 1, its opposite on joint 2.

    `places` say where the stacked force of a constraint is found, and which of the six components
    it has; `size` is that of the stacked forces.
    """

    def __init__(
        self,
        model: Any,
        places: Sequence[tuple[TwoFrameConstraint, slice, tuple[int, ...]]],
        size: int,
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
        """Wrench on each joint, in its axes, in memory of this object."""
        # `forces` (2 size,) are the stacked ones in the axes and at the origin of c1, and the same
        # of c2.
        self._on_joints.dot(forces, self._stacked)
        for wrench, force in self._targets:
            wrench[:] = force
        return self.all


# The two ends of many loops at once: where the frames c1 and c2 are, and how they move.
#
# E1, E2 are their placements in the world, R = R1^T R2, r = R1^T (p2 - p1), and every velocity and
# acceleration is in the axes of its own frame; accelerations of origins are the classical ones.


class Ends:
    """Ends of k loops, after forward kinematics into `data`."""

    def __init__(self, data: Any, bounds: Sequence[TwoFrameConstraint]) -> None:
        self.k = len(bounds)
        # first the ends c1 of all loops, then the ends c2
        ends = [(b.joint1, b.placement1) for b in bounds]
        ends += [(b.joint2, b.placement2) for b in bounds]
        # views into data's own memory, one call copies them all: the axes of the joint, one a row,
        # and its origin
        self._sources = [placement_view(data.oMi[j]).T for j, _ in ends]
        self._of_joints = np.zeros((2, self.k, 4, 3))
        self._rows_of_joints = self._of_joints.reshape(-1, 3)
        self._in_joints = np.array([p.homogeneous.T for _, p in ends]).reshape(2, -1, 4, 4)
        self._joints = Joints(data, {j for j, _ in ends})
        linear, angular = self._joints.maps(ends)
        self._linearT = np.ascontiguousarray(linear.T)
        self._angularT = np.ascontiguousarray(angular.T)
        crossed = Centripetal(linear, angular).factors
        self._crossedT = np.ascontiguousarray(np.vstack([linear, crossed]).T)
        self._motion = np.zeros((2, self._joints.size))

    def placements(self) -> Array:
        """Placements E (2, k, 4, 3): axes of c1 and c2 in the world, one a row; then origins."""
        np.concatenate(self._sources, out=self._rows_of_joints)
        return self._in_joints @ self._of_joints

    def apart(self) -> tuple[Array, Array]:
        """Relative placements R (k, 3, 3) and r (k, 3)."""
        one, two = self.placements()
        two[:, 3] -= one[:, 3]
        both = one[:, :3] @ two.swapaxes(1, 2)  # R1^T [R2, p2 - p1]
        return both[:, :, :3], both[:, :, 3]

    def linear(self) -> Array:
        """Linear velocities and accelerations (2, 2, k, 3): by order, end, loop and component."""
        self._motion = self._joints.read()
        found, size = self._motion.dot(self._crossedT), 6 * self.k
        both = found[:, :size]
        both[1] += centripetal(found[0, size:])
        return both.reshape(2, 2, self.k, 3)  # type: ignore[no-any-return]

    def angular(self) -> Array:
        """Angular velocities and accelerations (2, 2, k, 3), right after `linear`."""
        return np.asarray(self._motion.dot(self._angularT).reshape(2, 2, self.k, 3))


# Cut joints: loops that keep a choice of the six rows of the relative velocity.
#
# With r, R, v, omega as above, body 1 moves relative to body 2 at
# the origin of c2 with
#
#     s_lin = v1 + omega1 x r - R v2 = -r',       s_ang = omega1 - R omega2
#
# in the axes of c1, and its derivatives, component by component in those axes, are
#
#     s_lin' = a1 - R a2 + alpha1 x r + omega1 x (omega1 x r) - 2 omega1 x s_lin
#     s_ang' = alpha1 - R alpha2 + omega1 x R omega2.
#
# The violation is -r, and for turns -log(R), or for a hinge about e the turn that brings e back
# onto R e.


_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])


class CutJoints:
    """All loops of one scene with rows that Pinocchio does not have."""

    def __init__(self, ends: Ends, bounds: Sequence[BoundBetweenFrames]) -> None:
        self._bounds, self._ends = tuple(bounds), ends
        k = len(bounds)
        self._rows = rows_of(bounds)
        chosen = [6 * i + j for i, b in enumerate(bounds) for j in b.selection]
        self._chosen = np.array(chosen, dtype=np.int_)  # of the k x 6 components
        self._aligned = np.array([i for i, b in enumerate(bounds) if b.is_aligned], dtype=np.int_)
        self._axes = np.eye(3)[[bounds[i].axis for i in self._aligned]]
        self._sliders = [i for i, b in enumerate(bounds) if b.size == 5 and not b.is_hinge]
        self._anchored = np.array([[[float(b.anchored)]] for b in bounds])
        self._R, self._r = np.zeros((k, 3, 3)), np.zeros((k, 3))

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows of these loops into the three vectors of all rows."""
        self._R, self._r, s, s_dot = relative_velocities(self._ends)
        off = np.empty_like(s)
        off[:, 0], off[:, 1] = -self._r, self._turn_off()
        off *= self._anchored
        for six, out in ((off, c), (s, velocity), (s_dot, acceleration)):
            out[self._rows] = six.reshape(-1)[self._chosen]

    def stack(self, lam: Array, f1: Array, f2: Array) -> None:
        """Write the forces and moments (6 k) at the origins of c1 and c2, each in its axes."""
        six = np.zeros((len(self._bounds), 2, 3))
        six.reshape(-1)[self._chosen] = lam[self._rows]
        force, moment = six[:, 0], six[:, 1]
        f2.reshape(-1, 2, 3)[:] = six @ self._R  # R^T f, R^T m
        moment += cross(self._r, force)
        f1[:] = six.reshape(-1)

    def jacobian(self, J: Array, of_frame: FrameJacobian) -> None:
        """Write the rows of these loops into J (m, nv), at the last evaluation."""
        for i, b in enumerate(self._bounds):
            J1, J2 = of_frame(b.joint1, b.placement1), of_frame(b.joint2, b.placement2)
            R = self._R[i]
            linear = J1[:3] - pin.skew(self._r[i]) @ J1[3:] - R @ J2[:3]
            J[b.rows] = np.vstack([linear, J1[3:] - R @ J2[3:]])[list(b.selection)]

    def _turn_off(self) -> Array:
        """Rotation errors of hinges, cylindrical joints and sliders, as rotation vectors."""
        off = np.zeros_like(self._r)
        for i in self._sliders:
            off[i] = -pin.log3(self._R[i])
        if not len(self._aligned):
            return off
        e = self._axes
        turned = (self._R[self._aligned] @ e[:, :, None])[:, :, 0]
        across, cosine = cross(turned, e), dot(turned, e)
        sine = np.sqrt(dot(across, across))
        # an axis that points backwards is half a turn off, about any axis across
        across = np.where(
            sine[:, None] > 0, across, np.where(cosine[:, None] < 0, np.roll(e, 1, axis=1), 0)
        )
        scale = np.arctan2(sine, cosine) / np.where(sine > 0, sine, 1.0)
        off[self._aligned] = scale[:, None] * across
        return off


def relative_velocities(ends: Ends) -> tuple[Array, Array, Array, Array]:
    """Return R (k, 3, 3), r (k, 3), and the relative velocities and their rates (k, 2, 3)."""
    # Both have a linear and an angular part, in the axes of c1.
    R, r = ends.apart()
    (v1, v2), (a1, a2) = ends.linear()
    (w1, w2), (alpha1, alpha2) = ends.angular()
    (v2, w2), (a2, alpha2) = rotated(R, v2, w2), rotated(R, a2, alpha2)
    w1_r, alpha1_r, w1_w2 = cross(w1, r), cross(alpha1, r), cross(w1, w2)
    s, s_dot = np.empty((2, len(r), 2, 3))
    s[:, 0] = v1 + w1_r - v2
    s[:, 1] = w1 - w2
    s_dot[:, 0] = a1 - a2 + alpha1_r + cross(w1, w1_r - 2 * s[:, 0])
    s_dot[:, 1] = alpha1 - alpha2 + w1_w2
    return R, r, s, s_dot


def rotated(R: Array, *parts: Array) -> Array:
    """Products R x for each of many (k, 3, 3) and some parts (k, 3)."""
    x = np.empty((len(parts), len(R), 3, 1))
    for i, part in enumerate(parts):
        x[i, :, :, 0] = part
    return np.asarray((R @ x)[..., 0])


def cross(x: Array, y: Array) -> Array:
    """Cross products x x y of many (..., 3): a tenth of the time of `np.cross`."""
    x_yzx, y_yzx = x.take(_YZX, axis=-1), y.take(_YZX, axis=-1)
    return np.asarray(x_yzx * y.take(_ZXY, axis=-1) - x.take(_ZXY, axis=-1) * y_yzx)


def dot(x: Array, y: Array) -> Array:
    """Scalar products x . y of many (k, 3)."""
    return np.asarray(np.einsum("ij,ij->i", x, y))


# Loops that Pinocchio has itself: balls and welds between two bodies.
#
# With E1, E2 the frames c1, c2 in the world, R = R1^T R2, and every velocity and acceleration in
# the axes of its own frame,
#
#     3 rows:  c = -R1^T (p2 - p1)    J v = v1 - R v2            J a + gamma = a1 - R a2
#     6 rows:  c = -log6(E1^-1 E2)    J v = v1 - X v2 =: s    J a + gamma = a1 - X a2 + s x X v2
#
# with the classical acceleration of the points in the first line, spatial ones in the second, and X
# the action of E1^-1 E2. The last term is the turning of c1's axes, in which v2 is written.


class Balls:
    """All 3-row loops at once: R1^T times the difference of both ends in the world.

    `ends` are those of one state, or of many, whose forces are not needed.
    """

    def __init__(self, ends: PointEnds | ManyEnds, bounds: Sequence[BoundBetweenFrames]) -> None:
        self._ends = ends
        self._rows = rows_of(bounds)
        of_all = np.zeros((3, len(bounds), 3))
        self._of_each, self._of_all = of_all.swapaxes(0, 1), tuple(of_all.reshape(3, -1))

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows of these loops into the three vectors of all rows."""
        rows = self._rows
        R1, apart = self._ends.evaluate()
        np.matmul(apart, R1, out=self._of_each)
        c[rows], velocity[rows], acceleration[rows] = self._of_all

    def violation(self, c: Array) -> None:
        """Write c of these loops: placements in `data` are enough."""
        one, two = self._ends.placements()
        c[self._rows] = ((one[:, 3:] - two[:, 3:]) @ one[:, :3].swapaxes(1, 2)).reshape(-1)

    def stack(self, lam: Array, _: Array, f2: Array) -> None:
        """Write R^T lam, the forces in the axes of c2, for the rows of these loops."""
        assert isinstance(self._ends, PointEnds)
        f2[self._rows] = self._ends.push(lam[self._rows].reshape(-1, 1, 3)).reshape(-1)


class Weld:
    """One 6-row loop."""

    def __init__(self, data: Any, bound: BoundBetweenFrames) -> None:
        self._data, self._bound = data, bound  # data keeps alive what the next lines refer to
        self._oMi1, self._oMi2 = data.oMi[bound.joint1], data.oMi[bound.joint2]
        self._v1, self._v2 = data.v[bound.joint1], data.v[bound.joint2]
        self._a1, self._a2 = data.a[bound.joint1], data.a[bound.joint2]
        self._c1Mc2 = pin.SE3.Identity()  # of the last evaluation

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows of this loop into the three vectors of all rows."""
        self.violation(c)
        b, one, two = self._bound, self._bound.placement1, self._bound.placement2
        between = self._c1Mc2
        v2, a2 = between.act(two.actInv(self._v2)), between.act(two.actInv(self._a2))
        s = one.actInv(self._v1) - v2
        velocity[b.rows] = s.vector
        acceleration[b.rows] = (one.actInv(self._a1) - a2 + s.cross(v2)).vector

    def violation(self, c: Array) -> None:
        """Write c of this loop: placements in `data` are enough."""
        b = self._bound
        self._c1Mc2 = (self._oMi1 * b.placement1).actInv(self._oMi2 * b.placement2)
        c[b.rows] = -pin.log6(self._c1Mc2).vector

    def stack(self, lam: Array, _: Array, f2: Array) -> None:
        """Write X^T lam, the wrench in the axes and at the origin of c2."""
        rows = self._bound.rows
        f2[rows] = self._c1Mc2.toActionMatrix().T @ lam[rows]


# Rods: loops whose one row is a distance.
#
# With p1, p2 the origins of c1 and c2 in the world, r = p2 - p1, n = r / |r| and s = p1' - p2',
#
#     c = L - |r|,    J v = n . s,    J a + gamma = n . s' - (|s|^2 - (n . s)^2) / |r|.


_SMALLEST = 1e-300  # keeps 0/0 out of a direction that does not exist


class Rods:
    """All rods of one scene."""

    def __init__(self, ends: Ends, bounds: Sequence[BoundBetweenFrames]) -> None:
        self._bounds, self._ends = tuple(bounds), ends
        self._rows = rows_of(bounds)
        self._lengths = np.array([b.length for b in bounds])
        k = len(bounds)
        self._n = np.zeros((2, k, 3))  # in the axes of c1, and of c2
        # rows (v, 0), (a, 0) and (0, 1) of each end: times its placement v, a and p in the world
        self._motion = np.zeros((2, k, 3, 4))
        self._motion[:, :, 2, 3] = 1.0
        self._linear = self._motion[:, :, :2, :3].transpose(2, 0, 1, 3)  # a view

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows of these loops into the three vectors of all rows."""
        E = self._ends.placements()
        self._linear[:] = self._ends.linear()
        one, two = self._motion @ E
        both = one - two  # s, s' and -r of each rod
        s_s, s_r, a_r, r_r = (both @ both.swapaxes(1, 2))[:, (0, 0, 1, 2), (0, 2, 2, 2)].T
        distance = np.sqrt(r_r)
        per_distance = -1.0 / np.maximum(distance, _SMALLEST)
        along = s_r * per_distance
        c[self._rows] = self._lengths - distance
        velocity[self._rows] = along
        acceleration[self._rows] = (a_r + s_s - along * along) * per_distance
        self._n = ((E[:, :, :3] @ both[:, 2, :, None])[..., 0]) * per_distance[:, None]

    def stack(self, lam: Array, f1: Array, f2: Array) -> None:
        """Write the forces (3 k) at the origins of c1 and c2, each in its axes."""
        one, two = lam[self._rows][:, None] * self._n
        f1[:], f2[:] = one.reshape(-1), two.reshape(-1)

    def jacobian(self, J: Array, of_frame: FrameJacobian) -> None:
        """Write the rows of these loops into J (m, nv), at the last evaluation."""
        for b, n1, n2 in zip(self._bounds, *self._n, strict=True):
            J1, J2 = of_frame(b.joint1, b.placement1), of_frame(b.joint2, b.placement2)
            J[b.rows] = n1 @ J1[:3] - n2 @ J2[:3]


# The two ends of many points at once: axes, places and motions in the world, and forces on them.
#
# A point at s in the axes of its joint, which is placed at (R, t) in the world and has there, in
# its own axes, the velocity (v, w) and the acceleration (a, alpha), spatial ones, moves by
#
#     p = R s + t,    p' = R u,    p'' = R (a + alpha x s + w x u),    u = v + w x s


# The rows of an end in `PointEnds.places`, of three numbers each: axes of its frame in the world,
# p, p' and p'', the force on it, and a one with two zeros.
AXES, MOVING, FORCE, ONE, ROWS = slice(3), slice(3, 6), slice(6, 7), 7, 8


class PointEnds:
    """Ends of k points, after forward kinematics into `data`.

    places (2, k, 8, 3): What is known of c1 and of c2, in the world: overwritten by the next
        evaluation. All others are views of it.
    axes1 (k, 3, 3): axes of c1, one a row
    of_c1, of_c2 (k, 2, 3): p'' and the force, which is on c2 alone
    known (2 k, 15): all but axes, of c1 and behind all of them c2
    """

    def __init__(self, data: Any, bounds: Sequence[TwoFrameConstraint]) -> None:
        k = len(bounds)
        ends = [(b.joint1, b.placement1) for b in bounds]
        ends += [(b.joint2, b.placement2) for b in bounds]
        joints = Joints(data, {joint for joint, _ in ends})
        # views into data's own memory, one call copies them all: [R^T, t] of the joint of each end,
        # and then how joints move
        placements = [placement_view(data.oMi[joint]).T.reshape(-1) for joint, _ in ends]
        self._sources = [*placements, *joints.sources]
        self._read = np.zeros(24 * k + 2 * joints.size)
        self._of_joints = self._read[: 24 * k].reshape(2, k, 4, 3)
        self._motion = self._read[24 * k :].reshape(2, joints.size)
        self._make_rows(ends, joints)
        self._name_places(k)

    def _make_rows(self, ends: Sequence[tuple[int, Any]], joints: Joints) -> None:
        """Make the rows of each end in its joint: axes, s, u and p'', and the map to the last two.

        Times [R^T, t] they are those in the world.
        """
        k, aligned = len(ends) // 2, [(j, pin.SE3(np.eye(3), p.translation)) for j, p in ends]
        self._rows = np.zeros((2, k, 6, 4))
        self._rows[:, :, :4] = np.array([p.homogeneous.T for _, p in ends]).reshape(2, k, 4, 4)
        self._moving_rows = self._rows[:, :, 4:, :3].transpose(2, 0, 1, 3)
        linear, angular = joints.maps(aligned)
        crossed = Centripetal(linear, angular).factors
        self._map = np.ascontiguousarray(np.vstack([linear, crossed]).T)
        # u of all ends, and what w x u is made of; below, a + alpha x s, and what is of no use
        self._found = np.zeros((2, 30 * k))
        self._moving = self._found[:, : 6 * k].reshape(2, 2, k, 3)
        self._a = self._moving[1]
        self._w, self._across = self._found[0, 6 * k :].reshape(2, 2, 2, k, 3)
        self._products = np.zeros((2, 2, k, 3))
        self._forth, self._back = self._products

    def _name_places(self, k: int) -> None:
        """Make `places`, and its views."""
        self.places = np.zeros((2, k, ROWS, 3))
        self.places[:, :, ONE, 0] = 1.0
        self.known = self.places.reshape(2 * k, 3 * ROWS)[:, 3 * AXES.stop :]
        self._in_world, (one, two) = self.places[:, :, : MOVING.stop], self.places
        self.axes1, self._force = one[:, AXES], two[:, FORCE]
        self._axes1T, self._axes2T = one[:, AXES].swapaxes(1, 2), two[:, AXES].swapaxes(1, 2)
        self.of_c1, self.of_c2 = one[:, MOVING.stop - 1 : ONE], two[:, MOVING.stop - 1 : ONE]
        self._between = np.zeros((k, ROWS, 3))
        self._evaluated = self._axes1T, self._between[:, MOVING]
        self._one, self._two = one, two

    def evaluate(self) -> tuple[Array, Array]:
        """Return R1 (k, 3, 3), and p, p' and p'' (k, 3, 3) of c1 less those of c2, a row each."""
        np.concatenate(self._sources, out=self._read)
        np.dot(self._motion, self._map, out=self._found)
        np.multiply(self._w, self._across, out=self._products)
        self._a += np.subtract(self._forth, self._back, out=self._forth)
        self._moving_rows[:] = self._moving
        np.matmul(self._rows, self._of_joints, out=self._in_world)
        np.subtract(self._one, self._two, out=self._between)  # the whole is quicker than a part
        return self._evaluated

    def push(self, lam: Array) -> Array:
        """Set the force to lam (k, 1, 3), in the axes of c1; return it in those of c2."""
        force = np.matmul(lam, self.axes1, out=self._force)
        return force @ self._axes2T

    def placements(self) -> Array:
        """Placements E (2, k, 4, 3): axes of c1 and c2 in the world, one a row; then origins."""
        np.concatenate(self._sources, out=self._read)
        return self._rows[:, :, :4] @ self._of_joints
