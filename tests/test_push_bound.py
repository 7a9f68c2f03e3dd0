"""How hard a robot may be pushed with its motors: closed forms, monotony, and what falls."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from shared import robot

import condyn_pin as cp
from condyn_pin.contact import FrictionCone, WrenchCone
from condyn_pin.control import (
    Actuation,
    PushBound,
    capturable_speed,
    push_bound,
    support_polygon,
)
from condyn_pin.model import CoupledMotor

G, MASS = 9.81, 8.0
LONG, WIDE, HIGH = 0.3, 0.2, 0.6  # from the centre of mass to the feet [m]
ROUGH = FrictionCone(10.0, sides=4)
FLOOR = FrictionCone(0.7, sides=16, pyramid="outer")


@functools.cache
def table(force: float) -> cp.Scene:
    """A mass on four legs, nearly without mass, that push with a force at most.

    Their hips are in the mass, and have motors that just turn the legs themselves.
    """
    model = pin.Model()
    body = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    model.appendBodyToJoint(
        body, pin.Inertia(MASS, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity()
    )
    light = pin.Inertia(1e-6, np.zeros(3), 1e-7 * np.eye(3))
    feet = []
    for i, (x, y) in enumerate([(LONG, WIDE), (-LONG, WIDE), (-LONG, -WIDE), (LONG, -WIDE)]):
        to_foot = np.array([x, y, -HIGH])
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), to_foot).matrix()
        hip = model.addJoint(body, pin.JointModelSpherical(), pin.SE3(turn, np.zeros(3)), f"hip{i}")
        leg = model.addJoint(hip, pin.JointModelPZ(), pin.SE3.Identity(), f"leg{i}")
        for joint in (hip, leg):
            model.appendBodyToJoint(joint, light, pin.SE3.Identity())
        place = pin.SE3(turn.T, np.array([0.0, 0.0, np.linalg.norm(to_foot)]))
        model.addFrame(pin.Frame(f"foot{i}", leg, place, pin.FrameType.OP_FRAME))
        model.effortLimit[model.joints[hip].idx_v :] = 1e-4
        model.effortLimit[model.joints[leg].idx_v] = force
        feet.append(cp.PointContact(f"foot{i}"))
    motors = [f"{part}{i}" for part in ("hip", "leg") for i in range(4)]
    return cp.Scene(cp.Robot("table", model, actuated=motors), feet)


def pushed(scene: cp.Scene, **more: object) -> PushBound:
    return push_bound(scene, pin.neutral(scene.robot.model), (1, 0, 0), cones=ROUGH, **more)


@pytest.mark.long
def test_motors_of_the_legs_may_have_gears_and_limits_of_their_own() -> None:
    """Limits of motors are those of their joints over the gear; a limit of a joint is named so."""
    force = 1.3 * MASS * G / 4 * np.sqrt(LONG**2 + WIDE**2 + HIGH**2) / HIGH
    plain, strong = pushed(table(force)), table(1e3 * force)
    hips, pushes = [f"hip{i}" for i in range(4)], (-force / 2, force / 2)
    legs = [CoupledMotor(f"screw{i}", {f"leg{i}": 2.0}, pushes) for i in range(4)]
    geared = pushed(strong, actuation=Actuation(strong.robot, [*hips, *legs]))
    assert geared.speed == pytest.approx(plain.speed, rel=1e-6)
    assert set(geared.motors) == {"screw0", "screw3"}
    # two motors that pull at each leg, where the joint itself takes no more
    pair = [CoupledMotor(f"{side}{i}", {f"leg{i}": 1.0}) for i in range(4) for side in "ab"]
    weak = table(force)
    twice = pushed(weak, actuation=Actuation(weak.robot, [*hips, *pair]))
    assert twice.speed == pytest.approx(plain.speed, rel=1e-6)
    assert set(twice.motors) == {"leg0", "leg3"}
    assert pushed(weak, actuation=Actuation(weak.robot, [*hips, *pair]), torque=False).motors == ()


@pytest.mark.parametrize("share", [1.05, 1.3, 1.7])
def test_a_mass_on_legs_that_push_with_a_force_at_most_by_hand(share: float) -> None:
    """Each front leg carries F h / L at most, of length L, and the pressure is between the feet.

    p(s) = min(b, b (4 F h / (m g L) - 1)),    L^2 = (b - s)^2 + w^2 + h^2
    """
    force = share * MASS * G / 4 * np.sqrt(LONG**2 + WIDE**2 + HIGH**2) / HIGH

    def ahead(s: float) -> float:
        length = np.sqrt((LONG - s) ** 2 + WIDE**2 + HIGH**2)
        return min(LONG, LONG * (4 * force * HIGH / (MASS * G * length) - 1)) - s

    rest = brentq(ahead, 0.0, LONG)
    speed = np.sqrt(2 * G / HIGH * quad(ahead, 0.0, rest)[0])
    found = pushed(table(force))
    assert found.speed == pytest.approx(speed, rel=1e-3)
    assert found.impulse == pytest.approx(MASS * found.speed, rel=1e-6)
    assert found.travel[-1] == pytest.approx(rest, abs=1e-3)
    assert found.pressure == pytest.approx([ahead(s) + s for s in found.travel], abs=1e-4)
    assert set(found.motors) == {"leg0", "leg3"}  # those in front
    middle = found.travel[-1] / 2
    left = np.sqrt(2 * G / HIGH * quad(ahead, middle, rest)[0])
    assert found.speed_at(middle) == pytest.approx(left, rel=5e-3)
    assert found.speed_at(2 * rest) == 0.0


@pytest.mark.long
def test_with_motors_of_any_strength_it_is_the_inverted_pendulum() -> None:
    free = pushed(table(20.0), torque=False)
    assert free.speed == pytest.approx(capturable_speed(LONG, HIGH), rel=1e-3)
    assert free.motors == ()
    strong = pushed(table(1e6))
    assert strong.speed == pytest.approx(free.speed, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "way", "cone"),
    [
        ("solo12", (0, 1, 0), FLOOR),
        ("cassie", (1, 0, 0), FLOOR),
        ("cassie", (1, -2, 0), FLOOR),
        ("talos", (1, 0, 0), WrenchCone(0.7, pyramid="outer")),
        ("talos", (-1, 1, 0), WrenchCone(0.7, pyramid="outer")),
    ],
)
def test_so_it_is_on_robots(name: str, way: tuple[float, ...], cone: cp.contact.Cone) -> None:
    """With loops, springs, lines and soles; where friction ends the reach of the pressure too."""
    made = robot(name)
    scene = cp.Scene(made, [*made.loops, *made.contacts])
    q, _ = scene.state()
    rigid = [spring.joint for spring in made.springs]
    found = push_bound(scene, q, way, cones=cone, rigid=rigid, torque=False)
    com = made.center_of_mass(q)
    feet = support_polygon(scene, q)
    level = replace(feet, plane=feet.plane._replace(axes=np.eye(3)))  # of soles that lean by 1e-3
    d = level.reach(com, way)
    assert found.height == pytest.approx(com[2] - feet.plane.origin[2], abs=1e-3)
    speed = capturable_speed(d, found.height, friction=0.7)
    assert found.speed == pytest.approx(speed, rel=2e-3)


def test_a_bound_grows_with_its_motors() -> None:
    made = robot("solo12")
    scene = cp.Scene(made, made.contacts)
    q, _ = scene.state()
    corner = (0.195, 0.169, 0)
    speeds = []
    for torque in (2.0, 2.7, 4.0, 8.0):
        scene = cp.Scene(limited(made, torque), made.contacts)
        found = push_bound(scene, q, corner, cones=FLOOR)
        speeds.append(found.speed)
        assert ("FL_HFE" in found.motors) == (torque < 5)
    assert (np.diff(speeds) > 0.01).all()
    free = push_bound(scene, q, corner, cones=FLOOR, torque=False)
    assert speeds[-1] == pytest.approx(free.speed, rel=1e-6)
    with pytest.raises(cp.errors.Infeasible, match="hold the robot at rest"):
        push_bound(cp.Scene(limited(made, 0.1), made.contacts), q, corner, cones=FLOOR)


@pytest.mark.long
def test_a_robot_of_mirrored_legs_has_a_mirrored_bound() -> None:
    made = robot("solo12")
    scene = cp.Scene(limited(made, 2.7), made.contacts)
    q, _ = scene.state()
    speeds = [
        push_bound(scene, q, (i * 1.0, j * 0.6, 5.0), cones=FLOOR).speed
        for i in (-1, 1)
        for j in (-1, 1)
    ]
    assert speeds == pytest.approx([speeds[0]] * 4, rel=1e-3)


def limited(made: cp.Robot, torque: float) -> cp.Robot:
    model = pin.Model(made.model)
    model.effortLimit[6:] = torque
    return replace(made, model=model)


def test_how_far_a_polygon_reaches() -> None:
    scene = table(50.0)
    feet = support_polygon(scene, pin.neutral(scene.robot.model))
    assert feet.reach((0.1, 0, 0), (2, 0, 7)) == pytest.approx(LONG - 0.1)
    assert feet.reach((0, 0, 1), (LONG, WIDE, 0)) == pytest.approx(np.hypot(LONG, WIDE))
    assert feet.reach((LONG + 0.1, 0, 0), (1, 0, 0)) == pytest.approx(-0.1)
    with pytest.raises(cp.InvalidArgument, match="misses the support"):
        feet.reach((0, 1, 0), (1, 0, 0))
    with pytest.raises(cp.InvalidArgument, match="way: it is across the plane"):
        feet.reach((0, 0, 0), (0, 0, 1))


def test_what_is_wrong_is_named() -> None:
    scene = table(50.0)
    q = pin.neutral(scene.robot.model)

    def wrong(text: str, of: cp.Scene = scene, **other: object) -> None:
        given = {"q": q, "way": (1, 0, 0), "cones": ROUGH} | other
        at, way = given.pop("q"), given.pop("way")
        with pytest.raises(cp.InvalidArgument, match=text):
            push_bound(of, at, way, **given)

    wrong("way: it is across the plane", way=(0, 0, 1))
    wrong("way", way=(np.nan, 0, 0))
    wrong("way has shape", way=(1, 0))
    wrong("q has shape", q=q[:-1])
    wrong("torque = 1", torque=1)
    wrong("cones: foot0 has 0.5", cones=0.5)
    wrong("rigid = .'leg0'.: one of them has a motor", rigid=["leg0"])
    wrong("nothing in this scene presses", of=cp.Scene(scene.robot))
    two = cp.Scene(scene.robot, scene.constraints[:2])
    wrong("span no area", of=two)
    with pytest.raises(cp.errors.UnknownName, match="leg0"):
        push_bound(scene, q, (1, 0, 0), cones=ROUGH, rigid=["leg9"])
    block = pin.Model()
    joint = block.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "float")
    block.addJointFrame(joint)
    inertia = pin.Inertia(2.0, np.array([0.0, 0.0, 0.5]), np.eye(3))
    block.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    rigid = cp.Robot("block", block, actuated=["float"])
    sole = cp.SurfaceContact("float", 0.1, 0.1)
    with pytest.raises(cp.InvalidArgument, match="cannot move along the floor"):
        push_bound(cp.Scene(rigid, [sole]), pin.neutral(block), (1, 0, 0), cones=WrenchCone(0.5))
