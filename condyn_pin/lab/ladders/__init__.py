"""Ladders: one file each, with a `LADDER` in it, so that to add a ladder is to add one file."""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.lab.climbing import Ladder

LADDERS: dict[str, Ladder] = {}

for _module in iter_modules(__path__):
    _ladder: Ladder = import_module(f"{__name__}.{_module.name}").LADDER
    LADDERS[_ladder.name] = _ladder

__all__ = ["LADDERS"]
