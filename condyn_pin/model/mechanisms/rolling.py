"""Bodies that roll or glide on a level plane: ball, coin, wheel, sleigh, car with trailers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import Constraint, check_positive
from condyn_pin.constraints.knife_edge import KnifeEdge
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.rolling_ball import RollingBall
from condyn_pin.constraints.rolling_wheel import RollingWheel
from condyn_pin.model.mechanisms.machine import LICENCE, SOURCE, disc, mechanism
from condyn_pin.model.robot import Robot


def _robot(
    name: str,
    joints: Mapping[str, Any],
    inertia: Any,
    contact: Constraint,
    postures: Mapping[str, Array],
    *,
    height: float = 0.0,
    actuated: tuple[str, ...] = (),
) -> Robot:
    """Return a body on joints in series, the first one at a height, its contact at its origin."""
    model = pin.Model()
    model.name = name
    i, placement = 0, pin.SE3(np.eye(3), np.array([0.0, 0.0, height]))
    for joint, kind in joints.items():
        i, placement = model.addJoint(i, kind, placement, joint), pin.SE3.Identity()
    model.appendBodyToJoint(i, inertia, placement)
    (frame,) = contact.frames
    model.addFrame(pin.Frame(frame, i, 0, placement, pin.FrameType.OP_FRAME))
    return Robot(
        name,
        model,
        postures=postures,
        contacts=(contact,),
        actuated=actuated,
        source=SOURCE,
        licence=LICENCE,
    )


@mechanism
def rolling_ball(*, radius: float = 0.1, mass: float = 0.5) -> Robot:
    """Return a solid ball that floats, and rolls on the world's plane z = 0 by its contact.

    With the torque tau, J = (2/5) mass radius^2, p the middle, n the vertical and any force f,

        (J + mass radius^2) p'' = radius tau x n + radius^2 f,    level parts,
        J omega_n' = tau_n,

    so that it comes down a slope of angle s with (5/7) g sin(s).

    Parameters
    ----------
    radius : float
        Radius [m].
    mass : float
        Mass [kg].

    Returns
    -------
    Robot
        A free-flyer and its ready-made contact.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    Notes
    -----
    The contact is among the ready-made ones: ``Scene(robot, robot.contacts)``.
    """
    check_positive(radius=radius, mass=mass)
    return _robot(
        "rolling_ball",
        {"floating": pin.JointModelFreeFlyer()},
        pin.Inertia.FromSphere(mass, radius),
        RollingBall("centre", radius, height=0.0, name="skin"),
        {"origin": _leaning_disc(radius, 0.0)},
    )


@mechanism
def rolling_disc(*, radius: float = 0.1, mass: float = 0.5) -> Robot:
    """Return a thin disc that floats, and rolls on the world's plane z = 0 by its contact.

    With A = mass radius^2 / 4 across and C = 2 A about the axle, theta the angle between the axle
    and the vertical, precession Omega about the vertical and w3 the turn rate about the axle, it
    turns steadily in a circle if

        A Omega^2 sin(theta) cos(theta) - (C + mass radius^2) w3 Omega sin(theta)
            = mass g radius cos(theta),

    and rolls straight without falling over if w3^2 > g / (3 radius).

    Parameters
    ----------
    radius : float
        Radius [m].
    mass : float
        Mass [kg].

    Returns
    -------
    Robot
        A free-flyer and its ready-made contact.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    Notes
    -----
    The axle is y of the frame ``centre``. The contact is among the ready-made ones:
    ``Scene(robot, robot.contacts)``. At the posture ``leaning`` the axle is 0.3 rad off the level.

    References
    ----------
    O'Reilly. The dynamics of rolling disks and sliding disks. Nonlinear Dynamics 10, 1996.
    """
    check_positive(radius=radius, mass=mass)
    return _robot(
        "rolling_disc",
        {"floating": pin.JointModelFreeFlyer()},
        disc(radius, mass),
        RollingWheel("centre", radius, height=0.0, name="rim"),
        {"upright": _leaning_disc(radius, 0.0), "leaning": _leaning_disc(radius, 0.3)},
    )


def _leaning_disc(radius: float, angle: float) -> Array:
    """Return a disc on the plane, turned about x [rad]."""
    height = radius * np.cos(angle)
    return np.array([0.0, 0.0, height, np.sin(angle / 2), 0.0, 0.0, np.cos(angle / 2)])


@mechanism
def unicycle(*, radius: float = 0.3, mass: float = 2.0) -> Robot:
    """Return an upright disc on a level plane, with motors about the vertical and the axle.

    q = (x, y, heading, roll). With A = mass radius^2 / 4 and C = mass radius^2 / 2,

        A heading'' = tau_heading,    (C + mass radius^2) roll'' = tau_roll,
        x' = radius roll' cos(heading),    y' = radius roll' sin(heading).

    Two directions of motion lead to every (x, y, heading, roll): it parks.

    Parameters
    ----------
    radius : float
        Radius [m].
    mass : float
        Mass [kg].

    Returns
    -------
    Robot
        Four joints and its ready-made wheel.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    Notes
    -----
    Its wheel is among the ready-made contacts: ``Scene(robot, robot.contacts)``.
    """
    check_positive(radius=radius, mass=mass)
    joints = {
        "x": pin.JointModelPX(),
        "y": pin.JointModelPY(),
        "heading": pin.JointModelRZ(),
        "roll": pin.JointModelRY(),
    }
    wheel = RollingWheel("wheel", radius, holds=("rolling", "lateral"))
    return _robot(
        "unicycle",
        joints,
        disc(radius, mass),
        wheel,
        {"origin": np.zeros(4)},
        height=radius,
        actuated=("heading", "roll"),
    )


@mechanism
def sleigh(*, arm: float = 0.2, mass: float = 1.0, inertia: float = 0.1) -> Robot:
    """Return a body that slides on a level plane, on a blade that does not slip sideways.

    With u the speed of the blade, omega the turn rate and J = inertia + mass arm^2,

        u' = arm omega^2,    J omega' = -mass arm u omega,

    so that it ends up gliding straight, blade behind and centre of mass ahead. From the start
    u = 0, omega = W, with U = W sqrt(J / mass) and k = mass arm U / J,

        u = U tanh(k t),    omega = W / cosh(k t).

    Parameters
    ----------
    arm : float
        From the blade forward to the centre of mass [m].
    mass : float
        Mass [kg].
    inertia : float
        About the vertical through the centre of mass [kg m^2].

    Returns
    -------
    Robot
        Three joints and its ready-made blade.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    Notes
    -----
    Its blade is among the ready-made contacts: ``Scene(robot, robot.contacts)``.

    References
    ----------
    Neimark, Fufaev. Dynamics of Nonholonomic Systems. American Mathematical Society, 1972.
    """
    check_positive(arm=arm, mass=mass, inertia=inertia)
    body = pin.Inertia(mass, np.array([arm, 0.0, 0.0]), inertia * np.eye(3))
    plane = {"plane": pin.JointModelPlanar()}
    return _robot(
        "sleigh",
        plane,
        body,
        KnifeEdge("blade", axis="y"),
        {"origin": np.array([0.0, 0.0, 1.0, 0.0])},
    )


def car(*, trailers: int = 0, wheelbase: float = 2.5, hitch: float = 2.0) -> Robot:
    """Return a car on a level plane, by one wheel an axle, with trailers on its rear axle.

    q = (x, y, heading, steering, hitch_1, ...), x and y those of the rear axle; with u the speed
    there, theta_i the heading of trailer i and theta_0 = heading,

        x' = u cos(heading),    y' = u sin(heading),    heading' = u tan(steering) / wheelbase,
        theta_i' = u_(i-1) sin(theta_(i-1) - theta_i) / hitch,
        u_i = u_(i-1) cos(theta_(i-1) - theta_i).

    Two directions of motion lead to every q, by brackets of depth 3 + trailers.

    Parameters
    ----------
    trailers : int
        How many, one behind the other.
    wheelbase : float
        From the rear axle to the front one [m].
    hitch : float
        From an axle to that of the next trailer [m].

    Returns
    -------
    Robot
        Its ready-made blades are the axles: ``Scene(robot, robot.contacts)``.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number, or `trailers` is no count.

    Notes
    -----
    1000 kg, 10 kg of steered wheels, 300 kg a trailer. An engine is an `AppliedForce` on ``rear``,
    along its x.

    References
    ----------
    Murray, Sastry. Nonholonomic motion planning: steering using sinusoids. IEEE Transactions on
    Automatic Control 38, 1993.
    """
    check_positive(wheelbase=wheelbase, hitch=hitch)
    check_count("trailers", trailers, least=0)
    model = pin.Model()
    model.name = "car"
    here, joint = pin.SE3.Identity(), 0
    for name, kind in (("x", pin.JointModelPX()), ("y", pin.JointModelPY()),
                       ("heading", pin.JointModelRZ())):  # fmt: skip
        joint = model.addJoint(joint, kind, here, name)
    blades = [KnifeEdge("rear"), KnifeEdge("front")]
    middle = pin.SE3(np.eye(3), np.array([wheelbase / 2, 0.0, 0.0]))
    model.appendBodyToJoint(joint, pin.Inertia.FromBox(1000.0, 1.5 * wheelbase, 1.6, 1.2), middle)
    _add_frame(model, "rear", joint)
    ahead = pin.SE3(np.eye(3), np.array([wheelbase, 0.0, 0.0]))
    steering = model.addJoint(joint, pin.JointModelRZ(), ahead, "steering")
    model.appendBodyToJoint(steering, pin.Inertia.FromSphere(10.0, 0.3), here)
    _add_frame(model, "front", steering)
    behind = pin.SE3(np.eye(3), np.array([-hitch, 0.0, 0.0]))
    place = here
    for i in range(1, trailers + 1):
        joint = model.addJoint(joint, pin.JointModelRZ(), place, f"hitch_{i}")
        model.appendBodyToJoint(joint, pin.Inertia.FromBox(300.0, hitch, 1.5, 1.0), behind)
        model.addFrame(pin.Frame(f"axle_{i}", joint, 0, behind, pin.FrameType.OP_FRAME))
        blades.append(KnifeEdge(f"axle_{i}"))
        place = behind
    return Robot(
        "car",
        model,
        postures={"origin": np.zeros(model.nq)},
        contacts=tuple(blades),
        actuated=("steering",),
        source=SOURCE,
        licence=LICENCE,
    )


def ackermann(*, wheelbase: float = 2.5, track: float = 1.4, arm: float = 0.15) -> Robot:
    """Return the trapezoid that steers two front wheels: kingpins, arms and a tie rod.

    Both wheels roll about one centre on the line of the rear axle if

        cot(outer) - cot(inner) = track / wheelbase,

    which a trapezoid whose arms point to the middle of the rear axle comes near to.

    Parameters
    ----------
    wheelbase : float
        From the rear axle to the kingpins [m].
    track : float
        From one kingpin to the other [m].
    arm : float
        From a kingpin to the end of the tie rod [m].

    Returns
    -------
    Robot
        Two hinges, ``left`` and ``right``, and the tie rod as its loop; the rack drives the left.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    References
    ----------
    Gillespie. Fundamentals of Vehicle Dynamics. SAE International, 1992.
    """
    check_positive(wheelbase=wheelbase, track=track, arm=arm)
    model = pin.Model()
    model.name = "ackermann"
    inwards = np.arctan2(track / 2, wheelbase)  # of the arms, which point back
    ends = []
    for side, name in ((1.0, "left"), (-1.0, "right")):
        at = pin.SE3(np.eye(3), np.array([wheelbase, side * track / 2, 0.0]))
        joint = model.addJoint(0, pin.JointModelRZ(), at, name)
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(10.0, 0.3), pin.SE3.Identity())
        end = arm * np.array([-np.cos(inwards), -side * np.sin(inwards), 0.0])
        frame = pin.Frame(f"{name}_arm", joint, 0, pin.SE3(np.eye(3), end), pin.FrameType.OP_FRAME)
        model.addFrame(frame)
        ends.append(at.act(end))
    length = float(ends[0][1] - ends[1][1])
    rod = Loop("left_arm", "right_arm", "rod", length=length, name="tie_rod")
    return Robot(
        "ackermann",
        model,
        postures={"straight": np.zeros(2)},
        loops=(rod,),
        actuated=("left",),
        source=SOURCE,
        licence=LICENCE,
    )


def _add_frame(model: object, name: str, joint: int) -> None:
    """Add a frame at the origin of a joint."""
    frame = pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
    model.addFrame(frame)  # type: ignore[attr-defined]
