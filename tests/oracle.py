"""Rigid-body dynamics in 50 digits, that shares no formula and no code with the library.

Everything is written for points in the axes of the world, with the classical acceleration of the
origin of each body, where Pinocchio carries spatial vectors in the axes of the bodies:

    joint              omega_i - omega_p        v_i - (v_p + omega_p x d)      d = p_i - p_p
    turn about z       z q'                     0
    shift along z      0                        z q'
    ball               R_i w                    0
    free-flyer         R_i w                    R_i v
    plane              z q3'                    R_i (v1, v2, 0)
    screw              z q'                     z pitch q'
    ellipsoid          turns about x, y, z      s',  s = radii * (third axis)

and a composite joint is its parts, one after the other.

Newton and Euler give the torques, from the tips to the root,

    f = m (a_com - g),   n = I alpha + omega x I omega,

M column by column from torques of unit accelerations, J the same way from unit velocities, and
gamma is J a + gamma for a = 0: the derivative of the slip in the turning axes of c1, as the
library defines it for each kind. Then, with G = J M^-1 J^T taken apart by its eigenvalues,

    lam = G^+ (a_ref - gamma - J a_free),    a = a_free + M^-1 J^T lam.

Numbers are mpmath's, kept in numpy's arrays of objects. Inputs are doubles, taken exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import mpmath
import numpy as np

import condyn_pin as cp
from condyn_pin.constraints.rows.bound import FRAME, POINT, BoundBetweenFrames
from condyn_pin.constraints.rows.special import BoundRolling

DIGITS = 50
mp = mpmath.mp.clone()
mp.dps = DIGITS

exact = np.vectorize(mp.mpf, otypes=[object])


def vector(*numbers: float) -> np.ndarray:
    return exact(np.array(numbers, dtype=object))


ZERO, ONE = vector(0, 0, 0), exact(np.eye(3))
AXES = {"X": vector(1, 0, 0), "Y": vector(0, 1, 0), "Z": vector(0, 0, 1)}


def cross(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.array(
        [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]
    )


def turn(axis: np.ndarray, c: mpmath.mpf, s: mpmath.mpf) -> np.ndarray:
    """Rodrigues: 1 + s [axis] + (1 - c) [axis]^2."""
    K = np.array([cross(axis, e) for e in ONE]).T
    return ONE + s * K + (1 - c) * (K @ K)


def of_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """The rotation of x y z w, taken for the unit quaternion that it is nearly."""
    x, y, z, w = quaternion / mp.sqrt(sum(quaternion**2))
    s = mp.sqrt(x * x + y * y + z * z)
    if s == 0:
        return ONE
    return turn(np.array([x, y, z]) / s, w * w - s * s, 2 * w * s)


@dataclass
class Body:
    """Placement and motion of one body, in the world; the world itself to begin with."""

    R: np.ndarray
    p: np.ndarray
    omega: np.ndarray
    v: np.ndarray
    alpha: np.ndarray
    a: np.ndarray

    def carried(self, R: np.ndarray, p: np.ndarray) -> Body:
        """A frame that is fixed to the body."""
        d = self.R @ p
        turning = cross(self.omega, d)
        return Body(
            self.R @ R, self.p + d, self.omega, self.v + turning, self.alpha,
            self.a + cross(self.alpha, d) + cross(self.omega, turning),
        )  # fmt: skip

    def turned(self, z: np.ndarray, R: np.ndarray, w: mpmath.mpf, dw: mpmath.mpf) -> Body:
        """What turns on the body at its origin, about z of the world with w."""
        return Body(
            R, self.p, self.omega + z * w, self.v,
            self.alpha + z * dw + cross(self.omega, z * w), self.a,
        )  # fmt: skip

    def shifted(self, d: np.ndarray, v: np.ndarray, a: np.ndarray) -> Body:
        """What moves on the body: d, v, a as seen from it, in the axes of the world."""
        turning = cross(self.omega, d)
        return Body(
            self.R, self.p + d, self.omega, self.v + turning + v, self.alpha,
            self.a + cross(self.alpha, d) + cross(self.omega, turning)
            + 2 * cross(self.omega, v) + a,
        )  # fmt: skip


class Oracle:
    """The equations of one scene."""

    def __init__(self, scene: cp.Scene):
        self.model, self.bounds, self.m = scene.robot.model, scene.bounds, scene.rows
        self.nv = self.model.nv
        self.gravity = exact(np.array(self.model.gravity.linear))

    def bodies(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> list[Body]:
        q, v, a = exact(q), exact(v), exact(a)
        found = [Body(ONE, ZERO, ZERO, ZERO, ZERO, ZERO)]
        for i in range(1, self.model.njoints):
            joint, place = self.model.joints[i], self.model.jointPlacements[i]
            base = found[self.model.parents[i]].carried(
                exact(place.rotation), exact(place.translation)
            )
            parts = (
                q[joint.idx_q : joint.idx_q + joint.nq],
                v[joint.idx_v : joint.idx_v + joint.nv],
                a[joint.idx_v : joint.idx_v + joint.nv],
            )
            found.append(_across(joint, base, *parts))
        return found

    def torque(self, bodies: list[Body], gravity: np.ndarray) -> np.ndarray:
        """Newton-Euler: what the joints have to give, without armature."""
        forces = [ZERO] * len(bodies)
        moments = [ZERO] * len(bodies)  # about the origin of each body
        tau = np.full(self.nv, mp.mpf(0))
        for i in range(len(bodies) - 1, 0, -1):
            body, inertia = bodies[i], self.model.inertias[i]
            lever = body.R @ exact(np.array(inertia.lever))
            a_com = body.a + cross(body.alpha, lever)
            a_com = a_com + cross(body.omega, cross(body.omega, lever))
            I_world = body.R @ exact(np.array(inertia.inertia)) @ body.R.T
            f = mp.mpf(inertia.mass) * (a_com - gravity)
            n = I_world @ body.alpha + cross(body.omega, I_world @ body.omega)
            forces[i] = forces[i] + f
            moments[i] = moments[i] + n + cross(lever, f)
            parent = self.model.parents[i]
            forces[parent] = forces[parent] + forces[i]
            d = body.p - bodies[parent].p
            moments[parent] = moments[parent] + moments[i] + cross(d, forces[i])
            joint = self.model.joints[i]
            for k, (z, along) in enumerate(self._columns(i, bodies)):
                tau[joint.idx_v + k] = sum(z * moments[i]) + sum(along * forces[i])
        return tau

    def _columns(self, i: int, bodies: list[Body]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Angular and linear velocity of body i for a unit velocity of its joint."""
        joint, place = self.model.joints[i], self.model.jointPlacements[i]
        parent, columns = bodies[self.model.parents[i]], []
        at = Body(parent.R, bodies[i].p, ZERO, ZERO, ZERO, ZERO)
        base = at.carried(exact(place.rotation), ZERO)
        q = exact(self._q[joint.idx_q : joint.idx_q + joint.nq])
        if joint.nv > 1:
            nothing = vector(*[0] * joint.nv)
            for unit in exact(np.eye(joint.nv)):
                moved = _across(joint, base, q, unit, nothing)
                columns.append((moved.omega, moved.v))
            return columns
        moved = _across(joint, base, q, vector(1), vector(0))
        return [(moved.omega, moved.v)]

    def constraint_velocity(self, bodies: list[Body], q: np.ndarray, v: np.ndarray, a: np.ndarray):
        """J v and J a + gamma."""
        velocity, acceleration = np.full((2, self.m), mp.mpf(0))
        for b in self.bounds:
            if isinstance(b, BoundRolling):
                raise NotImplementedError(f"{b.name}: the oracle knows nothing that rolls")
            if not isinstance(b, BoundBetweenFrames):
                assert not b.bends
                weights = [mp.mpf(w) for w in b.weights]
                for found, x in ((velocity, v), (acceleration, a)):
                    terms = (w * mp.mpf(x[i]) for w, i in zip(weights, b.velocity, strict=True))
                    found[b.rows] = sum(terms)
                continue
            one, two = (
                bodies[joint].carried(exact(place.rotation), exact(place.translation))
                for joint, place in ((b.joint1, b.placement1), (b.joint2, b.placement2))
            )
            velocity[b.rows], acceleration[b.rows] = _slip(b, one, two)
            velocity[b.rows] *= mp.mpf(b.sign)
            acceleration[b.rows] *= mp.mpf(b.sign)
        return velocity, acceleration

    def terms(self, q: np.ndarray, v: np.ndarray):
        """M, h, J and gamma."""
        self._q, n = q, self.nv
        still = np.zeros(n)
        moving = self.bodies(q, v, still)
        h = self.torque(moving, self.gravity)
        gamma = self.constraint_velocity(moving, q, v, still)[1]
        M, J = np.full((n, n), mp.mpf(0)), np.full((self.m, n), mp.mpf(0))
        for k, unit in enumerate(np.eye(n)):
            M[:, k] = self.torque(self.bodies(q, still, unit), ZERO)
            J[:, k] = self.constraint_velocity(self.bodies(q, unit, still), q, unit, still)[0]
        return M + np.diag(exact(np.array(self.model.armature))), h, J, gamma

    def solve(self, q, v, tau, rank_tolerance: float = 1e-11):
        """a and the smallest lam; singular values of J L^-T below the tolerance are zeros."""
        M, h, J, gamma = self.terms(q, v)
        L = mp.cholesky(mp.matrix(M.tolist()))
        free = np.array(
            mp.cholesky_solve(mp.matrix(M.tolist()), mp.matrix((exact(tau) - h).tolist()))
        )
        free = free.reshape(-1)
        if not self.m:
            return free, np.full(0, mp.mpf(0))
        W = np.array([_forward(L, row) for row in J])  # J L^-T
        G = W @ W.T
        values, vectors = mp.eigsy(mp.matrix(G.tolist()))
        U = np.array(vectors.tolist(), dtype=object).reshape(self.m, self.m)
        largest = max(values)
        missing = U.T @ (-gamma - J @ free)
        share = mp.mpf(rank_tolerance) ** 2
        kept = [
            x / s if s > share * largest else mp.mpf(0)
            for x, s in zip(missing, values, strict=True)
        ]
        lam = U @ np.array(kept, dtype=object)
        return free + _backward(L, W.T @ lam), lam


