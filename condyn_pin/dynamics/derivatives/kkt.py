"""Derivatives by the implicit function theorem, on the matrix of the solve itself.

Both residuals of `condyn_pin.dynamics.derivatives.linearised` stay zero along an answer:

    M da - J^T dlam = dtau - r_q dq - r_v dv,        J da = -s_q dq - s_v dv

With independent rows, Y = M^-1 J^T, J Y = U^T U and W = Y U^-1, the inverse of that matrix is
that of M and a product of rank m:

    [ M  -J^T ]^-1   [ M^-1  0 ]   [  W   ]
    [ J    0  ]    = [  0    0 ] + [ U^-1 ] [ -W^T  U^-T ].

Where rows are redundant, the derivative is that of the smallest lam (`algebra/minimum_norm.py`).
With J L^-T = U S V^T and U_r the columns of U that belong to singular values above zero, U_r S^-1
takes the place of U^-1. The other columns N span the left null space of J, and that lam keeps
N^T lam = 0: with lam = J w

    N^T dlam = N^T (dJ w).

A product with an inverse loses what cancels in it: torques of tons by q, times the M^-1 of grams.
Where M is badly conditioned each is corrected once by what it leaves in the equations.
"""

from __future__ import annotations

from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg.minimum_norm import MinimumNorm, factorise
from condyn_pin._core.one_thread import of_workspace
from condyn_pin.dynamics.derivatives.base import Derivatives
from condyn_pin.dynamics.derivatives.linearised import Linearisation
from condyn_pin.dynamics.derivatives.loads import load_partial
from condyn_pin.dynamics.derivatives.parameters import (
    gravity_regressor,
    inertia_regressor,
    placement_partials,
)
from condyn_pin.dynamics.solution import Solution

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace

# Squares of the pivots of G that are below this multiple of its rounding may be nothing else: those
# of redundant rows are up to 6 times it, and those of robots with independent rows 1e7 times it.
_NOISE: Final = 1e3

_EPS: Final = float(np.finfo(float).eps)

# eps cond(M) from which on products with the inverse are corrected: what cancels costs up to a
# thousand times as much, and derivatives are promised to DERIVATIVES.
_ILL: Final = tolerances.DERIVATIVES / 1e4


class KktDerivatives(Derivatives):
    """Exact derivatives of every kind of constraint, on the constraints and off them.

    Notes
    -----
    Cost O(n d + n^2 m) for n joints and a tree of depth d, most of it Newton-Euler's derivatives
    and products of matrices.
    """

    def __init__(self, workspace: Workspace, solution: Solution, v: Array, tau: Array) -> None:
        super().__init__(solution)
        self._linearisation = linearisation = workspace.linearisation
        q = solution.q
        self._of = of = linearisation.at(q, v, solution.a, solution.lam)
        if solution.applied:
            of.rhs[: self._n, : self._n] += load_partial(workspace.loads, q, solution.applied)
        self._factors: MinimumNorm | None = None  # of redundant rows
        self._J = J = workspace.equations.drop_roundoff_rows(of.J)
        Y = of.M_inv.dot(J.T)
        nominal = workspace.scene.nominal
        # where rows are known to be redundant there is nothing to try
        K = None if nominal.dependent else _independent(J.dot(Y), _rounding(of.M_inv, J))
        if K is None:
            self._factors = factorise(of.M, J, tolerances.RANK)
            K = self._factors.U[:, : self._factors.rank] / self._factors.S[: self._factors.rank]
        self._inverse, self._workspace, self._v = _inverse(of.M_inv, Y, K), workspace, v
        self._matrix: Array | None = None
        if nominal.condition * _EPS > _ILL:
            self._matrix = _saddle(of.M, J)

    @cached_property
    @of_workspace
    def _null(self) -> Array | None:
        """What keeps lam the smallest as redundant rows turn (m, nv)."""
        if self._factors is None:
            return None
        q, lam = self.solution.q, self.solution.lam
        return turning_null_space(self._linearisation, q, lam, self._J, self._factors)

    @cached_property
    def _lam_by_q(self) -> Array:
        by_q: Array = self._blocks[0][self._n :]
        return by_q if self._null is None else by_q + self._null

    @property
    def dlam_dq(self) -> Array:
        """(m, nv); where rows are redundant, it takes its time when it is asked for first."""
        return self._lam_by_q

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
        of, bounds = self.solution, self.solution.scene.bounds
        return self._by(
            *placement_partials(
                self._linearisation, bounds, name, frame, of.q, self._v, of.a, of.lam
            )
        )

    def _by(self, r: Array, s: Array | None = None) -> tuple[Array, Array]:
        """Return the derivatives by a parameter, from the partials of the two residuals."""
        n = self._n
        answer = self._solve(-np.vstack([r, np.zeros((self._m, r.shape[1])) if s is None else s]))
        return answer[:n], answer[n:]

    def _solve(self, x: Array) -> Array:
        """Return the inverse times x, corrected where M is badly conditioned."""
        answer: Array = self._inverse.dot(x)
        if self._matrix is not None:
            answer += self._inverse.dot(x - self._matrix.dot(answer))
        return answer

    def _form(self) -> tuple[Array, Array, Array]:
        n = self._n
        by_state, by_tau = self._solve(self._of.rhs), self._inverse[:, :n].copy()
        if self._matrix is not None:
            left = self._matrix.dot(by_tau)
            left.flat[: n * n : n + 1] -= 1.0  # what is left of the torques, with the other sign
            by_tau -= self._inverse.dot(left)
        return by_state[:, :n], by_state[:, n:], by_tau

    def _forward(self, dq: Array, dv: Array, dtau: Array) -> tuple[Array, Array]:
        n = self._n
        x = self._of.rhs.dot(np.concatenate([dq, dv]))
        x[:n] += dtau
        answer = self._solve(x)
        if dq.any() and self._null is not None:
            answer[n:] += self._null @ dq
        return answer[:n], answer[n:]

    def _backward(self, da: Array, dlam: Array) -> tuple[Array, Array, Array]:
        n = self._n
        y = np.concatenate([da, dlam])
        x = y @ self._inverse
        if self._matrix is not None:
            x += (y - x @ self._matrix) @ self._inverse
        by_state = x.dot(self._of.rhs)
        if dlam.any() and self._null is not None:
            by_state[:n] += dlam @ self._null
        return by_state[:n], by_state[n:], x[:n]


