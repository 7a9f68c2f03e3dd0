"""The study: what a row says, what is never hidden, and that a run can stop and go on."""

from __future__ import annotations

import json
import math
import os
import sys
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from dataclasses import dataclass, fields
from multiprocessing import get_context
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from lost import KillsOnce
from shared import HAS_LCABA, all_scenes, each_row, relative

import condyn_pin as cp
import lab
from condyn_pin._core.arguments import ITERATIONS, WEIGHTS
from condyn_pin.study import case
from condyn_pin.study import study as running
from condyn_pin.study.study import default_sweep
from condyn_pin.study.tables import ALONE

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

BAR = all_scenes()["four_bar loops"]
BRIEF = cp.study.TimingEffort(rounds=4, repeats=1)
FEW = (
    cp.Proximal(),
    cp.DenseKKT(),
    *cp.study.sweep(cp.Proximal(max_iterations=1), mu=[1e-8, 1e-2]),
)


def brief(scenes=BAR, solvers=FEW, **options) -> cp.Study:
    return cp.Study(scenes, solvers, **{"states": 3, "effort": BRIEF} | options)


@pytest.fixture(scope="module")
def table() -> cp.study.Table:
    return brief().run()


def errors(table: cp.study.Table) -> list[tuple]:
    """Everything of a table but its times."""
    times = ("build_us", "median_us", "p95_us", "bare_us", "solve_us", "timed")
    names = [field.name for field in fields(cp.study.Row) if field.name not in times]
    return [tuple(getattr(row, name) for name in names) for row in table.rows]


# Motions that are short, and in which only the solver makes an error.
MEASURES = {
    name: name for name, kind in cp.study.MEASURES.items() if kind.asks is cp.dynamics.Solver
} | {
    "trajectory": cp.study.TrajectoryMeasure(
        duration=2e-3,
        dt=1e-3,
        integrator=cp.simulation.DormandPrince(1e-12, 1e-13),
        drift=cp.simulation.NoDrift(),
    )
}


# --- solvers that are wrong on purpose; nothing else gets to see them ---


@dataclass(frozen=True)
class WrongEverySecondTime(cp.Proximal):
    """As Pinocchio's lcaba is, if its state is not cured."""

    title: ClassVar[str] = "Wrong every second time"
    every: int = 2

    def start(self, workspace):
        method, calls = super().start(workspace), [0]

        def acceleration(q, v, tau):
            calls[0] += 1
            wrong = calls[0] % self.every == 1 % self.every
            return (1.0 + 1e-3 * wrong) * method.acceleration(q, v, tau)

        return cp.dynamics.BoundSolver(acceleration, method.lam, method.iterations)


@dataclass(frozen=True)
class Raises(cp.Proximal):
    title: ClassVar[str] = "Raises"

    def start(self, workspace):
        raise ZeroDivisionError("a bug")


@dataclass(frozen=True)
class KillsItsProcess(cp.Proximal):
    title: ClassVar[str] = "Kills its process"

    parent: int = 0

    def start(self, workspace):
        if os.getpid() != self.parent:
            os._exit(1)
        return super().start(workspace)


for kind in (WrongEverySecondTime, Raises, KillsItsProcess):
    del cp.dynamics.SOLVERS[kind.__name__.lower()]


# --- rows ---


@pytest.mark.long
def test_rows_say_what_was_measured(table):
    assert [row.solver for row in table.rows] == [repr(solver) for solver in FEW]
    good, dense, _, coarse = table.rows
    assert (good.scene, good.rows, good.nv) == ("four_bar, 3 rows", BAR.rows, BAR.robot.nv)
    assert (good.measure, good.n) == ("acceleration", 3)
    assert good.states == "3 sampled under all loads, seed 0"
    assert good.parameters["max_iterations"] == 20
    assert good.ok
    assert good.error_median <= good.error_worst < 1e-12
    assert good.iterations > 1
    assert coarse.statuses == {"inaccurate": 3}
    assert coarse.error_worst > 1e-3
    assert coarse.constraint_error > 1e3 * good.constraint_error
    assert dense.statuses == {"singular": 3}
    assert dense.error_worst == math.inf
    assert 0 < table.floors["four_bar, 3 rows"] < 1e-12
    assert table.machine["pinocchio"]


@pytest.mark.long
def test_times_stand_beside_errors_and_say_how_they_were_taken(table):
    good, dense, _, coarse = table.rows
    for row in (good, coarse):
        assert row.timed == ALONE or row.timed.startswith("timed on a shared core: had it ")
        assert row.build_us > 0
        assert row.p95_us >= row.median_us > 0
    assert min(good.solve_us, good.bare_us) > 0
    assert coarse.solve_us is None  # a doubtful answer is looked at twice
    assert dense.median_us is None
    assert dense.timed == "not timed: no finite answer at every state (3 singular)"
    assert {row.timed for row in brief().run(timed=False).rows} == {"not timed"}


