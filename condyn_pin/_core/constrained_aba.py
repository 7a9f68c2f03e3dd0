"""Pinocchio 3.9's recursions for contacts: whether they are compiled, and for which joints.

No wheel of Pinocchio brings `constrainedABA` and `pv` to Python, and the headers of 4.1 do not
compile for its rigid constraints. So they are compiled from those of 3.9, whatever is installed, in
the distribution ``condyn_pin_native`` (the folder ``native`` of the repository).
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

from condyn_pin._core.compiled import BUILD
from condyn_pin.errors import MissingExtra


@cache
def constrained_aba() -> Any:
    """Return the module that was compiled; MissingExtra if there is none."""
    if missing := missing_constrained_aba():
        raise MissingExtra(missing)
    return import_module("condyn_pin_native._constrained_aba")


@cache
def compiled_lcaba() -> Any:
    """Return the calls of Pinocchio 4.1, compiled to be timed beside; MissingExtra if not there."""
    constrained_aba()  # says what is missing
    return import_module("condyn_pin_native._lcaba")


@cache
def missing_constrained_aba() -> str:
    """Return what is missing, and what installs it; nothing where it is there."""
    try:
        import_module("condyn_pin_native._constrained_aba")
    except ImportError as error:
        return f"ConstrainedABA and PV are compiled, and not installed: {BUILD} ({error})"
    return ""


def features() -> dict[str, str]:
    """Return what there is of it, for `condyn doctor`."""
    if missing := missing_constrained_aba():
        return {"ConstrainedABA, PV": f"no: {missing}"}
    module = constrained_aba()
    return {"ConstrainedABA, PV": f"yes, from headers of Pinocchio {module.pinocchio}"}
