"""The contract of a constraint: what a kind is lies in one file, and the rest of the program asks.

    J(q) v = 0,        J a + gamma = a_ref,        c(q) = 0 where the kind has a position

A constraint is seen from two sides. The user holds a `Constraint`, a frozen value that names frames
or joints. `bind` makes a `AnyBound` of it (`condyn_pin.constraints.rows.bound`): joints, placements
and rows of one model, which has its equations.

    question                                       who answers                     by default
    ---------------------------------------------  ------------------------------  -------------
    how many rows, and what they are               rows, bind                      to be written
    frames, joints, the two bodies it ties         frames, joints, sides           of its base
    what files and summaries call it               word, closes, title, called     the class
    whom its force is on, by whom, in which axes   acting                          of its base
    does it press on a floor, and with what        presses, has_normal, support    it does not
    which points of it touch that floor            feet                            none
    where it belongs, if it is where it is         anchored_at                     itself
    does it follow a path, and where is it at t    is_rheonomic, at                it does not
    the same with c' = J v wherever c is           bind_to_drive                   refused
    the same by points, or as a planar pin         by_points, as_planar_pin        none
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
   the functions below and ends with `_set_name`. Fields in metres are listed in `lengths`.
3. It registers itself in `KINDS` under its name, by which archives find it; with a `word`
   robot.toml has it too: among its loops if it `closes`, among its contacts if not.
4. What it answers otherwise than its base it overrides. Nothing outside of this room asks what
   kind it is: a question that no method answers becomes a method here, with a default.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar, Self

from condyn_pin._core.arguments import enter
from condyn_pin.constraints.constraint_fields import Vector3
from condyn_pin.constraints.protocols import Machine, MjcfWriter
from condyn_pin.constraints.support import Foot, Patch, Support
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from condyn_pin.constraints.rows.any_bound import AnyBound

WORLD = ("world", "universe")

# All kinds by the names of their classes; `condyn_pin.constraints.kinds` has those of the library.
KINDS: dict[str, type[Constraint]] = {}


@dataclass(frozen=True, kw_only=True)
class Constraint(ABC):
    """What every constraint has: a name, a number of rows, and an answer to every question.

    Parameters
    ----------
    name : str, optional
        What forces, rows and errors are listed under; after its frames or joints by default.
    """

    word: ClassVar[str] = ""  # what robot.toml calls the kind; it has no word for most
    closes: ClassVar[bool] = False  # whether robots list it among their loops, not their contacts
    lengths: ClassVar[tuple[str, ...]] = ()  # fields in metres
    unitless: ClassVar[tuple[str, ...]] = ()  # fields with numbers that have no unit
    has_normal: ClassVar[bool] = False  # whether z of its force is a normal; else the vertical is

    name: str = ""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if ABC not in cls.__bases__:
            enter(KINDS, cls.__name__, cls, f"a kind of constraint named {cls.__name__}")

    def _set_name(self, default: str) -> None:
        if not isinstance(self.name, str):
            raise InvalidArgument(f"name = {self.name!r}: a text is needed")
        object.__setattr__(self, "name", self.name or default)

    @property
    @abstractmethod
    def rows(self) -> int:
        """Number of rows of the constraint."""

    @abstractmethod
    def bind(self, machine: Machine, rows: slice) -> AnyBound:
        """Return it on the joints and columns of a machine, at some rows."""

    def bind_to_drive(self, machine: Machine, rows: slice) -> AnyBound:
        """Return it bound so that J v is the rate of c wherever c is, as `Driven` needs, or raise.

        InvalidConstraint where that is so at c = 0 alone. `machine` and `rows` are those of `bind`.
        """
        from condyn_pin.constraints.driven import not_to_drive  # a constraint of constraints

        raise not_to_drive(self)

    def at(self, t: float) -> Self:
        """Return it at a time [s]: itself, unless it follows a path."""
        return self

    @property
    def is_rheonomic(self) -> bool:
        """Whether time enters its rows."""
        return False

    @property
    def on_velocity(self) -> bool:
        """Whether some of its rows are on the velocity alone."""
        return False

    @abstractmethod
    def sides(self, machine: Machine) -> tuple[int, ...]:
        """Return the numbers of the joints of a machine that it ties, 0 is the world."""

    @abstractmethod
    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return whom its force is on, by whom, and in whose axes.

        Parameters
        ----------
        swapped : bool
            Whether its rows are written in the axes of the frame that was named second.
        """

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames of the robot, or of the world, that it names: two, one or none."""
        return ()

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints whose coordinates it ties: none for what is between frames."""
        return ()

    @property
    def title(self) -> str:
        """What it is, for summaries."""
        return type(self).__name__

    @property
    def called(self) -> str:
        """What it is, within a sentence."""
        return type(self).__name__

    @property
    def presses(self) -> bool:
        """Whether it is a contact with a normal force, which no ground lets pull."""
        return self.support is not None

    @property
    def support(self) -> Support | None:
        """What of a contact lies on the floor; None for what does not press on one."""
        return None

    @property
    def feet(self) -> tuple[Foot, ...]:
        """What of a contact touches a floor, point by point."""
        return ()

    @property
    def point(self) -> Vector3 | None:
        """The point of its frame that it holds wherever it is, and nothing else; None if not so."""
        return None

    @property
    def is_pin(self) -> bool:
        """Whether it ties a point of one body to one of another, in space or in a plane."""
        return False

    @property
    def in_mjcf(self) -> bool:
        """Whether MuJoCo has an equality for it."""
        return False

    @property
    def by_points_called(self) -> str:
        """What studies call its equivalent by points; empty if it has none."""
        return ""

    def anchored_at(self, c1: Any, c2: Any) -> Constraint:
        """Return it anchored where its frames c1 and c2 are; itself if it belongs everywhere."""
        return self

    def by_points(self, robot: Any) -> tuple[Any, tuple[Constraint, ...]]:
        """Return its equivalent by points, and the robot with frames for them; itself without one.

        The rows are more, and say the same.
        """
        return robot, (self,)

    def as_planar_pin(self, frame: str) -> Constraint | None:
        """Return the same without the row along z of a frame at its first one, for a ball."""
        return None

    def renamed(self, new: Callable[[str], str]) -> Constraint:
        """Return it between frames and joints of other names, under a new name of its own."""
        named = ("frame", "joint")  # fields that name one begin so
        changed = {
            field: new(value)
            for field, value in vars(self).items()
            if isinstance(value, str) and field.startswith(named)
        }
        return replace(self, name=new(self.name), **changed)

    def with_held(self, values: Mapping[str, float]) -> Constraint:
        """Return it where joints are held at values: the same for what is between frames."""
        return self

    def in_units(self, length: float, of_joint: Callable[[str], float]) -> Constraint:
        """Return it with lengths times `length`, and coordinates of joints times `of_joint`."""

        def scaled(value: Any) -> Any:
            if not isinstance(value, tuple):
                return length * value
            # a point, and a quaternion where it is a placement
            return (*(length * x for x in value[:3]), *value[3:])

        changed = {}
        for field, value in vars(self).items():
            if field in self.lengths and value is not None:
                changed[field] = scaled(value)
            elif field not in (*self.lengths, *self.unitless) and _has_numbers(value):
                raise InvalidArgument(f"{self.name}: nothing says what unit its {field} has")
        return replace(self, **changed)

    def write_mjcf(self, to: MjcfWriter) -> None:
        """Write the equalities that are the constraint `to` a file, if it is `in_mjcf`."""
        raise NotImplementedError(f"{self.name}: MuJoCo has no equality for a {self.called}")

    def patch(self, size: float) -> Patch | None:
        """Return what a contact is drawn with, in a scene of some size [m]; None for the others."""
        return None


def _has_numbers(value: Any) -> bool:
    return any(isinstance(x, Real) for x in (value if isinstance(value, tuple) else (value,)))
