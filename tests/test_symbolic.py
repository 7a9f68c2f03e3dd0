"""What the library returns is what the mathematics says: proofs by SymPy, from the Lagrangian."""

from __future__ import annotations

import sys

import mpmath
import numpy as np
import pytest
import sympy as sp
from lagrange import ALPHA, BETA, DIGITS, floats
from lagrange_cases import (
    DRIFTS,
    GRAVITY,
    LENGTH,
    MASS,
    PIVOT,
    assert_near,
    each_case,
    each_drift,
    each_place,
    gains,
    rod_pendulum,
)
from shared import robot

import condyn_pin as cp


def test_the_rod_pendulum_obeys_the_law_of_the_pendulum():
    """x = l sin(theta), z = -l cos(theta): theta'' = -(g/l) sin(theta), and lam is the tension.

    lam = m (g cos(theta) + l theta'^2)
    """
    system = rod_pendulum().system
    t, g, rate = sp.symbols("t"), GRAVITY, sp.Symbol("omega", real=True)
    theta, angle = sp.Function("theta")(t), sp.Symbol("theta", real=True)
    place = PIVOT + LENGTH * sp.Matrix([sp.sin(theta), -sp.cos(theta)])
    law = {theta.diff(t, 2): -g / LENGTH * sp.sin(theta)}

    def at(expression):
        return expression.subs(law).subs({theta.diff(t): rate}).subs({theta: angle})

    state = dict(zip([*system.q, *system.v], [*at(place), *at(place.diff(t))], strict=True))
    K, k = (part.subs(state).subs(dict.fromkeys(system.tau, 0)) for part in system.kkt())
    tension = MASS * (g * sp.cos(angle) + LENGTH * rate**2)
    answer = sp.Matrix([*at(place.diff(t, 2)), tension])
    assert sp.simplify(K * answer - k) == sp.zeros(3, 1)
    assert sp.simplify(K.det()) != 0


@each_place
@each_case
def test_the_terms_are_those_of_the_lagrangian(case, closed):
    case = case()
    workspace = cp.Workspace(case.scene)
    for q, v, _ in case.states(closed):
        wanted, found = case.system.terms(q, v), workspace.terms(q, v)
        assert (np.abs(wanted.c).max() < 1e-9) == closed
        assert_near(found.M, wanted.M, 1e-12)
        assert_near(found.h, wanted.h, 1e-12)
        for name in ("J", "gamma"):
            rows = getattr(found, name)
            assert_near(rows[case.kept], getattr(wanted, name), 1e-12)
            assert np.abs(np.delete(rows, case.kept, axis=0)).max(initial=0.0) < 1e-15
        assert_near(workspace.violation(q)[case.kept], wanted.c, 1e-12)


@pytest.mark.pairs
@each_drift
@each_place
@each_case
def test_the_answer_is_the_solution_of_the_lagrangian(case, closed, drift):
    case = case()
    workspace = cp.Workspace(case.scene, drift=drift)
    for q, v, tau in case.states(closed):
        wanted, _ = case.system.solve(q, v, tau, *gains(drift))
        solution = workspace.solve(q, v, tau)
        assert_near(solution.a, wanted[: case.system.n], 1e-12)
        assert_near(solution.lam[case.kept], wanted[case.system.n :], 1e-12)
        assert np.abs(np.delete(solution.lam, case.kept)).max(initial=0.0) < 1e-12


@pytest.mark.pairs
@each_drift
@each_place
@each_case
def test_the_solvers_return_the_two_formulas(case, closed, drift):
    """Elimination, and Udwadia and Kalaba's formula, in 30 digits, from SymPy's terms.

    lam = (J M^-1 J^T)^-1 (b - J a0),   a = a0 + M^-1 J^T lam = a0 + M^-1/2 (J M^-1/2)^+ (b - J a0)
    """
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


