"""The compiled core: whether it is there, and which.

It is a distribution of its own, `condyn_pin_native` (the folder ``native`` of the repository), and
nothing needs it: what it does, Python does as well. It is built from headers of Pinocchio and does
not touch the one that is installed.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any, Final

from condyn_pin.errors import MissingExtra

# Of the arrays that are handed over; a core of another one was built from another version.
PROTOCOL: Final = 4

BUILD: Final = "pip install ./native, in a checkout of condyn_pin, builds it in some minutes"


@cache
def compiled() -> Any:
    """Return the module that was compiled; MissingExtra if there is none that fits."""
    try:
        module = import_module("condyn_pin_native._core")
    except ImportError as error:
        raise MissingExtra(f"the compiled core is not installed: {BUILD} ({error})") from error
    if module.protocol != PROTOCOL:
        raise MissingExtra(
            f"the compiled core that is installed is of another version of condyn_pin: {BUILD}"
        )
    return module


def features() -> dict[str, str]:
    """Return what there is of it, for `condyn doctor`."""
    try:
        module = compiled()
    except MissingExtra as error:
        return {"compiled core": f"no: {error}"}
    flags = f"for {module.arch}" if module.arch else "by default flags"
    return {
        "compiled core": f"yes, from headers of Pinocchio {module.pinocchio}, {flags} "
        f"({module.simd})"
    }
