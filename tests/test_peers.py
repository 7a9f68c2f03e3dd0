"""The side-by-side benchmark without the peers: what is exported, and how results become tables."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import condyn_pin as cp

pytestmark = pytest.mark.once

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "benchmarks" / "peers"


@pytest.fixture(scope="module")
def peers():
    """The modules that need no peer."""
    patch = pytest.MonkeyPatch()
    patch.syspath_prepend(str(ROOT / "benchmarks"))
    from peers import bare, environments, export, exported, harness, run, stepping, table

    yield {
        module.__name__.removeprefix("peers."): module
        for module in (bare, environments, export, exported, harness, run, stepping, table)
    }
    patch.undo()


@pytest.fixture(scope="module", params=["talos, two feet", "cassie, loops", "four-bar"])
def case(request, peers, tmp_path_factory):
    """A scene, and the same as a peer reads it."""
    patch = pytest.MonkeyPatch()
    patch.setattr(peers["export"], "STATES", 2)
    patch.setattr(peers["export"], "FINE", 2e-3)
    scene = peers["export"].scenes()[request.param]
    folder = peers["export"].export_scene(tmp_path_factory.mktemp("s"), request.param, scene)
    patch.undo()
    return scene, peers["exported"].load(folder)


@pytest.mark.long
def test_tree_is_the_robot(peers, case):
    scene, exported = case
    q, v, _ = exported.state(0)
    rebuilt, model = peers["bare"].model_of(exported), scene.robot.model
    assert list(rebuilt.names) == list(model.names)
    for f in (pin.crba, lambda m, d, q: pin.nonLinearEffects(m, d, q, v)):
        ours, theirs = (np.array(f(m, m.createData(), q)) for m in (model, rebuilt))
        assert np.abs(ours - theirs).max() <= 1e-12 * np.abs(ours).max()


def test_bare_pinocchio_gives_the_exported_answers(peers, case):
    scene, exported = case
    hot, derivatives = peers["bare"].references(exported)
    for i in range(exported.count):
        assert exported.error("acceleration", i, hot.answer(i)) < 1e-10
        if scene.robot.name != "four_bar":  # there Pinocchio's own first column is wrong
            assert exported.error("derivatives", i, derivatives.answer(i)) < 1e-8


def test_tangent_motions_stay_on_the_constraints(peers, case):
    scene, exported = case
    workspace, h = cp.Workspace(scene), 1e-6
    q, v, _ = exported.state(0)
    T = exported.states["tangent"][0]
    nv = scene.robot.nv
    mobility = nv - scene.rank(q).rank
    assert T.shape == (2 * nv, 2 * mobility)
    assert np.abs(T.T @ T - np.eye(2 * mobility)).max() < 1e-12
    for dq, dv in zip(T[:nv].T, T[nv:].T, strict=True):
        moved = pin.integrate(scene.robot.model, q, h * dq)
        assert np.abs(workspace.violation(moved)).max() < 10 * h**2
        assert np.abs(workspace.jacobian(moved) @ (v + h * dv)).max() < 100 * h**2


@pytest.mark.long
def test_error_of_derivatives_ignores_how_gaps_are_pulled_back(case):
    """Baumgarte's terms change da_dq, and not along motions that stay on the constraints."""
    scene, exported = case
    pulled = cp.Workspace(scene, cp.dynamics.Reference(), drift=cp.Baumgarte(20.0, 20.0))
    d = pulled.derivatives(*exported.state(0))
    answer = (d.da_dq, d.da_dv, d.da_dtau[:, exported.motors])
    assert np.abs(d.da_dq - exported.states["da_dq"][0]).max() > 1.0
    assert exported.error("derivatives", 0, answer) < 1e-6


@pytest.mark.long
def test_mjcf_has_the_constraints_and_no_idle_sites(case):
    scene, exported = case
    model = mujoco.MjModel.from_xml_path(str(exported.folder / "scene.xml"))
    assert (model.nv, model.neq) == (scene.robot.nv, len(exported.constraints))
    assert model.nsite == 2 * len(exported.constraints)


@pytest.mark.long
def test_errors(case):
    _, exported = case
    a = exported.states["a"][0]
    assert exported.error("acceleration", 0, a) == 0.0
    assert exported.error("acceleration", 0, a * 1.01) == pytest.approx(0.01)
    assert exported.error("acceleration", 0, np.full_like(a, np.nan)) == float("inf")
    assert exported.error("motion", 0, exported.end) == 0.0


@pytest.mark.long
def test_difference_is_that_of_pinocchio_and_does_not_count_turns(case):
    scene, exported = case
    q = exported.states["q"][0]
    d = 1e-4 * np.linspace(-1.0, 1.0, scene.robot.nv)
    moved = pin.integrate(scene.robot.model, q, d)
    found = exported.difference(q, moved)
    for joint in exported.joints:
        here = slice(joint.idx_v, joint.idx_v + joint.nv)
        if joint.kind == "free":  # positions are compared in the axes of the world
            here = slice(joint.idx_v + 3, joint.idx_v + 6)
        assert np.abs(found[here] - d[here]).max() < 1e-9
        if joint.kind == "revolute":
            turned = q.copy()
            turned[joint.idx_q] += 2 * np.pi
            assert np.abs(exported.difference(q, turned)).max() < 1e-12


