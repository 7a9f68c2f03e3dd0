"""Loops: a chain closed by a cut joint.

A loop keeps a part of the relative placement of two frames, c1 and c2. With r the position
of c2's origin in c1, R the axes of c2 in c1, and every velocity in the axes of its own frame, body
1 moves relative to body 2, at the origin of c2, with

    s = ( v1 + omega1 x r - R v2,   omega1 - R omega2 )        in the axes of c1,

and a kind is a choice of rows of s = 0:

    ball         x y z                the two origins stay together
    weld         x y z rx ry rz       the two frames stay together
    hinge        all but the turn about `axis`
    slider       all but the shift along `axis`
    cylindrical  all but the turn about `axis` and the shift along it
    planar       x y z but the shift along `axis`: the pin of a linkage in the plane across it
    universal    x y z, and (e_i x R e_j) . s_ang: axis i of c1 stays across axis j of c2
    rod          r . s / |r|: the distance of the two origins stays
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import nan
from typing import Any, ClassVar, Final, Literal, get_args

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, text_of
from condyn_pin.constraints.constraint import (
    Axis,
    BetweenFrames,
    Constraint,
    FramedModel,
    MjcfWriter,
    check_axis,
    check_lengths,
    lever,
)
from condyn_pin.constraints.driven import not_to_drive
from condyn_pin.constraints.places import FrameLike, set_frames
from condyn_pin.constraints.rows.bound import FRAME, POINT, BoundBetweenFrames, BoundConstraint
from condyn_pin.constraints.rows.frames import cross
from condyn_pin.constraints.rows.special import BoundRelation, RelativePosition
from condyn_pin.errors import InvalidArgument

LoopKind = Literal["ball", "weld", "hinge", "slider", "cylindrical", "planar", "universal", "rod"]
AxisPair = Literal["xy", "xz", "yx", "yz", "zx", "zy"]  # of frame a, and of frame b

_OF_A: Final = 'the axis of {frame_a!r} that %s: axis="x", "y" or "z"'
# What the axis of a kind is; the other kinds have none.
_AXES: Final = {
    "hinge": _OF_A % "it turns about",
    "slider": _OF_A % "it moves along",
    "cylindrical": _OF_A % "it turns about and moves along",
    "planar": _OF_A % "it leaves free, across the plane of the linkage",
    "universal": "the axis of {frame_a!r} that it turns about and, across it, that of {frame_b!r}: "
    'axis="xy" for x of the one and y of the other',
}

# What MuJoCo calls them; a hinge is two of them.
_EQUALITIES: Final = {"ball": "connect", "weld": "weld", "hinge": "connect"}

# From the middle of a hinge or a weld to the points that stand for it.
_APART: Final = 0.1  # [m]


def axis_of(kind: str, axis: Axis | AxisPair = "z") -> Axis | AxisPair | None:
    """Axis of a loop of a kind that has one; None for other kinds."""
    return axis if kind in _AXES else None


@dataclass(frozen=True)
class Loop(BetweenFrames):
    """A closed chain: a joint between two frames of the robot.

    What is held of the velocity (v, omega) of `frame_a` relative to `frame_b`, with e the axis and
    r from one origin to the other:

        ball    v = 0            weld         v = 0, omega = 0
        planar  e x v = 0        hinge        v = 0, e x omega = 0
        rod     r . v = 0        slider       e x v = 0, omega = 0
                                 cylindrical  e x v = 0, e x omega = 0
                                 universal    v = 0, (e x e_b) . omega = 0

    Parameters
    ----------
    frame_a, frame_b : str, (joint, pin.SE3) or pin.Frame
        The two halves of the joint that closes the loop. One of them may belong to the world.
    kind : {"ball", "weld", "hinge", "slider", "cylindrical", "planar", "universal", "rod"}
        The joint that was cut, with 3, 6, 5, 5, 4, 2, 4 and 1 rows. A ball closes planar linkages
        too, with a redundant row that ``planar`` does not have; an answer that is ok is right with
        either. Sliders, cylindrical and universal joints, rods, and planar pins whose bodies can
        leave the plane have no equivalent in Pinocchio, and take five times as long or more. A weld
        in place of a hinge locks it.
    axis : {"x", "y", "z"} or {"xy", "xz", "yx", "yz", "zx", "zy"}, optional
        Of `frame_a`: a hinge turns about it, a slider moves along it, a cylindrical joint does
        both, and a planar pin leaves it free. The same axis of `frame_b` coincides with it in a
        hinge and a cylindrical joint. A universal joint has two: "xy" is a cross with one pin along
        x of `frame_a` and the other along y of `frame_b`. These kinds need it; the others have
        none.
    length : float, optional
        Of a rod [m], which needs it; the other kinds have none.
    name : str, optional
        Name of the constraint; ``frame_a~frame_b`` by default.

    Raises
    ------
    InvalidArgument
        If the kind or the axis is unknown, a kind lacks its axis or its length, or has one that
        is of other kinds.

    Notes
    -----
    The force is the one on the body of `frame_a`, at the origin of `frame_b` and in the axes of
    `frame_a`; the body of `frame_b` feels the opposite. When `frame_a` of a ball, a weld or a
    hinge belongs to the world, the axes are those of `frame_b`. Where it is open, each body of a
    ball feels it at its own origin, and the moment of a weld is about that of the axes.
    """

    lengths: ClassVar[tuple[str, ...]] = ("length",)

    frame_a: FrameLike
    frame_b: FrameLike
    kind: LoopKind = "ball"
    axis: Axis | AxisPair | None = None
    length: float | None = None  # [m]

    def __post_init__(self) -> None:
        set_frames(self, "frame_a", "frame_b")
        if self.kind not in get_args(LoopKind):
            raise InvalidArgument(
                f"kind = {self.kind!r}: known kinds of loops are {', '.join(get_args(LoopKind))}"
            )
        self._check_axis()
        check_lengths(length=self.length)
        if (self.kind == "rod") != (self.length is not None):
            wanted = "a rod needs its length" if self.kind == "rod" else "only a rod has a length"
            raise InvalidArgument(f"length = {self.length!r} for a {self.kind}: {wanted} [m]")
        self._set_name(f"{self.frame_a}~{self.frame_b}")

    def _check_axis(self) -> None:
        """Raise InvalidArgument for a missing axis, or for one that the kind does not have."""
        if self.kind in _AXES:
            wanted = _AXES[self.kind].format(frame_a=self.frame_a, frame_b=self.frame_b)
            if self.axis is None:
                raise InvalidArgument(f"axis: a {self.kind} needs {wanted}")
            if self.kind != "universal":
                check_axis(self.axis)
            elif self.axis not in get_args(AxisPair):
                raise InvalidArgument(f"axis = {text_of(self.axis)}: a universal needs {wanted}")
        elif self.axis is not None:
            raise InvalidArgument(
                f"axis = {text_of(self.axis)} for a {self.kind}, which has no axis: leave it out, "
                f"or name the kind that has one, {', '.join(_AXES)}"
            )

    @property
    def _axis(self) -> int:
        """Column of the axis in the axes of `frame_a`; that of z for a kind without an axis."""
        return "xyz".index((self.axis or "z")[0])

    @property
    def _other_axis(self) -> int:
        """Column of the last axis, of `frame_b` in a universal joint."""
        return "xyz".index((self.axis or "z")[-1])

    @property
    def rows(self) -> int:
        """Number of rows of the kind."""
        return 4 if self.kind == "universal" else len(self._selected) or 1

    @property
    def _selected(self) -> tuple[int, ...]:
        """Rows x y z rx ry rz of s that stay zero; none for a rod."""
        axis = self._axis
        return {
            "ball": POINT,
            "weld": FRAME,
            "hinge": tuple(i for i in FRAME if i != 3 + axis),
            "slider": tuple(i for i in FRAME if i != axis),
            "cylindrical": tuple(i for i in FRAME if i % 3 != axis),
            "planar": tuple(i for i in POINT if i != axis),
            "universal": POINT,
            "rod": (),
        }[self.kind]

    def bind(self, machine: FramedModel, rows: slice) -> BoundConstraint:
        """Return the loop with c1 its first frame and c2 its second one.

        Where the first one is the world's they are exchanged, for rows that Pinocchio has: in the
        LOCAL frame with a moving joint first none of its algorithms is wrong.
        """
        one, two, sign = machine.frame(self.frame_a), machine.frame(self.frame_b), 1.0
        if one[0] == 0 and self.kind in ("ball", "weld", "hinge"):
            one, two, sign = two, one, -1.0  # the force is reported with the other sign
        if self.kind == "universal":
            return BoundRelation(self.name, rows, *one, *two, Cross(self._axis, self._other_axis))
        length = nan if self.length is None else self.length
        return BoundBetweenFrames(
            self.name, rows, *one, *two, self._selected, sign=sign, axis=self._axis, length=length,
            lever=lever(machine, one[1], two[1]),
        )  # fmt: skip

    def bind_to_drive(self, machine: FramedModel, rows: slice) -> BoundConstraint:
        """Return a rod as it is, and pins as the position of frame a in the axes of frame b."""
        if self.kind == "rod":
            return self.bind(machine, rows)
        if not self.is_pin:
            raise not_to_drive(self)
        one, two = machine.frame(self.frame_b), machine.frame(self.frame_a)
        return BoundRelation(
            self.name, rows, *one, *two, RelativePosition(self._selected), sign=-1.0
        )

    @property
    def title(self) -> str:
        """Class and kind of the loop."""
        return f"Loop ({self.kind})"

    @property
    def called(self) -> str:
        """Kind of the loop."""
        return self.kind

    @property
    def is_pin(self) -> bool:
        """True if a point of one body is pinned to one of the other, in space or in a plane."""
        return self.kind in ("ball", "planar")

    def as_planar_pin(self, frame: str) -> Loop | None:
        """Return a ball without its row along z of a `frame` at `frame_a`; None for other kinds."""
        if self.kind != "ball":
            return None
        return replace(self, frame_a=frame, kind="planar", axis="z")

    @property
    def cut_joints(self) -> tuple[CutJoint, ...]:
        """The joint that it is the cut of: two of a cylindrical or universal one."""
        return _cut_joints(self)

    @property
    def by_points_called(self) -> str:
        """Name of a hinge or a weld by points, in studies; empty for other kinds."""
        return {"hinge": "two points for hinges", "weld": "three points for welds"}.get(
            self.kind, ""
        )

    def by_points(self, robot: Any) -> tuple[Any, tuple[Constraint, ...]]:
        """Return a hinge as two balls on its axis, and a weld as three around it."""
        along = np.eye(3)[self._axis]
        places = {"hinge": (_APART * along, -_APART * along), "weld": tuple(_APART * np.eye(3))}
        if self.kind not in places:
            return robot, (self,)
        balls = []
        for number, place in enumerate(places[self.kind]):
            a, b = (f"{frame} of {self.name}, {number}" for frame in self.frames)
            robot = robot.with_frame(a, self.frame_a, place).with_frame(b, self.frame_b, place)
            balls.append(Loop(a, b, name=f"{self.name}, {number}", drift=self.drift))
        return robot, tuple(balls)

    @property
    def in_mjcf(self) -> bool:
        """True if MuJoCo has an equality of this kind."""
        return self.kind in _EQUALITIES

    def write_mjcf(self, to: MjcfWriter) -> None:
        """Write an equality of two sites; a hinge is two points of its axis."""
        tag = _EQUALITIES[self.kind]
        a, b = (to.site(f, f"{self.name}_{e}") for f, e in zip(self.frames, "ab", strict=True))
        to.equate(tag, name=self.name, site1=a, site2=b)
        if self.kind == "hinge":
            ends = (to.robot.frame(frame)[1] for frame in self.frames)
            far = lever(to.robot, *ends)
            x, y, z = (far * np.eye(3)[self._axis]).tolist()
            a, b = (
                to.site_beside(f, f"{self.name}_axis_{e}", (x, y, z))
                for f, e in zip(self.frames, "ab", strict=True)
            )
            to.equate(tag, name=f"{self.name}_axis", site1=a, site2=b)


@dataclass(frozen=True)
class Cross:
    """Cross of a universal joint: one pin along axis i of c1, the other along axis j of c2.

    c = (-r, e_i . u),    W = ((1, 0), (0, e_i x u)),    u = R e_j,    u' = -s_ang x u
    """

    i: int
    j: int

    row_words: ClassVar[tuple[str, ...]] = ("x", "y", "z", "square")
    angles: ClassVar[tuple[bool, ...]] = (False, False, False, True)

    def violation(self, R: Array, r: Array) -> Array:
        """Violation c (4,) [m, and the cosine of the angle between the pins]."""
        return np.array([*-r, R[self.i, self.j]])

    def weights(self, R: Array, r: Array) -> Array:
        """Weights W (4, 6)."""
        W = np.zeros((4, 6))
        W[:3, :3] = np.eye(3)
        W[3, 3:] = self._across(R[:, self.j])
        return W

    def weights_rate(self, R: Array, r: Array, s: Array) -> Array:
        """Rate W' (4, 6) of the weights while the frames move by s."""
        rate = np.zeros((4, 6))
        rate[3, 3:] = self._across(cross(R[:, self.j], s[3:]))
        return rate

    def weights_bend(self, R: Array, r: Array, s: Array) -> Array:
        """Partials of W' by moves of the frames (6, 4, 6)."""
        bend = np.zeros((6, 4, 6))
        for k, turn in enumerate(np.eye(3)):
            bend[3 + k, 3, 3:] = self._across(cross(cross(R[:, self.j], turn), s[3:]))
        return bend

    @property
    def of_cut(self) -> dict[str, Any]:
        """Three shifts, and the turn that the pins do not have."""
        return {"selection": (0, 1, 2, 3), "axis": self.i, "other_axis": self.j}

    def _across(self, u: Array) -> Array:
        """Product e_i x u."""
        return cross(np.eye(3)[self.i], u)


