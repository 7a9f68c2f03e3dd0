"""Exact sums, the minimum-norm factors, and the bound that a status is judged by."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from shared import all_scenes, each_row, each_scene, each_solver, states, truth

import condyn_pin as cp
from condyn_pin._core.linalg import (
    add,
    exact_product,
    exact_residual,
    factorise,
    held_and_free,
    inverse_factor,
    split,
)
from condyn_pin._core.tolerances import REFERENCE_RANK
from condyn_pin.constraints import Terms
from condyn_pin.dynamics.residuals import ErrorEstimator

numbers = st.floats(-1e100, 1e100).filter(lambda x: x == 0 or abs(x) > 1e-100)
vectors = arrays(float, 5, elements=numbers)


@given(vectors)
def test_split_is_exact_and_short(x):
    high, low = split(x)
    assert all(
        Fraction(h) + Fraction(t) == Fraction(a) for h, t, a in zip(high, low, x, strict=True)
    )
    assert np.array_equal(high * high / np.where(high == 0, 1, high), high)


@given(vectors, vectors)
def test_product_is_exact(x, y):
    p, e = exact_product(x, y)
    for pi, ei, xi, yi in zip(p, e, x, y, strict=True):
        assert Fraction(pi) + Fraction(ei) == Fraction(xi) * Fraction(yi)


@settings(max_examples=50)
@given(st.integers(0, 10**6))
def test_residual_is_the_exact_one_rounded(seed):
    """Where a plain residual has no correct digit left."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, 6)) * 10.0 ** rng.integers(-8, 8, size=(6, 6))
    x = rng.normal(size=6), 1e-17 * rng.normal(size=6)
    b = A @ x[0], 1e-12 * rng.normal(size=6)
    found = exact_residual(A, b, x)
    for i in range(6):
        exact = sum(map(Fraction, (part[i] for part in b)))
        exact -= sum(Fraction(A[i, j]) * (Fraction(x[0][j]) + Fraction(x[1][j])) for j in range(6))
        size = sum(abs(A[i, j] * x[0][j]) for j in range(6))
        assert abs(found[i] - float(exact)) <= 1e-31 * size + 1e-15 * abs(float(exact))


@pytest.mark.long
def test_residual_of_what_is_not_finite_is_nan():
    found = exact_residual(np.array([[np.inf, 1.0], [1.0, 1.0]]), [np.zeros(2)], (np.ones(2),) * 2)
    assert np.isnan(found[0])
    assert found[1] == -4.0


@given(vectors, vectors)
def test_sum_of_pairs_keeps_what_one_double_cannot(x, y):
    high, low = add((x, np.zeros(5)), y)
    for h, t, a, b in zip(high, low, x, y, strict=True):
        assert Fraction(h) + Fraction(t) == Fraction(a) + Fraction(b)


def system(rng, n=8, m=6, rank=4):
    root = rng.normal(size=(n, n))
    M = root @ root.T + n * np.eye(n)
    J = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
    return M, J


@pytest.mark.parametrize("seed", range(5))
def test_minimum_norm_solves_both_equations_with_the_smallest_lam(seed):
    rng = np.random.default_rng(seed)
    M, J = system(rng)
    factors = factorise(M, J, 1e-10)
    assert factors.rank == 4
    r, s = rng.normal(size=8), J @ rng.normal(size=8)
    a, lam = factors.solve(r, s)
    assert np.abs(M @ a - J.T @ lam - r).max() < 1e-12
    assert np.abs(J @ a - s).max() < 1e-12
    assert np.abs(factors.U[:, 4:].T @ lam).max() < 1e-13


