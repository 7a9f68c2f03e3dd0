"""Contract of a constraint: one file for each kind, and its answers to the program.

    J(q) v = 0,        J a + gamma = a_ref,        c(q) = 0 where the kind has a position

A constraint is seen from two sides. The user holds a `Constraint`, a frozen value that names frames
or joints. `bind` makes a `BoundConstraint` of it (`condyn_pin.constraints.rows.bound`): joints,
placements and rows of one model, which has its equations.

    question                                       who answers                     by default
    ---------------------------------------------  ------------------------------  -------------
    how many rows, and what they are               rows, bind                      to be written
    frames, joints, the two bodies it ties         frames, joints, sides           of its base
    what files and summaries call it               word, closes, title, called     the class
    whom its force is on, by whom, in which axes   acting                          of its base
    does it press on a floor, and with what        presses, has_normal, support    it does not
    which points of it touch that floor            feet                            none
    where it belongs, if it is where it is         anchored_at                     itself
    is it a cable, whose force is a tension        only_pulls                      it is not
    does it follow a path, and where is it at t    is_rheonomic, at                it does not
    the same with c' = J v wherever c is           bind_to_drive                   refused
    the same by points, or as a planar pin         by_points, as_planar_pin        none
    which joint it is the cut of                   cut_joints                      none
    the same with other names                      renamed                         by its fields
    the same in other units                        in_units, lengths, unitless     by its fields
    how MuJoCo has it                              in_mjcf, write_mjcf             it has not
    what is drawn                                  patch                           nothing

and of the bound one: the names of its rows, which of them have a position, where its frames are, at
which point it acts, how far it is open in metres and radians, what is rounding in its rows, how
Pinocchio has it, and by which group its rows and their partial derivatives are evaluated.

To add a kind: one file.

1. One frozen dataclass. It inherits from `FrameRelation` (`condyn_pin.constraints.relation`) if it
   relates two frames by new equations: then write `rows`, `violation`, `weights` and
   `weights_rate`, and nothing else. Other bases are `WithWorld` and `BetweenFrames`.
2. Its fields are what a file says of it: texts, numbers, tuples. `__post_init__` checks them with
   the functions below, frames with `set_frames` (`condyn_pin.constraints.places`), and ends with
   `_set_name`. Fields in metres are listed in `lengths`.
3. It registers itself in `KINDS` under its name, by which archives find it; one of the library is
   imported in `kinds.py`. With a `word` robot.toml has it too: among its loops if it `closes`,
   among its contacts if not.
4. What it answers otherwise than its base it overrides. Nothing outside of this room depends on
   its kind: a question that no method answers becomes a method here, with a default.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Final,
    Literal,
    NamedTuple,
    Protocol,
    Self,
    get_args,
)

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_type, register
from condyn_pin._core.arrays import Array, finite, text_of
from condyn_pin._core.models import rotation_fault, z_along
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.places import FrameLike, place_of, set_frames, short_frames
from condyn_pin.errors import InvalidArgument, UnknownName, unknown_name

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.bound import BoundConstraint


# All kinds by the names of their classes; `condyn_pin.constraints.kinds` has those of the library.
KINDS: dict[str, type[Constraint]] = {}


class GivenFields:
    """Dataclass whose repr has the fields that differ from their defaults."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__repr__" not in vars(cls):  # before the dataclass gives it one with all fields
            cls.__repr__ = cls.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        given = ((f, getattr(self, f.name)) for f in fields(self) if f.repr)  # type: ignore[arg-type]
        said = [f"{f.name}={value!r}" for f, value in given if (value == f.default) is not True]
        return f"{type(self).__qualname__}({', '.join(said)})"


