"""What each solver promises beyond the contract that all of them share."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared import (
    HAS_LCABA,
    SOLVED,
    SOLVERS,
    all_scenes,
    each_of,
    each_scene,
    relative,
    states,
    takes,
    truth,
)

import condyn_pin as cp
from condyn_pin._core.linalg import range_space
from condyn_pin.cli.commands.look import solver_rows
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.solvers.conjugate_gradient import conjugate_gradients
from condyn_pin.dynamics.solvers.dense_kkt import PROBES, probing, scaling

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "benchmarks"))

DAMPED = [
    cp.dynamics.DelassusCholesky,
    cp.DenseKKT,
    cp.dynamics.SparseKKT,
    cp.dynamics.ConjugateGradient,
    cp.dynamics.MinimumResidual,
]
ITERATIVE = [cp.dynamics.ConjugateGradient, cp.dynamics.MinimumResidual]
SMALLEST_LAM = [cp.dynamics.NullSpace(), cp.dynamics.GaussPrinciple()]
REDUNDANT = [label for label, scene in all_scenes().items() if scene.nominal.redundant]


@pytest.mark.values
@pytest.mark.parametrize("kind", DAMPED)
@pytest.mark.parametrize("label", ["talos corners", "cassie loops", "four_bar backwards"])
def test_damping_costs_accuracy_in_proportion(kind, label):
    """Redundant rows: off by mu / sigma, and by ten times less for a tenth of mu."""
    scene, state, right = all_scenes()[label], states(label)[1], truth(label)[1]
    errors = []
    for share in (1e-4, 1e-5, 1e-6):
        parameters = {"tolerance": 1e-12} if kind in ITERATIVE else {}
        solver = kind(mu=share * scene.nominal.delassus_norm, **parameters)
        errors.append(relative(cp.solve(scene, *state, solver=solver, throw=False).a, right.a))
    assert np.allclose(np.array(errors[:-1]) / errors[1:], 10.0, rtol=0.05), errors


@pytest.mark.values
@pytest.mark.parametrize("kind", DAMPED)
@pytest.mark.parametrize("mu", [-1e-9, np.nan, np.inf, "1"])
def test_damping_that_means_nothing_is_refused(kind, mu):
    with pytest.raises(cp.InvalidArgument, match="mu"):
        kind(mu=mu)


def test_knobs_may_be_numbers_of_numpy():
    """Pinocchio takes Python's alone."""
    scene, state = all_scenes()["talos contacts"], states("talos contacts")[0]
    number, few = np.float32(1e-6), np.int64(3)
    chosen = [
        cp.dynamics.SparseKKT(mu=np.float32(1e-9)),
        cp.dynamics.DelassusCholesky(mu=np.int64(1)),
        cp.Proximal(max_iterations=few, relative_accuracy=number, absolute_accuracy=number),
    ]
    if HAS_LCABA:
        chosen.append(cp.LCABA(mu=number, max_iterations=few, absolute_accuracy=number))
    for solver in chosen:
        assert np.isfinite(cp.solve(scene, *state, solver=solver, throw=False).a).all()


@pytest.mark.long
@pytest.mark.values
@pytest.mark.parametrize("solver", SMALLEST_LAM, ids=lambda s: s.title)
@each_of(REDUNDANT)
def test_of_many_lam_the_smallest(solver, label):
    scene = all_scenes()[label]
    for state, right in zip(states(label), truth(label), strict=True):
        found = cp.solve(scene, *state, solver=solver)
        assert relative(found.lam, right.lam, floor=scene.nominal.weight) < 1e-9


@pytest.mark.values
@pytest.mark.parametrize(
    "kind", [cp.dynamics.NullSpace, cp.dynamics.GaussPrinciple, cp.dynamics.Reference]
)
@pytest.mark.parametrize("share", [0.0, 1.0, -1e-3, np.nan])
def test_a_rank_tolerance_is_a_share(kind, share):
    with pytest.raises(cp.InvalidArgument, match="rank_tolerance"):
        kind(rank_tolerance=share)


