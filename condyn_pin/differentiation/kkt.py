"""Derivatives by the implicit function theorem, on the matrix of the solve itself.

Both residuals of `condyn_pin.differentiation.linearised` stay zero along an answer:

    M da - J^T dlam = dtau - r_q dq - r_v dv,        J da = -s_q dq - s_v dv

Independent rows take two Cholesky factorisations (`condyn_pin.range_space`). Where rows are
redundant, the derivative is that of the smallest lam. With J = U S V^T L^T cut at its rank and N
the rest of U, a basis of the left null space, that lam keeps N^T lam = 0: with lam = J w

    N^T dlam = N^T (dJ w).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin import tolerances
from condyn_pin.arrays import Array
from condyn_pin.differentiation.base import Derivatives
from condyn_pin.differentiation.linearised import Linearisation, Linearised
from condyn_pin.minimum_norm import MinimumNorm, factorise
from condyn_pin.range_space import RangeSpace, range_space
from condyn_pin.solution import Solution

if TYPE_CHECKING:
    from condyn_pin.workspace import Workspace


class KktDerivatives(Derivatives):
    """Exact derivatives of every kind of constraint, on the constraints and off them.

    Parameters
    ----------
    workspace : Workspace
    solution : Solution
    v, tau : (nv,) array
    """

    def __init__(self, workspace: Workspace, solution: Solution, v: Array, tau: Array) -> None:
        super().__init__(solution)
        linearisation, q, lam = workspace.linearisation, solution.q, solution.lam
        self._of = of = linearisation.at(q, v, solution.a, lam)
        self._null: Array | None = None
        factors: RangeSpace | MinimumNorm | None = range_space(of.M, of.J)
        if factors is None:
            M = np.triu(of.M) + np.triu(of.M, 1).T
            factors = factorise(M, of.J, tolerances.RANK)
            self._null = turning_null_space(linearisation, q, lam, of, factors)
        self._factors = factors

    def _form(self) -> tuple[Array, Array]:
        of, n, m = self._of, self._n, self._m
        x, y = np.empty((n, 3 * n), order="F"), np.zeros((m, 3 * n), order="F")
        np.negative(of.r_q, out=x[:, :n])
        np.negative(of.r_v, out=x[:, n : 2 * n])
        x[:, 2 * n :] = np.eye(n)
        np.negative(of.s_q, out=y[:, :n])
        np.negative(of.s_v, out=y[:, n : 2 * n])
        da, dlam = self._factors.solve(x, y)
        if self._null is not None:
            dlam[:, :n] += self._null
        return da, dlam

    def _forward(self, dq: Array, dv: Array, dtau: Array) -> tuple[Array, Array]:
        of = self._of
        da, dlam = self._factors.solve(
            dtau - of.r_q @ dq - of.r_v @ dv, -(of.s_q @ dq) - of.s_v @ dv
        )
        return da, dlam if self._null is None else dlam + self._null @ dq

    def _backward(self, da: Array, dlam: Array) -> tuple[Array, Array, Array]:
        # the matrix is symmetric in (a, -lam): its transpose is solved like itself
        of = self._of
        x, y = self._factors.solve(da, -dlam)
        by_q = y @ of.s_q - x @ of.r_q
        if self._null is not None:
            by_q += dlam @ self._null
        return by_q, y @ of.s_v - x @ of.r_v, x


def turning_null_space(
    linearisation: Linearisation, q: Array, lam: Array, of: Linearised, factors: MinimumNorm
) -> Array:
    """Return N N^T (dJ w) (m, nv): what keeps lam the smallest as the rows turn."""
    N = factors.U[:, factors.rank :]
    w: Array = np.asarray(np.linalg.lstsq(of.J, lam, rcond=tolerances.RANK)[0], dtype=np.float64)
    still = np.zeros_like(w)
    dJ_w = linearisation.at(q, still, w, np.zeros_like(lam)).s_q
    return np.asarray(N @ (N.T @ dJ_w))
