"""Kept: what a thread has made for objects, such as the workspaces of scenes.

It is as long there as its object, the thread, and no more than a few others that were asked for
since. It may refer to the object: that is why the object itself keeps it, and the thread knows only
where.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar
from weakref import ref

T = TypeVar("T")


class Kept(Generic[T]):
    """What each thread has made last, of one kind.

    Parameters
    ----------
    most : int
        How many a thread keeps.
    """

    def __init__(self, most: int = 4) -> None:
        self._most, self._of_thread = most, threading.local()

    def of(self, owner: object, asked: object, make: Callable[[], T]) -> T:
        """Return what this thread has made for an object, asked for like this; or make it."""
        places: _Places | None = getattr(self._of_thread, "places", None)
        if places is None:
            self._of_thread.places = places = _Places()
        for place in reversed(places):
            if place.owner() is owner and place.asked == asked:
                if place is not places[-1]:
                    places.remove(place)
                    places.append(place)
                return place.content  # type: ignore[no-any-return]
        made = make()
        places[:] = [place for place in places if place.owner()]
        places.append(_Place(ref(owner), asked))
        places[-1].keep(made)
        for place in places[: -self._most]:
            place.drop()
        del places[: -self._most]
        return made


@dataclass(eq=False)
class _Place:
    """Where something is kept: by its owner, under this very object."""

    owner: ref[Any]
    asked: object

    @property
    def content(self) -> Any:
        return vars(self.owner())["_kept"][self]

    def keep(self, content: object) -> None:
        vars(self.owner()).setdefault("_kept", {})[self] = content

    def drop(self) -> None:
        if owner := self.owner():
            del vars(owner)["_kept"][self]


class _Places(list[_Place]):
    """Those of one thread, oldest first; what is kept there goes with the thread."""

    def __del__(self) -> None:
        for place in self:
            place.drop()
