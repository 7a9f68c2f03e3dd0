"""Driven rows beside contacts that open: a plate pushes a box, and lets it slide on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import condyn_pin as cp
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
from condyn_pin.stepping import EventDriven

GRAVITY, FRICTION = 9.81, 0.4
PLATE, BOX, SLIDE = 1.0, 2.0, 1e-3  # [kg]
TO_ROUNDING = ADMM(polish=True)  # a step is right to 1e-8 without
SCHEMES = [cp.StewartTrinkle(TO_ROUNDING), cp.Moreau(TO_ROUNDING)]
LOCATED = EventDriven()
WALL = FrictionalContact(
    "plate_frame", on=Plane(normal=(-1, 0, 0), height=-0.1), friction=0.0, name="wall"
)


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


@pytest.mark.long
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


@pytest.mark.long
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
    scene = pushing(Polynomial((0.0, 1.0)), WALL)
    run = cp.simulate(
        scene, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], duration=0.2, dt=1e-3, integrator=scheme
    )
    assert run.status.name == "FAILED"
    assert run.t[-1] == pytest.approx(0.1, abs=1e-9)  # the last sample that touches
    assert "wall" in run.reason
    assert "neither can move away" in run.reason


@pytest.mark.long
def test_a_batch_moves_as_single_motions_do():
    scene = pushing(Polynomial((0.0, 0.0, 1.5)))
    q, v = np.zeros((2, 3)), np.zeros((2, 3))
    q[1, 1] = 0.01
    batch = cp.simulation.simulate_batch(scene, q, v, duration=0.1, dt=1e-3, record=1)
    for i in range(2):
        run = cp.simulate(scene, q[i], v[i], duration=0.1, dt=1e-3)
        assert np.array_equal(batch[i].q, run.q)


@pytest.mark.long
def test_event_driven_pushes_a_box_to_rounding():
    """s = a t^2 / 2, as above, with no error of a step."""
    a, T = 3.0, 0.5
    scene = pushing(Polynomial((0.0, 0.0, a / 2)))
    run = cp.simulate(scene, np.zeros(3), np.zeros(3), duration=T, dt=1e-2, integrator=LOCATED)
    force = (PLATE + BOX + SLIDE) * a + FRICTION * BOX * GRAVITY
    assert run.q[-1, :2] == pytest.approx(2 * [a * T**2 / 2], abs=1e-13)
    assert run.forces["plate"][:, 0] == pytest.approx(force, abs=1e-11)
    assert run.energy.driven[-1] == pytest.approx(force * a * T**2 / 2, abs=1e-11)
    assert run.energy.contact[-1] == pytest.approx(
        -FRICTION * BOX * GRAVITY * a * T**2 / 2, abs=1e-11
    )
    assert np.abs(run.energy.error).max() < 1e-12


@pytest.mark.long
def test_event_driven_locates_where_the_box_stops():
    v = 2.0
    scene = pushing(Polynomial((0.0, v, -3.0)))
    run = cp.simulate(scene, np.zeros(3), [v, v, 0.0], duration=0.6, dt=1e-2, integrator=LOCATED)
    stop = v / (FRICTION * GRAVITY) * (1 + SLIDE / BOX)
    assert run.q[-1, 1] == pytest.approx(v * stop / 2, abs=1e-12)
    (stuck,) = [each for each in run.run.happened if each.name == "stick of floor"]
    assert stuck.t == pytest.approx(stop, abs=1e-12)
    assert run.forces["plate"][-1, 0] == pytest.approx(-6.0 * PLATE, abs=1e-12)
    assert np.abs(run.energy.error).max() < 1e-12


def test_the_work_of_a_motor_in_an_impact_is_part_of_the_balance():
    """A plate at V meets a box at rest: the motor gives m V^2, and half of it is lost."""
    V, gap, m = 2.0, 0.3, BOX + SLIDE
    scene = pushing(Polynomial((0.0, V)))
    run = cp.simulate(
        scene, [0.0, gap, 0.0], [V, 0.0, 0.0], duration=0.4, dt=1e-2, integrator=LOCATED
    )
    (struck,) = run.run.happened
    assert struck.t == pytest.approx(gap / V, abs=1e-13)
    assert struck.energy_lost == pytest.approx(m * V**2 / 2, abs=1e-12)
    assert struck.driven == pytest.approx(m * V**2, abs=1e-12)
    pushed_on = FRICTION * BOX * GRAVITY * V * (0.4 - gap / V)
    assert run.energy.driven[-1] == pytest.approx(m * V**2 + pushed_on, abs=1e-11)
    assert np.abs(run.energy.error).max() < 1e-11


@pytest.mark.long
@pytest.mark.parametrize("record", [1, 7])
@pytest.mark.parametrize("path", [Polynomial((0.0, 2.0)), Sine(0.3, 1.0)])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_steps_book_what_a_motor_does_in_an_impact(scheme, path, record):
    """l_b . (J v + J v+) / 2 in every step, recorded or not: the balance holds to rounding."""
    scene = pushing(path)
    s, rate, _ = np.ravel(path(0.0))
    run = cp.simulate(
        scene, [s, s + 0.15, 0.0], [rate, 0.0, 0.0], duration=0.4, dt=1e-3, integrator=scheme,
        record=record,
    )  # fmt: skip
    assert np.ptp(run.energy.driven) > 4.0
    assert np.abs(run.energy.error).max() < 1e-12
    if isinstance(path, Polynomial):  # the box takes m V^2 in the impact, and friction after it
        work = (BOX + SLIDE) * 4.0 + FRICTION * BOX * GRAVITY * (0.4 * 2.0 - 0.15)
        assert run.energy.driven[-1] == pytest.approx(work, rel=2e-3)
    one = cp.step(scene.at(0.0), run.q[0], run.v[0], dt=1e-3, integrator=scheme)
    again = cp.simulate(scene, run.q[0], run.v[0], duration=1e-3, dt=1e-3, integrator=scheme)
    assert one.driven_work == pytest.approx(again.energy.driven[-1], abs=1e-14)


def test_what_a_motor_did_stays_in_the_balance_when_it_lets_go(tmp_path):
    path = Polynomial((0.0, 2.0))
    scene = pushing(path)
    free = replace(scene, constraints=())
    run = cp.simulate(
        scene, [0.0, 0.05, 0.0], [2.0, 0.0, 0.0], duration=0.2, dt=1e-3, record=3,
        events=[cp.Event(name="let go", at=0.1, scene=free)], integrator=SCHEMES[0],
    )  # fmt: skip
    assert run.energy.driven[-1] == pytest.approx(run.energy.driven[35], abs=1e-12)
    assert run.energy.driven[-1] > 8.0
    assert np.abs(run.energy.error).max() < 1e-12
    assert "drives" in str(run)
    run.save(tmp_path / "run.npz")
    again = cp.Trajectory.load(tmp_path / "run.npz")
    assert np.array_equal(again.energy.driven, run.energy.driven)
    assert np.array_equal(again.contact.codes, run.contact.codes)


@pytest.mark.long
def test_a_batch_books_what_motors_do(tmp_path, engine):
    """m V^2 of a plate that meets a box, in place of lam . s' at samples."""
    scene = pushing(Polynomial((0.0, 2.0)))
    q, v = np.array([[0.0, 0.05, 0.0]]), np.array([[2.0, 0.0, 0.0]])
    how = {"duration": 0.1, "dt": 1e-3, "integrator": SCHEMES[0], "record": 10}
    batch = cp.simulate_batch(scene, q, v, **how, **engine.batches)
    assert batch[0].energy.driven[-1] > 8.0
    assert np.abs(batch[0].energy.error).max() < 1e-12
    assert batch.energy_error.max() < 1e-12
    batch.save(tmp_path / "batch.npz")
    again = cp.simulation.BatchTrajectory.load(tmp_path / "batch.npz")
    assert np.array_equal(again[0].energy.driven, batch[0].energy.driven)