def _across(joint, base: Body, q, v, a) -> Body:
    """The body beyond a joint."""
    kind = joint.shortname().removeprefix("JointModel")
    if kind == "FreeFlyer":
        R = base.R @ of_quaternion(q[3:])
        w, dw = R @ v[3:], R @ a[3:]
        moved = base.shifted(base.R @ q[:3], R @ v[:3], R @ a[:3] + cross(w, R @ v[:3]))
        return moved.turned(w, R, mp.mpf(1), mp.mpf(0)).turned(dw, R, mp.mpf(0), mp.mpf(1))
    if kind == "Spherical":
        R = base.R @ of_quaternion(q)
        w, dw = R @ v, R @ a
        return base.turned(w, R, mp.mpf(1), mp.mpf(0)).turned(dw, R, mp.mpf(0), mp.mpf(1))
    if kind == "SphericalZYX":
        for axis, *one in zip("ZYX", q, v, a, strict=True):
            base = _revolve(base, AXES[axis], mp.cos(one[0]), mp.sin(one[0]), *one[1:])
        return base
    if kind == "Planar":
        R = base.R @ turn(AXES["Z"], q[2] / mp.hypot(*q[2:]), q[3] / mp.hypot(*q[2:]))
        shift, w = vector(q[0], q[1], 0), base.R @ vector(0, 0, v[2])
        speed, rate = R @ vector(v[0], v[1], 0), R @ vector(a[0], a[1], 0)
        moved = base.shifted(base.R @ shift, speed, rate + cross(w, speed))
        return moved.turned(base.R @ AXES["Z"], R, v[2], a[2])
    if kind == "Translation":
        return base.shifted(*(base.R @ x for x in (q, v, a)))
    if kind == "Universal":
        for axis, *one in zip((joint.extract().axis1, joint.extract().axis2), q, v, a, strict=True):
            base = _revolve(base, exact(np.array(axis)), mp.cos(one[0]), mp.sin(one[0]), *one[1:])
        return base
    if kind == "Ellipsoid":
        return _on_ellipsoid(joint.extract(), base, q, v, a)
    if kind == "Composite":
        at = 0
        for part, place in zip(
            joint.extract().joints, joint.extract().jointPlacements, strict=True
        ):
            base = base.carried(exact(place.rotation), exact(place.translation))
            base = _across(part, base, *(x[at : at + part.nv] for x in (q, v, a)))
            at += part.nv
        return base
    if kind in ("HX", "HY", "HZ", "HelicalUnaligned"):
        axis = AXES.get(kind[1:])
        axis = exact(np.array(joint.extract().axis)) if axis is None else axis
        pitch, z = mp.mpf(joint.extract().pitch), base.R @ axis
        base = base.shifted(*(z * (pitch * x) for x in (q[0], v[0], a[0])))
        return _revolve(base, axis, mp.cos(q[0]), mp.sin(q[0]), v[0], a[0])
    if kind.startswith("P"):
        axis = AXES.get(kind[1:])
        z = base.R @ (exact(np.array(joint.extract().axis)) if axis is None else axis)
        return base.shifted(z * q[0], z * v[0], z * a[0])
    if kind.startswith("RUB") or kind == "RevoluteUnboundedUnaligned":
        c, s = q / mp.sqrt(sum(q**2))
    else:
        c, s = mp.cos(q[0]), mp.sin(q[0])
    if kind in ("RevoluteUnaligned", "RevoluteUnboundedUnaligned"):
        axis = exact(_axis(joint))
        axis = axis / mp.sqrt(sum(axis**2))
    else:
        axis = AXES[kind[-1]]
    return _revolve(base, axis, c, s, v[0], a[0])


