"""Derivatives by the implicit function theorem, on the matrix of the solve itself.

Both residuals of `condyn_pin.differentiation.linearised` stay zero along an answer:

    M da - J^T dlam = dtau - r_q dq - r_v dv,        J da = -s_q dq - s_v dv

With independent rows, Y = M^-1 J^T, G = J Y and B = Y G^-1, an inverse of that matrix is

    a = (M^-1 - Y B^T) x + B y,        lam = G^-1 y - B^T x.

Where rows are redundant, the derivative is that of the smallest lam (`condyn_pin.minimum_norm`).
With N a basis of the left null space of J, that lam keeps N^T lam = 0: with lam = J w

    N^T dlam = N^T (dJ w).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from condyn_pin import tolerances
from condyn_pin.arrays import Array
from condyn_pin.differentiation.base import Derivatives
from condyn_pin.differentiation.linearised import Linearisation, Linearised
from condyn_pin.minimum_norm import MinimumNorm, factorise
from condyn_pin.solution import Solution

if TYPE_CHECKING:
    from condyn_pin.workspace import Workspace


class Inverse(NamedTuple):
    """The inverse of the matrix, by blocks."""

    A: Array  # (nv, nv), M^-1 - Y B^T
    B: Array  # (nv, m)
    G_inv: Array  # (m, m)

    def solve(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return (a, lam) for one or many right-hand sides x (nv, k), y (m, k)."""
        return self.A @ x + self.B @ y, self.G_inv @ y - self.B.T @ x


class KktDerivatives(Derivatives):
    """Exact derivatives of every kind of constraint, on the constraints and off them.

    Parameters
    ----------
    workspace : Workspace
    solution : Solution
    v, tau : (nv,) array

    Notes
    -----
    Cost O(n d + n^2 m) for n joints and a tree of depth d, most of it Newton-Euler's derivatives
    and products of matrices.
    """

    def __init__(self, workspace: Workspace, solution: Solution, v: Array, tau: Array) -> None:
        super().__init__(solution)
        linearisation, q, lam = workspace.linearisation, solution.q, solution.lam
        self._of = of = linearisation.at(q, v, solution.a, lam)
        self._null: Array | None = None  # (m, nv): what keeps lam the smallest as the rows turn
        factors: Inverse | MinimumNorm | None = _invert(of)
        if factors is None:
            factors = factorise(linearisation.mass_matrix(q), of.J, tolerances.RANK)
            self._null = turning_null_space(
                linearisation, q, lam, of.J, factors, drift=workspace.drift is not None
            )
        self._factors = factors

    def _form(self) -> tuple[Array, Array]:
        of, n, m = self._of, self._n, self._m
        x, y = np.concatenate([of.r_q, of.r_v], axis=1), np.concatenate([of.s_q, of.s_v], axis=1)
        by_state = self._factors.solve(x, y)
        if isinstance(self._factors, Inverse):
            by_tau = self._factors.A, -self._factors.B.T
        else:
            by_tau = self._factors.solve(np.eye(n), np.zeros((m, n)))
        da, dlam = (np.concatenate([-a, b], axis=1) for a, b in zip(by_state, by_tau, strict=True))
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


def _invert(of: Linearised) -> Inverse | None:
    """Return the inverse; None if the rows are not independent."""
    # imported here: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.lapack import dpotrf, dpotrs

    m, n = of.J.shape
    if m == 0:
        return Inverse(of.M_inv, np.zeros((n, 0)), np.zeros((0, 0)))
    Y = of.M_inv @ of.J.T
    C, info = dpotrf(of.J @ Y)
    pivots = C.diagonal()
    if info or not pivots.min() > tolerances.RANK * pivots.max():
        return None
    BT = dpotrs(C, Y.T)[0]
    return Inverse(of.M_inv - Y @ BT, BT.T, dpotrs(C, np.eye(m))[0])


def turning_null_space(
    linearisation: Linearisation,
    q: Array,
    lam: Array,
    J: Array,
    factors: MinimumNorm,
    *,
    drift: bool = False,
) -> Array:
    """Return N N^T (dJ w) (m, nv): what keeps lam the smallest as the rows turn."""
    N = factors.U[:, factors.rank :]
    w = np.asarray(np.linalg.lstsq(J, lam, rcond=tolerances.RANK)[0], dtype=np.float64)
    still, no_force = np.zeros_like(w), np.zeros_like(lam)
    dJ_w = linearisation.at(q, still, w, no_force).s_q
    if drift:  # what it adds at rest is no part of J w
        dJ_w = dJ_w - linearisation.at(q, still, still, no_force).s_q
    return np.asarray(N @ (N.T @ dJ_w))
