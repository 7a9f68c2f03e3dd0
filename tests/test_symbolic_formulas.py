"""Elimination, and Udwadia and Kalaba's formula, give the KKT solution: residuals by SymPy."""

from __future__ import annotations

import mpmath
import pytest
import sympy as sp
from lagrange import DIGITS, floats
from lagrange_cases import assert_near, each_case, each_drift, each_place, gains
from sympy.polys.matrices import DomainMatrix

import condyn_pin as cp


def symbols(name: str, rows: int, columns: int = 1) -> sp.Matrix:
    return sp.Matrix(rows, columns, lambda i, j: sp.Symbol(f"{name}_{i}{j}"))


def symmetric(name: str, n: int) -> sp.Matrix:
    return sp.Matrix(n, n, lambda i, j: sp.Symbol(f"{name}_{max(i, j)}{min(i, j)}"))


def polynomials(*matrices: sp.Matrix) -> list[DomainMatrix]:
    """Return matrices of polynomials, in one ring, where equal means identical."""
    ring = sp.QQ[tuple(sorted(set().union(*(A.free_symbols for A in matrices)), key=str))]
    return [DomainMatrix.from_Matrix(A).convert_to(ring) for A in matrices]


SIZES = [(2, 1), (2, 2), (3, 1), (3, 2)]


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_elimination_gives_the_kkt_solution(n, m):
    """Every W = M^-1, J, x and b, with G = J W J^T:

        lam = G^-1 (b - J W x),   a = W (x + J^T lam)   solve   M a - J^T lam = x,   J a = b.

    All is multiplied by d = det(G), and the first line by W, so that it is polynomial; K has one
    solution, since det(K) = det(M) det(G).
    """
    W, J, x, b = polynomials(
        symmetric("W", n), symbols("J", m, n), symbols("x", n), symbols("b", m)
    )
    adjugate, d = (J * W * J.transpose()).adj_det()
    d_lam = adjugate * (b - J * W * x)
    d_a = W * (d * x + J.transpose() * d_lam)
    assert (d_a - W * J.transpose() * d_lam - d * W * x).is_zero_matrix
    assert (J * d_a - d * b).is_zero_matrix

    M, J = symmetric("M", n), symbols("J", m, n)
    K = sp.BlockMatrix([[M, -J.T], [J, sp.zeros(m)]]).as_explicit()
    d_M = M.det()
    G = J * M.adjugate() * J.T  # times det(M)
    assert sp.expand(K.det(method="berkowitz") * d_M ** (m - 1) - G.det()) == 0


@pytest.mark.parametrize("redundant", [False, True], ids=["independent", "redundant"])
@pytest.mark.parametrize(("n", "m"), SIZES)
def test_udwadia_and_kalaba_give_the_kkt_solution(n, m, redundant):
    """Every M = S^2, J, x and b, with B = J M^-1/2 and a0 = M^-1 x:

        a = a0 + M^-1/2 B^+ (b - J a0),   lam = B^+T B^+ (b - J a0).

    S is a root of M, so that J = B S and, with x = S y, J a0 = B y. B^+ = P / d is the
    pseudo-inverse because it satisfies Penrose's four conditions. For independent rows it is
    B^T (B B^T)^-1; for rows in proportion, B = u w^T and b in proportion too, w u^T / |u|^2 |w|^2.
    """
    S, y = symmetric("S", n), symbols("y", n)
    if redundant:
        u, w = symbols("u", m), symbols("w", n)
        B, b, P = u * w.T, u * sp.Symbol("b"), w * u.T
        d = u.dot(u) * w.dot(w)
    else:
        B, b = symbols("B", m, n), symbols("b", m)
        P, d = B.T * (B * B.T).adjugate(), (B * B.T).det()
    S, y, B, b, P, d = polynomials(S, y, B, b, P, sp.Matrix([d]))
    d = d[0, 0].element
    for BP in (B * P, P * B):
        assert (BP - BP.transpose()).is_zero_matrix
    assert (B * P * B - d * B).is_zero_matrix
    assert (P * B * P - d * P).is_zero_matrix

    missing = b - B * y
    dd_Sa = d * d * y + d * (P * missing)  # d^2 S a
    dd_lam = P.transpose() * P * missing
    assert (
        S * dd_Sa - (B * S).transpose() * dd_lam - d * d * (S * y)
    ).is_zero_matrix  # M a = S S a
    assert (B * dd_Sa - d * d * b).is_zero_matrix  # J a = B S a


@each_drift
@each_place
@each_case
def test_the_solvers_return_the_two_formulas(case, closed, drift):
    """The formulas word by word, in 30 digits, from SymPy's terms."""
    case = case()
    solvers = [cp.dynamics.GaussPrinciple()]
    if case.scene.rows == case.system.m:  # a ball in the plane has a redundant row
        solvers.append(cp.dynamics.DelassusCholesky())
    for q, v, tau in case.states(closed):
        t = case.system.terms(q, v, *gains(drift))
        with mpmath.workdps(DIGITS):
            M, J = mpmath.matrix(t.M), mpmath.matrix(t.J)
            x, b = mpmath.matrix(tau - t.h), mpmath.matrix(t.a_ref - t.gamma)
            a0 = M**-1 * x
            lam = (J * M**-1 * J.T) ** -1 * (b - J * a0)
            eliminated = floats(a0 + M**-1 * J.T * lam)
            values, Q = mpmath.eigsy(M)
            root = Q * mpmath.diag([1 / mpmath.sqrt(value) for value in values]) * Q.T  # M^-1/2
            U, S, V = mpmath.svd_r(J * root)
            pseudo_inverse = V.T * mpmath.diag([1 / s for s in S]) * U.T
            gauss = floats(a0 + root * pseudo_inverse * (b - J * a0))
        assert_near(eliminated, gauss, 1e-15)
        for solver in solvers:
            solution = cp.solve(case.scene, q, v, tau, solver=solver, drift=drift)
            assert_near(solution.a, gauss, 1e-12)
            assert_near(solution.lam[case.kept], floats(lam), 1e-12)
