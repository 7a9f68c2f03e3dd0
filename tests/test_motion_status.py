"""A status of a motion is ok only within stated limits; else it names what, when and how far."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box, JointLimit
from condyn_pin.model import Spring
from condyn_pin.simulation import (
    DormandPrince,
    ImplicitMidpoint,
    MotionLimits,
    NoDrift,
    Rattle,
    RunStatus,
    SemiImplicitEuler,
    simulate_batch,
)
from condyn_pin.simulation.measures import hermite_weights, work
from condyn_pin.stepping import Moreau

ONE = pin.SE3.Identity()


def bar():
    robot = cp.model.four_bar()
    return cp.Scene(robot, robot.loops)


def cart(light):
    """A cart of `light` kg under a pendulum of 2 kg and 0.5 m."""
    model = pin.Model()
    j = model.addJoint(0, pin.JointModelPX(), ONE, "cart")
    model.appendBodyToJoint(j, pin.Inertia.FromSphere(light, 0.05), ONE)
    j = model.addJoint(j, pin.JointModelRY(), ONE, "pole")
    model.appendBodyToJoint(j, pin.Inertia(2.0, np.array([0.5, 0, 0]), np.zeros((3, 3))), ONE)
    return cp.Scene(cp.Robot("cart", model))


def oscillator(damping, stiffness=400.0):
    model = pin.Model()
    j = model.addJoint(0, pin.JointModelPX(), ONE, "x")
    model.appendBodyToJoint(j, pin.Inertia.FromSphere(1.0, 0.05), ONE)
    model.damping[:] = damping
    return cp.Scene(cp.Robot("oscillator", model, springs=[Spring("x", stiffness, 0.0)]))


def limited_bar():
    """The four-bar with a stop of its crank 0.2 rad from where it begins."""
    robot = cp.model.four_bar()
    q, v = cp.Scene(robot, robot.loops).state()
    model = pin.Model(robot.model)
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = q - 9.0, q + 9.0
    model.lowerPositionLimit[0], model.upperPositionLimit[0] = q[0] - 0.2, q[0] + 0.2
    return replace(robot, model=model), q, v


def sliding_box():
    box = Box(0.1, 0.1, 0.1)
    scene = cp.Scene(cp.model.free_box(), contacts=[cp.FrictionalContact("box", box, friction=0.5)])
    q, v = scene.state()
    v[0], v[5] = 1.0, 2.0
    return scene, q, v


# constraints ---------------------------------------------------------------------------------


def test_loops_that_come_open_are_not_ok():
    scene = bar()
    run = cp.simulate(scene, *scene.state(), duration=1.0, dt=0.5)
    assert run.status is RunStatus.OPENED
    assert run.run.status is RunStatus.FINISHED
    assert "coupler_rocker is open by" in run.reason
    assert "at t = 1 s" in run.reason
    assert "smaller dt" in run.reason
    assert run.notices[0].startswith("opened: ")
    assert sum("is open by" in notice for notice in run.notices) == 1


def test_limits_are_those_of_the_user():
    scene = bar()
    state = scene.state()

    def by(**limits):
        return cp.simulate(
            scene, *state, duration=0.3, dt=1e-2, drift=NoDrift(),
            integrator=cp.simulation.ExplicitEuler(), limits=MotionLimits(**limits),
        )  # fmt: skip

    wide = by(violation=np.inf, constraint_velocity=np.inf, energy=np.inf)
    gap = wide.violation.max()
    assert wide.status.ok
    assert gap > 1e-4
    rest = {"constraint_velocity": np.inf, "energy": np.inf}
    assert by(violation=1.01 * gap, **rest).status.ok
    assert by(violation=0.99 * gap, **rest).status is RunStatus.OPENED
    speed = wide.constraint_velocity.max()
    narrow = by(violation=np.inf, constraint_velocity=0.99 * speed, energy=np.inf)
    assert narrow.status is RunStatus.OPENED
    assert "move apart" in narrow.reason


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, "a", True])
def test_limits_are_positive_numbers(value):
    with pytest.raises(cp.errors.InvalidArgument, match=r"violation = .*: a number > 0"):
        MotionLimits(violation=value)
    with pytest.raises(cp.errors.InvalidArgument, match="limits = "):
        cp.simulate(bar(), *bar().state(), duration=1e-2, limits=value)


@pytest.mark.long
def test_a_start_that_was_left_open_is_not_blamed_on_the_motion():
    scene = bar()
    q, v = scene.state()
    q[0] += 0.05
    run = cp.simulate(
        scene, q, v, duration=1.0, drift=cp.Baumgarte.critical(20.0), close_start=False
    )
    assert run.violation[0] > 1e-2
    assert run.status.ok, run.reason


@pytest.mark.long
def test_constraints_that_give_way_by_choice_are_ok():
    scene = bar()
    run = cp.simulate(scene, *scene.state(), duration=0.3, solver=cp.dynamics.Soft())
    assert run.violation.max() > 1e-4
    assert run.status.ok, run.reason


# contacts and stops --------------------------------------------------------------------------


def test_a_joint_past_a_stop_of_the_scene():
    robot, q, v = limited_bar()
    scene = cp.Scene(robot, robot.loops, contacts=[JointLimit("crank")])
    run = cp.simulate(scene, q, v, duration=0.5, integrator=Moreau())
    assert run.status.ok
    assert not any("has no stops" in notice for notice in run.notices)
    past = [notice for notice in run.notices if "although the scene has stops" in notice]
    assert len(past) == 1
    assert past[0].startswith("crank is")
    narrow = cp.simulate(
        scene, q, v, duration=0.5, integrator=Moreau(), limits=MotionLimits(penetration=1e-6)
    )
    assert narrow.status is RunStatus.PENETRATED
    assert "crank/" in narrow.reason
    assert "StewartTrinkle" in narrow.reason


@pytest.mark.long
def test_a_limit_without_a_stop_is_named_with_its_cure():
    robot, q, v = limited_bar()
    run = cp.simulate(cp.Scene(robot, robot.loops), q, v, duration=0.5)
    said = [notice for notice in run.notices if "has no stops there" in notice]
    assert len(said) == 1
    assert said[0].startswith("crank is")


def test_a_contact_that_is_deep():
    ball = cp.FrictionalContact("ball", Ball(0.05), friction=0.5)
    scene = cp.Scene(cp.model.free_ball(mass=1.0, radius=0.05), contacts=[ball])
    q, v = scene.state()
    q[2] = 0.35
    run = cp.simulate(
        scene, q, v, duration=0.5, dt=1e-2, integrator=Moreau(),
        limits=MotionLimits(penetration=1e-3),
    )  # fmt: skip
    depth = -run.gaps["ball"].min()
    assert run.status is RunStatus.PENETRATED
    assert f"ball is {depth:.3g} m" in run.reason
    # half a step of the fall, as its docstring has it
    assert cp.simulate(scene, q, v, duration=0.5, dt=1e-2, integrator=Moreau()).status.ok


# energy --------------------------------------------------------------------------------------


def test_a_motion_that_loses_its_energy_is_not_ok():
    scene, q, v = cart(2e-3), np.array([0.0, 0.3]), np.zeros(2)
    run = cp.simulate(scene, q, v, duration=3.0)
    assert run.status is RunStatus.UNBALANCED
    assert "appeared or vanished without work" in run.reason
    assert " % from t = " in run.reason
    assert sum("without work" in notice for notice in run.notices) == 1
    assert cp.simulate(scene, q, v, duration=3.0, integrator=DormandPrince()).status.ok


@pytest.mark.long
def test_energy_of_a_damped_motion_is_as_accurate_as_the_motion():
    scene, rate = oscillator(4.0), np.sqrt(396.0)
    run = cp.simulate(
        scene, np.array([0.1]), np.zeros(1), duration=1.0, dt=1e-2, integrator=DormandPrince()
    )
    t = run.t
    right = 0.1 * np.exp(-2 * t) * (np.cos(rate * t) + 2 / rate * np.sin(rate * t))
    assert np.abs(run.q[:, 0] - right).max() < 1e-9
    assert np.abs(run.energy.error).max() < 1e-8


@pytest.mark.long
@pytest.mark.parametrize("record", [3, 10, 30, 100])
def test_few_samples_are_not_blamed_on_the_energy(record):
    """The work of the damper over few samples is not known: no energy is said to be lost."""
    run = cp.simulate(
        oscillator(4.0), np.array([0.1]), np.zeros(1), lambda t, q, v: 10 * np.sin(40 * t + q),
        duration=1.0, record=record,
    )  # fmt: skip
    assert run.status.ok, run.reason
    assert not any("without work" in notice for notice in run.notices)
    full = cp.simulate(
        oscillator(4.0), np.array([0.1]), np.zeros(1), lambda t, q, v: 10 * np.sin(40 * t + q),
        duration=1.0,
    )  # fmt: skip
    off = (
        run.energy.work[-1]
        + run.energy.damping[-1]
        - full.energy.work[-1]
        - full.energy.damping[-1]
    )
    assert abs(off) <= run.energy.doubt[-1] + full.energy.doubt[-1]


@given(
    st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8), st.integers(4, 9),
    st.floats(-0.2, 0.2),
)  # fmt: skip
def test_quadrature_is_exact_for_degree_seven(coefficients, count, uneven):
    t = np.linspace(0.0, 1.0, count)
    t += uneven * t * (1 - t)
    power = np.polynomial.Polynomial(coefficients)
    done = work(t, power(t), power.deriv()(t))
    right = power.integ()(t) - power.integ()(0.0)
    np.testing.assert_allclose(done, right, atol=1e-11)


@pytest.mark.long
def test_quadrature_beside_an_event_is_no_difference_of_rounding():
    t = np.sort(np.concatenate((np.linspace(0.0, 1.0, 11), [0.35, 0.35 + 1e-11])))
    for weights in hermite_weights(t):
        assert np.abs(weights).max() < 1.0
    assert abs(work(t, np.sin(t), np.cos(t))[-1] - (1 - np.cos(1.0))) < 1e-6


# estimated error -----------------------------------------------------------------------------


def apart(run, q):
    from condyn_pin.simulation.motion_status import Points

    return Points(run.scene.robot.model).apart(run.q[-1], q)


@pytest.mark.parametrize(
    ("integrator", "dt"),
    [(cp.RungeKutta4(), 1e-3), (Rattle(), 2e-3), (SemiImplicitEuler(), 1e-3)],
    ids=repr,
)
def test_estimated_error_has_the_size_of_the_error(integrator, dt):
    scene = bar()
    q, v = scene.state()
    right = cp.simulate(scene, q, v, duration=1.0, integrator=DormandPrince(1e-11, 1e-13), dt=1e-2)
    run = cp.simulate(scene, q, v, duration=1.0, dt=dt, integrator=integrator)
    assert 0.05 < run.error / apart(run, right.q[-1]) < 20


@pytest.mark.long
def test_estimated_error_falls_with_the_order():
    scene = bar()
    errors = [
        cp.simulate(scene, *scene.state(), duration=1.0, dt=dt, integrator=Rattle()).error
        for dt in (2e-3, 1e-3)
    ]
    assert 3 < errors[0] / errors[1] < 5.5


@pytest.mark.long
def test_free_flight_has_no_error_and_adaptive_steps_none_to_estimate():
    scene = cp.Scene(cp.model.free_ball(mass=1.0, radius=0.05))
    q, v = scene.state()
    v[0] = 1.0
    assert cp.simulate(scene, q, v, duration=0.5).error < 1e-12
    assert np.isnan(cp.simulate(scene, q, v, duration=0.5, integrator=DormandPrince()).error)


@pytest.mark.long
def test_a_fast_top_in_coarse_steps_says_how_far_it_is_off():
    model = pin.Model()
    j = model.addJoint(0, pin.JointModelFreeFlyer(), ONE, "top")
    inertia = pin.Inertia(1.0, np.array([0, 0, 0.3]), np.diag([0.01, 0.01, 0.004]))
    model.appendBodyToJoint(j, inertia, ONE)
    model.addFrame(pin.Frame("tip", j, 0, ONE, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("nail", 0, 0, ONE, pin.FrameType.OP_FRAME))
    scene = cp.Scene(cp.Robot("top", model), [cp.Loop("tip", "nail", "ball")])
    q = np.r_[0, 0, 0, 0, np.sin(0.25), 0, np.cos(0.25)]
    v = np.r_[np.zeros(5), 500.0]
    run = cp.simulate(scene, q, v, duration=1.0, dt=5e-4, integrator=ImplicitMidpoint())
    said = [notice for notice in run.notices if "doubled steps" in notice]
    assert len(said) == 1
    assert "smaller dt" in said[0]
    fine = cp.simulate(scene, q, v, duration=0.2, dt=5e-5)
    assert not any("doubled steps" in notice for notice in fine.notices)


@pytest.mark.long
def test_torques_of_a_function_are_not_called_for_the_estimate():
    calls = []

    def torque(t, q, v):
        calls.append(t)
        return -5.0 * q - v

    run = cp.simulate(oscillator(0.0), np.array([0.1]), np.zeros(1), torque, duration=0.5)
    before = len(calls)
    assert run.error >= 0
    assert run.notices is not None
    assert len(calls) == before


# notices of answers --------------------------------------------------------------------------


@pytest.mark.long
def test_notices_of_steps_come_through_once_with_their_time():
    scene, q, v = sliding_box()
    by_step = cp.step(scene, q, v, dt=1e-3)
    run = cp.simulate(scene, q, v, duration=0.05)
    assert by_step.notices
    for notice in by_step.notices:
        said = [each for each in run.notices if notice in each]
        assert len(said) == 1
        assert "t = 0 s" in said[0].removesuffix(notice)


@pytest.mark.long
def test_notices_of_solve_come_through_once_with_their_time():
    scene = bar()
    run = cp.simulate(scene, *scene.state(), duration=1.0, dt=0.5)
    answer = cp.solve(scene, run.q[1], run.v[1], np.zeros(3), throw=False)
    assert answer.notices
    for notice in answer.notices:
        assert f"t = 0.5 s: {notice}" in run.notices


# files and batches ---------------------------------------------------------------------------


@pytest.mark.long
def test_a_file_has_the_status_and_its_limits(tmp_path):
    scene = bar()
    limits = MotionLimits(violation=1e-3, energy=np.inf)
    run = cp.simulate(scene, *scene.state(), duration=1.0, dt=0.5, limits=limits)
    run.save(tmp_path / "run.npz")
    again = cp.simulation.Trajectory.load(tmp_path / "run.npz")
    assert again.run.limits == limits
    assert (again.status, again.reason) == (run.status, run.reason)


@pytest.mark.parametrize("record", [1, None])
def test_a_batch_has_status_and_reason_a_row(record, tmp_path):
    scene = cart(2e-3)
    Q, V = np.array([[0.0, 0.3], [0.0, 3.1], [0.0, 0.4]]), np.zeros((3, 2))
    batch = simulate_batch(scene, Q, V, duration=2.0, record=record)
    for i, (q, v) in enumerate(zip(Q, V, strict=True)):
        every = 1 if record else max(2000 // 50, 10)
        run = cp.simulate(scene, q, v, duration=2.0, record=every)
        assert batch.status_names[i] == run.status.name.lower()
        assert batch.reasons[i] == run.reason
    assert "unbalanced" in batch.counts
    if record:
        assert batch[0].status is RunStatus.UNBALANCED
        assert batch[0].run.status is RunStatus.FINISHED
        batch.save(tmp_path / "batch.npz")
        again = cp.simulation.BatchTrajectory.load(tmp_path / "batch.npz")
        assert again.reasons.tolist() == batch.reasons.tolist()
    wide = simulate_batch(scene, Q, V, duration=2.0, limits=MotionLimits(energy=np.inf))
    assert wide.ok


# steps ---------------------------------------------------------------------------------------


@pytest.mark.long
@given(st.integers(0, 1000), st.sampled_from([1e-3, 5e-3, 2e-2]), st.booleans())
def test_energy_of_a_step_is_that_of_its_two_states(seed, dt, by_moreau):
    rng = np.random.default_rng(seed)
    scene, q, _ = sliding_box()
    q[2] += rng.uniform(0.0, 0.1)
    v = rng.normal(size=6)
    step = cp.step(scene, q, v, dt=dt, integrator=Moreau() if by_moreau else cp.StewartTrinkle())
    model = scene.robot.model
    data = model.createData()
    before = pin.computeMechanicalEnergy(model, data, q, v)
    after = pin.computeMechanicalEnergy(model, data, step.q, step.v)
    done = -step.energy_lost + step.correction_work + step.algorithmic_work
    assert abs(abs(after - before - done) - step.energy_error) < 1e-9
    assert step.status.ok


def test_a_step_whose_energy_no_work_explains_is_not_ok():
    scene, q, v = sliding_box()
    step = cp.step(scene, q, v, dt=1e-3)
    wrong = replace(step, energy_error=2 * step.energy_limit)
    assert not wrong.status.ok
    assert any("no work explains" in notice for notice in wrong.notices)


# cures ---------------------------------------------------------------------------------------


def test_a_stiff_damper_is_advised_an_accurate_integrator():
    run = cp.simulate(oscillator(8e3, 1e6), np.array([0.1]), np.zeros(1), duration=0.5)
    assert run.status is RunStatus.DIVERGED
    assert "use RadauIIA(3)" in run.reason
    assert "SemiImplicitEuler" not in run.reason
    assert not any("nan" in notice for notice in run.notices)


@pytest.mark.parametrize("dt", [1e-3, 5e-4])
def test_arrays_of_the_core_are_judged_as_motions_are(dt):
    """Samples as the compiled core measures them, of motions by Python."""
    from condyn_pin.simulation.batch.motions import MEASURED, Motions, put_motions

    scene, tau = cart(2e-3), np.array([[0.0, 0.0], [1e-3, 0.0]])
    scene.robot.model.damping[1] = 0.01
    scene = cp.Scene(cp.Robot("cart", scene.robot.model))
    starts = np.array([[0.0, 0.3], [0.0, 3.1]])
    runs = [
        cp.simulate(scene, q, np.zeros(2), each, duration=1.0, dt=dt, record=10)
        for q, each in zip(starts, tau, strict=True)
    ]
    kept = len(runs[0].t)
    found = {name: np.array([getattr(run, name) for run in runs]) for name in "tqva"}
    found["lam"] = np.zeros((2, kept, 0))
    damping = -scene.robot.model.damping
    found["measures"] = np.array(
        [
            np.stack(
                [
                    run.violation, run.constraint_velocity, run.energy.kinetic,
                    run.energy.potential, run.energy.springs, -(run.v**2) @ damping,
                ], axis=1,
            )
            for run in runs
        ]
    )  # fmt: skip
    assert found["measures"].shape[2] == MEASURED
    outputs = {
        "t": np.zeros(2), "q": np.zeros((2, 2)), "v": np.zeros((2, 2)), "violation": np.zeros(2),
        "constraint_velocity": np.zeros(2), "energy_error": np.zeros(2),
        "statuses": np.full(2, -1, np.int8),
    }  # fmt: skip
    run = runs[0].run
    motions = Motions(
        function=None, jacobian=None, duration=1.0, dt=dt, steps=round(1.0 / dt), every=10,
        integrator=run.integrator, drift=run.drift, solver=run.solver, limits=run.limits,
    )  # fmt: skip
    words = put_motions(outputs, np.arange(2), found, tau, scene, run.solver, motions)
    for i, motion in enumerate(runs):
        assert tuple(RunStatus)[outputs["statuses"][i]] is motion.status
        assert words.get(i, "") == motion.reason
        np.testing.assert_allclose(
            outputs["energy_error"][i], np.abs(motion.energy.error).max(), rtol=1e-9, atol=1e-12
        )
    assert words
