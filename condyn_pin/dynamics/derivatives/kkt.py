"""Derivatives by the implicit function theorem, on the matrix of the solve itself.

Both residuals of `EquationPartials` stay zero along an answer:

    M da - J^T dlam = dtau - r_q dq - r_v dv,        J da = -s_q dq - s_v dv

Motions that are held and those that are free (`_core/linalg.py`) solve that for all
columns at once, those by tau among them. Where rows are redundant, the derivative is that of the
smallest lam. With N the left null space of J, that lam keeps N^T lam = 0 as the rows turn: for any
w with lam = J w

    N^T dlam = N^T (dJ w).

Off the constraints, where rows are left out, what is left in them is active as well
(below, with the redundancy of the rows):

    P J da = -P (s_q dq + s_v dv + dP s),    N^T dlam = N^T dP lam.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import ConstraintBasis, held_and_free, inverse_factor, lapack
from condyn_pin._core.models import joints_with_turning_axes, whole_data
from condyn_pin._core.threads import of_workspace, one_blas_thread
from condyn_pin.constraints.drift import Baumgarte, gains
from condyn_pin.constraints.partials.rows import ConstraintPartials
from condyn_pin.constraints.rows.bound import BoundConstraint
from condyn_pin.constraints.rows.equations import Equations, answer_key
from condyn_pin.constraints.rows.redundancy import Redundancy
from condyn_pin.dynamics.at_state import without_gravity
from condyn_pin.dynamics.derivatives.solution_derivatives import (
    Derivatives,
    FreeBodyModel,
    gravity_regressor,
    in_series,
    inertia_regressor,
    load_partial,
    placement_partials,
)
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.workspace import Workspace


class KktDerivatives(Derivatives):
    """Exact derivatives of every kind of constraint, on the constraints and off them.

    Notes
    -----
    Cost O(n d + n^2 m) for n joints and a tree of depth d, most of it Newton-Euler's derivatives
    and products of matrices.
    """

    def __init__(self, workspace: Workspace, solution: Solution, v: Array, tau: Array) -> None:
        Derivatives.__init__(self, solution)
        self._workspace, self._v = workspace, v
        # of this scene, whatever comes after it
        self._equations, self._linearisation = workspace.equations, workspace.linearisation
        self._factored = self._factorise()  # at once, while the workspace is whose asked

    @cached_property
    @of_workspace
    def _factored(self) -> tuple[Array, ConstraintBasis, TurningRows | None]:
        """Right-hand sides (nv + m, 2 nv) of steps of q and v, and the factors that solve them."""
        # Off the constraints also the rows that are kept.
        return self._factorise()

    def _factorise(self) -> tuple[Array, ConstraintBasis, TurningRows | None]:
        q, solution = self.solution.q, self.solution
        of = self._linearisation.at(q, self._v, solution.a, solution.lam)
        if solution.applied:
            loads = self._workspace.loads
            of.rhs[: self._n, : self._n] += load_partial(loads, q, solution.applied)
        J = self._equations.drop_roundoff_rows(of.J)
        M = self._equations.mass(q) if of.M is None else of.M
        kept = self._kept(J)
        if kept is None:
            return of.rhs, held_and_free(inverse_factor(M), J, tolerances.RANK), None
        turning, pulling = (
            partial(how, q) for how in (self._linearisation.turning, self._linearisation.pulling)
        )
        of_rest, self._null = kept.turned(solution.lam, turning, pulling)
        torques, rows = np.vsplit(of.rhs, [self._n])
        torques[:, : self._n] += J.T.dot(self._null)
        rows[:] = kept.kept(rows)
        rows[:, : self._n] -= of_rest
        share, rank = tolerances.REFERENCE_RANK, kept.rank
        return of.rhs, held_and_free(inverse_factor(M), kept.kept(J), share, rank), kept

    def _kept(self, J: Array) -> TurningRows | None:
        """The rows that are kept off the constraints, where some are redundant."""
        of, nominal = self.solution, self.solution.scene.nominal
        missed, off = of._missed, max(of.residuals.violation, of.residuals.velocity)
        if missed is None and not (nominal.dependent and off > tolerances.OPEN):
            return None
        if missed is not None:
            rank = of.rank
        else:  # rows at their word
            left = nominal.redundancy.left_out(J, np.zeros(self._m))
            s = self._equations.residuals(of.q, self._v, 0.0 * of.a, of.a, of.lam)[1]
            rank, missed = left.rank, left.rest(s)
        return TurningRows(nominal.redundancy, J, rank, missed) if rank < self._m else None

    @property
    def _motions(self) -> ConstraintBasis:
        return self._factored[1]

    @cached_property
    @of_workspace
    def _null(self) -> Array | None:
        """Change of lam by q (m, nv) that keeps it smallest as redundant rows turn, or None."""
        motions, of = self._motions, self.solution
        if not motions.N.shape[1]:
            return None
        w = motions.held(of.lam)
        return turning_null_space(self._linearisation, of.q, w, motions.N)

    def block(self, output: str, by: str) -> Array:
        """Return the derivative of a (nv, nv) or lam (m, nv) by q, v or tau."""
        if output == "a":
            return super().block(output, by)
        return self._forces[self.inputs.index(by)]

    @cached_property
    @one_blas_thread
    def _forces(self) -> tuple[Array, Array, Array]:
        """The derivatives of lam by q, v and tau; `_blocks` has those of a alone."""
        n, (rhs, motions, _) = self._n, self._factored
        found = motions.force(rhs[:n], rhs[n:])
        by_q = found[:, :n] if self._null is None else found[:, :n] + self._null
        return by_q, found[:, n:], motions.support

    def by_gravity(self) -> tuple[Array, Array]:
        """Return the derivatives of a (nv, 3) and lam (m, 3) by the vector of gravity [m/s^2]."""
        return self._by(gravity_regressor(self._workspace.model, self.solution.q))

    def by_inertias(self) -> tuple[Array, Array]:
        """Return the derivatives of a and lam by the inertial parameters of the bodies."""
        # Ten columns a joint, as `pin.Inertia.toDynamicParameters`: mass, mass times centre of
        # mass, and the inertia about the joint's origin xx xy yy xz yz zz. Armature is not among
        # them.
        model, of = self._workspace.model, self.solution
        return self._by(inertia_regressor(model, of.q, self._v, of.a))

    @of_workspace
    def by_placement(self, name: str, frame: str = "first") -> tuple[Array, Array]:
        """Return the derivatives of a (nv, 6) and lam (m, 6) by where a constraint is on a body.

        Parameters
        ----------
        name : str
            Of the constraint.
        frame : {"first", "second"}
            The first-named frame moves on its body, or the other one, by a small twist in its own
            axes, linear part first. Where rows are redundant, only a and J^T lam are unique.
        """
        of, kept = self.solution, self._factored[2]
        partials = partial(
            placement_partials, self._linearisation, of.scene.bounds, name, frame, of.q
        )
        r, s = partials(self._v, of.a, of.lam)
        if kept is None:
            return self._by(r, s)
        still, no_force = np.zeros(self._n), np.zeros(self._m)
        at_rest = partials(still, still, no_force)[1]
        of_rest, of_lam = kept.turned(
            of.lam,
            lambda w: partials(still, w, no_force)[1] - at_rest,
            lambda z: -partials(still, still, z)[0],
        )
        J = self._equations.jacobian(of.q)
        da, dlam = self._by(r - J.T.dot(of_lam), kept.kept(s) + of_rest)
        return da, dlam + of_lam

    def _by(self, r: Array, s: Array | None = None) -> tuple[Array, Array]:
        """Return the derivatives by a parameter, from the partials of the two residuals."""
        s = np.zeros((self._m, r.shape[1])) if s is None else s
        return self._motions.solve(-r, -s)

    def _form(self) -> tuple[Array, Array, Array]:
        n, (rhs, motions, _) = self._n, self._factored
        found = motions.motion(rhs[:n], rhs[n:])
        return found[:, :n], found[:, n:], motions.mobility

    def _forward(self, dq: Array, dv: Array, dtau: Array) -> tuple[Array, Array]:
        n = self._n
        x = self._factored[0].dot(np.concatenate([dq, dv]))
        da, dlam = self._motions.solve(x[:n] + dtau, x[n:])
        if dq.any() and self._null is not None:
            dlam += self._null @ dq
        return da, dlam

    def _backward(self, da: Array, dlam: Array) -> tuple[Array, Array, Array]:
        n = self._n
        by_tau, forced = self._motions.solve(da, -dlam)  # the transpose, but for signs
        rhs = self._factored[0]
        by = by_tau.dot(rhs[:n]) - forced.dot(rhs[n:])
        if dlam.any() and self._null is not None:
            by[:n] += dlam @ self._null
        return by[:n], by[n:], by_tau


# The two equations, linearised: how their residuals change with q and v at fixed a and lam.
#
#     r = M a + h - tau - J^T lam,        s = J a + gamma - a_ref
#
# Newton-Euler's derivatives give those of r with the constraint forces fixed in the axes of their
# bodies. What turns, and those of s, come from the constraints: `condyn_pin.constraints.partials`.
# A joint whose axes turn with its own q is taken apart (`in_series`, beside them), or carried by a
# free body (`carried`).
#
# References
# ----------
# Carpentier, Mansard. Analytical derivatives of rigid body dynamics algorithms. RSS, 2018.


_rnea_derivatives = pin.computeRNEADerivatives  # bound once


class EquationPartials(NamedTuple):
    """The partial derivatives at one (q, v, a, lam)."""

    J: Array  # (m, nv)
    # -[[r_q, r_v], [s_q, s_v]]: what a step of q and v leaves to solve
    rhs: Array  # (nv + m, 2 nv)
    M: Array | None  # (nv, nv), r by a; None where free bodies carry joints

    @property
    def r_q(self) -> Array:
        """(nv, nv)."""
        n = self.J.shape[1]
        return -self.rhs[:n, :n]

    @property
    def s_q(self) -> Array:
        """(m, nv)."""
        n = self.J.shape[1]
        return -self.rhs[n:, :n]


class Linearisation:
    """The linearised equations of one model with its bound constraints, and their memory.

    `equations` of the same model put the constraint forces on the bodies; they have that done
    already of an answer that they have proved just now, and where the loops are. As their
    `recursion` in that proof, this has Newton-Euler's derivatives done too.
    """

    def __init__(
        self, model: Any, bounds: Sequence[BoundConstraint], drift: Baumgarte | None = None,
        equations: Equations | None = None,
    ) -> None:  # fmt: skip
        given, self._bounds = model, bounds
        model, bounds = in_series(model, bounds)
        self._carried: FreeBodyModel | None = None
        self._done = b""  # the answer of which `data` holds Newton-Euler's derivatives
        if model is not given and joints_with_turning_axes(model):
            self._carried = FreeBodyModel(model)
            model = self._carried.model
        # in which no axes turn
        self._model, self._data = model, whole_data(model)
        self._hold_views(self._data, model.nv)
        self._of_constraints = ConstraintPartials(model, self._data, bounds, drift)
        self._drift = drift
        if drift:
            self._Kd = gains(bounds, drift)[1][:, None]
        self._m = sum(b.size for b in bounds)
        if equations is None or model is not given:
            equations = Equations(model, bounds)
        self._equations, self._given = equations, given

    def at(self, q: Array, v: Array, a: Array, lam: Array) -> EquationPartials:
        """Return the partial derivatives at a state and an answer."""
        if self._carried is None:
            rhs, J = self._of_bodies(q, v, a, lam)
            M = self._M.copy()  # Newton-Euler's derivatives leave it behind
        else:
            free_q, nu, rate, chain = self._carried.state(q, v, a)
            of_free, J = self._of_bodies(free_q, nu, rate, lam)
            r = self._torques.copy()  # as Newton-Euler's derivatives left it
            by_a = np.vstack([pin.crba(self._model, self._data, free_q), J])
            rhs, J, M = self._carried.back(chain, of_free, -by_a, -r), J @ chain.Phi, None
        self._of_constraints.write_couplings((q, v, a, lam), rhs, J)
        return EquationPartials(J, rhs, M)

    def _hold_views(self, data: Any, n: int) -> None:
        """Hold what Newton-Euler's derivatives write: to fetch it costs as much as to copy it."""
        # of a single coordinate Pinocchio has vectors
        self._M, self._dtau_dq, self._dtau_dv = (
            part.reshape(n, n) for part in (data.M.T, data.dtau_dq, data.dtau_dv)
        )
        self._torques = data.tau

    @property
    def uses_given_model(self) -> bool:
        """True if the given model is used as it is: no joint has axes that turn with its own q."""
        return self._model is self._given

    def newton_euler(self, q: Array, v: Array, a: Array, wrenches: Any, answer: bytes) -> Array:
        """Return M a + h less the torques of wrenches, and keep its derivatives for `at`."""
        _rnea_derivatives(self._model, self._data, q, v, a, wrenches)
        self._done = answer
        return self._torques  # type: ignore[no-any-return]

    def mass(self, q: Array) -> Array | None:
        """Return M if `newton_euler` has left it behind at q, where it stands."""
        return self._M if self._done.startswith(q.tobytes()) else None

    def _of_bodies(self, q: Array, v: Array, a: Array, lam: Array) -> tuple[Array, Array]:
        """Return right-hand sides of steps of q and v, and J, without couplings; no axes turn."""
        n, equations = self._model.nv, self._equations
        answer = answer_key(q, v, a, lam)
        proved = answer == equations.answer
        if self._done != answer:
            # it leaves behind all that the derivatives of frames read
            wrenches = equations.on_joints if proved else equations.wrenches_at(q, lam)
            self.newton_euler(q, v, a, wrenches, answer)
        self._done = b""  # for one call
        make, pulls = self._of_constraints.make, np.negative(self._dtau_dq)
        rhs, J = make((n + self._m, 2 * n)), make((self._m, n))
        ends = equations.ball_ends if proved else None
        self._of_constraints.write(lam, pulls, rhs[n:], J, ends)
        # what is contiguous is added to, and copied, in half the time
        rhs[:n, :n], rhs[:n, n:] = pulls, np.negative(self._dtau_dv)
        if self._drift:
            rhs[n:, n:] -= self._Kd * J
        return rhs, J

    def turning(self, q: Array, w: Array) -> Array:
        """Return the derivative of J w by q (m, nv) at fixed w (nv,); with w = v, of J v."""
        if self._carried is None:
            of_rows = self._velocity_by_q(q, w)
        else:
            free_q, nu, still, chain = self._carried.state(q, w, np.zeros_like(w))
            _, J = self._of_bodies(free_q, nu, still, np.zeros(self._m))
            of_rows = self._velocity_by_q(free_q, nu) @ chain.Phi + J @ chain.v_q
        self._of_constraints.turn_couplings(q, w, of_rows)
        return of_rows

    def pulling(self, q: Array, z: Array) -> Array:
        """Return the derivative of J^T z by q (nv, nv) at fixed z (m,)."""
        still = np.zeros(self._given.nv)
        return -self._weightless.at(q, still, still, z).r_q

    @cached_property
    def _weightless(self) -> Linearisation:
        """Linearised equations without gravity: at rest only torques of the rows change with q."""
        return Linearisation(without_gravity(self._given), self._bounds)

    def _velocity_by_q(self, q: Array, w: Array) -> Array:
        """Return the partials of J w by q, where no axes turn."""
        self._done = b""
        _rnea_derivatives(self._model, self._data, q, w, np.zeros_like(w))
        of_rows = np.zeros((self._m, self._model.nv))
        self._of_constraints.turning(of_rows)
        return of_rows

    def by_frame(
        self, q: Array, v: Array, a: Array, lam: Array, name: str, end: int
    ) -> tuple[Array, Array]:
        """Return r (nv, 6) and s (rows, 6) by a twist of c1 or c2 of a constraint, in its axes."""
        # The frame moves as if a joint held it: its velocity turns by -x x v, and its wrench goes
        # along. The end that stays has no part in it.
        chain = None
        if self._carried:
            q, v, a, chain = self._carried.state(q, v, a)
        self._done = b""
        pin.computeForwardKinematicsDerivatives(self._model, self._data, q, v, a)
        r, s = self._of_constraints.by_frame(name, lam, end)
        return (chain.Phi.T @ r if chain else r), s


