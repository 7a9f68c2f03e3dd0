"""Trials: solvers tried on scenes, and timed beside each other where they say ok."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TypeVar

import numpy as np

from condyn_pin._core.timing import Call, State, Times, interleaved
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.workspace import Workspace, untaken
from condyn_pin.errors import UnsupportedConstraint

_Key = TypeVar("_Key", bound=Hashable)


@dataclass(frozen=True)
class Trial:
    """A solver tried on a scene: "ok" and what to time, or why a time would say nothing.

    The call goes from one state to the next, and does not check its arguments: scenes that are
    compared do not share their states.
    """

    call: Call | None
    said: str


def trial(scene: Scene, solver: Solver, states: Sequence[State]) -> Trial:
    """Return what to time, if the solver takes the scene and says ok at every state."""
    try:
        workspace = Workspace(scene, solver)
    except UnsupportedConstraint:
        missing = [c for c in scene.constraints if c.name in untaken(scene, solver)]
        kinds = dict.fromkeys(str(getattr(c, "kind", type(c).__name__)) for c in missing)
        return Trial(None, f"takes no {' and no '.join(kinds)}")
    for state in states:
        status = workspace.solve(*state, throw=False).status
        if not status.ok:
            return Trial(None, status.name.lower())
    turn = cycle(states)
    return Trial(lambda q, v, tau: workspace.acceleration(*next(turn)), "ok")


def time_trials(
    trials: Mapping[_Key, Trial], *, rounds: int, repeats: int = 10
) -> dict[_Key, Times]:
    """Time what can be timed of some trials, in one interleaved run."""
    calls = {name: one.call for name, one in trials.items() if one.call is not None}
    nothing = (np.zeros(0),) * 3
    return interleaved(calls, [nothing], rounds=rounds, repeats=repeats)
