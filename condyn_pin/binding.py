"""Constraints bound to a model: joints and placements in place of names.

Every constraint is solved in the LOCAL frame with a moving joint first and the other body, or the
world, second: the one combination in which none of Pinocchio's algorithms is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from condyn_pin._pin import LOCAL, pin
from condyn_pin.constraints import Constraint, Loop
from condyn_pin.contacts import PointContact, SurfaceContact
from condyn_pin.errors import InvalidConstraint
from condyn_pin.robot import Robot

_AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class Bound:
    """One constraint, bound.

    Attributes
    ----------
    name : str
    rows : slice
        Its rows among those of the scene.
    joint1, joint2 : int
        The moving joint, and the other one (0 is the world).
    placement1, placement2 : pin.SE3
        Frame c1 on joint 1, frame c2 on joint 2.
    anchored : bool
        False for a contact that belongs wherever it is: it has no position error.
    sign : float
        +1 if the force on the first-named body is the one on joint 1, else -1.
    """

    name: str
    rows: slice
    joint1: int
    placement1: Any
    joint2: int
    placement2: Any
    anchored: bool
    sign: float

    @property
    def size(self) -> int:
        """Number of rows: 3 or 6."""
        return int(self.rows.stop - self.rows.start)

    @property
    def row_names(self) -> tuple[str, ...]:
        """A name for each row: the constraint's and the axis."""
        return tuple(f"{self.name}.{axis}" for axis in _AXES[: self.size])

    def to_pinocchio(self, model: Any) -> Any:
        """Return the RigidConstraintModel of this constraint."""
        kind = pin.ContactType.CONTACT_3D if self.size == 3 else pin.ContactType.CONTACT_6D
        made = pin.RigidConstraintModel(
            kind, model, self.joint1, self.placement1, self.joint2, self.placement2, LOCAL
        )
        made.name = self.name
        return made


def bind(robot: Robot, constraints: Sequence[Constraint]) -> tuple[Bound, ...]:
    """Bind constraints to a robot, rows in the order given.

    Raises
    ------
    InvalidConstraint
        If two constraints share a name, or one of them cannot constrain any motion.
    UnknownName
        If a frame does not exist.
    """
    bound: list[Bound] = []
    start = 0
    for constraint in constraints:
        if not isinstance(constraint, Constraint):
            raise InvalidConstraint(
                f"{constraint!r}: a PointContact, a SurfaceContact or a Loop is needed"
            )
        if any(constraint.name == other.name for other in bound):
            raise InvalidConstraint(
                f"two constraints are named {constraint.name!r}; give one of them a name=..."
            )
        rows = slice(start, start + constraint.rows)
        bound.append(_bind(robot, constraint, rows))
        start = rows.stop
    return tuple(bound)


def _bind(robot: Robot, constraint: Constraint, rows: slice) -> Bound:
    joint1, placement1, joint2, placement2, anchored = _ends(robot, constraint)
    if joint1 == joint2:
        where = "the world" if joint1 == 0 else f"joint {robot.model.names[joint1]!r}"
        raise InvalidConstraint(
            f"{constraint.name}: both sides belong to {where}, so it constrains nothing; "
            "name frames on two bodies that move against each other"
        )
    sign = 1.0
    if joint1 == 0:  # the world first: exchange, and report the force with the other sign
        joint1, placement1, joint2, placement2, sign = joint2, placement2, joint1, placement1, -1.0
    return Bound(constraint.name, rows, joint1, placement1, joint2, placement2, anchored, sign)


def _ends(robot: Robot, constraint: Constraint) -> tuple[int, Any, int, Any, bool]:
    if isinstance(constraint, Loop):
        return *robot.frame(constraint.frame_a), *robot.frame(constraint.frame_b), True
    if isinstance(constraint, PointContact):
        joint, placement = robot.frame(constraint.frame)
        placement = placement * pin.SE3(np.eye(3), np.array(constraint.offset))
        anchor = constraint.anchor
        target = pin.SE3(np.eye(3), np.array(anchor)) if anchor else pin.SE3.Identity()
        return joint, placement, 0, target, anchor is not None
    if isinstance(constraint, SurfaceContact):
        joint, placement = robot.frame(constraint.frame)
        pose = constraint.anchor
        target = pin.XYZQUATToSE3(np.array(pose)) if pose else pin.SE3.Identity()
        return joint, placement, 0, target, pose is not None
    raise InvalidConstraint(f"{constraint!r}: a PointContact, a SurfaceContact or a Loop is needed")
