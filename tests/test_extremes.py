"""The extremes: families, verdicts, the process that may die, and the table that is committed."""

from __future__ import annotations

import functools
import math
import re
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from shared import SOLVERS, all_scenes, each_row, each_scene, each_solver, relative, states, takes
from typer.testing import CliRunner

import condyn_pin as cp
from condyn_pin._core import tolerances
from condyn_pin.errors import CondynError
from lab.cli import app
from lab.extremes import EXTREMES
from lab.extremes.base import Units, shifts
from lab.extremes.planar_chain import accelerations
from lab.extremes.report import counts, maps, read_csv, short
from lab.extremes.stress import ROBOTS, Memory, answers, methods, mixed, stress, tasks
from lab.extremes.verdicts import (
    Outcome,
    Task,
    Verdict,
    error_of,
    gap_error,
    gap_map,
    judge,
    judge_flight,
    judge_run,
    right_answers,
)

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "benchmarks" / "results"

each_family = pytest.mark.parametrize("name", list(EXTREMES))


def scene_for(family):
    return all_scenes()["four_bar loops"] if family.any_scene else None


@pytest.mark.long
@each_family
def test_family_is_a_dial_that_repeats_itself(name):
    family = EXTREMES[name]
    assert family.title
    assert not family.title.endswith(".")
    dial = family.severities
    assert len(set(map(repr, dial))) == len(dial) > 4, (
        f"{name}: five different severities are needed"
    )
    tame = family.severities[0]
    made = []
    for seed in (5, 5, 6):
        try:
            case = family.case(tame, seed, scene_for(family))
        except CondynError:
            assert name == "loose_quaternion"  # the four-bar has none
            return
        made.append(np.concatenate([case.q, case.v, case.tau]))
    assert np.array_equal(made[0], made[1])
    assert not np.array_equal(made[0], made[2]) or name == "immobile"


@each_family
def test_tame_cases_are_closed_and_have_one_answer(name):
    family = EXTREMES[name]
    solo = all_scenes()["solo12 contacts"]
    scene = solo if name == "loose_quaternion" else scene_for(family)
    case = family.case(family.severities[0], 0, scene)
    if case.drift is None and name != "bad_q":  # one entry of q is zero there
        assert case.scene.check(case.q).ok
    right = right_answers(case)
    assert right, f"{name}: the tamest case has no right answer"
    for other in right[1:]:
        error = relative(other, right[0])
        assert error < 1e-12, (
            f"{name}: at its tamest severity two answers are right that differ by {error:.3g}; "
            "severities begin where the answer is unique"
        )


@pytest.mark.parametrize("n", [1, 2, 7])
def test_decimal_chain_agrees_with_pinocchio(n):
    links, (q, v, tau) = cp.model.chain(n), np.random.default_rng(n).normal(size=(3, n))
    a = cp.solve(cp.Scene(links), q, v, tau, solver=cp.dynamics.Reference()).a
    assert np.abs(accelerations(q, v, tau) - a).max() < 1e-13 * np.abs(a).max()


each_units = pytest.mark.parametrize(
    "units",
    [
        Units(length=2.0**10),
        Units(mass=2.0**-12),
        Units(time=2.0**-10),
        Units(2.0**-9, 2.0**8, 2.0**7),
    ],
    ids=["length", "mass", "time", "all"],
)
each_usual_scene = pytest.mark.parametrize(
    "label", ["four_bar loops", "delta loops", "cassie loops", "talos contacts"]
)


@functools.cache
def in_units(label, units):
    return units.scene(all_scenes()[label])


@each_units
@each_usual_scene
def test_units_change_no_digit_of_the_equations(label, units):
    """Powers of two are exact: springs and damping with them."""
    scene, (q, v, tau) = all_scenes()[label], states(label)[0]
    other, robot = in_units(label, units), scene.robot
    q_, v_, tau_ = units.state(robot.model, q, v, tau)
    one = cp.Workspace(scene).terms(q, v)
    two = cp.Workspace(other).terms(q_, v_)
    along = np.where(shifts(robot.model)[1], units.length, 1.0)
    inertia = units.mass * units.length**2
    assert np.array_equal(two.M, inertia / np.outer(along, along) * one.M)
    torque = units.state(robot.model, q, v, np.ones(robot.nv))[2]
    assert np.array_equal(two.h, torque * one.h)
    assert np.array_equal(tau_, torque * tau)
    passive = other.robot.passive_torque(q_, v_)
    assert np.array_equal(passive, torque * robot.passive_torque(q, v))
    assert passive.any() == bool(robot.springs or np.any(robot.model.damping))
    assert passive.any() or label in ("four_bar loops", "delta loops")


