"""Lists of names: as users hand them in, and as sentences show them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from condyn_pin.errors import InvalidArgument, unknown_name

_NAMES_SHOWN = 8


def checked(argument: str, names: Any, known: Sequence[str], what: str) -> tuple[str, ...]:
    """Return a list of names without repetition, each of which exists."""
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise InvalidArgument(f"{argument} = {names!r}: a list of names is needed")
    found = []
    for name in names:
        if not isinstance(name, str):
            raise InvalidArgument(f"{argument}: {name!r} is not the name of a {what}")
        if name not in known:
            raise unknown_name(what, name, known)
        found.append(name)
    return tuple(dict.fromkeys(found))


def listed(names: Sequence[str]) -> str:
    """Return names for a sentence, the first few of many."""
    more = len(names) - _NAMES_SHOWN
    return ", ".join(names[:_NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")


def few(names: Sequence[str]) -> str:
    """Return up to four names, or how many joints there are."""
    return ", ".join(names) if len(names) <= 4 else f"{len(names)} joints"


def quoted(names: Iterable[str]) -> str:
    """Return names as errors list them."""
    return ", ".join(repr(name) for name in names)


def counted(number: int, thing: str) -> str:
    """Return a number of things: 1 loop, 2 loops."""
    return f"{number} {thing}{'s' * (number != 1)}"
