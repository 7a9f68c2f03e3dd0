"""Derivatives of an answer: with respect to states, forces, inertias, carried on.

Derivatives: how an answer changes with the state and the torques.

Columns are tangent: column i is the derivative along ``pin.integrate(model, q, t e_i)``.

How the torques of forces on frames change with q.

With L the Jacobian of the frame in its own axes, one column a coordinate, and w the wrench in the
same axes,

    tau_i = L_i . w

A step of coordinate j moves the frame by L_j. Of the joints above j it turns the column, for it is
carried with the body of the frame, and a w that keeps its direction in the world turns the other
way:

    dL_i/dq_j = -L_j x L_i    if j belongs to a joint below that of i, else 0,
    dw/dq_j   = w x omega_j   in axes of the world, else 0.

Where the axes of a joint turn with its own q, v_J = S(q) v, its columns change by dS besides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.jacobian import Block, Jacobian
from condyn_pin._core.models import Indices, axes, joints_with_turning_axes, whole_data
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.forces import AppliedForce, Loads, frame_jacobian, in_axes
from condyn_pin.constraints.partials.motion import dual_cross
from condyn_pin.constraints.rows.bound import BoundConstraint
from condyn_pin.dynamics.at_state import without_gravity
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.io.mjcf_write import drawn_configuration

if TYPE_CHECKING:
    from condyn_pin.dynamics.derivatives.kkt import Linearisation


class Derivatives(Jacobian):
    """The derivatives of accelerations and constraint forces, as returned by `derivatives`.

    M da - J^T dlam = dtau - r_q dq - r_v dv,    J da = -s_q dq - s_v dv

    Columns are tangent: those for q belong to ``pin.integrate(model, q, dq)``. The six matrices are
    formed when one of them is accessed; `jvp` and `vjp` do without.

    Attributes
    ----------
    solution : Solution
        The answer.
    da_dq, da_dv, da_dtau : (nv, nv) array
        Of the joint accelerations a; the columns by q are tangent.
    dlam_dq, dlam_dv, dlam_dtau : (m, nv) array
        Of the rows, in the axes of each constraint, whatever its `axes`. Where rows are redundant,
        those of the smallest lam.
    disagreement : float or None
        Largest difference to central differences, relative to the largest entry of its block [1],
        where these were taken (``check=True``).
    """

    outputs = "a", "lam"
    disagreement: float | None = None  # relative to the largest entry of a block

    da_dq = Block("Accelerations by the configuration (nv, nv).")
    da_dv = Block("Accelerations by the velocity (nv, nv).")
    da_dtau = Block("Accelerations by the torques (nv, nv).")
    dlam_dq = Block("Constraint forces by q (m, nv); costly at first if rows are redundant.")
    dlam_dv = Block("Constraint forces by the velocity (m, nv).")
    dlam_dtau = Block("Constraint forces by the torques (m, nv).")

    def __init__(self, solution: Solution, *blocks: Array) -> None:
        self.solution, self._given = solution, blocks
        self._n, self._m = len(solution.a), len(solution.lam)

    def _form(self) -> tuple[Array, ...]:
        """Return the derivatives of (a, lam) by q, v and tau, each (nv + m, nv)."""
        return self._given

    @cached_property
    @one_blas_thread
    def _blocks(self) -> tuple[Array, ...]:
        return self._form()

    def block(self, output: str, by: str) -> Array:
        """Return the derivative of a (nv, nv) or lam (m, nv) by q, v or tau."""
        rows = slice(self._n) if output == "a" else slice(self._n, None)
        return self._blocks[self.inputs.index(by)][rows]

    @one_blas_thread
    def jvp(self, dq: ArrayLike, dv: ArrayLike, dtau: ArrayLike) -> tuple[Array, Array]:
        """Return (da, dlam) along dq, dv and dtau, each (nv,): a direction of state and torques."""
        steps = [finite(name, x, self._n) for name, x in (("dq", dq), ("dv", dv), ("dtau", dtau))]
        return self._forward(*steps)

    @one_blas_thread
    def vjp(self, da: ArrayLike, dlam: ArrayLike) -> tuple[Array, Array, Array]:
        """Return the gradients by q, v and tau of da . a + dlam . lam, for da (nv,), dlam (m,)."""
        return self._backward(finite("da", da, self._n), finite("dlam", dlam, self._m))

    def _forward(self, dq: Array, dv: Array, dtau: Array) -> tuple[Array, Array]:
        by_q, by_v, by_tau = self._blocks
        answer = by_q @ dq + by_v @ dv + by_tau @ dtau
        return answer[: self._n], answer[self._n :]

    def _backward(self, da: Array, dlam: Array) -> tuple[Array, Array, Array]:
        answer = np.concatenate([da, dlam])
        by_q, by_v, by_tau = self._blocks
        return answer @ by_q, answer @ by_v, answer @ by_tau

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.solution!r})"

    def __str__(self) -> str:
        n, m = self._n, self._m
        blocks = [
            ", ".join(f"d{y}_d{x} {(k, n)}" for x in self.inputs) for y, k in (("a", n), ("lam", m))
        ]
        checked = (
            "not compared with differences; check=True compares"
            if self.disagreement is None
            else f"differ from central differences by {self.disagreement:.1e} of the largest entry"
        )
        return "\n".join([repr(self), *blocks, checked])


# Joints whose axes turn with their own q.
#
#     v_J = S(q) v
#
# Pinocchio's derivatives of velocities, accelerations and torques, and its Coriolis matrix, take S
# for constant in the axes of the body. Where it is not, and the joint is made of others
# (SphericalZYX, Universal, Composite), the same joint as its parts in series, with nothing between
# them, has the same q, v, M and h, and every S is constant.
#
# What turns still is not made of other joints: it is carried by a free body,
#
#     nu = Phi(q) v,    nu' = Phi a + c,    c = Phi' v
#
# whose velocity nu has axes that do not turn, so that all derivatives are known there. The joint
# hands on what its axes S, the blocks of Phi, feel of them,
#
#     r = Phi^T r~(nu', nu),        s = s~(nu', nu)
#
# and the derivatives are those of the chain
#
#     dr = Phi^T (r~_q Phi dq + r~_v dnu + M~ dnu') + (Phi_q dq)^T r~,    ds the same with J~ for
#     M~.
#
# S is a few sines of q, so that S_q is differenced to rounding:
#
#     f'(0) d ~ sum_j w_j (f(j h d) - f(-j h d)) / h,    wrong by h^8 f^(9) / 630


_WEIGHTS: Final = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
_H: Final = 2.0**-7  # [rad, m]: below the rounding of f over h


class FreeBodyChainRule(NamedTuple):
    """Derivatives of the carried state by that of the model, at one state."""

    Phi: Array  # (n~, n)
    v_q: Array  # (n~, n), of nu = Phi v
    a_q: Array  # (n~, n), of nu' = Phi a + c
    a_v: Array  # (n~, n), of c
    S_q: tuple[Array, ...]  # (k, 6, k) of each joint: by each of its coordinates


class _JointIndices(NamedTuple):
    """Indices of a joint's coordinates, in the model and in that with free bodies."""

    q: Indices
    v: Indices
    q_free: Indices
    v_free: Indices


