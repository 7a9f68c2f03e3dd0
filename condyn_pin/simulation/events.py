"""Events: what happens to a simulation at a time, or when a condition is met."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from condyn_pin._core.arguments import check_called
from condyn_pin._core.arrays import finite
from condyn_pin.dynamics.impacts import Restitution, restitutions
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, UnknownName
from condyn_pin.simulation.snapshot import Snapshot


@dataclass(frozen=True, kw_only=True)
class Event:
    """A switch to other constraints, at a time or when a condition is met.

    Give `at` or `when`. The event is located in time, and the velocity changes there as by
    `switch`: a touch-down is an impact, a lift-off changes nothing.

    Parameters
    ----------
    name : str
        What the trajectory calls it.
    at : float, optional
        The time [s].
    when : callable, optional
        A function of a `Snapshot`, such as a height or a normal force; the event is where it falls
        from above zero to zero or below, by more than 1e-9, as often as it does. A function that
        begins at zero or below has to rise first. It is evaluated after every step, so one that
        falls and rises again within a step is missed; and not at all while its scene is on already
        and the event would change nothing.
    scene : Scene, optional
        The scene after the event, of the same robot. Contacts without an anchor are anchored where
        they are then; those of the scene before keep their anchor. Without a scene and without
        `met` the run ends here.
    met : Scene, optional
        The scene of the impact, which holds for that instant alone: with `restitution`, a rebound.
        By default `scene`. It needs the constraints that hold afterwards too: an impact without
        them would violate them.
    restitution : float or mapping of str to float
        As in `switch`.

    Raises
    ------
    InvalidArgument
        If both or neither of `at` and `when` are given, `when` cannot be called with a snapshot, or
        a restitution is not between 0 and 1.
    """

    name: str
    at: float | None = None  # [s]
    when: Callable[[Snapshot], float] | None = None
    scene: Scene | None = None
    met: Scene | None = None
    restitution: Restitution = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InvalidArgument(f"name = {self.name!r}: a text is needed")
        if (self.at is None) == (self.when is None):
            raise InvalidArgument(f"event {self.name!r}: give either at=... [s] or when=...")
        if self.at is not None:
            object.__setattr__(self, "at", float(finite("at", self.at, ())))
        else:
            check_called(f"event {self.name!r}: when", self.when, "snapshot")
        for argument in ("scene", "met"):
            if not isinstance(getattr(self, argument), Scene | None):
                raise InvalidArgument(
                    f"event {self.name!r}: {argument} = {getattr(self, argument)!r}: a Scene is "
                    "needed"
                )

        if hit := self.met or self.scene:
            restitutions(hit, self.restitution)

    @property
    def ends(self) -> bool:
        """Whether the run ends with it."""
        return self.scene is None and self.met is None

    def changes(self, scene: Scene) -> bool:
        """Whether it does anything while a scene goes on: brings another one, or an impact."""
        after = self.scene or scene
        if self.ends or after.constraints != scene.constraints or after.contacts != scene.contacts:
            return True
        return self.met is not None and not set(self.met.constraints) <= set(scene.constraints)

    def missed(self, value: float, scene: Scene) -> str:
        """Return why it did not happen, from its value and the scene at the end."""
        if not self.changes(scene):
            return "its scene is on already, and it brings no impact"
        if self.at is not None:
            if value > 0:
                return f"the run ends before t = {self.at:g} s"
            return f"its scene went on at t = {self.at:g} s, and another event took it off then"
        if value > 0:
            return f"its condition is {value:.3g} at the end, and has not fallen to zero"
        return f"its condition is {value:.3g} at the end, and has not been above zero"

    def value(self, snapshot: Snapshot) -> float:
        """Return what falls to zero at the event, at a `snapshot`."""
        if self.at is not None:
            return self.at - snapshot.t
        assert self.when is not None
        try:
            found = self.when(snapshot)
        except UnknownName:
            raise
        except KeyError as error:
            there = ", ".join(snapshot.forces) or "no constraint"
            raise InvalidArgument(
                f"event {self.name!r}: its condition asks for {error} at t = {snapshot.t:g} s, "
                f"where the scene has {there}; `name in snapshot.forces` says whether one is there"
            ) from error
        try:
            value = float(found)
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidArgument(
                f"event {self.name!r}: its condition returns {found!r}: a number is needed"
            ) from error
        if value != value:
            raise InvalidArgument(
                f"event {self.name!r}: its condition is NaN at t = {snapshot.t:g} s"
            )
        return value


@dataclass(frozen=True)
class Happened:
    """An event that happened.

    Attributes
    ----------
    name : str
    t : float
        Time [s].
    sample : int
        The first sample after it; the one before is of the same time.
    energy_lost : float
        By the impact [J].
    added, dropped : tuple of str
        Names of constraints.
    modes : tuple of (str, str, str)
        Contacts whose mode has changed, of an integrator that locates that: name, and open, stick
        or slide before and after; slide twice where the slip reverses.
    impulses : tuple of (str, float, ...)
        Contacts that have struck: name, and impulse on the robot in the axes (t1, t2, n) of the
        contact, one number of a stop [N s, N m s].
    driven : float
        Work of driven constraints in it [J].
    """

    name: str
    t: float  # [s]
    sample: int
    energy_lost: float = 0.0  # [J]
    added: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()
    modes: tuple[tuple[str, str, str], ...] = ()
    impulses: tuple[tuple[Any, ...], ...] = ()
    driven: float = 0.0  # [J]

    def __post_init__(self) -> None:
        for name in ("modes", "impulses"):  # a file has lists
            object.__setattr__(self, name, tuple(tuple(each) for each in getattr(self, name)))

    @property
    def is_of_contacts(self) -> bool:
        """Whether contacts made it, and no `Event`."""
        return bool(self.modes or self.impulses)


class Ended(Exception):
    """An event has ended the run."""


class ZenoDetected(Exception):
    """Events follow one another without end, as the rebounds of a ball do."""