@pytest.mark.long
def test_harness_measures(peers, case):
    _, exported = case
    harness = peers["harness"]
    hot, _ = peers["bare"].references(exported)
    called = []
    slow = harness.Candidate(
        "acceleration", "slow", called.append, lambda i: exported.states["a"][i]
    )
    rows = harness.measure(exported, [hot, slow], 0.05)
    assert {row["method"] for row in rows} == {hot.method, "slow"}
    assert set(called) == set(range(exported.count))  # every state has its turn
    for row in rows:
        assert 0.0 < row["min_us"] <= row["median_us"] <= row["p95_us"]
        if row["method"] == hot.method:
            assert row["min_us"] == row["bare_min_us"]


def result(version: str, pinocchio: str, peer: str = "Toy", **changes: float) -> dict:
    """What a script writes, with one row of its own and the reference."""
    from peers.harness import REFERENCES

    row = {
        "scene": "s", "quantity": "acceleration", "peer": peer, "version": version, "method": "m",
        "note": "", "median_us": 30.0, "min_us": 20.0, "p95_us": 40.0, "bare_min_us": 5.0,
        "error_median": 1e-9, "error_worst": 1e-6,
    } | changes  # fmt: skip
    bare = row | {
        "peer": "Pinocchio", "version": pinocchio, "method": REFERENCES["acceleration"],
        "median_us": 10.0, "min_us": 8.0, "bare_min_us": 8.0, "error_worst": 1e-15,
    }  # fmt: skip
    return {"peer": peer, "version": version, "pinocchio": pinocchio, "rows": [bare, row]}


@pytest.mark.long
def test_gather_takes_medians_over_passes_and_the_reference_of_the_pass(peers):
    gather = peers["table"].gather
    passes = [
        [
            result("1", "4.1.0", median_us=us, min_us=us / 2),
            result("2", "4.0.0", "Old", min_us=16.0),
        ]
        for us in (20.0, 30.0, 70.0)
    ]
    rows = {(row.peer, row.pinocchio): row for row in gather(passes)}
    toy, old = rows["Toy", "4.1.0"], rows["Old", "4.0.0"]
    assert (toy.median_us, toy.ratio, toy.ratio_low, toy.ratio_high) == (30.0, 3.0, 2.0, 7.0)
    assert old.ratio == 2.0  # 16 us over the 8 us that Pinocchio 4.1 took in the same pass
    assert rows["Pinocchio", "4.0.0"].ratio == 1.0
    with pytest.raises(ValueError, match=r"no bare Pinocchio 4\.1"):
        gather([[result("2", "4.0.0")]])


@pytest.mark.long
def test_table_names_the_fastest_within_an_error(peers):
    table = peers["table"]
    fast = result("1", "4.1.0", "MuJoCo", method="soft", min_us=4.0, error_worst=1e-2)
    right = result("1", "4.1.0", "MuJoCo", method="stiff", min_us=5.0, error_worst=1e-9)
    rows = table.gather([[fast, right]])
    made = table.PeerTable(rows, dict.fromkeys(("processor", "cores"), "x"), {}, 1, 2)
    assert made.fastest("s", "acceleration", "MuJoCo", 1e-1).method == "soft"
    assert made.fastest("s", "acceleration", "MuJoCo", 1e-8).method == "stiff"
    assert made.fastest("s", "acceleration", "Drake", 1e-1) is None


@pytest.mark.long
def test_a_crash_is_told_in_a_sentence(peers, tmp_path):
    run, missing = peers["run"], peers["environments"].Missing
    for code, said in (
        ("kill -SEGV $$", "SIGSEGV"),
        ("echo 'E: no such thing' >&2; exit 1", "no such"),
    ):
        python = tmp_path / "python"
        python.write_text(f"#!/bin/sh\n{code}\n")
        python.chmod(0o755)
        with pytest.raises(missing, match=said):
            run.run_script(python, "with_toy", [], tmp_path / "out.json", 1.0)


@pytest.mark.long
def test_the_line_that_tells_an_error_is_found(peers):
    last_line = peers["environments"].last_line
    assert (
        last_line("WARNING: old\nERROR: no such wheel\nHint: try harder\n")
        == "ERROR: no such wheel"
    )
    assert last_line("one\n\ntwo\n") == "two"
    assert last_line("") == "no message"


@pytest.mark.long
def test_every_script_exists_and_says_what_it_computes(peers):
    for environment in peers["environments"].ENVIRONMENTS:
        for script in environment.scripts:
            tree = ast.parse((FOLDER / f"{script}.py").read_text(encoding="utf-8"))
            names = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
            assert "candidates" in names
            assert ast.get_docstring(tree)


def test_committed_rows_are_those_of_their_page(peers):
    results = ROOT / "benchmarks" / "results"
    table = peers["table"].load(results / "peers.json")
    assert (results / "peers.md").read_text(encoding="utf-8") == table.to_markdown()
    again = json.loads((results / "peers.json").read_text(encoding="utf-8"))
    assert len(again["rows"]) == len(table.rows) > 0