class _Joint(NamedTuple):
    """A joint by itself, and where its coordinates and those of its free body are."""

    model: Any
    data: Any
    places: _JointIndices


class FreeBodyModel:
    """A model with free bodies in the place of the joints whose axes turn.

    `model` has the same joints by number, without their armature, which needs no derivatives.
    """

    def __init__(self, model: Any) -> None:
        chosen, free = joints_with_turning_axes(model), pin.Model()
        self._n = model.nv
        self._joints: list[_Joint] = []
        nothing = np.zeros(0, dtype=int)
        stay = [_JointIndices(nothing, nothing, nothing, nothing)]
        for i in range(1, model.njoints):
            joint = model.joints[i]
            kind = pin.JointModelFreeFlyer() if i in chosen else joint
            free.addJoint(model.parents[i], kind, model.jointPlacements[i], model.names[i])
            free.inertias[i] = model.inertias[i]
            places = _places(joint, free.joints[i])
            if i in chosen:
                self._joints.append(_single_joint(joint, places))
            else:
                stay.append(places)
        self._stay = _JointIndices(*map(np.concatenate, zip(*stay, strict=True)))
        free.armature[self._stay.v_free] = model.armature[self._stay.v]
        free.gravity = model.gravity
        self.model = free

    def state(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array, FreeBodyChainRule]:
        """Return q, v and a of the model with free bodies, and how they change."""
        free, stay = self.model, self._stay
        Phi, v_q, a_q, a_v = np.zeros((4, free.nv, self._n))
        q_free, nu, rate = np.zeros(free.nq), np.zeros(free.nv), np.zeros(free.nv)
        Phi[stay.v_free, stay.v] = 1.0
        q_free[stay.q_free], nu[stay.v_free], rate[stay.v_free] = q[stay.q], v[stay.v], a[stay.v]
        all_S_q = []
        for joint in self._joints:
            at, its = joint.places, (q[joint.places.q], v[joint.places.v], a[joint.places.v])
            block = np.ix_(at.v_free, at.v)
            Phi[block], nu[at.v_free], rate[at.v_free] = _axes(joint, *its)
            q_free[at.q_free] = pin.SE3ToXYZQUAT(joint.data.oMi[1])
            S_q, its_v_q, its_a_q = _by_q(joint, *its)
            v_q[block], a_q[block] = its_v_q.T, its_a_q.T
            a_v[block] = its_v_q.T + np.tensordot(v[at.v], S_q, 1)
            all_S_q.append(S_q)
        return q_free, nu, rate, FreeBodyChainRule(Phi, v_q, a_q, a_v, tuple(all_S_q))

    def back(self, chain: FreeBodyChainRule, by_state: Array, by_a: Array, r: Array) -> Array:
        """Return [[r_q, r_v], [s_q, s_v]] of the model, from those of that with free bodies."""
        # `by_a` (n~ + m, n~) is M~ above J~, and r (n~,) are torques and forces that move the
        # bodies so.
        of_q, of_v = np.hsplit(by_state, 2)
        by_q = of_q @ chain.Phi + of_v @ chain.v_q + by_a @ chain.a_q
        moved = np.hstack([by_q, of_v @ chain.Phi + by_a @ chain.a_v])
        top = chain.Phi.T @ moved[: len(r)]
        for joint, S_q in zip(self._joints, chain.S_q, strict=True):
            at = joint.places
            top[np.ix_(at.v, at.v)] += (S_q.swapaxes(1, 2) @ r[at.v_free]).T
        return np.vstack([top, moved[len(r) :]])


