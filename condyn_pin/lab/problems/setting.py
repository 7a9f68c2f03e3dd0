"""What is said about a problem: how it is run, how right it has to be, what others needed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from condyn_pin.dynamics.solvers.base import Solver
    from condyn_pin.simulation.drift import Drift
    from condyn_pin.simulation.integrators import Integrator


@dataclass(frozen=True)
class Limit:
    """An error that somebody asks for."""

    level: str  # how it is called
    value: float  # in the unit of what is judged
    source: str  # who asks for it


@dataclass(frozen=True)
class Setting:
    """How to run a problem; what is None is left to `simulate`."""

    dt: float  # [s]
    integrator: Integrator | None = None
    drift: Drift | None = None
    solver: Solver | None = None


@dataclass(frozen=True)
class Published:
    """What another code needed, as it was published."""

    code: str
    case: str  # what was run
    seconds: float  # CPU time [s]
    error: str  # as stated there; empty if it was not
    processor: str
    source: str
