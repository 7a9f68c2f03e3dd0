"""Mechanisms built without any file: functions with parameters, one file each.

Each function marked with `mechanism` enters `MECHANISMS` under its name where its module is
imported, and `MECHANISMS`, when it is first asked for, imports every module of this folder: to add
a mechanism is to add one file. With its default values it is what `load_robot` returns under that
name.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

from condyn_pin.model.mechanisms import machine
from condyn_pin.model.mechanisms.machine import mechanism

if TYPE_CHECKING:
    from condyn_pin.model.mechanisms.machine import MECHANISMS

__all__ = ["MECHANISMS", "mechanism"]


def __getattr__(name: str) -> Any:
    if name != "MECHANISMS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    for module in iter_modules(__path__):
        import_module(f"{__name__}.{module.name}")
    in_order = sorted(machine.MECHANISMS.items(), key=_place)  # one may have been imported before
    machine.MECHANISMS.clear()
    machine.MECHANISMS.update(in_order)
    globals()[name] = machine.MECHANISMS  # asked for once
    return machine.MECHANISMS


def _place(entry: tuple[str, Callable[..., Any]]) -> tuple[str, int]:
    """Module and line of a mechanism."""
    build: Any = entry[1]
    return build.__module__, build.__code__.co_firstlineno
