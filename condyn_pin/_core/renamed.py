"""What a member of a class was called in the last version: it warns, and forwards."""

from __future__ import annotations

from functools import partial
from importlib import import_module
from typing import Any
from warnings import warn


class renamed:  # noqa: N801  used as a function is
    """Forward a member to its name of today, for one version.

    Parameters
    ----------
    now : str
        What it is called now: another member, or a function of the object with the room that has
        it, ``mechanism.keep``.
    called : bool
        That a function is called, since the member was no method.
    """

    def __init__(self, now: str, *, called: bool = False) -> None:
        self._room, _, self._now = now.rpartition(".")
        self._called = called

    def __set_name__(self, owner: type, name: str) -> None:
        place = self._room or owner.__name__
        self._text = f"{owner.__name__}.{name} is {place}.{self._now} now"

    def __get__(self, instance: Any, owner: type) -> Any:
        """Return what the member of today is; of the class itself, this."""
        if instance is None:
            return self
        warn(self._text, DeprecationWarning, stacklevel=2)
        if not self._room:
            return getattr(instance, self._now)
        function = getattr(import_module(f"condyn_pin.{self._room}"), self._now)
        return function(instance) if self._called else partial(function, instance)
