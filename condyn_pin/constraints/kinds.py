"""All kinds of constraints, and how some of them are bound to a robot.

Those of the library are imported here, others register themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from condyn_pin.constraints.constraint import KINDS, Constraint, FramedModel
from condyn_pin.constraints.rows.bound import BoundConstraint
from condyn_pin.errors import InvalidConstraint

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
from condyn_pin.constraints.held_joint import HeldJoint as HeldJoint
from condyn_pin.constraints.taut_cable import TautCable as TautCable
from condyn_pin.constraints.own_rows import OwnRows as OwnRows
from condyn_pin.constraints.driven import Driven as Driven
# ruff: isort: on


def kind_named(name: str) -> type[Constraint] | None:
    """Kind of constraint with a name, or None."""
    return KINDS.get(name)


def of_loops() -> tuple[type[Constraint], ...]:
    """Kinds of constraints that robots list among their loops."""
    return tuple(kind for kind in KINDS.values() if kind.closes)


def kinds_by_word(*, closes: bool) -> dict[str, type[Constraint]]:
    """Kinds of loops, or of contacts, by their word in robot.toml."""
    own = [kind for kind in KINDS.values() if vars(kind).get("word")]
    return {kind.word: kind for kind in own if kind.closes == closes}


def bind(robot: FramedModel, constraints: Sequence[Constraint]) -> tuple[BoundConstraint, ...]:
    """Bind constraints to a robot, rows in the order given.

    Where Pinocchio solves, every constraint is solved in the LOCAL frame with a moving joint
    first and the other body, or the world, second: the one combination in which none of its
    algorithms is wrong.

    Raises
    ------
    InvalidConstraint
        If two constraints share a name, or one of them cannot constrain any motion.
    UnknownName
        If a frame or a joint does not exist.
    """
    bound: list[BoundConstraint] = []
    start = 0
    for constraint in constraints:
        if not isinstance(constraint, Constraint):
            raise InvalidConstraint(
                f"{constraint!r}: a contact (PointContact, SurfaceContact, LineContact, "
                "PlanarContact), what rolls or glides (RollingWheel, RollingBall, KnifeEdge), "
                "a HeldJoint, a Loop, a Coupling or a TautCable is needed, Driven or not; what "
                "opens belongs into contacts=[...]"
            )
        if any(constraint.name == other.name for other in bound):
            raise InvalidConstraint(
                f"two constraints are named {constraint.name!r}; give one of them a name=..."
            )
        rows = slice(start, start + constraint.rows)
        made = constraint.bind(robot, rows)
        if constraint.drift:
            made = replace(made, drift=constraint.drift)  # type: ignore[type-var]
        if constraint.axes is not None:
            _check_axes(robot, constraint)
        joint = made.one_body
        if joint is not None:
            where = "the world" if joint == 0 else f"joint {robot.model.names[joint]!r}"
            raise InvalidConstraint(
                f"{constraint.name}: both sides belong to {where}, so it constrains nothing; "
                "name frames on two bodies that move against each other"
            )
        bound.append(made)
        start = rows.stop
    return tuple(bound)


def _check_axes(robot: FramedModel, constraint: Constraint) -> None:
    """Refuse axes of a force that has none, and a frame of them that does not exist."""
    if not constraint.frames:
        raise InvalidConstraint(
            f"{constraint.name}: axes = {constraint.axes!r}, and a {constraint.called} acts along "
            "joints; leave them out"
        )
    robot.frame(constraint.axes)
