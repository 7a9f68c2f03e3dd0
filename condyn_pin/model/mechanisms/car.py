"""A car with trailers, seen from above, and the linkage that steers two wheels at once."""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.constraints.knife_edge import KnifeEdge
from condyn_pin.constraints.loop import Loop
from condyn_pin.model.mechanisms.registry import LICENCE, source
from condyn_pin.model.robot import Robot


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
        source=source("car"),
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
        source=source("car"),
        licence=LICENCE,
    )


def _add_frame(model: object, name: str, joint: int) -> None:
    """Add a frame at the origin of a joint."""
    frame = pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
    model.addFrame(frame)  # type: ignore[attr-defined]
