"""What each solver takes, costs and is good for, as it declares itself."""

from __future__ import annotations

from dataclasses import dataclass

from condyn_pin.dynamics.solvers import SOLVERS, Solver
from condyn_pin.dynamics.solvers.base import parameter_fields
from condyn_pin.dynamics.workspace import kinds_of


@dataclass(frozen=True)
class SolverRow:
    """One solver in words."""

    name: str  # as `cp.NAME()` and, in any case of letters, for ``--solver``
    kinds: str  # of constraints that it takes
    redundant: str  # what it makes of redundant rows, and of states where rows become so
    cost: str
    use: str
    parameters: str  # its fields with their defaults, one a line; None is found on the scene


def solver_rows() -> tuple[SolverRow, ...]:
    """Return a row for every solver."""
    return tuple(
        SolverRow(
            kind.__name__, kinds_of(kind), _redundant(kind), kind.cost, kind.use, _parameters(kind)
        )
        for kind in SOLVERS.values()
    )


def _redundant(kind: type[Solver]) -> str:
    if kind.takes_redundant:
        return "yes"
    return "mu > 0, else singular" if hasattr(kind, "mu") else "singular"


def _parameters(kind: type[Solver]) -> str:
    default = kind()
    return "\n".join(f"{f.name}={getattr(default, f.name)!r}" for f in parameter_fields(kind))
