"""Events, and what changes at them: scenes, contacts, switches.

Events: what happens to a simulation at a time, or when a condition is met.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core.arguments import check_called, listed
from condyn_pin._core.arrays import Array, finite, read_only_view
from condyn_pin._core.models import algorithms
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.constraints.places import FrameLike
from condyn_pin.contact.problem import MODES, OPEN, SLIDE, STICK, Modes
from condyn_pin.dynamics.at_state import at_state
from condyn_pin.dynamics.impacts import Impact, Restitution, impact, restitutions
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solution import ConstraintForce, Sites
from condyn_pin.errors import InvalidArgument, UnknownName
from condyn_pin.simulation.records import ContactWork, Row, codes_in, contact_rows, with_work
from condyn_pin.simulation.system import NO_TOUCH, System


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
        """True if the run ends with the event."""
        return self.scene is None and self.met is None

    def changes(self, scene: Scene) -> bool:
        """True if the event ends the run of a scene, replaces the scene, or brings an impact."""
        after = self.scene or scene
        if self.ends or after.constraints != scene.constraints or after.contacts != scene.contacts:
            return True
        return self.met is not None and not set(self.met.constraints) <= set(scene.constraints)

    def missed(self, value: float, scene: Scene) -> str:
        """Reason why the event did not happen, from its value and the scene at the end."""
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
        """Value of the condition at a `snapshot`; it falls to zero at the event."""
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
class EventRecord:
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
        """True if contacts caused the event, and not an `Event`."""
        return bool(self.modes or self.impulses)


class RunEnd(Exception):
    """An event has ended the run."""


class ZenoDetected(Exception):
    """Events follow one another without end, as the rebounds of a ball do."""


# ContactEvent: an instant in which contacts strike, open, close, stick or slip.


# An impulse that is rounding, relative to the largest.
_NONE = 1e-12


@dataclass(frozen=True, eq=False)
class ContactEvent:
    """Impact, or change of contact modes, with the samples before and after it."""

    what: str  # ``impact``, ``shock``, or nothing where only modes have changed
    candidates: Candidates
    modes: tuple[Modes, Modes]  # before and after
    # (candidates,) which of them slide before and after, in opposite directions
    back: NDArray[np.bool_]
    impulse: Array  # (rows,) [N s, N m s]
    energy_lost: float  # [J]
    # before, after: samples, without the work of contacts before their step: `behind` adds it
    before: Row
    after: Row
    driven: float = 0.0  # work of driven constraints in it [J]

    @property
    def t(self) -> float:
        """Time of the event [s]."""
        return self.after[0]

    def behind(self, work: ContactWork) -> ContactEvent:
        """The event with the work of contacts since the start, its own included."""
        k, before = len(self.candidates.names), work.more(contact=self.energy_lost)
        return replace(
            self,
            before=(*self.before[:-1], with_work(self.before[-1], k, before)),
            after=(*self.after[:-1], with_work(self.after[-1], k, work)),
        )

    def at(self, t: float) -> ContactEvent:
        """The event at a time that differs by rounding."""
        return replace(self, before=(t, *self.before[1:]), after=(t, *self.after[1:]))

    def happened(self, sample: int) -> EventRecord:
        """Record of the event for a trajectory, with the index of the sample after it."""
        rows, names = contact_rows(self.candidates), self.candidates.names
        impulses = {name: self.impulse[rows[name]] for name in names}
        least = _NONE * float(np.abs(self.impulse).max(initial=0.0))
        struck = tuple((n, *x.tolist()) for n, x in impulses.items() if np.abs(x).max() > least)
        before, after = self.modes
        changed = tuple(
            (names[i], MODES[before[i]], MODES[after[i]])
            for i in np.flatnonzero((before != after) | self.back)
        )
        return EventRecord(
            self._called([name for name, *_ in struck]), self.t, sample, self.energy_lost,
            modes=changed, impulses=struck, driven=self.driven,
        )  # fmt: skip

    def _called(self, struck: list[str]) -> str:
        if self.what:
            return f"{self.what} of {listed(struck)}"
        before, after = self.modes
        kinds = {
            "lift-off": (before != OPEN) & (after == OPEN),
            "touch": (before == OPEN) & (after != OPEN),
            "slip": (before == STICK) & (after == SLIDE),
            "stick": (before == SLIDE) & (after == STICK),
            "reversal": self.back,
        }
        what, which = next((what, its) for what, its in kinds.items() if its.any())
        return f"{what} of {listed([self.candidates.names[i] for i in np.flatnonzero(which)])}"


# Events of a run: each fits the scene that is simulated, and equal scenes are one.


def checked_events(scene: Scene, events: Sequence[Event]) -> tuple[Event, ...]:
    """Return the events of a run, or raise InvalidArgument."""
    # They have to fit the scene, and to have names of their own.
    if isinstance(events, Event) or not isinstance(events, Iterable):
        raise InvalidArgument("events: a list is needed, also for a single event")
    checked = tuple(events)
    scalar = {bound.name: bound.is_scalar for bound in scene.bounds}
    for event in checked:
        if not isinstance(event, Event):
            raise InvalidArgument(f"events: {event!r} is not an Event")
        if sum(other.name == event.name for other in checked) > 1:
            raise InvalidArgument(f"two events are named {event.name!r}")
        for other in (event.scene, event.met):
            if other is not None:
                _check_scene(event.name, other, scene, scalar)
        if event.at is not None and event.at <= 0:
            raise InvalidArgument(f"event {event.name!r}: at = {event.at:g}: after the start")
    return _with_shared_scenes(scene, checked)


def _check_scene(event: str, its: Scene, simulated: Scene, scalar: dict[str, bool]) -> None:
    """Refuse the scene of an event that does not go with the one simulated."""
    # `scalar` says of the constraints so far whether their force is recorded by rows; it gets those
    # of this scene.
    if its.robot.model != simulated.robot.model:
        raise InvalidArgument(
            f"event {event!r}: its scene is of another model than the one simulated"
        )
    one, other = its.robot, simulated.robot
    if (one.springs, one.spring_dampers) != (other.springs, other.spring_dampers):
        raise InvalidArgument(
            f"event {event!r}: its scene has other springs than the one simulated; "
            "what changes on the way is a torque: tau(t, q, v)"
        )
    for bound in its.bounds:
        if scalar.setdefault(bound.name, bound.is_scalar) != bound.is_scalar:
            raise InvalidArgument(
                f"event {event!r}: {bound.name!r} has a force by its rows in one scene, and by "
                "axes of a frame in another; give one of the two another name"
            )


def _with_shared_scenes(scene: Scene, events: tuple[Event, ...]) -> tuple[Event, ...]:
    """Return the events with one scene where several have the same constraints: it is one place."""
    known = {(scene.constraints, scene.contacts): scene}

    def shared(other: Scene) -> Scene:
        return known.setdefault((other.constraints, other.contacts), other)

    return tuple(
        replace(event, scene=shared(event.scene)) if event.scene else event for event in events
    )


# Snapshot: the state of a motion at one instant, as an event's condition sees it.


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of a motion at one instant, passed to the condition of an event.

    Attributes
    ----------
    t : float
        Time [s].
    q, v : (nq,), (nv,) array
        Configuration [rad, m] and velocity [rad/s, m/s], read-only: they are the state itself.
    """

    t: float
    q: Array
    v: Array
    _system: System
    _sample: Callable[[float, Array, Array], Row]

    def __post_init__(self) -> None:
        object.__setattr__(self, "_state", (self.q, self.v))  # that the system knows again
        object.__setattr__(self, "q", read_only_view(self.q))
        object.__setattr__(self, "v", read_only_view(self.v))

    @cached_property
    def a(self) -> Array:
        """Accelerations (nv,) [rad/s^2, m/s^2]; they cost a solve."""
        return self._solved[0]

    @property
    def forces(self) -> dict[str, ConstraintForce | Array]:
        """Force on the first-named body by constraint, and on the robot by contact.

        Those of contacts are (t1, t2, n) [N]. They cost a solve, or a step where contacts may open.
        """
        system = self._system
        rows, lam = system.scene.rows, self._solved[1]
        held = Sites(system.scene, self.q, system.equations).forces(lam[:rows])
        contacts = contact_rows(system.contacts).items()
        return {**held, **{name: lam[rows:][its] for name, its in contacts}}

    @property
    def gaps(self) -> dict[str, float]:
        """Distance of each contact and stop [m, rad]."""
        data = self._system.equations.data
        algorithms(data).forwardKinematics(self._system.model, data, self.q)
        gaps = self._system.contacts.exact.gaps(data, self.q)
        return dict(zip(self._system.contacts.names, gaps.tolist(), strict=False))

    @property
    def modes(self) -> dict[str, str]:
        """Mode of each contact in the step that begins here: open, stick or slide."""
        codes = self._solved[2]
        return {n: MODES[int(c)] for n, c in zip(self._system.contacts.names, codes, strict=True)}

    def position(self, frame: FrameLike) -> Array:
        """Position of the origin of a frame in world axes (3,) [m]."""
        joint, placement = self._system.scene.robot.frame(frame)
        model, data = self._system.model, self._system.equations.data
        algorithms(data).forwardKinematics(model, data, self.q)
        return np.array((data.oMi[joint] * placement).translation)

    def velocity(self, frame: FrameLike) -> Array:
        """Velocity of the origin of a frame in world axes (3,) [m/s]."""
        joint, placement = self._system.scene.robot.frame(frame)
        model, data = self._system.model, self._system.equations.data
        algorithms(data).forwardKinematics(model, data, self.q, self.v)
        return np.array(
            (data.oMi[joint] * placement).rotation @ placement.actInv(data.v[joint]).linear
        )

    @cached_property
    def _solved(self) -> tuple[Array, Array, Array]:
        system, state = self._system, self._state  # type: ignore[attr-defined]
        if system.contacts.names:
            _, _, _, a, lam, _, touch = self._sample(self.t, *state)
            return a, lam, codes_in(touch, len(system.contacts.names))
        return system.acceleration(self.t, *state), system.lam(), NO_TOUCH


