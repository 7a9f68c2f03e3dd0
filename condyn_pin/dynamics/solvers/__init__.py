"""Solvers: frozen values whose fields are their parameters, one file each.

Each solver registers itself where its module is imported, and `SOLVERS`, when it is first asked
for, imports every module of this folder: to add a solver is to add one file (`solver.py` has its
contract), and a solve imports no solver but its own.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from condyn_pin.dynamics.solvers import solver
from condyn_pin.dynamics.solvers.solver import Solver

if TYPE_CHECKING:
    from condyn_pin.dynamics.solvers.solver import SOLVERS

__all__ = ["SOLVERS", "Solver"]


def __getattr__(name: str) -> dict[str, type[Solver]]:
    if name != "SOLVERS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    for module in iter_modules(__path__):
        import_module(f"{__name__}.{module.name}")
    globals()[name] = solver.SOLVERS  # asked for once
    return solver.SOLVERS
