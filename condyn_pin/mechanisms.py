"""Small mechanisms built without any file."""

from __future__ import annotations

import math
from collections.abc import Callable
from numbers import Real
from typing import Any

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.constraints import Loop
from condyn_pin.errors import InvalidArgument
from condyn_pin.robot import Robot

_LICENCE = "BSD-2-Clause (this project)"


def pendulum(*, length: float = 1.0, mass: float = 1.0) -> Robot:
    """Return a point mass on a massless rod that turns about the world's y axis.

    theta'' = -(g / length) sin(theta), with theta = 0 hanging.

    Parameters
    ----------
    length : float
        Length of the rod [m].
    mass : float
        Mass at its end [kg].
    """
    _positive(length=length, mass=mass)
    model = pin.Model()
    model.name = "pendulum"
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "pivot")
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, -length]))
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.zeros(3), np.zeros((3, 3))), tip)
    model.addFrame(pin.Frame("tip", joint, 0, tip, pin.FrameType.OP_FRAME))
    return Robot(
        "pendulum",
        model,
        postures={"hanging": np.zeros(1), "horizontal": np.array([math.pi / 2])},
        actuated=("pivot",),
        source="built in condyn_pin/mechanisms.py",
        licence=_LICENCE,
    )


def four_bar(
    *,
    ground: float = 0.7,
    crank: float = 0.3,
    coupler: float = 0.8,
    rocker: float = 0.6,
    density: float = 2.5,
) -> Robot:
    """Return a planar four-bar linkage of slender rods in the world's x-z plane.

    The tree is crank -> coupler and rocker, both on the ground; one ball loop joins coupler and
    rocker. Its 3 rows have rank 2 at every configuration, because nothing moves along y: the
    smallest mechanism on which an undamped solve gives NaN.

    Parameters
    ----------
    ground, crank, coupler, rocker : float
        Lengths of the four bars [m].
    density : float
        Mass of the rods per length [kg/m].
    """
    _positive(ground=ground, crank=crank, coupler=coupler, rocker=rocker, density=density)
    lengths = sorted((ground, crank, coupler, rocker))
    if lengths[3] >= sum(lengths[:3]):
        raise InvalidArgument(
            f"a bar of {lengths[3]} m cannot be closed by bars of {lengths[:3]} m: "
            "the longest must be shorter than the sum of the others"
        )
    model = pin.Model()
    model.name = "four_bar"
    joints: dict[str, int] = {}
    for name, parent, at, length in (
        ("crank", "", 0.0, crank),
        ("coupler", "crank", crank, coupler),
        ("rocker", "", ground, rocker),
    ):
        # about -y, so that angles count from x towards z
        joint = model.addJoint(
            joints.get(parent, 0),
            pin.JointModelRevoluteUnaligned(np.array([0.0, -1.0, 0.0])),
            _along_x(at),
            name,
        )
        model.appendBodyToJoint(joint, _rod(length, density * length), pin.SE3.Identity())
        frame = pin.Frame(f"{name}_tip", joint, 0, _along_x(length), pin.FrameType.OP_FRAME)
        model.addFrame(frame)
        joints[name] = joint
    return Robot(
        "four_bar",
        model,
        postures={"open": _four_bar_posture(ground, crank, coupler, rocker)},
        loops=(Loop("coupler_tip", "rocker_tip", name="coupler_rocker"),),
        actuated=("crank",),
        source="built in condyn_pin/mechanisms.py",
        licence=_LICENCE,
    )


def _along_x(x: float) -> Any:
    return pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))


def _rod(length: float, mass: float) -> Any:
    # a slender rod along x, a thousandth of its length thick so that no inertia is zero
    across = mass * length**2 / 12
    return pin.Inertia(
        mass, np.array([length / 2, 0.0, 0.0]), np.diag([1e-6 * across, across, across])
    )


def _four_bar_posture(ground: float, crank: float, coupler: float, rocker: float) -> Array:
    """Return angles at which the bars meet, in the middle of the crank's range.

    The crank's tip B is at a distance r from the rocker's pivot D; coupler and rocker reach it if
    |coupler - rocker| < r < coupler + rocker, the crank if |ground - crank| < r < ground + crank.
    """
    nearest = max(abs(coupler - rocker), abs(ground - crank))
    farthest = min(coupler + rocker, ground + crank)
    r = (nearest + farthest) / 2
    theta = math.acos((ground**2 + crank**2 - r**2) / (2 * ground * crank))
    B = crank * np.array([math.cos(theta), math.sin(theta)])
    D = np.array([ground, 0.0])
    along = (coupler**2 - rocker**2 + r**2) / (2 * r)
    up = math.sqrt(coupler**2 - along**2)
    e = (D - B) / r
    C = B + along * e + up * np.array([-e[1], e[0]])
    of_coupler, of_rocker = (math.atan2(*(C - end)[::-1]) for end in (B, D))
    return np.array([theta, of_coupler - theta, of_rocker])


def _positive(**lengths: float) -> None:
    for name, value in lengths.items():
        if not (isinstance(value, Real) and math.isfinite(value) and value > 0):
            raise InvalidArgument(f"{name} = {value!r}: a positive number is needed")


MECHANISMS: dict[str, Callable[[], Robot]] = {"four_bar": four_bar, "pendulum": pendulum}
