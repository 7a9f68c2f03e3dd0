"""Motions with contacts that are known: what rolls, flies, tips, hits and is held."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from shared import each_row

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box, FrictionalContact, JointFriction, JointLimit, Plane
from condyn_pin.contact import Lemke, SemismoothNewton, solve_contact
from condyn_pin.model import free_ball, free_box, together
from condyn_pin.stepping import (
    Anitescu,
    EventDriven,
    Moreau,
    SoftStep,
    StewartTrinkle,
    contact_problem,
)

G = 9.81
SCHEMES = (StewartTrinkle(), Moreau(), Anitescu(), SoftStep())
HARD = SCHEMES[:2]  # what slides in a convex step lifts off
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def ball_scene(friction: float = 0.3) -> cp.Scene:
    return cp.Scene(
        free_ball(radius=0.05), contacts=[FrictionalContact("ball", Ball(0.05), friction=friction)]
    )


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_ball_rolls_on_as_fast_as_it_did(scheme: cp.simulation.ContactScheme) -> None:
    """In turning axes an explicit step makes it faster: 28 m/s after half a second."""
    q, v = np.array([0, 0, 0.05, *UPRIGHT]), np.array([3.0, 0, 0, 0, 60.0, 0])
    run = cp.simulate(ball_scene(), q, v, duration=0.5, dt=1e-3, integrator=scheme)
    tolerance = 1e-3 if scheme.penetrates_at_rest else 1e-9
    assert_allclose(run.q[-1, :3], (1.5, 0, 0.05), atol=tolerance)
    assert_allclose(np.linalg.norm(run.v[-1, :3]), 3.0, atol=tolerance)


@pytest.mark.parametrize("scheme", HARD)
def test_a_ball_that_slides_ends_up_rolling(scheme: cp.simulation.ContactScheme) -> None:
    """v = 5/7 v_0 from t = 2 v_0 / (7 mu g) on, for a solid one, and not before."""
    q, v = np.array([0, 0, 0.05, *UPRIGHT]), np.array([2.0, 0, 0, 0, 0, 0])
    run = cp.simulate(ball_scene(0.3), q, v, duration=0.4, dt=1e-3, integrator=scheme)
    assert_allclose(np.linalg.norm(run.v[-1, :3]), 10 / 7, atol=1e-6)
    assert_allclose(run.v[-1, 4] * 0.05, 10 / 7, atol=1e-6)
    rolls = run.t[run.modes["ball"] == "slide"][-1]
    assert_allclose(rolls, 4 / (7 * 0.3 * G), atol=1.1e-3)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_what_spins_and_flies_follows_its_parabola(scheme: cp.simulation.ContactScheme) -> None:
    q, v = np.array([0, 0, 5.0, *UPRIGHT]), np.array([3.0, 0, 0, 0, 0, 100.0])
    run = cp.simulate(ball_scene(), q, v, duration=0.5, dt=1e-3, integrator=scheme)
    assert_allclose(run.q[-1, :3], (1.5, 0, 5 - G / 8), atol=G * 0.5 * 1e-3)
    assert_allclose(run.q[-1, :2], (1.5, 0), atol=1e-12)


@pytest.mark.long
def test_what_spins_on_a_plane_flies_straight_too() -> None:
    model = pin.Model()
    model.gravity.linear[:] = 0.0
    joint = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "puck")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.05), pin.SE3.Identity())
    scene = cp.Scene(cp.Robot("puck", model))
    q, v = np.array([0.1, 0.2, 1.0, 0.0]), np.array([3.0, 1.0, 50.0])
    run = cp.simulate(scene, q, v, duration=0.5, dt=1e-3, integrator=StewartTrinkle())
    assert_allclose(run.q[-1, :2], (1.6, 0.7), atol=1e-12)
    assert_allclose(np.linalg.norm(run.v[-1, :2]), np.sqrt(10), atol=1e-12)
    now = cp.step(scene, q, v, dt=1e-3)
    assert now.dynamics_error < 1e-15


def momentum(scene: cp.Scene, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Linear momentum, and angular momentum about the origin of the world."""
    model = scene.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, q, v)
    bodies = range(1, model.njoints)
    return np.sum([data.oMi[j].act(model.inertias[j] * data.v[j]).vector for j in bodies], axis=0)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_bodies_that_hit_each_other_keep_their_momentum(
    scheme: cp.simulation.ContactScheme,
) -> None:
    half = Box(0.1, 0.1, 0.05)
    boxes = together({name: free_box(size=(0.2, 0.2, 0.1)) for name in "ab"})
    model = pin.Model(boxes.model)
    model.gravity.linear[:] = 0.0
    contact = FrictionalContact("a/box", half, on="b/box", on_shape=half, friction=0.5)
    scene = cp.Scene(replace(boxes, model=model), contacts=[contact])
    rng = np.random.default_rng(0)
    for _ in range(2):
        one, two = (pin.exp3(rng.normal(size=3)) for _ in "ab")
        q = np.concatenate([
            (0, 0, 0.3), pin.Quaternion(one).coeffs(), (0.05, 0, 0), pin.Quaternion(two).coeffs()
        ])  # fmt: skip
        v = np.concatenate([
            one.T @ (0, 0, -2), rng.normal(size=3), two.T @ (0, 0, 1), rng.normal(size=3)
        ])  # fmt: skip
        run = cp.simulate(scene, q, v, duration=0.15, dt=5e-4, integrator=scheme)
        assert any((modes != "open").any() for modes in run.modes.values())
        change = momentum(scene, run.q[-1], run.v[-1]) - momentum(scene, q, v)
        assert np.abs(change[:3]).max() < 1e-12
        assert np.abs(change[3:]).max() < 1e-4  # gyroscopic torques are those of the start


