"""MotionLimits: how far a motion may stray from its own laws and still be ok."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isnan
from typing import Any

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import shown
from condyn_pin._core.threads import Kept
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.manifold import Manifold

# Every motion of a batch is judged by it.
_gaps = Kept[float]()


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """How far a motion may stray from its own laws and still be ok.

    Sizes are those of the machine: a thousandth of the distance over which its joints are spread,
    0.2 mm or mrad at least and 1 cm or 10 mrad at most. ``inf`` switches a limit off.

    Parameters
    ----------
    violation : float, optional
        Gap of a constraint [m, rad]. By default the size above; no limit where `solver` lets
        constraints give way. Twice the gap of a start that ``close_start=False`` left open is
        always within it.
    constraint_velocity : float, optional
        abs(J v) [m/s, rad/s]. By default 1 % of the largest velocity, or of 1 rad/s, and 2 dt gamma
        more, for schemes with contacts are tangent in the middle of a step; from where an open
        start is closed, and not where constraints give way.
    penetration : float, optional
        Depth of a contact [m], and how far a joint passes a stop of the scene [rad, m], beyond the
        depth at the start. By default the size above, 1 mm or mrad at least, and dt times the
        fastest rate of the gap more by schemes that push nothing out; no limit where contacts give
        way, as in `SoftStep`.
    energy : float
        Energy that appeared or vanished without work, as a share of the largest exchange [1].
        What gravity and torques exchange in one step is within it by schemes of order 1.
    error : float
        `Trajectory.error` from which on a notice names it, as a share of how far bodies moved [1].

    Raises
    ------
    InvalidArgument
        If one is not positive.
    """

    violation: float | None = None  # [m, rad]
    constraint_velocity: float | None = None  # [m/s, rad/s]
    penetration: float | None = None  # [m, rad]
    energy: float = tolerances.UNBALANCED
    error: float = tolerances.OFF

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = getattr(self, name)
            if value is None and name not in ("energy", "error"):
                continue
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if not is_number or isnan(value) or value <= 0:
                raise InvalidArgument(f"{name} = {shown(value)}: a number > 0 is needed")


def check_limits(limits: object) -> MotionLimits:
    """Return the limits of a motion: those by default for None."""
    if limits is None:
        return MotionLimits()
    if not isinstance(limits, MotionLimits):
        raise InvalidArgument(f"limits = {shown(limits)}: MotionLimits(...) is needed")
    return limits


def default_gap(robot: Robot) -> float:
    """Largest gap of a constraint [m, rad] in a motion that is ok, by default."""
    return _gaps.of(robot, None, lambda: _gap_of(robot.unedited))


def _gap_of(model: Any) -> float:
    size = tolerances.LEFT_OPEN * Manifold(model).reach
    return min(max(size, 2 * tolerances.NEARLY_CLOSED), tolerances.OUT_OF_REACH)
