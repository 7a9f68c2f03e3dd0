"""Contacts of the robot with the world.

The rows are those of a loop whose other body is the world (`condyn_pin.constraints.constraints`).
Without an anchor a contact holds what it touches where it is: it has no position error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.errors import InvalidArgument
from condyn_pin.constraints.constraint_fields import (
    Axis,
    Placement,
    Vector3,
    check_axis,
    check_lengths,
    direction,
    floats,
    placement,
    text,
)
from condyn_pin.constraints.constraints import Constraint


@dataclass(frozen=True)
class PointContact(Constraint):
    """A point of the robot that keeps its place in the world: 3 rows.

    Parameters
    ----------
    frame : str
        Frame of the robot that carries the point.
    offset : (3,) sequence of float
        The point, in the axes of `frame` [m].
    anchor : (3,) sequence of float, optional
        Where the point belongs, in the world [m]. Without it the point belongs where it is: the
        contact holds it there and has no position error.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Notes
    -----
    The force is the one on the robot, in the axes of `frame` [N]. The contact is bilateral: it
    also pulls.
    """

    frame: str
    offset: Vector3 = (0.0, 0.0, 0.0)
    anchor: Vector3 | None = None

    def __post_init__(self) -> None:
        text("frame", self.frame)
        object.__setattr__(self, "offset", floats("offset", self.offset, 3))
        if self.anchor is not None:
            object.__setattr__(self, "anchor", floats("anchor", self.anchor, 3))
        self._set_name(self.frame)

    @property
    def rows(self) -> int:
        """Number of rows: 3."""
        return 3


@dataclass(frozen=True)
class SurfaceContact(Constraint):
    """A flat part of the robot that keeps its placement in the world: 6 rows.

    Parameters
    ----------
    frame : str
        Frame of the robot in the middle of the surface, z along its normal.
    half_length, half_width : float, optional
        Half of the size along x and y of `frame` [m]. The dynamics do not need them; they are
        where `corners` puts its points.
    anchor : (7,) sequence of float or pin.SE3, optional
        Where the frame belongs in the world: x y z [m] and the quaternion x y z w. Without it the
        surface belongs where it is.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Notes
    -----
    The force is the wrench on the robot at the origin of `frame`, in its axes, linear part first
    [N, N m]. The contact is bilateral.
    """

    frame: str
    half_length: float | None = None  # [m]
    half_width: float | None = None  # [m]
    anchor: Placement | None = None

    def __post_init__(self) -> None:
        text("frame", self.frame)
        check_lengths(half_length=self.half_length, half_width=self.half_width)
        object.__setattr__(self, "anchor", placement("anchor", self.anchor))
        self._set_name(self.frame)

    @property
    def rows(self) -> int:
        """Number of rows: 6."""
        return 6

    def corners(self) -> tuple[PointContact, ...]:
        """Return the same support as four points: 12 rows, of which 6 are redundant."""
        if self.half_length is None or self.half_width is None:
            raise InvalidArgument(
                f"{self.name}: half_length and half_width are not set, so there are no corners; "
                "use SurfaceContact(frame, half_length=..., half_width=...)"
            )
        signs = {"front_left": (1, 1), "front_right": (1, -1), "back_left": (-1, 1),
                 "back_right": (-1, -1)}  # fmt: skip
        return tuple(
            _point(self, corner, np.array([x * self.half_length, y * self.half_width, 0.0]))
            for corner, (x, y) in signs.items()
        )


@dataclass(frozen=True)
class LineContact(Constraint):
    """A straight edge of the robot that keeps its place in the world: 5 rows.

    The robot can still roll about the edge: Cassie's foot.

    Parameters
    ----------
    frame : str
        Frame of the robot in the middle of the edge.
    axis : {"x", "y", "z"}
        Of `frame`: the edge lies along it.
    half_length : float, optional
        Half of the edge [m]. The dynamics do not need it; it is where `ends` puts its points.
    anchor : (7,) sequence of float or pin.SE3, optional
        Where the frame belongs in the world, up to a turn about the edge: x y z [m] and the
        quaternion x y z w. Without it the edge belongs where it is.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Notes
    -----
    The force is the wrench on the robot at the origin of `frame`, in its axes, linear part first
    [N, N m]; its moment about the edge is zero. The contact is bilateral.
    """

    frame: str
    axis: Axis = "x"
    half_length: float | None = None  # [m]
    anchor: Placement | None = None

    def __post_init__(self) -> None:
        text("frame", self.frame)
        check_axis(self.axis)
        check_lengths(half_length=self.half_length)
        object.__setattr__(self, "anchor", placement("anchor", self.anchor))
        self._set_name(self.frame)

    @property
    def rows(self) -> int:
        """Number of rows: 5."""
        return 5

    def ends(self) -> tuple[PointContact, PointContact]:
        """Return the same support as two points: 6 rows, of which 1 is redundant."""
        if self.half_length is None:
            raise InvalidArgument(
                f"{self.name}: half_length is not set, so there are no ends; "
                "use LineContact(frame, half_length=...)"
            )
        direction = np.eye(3)["xyz".index(self.axis)]
        front, back = (
            _point(self, end, sign * self.half_length * direction)
            for end, sign in (("front", 1), ("back", -1))
        )
        return front, back


@dataclass(frozen=True)
class PlanarContact(Constraint):
    """A point of the robot that slides on a plane of the world without friction: 1 row.

    Parameters
    ----------
    frame : str
        Frame of the robot that carries the point.
    offset : (3,) sequence of float
        The point, in the axes of `frame` [m].
    normal : (3,) sequence of float
        Of the plane, in the world; any length.
    height : float, optional
        Of the plane, along the normal from the world's origin [m]. Without it the plane goes
        through the point.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Notes
    -----
    The force is the one on the robot [N], in the axes of the plane: z is the normal, x and y are
    zero. The contact is bilateral.
    """

    frame: str
    offset: Vector3 = (0.0, 0.0, 0.0)
    normal: Vector3 = (0.0, 0.0, 1.0)
    height: float | None = None  # [m]

    def __post_init__(self) -> None:
        text("frame", self.frame)
        object.__setattr__(self, "offset", floats("offset", self.offset, 3))
        object.__setattr__(self, "normal", direction("normal", self.normal))
        if self.height is not None:
            object.__setattr__(self, "height", floats("height", [self.height], 1)[0])
        self._set_name(self.frame)

    @property
    def rows(self) -> int:
        """Number of rows: 1."""
        return 1


Contact = PointContact | SurfaceContact | LineContact | PlanarContact

# As files and the command line write them.
CONTACTS: dict[str, type[Contact]] = {
    "point": PointContact,
    "surface": SurfaceContact,
    "line": LineContact,
    "planar": PlanarContact,
}


def _point(contact: SurfaceContact | LineContact, name: str, offset: Array) -> PointContact:
    """Return a point of an extended contact, anchored where the contact is."""
    anchor = None
    if contact.anchor is not None:
        anchor = tuple(pin.XYZQUATToSE3(np.array(contact.anchor)).act(offset))
    return PointContact(contact.frame, tuple(offset), anchor, name=f"{contact.name}/{name}")
