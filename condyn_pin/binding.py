"""Constraints bound to a model: joints, placements and columns in place of names.

Where Pinocchio takes part, every constraint is solved in the LOCAL frame with a moving joint first
and the other body, or the world, second: the one combination in which none of its algorithms is
wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import Any, Final

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.constraints import Constraint, Coupling, Loop
from condyn_pin.contacts import LineContact, PlanarContact, PointContact, SurfaceContact
from condyn_pin.errors import InvalidConstraint, unknown_name
from condyn_pin.robot import Robot

_AXES: Final = ("x", "y", "z", "rx", "ry", "rz")

POINT: Final[tuple[int, ...]] = (0, 1, 2)
FRAME: Final[tuple[int, ...]] = (0, 1, 2, 3, 4, 5)


@dataclass(frozen=True)
class Bound:
    """One constraint between two bodies, bound.

    Attributes
    ----------
    name : str
    rows : slice
        Its rows among those of the scene.
    joint1, placement1 : int, pin.SE3
        The joint that carries frame c1, and where.
    joint2, placement2 : int, pin.SE3
        The same of c2. The world is joint 0.
    selection : tuple of int
        The rows of the slip x y z rx ry rz that stay zero; empty for a rod.
    anchored : bool
        False for a contact that belongs wherever it is: it has no position error.
    sign : float
        +1 if the force on the first-named body is the one on joint 1, else -1.
    axis : int
        What a hinge or an edge turns about: 0, 1 or 2 for x, y or z of c1.
    length : float
        Of a rod [m]; NaN for all else.
    lever : float
        Half the distance of two points on `axis` that stand for a hinge [m].
    """

    name: str
    rows: slice
    joint1: int
    placement1: Any
    joint2: int
    placement2: Any
    selection: tuple[int, ...]
    anchored: bool = True
    sign: float = 1.0
    axis: int = 2
    length: float = nan  # [m]
    lever: float = nan  # [m]

    @property
    def size(self) -> int:
        """Number of rows."""
        return int(self.rows.stop - self.rows.start)

    @property
    def is_rod(self) -> bool:
        """Whether its row is a distance."""
        return not self.selection

    @property
    def is_hinge(self) -> bool:
        """Whether its rows are all but one turn."""
        return self.size == 5 and self.selection[:3] == POINT

    @property
    def is_plain(self) -> bool:
        """Whether Pinocchio has a constraint of these very rows."""
        return self.selection in (POINT, FRAME)

    @property
    def row_names(self) -> tuple[str, ...]:
        """A name for each row: the constraint's and the axis."""
        axes = [_AXES[i] for i in self.selection] or ["length"]
        return tuple(f"{self.name}.{axis}" for axis in axes)

    def whole(self, lam: Array) -> Array:
        """Return the force with the components that the kind does not transmit: they are zero.

        (3,) [N], or (6,) [N, N m] for kinds that transmit moments. A rod's direction is not known
        here.
        """
        force = np.zeros(6 if self.selection[-1] > 2 else 3)
        force[list(self.selection)] = lam
        return force


@dataclass(frozen=True)
class Coupled:
    """A coupling of two joints, bound.

    Attributes
    ----------
    name : str
    rows : slice
    configuration, velocity : pair of int
        Where q and v hold joint a and joint b.
    ratio, offset : float
        q_a = ratio q_b + offset.
    """

    name: str
    rows: slice
    configuration: tuple[int, int]
    velocity: tuple[int, int]
    ratio: float
    offset: float

    @property
    def size(self) -> int:
        """Number of rows: 1."""
        return 1

    @property
    def row_names(self) -> tuple[str, ...]:
        """The constraint's name."""
        return (f"{self.name}.ratio",)


def bind(robot: Robot, constraints: Sequence[Constraint]) -> tuple[Bound | Coupled, ...]:
    """Bind constraints to a robot, rows in the order given.

    Raises
    ------
    InvalidConstraint
        If two constraints share a name, or one of them cannot constrain any motion.
    UnknownName
        If a frame or a joint does not exist.
    """
    bound: list[Bound | Coupled] = []
    start = 0
    for constraint in constraints:
        if not isinstance(constraint, Constraint):
            raise _unknown(constraint)
        if any(constraint.name == other.name for other in bound):
            raise InvalidConstraint(
                f"two constraints are named {constraint.name!r}; give one of them a name=..."
            )
        rows = slice(start, start + constraint.rows)
        if isinstance(constraint, Coupling):
            bound.append(_couple(robot, constraint, rows))
        else:
            bound.append(_bind(robot, constraint, rows))
        start = rows.stop
    return tuple(bound)