@pytest.mark.long
def test_a_machine_without_any_freedom_stands_still():
    """As many rows as joints: the null space is empty, and so is its matrix."""
    bar = cp.model.four_bar()
    q, _ = cp.Scene(bar, bar.loops).state()
    scene = cp.Scene(bar, [*bar.loops, cp.PointContact("crank_tip", name="held")])
    assert scene.nominal.mobility == 0
    for name, kind in SOLVERS.items():
        if takes(kind(), scene) and kind.exact:
            tau = np.array([3.0, -1.0, 2.0])
            found = cp.solve(scene, q, np.zeros(3), tau, solver=kind(), throw=False)
            assert np.abs(found.a).max() < SOLVED, name


@settings(max_examples=100)
@given(st.integers(0, 10**6), st.integers(0, 6), st.booleans())
def test_range_space_solves_or_says_that_it_cannot(seed, m, redundant):
    """Whatever the units of the rows are."""
    rng = np.random.default_rng(seed)
    unit = 10.0 ** rng.integers(-4, 5, (m, 1))
    root, J = rng.normal(size=(7, 7)), unit * rng.normal(size=(m, 7))
    M = root @ root.T + 0.1 * np.eye(7)
    if redundant and m > 2:
        J[-1] = 3 * J[0] - 2 * J[(m - 1) // 2]
        assert range_space(M, J) is None
        assert range_space(M, J, 1e-3) is not None
        return
    factors = range_space(M, J)
    assert factors is not None
    x, y = rng.normal(size=(7, 3)), unit * rng.normal(size=(m, 3))
    a, lam = factors.solve(x, y)
    size = np.abs(M) @ np.abs(a) + np.abs(J.T) @ np.abs(lam)
    assert (np.abs(M @ a - J.T @ lam - x) < 1e-9 * size).all()
    assert np.abs((J @ a - y) / unit).max(initial=0.0) < 1e-7


@pytest.mark.long
def test_a_mass_matrix_that_is_none_is_no_answer():
    assert range_space(-np.eye(3), np.ones((1, 3))) is None


# --- Dense KKT


@each_scene
def test_dense_kkt_says_singular_where_rows_are_redundant_and_only_there(label):
    """Its two random right-hand sides miss no singularity at any of a hundred states."""
    scene = all_scenes()[label]
    workspace = cp.Workspace(scene, cp.DenseKKT())
    said = {
        workspace.solve(*state, throw=False).status
        for state in cp.study.SampledStates(100, seed=7).of(scene)
    }
    assert said == {cp.Status.SINGULAR if scene.nominal.redundant else cp.Status.OK}


@pytest.mark.long
@settings(max_examples=200)
@given(st.integers(0, 10**6), st.integers(2, 60), st.floats(1.0, 16.0))
def test_random_right_hand_sides_see_how_large_an_inverse_is(seed, size, digits):
    """To within a factor of a hundred, where four digits lie between what is told apart."""
    U, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(size, size)))
    inverse = np.ones(size)
    inverse[0] = 10.0**digits
    found = (U * inverse) @ (U.T @ probing(size).reshape(-1, size).T)
    seen = np.sqrt(np.vdot(found, found) / PROBES)
    assert 1e-2 < seen / np.linalg.norm(inverse) < 1e2


@pytest.mark.long
def test_a_row_that_is_nothing_at_the_nominal_state_is_not_blown_up():
    chain = cp.model.chain(4)  # it hangs straight: no joint moves the tip up
    scene = cp.Scene(chain, [cp.PointContact(chain.model.frames[-1].name)])
    assert scaling(scene.nominal.terms)[4:].max() < 1e3


# --- Conjugate gradients and MINRES


@pytest.mark.parametrize("kind", ITERATIVE)
def test_sweeps_form_no_jacobian(kind, monkeypatch):
    def formed(*_):
        raise AssertionError("J was formed")

    for label in ("talos corners", "cassie loops", "four_bar geared", "talos hands on a rod"):
        scene, state = all_scenes()[label], states(label)[0]
        right = truth(label)[0].a
        workspace = cp.Workspace(scene, kind())
        with monkeypatch.context() as patch:
            patch.setattr(Equations, "_raw_jacobian", formed)
            assert relative(workspace.acceleration(*state), right) < SOLVED


