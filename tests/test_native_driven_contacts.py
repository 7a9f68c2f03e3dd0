"""Driven rows beside contacts that open and slide: by the compiled core as by Python.

    J_b v+ = s' - dt (gamma - s'') / 2

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
from numpy.testing import assert_allclose
from test_driven_contacts import FRICTION, WALL, driven_bar, pushed, pushing
from test_native_contact import CORE, DT, EXACT, MOVED, on_feet

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.tolerances import CONTACT_SOLVED
from condyn_pin.constraints import (
    Ball,
    Coupling,
    Driven,
    FrictionalContact,
    HeldJoint,
    JointFriction,
    Plane,
    Polynomial,
    RollingBall,
    Sine,
)
from condyn_pin.model import free_box
from condyn_pin.simulation.batch import motions
from condyn_pin.stepping import step_batch
from condyn_pin.stepping.batch import contacts_of, paths_of, step_plan

# The core has Pinocchio's headers in it; that scenes cross from either version: test_native.py.
pytestmark = [pytest.mark.native, pytest.mark.once]


def along_path(scene: cp.Scene, q: np.ndarray, v: object) -> np.ndarray:
    """The velocity nearest to v with J v = s'."""
    return np.array(cp.mechanism.project_velocity(scene.at(0.0), q, v))


def plate() -> Start:
    """It overtakes a box, pushes it, and leaves it to slide on."""
    path = Polynomial((0.0, 0.6, 0.8, -1.6))
    return at_rest(pushing(path), [0.0, 0.05, 0.0], [0.6, 0.0, 0.0])


def motor() -> Start:
    """Along the driven row G is zero, and the contact slides there all the same."""
    floor = FrictionalContact("box_frame", friction=FRICTION)
    driven = Driven(HeldJoint("along"), Sine(0.05, 4.0))
    scene = cp.Scene(pushed(), [driven], contacts=[floor])
    return at_rest(scene, np.zeros(3), [0.0, 0.4 * np.pi, 0.0])


def crank() -> Start:
    """A loop beside a drive, and dry friction that turns."""
    scene = driven_bar(Sine(0.4, 0.7))
    return at_rest(scene, *scene.state())


def knees() -> Start:
    """Solo12 on its feet, knees geared and bent: feet stand, slide and open."""
    scene, q, v, tau = on_feet("solo12", friction=0.4)
    at = q[scene.robot.model.joints[scene.robot.model.getJointId("HL_KFE")].idx_q]
    geared = Driven(Coupling("FL_KFE", "FR_KFE", 1.0), Sine(0.05, 4.0))
    held = Driven(HeldJoint("HL_KFE", at), Sine(-0.05, 5.0))
    scene = cp.Scene(scene.robot, [geared, held], contacts=scene.contacts)
    return at_rest(scene, q, along_path(scene, q, v), tau)


def piston() -> Start:
    """A body on a ball that falls on the floor, dragged to and fro by a rod."""
    box = free_box(size=(0.2, 0.2, 0.1)).with_frame("hook", "box", (-0.1, 0.02, 0.03))
    rod = cp.Loop("hook", "world", "rod", length=0.32)
    floor = FrictionalContact("box", Ball(0.05), friction=0.4)
    scene = cp.Scene(box, [Driven(rod, Sine(0.02, 5.0))], contacts=[floor])
    q = pin.neutral(box.model)
    q[:3] = 0.1 + np.sqrt(0.32**2 - 0.02**2 - 0.085**2), 0.0, 0.055
    return at_rest(scene, q, along_path(scene, q, np.zeros(6)))


def belt() -> Start:
    """A ball on a belt that speeds up, thrown against a wall."""
    ball = cp.model.rolling_ball()
    path = Polynomial(((0.0, 0.0, 1.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.0)))
    rolls = Driven(RollingBall("centre", 0.1, height=0.0), path)
    away = Plane(normal=(-1.0, 0.2, 0.0), height=-0.12)
    wall = FrictionalContact("centre", Ball(0.1), on=away, friction=0.3, name="wall")
    scene = cp.Scene(ball, [rolls], contacts=[wall])
    q, _ = scene.at(0.0).state()
    return at_rest(scene, q, along_path(scene, q, [0.4, 0.1, 0, 0, 4.0, 0.3]))


# How long each moves [s], and the modes that it goes through; none beside is asked for.
SCENES = {
    plate: (0.4, {0, 1, 2}), motor: (0.2, {2}), crank: (0.4, {2}), knees: (0.1, {0, 1, 2}),
    piston: (0.2, {0, 1, 2}), belt: (0.2, {0, 2}),
}  # fmt: skip
each = pytest.mark.parametrize("make", SCENES, ids=lambda make: make.__name__)


@each
def test_steps_are_those_of_python(make, monkeypatch):
    duration, modes = SCENES[make]
    assert modes <= assert_steps_of_python(along(make(), duration), monkeypatch)


@each
def test_derivatives_are_those_of_python(make, monkeypatch):
    assert_derivatives_of_python(along(make(), SCENES[make][0])[::3], monkeypatch)


@each
@pytest.mark.parametrize("record", [7, 10])
def test_motions_are_those_of_python(make, record, monkeypatch):
    """Also where the last sample is that of a step that is not taken."""
    assert_motions_of_python(make(), SCENES[make][0], monkeypatch, record=record)