@dataclass(frozen=True, kw_only=True)
class Constraint(GivenFields, ABC):
    """Base of every constraint: a name, a number of rows, and defaults of the contract.

    Parameters
    ----------
    name : str, optional
        What forces, rows and errors are listed under; after its frames or joints by default.
    axes : str, (joint, pin.SE3) or pin.Frame, optional
        Frame whose axes the components of its force are in, such as "world"; its own by default.
        Rows, and so `lam` and its derivatives, stay in their own.
    drift : Baumgarte, optional
        Stabilisation of its own rows; by default that of the question, `solve(..., drift=...)`.
    """

    word: ClassVar[str] = ""  # what robot.toml calls the kind; it has no word for most
    closes: ClassVar[bool] = False  # whether robots list it among their loops, not their contacts
    lengths: ClassVar[tuple[str, ...]] = ()  # fields in metres
    unitless: ClassVar[tuple[str, ...]] = ()  # fields with numbers that have no unit
    has_normal: ClassVar[bool] = False  # whether z of its force is a normal; else the vertical is

    name: str = ""
    axes: FrameLike | None = None
    drift: Baumgarte | None = None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if ABC not in cls.__bases__:
            register(KINDS, cls.__name__, cls, f"a kind of constraint named {cls.__name__}")

    def _set_name(self, default: str) -> None:
        check_type("name", self.name, str, "a text is needed")
        object.__setattr__(self, "name", self.name or short_frames(default))
        if self.axes is not None:
            set_frames(self, "axes")
        check_type("drift", self.drift, Baumgarte | None, "Baumgarte(alpha, beta) is needed")

    @property
    @abstractmethod
    def rows(self) -> int:
        """Number of rows of the constraint."""

    @abstractmethod
    def bind(self, machine: FramedModel, rows: slice) -> BoundConstraint:
        """Return the constraint bound to the joints and columns of a machine, at some rows."""

    def bind_to_drive(self, machine: FramedModel, rows: slice) -> BoundConstraint:
        """Return the constraint bound so that J v = c' at any c, as `Driven` needs, or raise.

        InvalidConstraint where that is so at c = 0 alone. `machine` and `rows` are those of `bind`.
        """
        from condyn_pin.constraints.driven import not_to_drive  # a constraint of constraints

        raise not_to_drive(self)

    def at(self, t: float) -> Self:
        """Return the constraint at a time t [s]: itself, unless it follows a path."""
        return self

    @property
    def is_rheonomic(self) -> bool:
        """True if time enters the rows."""
        return False

    @property
    def on_velocity(self) -> bool:
        """True if some rows are on the velocity alone."""
        return False

    @abstractmethod
    def sides(self, machine: FramedModel) -> tuple[int, ...]:
        """Return the numbers of the joints of a machine that it ties; 0 is the world."""

    @abstractmethod
    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return the body under the force, the body that exerts it, and the frame of its axes.

        Parameters
        ----------
        swapped : bool
            Whether its rows are written in the axes of the frame that was named second.
        """

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames of the robot, or of the world, that the constraint names: two, one or none."""
        return ()

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints whose coordinates the constraint ties: none for a constraint between frames."""
        return ()

    @property
    def title(self) -> str:
        """Name of the kind, for summaries."""
        return type(self).__name__

    @property
    def called(self) -> str:
        """Name of the kind within a sentence."""
        return type(self).__name__

    @property
    def presses(self) -> bool:
        """True for a contact with a normal force, which cannot pull."""
        return self.support is not None

    @property
    def only_pulls(self) -> bool:
        """True for a cable: its force is a tension, which is not negative."""
        return False

    @property
    def support(self) -> Support | None:
        """Support of a contact on the floor: a point, an edge or a rectangle; None without one."""
        return None

    @property
    def feet(self) -> tuple[Foot, ...]:
        """Points of a contact that touch the floor."""
        return ()

    @property
    def point(self) -> Vector3 | None:
        """Point of the frame that is held wherever it is, if nothing else is held; else None."""
        return None

    @property
    def is_pin(self) -> bool:
        """True if a point of one body is pinned to one of another, in space or in a plane."""
        return False

    @property
    def in_mjcf(self) -> bool:
        """True if MuJoCo has an equality for the constraint."""
        return False

    @property
    def by_points_called(self) -> str:
        """Name of the equivalent by points in studies; empty without one."""
        return ""

    def anchored_at(self, c1: Any, c2: Any) -> Constraint:
        """Return the constraint anchored at its frames c1 and c2; itself if it has no anchor."""
        return self

    def by_points(self, robot: Any) -> tuple[Any, tuple[Constraint, ...]]:
        """Return a robot with frames for the equivalent by points, and its constraints; or itself.

        The rows are more, and say the same.
        """
        return robot, (self,)

    def as_planar_pin(self, frame: str) -> Constraint | None:
        """Return a ball without its row along z of a `frame` at its first one; None for others."""
        return None

    @property
    def cut_joints(self) -> tuple[Any, ...]:
        """Joints from its first frame to its second, each with coordinates; none by default."""
        return ()

    def renamed(self, new: Callable[[str], str]) -> Constraint:
        """Return the constraint between frames and joints of new names, its own name too."""
        named = ("frame", "joint", "axes")  # fields that name one begin so
        changed: dict[str, Any] = {
            field: new(value)
            for field, value in vars(self).items()
            if isinstance(value, str) and field.startswith(named)
        }
        return replace(self, name=new(self.name), **changed)

    def with_held(self, values: Mapping[str, float]) -> Constraint:
        """Return the constraint with joints held at values: itself if it is between frames."""
        return self

    def in_units(self, length: float, of_joint: Callable[[str], float]) -> Constraint:
        """Return the constraint with lengths times `length` and joint values times `of_joint`."""

        def scaled(value: Any) -> Any:
            if not isinstance(value, tuple):
                return length * value
            # a point, and a quaternion where it is a placement
            return (*(length * x for x in value[:3]), *value[3:])

        changed = {}
        for field, value in vars(self).items():
            if field in self.lengths and value is not None:
                changed[field] = scaled(value)
            elif field != "name" and isinstance(value, str) and place_of(value):
                raise InvalidArgument(
                    f"{self.name}: {field} = {value!r} has lengths; Robot.with_frame names it"
                )
            elif field not in (*self.lengths, *self.unitless) and _has_numbers(value):
                raise InvalidArgument(f"{self.name}: nothing says what unit its {field} has")
        return replace(self, **changed)

    def write_mjcf(self, to: MjcfWriter) -> None:
        """Write the equalities of the constraint `to` a file, if it is `in_mjcf`."""
        raise NotImplementedError(f"{self.name}: MuJoCo has no equality for a {self.called}")

    def patch(self, size: float) -> Patch | None:
        """Return the picture of a contact in a scene of some size [m]; None for the others."""
        return None


def _has_numbers(value: Any) -> bool:
    return any(isinstance(x, Real) for x in (value if isinstance(value, tuple) else (value,)))


# What constraints are bound to, and what they are written to.


class FramedModel(Protocol):
    """A `pinocchio.Model` with frames by name, such as a `Robot`, to bind constraints to."""

    @property
    def model(self) -> Any:
        """The `pinocchio.Model`."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, without the world's."""

    @property
    def longest_link(self) -> float:
        """Largest distance from a joint to the next one [m]."""

    def frame(self, name: FrameLike) -> tuple[int, Any]:
        """Return the joint that carries a frame and its placement on it, or raise UnknownName."""


