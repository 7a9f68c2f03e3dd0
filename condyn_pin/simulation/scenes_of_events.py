"""Events of a run: each fits the scene that is simulated, and equal scenes are one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.events import Event


def checked_events(scene: Scene, events: Sequence[Event]) -> tuple[Event, ...]:
    """Return the events of a run, or raise InvalidArgument.

    They have to fit the scene, and to have names of their own.
    """
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
    return _shared(scene, checked)


def _check_scene(event: str, its: Scene, simulated: Scene, scalar: dict[str, bool]) -> None:
    """Refuse the scene of an event that does not go with the one simulated.

    `scalar` says of the constraints so far whether their force is one number; it gets those of this
    scene.
    """
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
                f"event {event!r}: {bound.name!r} has a force of one number in one "
                "scene and a vector in another; give one of the two another name"
            )


def _shared(scene: Scene, events: tuple[Event, ...]) -> tuple[Event, ...]:
    """Return the events with one scene where several have the same constraints: it is one place."""
    known = {(scene.constraints, scene.contacts): scene}

    def shared(other: Scene) -> Scene:
        return known.setdefault((other.constraints, other.contacts), other)

    return tuple(
        replace(event, scene=shared(event.scene)) if event.scene else event for event in events
    )
