"""Minimal scenes and ladders: what is dropped is measured, and said."""

from __future__ import annotations

import csv
import functools
import json
import math
import pickle

import numpy as np
import pytest
from shared import all_scenes, each_row, motor_torque, relative, robot

import condyn_pin as cp
import lab
from condyn_pin._core.timing import Times
from condyn_pin._core.tolerances import EXACT
from lab import hierarchy
from lab.hierarchy import climb, draw_hierarchy, save_hierarchies
from lab.same_motion import loaded, same_motion, standing_torque

FEW = lab.HierarchyEffort(states=2, rounds=5, repeats=2)


@functools.cache
def cassie(error: float, solver: cp.dynamics.Solver) -> cp.mechanism.Minimal:
    return all_scenes()["cassie loops + contacts"].minimal(error=error, solver=solver)


def test_minimal_cassie_lets_its_plantar_linkages_follow():
    found = cassie(0.05, cp.Proximal())
    assert found.nv == (32, 28)
    assert found.rows == (24, 18)
    assert found.errors.worst <= 0.05
    assert all(us > 1 for us in found.us)
    text = str(found)
    for said in ("nv 32 -> 28", "0.05 allowed", "kept: loop left-plantar-foot-joint left out"):
        assert said in text
    assert "left-crank-rod-joint" in str(found.scene.summary())


@pytest.mark.long
def test_a_tighter_limit_keeps_more():
    tight = cassie(1e-9, cp.Proximal())
    assert tight.nv == (32, 32)
    assert tight.errors.worst <= 1e-9
    assert any("1e-09 is allowed" in str(step) for step in tight.steps)


def test_a_solver_of_exact_rows_gets_rods_pins_and_edges():
    found = cassie(0.1, cp.DenseKKT())
    assert found.nv == (32, 22)
    assert not found.scene.nominal.redundant
    assert found.said == ("singular", "ok")
    assert math.isnan(found.us[0])
    assert found.us[1] > 1
    assert "singular before, " in str(found)
    assert "nan" not in str(found)
    kinds = {getattr(c, "kind", type(c).__name__) for c in found.scene.constraints}
    assert kinds == {"rod", "LineContact"}


def columns_of(model, names):
    """Where v holds joints."""
    joints = (model.joints[model.getJointId(name)] for name in names)
    return [i for joint in joints for i in range(joint.idx_v, joint.idx_v + joint.nv)]


@pytest.mark.long
def test_the_errors_are_those_of_the_smaller_scene():
    """Solved again from outside, at states that the choice was not made by."""
    found = cassie(0.05, cp.Proximal())
    assert found.states >= 50
    scene = all_scenes()["cassie loops + contacts"]
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(found.states):
        q, v = scene.sample(rng)
        tau = motor_torque(scene.robot, rng)
        a = cp.solve(scene, q, v, tau).a
        b = cp.solve(found.scene, *found.scene.reduce_state(q, v), found.scene.reduce_torque(tau)).a
        where = [columns_of(s.robot.model, found.watch) for s in (scene, found.scene)]
        errors.append(relative(b[where[1]], a[where[0]]))
    assert max(errors) == pytest.approx(found.errors.a_worst, rel=1e-3)
    assert np.median(errors) == pytest.approx(found.errors.a_median, rel=1e-3)


def test_joints_that_the_motion_leaves_alone_are_locked():
    """If the torques hold them still: then the lock is exact."""
    scene = all_scenes()["talos corners"]
    arms = [name for name in scene.robot.joints if name.startswith(("arm", "gripper", "head"))]
    raised = scene.state()[0]
    raised[scene.robot.index_q(arms[0])] += 0.3
    small = scene.lock(arms, raised)
    rng = np.random.default_rng(1)
    motion = []
    for _ in range(3):
        q, v = small.sample(rng)
        a = cp.solve(small, q, v, np.zeros(small.robot.nv)).a
        q_full, v_full = small.expand_state(q, v)
        _, a_full = small.expand_state(q, a)
        # what holds the arms: inverse dynamics with the accelerations of the locked scene
        terms = cp.Workspace(scene).terms(q_full, v_full)
        tau = terms.M @ a_full + terms.h
        held = [*map(scene.robot.index_v, arms)]
        only = np.zeros(scene.robot.nv)
        only[held] = tau[held]
        motion.append((q_full, v_full, only))
    found = scene.minimal(error=1e-8, motion=motion)
    assert found.scene.robot.joints == small.robot.joints
    assert found.rows == (24, 12)
    assert "joints that do not move locked" in str(found)


