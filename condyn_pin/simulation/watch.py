"""Watch: what events say from step to step, and which of them happen."""

from __future__ import annotations

from collections.abc import Sequence

from condyn_pin.dynamics.scene import Scene
from condyn_pin.simulation.events import Event, ZenoDetected
from condyn_pin.simulation.snapshot import Snapshot

# From less than this above zero to less than this below it is noise: so a foot rests on the ground
# [m, rad, N, ...].
_NOISE = 1e-9


class Watch:
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
        """Remember the values after a step to t, in which no event is left.

        ZenoDetected if what has rebounded has not come off in a whole step.
        """
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
        """Remember the values after an event, which left one scene for another.

        Those that fell to zero with it are still to happen, and those that brought the scene may
        happen again: what lets go of the ground is above it, whatever rounding says.
        """
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
