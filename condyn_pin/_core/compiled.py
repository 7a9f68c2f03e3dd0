"""Compiled modules: the core, control ticks, recursions of Pinocchio 3.9.

The compiled core is a distribution of its own, `condyn_pin_native` (the folder ``native`` of the
repository), and nothing needs it: what it does, Python does as well. It is built from headers of
Pinocchio and does not touch the one that is installed.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from typing import Any, Final, Literal, TypeAlias, get_args

from condyn_pin.errors import InvalidArgument, MissingExtra, UnsupportedBackend

# Who answers: "auto" is the compiled core where it is installed and has what is needed, and Python
# where not; "core" is an error there.
Engine: TypeAlias = Literal["auto", "core", "python"]

# With the value "python", "auto" is Python: to compare both.
VARIABLE: Final = "CONDYN_ENGINE"

# Of the fields that are handed over; a module of another one was built from another version.
PROTOCOL: Final = 13
TICK_PROTOCOL: Final = 4

BUILD: Final = "pip install ./native, in a checkout of condyn_pin, builds it in some minutes"
BUILD_RECURSIONS: Final = (
    "pip install ./native -C cmake.define.CONDYN_RECURSIONS=ON, in a checkout of condyn_pin"
)


@cache
def compiled() -> Any:
    """Return the module that was compiled; MissingExtra if there is none that fits."""
    return _module("_core", PROTOCOL, "the compiled core is not installed")


@cache
def compiled_tick() -> Any:
    """Return the compiled module of control ticks, a small one; MissingExtra if there is none."""
    return _module("_tick", TICK_PROTOCOL, "the compiled core has no control ticks")


def is_compiled(engine: Engine) -> bool:
    """True if an engine, checked here, is the compiled core."""
    if engine not in get_args(Engine):
        raise InvalidArgument(f"engine = {engine!r}: 'auto', 'core' or 'python' is needed")
    if engine != "auto":
        return engine == "core"
    named = os.environ.get(VARIABLE, "auto")
    if named not in ("auto", "python"):
        raise InvalidArgument(f"{VARIABLE} = {named!r}: 'auto' or 'python' is needed")
    return named == "auto" and has_core()


@cache
def has_core() -> bool:
    """True if a compiled core of this version is installed."""
    try:
        compiled()
    except MissingExtra:
        return False
    return True


def refuse(reasons: Iterable[str], by_python: str = "Native(where_possible=True)") -> None:
    """Raise `UnsupportedBackend` for the first reason; the argument named leaves it to Python."""
    for reason in reasons:
        raise UnsupportedBackend(
            f"the compiled core does not take this: {reason}; {by_python} leaves it to Python"
        )


def _module(name: str, protocol: int, missing: str) -> Any:
    try:
        module = import_module(f"condyn_pin_native.{name}")
    except ImportError as error:
        raise MissingExtra(f"{missing}: {BUILD} ({error})") from error
    if module.protocol != protocol:
        raise MissingExtra(
            f"the compiled core that is installed is of another version of condyn_pin: {BUILD}"
        )
    return module


_CORE: Final = "compiled core"


def core_features() -> dict[str, str]:
    """Availability of the compiled core, ticks and recursions, for `condyn doctor`."""
    found = {}
    try:
        import_module("condyn_pin_native")
    except ImportError:
        return {_CORE: f"no, and so no control ticks, no ConstrainedABA, no PV: {BUILD}"}
    try:
        module = compiled()
        flags = f"for {module.arch}" if module.arch else "by default flags"
        built = f"from headers of Pinocchio {module.pinocchio}, {flags} ({module.simd})"
        used = "used by default" if is_compiled("auto") else f"not used: {VARIABLE}=python"
        found[_CORE] = f"yes, {used}, {built}"
    except MissingExtra as error:
        found[_CORE] = f"no: {error}"
    try:
        compiled_tick()
        found["compiled control ticks"] = "yes, built with the compiled core"
    except MissingExtra as error:
        found["compiled control ticks"] = f"no: {error}"
    missing = missing_constrained_aba()
    found["ConstrainedABA, PV"] = (
        f"no: {missing}"
        if missing
        else f"yes, from headers of Pinocchio {constrained_aba().pinocchio}"
    )
    return found


# Pinocchio 3.9's recursions for contacts: whether they are compiled, and for which joints.
#
# No wheel of Pinocchio brings `constrainedABA` and `pv` to Python, and the headers of 4.1 do not
# compile for its rigid constraints. So they are compiled from those of 3.9, whatever is installed,
# in the distribution ``condyn_pin_native`` (the folder ``native`` of the repository).


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
    """Reason why ConstrainedABA and PV are missing, and the remedy; empty if they are there."""
    try:
        import_module("condyn_pin_native._constrained_aba")
    except ImportError as error:
        return f"ConstrainedABA and PV are not compiled: {BUILD_RECURSIONS} ({error})"
    return ""