@pytest.mark.parametrize(("rows", "rank"), [(0, 0), (4, 4), (4, 0), (9, 6), (9, 4), (6, 5)])
def test_held_and_free_motions_solve_what_the_minimum_norm_does(rows, rank):
    """Independent, redundant, more rows than columns, zeros, and none at all."""
    rng = np.random.default_rng(rank)
    J = rng.normal(size=(rows, rank)) @ rng.normal(size=(rank, 6))
    A = rng.normal(size=(6, 6))
    M = A @ A.T + np.eye(6)
    motions, factors = held_and_free(inverse_factor(M), J, 1e-9), factorise(M, J, 1e-9)
    assert motions.K.shape == (rows, rank)
    assert motions.N.shape == (rows, rows - rank)
    x, y = rng.normal(size=(6, 3)), rng.normal(size=(rows, 3))
    for had, wanted in zip(motions.solve(x, y), factors.solve(x, y), strict=True):
        assert np.abs(had - wanted).max(initial=0.0) < 1e-12 * np.abs(wanted).max(initial=1.0)
    one, none = np.eye(6), np.zeros((rows, 6))
    for had, wanted in zip(
        (motions.mobility, motions.support), motions.solve(one, none), strict=True
    ):
        assert np.abs(had - wanted).max(initial=0.0) < 1e-13
    assert np.abs(motions.B @ M @ motions.B.T - np.eye(6)).max() < 1e-13
    assert np.abs(J.T @ motions.N).max(initial=0.0) < 1e-12


@pytest.mark.long
def test_tangent_removes_what_the_constraints_see_and_nothing_else():
    rng = np.random.default_rng(0)
    M, J = system(rng)
    factors = factorise(M, J, 1e-10)
    v = rng.normal(size=8)
    tangent = factors.tangent(v)
    assert np.abs(J @ tangent).max() < 1e-13
    assert np.allclose(factors.tangent(tangent), tangent, atol=1e-14)
    assert abs(tangent @ M @ (v - tangent)) < 1e-12  # nearest in the metric of M


def test_reference_gains_digits_by_refinement():
    """Cassie's M has a condition of 1e7; the refined answer does not feel it."""
    scene, state = all_scenes()["cassie loops"], states("cassie loops")[0]
    plain = cp.solve(scene, *state, solver=cp.dynamics.Reference(refinements=0)).a
    once = cp.solve(scene, *state, solver=cp.dynamics.Reference(refinements=1)).a
    full = cp.solve(scene, *state, solver=cp.dynamics.Reference()).a
    more = cp.solve(scene, *state, solver=cp.dynamics.Reference(refinements=6)).a
    scale = np.abs(full).max()
    assert np.abs(full - more).max() <= 1e-15 * scale
    assert np.abs(once - full).max() <= 1e-13 * scale
    assert 1e-16 * scale < np.abs(plain - full).max() < 1e-9 * scale


@each_scene
def test_bound_is_one_at_the_nominal_state(label):
    """Whatever the residuals are made of: errors along light joints, rows, or everything."""
    scene = all_scenes()[label]
    equations = cp.Workspace(scene).equations
    nominal = scene.nominal.states[1]
    exact = cp.solve(scene, nominal.q, nominal.v, nominal.tau, solver=cp.dynamics.Reference())
    scale = max(np.abs(exact.a).max(), scene.nominal.estimator.gravity)
    rng = np.random.default_rng(0)
    for size in (1e-9, 1e-6, 1e-3):
        for direction in (np.ones(scene.robot.nv), rng.normal(size=scene.robot.nv)):
            a = exact.a + size * scale * direction / np.abs(direction).max()
            lam = exact.lam + size * scene.nominal.weight * rng.normal(size=scene.rows)
            residuals = equations.errors(nominal.q, nominal.v, nominal.tau, a, lam)
            bound = scene.nominal.estimator.prove(*residuals, nominal.tau)[0].bound
            true = np.abs(a - exact.a).max() / max(np.abs(a).max(), scene.nominal.estimator.gravity)
            assert true <= bound * (1 + 1e-6)


@settings(max_examples=60)
@given(
    st.sampled_from(
        ["cassie loops", "cassie loops + contacts", "talos foot held twice", "four_bar loops"]
    ),
    st.floats(-14, 1),
    st.integers(1, 30),
    st.integers(0, 3),
    st.sampled_from(
        [s for s in (cp.Proximal, cp.LCABA) if s.__name__.lower() in cp.dynamics.SOLVERS]
    ),
)
def test_ok_is_never_a_lie(label, exponent, iterations, which, kind):
    """Away from the nominal state, whatever mu and however few iterations."""
    from shared import HAS_LCABA

    if kind is cp.LCABA and not HAS_LCABA:
        kind = cp.Proximal
    scene, state, reference = all_scenes()[label], states(label)[which], truth(label)[which]
    solver = kind(mu=10.0**exponent, max_iterations=iterations)
    solution = cp.solve(scene, *state, solver=solver, throw=False)
    true = np.abs(solution.a - reference.a).max() / max(np.abs(reference.a).max(), 9.81)
    if solution.status.ok:
        assert true < 1e-8
    else:
        assert solution.error_bound > 1e-8