# The joint that a loop is the cut of, by its coordinates.


@dataclass(frozen=True, eq=False)
class CutJoint:
    """One joint of those between frame a and frame b, of which a universal joint has two."""

    name: str
    kind: Literal["turn", "slide", "ball"]
    e: Array  # unit vector that it turns about or slides along
    f: Array  # its angle is by how much this direction across e is turned

    @property
    def is_ball(self) -> bool:
        """True for a ball, whose coordinates are a quaternion."""
        return self.kind == "ball"

    @property
    def turns(self) -> bool:
        """True for a turn about e, whose coordinate is an angle."""
        return self.kind == "turn"

    @property
    def axes(self) -> Array:
        """Motion subspace (6, 1 or 3), linear first."""
        if self.is_ball:
            return np.vstack([np.zeros((3, 3)), np.eye(3)])
        parts = (np.zeros(3), self.e) if self.turns else (self.e, np.zeros(3))
        return np.concatenate(parts)[:, None]

    def placed(self, value: float) -> Any:
        """Placement of what follows a turn or a slide, in what is before."""
        R = pin.exp3(value * self.e) if self.turns else np.eye(3)
        return pin.SE3(R, np.zeros(3) if self.turns else value * self.e)

    def value(self, M: Any) -> float:
        """Coordinate at which what follows is placed at M, as far as it is by this joint."""
        if self.kind == "slide":
            return float(self.e @ M.translation)
        turned = M.rotation @ self.f
        return float(np.arctan2(self.e @ np.cross(self.f, turned), self.f @ turned))


def _cut_joints(loop: Loop) -> tuple[CutJoint, ...]:
    """Joints from frame a to frame b; none of kinds that are no joint with coordinates."""
    name, axis = loop.name, loop.axis or "z"
    e, other = (np.eye(3)["xyz".index(letter)] for letter in (axis[0], axis[-1]))
    across = np.roll(e, 1)
    if loop.kind == "universal":
        return CutJoint(f"{name}_axis", "turn", e, other), CutJoint(
            f"{name}_axis2", "turn", other, e
        )
    if loop.kind == "cylindrical":
        return (
            CutJoint(f"{name}_slide", "slide", e, across),
            CutJoint(f"{name}_turn", "turn", e, across),
        )
    if loop.kind == "hinge":
        return (CutJoint(name, "turn", e, across),)
    if loop.kind == "slider":
        return (CutJoint(name, "slide", e, across),)
    return (CutJoint(name, "ball", e, across),) if loop.kind == "ball" else ()
