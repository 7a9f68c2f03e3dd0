"""What a member of a class was called in the last version: it warns, and forwards."""

from __future__ import annotations

from typing import Any
from warnings import warn


class renamed:  # noqa: N801  used as a function is
    """Forward a member to its name of today, for one version.

    Parameters
    ----------
    now : str
        What it is called now.
    """

    def __init__(self, now: str) -> None:
        self._now = now

    def __set_name__(self, owner: type, name: str) -> None:
        self._text = f"{owner.__name__}.{name} is {owner.__name__}.{self._now} now"

    def __get__(self, instance: Any, owner: type) -> Any:
        """Return what the member of today is; of the class itself, this."""
        if instance is None:
            return self
        warn(self._text, DeprecationWarning, stacklevel=2)
        return getattr(instance, self._now)