@pytest.mark.pairs
@each_units
@each_usual_scene
@each_solver
def test_units_change_no_answer(solver, label, units):
    """None but the last digits; where a scene chooses parameters anew, none but by that choice."""
    scene = all_scenes()[label]
    if not takes(solver, scene):
        return
    other, model = in_units(label, units), scene.robot.model
    back = Units(1 / units.length, 1 / units.mass, 1 / units.time)
    fixed = with_choices(solver, scene)
    pairs = [(fixed, converted(fixed, units), tolerances.OTHER_UNITS)]
    if fixed != solver:
        pairs.append((solver, solver, tolerances.OTHER_CHOICE))
    # one mu weighs the forces and the moments of a foot: no other one does so in another length
    if isinstance(solver, cp.LCABA) and "talos" in label and units.length != 1:
        pairs.pop(0)
    for one, two, tolerance in pairs:
        here, there = cp.Workspace(scene, one), cp.Workspace(other, two)
        for q, v, tau in states(label)[:2]:
            a = here.solve(q, v, tau, throw=False).a
            a_ = there.solve(*units.state(model, q, v, tau), throw=False).a
            error = np.abs(back.acceleration(model, a_) - a).max()
            assert error <= tolerance * np.abs(a).max(), two


def with_choices(solver, scene):
    """Return a solver with the parameters that it chooses on a scene by the numbers there."""
    enough = scene.nominal.estimator.tolerated_constraint_error / 10
    if isinstance(solver, cp.dynamics.ConjugateGradient | cp.dynamics.MinimumResidual):
        return replace(solver, tolerance=enough)
    if isinstance(solver, cp.LCABA):
        cp.Workspace(scene, solver)
        mu, limit, corrections = scene.nominal.measured[solver]
        return replace(
            solver, mu=mu, max_iterations=limit, refinements=corrections, absolute_accuracy=enough
        )
    return solver


def converted(solver, units):
    """Return a solver with its parameters in other units."""
    acceleration = units.length / units.time**2
    if isinstance(solver, cp.dynamics.Soft):
        (timeconst, dampratio), (d_0, d_width, width, *shape) = solver.solref, solver.solimp
        return replace(
            solver,
            solref=(units.time * timeconst, dampratio),
            solimp=(d_0, d_width, units.length * width, *shape),
        )
    scales = {
        "mu": 1 / units.mass,
        "tolerance": acceleration,
        "absolute_accuracy": acceleration,
        "relative_accuracy": units.mass * acceleration,
    }
    given = {name: getattr(solver, name, None) for name in scales}
    return replace(
        solver, **{name: scales[name] * value for name, value in given.items() if value is not None}
    )


UNITS = Units(2.0**-3, 2.0**5, 2.0**-7)
PLACED = (0.1, 0.2, 0.3, 0.5, 0.5, 0.5, 0.5)
# One example of every kind. Where rows in metres and rows in radians depend on each other, a is a
# compromise that other units change: hand and foot have two freedoms between them, foot and world
# seven, so a kind with both sorts of rows takes the world.
EVERY_KIND = {
    "ball": cp.Loop("hand", "foot"),
    "weld": cp.Loop("foot", "world", "weld"),
    "hinge": cp.Loop("foot", "world", "hinge", axis="z"),
    "slider": cp.Loop("foot", "world", "slider", axis="z"),
    "cylindrical": cp.Loop("foot", "world", "cylindrical", axis="z"),
    "planar": cp.Loop("hand", "foot", "planar", axis="z"),
    "universal": cp.Loop("foot", "world", "universal", axis="zx"),
    "rod": cp.Loop("hand", "foot", "rod", length=0.7),
    "point": cp.PointContact("foot", (0.1, 0.2, 0.3), anchor=(0.3, 0.1, 0.2)),
    "surface": cp.SurfaceContact("foot", 0.1, 0.05, PLACED),
    "line": cp.constraints.LineContact("foot", "y", 0.1, PLACED),
    "plane": cp.constraints.PlanarContact("foot", (0.1, 0.0, 0.2), (1.0, 2.0, 3.0), 0.4),
    "gear": cp.constraints.Coupling("slide", "turn", 0.3, 0.1),
    "rack": cp.constraints.Coupling("turn", "slide", 0.3, 0.1),
    "knife": cp.constraints.KnifeEdge("foot", "y", (0.1, 0.2, 0.3)),
    "wheel": cp.constraints.RollingWheel("foot", 0.3, height=0.2),
    "rolling ball": cp.constraints.RollingBall("foot", 0.3, height=0.2),
    "held": cp.constraints.HeldJoint("slide", 0.3),
    "cable": cp.constraints.TautCable(("hand", "foot", "world"), 4.0, {"turn": 0.2, "slide": -0.3}),
    "over": cp.constraints.RollingBall("hand", 0.3, height=0.2, on="foot"),
}


