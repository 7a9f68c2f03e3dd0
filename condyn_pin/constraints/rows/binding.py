"""From the constraints of a user to bound ones.

Where Pinocchio takes part, every constraint is solved in the LOCAL frame with a moving joint first
and the other body, or the world, second: the one combination in which none of its algorithms is
wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from typing import Any, Protocol

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.errors import InvalidConstraint, unknown_name
from condyn_pin.constraints.constraints import Constraint, Coupling, Loop
from condyn_pin.constraints.contacts import LineContact, PlanarContact, PointContact, SurfaceContact
from condyn_pin.constraints.nonholonomic import Knife, RollingBall, RollingWheel
from condyn_pin.constraints.rows.bound import (
    DIRECTIONS,
    FRAME,
    POINT,
    AnyBound,
    Bound,
    Coupled,
    Rolled,
)


class Machine(Protocol):
    """What constraints are bound to: a `pinocchio.Model` with frames by name, such as a `Robot`."""

    @property
    def model(self) -> Any:
        """The `pinocchio.Model`."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, the world's not among them."""

    @property
    def longest_link(self) -> float:
        """The longest way from a joint to the next one [m]."""

    def frame(self, name: str) -> tuple[int, Any]:
        """Return the joint that carries a frame and its placement on it, or raise UnknownName."""


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
        if isinstance(constraint, Coupling):
            bound.append(_couple(robot, constraint, rows))
        else:
            bound.append(_bind(robot, constraint, rows))
        start = rows.stop
    return tuple(bound)


def _bind(robot: Machine, constraint: Constraint, rows: slice) -> Bound | Rolled:
    bound: Bound | Rolled
    if isinstance(constraint, Loop):
        bound = _bind_loop(robot, constraint, rows)
    elif isinstance(constraint, PointContact | SurfaceContact | LineContact):
        bound = _bind_contact(robot, constraint, rows)
    elif isinstance(constraint, PlanarContact):
        bound = _bind_plane(robot, constraint, rows)
    elif isinstance(constraint, Knife):
        bound = _bind_knife(robot, constraint, rows)
    elif isinstance(constraint, RollingWheel | RollingBall):
        bound = _bind_rolling(robot, constraint, rows)
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


def _bind_loop(robot: Machine, loop: Loop, rows: slice) -> Bound:
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
    robot: Machine, contact: PointContact | SurfaceContact | LineContact, rows: slice
) -> Bound:
    joint, placement = robot.frame(contact.frame)
    anchor = contact.anchor
    selection, axis, lever = FRAME, 2, _lever(robot, placement)
    if isinstance(contact, PointContact):
        selection = POINT
        placement = placement * pin.SE3(np.eye(3), np.array(contact.offset))
        anchor = (*contact.anchor, 0.0, 0.0, 0.0, 1.0) if contact.anchor else None
    elif isinstance(contact, LineContact):
        axis = "xyz".index(contact.axis)
        selection = tuple(i for i in FRAME if i != 3 + axis)
        lever = contact.half_length or lever
    target = pin.XYZQUATToSE3(np.array(anchor)) if anchor else pin.SE3.Identity()
    return Bound(
        contact.name, rows, joint, placement, 0, target, selection,
        anchored=anchor is not None, axis=axis, lever=lever,
    )  # fmt: skip


def _bind_plane(robot: Machine, contact: PlanarContact, rows: slice) -> Bound:
    """Bind the plane as c1, z along its normal, and the robot's point as c2."""
    joint, placement = robot.frame(contact.frame)
    point = placement * pin.SE3(np.eye(3), np.array(contact.offset))
    plane = _plane(contact.normal, contact.height)
    anchored = contact.height is not None
    return Bound(contact.name, rows, 0, plane, joint, point, (2,), anchored=anchored, sign=-1.0)


def _plane(normal: tuple[float, float, float], height: float | None) -> Any:
    """Return a frame in a plane of the world, z along its normal."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(normal))
    return pin.SE3(turn.matrix(), (height or 0.0) * np.array(normal))


def _bind_knife(robot: Machine, knife: Knife, rows: slice) -> Bound:
    joint, placement = robot.frame(knife.frame)
    point = placement * pin.SE3(np.eye(3), np.array(knife.offset))
    chosen = ("xyz".index(knife.axis),)
    world = pin.SE3.Identity()
    return Bound(knife.name, rows, joint, point, 0, world, chosen, anchored=False)


def _bind_rolling(robot: Machine, rolling: RollingWheel | RollingBall, rows: slice) -> Rolled:
    wheel = rolling if isinstance(rolling, RollingWheel) else None
    holds = wheel.holds if wheel else DIRECTIONS
    return Rolled(
        rolling.name, rows, *robot.frame(rolling.frame), _plane(rolling.normal, rolling.height),
        tuple(DIRECTIONS.index(each) for each in holds), rolling.radius,
        axle="xyz".index(wheel.axis) if wheel else None,
        anchored=rolling.height is not None,
    )  # fmt: skip


def _lever(robot: Machine, *placements: Any) -> float:
    """Return the size of the bodies that meet: two points of them are to be that far apart.

    A short lever turns rounding of the points into moments: 1/lever^2 enters the condition. A frame
    near the middle of its joint says nothing about the size; then it is that of the robot's links.
    """
    own = max(float(np.linalg.norm(p.translation)) for p in placements)
    links = robot.longest_link
    return own if own > 0.1 * links else links or 1.0


def _couple(robot: Machine, coupling: Coupling, rows: slice) -> Coupled:
    model = robot.model
    if coupling.joint_a == coupling.joint_b:
        raise InvalidConstraint(f"{coupling.name}: both joints are {coupling.joint_a!r}")
    joints = []
    for name in (coupling.joint_a, coupling.joint_b):
        if name not in robot.joints:
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
        "what rolls or glides (RollingWheel, RollingBall, Knife), a Loop or a Coupling is needed"
    )