# How the combinations of rows that are left out turn with the rows.
#
# Off the constraints an answer satisfies its rows but for a remainder s that no acceleration meets,
#
#     P (J a + gamma - a_ref) = 0,    lam = P lam,    s = J a + gamma - a_ref,    P = 1 - N N^T,
#
# where N spans R U_n, and U_n are the left singular vectors of the scaled rows A = R J D that do
# not count (`condyn_pin.constraints.rows.redundancy`). So an answer changes with P as well:
#
#     P J da = -P (s_q dq + s_v dv + dP s),        N^T dlam = N^T dP lam.
#
# With A = U S V^T, E = R dJ D, i kept and j left out (Golub, Pereyra)
#
#     dU_n = U_r X,    X_ij = (s_j u_i^T E v_j + s_i u_j^T E v_i) / (s_j^2 - s_i^2),
#     dP = -(Z + Z^T),    Z = P R U_r X B^+,    B = R U_n,
#
# of which P s = 0 and B^+ lam = 0 leave dP s = -Z s and dP lam = -Z^T lam. The partials of J w at a
# fixed w and of J^T z at a fixed z have all of E that this needs. All j with s_j = 0, each of them
# on closed loops, are served by one of either; an s_j that the gap has made, by one more.
#
# References
# ----------
# Golub, Pereyra. The differentiation of pseudo-inverses and nonlinear least squares problems whose
# variables separate. SIAM J. Numer. Anal. 10, 1973.


