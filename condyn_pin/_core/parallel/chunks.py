"""Chunks of work over an executor, and what happens when a worker is lost."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import closing
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from condyn_pin._core.parallel.processes import GUARD, Processes
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
    """Show no progress."""


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
    """Yield as `map_chunks` does, of chunks that `send` makes when they are handed out.

    No more than so many `places` are in flight, and a chunk keeps its place to itself until the
    result that was yielded for it is asked to be followed by the next.
    """
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
    """What `work` returned, or what it raised; all else that is raised is the executor's."""

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
        """Return the answer of chunk i, or None if it was lost and is to be done again."""
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
