"""Outcome: how a run was made, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import Enum
from typing import Any

from condyn_pin.constraints.drift import Drift
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.simulation.effects import Effects
from condyn_pin.simulation.events import Happened
from condyn_pin.simulation.integrators.base import Integrator


class RunStatus(Enum):
    """How a run ended."""

    FINISHED = "it went to its end"
    ENDED = "an event ended it"
    DIVERGED = "its numbers grew without bound: use a smaller dt, or other gains"
    FAILED = "a step could not be taken"
    PILED_UP = "events piled up"
    INTERRUPTED = "what came before is kept"

    @property
    def ok(self) -> bool:
        """Whether it went to its end, or to that of an event."""
        return self in (RunStatus.FINISHED, RunStatus.ENDED)

    def __str__(self) -> str:
        return f"{self.name.lower()}: {self.value}"


@dataclass(frozen=True, kw_only=True)
class Run:
    """How a trajectory was made.

    Attributes
    ----------
    duration, dt : float
        What was asked for, and the step [s].
    integrator, drift, solver
        What was used.
    effects : Effects
        What of the robot's model was on.
    status : RunStatus
    reason : str
        Why it ended where it did; empty if it went to its end.
    happened : tuple of Happened
        The events.
    missed : tuple of str
        Events that did not happen, and why not.
    differenced : int
        How often the function of torques was called for its differences.
    wall_time : float
        [s]
    """

    duration: float  # [s]
    dt: float  # [s]
    integrator: Integrator
    drift: Drift
    solver: Solver
    effects: Effects = field(default_factory=Effects)
    status: RunStatus = RunStatus.FINISHED
    reason: str = ""
    happened: tuple[Happened, ...] = ()
    missed: tuple[str, ...] = ()
    differenced: int = 0
    wall_time: float = 0.0  # [s]

    @property
    def choices(self) -> str:
        """Integrator, drift scheme and solver, with what is not at its default."""
        return ", ".join(_short(choice) for choice in (self.integrator, self.drift, self.solver))


def _short(value: Any) -> str:
    """Return the repr of a choice with those parameters that are not at their defaults."""
    parameters = (
        f"{f.name}={x!r}" for f in fields(value) if (x := getattr(value, f.name)) != f.default
    )
    return f"{type(value).__name__}({', '.join(parameters)})"
