"""Chunks of work over an executor, and the loss of workers."""

from __future__ import annotations

import mmap
import multiprocessing
import os
import signal
import sys
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import closing
from dataclasses import dataclass, field
from functools import lru_cache, partial
from math import prod
from pathlib import Path
from threading import Thread
from typing import Any, Final, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import check_count
from condyn_pin._core.threads import keep_to_one_thread
from condyn_pin.errors import InvalidArgument, WorkersLost

Chunk = TypeVar("Chunk")
Result = TypeVar("Result")
Progress = Callable[[int, int], None]

# Makes the chunk of an index when it is handed out, for the place in flight that it takes.
Send = Callable[[int, int], Chunk]

# Chunks handed to an executor at a time: enough for a hundred workers, and a million states are not
# all copied into its queue.
IN_FLIGHT: Final = 256

# A chunk that was lost this often, or a pool that broke this often without an answer in between:
# it is the work that kills workers, and there is no use in going on. Dask's own limit is the same.
_LOSSES: Final = 3


def silent(done: int, total: int) -> None:
    """Ignore progress."""


def map_chunks(
    work: Callable[[Chunk], Result],
    chunks: Sequence[Chunk],
    *,
    executor: Executor | None = None,
    progress: Progress = silent,
) -> Generator[tuple[int, Result], None, None]:
    """Yield (index of the chunk, result) as results come in, in any order.

    Parameters
    ----------
    work : callable
        Called with one chunk. For processes it has to be picklable, as have chunks and results. It
        may be called again with the same chunk, where a worker was lost.
    chunks : sequence
        What is handed to `work`, one at a time.
    executor : Executor, optional
        Any `concurrent.futures.Executor`: `Processes`, a pool, Dask's ``Client.get_executor()``.
        By default this process does the work, one chunk when its result is asked for.
    progress : callable
        Called with the number of chunks done and that of all, after each.

    Yields
    ------
    tuple of int and result
        Where the chunk is in `chunks`, and what `work` returned for it.

    Raises
    ------
    InvalidArgument
        If `executor` cannot take work.
    WorkersLost
        If workers were lost and the executor cannot go on: a `ProcessPoolExecutor` is of no use
        after the loss of one worker. `Processes` starts new ones, and Dask does: there it is raised
        when the same chunk was lost three times, or three pools without a result in between. And
        if the executor is shut down.
    Exception
        What `work` raises is raised here, and no further chunk is begun.

    Notes
    -----
    If a worker is lost, the chunks that it was working on are handed out again. You may stop
    iterating at any time: chunks that have not begun are cancelled.
    """
    results = in_flight(work, len(chunks), lambda i, _: chunks[i], executor)
    with closing(results):
        for done, found in enumerate(results, start=1):
            progress(done, len(chunks))
            yield found


def in_flight(
    work: Callable[[Chunk], Result],
    count: int,
    send: Send[Chunk],
    executor: Executor | None,
    places: int = IN_FLIGHT,
) -> Generator[tuple[int, Result], None, None]:
    """Yield as `map_chunks` does; `send` makes each chunk when it is submitted."""
    # No more than so many `places` are in flight, and a chunk keeps its place to itself until the
    # result that was yielded for it is asked to be followed by the next.
    if not isinstance(executor, Executor | None):
        raise InvalidArgument(
            f"executor = {executor!r}: a concurrent.futures.Executor is needed, such as "
            "Processes(2), or client.get_executor() of a Dask client"
        )
    if executor is None:
        for i in range(count):
            yield i, work(send(i, 0))
    else:
        yield from _Run(work, count, send, executor, places).results()


@dataclass(frozen=True)
class _Answer(Generic[Result]):
    """Result of `work`, or its exception; any other exception is the executor's."""

    result: Result | None
    error: Exception | None


def _answer(work: Callable[[Chunk], Result], chunk: Chunk) -> _Answer[Result]:
    try:
        return _Answer(work(chunk), None)
    except Exception as error:
        return _Answer(None, error)


