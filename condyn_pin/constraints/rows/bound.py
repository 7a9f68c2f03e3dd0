"""Constraint bound to a model, and its answers to the program.

Names are replaced by joints, placements and rows.

The rest of the program calls the methods of `BoundConstraint`. Its own fields, and those of
`BoundCoupling`, `BoundRolling` and `BoundRelation`, are for the groups that evaluate them together.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array, check_overflow
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.path import Along, along_at
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.equations import Equations
    from condyn_pin.constraints.rows.redundancy import RedundantRows


_EPS = float(np.finfo(np.float64).eps)

# Frame of the joint itself.
STILL: Final = pin.SE3.Identity()


# Rows of a constraint as the compiled core reads them, by the names of fields.


class CompiledRows(NamedTuple):
    """Rows of one constraint in the compiled core (`native/src/core/constraint.hpp`)."""

    kind: Literal["held", "ball", "weld", "cut", "rod", "coupling", "roll"]
    rows: slice  # among those of the scene
    joint1: int = 0  # joints of its bodies
    joint2: int = 0
    placement1: Any = STILL  # pin.SE3 of its frames on them
    placement2: Any = STILL
    selection: tuple[int, ...] = ()  # which of the six rows it has
    anchored: bool = True
    is_hinge: bool = False
    is_slider: bool = False
    axis: int = 0  # of a hinge; the axle of a wheel, -1 of a ball; of c1 in a cross
    other_axis: int = -1  # of c2 in a cross
    at_q: tuple[int, int] = (0, 0)  # of the two joints of a coupling
    at_v: tuple[int, int] = (0, 0)
    sign: float = 1.0
    length: float = 0.0  # of a rod, radius of a wheel [m], or ratio of a coupling [1]
    offset: float = 0.0  # of a coupling


# The contract of a bound constraint: its answers to the rest of the program.
#
# `condyn_pin.constraints.constraint` says how a kind is made. Rows are evaluated in groups, not one
# by one: that stays inside of this room (`condyn_pin.constraints.rows.groups`).


@dataclass(frozen=True)
class RowPath:
    """Path of driven rows: c = s(t), J v = s'(t), J a + gamma = s''(t).

    `along` returns the three at a time; `time` is the time of evaluation, None if it is not set.
    """

    along: Along
    time: float | None  # [s]


class BoundConstraint(ABC):
    """Base of every bound constraint."""

    name: str
    rows: slice  # its rows among those of the scene
    anchored: bool  # false for a contact that belongs wherever it is: it has no position error
    sign: float  # +1 if the force on the first-named body is the one on joint 1, else -1
    drive: RowPath | None  # what its rows follow, if they do not stay at zero
    drift: Baumgarte | None  # stabilisation of its own rows, in place of the scene's

    @property
    def size(self) -> int:
        """Number of rows."""
        return int(self.rows.stop - self.rows.start)

    @property
    @abstractmethod
    def row_names(self) -> tuple[str, ...]:
        """Name of each row: the constraint's, and its direction."""

    @property
    def positioned(self) -> range:
        """Rows with a position error."""
        return range(self.rows.start, self.rows.stop if self.anchored else self.rows.start)

    def wanted_rate(self, q: Array, t: float) -> Array:
        """Rate J v (size,) that the rows follow at q and t [s]."""
        if not self.drive:
            return np.zeros(self.size)
        return along_at(self.drive.along, t, self.size, self.name)[1]  # type: ignore[no-any-return]

    @property
    def is_plain(self) -> bool:
        """True if Pinocchio has a constraint of the same rows."""
        return False

    @property
    def is_ball(self) -> bool:
        """True for a point of one moving body held on a point of another."""
        return False

    @property
    def is_scalar(self) -> bool:
        """True if the force is recorded by its rows, not by components along axes."""
        return False

    @property
    def has_computed_axes(self) -> bool:
        """True if the rows are along computed directions, not along axes of the frames."""
        return False

    @property
    def hinge_axis(self) -> int | None:
        """Axis of c1 about which a hinge turns: 0, 1 or 2; None for others."""
        return None

    @property
    def joints(self) -> tuple[int, int] | None:
        """Joints that carry the frames c1 and c2; None without frames."""
        return None

    @property
    def one_body(self) -> int | None:
        """Joint of the body that carries both sides; None for two bodies."""
        return None

    def within(self, joints: Container[int]) -> bool:
        """True if both sides are on bodies of these joints."""
        # Moving them as one body then changes nothing, also where it is open and J says otherwise.
        return False

    @property
    def on_robot(self) -> int:
        """Index of the frame on the robot: 0 for c1, 1 for c2."""
        return 0

    @property
    def origins_coincide(self) -> bool:
        """True if the origins of the two frames coincide when the constraint is closed."""
        return False

    def compiled(self) -> CompiledRows | None:
        """Rows in the format of the compiled core; None if it has no such rows."""
        # Those that follow a path are those that do not: the core is told where the path is.
        return None

    @abstractmethod
    def moved(self, joints: Sequence[int]) -> Self:
        """Constraint on other joints: the new number of each."""

    @abstractmethod
    def ends(self, oMi: Any) -> tuple[Any, Any] | None:
        """Frames c1 and c2 in the world; None without frames."""
        # The axes of c1 are those of its force.

    def whole(self, lam: Array) -> Array:
        """Force with zeros for the components that the kind does not transmit."""
        return lam.copy()

    def force(self, lam: Array, ends: Callable[[], tuple[Any, Any]]) -> Array:
        """Components of the force in the axes of c1; `ends` returns c1 and c2."""
        return self.whole(lam)

    @abstractmethod
    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Point of the world where the force acts, on the first body or on the other."""

    def reaction(self, *, on_first: bool) -> float:
        """Ratio of the reaction on the other side to the force."""
        return 1.0

    @abstractmethod
    def turns(self, model: Any) -> NDArray[np.bool_]:
        """Flag of each row: angle, or else length."""

    def opening(self, model: Any, c: Array) -> tuple[float, float]:
        """Gap by the rows of c: length [m] and angle [rad]."""
        return self.rates(model, c)

    def rates(self, model: Any, velocity: Array) -> tuple[float, float]:
        """Rate of the gap by the rows of J v: [m/s] and [rad/s]."""
        angular = self.turns(model)
        # no square overflows
        return math.hypot(*velocity[~angular]), math.hypot(*velocity[angular])

    @abstractmethod
    def end(self, frame: str) -> Literal[1, 2]:
        """Return 1 or 2 for the "first" or "second" frame as c1 or c2, or raise InvalidArgument."""

    @abstractmethod
    def approximate_delassus(
        self, body: Callable[[int], Array], columns: Callable[[Sequence[int]], float | Array]
    ) -> Any:
        """MuJoCo's approximate diagonal of J M^-1 J^T, a number per row or one for all."""
        # `body` returns the inverse inertia of the body of a joint under a force and under a moment
        # (2,), `columns` the sum of those of some coordinates of v.