def test_an_iteration_for_every_independent_row_is_enough():
    """In exact arithmetic; here one or two more, for a tolerance near rounding."""
    for label in ("solo12 contacts", "talos contacts", "talos corners", "cassie loops"):
        scene = all_scenes()[label]
        found = cp.solve(scene, *states(label)[0], solver=cp.dynamics.ConjugateGradient())
        assert 0 < found.iterations <= scene.nominal.rank + 2


@pytest.mark.long
@pytest.mark.parametrize("kind", ITERATIVE)
def test_too_few_iterations_are_told(kind):
    scene, state = all_scenes()["talos contacts"], states("talos contacts")[0]
    found = cp.solve(scene, *state, solver=kind(max_iterations=3), throw=False)
    assert found.iterations == 3
    assert found.status is cp.Status.INACCURATE
    enough = cp.solve(scene, *state, solver=kind())
    found = cp.solve(scene, *state, solver=kind(tolerance=0.1), throw=False)
    assert 1e-9 < found.constraint_error < 0.1
    assert found.iterations < enough.iterations


def test_minres_takes_three_steps_with_the_ideal_preconditioner():
    """At the nominal state the preconditioned matrix has three eigenvalues."""
    scene = all_scenes()["talos contacts"]
    state = (*scene.state(), np.ones(scene.robot.nv))
    found = cp.solve(scene, *state, solver=cp.dynamics.MinimumResidual())
    assert found.iterations <= 3
    assert relative(found.a, cp.solve(scene, *state, solver=cp.dynamics.Reference()).a) < SOLVED


@pytest.mark.long
def test_minres_takes_at_most_four_times_the_steps_of_conjugate_gradients():
    for label in ("solo12 contacts", "talos contacts", "talos corners", "cassie loops"):
        cg, minres = (
            cp.solve(all_scenes()[label], *states(label)[0], solver=kind()) for kind in ITERATIVE
        )
        assert cg.iterations < minres.iterations <= 4 * cg.iterations


@settings(max_examples=40)
@given(st.integers(0, 10**6))
def test_what_is_out_of_reach_does_not_blow_the_answer_up(seed):
    """A right side with a part outside the range of A, which no x can meet."""
    rng = np.random.default_rng(seed)
    U, _ = np.linalg.qr(rng.normal(size=(8, 8)))
    S = np.array([5.0, 3.0, 1.0, 0.5, 0.2, 0.0, 0.0, 0.0])
    A = (U * S) @ U.T
    wanted = U[:, :5] @ rng.normal(size=5)
    b = A @ wanted + 1e-9 * U[:, 5:] @ rng.normal(size=3)
    x, iterations = conjugate_gradients(lambda p: A @ p, b, np.eye(8), 1e-14, 500)
    assert iterations < 50
    assert np.abs(U[:, :5].T @ (x - wanted)).max() < 1e-6
    assert np.abs(b - A @ x).max() < 1e-8


@pytest.mark.long
def test_a_nominal_state_that_is_singular_is_no_bad_start():
    """The preconditioner is made at a flat parallelogram, where one row more is redundant."""
    bar = cp.model.four_bar(ground=0.6, crank=0.3, coupler=0.6, rocker=0.3)
    flat = cp.Robot("flat", bar.model, loops=bar.loops, postures={"flat": np.zeros(3)})
    scene = cp.Scene(flat, flat.loops)
    assert scene.nominal.rank == 1
    q = np.array([1.0, -1.0, 1.0])
    state = (q, np.zeros(3), np.array([5.0, -2.0, 1.0]))
    found = cp.solve(scene, *state, solver=cp.dynamics.ConjugateGradient())
    assert relative(found.a, cp.solve(scene, *state, solver=cp.dynamics.Reference()).a) < SOLVED


# --- Sparse KKT