def _axis(joint) -> np.ndarray:
    """The axis of a hinge; that of an unbounded one is only in its S."""
    if hasattr(joint.extract(), "axis"):
        return np.array(joint.extract().axis)
    data, q = joint.createData(), np.zeros(joint.idx_q + joint.nq)
    q[joint.idx_q] = 1.0
    joint.calc(data, q)
    return np.array(data.S).ravel()[3:]


def _on_ellipsoid(joint, base: Body, q, v, a) -> Body:
    """Where the third axis after turns about x, y and z is the normal of the unit sphere."""
    (sx, cx), (sy, cy) = ((mp.sin(x), mp.cos(x)) for x in q[:2])
    (vx, vy), (ax, ay) = v[:2], a[:2]
    normal = vector(sy, -sx * cy, cx * cy)
    first = vector(cy * vy, -cx * cy * vx + sx * sy * vy, -sx * cy * vx - cx * sy * vy)
    mixed, both = 2 * vx * vy * sy, vx**2 + vy**2
    second = vector(
        cy * ay - sy * vy**2,
        -cx * cy * ax + sx * sy * ay + sx * cy * both + cx * mixed,
        -sx * cy * ax - cx * sy * ay - cx * cy * both + sx * mixed,
    )
    radii = exact(np.array([joint.radius_x, joint.radius_y, joint.radius_z]))
    base = base.shifted(*(base.R @ (radii * x) for x in (normal, first, second)))
    for axis, *one in zip("XYZ", q, v, a, strict=True):
        base = _revolve(base, AXES[axis], mp.cos(one[0]), mp.sin(one[0]), *one[1:])
    return base


