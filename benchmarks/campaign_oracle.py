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
library's by a turn of their axes: at a state with c = 0 and J v = 0 the motion is the same. With
M = L L^T and L^-1 J^T P = Q R, pivots falling, the motion nearest to the free one is

    a = L^-T ( Q y + (1 - Q Q^T) x ),     R^T y = P^T (-gamma),    x = L^-1 (tau - h).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from campaign_jets import (
    ONE,
    REAL,
    Array,
    Jet,
    Place,
    apply,
    body_motion,
    constant,
    exact,
    fixed,
    of_quaternion,
    shift,
    turn,
    vee,
)

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