# Switch: from one set of constraints to another, touch-down and lift-off.


@dataclass(frozen=True, eq=False, repr=False)
class Switch:
    """The effect of a change of constraints: the new velocity, and the impact.

    Attributes
    ----------
    v : (nv,) array
        Velocity after it, with which the second scene goes on.
    added, dropped, kept : tuple of str
        Names of constraints. One that is changed under its name is dropped and added.
    impact : Impact or None
        What added constraints did; None if none was added, for then the velocity stays.
    before, after : Scene
    """

    v: Array
    added: tuple[str, ...]
    dropped: tuple[str, ...]
    kept: tuple[str, ...]
    impact: Impact | None
    before: Scene
    after: Scene

    @property
    def notices(self) -> tuple[str, ...]:
        """Warnings about the impact, one sentence each."""
        return self.impact.notices if self.impact else ()

    def __repr__(self) -> str:
        lost = f", {self.impact.energy_lost:.4g} J lost" if self.impact else ""
        return (
            f"Switch({self.after.robot.name}: added {listed(self.added) or 'nothing'}, "
            f"dropped {listed(self.dropped) or 'nothing'}{lost})"
        )


def switch(
    scene_before: Scene,
    scene_after: Scene,
    q: ArrayLike,
    v: ArrayLike,
    *,
    restitution: Restitution = 0.0,
) -> Switch:
    """Return the velocity of a robot just after its constraints change.

    M (v+ - v) = J^T lam,    J v+ = -e J v    of what is added,    J v+ = 0    of what is kept

    A touch-down is an impact of all constraints of the second scene, so closed constraints stay
    closed. A lift-off does not change the velocity.

    Parameters
    ----------
    scene_before, scene_after : Scene
        Two scenes of one robot.
    q, v : (nq,), (nv,) array_like
        The state at which they change.
    restitution : float or mapping of str to float
        As in `impact`, of the constraints that are added: those that are kept do not rebound.

    Returns
    -------
    Switch

    Raises
    ------
    InvalidArgument
        If the scenes are of different models, or as in `impact`.

    Notes
    -----
    Cost and source are those of `impact`.
    """
    for argument, scene in (("scene_before", scene_before), ("scene_after", scene_after)):
        check_scene(scene, argument)
    if scene_before.robot.model != scene_after.robot.model:
        raise InvalidArgument(
            f"scene_after: its robot {scene_after.robot.name!r} has another model than that of "
            "scene_before; a ReducedScene has reduce_state and expand_state"
        )
    old, new = set(scene_before.constraints), set(scene_after.constraints)
    added = tuple(c.name for c in scene_after.constraints if c not in old)
    met = None
    if added:
        if not isinstance(restitution, Mapping):
            restitution = dict.fromkeys(added, restitution)
        met = impact(scene_after, q, v, restitution=restitution)
    return Switch(
        v=met.v if met else at_state(scene_after, q, v).v,
        added=added,
        dropped=tuple(c.name for c in scene_before.constraints if c not in new),
        kept=tuple(c.name for c in scene_after.constraints if c in old),
        impact=met,
        before=scene_before,
        after=scene_after,
    )


