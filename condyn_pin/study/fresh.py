"""Fresh states: a solver judged where it was not chosen.

The worst of n states says little of the next n. If the tail of the errors goes on as it is, like a
power of how rare they are, every ten times as many states make the worst larger by the same factor.
The tenth largest of n is where the largest of n / 10 is to be looked for, so that over a hundred
times as many it is

    worst * (worst / tenth)^2.

Ten errors say the exponent of the tail to 1 / sqrt(10) of it (Hill), so two of these are added,

    expected = worst * (worst / tenth)^(2 (1 + 2 / sqrt(10))),

and a solver meets an error only if `expected` does: it is used more often than it is tried. A tenth
that is zero says nothing of the worst: it counts as rounding.

References
----------
Hill. A simple general approach to inference about the tail of a distribution. Annals of
Statistics 3, 1975.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, sqrt
from typing import Any, Final

from condyn_pin._core.arrays import Array
from condyn_pin._core.timing import State
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.study.measures import Measure
from condyn_pin.study.method import Method
from condyn_pin.study.row import ANSWERED
from condyn_pin.study.states import SampledStates, States, as_states

_TENTH: Final = 10
_DECADES: Final = 2 * (1 + 2 / sqrt(_TENTH))  # two, and what ten errors leave open
_LEAST: Final = 20  # states, for a tenth largest that is not the smallest

# No error is known better than that.
_ROUNDING: Final = 2.2e-16

# Seeds of studies are small numbers.
_SEED: Final = 2**32


@dataclass(frozen=True)
class Fresh:
    """What a solver gave at states that it was not chosen by."""

    states: int  # how many
    error: float  # the worst, relative; infinite where there was no answer
    expected: float  # what the worst is expected to stay below over a hundred times as many states

    @classmethod
    def of(cls, errors: Sequence[float]) -> Fresh:
        """Judge the errors at some states."""
        ranked = sorted((error if isfinite(error) else inf for error in errors), reverse=True)
        worst = ranked[0]
        tenth = ranked[min(_TENTH, len(ranked)) - 1]
        factor = max(worst / max(tenth, _ROUNDING), 1.0) if isfinite(worst) else 1.0
        return cls(len(ranked), worst, worst * factor**_DECADES)

    def __str__(self) -> str:
        return (
            f"worst {self.error:.1e} at {self.states} fresh states, "
            f"{self.expected:.1e} expected over {_TENTH**2 * self.states}"
        )


def as_fresh(states: States | int) -> States:
    """Return a set of states; a number is that many sampled ones, of a seed that no study has."""
    chosen = states if isinstance(states, States) else as_states(states)
    if isinstance(chosen, SampledStates) and chosen is not states:
        chosen = replace(chosen, seed=_SEED)
    _check_count(states, getattr(chosen, "count", _LEAST))
    return chosen


def _check_count(states: States | int, count: int) -> None:
    if count < _LEAST:
        raise InvalidArgument(f"states = {states!r}: {count}, and at least {_LEAST} are needed")


class FreshErrors:
    """The errors of solvers at fresh states, all at the same ones, of which there have to be 20."""

    def __init__(self, scene: Scene, measure: Measure, states: States | int) -> None:
        self._scene, self._measure = scene, measure
        self._states = as_fresh(states).of(scene)
        _check_count(states, len(self._states))
        self._truth = [measure.truth(scene, state) for state in self._states]

    def __call__(self, solver: Method, measure: Measure | None = None) -> Fresh:
        """Return what a solver gives at the states, by a measure of the same truth."""
        asked = self._measure if measure is None else measure
        try:
            workspace = asked.open(self._scene, solver)
        except Exception:  # a solver of somebody's own may raise anything; it is rejected
            return Fresh.of([inf] * len(self._states))
        pairs = zip(self._states, self._truth, strict=True)
        return Fresh.of([_error(asked, workspace, *pair) for pair in pairs])


def _error(measure: Measure, workspace: Any, state: State, truth: Array) -> float:
    """Return the error at a state; infinite without an answer, or where ok is a lie."""
    try:
        answer = measure.answer(workspace, state, truth, SOLVED)
    except Exception:  # a solver of somebody's own may raise anything; it is rejected
        return inf
    return answer.error if answer.status in ANSWERED else inf
