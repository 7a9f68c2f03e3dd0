"""Foundations of every room.

Knows which Pinocchio is installed, and what it lacks; numbers and names as they come in; errors
and tolerances; linear algebra; files that appear whole or not at all; processes, shared memory and
threads; tables of text and the style of pictures.

Nothing here knows a robot, a constraint or a scene. Nothing here is public but the errors.
"""

from collections.abc import Callable, Mapping
from pkgutil import resolve_name
from typing import Any
from warnings import warn


def forward(
    room: str, public: Callable[[str], Any], renamed: Mapping[str, str]
) -> Callable[[str], Any]:
    """`__getattr__` of a room with names of the last version, `renamed`; they go with the next."""
    # `room` is its ``__name__``, `public` finds its names of today; `renamed` maps old names to
    # ``room.name`` of today.

    def find(name: str) -> Any:
        if not (now := renamed.get(name)):
            return public(name)
        warn(f"{room}.{name} is condyn_pin.{now} now", DeprecationWarning, stacklevel=2)
        return resolve_name(f"condyn_pin.{now}")

    return find
