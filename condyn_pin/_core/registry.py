"""Registries: what registers itself under a name, once."""

from __future__ import annotations

from typing import TypeVar

from condyn_pin.errors import InvalidArgument

_Entry = TypeVar("_Entry")


def enter(registry: dict[str, _Entry], name: str, entry: _Entry, what: str) -> None:
    """Enter something into a registry; InvalidArgument says `what` exists if its name is taken."""
    if name in registry:
        raise InvalidArgument(f"{what} exists: choose another name")
    registry[name] = entry
