"""A coin that rolls on a table, upright or leaning."""

from __future__ import annotations

import numpy as np

from condyn_pin.constraints.constraint_fields import check_positive
from condyn_pin.constraints.rolling_wheel import RollingWheel
from condyn_pin.model.mechanisms.base import (
    LICENCE,
    disc,
    floating_body,
    mechanism,
    source,
)
from condyn_pin.model.robot import Robot


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
        [m].
    mass : float
        [kg].

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
    return Robot(
        "rolling_disc",
        floating_body("rolling_disc", disc(radius, mass)),
        postures={"upright": _posture(radius, 0.0), "leaning": _posture(radius, 0.3)},
        contacts=(RollingWheel("centre", radius, height=0.0, name="rim"),),
        source=source("rolling_disc"),
        licence=LICENCE,
    )


def _posture(radius: float, lean: float) -> np.ndarray:
    """Return the disc on the plane, turned about x by `lean` [rad]."""
    height = radius * np.cos(lean)
    return np.array([0.0, 0.0, height, np.sin(lean / 2), 0.0, 0.0, np.cos(lean / 2)])
