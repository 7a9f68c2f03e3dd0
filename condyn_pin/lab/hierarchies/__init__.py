"""Ladders: one file each, with a `HIERARCHY` in it, so that to add a ladder is to add one file.

A `HIERARCHY` is a first scene, and models that each make the scene above smaller. `condyn lab
ladder <name>` and `benchmarks/ladder.py` find it here.
"""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.lab.hierarchy import ModelHierarchy

HIERARCHIES: dict[str, ModelHierarchy] = {}

for _module in iter_modules(__path__):
    _ladder: ModelHierarchy = import_module(f"{__name__}.{_module.name}").HIERARCHY
    HIERARCHIES[_ladder.name] = _ladder

__all__ = ["HIERARCHIES"]
