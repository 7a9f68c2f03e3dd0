"""Landings: when gaps close within a step, and the motion up to there.

    gap(flow(s)) = 0

Between two such times contacts keep what they are, open or at rest, by steps of `Moreau`; what is
at rest does not rebound.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms
from condyn_pin.simulation.integrators.chosen_contacts import Chosen
from condyn_pin.simulation.integrators.contact_steps import ContactSteps
from condyn_pin.simulation.integrators.posed import Posed
from condyn_pin.simulation.routes.linear_steps import LinearSteps

# A gap that is closed [m, rad], and a velocity along the normal that counts as zero [m/s, rad/s].
TOUCHES: Final = 1e-9
RESTS: Final = 1e-7

# Cuts of one step, at most: what bounces more often rests.
_CUTS: Final = 8

# Halvings of the step in which an impact is looked for: to rounding.
_HALVINGS: Final = 100

# Halvings of the step in which a gap is looked for that opens: a millionth of a millionth of it.
_OPENINGS: Final = 40


class HeldSteps(ContactSteps):
    """Steps in which some contacts take part, wherever they are: in a flow, or in an impact.

    What is at rest in a flow does not rebound.
    """

    def __init__(
        self, steps: LinearSteps, dt: float, held: NDArray[np.bool_], rebounds: bool
    ) -> None:
        super().__init__(steps.scheme, steps.system, dt)
        self.held, self._rebounds = held, rebounds

    def pose(self, t: float, q: Array, v: Array, active: NDArray[np.bool_] | None = None) -> Posed:
        """Return the step from a state with the contacts that are held."""
        return super().pose(t, q, v, self.held)

    def _choose(self, near: NDArray[np.bool_]) -> Chosen:
        chosen = super()._choose(near)
        if not self._rebounds:
            chosen.restitution[:] = 0.0
        return chosen


class Cut(NamedTuple):
    """A flow, a part of a step."""

    start: float  # [s], since the start of the step
    length: float  # [s]
    held: NDArray[np.bool_]
    closing: int  # the gap that ends it, -1 if the end of the step does


class Landings:
    """The flows of one step, each up to the first gap that closes."""

    def __init__(self, steps: LinearSteps) -> None:
        self._steps, self._dt, self._system = steps, steps.dt, steps.system
        self._cuts = 0

    def flow(self, cut: Cut, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the end of a flow."""
        steps = HeldSteps(self._steps, cut.length, cut.held, rebounds=False)
        q, v, _ = steps.step(t + cut.start, q, v)
        return q, v

    def struck(self, q: Array, v: Array) -> NDArray[np.bool_] | None:
        """Return which contacts touch, if one of them closes; None if none does."""
        gaps, closing = self.approach(q, v)
        touches = gaps <= TOUCHES
        return touches if (touches & (closing < -RESTS)).any() else None

    @property
    def rebounds(self) -> bool:
        """Whether what is struck now rebounds: what has done so too often comes to rest."""
        return self._cuts < _CUTS

    def approach(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the gaps, and how fast they open."""
        system = self._system
        data = system.equations.data
        algorithms(data).computeJointJacobians(system.model, data, q)
        gaps, J = system.contacts.evaluate(data, q)
        return gaps, J[system.contacts.normals].dot(v)

    def normal(self, q: Array, i: int) -> Array:
        """Return the row J_n (nv,) of a gap."""
        system = self._system
        data = system.equations.data
        algorithms(data).computeJointJacobians(system.model, data, q)
        J = system.contacts.evaluate(data, q)[1]
        return np.asarray(J[system.contacts.normals[i]])

    def next(self, t: float, done: float, q: Array, v: Array) -> Cut:
        """Return the flow from a state to the first gap that closes, or to the end of the step."""
        gaps, opening = self.approach(q, v)
        touches = gaps <= TOUCHES
        held = touches & (opening <= RESTS)
        whole = Cut(done, self._dt - done, held, -1)
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

    def _gaps_after(self, cut: Cut, t: float, q: Array, v: Array) -> Array:
        there = self.flow(cut, t, q, v)[0]
        return self.approach(there, v)[0]

    def _located(self, whole: Cut, t: float, q: Array, v: Array, i: int) -> float:
        """Return when a gap closes, by secants within an interval that holds the root.

        The end of the flow, if it never opens.
        """
        low, high = 0.0, whole.length
        f_low, f_high = (
            float(self.approach(q, v)[0][i]),
            float(self._gaps_after(whole, t, q, v)[i]),
        )
        if f_low <= TOUCHES:  # it has just left: the gap opens first
            opened = self._opened(whole, t, q, v, i)
            if opened is None:
                return high
            low, f_low = opened
        for k in range(_HALVINGS):
            s = high - f_high * (high - low) / (f_high - f_low) if k % 3 < 2 else (low + high) / 2
            f = float(self._gaps_after(whole._replace(length=s), t, q, v)[i])
            if abs(f) < TOUCHES / 1e3 or high - low < 1e-15 * self._dt:
                return s
            if f > 0:
                low, f_low = s, f
            else:
                high, f_high = s, f
        return high

    def _opened(
        self, whole: Cut, t: float, q: Array, v: Array, i: int
    ) -> tuple[float, float] | None:
        """Return a time at which a gap is open, and how far; None if there is none."""
        s = whole.length
        for _ in range(_OPENINGS):
            f = float(self._gaps_after(whole._replace(length=s), t, q, v)[i])
            if f > 0:
                return s, f
            s /= 2
        return None