@pytest.mark.long
def test_json_keeps_every_field_and_has_no_infinity(table):
    for row in table.rows:
        text = json.dumps(row.as_dict(), allow_nan=False)
        assert cp.study.Row.from_dict(json.loads(text)) == row


@each_row("wrong", [
        {"error_worst": "small"}, {"error_worst": math.nan}, {"error_median": -1.0},
        {"median_us": "12"}, {"median_us": -1.0}, {"p95_us": math.nan}, {"statuses": ["ok"]},
        {"n": "3"}, {"scene": None}, {"how": 1}, {"nonsense": 1},
    ])  # fmt: skip
def test_what_is_no_row_is_refused_by_its_field(table, wrong):
    row = table.rows[0].as_dict()
    for saved, said in ((row | wrong, *wrong), (wrong, "missing, or not a field of a Row")):
        with pytest.raises(cp.InvalidArgument, match=said):
            cp.study.Row.from_dict(saved)


# --- what is never hidden ---


def test_a_solver_that_does_not_take_a_scene_is_in_the_table_with_the_reason():
    hinge = all_scenes()["four_bar hinge"]
    taken, refused = brief(hinge, [cp.Proximal(), cp.dynamics.SparseKKT()]).run().rows
    assert taken.ok
    assert refused.statuses == {"refused": 3}
    assert refused.error_worst == math.inf
    assert "SparseKKT takes" in refused.note
    assert refused.median_us is None
    (soft,) = brief(solvers=[cp.dynamics.Soft()], measure="derivatives").run().rows
    assert soft.statuses == {"refused": 3}
    assert "Soft solves other equations" in soft.note


@pytest.mark.long
@pytest.mark.parametrize(
    ("solver", "status"),
    [
        (WrongEverySecondTime(every=1), "inaccurate"),  # its own residuals tell
        (WrongEverySecondTime(), "wrong"),  # ok, and off beside Reference
        (Raises(), "raised"),
    ],
)
def test_a_broken_solver_is_reported_broken_and_ends_no_study(solver, status):
    moving = cp.study.SampledStates(3, loads="random")  # at rest a thousandth of nothing is right
    broken, good = brief(solvers=[solver, cp.Proximal()], states=moving).run().rows
    assert broken.statuses == {status: 3}
    assert not broken.ok
    assert broken.error_worst > 1e-4
    assert good.ok
    assert "ZeroDivisionError: a bug" in broken.note or status != "raised"


# --- the same again, elsewhere, later ---


class Here(Executor):
    """Runs a task when it is submitted."""

    def submit(self, call, /, *args, **kwargs):
        future = Future()
        future.set_result(call(*args, **kwargs))
        return future


def test_the_same_study_gives_the_same_errors_to_the_bit(table):
    study = brief({"a": BAR, "b": all_scenes()["talos contacts"]}, measure=list(MEASURES.values()))
    first = errors(study.run(timed=False))
    assert len(first) == 2 * len(MEASURES) * len(FEW)
    assert errors(study.run(timed=False)) == first
    with ProcessPoolExecutor(2, get_context("spawn")) as executor:
        assert errors(study.run(timed=False, executor=executor)) == first
    here = brief().run(executor=Here())
    assert errors(here) == errors(table)
    assert here.rows[0].median_us > 0  # times are taken here also with an executor


@pytest.mark.long
@pytest.mark.parametrize(("count", "known"), [(1, 0), (3, 1), (8, 4)])
def test_ctrl_c_keeps_what_was_measured_and_the_study_goes_on(
    tmp_path, count, known, monkeypatch, table
):
    path, steps, measured = tmp_path / "rows.jsonl", iter(range(1, count + 1)), []

    def progress(what: str, done: int, total: int) -> None:
        if next(steps) == count:
            raise KeyboardInterrupt

    with pytest.raises(cp.errors.Interrupted) as stopped:
        brief().run(progress=progress, results=path)
    assert len(stopped.value.table.rows) == known
    plain = running.measure_errors
    monkeypatch.setattr(
        running, "measure_errors", lambda of, solver: measured.append(solver) or plain(of, solver)
    )
    again = brief().run(results=path)
    assert measured == list(FEW[known:])
    assert errors(again) == errors(table)
    assert again.rows[0].median_us > 0


