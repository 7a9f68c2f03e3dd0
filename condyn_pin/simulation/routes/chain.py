"""Chain: steps of a motion with contacts, one after the other, with their derivatives.

    x_i+1 = step(x_i, u_i, p),    dx_i+1 = A_i dx_i + B_i du_i + P_i dp

Backward, the gradient y of what is asked of the states x_i, with g_i of x_i itself,

    y_i = g_i + A_i^T y_i+1,    by u_i: B_i^T y_i+1,    by p: sum_i P_i^T y_i+1

and each step is linearised when its turn comes, at a state that is kept, or taken again from one
that is: no matrix of another step is in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import ceil, sqrt
from typing import NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.routes.base import Route
from condyn_pin.simulation.routes.linear_steps import LinearSteps
from condyn_pin.simulation.routes.step_derivatives import StepDerivatives

State = tuple[Array, Array]


class Adjoint(NamedTuple):
    """The gradient of what is asked of the states of a motion."""

    state: Array  # (2 nv,), by the start; tangent
    tau: Array  # (steps, nv)
    columns: Array  # (columns,), by what all steps share


class Chain:
    """So many steps of a route.

    Parameters
    ----------
    torques : (count, nv) array, optional
        What is held in each step; without them what the system of `steps` applies.
    """

    def __init__(
        self, route: Route, steps: LinearSteps, count: int, torques: Array | None = None
    ) -> None:
        self.route, self.steps, self.count = route, steps, count
        self._torques, self._every = torques, max(ceil(sqrt(count)), 1)

    def after(self, start: State) -> Iterator[State]:
        """Return the state after each step."""
        state = start
        for i in range(self.count):
            state = self._next(i, state)
            yield state

    def kept(self, start: State) -> list[State]:
        """Return some sqrt(count) states, from the start on, and the end."""
        ends = list(range(self._every, self.count, self._every))
        found = [start]
        for i, state in enumerate(self.after(start), start=1):
            if i in ends or i == self.count:
                found.append(state)
        return found

    def forward(self, start: State) -> Iterator[StepDerivatives]:
        """Return the derivatives of each step."""
        state = start
        for i in range(self.count):
            of = self._at(i, state)
            yield of
            state = of.q, of.v

    def backward(self, kept: list[State]) -> Iterator[tuple[int, StepDerivatives]]:
        """Return the derivatives of each step, from the last one on, with its number."""
        for first in reversed(range(0, self.count, self._every)):
            last = min(first + self._every, self.count)
            states = [kept[first // self._every]]
            for i in range(first, last - 1):
                states.append(self._next(i, states[-1]))
            for i in reversed(range(first, last)):
                yield i, self._at(i, states[i - first])

    def adjoint(
        self, kept: list[State], asked: Callable[[int, StepDerivatives], Array | None]
    ) -> Adjoint:
        """Return the gradient of a function of all states.

        ``asked(i, of)`` is its own gradient (2 nv,) by the end of step i, None if it has none.
        """
        columns = self.steps.columns
        y, by_tau = np.zeros(2 * columns.nv), np.zeros((self.count, columns.nv))
        by_others = np.zeros(columns.size)
        for i, of in self.backward(kept):
            own = asked(i, of)
            x = (y if own is None else y + own) @ np.vstack(of.matrices)
            by_tau[i] = x[columns.tau]
            by_others += x
            y = x[: 2 * columns.nv]
        return Adjoint(y, by_tau, by_others)

    def _next(self, i: int, state: State) -> State:
        self._hold(i)
        return self.route.step(self.steps, self._time(i), *state)

    def _at(self, i: int, state: State) -> StepDerivatives:
        self._hold(i)
        return self.route.at(self.steps, self._time(i), *state)

    def _time(self, i: int) -> float:
        return self.steps.begin + i * self.steps.dt

    def _hold(self, i: int) -> None:
        if self._torques is not None:
            self.steps.system.applied.hold(self._torques[i], ())
