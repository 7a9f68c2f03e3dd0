"""Bodies that roll, and blades, beside contacts that open: by the compiled core as by Python.

Without the core these tests are left out; where CI=true they fail.
"""

from __future__ import annotations

import numpy as np
import pytest
from native_contacts import (
    Start,
    along,
    assert_derivatives_of_python,
    assert_motions_of_python,
    assert_steps_of_python,
    at_rest,
)
from test_native_contact import on_feet
from test_nonholonomic import cart

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin.constraints import (
    Ball,
    FrictionalContact,
    JointFriction,
    KnifeEdge,
    LineContact,
    PlanarContact,
    Plane,
    RollingBall,
)
from condyn_pin.model import free_box

# The core has Pinocchio's headers in it; that scenes cross from either version: test_native.py.
pytestmark = [pytest.mark.native, pytest.mark.once]


def wall(frame: str, x: float, radius: float) -> FrictionalContact:
    """A wall across the way at x [m] against a ball about a frame."""
    plane = Plane(normal=(-1.0, 0.2, 0.0), height=-x)
    return FrictionalContact(frame, Ball(radius), on=plane, friction=0.3, name="wall")


def thrown(scene: cp.Scene, q: np.ndarray, v: object, tau: object = None) -> Start:
    """With the velocity nearest to v that rolls."""
    return at_rest(scene, q, cp.mechanism.project_velocity(scene, q, np.array(v, float)), tau)


def ball() -> Start:
    robot = cp.model.rolling_ball()
    scene = cp.Scene(robot, robot.contacts, contacts=[wall("centre", 0.13, 0.1)])
    return thrown(scene, scene.state()[0], [1.0, 0.3, 0.0, -3.0, 10.0, 2.0], [2.0, 0, 0, 0, 0, 0])


def disc() -> Start:
    robot = cp.model.rolling_disc()
    scene = cp.Scene(robot, robot.contacts, contacts=[wall("centre", 0.13, 0.1)])
    return thrown(scene, robot.postures["leaning"], [0.5, 0.0, 0.0, 0.2, 5.0, 1.0])


def unicycle() -> Start:
    """With a heading that turns; a motor goes on while it is at the wall."""
    robot = cp.model.unicycle()
    scene = cp.Scene(robot, robot.contacts, contacts=[wall("wheel", 0.32, 0.3)])
    return thrown(scene, np.zeros(4), [0.6, 0.0, 0.5, 2.0], [0.0, 0.0, 0.02, 0.3])


def wagon() -> Start:
    """Two wheels and a caster, whose rows are redundant."""
    bare = cart()
    contacts = [wall("left_wheel", 0.45, 0.2), JointFriction("left", 0.1)]
    scene = cp.Scene(bare.robot, bare.constraints, contacts=contacts)
    v, tau = np.zeros((2, scene.robot.nv))
    v[[0, 5]], tau[6:8] = (0.8, 0.4), 0.5
    return thrown(scene, scene.robot.postures["standing"], v, tau)


def blade() -> Start:
    """A body that slides on a ball along a knife edge, which has no place."""
    floor = FrictionalContact("box", Ball(0.05), friction=0.1, name="floor")
    box = free_box(size=(0.2, 0.2, 0.1))
    scene = cp.Scene(box, [KnifeEdge("box", axis="y")], contacts=[floor])
    q = pin.neutral(box.model)
    q[2] = 0.0502
    return thrown(scene, q, [1.0, 0.5, 0.0, 0.2, 0.1, 3.0])


def beside_feet(*held: object) -> Start:
    """Solo12, a front foot or two held; hind feet stand, slide and open."""
    scene, q, _, tau = on_feet("solo12", friction=0.4)
    v = np.random.default_rng(5).normal(scale=0.6, size=scene.robot.nv)
    beside = cp.Scene(scene.robot, held, contacts=scene.contacts[2:])
    return thrown(beside, q, v, tau)


def rolling_foot() -> Start:
    """On a plane through where its motion begins."""
    return beside_feet(RollingBall("FL_FOOT", 0.0165))


def flat_foot() -> Start:
    return beside_feet(PlanarContact("FR_FOOT"))


def foot_on_an_edge() -> Start:
    return beside_feet(LineContact("FL_FOOT"))


# How long each moves [s], the modes that it goes through, and whether forces are unique: at a wall
# what rolls is held by both.
SCENES = {
    ball: (0.2, {0, 1}, False), disc: (0.2, {0, 2}, False), unicycle: (0.3, {0, 1, 2}, False),
    wagon: (0.2, {0, 2}, False), blade: (0.2, {0, 2}, True), rolling_foot: (0.1, {0, 2}, True),
    flat_foot: (0.05, {2}, True), foot_on_an_edge: (0.1, {0, 2}, True),
}  # fmt: skip
# steps that the first attempt of the contact solver does not answer, or whose rank leaves a doubt
LEFT = {wagon: 2}
each = pytest.mark.parametrize("make", SCENES, ids=lambda make: make.__name__)


@each
def test_steps_are_those_of_python(make, monkeypatch):
    duration, modes, unique = SCENES[make]
    groups, left = along(make(), duration), LEFT.get(make, 0)
    assert modes <= assert_steps_of_python(groups, monkeypatch, unique=unique, left=left)


@each
def test_derivatives_are_those_of_python(make, monkeypatch):
    groups, left = along(make(), SCENES[make][0]), LEFT.get(make, 0)
    assert_derivatives_of_python(groups, monkeypatch, left=left)


@each
@pytest.mark.parametrize("record", [7, 10])
def test_motions_are_those_of_python(make, record, monkeypatch):
    duration, _, unique = SCENES[make]
    left = 20 * LEFT.get(make, 0)  # of 600
    about = {"record": record, "unique": unique, "left": left}
    assert_motions_of_python(make(), duration, monkeypatch, **about)