class TwoFrameConstraint(BoundConstraint, ABC):
    """Bound constraint between a frame c1 on joint 1 and a frame c2 on joint 2."""

    joint1: int
    placement1: Any
    joint2: int
    placement2: Any

    @property
    def joints(self) -> tuple[int, int]:
        """Joints 1 and 2."""
        return self.joint1, self.joint2

    @property
    def one_body(self) -> int | None:
        """Joint 1, if it is joint 2 too."""
        return self.joint1 if self.joint1 == self.joint2 else None

    def within(self, joints: Container[int]) -> bool:
        """True if joints 1 and 2 are among these joints."""
        return self.joint1 in joints and self.joint2 in joints

    @property
    def on_robot(self) -> int:
        """0, unless joint 1 is the world."""
        return 0 if self.joint1 else 1

    def moved(self, joints: Sequence[int]) -> Self:
        """Constraint on other joints: the new number of each."""
        new = {"joint1": joints[self.joint1], "joint2": joints[self.joint2]}
        return replace(self, **new)  # type: ignore[type-var]

    def placed(self, oMi: Any) -> tuple[Any, Any]:
        """Frames c1 and c2 in the world, by which the rows are evaluated."""
        return oMi[self.joint1] * self.placement1, oMi[self.joint2] * self.placement2

    def ends(self, oMi: Any) -> tuple[Any, Any]:
        """Frames c1 and c2 in the world, or where its force acts and in which axes."""
        return self.placed(oMi)

    def arm(self, oMi: Any) -> float:
        """Distance from c1 to the origin of c2, which the rows are about [m]."""
        c1, c2 = self.placed(oMi)
        return length(c2.translation - c1.translation)

    def reach(self, oMi: Any) -> float:
        """Sum of the lengths that add up to the positions of c1 and c2 in the world [m]."""
        ends = (self.joint1, self.placement1), (self.joint2, self.placement2)
        return sum(length(oMi[j].translation) + length(P.translation) for j, P in ends)

    def shares(self, oMi: Any) -> Array:
        """Sizes of shifts and of turns in the rows (size, 2), if the constraint leans."""
        # The errors of their directions by rounding, over eps, are among them.
        raise NotImplementedError

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Origin of c2."""
        return np.array(c2.translation)

    def end(self, frame: str) -> Literal[1, 2]:
        """Return 1 for the frame that was named first, if joint 1 carries it."""
        end: Literal[1, 2] = 1 if (frame == "first") == (self.sign > 0) else 2
        if not self.anchored and (self.joint1, self.joint2)[end - 1] == 0:
            raise InvalidArgument(
                f"{self.name!r} belongs where it is: without an anchor it has no frame in the world"
            )
        return end

    def approximate_delassus(
        self,
        body: Callable[[int], Array],
        columns: Callable[[Sequence[int]], float | Array],
    ) -> Any:
        """Sum of both bodies' inverse inertias: for shifts linear, for turns 4 times angular."""
        linear, angular = body(self.joint1) + body(self.joint2)
        # MuJoCo's angular rows are half of ours
        return [4 * angular if turns else linear for turns in self.turns(None)]


