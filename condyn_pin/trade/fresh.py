"""Fresh states: a solver judged where it was not chosen.

The worst of n states says little of the next n. If the tail of the errors goes on as it is, like a
power of how rare they are, the worst over ten times as many states is

    expected = worst * worst / tenth,        tenth: the tenth largest error of the n,

since the tenth largest of n is where the largest of n / 10 is to be looked for. A solver meets an
error only if `expected` does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite

import numpy as np

from condyn_pin.catalogue import motor_torque
from condyn_pin.errors import InvalidArgument
from condyn_pin.scene import Scene
from condyn_pin.solvers.base import Solver
from condyn_pin.solvers.reference import Reference
from condyn_pin.timing import State
from condyn_pin.workspace import Workspace

_TENTH = 10
_LEAST = 20  # states, for a tenth largest that is not the smallest


@dataclass(frozen=True)
class Fresh:
    """What a solver gave at states that it was not chosen by.

    Attributes
    ----------
    states : int
    error : float
        The worst, relative; infinite where there was no answer.
    expected : float
        What the worst is expected to be over ten times as many states.
    """

    states: int
    error: float
    expected: float

    @classmethod
    def of(cls, errors: Sequence[float]) -> Fresh:
        """Judge the errors at some states."""
        ranked = sorted((error if isfinite(error) else inf for error in errors), reverse=True)
        worst = ranked[0]
        tenth = ranked[min(_TENTH, len(ranked)) - 1]
        steady = isfinite(worst) and tenth > 0
        return cls(len(ranked), worst, worst * (worst / tenth) if steady else worst)

    def __str__(self) -> str:
        return (
            f"worst {self.error:.1e} at {self.states} fresh states, "
            f"{self.expected:.1e} expected over {_TENTH * self.states}"
        )


def check_count(states: int) -> None:
    """Refuse a number of states that says nothing about a tail."""
    if isinstance(states, bool) or not isinstance(states, int | np.integer) or states < _LEAST:
        raise InvalidArgument(f"states = {states!r}: a whole number >= {_LEAST} is needed")


def fresh_states(scene: Scene, count: int, seed: int) -> list[State]:
    """Return closed, moving states under motor torques, of a stream that no study draws from."""
    rng = np.random.default_rng([seed, 0xF4E54])  # a seed that is a list: no study has one
    return [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(count)]


class FreshErrors:
    """The errors of solvers at fresh states, all at the same ones."""

    def __init__(self, scene: Scene, measure: str, states: int, seed: int) -> None:
        self.scene = scene
        self.states = fresh_states(scene, states, seed)
        reference = Workspace(scene, Reference())
        self.truth = [reference.solve(*state, throw=False).a for state in self.states]

    def __call__(self, solver: Solver) -> Fresh:
        """Return what a solver gives at the states."""
        workspace = Workspace(self.scene, solver)
        found = [workspace.solve(*state, throw=False).a for state in self.states]
        gravity = self.scene.audit.yardstick.gravity
        return Fresh.of(
            [
                float(np.abs(a - right).max() / max(np.abs(right).max(), gravity))
                for a, right in zip(found, self.truth, strict=True)
            ]
        )