@pytest.mark.long
@pytest.mark.parametrize("path", [Polynomial((0.0, 2.0)), Sine(0.1, 3.0)])
def test_friction_turns_where_a_driven_body_does(path):
    """G is zero, at a constant speed too; a reversal is an event, behind which the force is new."""
    floor = FrictionalContact("box_frame", friction=FRICTION, name="floor")
    scene = cp.Scene(pushed(), [Driven(HeldJoint("along"), path)], contacts=[floor])
    run = cp.simulate(scene, *scene.state(), duration=0.4, dt=1e-2, integrator=LOCATED)
    s = np.array([path(t) for t in run.t])[:, :, 0]
    friction = FRICTION * BOX * GRAVITY
    moves = np.abs(s[:, 1]) > 1e-6
    force = (BOX + SLIDE) * s[:, 2] + friction * np.sign(s[:, 1])
    assert run.forces["along"][moves, 0] == pytest.approx(force[moves], abs=1e-11)
    turns = [each.t for each in run.run.happened if each.name == "reversal of floor"]
    assert turns == pytest.approx([1 / 12, 3 / 12] if len(turns) else [], abs=1e-10)
    assert len(turns) == 2 * isinstance(path, Sine)
    way = 2.0 * 0.4 if isinstance(path, Polynomial) else 0.3 + 0.1 * (1 + np.sin(2.4 * np.pi))
    assert run.energy.contact[-1] == pytest.approx(-friction * way, rel=1e-4)
    assert not any(before == "open" for each in run.run.happened for _, before, _ in each.modes)