def test_what_looks_good_at_a_few_states_only_is_undone():
    """The rod of the four-bar is within 1e-2 at the ten states that it is tried at."""
    scene = all_scenes()["four_bar loops"]
    found = scene.minimal(error=1e-2, solver=cp.DenseKKT())
    undone = [
        step for step in found.steps if "other states; 0.01 is allowed, so undone" in str(step)
    ]
    assert undone
    assert all(
        isinstance(step, cp.mechanism.ReductionStep)
        and isinstance(step.errors, cp.mechanism.ReductionErrors)
        for step in undone
    )
    assert not any(step.kept for step in undone)
    assert all(step.errors.worst > 1e-2 for step in undone)
    assert found.rows == (3, 2)  # what the rod was in the way of: a planar pin
    rng = np.random.default_rng(5)
    worst = 0.0
    for _ in range(100):
        q, v = scene.sample(rng)
        tau = motor_torque(scene.robot, rng)
        small = found.scene
        a = cp.solve(scene, q, v, tau, solver=cp.dynamics.Reference()).a
        state = (*small.reduce_state(q, v), small.reduce_torque(tau))
        b = cp.solve(small, *state, solver=cp.dynamics.Reference()).a
        worst = max(worst, relative(b[:1], a[:1]))
    assert worst <= 1e-2


@pytest.mark.long
def test_no_error_at_all_leaves_what_is_exact():
    found = all_scenes()["talos corners"].minimal(error=0)
    assert found.rows == (24, 12)
    assert found.limit == EXACT
    assert found.errors.worst <= EXACT
    assert "1e-09 allowed" in str(found)


@pytest.mark.parametrize("label", ["four_bar geared", "four_bar rod"])
def test_kinds_that_proximal_does_not_take_are_taken_by_default(label):
    found = all_scenes()[label].minimal(error=0.1)
    assert found.solver in (cp.DenseKKT(), cp.dynamics.Reference())
    assert found.said == ("ok", "ok")
    assert all(us > 1 for us in found.us)


def test_a_solver_that_cannot_be_timed_is_said():
    scene = all_scenes()["four_bar loops"]
    found = scene.minimal(error=1e-9, solver=cp.Proximal(max_iterations=1, mu=1.0))
    assert found.said == ("inaccurate", "inaccurate")
    assert all(map(math.isnan, found.us))
    assert "inaccurate before, inaccurate after" in str(found)


def test_a_motion_is_to_be_closed():
    scene = all_scenes()["four_bar loops"]
    q, v = scene.sample(np.random.default_rng(0))
    tau = np.zeros(3)
    for q_, v_, said in (
        (np.add(q, [0.1, 0, 0]), v, "coupler_rocker is open by"),
        (q, np.add(v, [0.1, 0, 0]), r"coupler_rocker has \|J v\| ="),
    ):
        with pytest.raises(cp.errors.NotAssembled, match=rf"motion\[1\]: {said}"):
            scene.minimal(error=0.1, motion=[(q, v, tau), (q_, v_, tau)])


@pytest.mark.long
def test_watch_chooses_what_counts_and_the_answer_pickles():
    found = all_scenes()["four_bar loops"].minimal(error=0.9, watch=["rocker"])
    assert found.watch == ("rocker",)
    assert pickle.loads(pickle.dumps(found)) == found