@pytest.mark.pairs
@each_drift
@each_place
@each_case
def test_the_derivatives_are_those_of_the_symbolic_answer(case, closed, drift):
    case = case()
    for q, v, tau in case.states(closed, count=2):
        _, wanted = case.system.solve(q, v, tau, *gains(drift))
        d = cp.derivatives(case.scene, q, v, tau, drift=drift)
        by_q_v_tau = np.hsplit(wanted, 3)
        for found, block in zip((d.da_dq, d.da_dv, d.da_dtau), by_q_v_tau, strict=True):
            assert_near(found, block[: case.system.n], 1e-10)
        for found, block in zip((d.dlam_dq, d.dlam_dv, d.dlam_dtau), by_q_v_tau, strict=True):
            assert_near(found[case.kept], block[case.system.n :], 1e-10)
            assert np.abs(np.delete(found, case.kept, axis=0)).max(initial=0.0) < 1e-12


def test_baumgarte_makes_a_gap_a_damped_spring():
    """K (a, lam) = k gives c'' + 2 alpha c' + beta^2 c = 0, with c'' by the chain rule.

    Its roots are -alpha +- sqrt(alpha^2 - beta^2).
    """
    system = rod_pendulum().system
    K, k = system.kkt()
    a = K.LUsolve(k)[: system.n, :]
    c = system.rows.c
    c_dot = c.jacobian(system.q) * system.v
    c_ddot = c_dot.jacobian(system.q) * system.v + c_dot.jacobian(system.v) * a
    spring = c_ddot + 2 * ALPHA * c_dot + BETA**2 * c
    assert sp.simplify(spring) == sp.zeros(1, 1)

    t, s = sp.symbols("t s")
    mode, root = sp.exp(s * t), sp.sqrt(ALPHA**2 - BETA**2)
    characteristic = mode.diff(t, 2) + 2 * ALPHA * mode.diff(t) + BETA**2 * mode
    factors = (s + ALPHA - root) * (s + ALPHA + root)
    assert sp.expand(characteristic / mode - factors) == 0


@pytest.mark.pairs
@each_drift
@each_place
@each_case
def test_the_library_obeys_that_equation(case, closed, drift):
    """J a + gamma = -2 alpha J v - beta^2 c with the library's a, and SymPy's rows or its own.

    For a ball these are R^T C'', R^T C' and R^T C: C obeys it, in the axes of the world.
    """
    case = case()
    workspace, (alpha, beta) = cp.Workspace(case.scene, drift=drift), gains(drift)
    for q, v, tau in case.states(closed):
        t, own = case.system.terms(q, v), workspace.terms(q, v)
        a = workspace.solve(q, v, tau).a
        wanted = -2 * alpha * t.J @ v - beta**2 * t.c
        scale = max(1.0, np.abs(a).max())
        assert np.abs(t.J @ a + t.gamma - wanted).max() < 1e-12 * scale
        assert np.abs(own.J @ a + own.gamma - own.a_ref).max() < 1e-12 * scale
        assert_near(own.a_ref[case.kept], wanted, 1e-12)


@pytest.mark.long
@pytest.mark.parametrize("drift", list(DRIFTS.values())[1:], ids=list(DRIFTS)[1:])
def test_the_roots_are_those_of_the_linearised_library(drift):
    """About hanging at rest, det(s I - A) = (s^2 + g/l) (s^2 + 2 alpha s + beta^2).

    A = [[0, I], [da_dq, da_dv]]: the swing of the pendulum, and the spring of the gap.
    """
    case = rod_pendulum()
    hanging = floats(mpmath.matrix(list(PIVOT - sp.Matrix([0, LENGTH]))))
    d = cp.derivatives(case.scene, hanging, np.zeros(2), np.zeros(2), drift=drift)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [d.da_dq, d.da_dv]])
    swing = [1.0, 0.0, float(GRAVITY / LENGTH)]
    wanted = np.polymul(swing, [1.0, 2 * drift.alpha, drift.beta**2])
    assert_near(np.poly(A), wanted, 1e-11)