@pytest.mark.pairs
@pytest.mark.parametrize("moving", [0.0, 1.0])
@pytest.mark.parametrize("angle", [1e-1, 1e-3, 1e-5, 1e-7, 1e-9, 1e-12])
@each_solver
def test_ok_is_no_lie_near_a_singular_configuration(solver, angle, moving):
    """A parallelogram nearly flat: lam grows as 1/angle, and a jumps at zero."""
    bar = cp.model.four_bar(ground=0.6, crank=0.3, coupler=0.6, rocker=0.3)
    scene = cp.Scene(bar, bar.loops)
    if not solver.takes_loops:
        return
    q = angle * np.array([1.0, -1.0, 1.0])
    v = moving * np.array([1.0, -1.0, 1.0])
    tau = np.array([5.0, -2.0, 1.0])
    reference = cp.solve(scene, q, v, tau, solver=cp.dynamics.Reference(), throw=False)
    solution = cp.solve(scene, q, v, tau, solver=solver, throw=False)
    if solution.status.ok:
        scale = max(np.abs(reference.a).max(), 9.81)
        assert np.abs(solution.a - reference.a).max() < 1e-8 * scale
    if isinstance(solver, cp.Proximal) and angle > 0.005:
        assert solution.status.ok


def test_a_doubtful_answer_is_judged_at_its_own_state():
    """The nominal sigma, 70 times too large at this posture, would call some of these ok."""
    bar = cp.model.four_bar(ground=0.6, crank=0.3, coupler=0.6, rocker=0.3)
    scene = cp.Scene(bar, bar.loops)
    equations, nominal = cp.Workspace(scene).equations, scene.nominal.estimator
    q, v, tau = 0.01 * np.array([1.0, -1.0, 1.0]), np.zeros(3), np.array([5.0, -2.0, 1.0])
    caught = 0
    for iterations in range(1, 40):
        solver = cp.Proximal(mu=1e-4, max_iterations=iterations, relative_accuracy=0.0)
        solution = cp.solve(scene, q, v, tau, solver=solver, throw=False)
        residuals = equations.errors(q, v, tau, solution.a, solution.lam)
        caught += nominal.prove(*residuals, tau)[0].bound < 1e-8 < solution.error_bound
    assert caught
    assert solution.status.ok


def inaccurate(label: str, mu: float, iterations: int) -> tuple[cp.dynamics.Solution, float]:
    """An answer with an error on purpose, and the error relative to a."""
    scene, state, right = all_scenes()[label], states(label)[1], truth(label)[1]
    solver = cp.Proximal(mu=mu * scene.nominal.delassus_norm, max_iterations=iterations)
    solution = cp.solve(scene, *state, solver=solver, throw=False)
    return solution, np.abs(solution.a - right.a).max() / max(np.abs(solution.a).max(), 9.81)


@pytest.mark.parametrize("iterations", [1, 2])
@pytest.mark.parametrize(
    "label", ["four_bar loops", "cassie loops", "solo12 contacts", "talos foot held twice"]
)
def test_bound_of_an_answer_in_doubt_is_its_error(label, iterations):
    """Relative to the exact a, which may be smaller by the error."""
    solution, error = inaccurate(label, 1e-4, iterations)
    assert solution.status is cp.Status.INACCURATE
    assert solution.error_bound == pytest.approx(error / (1 - error), rel=2e-5)


@each_row(
    ("label", "mu"),
    [("four_bar loops", 1e-6), ("delta loops", 1e-8), ("talos foot held twice", 1e-8)],
)
def test_bound_of_a_small_error_is_that_of_the_nominal_state(label, mu):
    """max_i w_i sqrt(m) |s|_inf / sigma, with w_j^2 = (M^-1)_jj."""
    scene = all_scenes()[label]
    solution, error = inaccurate(label, mu, 2)
    terms = cp.Workspace(scene).terms(*scene.state())
    inverse = np.linalg.inv(terms.M)
    w = np.sqrt(inverse.diagonal())
    S = np.linalg.svd(terms.J @ np.linalg.cholesky(inverse), compute_uv=False)
    sigma = S[np.linalg.matrix_rank(terms.J, tol=1e-9) - 1]
    size = max(np.abs(solution.a).max(), 9.81)
    bound = w.max() * np.sqrt(scene.rows) / sigma * solution.residuals.constraint / size
    assert solution.status.ok
    assert error < solution.error_bound == pytest.approx(bound, rel=0.02)


