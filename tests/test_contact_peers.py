"""The side-by-side of contact without the peers: the motions, their files, and the tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.once

mujoco = pytest.importorskip("mujoco")

ROOT = Path(__file__).parent.parent


@pytest.fixture(autouse=True)
def benchmarks(monkeypatch):
    """Let scripts be imported."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))


@pytest.fixture
def box(tmp_path):
    """Return the box that slides, and what peers are told of it."""
    from peers.contact import export
    from peers.contact.scene import load

    motion = export.sliding()
    told = export.export(motion, tmp_path)
    again = load(told.folder)
    assert again == told
    return motion, told


@pytest.mark.long
def test_the_file_starts_where_the_motion_starts(box):
    motion, told = box
    model = mujoco.MjModel.from_xml_path(str(told.model))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    body = model.body(told.bodies[0]).id
    np.testing.assert_allclose(data.xipos[body], motion.centres(motion.q)[0], atol=1e-15)
    np.testing.assert_allclose(data.qvel, motion.v, atol=1e-15)
    assert model.geom_friction[:, 0] == pytest.approx(told.friction)
    assert data.ncon == 4


def test_the_box_stops_where_the_closed_form_says(box):
    """After v^2 / (2 mu g) = 0.101937 m, in its direction."""
    _, told = box
    end = np.array(told.truth)[-1, 0]
    assert np.hypot(*end[:2]) == pytest.approx(0.101937, abs=1e-6)
    assert np.arctan2(end[1], end[0]) == pytest.approx(0.3)


@pytest.mark.long
def test_the_error_is_of_the_motion_and_of_nothing_else(box):
    from peers.contact import with_condyn

    motion, told = box
    exact = with_condyn.way(motion, told, "Moreau", with_condyn.SCHEMES["Moreau"], 2e-3)
    first = with_condyn.SCHEMES["Stewart-Trinkle"]
    near = with_condyn.way(motion, told, "Stewart-Trinkle", first, 2e-3)
    assert told.distance(exact.play()[0]) < 1e-6
    for _ in range(2):  # a way starts anew
        assert told.distance(near.play()[0]) == pytest.approx(1e-3, rel=0.05)
    assert told.distance(np.full((8, 1, 3), np.nan)) == np.inf


@pytest.mark.long
def test_steps_lead_from_time_to_time(box):
    _, told = box
    for dt in told.steps:
        assert sum(told.counts(dt)) * dt == pytest.approx(told.duration)
        assert set(told.counts(dt)) == {round(0.05 / dt)}


def test_a_ball_bounces_five_times_in_the_closed_form():
    """It is e^2 as high after each hit: 0.316859 m after 0.6 s."""
    import contact

    motion = contact.bouncing()
    t = np.array([0.319275, 0.6, 1.5])
    z = motion.path(t)[:, 2] - 0.05
    assert z[0] == pytest.approx(0.0, abs=5e-6)
    assert z[1] == pytest.approx(0.316859, abs=1e-6)


def test_committed_orders_are_those_of_the_schemes():
    """Hard schemes are of first order where contacts slide; a convex law does not converge."""
    import script

    found = script.load("contact convergence")["orders"]
    slopes = {(row["motion"], row["scheme"]): row["order"] for row in found}
    assert slopes["box slides and stops", "Stewart-Trinkle"] == pytest.approx(1.0, abs=0.05)
    assert slopes["box slides and stops", "Moreau"] > 1.5
    assert slopes["ball bounces, e = 0.8", "Moreau"] == pytest.approx(1.0, abs=0.2)
    assert slopes["box slides and stops", "Anitescu"] < 0.1


@pytest.mark.long
def test_committed_rows_are_compared_at_equal_error():
    import contact_peers
    import script

    saved = script.load("contact_peers motions")
    rows, errors = contact_peers.rows_of(saved), saved["errors"]
    assert {row.peer for row in rows} == {"condyn_pin", "MuJoCo", "Drake", "Newton"}
    for scene in errors:
        for peer in ("condyn_pin", "MuJoCo"):
            for target in contact_peers.TARGETS:
                found = contact_peers.fastest(rows, scene, peer, target)
                if found:
                    assert found.error <= target
                    least = [r.work for r in rows if (r.scene, r.peer) == (scene, peer)]
                    assert found.work >= min(least)
