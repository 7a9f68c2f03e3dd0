"""Thread safety: workspaces for one thread at a time, and caches of each thread.

One thread at a time: memory that threads share by mistake gives each the numbers of the other.

The mark of the thread at work is read and written without a call in between, where Python neither
switches threads nor raises KeyboardInterrupt; a lock would be left taken by a Ctrl-C.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from threading import get_ident
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar
from weakref import ref

from condyn_pin.errors import SharedWorkspace

P = ParamSpec("P")
R = TypeVar("R")
Self = TypeVar("Self", bound="OneThread")


class OneThread:
    """Object for one thread at a time; reentrant within that thread."""

    _user = 0  # the thread that is at work in it; 0 if none is

    def check_alone(self) -> None:
        """Raise `SharedWorkspace` if another thread is using the object."""
        if self._user and self._user != get_ident():
            raise in_use()


def single_threaded(method: Callable[Concatenate[Self, P], R]) -> Callable[Concatenate[Self, P], R]:
    """Decorate a method to raise `SharedWorkspace` while another thread is using the object."""

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
    """Error of a second thread in one workspace."""
    return SharedWorkspace(
        f"{what}: its memory belongs to one at a time, and the answers would be mixed up; make one "
        "Workspace(scene) a thread, or call solve and derivatives, which keep one for each thread"
    )


def of_workspace(method: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Any, P], R]:
    """Decorate a method to use the object's `_workspace` alone, as `single_threaded` does."""

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


# Kept: what a thread has made for objects, such as the workspaces of scenes.
#
# It is as long there as its object, the thread, and no more than a few others that were asked for
# since. It may refer to the object: that is why the object itself keeps it, and the thread knows
# only where.


T = TypeVar("T")


class ThreadCache(Generic[T]):
    """Cache of the latest objects of one kind, separate for each thread.

    most: how many a thread keeps
    """

    def __init__(self, most: int = 4) -> None:
        self._most, self._of_thread = most, threading.local()

    def of(self, owner: object, arguments: object, make: Callable[[], T]) -> T:
        """Cached object of an owner and its `arguments`; made by `make` if missing."""
        places: _Places | None = getattr(self._of_thread, "places", None)
        if places is None:
            self._of_thread.places = places = _Places()
        for place in reversed(places):
            if place.owner() is owner and place.arguments == arguments:
                if place is not places[-1]:
                    places.remove(place)
                    places.append(place)
                return place.content  # type: ignore[no-any-return]
        made = make()
        places[:] = [place for place in places if place.owner()]
        places.append(_Place(ref(owner), arguments))
        places[-1].keep(made)
        for place in places[: -self._most]:
            place.drop()
        del places[: -self._most]
        return made


@dataclass(eq=False)
class _Place:
    """Key of a cached object, which is stored on its owner."""

    owner: ref[Any]
    arguments: object

    @property
    def content(self) -> Any:
        return vars(self.owner())["_kept"][self]

    def keep(self, content: object) -> None:
        vars(self.owner()).setdefault("_kept", {})[self] = content

    def drop(self) -> None:
        if owner := self.owner():
            del vars(owner)["_kept"][self]


class _Places(list[_Place]):
    """Cache keys of one thread, oldest first; their objects are dropped when the thread ends."""

    def __del__(self) -> None:
        for place in self:
            place.drop()
