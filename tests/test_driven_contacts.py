"""Driven rows beside contacts that open: a plate pushes a box, and lets it slide on."""

from __future__ import annotations

import numpy as np
import pytest

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin.constraints import (
    Driven,
    FrictionalContact,
    HeldJoint,
    JointFriction,
    Plane,
    Polynomial,
    Sine,
)
from condyn_pin.contact import ADMM
from condyn_pin.simulation import INTEGRATORS, trajectory_derivatives

GRAVITY, FRICTION = 9.81, 0.4
PLATE, BOX, SLIDE = 1.0, 2.0, 1e-3  # [kg]
TO_ROUNDING = ADMM(polish=True)  # a step is right to 1e-8 without
SCHEMES = [cp.StewartTrinkle(TO_ROUNDING), cp.Moreau(TO_ROUNDING)]


def pushed() -> cp.Robot:
    """A plate on a slide along x, and a box that moves along x and z."""
    model = pin.Model()

    def body(parent, joint, name, mass):
        index = model.addJoint(parent, joint, pin.SE3.Identity(), name)
        inertia = pin.Inertia(mass, np.zeros(3), 0.01 * mass * np.eye(3))
        model.appendBodyToJoint(index, inertia, pin.SE3.Identity())
        model.addFrame(
            pin.Frame(f"{name}_frame", index, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
        )
        return index

    body(0, pin.JointModelPX(), "plate", PLATE)
    body(body(0, pin.JointModelPX(), "along", SLIDE), pin.JointModelPZ(), "box", BOX)
    return cp.Robot("pushed", model)


def pushing(path, *contacts: FrictionalContact) -> cp.Scene:
    floor = FrictionalContact("box_frame", friction=FRICTION, name="floor")
    side = FrictionalContact(
        "box_frame", on="plate_frame", on_shape=Plane(normal=(1, 0, 0)), friction=0.0, name="side"
    )
    motor = Driven(HeldJoint("plate"), path)
    return cp.Scene(pushed(), [motor], contacts=contacts or (floor, side))


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_plate_pushes_a_box_with_friction(scheme):
    """s = a t^2 / 2: the motor gives (M + m) a + mu m g, and its work is that times s."""
    a, T = 3.0, 0.5
    scene = pushing(Polynomial((0.0, 0.0, a / 2)))
    run = cp.simulate(scene, np.zeros(3), np.zeros(3), duration=T, dt=1e-3, integrator=scheme)
    assert run.q[-1, :2] == pytest.approx(2 * [a * T**2 / 2], abs=1e-12)
    force = (PLATE + BOX + SLIDE) * a + FRICTION * BOX * GRAVITY
    assert run.forces["plate"][2:, 0] == pytest.approx(force, abs=1e-9)
    assert run.forces["side"][2:, 2] == pytest.approx(force - PLATE * a, abs=1e-9)
    assert run.violation.max() < 1e-12
    # the first step of StewartTrinkle goes from rest to the mean velocity, half of a dt
    share = 1e-12 if isinstance(scheme, cp.Moreau) else 2e-3
    assert run.energy.driven[-1] == pytest.approx(force * a * T**2 / 2, rel=share)
    assert np.abs(run.energy.error).max() < share * run.energy.driven[-1] + 1e-12


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_motor_feels_the_friction_of_what_it_moves(scheme):
    """G is zero along a driven row, and the contact slides there all the same."""
    a = 3.0
    floor = FrictionalContact("box_frame", friction=FRICTION, name="floor")
    motor = Driven(HeldJoint("along"), Polynomial((0.0, 0.0, a / 2)))
    scene = cp.Scene(pushed(), [motor], contacts=[floor])
    run = cp.simulate(scene, np.zeros(3), np.zeros(3), duration=0.2, dt=1e-3, integrator=scheme)
    friction = FRICTION * BOX * GRAVITY
    assert run.forces["along"][2:, 0] == pytest.approx((BOX + SLIDE) * a + friction, abs=1e-9)
    assert run.forces["floor"][2:, 0] == pytest.approx(-friction, abs=1e-9)
    assert run.energy.contact[-1] == pytest.approx(-friction * a * 0.2**2 / 2, rel=1e-2)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_plate_that_slows_down_lets_the_box_slide_on(scheme):
    """The box comes to rest v^2 / (2 mu g) from there, with an error that falls with dt."""
    v = 2.0
    scene = pushing(Polynomial((0.0, v, -3.0)))
    errors = []
    for dt in (2e-3, 1e-3):
        run = cp.simulate(scene, np.zeros(3), [v, v, 0.0], duration=0.6, dt=dt, integrator=scheme)
        errors.append(abs(run.q[-1, 1] - v**2 / (2 * FRICTION * GRAVITY) * (1 + SLIDE / BOX)))
        assert run.q[-1, 0] == pytest.approx(v * 0.6 - 3.0 * 0.6**2, abs=1e-12)
        assert run.forces["side"][-1, 2] == 0.0
        assert run.forces["plate"][-1, 0] == pytest.approx(-6.0 * PLATE, abs=1e-9)
    assert errors[0] < 2 * v * 2e-3
    assert errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_driven_four_bar_with_dry_friction_in_its_rocker(scheme):
    """G is zero: the rocker goes where the crank takes it, and takes what friction does off it."""
    bar = cp.model.four_bar()
    crank = float(bar.postures["open"][0])
    motor = Driven(HeldJoint("crank", crank), Sine(0.4, 0.7))
    joint = list(bar.model.names)[-1]
    torque, errors = 0.5, []
    for dt in (2e-3, 1e-3):
        scene = cp.Scene(bar, [*bar.loops, motor], contacts=[JointFriction(joint, torque)])
        run = cp.simulate(scene, *scene.state(), duration=0.3, dt=dt, integrator=scheme)
        assert run.q[-1, 0] == pytest.approx(crank + Sine(0.4, 0.7)(run.t[-1])[0][0], abs=1e-9)
        assert run.energy.contact[-1] < -0.01
        errors.append(np.abs(run.energy.error).max())
    assert errors[0] < 0.06 * np.ptp(run.energy.driven)
    assert errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_path_into_a_wall_is_refused_there(scheme):
    wall = FrictionalContact(
        "plate_frame", on=Plane(normal=(-1, 0, 0), height=-0.1), friction=0.0, name="wall"
    )
    scene = pushing(Polynomial((0.0, 1.0)), wall)
    run = cp.simulate(
        scene, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], duration=0.2, dt=1e-3, integrator=scheme
    )
    assert run.status.name == "FAILED"
    assert run.t[-1] == pytest.approx(0.1, abs=1e-9)  # the last sample that touches
    assert "wall" in run.reason
    assert "nothing gives way" in run.reason


