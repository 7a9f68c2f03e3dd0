"""One thread at a time: memory that threads share by mistake gives each the numbers of the other.

The mark of the thread at work is read and written without a call in between, where Python neither
switches threads nor raises KeyboardInterrupt; a lock would be left taken by a Ctrl-C.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import get_ident
from typing import Any, Concatenate, ParamSpec, TypeVar

from condyn_pin.errors import SharedWorkspace

P = ParamSpec("P")
R = TypeVar("R")
Self = TypeVar("Self", bound="OneThread")


class OneThread:
    """What one thread at a time may use; by the same thread again, also within a call."""

    _user = 0  # the thread that is at work in it; 0 if none is

    def check_alone(self) -> None:
        """Raise `SharedWorkspace` if another thread is at work in it."""
        if self._user and self._user != get_ident():
            raise in_use()


def alone(method: Callable[Concatenate[Self, P], R]) -> Callable[Concatenate[Self, P], R]:
    """Return a method that raises `SharedWorkspace` while another thread is at work."""

    @wraps(method)
    def guarded(self: Self, /, *args: P.args, **options: P.kwargs) -> R:
        me, user = get_ident(), self._user
        if user and user != me:
            raise in_use()
        self._user = me
        try:
            return method(self, *args, **options)
        finally:
            self._user = user

    return guarded


def in_use(what: str = "another thread is at work in this Workspace") -> SharedWorkspace:
    """Return the error."""
    return SharedWorkspace(
        f"{what}: its memory belongs to one at a time, and the answers would be mixed up; make one "
        "Workspace(scene) a thread, or call solve and derivatives, which keep one for each thread"
    )


def of_workspace(method: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Any, P], R]:
    """Return a method, of what has a `_workspace`, that works in it alone, as `alone` does."""

    @wraps(method)
    def guarded(self: Any, /, *args: P.args, **options: P.kwargs) -> R:
        workspace: OneThread = self._workspace
        me, user = get_ident(), workspace._user
        if user and user != me:
            raise in_use()
        workspace._user = me
        try:
            return method(self, *args, **options)
        finally:
            workspace._user = user

    return guarded
