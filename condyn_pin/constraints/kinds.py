"""All kinds of constraints: those of the library are imported here, others register themselves."""

from __future__ import annotations

from condyn_pin.constraints.base import KINDS, Constraint

# ruff: isort: off
# In the order in which messages list them.
from condyn_pin.constraints.point_contact import PointContact as PointContact
from condyn_pin.constraints.surface_contact import SurfaceContact as SurfaceContact
from condyn_pin.constraints.line_contact import LineContact as LineContact
from condyn_pin.constraints.planar_contact import PlanarContact as PlanarContact
from condyn_pin.constraints.loop import Loop as Loop
from condyn_pin.constraints.coupling import Coupling as Coupling
from condyn_pin.constraints.knife_edge import KnifeEdge as KnifeEdge
from condyn_pin.constraints.rolling_wheel import RollingWheel as RollingWheel
from condyn_pin.constraints.rolling_ball import RollingBall as RollingBall
# ruff: isort: on


def named(name: str) -> type[Constraint] | None:
    """Return the kind of a name, if there is one."""
    return KINDS.get(name)


def of_loops() -> tuple[type[Constraint], ...]:
    """Return the kinds that robots list among their loops."""
    return tuple(kind for kind in KINDS.values() if kind.closes)


def worded(*, closes: bool) -> dict[str, type[Constraint]]:
    """Return the kinds of loops, or of contacts, that robot.toml has a word for."""
    own = [kind for kind in KINDS.values() if vars(kind).get("word")]
    return {kind.word: kind for kind in own if kind.closes == closes}
