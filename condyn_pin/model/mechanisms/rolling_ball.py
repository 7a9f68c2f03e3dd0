"""A ball that rolls on a table."""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.constraint_fields import check_positive
from condyn_pin.constraints.rolling_ball import RollingBall
from condyn_pin.model.mechanisms.base import LICENCE, floating_body, mechanism, source
from condyn_pin.model.robot import Robot


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
    The contact is among the ready-made ones: ``Scene(robot, robot.contacts)``.
    """
    check_positive(radius=radius, mass=mass)
    return Robot(
        "rolling_ball",
        floating_body("rolling_ball", pin.Inertia.FromSphere(mass, radius)),
        postures={"origin": np.array([0.0, 0.0, radius, 0.0, 0.0, 0.0, 1.0])},
        contacts=(RollingBall("centre", radius, height=0.0, name="skin"),),
        source=source("rolling_ball"),
        licence=LICENCE,
    )
