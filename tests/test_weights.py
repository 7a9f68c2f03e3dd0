"""Proximal's own mu: on machines, near singular postures, and against every mu by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from shared import all_scenes, relative, robot, states, takes, truth

import condyn_pin as cp
from condyn_pin._core._pin import factorise_constraints
from lab.extremes import EXTREMES
from lab.extremes.verdicts import Task, error_of, right_answers

BENCHMARKS = str(Path(__file__).parent.parent / "benchmarks")


@pytest.mark.parametrize(
    ("label", "most"),
    [
        ("talos contacts", 2),
        ("four_bar loops", 2),
        ("cassie loops", 3),
        ("four_bar hinge", 3),  # Pinocchio takes it as two points, with a row too many
        ("talos hands hinged", 5),
    ],
)
def test_machines_take_few_iterations(label, most):
    """One or more, and one that finds that nothing changes."""
    workspace = cp.Workspace(all_scenes()[label])
    assert all(workspace.solve(*state).iterations <= most for state in states(label))


@pytest.mark.long
@pytest.mark.parametrize("name", ["four_bar", "n_four_bar", "five_bar", "parallelogram"])
def test_planar_loops_in_a_slanted_plane_take_three_iterations(name):
    """Rows across the plane are then no longer exactly zero, and lam grows along them."""
    level = cp.load_robot(name)
    model = level.model.copy()
    slant = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.2, 0.1), np.zeros(3))
    for joint in range(1, model.njoints):
        if model.parents[joint] == 0:
            model.jointPlacements[joint] = slant * model.jointPlacements[joint]
    for frame in model.frames:
        if frame.parentJoint == 0:
            frame.placement = slant * frame.placement
    scene = cp.Scene(replace(level, model=model), level.loops)
    assert scene.nominal.independent
    assert scene.nominal.rounded
    assert not cp.Scene(level, level.loops).nominal.rounded
    workspace, rng = cp.Workspace(scene), np.random.default_rng(0)
    for _ in range(5):
        solution = workspace.solve(*scene.sample(rng), rng.normal(size=level.nv))
        assert solution.iterations <= 3
        assert solution.error_bound < 1e-12


@pytest.mark.parametrize(
    ("label", "independent"),
    [
        ("talos contacts", True),
        ("four_bar loops", True),  # its third row is zero
        ("andrews loops", True),
        ("four_bar hinge", False),  # Pinocchio takes it as two points, with a row too many
        ("talos corners", False),  # more points than a rigid foot has room for
        ("cassie loops", False),  # redundant where they are closed, and only there
        ("bricard loops", False),
    ],
)
def test_redundant_rows_that_come_to_life_are_found(label, independent):
    assert all_scenes()[label].nominal.independent is independent


@pytest.mark.parametrize(
    "label", ["cassie on lines", "four_bar hinge", "talos hands hinged", "cassie loops"]
)
def test_shares_are_of_the_matrix_that_pinocchio_factorises(label):
    """Two points in place of an edge have other eigenvalues than its turns, 1 / (kg m^2), have."""
    scene = all_scenes()[label]
    nominal, w = scene.nominal, cp.Workspace(scene)
    models, datas = w.constraint_models, w.constraint_datas
    factor = factorise_constraints(w.model, w.data, models, datas, nominal.q, 1e-3)
    G = factor.getInverseOperationalSpaceInertiaMatrix() - 1e-3 * np.eye(factor.constraintDim())
    sigma = np.sort(np.linalg.eigvalsh(G))[::-1]
    assert nominal.delassus_spectrum == pytest.approx((sigma[0], sigma[nominal.rank - 1]), rel=1e-6)
    assert sigma[nominal.rank : nominal.rank + 1].max(initial=0.0) < 1e-9 * sigma[0]


@pytest.mark.parametrize("severity", [1e-9, 1e-12, 0.0])
def test_edges_through_one_point_leave_eleven_digits(severity):
    """With shares of the largest eigenvalue for turns, mu was too large to converge in six."""
    for seed in range(3):
        case = EXTREMES["near_edges"].case(severity, seed)
        solution = cp.solve(case.scene, case.q, case.v, case.tau)
        assert min(error_of(case, solution.a, right) for right in right_answers(case)) < 5e-12
        assert solution.iterations <= 6


@pytest.mark.long
@pytest.mark.parametrize("severity", [1e-9, 1e-12])
def test_a_body_that_weighs_nothing_is_not_moved_by_the_last_step_of_lam(severity):
    """A force of 1e-9 of the weight is 1e-8 N, and 1e4 m/s^2 to a body of 1e-12 kg."""
    scene = all_scenes()["four_bar loops"]
    for seed in range(3):
        case = EXTREMES["massless_body"].case(severity, seed, scene)
        found = cp.solve(case.scene, case.q, case.v, case.tau, throw=False)
        error = min(error_of(case, found.a, each) for each in right_answers(case))
        assert error < 1e-4 * 2.0**-52 * case.scene.nominal.delassus_condition


@pytest.mark.long
@pytest.mark.parametrize("severity", [1e-10, 1e-11, 0.0])
def test_a_flat_parallelogram_takes_five_iterations_more(severity):
    """What is left of G has one eigenvalue, a large one: a small mu is as safe as a large one."""
    case = EXTREMES["parallelogram"].case(severity, 0)
    solution = cp.solve(case.scene, case.q, case.v, case.tau, throw=False)
    assert solution.iterations <= 11
    assert min(error_of(case, solution.a, right) for right in right_answers(case)) < 1e-12


@pytest.mark.values
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("severity", EXTREMES["parallelogram"].severities)
def test_a_nearly_flat_parallelogram_is_solved_at_every_angle(severity, seed):
    case = EXTREMES["parallelogram"].case(severity, seed)
    workspace = cp.Workspace(case.scene)
    solution = workspace.solve(case.q, case.v, case.tau, throw=False)
    assert min(error_of(case, solution.a, right) for right in right_answers(case)) < 1e-8
    if severity >= 1e-7:  # no second reading there
        assert solution.status.ok
        assert relative(solution.a, case.right[0]) < 1e-8
    again = workspace.acceleration(case.q, case.v, case.tau)
    assert np.array_equal(again, solution.a)
    assert np.array_equal(workspace.lam(), solution.lam)


@pytest.mark.long
def test_spinning_rods_are_right_and_say_so():
    """The bound once said 4e-8 of answers that are off by 1e-11."""
    for severity in (0.0, 0.2):
        case = EXTREMES["spinning_rods"].case(severity, 0)
        solution = cp.solve(case.scene, case.q, case.v, case.tau)
        assert error_of(case, solution.a, right_answers(case)[0]) < solution.error_bound < 1e-8


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("name", "severity"),
    [("quarter_turn", 1e-3), ("quarter_turn", 1e-4), ("flat_rods", 1e-3)],
)
def test_machines_near_their_singularity_get_a_correction(name, severity, seed):
    """Rounding of G alone, eps cond(G), would be more there than an answer that is ok may miss."""
    case = EXTREMES[name].case(severity, seed)
    solution = cp.solve(case.scene, case.q, case.v, case.tau)
    error = error_of(case, solution.a, case.right[0])
    plain = cp.Proximal(refinements=0)
    rough = cp.solve(case.scene, case.q, case.v, case.tau, solver=plain, throw=False)
    assert error < 1e-9
    assert error < 0.01 * error_of(case, rough.a, case.right[0])
    assert solution.iterations == rough.iterations + 1


@pytest.mark.long
@pytest.mark.parametrize("label", ["talos contacts", "cassie loops", "g1 contacts"])
def test_machines_need_no_correction(label):
    plain = cp.Proximal(refinements=0)
    for state in states(label):
        solution = cp.solve(all_scenes()[label], *state)
        assert np.array_equal(solution.a, cp.solve(all_scenes()[label], *state, solver=plain).a)


@pytest.mark.parametrize("parameters", [{}, {"max_iterations": 100}, {"refinements": 2}])
@pytest.mark.parametrize("severity", [1e-2, 1e-3, 1e-4])
def test_edges_that_are_near_to_each_other_leave_digits(severity, parameters):
    """Rows too many, and one that nearly is: corrections gain by a small mu, not by none."""
    case = EXTREMES["near_edges"].case(severity, 1)
    solver = cp.Proximal(**parameters)
    solution = cp.solve(case.scene, case.q, case.v, case.tau, solver=solver, throw=False)
    error = min(error_of(case, solution.a, right) for right in right_answers(case))
    lost = 2.0**-52 * case.scene.nominal.delassus_condition
    assert error < 0.1 * lost
    assert 1e-7 < lost < 0.1


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_an_iteration_ends_when_light_joints_are_at_rest_too(seed):
    """1e-9 of the weight, along points that weigh little in G, is 3e-9 of a light joint's a."""
    case = EXTREMES["near_loops"].case(1e-6, seed)
    by_weight = 1e-9 * case.scene.nominal.weight
    error, before = (
        error_of(case, solution.a, right_answers(case)[0])
        for solver in (cp.Proximal(), cp.Proximal(relative_accuracy=by_weight))
        for solution in [cp.solve(case.scene, case.q, case.v, case.tau, solver=solver, throw=False)]
    )
    assert error < 3e-10
    assert error <= before


