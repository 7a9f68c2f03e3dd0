"""Derivatives of compliant constraints: those of `Soft`.

    r = M a + h - tau - J^T lam = 0,    s = J a + gamma + b J v + k c + R lam = 0,

where b is fixed, and k and R = (1 - d) / d w change with the impedance d of the gap |c| of each
constraint, but w does not: it changes with what bodies weigh (`inverse_inertias`). So with r_q, r_v
and the partials of J a + gamma of hard constraints (`condyn_pin.dynamics.derivatives.kkt`)

    M da - J^T dlam = dtau - r_q dq - r_v dv,    J da + R dlam = -s_q dq - s_v dv,
    s_q = (J a + gamma)_q + b (J v)_q + k c_q + (k_d c + R_d lam) d_q,    d_q = d' c^T c_q / |c|,
    s_v = (J a + gamma)_v + b J
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import damped_range_space
from condyn_pin._core.threads import of_workspace
from condyn_pin.dynamics.derivatives.solution_derivatives import (
    Derivatives,
    gravity_regressor,
    inertia_regressor,
    inverse_inertias_by_inertias,
    load_partial,
)
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.solvers.soft import (
    SolImp,
    SolRef,
    impedance,
    impedance_slope,
    reference_by,
)
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import SolveFailed


class SoftDerivatives(Derivatives):
    """Exact derivatives of the answer of `Soft`, off the constraints too.

    Notes
    -----
    Cost as `KktDerivatives`, and one more evaluation, of c and J v by q. Where the gap of a
    constraint is zero and impedance rises at once, power = 1, they are those of a gap that stays.
    """

    def __init__(
        self, workspace: Workspace, solution: Solution, v: Array, yields: Array,
        solref: SolRef, solimp: SolImp,
    ) -> None:  # fmt: skip
        super().__init__(solution)
        self._workspace, self._v = workspace, v
        self._softness = yields, solref, solimp
        self._linearise()

    @of_workspace
    def _linearise(self) -> None:
        """Keep what a step of q and v leaves to solve, and what solves it."""
        workspace, solution, v = self._workspace, self.solution, self._v
        (w, solref, solimp), q, lam, n = self._softness, solution.q, solution.lam, self._n
        equations, still = workspace.equations, np.zeros(n)
        c, velocity = equations.gaps(q, v)
        of = workspace.linearisation.at(q, v, solution.a, lam)
        J, rhs, rows = equations.drop_roundoff_rows(of.J), of.rhs, of.rhs[n:]
        if solution.applied:
            rhs[:n, :n] += load_partial(workspace.loads, q, solution.applied)
        M, R = equations.mass(q) if of.M is None else of.M, np.zeros(self._m)
        self._by_solref, self._by_w = np.zeros((self._m, 2)), np.zeros(self._m)
        if self._m:
            c_q = workspace.linearised_gaps.at(q, still, still, 0.0 * lam).s_q
            d, d_q = self._impedance(c, c_q)
            b, k, k_d, self._by_solref = reference_by(c, velocity, d, solref, solimp)
            R, R_d = (1 - d) / d * w, -w / d**2
            self._by_w = (1 - d) / d * lam
            rows[:, :n] -= b * workspace.linearisation.turning(q, v) + k[:, None] * c_q
            rows[:, :n] -= (k_d * c + R_d * lam)[:, None] * d_q
            rows[:, n:] -= b * J
        factors = damped_range_space(M, J, R)
        if factors is None:
            raise SolveFailed("M is not positive definite here", solution)
        self._rhs, self._factors = rhs, factors

    def _impedance(self, c: Array, c_q: Array) -> tuple[Array, Array]:
        """Return d of the constraint of each row (m,), and d by q (m, nv)."""
        bounds, (_, _, solimp) = self._workspace.bounds, self._softness
        starts, sizes = [b.rows.start for b in bounds], [b.size for b in bounds]
        gaps = np.sqrt(np.add.reduceat(c * c, starts))
        widens = np.add.reduceat(c[:, None] * c_q, starts) / np.where(gaps > 0, gaps, 1.0)[:, None]
        d_q = impedance_slope(gaps, solimp)[:, None] * widens
        return np.repeat(impedance(gaps, solimp), sizes), np.repeat(d_q, sizes, axis=0)

    def by_solref(self) -> tuple[Array, Array]:
        """Return the derivatives of a (nv, 2) and lam (m, 2) by the two numbers of `solref`."""
        return self._factors.solve(np.zeros((self._n, 2)), self._by_solref)

    def by_gravity(self) -> tuple[Array, Array]:
        """Return the derivatives of a (nv, 3) and lam (m, 3) by the vector of gravity [m/s^2]."""
        pulled = gravity_regressor(self._workspace.model, self.solution.q)
        return self._factors.solve(-pulled, np.zeros((self._m, 3)))

    @of_workspace
    def by_inertias(self) -> tuple[Array, Array]:
        """Return the derivatives of a and lam by the inertial parameters of the bodies."""
        # Ten columns a joint, as `KktDerivatives.by_inertias`; R is among them: compliances change
        # with the inertias of the bodies.
        model, of = self._workspace.model, self.solution
        r = inertia_regressor(model, of.q, self._v, of.a)
        s = self._by_w[:, None] * inverse_inertias_by_inertias(self._workspace)
        return self._factors.solve(-r, -s)

    def _form(self) -> tuple[Array, Array, Array]:
        n, rhs = self._n, self._rhs
        by_state = np.concatenate(self._factors.solve(rhs[:n], rhs[n:]))
        by_tau = np.concatenate(self._factors.solve(np.eye(n), np.zeros((self._m, n))))
        return by_state[:, :n], by_state[:, n:], by_tau