def test_a_batch_moves_as_single_motions_do():
    scene = pushing(Polynomial((0.0, 0.0, 1.5)))
    q, v = np.zeros((2, 3)), np.zeros((2, 3))
    q[1, 1] = 0.01
    batch = cp.simulation.simulate_batch(scene, q, v, duration=0.1, dt=1e-3, record=1)
    for i in range(2):
        run = cp.simulate(scene, q[i], v[i], duration=0.1, dt=1e-3)
        assert np.array_equal(batch[i].q, run.q)


def test_what_holds_its_rows_at_rest_says_so():
    scene = pushing(Polynomial((0.0, 0.0, 1.5)))
    unsupported = cp.errors.UnsupportedConstraint
    with pytest.raises(unsupported, match="plate"):
        cp.step(scene, np.zeros(3), np.zeros(3), dt=1e-3)
    with pytest.raises(unsupported, match=r"plate.*use StewartTrinkle\(\)"):
        cp.simulate(
            scene, np.zeros(3), np.zeros(3), duration=0.1,
            integrator=INTEGRATORS["eventdriven"](),
        )  # fmt: skip
    run = cp.simulate(scene, np.zeros(3), np.zeros(3), duration=0.01, dt=1e-3)
    with pytest.raises(unsupported, match="plate"):
        trajectory_derivatives(run)
