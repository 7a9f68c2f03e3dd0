"""Drift schemes: what keeps the constraints closed while time goes on, one file each.

Every module of this folder is imported once, and each scheme in it registers itself, so that to
add a scheme is to add one file (`constraints/drift.py` has its contract).
"""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.constraints.drift import DRIFTS, Baumgarte, Correction, Drift

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["DRIFTS", "Baumgarte", "Correction", "Drift"]