def _places(joint: Any, free: Any) -> _JointIndices:
    """Return the indices of a joint's coordinates in both models."""
    return _JointIndices(
        np.arange(joint.idx_q, joint.idx_q + joint.nq),
        np.arange(joint.idx_v, joint.idx_v + joint.nv),
        np.arange(free.idx_q, free.idx_q + free.nq),
        np.arange(free.idx_v, free.idx_v + free.nv),
    )


def _single_joint(joint: Any, places: _JointIndices) -> _Joint:
    """Return a joint by itself."""
    model = pin.Model()
    model.addJoint(0, joint, pin.SE3.Identity(), "joint")
    return _Joint(model, whole_data(model), places)


def _axes(joint: _Joint, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Return S (6, k), S v and S a + c of a joint by itself."""
    data = joint.data
    pin.forwardKinematics(joint.model, data, q, v, a)
    S = np.array(data.joints[1].S).reshape(6, joint.model.nv)
    return S, np.array(data.v[1].vector), np.array(data.a[1].vector)


def _by_q(joint: _Joint, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Return S_q (k, 6, k), and S v and S a + c by q, each (k, 6): one row per coordinate."""

    def moved(step: Array) -> Array:
        return np.column_stack(_axes(joint, pin.integrate(joint.model, q, step), v, a))

    rows = np.array([slope(moved, direction) for direction in np.eye(len(v))])
    return rows[:, :, :-2], rows[:, :, -2], rows[:, :, -1]


def in_series(
    model: Any, bounds: Sequence[BoundConstraint]
) -> tuple[Any, tuple[BoundConstraint, ...]]:
    """Return model and constraints with such joints in series; the same ones if there are none."""
    if not joints_with_turning_axes(model):
        return model, tuple(bounds)
    series, last = pin.Model(), [0]
    for i in range(1, model.njoints):
        parent, placement = last[model.parents[i]], model.jointPlacements[i]
        for k, (joint, at) in enumerate(_parts(model.joints[i])):
            parent = series.addJoint(parent, joint, placement * at, f"{model.names[i]}.{k}")
            placement = pin.SE3.Identity()
        series.inertias[parent] = model.inertias[i]
        last.append(parent)
    series.armature, series.gravity = model.armature, model.gravity
    return series, tuple(bound.moved(last) for bound in bounds)


def _parts(joint: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the joints that one is made of, each with its placement on the one before."""
    name, here = joint.shortname(), pin.SE3.Identity()
    if name == "JointModelSphericalZYX":
        yield from (
            (kind(), here) for kind in (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX)
        )
    elif name == "JointModelUniversal":
        universal = joint.extract()
        for axis in (universal.axis1, universal.axis2):
            yield pin.JointModelRevoluteUnaligned(*axis.tolist()), here
    elif name == "JointModelComposite":
        composite = joint.extract()
        for part, at in zip(composite.joints, composite.jointPlacements, strict=True):
            for each, within in _parts(part):
                yield each, at * within
                at = here
    else:
        yield joint, here


def slope(function: Callable[[Array], Array], direction: Array) -> Array:
    """Return the derivative of a smooth function of a step, along a direction, at no step."""
    steps = [j * _H * direction for j in range(1, len(_WEIGHTS) + 1)]
    changes = np.array([function(step) - function(-step) for step in steps])
    return np.asarray(np.tensordot(_WEIGHTS, changes, 1) / _H)


# How w, the compliance of bodies and joints in `Soft`, changes with what bodies weigh.
#
#     w = J_i M^-1 J_i^T,    y = M^-1 J_i^T,    w_pi = -y . (M y)_pi,    (M y)_pi = Y(q, 0, y)
#
# with Y the regressor without gravity. A body has the mean of w over three axes at its centre of
# mass c, whose J_lin turns with it,
#
#     c = m c / m,    J_lin' = -c' x J_ang,    mean' = -2/3 tr(skew(c') J_ang M^-1 J_lin^T).


def inverse_inertias_by_inertias(workspace: Workspace) -> Array:
    """Return w of `inverse_inertias` by the inertial parameters (m, 10 (njoints - 1))."""
    model = workspace.model
    data, q, still = (
        whole_data(model),
        drawn_configuration(workspace.scene.robot),
        without_gravity(model),
    )
    M = np.array(pin.crba(model, data, q))
    pin.computeJointJacobians(model, data, q)
    size, rest = 10 * (model.njoints - 1), np.zeros(model.nv)

    def gives(moved: Array) -> Array:
        """Return w of each row by the parameters (rows, size), for y in the columns."""
        return np.array([-y @ inertia_regressor(still, q, rest, y) for y in moved.T])

    def body(joint: int) -> Array:
        by = np.zeros((2, size))
        if joint == 0:
            return by
        mass, c = model.inertias[joint].mass, model.inertias[joint].lever
        J = frame_jacobian(model, data, joint, pin.SE3(np.eye(3), c), LOCAL)
        moved = np.linalg.solve(M, J.T)
        by[:] = gives(moved).reshape(2, 3, -1).mean(axis=1)
        if mass:
            B = J[3:] @ moved[:, :3]
            by_c = -2 / 3 * np.array([B[1, 2] - B[2, 1], B[2, 0] - B[0, 2], B[0, 1] - B[1, 0]])
            own = 10 * (joint - 1)
            by[0, own] -= by_c @ c / mass
            by[0, own + 1 : own + 4] += by_c / mass
        return by

    def columns(velocities: Sequence[int]) -> Array:
        moved = np.linalg.solve(M, np.eye(model.nv)[:, list(velocities)])
        return np.asarray(gives(moved).sum(axis=0))

    w = np.zeros((workspace.scene.rows, size))
    for bound in workspace.bounds:
        w[bound.rows] = bound.approximate_delassus(body, columns)  # linear in both
    return w


# Derivatives of an answer by what the model is made of.
#
# With r_x and s_x the partials of the two residuals by a parameter x, at the answer,
#
#     M da - J^T dlam = -r_x dx,        J da = -s_x dx.
#
# Gravity and inertial parameters enter r linearly: r = Y(q, v, a) pi + ..., the regressor form.


ENDS = ("first", "second")


def gravity_regressor(model: Any, q: Array) -> Array:
    """Return the derivative of h by the vector of gravity (nv, 3)."""
    columns = []
    for direction in np.eye(3):
        pulled = pin.Model(model)
        pulled.gravity = pin.Motion(direction, np.zeros(3))
        columns.append(np.array(pin.computeGeneralizedGravity(pulled, whole_data(pulled), q)))
    return np.column_stack(columns)


def inertia_regressor(model: Any, q: Array, v: Array, a: Array) -> Array:
    """Return Y (nv, 10 (njoints - 1)) with M a + h = Y pi + armature a."""
    Y = pin.computeJointTorqueRegressor(model, whole_data(model), q, v, a)
    return np.array(Y).reshape(model.nv, -1)  # a single row comes as a vector


def placement_partials(
    linearisation: Linearisation, bounds: Sequence[BoundConstraint],
    name: str, frame: str, q: Array, v: Array, a: Array, lam: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Return r_x (nv, 6) and s_x (m, 6) for a twist x of one frame of a constraint."""
    found = {bound.name: bound for bound in bounds}
    if name not in found:
        raise unknown_name("constraint", name, found)
    if frame not in ENDS:
        raise InvalidArgument(f"frame = {frame!r}: one of {', '.join(ENDS)} is needed")
    bound = found[name]
    end = bound.end(frame)
    r, rows = linearisation.by_frame(q, v, a, lam, name, end)
    s = np.zeros((len(lam), 6))
    s[bound.rows] = rows
    return r, s


# How the torques of forces on frames change with q.


def load_partial(loads: Loads, q: Array, forces: Sequence[AppliedForce]) -> Array:
    """Return the derivative (nv, nv) of sum_f J_f^T f by q, for forces with constant numbers."""
    model, data = loads.model, loads.data
    pin.computeJointJacobians(model, data, q)
    owner = np.concatenate([np.full(j.nv, j.id) for j in model.joints if j.nv > 0 and j.idx_v >= 0])
    below = owner[:, None] < owner[None, :]
    total = np.zeros((model.nv, model.nv))
    for (joint, placement), in_world, wrench in loads.bind(forces):
        L = frame_jacobian(model, data, joint, placement, LOCAL)
        if in_world:
            wrench = in_axes((data.oMi[joint] * placement).rotation, wrench)
            turned = np.vstack([pin.skew(wrench[:3]), pin.skew(wrench[3:])])
            total += L.T @ (turned @ L[3:])
        total += below * (L.T @ dual_cross(wrench) @ L)
        oMf = data.oMi[joint] * placement
        for i, columns, dS in _turning_axes(loads, q, joint):
            on_joint = (data.oMi[i].actInv(oMf)).act(pin.Force(wrench)).vector
            total[columns, columns] += np.einsum("kij,k->ij", dS, on_joint)
    return total


def _turning_axes(loads: Loads, q: Array, end: int) -> Iterator[tuple[int, slice, Array]]:
    """Yield the joints above a frame whose axes turn with their q, their columns, and S by q."""
    model = loads.model
    for i in list(model.supports[end])[1:]:
        if i in loads.turning:
            joint = model.joints[i]
            columns = slice(joint.idx_v, joint.idx_v + joint.nv)
            yield i, columns, _axes_by_q(model, joint, q, np.eye(model.nv)[columns])


def _axes_by_q(model: Any, joint: Any, q: Array, directions: Array) -> Array:
    """Return S (6, k) of a joint by each of its coordinates, (6, k, k)."""

    def moved(step: Array) -> Array:
        return axes(joint, pin.integrate(model, q, step))

    return np.stack([slope(moved, direction) for direction in directions], axis=-1)
