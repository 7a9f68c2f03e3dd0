"""Constrained dynamics from positions alone, in 64 bits of mantissa: the judge of the campaign.

No twist, no joint axis and no row of the library, or of Pinocchio, enters. A state that moves along

    q(t) = q + t v      on the manifold of configurations

moves every body; R(t) and p(t) are carried with their first and second derivative through products
and sums, joint by joint, from what each joint is: a turn, a shift, or both. Along e_j the first
derivatives are columns of Jacobians, along v the second ones are what is left where a = 0. With
c and w the centre of mass and the angular velocity of a body, d'Alembert says

    M = sum_i m C^T C + W^T I W + armature,       C = dc'/dv,  W = dw/dv,
    h = sum_i m C^T (c'' - g) + W^T (I w' + w x I w),
    J = ds/dv,    gamma = s'  where a = 0,

s being the rate of what a constraint keeps, or the slip of what rolls. Rows may differ from the
library's by a turn of their axes: at a state with c = 0 and J v = 0 the motion is the same. They
are written from the definitions in the docstrings of `condyn_pin.Loop`, the contacts, and what
rolls. With
M = L L^T and L^-1 J^T P = Q R, pivots falling, the motion nearest to the free one is

    a = L^-T ( Q y + (1 - Q Q^T) x ),     R^T y = P^T (-gamma),    x = L^-1 (tau - h).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

import condyn_pin as cp

# --- functions of time with their derivatives, along many directions at once

Array = np.ndarray
REAL = np.longdouble
ONE = np.eye(3, dtype=REAL)


def exact(x: Any) -> Array:
    """Return numbers in extended precision."""
    return np.asarray(x, dtype=REAL)


def skew(w: Array) -> Array:
    """Return the matrices of w x."""
    K = np.zeros((*w.shape[:-1], 3, 3), dtype=REAL)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        K[..., j, i], K[..., i, j] = w[..., k], -w[..., k]
    return K


def vee(K: Array) -> Array:
    """Return the vectors of the skew parts of matrices."""
    D = (K - np.swapaxes(K, -1, -2)) / 2
    return np.stack([D[..., 2, 1], D[..., 0, 2], D[..., 1, 0]], axis=-1)


@dataclass(frozen=True)
class Jet:
    """A function of time along many directions: its value, its rate and the rate of that."""

    x: Array
    d: Array
    dd: Array

    def __add__(self, other: Jet) -> Jet:
        return Jet(self.x + other.x, self.d + other.d, self.dd + other.dd)

    def __sub__(self, other: Jet) -> Jet:
        return Jet(self.x - other.x, self.d - other.d, self.dd - other.dd)

    def map(self, linear: Callable[[Array], Array]) -> Jet:
        """Return a linear function of this."""
        return Jet(linear(self.x), linear(self.d), linear(self.dd))

    def over(self, other: Jet) -> Jet:
        """Return the quotient by a scalar."""
        x = self.x / other.x
        d = (self.d - x * other.d) / other.x
        return Jet(x, d, (self.dd - 2 * d * other.d - x * other.dd) / other.x)

    def root(self) -> Jet:
        """Return the square root."""
        x = np.sqrt(self.x)
        d = self.d / (2 * x)
        return Jet(x, d, (self.dd - 2 * d * d) / (2 * x))


def product(f: Callable[[Array, Array], Array], a: Jet, b: Jet) -> Jet:
    """Return what is linear in both."""
    return Jet(
        f(a.x, b.x), f(a.d, b.x) + f(a.x, b.d), f(a.dd, b.x) + 2 * f(a.d, b.d) + f(a.x, b.dd)
    )


def times(A: Jet, B: Jet) -> Jet:
    """Return A B."""
    return product(np.matmul, A, B)


def apply(A: Jet, b: Jet) -> Jet:
    """Return A b."""
    return product(lambda R, p: (R @ p[..., None])[..., 0], A, b)


def dot(a: Jet, b: Jet) -> Jet:
    """Return a . b, as (..., 1)."""
    return product(lambda x, y: (x * y).sum(axis=-1, keepdims=True), a, b)


def cross(a: Jet, b: Jet) -> Jet:
    """Return a x b."""
    return product(lambda x, y: np.cross(*np.broadcast_arrays(x, y)), a, b)


def unit(a: Jet) -> Jet:
    """Return a / |a|."""
    return a.over(dot(a, a).root())


def constant(x: Any) -> Jet:
    """Return what does not move."""
    x = exact(x)
    return Jet(x, np.zeros_like(x), np.zeros_like(x))


def transposed(A: Jet) -> Jet:
    """Return A^T."""
    return A.map(lambda R: np.swapaxes(R, -1, -2))


@dataclass(frozen=True)
class Place:
    """Axes and origin in the world, or in another place."""

    R: Jet
    p: Jet

    def __mul__(self, other: Place) -> Place:
        return Place(times(self.R, other.R), apply(self.R, other.p) + self.p)

    @property
    def w(self) -> tuple[Array, Array]:
        """Angular velocity and acceleration."""
        back = np.swapaxes(self.R.x, -1, -2)
        return vee(self.R.d @ back), vee(self.R.dd @ back)


def fixed(placement: Any) -> Place:
    """Return a placement that does not move."""
    return Place(constant(placement.rotation), constant(placement.translation))


def turn(axis: Array, angle: Jet) -> Place:
    """Return a turn, by Rodrigues; angle.x is an angle or (cos, sin)."""
    K, x, w = skew(axis), angle.x, angle.d
    c, s = (x[:1], x[1:]) if len(x) == 2 else (np.cos(x), np.sin(x))
    zero = np.zeros(3, dtype=REAL)

    def of(c: Array, s: Array) -> Array:
        return s[:, None, None] * K - c[:, None, None] * (K @ K)

    R = Jet(ONE + K @ K + of(c, s)[0], of(-s * w, c * w), of(-c * w * w, -s * w * w))
    return Place(R, Jet(zero, np.zeros((len(w), 3), REAL), np.zeros((len(w), 3), REAL)))


def shift(axis: Array, length: Jet) -> Place:
    """Return a shift along an axis."""
    return Place(constant(ONE), length.map(lambda x: x[..., None] * axis))


def body_motion(R: Array, p: Array, v: Array, w: Array) -> Place:
    """Return a motion with a velocity that is constant in its own axes."""
    K = skew(w)
    along = (R @ v[..., None])[..., 0]
    bent = (R @ K @ v[..., None])[..., 0]
    return Place(Jet(R, R @ K, R @ K @ K), Jet(p, along, bent))


def of_quaternion(quaternion: Array) -> Array:
    """Return the rotation of x y z w."""
    x, y, z, w = quaternion / np.sqrt((quaternion**2).sum())
    K = skew(np.array([x, y, z]))
    return ONE + 2 * w * K + 2 * K @ K


# Pivots of L^-1 J^T, relative to the largest, that are rounding, and that are none; between the two
# nobody can say.
NOTHING, SOMETHING = 1e-13, 1e-10


# --- joints


def across(joint: Any, q: Array, v: Array) -> Place:
    """Return the placement that a joint makes, q (nq,), along directions v (D, nv)."""
    kind = joint.shortname().removeprefix("JointModel")
    if kind == "Composite":
        place, nq, nv = fixed(pin.SE3.Identity()), 0, 0
        parts = joint.extract()
        for part, placement in zip(parts.joints, parts.jointPlacements, strict=True):
            here = across(part, q[nq : nq + part.nq], v[:, nv : nv + part.nv])
            place = place * fixed(placement) * here
            nq, nv = nq + part.nq, nv + part.nv
        return place
    still = np.zeros_like(v)
    line = [Jet(x[None], *along) for x, *along in zip(q, v.T, still.T, strict=False)]
    none = np.zeros((len(v), 1), REAL)
    if kind == "FreeFlyer":
        return body_motion(of_quaternion(q[3:]), q[:3], v[:, :3], v[:, 3:])
    if kind == "Spherical":
        return body_motion(of_quaternion(q), np.zeros(3, REAL), np.zeros_like(v), v)
    if kind == "Planar":
        R = np.array([[q[2], -q[3], 0], [q[3], q[2], 0], [0, 0, 1]], REAL)
        flat, up = np.hstack([v[:, :2], none]), np.hstack([none, none, v[:, 2:]])
        return body_motion(R, np.array([q[0], q[1], 0], REAL), flat, up)
    if kind == "Translation":
        return Place(constant(ONE), Jet(q, v, still))
    if kind == "SphericalZYX":
        return turn(ONE[2], line[0]) * turn(ONE[1], line[1]) * turn(ONE[0], line[2])
    if kind == "Universal":
        one, two = exact(joint.extract().axis1), exact(joint.extract().axis2)
        return turn(one, line[0]) * turn(two, line[1])
    if kind == "Ellipsoid":
        return _ellipsoid(joint.extract(), line)
    axis = _axis(joint, kind)
    if "RevoluteUnbounded" in kind or kind.startswith("RUB"):
        return turn(axis, Jet(q / np.hypot(*q), v[:, 0], still[:, 0]))
    if kind.startswith("P"):
        return shift(axis, line[0])
    if kind.startswith("H"):
        pitch = exact(joint.extract().pitch)
        return turn(axis, line[0]) * shift(axis, line[0].map(lambda x: pitch * x))
    return turn(axis, line[0])


def _axis(joint: Any, kind: str) -> Array:
    if kind.endswith("Unaligned"):
        if "Unbounded" in kind:  # Python sees its axis only in a quarter turn
            data, q = joint.createData(), np.zeros(joint.idx_q + 2)
            q[-1] = 1.0
            joint.calc(data, q)
            axis = vee(exact(data.M.rotation))
        else:
            axis = exact(joint.extract().axis)
        return axis / np.sqrt((axis**2).sum())
    return ONE["XYZ".index(kind[-1])]


def _ellipsoid(joint: Any, q: Sequence[Jet]) -> Place:
    """Return a point on the surface, with the body turned to it."""
    turned = turn(ONE[0], q[0]) * turn(ONE[1], q[1]) * turn(ONE[2], q[2])
    radii = exact([joint.radius_x, joint.radius_y, joint.radius_z])
    normal = turned.R.map(lambda R: R[..., 2])  # (sin b, -sin a cos b, cos a cos b)
    return Place(turned.R, normal.map(lambda n: radii * n))


# --- the equations


class Oracle:
    """M, h and the places of all bodies of a model at a state."""

    def __init__(self, model: Any, q: Array, v: Array) -> None:
        self.model, n = model, model.nv
        along = np.vstack([np.eye(n, dtype=REAL), exact(v)])
        q = exact(q)
        still, here = np.zeros((n + 1, 3, 3), REAL), np.zeros((n + 1, 3), REAL)
        self.places = [Place(Jet(ONE, still, still), Jet(here[0], here, here))]
        M, h = np.diag(exact(model.armature)), np.zeros(n, REAL)
        gravity = exact(model.gravity.linear)
        for i in range(1, model.njoints):
            joint, inertia = model.joints[i], model.inertias[i]
            own_q = q[joint.idx_q : joint.idx_q + joint.nq]
            own_v = along[:, joint.idx_v : joint.idx_v + joint.nv]
            base = self.places[model.parents[i]] * fixed(model.jointPlacements[i])
            place = base * across(joint, own_q, own_v)
            self.places.append(place)
            centre = apply(place.R, constant(inertia.lever)) + place.p
            w, turning = place.w
            R = place.R.x.reshape(3, 3)
            I_world = R @ exact(inertia.inertia) @ R.T
            C, W, m = centre.d[:n], w[:n], exact(inertia.mass)
            M += m * C @ C.T + W @ I_world @ W.T
            spin = w[n]
            h += m * C @ (centre.dd[n] - gravity)
            h += W @ (I_world @ turning[n] + np.cross(spin, I_world @ spin))
        self.M, self.h = M, h

    def frame(self, name: str) -> Place:
        """Return a frame of the model; the world is one."""
        if name in ("world", "universe"):
            return self.places[0]
        frame = self.model.frames[self.model.getFrameId(name)]
        return self.places[frame.parentJoint] * fixed(frame.placement)

    def pull(self, name: str, force: Array, of_body: bool) -> Array:
        """Return what a force at the origin of a frame does to the joints."""
        place = self.frame(name)
        R = place.R.x.reshape(3, 3) if of_body else ONE
        parts = exact(force).reshape(-1, 3) @ R.T
        return generalised(place, place.p.x.reshape(3), parts.ravel(), self.model.nv)


def generalised(place: Place, at: Array, force: Array, n: int) -> Array:
    """Return what a force, or a force with a moment, at a point of the world does to the joints."""
    arm, force = exact(at) - place.p.x.reshape(3), exact(force)
    w, _ = place.w
    moment = np.cross(arm, force[:3]) + (force[3:] if len(force) > 3 else 0)
    return place.p.d[:n] @ force[:3] + w[:n] @ moment


class Undecided(ArithmeticError):
    """Raised where nobody can say how many rows are independent."""


@dataclass(frozen=True)
class Solved:
    """The right answer: a, the generalised force of the constraints, and the free directions."""

    a: Array
    force: Array
    free: Array  # (nv, nv - rank), J free = 0
    kept: Array  # rows that count
    rank: int
    smallest: float  # pivot that counts, relative


def solve(M: Array, x: Array, J: Array, gamma: Array) -> Solved:
    """Solve M a = x + J^T lam, J a + gamma = 0; rows that depend on others are left out.

    Entries of J are levers [m, rad] of machines of about a metre: a row of less than NOTHING is
    rounding, of places that do not depend on q.
    """
    J = np.where(np.abs(J).max(axis=1, initial=0.0, keepdims=True) > NOTHING, J, 0.0)
    L = _cholesky(M)
    free = _forward(L, x)
    Q, R, order, rank = _pivoted(_forward(L, J.T))
    pivots = np.abs(R.diagonal())
    y = np.zeros(rank, REAL)
    for k in range(rank):
        y[k] = (-gamma[order[k]] - R[:k, k] @ y[:k]) / R[k, k]
    own = Q[:, :rank]
    a_ = own @ (y - own.T @ free) + free if rank else free
    left = np.abs(R[:rank, rank:].T @ y + gamma[order[rank:]]).max(initial=0.0)
    if left > 1e-9 * max(1.0, np.abs(gamma).max(initial=0.0)):
        raise Undecided("rows contradict each other")
    a = _backward(L.T, a_)
    smallest = float(pivots[rank - 1] / pivots[0]) if rank else 1.0
    return Solved(a, M @ a - x, _backward(L.T, Q[:, rank:]), order[:rank], rank, smallest)


def _cholesky(M: Array) -> Array:
    L = np.zeros_like(M)
    for j in range(len(M)):
        column = M[j:, j] - L[j:, :j] @ L[j, :j]
        L[j:, j] = column / np.sqrt(column[0])
    return L


def _forward(L: Array, x: Array) -> Array:
    y = np.array(x, dtype=REAL)
    for i in range(len(L)):
        y[i] = (y[i] - L[i, :i] @ y[:i]) / L[i, i]
    return y


def _backward(U: Array, y: Array) -> Array:
    x = np.array(y, dtype=REAL)
    for i in range(len(U) - 1, -1, -1):
        x[i] = (x[i] - U[i, i + 1 :] @ x[i + 1 :]) / U[i, i]
    return x


def _pivoted(A: Array) -> tuple[Array, Array, Array, int]:
    """Householder's Q R with the longest column first, and the rank."""
    n, m = A.shape
    R, Q, order = A.copy(), np.eye(n, dtype=REAL), np.arange(m)
    first, rank = REAL(0), 0
    for k in range(min(n, m)):
        lengths = np.sqrt((R[k:, k:] ** 2).sum(axis=0))
        j = k + int(lengths.argmax())
        pivot = lengths[j - k]
        first = first or pivot
        if pivot <= NOTHING * first:
            break
        if pivot < SOMETHING * first:
            raise Undecided(f"a pivot of {float(pivot / first):.0e}")
        R[:, [k, j]], order[[k, j]] = R[:, [j, k]], order[[j, k]]
        u = R[k:, k].copy()
        u[0] += pivot if u[0] >= 0 else -pivot
        u /= np.sqrt(u @ u)
        R[k:, k:] -= 2 * np.outer(u, u @ R[k:, k:])
        Q[:, k:] -= 2 * np.outer(Q[:, k:] @ u, u)
        rank = k + 1
    return Q, R, order, rank


