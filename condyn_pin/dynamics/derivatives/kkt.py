"""Derivatives by the implicit function theorem, on the matrix of the solve itself.

Both residuals of `condyn_pin.dynamics.derivatives.linearised` stay zero along an answer:

    M da - J^T dlam = dtau - r_q dq - r_v dv,        J da = -s_q dq - s_v dv

Motions that are held and those that are free (`_core/linalg.py`) solve that for all
columns at once, those by tau among them. Where rows are redundant, the derivative is that of the
smallest lam. With N the left null space of J, that lam keeps N^T lam = 0 as the rows turn: for any
w with lam = J w

    N^T dlam = N^T (dJ w).

Off the constraints, where rows are left out, what is left in them is active as well
(`condyn_pin.dynamics.derivatives.turning`):

    P J da = -P (s_q dq + s_v dv + dP s),    N^T dlam = N^T dP lam.
"""

from __future__ import annotations

from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.linalg import HeldAndFree, held_and_free, inverse_factor
from condyn_pin._core.threads import of_workspace
from condyn_pin.dynamics.derivatives.base import Derivatives
from condyn_pin.dynamics.derivatives.loads import load_partial
from condyn_pin.dynamics.derivatives.parameters import (
    gravity_regressor,
    inertia_regressor,
    placement_partials,
)
from condyn_pin.dynamics.derivatives.turning import TurningRows, turning_null_space
from condyn_pin.dynamics.solution import Solution

if TYPE_CHECKING:
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
    def _factored(self) -> tuple[Array, HeldAndFree, TurningRows | None]:
        """What a step of q and v leaves to solve (nv + m, 2 nv), and what solves it.

        Off the constraints also the rows that are kept.
        """
        return self._factorise()

    def _factorise(self) -> tuple[Array, HeldAndFree, TurningRows | None]:
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
    def _motions(self) -> HeldAndFree:
        return self._factored[1]

    @cached_property
    @of_workspace
    def _null(self) -> Array | None:
        """What keeps lam the smallest as redundant rows turn (m, nv)."""
        motions, of = self._motions, self.solution
        if not motions.N.shape[1]:
            return None
        w = motions.held(of.lam)
        return turning_null_space(self._linearisation, of.q, w, motions.N)

    @property
    def dlam_dq(self) -> Array:
        """(m, nv); where rows are redundant, it takes its time when it is asked for first."""
        return self._forces[0]

    @property
    def dlam_dv(self) -> Array:
        """Constraint forces by the velocity (m, nv)."""
        return self._forces[1]

    @property
    def dlam_dtau(self) -> Array:
        """Constraint forces by the torques (m, nv)."""
        return self._forces[2]

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
        """Return the derivatives of a and lam by the inertial parameters of the bodies.

        Ten columns a joint, as `pin.Inertia.toDynamicParameters`: mass, mass times centre of mass,
        and the inertia about the joint's origin xx xy yy xz yz zz. Armature is not among them.
        """
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
