"""Lagrangian mechanics by SymPy, from energies and constraint functions alone.

With the Lagrangian L(q, v) = T - V and the constraints c(q) = 0,

    d/dt dL/dv - dL/dq = tau + J^T lam,      J a + gamma = a_ref

so that M = d2L/dv2, h = (d2L/dv dq) v - dL/dq, J = dc/dq and gamma = (d(J v)/dq) v = Jdot v.
Nothing here knows Pinocchio or the library; numbers have 30 digits.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from types import SimpleNamespace

import mpmath
import numpy as np
import sympy as sp
from sympy.polys.matrices import DomainMatrix

DIGITS = 30
ALPHA, BETA = sp.symbols("alpha beta", nonnegative=True)  # [1/s]


@dataclass(frozen=True)
class Rows:
    """Constraints: what they call a gap c, its velocity J v, and its acceleration J a + gamma."""

    c: sp.Matrix
    J: sp.Matrix
    gamma: sp.Matrix

    @classmethod
    def of(cls, c: sp.Matrix, q: sp.Matrix, v: sp.Matrix) -> Rows:
        """Differentiate c(q) twice by time."""
        J = c.jacobian(q)
        return cls(c, J, (J * v).jacobian(q) * v)

    def seen_in(self, axes: sp.Matrix) -> Rows:
        """Return the same three vectors in other axes, whose own turning does not count."""
        return Rows(axes * self.c, axes * self.J, axes * self.gamma)


class System:
    """A constrained mechanism: its equations, their solution, and the derivatives of that."""

    def __init__(self, q: sp.Matrix, v: sp.Matrix, L: sp.Expr, rows: Rows) -> None:
        dL_dv = sp.Matrix([L]).jacobian(v).T
        self.q, self.v, self.rows = q, v, rows
        self.tau = sp.Matrix(sp.symbols(f"tau:{len(q)}"))
        self.M = dL_dv.jacobian(v)
        self.h = dL_dv.jacobian(q) * v - sp.Matrix([L]).jacobian(q).T
        self.a_ref = -2 * ALPHA * rows.J * v - BETA**2 * rows.c
        self.n, self.m = len(q), len(rows.c)

    def kkt(self) -> tuple[sp.Matrix, sp.Matrix]:
        """Return K and k of K (a, lam) = k: both equations of the module, one above the other."""
        J = self.rows.J
        K = sp.BlockMatrix([[self.M, -J.T], [J, sp.zeros(self.m)]]).as_explicit()
        return K, sp.Matrix.vstack(self.tau - self.h, self.a_ref - self.rows.gamma)

    @functools.cached_property
    def _numeric(self) -> SimpleNamespace:
        """The terms, the entries e of M, J and k, and their derivatives by p = (q, v, tau)."""
        p = [*self.q, *self.v, *self.tau]
        _, k = self.kkt()
        e = sp.Matrix([*lower_triangle(self.M), *self.rows.J, *k])
        terms = (self.M, self.h, self.rows.J, self.rows.gamma, self.a_ref, self.rows.c)
        return SimpleNamespace(
            terms=compiled([*p, ALPHA, BETA], *terms),
            entries=compiled([*p, ALPHA, BETA], e, e.jacobian(p)),
        )

    def terms(self, q, v, alpha=0.0, beta=0.0) -> SimpleNamespace:
        """Return M, h, J, gamma, a_ref and c at a state."""
        with mpmath.workdps(DIGITS):
            found = self._numeric.terms(*exact(q, v, np.zeros(self.n), [alpha, beta]))
        names = ("M", "h", "J", "gamma", "a_ref", "c")
        return SimpleNamespace(**dict(zip(names, map(floats, found), strict=True)))

    def solve(self, q, v, tau, alpha=0.0, beta=0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return (a, lam), and their derivatives by (q, v, tau) as an (n + m, 3 n) array.

        With x = N / d by Cramer's rule, a rational function of the entries e of M, J and k,

            dx/dp = dx/de de/dp,    dx/de = (dN/de - x dd/de) / d.
        """
        with mpmath.workdps(DIGITS):
            e, de_dp = self._numeric.entries(*exact(q, v, tau, [alpha, beta]))
            N, dN_de, d, dd_de = cramer(self.n, self.m)(*e)
            x = N / d
            return floats(x), floats((dN_de - x * dd_de) / d * de_dp)


@functools.cache
def cramer(n: int, m: int):
    """Solve K x = k for every M, J and k: x = adj(K) k / det(K) = N / d, and derivatives by these.

    The function takes the lower triangle of M, J and k, row by row, and returns N, dN/de, d, dd/de.
    """
    entry = sp.Matrix(n + m, n + m, lambda i, j: sp.Symbol(f"K_{max(i, j)}_{min(i, j)}"))
    M, J = entry[:n, :n], entry[n:, :n]
    k = sp.Matrix(sp.symbols(f"k:{n + m}"))
    K = sp.BlockMatrix([[M, -J.T], [J, sp.zeros(m)]]).as_explicit()
    adjugate, det = DomainMatrix.from_Matrix(K).adj_det()
    N, d = adjugate.to_Matrix() * k, sp.Matrix([adjugate.domain.to_sympy(det)])
    e = [*lower_triangle(M), *J, *k]
    return compiled(e, N, N.jacobian(e), d[0], d.jacobian(e))


def lower_triangle(M: sp.Matrix) -> list[sp.Expr]:
    """Return the entries of a symmetric matrix, each once."""
    return [M[i, j] for i in range(M.rows) for j in range(i + 1)]


def compiled(arguments, *results):
    """Return a function of numbers with any number of digits."""
    return sp.lambdify(arguments, results, "mpmath", cse=True)


def exact(*parts) -> list[mpmath.mpf]:
    """Return floats as they are, with more digits behind them."""
    return [mpmath.mpf(float(x)) for part in parts for x in part]


def floats(matrix: mpmath.matrix) -> np.ndarray:
    """Return the nearest floats; a column as a vector."""
    array = np.array(matrix.tolist(), dtype=float)
    return array[:, 0] if matrix.cols == 1 else array
