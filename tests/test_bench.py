"""The harness: what it times, what it writes, and that a failure stays in the table."""

from __future__ import annotations

import json
import math
from dataclasses import fields

import numpy as np
import pytest
from shared import HAS_LCABA, all_scenes, each_scene, motor_torque, robot, standard_scenes

import condyn_pin as cp
from condyn_pin._core import timing
from condyn_pin._core.timing import Times, interleaved, machine
from condyn_pin.study.bench import (
    BY_HAND,
    METHODS,
    BenchRow,
    BenchTable,
    Effort,
    bench,
    bench_scene,
    by_hand,
)

TINY = Effort(states=2, rounds=4, repeats=1)


@pytest.mark.long
def test_every_candidate_sees_every_state_equally_often():
    seen: dict[str, list[float]] = {"one": [], "two": [], "three": []}
    calls = {name: lambda q, v, tau, name=name: seen[name].append(q[0]) for name in seen}
    states = [(np.array([float(i)]),) * 3 for i in range(5)]
    ticks: list[int] = []
    times = interleaved(calls, states, rounds=10, repeats=3, tick=lambda: ticks.append(1))
    assert len(ticks) == 10
    assert seen["one"] == seen["two"] == seen["three"]
    assert len(seen["one"]) == 5 + 10 * (1 + 3)
    assert all(len(t.samples) == 10 for t in times.values())


@pytest.mark.long
def test_what_is_slow_is_called_less(monkeypatch):
    seen = {"fast": 0, "slow": 0}
    now = [0.0]  # [s] on a clock that only the calls move

    def taking(seconds: float, name: str):
        def call(q, v, tau):
            seen[name] += 1
            now[0] += seconds

        return call

    monkeypatch.setattr(timing, "perf_counter", lambda: now[0])
    calls = {"fast": taking(1e-5, "fast"), "slow": taking(2e-3, "slow")}
    states = [(np.zeros(1),) * 3] * 4
    times = interleaved(calls, states, rounds=3, repeats=5, enough=1e-3)
    assert seen == {"fast": 4 + 3 * (1 + 5), "slow": 4 + 3 * (1 + 1)}
    assert times["fast"].samples == pytest.approx([10.0] * 3)
    assert times["slow"].samples == pytest.approx([2000.0] * 3)


@pytest.mark.long
def test_times_are_what_they_say():
    times = Times(tuple(map(float, range(1, 101))))
    assert times.median == 50.5
    assert times.p95 == pytest.approx(95.05)
    assert Times((2.0, 4.0, 9.0)).ratio(Times((1.0, 2.0, 3.0))) == 2.0


@pytest.mark.long
@pytest.mark.parametrize("label", ["four_bar loops", "talos contacts"])
def test_rows_of_a_scene(label):
    rows = bench_scene(label, all_scenes()[label], effort=TINY)
    methods = [row.method.split(",")[0] for row in rows]
    assert methods[0] == "ABA"
    assert ("LCABA" in methods) == HAS_LCABA
    for row in rows[1:]:
        assert (row.rows, row.rank) == (all_scenes()[label].rows, all_scenes()[label].nominal.rank)
        if "singular" in row.status:
            assert row.method == "Dense KKT"
            assert math.isnan(row.acceleration_us)
            continue
        assert row.status in ("2 ok", BY_HAND)
        assert row.error < 1e-8
        assert row.acceleration_us > 0
        assert row.solve_us > 0 or row.status == BY_HAND
        assert row.to_dense > 0


@pytest.mark.long
def test_dense_is_the_fastest_of_the_dense(monkeypatch):
    """Invented times: every method is faster than the one before it."""
    from condyn_pin.study import bench

    def timed(calls, *_, **__) -> dict:
        return {key: Times((100.0 - i,)) for i, key in enumerate(calls)}

    monkeypatch.setattr(bench, "interleaved", timed)
    rows = bench_scene("talos contacts", all_scenes()["talos contacts"], effort=TINY)
    by_hand = [row for row in rows if row.status == BY_HAND]
    assert [row.method for row in by_hand] == list(METHODS)
    assert by_hand[-1].to_dense == 1.0
    assert all(row.to_dense < 1.0 for row in rows[1:-1])


@each_scene
def test_by_hand_is_right_or_not_there(label):
    scene = all_scenes()[label]
    damping = 1e-11 * scene.nominal.delassus_norm if scene.nominal.redundant else 0.0
    state = (*scene.sample(np.random.default_rng(1)), np.zeros(scene.robot.nv))
    truth = cp.solve(scene, *state, solver=cp.dynamics.Reference()).a
    answers = by_hand(scene, damping)
    assert set(answers) in (set(), set(METHODS))
    for answer in answers.values():
        assert np.abs(answer(*state) - truth).max() < 1e-6 * max(np.abs(truth).max(), 9.81)


