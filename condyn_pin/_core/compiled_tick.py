"""The module of control ticks that was compiled beside the core, a small one of its own."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any, Final

from condyn_pin._core.compiled import BUILD
from condyn_pin.errors import MissingExtra

# Of the arrays that are handed over, as that of the core.
PROTOCOL: Final = 1


@cache
def compiled_tick() -> Any:
    """Return the module; MissingExtra if there is none that fits."""
    try:
        module = import_module("condyn_pin_native._tick")
    except ImportError as error:
        raise MissingExtra(f"the compiled core has no control ticks: {BUILD} ({error})") from error
    if module.protocol != PROTOCOL:
        raise MissingExtra(
            f"the compiled core that is installed is of another version of condyn_pin: {BUILD}"
        )
    return module