def tilt(by: float, over: float) -> float:
    """Error over eps of the direction of a vector, off by eps `by`: at most 1 / eps."""
    return by / max(over, _EPS * by) if by else 0.0


def length(x: Array) -> float:
    """Length of a vector."""
    return math.sqrt(x.dot(x))


# A constraint between two bodies, bound to a model: joints, placements and rows for names.


_AXES: Final = ("x", "y", "z", "rx", "ry", "rz")

POINT: Final[tuple[int, ...]] = (0, 1, 2)
FRAME: Final[tuple[int, ...]] = (0, 1, 2, 3, 4, 5)


@dataclass(frozen=True)
class BoundBetweenFrames(TwoFrameConstraint):
    """One constraint between two bodies, bound.

    joint1, placement1: the joint that carries frame c1, and where
    joint2, placement2: The same of c2. The world is joint 0.
    selection: the rows x y z rx ry rz of the relative velocity that stay zero; empty for a rod
    axis: what a hinge, a cylindrical joint or an edge turns about: 0, 1 or 2 for x, y or z of c1
    length: of a rod [m]; NaN for all else
    lever: half the distance of two points on `axis` that stand for a hinge, and what points that
        are nearly one are moved apart by (`condyn_pin.constraints.rows.pinocchio`) [m]
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
    drive: RowPath | None = None
    drift: Baumgarte | None = None

    @property
    def is_rod(self) -> bool:
        """True for a rod: its row is a distance."""
        return not self.selection

    @property
    def is_hinge(self) -> bool:
        """True for a hinge: its rows are all but one turn."""
        return self.size == 5 and self.selection[:3] == POINT

    @property
    def is_aligned(self) -> bool:
        """True for a hinge and a cylindrical joint: the turns across `axis` are held."""
        return self.is_hinge or self.size == 4

    @property
    def hinge_axis(self) -> int | None:
        """Axis of a hinge; None for others."""
        return self.axis if self.is_hinge else None

    @property
    def is_planar(self) -> bool:
        """True for a pin in a plane: its rows are two shifts."""
        return self.size == 2

    @property
    def is_plain(self) -> bool:
        """True if Pinocchio has a constraint of the same rows."""
        return self.selection in (POINT, FRAME)

    @property
    def is_point(self) -> bool:
        """True for a point held on a point of a body or of the world."""
        return self.selection == POINT

    @property
    def is_ball(self) -> bool:
        """True for a point of one moving body held on a point of another."""
        return self.selection == POINT and self.joint1 > 0 and self.joint2 > 0

    @property
    def is_scalar(self) -> bool:
        """True for a rod, whose force is along its line."""
        return self.is_rod

    @property
    def origins_coincide(self) -> bool:
        """True if the constraint has an anchor."""
        return self.anchored

    @property
    def is_held(self) -> bool:
        """True if the rows are the velocity of c1 in its own axes; the world enters c alone."""
        return self.joint2 == 0 and (self.is_plain or not self.anchored)

    @property
    def is_about_c1(self) -> bool:
        """True for a frame, and an edge that belongs where it is: the origin of c1 is held."""
        return self.selection == FRAME or self.is_held

    @property
    def is_cut(self) -> bool:
        """True if the rows are some of the relative velocity at the origin of c2."""
        return not (self.is_rod or self.is_point or self.is_about_c1)

    @property
    def of_six(self) -> tuple[int, ...]:
        """Rows among six: a rod has the first."""
        return self.selection or (0,)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of each row: the constraint's and the axis."""
        axes = [_AXES[i] for i in self.selection] or ["length"]
        return tuple(f"{self.name}.{axis}" for axis in axes)

    def compiled(self) -> CompiledRows:
        """Rows in the format of the compiled core."""
        kind: Any = {POINT: "ball", FRAME: "weld", (): "rod"}.get(self.selection, "cut")
        return CompiledRows(
            "held" if self.is_held else kind, self.rows, self.joint1, self.joint2,
            self.placement1, self.placement2, self.selection, anchored=self.anchored,
            is_hinge=self.is_aligned, is_slider=self.size == 5 and not self.is_hinge,
            axis=self.axis, sign=self.sign, length=self.length if self.is_rod else 0.0,
        )  # fmt: skip

    def whole(self, lam: Array) -> Array:
        """Force with zeros for the components that the kind does not transmit."""
        # (3,) [N], or (6,) [N, N m] for kinds that transmit moments. A rod's direction is not known
        # here.
        force = np.zeros(6 if self.selection[-1] > 2 else 3)
        force[list(self.selection)] = lam
        return force

    def force(self, lam: Array, ends: Callable[[], tuple[Any, Any]]) -> Array:
        """Components of the force in the axes of c1; `ends` returns c1 and c2."""
        if not self.is_rod:
            return self.whole(lam)
        c1, c2 = ends()
        along: Array = c1.actInv(c2).translation
        return np.asarray(lam[0] * np.asarray(along / np.linalg.norm(along)))

    @property
    def has_computed_axes(self) -> bool:
        """True for a rod: its direction is the difference of two positions over its length."""
        return self.is_rod

    def shares(self, oMi: Any) -> Array:
        """Size of a rod's shifts, with the error of its direction."""
        return np.array([[1.0 + tilt(self.reach(oMi), self.arm(oMi)), 0.0]])

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Point of the world where the force acts: for other kinds than points and welds, c2."""
        if not self.anchored and self.joint2 == 0:
            return np.array(c1.translation)  # nothing says where c2 is
        if self.is_plain:  # a weld keeps its wrench whole, a ball acts at each body's own point
            at_two = self.selection == POINT and on_first != (self.sign > 0)
            return np.array((c2 if at_two else c1).translation)
        return super().acts_at(c1, c2, on_first=on_first)

    def turns(self, model: Any) -> NDArray[np.bool_]:
        """Flag of each row: angle, or else length."""
        return np.array([row > 2 for row in self.selection] or [False])

    def opening(self, model: Any, c: Array) -> tuple[float, float]:
        """Gap by the rows of c: length [m] and angle [rad]."""
        # Those of a weld are log6 of the placement of one frame in the other: the length of that is
        # no distance, but along a screw. The result is the distance and the angle between the
        # frames.
        if self.selection == FRAME:
            apart = pin.exp6(pin.Motion(np.ascontiguousarray(c))).translation
            return math.hypot(*apart), math.hypot(*c[3:])
        return self.rates(model, c)


@dataclass(frozen=True)
class PinocchioConstraint:
    """Constraint of Pinocchio, of 3 or of 6 rows.

    `approximates` is True where it stands for rows of another kind; all else is as in
    `BoundBetweenFrames`.
    """

    name: str
    size: int
    joint1: int
    placement1: Any
    joint2: int
    placement2: Any
    anchored: bool
    lever: float  # [m]
    approximates: bool
    drift: Baumgarte | None = None

    @classmethod
    def of(
        cls, b: BoundBetweenFrames, size: int, d1: Array | None = None, d2: Array | None = None
    ) -> PinocchioConstraint:
        """Point or frame, shifted by d1 in the axes of c1 and by d2 in those of c2."""
        # where a contact is unanchored, c2 is not read
        one, two = (
            placement if d is None else placement * pin.SE3(np.eye(3), d)
            for placement, d in ((b.placement1, d1), (b.placement2, d2))
        )
        name = b.name
        if size != b.size:
            name += "-" if d2 is not None and d2.sum() < 0 else "+"
        return cls(
            name, size, b.joint1, one, b.joint2, two, b.anchored, b.lever,
            approximates=size != b.size, drift=b.drift,
        )  # fmt: skip

    def to_pinocchio(self, model: Any) -> Any:
        """Pinocchio's RigidConstraintModel."""
        kind = pin.ContactType.CONTACT_3D if self.size == 3 else pin.ContactType.CONTACT_6D
        made = pin.RigidConstraintModel(
            kind, model, self.joint1, self.placement1, self.joint2, self.placement2, LOCAL
        )
        made.name = self.name
        return made


