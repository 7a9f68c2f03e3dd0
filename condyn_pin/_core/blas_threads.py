"""BLAS threads: one during this library's computations, the user's number at other times.

The matrices of a robot are 10 to 200 wide. The BLAS of numpy and that of scipy share even a 3 x 3
triangle among all cores, and the first thread then waits for the last: microseconds on an idle
machine, a time slice of the system, 4 ms, beside a busy neighbour. The number of threads belongs to
the process, so it is put back when a call returns. Who sets one of `VARIABLES` before Python starts
has decided: then nothing is changed here.
"""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Callable, Sequence
from contextlib import ContextDecorator
from functools import cache
from itertools import product
from typing import Any, Final, TypeVar

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