@functools.cache
def two_limbs() -> cp.Robot:
    """A free body with an arm that turns and a leg that slides; its loops may be wide open."""
    model = pin.Model()
    rng = np.random.default_rng(2)
    joints = [("base", pin.JointModelFreeFlyer(), 0), ("turn", pin.JointModelRX(), 1),
              ("slide", pin.JointModelPY(), 1)]  # fmt: skip
    for name, kind, parent in joints:
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        joint = model.addJoint(parent, kind, place, name)
        body = pin.Inertia(1.0 + rng.random(), rng.normal(size=3), np.diag([1.0, 1.2, 1.5]))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    for name, joint in (("hand", 2), ("foot", 3)):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        model.addFrame(pin.Frame(name, joint, 0, place, pin.FrameType.OP_FRAME))
    return cp.Robot("two limbs", model, precision=0.0)


@pytest.mark.long
def test_every_kind_is_put_into_other_units_below():
    kinds = {k for k in kinds_below(cp.constraints.Constraint) if not k.__abstractmethods__}
    ours = {k for k in kinds if k.__module__.startswith("condyn_pin")}
    ours.remove(cp.constraints.Driven)  # the path is in seconds: it is refused by name
    ours.remove(cp.constraints.OwnRows)  # so are functions
    missing = {kind.__name__ for kind in ours - {type(each) for each in EVERY_KIND.values()}}
    assert not missing, f"EVERY_KIND above needs an example of {missing}"


def kinds_below(kind: type) -> set[type]:
    return {kind}.union(*(kinds_below(each) for each in kind.__subclasses__()))


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_units_reach_every_length_of_a_constraint(kind):
    """Drift control pulls at gaps that offsets, anchors, heights and lengths are part of."""
    scene = cp.Scene(two_limbs(), [EVERY_KIND[kind]])
    model, rng = scene.robot.model, np.random.default_rng(3)
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    v, tau = rng.normal(size=(2, model.nv))
    a = cp.solve(scene, q, v, tau, solver=cp.dynamics.Reference(), drift=cp.Baumgarte(3.0, 5.0)).a
    drift = cp.Baumgarte(3.0 / UNITS.time, 5.0 / UNITS.time)
    other = cp.Workspace(UNITS.scene(scene), cp.dynamics.Reference(), drift=drift)
    a_ = other.solve(*UNITS.state(model, q, v, tau)).a
    error = relative(a_, UNITS.acceleration(model, a))
    assert error < tolerances.OTHER_UNITS, (
        f"{kind}: in other units a differs by {error:.3g}. Either `lengths` of the kind lacks a "
        "field in metres, or rows of the example in EVERY_KIND depend on each other: use the world"
    )


def test_a_field_of_unknown_unit_is_refused():
    @dataclass(frozen=True)
    class Winch(cp.Loop):
        pitch: float = 0.1

    winch = Winch("hand", "foot")
    with pytest.raises(cp.InvalidArgument, match="hand~foot: nothing says what unit its pitch has"):
        UNITS.scene(cp.Scene(two_limbs(), [winch]))


@pytest.mark.long
def test_torques_and_speeds_are_as_large_as_their_dials_say():
    talos = Memory().scene("talos")
    for severity in (0.0, 1.0, 1e4, 1e8):
        assert np.abs(EXTREMES["strong"].case(severity, 1, talos).tau).max() == severity
    for severity in (0.0, 1.0, 1e4):
        assert np.abs(EXTREMES["fast"].case(severity, 1, talos).v).max() == severity


