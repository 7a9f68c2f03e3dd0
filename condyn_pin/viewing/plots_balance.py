"""Diagrams of balance along a motion: points of pressure and capture seen from above, and margins.

All points are in the axes of the world, x and y [m]. With c the centre of mass, h its height above
the plane of the contacts, omega = sqrt(g / h) and (f, n) what the motion needs from the floor:

    ZMP             where (f, n) leaves a moment along the normal alone; of the motion alone
    CoP             the mean of the contact points, weighted by normal forces; of the forces alone
    DCM             c + cdot / omega, and the capture point is its foot on the plane

ZMP and CoP are one where nothing but the floor acts from outside. They, and the support polygon,
are there while all contacts that touch are on one plane; the capture point is that of a linear
inverted pendulum, whose height and angular momentum do not change. In flight there is none of them.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from condyn_pin._core.arrays import shown
from condyn_pin._core.show import axes, finished, line
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.motion_balance import MotionBalance, motion_balance
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.viewing.plots_motion import TIME, mark_events, title_of

_SAME: Final = 1e-3  # [m] supports whose corners are nearer are drawn once


def from_above(
    trajectory: Trajectory, ax: Any = None, *, found: MotionBalance | None = None
) -> Any:
    """Draw the paths of centre of mass, ZMP, CoP and capture point over the support, from above.

    Each path starts at its dot; every support polygon of the motion is an area.

    Parameters
    ----------
    trajectory : Trajectory
    ax : matplotlib axes, optional
        A new figure by default.
    found : MotionBalance, optional
        That of the trajectory, if it is known; it is computed by default.

    Returns
    -------
    matplotlib axes
        x and y of the world [m], with one scale; heights are left out.

    Raises
    ------
    InvalidArgument
        If nothing of it could press on a floor, or what was found is of another motion.
    """
    found = _found(trajectory, found)
    ax = axes(ax)
    for i, corners in enumerate(_supports(found)):
        ax.fill(*corners.T, facecolor="0.5", edgecolor="0.3", alpha=0.15, lw=0.8,
                label="" if i else "support")  # fmt: skip
    ways = {
        "centre of mass": found.com,
        "ZMP": found.zmp,
        "CoP": found.cop,
        "capture point": found.capture_point,
    }
    for i, (label, points) in enumerate(ways.items()):
        drawn = ax.plot(points[:, 0], points[:, 1], label=label, **line(i))[0]
        known = np.flatnonzero(np.isfinite(points[:, 0]))
        if len(known):
            start = points[known[0]]
            ax.plot(start[0], start[1], "o", ms=4, color=drawn.get_color(), label="_start")
    finished(ax, title=title_of(trajectory), x="x [m]", y="y [m]")
    ax.set_aspect("equal", adjustable="datalim")
    return ax


def margins(trajectory: Trajectory, ax: Any = None, *, found: MotionBalance | None = None) -> Any:
    """Draw the margins of ZMP, CoP and capture point to the support polygon's edge over time.

    A CoP is never below zero. A ZMP below zero says that more than the floor acted, a push above
    all, and a capture point that the robot falls unless it steps. There is no line in flight.

    Parameters
    ----------
    trajectory : Trajectory
    ax : matplotlib axes, optional
        A new figure by default.
    found : MotionBalance, optional
        That of the trajectory, if it is known; it is computed by default.

    Returns
    -------
    matplotlib axes
        One line each: the distance to the nearest edge [m].

    Raises
    ------
    InvalidArgument
        If nothing of it could press on a floor, or what was found is of another motion.
    """
    found = _found(trajectory, found)
    ax = axes(ax)
    lines = {
        "ZMP": found.zmp_margin,
        "CoP": found.cop_margin,
        "capture point": found.capture_margin,
    }
    for i, (label, values) in enumerate(lines.items(), start=1):
        ax.plot(found.t, values, label=label, **line(i))
    ax.axhline(0.0, color="0.6", lw=0.8)
    mark_events(trajectory, ax)
    return finished(ax, title=title_of(trajectory), x=TIME, y="within the support by [m]")


def _found(trajectory: Trajectory, found: MotionBalance | None) -> MotionBalance:
    """Balance of a motion, computed unless it is given."""
    if found is None:
        return motion_balance(trajectory)
    if not (isinstance(found, MotionBalance) and np.array_equal(found.t, trajectory.t)):
        raise InvalidArgument(
            f"found = {shown(found)}: it is not of this motion; motion_balance(trajectory) is"
        )
    return found


def _supports(found: MotionBalance) -> list[Any]:
    """Distinct support polygons of a motion (k, 2), their corners in the world [m]."""
    seen: dict[bytes, Any] = {}
    for polygon in found.polygons:
        if polygon is not None:
            corners = polygon.in_world[:, :2]
            seen.setdefault(np.round(corners / _SAME).tobytes(), corners)
    return list(seen.values())
