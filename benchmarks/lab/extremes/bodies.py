"""Hard bodies and bad input: light, heavy, without mass; gains and numbers that no machine has."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.surface_contact import SurfaceContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.mechanism.projection import project_velocity
from condyn_pin.model.mechanisms.machine import along_x, rod
from condyn_pin.model.mechanisms.planar import chain, four_bar, n_four_bar
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.integrators.dormand_prince import DormandPrince
from condyn_pin.simulation.integrators.rattle import Rattle
from condyn_pin.simulation.run import simulate
from lab.extremes.base import (
    Case,
    Flight,
    Motion,
    Rng,
    ajar,
    alternating,
    by_reference,
    closed,
    extreme,
    frame_at,
    hooked,
    moving,
    one_joint,
    powers,
    rods,
    torques,
    with_inertias,
)
from lab.extremes.loops import cranks_as_one
from lab.extremes.planar_chain import accelerations

# One body of a machine without its mass.


@extreme(1.0, 1e-3, 1e-6, 1e-9, 1e-12, 0.0)
def massless_body(severity: float, rng: Rng, scene: Scene) -> Case:
    """Mass and inertia of one body, any of them, times its own.

    Nothing is wrong with a body without mass where it cannot move without others.
    """
    robot = scene.robot
    inertias = list(robot.model.inertias)
    body = int(rng.integers(1, len(inertias)))
    whole = inertias[body]
    inertias[body] = pin.Inertia(severity * whole.mass, whole.lever, severity * whole.inertia)
    light = Scene(
        replace(robot, model=with_inertias(robot.model, inertias)),
        scene.constraints,
        scene.contacts,
    )
    return Case(light, *moving(light, rng))


# A four-bar whose coupler weighs less and less.


_CRANK, _COUPLER, _ROCKER, _DENSITY, _GRAVITY = 0.3, 0.8, 0.6, 2.5, 9.81


@extreme(1.0, 1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 1e-13, 1e-15, 1e-30, 1e-300, 0.0)
def massless_coupler(severity: float, rng: Rng) -> Case:
    """Mass of the coupler of a four-bar, which ends one side of its loop [kg].

    Without mass M is singular, and the linkage moves like any other: crank and rocker hold it.
    """
    linkage = four_bar(crank=_CRANK, coupler=_COUPLER, rocker=_ROCKER, density=_DENSITY)
    q, v = closed(linkage).sample(rng)
    tau = rng.normal(size=3)
    inertias = list(linkage.model.inertias)
    inertias[2] = rod(_COUPLER, severity)
    light = Robot("light four-bar", with_inertias(linkage.model, inertias), linkage.postures)
    return Case(Scene(light, linkage.loops), q, v, tau, (_right(q, v, tau, severity),))


def _right(q: Array, v: Array, tau: Array, mass: float) -> Array:
    """Return q'' from the one equation of motion, with the mass of the coupler.

    In the angles of the rods to the ground, M theta'' + h = torques + J^T lam; the loop gives
    theta'' = t alpha + b, with t their rates per turn of the crank, and so

        t^T M t alpha = t^T (torques - h - M b).
    """
    theta, omega = np.array([q[0], q[0] + q[1], q[2]]), np.array([v[0], v[0] + v[1], v[2]])
    along, across = (np.array(f(theta)) for f in (np.cos, np.sin))
    lengths = np.array([_CRANK, _COUPLER, -_ROCKER])  # round the loop
    J = lengths * np.array([-across, along])
    centripetal = lengths * omega**2 @ np.array([along, across]).T
    t = np.array([1.0, *np.linalg.solve(J[:, 1:], -J[:, 0])])
    b = np.array([0.0, *np.linalg.solve(J[:, 1:], centripetal)])
    crank, rocker = _DENSITY * _CRANK, _DENSITY * _ROCKER
    M = np.diag([(crank / 3 + mass) * _CRANK**2, mass * _COUPLER**2 / 3, rocker * _ROCKER**2 / 3])
    between = mass * _CRANK * _COUPLER / 2
    M[0, 1] = M[1, 0] = between * np.cos(theta[0] - theta[1])
    levers = np.array([(crank / 2 + mass) * _CRANK, mass * _COUPLER / 2, rocker * _ROCKER / 2])
    turning = between * np.sin(theta[0] - theta[1])
    h = _GRAVITY * levers * along + turning * np.array([omega[1] ** 2, -(omega[0] ** 2), 0.0])
    torques = np.array([tau[0] - tau[1], tau[1], tau[2]])
    alpha = t @ (torques - h - M @ b) / (t @ M @ t)
    a = alpha * t + b
    return np.array([a[0], a[1] - a[0], a[2]])


# Rods without mass in a row, in a closed chain.


@extreme(0, 1, 2, 3, 5, 10)
def massless_row(severity: float, rng: Rng) -> Case:
    """How many rods without mass there are in a row, between two of 1 kg, the last held at its tip.

    Up to two of them move only with the last rod, which has three ways to go; of more, nothing
    says how they move.
    """
    n = round(severity) + 2
    q = alternating(n) * rng.uniform(0.5, 1.5, size=n)  # far from stretched
    scene = hooked(rods((1.0, *(n - 2) * (0.0,), 1.0)), q)
    v = project_velocity(scene, q, rng.normal(size=n))
    return Case(scene, q, v, rng.normal(size=n))


# A chain whose last rod weighs less and less.


@extreme(1.0, 1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 1e-13, 1e-15, 1e-30, 1e-300, 0.0)
def massless_tip(severity: float, rng: Rng) -> Case:
    """Mass of the last of five rods in an open chain, the others of 1 kg [kg].

    It still swings by its own weight; without mass nothing says how.
    """
    masses = (1.0, 1.0, 1.0, 1.0, severity)
    scene = Scene(rods(masses))
    q, v = rng.normal(size=(2, 5))
    tau = torques(scene, rng)
    return Case(scene, q, v, tau, (accelerations(q, v, tau, masses),))


# A thin rod with balls at both ends between two heavy bodies.


@extreme(1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-9, 1e-12, 1e-15, 0.0)
def light_rod(severity: float, rng: Rng) -> Case:
    """Mass of a rod of 2 mm across that joins two arms of 10 kg [kg].

    Nothing keeps it from spinning about itself, with an inertia of m r^2 / 2.
    """
    arm = pin.Inertia(10.0, np.array([0.25, 0.0, 0.0]), np.diag([0.01, 0.2, 0.2]))
    model = one_joint("left", pin.JointModelRY(), arm)
    link = model.addJoint(1, pin.JointModelSpherical(), along_x(0.5), "rod")
    across = severity * (0.4**2 / 12 + 1e-6 / 4)
    about = np.diag([severity * 1e-6 / 2, across, across])
    thin = pin.Inertia(severity, np.array([0.2, 0.0, 0.0]), about)
    model.appendBodyToJoint(link, thin, pin.SE3.Identity())
    model.addFrame(pin.Frame("rod_tip", link, 0, along_x(0.4), pin.FrameType.OP_FRAME))
    right = model.addJoint(0, pin.JointModelRZ(), along_x(0.9), "right")
    lever = pin.SE3(np.eye(3), np.array([0.0, 0.3, 0.0]))
    model.appendBodyToJoint(right, arm, lever)
    model.addFrame(pin.Frame("arm", right, 0, lever, pin.FrameType.OP_FRAME))
    q = np.array([0.3, 0.0, 0.0, 0.0, 1.0, -0.5])
    robot = Robot("arms on a rod", model, postures={"open": q}, actuated=("left", "right"))
    scene = Scene(robot, [Loop("rod_tip", "arm", name="tip")])
    q, v = scene.sample(rng)
    tau = np.zeros(5)
    tau[[0, 4]] = 10.0 * rng.normal(size=2)
    return Case(scene, q, v, tau)


# One heavy or light body in a loop.


@extreme(1.0, 1e1, 1e2, 1e3, 1e4, 1e6, 1e9, 1e12, 1e-2, 1e-4, 1e-6, 1e-9, 1e-12)
def mass_ratio(severity: float, rng: Rng) -> Case:
    """Mass of the coupler of a four-bar over that of its crank."""
    linkage = four_bar()
    inertias = list(linkage.model.inertias)
    inertias[2] = rod(0.8, severity * inertias[1].mass)
    scene = closed(replace(linkage, model=with_inertias(linkage.model, inertias)))
    return Case(scene, *moving(scene, rng))


# A held chain of rods that weigh next to nothing beside others of tons.


_RODS, _HELD = 8, 3


@extreme(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
def wide_masses(severity: float, rng: Rng) -> Case:
    """Decades over which the masses of eight rods are spread, the third held four times over.

    A weld and two equal sliders hold its tip, 16 rows of rank 3. So the first three joints do not
    move, and the others are a chain of five, known to 50 digits.
    """
    masses = 10.0 ** (severity * (rng.permutation(_RODS) / (_RODS - 1) - 0.5))
    q, tip = rng.normal(size=_RODS), f"joint{_HELD - 1}_tip"
    robot = Robot("wide masses", rods(masses.tolist()).model, postures={"held": q})
    place = frame_at(robot, q, tip)
    robot = robot.with_frame("rail", "world", place.translation, place.rotation)
    sliders = [Loop(tip, "rail", "slider", axis="x", name=name) for name in ("one", "two")]
    scene = Scene(robot, [SurfaceContact(tip, name="weld"), *sliders])
    v = np.zeros(_RODS)
    v[_HELD:] = rng.normal(size=_RODS - _HELD)
    tau = torques(scene, rng)
    # the angle of the first rod of the rest is counted from the x axis
    outer = np.concatenate([[q[: _HELD + 1].sum()], q[_HELD + 1 :]])
    a = np.zeros(_RODS)
    a[_HELD:] = accelerations(outer, v[_HELD:], tau[_HELD:], masses[_HELD:].tolist())
    return Case(scene, q, v, tau, (a,))


# A long chain that is held at its tip too.


@extreme(3, 5, 10, 20, 50, 100)
def held_chain(severity: float, rng: Rng) -> Case:
    """How many rods there are in a chain with a ball at its tip."""
    n = round(severity)
    scene = hooked(chain(n), rng.normal(size=n) * 0.3)
    q, _ = scene.state()
    v = project_velocity(scene, q, rng.normal(size=n) / n)
    return Case(scene, q, v, rng.normal(size=n))


# A rod loop whose two ends nearly meet.


@extreme(1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14, 1e-16, 1e-300)
def short_rod(severity: float, rng: Rng) -> Case:
    """Length of the rod between coupler and rocker of a four-bar [m].

    Its direction turns with the speed of the ends over its length.
    """
    scene = Scene(four_bar(), [Loop("coupler_tip", "rocker_tip", "rod", length=severity)])
    return Case(scene, *moving(scene, rng))


# Joints whose axes turn with their own angles, in motion by `Rattle`.


_DURATION, _DT = 0.5, 2e-3  # [s]


@extreme(0.0, 0.1, 0.3, 1.0, 2.0, 5.0)
def turning_joints(severity: float, rng: Rng) -> Case:
    """Speed of a body on a universal joint, and of another on Euler angles at it [rad/s].

    The axis of one angle turns with another, so that their momenta are no constants of a free
    motion. The end is that of Dormand and Prince's method, at 1e-12.
    """
    x, y, _ = np.eye(3)
    body = pin.Inertia(1.0, np.array([0.1, 0.2, -0.3]), np.diag([0.1, 0.2, 0.25]))
    model = one_joint("universal", pin.JointModelUniversal(x, y), body)
    at = pin.SE3(np.eye(3), np.array([0.0, 0.1, -0.5]))
    euler = model.addJoint(1, pin.JointModelSphericalZYX(), at, "euler")
    model.appendBodyToJoint(euler, body, pin.SE3.Identity())
    scene = Scene(Robot("turning", model))
    q, v = 0.3 * rng.normal(size=5), severity * rng.uniform(0.5, 1.0, size=5)
    exact = DormandPrince(1e-12, 1e-12)
    right = simulate(scene, q, v, duration=_DURATION, dt=_DT, integrator=exact)
    flight = Flight(_DURATION, _DT, Rattle(), right.q[-1], 2e-3 * (1.0 + severity))
    return Case(scene, q, v, np.zeros(5), flight=flight)


# Quaternions that are not of unit length.


@extreme(*powers(-16, -7), 9e-7, *powers(-6, -1), -1.0)
def loose_quaternion(severity: float, rng: Rng, scene: Scene) -> Case:
    """How far the length of every quaternion of q is from one; -1 makes it zero."""
    q, v, tau = moving(scene, rng)
    at = [offset // q.itemsize for offset in scene.robot.arguments.quaternions]
    if not at:
        raise InvalidArgument(f"{scene.robot.name} has no quaternion")
    # with quaternions of unit length
    right = (by_reference(scene, q, v, tau),) if severity < 0.1 else ()
    for start in at:
        q[start : start + 4] *= 1.0 + severity
    return Case(scene, q, v, tau, right)


# Drift control on both sides of the stability limit of semi-implicit Euler.


@extreme(1e-3, 1e-2, 0.1, 0.5, 0.8, 0.82, 0.828, 0.829, 0.84, 1.0, 2.0, 10.0, 1e3, 1e6)
def wall(severity: float, rng: Rng, scene: Scene) -> Case:
    """Gains alpha = beta of Baumgarte times the step, of 1e-6 to 0.1 s; gaps grow beyond 0.828.

    The loops are open by about 1e-7, and nothing else moves.
    """
    dt = 10.0 ** rng.uniform(-6.0, -1.0)  # [s]
    q, v = scene.state()
    drift = Baumgarte(severity / dt, severity / dt)
    return Case(scene, ajar(scene, q, rng), v, np.zeros(len(v)), drift=drift, motion=Motion(dt))


# The proximal weight, or damping, of every method that has one.


@extreme(
    *(1e-6, 1e-8, 1e-10, 1e-12, 1e-14, 1e-16, 1e-20, 1e-50, 1e-300, 0.0),
    *(1e-4, 1e-2, 1.0, 1e2, 1e4, 1e6, 1e12),
)
def weight(severity: float, rng: Rng, scene: Scene) -> Case:
    """How large the parameter mu is [1/kg]."""
    return Case(scene, *moving(scene, rng), parameters={"mu": severity})


# One number of the configuration, the torque or the velocity that no machine has.


SIZES = (
    0.0, 5e-324, 1e-310, 1e-155, 1e16, 1e30, 1e77, 1e100, 1e155, 1e300, math.inf, math.nan,
)  # fmt: skip


@extreme(*SIZES)
def bad_q(severity: float, rng: Rng, scene: Scene) -> Case:
    """One entry of q, from nothing to what is not a number [SI]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, _spoilt(q, severity, rng), v, tau)


