"""Scene: a robot and exactly the constraints that the question needs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from numpy.typing import ArrayLike

from condyn_pin._core.arrays import read_only
from condyn_pin._core.errors import InvalidArgument
from condyn_pin.constraints.constraints import Constraint
from condyn_pin.constraints.rows.binding import bind
from condyn_pin.constraints.rows.bound import AnyBound
from condyn_pin.constraints.rows.natives import Natives, natives
from condyn_pin.dynamics.nominal import NominalAnalysis
from condyn_pin.mechanism.chains import Chains, chains
from condyn_pin.mechanism.methods import States
from condyn_pin.mechanism.rank import Rank, rank
from condyn_pin.mechanism.reduction.methods import Smaller
from condyn_pin.mechanism.summary import Summary, summarise
from condyn_pin.model.robot import Robot


@dataclass(frozen=True)
class Scene(States, Smaller):
    """A robot with constraints; a frozen value that pickles and compares.

    Parameters
    ----------
    robot : Robot
    constraints : sequence of Constraint
        Contacts and loops. Only these exist: the loops of the robot's description are in a scene
        if you put them there, ``Scene(robot, robot.loops)``.

    Raises
    ------
    UnknownName
        If a frame does not exist.
    InvalidConstraint
        If two constraints share a name, or one constrains nothing.
    StaleModel
        If the robot's model was edited since it was loaded.
    """

    robot: Robot
    constraints: Sequence[Constraint] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Robot):
            raise InvalidArgument(
                f"robot = {type(self.robot).__name__}: a Robot is needed; "
                "load_robot(name) loads one, Robot(name, model) wraps a pinocchio.Model"
            )
        if isinstance(self.constraints, Constraint):
            raise InvalidArgument("constraints: a list is needed, also for a single constraint")
        if isinstance(self.constraints, str) or not isinstance(self.constraints, Iterable):
            raise InvalidArgument(f"constraints = {self.constraints!r}: a list is needed")
        self.robot.check_unedited()
        object.__setattr__(self, "constraints", tuple(self.constraints))
        object.__setattr__(self, "_bounds", bind(self.robot, self.constraints))

    @property
    def bounds(self) -> tuple[AnyBound, ...]:
        """The constraints bound to joints, placements and columns."""
        return self._bounds  # type: ignore[attr-defined, no-any-return]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the constraints, in order."""
        return tuple(bound.name for bound in self.bounds)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the rows: ``constraint.axis``."""
        return tuple(name for bound in self.bounds for name in bound.row_names)

    @property
    def rows(self) -> int:
        """Number of rows, m."""
        return sum(bound.size for bound in self.bounds)

    @cached_property
    def chains(self) -> Chains:
        """Which joints the loops determine, and where their dead points are; found on first use."""
        return read_only(chains(self))

    @cached_property
    def natives(self) -> Natives:
        """The constraints as Pinocchio's own methods take them."""
        return natives(self.robot.model, self.bounds, lambda: self.audit.whitened_rows())

    @cached_property
    def audit(self) -> NominalAnalysis:
        """What the scene is at its nominal state; each figure is measured on first use."""
        return NominalAnalysis(self)

    def summary(self, q: ArrayLike | None = None) -> Summary:
        """Return rows, rank, redundant rows by name, mobility, and what is not used.

        Everything is measured at q, or at the first posture with the loops closed.
        """
        return summarise(self, q)

    def rank(self, q: ArrayLike | None = None) -> Rank:
        """Return rank, redundant rows, mobility and conditions at q; the nominal state by default.

        q is taken as it is: `Rank.gap` says how far it is from being closed.
        """
        return rank(self, q)

    def __reduce__(self) -> tuple[Any, ...]:
        return Scene, (self.robot, self.constraints)


def check_scene(scene: object, argument: str = "scene") -> None:
    """Refuse what is no scene."""
    if not isinstance(scene, Scene):
        raise InvalidArgument(f"{argument} = {type(scene).__name__}: a Scene is needed")
