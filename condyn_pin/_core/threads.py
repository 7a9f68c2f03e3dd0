"""Threads: one for BLAS within this library, one for a workspace at a time, and caches of each.

The matrices of a robot are 10 to 200 wide. The BLAS of numpy and that of scipy share even a 3 x 3
triangle among all cores, and the first thread then waits for the last: microseconds on an idle
machine, a time slice of the system, 4 ms, beside a busy neighbour. The number of threads belongs to
the process, so it is put back when a call returns. Who sets one of `VARIABLES` before Python starts
has decided: then nothing is changed here.

One thread at a time: memory that threads share by mistake gives each the numbers of the other.

The mark of the thread at work is read and written without a call in between, where Python neither
switches threads nor raises KeyboardInterrupt; a lock would be left taken by a Ctrl-C.
"""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Callable, Sequence
from contextlib import ContextDecorator
from dataclasses import dataclass
from functools import cache, wraps
from itertools import product
from threading import get_ident
from typing import Any, Concatenate, Final, Generic, ParamSpec, TypeVar
from weakref import ref

from condyn_pin.errors import SharedWorkspace

VARIABLES: Final = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "GOTO_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)

_BY_US = "one inside condyn_pin, one for each core elsewhere"

# How many threads a library has, and to set it.
_Get = Callable[[], int]
_Set = Callable[[int], object]

_Function = TypeVar("_Function", bound=Callable[..., Any])


def _set_to() -> str:
    return next((f"{name}={value}" for name in VARIABLES if (value := os.environ.get(name))), "")


class _OneThread(threading.local, ContextDecorator):
    """Reentrant context and decorator that limits BLAS to one thread.

    Each Python thread puts back what it has changed, and that is never from 1: where several are
    inside, one that leaves early lets the others go on with more threads, and none is left with 1.
    """

    _depth = 0
    _before: Sequence[tuple[_Set, int]] = ()

    def __enter__(self) -> None:
        self._depth += 1
        if self._depth > 1 or decided():
            return
        before = []
        for get, put in _libraries():
            n = get()
            if n > 1:
                put(1)
                before.append((put, n))
        self._before = before

    def __call__(self, function: _Function) -> _Function:
        # nothing is to be changed: a call more would only take time
        return function if _set_to() else super().__call__(function)

    def __exit__(self, *_: object) -> None:
        self._depth -= 1
        if not self._depth:
            for put, n in self._before:
                put(n)


one_blas_thread = _OneThread()


@cache
def decided() -> str:
    """User's setting of the BLAS threads, such as ``OMP_NUM_THREADS=4``, or empty."""
    # The command line reads it first, and sets it then.
    return _set_to()


def blas_controllers() -> tuple[Any, ...]:
    """Return threadpoolctl's controllers of the BLAS of numpy and of scipy."""
    # imported here: scipy.linalg takes as long to import as Pinocchio
    import scipy.linalg  # noqa: F401  brings a BLAS of its own
    from threadpoolctl import ThreadpoolController

    return tuple(ThreadpoolController().select(user_api="blas").lib_controllers)


def blas_features() -> dict[str, str]:
    """BLAS libraries that are loaded, and their threads, for `condyn doctor`."""
    found = {
        f"{each.internal_api} {each.version} for {each.architecture}" for each in blas_controllers()
    }
    set_to = f"as you set it, {decided()}" if decided() else _BY_US
    return {"BLAS": ", ".join(sorted(found)), "BLAS threads": set_to}


def keep_to_one_thread() -> None:
    """Limit BLAS to one thread in a worker process, unless the user has set a number."""
    if not decided():
        for _, put in _libraries():
            put(1)


@cache
def _libraries() -> tuple[tuple[_Get, _Set], ...]:
    return tuple(_functions(library) for library in blas_controllers())


def _functions(library: Any) -> tuple[_Get, _Set]:
    if getattr(library, "threading_layer", "") == "pthreads":
        # OpenBLAS itself: through threadpoolctl only one thread of Python may set the number
        blas = ctypes.PyDLL(library.filepath)
        for before, after in product(("", "scipy_"), ("", "64_", "_64")):
            names = (f"{before}openblas_{verb}_num_threads{after}" for verb in ("get", "set"))
            found = [getattr(blas, name) for name in names if hasattr(blas, name)]
            if len(found) == 2:
                return found[0], found[1]
    return library.get_num_threads, library.set_num_threads


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
        places: _CacheKeys | None = getattr(self._of_thread, "places", None)
        if places is None:
            self._of_thread.places = places = _CacheKeys()
        for place in reversed(places):
            if place.owner() is owner and place.arguments == arguments:
                if place is not places[-1]:
                    places.remove(place)
                    places.append(place)
                return place.content  # type: ignore[no-any-return]
        made = make()
        places[:] = [place for place in places if place.owner()]
        places.append(_CacheKey(ref(owner), arguments))
        places[-1].keep(made)
        for place in places[: -self._most]:
            place.drop()
        del places[: -self._most]
        return made


@dataclass(eq=False)
class _CacheKey:
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


class _CacheKeys(list[_CacheKey]):
    """Cache keys of one thread, oldest first; their objects are dropped when the thread ends."""

    def __del__(self) -> None:
        for place in self:
            place.drop()