# Terms: what the equations of a scene are made of at one state.


@dataclass(frozen=True, eq=False)
class Terms:
    """The terms of the two equations at one state.

    M a + h = tau + J^T lam,    J a + gamma = a_ref

    Attributes
    ----------
    M : (nv, nv) array
        Mass matrix, armature included, both triangles.
    h : (nv,) array
        Coriolis, centrifugal and gravity torques [N m, N].
    J : (m, nv) array
        Constraint Jacobian, rows in the order of the scene, in the axes of each constraint.
    gamma : (m,) array
        Jdot v where J v = 0; for points and balls the classical acceleration elsewhere.
    a_ref : (m,) array
        Wanted acceleration of the constraints; zero without drift control.
    """

    M: Array
    h: Array
    J: Array
    gamma: Array
    a_ref: Array

    def __init__(self, M: Array, h: Array, J: Array, gamma: Array, a_ref: Array) -> None:
        # at once: the guarded assignments of a frozen dataclass take twice as long
        self.__dict__.update(M=M, h=h, J=J, gamma=gamma, a_ref=a_ref)

    def kept(self, left: RedundantRows) -> Terms:
        """Terms without the combinations of rows that are left out.

        Parameters
        ----------
        left : RedundantRows
            What is left out at their state.
        """
        J, gamma, a_ref = (left.kept(part) for part in (self.J, self.gamma, self.a_ref))
        return Terms(self.M, self.h, J, gamma, a_ref)