def no_joint(machine: FramedModel, name: str) -> UnknownName:
    """Error for a name that no joint has, with the cure where a loop has it."""
    if any(loop.name == name for loop in getattr(machine, "loops", ())):
        return UnknownName(
            f"no joint named {name!r}: it closes a loop, and has no coordinate; "
            f"robot.with_whole_joints({name!r}) gives it one"
        )
    return unknown_name("joint", name, machine.joints)


class MjcfGeomWriter(Protocol):
    """Writer of contacts as MJCF."""

    def collide(
        self,
        name: str,
        first: tuple[str, Vector3, Any],
        second: Any,
        friction: float,
    ) -> None:
        """Write the geoms of a shape at an offset in a frame, and of a plane or another shape."""

    def cable(
        self, name: str, frames: Sequence[str], at_least: float | None, at_most: float | None
    ) -> None:
        """Write a cable over frames with a shortest and a longest length [m]."""

    def dry(self, joint: str, torque: float | None) -> None:
        """Write the dry friction of a joint [N m, N]."""


class MjcfWriter(Protocol):
    """Writer of constraints as MJCF."""

    robot: Any

    def equate(self, tag: str, **words: str | Sequence[float]) -> None:
        """Write an equality."""

    def fixed_tendon(self, name: str, weights: Mapping[str, float]) -> str:
        """Write a fixed tendon, a weighted sum of joint coordinates; return its name."""

    def site(self, frame: str, new: str) -> str:
        """Return the site of a frame; it is made with the name `new` if there is none."""

    def site_beside(self, frame: str, new: str, shift: Vector3) -> str:
        """Return a new site, shifted from a frame in its axes [m]."""

    def coordinate(self, joint: str) -> float:
        """Return the coordinate of a joint where the file draws the model [rad or m]."""