@extreme(*SIZES)
def bad_tau(severity: float, rng: Rng, scene: Scene) -> Case:
    """One entry of tau, from nothing to what is not a number [SI]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, v, _spoilt(tau, severity, rng))


@extreme(*SIZES)
def bad_v(severity: float, rng: Rng, scene: Scene) -> Case:
    """One entry of v, from nothing to what is not a number [SI]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, _spoilt(v, severity, rng), tau)


def _spoilt(x: Array, severity: float, rng: Rng) -> Array:
    """Return x with one of its entries replaced."""
    x[rng.integers(len(x))] = severity
    return x


# A mass, or a length, that no machine has.


_SIZES = (
    *(1.0, 1e-6, 1e-12, 1e-15, 1e-16, 1e-17, 1e-30, 1e-77, 1e-155, 1e-310, 5e-324, 0.0),
    *(1e12, 1e30, 1e60, 1e77, 1e155, 1e300, math.inf, math.nan),
)


@extreme(*_SIZES)
def bad_mass(severity: float, rng: Rng) -> Case:
    """Mass of every rod of a parallelogram, which moves by its weight alone [kg]."""
    return _falling(n_four_bar(1, mass=severity), 1.0, rng)


@extreme(*_SIZES)
def bad_length(severity: float, rng: Rng) -> Case:
    """Length of every rod of a parallelogram, which moves by its weight alone [m]."""
    return _falling(n_four_bar(1, length=severity), severity, rng)


