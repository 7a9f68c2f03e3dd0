"""The contract of a bound constraint: what the rest of the program asks it.

`condyn_pin.constraints.base` says how a kind is made. Rows are evaluated in groups, not one by one:
that stays inside of this room (`condyn_pin.constraints.rows.groups`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.path import Along
from condyn_pin.constraints.rows.compiled_rows import CompiledRows
from condyn_pin.errors import InvalidArgument

_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class Drive:
    """What moves driven rows: c = s(t), J v = s'(t), J a + gamma = s''(t).

    `along` returns the three at a time; `time` is the one at which the constraint is evaluated, and
    None where that has not been said.
    """

    along: Along
    time: float | None  # [s]


class AnyBound(ABC):
    """What every bound constraint has, and answers.

    Attributes
    ----------
    name : str
    rows : slice
        Its rows among those of the scene.
    anchored : bool
        False for a contact that belongs wherever it is: it has no position error.
    sign : float
        +1 if the force on the first-named body is the one on joint 1, else -1.
    drive : Drive or None
        What its rows follow, if they do not stay at zero.
    """

    name: str
    rows: slice
    anchored: bool
    sign: float
    drive: Drive | None

    @property
    def size(self) -> int:
        """Number of rows."""
        return int(self.rows.stop - self.rows.start)

    @property
    @abstractmethod
    def row_names(self) -> tuple[str, ...]:
        """A name for each row: the constraint's, and what it is along."""

    @property
    def positioned(self) -> range:
        """Its rows that have a position error."""
        return range(self.rows.start, self.rows.stop if self.anchored else self.rows.start)

    @property
    def is_plain(self) -> bool:
        """Whether Pinocchio has a constraint of these very rows."""
        return False

    @property
    def is_ball(self) -> bool:
        """Whether it is a point of one moving body on one of another, and nothing else."""
        return False

    @property
    def is_scalar(self) -> bool:
        """Whether its force is one number, along a line or a joint."""
        return False

    @property
    def leans(self) -> bool:
        """True if its rows are along directions that are computed, and not axes of its frames."""
        return False

    @property
    def hinge_axis(self) -> int | None:
        """The axis of c1 about which a hinge turns: 0, 1 or 2; None if it is no hinge."""
        return None

    @property
    def joints(self) -> tuple[int, int] | None:
        """The joints that carry its frames c1 and c2; None if it has no frames."""
        return None

    @property
    def one_body(self) -> int | None:
        """The joint of the body that both its sides are on; None where they are on two."""
        return None

    def within(self, joints: Container[int]) -> bool:
        """Return whether both its sides are on bodies of these joints.

        Moving them as one body then changes nothing, also where it is open and J says otherwise.
        """
        return False

    @property
    def on_robot(self) -> int:
        """Which of its two frames is on the robot: 0 for c1, 1 for c2."""
        return 0

    @property
    def meets(self) -> bool:
        """Whether the origins of its two frames belong at one place."""
        return False

    def compiled(self) -> CompiledRows | None:
        """Return its rows as the compiled core has them; None if it has no such rows.

        Those that follow a path are those that do not: the core is told where the path is.
        """
        return None

    @abstractmethod
    def moved(self, joints: Sequence[int]) -> Self:
        """Return it on other joints: the new number of each."""

    @abstractmethod
    def ends(self, oMi: Any) -> tuple[Any, Any] | None:
        """Return its frames c1 and c2 in the world; None if it has none.

        The axes of c1 are those of its force.
        """

    def whole(self, lam: Array) -> Array:
        """Return the force with the components that the kind does not transmit: they are zero."""
        return lam.copy()

    def force(self, lam: Array, ends: Callable[[], tuple[Any, Any]]) -> Array:
        """Return the components of the force in the axes of c1; `ends` finds c1 and c2."""
        return self.whole(lam)

    @abstractmethod
    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Return the point of the world at which its force acts, or the opposite one."""

    def reaction(self, *, on_first: bool) -> float:
        """Return how many times as large as a force the one on the other side is."""
        return 1.0

    @abstractmethod
    def turns(self, model: Any) -> NDArray[np.bool_]:
        """Return for each row whether it is an angle, not a length."""

    def opening(self, model: Any, c: Array) -> tuple[float, float]:
        """Return how far it is open, from its rows of c: length [m] and angle [rad]."""
        return self.rates(model, c)

    def rates(self, model: Any, velocity: Array) -> tuple[float, float]:
        """Return how fast its sides move apart, from its rows of J v: [m/s] and [rad/s]."""
        angular = self.turns(model)
        # no square overflows
        return math.hypot(*velocity[~angular]), math.hypot(*velocity[angular])

    @abstractmethod
    def end(self, frame: str) -> Literal[1, 2]:
        """Return which of c1 and c2 its "first" or "second" frame is, or raise InvalidArgument."""

    @abstractmethod
    def yields(
        self, body: Callable[[int], Array], columns: Callable[[Sequence[int]], float | Array]
    ) -> Any:
        """Return what MuJoCo takes for the diagonal of J M^-1 J^T, a number a row or one for all.

        `body` returns what the body of a joint gives way to a force and to a moment (2,), `columns`
        the sum of what some velocities give way.
        """


class OnFrames(AnyBound, ABC):
    """What has a frame c1 on joint 1, and a frame c2 on joint 2."""

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
        """Return whether joints 1 and 2 are among them."""
        return self.joint1 in joints and self.joint2 in joints

    @property
    def on_robot(self) -> int:
        """0, unless joint 1 is the world."""
        return 0 if self.joint1 else 1

    def moved(self, joints: Sequence[int]) -> Self:
        """Return it on other joints: the new number of each."""
        new = {"joint1": joints[self.joint1], "joint2": joints[self.joint2]}
        return replace(self, **new)  # type: ignore[type-var]

    def ends(self, oMi: Any) -> tuple[Any, Any]:
        """Return the frames c1 and c2 in the world."""
        return oMi[self.joint1] * self.placement1, oMi[self.joint2] * self.placement2

    def arm(self, oMi: Any) -> float:
        """Return how far what the rows are about is from c1: the origin of c2 [m]."""
        c1, c2 = self.ends(oMi)
        return length(c2.translation - c1.translation)

    def reach(self, oMi: Any) -> float:
        """Sum of the lengths that the places of c1 and c2 in the world are made of [m]."""
        ends = (self.joint1, self.placement1), (self.joint2, self.placement2)
        return sum(length(oMi[j].translation) + length(P.translation) for j, P in ends)

    def shares(self, oMi: Any) -> Array:
        """Sizes of shifts and of turns in its rows (size, 2), if it leans.

        The errors of their directions by rounding, over eps, are among them.
        """
        raise NotImplementedError

    def acts_at(self, c1: Any, c2: Any, *, on_first: bool) -> Array:
        """Return the origin of c2."""
        return np.array(c2.translation)

    def end(self, frame: str) -> Literal[1, 2]:
        """Return 1 for the frame that was named first, if joint 1 carries it."""
        end: Literal[1, 2] = 1 if (frame == "first") == (self.sign > 0) else 2
        if not self.anchored and (self.joint1, self.joint2)[end - 1] == 0:
            raise InvalidArgument(
                f"{self.name!r} belongs where it is: without an anchor it has no frame in the world"
            )
        return end

    def yields(
        self,
        body: Callable[[int], Array],
        columns: Callable[[Sequence[int]], float | Array],
    ) -> Any:
        """Return what both bodies give way to a force, and for turns to a moment."""
        linear, angular = body(self.joint1) + body(self.joint2)
        # MuJoCo's angular rows are half of ours
        return [4 * angular if turns else linear for turns in self.turns(None)]


def tilt(by: float, over: float) -> float:
    """Error over eps of the direction of a vector, off by eps `by`: at most 1 / eps."""
    return by / max(over, _EPS * by) if by else 0.0


def length(x: Array) -> float:
    """Return the length of a vector."""
    return math.sqrt(x.dot(x))