# What of a contact lies on the floor: its size, the points of it that touch, and its picture.


class Support(NamedTuple):
    """Support of a contact on the floor, in the axes of its frame: a point by default."""

    half_length: float | None = 0.0  # [m]; None where nothing says it
    half_width: float | None = 0.0  # [m]
    axis: int | None = None  # of an edge: it lies along x, y or z

    @property
    def is_point(self) -> bool:
        """True if the support has no size."""
        return self.half_length == 0.0


class Foot(NamedTuple):
    """A point of the robot, or the middle of a ball, that touches a floor."""

    name: str
    frame: str
    offset: Vector3  # in the axes of the frame [m]
    radius: float = 0.0  # [m]


class Patch(NamedTuple):
    """The shape that a contact is drawn with."""

    shape: Literal["ball", "box", "capsule", "rod"]
    size: tuple[float, ...]  # [m]: radius; three edges; radius and length between the ends
    along: Vector3 = (0.0, 0.0, 1.0)  # axis of a rod
    turns: bool = True  # with the body; else its axes are the world's


# What the fields of a constraint have to be.


Axis = Literal["x", "y", "z"]
Vector3 = tuple[float, float, float]
Placement = tuple[float, float, float, float, float, float, float]


def floats(argument: str, value: Any, size: int) -> tuple[float, ...]:
    """Tuple of a sequence of numbers, or InvalidArgument."""
    try:
        array = finite(argument, value, size)
    except InvalidArgument as error:
        raise InvalidArgument(
            f"{argument} = {text_of(value)}: {size} finite numbers are needed"
        ) from error
    check_size(argument, *array)
    return tuple(float(x) for x in array)


def not_negative(argument: str, value: Any) -> float:
    """Number that is not negative, or InvalidArgument."""
    number = float(finite(argument, value, ()))
    if number < 0:
        raise InvalidArgument(f"{argument} = {text_of(value)}: a number >= 0 is needed")
    check_size(argument, number)
    return number


def check_size(argument: str, *numbers: float) -> None:
    """Raise InvalidArgument if numbers are so large that results overflow."""
    for number in numbers:
        if abs(number) > tolerances.HUGE:
            raise InvalidArgument(
                f"{argument} = {number:g}: no machine has that; {tolerances.HUGE:g} is the largest "
                "number"
            )


def direction(argument: str, value: Any) -> tuple[float, ...]:
    """Unit vector of three numbers, or InvalidArgument."""
    return unit(floats(argument, value, 3), f"{argument} = (0, 0, 0): a direction is needed")


def unit(vector: Sequence[float], fault: str) -> tuple[float, ...]:
    """Unit vector along a vector; InvalidArgument with the given fault if it is zero."""
    exponent = math.frexp(max(map(abs, vector)))[1]
    scaled = [math.ldexp(x, -exponent) for x in vector]  # exact, and no longer subnormal
    norm = math.hypot(*scaled)
    if norm == 0.0:
        raise InvalidArgument(fault)
    return tuple(x / norm for x in scaled)


def text(argument: str, value: Any, what: str) -> str:
    """Name as a text that is not empty, or InvalidArgument."""
    if not isinstance(value, str) or not value:
        raise InvalidArgument(f"{argument} = {text_of(value)}: the name of a {what} is needed")
    return value