@each_row(
    ("family", "severity"), [("massless_coupler", 0.0), ("massless_tip", 0.0), ("massless_row", 3)]
)
def test_what_nothing_moves_is_refused_by_the_names_of_its_joints(family, severity):
    names = {"massless_coupler": "coupler", "massless_tip": "joint4", "massless_row": "joint1"}
    with pytest.raises(cp.errors.InvalidModel, match=f"{names[family]}.*M is singular"):
        EXTREMES[family].case(severity)


@pytest.mark.long
@pytest.mark.parametrize(
    "solver", [cp.Proximal(), cp.dynamics.NullSpace(), cp.dynamics.ConjugateGradient()]
)
@pytest.mark.parametrize(("family", "severity"), [("massless_row", 2), ("massless_tip", 1e-12),
                                                  ("massless_coupler", 1e-6)])  # fmt: skip
def test_bodies_without_mass_are_right_where_others_hold_them(solver, family, severity):
    case = EXTREMES[family].case(severity, 1)
    solution = cp.solve(case.scene, case.q, case.v, case.tau, solver=solver)
    assert error_of(case, solution.a, right_answers(case)[0]) < 1e-9


@pytest.mark.values
@pytest.mark.parametrize("solver", [kind() for kind in SOLVERS.values() if kind.takes_every_kind])
@pytest.mark.parametrize("severity", [0.0, 1e-17, 1e-14, 1e-9, 1e-3, 1.0])
def test_a_row_that_is_only_rounding_is_no_row(solver, severity):
    """A rod from a tip to its own pivot took a force of 1e17 N, and nothing said so."""
    case = EXTREMES["empty_row"].case(severity, 0)
    solution = cp.solve(case.scene, case.q, case.v, case.tau, solver=solver, throw=False)
    if solution.status.ok:
        assert min(relative(solution.a, right) for right in case.right) < 1e-8
        assert np.abs(solution.lam).max() < 1e17
    elif severity >= 1e-3 and solver.exact:
        pytest.fail(f"{solver} is right at {severity} and does not say so")