def _falling(linkage: Robot, length: float, rng: Rng) -> Case:
    theta, rest = rng.uniform(0.5, 2.5), np.zeros(3)
    right = cranks_as_one(1, theta, rest) / length
    return Case(closed(linkage), theta * alternating(3), rest, rest, (right,))


# A parameter, a gain or a step that no method and no run can use.


_STEPS = (
    1e-3, 1e-9, 1e-30, 1e-100, 0.0, 5e-324, 1e-310, 1e-155, 1.0, 1e16, 1e100, 1e155, 1e300,
    math.inf, math.nan,
)  # fmt: skip


@extreme(*SIZES)
def bad_gain(severity: float, rng: Rng) -> Case:
    """Gains alpha = beta of Baumgarte on a four-bar, from nothing to what is not a number [1/s]."""
    scene = closed(four_bar())
    q, v, tau = moving(scene, rng)
    return Case(scene, ajar(scene, q, rng), v, tau, drift=Baumgarte(severity, severity))


@extreme(*SIZES)
def bad_mu(severity: float, rng: Rng) -> Case:
    """Parameter mu on a four-bar, from nothing to what is not a number [1/kg]."""
    scene = closed(four_bar())
    return Case(scene, *moving(scene, rng), parameters={"mu": severity})


@extreme(*_STEPS)
def bad_step(severity: float, rng: Rng) -> Case:
    """Step of a run of a four-bar, from what is usual to what is not a number [s]."""
    scene = closed(four_bar())
    q, v = scene.state()
    q = ajar(scene, q, rng)
    motion = Motion(severity, steps=10)
    return Case(scene, q, v, np.zeros(len(v)), drift=Baumgarte(1.0, 1.0), motion=motion)