def test_the_work_of_a_drive_in_an_impact_is_in_the_balance():
    """m V^2 of a plate that meets a box, in place of lam . s' at samples."""
    scene = pushing(Polynomial((0.0, 2.0)))
    state = np.array([[0.0, 0.05, 0.0]]), np.array([[2.0, 0.0, 0.0]])
    batch = cp.simulate_batch(scene, *state, duration=0.1, dt=DT, integrator=EXACT, **CORE)
    assert batch.ok
    assert batch.energy_error.max() < 1e-12


def test_steps_of_other_times_are_of_these():
    """One core after the other, with memory of the same scene."""
    scene = plate().scene
    q, v = np.array([[0.0, 0.0, 0.0]]), np.array([[0.6, 0.6, 0.0]])
    for t in (0.0, 0.2, 0.1, 0.0):
        about = {"dt": DT, "integrator": EXACT}
        found = step_batch(scene.at(t), q, v, **about, **CORE)
        wanted = step_batch(scene.at(t), q, v, **about)
        assert found.ok
        assert_allclose(found.v, wanted.v, rtol=0, atol=1e-12)
        assert_allclose(found.lam, wanted.lam, rtol=0, atol=1e-12 * np.abs(wanted.lam).max())


def test_a_path_into_a_wall_is_refused_as_by_python():
    scene = pushing(Polynomial((0.0, 1.0)), WALL)
    state = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])
    about = {"duration": 0.2, "dt": DT, "integrator": EXACT}
    wanted = cp.simulate_batch(scene, *state, **about)
    found = cp.simulate_batch(scene, *state, **about, **CORE)
    assert list(found.reasons) == list(wanted.reasons)
    assert "neither can move away" in found.reasons[0]
    assert_allclose(found.t, wanted.t, rtol=0, atol=1e-12)
    state = np.array([[0.0999, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])
    step = step_batch(scene.at(0.0999), *state, dt=DT, integrator=EXACT, **CORE)
    assert not step.ok


def test_a_path_that_ends_or_leads_out_of_reach_is_left_to_python():
    """What Python says of it is said."""

    def ends(t):
        if t > 0.05:
            raise cp.InvalidArgument("no path from here")
        return np.array([0.3 * t, 0.3, 0.0])

    bar = cp.model.four_bar()
    crank, rocker = bar.model.names[1], bar.model.names[-1]
    held = Driven(HeldJoint(rocker, float(bar.postures["open"][-1])), Polynomial((0.0, 0.6, 400.0)))
    turned = cp.Scene(bar, [*bar.loops, held], contacts=[JointFriction(crank, 0.5)])
    for scene in (driven_bar(ends), turned):
        q, v = scene.at(0.0).state()
        about = {"duration": 0.1, "dt": DT, "integrator": EXACT}
        wanted = cp.simulate_batch(scene, q[None], v[None], **about)
        found = cp.simulate_batch(scene, q[None], v[None], **about, **CORE)
        assert not wanted.ok
        assert list(found.reasons) == list(wanted.reasons)
        assert_allclose(found.t, wanted.t, rtol=0, atol=1e-12)


def test_what_the_core_leaves_of_a_motion_is_taken_by_python(monkeypatch):
    """A step in between: the motion goes on in the core, with the work that the drive did."""
    scene, q, v, tau = knees()
    about = {"duration": 0.1, "dt": DT, "integrator": EXACT, "record": 7}
    wanted = cp.simulate_batch(scene, q[None], v[None], tau, **about)

    def short(*about: object) -> np.ndarray:  # Newton's method ends early, most often at no answer
        plan = step_plan(*about)
        assert (plan[8], plan[14]) == (EXACT.contact.max_iterations, CONTACT_SOLVED)
        plan[8], plan[14] = 5, 1e-12
        return plan

    taken = []
    step = motions.ContactSteps.step

    def counted(self: object, *state: np.ndarray) -> tuple[np.ndarray, ...]:
        taken.append(state)
        return step(self, *state)

    monkeypatch.setattr(motions, "step_plan", short)
    monkeypatch.setattr(motions.ContactSteps, "step", counted)
    found = cp.simulate_batch(scene, q[None], v[None], tau, **about, **CORE)
    assert 5 < len(taken) < 95
    for name in ("q", "v", "lam", "contact"):
        one, two = (getattr(x.samples, name) for x in (found, wanted))
        assert_allclose(one, two, rtol=0, atol=MOVED * max(1.0, np.abs(two).max()), err_msg=name)
    assert_allclose(found.energy_error, wanted.energy_error, rtol=0, atol=MOVED)


@pytest.mark.parametrize(
    ("rows", "shape"), [([], (3, 3, 0)), ([0], (2, 3, 1)), ([0], (3, 2, 1)), ([1], (3, 3, 1))]
)
def test_paths_that_do_not_fit_are_refused_at_the_border(rows, shape):
    scene, q, v, tau = motor()
    workspace = cp.Workspace(scene.bilateral.at(0.0))
    contacts = contacts_of(workspace, tuple(scene.contacts))
    out = {
        "q": np.zeros((1, 3)), "v": np.zeros((1, 3)), "lam": np.zeros((1, 4)),
        "errors": np.zeros((1, 8)), "modes": np.zeros((1, 1), np.int32),
        "done": np.zeros(1, np.int32), "plan": step_plan(EXACT, DT), "threads": 1,
    }  # fmt: skip
    contacts.step(q[None], v[None], tau[None], **out, **paths_of(workspace, DT))
    assert out["done"][0]
    path = {"driven": np.array(rows, np.int32), "path": np.zeros(shape)}
    with pytest.raises(ValueError, match=r"driven rows|path"):
        contacts.step(q[None], v[None], tau[None], **out, **path)