@pytest.mark.pairs
@pytest.mark.parametrize("constrained", [False, True])
@pytest.mark.parametrize("distance", [1e-1, 1e-3, 1e-6, 0.0])
@each_solver
def test_ok_is_no_lie_where_the_mass_matrix_is_nearly_singular(solver, distance, constrained):
    """Euler angles near their gimbal lock: cond M grows as 1 / distance^2, and so does a."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSphericalZYX(), pin.SE3.Identity(), "turn")
    body = pin.Inertia(1.0, np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.2, 0.25]))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.3, 0.1, 0.2]))
    model.addFrame(pin.Frame("tip", joint, 0, tip, pin.FrameType.OP_FRAME))
    scene = cp.Scene(cp.Robot("top", model), [cp.PointContact("tip")] if constrained else [])
    q = np.array([0.4, np.pi / 2 - distance, 0.3])
    state = (q, np.zeros(3), np.array([1.0, 2.0, 3.0]))
    solution = cp.solve(scene, *state, solver=solver, throw=False)
    if distance < 1e-3:
        assert not solution.status.ok
    elif solution.status.ok:
        right = cp.solve(scene, *state, solver=cp.dynamics.Reference())
        assert np.abs(solution.a - right.a).max() < 1e-8 * np.abs(right.a).max()


# --- rounding of J


def terms_of_a_light_joint() -> tuple[Terms, np.ndarray]:
    """Two equal rows on a joint of 1 kg; on one of 1e-12 kg they cancel but for rounding."""
    J = np.array([[1.0, 0.0], [1.0, 2.0**-53]])
    nothing = np.zeros(2)
    terms = Terms(np.diag([1.0, 1e-12]), nothing, J, nothing, nothing)
    return terms, np.ones((2, 2))


@pytest.mark.long
def test_a_singular_value_that_rounding_made_does_not_count():
    """1e6 times larger in the metric of M, it was 5e-11 of the largest and held the joint."""
    terms, P = terms_of_a_light_joint()
    factors = factorise(terms.M, terms.J, REFERENCE_RANK)
    assert factors.rank == 2
    assert factors.above_rounding(P).rank == 1
    a, _ = cp.dynamics.Reference().solve(terms, np.array([2.0, 1.0]), P)
    np.testing.assert_allclose(a, [0.0, 1e12], atol=1.0)
    held, _ = cp.dynamics.Reference().solve(terms, np.array([2.0, 1.0]))
    assert abs(held[1]) < 1e9


@pytest.mark.long
def test_singular_values_above_rounding_count():
    terms, P = terms_of_a_light_joint()
    J = np.array([[1.0, 0.0], [1.0, 1e-6]])
    assert factorise(terms.M, J, REFERENCE_RANK).above_rounding(P).rank == 2


@pytest.mark.long
def test_a_slip_of_nothing_is_no_proof_where_j_is_rounding():
    """|e| <= |s| / sigma is no bound where J a itself is only known to eps P |a|."""
    terms, P = terms_of_a_light_joint()
    factors = factorise(terms.M, np.array([[1.0, 0.0], [1.0, 1e-12]]), 0.0)
    estimator = ErrorEstimator(factors, P, gravity=9.81, weight=9.81)
    a, nothing = np.array([10.0, 10.0]), np.zeros(2)
    assert estimator.negligible_constraint_error < 0.0
    bound = estimator.missing(nothing, nothing, nothing, a)
    assert bound > 2.0**-52 * 10.0 / 1e-12
    proof, _ = estimator.prove(nothing, [0.0, 10.0, 0.0, 0.0, 0.0, 0.0], nothing, bound)
    assert proof.bound > bound / 10.0


@pytest.mark.parametrize("label", ["cassie loops", "talos contacts", "talos_full corners"])
def test_machines_stay_above_their_rounding(label):
    """What rounding of J could make of singular values is far from those of machines."""
    nominal = all_scenes()[label].nominal
    assert 16 * nominal.estimator.blur < 1e-9 * nominal.singular_values[nominal.rank - 1]
    assert nominal.estimator.negligible_constraint_error > 0.0