def test_open_loops_with_rows_that_contradict_each_other_are_solved():
    scene = all_scenes()["cassie loops + contacts"]
    for severity in (1e-4, 1e-3):
        case = EXTREMES["open_loops"].case(severity, 0, scene)
        for precision, fewest, most in ((0.0, 20, 24), (1e-11, 1, 6)):
            robot = replace(case.scene.robot, precision=precision)
            taken = cp.Scene(robot, case.scene.constraints)
            for limit in (20, 100):
                workspace = cp.Workspace(taken, cp.Proximal(max_iterations=limit))
                solution = workspace.solve(case.q, case.v, case.tau, throw=False)
                assert fewest <= solution.iterations <= most
                if not precision:  # every row at its word
                    exact = cp.Workspace(taken, cp.dynamics.Reference())
                    right = exact.solve(case.q, case.v, case.tau, throw=False).a
                    assert error_of(case, solution.a, right) < 2e-9


@pytest.mark.long
def test_few_iterations_that_were_asked_for_stay_few():
    case = EXTREMES["parallelogram"].case(1e-6, 0)
    solver = cp.Proximal(max_iterations=5)
    solution = cp.solve(case.scene, case.q, case.v, case.tau, solver=solver, throw=False)
    assert solution.iterations == 5


@pytest.mark.long
@pytest.mark.parametrize("label", ["talos corners", "cassie loops"])
def test_refinements_and_other_weights_agree(label):
    for state, right in zip(states(label), truth(label), strict=True):
        a = cp.solve(all_scenes()[label], *state, solver=cp.Proximal(refinements=2)).a
        assert takes(cp.Proximal(), all_scenes()[label])
        assert relative(a, right.a) < 1e-10


