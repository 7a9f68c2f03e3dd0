"""Ways from one time to the next, by name.

Each integrator registers itself where its module is imported, and `INTEGRATORS`, when it is first
read, imports every module of these folders: to add an integrator is to add one file (its contract
is in `integrator.py`), and a run imports no integrator but its own.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Final

from condyn_pin.simulation.integrators import integrator
from condyn_pin.simulation.integrators.integrator import Integrator, Order, Stepper

if TYPE_CHECKING:
    from condyn_pin.simulation.integrators.integrator import INTEGRATORS

__all__ = ["INTEGRATORS", "Integrator", "Order", "Stepper"]

# Folders of integrators.
_FOLDERS: Final = (__name__, "condyn_pin.stepping.schemes")


def __getattr__(name: str) -> dict[str, type[Integrator]]:
    if name != "INTEGRATORS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    for folder in _FOLDERS:
        for module in iter_modules(import_module(folder).__path__):
            import_module(f"{folder}.{module.name}")
    globals()[name] = integrator.INTEGRATORS  # asked for once
    return integrator.INTEGRATORS