@pytest.mark.parametrize("scheme", [StewartTrinkle(), Anitescu()])
@pytest.mark.parametrize("dt", [1e-3, 1e-2, 0.1])
def test_nothing_goes_through_however_long_a_step_is(
    scheme: cp.simulation.ContactScheme, dt: float
) -> None:
    """A box 2 mm above the floor, that gravity alone brings down; and one that is thrown."""
    half = Box(0.1, 0.1, 0.05)
    scene = cp.Scene(
        free_box(size=(0.2, 0.2, 0.1)), contacts=[FrictionalContact("box", half, friction=0.5)]
    )
    q = np.array([0, 0, 0.052, *UPRIGHT])
    assert cp.step(scene, q, np.zeros(6), dt=dt, integrator=scheme).penetration < 1e-6
    far = np.array([0, 0, 1.0, *UPRIGHT])
    fast = np.array([0, 0, -0.95 / dt, 0, 0, 0])
    assert cp.step(scene, far, fast, dt=dt, integrator=scheme).penetration < 1e-6


@pytest.mark.long
def test_an_impulse_at_one_end_brings_down_the_other() -> None:
    """A rod of 2 m on one end: gravity closes the 30 mm below the other, and half as much again."""
    ends = [
        FrictionalContact("box", offset=(x, 0, -0.01), friction=0.5, name=name)
        for x, name in ((-1.0, "left"), (1.0, "right"))
    ]
    scene = cp.Scene(free_box(size=(2.0, 0.02, 0.02)), contacts=ends)
    R = pin.utils.rotate("y", -0.015)
    q = np.array([0, 0, 0.01 + 0.015, *pin.Quaternion(R).coeffs()])
    now = cp.step(scene, q, np.zeros(6), dt=0.1)
    assert "open" not in now.modes.values()
    assert abs(now.gaps["right"]) < 1e-3


@pytest.mark.parametrize("tilt", [1e-6, 1e-5, 1e-4, 1e-3])
def test_a_foot_that_lands_tilted_is_answered_to_rounding(tilt: float) -> None:
    """Both ends are to close their gaps, which no motion of a rigid foot does: one slides."""
    ends = [
        FrictionalContact("box", offset=(x, 0, -0.01), friction=0.7, name=name)
        for x, name in ((-0.1, "heel"), (0.1, "toe"))
    ]
    scene = cp.Scene(free_box(size=(0.2, 0.02, 0.02)), contacts=ends)
    R = pin.utils.rotate("y", -tilt)
    q = np.array([0, 0, 0.01 + 0.1 * tilt, *pin.Quaternion(R).coeffs()])
    v = np.concatenate([R.T @ (0, 0, -4.0), np.zeros(3)])
    now = cp.step(scene, q, v, dt=5e-4, integrator=StewartTrinkle(contact=SemismoothNewton()))
    assert now.contact.natural < 1e-14
    assert now.contact.path == ("Newton",)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("height", [0.05, 5.0])