# Of a vector to a matrix with one column for each direction in which the rows turn.
Partial = Callable[[Array], Array]


class TurningRows:
    """The rows that are kept at one state, and how they turn.

    J (m, nv)
    rank: rows that are kept, less than m
    rest (m,): what is left in the rows, s
    """

    def __init__(self, redundancy: Redundancy, J: Array, rank: int, rest: Array) -> None:
        self.R, self.D, self.rank, self.rest = redundancy.R, redundancy.D, rank, rest
        A = self.R[:, None] * J * self.D
        self._U, self._S, self._Vt, _ = lapack().dgesdd(A, full_matrices=len(J) > J.shape[1])
        self.N, self._T = np.linalg.qr(self.R[:, None] * self._U[:, rank:])  # B
        alive = tolerances.REFERENCE_RANK * self._S[0] < self._S
        self._live = range(rank, max(int(np.count_nonzero(alive)), rank))

    def kept(self, s: Array) -> Array:
        """P s: rows (m,) or (m, k) without what is left out."""
        return np.asarray(s - self.N.dot(self.N.T.dot(s)))

    def turned(self, lam: Array, turning: Partial, pulling: Partial) -> tuple[Array, Array]:
        """P dP s and N N^T dP lam (m, k) along k turns of the rows, with N^T lam = 0."""
        # `turning` and `pulling` are how J w and J^T z change: (m, k) for a fixed w (nv,), and (nv,
        # k) for a fixed z (m,).
        r, R, D, dead = self.rank, self.R[:, None], self.D[:, None], self._live.stop
        U_r, V_r, values = self._U[:, :r], self._Vt[:r], self._S[:r]
        along = np.linalg.solve(self._T, self.N.T.dot(self.rest))
        held = U_r.T.dot(self.R * lam)
        # of all j with s_j = 0, whose X_ij = -u_j^T E v_i / s_i
        z = self.R * self._U[:, dead:].dot(along[dead - r :])
        w = self.D * V_r.T.dot(held / values)
        X_s = V_r.dot(D * pulling(z)) / -values[:, None]
        lam_X = [-self._U[:, dead:].T.dot(R * turning(w))]
        for j in reversed(self._live):
            s_j, u_j, v_j = self._S[j], self._U[:, j], self._Vt[j]
            X_j = s_j * U_r.T.dot(R * turning(self.D * v_j))
            X_j += values[:, None] * V_r.dot(D * pulling(self.R * u_j))
            X_j /= (s_j**2 - values**2)[:, None]
            X_s += along[j - r] * X_j
            lam_X.insert(0, held.dot(X_j)[None])
        by_lam = self.N.dot(np.linalg.solve(self._T.T, np.vstack(lam_X)))
        return -self.kept(R * U_r.dot(X_s)), -by_lam


def turning_null_space(linearisation: Linearisation, q: Array, w: Array, N: Array) -> Array:
    """Return N N^T (dJ w) (m, nv): what keeps lam = J w the smallest as the rows turn."""
    # On the constraints, where N (m, k) is an orthonormal basis of the left null space of J.
    return np.asarray(N @ (N.T @ linearisation.turning(q, w)))


def kkt_derivatives(workspace: Workspace, solution: Solution, v: Array, tau: Array) -> Derivatives:
    """Derivatives of the solver's own equations, or else of the KKT system."""
    found = workspace.solver.differentiated(workspace, solution, v, tau)
    return found or KktDerivatives(workspace, solution, v, tau)