# --- rows of every kind of constraint


def rows(oracle: Oracle, scene: cp.Scene) -> tuple[Array, Array]:
    """Return J (m, nv) and gamma (m,)."""
    n = oracle.model.nv
    J, gamma = [np.zeros((0, n), REAL)], [np.zeros(0, REAL)]
    for constraint in scene.constraints:
        if isinstance(constraint, cp.constraints.Coupling):
            row = np.zeros((1, n), REAL)
            for joint, weight in constraint.weights.items():
                row[0, oracle.model.joints[oracle.model.getJointId(joint)].idx_v] = exact(weight)
            J.append(row)
            gamma.append(np.zeros(1, REAL))
            continue
        rate, rate_of_rate = _slips(oracle, constraint)
        J.append(rate[:n].T)
        gamma.append(rate_of_rate[n])
    return np.vstack(J), np.concatenate(gamma)


def _slips(oracle: Oracle, c: cp.constraints.Constraint) -> tuple[Array, Array]:
    """Return what stays zero, a rate (D, rows), and its derivative."""
    if isinstance(c, cp.Loop):
        kept = _loop(c, oracle.frame(c.frame_a), oracle.frame(c.frame_b))
    elif isinstance(c, cp.PointContact):
        kept = [_point(oracle.frame(c.frame), c.offset)]
    elif isinstance(c, cp.SurfaceContact):
        kept = _together(oracle.frame(c.frame), _standing(oracle.frame(c.frame)), None)
    elif isinstance(c, cp.constraints.LineContact):
        here = oracle.frame(c.frame)
        kept = _together(here, _standing(here), "xyz".index(c.axis))
    elif isinstance(c, cp.constraints.PlanarContact):
        kept = [dot(constant(c.normal), _point(oracle.frame(c.frame), c.offset))]
    elif isinstance(c, cp.constraints.KnifeEdge):
        return _knife(c, oracle.frame(c.frame))
    else:
        return _rolling(c, oracle.frame(c.frame))
    rates = [np.broadcast_to(part.d, (oracle.model.nv + 1, part.d.shape[-1])) for part in kept]
    bent = [np.broadcast_to(part.dd, (oracle.model.nv + 1, part.dd.shape[-1])) for part in kept]
    return np.hstack(rates), np.hstack(bent)