@pytest.mark.long
def test_redundant_rows_get_a_damped_reference():
    rows = bench_scene("four_bar loops", all_scenes()["four_bar loops"], effort=TINY)
    dense = [row for row in rows if row.method.startswith("Dense KKT")]
    assert [row.status for row in dense] == ["2 singular", "2 ok"]
    assert "mu" in dense[1].method


@pytest.mark.long
def test_a_method_that_fails_stays_in_the_table(monkeypatch):
    from condyn_pin.study import bench

    monkeypatch.setattr(bench, "_solvers", lambda scene: [cp.Proximal(mu=0.0, max_iterations=1)])
    rows = bench_scene("four_bar loops", all_scenes()["four_bar loops"], effort=TINY)
    assert rows[1].status == "2 not_finite"
    assert math.isnan(rows[1].acceleration_us)


def table() -> BenchTable:
    rows = (BenchRow("s", "ABA", 0, 0, bare_us=1.0), BenchRow("s", "Proximal", 3, 2, error=1e-9))
    return BenchTable(rows, machine())


@pytest.mark.long
def test_json_has_no_nan_and_keeps_every_field(tmp_path):
    table().to_json(tmp_path / "b.json")
    text = (tmp_path / "b.json").read_text()
    assert "NaN" not in text
    saved = json.loads(text)
    assert set(saved["rows"][0]) == {field.name for field in fields(BenchRow)}
    assert saved["machine"]["processor"]
    again = BenchTable.from_json(tmp_path / "b.json")
    assert repr(again) == repr(table())  # NaN is unlike itself


@pytest.mark.native
@pytest.mark.parametrize("name", ["talos", "four_bar"])
def test_native_rows_are_those_of_python_without_it(name):
    """The same equations and settings: the same error, and a time against dense in C++."""
    found = bench((name,), effort=Effort(states=2, rounds=2, repeats=1), native=True)
    assert found.machine["C++ compiler"]
    for scene in {row.scene for row in found.rows}:
        here = [row for row in found.rows if row.scene == scene]
        python = {row.method: row for row in here if row.origin == "python"}
        in_cpp = {row.method: row for row in here if row.origin == "C++"}
        assert all(row.bare_us > 0.0 for row in in_cpp.values())
        assert ("constrainedABA" in in_cpp) == (name == "talos")
        assert {"ABA, unconstrained", "Proximal", "Dense KKT, Eigen LDLT"} <= in_cpp.keys()
        assert math.isnan(in_cpp["ABA, unconstrained"].to_dense)
        dense = [row.to_dense for method, row in in_cpp.items() if method.startswith("Dense")]
        assert max(dense) == pytest.approx(1.0, rel=0.5)  # medians of ratios, of two rounds
        for method in ("constrainedABA", "PV", "LCABA", "Proximal"):
            if method in in_cpp:
                assert in_cpp[method].error < max(1e-9, 10 * python[method].error)


@pytest.mark.long
def test_standard_scenes_of_every_robot():
    assert list(standard_scenes(robot("talos"))) == ["talos contacts", "talos corners"]
    assert list(standard_scenes(robot("cassie"))) == ["cassie loops", "cassie loops + contacts"]
    assert list(standard_scenes(robot("pendulum"))) == ["pendulum free"]


@pytest.mark.long
def test_torques_are_in_the_motors_only():
    cassie = robot("cassie")
    tau = motor_torque(cassie, np.random.default_rng(0))
    moved = {cassie.model.joints[cassie.model.getJointId(n)].idx_v for n in cassie.actuated}
    assert set(np.flatnonzero(tau)) == moved


@pytest.mark.long
def test_picture_has_a_mark_for_every_method_and_a_line_for_aba():
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    from condyn_pin.study import plots

    rows = bench_scene("four_bar loops", all_scenes()["four_bar loops"], effort=TINY)
    ax = plots.draw_bench(BenchTable(tuple(rows), machine()), "four_bar loops")
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert "Dense KKT: singular" in ax.texts[0].get_text()
    assert "Proximal" in labels
    drawn = {line.get_label(): line for line in ax.get_lines()}
    proximal = next(row for row in rows if row.method == "Proximal")
    assert drawn["Proximal"].get_xdata()[0] == proximal.acceleration_us
    assert drawn["Proximal"].get_ydata()[0] == max(proximal.error, 1e-16)
    remark = ax.texts[0].get_window_extent().transformed(ax.transData.inverted())
    assert remark.y1 < 1e-16  # below all marks
    assert plots.draw_bench(BenchTable(tuple(rows), machine()), "four_bar loops", ax) is ax
    pyplot.close("all")
