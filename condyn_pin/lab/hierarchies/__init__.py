"""Ladders: one file each, with a `HIERARCHY` in it, so that to add a ladder is to add one file."""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.lab.hierarchy import ModelHierarchy

HIERARCHIES: dict[str, ModelHierarchy] = {}

for _module in iter_modules(__path__):
    _ladder: ModelHierarchy = import_module(f"{__name__}.{_module.name}").HIERARCHY
    HIERARCHIES[_ladder.name] = _ladder

__all__ = ["HIERARCHIES"]