def _point(place: Place, offset: tuple[float, float, float]) -> Jet:
    return apply(place.R, constant(offset)) + place.p


def _standing(place: Place) -> Place:
    """Return the same place, held by the world."""
    return Place(constant(place.R.x.reshape(3, 3)), constant(place.p.x.reshape(3)))


def _turned(a: Place, b: Place) -> Jet:
    return times(transposed(a.R), b.R)


def _shifted(a: Place, b: Place) -> Jet:
    return apply(transposed(a.R), b.p - a.p)


def _together(a: Place, b: Place, axis: int | None) -> list[Jet]:
    """Return what keeps two frames together, but for a turn about an axis."""
    if axis is None:
        # at a state where they are together, the skew part is the turn
        return [b.p - a.p, _turned(a, b).map(vee)]
    others = [i for i in range(3) if i != axis]
    return [b.p - a.p, _turned(a, b).map(lambda R: R[..., others, axis])]


def _loop(c: cp.Loop, a: Place, b: Place) -> list[Jet]:
    axis, other = ("xyz".index((c.axis or "z")[k]) for k in (0, -1))
    others = [i for i in range(3) if i != axis]
    if c.kind == "ball":
        return [b.p - a.p]
    if c.kind == "weld":
        return _together(a, b, None)
    if c.kind == "hinge":
        return _together(a, b, axis)
    if c.kind == "slider":
        return [_shifted(a, b).map(lambda r: r[..., others]), _turned(a, b).map(vee)]
    if c.kind == "planar":
        return [_shifted(a, b).map(lambda r: r[..., others])]
    if c.kind == "cylindrical":
        return [
            _shifted(a, b).map(lambda r: r[..., others]),
            _turned(a, b).map(lambda R: R[..., others, axis]),
        ]
    if c.kind == "universal":  # the pin of a is across that of b
        return [b.p - a.p, _turned(a, b).map(lambda R: R[..., [axis], other])]
    apart = b.p - a.p
    return [dot(apart, apart).root()]


