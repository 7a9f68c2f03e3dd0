"""Rows of arrays over an executor: the common part of everything that is done to many states."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from math import nan
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import read_only
from condyn_pin._core.parallel.chunks import Progress, in_flight, silent
from condyn_pin._core.parallel.memory import CAN_SHARE, Arrays, Kinds
from condyn_pin._core.parallel.outcome import MISSING
from condyn_pin._core.parallel.processes import Processes, workers_of
from condyn_pin._core.parallel.transports import (
    ByCopies,
    ByMemory,
    InPlace,
    Kernel,
    Recipe,
    Transport,
)
from condyn_pin._core.parameters import check_called, check_count
from condyn_pin.errors import Interrupted, InvalidArgument, WorkersLost

Batch = TypeVar("Batch")

# A chunk is this part of what is left at most, so that several workers end at about the same time;
_SHARES: Final = 16
# but not smaller than this part of a full one, unless all are.
_SMALLER: Final = 5


@dataclass(frozen=True)
class Rows:
    """What is done to the rows of arrays, and by whom.

    Without an executor this process does the work. Workers are handed `chunk` rows at a time; by
    default a sixteenth of what is left, up to `most`, which should take a tenth of a second or
    less. `progress` is called with the number of rows done and that of all.
    """

    kernel: Kernel
    recipe: Recipe
    executor: Executor | None
    chunk: int | None
    most: int
    progress: Progress

    def __post_init__(self) -> None:
        if self.progress is not silent:
            check_called("progress", self.progress, "done, total")
        if self.chunk is not None:
            check_count("chunk", self.chunk)

    def fill(
        self, count: int, inputs: Arrays, kinds: Kinds, batch: Callable[[Arrays], Batch]
    ) -> Batch:
        """Return the `batch` that is made of the outputs, one row per state.

        Inputs with two axes have one row per state; with one, they are the same for all. `kinds`
        says what a row of each output is; one of them is ``statuses``: MISSING where nobody has
        worked on a row, and its floats are NaN. ``words`` has what the kernel said of each row.
        WorkersLost and Interrupted have the batch of what was worked on, as `done` and `table`.
        """
        kinds = {name: kind.times(count) for name, kind in kinds.items()}
        outputs = {name: np.zeros(kind.shape, kind.dtype) for name, kind in kinds.items()}
        words, chunks = np.full(count, "", object), self._chunks(count)
        done = np.zeros(count, bool)

        def found() -> Batch:
            return batch(_sealed(outputs | {"words": words}, done))

        try:
            with closing(self._transport(inputs, outputs, chunks)) as transport:
                self._drain(chunks, transport, words, done)
        except WorkersLost as lost:
            lost.done = found()
            raise
        except KeyboardInterrupt as stop:
            raise Interrupted(found()) from stop
        return found()

    def _transport(self, inputs: Arrays, outputs: Arrays, chunks: list[slice]) -> Transport:
        """Return the transport to whoever does the work."""
        if self.executor is None:
            return InPlace(self.kernel, self.recipe, inputs, outputs)
        recipe = self.recipe.pickled()
        if not isinstance(self.executor, ProcessPoolExecutor | Processes):
            return ByCopies(self.kernel, recipe, inputs, outputs)
        self._check_travels()
        if CAN_SHARE:
            try:
                return ByMemory(
                    self.kernel, recipe, inputs, outputs,
                    most=max((rows.stop - rows.start for rows in chunks), default=0),
                    places=min(2 * workers_of(self.executor) + 1, len(chunks)),
                )  # fmt: skip
            except OSError:  # not so much memory at once: copies, then
                pass
        return ByCopies(self.kernel, recipe, inputs, outputs)

    def _check_travels(self) -> None:
        """Refuse what cannot be sent to a process: its chunks would only be called lost."""
        try:
            pickle.dumps(self.kernel)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InvalidArgument(
                f"executor = {self.executor!r}: its processes need what pickles, such as torques "
                f"that are a function of a module, no lambda ({error})"
            ) from error

    def _chunks(self, count: int) -> list[slice]:
        """Return the rows of each chunk: the last ones few, as all wait for the last one."""
        chunks, start = [], 0
        least = min(_part(count, _SHARES), _part(self.most, _SMALLER))
        while start < count:
            share = min(self.most, max(least, _part(count - start, _SHARES)))
            stop = min(start + (self.chunk or share), count)
            chunks.append(slice(start, stop))
            start = stop
        return chunks

    def _drain(
        self,
        chunks: list[slice],
        transport: Transport,
        words: NDArray[Any],
        done: NDArray[np.bool_],
    ) -> None:
        """Have all chunks done; put down what is said of rows, and which of them are done."""
        results = in_flight(
            transport.work, len(chunks), lambda i, place: transport.send(chunks[i], place),
            self.executor, transport.places,
        )  # fmt: skip
        with closing(results):  # an interrupt cancels what has not begun
            for i, found in results:
                for k, text in transport.receive(chunks[i], found).items():
                    words[chunks[i].start + k] = text
                done[chunks[i]] = True
                self.progress(int(np.count_nonzero(done)), len(done))


def _sealed(outputs: Arrays, done: NDArray[np.bool_]) -> Arrays:
    """Return the outputs, NaN where they are missing, and read-only."""
    some_missing = not done.all()
    outputs["statuses"][~done] = MISSING
    for array in outputs.values():
        if some_missing and array.dtype.kind == "f":
            array[~done] = nan
        read_only(array)
    return outputs


def _part(rows: int, of: int) -> int:
    return -(-rows // of)