def driven_bar(path, torque=0.5):
    bar = cp.model.four_bar()
    motor = Driven(HeldJoint("crank", float(bar.postures["open"][0])), path)
    joint = list(bar.model.names)[-1]
    return cp.Scene(bar, [*bar.loops, motor], contacts=[JointFriction(joint, torque)])


def torque_of(scene, q, v, a, torque=0.5):
    """The crank's by virtual power: v . (M a + h - friction) / v_crank."""
    model = scene.robot.model
    tau = pin.rnea(model, model.createData(), q, v, a)
    tau[-1] += torque * np.sign(v[-1])
    return v @ tau / v[0]


def test_a_driven_four_bar_with_dry_friction_needs_the_torque_of_inverse_dynamics():
    scene = driven_bar(Sine(0.4, 0.7))
    run = cp.simulate(scene, *scene.state(), duration=0.6, dt=4e-3, integrator=LOCATED)
    assert [each.name for each in run.run.happened] == ["reversal of rocker/friction"]
    off = [
        motor[0] - torque_of(scene, q, v, a)
        for q, v, a, motor in zip(run.q, run.v, run.a, run.forces["crank"], strict=True)
        if abs(v[0]) > 1e-6
    ]
    assert len(off) >= len(run.t) - 2
    assert np.abs(off).max() < 1e-9
    assert np.abs(run.energy.error).max() < 1e-8


@pytest.mark.long
@pytest.mark.parametrize("scheme", SCHEMES)
def test_one_step_of_a_plate_that_pushes_a_box(scheme):
    """The velocity of StewartTrinkle is that of the middle of the step before."""
    a, t, dt = 3.0, 0.2, 1e-3
    late = 0.0 if isinstance(scheme, cp.Moreau) else dt / 2
    scene = pushing(Polynomial((0.0, 0.0, a / 2)))
    q, v = (x * np.array([1.0, 1.0, 0.0]) for x in (a * t**2 / 2, a * (t - late)))
    found = cp.step(scene.at(t), q, v, dt=dt, integrator=scheme)
    assert found.status.ok
    assert found.q[:2] == pytest.approx(a * (t + dt) ** 2 / 2, abs=1e-12)
    assert found.v[:2] == pytest.approx(a * (t + dt - late), abs=1e-12)
    force = (PLATE + BOX + SLIDE) * a + FRICTION * BOX * GRAVITY
    assert found.forces["plate"] == pytest.approx([force], abs=1e-9)
    assert found.forces["side"][2] == pytest.approx(force - PLATE * a, abs=1e-9)
    assert max(found.constraint_error, found.violation, found.dynamics_error) < 1e-12


