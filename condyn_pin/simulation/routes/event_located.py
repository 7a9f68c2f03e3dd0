"""EventLocated: impacts at their own times within a step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import compress
from math import inf
from typing import ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.contact_steps import ContactSteps
from condyn_pin.simulation.integrators.moreau import Moreau
from condyn_pin.simulation.integrators.posed import Posed
from condyn_pin.simulation.integrators.tried import Taken
from condyn_pin.simulation.routes.active_set import ActiveSet
from condyn_pin.simulation.routes.base import Route
from condyn_pin.simulation.routes.linear_steps import Ended, LinearSteps
from condyn_pin.simulation.routes.step_derivatives import StepDerivatives, made, modes_of

# An impact is a step so short that no force has time to do anything [s].
_INSTANT: Final = 1e-12

# A gap that is closed [m, rad], and a velocity along the normal that is none [m/s, rad/s].
_TOUCHES: Final = 1e-9
_RESTS: Final = 1e-7

# Cuts of one step, at most: what bounces more often rests.
_CUTS: Final = 8

# Halvings of the step in which an impact is looked for: to rounding.
_HALVINGS: Final = 100

# Halvings of the step in which a gap is looked for that opens: a millionth of a millionth of it.
_OPENINGS: Final = 40

# How flows are differenced by their length, as a share of the step.
_SHARE: Final = 1e-4


@dataclass(frozen=True)
class EventLocated(Route):
    """The derivatives of a step with impacts located in time: saltation matrices.

    x+ = flow(dt - s) o impact o flow(s),    gap(s) = 0,    ds = -(J_n dq) / (J_n v)

    What begins later by ds is over sooner by ds, and paths and torques of time are elsewhere.

    The step is cut where a gap closes. On both sides contacts keep what they are, open or at rest,
    by steps of `Moreau`; at the cut they rebound by Newton's law, with friction. The time of the
    cut depends on the start, which a step of fixed length ignores: otherwise the height of a ball
    after one bounce has a wrong derivative with respect to its initial height, at every dt.

    Notes
    -----
    The end differs from that of the scheme, which rebounds before or after the true impact. A
    contact that bounces more than eight times within a step rests from then on. One that is on its
    way out of the ground and does not get there within the step closes nothing: it goes on.

    References
    ----------
    Leine, Nijmeijer. Dynamics and Bifurcations of Non-Smooth Mechanical Systems. Springer, 2004.
    Kong, Payne, Zhu, Johnson. Saltation matrices: the essential tool for linearizing hybrid
    dynamical systems. Proceedings of the IEEE 112, 2024.
    """

    title: ClassVar[str] = "event located"
    cost: ClassVar[str] = "as ActiveSet; a step with an impact as much as ten"
    use: ClassVar[str] = "where the time of an impact matters: throws, bounces, touch-down"

    def scheme(self, scheme: ContactScheme) -> ContactScheme:
        """Return the scheme of the parts of a step: Moreau's, with the same contact solver."""
        if scheme.law != "ncp":
            raise InvalidArgument(
                f"route = EventLocated(): impacts obey Coulomb's law, and {scheme.title} poses its "
                "convex relaxation; take StewartTrinkle() or Moreau()"
            )
        return Moreau(contact=scheme.contact)

    def at(
        self, steps: LinearSteps, t: float, q: Array, v: Array, taken: Taken | None = None
    ) -> StepDerivatives:
        """Return the end of a step of `steps` from a state, and how it changes."""
        parts = _Parts(steps)
        with np.errstate(all="ignore"):  # what is not finite is refused
            return parts.differentiated(self, t, q, v)

    def step(self, steps: LinearSteps, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the end of the same step of `steps`, without derivatives."""
        with np.errstate(all="ignore"):
            return _Parts(steps).taken(t, q, v)


class _Held(ContactSteps):
    """Steps in which some contacts take part, wherever they are."""

    held: NDArray[np.bool_]

    def pose(self, t: float, q: Array, v: Array, active: NDArray[np.bool_] | None = None) -> Posed:
        """Return the step from a state with the contacts that are held."""
        return super().pose(t, q, v, self.held)


class _Cut(NamedTuple):
    """A part of a step: a flow or an impact."""

    start: float  # [s], since the start of the step
    length: float  # [s]
    held: NDArray[np.bool_]
    closing: int  # the gap that ends it, -1 if the end of the step does


class _Parts:
    """The parts that impacts cut a step into."""

    def __init__(self, steps: LinearSteps) -> None:
        self._steps, self._dt, self._system = steps, steps.dt, steps.system
        self._law = partial(ActiveSet().law, size=steps.size)
        self._cuts = 0

    def taken(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the end of a step."""
        done = 0.0
        self._cuts = 0
        while done < self._dt:
            q, v = self._struck(t + done, q, v)
            cut = self._next(t, done, q, v)
            q, v = self._flow(cut, t, q, v)
            done = cut.start + cut.length if cut.closing >= 0 else self._dt
        return q, v

    def differentiated(self, route: Route, t: float, q: Array, v: Array) -> StepDerivatives:
        """Return the end of a step, and how it changes with its start."""
        columns, n = self._steps.columns, len(v)
        dq, dv, done, ds = columns.empty(), columns.empty(), 0.0, np.zeros(columns.size)
        dq[:, columns.q], dv[:, columns.v] = np.eye(n), np.eye(n)
        modes: dict[str, str] = {}
        self._cuts, margin, cut = 0, inf, None
        while done < self._dt:
            held, impact = self._impact(q, v), None
            if held is not None:
                blow = self._made(_INSTANT, held)
                late = self._late(blow, t + done, q, v, ds)
                impact = blow.end(t + done, q, v, self._law)
                q, v = impact.q, impact.v
                modes, margin = _joined(modes, modes_of(self._steps, impact)), impact.law.margin
            is_located = cut is not None
            cut = self._next(t, done, q, v)
            flow = self._made(cut.length, cut.held)
            ended = flow.end(t + done, q, v, self._law)
            rate_q, rate_v = self._rates(cut, t, q, v)
            modes = _joined(modes, modes_of(self._steps, ended))
            margin = min(margin, ended.law.margin)
            if impact is not None:
                if is_located and self._stays(impact, ended):
                    for by in (impact.dq, impact.dv):
                        by[:, columns.restitution] = 0.0
                dq, dv = _composed(impact, dq, dv, late, ds)
            late_q, late_v = self._late(flow, t + done, q, v, ds)
            # at the same time, though this part has begun later by ds
            dq, dv = _composed(ended, dq, dv, (late_q - rate_q, late_v - rate_v), ds)
            q, v, done = ended.q, ended.v, self._dt
            if cut.closing >= 0:
                J_n = self._normal(q, cut.closing)
                later = -(J_n @ dq) / float(J_n @ rate_q)
                dq, dv = dq + np.outer(rate_q, later), dv + np.outer(rate_v, later)
                ds, done = later, cut.start + cut.length
        return made(route, self._steps, (q, v), (dq, dv), modes, margin)

    def _stays(self, impact: Ended, flow: Ended) -> bool:
        """Whether all that was struck stays where it is, without restitution.

        What rebounds by e v then is back after 2 e v / a, and has lost by then what the impact gave
        it beside that of e = 0: the end is the same to e^2.
        """
        struck, cones = impact.posed.chosen, self._system.contacts.cones
        after = modes_of(self._steps, flow)
        names = [*compress(self._system.contacts.names, struck.active[:cones])]
        return not struck.restitution.any() and all(after[name] != "open" for name in names)

    def _made(self, dt: float, held: NDArray[np.bool_]) -> LinearSteps:
        """Return the linear steps of a part."""
        of = self._steps
        made = LinearSteps(of.scene, of.scheme, dt, self._system, wrt=of.wrt)
        made.steps = self._held(dt, held)
        return made

    def _held(self, dt: float, held: NDArray[np.bool_]) -> _Held:
        steps = _Held(self._steps.scheme, self._system, dt)
        steps.held = held
        return steps

    def _flow(self, cut: _Cut, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        q, v, _ = self._held(cut.length, cut.held).step(t + cut.start, q, v)
        return q, v

    def _rates(self, cut: _Cut, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return how the end of a flow changes with its length (nv,) each."""
        by, model = _SHARE * self._dt, self._system.model
        (q1, v1), (q0, v0) = (
            self._flow(cut._replace(length=cut.length + x), t, q, v) for x in (by, -by)
        )
        middle = self._flow(cut, t, q, v)[0]
        moved = pin.difference(model, middle, q1) - pin.difference(model, middle, q0)
        return np.asarray(moved) / (2 * by), (v1 - v0) / (2 * by)

    def _late(
        self, part: LinearSteps, t: float, q: Array, v: Array, ds: Array
    ) -> tuple[Array, Array]:
        """Return how the end of a part changes with its time, if ds is: its length stays."""
        system, by, none = self._system, _SHARE * self._dt, np.zeros(len(v))
        is_of_time = system.scene.is_driven or system.applied.constant is None
        if not (is_of_time and ds.any()):
            return none, none
        (q1, v1), (q0, v0) = (part.ended(t + x, q, v, self._law) for x in (by, -by))
        return np.asarray(pin.difference(system.model, q0, q1)) / (2 * by), (v1 - v0) / (2 * by)

    def _struck(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the state behind an impact, if there is one."""
        held = self._impact(q, v)
        if held is None:
            return q, v
        return self._made(_INSTANT, held).ended(t, q, v, self._law)

    def _impact(self, q: Array, v: Array) -> NDArray[np.bool_] | None:
        """Return which contacts touch, if one of them closes; None if none does."""
        gaps, closing = self._approach(q, v)
        touches = gaps <= _TOUCHES
        struck = (touches & (closing < -_RESTS)).any() and self._cuts < _CUTS
        return touches if struck else None

    def _approach(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the gaps, and how fast they open."""
        system = self._system
        data = system.equations.data
        pin.computeJointJacobians(system.model, data, q)
        gaps, J = system.contacts.evaluate(data, q)
        return gaps, J[system.contacts.normals].dot(v)

    def _normal(self, q: Array, i: int) -> Array:
        system = self._system
        data = system.equations.data
        pin.computeJointJacobians(system.model, data, q)
        J = system.contacts.evaluate(data, q)[1]
        return np.asarray(J[system.contacts.normals[i]])

    def _next(self, t: float, done: float, q: Array, v: Array) -> _Cut:
        """Return the flow from a state to the first gap that closes, or to the end of the step."""
        gaps, opening = self._approach(q, v)
        touches = gaps <= _TOUCHES
        held = touches & (opening <= _RESTS)
        whole = _Cut(done, self._dt - done, held, -1)
        if self._cuts >= _CUTS:
            return whole._replace(held=touches)
        # what goes out and does not get there takes part: it may not go in again
        leaves = np.flatnonzero(touches & ~held).tolist()
        inside = [i for i in leaves if self._opened(whole, t, q, v, i) is None]
        if inside:
            held = held.copy()
            held[inside] = True
            whole = whole._replace(held=held)
        ends = self._gaps_after(whole, t, q, v)
        first, closing = whole.length, -1
        for i in np.flatnonzero((ends < 0) & ~held):
            s = self._located(whole, t, q, v, int(i))
            if s < first:
                first, closing = s, int(i)
        self._cuts += closing >= 0
        return whole._replace(length=first, closing=closing)

    def _gaps_after(self, cut: _Cut, t: float, q: Array, v: Array) -> Array:
        there = self._flow(cut, t, q, v)[0]
        return self._approach(there, v)[0]

    def _located(self, whole: _Cut, t: float, q: Array, v: Array, i: int) -> float:
        """Return when a gap closes, by secants within an interval that holds the root.

        The end of the flow, if it never opens.
        """
        low, high = 0.0, whole.length
        f_low, f_high = (
            float(self._approach(q, v)[0][i]),
            float(self._gaps_after(whole, t, q, v)[i]),
        )
        if f_low <= _TOUCHES:  # it has just left: the gap opens first
            opened = self._opened(whole, t, q, v, i)
            if opened is None:
                return high
            low, f_low = opened
        for k in range(_HALVINGS):
            s = high - f_high * (high - low) / (f_high - f_low) if k % 3 < 2 else (low + high) / 2
            f = float(self._gaps_after(whole._replace(length=s), t, q, v)[i])
            if abs(f) < _TOUCHES / 1e3 or high - low < 1e-15 * self._dt:
                return s
            if f > 0:
                low, f_low = s, f
            else:
                high, f_high = s, f
        return high

    def _opened(
        self, whole: _Cut, t: float, q: Array, v: Array, i: int
    ) -> tuple[float, float] | None:
        """Return a time at which a gap is open, and how far; None if there is none."""
        s = whole.length
        for _ in range(_OPENINGS):
            f = float(self._gaps_after(whole._replace(length=s), t, q, v)[i])
            if f > 0:
                return s, f
            s /= 2
        return None


def _composed(
    ended: Ended, dq: Array, dv: Array, late: tuple[Array, Array], ds: Array
) -> tuple[Array, Array]:
    """Return the end of a part by the start of the step, and by what acts in both.

    `late` is how it changes where the part begins later, as it does by ds (columns,).
    """
    n = len(dq)
    both = []
    for of, slope in zip((ended.dq, ended.dv), late, strict=True):
        x = of[:, :n] @ dq + of[:, n : 2 * n] @ dv + np.outer(slope, ds)
        x[:, 2 * n :] += of[:, 2 * n :]
        both.append(x)
    return both[0], both[1]


def _joined(first: dict[str, str], then: dict[str, str]) -> dict[str, str]:
    """Return modes in which a contact is what it was when it last touched."""
    return {name: first.get(name, "open") if m == "open" else m for name, m in then.items()}
