"""Control beside tsid and placo without the peers: the question, the clock, and the table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.once

pytest.importorskip("proxsuite")

ROOT = Path(__file__).parent.parent


@pytest.fixture(autouse=True)
def benchmarks(monkeypatch):
    """Let scripts be imported."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))


@pytest.fixture
def question(tmp_path):
    """Return what peers are told of Talos in three states."""
    import control
    from peers.control.question import load
    from peers.control.with_condyn import question_of

    made = question_of(str(control.bare_description(tmp_path)), 3)
    told = load(made.save(tmp_path / "question.json"))
    assert told.wish == made.wish
    assert np.array_equal(told.q, made.q)
    return told


@pytest.mark.long
def test_the_robot_that_is_told_is_ours(question):
    from peers.control import harness
    from peers.control.with_condyn import talos

    model, ours = harness.model_of(question), talos().robot.model
    assert list(model.names) == list(ours.names)
    assert np.array_equal(model.armature, ours.armature)
    assert [inertia.mass for inertia in model.inertias] == pytest.approx(
        [inertia.mass for inertia in ours.inertias]
    )


@pytest.mark.long
def test_errors_are_those_of_the_answer(question):
    from peers.control import harness
    from peers.control.with_condyn import contender

    ours = contender(question)
    found = harness.errors(question, ours)
    assert found["dynamics"] < 1e-10
    assert found["feet"] < 1e-10
    assert found["com"] < 0.1

    def off(i):
        a, tau, felt = ours.answer(i)
        return a + 1e-3, tau, felt

    wrong = harness.errors(question, replace(ours, answer=off))
    assert wrong["dynamics"] > 1e-3
    assert wrong["feet"] > 1e-4


def test_committed_rows_have_right_answers():
    import control
    import script

    saved = script.load("control peers")
    rows = control.rows_of(saved)
    assert not saved["missing"]
    assert {row["peer"] for row in rows} == {"condyn_pin", "condyn_pin's core", "tsid", "placo"}
    for row in rows:
        assert row["dynamics"] < 1e-9
        assert row["feet"] < 1e-9
        assert row["com"] == pytest.approx(0.085, abs=0.01)  # the same wish, weighed the same


def test_where_inequalities_are_active_the_optimum_is_that_of_tsid():
    """To what either regularises; placo's cones leave the moment about the normal out."""
    import script

    rows = script.load("control peers")["rows"]
    last = {row["peer"]: row["active"] for row in rows}
    *asked, impossible = range(5)
    for i in asked:
        ours, tsid, placo = (last[peer][i] for peer in ("condyn_pin", "tsid", "placo"))
        core = last["condyn_pin's core"][i]
        assert core["objective"] == pytest.approx(ours["objective"], rel=1e-9)
        assert core["motors"] == ours["motors"]
        assert {ours["answer"], tsid["answer"], placo["answer"]} == {"ok"}
        assert ours["objective"] == pytest.approx(tsid["objective"], rel=1e-8)
        assert ours["motors"] == tsid["motors"]
        assert ours["dynamics"] < 1e-9
        if "friction" not in ours["title"]:
            assert ours["objective"] < placo["objective"]
    for peer in ("condyn_pin", "condyn_pin's core"):
        assert "CenterOfMass.z gives 1.19 m/s^2" in last[peer][impossible]["answer"]
    assert last["tsid"][impossible]["answer"] != "ok" != last["placo"][impossible]["answer"]


@pytest.mark.long
def test_ours_answers_where_inequalities_are_active(question):
    from peers.control import harness
    from peers.control.with_condyn import active, contender

    *asked, impossible = active(question)
    for each in asked:
        row = harness.judged(each, contender)
        assert row["answer"] == "ok"
        assert row["torque"] < 1 + 1e-9
        assert row["dynamics"] < 1e-9
        assert row["com"] > 0.5  # [m/s^2]: it cannot be had
    assert harness.judged(impossible, contender)["answer"].startswith("CenterOfMass.z gives 1.19")
