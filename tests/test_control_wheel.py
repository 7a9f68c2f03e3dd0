"""A wheeled leg under the controller: rows that roll are contacts of the program like any other."""

from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin
import pytest

import condyn_pin as cp
from condyn_pin.contact import FrictionCone
from condyn_pin.control import CenterOfMass, Controller, ControlStatus, JointTask, Posture
from condyn_pin.mechanism import project_velocity

pytest.importorskip("proxsuite")

G, RADIUS, LINK = 9.81, 0.1, 0.3  # [m/s^2], [m], [m]
TRUNK, LEG, RIM = 4.0, 0.5, 0.8  # [kg]
FOLD = 0.6  # [rad]


@functools.cache
def scene() -> cp.Scene:
    """A trunk that is guided in a vertical plane, a hip, a knee, and a wheel that rolls."""
    model, here = pin.Model(), pin.SE3.Identity()
    down = pin.SE3(np.eye(3), np.array([0.0, 0.0, -LINK]))
    rail = model.addJoint(0, pin.JointModelPX(), here, "rail")
    trunk = model.addJoint(rail, pin.JointModelPZ(), here, "trunk")
    model.appendBodyToJoint(trunk, pin.Inertia.FromSphere(TRUNK, 0.1), here)
    hip = model.addJoint(trunk, pin.JointModelRY(), here, "hip")
    knee = model.addJoint(hip, pin.JointModelRY(), down, "knee")
    for joint in (hip, knee):
        middle = pin.SE3(np.eye(3), np.array([0.0, 0.0, -LINK / 2]))
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(LEG, 0.05), middle)
    axle = model.addJoint(knee, pin.JointModelRY(), down, "axle")
    model.appendBodyToJoint(axle, pin.Inertia.FromCylinder(RIM, RADIUS, 0.02), _turned())
    model.addFrame(pin.Frame("wheel", axle, 0, here, pin.FrameType.OP_FRAME))
    model.effortLimit = np.full(5, 1e3)
    q = np.array([0.0, 2 * LINK * np.cos(FOLD) + RADIUS, FOLD, -2 * FOLD, 0.0])
    made = cp.Robot("wheeled_leg", model, postures={"bent": q}, actuated=("hip", "knee", "axle"))
    rolls = cp.constraints.RollingWheel("wheel", RADIUS, holds=("rolling", "normal"), height=0.0)
    return cp.Scene(made, [rolls])


def _turned() -> pin.SE3:
    return pin.SE3(pin.rpy.rpyToMatrix(np.pi / 2, 0.0, 0.0), np.zeros(3))  # its axle along y


def legs_still() -> list:
    """The leg keeps its shape: hip and knee do not accelerate."""
    return [JointTask(name, a=0.0, weight=np.inf) for name in ("hip", "knee")]


@pytest.mark.parametrize("a", [1.5, -3.0])
def test_a_leg_is_driven_by_its_wheel(a):
    """With the leg stiff all moves as one: f = m a, tau = f r + I a / r."""
    q, v = scene().state()
    mass = scene().robot.mass
    drive = CenterOfMass(a=(a, 0.0, 0.0), weight=100.0)
    out = Controller(scene(), [drive, *legs_still()], cones=FrictionCone(0.5)).solve(q, v)
    assert out.status.ok
    along, up = out.forces["wheel"].in_world()[[0, 2]]
    assert along == pytest.approx(mass * a, rel=1e-4)
    assert up == pytest.approx(mass * G, rel=1e-6)
    assert out.a[4] == pytest.approx(a / RADIUS, rel=1e-4)
    spin = 0.5 * RIM * RADIUS**2 * out.a[4]
    assert out.torques["axle"] == pytest.approx(along * RADIUS + spin, rel=1e-6)
    assert out.residuals.kkt < 1e-9
    assert out.residuals.constraints < 1e-12
    forward = cp.solve(scene(), q, v, out.tau)
    assert forward.a == pytest.approx(out.a, abs=1e-9)


@pytest.mark.long
def test_friction_says_how_fast_it_can_start():
    """mu g, and not more: what is asked beyond that is named, and by how much."""
    q, v = scene().state()
    cone = FrictionCone(0.5, pyramid="outer")  # exact along the way
    upwards = CenterOfMass(a=(6.0, 0.0, 3.0), weight=np.inf)  # and presses the more on the floor
    out = Controller(scene(), [upwards, Posture(weight=0.1)], cones=cone).solve(q, v)
    assert out.status is ControlStatus.OK
    level = CenterOfMass(a=(6.0, 0.0, 0.0), weight=np.inf)
    out = Controller(scene(), [level, *legs_still()], cones=cone).solve(q, v)
    assert out.status is ControlStatus.INFEASIBLE
    gives = {give.row: give.amount for give in out.infeasible.gives}
    assert gives["CenterOfMass.x"] == pytest.approx(6.0 - 0.5 * G, abs=1e-6)
    assert any(row.startswith("wheel: slips") for row in out.infeasible.against)


def test_a_wheel_without_a_cone_is_held_and_eliminated():
    """The same motion: its two rows are no unknowns then, and the force is found from the rest."""
    q, v = scene().state()
    v = project_velocity(scene(), q, np.array([0.8, 0.0, 0.1, -0.2, 0.0]))
    tasks = [CenterOfMass(a=(1.0, 0.0, 0.2), weight=100.0), Posture(weight=0.1)]
    free = Controller(scene(), tasks, cones={})
    cone = Controller(scene(), tasks, cones=FrictionCone(0.9))
    assert free.program(q, v).sizes[0] == cone.program(q, v).sizes[0] - 4
    one, other = free.solve(q, v), cone.solve(q, v)
    assert one.status.ok
    assert other.status.ok
    assert one.a == pytest.approx(other.a, abs=1e-3)  # forces are weighed in one of them
    assert one.forces["wheel"].in_world() == pytest.approx(
        other.forces["wheel"].in_world(), abs=0.02
    )