def _independent(G: Array, rounding: float) -> Array | None:
    """Return U^-1 with U^T U = G (m, m), known to `rounding`; None unless rows are independent."""
    if not len(G):
        return G
    potrf, trtri = _lapack()
    U, info = potrf(G)
    pivots = U.diagonal().tolist()
    least = max(tolerances.RANK * max(pivots), (_NOISE * rounding) ** 0.5)
    if info or not min(pivots) > least:
        return None
    return trtri(U)[0]  # type: ignore[no-any-return]


def _rounding(M_inv: Array, J: Array) -> float:
    """Return eps |J| |M^-1| |J^T|: rounding of G = J M^-1 J^T; the largest of M^-1 is diagonal."""
    return _EPS * float(M_inv.diagonal().max()) * float(np.vdot(J, J))


def _saddle(M: Array, J: Array) -> Array:
    """Return [[M, -J^T], [J, 0]]."""
    m, n = J.shape
    K = np.zeros((n + m, n + m))
    K[:n, :n], K[:n, n:], K[n:, :n] = M, -J.T, J
    return K


def _inverse(M_inv: Array, Y: Array, K: Array) -> Array:
    """Return the inverse (nv + m, nv + m) of [[M, -J^T], [J, 0]] with K for U^-1."""
    n, m = Y.shape
    left = np.empty((n + m, K.shape[1]))
    left[n:] = K
    np.dot(Y, K, out=left[:n])
    right = left.copy()
    np.negative(right[:n], out=right[:n])
    inverse: Array = left.dot(right.T)
    inverse[:n, :n] += M_inv
    return inverse


@cache
def _lapack() -> tuple[Any, Any]:
    # imported here: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.lapack import dpotrf, dtrtri

    return dpotrf, dtrtri


def turning_null_space(
    linearisation: Linearisation, q: Array, lam: Array, J: Array, factors: MinimumNorm
) -> Array:
    """Return N N^T (dJ w) (m, nv): what keeps lam = J w the smallest as the rows turn."""
    N = factors.U[:, factors.rank :]
    w = np.asarray(np.linalg.lstsq(J, lam, rcond=tolerances.RANK)[0], dtype=np.float64)
    return np.asarray(N @ (N.T @ linearisation.turning(q, w)))