@pytest.mark.long
def test_what_is_in_the_file_is_not_measured_again(tmp_path, monkeypatch):
    path = tmp_path / "rows.jsonl"
    table = brief().run(results=path)
    for name in ("measure_errors", "measure_times"):
        monkeypatch.setattr(running, name, lambda *_: pytest.fail("measured again"))
    assert brief().run(results=path).rows == table.rows
    assert brief(solvers=FEW[:2]).run(results=path).rows == table.rows[:2]


def test_times_of_a_shared_core_are_taken_again_when_asked(tmp_path, monkeypatch):
    path, now = tmp_path / "rows.jsonl", 0.0

    def passing() -> float:
        nonlocal now
        now += 1.0  # [s] that pass whenever somebody looks
        return now

    def timed_by(share: float, **effort) -> cp.study.Table:
        monkeypatch.setattr(case, "perf_counter", passing)
        monkeypatch.setattr(case, "process_time", lambda: share * now)
        return brief(effort=cp.study.TimingEffort(rounds=4, repeats=1, **effort)).run(results=path)

    shared = timed_by(0.5)
    assert {row.timed for row in shared.rows if row.median_us} == {
        "timed on a shared core: had it 50% of the time"
    }
    assert timed_by(1.0).rows == shared.rows
    alone = timed_by(1.0, alone=True)
    assert {row.timed for row in alone.rows if row.median_us} == {ALONE}
    assert errors(alone) == errors(shared)
    assert timed_by(0.5, alone=True).rows == alone.rows


def test_other_states_another_machine_and_a_cut_line_are_measured_anew(tmp_path, monkeypatch):
    path, other = tmp_path / "rows.jsonl", cp.study.SampledStates(3, seed=1)
    table = brief().run(results=path, timed=False)
    fresh = brief(states=other).run(timed=False)
    assert (
        errors(brief(states=other).run(results=path, timed=False)) == errors(fresh) != errors(table)
    )
    path.write_bytes(path.read_bytes()[:-40])
    assert brief(states=other).run(results=path, timed=False).rows == fresh.rows
    assert len([json.loads(line) for line in path.read_text().splitlines()]) == 2 * len(FEW)
    monkeypatch.setattr(case, "machine", lambda: {"processor": "another"})
    brief().run(results=path, timed=False)
    assert len(path.read_text().splitlines()) == 3 * len(FEW)


@each_row("text", ["notes of mine", "notes\nof mine\n", '{"row": {}}\n'])
def test_a_file_of_something_else_is_refused_and_left_alone(tmp_path, text):
    path = tmp_path / "notes.txt"
    path.write_text(text)
    with pytest.raises(cp.InvalidArgument, match=r"notes\.txt', line 1: not a row"):
        brief().run(results=path)
    assert path.read_text() == text
    with pytest.raises(cp.InvalidArgument, match=r"results = .*: No such file or directory"):
        brief().run(results=tmp_path / "nowhere" / "rows.jsonl")


def test_a_killed_worker_loses_nothing(tmp_path):
    path = tmp_path / "rows.jsonl"
    weights = [10.0**-k for k in range(1, 9)]
    solvers = [*cp.study.sweep(cp.Proximal(), mu=weights), KillsItsProcess(parent=os.getpid())]
    study = brief(solvers=solvers)
    pool = ProcessPoolExecutor(1, get_context("spawn"))
    with pool, pytest.raises(cp.errors.WorkersLost, match="results=PATH") as lost:
        study.run(timed=False, executor=pool, results=path)
    assert len(lost.value.done.rows) == len(weights)
    # here, where it does not kill, only what is missing is measured
    assert len(study.run(timed=False, results=path).rows) == len(solvers)
    assert len(path.read_text().splitlines()) == len(solvers)


def test_a_worker_that_is_replaced_does_not_even_stop_the_study(tmp_path):
    mark = tmp_path / "mark"
    study = brief(solvers=[*FEW, KillsOnce(mark=str(mark))])
    with cp.Processes(1) as executor:
        table = study.run(timed=False, executor=executor)
    assert mark.exists()
    assert table.rows == study.run(timed=False).rows


@pytest.mark.long
def test_progress_ends_where_it_said():
    seen: list[tuple[str, int, int]] = []
    brief().run(progress=lambda *step: seen.append(step))
    assert {total for _, _, total in seen} == {1 + 2 * len(FEW)}
    assert [done for _, done, _ in seen] == sorted(done for _, done, _ in seen)
    assert seen[-1][1] == seen[-1][2]


# --- states ---


