"""What the library returns is what the mathematics says: proofs by SymPy, from the Lagrangian."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import mpmath
import numpy as np
import pytest
import sympy as sp
from lagrange import ALPHA, BETA, DIGITS, Rows, System, floats
from sympy.polys.matrices import DomainMatrix

import condyn_pin as cp
from condyn_pin._pin import pin

GRAVITY = sp.Rational(981, 100)  # [m/s^2]
MASS, LENGTH, PIVOT = sp.Rational(3, 2), sp.Rational(4, 5), sp.Matrix([sp.Rational(1, 5), 1])
LINKS = sp.Rational(1, 2), sp.Rational(2, 5), sp.Rational(3, 10)  # [m]
MASSES = 2, sp.Rational(3, 2), 1  # [kg]
HOOK = sp.Matrix([sp.Rational(3, 5), sp.Rational(-2, 5)])  # x and z [m]

DRIFTS = {
    "no drift control": None,
    "underdamped": cp.Baumgarte(3.0, 5.0),
    "critical": cp.Baumgarte(4.0, 4.0),
    "overdamped": cp.Baumgarte(6.0, 4.0),
}
each_drift = pytest.mark.parametrize("drift", DRIFTS.values(), ids=list(DRIFTS))


@dataclass(frozen=True, eq=False)
class Case:
    """The same mechanism twice: as equations of SymPy, and as a scene."""

    system: System
    scene: cp.Scene

    @functools.cached_property
    def kept(self) -> list[int]:
        """Rows in the plane: all, but for the y of a ball."""
        return [0, 2] if self.scene.rows == 3 else list(range(self.scene.rows))

    def states(self, closed: bool, count: int = 3):
        """Yield (q, v, tau), moving, on the constraints or far off."""
        rng = np.random.default_rng(11)
        for _ in range(count):
            q, v = self.scene.sample(rng) if closed else rng.normal(size=(2, self.system.n))
            yield q, v, 3 * rng.normal(size=self.system.n)


def in_the_plane(x, z) -> np.ndarray:
    return np.array([float(x), 0.0, float(z)])


@functools.cache
def rod_pendulum() -> Case:
    """A point mass at (x, z), a rod to the pivot: L = m (x'^2 + z'^2) / 2 - m g z."""
    q, v = sp.Matrix(sp.symbols("x z", real=True)), sp.Matrix(sp.symbols("vx vz", real=True))
    r = q - PIVOT
    c = sp.Matrix([LENGTH - sp.sqrt(r.dot(r))])
    L = MASS * v.dot(v) / 2 - MASS * GRAVITY * q[1]

    model, here = pin.Model(), pin.SE3.Identity()
    x = model.addJoint(0, pin.JointModelPX(), here, "x")
    z = model.addJoint(x, pin.JointModelPZ(), here, "z")
    point = pin.Inertia(float(MASS), np.zeros(3), np.zeros((3, 3)))
    model.appendBodyToJoint(z, point, here)
    model.addFrame(pin.Frame("mass", z, 0, here, pin.FrameType.OP_FRAME))
    robot = cp.Robot("point mass", model).with_frame("pivot", "world", in_the_plane(*PIVOT))
    rod = cp.Loop("pivot", "mass", "rod", length=float(LENGTH))
    return Case(System(q, v, L, Rows.of(c, q, v)), cp.Scene(robot, [rod]))


def arm_robot() -> cp.Robot:
    """Three slender rods that turn about y, m l^2 / 12 across; a frame at the tip."""
    model, joint, at = pin.Model(), 0, np.zeros(3)
    for length, mass in zip(map(float, LINKS), map(float, MASSES), strict=True):
        place = pin.SE3(np.eye(3), at)
        joint = model.addJoint(joint, pin.JointModelRY(), place, f"joint{joint}")
        at = np.array([length, 0.0, 0.0])
        across = mass * length**2 / 12
        rod = pin.Inertia(mass, at / 2, np.diag([0.0, across, across]))
        model.appendBodyToJoint(joint, rod, pin.SE3.Identity())
    place = pin.SE3(np.eye(3), at)
    model.addFrame(pin.Frame("tip", joint, 0, place, pin.FrameType.OP_FRAME))
    return cp.Robot("arm", model).with_frame("hook", "world", in_the_plane(*HOOK))


@functools.cache
def arm(closure: str) -> Case:
    """Three rods in the plane x-z, the tip held: L = sum m v_c^2 / 2 + I w^2 / 2 - m g z_c.

    With C = tip - hook and R the axes of the last rod, the closures mean

        planar, the hook first     c = -C                         in the axes of the world
        planar, the tip first      c = R^T C, its derivatives with the turning of R
        ball, point                c = R^T C, J v = R^T C', J a + gamma = R^T C''
    """
    q, v = sp.Matrix(sp.symbols("q1:4", real=True)), sp.Matrix(sp.symbols("v1:4", real=True))
    end, L = sp.zeros(2, 1), sp.Integer(0)
    for k, (length, mass) in enumerate(zip(LINKS, MASSES, strict=True)):
        angle, rate = sum(q[: k + 1]), sum(v[: k + 1])  # about y: from x to -z
        along = sp.Matrix([sp.cos(angle), -sp.sin(angle)])
        centre, end = end + along * length / 2, end + along * length
        velocity = centre.jacobian(q) * v
        inertia = mass * length**2 / sp.Integer(12)
        L += mass * velocity.dot(velocity) / 2 + inertia * rate**2 / 2 - mass * GRAVITY * centre[1]
    C, to_tip = end - HOOK, sp.Matrix([along.T, [-along[1], along[0]]])
    rows, constraint = {
        "planar of the world": (Rows.of(-C, q, v), cp.Loop("hook", "tip", "planar", axis="y")),
        "planar of the tip": (Rows.of(to_tip * C, q, v), cp.Loop("tip", "hook", "planar", "y")),
        "ball": (Rows.of(C, q, v).seen_in(to_tip), cp.Loop("tip", "hook", "ball")),
        "point": (
            Rows.of(C, q, v).seen_in(to_tip),
            cp.PointContact("tip", anchor=tuple(in_the_plane(*HOOK))),
        ),
    }[closure]
    return Case(System(q, v, L, rows), cp.Scene(arm_robot(), [constraint]))


CASES = {
    "rod pendulum": rod_pendulum,
    **{
        f"arm, {closure}": functools.partial(arm, closure)
        for closure in ("planar of the world", "planar of the tip", "ball", "point")
    },
}
each_case = pytest.mark.parametrize("case", CASES.values(), ids=list(CASES))
each_place = pytest.mark.parametrize("closed", [True, False], ids=["closed", "open"])


def gains(drift: cp.Baumgarte | None) -> tuple[float, float]:
    return (drift.alpha, drift.beta) if drift else (0.0, 0.0)


def assert_near(found: np.ndarray, wanted: np.ndarray, share: float) -> None:
    """|found - wanted| <= share max(1, |wanted|), with the largest entries."""
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max() <= share * max(1.0, np.abs(wanted).max())


# The terms and the answer


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


@each_drift
@each_place
@each_case
def test_the_derivatives_are_those_of_the_symbolic_answer(case, closed, drift):
    case = case()
    for q, v, tau in case.states(closed, count=2):
        _, wanted = case.system.solve(q, v, tau, *gains(drift))
        d = cp.derivatives(case.scene, q, v, tau, drift=drift)
        of_a = np.hstack([d.da_dq, d.da_dv, d.da_dtau])
        of_lam = np.hstack([d.dlam_dq, d.dlam_dv, d.dlam_dtau])
        assert_near(of_a, wanted[: case.system.n], 1e-10)
        assert_near(of_lam[case.kept], wanted[case.system.n :], 1e-10)


# Baumgarte


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


# Two formulas for the same solution


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
    solvers = [cp.GaussPrinciple()]
    if case.scene.rows == case.system.m:  # a ball in the plane has a redundant row
        solvers.append(cp.DelassusCholesky())
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