def _revolve(base: Body, axis, c, s, v, a) -> Body:
    return base.turned(base.R @ axis, base.R @ turn(axis, c, s), v, a)


def _slip(b: BoundBetweenFrames, one: Body, two: Body):
    """The rows of one constraint, in the axes of c1, and their derivatives."""
    to_c1, r = one.R.T, two.p - one.p
    if b.selection == POINT:  # two points; classical accelerations
        return to_c1 @ (one.v - two.v), to_c1 @ (one.a - two.a)
    held = not (b.anchored or b.joint2) and b.joint1
    if b.selection == FRAME or held:  # the two bodies compared where c1 is
        s = one.v - two.v + cross(two.omega, r)
        s_dot = one.a - two.a + cross(two.alpha, r) - cross(two.omega, one.v - two.v)
    else:  # compared where c2 is
        s = one.v + cross(one.omega, r) - two.v
        s_dot = one.a + cross(one.alpha, r) + cross(one.omega, two.v - one.v) - two.a
    turning = one.omega - two.omega
    turning_dot = one.alpha - two.alpha
    six = np.concatenate([to_c1 @ s, to_c1 @ turning])
    six_dot = np.concatenate(
        [to_c1 @ (s_dot - cross(one.omega, s)), to_c1 @ (turning_dot - cross(one.omega, turning))]
    )
    if b.is_rod:  # the distance, whose second derivative is n . s' less the turning of n
        length = mp.sqrt(sum(r**2))
        n = to_c1 @ r / length
        along = sum(n * six[:3])
        across = sum(six[:3] ** 2) - along**2
        return np.array([along]), np.array([sum(n * six_dot[:3]) - across / length])
    chosen = list(b.selection)
    return six[chosen], six_dot[chosen]


def _forward(L, b) -> np.ndarray:
    """L^-1 b."""
    x: list = []
    for i, each in enumerate(b):
        x.append((each - mp.fsum(L[i, k] * x[k] for k in range(i))) / L[i, i])
    return np.array(x, dtype=object)


def _backward(L, b) -> np.ndarray:
    """L^-T b."""
    n = len(b)
    x = [mp.mpf(0)] * n
    for i in range(n - 1, -1, -1):
        x[i] = (b[i] - mp.fsum(L[k, i] * x[k] for k in range(i + 1, n))) / L[i, i]
    return np.array(x, dtype=object)