@pytest.mark.long
@pytest.mark.parametrize(
    "states",
    [cp.study.SampledStates(2), cp.study.NominalStates(), cp.study.PostureStates()],
    ids=repr,
)
@pytest.mark.parametrize("label", ["cassie loops + contacts", "four_bar loops"])
def test_states_are_closed_consistent_and_the_same_every_time(label, states):
    scene = all_scenes()[label]
    once, again = states.of(scene), states.of(scene)
    assert once
    for one, other in zip(once, again, strict=True):
        scene.check(one[0], one[1]).raise_if_open()
        assert all(np.array_equal(x, y) for x, y in zip(one, other, strict=True))


Q, V = BAR.state()


@each_row(
    ("label", "states", "error", "said"),
    [
        ("open", [(Q + 0.1, V, V)], cp.errors.NotAssembled, "open"),
        ("short", [(Q, V, V[:2])], cp.InvalidArgument, "tau"),
        ("two", [(Q, V)], cp.InvalidArgument, r"'two'.* is no \(q, v, tau\)"),
        ("none", [], cp.InvalidArgument, "at least one"),
    ],
)
def test_given_states_have_to_be_closed(label, states, error, said):
    given = cp.study.GivenStates("mine", [(Q, V, np.ones(3))])
    assert brief(states=given).run(timed=False).rows[0].states == "mine"
    with pytest.raises(error, match=said):
        brief(states=cp.study.GivenStates(label, states)).run(timed=False)


# --- scenes and parameters ---


@pytest.mark.long
def test_names_of_robots_and_hierarchies_stand_for_their_scenes():
    table = cp.Study(["four_bar", "pendulum"], [cp.Proximal()], states=1).run(timed=False)
    assert [row.scene for row in table.rows] == ["four_bar loops", "pendulum free"]
    models = lab.HIERARCHIES["talos"].scenes()
    table = cp.Study(models, [cp.Proximal()], states=1).run(timed=False)
    assert [row.scene for row in table.rows] == list(models)
    assert all(row.ok for row in table.rows)


@pytest.mark.parametrize(
    ("label", "more"),
    [
        ("talos contacts", {"corners for surfaces"}),
        ("talos on edges and planes", {"ends for edges"}),
        ("four_bar hinge", {"two points for hinges"}),
        ("talos foot to foot, welded", {"corners for surfaces", "three points for welds"}),
    ],
)
def test_other_constraints_that_hold_the_same(label, more):
    scene = all_scenes()[label]
    made = cp.study.modellings(scene)
    assert set(made) == {"as it is", *more}
    q, v = scene.sample(np.random.default_rng(0))
    answers = [
        cp.solve(other, q, v, 0 * v, solver=cp.dynamics.Reference(), throw=False).a
        for other in made.values()
    ]
    for a in answers:
        assert relative(a, answers[0]) < 1e-9
    assert len(cp.Study(made, [cp.Proximal()], states=1).run(timed=False).rows) == len(made)


@pytest.mark.long
def test_sweep_is_the_product_of_its_parameters():
    solvers = cp.study.sweep(
        cp.Proximal(relative_accuracy=0.0), mu=[1e-8, 1e-4], max_iterations=[1, 20]
    )
    assert [(s.mu, s.max_iterations) for s in solvers] == [
        (1e-8, 1), (1e-8, 20), (1e-4, 1), (1e-4, 20)
    ]  # fmt: skip
    assert {s.relative_accuracy for s in solvers} == {0.0}


def test_default_sweep_turns_the_parameters_of_every_solver():
    solvers = default_sweep(BAR)
    assert len(set(solvers)) == len(solvers)
    assert {type(solver) for solver in solvers} == {*cp.dynamics.SOLVERS.values()} - {
        cp.dynamics.Reference
    }
    for kind in [cp.Proximal, cp.LCABA] if HAS_LCABA else [cp.Proximal]:
        mine = [solver for solver in solvers if isinstance(solver, kind)]
        assert {*WEIGHTS, None} == {solver.mu for solver in mine}
        assert {*ITERATIONS} <= {solver.max_iterations for solver in mine}
    assert (WEIGHTS[0], WEIGHTS[-1]) == (1e-12, 1.0)


NONSENSE = {
    cp.errors.UnknownName: [{"scenes": "nobody"}, {"measure": "speed"}, {"measure": [3]}],
    cp.InvalidArgument: [
        *({"scenes": scenes} for scenes in ([], None, [3], {"x": 3}, [BAR, BAR])),
        *({"solvers": solvers} for solvers in ([], ["Proximal"])),
        *({"states": states} for states in (0, 1.5, True)),
        {"measure": []}, {"accuracy": 1e-20}, {"effort": cp.study.TimingEffort},
    ],
}  # fmt: skip