def check_positive(kind: str = "number", /, **values: float) -> None:
    """Raise InvalidArgument unless values, by name, are positive."""
    for name, value in values.items():
        try:
            number = isinstance(value, Real) and not isinstance(value, bool)
            size = float(value) if number else 0.0
        except OverflowError:  # a whole number beyond a double
            size = math.inf
        if not 0.0 < size < math.inf:
            raise InvalidArgument(f"{name} = {text_of(value)}: a positive {kind} is needed")
        check_size(name, size)


def check_lengths(**lengths: float | None) -> None:
    """Raise InvalidArgument unless lengths, by name, are positive; None is left out."""
    said = {name: length for name, length in lengths.items() if length is not None}
    check_positive("length [m]", **said)


def check_axis(axis: Any) -> None:
    """Raise InvalidArgument unless a value is the name of an axis."""
    if axis not in get_args(Axis):
        raise InvalidArgument(
            f"axis = {text_of(axis)}: one of {', '.join(get_args(Axis))} is needed"
        )


def placement(argument: str, value: object) -> Placement | None:
    """Placement in the world with a unit quaternion, or InvalidArgument."""
    if value is None:
        return None
    if isinstance(value, pin.SE3):
        fault = rotation_fault(value.rotation)
        if fault and np.isfinite(value.rotation).all():
            raise InvalidArgument(f"{argument}: it has no valid rotation: {fault}")
    x, y, z, *quaternion = floats(
        argument, pin.SE3ToXYZQUAT(value) if isinstance(value, pin.SE3) else value, 7
    )
    fault = f"{argument}: its quaternion (x y z w) is zero; use 0 0 0 1"
    qx, qy, qz, qw = unit(quaternion, fault)
    return x, y, z, qx, qy, qz, qw


# Between two frames of the robot, of which one may belong to the world: what loops share.


class BetweenFrames(Constraint, ABC):
    """Constraint between two frames."""

    closes: ClassVar[bool] = True

    frame_a: FrameLike
    frame_b: FrameLike

    @property
    def frames(self) -> tuple[str, ...]:
        """The two frames."""
        return self.frame_a, self.frame_b

    def sides(self, machine: FramedModel) -> tuple[int, int]:
        """Return the joints that carry the two frames."""
        return machine.frame(self.frame_a)[0], machine.frame(self.frame_b)[0]

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return the first frame, the second, and the frame whose axes the rows are in."""
        return self.frame_a, self.frame_b, self.frame_b if swapped else self.frame_a


def lever(machine: FramedModel, *placements: Any) -> float:
    """Size of the bodies that meet [m], as the distance between two points on them."""
    # A short lever turns rounding of the points into moments: 1/lever^2 enters the condition. A
    # frame near the middle of its joint says nothing about the size; then it is that of the robot's
    # links.
    own = max(float(np.linalg.norm(p.translation)) for p in placements)
    links = machine.longest_link
    return own if own > 0.1 * links else links or 1.0


# Between one frame of the robot and the world: what contacts, blades and wheels share.


USUAL: Final = 0.025  # half of what is drawn of a contact that says no size, of that of the scene
THIN: Final = 0.004  # thickness of what is drawn, the same


class WithWorld(Constraint, ABC):
    """Constraint between one frame of the robot and the world."""

    frame: FrameLike

    @property
    def frames(self) -> tuple[str, ...]:
        """The frame."""
        return (self.frame,)

    def sides(self, machine: FramedModel) -> tuple[int, int]:
        """Return the joint that carries the frame, and 0."""
        return machine.frame(self.frame)[0], 0

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return the frame, the world, and the frame again for its axes."""
        return self.frame, "world", self.frame

    def patch(self, size: float) -> Patch:
        """Return a small ball."""
        return Patch("ball", (0.012 * size,))


def plane(normal: Sequence[float] | Array, height: float | None) -> Any:
    """Frame in a plane of the world, z along its normal."""
    up = np.array(normal)
    return pin.SE3(z_along(up), (height or 0.0) * up)


def shifted_placement(placement: Any, offset: Vector3) -> Any:
    """Placement shifted in its own axes."""
    return placement * pin.SE3(np.eye(3), np.array(offset))