# --- Scene.symbolic ------------------------------------------------------------------------------


def on_everything(made: cp.Robot) -> cp.Scene:
    return cp.Scene(made, [*made.loops, *made.contacts])


def bar(constraint: cp.constraints.Constraint) -> cp.Scene:
    return cp.Scene(robot("four_bar"), [constraint])


DERIVED = {
    "a ball loop, three hinges": lambda: on_everything(robot("four_bar")),
    "a planar pin": lambda: bar(cp.Loop("coupler_tip", "rocker_tip", "planar", axis="y")),
    "a hinge": lambda: bar(cp.Loop("coupler_tip", "rocker_tip", "hinge", axis="y")),
    "a rod": lambda: bar(cp.Loop("crank_tip", "rocker_tip", "rod", length=0.8)),
    "a curved coupling": lambda: bar(
        cp.constraints.Coupling("rocker", "crank", -0.5, 0.7, higher=(0.3, -0.2))
    ),
    "a wheel that rolls": lambda: on_everything(robot("unicycle")),
    "a disc that floats": lambda: on_everything(robot("rolling_disc")),
    "a blade on a plane": lambda: on_everything(robot("sleigh")),
    "a body welded to the world": lambda: cp.Scene(
        robot("rolling_ball"), [cp.SurfaceContact("centre", half_length=0.1, half_width=0.1)]
    ),
}


@pytest.mark.parametrize("made", DERIVED.values(), ids=list(DERIVED))
def test_formulas_of_a_scene_have_the_numbers_of_its_terms(made):
    scene = made()
    derived, workspace = scene.symbolic(), cp.Workspace(scene)
    rng = np.random.default_rng(6)
    for _ in range(2):
        q, v = scene.sample(rng)
        wanted, found = workspace.terms(q, v), derived.terms(q, v)
        for name in ("M", "h", "J", "gamma"):
            assert_near(getattr(found, name), getattr(wanted, name), 1e-13)


def test_formulas_of_a_wheel_are_those_of_the_textbook():
    """cos(heading) x' + sin(heading) y' = radius roll', -sin(heading) x' + cos(heading) y' = 0."""
    scene = on_everything(robot("unicycle"))
    derived = scene.symbolic()
    heading, radius = derived.q[2], sp.Float(0.3, 17)
    c, s = sp.cos(heading), sp.sin(heading)
    textbook = sp.Matrix([[c, s, 0, -radius], [-s, c, 0, 0]])
    assert sp.simplify(derived.J - textbook) == sp.zeros(2, 4)
    assert sp.simplify(derived.gamma - (textbook * derived.v).jacobian(derived.q) * derived.v) == (
        sp.zeros(2, 1)
    )
    K, k = derived.kkt()
    q, v = scene.sample(np.random.default_rng(6))
    tau = np.array([0.0, 0.0, 0.3, -0.2])
    at = dict(zip([*derived.q, *derived.v, *derived.tau], [*q, *v, *tau], strict=True))
    solution = cp.solve(scene, q, v, tau)
    answer = np.array(K.subs(at).LUsolve(k.subs(at)), dtype=float).ravel()
    assert_near(answer, np.append(solution.a, solution.lam), 1e-12)


def test_what_has_no_formula_is_refused(monkeypatch):
    four_bar = robot("four_bar")
    own = cp.constraints.OwnRows(lambda q: np.eye(3)[:1], name="own")
    driven = cp.constraints.Driven(cp.constraints.HeldJoint("crank"), cp.constraints.Sine(0.1))
    for scene in (
        cp.Scene(four_bar, [own]),
        cp.Scene(four_bar, [driven]),
        cp.Scene(robot("solo12"), contacts=robot("solo12").frictional_contacts(0.7)),
    ):
        with pytest.raises(cp.errors.UnsupportedConstraint):
            scene.symbolic()
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(cp.errors.MissingExtra, match="symbolic"):
        cp.Scene(four_bar).symbolic()