def _rates(x: Jet) -> Jet:
    """Return the rate of a function; its second derivative is not known, and not used."""
    return Jet(x.d, x.dd, np.zeros_like(x.dd))


def _knife(c: cp.constraints.KnifeEdge, place: Place) -> tuple[Array, Array]:
    across = apply(place.R, constant(ONE["xyz".index(c.axis)]))
    slip = dot(across, _rates(_point(place, c.offset)))
    return slip.x, slip.d


def _rolling(
    c: cp.constraints.RollingWheel | cp.constraints.RollingBall, place: Place
) -> tuple[Array, Array]:
    normal = constant(exact(c.normal) / np.sqrt((exact(c.normal) ** 2).sum()))
    w = Jet(*place.w, np.zeros_like(place.p.dd))
    if isinstance(c, cp.constraints.RollingWheel):
        axle = apply(place.R, constant(ONE["xyz".index(c.axis)]))
        ahead = unit(cross(axle, normal))
        down = cross(axle, ahead)
        names = [d for d in ("rolling", "lateral", "normal") if d in c.holds]
    else:
        ahead = unit(cross(constant(_any_across(normal.x)), normal))
        down = constant(-normal.x)
        names = ["rolling", "lateral", "normal"]
    slip = _rates(place.p) + cross(w, down.map(lambda x: exact(c.radius) * x))
    axes = {"rolling": ahead, "lateral": cross(normal, ahead), "normal": normal}
    found = [dot(axes[name], slip) for name in names]
    return np.hstack([f.x for f in found]), np.hstack([f.d for f in found])


def _any_across(normal: Array) -> Array:
    return ONE[int(np.abs(normal).argmin())]