# Watch: what events say from step to step, and which of them happen.


# From less than this above zero to less than this below it is noise: so a foot rests on the ground
# [m, rad, N, ...].
_NOISE = 1e-9


class EventWatch:
    """The values of events on the way of a run: an event is where its value falls to zero.

    `values` are those that the next step is compared with, by name.
    """

    def __init__(self, events: Sequence[Event]) -> None:
        self.events = tuple(events)
        self.values: dict[str, float] = {}
        self._rebounding: set[str] = set()  # events that have not been above zero since

    def look(self, snapshot: Snapshot, scene: Scene) -> dict[str, float]:
        """Return the value of every event at a snapshot, while a scene goes on."""
        return {
            # an event that would change nothing has nothing to say
            event.name: event.value(snapshot) if event.changes(scene) else 0.0
            for event in self.events
        }

    def fallen(self, values: dict[str, float]) -> list[Event]:
        """Return the events whose values have fallen to zero, by more than noise."""
        return [event for event in self.events if self._falls(event, values[event.name])]

    def after_step(self, t: float, values: dict[str, float]) -> None:
        """Remember the values after a step to t, in which no event is left."""
        # ZenoDetected if what has rebounded has not come off in a whole step.
        self._rebounding -= {name for name in self._rebounding if values[name] > 0}
        if self._rebounding:
            raise ZenoDetected(
                f"event {min(self._rebounding)!r} goes on at t = {t:g} s: its rebounds have "
                "become shorter than a step; use a restitution of 0 and a scene that keeps it"
            )
        for name, before in self.values.items():
            if not before > 0 >= values[name]:  # noise takes none below zero
                self.values[name] = values[name]

    def after_event(
        self, event: Event, left: Scene, values: dict[str, float], scene: Scene
    ) -> None:
        """Remember the values after an event, which left one scene for another."""
        # Those that fell to zero with it are still to happen, and those that brought the scene may
        # happen again: a body that leaves the ground is above it, whatever rounding says.
        stays = event.scene is None or event.scene is left
        if stays and event.at is None:  # a time does not come again
            self._rebounding.add(event.name)
        for other in self.events:
            name, before = other.name, self.values[other.name]
            waits = other is not event and other.changes(scene)
            if waits and before > 0 >= values[name]:
                values[name] = before
            elif stays:
                continue
            elif other.at is None and other.scene is left and abs(values[name]) <= _NOISE:
                values[name] = _NOISE
        self.values = values

    def _falls(self, event: Event, after: float) -> bool:
        before, noise = self.values[event.name], _NOISE if event.at is None else 0.0
        return before > 0 >= after and (before > noise or after < -noise)