def test_what_is_not_finite_is_not_ok(scheme: cp.simulation.ContactScheme, height: float) -> None:
    scene, q = ball_scene(), np.array([0, 0, height, *UPRIGHT])
    for v, tau in ((1e200, 0.0), (0.0, 1e308)):
        now = cp.step(
            scene, q, np.full(6, v), np.full(6, tau), dt=1e-3, integrator=scheme, throw=False
        )
        finite = np.isfinite(now.v).all() and np.isfinite(now.q).all()
        assert finite if now.status.ok else now.status.name == "NOT_FINITE"
    with pytest.raises(cp.errors.StepFailed, match="overflow"):
        cp.simulate(scene, q, np.full(6, 1e200), duration=0.01, integrator=scheme)


@each_row("scheme", [*SCHEMES, EventDriven(), cp.RungeKutta4()])
def test_a_function_that_returns_nan_is_named(scheme: cp.simulation.Integrator) -> None:
    """It is to blame, and neither the masses nor the size of the step."""
    scene = ball_scene() if scheme.takes_contacts else ball_scene().closed()
    state = (0, 0, 0.05, *UPRIGHT), np.zeros(6)

    def tau(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.where(np.arange(6) == 2, np.nan if t > 0.0015 else 0.0, 0.0)

    run = cp.simulate(scene, *state, tau, duration=0.01, integrator=scheme)
    assert re.search(r"tau\(0\.00[\d.]*, q, v\)\[2\] = nan: finite numbers", run.reason)


@pytest.mark.long
def test_a_puck_that_turns_faster_than_numbers_go_is_not_ok() -> None:
    """sin and cos of infinity are errors in Python."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "puck")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1e-6, 0.05), pin.SE3.Identity())
    model.addFrame(pin.Frame("ball", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    contact = FrictionalContact("ball", Ball(0.05), friction=0.3)
    scene = cp.Scene(cp.Robot("puck", model), contacts=[contact])
    pushed = np.zeros(3), np.full(3, 1e308)
    now = cp.step(scene, np.array([0, 0, 1.0, 0]), *pushed, dt=1e-3, throw=False)
    assert now.status.name == "NOT_FINITE"


@pytest.mark.long
def test_numbers_of_numpy_are_numbers() -> None:
    """So that contacts are equal, can be hashed and come back from files."""
    plain = FrictionalContact("ball", Ball(0.5), friction=0.25, restitution=0.5)
    other = FrictionalContact(
        "ball", Ball(np.float32(0.5)), friction=np.array(0.25), restitution=np.float32(0.5)
    )
    assert repr(plain) == repr(other)
    assert hash(plain) == hash(other)
    dry = JointFriction("pivot", torque=np.float32(0.5))
    assert repr(dry) == repr(JointFriction("pivot", torque=0.5))


def test_what_is_no_contact_problem_is_named() -> None:
    scene, q = ball_scene(), np.array([0, 0, 0.05, *UPRIGHT])
    problem = contact_problem(scene, q, np.zeros(6), dt=1e-3)
    with pytest.raises(cp.InvalidArgument, match="problem = None"):
        solve_contact(None)  # type: ignore[arg-type]
    with pytest.raises(cp.InvalidArgument, match=r"solver = 'ADMM'.*ADMM\(\)"):
        solve_contact(problem, "ADMM")  # type: ignore[arg-type]
    with pytest.raises(cp.InvalidArgument, match="tau"):
        cp.step(scene, q, np.zeros(6), False, dt=1e-3)


def dropped(
    turn: np.ndarray, order: tuple[int, ...] = (0, 1, 2, 3)
) -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """A box that lands on its corners while it turns and slides, in a world that is turned."""
    box = free_box(size=(0.2, 0.16, 0.1))
    model = pin.Model(box.model)
    model.gravity.linear[:] = turn @ (0, 0, -G)
    floor = Plane(tuple(turn @ (0, 0, 1)))
    corners = [
        FrictionalContact("box", offset=(x, y, -0.05), friction=0.4, on=floor, name=f"{x}{y}")
        for x in (-0.1, 0.1)
        for y in (-0.08, 0.08)
    ]
    start = pin.exp3(np.array([0.2, -0.1, 0.3]))
    q = np.concatenate([turn @ (0, 0, 0.08), pin.Quaternion(turn @ start).coeffs()])
    v = np.concatenate([start.T @ (0.8, 0.3, -0.5), (0.5, -0.4, 1.0)])
    return cp.Scene(replace(box, model=model), contacts=[corners[i] for i in order]), q, v


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_turned_world_and_another_order_move_the_same(
    scheme: cp.simulation.ContactScheme,
) -> None:
    turn = pin.exp3(np.array([0.7, -0.4, 1.1]))
    ends = []
    for R, order in ((np.eye(3), (0, 1, 2, 3)), (turn, (0, 1, 2, 3)), (turn, (2, 0, 3, 1))):
        run = cp.simulate(*dropped(R, order), duration=0.15, dt=1e-3, integrator=scheme)
        assert run.status.ok, run.reason
        ends.append(R.T @ run.q[-1, :3])
        assert np.diff(run.energy.contact).max() < (1e-3 if scheme.penetrates_at_rest else 1e-9)
    # Coulomb's law leaves corners that slide together open by a little
    assert_allclose(ends[1:], ends[:1] * 2, atol=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("scheme", HARD)
def test_events_change_what_may_touch(scheme: cp.simulation.ContactScheme) -> None:
    """The floor is taken away; or one with more friction comes, or one that is too high."""
    scene, q, v = dropped(np.eye(3))
    robot, corners = scene.robot, scene.contacts

    def run(contacts: Sequence[FrictionalContact]) -> cp.Trajectory:
        event = cp.Event(name="changes", at=0.1005, scene=cp.Scene(robot, contacts=contacts))
        return cp.simulate(scene, q, v, duration=0.3, dt=1e-3, events=[event], integrator=scheme)

    alone = cp.simulate(scene, q, v, duration=0.3, dt=1e-3, integrator=scheme)
    gone = run(())
    assert gone.status.ok, gone.reason
    assert gone.q[-1, 2] < 0
    rough = run([replace(corner, friction=2.0) for corner in corners])
    assert rough.status.ok, rough.reason
    assert rough.q[-1, 2] > 0.04
    assert rough.q[-1, 0] < alone.q[-1, 0] - 0.005
    ball = FrictionalContact("box", Ball(0.15), friction=0.5, name="ball")
    high = run([*corners, ball])
    assert not high.status.ok
    assert "ball penetrates by 0." in high.reason


def test_stops_that_exclude_each_other_are_refused() -> None:
    arm = cp.model.pendulum()
    model = pin.Model(arm.model)
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = 0.5, -0.5
    with pytest.raises(cp.InvalidArgument, match=r"lower limit 0\.5 above the upper one, -0\.5"):
        cp.Scene(replace(arm, model=model), contacts=[JointLimit(arm.joints[0])])


@pytest.mark.parametrize("sides", [4, 8])
@pytest.mark.parametrize("scheme", [StewartTrinkle, Moreau])
def test_polygons_are_off_by_what_they_are_off_a_circle(
    scheme: type[StewartTrinkle | Moreau], sides: int
) -> None:
    """In every step, however redundant the contacts are that slide."""
    half = Box(0.1, 0.08, 0.05)
    box = free_box(size=(0.2, 0.16, 0.1))
    scene = cp.Scene(box, contacts=[FrictionalContact("box", half, friction=0.4)])
    q, v = np.array([0, 0, 0.06, *UPRIGHT]), np.array([0.8, 0.3, -0.5, 0.5, -0.4, 1.0])
    for little in (0.0, 1e-13, 5e-13):  # what rounding does to a motion, and more
        run = cp.simulate(
            scene, q, v + little, duration=0.2, dt=1e-3, integrator=scheme(Lemke(sides))
        )
        assert run.status.ok, run.reason
        assert run.contact is not None
        assert run.contact.natural.max() < np.sin(np.pi / sides) / 2


def test_polygons_that_were_not_answered_end_a_motion() -> None:
    """However far polygons are from circles by themselves: one pivot is no answer."""
    scene, q = ball_scene(), np.array([0, 0, 0.05, *UPRIGHT])
    v = np.array([1.0, 0, 0, 0, 0, 0])
    assert cp.simulate(scene, q, v, duration=0.01, integrator=Moreau(Lemke(4))).status.ok
    with pytest.raises(cp.errors.StepFailed, match="Lemke"):
        cp.simulate(scene, q, v, duration=0.01, integrator=Moreau(Lemke(4, max_iterations=1)))