@each_row(
    ("arguments", "error", "said"),
    [
        ({"error": -0.1}, cp.InvalidArgument, "from 0 to below 1"),
        ({"error": 1.0}, cp.InvalidArgument, "from 0 to below 1"),
        ({"error": math.nan}, cp.InvalidArgument, "error"),
        ({"error": 0.1, "motion": []}, cp.InvalidArgument, "empty"),
        ({"error": 0.1, "motion": "walk"}, cp.InvalidArgument, "list of"),
        ({"error": 0.1, "motion": [3]}, cp.InvalidArgument, r"motion\[0\]"),
        ({"error": 0.1, "motion": [(np.zeros(3),) * 2]}, cp.InvalidArgument, r"motion\[0\]"),
        ({"error": 0.1, "motion": [(np.zeros(4),) * 3]}, cp.InvalidArgument, "shape"),
        ({"error": 0.1, "watch": ["crnk"]}, cp.errors.UnknownName, "did you mean 'crank'"),
        ({"error": 0.1, "solver": "proximal"}, cp.InvalidArgument, "solver object"),
    ],
)
def test_mistakes_are_named(arguments, error, said):
    with pytest.raises(error, match=said):
        all_scenes()["four_bar loops"].minimal(**arguments)


def invented(trials, **_) -> dict:
    """Times by method and size: what is the fastest does not depend on who uses the machine."""
    us = {"Proximal": 1.0, "LCABA": 2.0, "Dense KKT": 3.0}
    sizes = dict(zip(dict.fromkeys(label for label, _ in trials), range(9, 0, -1), strict=False))
    return {
        (label, title): Times((us[title] * sizes[label],))
        for (label, title), one in trials.items()
        if one.call
    }


@functools.cache
def table(name: str) -> lab.HierarchyTable:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hierarchy, "time_trials", invented)
        return lab.model_hierarchy(name, effort=FEW)


def test_cassies_ladder():
    rows = {row.label: row for row in table("cassie").rows}
    assert next(iter(rows)) == "springs free"
    assert all(isinstance(row, lab.HierarchyRow) for row in rows.values())
    sizes = [(row.nv, row.rows) for row in rows.values()]
    assert sizes == [(32, 24), (28, 18), (24, 18), (18, 12), (18, 12)]
    assert rows["springs free"].a_worst == 0.0
    assert 0 < rows["feet driven directly"].a_worst < 0.01
    assert 1e-3 < rows["springs locked"].a_worst < 0.2
    assert rows["achilles rods as distances"].a_step < 0.01
    assert all(row.solver != "none says ok" and row.us >= 1 for row in rows.values())
    rods = rows["achilles rods as distances"]
    assert (rods.solver, rods.slower_as) == ("Dense KKT", "Proximal takes no rod")
    assert rows["knee and tarsus geared"].slower_as == "Proximal takes no Coupling"
    assert rows["springs free"].slower_as == ""
    assert "Dense KKT; Proximal takes no rod" in table("cassie").to_markdown()


def test_taloss_ladder():
    rows = {row.label: row for row in table("talos").rows}
    assert [row.nv for row in rows.values()] == [38, 38, 20, 18]
    assert rows["two surfaces"].a_worst < 1e-9
    assert rows["two surfaces"].force_worst < 1e-9
    assert 0 < rows["arms and head locked"].a_worst < rows["legs alone"].a_worst
    assert table("talos").fastest(1e-6).label in ("eight corners", "two surfaces")


@pytest.mark.long
@pytest.mark.parametrize("name", list(lab.HIERARCHIES))
def test_the_same_motion_is_closed_in_every_rung(name):
    chosen = lab.HIERARCHIES[name]
    scenes = chosen.scenes()
    source = scenes[chosen.sampled]
    joints = ("root_joint", *list(scenes.values())[-1].robot.actuated)
    q, v = source.sample(np.random.default_rng(3))
    state = (q, v, standing_torque(source, q))
    for scene in scenes.values():
        q_, v_, tau_ = same_motion(source, scene, state, joints)
        workspace = cp.Workspace(scene, cp.dynamics.Reference())
        assert np.abs(workspace.violation(q_)).max(initial=0.0) <= 1e-10
        assert np.abs(workspace.jacobian(q_) @ v_).max() < 1e-9
        assert np.allclose(q_[:7], q[:7], atol=1e-12)
        assert np.isfinite(tau_).all()


