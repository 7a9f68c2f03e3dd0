"""From the constraints of a user to bound ones.

Where Pinocchio takes part, every constraint is solved in the LOCAL frame with a moving joint first
and the other body, or the world, second: the one combination in which none of its algorithms is
wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

from condyn_pin.constraints.base import Constraint, Machine
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.errors import InvalidConstraint


def bind(robot: Machine, constraints: Sequence[Constraint]) -> tuple[AnyBound, ...]:
    """Bind constraints to a robot, rows in the order given.

    Raises
    ------
    InvalidConstraint
        If two constraints share a name, or one of them cannot constrain any motion.
    UnknownName
        If a frame or a joint does not exist.
    """
    bound: list[AnyBound] = []
    start = 0
    for constraint in constraints:
        if not isinstance(constraint, Constraint):
            raise _unknown(constraint)
        if any(constraint.name == other.name for other in bound):
            raise InvalidConstraint(
                f"two constraints are named {constraint.name!r}; give one of them a name=..."
            )
        rows = slice(start, start + constraint.rows)
        made = constraint.bind(robot, rows)
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


def _unknown(constraint: object) -> InvalidConstraint:
    return InvalidConstraint(
        f"{constraint!r}: a contact (PointContact, SurfaceContact, LineContact, PlanarContact), "
        "what rolls or glides (RollingWheel, RollingBall, KnifeEdge), a Loop or a Coupling "
        "is needed"
    )