@pytest.mark.long
@pytest.mark.parametrize("scheme", SCHEMES)
def test_steps_one_by_one_are_those_of_a_motion(scheme):
    scene, dt = driven_bar(Sine(0.4, 0.7)), 1e-3
    q, v = scene.state()
    run = cp.simulate(scene, q, v, duration=5 * dt, dt=dt, integrator=scheme)
    for k in range(5):
        one = cp.step(scene.at(k * dt), q, v, dt=dt, integrator=scheme)
        assert one.status.ok
        assert one.violation < 1e-12
        q, v = one.q, one.v
        assert q == pytest.approx(run.q[k + 1], abs=1e-13)
        assert v == pytest.approx(run.v[k + 1], abs=1e-11)


def test_a_step_of_a_driven_four_bar_comes_to_inverse_dynamics():
    """By Moreau, to that in the middle of the step; of first order in dt."""
    scene, t, off = driven_bar(Sine(0.4, 0.7)), 0.1, []
    bare, torque = replace(scene, contacts=()), 0.0
    for dt in (4e-3, 2e-3):
        one = cp.step(scene.at(t), *scene.at(t).state(), dt=dt, integrator=cp.Moreau(TO_ROUNDING))
        q, v = scene.at(t + dt / 2).state()
        torque = torque_of(scene, q, v, cp.solve(bare.at(t + dt / 2), q, v, np.zeros(3)).a)
        off.append(abs(one.forces["crank"][0] - torque))
    assert off[1] < 0.02 * abs(torque)
    assert off[1] < 0.6 * off[0]


def test_a_step_of_driven_rows_needs_one_time():
    scene, unsupported = pushing(Polynomial((0.0, 0.0, 1.5))), cp.errors.UnsupportedConstraint
    with pytest.raises(unsupported, match=r"plate follows a path of time: scene\.at\(t\)"):
        cp.step(scene, np.zeros(3), np.zeros(3), dt=1e-3)
    two = replace(
        scene, constraints=[*scene.at(0.1).constraints, Driven(HeldJoint("box"), Sine(0.1), 0.2)]
    )
    with pytest.raises(unsupported, match=r"at 0\.1, 0\.2 s: one time is needed"):
        cp.step(two, np.zeros(3), np.zeros(3), dt=1e-3)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_step_into_a_wall_is_refused(scheme):
    scene = pushing(Polynomial((0.0, 1.0)), WALL).at(0.0999)
    with pytest.raises(cp.errors.StepFailed, match=r"wall.*neither can move away"):
        cp.step(scene, [0.0999, 0.0, 1.0], [1.0, 0.0, 0.0], dt=1e-3, integrator=scheme)


def test_event_driven_ends_at_a_wall():
    scene = pushing(Polynomial((0.0, 1.0)), WALL)
    run = cp.simulate(
        scene, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], duration=0.2, dt=1e-2, integrator=LOCATED
    )
    assert run.status.name == "FAILED"
    assert "wall at t = 0.1 s" in run.reason
    assert "neither can move away" in run.reason


@pytest.mark.long
def test_the_work_in_an_impact_is_in_the_file(tmp_path):
    scene = pushing(Polynomial((0.0, 2.0)))
    run = cp.simulate(
        scene, [0.0, 0.1, 0.0], [2.0, 0.0, 0.0], duration=0.1, dt=1e-2, integrator=LOCATED
    )
    run.save(tmp_path / "run.npz")
    again = cp.Trajectory.load(tmp_path / "run.npz")
    assert again.run.happened == run.run.happened
    assert np.array_equal(again.energy.driven, run.energy.driven)
