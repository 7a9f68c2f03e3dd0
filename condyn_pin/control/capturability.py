"""Capturability: how fast a robot may move towards an edge and yet stop without a step.

The linear inverted pendulum of constant height h, whose pressure p is no further than the edge, at
a distance d ahead of c, and whose force leans no more than friction lets it,

    cddot = omega^2 (c - p),    omega = sqrt(g / h),    p <= c + d,    |p - c| <= mu h,

brakes best with p as far ahead as it may be, and comes to rest at the edge from

    v = omega d                         where d <= mu h: the capture point is at the edge,
    v = sqrt(mu g (2 d - mu h))         beyond: it brakes by mu g until the edge is at mu h.
"""

from __future__ import annotations

from math import inf, isfinite, sqrt
from numbers import Real

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import finite
from condyn_pin.constraints.base import check_positive
from condyn_pin.errors import InvalidArgument


def capturable_speed(
    reach: float, height: float, *, friction: float = inf, gravity: float = tolerances.GRAVITY
) -> float:
    """Return the largest speed from which an inverted pendulum stops without a step [m/s].

    v = omega d,    or sqrt(mu g (2 d - mu h)) where d > mu h

    An impulse of m v through the centre of mass is the largest that a robot at rest can withstand
    at constant height and without angular momentum; by swinging arms and trunk it may withstand a
    little more.

    Parameters
    ----------
    reach : float
        From the centre of mass to the edge of its support, along the motion: d [m]. None is left
        where it is negative.
    height : float
        Of the centre of mass over the floor, h [m].
    friction : float
        Of the floor, mu [1]; infinite by default.
    gravity : float
        Acceleration of gravity [m/s^2].

    Returns
    -------
    float
        The speed [m/s]; zero where nothing is left to reach, or without friction.

    Raises
    ------
    InvalidArgument
        If the height or gravity is not positive, or friction is negative.

    References
    ----------
    Koolen, de Boer, Rebula, Goswami, Pratt. Capturability-based analysis and control of legged
    locomotion, part 1. International Journal of Robotics Research, 2012.
    """
    check_positive("length [m]", height=height)
    check_positive("acceleration [m/s^2]", gravity=gravity)
    d = max(float(finite("reach", reach, ())), 0.0)
    if isinstance(friction, bool) or not isinstance(friction, Real) or not friction >= 0:
        raise InvalidArgument(f"friction = {friction!r}: a number >= 0 is needed")
    leans = friction * height
    speed = sqrt(gravity / height) * d if d <= leans else sqrt(friction * gravity * (2 * d - leans))
    if not isfinite(speed):
        raise InvalidArgument(f"reach = {reach!r}: the speed overflows; a smaller one is needed")
    return speed
