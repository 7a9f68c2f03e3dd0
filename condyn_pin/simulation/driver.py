"""Driver: a run on its way, leg after leg, with the events between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraints import Constraint
from condyn_pin.dynamics.scene import Scene
from condyn_pin.simulation.anchoring import anchored
from condyn_pin.simulation.events import Ended, Event, Happened, Moment, PiledUp
from condyn_pin.simulation.fit import check_fit, check_slip
from condyn_pin.simulation.leg import Leg, Method
from condyn_pin.simulation.switching import Switch, switch
from condyn_pin.simulation.watch import Watch

# Where an event is found, as a share of dt.
_FOUND = 1e-12

# What is left of a step after an event, and is not worth one, as a share of dt.
_NOTHING = 1e-9

# Events in one step, at most: more have piled up.
_MOST = 100


class Driver:
    """A run on its way.

    Parameters
    ----------
    scene : Scene
    q, v : (nq,), (nv,) array
        Owned.
    method : Method
    events : sequence of Event
    leg : Leg, optional
        Of another run of this scene by this method, whose memory is used again.

    Attributes
    ----------
    t, q, v
        Where it is.
    leg : Leg
        Its present leg.
    recorders : list of Recorder
        The samples, one a phase.
    happened : list of Happened
    """

    def __init__(
        self,
        scene: Scene,
        q: Array,
        v: Array,
        method: Method,
        events: Sequence[Event],
        leg: Leg | None,
    ) -> None:
        self.t, self.q, self.v = 0.0, q, v
        self._method = method
        self._places: dict[Constraint, Constraint] = {}
        self._asked = scene  # as the user wrote it: its contacts may lack a place
        placed = self._placed(scene)
        self.leg = leg or Leg(placed, method)
        self.leg.use(placed)
        self.recorders = [self.leg.begin(self.t, q, v)]
        self.happened: list[Happened] = []
        self._watch = Watch(events)
        if events:
            self._watch.values = self._look(self.t, q, v)

    def run(self, steps: int, every: int, tick: Callable[[int], None] | None = None) -> None:
        """Take the steps; `tick` is told how many are taken.

        Raises
        ------
        Ended, PiledUp
            If an event ends the run, or happens again at once.
        """
        (self._run_watched if self._watch.events else self._run_free)(steps, every, tick)
        self.leg.end(self.t, self.q, self.v)

    def _run_free(self, steps: int, every: int, tick: Callable[[int], None] | None) -> None:
        """Take the steps where no event can happen: nothing is looked at in between."""
        leg, dt = self.leg, self._method.dt
        step, move, turn = leg.step, leg.move, leg.turn(every)
        t, q, v = self.t, self.q, self.v
        try:
            for k in range(steps):
                if k % every == turn:
                    q, v = step(t, q, v, k, every)
                else:
                    q, v, _ = move(t, q, v)
                t = (k + 1) * dt
                if tick:
                    tick(k + 1)
        finally:
            self.t, self.q, self.v = t, q, v

    def _run_watched(self, steps: int, every: int, tick: Callable[[int], None] | None) -> None:
        """Take the steps, and look after each which event has happened in it."""
        for k in range(steps):
            q, v = self.leg.step(self.t, self.q, self.v, k, every)
            t1 = (k + 1) * self._method.dt
            q, v = self._through_events(t1, q, v, (k + 1) % every == 0)
            self.t, self.q, self.v = t1, q, v
            if tick:
                tick(k + 1)

    def missed(self) -> tuple[str, ...]:
        """Return what there is to say of the events that did not happen."""
        names, values = {event.name for event in self.happened}, self._watch.values
        return tuple(
            f"{event.name} did not happen: {event.missed(values[event.name], self._asked)}"
            for event in self._watch.events
            if event.name not in names
        )

    def _through_events(self, t1: float, q1: Array, v1: Array, keep: bool) -> tuple[Array, Array]:
        """Return the state at t1, a sample if it is to be kept, from that without events."""
        for _ in range(_MOST):
            values = self._look(t1, q1, v1)
            event, share = self._first(t1, values)
            if event is None:
                break
            self.leg.take_back(self.t)
            self._go(event, self.t + share * (t1 - self.t))
            self._happen(event)
            if self._is_there(t1):
                q1, v1 = self.q, self.v
            else:
                q1, v1 = self.leg.part(self.t, self.q, self.v, t1, keep=keep)
        else:
            names = " and ".join(sorted({each.name for each in self.happened[-_MOST:]}))
            raise PiledUp(
                f"more than {_MOST} events ({names}) from t = {self.t:g} s to {t1:g} s: one "
                "undoes the other; a point that is held sideways while its normal force ends has "
                "to slide, as a PlanarContact does"
            )
        if not self._is_there(t1):  # else the last event was at t1, and its values are known
            self._watch.after_step(t1, values)
        return q1, v1

    def _look(self, t: float, q: Array, v: Array) -> dict[str, float]:
        """Return the value of every event at a state."""
        return self._watch.look(Moment(t, q, v, self.leg.system), self._asked)

    def _first(self, t1: float, values: dict[str, float]) -> tuple[Event | None, float]:
        """Return the first event on the way to t1, and at which share of it."""
        first: tuple[Event | None, float] = (None, inf)
        for event in self._watch.fallen(values):
            share = self._share(event, t1, self._watch.values[event.name], values[event.name])
            if share < first[1]:
                first = event, share
        return first

    def _is_there(self, t1: float) -> bool:
        """Whether what is left to t1 is not worth a step."""
        return t1 - self.t <= _NOTHING * self._method.dt

    def _share(self, event: Event, t1: float, before: float, after: float) -> float:
        """Return at which share of the way to t1 the value of an event is zero."""
        from scipy.optimize import brentq

        if self._is_there(t1):
            return 0.0
        if event.at is not None:
            return (event.at - self.t) / (t1 - self.t)
        way = t1 - self.t

        def value(share: float) -> float:
            if share in (0.0, 1.0):
                return after if share else before
            t = self.t + share * way
            q, v = self.leg.part(self.t, self.q, self.v, t)
            return event.value(Moment(t, q, v, self.leg.system))

        return float(brentq(value, 0.0, 1.0, xtol=_FOUND, rtol=_FOUND))

    def _go(self, event: Event, t: float) -> None:
        """Go on by less than a step, to an event at t."""
        t = t if event.at is None else event.at
        if t - self.t > _NOTHING * self._method.dt:
            self.q, self.v = self.leg.part(self.t, self.q, self.v, t)
        self.t = max(t, self.t)  # also if that is not worth a step: a time does not come again

    def _happen(self, event: Event) -> None:
        """Let an event happen here; Ended if it ends the run."""
        self.leg.end(self.t, self.q, self.v)
        sample = sum(recorder.count for recorder in self.recorders)
        if event.ends:
            self.happened.append(Happened(event.name, self.t, sample - 1))
            raise Ended(f"event {event.name!r} at t = {self.t:g} s")
        before, left = self.leg.scene, self._asked
        # a contact that was lifted has its place wherever it touches again
        self._places = {c: self._places[c] for c in self._asked.constraints if c in self._places}
        met = event.met or event.scene
        assert met is not None
        change = switch(before, self._placed(met), self.q, self.v, restitution=event.restitution)
        jump, self.v = change.v - self.v, change.v
        if event.scene is None or event.scene is left:
            what = f"event {event.name!r}: its impact tears apart what goes on: let met hold that: "
            check_slip(before, self.q, jump, what=what)
        else:
            after = self._placed(event.scene)
            what = f"event {event.name!r}: its scene does not fit the state: "
            check_fit(after, self.q, self.v, what=what)
            self._asked = event.scene
            self.leg = Leg(after, self._method)
        self.recorders.append(self.leg.begin(self.t, self.q, self.v))
        self.happened.append(_happened(event, self.t, sample, before, self.leg.scene, change))
        self._watch.after_event(event, left, self._look(self.t, self.q, self.v), self._asked)

    def _placed(self, scene: Scene) -> Scene:
        """Return a scene as it takes part: its contacts with their places, effects off or on."""
        return anchored(self._method.effects.applied_to(scene), self.q, self._places)


def _happened(
    event: Event, t: float, sample: int, before: Scene, after: Scene, change: Switch
) -> Happened:
    old, new = set(before.names), set(after.names)
    return Happened(
        event.name,
        t,
        sample,
        change.impact.energy_lost if change.impact else 0.0,
        tuple(name for name in after.names if name not in old),
        tuple(name for name in before.names if name not in new),
    )