@pytest.mark.long
@pytest.mark.values
@pytest.mark.parametrize("mu", [1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("seed", range(6))
def test_a_force_along_a_row_that_does_not_count_is_an_error(mu, seed):
    """Rows of a stretched leg contradict each other, and lam grows from iteration to iteration."""
    case = EXTREMES["straight_knee"].case(1e-12, seed)
    solution = cp.solve(case.scene, case.q, case.v, case.tau, solver=cp.Proximal(mu), throw=False)
    error = min(error_of(case, solution.a, right) for right in right_answers(case))
    assert error <= 1.01 * solution.error_bound + 1e-12
    assert not solution.status.ok or error <= 1e-8


@pytest.mark.long
@pytest.mark.parametrize(
    "solver", [cp.Proximal(), cp.dynamics.NullSpace(), cp.dynamics.Reference()]
)
@pytest.mark.parametrize("robot", ["delta", "talos"])
def test_a_loose_quaternion_is_seen_in_the_bound(solver, robot):
    """Residuals with its rotation agree with an answer that is off by hundreds of times as much."""
    memory = Memory()
    for seed in range(4):
        case = EXTREMES["loose_quaternion"].case(9e-7, seed, memory.scene(robot))
        solution = cp.solve(case.scene, case.q, case.v, case.tau, solver=solver, throw=False)
        error = error_of(case, solution.a, case.right[0])
        assert error <= 1.01 * solution.error_bound
        assert not solution.status.ok or error <= 1e-8


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("severity", [1e6, 1e-6])
def test_mass_ratio_of_a_million_is_right_and_said_to_be(severity, seed):
    case = EXTREMES["mass_ratio"].case(severity, seed)
    solution = cp.solve(case.scene, case.q, case.v, case.tau)
    assert error_of(case, solution.a, right_answers(case)[0]) < solution.error_bound < 1e-9


@pytest.mark.parametrize("severity", EXTREMES["wall"].severities)
def test_gaps_close_as_their_map_says_and_stronger_gains_are_refused_with_the_limit(severity):
    case = EXTREMES["wall"].case(severity, 0, scene_for(EXTREMES["wall"]))
    if severity > 0.8284:
        with pytest.raises(cp.InvalidArgument, match=r"alpha dt < 0\.828"):
            judge_run(case, case.motion, cp.Proximal())
        return
    verdict, error, _ = judge_run(case, case.motion, cp.Proximal())
    assert verdict is Verdict.OK
    assert error < 1e-6


@pytest.mark.long
def test_a_run_that_does_not_follow_the_map_is_no_right_one():
    """Half the gains are another motion, and gains that nobody refuses make gaps grow."""
    case = EXTREMES["wall"].case(0.5, 0, scene_for(EXTREMES["wall"]))
    run = cp.simulate(
        case.scene, case.q, case.v, duration=50 * case.motion.dt, dt=case.motion.dt,
        integrator=cp.SemiImplicitEuler(), drift=case.drift, gravity=False,
    )  # fmt: skip
    half = cp.Baumgarte(case.drift.alpha / 2, case.drift.beta / 2)
    assert gap_error(run, gap_map(case.drift, case.motion.dt)) < 1e-6
    assert gap_error(run, gap_map(half, case.motion.dt)) > 0.1
    for product, grows in ((0.828, False), (0.829, True)):
        values = np.linalg.eigvals(gap_map(cp.Baumgarte(product, product), 1.0))
        assert (np.abs(values).max() > 1.0) == grows


@pytest.mark.long
def test_what_takes_gigabytes_is_left_out_where_time_is_limited():
    light = {repr(task) for task in tasks(heavy=False)}  # a severity of nan equals no other
    heavy = {(t.family, t.severity) for t in tasks() if repr(t) not in light}
    assert heavy == {("straight_chain", 400.0), ("bent_chain", 400.0)}


@pytest.mark.long
@each_scene
def test_usual_scenes_are_judged_without_a_second_look(label):
    """The careful proof takes a factorisation: no robot pays for it at every solve."""
    assert all_scenes()[label].nominal.estimator.negligible_constraint_error > 0.0


@pytest.mark.long
@pytest.mark.parametrize("label", ["four_bar loops", "talos contacts"])
def test_reference_scales_what_would_overflow(label):
    scene, (q, v, tau) = all_scenes()[label], states(label)[0]
    huge = cp.solve(scene, q, v, 2.0**1000 * tau, solver=cp.dynamics.Reference(), throw=False)
    small = cp.solve(scene, q, 0 * v, tau, solver=cp.dynamics.Reference(), throw=False)
    weight = cp.solve(scene, q, 0 * v, 0 * tau, solver=cp.dynamics.Reference(), throw=False)
    wanted = small.a - weight.a  # beside 2^1000, gravity and v are nothing
    assert np.abs(huge.a * 2.0**-1000 - wanted).max() < 1e-11 * np.abs(wanted).max()


@pytest.mark.long
def test_singular_and_overflowing_comes_without_a_warning():
    """Warnings are errors here."""
    scene, (q, _, tau) = all_scenes()["four_bar loops"], states("four_bar loops")[0]
    solution = cp.solve(scene, q, 1e200 * np.ones(3), tau, solver=cp.DenseKKT(), throw=False)
    assert solution.status is cp.Status.SINGULAR


@pytest.mark.long
def test_broken_solvers_are_found_and_do_not_stop_the_run():
    """They are known to the other process alone."""
    todo = [Task("strong", 1.0, 0, "four_bar"), Task("strong", 0.0, 0, "four_bar")]
    wanted = {
        "lying": Verdict.WRONG,
        "raising": Verdict.CRASHED,
        "reference": Verdict.OK,
        "dying": Verdict.CRASHED,
        "proximal": Verdict.OK,
    }
    found = stress(todo[:1], list(wanted), imports=["broken_solvers"])
    assert {outcome.method: outcome.verdict for outcome in found} == wanted
    assert "exit code -11" in next(o.said for o in found if o.method == "dying")
    assert "RuntimeError: lost" in next(o.said for o in found if o.method == "raising")
    found = stress(todo, ["hanging"], patience=0.5, imports=["broken_solvers"])
    assert [(outcome.task, outcome.verdict) for outcome in found] == [
        (task, Verdict.HUNG) for task in todo
    ]


@pytest.mark.long
@pytest.mark.once  # tables, words and processes
def test_a_script_without_a_guard_is_told_so(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        f"import sys\nsys.path.append({str(ROOT / 'benchmarks')!r})\n"
        "from lab.extremes.stress import stress, tasks\nstress(tasks(['strong'])[:1])\n"
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("condyn_pin.errors.WorkersLost")
    assert 'if __name__ == "__main__":' in last


@pytest.mark.long
@pytest.mark.once  # tables, words and processes
def test_a_module_that_cannot_be_imported_is_no_fault_of_a_method():
    todo = [Task("strong", 1.0, 0, "four_bar")]
    with pytest.raises(cp.errors.WorkersLost, match="exit code 1 before its first one") as caught:
        stress(todo, ["reference"], imports=["nowhere_to_be_found"])
    assert caught.value.done == []


@pytest.mark.long
def test_time_is_kept_and_every_family_comes_early():
    todo = mixed(tasks())
    assert sorted(map(repr, todo)) == sorted(map(repr, tasks()))
    assert len({task.family for task in todo[:300]}) > 0.8 * len(EXTREMES)
    assert stress(todo, ["reference"], seconds=0.0) == []


@pytest.mark.long
def test_unknown_names_are_refused():
    with pytest.raises(cp.errors.UnknownName, match="parallelogram"):
        tasks(["paralelogram"])
    with pytest.raises(cp.errors.UnknownName, match="proximal"):
        methods(["proximl"])


@pytest.mark.long
@pytest.mark.once  # tables, words and processes
def test_committed_table_has_every_case_and_no_defect():
    rows = read_csv(RESULTS / "stress_solvers.csv")
    versions = {row["pinocchio"] for row in rows}
    assert {version[0] for version in versions} == {"3", "4"}
    wanted = {(t.family, t.robot, repr(t.severity)) for t in tasks()}
    for version in versions:
        own = [row for row in rows if row["pinocchio"] == version]
        assert {(row["family"], row["robot"], row["severity"]) for row in own} == wanted
    for row in rows:
        for cell in list(row.values())[4:]:
            assert not any(v.defect and v.name.lower() in cell for v in Verdict), row


@pytest.mark.parametrize(
    "name", ["parallelogram", "mass_ratio", "immobile", "short_rod", "bad_tau"]
)
def test_verdicts_are_the_expected_ones(name):
    expected: dict[tuple[str, str], str] = {}
    for row in read_csv(RESULTS / "stress_solvers.csv"):
        if row["family"] == name and row["robot"] in ("", "four_bar"):
            for method, cell in row.items():
                key = row["severity"], method
                expected[key] = f"{expected.get(key, '')}/{cell.split(' ')[0]}"
    memory = Memory()
    robot = "four_bar" if EXTREMES[name].any_scene else ""
    for severity in EXTREMES[name].severities:
        # what is compiled has no column in a table that was made without it
        asked = [method for method in methods() if (repr(severity), method) in expected]
        for answer in answers(Task(name, severity, 0, robot), asked, memory):
            if not isinstance(answer, str):
                # another processor's rounding may let a method answer what it refused, and rightly
                wanted = *expected[repr(severity), answer.method].split("/"), "ok"
                assert answer.verdict.name.lower() in wanted, answer


def test_a_flight_is_judged_by_its_end():
    case = EXTREMES["fast_spins"].case(1.0, 0)
    flight = case.flight
    assert judge_flight(case, flight, cp.Proximal())[0] is Verdict.OK
    elsewhere = pin.integrate(case.scene.robot.model, flight.end, np.array([0, 0, 0, 1e-5, 0, 0]))
    missed = replace(flight, end=elsewhere)
    verdict, error, said = judge_flight(case, missed, cp.Proximal())
    assert (verdict, said) == (Verdict.WRONG, "finished")
    assert abs(error - 1e-5) < 1e-8
    hopeless = EXTREMES["fast_spins"].case(1e9, 0)
    assert judge_flight(hopeless, hopeless.flight, cp.Proximal())[0] is Verdict.SAID_SO


def test_wide_masses_are_known_to_fifty_digits():
    """Up to six decades every method that takes redundant rows is right."""
    for seed in range(5):
        case = EXTREMES["wide_masses"].case(6.0, seed)
        assert case.scene.nominal.rank == 3
        assert case.scene.rows == 16
        for solver in (
            cp.dynamics.Reference(),
            cp.dynamics.NullSpace(),
            cp.dynamics.GaussPrinciple(),
        ):
            assert judge(case, solver, case.right)[0] is Verdict.OK


@pytest.mark.long
@pytest.mark.once  # tables, words and processes
def test_maps_count_and_advise():
    memory = Memory()
    outcomes = [
        answer
        for severity in EXTREMES["parallelogram"].severities
        for answer in answers(Task("parallelogram", severity), ["proximal", "reference"], memory)
        if not isinstance(answer, str)
    ]
    (found,) = maps(outcomes)
    right = r"right to \de-1\d at 1 \.\.\. 1e-[78], 1e-1\d \.\.\. 0"
    said = r"(1e-9, 1e-10|1e-8 \.\.\. 1e-10)"  # below 2e-8 no residual tells
    assert re.fullmatch(f"reference: {right}; says inaccurate at {said}", found.advice("reference"))
    assert re.fullmatch(
        rf"proximal: {right}; says inaccurate at 1e-8, 1e-9", found.advice("proximal")
    )
    assert sum(counts(outcomes).values()) == len(outcomes) == 2 * len(found.severities)
    assert maps(outcomes[::-1])[0].severities == EXTREMES["parallelogram"].severities


@pytest.mark.long
def test_advice_lists_the_runs_of_a_dial():
    """A span from end to end hides what is between."""
    dial = (1.0, 0.1, 1e-4, 1e-8, 0.0, math.nan)
    ok, said = Verdict.OK, Verdict.SAID_SO

    def advice(*verdicts):
        outcomes = [
            Outcome(Task("a", s), "m", verdict, 2e-9, "")
            for s, verdict in zip(dial, verdicts, strict=True)
        ]
        return maps(outcomes)[0].advice("m")

    assert advice(*6 * [ok]) == "m: right to 2e-9 at every severity"
    assert advice(*6 * [said]) == "m: says inaccurate at every severity"
    assert advice(ok, ok, ok, said, ok, said) == (
        "m: right to 2e-9 at 1 ... 1e-4, 0; says inaccurate at 1e-8, nan"
    )
    assert advice(ok, said, said, said, Verdict.WRONG, Verdict.REFUSED) == (
        "m: right to 2e-9 at 1; says inaccurate at 0.1 ... 1e-8; refused at nan; WRONG at 0"
    )


@pytest.mark.long
@each_row(
    ("number", "text"),
    [(0.0, "0"), (1e-4, "1e-4"), (0.01, "0.01"), (12.0, "12"), (1e4, "1e4"), (0.828, "0.828"),
     (5e-324, "5e-324"), (-1.0, "-1"), (math.inf, "inf"), (math.nan, "nan")],
)  # fmt: skip
def test_severities_are_written_shortly(number, text):
    assert short(number) == text


@pytest.mark.long
@pytest.mark.once  # tables, words and processes
def test_command_prints_advice_and_counts_and_draws(tmp_path):
    plot, table = tmp_path / "s.png", tmp_path / "s.csv"
    line = [
        "stress",
        "four_bar",
        "--solver",
        "proximal,reference",
        "--families",
        "few_iterations",
    ]
    result = CliRunner().invoke(app, [*line, "--plot", str(plot), "--csv", str(table)])
    assert result.exit_code == 0, result.output
    assert re.search(r"reference: right (to \S+ )?at every severity", result.output)
    assert f"20 cases on Pinocchio {pin.__version__}" in result.output
    assert plot.stat().st_size > 5000
    assert len(read_csv(table)) == len(EXTREMES["few_iterations"].severities)


@pytest.mark.long
def test_a_robot_that_does_not_exist_is_no_refusal():
    line = ["stress", "nope", "--solver", "proximal", "--families", "few_iterations"]
    result = CliRunner().invoke(app, line)
    assert isinstance(result.exception, cp.errors.UnknownName)
    assert "no robot named 'nope'" in str(result.exception)


@pytest.mark.long
def test_severities_are_numbers_that_can_be_written():
    for family in EXTREMES.values():
        for severity in family.severities:
            again = float(repr(severity))
            assert again == severity or (math.isnan(again) and math.isnan(severity))
    assert set(ROBOTS) <= set(cp.io.available_robots())
