"""Mechanisms built without any file: functions with parameters, one file each.

Every module of this folder is imported once, and each function marked with `mechanism` enters
`MECHANISMS` under its name, so that to add a mechanism is to add one file. With its default values
it is what `load_robot` returns under that name.
"""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.model.mechanisms.base import MECHANISMS, mechanism

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["MECHANISMS", "mechanism"]