class _Run(Generic[Chunk, Result]):
    """One run of chunks over an executor."""

    def __init__(
        self,
        work: Callable[[Chunk], Result],
        count: int,
        send: Send[Chunk],
        executor: Executor,
        places: int,
    ) -> None:
        self._work, self._count, self._send, self._executor = work, count, send, executor
        self._left = deque(range(count))
        self._places = list(range(places))  # those that are free; the last one was used last
        self._flying: dict[Future[_Answer[Result]], tuple[int, int]] = {}
        self._lost: Counter[int] = Counter()
        self._broken: BrokenExecutor | None = None
        self._breakages = 0  # without an answer in between

    def results(self) -> Iterator[tuple[int, Result]]:
        try:
            while self._left or self._flying:
                self._hand_out()
                for future in wait(self._flying, return_when=FIRST_COMPLETED).done:
                    i, place = self._flying.pop(future)
                    self._places.append(place)
                    answer = self._collect(future, i)
                    if answer is None:
                        continue
                    if answer.error is not None:
                        raise answer.error
                    self._breakages = 0
                    yield i, answer.result  # type: ignore[misc]
                if self._broken and not self._flying:
                    self._renew(self._broken)
        finally:
            for future in self._flying:
                future.cancel()

    def _hand_out(self) -> None:
        while self._left and self._places and not self._broken:
            i, place = self._left[0], self._places[-1]
            chunk = self._send(i, place)
            try:
                future = self._executor.submit(_answer, self._work, chunk)
            except BrokenExecutor as error:  # a worker was lost while others are handed work
                self._broken = error
            except RuntimeError as error:
                raise WorkersLost(
                    f"executor = {self._executor!r} takes no work ({error}); {self._unfinished}. "
                    "Work is for inside its `with` block, or for a new executor"
                ) from error
            else:
                self._flying[future] = self._left.popleft(), self._places.pop()

    def _collect(self, future: Future[Any], i: int) -> _Answer[Result] | None:
        """Result of chunk i, or None if it was lost and has to be repeated."""
        try:
            answer: _Answer[Result] = future.result()
        except BrokenExecutor as error:  # every chunk in flight is lost with the pool
            self._broken = error
        except Exception as error:
            self._lost[i] += 1
            if self._lost[i] == _LOSSES:
                raise WorkersLost(
                    f"chunk {i} of {self._count} was lost {_LOSSES} times, the last time "
                    f"with {type(error).__name__}: {error}"
                ) from error
        else:
            return answer
        self._left.append(i)
        return None

    def _renew(self, error: BrokenExecutor) -> None:
        self._breakages += 1
        if isinstance(self._executor, Processes) and not self._executor.began:
            raise WorkersLost(
                f"no worker of {self._executor!r} could begin, and printed why; "
                f"{self._unfinished}. In a script, {GUARD}"
            ) from error
        if not isinstance(self._executor, Processes):
            raise WorkersLost(
                f"a worker of the executor was lost, and a {type(self._executor).__name__} is of "
                f"no use after that; {self._unfinished}. condyn_pin.Processes(2) starts new "
                f"workers by itself. In a script, {GUARD}"
            ) from error
        if self._breakages == _LOSSES:
            raise WorkersLost(
                f"{_LOSSES} pools of workers in a row were lost without a result; "
                f"{self._unfinished}. The work itself kills them, by a crash or by all the memory "
                "it takes"
            ) from error
        self._executor.renew()
        self._broken = None

    @property
    def _unfinished(self) -> str:
        left = len(self._left) + len(self._flying)
        return f"{left} of {self._count} chunks are left"


# Processes: an executor of this machine that outlives its workers.


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
        thread runs in it, for a lock that one holds stays locked in the copy forever. Linear
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
        # keeps its lock forever, from all pools to come
        self._began = self._context.RawValue("b", 0)
        self._pool = self._new()

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers; empty before the first call."""
        return tuple(self._pool._processes or ())

    @property
    def began(self) -> bool:
        """True if any worker has ever started."""
        return bool(self._began.value)

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Future[Result]:
        """Submit a call, as `concurrent.futures.Executor.submit`."""
        typed = not hasattr(sys.modules["__main__"], "__file__")
        if typed and self.start_method != "fork" and getattr(fn, "__module__", "") == "__main__":
            raise InvalidArgument(
                f"fn = {getattr(fn, '__name__', fn)}: a function of a notebook or a prompt, which "
                "worker processes do not have; write it into a module (a .py file), and import it"
            )
        return self._pool.submit(fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop the workers, as `concurrent.futures.Executor.shutdown`."""
        self._pool.shutdown(wait=wait, cancel_futures=cancel_futures)

    def renew(self) -> None:
        """Replace all workers by new ones; calls that they work on are finished or lost."""
        self._pool.shutdown()
        self._pool = self._new()

    def _new(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self.workers, self._context, _initialise_worker, (self._began,))

    def __repr__(self) -> str:
        return f"Processes({self.workers}, start_method={self.start_method!r})"


def _initialise_worker(began: Any) -> None:
    """Initialise a worker: ignore Ctrl-C, which the parent handles; exit when the parent dies."""
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
    """Number of worker processes of a pool at full load."""
    found: int = pool.workers if isinstance(pool, Processes) else vars(pool)["_max_workers"]
    return found


