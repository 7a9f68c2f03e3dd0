"""Refusals and short answers that one question alone reaches: a row each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shared import HAS_LCABA, all_scenes, each_row, robot, states

import condyn_pin as cp
from condyn_pin.constraints import Coupling, Driven, HeldJoint, LineContact, Sine
from condyn_pin.contact import FrictionCone, margins
from condyn_pin.control import Actuation, operational_space, transmission

PATH = Sine(0.1, 0.4)


def bar(*more: cp.constraints.Constraint) -> cp.Scene:
    its = robot("four_bar")
    return cp.Scene(its, [*its.loops, *more])


def answer(scene: cp.Scene, **options: object) -> cp.dynamics.Solution:
    q, v = scene.state()
    return cp.solve(scene, q, v, 0 * v, **options)


def moved(scene: cp.Scene, **options: object) -> cp.Trajectory:
    return cp.simulate(scene, *scene.state(), duration=0.01, **options)


def pushed(force: object) -> cp.Trajectory:
    return moved(bar(), forces=[cp.AppliedForce("rocker_tip", lambda t, q, v: force)])


REFUSED = {
    "point of a coupling": (
        lambda: next(iter(answer(all_scenes()["four_bar geared"]).forces.values())).at,
        "a coupling acts along joints, at no point",
    ),
    "coupling to itself": (lambda: bar(Coupling("crank", "crank")), "both joints are 'crank'"),
    "driven twice": (
        lambda: Driven(Driven(HeldJoint("crank"), PATH), PATH), "whose rows are to be driven",
    ),
    "unit of a path": (
        lambda: Driven(HeldJoint("crank"), PATH).in_units(2.0, float), "what unit its path has",
    ),
    "shape of a force": (lambda: pushed([(0.0, 0.0, 1.0)]), r"\(0, q, v\) has shape \(1, 3\)"),
    "held motor": (
        lambda: transmission(bar(), bar().state()[0]).jacobian("rocker_tip", held=["crank"]),
        "crank is not at rest",
    ),
    "robot of motors": (lambda: Actuation("solo12"), "robot = str: a Robot is needed"),
    "limits upside down": (
        lambda: robot("four_bar").with_limits({"crank": (1.0, -1.0)}), "limits of crank",
    ),
    "exclusion of one": (
        lambda: replace(robot("four_bar"), exclusions=[["crank"]]), "two or more bodies",
    ),
    "exclusion of nobody": (
        lambda: replace(robot("four_bar"), exclusions=[["crank", "crnak"]]), "crnak",
    ),
    "forces of an array": (
        lambda: margins(np.zeros(3), FrictionCone(0.5)), "answer = ndarray: it has no contact",
    ),
    "forces without contacts": (
        lambda: margins(answer(bar()), FrictionCone(0.5)), "no contact to judge",
    ),
    "a switch of robots": (
        lambda: cp.simulation.switch(bar(), all_scenes()["solo12 contacts"], *bar().state()),
        "another model",
    ),
    "on the ground": (lambda: bar().state(on_ground="yes"), "on_ground = 'yes': True, False"),
    "a loop left out": (lambda: robot("four_bar").to_mjcf(without="it"), "without = 'it': a list"),
    "no loop left out": (lambda: robot("four_bar").to_mjcf(without=["it"]), "no loop named 'it'"),
    "raw lists": (
        lambda: cp.Workspace(bar()).constraint_models.append(None), r"workspace\.use\(scene\)",
    ),
    "rows of velocity": (
        lambda: moved(all_scenes()["sleigh contacts"], integrator=cp.simulation.Rattle()),
        "restrict velocities only",
    ),
    "no shape": (lambda: robot("solo12").collisions(0.5, shapes=["foot 9"]), "foot 9"),
}  # fmt: skip


@each_row(("call", "words"), REFUSED)
def test_it_is_refused(call, words):
    with pytest.raises(cp.CondynError, match=words):
        call()


def test_a_xacro_is_named_with_what_expands_it(tmp_path):
    path = tmp_path / "leg.xacro"
    path.write_text("<robot/>")
    with pytest.raises(cp.errors.InvalidModel, match=r"xacro leg\.xacro > robot\.urdf"):
        cp.load_robot(path)
    for folders in ("here", [tmp_path / "none"]):
        with pytest.raises(cp.InvalidArgument, match="a list of folders"):
            cp.load_robot("four_bar", package_dirs=folders)


@pytest.mark.skipif(not HAS_LCABA, reason="Pinocchio 3 has no lcaba")
def test_lcaba_says_what_to_exchange():
    its = robot("four_bar").with_frame("hook", "world", [0.35, 0.0, 0.4])
    held = cp.Loop("hook", "coupler_tip", "planar", axis="y", name="held")
    with pytest.raises(cp.errors.UnsupportedConstraint, match=r"world comes first.*held"):
        cp.Workspace(cp.Scene(its, [held]), cp.LCABA())


def test_constraints_know_frames_joints_and_feet():
    loop = robot("four_bar").loops[0]
    assert Driven(loop, lambda t: (np.zeros(3),) * 3).frames == loop.frames
    assert HeldJoint("crank").joints == ("crank",)
    assert len(LineContact("left_sole_link", half_length=0.1).feet) == 2


def test_forces_are_arrays_with_their_opposite():
    scene = bar(HeldJoint("crank", bar().state()[0][0]))
    solution = answer(scene)
    force = solution.forces["crank"]
    assert force.on_other()[0] == -force[0]
    assert force.shape == force.round(3).shape == (1,)


def test_answers_print_their_kind():
    scene = all_scenes()["four_bar loops"]
    space = operational_space(scene, states("four_bar loops")[0][0], "coupler_tip")
    assert repr(space) == "OperationalSpace(four_bar, coupler_tip: 1 of 6 directions free)"


def test_events_that_do_not_happen_are_told():
    events = [
        cp.Event(name="late", at=3.0),
        cp.Event(name="below", when=lambda moment: -1.0),
    ]
    late, below = moved(bar(), events=events).run.missed
    assert late == "late did not happen: the run ends before t = 3 s"
    assert "below did not happen: its condition is -1 at the end, and has not been above" in below


def test_independent_coordinates_do_not_jump_at_a_dead_point():
    """A parallelogram swings through the line where it may fold into a crossed one."""
    its = cp.model.parallelogram()
    scene, by = cp.Scene(its, its.loops), cp.simulation.CoordinatePartitioning()
    run = cp.simulate(scene, *scene.state(), duration=0.5, integrator=by)
    assert not run.status.ok
    assert "velocities jump by" in run.reason
    assert np.abs(run.energy.error).max() < 1e-8
