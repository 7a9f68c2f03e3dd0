"""Processes: an executor of this machine that outlives its workers."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from threading import Thread
from typing import Any, Final, TypeVar

from condyn_pin._core.blas_threads import keep_to_one_thread
from condyn_pin._core.parameters import check_count
from condyn_pin.errors import InvalidArgument, WorkersLost

Result = TypeVar("Result")

GUARD = (
    "every worker imports the main script, and may not do its work again: put what it does into "
    'main(), and call that inside `if __name__ == "__main__":`'
)
_MOST: Final = 1000  # processes


class Processes(Executor):
    """Worker processes on this machine; lost ones are replaced.

    Parameters
    ----------
    workers : int, optional
        As many as there are cores for this process by default.
    start_method : {"spawn", "forkserver", "fork"}
        How a process begins. ``spawn`` starts Python anew, in about a second, and is safe
        everywhere. ``fork`` copies this process as it stands: faster, and safe only while no other
        thread runs in it, for a lock that one holds stays locked in the copy for ever. Linear
        algebra, Dask and notebooks have such threads.

    Notes
    -----
    Use it in a ``with`` block, or call `shutdown`. With ``spawn`` and ``forkserver`` a script needs
    ``if __name__ == "__main__":`` around its work, because every worker imports it. Each worker
    uses one BLAS thread, unless the environment says otherwise: workers that each use all cores
    slow each other down. A `ProcessPoolExecutor` is broken once a worker was killed; this class
    starts another worker.

    Raises
    ------
    InvalidArgument
        If the number of workers is not positive, or the start method unknown.
    WorkersLost
        If a worker gets here while it imports the main script: it has no such guard.
    """

    def __init__(self, workers: int | None = None, *, start_method: str = "spawn") -> None:
        if getattr(multiprocessing.current_process(), "_inheriting", False):
            raise WorkersLost(f"a worker would start workers of its own; {GUARD}")
        count = cores() if workers is None else workers
        check_count("workers", count, most=_MOST)
        known = multiprocessing.get_all_start_methods()
        if start_method not in known:
            raise InvalidArgument(
                f"start_method = {start_method!r}: one of {', '.join(known)} is needed"
            )
        self.workers, self.start_method = count, start_method
        self._context = multiprocessing.get_context(start_method)
        # no Event: a pool that breaks terminates its workers, and one that is just setting an Event
        # keeps its lock for ever, from all pools to come
        self._began = self._context.RawValue("b", 0)
        self._pool = self._new()

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers; there are none before the first call."""
        return tuple(self._pool._processes or ())

    @property
    def began(self) -> bool:
        """Whether any worker has ever come so far that it could work."""
        return bool(self._began.value)

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Future[Result]:
        """Hand out a call, as `concurrent.futures.Executor.submit`."""
        self._check_found(fn)
        return self._pool.submit(fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers, as `concurrent.futures.Executor.shutdown`."""
        self._pool.shutdown(wait=wait, cancel_futures=cancel_futures)

    def renew(self) -> None:
        """Replace all workers by new ones; calls that they work on are finished or lost."""
        self._pool.shutdown()
        self._pool = self._new()

    def _check_found(self, fn: Callable[..., object]) -> None:
        """Refuse a function that a worker would not find: it breaks the pool, and says not why."""
        typed = not hasattr(sys.modules["__main__"], "__file__")
        if typed and self.start_method != "fork" and getattr(fn, "__module__", "") == "__main__":
            raise InvalidArgument(
                f"fn = {getattr(fn, '__name__', fn)}: a function of a notebook or a prompt, which "
                "worker processes do not have; write it into a module (a .py file), and import it"
            )

    def _new(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self.workers, self._context, _begin, (self._began,))

    def __repr__(self) -> str:
        return f"Processes({self.workers}, start_method={self.start_method!r})"


def _begin(began: Any) -> None:
    """Leave Ctrl-C, which a terminal sends to all, to the parent; end when the parent is killed."""
    began.value = 1
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # a pool waits for the workers that it terminates: none may have a fork's handler of its parent
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    keep_to_one_thread()  # other workers have the other cores
    Thread(target=_end_with_the_parent, daemon=True).start()


def _end_with_the_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def workers_of(pool: Processes | ProcessPoolExecutor) -> int:
    """Return how many processes a pool has when all of them have work."""
    found: int = pool.workers if isinstance(pool, Processes) else vars(pool)["_max_workers"]
    return found


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
