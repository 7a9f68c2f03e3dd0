"""What a user meets first: errors that name the cure, and prints that show the answer."""

from __future__ import annotations

import numpy as np
import pytest
from shared import each_row

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box, Plane
from condyn_pin.contact import FrictionCone
from condyn_pin.control import CenterOfMass, Controller, ControlLimits, Hierarchy, Posture
from condyn_pin.study.plots import _ticks

BAR = cp.model.four_bar()
SOLO = cp.load_robot("solo12")
STANDING = cp.Scene(SOLO, SOLO.contacts)
TASKS = (CenterOfMass(weight=100.0), Posture("standing", weight=0.1))

CURES = {
    "a torque limit": (lambda: ControlLimits(torque=5.0), r"torque = 5.0.*model.effortLimit"),
    "no cones": (lambda: Controller(STANDING, TASKS), r"cones is missing.*FrictionCone\(0.6\)"),
    "a robot for a scene": (
        lambda: cp.solve(BAR, np.zeros(3), np.zeros(3), np.zeros(3)),
        r"scene = Robot.*Scene\(robot, robot.loops\)",
    ),
    "a robot without loops": (
        lambda: cp.simulate(SOLO, np.zeros(19), np.zeros(18), duration=1.0),
        r"scene = Robot.*Scene\(robot, robot.contacts\)",
    ),
    "one constraint": (lambda: cp.Scene(BAR, BAR.loops[0]), r"Scene\(robot, \[coupler_rocker\]\)"),
    "a wall as a shape": (
        lambda: cp.FrictionalContact("ball", on_shape=Plane((1.0, 0.0, 0.0), 0.2), friction=0.3),
        r"on_shape = .*a plane of the world is on=Plane\(normal=\(1.0, 0.0, 0.0\), height=0.2\)",
    ),
    "a shape without its body": (
        lambda: cp.FrictionalContact("ball", on_shape=Ball(0.1), friction=0.3),
        r"on_shape = Ball.*name a frame of that one, on='frame'",
    ),
    "a robot that says it": (
        lambda: cp.load_robot("panda", floating=True),
        r"root_joint = 'free_flyer'.*load_robot\(robot.description",
    ),
    "a contradiction": (
        lambda: cp.load_robot("x.urdf", floating=True, root_joint="fixed"),
        "floating = True: root_joint = 'fixed' contradicts it",
    ),
    "floating as a number": (
        lambda: cp.load_robot("x.urdf", floating=1), "floating = 1: True or False"
    ),
}  # fmt: skip


@each_row("mistake", list(CURES))
def test_an_error_says_what_to_write_instead(mistake):
    call, match = CURES[mistake]
    with pytest.raises(cp.InvalidArgument, match=match):
        call()


@pytest.mark.long
def test_a_file_floats_if_it_is_to():
    free = cp.load_robot(SOLO.description, floating=True)
    assert (free.nv, cp.load_robot(SOLO.description, floating=False).nv) == (18, 12)
    assert free == cp.load_robot(SOLO.description, root_joint="free_flyer")


@pytest.mark.long
def test_an_answer_prints_its_accelerations():
    scene = cp.Scene(BAR, BAR.loops)
    answer = cp.solve(scene, *scene.state(), np.zeros(3))
    (line,) = [each for each in str(answer).splitlines() if each.startswith("[")]
    assert [float(x) for x in line.strip("[]").split()] == pytest.approx(answer.a, abs=1e-4)


@pytest.mark.long
def test_a_motion_prints_depth_and_modes_of_its_contacts():
    box = cp.model.free_box()
    floor = cp.FrictionalContact("box", Box(0.1, 0.1, 0.1), friction=0.5)
    scene = cp.Scene(box, contacts=[floor])
    q, v = scene.state()
    text = str(cp.simulate(scene, q, v, duration=0.01))
    assert text.startswith("free_box, 8 contacts: ")
    assert " rad deep at most; at the end " in text
    assert "at the end 4 open, 4 stick" in text
    assert "rows" not in text
    assert "violation" not in text
    q[2] += 1.0
    assert "at the end 8 open" in str(cp.simulate(scene, q, v, duration=0.01))
    bar = str(
        cp.simulate(cp.Scene(BAR, BAR.loops), *cp.Scene(BAR, BAR.loops).state(), duration=0.01)
    )
    assert bar.startswith("four_bar, 3 rows: ")
    assert "violation " in bar


@pytest.mark.long
def test_modes_are_texts():
    scene = cp.Scene(
        cp.model.free_ball(), contacts=[cp.FrictionalContact("ball", Ball(0.05), friction=0.5)]
    )
    run = cp.simulate(scene, *scene.state(), duration=2e-3)
    modes = run.modes["ball"]
    assert repr(list(modes)) == "['stick', 'stick', 'stick']"
    assert (modes == "stick").all()


def test_derivatives_print_their_blocks_and_what_a_check_found():
    scene = cp.Scene(BAR, BAR.loops)
    state = (*scene.state(), np.zeros(3))
    checked = cp.derivatives(scene, *state, check=True)
    assert 0.0 < checked.disagreement < 1e-5
    assert f"by {checked.disagreement:.1e} of the largest entry" in str(checked)
    assert "da_dq (3, 3)" in str(checked)
    assert "dlam_dtau (3, 3)" in str(checked)
    plain = cp.derivatives(scene, *state)
    assert plain.disagreement is None
    assert "not compared" in str(plain)


def test_a_controller_is_named_by_its_tasks():
    law = Controller(STANDING, TASKS, cones=FrictionCone(0.6))
    feet = "FL_FOOT, FR_FOOT, HL_FOOT, HR_FOOT"
    assert repr(law) == f"Controller(solo12 on {feet}: [CenterOfMass, Posture])"
    levels = Controller(STANDING, Hierarchy(*([task] for task in TASKS)), cones=FrictionCone(0.6))
    assert repr(levels).endswith(": Hierarchy([CenterOfMass], [Posture]))")


@pytest.mark.long
@each_row(
    ("low", "high"),
    [(8.18, 8.47), (0.5, 600.0), (1.2, 2.9), (95.0, 140.0), (2e-3, 3e-3), (5, 5.01)],
)
def test_an_axis_of_time_has_two_numbers_at_least(low, high):
    ticks = _ticks(low, high)
    assert len(ticks) > 1
    assert len({f"{tick:g}" for tick in ticks}) == len(ticks)
    assert low <= min(ticks) <= max(ticks) <= high
