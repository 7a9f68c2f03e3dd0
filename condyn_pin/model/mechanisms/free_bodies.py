"""Bodies that fly, fall and hit: a ball, a box, and Painlevé's rod."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import Vector3, check_positive, floats
from condyn_pin.model.mechanisms.machine import LICENCE, SOURCE, mechanism, rod
from condyn_pin.model.robot import Robot


@mechanism
def free_ball(*, mass: float = 1.0, radius: float = 0.05) -> Robot:
    """Return a solid ball that floats, its frame ``ball`` in the middle.

    Dropped from a height h above a floor with restitution e it is there after t0 = sqrt(2 h / g),
    comes back to e^2 h, then to e^4 h, and rests after

        t0 (1 + e) / (1 - e).

    Parameters
    ----------
    mass : float
        Mass [kg].
    radius : float
        Radius [m].

    Returns
    -------
    Robot
        A free-flyer; at its posture ``resting`` it lies on z = 0.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    Notes
    -----
    What it touches is a choice: ``FrictionalContact("ball", Ball(radius), friction=...)``.
    """
    check_positive(mass=mass, radius=radius)
    return _floating("free_ball", "ball", pin.Inertia.FromSphere(mass, radius), radius)


@mechanism
def free_box(*, mass: float = 1.0, size: Vector3 = (0.2, 0.2, 0.2)) -> Robot:
    """Return a solid box that floats, its frame ``box`` in the middle.

    On a slope of angle s with the friction mu it stays where it is if tan(s) <= mu, and else comes
    down with g (sin(s) - mu cos(s)). With the velocity v on a level floor it stops after

        v^2 / (2 mu g).

    Parameters
    ----------
    mass : float
        Mass [kg].
    size : (3,) sequence of float
        Its edges [m].

    Returns
    -------
    Robot
        A free-flyer; at its posture ``resting`` it lies on z = 0.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    Notes
    -----
    What it touches is a choice: ``FrictionalContact("box", Box(x / 2, y / 2, z / 2),
    friction=...)``, whose numbers are half of its edges.
    """
    x, y, z = floats("size", size, 3)
    check_positive(mass=mass)
    check_positive("length [m]", **{f"size[{i}]": edge for i, edge in enumerate((x, y, z))})
    return _floating("free_box", "box", pin.Inertia.FromBox(mass, x, y, z), z / 2)


@mechanism
def painleve_rod(*, length: float = 2.0, mass: float = 1.0) -> Robot:
    """Return a slender rod that moves in the plane x z, for its lower end ``tip`` to slide on.

    q = (x, z, theta): the middle, and the angle of the rod from x towards z. While the tip slides
    towards -x on z = 0 with the normal force N and the friction mu N,

        mass z_tip'' = A N - mass b,    A = 1 + 3 cos(theta)^2 - 3 mu sin(theta) cos(theta),
        b = g - (length / 2) sin(theta) theta'^2.

    Where A < 0 < b there is no force N >= 0: Painlevé's paradox. It needs mu > 4/3, and first
    comes at tan(theta) = 2. Only an impulse stops the tip: at tan(theta) = 2, and the velocity
    (-v, 0) of all its points, it is

        mass v (2/5, 3/10).

    Parameters
    ----------
    length : float
        Length of the rod [m].
    mass : float
        Mass [kg].

    Returns
    -------
    Robot
        Three joints; at its posture ``paradox`` the tip is on z = 0 and tan(theta) = 2.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    References
    ----------
    Painlevé. Sur les lois du frottement de glissement. Comptes rendus 121, 1895.
    Génot, Brogliato. New results on Painlevé paradoxes. European Journal of Mechanics A 18, 1999.
    """
    check_positive(length=length, mass=mass)
    model = pin.Model()
    model.name = "painleve_rod"
    i, here = 0, pin.SE3.Identity()
    turn = pin.JointModelRevoluteUnaligned(np.array([0.0, -1.0, 0.0]))
    joints = {"x": pin.JointModelPX(), "z": pin.JointModelPZ(), "theta": turn}
    for name, joint in joints.items():
        i = model.addJoint(i, joint, here, name)
    tip = pin.SE3(np.eye(3), np.array([-length / 2, 0.0, 0.0]))
    model.appendBodyToJoint(i, rod(length, mass), tip)
    model.addFrame(pin.Frame("tip", i, 0, tip, pin.FrameType.OP_FRAME))
    theta = math.atan(2.0)
    paradox = np.array([0.0, length / 2 * math.sin(theta), theta])
    return _robot("painleve_rod", model, {"paradox": paradox})


def _floating(name: str, frame: str, inertia: Any, height: float) -> Robot:
    """Return a body that floats, with a frame in its middle."""
    model = pin.Model()
    model.name = name
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "floating")
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame(frame, joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    resting = np.array([0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0])
    return _robot(name, model, {"resting": resting})


def _robot(name: str, model: Any, postures: Mapping[str, Array]) -> Robot:
    return Robot(name, model, postures=postures, source=SOURCE, licence=LICENCE)
