"""Driven rows in a controller: they accelerate as their paths do, at the t of each tick."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import condyn_pin as cp
from condyn_pin.constraints import Driven, HeldJoint, Polynomial, Sine
from condyn_pin.contact import FrictionCone
from condyn_pin.control import (
    Controller,
    ControlLimits,
    ControlStatus,
    Hierarchy,
    JointTask,
    Posture,
    push_bound,
)

pytest.importorskip("proxsuite")
pytest.importorskip("daqp")

GRAVITY, PATH = 9.81, Sine(0.2, 0.8, 0.4)


def carried(mass: float = 2.0, length: float = 0.7, effort: float = np.inf) -> cp.Robot:
    """A pendulum with a motor, upright, on a cart along x."""
    model = pin.Model()
    cart = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "cart")
    model.appendBodyToJoint(cart, pin.Inertia(5.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    arm = model.addJoint(cart, pin.JointModelRY(), pin.SE3.Identity(), "arm")
    point = pin.Inertia(mass, np.array([0.0, 0.0, length]), np.zeros((3, 3)))
    model.appendBodyToJoint(arm, point, pin.SE3.Identity())
    model.effortLimit[:] = effort
    return cp.Robot("carried", model, actuated=["arm"])


@pytest.mark.parametrize("t", [0.0, 0.3, 1.1])
def test_an_arm_is_held_on_a_cart_that_is_shaken(t, engine):
    """tau = -m L (s'' cos(q) + g sin(q)) holds it; the cart feels (M + m) s''."""
    scene = cp.Scene(carried(), [Driven(HeldJoint("cart"), PATH)])
    still = JointTask("arm", kp=0.0, kd=0.0)
    hold = Controller(scene, [still], cones={}, engine=engine.name)
    q = 0.4
    s, rate, bend = np.ravel(PATH(t))
    found = hold.solve([s, q], [rate, 0.0], t)
    assert found.status.ok
    assert found.a == pytest.approx([bend, 0.0], abs=1e-9)
    torque = -2.0 * 0.7 * (GRAVITY * np.sin(q) - bend * np.cos(q))
    assert found.u == pytest.approx([torque], abs=1e-6)
    assert found.lam == pytest.approx([7.0 * bend], abs=1e-6)
    assert found.residuals.constraints < 1e-12


@pytest.mark.parametrize("strict", [False, True])
def test_a_five_bar_with_one_crank_driven_needs_what_inverse_dynamics_says(strict):
    """One crank is driven, the other does its task: force and torque are the u of both motors."""
    bar, t = cp.model.five_bar(), 0.3
    free = cp.Scene(bar, bar.loops)
    first, second = bar.actuated
    home = free.state()[0][bar.index_q(first)] - PATH(0.0)[0][0]
    scene = cp.Scene(bar, [*bar.loops, Driven(HeldJoint(first, float(home)), PATH)])
    tasks = [JointTask(second, kp=30.0)]
    law = Controller(scene, Hierarchy(tasks) if strict else tasks, cones={})
    q, v = scene.at(t).state()
    found = law.solve(q, v, t)
    assert found.status.ok
    assert found.a[bar.index_v(first)] == pytest.approx(PATH(t)[2][0], abs=1e-9)
    assert found.errors[second] == pytest.approx([0.0], abs=1e-3)
    inverse = cp.inverse_dynamics(free, q, v, found.a)
    assert np.add(found.u, [found.lam[-1], 0.0]) == pytest.approx(inverse.u, abs=1e-6)
    assert found.torques[first] == pytest.approx(0.0, abs=1e-3)  # it would work against the drive


@pytest.mark.long
def test_a_motion_under_a_controller_follows_its_path_and_its_task():
    scene = cp.Scene(carried(), [Driven(HeldJoint("cart"), PATH)])
    law = Controller(scene, [JointTask("arm", reference=0.2, kp=100.0)], cones={})

    def tau(t, q, v):
        return law.solve(q, v, t).tau

    s, rate, _ = np.ravel(PATH(0.0))
    run = cp.simulate(scene, [s, 0.1], [rate, 0.0], tau, duration=1.5, dt=2e-3)
    assert run.q[-1, 0] == pytest.approx(PATH(1.5)[0][0], abs=1e-9)
    assert run.q[-1, 1] == pytest.approx(0.2, abs=1e-4)


@pytest.mark.long
def test_limits_that_a_path_does_not_leave_room_for_are_named():
    """The arm would need 40 N m to stay; a motor with 5 N m says so."""
    scene = cp.Scene(carried(effort=5.0), [Driven(HeldJoint("cart"), Polynomial((0.0, 0.0, 15.0)))])
    law = Controller(
        scene, [JointTask("arm", kp=0.0, kd=0.0, weight=np.inf)], cones={},
        limits=ControlLimits(torque=True),
    )  # fmt: skip
    found = law.solve([0.0, 0.0], [0.0, 0.0], 0.0)
    assert found.status is ControlStatus.INFEASIBLE
    assert "arm" in str(found.infeasible)


def test_a_scene_at_one_time_is_refused():
    scene = cp.Scene(carried(), [Driven(HeldJoint("cart"), PATH)])
    with pytest.raises(cp.errors.InvalidArgument, match=r"cart stays at one time.*at the t of"):
        Controller(scene.at(0.2), [Posture()], cones={})


@pytest.mark.long
def test_what_is_about_a_robot_at_rest_refuses_a_drive():
    solo = cp.load_robot("solo12")
    feet = [cp.PointContact(name) for name in ("FL_FOOT", "FR_FOOT", "HL_FOOT")]
    scene = cp.Scene(solo, [*feet, Driven(HeldJoint("HR_HFE"), PATH)])
    q, _ = cp.Scene(solo, feet).state()
    with pytest.raises(cp.errors.UnsupportedConstraint, match=r"HR_HFE.*push_bound takes J v = 0"):
        push_bound(scene, q, [1.0, 0.0, 0.0], cones=FrictionCone(0.7))
