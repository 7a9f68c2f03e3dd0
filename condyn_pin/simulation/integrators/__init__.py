"""Integrators: frozen values whose fields are their parameters, a family a file.

Every module of this folder is imported once, and each integrator in it registers itself, so that to
add an integrator is to add one file (`base.py` says what it must contain).
"""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.simulation.integrators.base import INTEGRATORS, Integrator, Order, Stepper

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["INTEGRATORS", "Integrator", "Order", "Stepper"]