@pytest.mark.long
@pytest.mark.parametrize("name", ["mass_ratio", "parallelogram", "many_cells"])
def test_no_mu_by_hand_is_three_times_better(name, monkeypatch):
    """Times are not compared here: `benchmarks/solvers.py auto_mu` does."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    import solvers

    severities = EXTREMES[name].severities[1:8:2]
    todo = [Task(name, severity) for severity in severities]
    found = list(solvers.comparisons(todo, timed=False))
    assert len(found) >= len(todo)
    for each in found:
        if not each.task.severity > 1e6:
            assert each.error_is_good, each


@pytest.mark.long
@pytest.mark.parametrize("index", [1, 3])
def test_runs_stay_closed_in_the_memory_that_they_began_with(index, monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    import runs

    run = runs.long_run(list(runs.plans())[index], 2000)
    assert run.is_good, run
    assert run.constraint_velocity < 1e-6


def test_contradictory_rows_are_named_with_the_size_of_their_conflict():
    case = EXTREMES["contradictory"].case(1e-2, 0)
    found = case.scene.rank(case.q)
    assert set(found.conflict) == {"here.x", "there.x"}
    assert found.conflict["there.x"] == pytest.approx(0.5e-2)  # half each
    solution = cp.solve(case.scene, case.q, case.v, case.tau, drift=case.drift, throw=False)
    rest = {"here.x": 2.0, "there.x": -2.0}  # half of beta^2 times the distance
    assert {row: abs(by) for row, by in solution.rest.items()} == pytest.approx(
        {row: abs(by) for row, by in rest.items()}
    )
    assert solution.constraint_error < 1e-9  # of all that can be met
    assert any("here.x, there.x contradict each other by 0.005" in n for n in solution.notices)
    assert not case.scene.rank(EXTREMES["contradictory"].case(0.0, 0).q).weak


@pytest.mark.long
def test_open_loops_that_can_be_closed_contradict_nothing():
    scene = all_scenes()["talos contacts"]
    q, _ = scene.state()
    assert scene.rank(q).conflict == {}
    linkage = all_scenes()["four_bar loops"]
    opened = linkage.state()[0] + np.array([0.1, 0.0, 0.0])
    assert linkage.rank(opened).violation["pin" if "pin" in linkage.names else linkage.names[0]]
    assert linkage.rank(opened).conflict == {}


def test_rows_that_lose_their_grip_are_named():
    case = EXTREMES["parallelogram"].case(1e-6, 0)
    solution = cp.solve(case.scene, case.q, case.v, case.tau)
    weak = case.scene.rank(case.q).weak
    assert weak
    assert EXTREMES["parallelogram"].case(0.1, 0).scene.rank().weak == ()
    if np.abs(solution.lam).max() > 1e3 * case.scene.nominal.weight:
        assert any(", ".join(weak) in notice for notice in solution.notices)
    few = cp.Proximal(max_iterations=2)  # does not converge: the answer says why
    doubtful = cp.solve(case.scene, case.q, case.v, case.tau, solver=few, throw=False)
    assert not doubtful.status.ok
    assert any("nearly singular" in notice and weak[0] in notice for notice in doubtful.notices)


@pytest.mark.long
@pytest.mark.values
@pytest.mark.parametrize("share", [0.5, 0.95, 1.05, 2.0])
@pytest.mark.parametrize("dt", [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1])
def test_steps_of_every_size_on_both_sides_of_the_wall(dt, share):
    """Gains within the wall keep a slow linkage closed, at any step; gains beyond are refused."""
    scene = all_scenes()["four_bar loops"]
    q, v = scene.state()
    v = cp.mechanism.project_velocity(scene, q, 0.01 / max(dt, 1e-3) * 1e-2 * np.ones(3))
    gain = share * 0.828 / dt
    parameters = {
        "duration": 200 * dt,
        "dt": dt,
        "integrator": cp.SemiImplicitEuler(),
        "gravity": False,
    }
    if share > 1:
        with pytest.raises(cp.InvalidArgument, match=r"wall|alpha|beta"):
            cp.simulate(scene, q, v, drift=cp.Baumgarte(gain, gain), **parameters)
        return
    run = cp.simulate(scene, q, v, drift=cp.Baumgarte(gain, gain), **parameters)
    assert run.status.ok
    assert run.violation.max() < 1e-4


@pytest.mark.long
@pytest.mark.values
@pytest.mark.parametrize("away", [1e3, 1e5, 3e5, 1e6, 1e7])
@pytest.mark.parametrize(
    "solver", [cp.dynamics.Reference(), cp.dynamics.NullSpace(), cp.dynamics.GaussPrinciple()]
)
def test_rows_that_are_redundant_at_the_origin_are_so_anywhere(solver, away):
    """In metres of a map: there rounding of J made two of Cassie's twelve rows independent."""
    cassie = robot("cassie")
    scene = cp.Scene(cassie, cassie.loops)
    q, v = scene.state("standing")
    push = [cp.AppliedForce(cassie.loops[0].frame_a, [10.0, 20.0, 30.0])]
    here = cp.solve(scene, q, v, np.zeros(cassie.nv), forces=push)
    q[0] += away
    there = cp.solve(scene, q, v, np.zeros(cassie.nv), forces=push, solver=solver, throw=False)
    assert np.abs(there.lam).max() < 10 * np.abs(here.lam).max()
    size = max(np.abs(here.a).max(), 9.81)
    assert np.abs(there.a - here.a).max() / size < max(3 * there.error_bound, 1e-9)