@each_row(
    ("error", "options"), [(error, one) for error, several in NONSENSE.items() for one in several]
)
def test_a_study_of_nonsense_is_refused(error, options):
    with pytest.raises(error):
        brief(**options)


@each_row(
    ("call", "said"),
    [
        (lambda: cp.study.TimingEffort(rounds=0), "whole number"),
        (lambda: cp.study.TimingEffort(repeats=0), "whole number"),
        (lambda: cp.study.TimingEffort(rounds=1.5), "whole number"),
        (lambda: cp.study.sweep(cp.Proximal(), muu=[1.0]), "muu"),
        (lambda: cp.study.sweep(cp.Proximal(), mu=1.0), "a list of values"),
        (lambda: cp.study.sweep(cp.Proximal(), mu=[-1.0]), "mu"),
        (lambda: cp.study.sweep("Proximal"), "a solver such as"),
    ],
)
def test_efforts_and_sweeps_of_nonsense_are_refused(call, said):
    with pytest.raises(cp.CondynError, match=said):
        call()


# --- measures ---


@pytest.mark.values
@pytest.mark.parametrize("label", ["four_bar loops", "talos contacts", "cassie on lines"])
@pytest.mark.parametrize("measure", MEASURES.values(), ids=MEASURES)
def test_every_measure_finds_the_default_solver_right_and_a_coarse_one_not(label, measure):
    scene = all_scenes()[label]
    solvers = [cp.Proximal(), cp.Proximal(mu=1.0, max_iterations=1), cp.dynamics.NullSpace()]
    good, coarse, other = brief(scene, solvers, measure=measure, states=2).run(timed=False).rows
    assert good.ok
    assert good.error_worst < 1e-9
    assert other.error_worst < 1e-9
    assert coarse.error_worst > 1e-3


def test_a_parameter_of_a_measure_is_in_its_label():
    table = brief(solvers=[cp.Proximal()], measure=cp.study.DerivativeMeasure("pinocchio")).run()
    assert table.rows[0].measure == "derivatives(method='pinocchio')"
    assert table.rows[0].error_worst < 1e-9


# --- curves that are known ---


@pytest.mark.long
def test_the_error_of_one_iteration_goes_with_mu():
    from study import one_iteration

    mus = [10.0**-k for k in range(2, 11)]
    shares = [row.error_worst / row.parameters["mu"] for row in one_iteration(mus).rows]
    assert 600 < min(shares) < max(shares) < 900  # where the legs carry the robot; 0.1 in swings
    assert max(shares[1:]) < 1.05 * min(shares[1:])  # at 1e-2 it begins to bend


@pytest.mark.long
def test_mu_is_read_against_the_heaviest_mass():
    """After one iteration at mu = 1e-8 a parallelogram is off by 2.1e-9 of its mass ratio."""
    from study import mass_ratios

    couplers = [1.0, 1e2, 1e4, 1e6]
    for s, row in zip(couplers, mass_ratios(couplers).rows, strict=True):
        assert row.error_worst == pytest.approx(2.1e-9 * s, rel=0.1)


@pytest.mark.long
def test_derivatives_without_the_protocol_are_off_by_mu():
    from study import protocols

    mus = [1e-4, 1e-6, 1e-8]
    rows = protocols(mus).rows
    for mu, kept, not_kept in zip(mus, rows[:3], rows[3:], strict=True):
        assert kept.error_worst < 1e-11
        assert not_kept.error_worst == pytest.approx(38.4 * mu, rel=0.02)


def test_noisy_states_are_judged_by_the_closed_machine():
    scene = cp.Scene(cp.model.bricard(), cp.model.bricard().loops)
    study = cp.Study(scene, [cp.Proximal(), cp.dynamics.NullSpace()], 4, noise=1e-4, effort=BRIEF)
    table = study.run(timed=False)
    for row in table.rows:
        assert 1e-6 < row.error_worst < 1e-2
        assert row.statuses == {"ok": 4}
        assert row.states.endswith("noise 0.0001")
    still = cp.Study(scene, [cp.Proximal()], 4, noise=(0.0, 1e-4), effort=BRIEF).run(timed=False)
    assert still.rows[0].error_worst < 1e-2
    assert still.rows[0].states.endswith("noise 0 and 0.0001")


@each_row("noise", [-1.0, math.nan, math.inf, (1e-4, -1.0)])
def test_noise_that_is_no_size_is_refused(noise):
    with pytest.raises(cp.InvalidArgument, match="noise"):
        cp.Study(BAR, FEW, noise=noise)