def _bind(robot: Robot, constraint: Constraint, rows: slice) -> Bound:
    if isinstance(constraint, Loop):
        bound = _bind_loop(robot, constraint, rows)
    elif isinstance(constraint, PointContact | SurfaceContact | LineContact):
        bound = _bind_contact(robot, constraint, rows)
    elif isinstance(constraint, PlanarContact):
        bound = _bind_plane(robot, constraint, rows)
    else:
        raise _unknown(constraint)
    if bound.joint1 == bound.joint2:
        joint = bound.joint1
        where = "the world" if joint == 0 else f"joint {robot.model.names[joint]!r}"
        raise InvalidConstraint(
            f"{constraint.name}: both sides belong to {where}, so it constrains nothing; "
            "name frames on two bodies that move against each other"
        )
    return bound


def _bind_loop(robot: Robot, loop: Loop, rows: slice) -> Bound:
    one, two, sign = robot.frame(loop.frame_a), robot.frame(loop.frame_b), 1.0
    if one[0] == 0 and loop.kind in ("ball", "weld", "hinge"):
        # the world first: exchange, and report the force with the other sign
        one, two, sign = two, one, -1.0
    axis = "xyz".index(loop.axis)
    selection = {
        "ball": POINT,
        "weld": FRAME,
        "hinge": tuple(i for i in FRAME if i != 3 + axis),
        "slider": tuple(i for i in FRAME if i != axis),
        "planar": tuple(i for i in POINT if i != axis),
        "rod": (),
    }[loop.kind]
    length = nan if loop.length is None else loop.length
    return Bound(
        loop.name, rows, *one, *two, selection,
        sign=sign, axis=axis, length=length, lever=_lever(robot, one[1], two[1]),
    )  # fmt: skip


def _bind_contact(
    robot: Robot, contact: PointContact | SurfaceContact | LineContact, rows: slice
) -> Bound:
    joint, placement = robot.frame(contact.frame)
    anchor = contact.anchor
    selection, axis, lever = FRAME, 2, nan
    if isinstance(contact, PointContact):
        selection = POINT
        placement = placement * pin.SE3(np.eye(3), np.array(contact.offset))
        anchor = (*contact.anchor, 0.0, 0.0, 0.0, 1.0) if contact.anchor else None
    elif isinstance(contact, LineContact):
        axis = "xyz".index(contact.axis)
        selection = tuple(i for i in FRAME if i != 3 + axis)
        lever = contact.half_length or _lever(robot, placement)
    target = pin.XYZQUATToSE3(np.array(anchor)) if anchor else pin.SE3.Identity()
    return Bound(
        contact.name, rows, joint, placement, 0, target, selection,
        anchored=anchor is not None, axis=axis, lever=lever,
    )  # fmt: skip


def _bind_plane(robot: Robot, contact: PlanarContact, rows: slice) -> Bound:
    """Bind the plane as c1, z along its normal, and the robot's point as c2."""
    joint, placement = robot.frame(contact.frame)
    point = placement * pin.SE3(np.eye(3), np.array(contact.offset))
    normal = np.array(contact.normal)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), normal)
    plane = pin.SE3(turn.matrix(), (contact.height or 0.0) * normal)
    anchored = contact.height is not None
    return Bound(contact.name, rows, 0, plane, joint, point, (2,), anchored=anchored, sign=-1.0)


def _lever(robot: Robot, *placements: Any) -> float:
    """Return the size of the bodies that meet: the two points of a hinge are to be that far apart.

    A short lever turns rounding of the points into moments: 1/lever^2 enters the condition.
    """
    own = [float(np.linalg.norm(p.translation)) for p in placements]
    all_joints = [float(np.linalg.norm(p.translation)) for p in robot.model.jointPlacements]
    return max(own) or max(all_joints) or 1.0


def _couple(robot: Robot, coupling: Coupling, rows: slice) -> Coupled:
    model = robot.model
    if coupling.joint_a == coupling.joint_b:
        raise InvalidConstraint(f"{coupling.name}: both joints are {coupling.joint_a!r}")
    joints = []
    for name in (coupling.joint_a, coupling.joint_b):
        if not model.existJointName(name):
            raise unknown_name("joint", name, robot.joints)
        joint = model.joints[model.getJointId(name)]
        if joint.nq != 1 or joint.nv != 1:
            raise InvalidConstraint(
                f"{coupling.name}: joint {name!r} has nq {joint.nq}, nv {joint.nv}; joints with "
                "one number are needed (a continuous joint counts as cos and sin: read it as "
                "revolute)"
            )
        joints.append(joint)
    a, b = joints
    return Coupled(
        coupling.name,
        rows,
        (int(a.idx_q), int(b.idx_q)),
        (int(a.idx_v), int(b.idx_v)),
        coupling.ratio,
        coupling.offset,
    )


def _unknown(constraint: object) -> InvalidConstraint:
    return InvalidConstraint(
        f"{constraint!r}: a contact (PointContact, SurfaceContact, LineContact, PlanarContact), "
        "a Loop or a Coupling is needed"
    )