def largest_torque(terms: Terms, tau: Array, size: float) -> float:
    """Largest |M| size + |h| + |tau| of a joint [N, N m]: the scale of constraint forces."""
    # `size` is that of a: the larger of |a|_inf and gravity.
    torques = np.abs(terms.M).sum(axis=1) * size + np.abs(terms.h) + np.abs(tau)
    return float(torques.max())


def finite_terms(equations: Equations, q: Array, v: Array) -> Terms:
    """Terms at a checked state; InvalidArgument if v makes them overflow."""
    with np.errstate(all="ignore"):  # what overflows is refused
        terms = equations.terms(q, v)
    check_overflow("v", v, terms.h, terms.gamma, terms.a_ref)
    return terms


# Gaps: how far one constraint is open, in metres and radians, and how fast its sides part.


_TINY = 1e-3  # [mm, deg]


class ConstraintViolation(NamedTuple):
    """Violation of a constraint, or of joint limits.

    Attributes
    ----------
    length : float
        Of its rows that are lengths [m], or [m/s] of a velocity.
    angle : float
        Of its rows that are angles [rad], or [rad/s].
    """

    length: float  # [m], or [m/s] of a velocity
    angle: float  # [rad], or [rad/s]

    @property
    def size(self) -> float:
        """Larger of the two numbers."""
        return max(self.length, self.angle)

    def text(self, per: str = "") -> str:
        """Return the violation in mm and degrees, `per` behind the units, such as "/s".

        A part that is rounding beside the other is left out.
        """
        least = tolerances.CLOSED if self.size > tolerances.CLOSED else 0.0
        parts = []
        if self.length > least or not self.angle > least:
            parts.append(f"{_digits(1e3 * self.length)} mm{per}")
        if self.angle > least:
            parts.append(f"{_digits(math.degrees(self.angle))} deg{per}")
        return " and ".join(parts)

    def __str__(self) -> str:
        return self.text()


def beyond_text(beyond: Mapping[str, ConstraintViolation]) -> str:
    """Violations of joint limits as text."""
    return ", ".join(f"{joint} is {by} beyond its limits" for joint, by in beyond.items())


def closed(gap: Mapping[str, ConstraintViolation]) -> bool:
    """True if every gap is within tolerance (1e-10)."""
    return all(each.size <= tolerances.CLOSED for each in gap.values())


def largest_violation(gap: Mapping[str, ConstraintViolation]) -> tuple[str, ConstraintViolation]:
    """Name and size of the largest gap."""
    return max(gap.items(), key=lambda item: item[1].size)


def gap_of(model: Any, bound: BoundConstraint, c: Array) -> ConstraintViolation:
    """Gap of one constraint, by its rows of c."""
    return ConstraintViolation(*bound.opening(model, c))


def _digits(x: float) -> str:
    """Number with three digits, as a decimal fraction unless it is tiny."""
    if not _TINY <= x < math.inf:
        return f"{x:.3g}"
    return np.format_float_positional(float(f"{x:.3g}"), trim="-")