@pytest.mark.long
def test_springs_are_bent_until_they_carry_the_load():
    """Standing, with the free springs bent and acting, nothing accelerates."""
    scene = all_scenes()["cassie loops + contacts"]
    springs = scene.robot.springs
    q = loaded(scene)
    bent = [scene.robot.index_q(spring.joint) for spring in springs]
    moved = [scene.robot.index_v(spring.joint) for spring in springs]
    assert all(1e-3 < abs(angle) < 0.1 for angle in q[bent])
    rigid = scene.lock([spring.joint for spring in springs])
    source = (*rigid.state(), standing_torque(rigid, rigid.state()[0]))
    state = same_motion(rigid, scene, source, ("root_joint", *rigid.robot.actuated))
    assert np.abs(state[0] - q).max() < 1e-12
    a = cp.solve(scene, *state, solver=cp.dynamics.Reference()).a
    assert np.abs(a[moved]).max() < 1e-6  # 1e-12 rad times stiffness over inertia, 1e5 / s^2
    unbent = cp.solve(scene, *scene.state(), state[2], solver=cp.dynamics.Reference()).a
    assert np.abs(unbent[moved]).max() > 1.0


@pytest.mark.long
def test_tables_travel(tmp_path):
    found = table("talos")
    found.to_csv(tmp_path / "l.csv")
    found.to_json(tmp_path / "l.json")
    assert (tmp_path / "l.csv").read_text().startswith("# name: talos\n# states: 2\n")
    lines = [x for x in (tmp_path / "l.csv").read_text().splitlines() if not x.startswith("#")]
    assert [row["label"] for row in csv.DictReader(lines)] == [row.label for row in found.rows]
    saved = json.loads((tmp_path / "l.json").read_text())
    assert saved["machine"]["pinocchio"]
    assert saved["rows"][2]["nv"] == 20
    assert lab.HierarchyTable.from_json(tmp_path / "l.json") == found
    assert found.to_markdown().count("\n") == len(found.rows) + 1
    assert "eight corners" in str(found)
    assert pickle.loads(pickle.dumps(found)) == found
    save_hierarchies([found, found], tmp_path / "l.png")
    assert (tmp_path / "l.png").read_bytes().startswith(b"\x89PNG")
    ax = draw_hierarchy(found)
    assert ax.get_title() == "talos"
    assert [text.get_text().split("\n")[0] for text in ax.texts] == [r.label for r in found.rows]
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert sorted(legend) == sorted({row.solver for row in found.rows})


@pytest.mark.long
def test_an_unknown_ladder_is_named():
    with pytest.raises(cp.errors.UnknownName, match="did you mean 'cassie'"):
        lab.model_hierarchy("casie")


@pytest.mark.long
def test_a_ladder_that_no_solver_takes_has_no_times(monkeypatch):
    monkeypatch.setattr(hierarchy, "_solvers", lambda: (cp.Proximal(),))
    bar = robot("four_bar")
    rod = cp.Scene(bar, [cp.Loop("crank_tip", "rocker_tip", "rod", length=0.8)])
    (row,) = climb(lab.ModelHierarchy("mine", lambda: rod, "rod", (), "rod"), effort=FEW).rows
    assert (row.solver, row.slower_as) == ("none says ok", "")
    assert math.isnan(row.us)


@pytest.mark.long
def test_a_ladder_of_ones_own():
    bar = robot("four_bar")
    mine = lab.ModelHierarchy(
        "mine",
        lambda: cp.Scene(bar, bar.loops),
        "whole",
        (
            lab.HierarchyModel(
                "rod",
                "the coupler is light",
                lambda s: cp.mechanism.rods_as_distances(s, ["coupler"]),
            ),
        ),
        "rod",
    )
    found = climb(mine, effort=FEW)
    assert [(row.nv, row.rows) for row in found.rows] == [(3, 3), (2, 1)]
    assert all(row.us > 0 and row.speedup > 0 for row in found.rows)
    assert 0 < found.rows[1].a_worst < 1