@pytest.mark.long
def test_imitated_kinds_are_refused_with_a_way_out():
    scene = all_scenes()["talos hands hinged"]
    with pytest.raises(
        cp.errors.UnsupportedConstraint, match=r"takes points and welds.*use Proximal\(\)"
    ):
        cp.Workspace(scene, cp.dynamics.SparseKKT())
    slider = all_scenes()["talos hands on a slider"]
    with pytest.raises(cp.errors.UnsupportedConstraint, match=r"NullSpace\(\)"):
        cp.Workspace(slider, cp.dynamics.SparseKKT())


@pytest.mark.long
def test_the_factor_is_that_of_the_state_asked_for():
    """Pinocchio 4 factorises the Jacobian of the last `calc`: here, of no state at all."""
    label = "talos foot to foot, welded"
    workspace = cp.Workspace(all_scenes()[label], cp.dynamics.SparseKKT())
    for state, right in zip(reversed(states(label)), reversed(truth(label)), strict=True):
        assert relative(workspace.solve(*state).a, right.a) < 1e-12


@pytest.mark.long
@pytest.mark.parametrize("distance", [1e-1, 1e-3])
def test_rows_that_pinocchio_has_further_apart_have_their_own_targets(distance):
    """Points that are nearly one are handed to it at other places of the same foot."""
    talos, rng = all_scenes()["talos contacts"].robot, np.random.default_rng(0)
    foot = "left_sole_link"
    points = [cp.PointContact(foot), cp.PointContact(foot, (distance, 0, 0), name="there")]
    scene = cp.Scene(talos, points)
    state = (*scene.sample(rng), rng.normal(size=talos.nv))
    right = cp.solve(scene, *state, solver=cp.dynamics.Reference())
    damped = cp.dynamics.SparseKKT(mu=1e-10 * scene.nominal.delassus_norm)
    found = cp.solve(scene, *state, solver=damped)
    assert relative(found.lam, right.lam) < 1e-5
    with pytest.raises(cp.SolveFailed, match="singular"):
        cp.solve(scene, *state, solver=cp.dynamics.SparseKKT())


# --- The table, and the committed comparison


def test_the_table_has_every_solver_and_every_knob():
    rows = {row.name: row for row in solver_rows()}
    assert set(rows) == {kind.__name__ for kind in cp.dynamics.SOLVERS.values()}
    assert "mu=0.0" in rows["DelassusCholesky"].parameters
    assert rows["DelassusCholesky"].redundant == "mu > 0, else singular"
    assert rows["NullSpace"].redundant == "yes"
    assert rows["Proximal"].kinds.startswith("points, welds, hinges, edges and the planar pins")
    assert rows["SparseKKT"].kinds == "points and welds"


@pytest.mark.parametrize("label", ["solo12 contacts", "cassie loops + contacts", "four_bar loops"])
def test_every_ok_is_one(label):
    """What `benchmarks/solvers.py equivalence` does for a thousand states, for ten."""
    from solvers import agreements

    table = agreements(label, all_scenes()[label], 10)
    assert {row.solver for row in table} >= {"Proximal", "NullSpace", "ConjugateGradient"}
    for row in table:
        assert row.is_honest, row
        name, _, damped = row.solver.partition("(")
        kind = cp.dynamics.SOLVERS[name.lower()]
        takes = kind.takes_redundant or row.rows == row.rank
        if damped:
            assert row.ok + row.inaccurate == 10
        elif not kind.exact:
            assert row.inaccurate == 10
        else:
            assert (row.ok if takes else row.singular) == 10, row


def test_the_committed_comparison_is_complete():
    from solvers import AGREEMENTS

    lines = [line for line in AGREEMENTS.read_text().splitlines() if not line.startswith("#")]
    table = list(csv.DictReader(lines))
    known = {kind.__name__ for kind in cp.dynamics.SOLVERS.values()} - {"Reference"}
    differing = {row["solver"].split("(")[0] for row in table} ^ known
    assert not differing, (
        f"the committed comparison and SOLVERS differ by {differing}: run "
        "benchmarks/solvers.py equivalence, and commit its table"
    )
    for row in table:
        assert int(row["states"]) >= 1000
        assert float(row["error"]) < SOLVED
