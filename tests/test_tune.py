"""Plans: a solver chosen once, found again, and refused where it does not hold."""

from __future__ import annotations

import dataclasses
import functools
import json
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest
from shared import all_scenes
from shell import condyn

import condyn_pin as cp
from condyn_pin._core.timing import Times
from condyn_pin.study import Choice, case, study
from condyn_pin.study import fresh as plans
from condyn_pin.study.fresh import Fresh, FreshErrors, fingerprint

pytestmark = pytest.mark.once


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """Keep the plans of a test in a folder of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "condyn_pin" / "plans"


@pytest.fixture(scope="module")
def scene() -> cp.Scene:
    bar = cp.model.four_bar()
    return cp.Scene(bar, bar.loops)


def choice(solver: cp.dynamics.Solver, error: float = 1e-8) -> Choice:
    from test_trade import row

    return Choice(solver, error, row(solver, 2.0, 1e-10), Fresh(200, 1e-10, 2e-10), ())


def test_without_a_plan_the_error_says_tune(scene):
    with pytest.raises(cp.errors.NotTuned, match=r"condyn_pin\.study\.tune\(scene, 1e-08\)"):
        cp.study.tuned(scene, 1e-8)
    with pytest.raises(cp.errors.NotTuned, match=r"measure='forces'"):
        cp.study.tuned(scene, 1e-8, measure="forces")


@pytest.mark.long
@pytest.mark.parametrize(
    "solver",
    [
        cp.Proximal(),
        cp.Proximal(mu=1 / 3, max_iterations=7),
        cp.DenseKKT(mu=1e-11),
        cp.dynamics.Soft(solref=(0.01, 1.0)),  # a tuple comes back as one
        cp.dynamics.Soft(),
    ],
)
def test_what_was_kept_is_found_by_an_equal_scene(scene, solver, cache):
    study.write_plan_of(scene, choice(solver))
    (path,) = cache.glob("*/*.json")
    saved = json.loads(path.read_text())
    assert (saved["found"], saved["expected"], saved["states"]) == (1e-10, 2e-10, 200)
    assert saved["where"] == plans.this_machine()
    bar = cp.model.four_bar()
    assert cp.study.tuned(cp.Scene(bar, bar.loops), 1e-8) == solver
    q, v = scene.sample(np.random.default_rng(0))
    assert cp.solve(scene, q, v, np.zeros(3), solver=cp.study.tuned(scene), throw=False).a.size == 3


@pytest.mark.long
def test_another_scene_another_error_and_another_measure_have_no_plan(scene):
    study.write_plan_of(scene, choice(cp.Proximal()))
    bar = cp.model.four_bar(crank=0.21)
    for other in (cp.Scene(bar, bar.loops), cp.Scene(scene.robot)):
        with pytest.raises(cp.errors.NotTuned):
            cp.study.tuned(other, 1e-8)
    with pytest.raises(cp.errors.NotTuned, match=r"there is one for acceleration to 1e-08\)"):
        cp.study.tuned(scene, 1e-6)
    with pytest.raises(cp.errors.NotTuned):
        cp.study.tuned(scene, 1e-8, measure="forces")


@pytest.mark.long
def test_a_plan_of_another_version_is_not_used_and_is_named(scene, monkeypatch):
    study.write_plan_of(scene, choice(cp.Proximal()))
    now = plans.machine()
    monkeypatch.setattr(plans, "machine", lambda: now | {"pinocchio": "9.9"})
    with pytest.raises(cp.errors.NotTuned, match=f"1e-08 with pinocchio {now['pinocchio']}"):
        cp.study.tuned(scene, 1e-8)


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: "",
        lambda text: text[: len(text) // 2],
        lambda text: "[1, 2]",
        lambda text: text.replace('"format": 1', '"format": 0'),
        lambda text: text.replace('"parameters": {', '"parameters": {"weight": 1, '),
        lambda text: text.replace('"max_iterations": 20', '"max_iterations": -1'),
        lambda text: text.replace('"Proximal"', '"Distal"'),
        lambda text: text.replace('"states"', '"stats"'),
        lambda text: text + "}",
        lambda text: b"\xff\xfe\x00",
    ],
)
def test_a_broken_plan_is_named_and_made_anew(scene, cache, damage):
    study.write_plan_of(scene, choice(cp.Proximal()))
    (path,) = cache.glob("*/*.json")
    broken = damage(path.read_text())
    broken = broken if isinstance(broken, bytes) else broken.encode()
    assert broken != path.read_bytes()
    path.write_bytes(broken)
    with pytest.raises(cp.errors.NotTuned, match=r"tune\(scene, 1e-08\) makes a new one"):
        cp.study.tuned(scene, 1e-8)
    study.write_plan_of(scene, choice(cp.Proximal()))
    assert cp.study.tuned(scene, 1e-8) == cp.Proximal()


def test_plans_written_at_the_same_time_are_whole(scene, cache):
    kept = [choice(cp.Proximal(mu=10.0**-i)) for i in range(1, 9)]
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda one: study.write_plan_of(scene, one), kept * 5))
    assert cp.study.tuned(scene, 1e-8) in [one.solver for one in kept]
    assert [path.suffix for path in cache.glob("*/*")] == [".json"]


def test_a_folder_that_cannot_be_written_is_named(scene, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(cp.InvalidArgument, match="XDG_CACHE_HOME"):
        study.write_plan_of(scene, choice(cp.Proximal()))


@pytest.mark.long
def test_the_fingerprint_is_that_of_the_content(scene):
    known = fingerprint(scene)
    words = (
        "import condyn_pin as cp; from condyn_pin.study.fresh import fingerprint;"
        "bar = cp.model.four_bar(); print(fingerprint(cp.Scene(bar, bar.loops)))"
    )
    other = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True)
    assert other.stdout.split() == [known], other.stderr
    heavier = pin.Model(scene.robot.model)
    inertia = heavier.inertias[1]
    inertia.mass = np.nextafter(inertia.mass, 1e9)
    heavier.inertias[1] = inertia
    weightless = pin.Model(scene.robot.model)
    weightless.gravity.linear = np.zeros(3)
    robots = [dataclasses.replace(scene.robot, model=m) for m in (heavier, weightless)]
    loop = dataclasses.replace(scene.constraints[0], kind="planar", axis="y")
    changed = [cp.Scene(robot, robot.loops) for robot in robots]
    changed.append(cp.Scene(scene.robot, [loop]))
    springs = [cp.model.Spring(scene.robot.joints[0], 50.0, 0.3)]
    changed.append(cp.Scene(dataclasses.replace(scene.robot, springs=springs), scene.constraints))
    found = {known, *map(fingerprint, changed)}
    assert len(found) == 5


@pytest.mark.long
def test_arguments_that_cannot_be():
    with pytest.raises(cp.InvalidArgument, match="a Scene is needed"):
        cp.study.tuned("cassie", 1e-8)
    for error in (0.0, -1.0, float("nan"), "small"):
        with pytest.raises(cp.InvalidArgument, match="error"):
            cp.study.tuned(cp.Scene(cp.model.four_bar()), error)


# with measurements


CANDIDATES = [cp.Proximal(mu=1.0, max_iterations=1), cp.Proximal(mu=1e-8), cp.dynamics.NullSpace()]


def test_tune_measures_keeps_and_tuned_finds(scene, monkeypatch):
    def timed(calls, *_, rounds, tick, **__) -> dict:
        """Invented: what is the fastest does not depend on who uses the machine."""
        for _ in range(rounds):
            tick()
        us = {cp.Proximal: 3.0, cp.dynamics.NullSpace: 30.0}
        return {key: Times((us[type(key[0][1])],)) for key in calls}

    monkeypatch.setattr(case, "interleaved", timed)
    seen: list[str] = []
    solver = cp.study.tune(
        scene, 1e-8, solvers=CANDIDATES, progress=lambda what, done, total: seen.append(what)
    )
    assert solver == cp.Proximal(mu=1e-8)
    assert cp.study.tuned(scene, 1e-8) == solver
    assert any("errors" in what for what in seen)
    assert any("times" in what for what in seen)


@pytest.mark.long
def test_what_is_chosen_carries_the_accuracy_it_was_chosen_for(scene):
    rough = cp.Proximal(mu=1e-3, max_iterations=1)
    chosen = cp.study.tune(scene, 1e-1, solvers=[rough])
    assert chosen == dataclasses.replace(rough, accuracy=1e-1)
    assert repr(chosen).endswith("refinements=None, accuracy=0.1)")
    found = cp.study.tuned(scene, 1e-1)
    table = cp.Study(scene, [rough], effort=cp.study.TimingEffort(rounds=2, repeats=1)).run()
    assert found == chosen == table.cheapest(1e-1).solver
    # one with an accuracy goes through a study
    again = cp.Study(scene, [chosen], effort=cp.study.TimingEffort(rounds=2, repeats=1)).run()
    assert again.rows[0].solver == repr(chosen)
    assert again.cheapest(1e-1).solver == chosen
    state = (*scene.sample(np.random.default_rng(0)), np.zeros(3))
    with pytest.raises(cp.SolveFailed):
        cp.solve(scene, *state, solver=rough)
    assert cp.solve(scene, *state, solver=found).status.ok
    assert cp.derivatives(scene, *state, solver=found).da_dq.shape == (3, 3)
    assert cp.solve_batch(scene, *(x[None] for x in state), solver=found).counts == {"ok": 1}
    with pytest.raises(cp.SolveFailed):  # what is said wins
        cp.solve(scene, *state, solver=found, accuracy=1e-8)
    assert pickle.loads(pickle.dumps(found)) == found


@pytest.mark.long
@pytest.mark.values
@pytest.mark.parametrize("accuracy", [-1.0, 0.0, np.nan, "rough", None])
@pytest.mark.parametrize("kind", [cp.Proximal, cp.dynamics.Reference, cp.dynamics.NullSpace])
def test_an_accuracy_that_no_answer_can_have(kind, accuracy):
    with pytest.raises(cp.InvalidArgument, match="accuracy"):
        kind(accuracy=accuracy)


@pytest.mark.long
def test_tune_may_keep_nothing_and_promises_no_less_than_ok_does(scene, cache):
    chosen = cp.study.tune(scene, 1e-10, solvers=CANDIDATES[2:], save=False)
    assert chosen == cp.dynamics.NullSpace()
    with pytest.raises(
        cp.errors.NotReached, match=r"1e-08 on .*; the best is Proximal\(mu=1\.0, max_"
    ):
        cp.study.tune(scene, 1e-8, solvers=CANDIDATES[:1])
    assert not cache.exists()


def test_tune_by_another_measure_is_a_plan_of_its_own(scene):
    cp.study.tune(scene, 1e-6, measure="forces", solvers=CANDIDATES[1:2])
    chosen = dataclasses.replace(CANDIDATES[1], accuracy=1e-6)
    assert cp.study.tuned(scene, 1e-6, measure="forces") == chosen
    with pytest.raises(cp.errors.NotTuned, match="there is one for forces to 1e-06"):
        cp.study.tuned(scene, 1e-6)


@pytest.mark.long
@pytest.mark.parametrize("level", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("label", ["four_bar loops", "solo12 contacts"])
def test_the_cheapest_meets_its_error_where_nobody_has_looked(label, level):
    """A small `benchmarks/trade.py cheapest`: at other states than the study and the choice.

    The less accurate, the faster: what meets an error by the least margin is asked first.
    """
    table, others = small_study(label)
    choice = table.cheapest(level, states=100)
    there = others(choice.solver)
    assert there.states == 300
    assert there.error <= level


@functools.cache
def small_study(label: str) -> tuple[cp.study.Table, FreshErrors]:
    solvers = (*cp.study.sweep(cp.Proximal(), mu=[1e-9, 1e-6, 1e-3, 1.0], max_iterations=[1, 20]),)
    scene = all_scenes()[label]
    table = cp.Study({label: scene}, solvers).run(timed=False)
    rows = tuple(dataclasses.replace(row, median_us=1.0 / row.error_worst) for row in table.rows)
    table = dataclasses.replace(table, rows=rows)
    return table, FreshErrors(
        scene, cp.study.AccelerationMeasure(), cp.study.SampledStates(300, seed=99)
    )


# on the command line


def test_condyn_tune_chooses_keeps_and_says_how_to_use_it(scene):
    result = condyn("trade", "--tune", "four_bar", "--solvers", "nullspace", "--error", "1e-8")
    assert result.exit_code == 0, result.output
    for said in ("NullSpace()", "200 fresh states", "kept in", "solver=tuned(scene, 1e-08)"):
        assert said in result.output
    assert cp.study.tuned(scene, 1e-8) == cp.dynamics.NullSpace()


def test_condyn_tune_prints_json_and_may_keep_nothing(cache):
    result = condyn(
        "trade", "--tune", "four_bar", "--solvers", "nullspace", "--json=-", "--no-save"
    )
    assert result.exit_code == 0, result.output
    plan = json.loads(result.stdout)
    assert (plan["solver"], plan["error"]) == ("NullSpace", 1e-8)
    assert plan["expected"] <= 1e-8
    assert not cache.exists()


def test_condyn_tune_fails_where_nothing_is_good_enough():
    result = condyn("trade", "--tune", "four_bar", "--solvers", "nullspace", "--error", "1e-20")
    assert result.exit_code == 1
    assert "nothing in this table meets acceleration to 1e-20" in result.output