def cores() -> int:
    """Number of cores available to this process."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


# Arrays in memory that the processes of this machine share.
#
# A file without a name, which exists only in memory (Linux's memfd): this process holds it open,
# and others open it by its number, ``/proc/<process>/fd/<number>``. There is no name to be left
# over: the memory is free again when the last array in it is gone, however the processes end.


# Whether this system has such memory. Elsewhere arrays go to processes as pickled copies.
CAN_SHARE: Final = hasattr(os, "memfd_create") and Path("/proc/self/fd").exists()

# Where an array may begin: a line of the cache [bytes].
_ALIGNED: Final = 64


class Kind(NamedTuple):
    """Shape and type of an array."""

    shape: tuple[int, ...]
    dtype: str = "f8"

    @property
    def size(self) -> int:
        """Size in memory, padded to the alignment [bytes]."""
        size = prod(self.shape) * np.dtype(self.dtype).itemsize
        return -(-size // _ALIGNED) * _ALIGNED

    def times(self, count: int) -> Kind:
        """Shape and type of `count` such arrays, stacked."""
        return Kind((count, *self.shape), self.dtype)


Kinds = Mapping[str, Kind]
Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class SharedAddress:
    """Address of shared arrays, for other processes of this machine."""

    path: str
    inode: int  # which file it is: the number in the path is given to others after it is closed
    kinds: Kinds = field(compare=False)

    def open(self) -> Arrays:
        """Return the arrays by name, for reading and writing."""
        # FileNotFoundError if they are gone: the caller no longer waits for the work.
        with Path(self.path).open("r+b") as file:
            if os.fstat(file.fileno()).st_ino != self.inode:
                raise FileNotFoundError(f"{self.path}: it is another file by now")
            return _views(mmap.mmap(file.fileno(), 0), self.kinds)


class SharedArrays:
    """Arrays of zeros that other processes open by `address`.

    OSError if there is obviously not enough memory; as with other arrays, it is taken when it is
    written to. After `close` no other process can open the arrays. They live on where they are
    open, and one file with them, for as long as something refers to them.
    """

    def __init__(self, kinds: Kinds) -> None:
        size = max(sum(kind.size for kind in kinds.values()), 1)
        self._file = os.memfd_create("condyn_pin")
        try:
            os.ftruncate(self._file, size)
            self.arrays = _views(mmap.mmap(self._file, size), kinds)
        except BaseException:
            os.close(self._file)
            raise
        path, inode = f"/proc/{os.getpid()}/fd/{self._file}", os.fstat(self._file).st_ino
        self.address = SharedAddress(path, inode, dict(kinds))

    def close(self) -> None:
        """Close the arrays to processes that have not opened them yet."""
        os.close(self._file)


def _views(memory: mmap.mmap, kinds: Kinds) -> Arrays:
    """Arrays laid out one after the other in shared memory; they keep it alive."""
    arrays, offset = {}, 0
    for name, kind in kinds.items():
        arrays[name] = np.ndarray(kind.shape, kind.dtype, memory, offset)
        offset += kind.size
    return arrays


# Ways of a chunk of rows to a worker and back.
#
# A kernel fills rows of outputs from the same rows of inputs, in one workspace: in the arrays
# themselves, in this process; in memory that the processes of one machine share; in pickled copies,
# anywhere. What a worker cannot reach is copied chunk by chunk, while others are worked on.
#
# Shared memory has room for the chunks that are in flight, not for all: what is touched for the
# first time costs a page fault each 4 kB, in every process, and a place that is used again is still
# in the cache.


# What there is to say of some rows, by their place in the chunk: most have nothing.
Messages = dict[int, str]

# It writes every number of its outputs, where those of another chunk may have been, and returns
# words. To travel to workers it has to pickle: a function of a module, or a partial of one.
Kernel = Callable[[Any, Arrays, Arrays], Messages]


class WorkspaceFactory(Protocol):
    """Source of the workspace of a kernel."""

    def workspace(self) -> Any:
        """Workspace of this thread, made at the first call."""


class WorkspaceSource(WorkspaceFactory, Protocol):
    """Source of the workspace in this process, which can be sent to workers."""

    def pickled(self) -> WorkspaceFactory:
        """Picklable source of the workspace, made once for all chunks."""


class Transport(ABC):
    """Transport of inputs to workers, and of outputs back."""

    work: Callable[[Any], Any]  # what the worker does with what it is sent
    places: int = IN_FLIGHT  # chunks that may be in flight at a time

    @abstractmethod
    def send(self, rows: slice, place: int) -> Any:
        """Message to a worker about some rows; the worker owns the `place` until it is done."""

    @abstractmethod
    def receive(self, rows: slice, found: Any) -> Messages:
        """Write the outputs of a worker into their rows; return its messages."""

    def close(self) -> None:  # noqa: B027 - most ways take nothing
        """Release the resources of the transport."""


class InProcessTransport(Transport):
    """Transport within this process: no data is copied."""

    def __init__(
        self, kernel: Kernel, recipe: WorkspaceFactory, inputs: Arrays, outputs: Arrays
    ) -> None:
        self.work = partial(_fill, kernel, recipe.workspace(), inputs, outputs)

    def send(self, rows: slice, place: int) -> slice:
        """Rows of the arrays, which are in this process."""
        return rows

    def receive(self, rows: slice, found: Messages) -> Messages:
        """Messages of the rows; the outputs are written already."""
        return found


class SharedMemoryTransport(Transport):
    """Transport to processes of this machine in shared memory.

    It has room for so many chunks (`places`) of so many rows (`most`); OSError if there is not.
    """

    def __init__(
        self,
        kernel: Kernel,
        recipe: WorkspaceFactory,
        inputs: Arrays,
        outputs: Arrays,
        *,
        most: int,
        places: int,
    ) -> None:
        self._outputs, self._most, self.places = outputs, most, places
        self._inputs = {name: array for name, array in inputs.items() if array.ndim > 1}
        for_all = inputs.keys() - self._inputs.keys()
        kinds = {
            name: Kind((places * most, *array.shape[1:]), array.dtype.str)
            for name, array in (self._inputs | outputs).items()
        }
        memory = SharedArrays(kinds | {name: Kind(inputs[name].shape) for name in for_all})
        self._memory, self._shared = memory, memory.arrays
        for name in for_all:
            self._shared[name][:] = inputs[name]
        self.work = partial(_in_memory, kernel, recipe, memory.address, tuple(inputs))

    def send(self, rows: slice, place: int) -> slice:
        """Slice of the shared inputs, after copying the rows there."""
        there = slice(place * self._most, place * self._most + rows.stop - rows.start)
        for name, array in self._inputs.items():
            self._shared[name][there] = array[rows]
        return there

    def receive(self, rows: slice, found: tuple[slice, Messages]) -> Messages:
        """Copy the outputs out of shared memory; return the messages."""
        there, words = found
        for name, array in self._outputs.items():
            array[rows] = self._shared[name][there]
        return words

    def close(self) -> None:
        """Close the shared memory to workers that have not opened it yet."""
        self._memory.close()


class PickleTransport(Transport):
    """Transport to workers anywhere, as pickled copies."""

    def __init__(
        self, kernel: Kernel, recipe: WorkspaceFactory, inputs: Arrays, outputs: Arrays
    ) -> None:
        self._inputs, self._outputs = inputs, outputs
        kinds = {name: Kind(array.shape[1:], array.dtype.str) for name, array in outputs.items()}
        self.work = partial(_on_copies, kernel, recipe, kinds)

    def send(self, rows: slice, place: int) -> tuple[int, Arrays]:
        """Number of rows, and their inputs."""
        return rows.stop - rows.start, rows_of(self._inputs, rows)

    def receive(self, rows: slice, found: tuple[Arrays, Messages]) -> Messages:
        """Copy the outputs into their rows; return the messages."""
        arrays, words = found
        for name, array in arrays.items():
            self._outputs[name][rows] = array
        return words


def _in_memory(
    kernel: Kernel,
    recipe: WorkspaceFactory,
    address: SharedAddress,
    names: tuple[str, ...],
    rows: slice,
) -> tuple[slice, Messages]:
    """Rows done by a process that shares memory with its parent; `names` are the inputs."""
    arrays = _shared_arrays_at(address)
    inputs = {name: arrays[name] for name in names}
    outputs = {name: arrays[name] for name in arrays.keys() - inputs.keys()}
    return rows, _fill(kernel, recipe.workspace(), inputs, outputs, rows)


@lru_cache(maxsize=1)
def _shared_arrays_at(address: SharedAddress) -> Arrays:
    """Shared arrays of a batch, kept open from one chunk to the next."""
    return address.open()


def _on_copies(
    kernel: Kernel, recipe: WorkspaceFactory, kinds: Kinds, sent: tuple[int, Arrays]
) -> tuple[Arrays, Messages]:
    """Outputs of rows done by a process anywhere, on copies; `kinds` are those of a row."""
    count, inputs = sent
    whole = {name: kind.times(count) for name, kind in kinds.items()}
    outputs = {name: np.zeros(kind.shape, kind.dtype) for name, kind in whole.items()}
    return outputs, kernel(recipe.workspace(), inputs, outputs)


def _fill(kernel: Kernel, workspace: Any, inputs: Arrays, outputs: Arrays, rows: slice) -> Messages:
    """Run a kernel on some rows."""
    chosen = {name: array[rows] for name, array in outputs.items()}
    return kernel(workspace, rows_of(inputs, rows), chosen)


def rows_of(arrays: Arrays, rows: slice | NDArray[np.intp]) -> Arrays:
    """Inputs of some rows; arrays of one axis are common to all rows."""
    return {name: array if array.ndim == 1 else array[rows] for name, array in arrays.items()}
