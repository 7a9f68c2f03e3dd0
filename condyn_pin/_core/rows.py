"""Rows of batches over an executor, and the status of each row.

Rows of arrays over an executor: the common part of everything that is done to many states.
"""

from __future__ import annotations

import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from enum import Enum
from math import nan
from typing import Any, ClassVar, Final, Generic, Self, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import check_called, check_count
from condyn_pin._core.arrays import read_only
from condyn_pin._core.compiled import compiled
from condyn_pin._core.show import facts, notes, page
from condyn_pin._core.work import (
    CAN_SHARE,
    Arrays,
    InPlace,
    Kernel,
    Kinds,
    PickleTransport,
    Processes,
    Progress,
    Recipe,
    SharedMemoryTransport,
    Transport,
    cores,
    in_flight,
    silent,
    workers_of,
)
from condyn_pin.errors import Interrupted, InvalidArgument, WorkersLost

SomeBatch = TypeVar("SomeBatch")

# A chunk is this part of what is left at most, so that several workers end at about the same time;
_SHARES: Final = 16
# but not smaller than this part of a full one, unless all are.
_SMALLER: Final = 5


@dataclass(frozen=True)
class Rows:
    """Work on the rows of batch arrays: kernel, executor and chunk size.

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
        self, count: int, inputs: Arrays, kinds: Kinds, batch: Callable[[Arrays], SomeBatch]
    ) -> SomeBatch:
        """Fill the outputs, one row per state, and return the `batch` that is made of them.

        Inputs with two axes have one row per state; with one, they are the same for all. `kinds`
        says what a row of each output is; one of them is ``statuses``: MISSING where nobody has
        worked on a row, and its floats are NaN. ``words`` has what the kernel said of each row.
        WorkersLost and Interrupted have the batch of what was worked on, as `done` and `table`.
        """
        kinds = {name: kind.times(count) for name, kind in kinds.items()}
        outputs = {name: np.zeros(kind.shape, kind.dtype) for name, kind in kinds.items()}
        words, chunks = np.full(count, "", object), self._chunks(count)
        done = np.zeros(count, bool)

        def found() -> SomeBatch:
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
        """Transport to the workers of the executor, or within this process."""
        if self.executor is None:
            return InPlace(self.kernel, self.recipe, inputs, outputs)
        recipe = self.recipe.pickled()
        if not isinstance(self.executor, ProcessPoolExecutor | Processes):
            return PickleTransport(self.kernel, recipe, inputs, outputs)
        try:
            pickle.dumps(self.kernel)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InvalidArgument(
                f"executor = {self.executor!r}: its processes need what pickles, such as torques "
                f"that are a function of a module, no lambda ({error})"
            ) from error
        if CAN_SHARE:
            try:
                return SharedMemoryTransport(
                    self.kernel, recipe, inputs, outputs,
                    most=max((rows.stop - rows.start for rows in chunks), default=0),
                    places=min(2 * workers_of(self.executor) + 1, len(chunks)),
                )  # fmt: skip
            except OSError:  # not so much memory at once: copies, then
                pass
        return PickleTransport(self.kernel, recipe, inputs, outputs)

    def _chunks(self, count: int) -> list[slice]:
        """Rows of each chunk; the last chunks are small, so that workers finish together."""
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
        """Run all chunks; collect the messages of rows, and flags of the rows that are done."""
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
    """Outputs made read-only, with NaN in missing rows."""
    some_missing = not done.all()
    outputs["statuses"][~done] = MISSING
    for array in outputs.values():
        if some_missing and array.dtype.kind == "f":
            array[~done] = nan
        read_only(array)
    return outputs


def _part(rows: int, of: int) -> int:
    return -(-rows // of)


# Batches: many answers, a row each, and how each of them ended.


# The status of a row that was not worked on.
MISSING: Final = -1

_SHOWN: Final = 10

One = TypeVar("One")
Some = slice | list[int] | NDArray[Any]  # of the rows, as NumPy takes them


class Batch(ABC, Generic[One]):
    """Sequence of solutions: ``batch[i]`` is one, ``batch[2:4]`` a batch of some."""

    @abstractmethod
    def __len__(self) -> int:
        """Number of rows."""

    @abstractmethod
    def _one(self, i: int) -> One:
        """Solution of one row."""

    @abstractmethod
    def _some(self, rows: Some) -> Self:
        """Batch of some rows."""

    @overload
    def __getitem__(self, i: int | np.integer[Any]) -> One: ...

    @overload
    def __getitem__(self, i: Some) -> Self: ...

    def __getitem__(self, i: int | np.integer[Any] | Some) -> One | Self:
        if isinstance(i, slice | list | np.ndarray):
            return self._some(i)
        return self._one(range(len(self))[i])

    def __iter__(self) -> Iterator[One]:
        return (self[i] for i in range(len(self)))


class BatchResult:
    """Statuses of the rows of a batch, as indices into `_endings`; 0 is ok."""

    _endings: ClassVar[Sequence[Enum]]

    statuses: NDArray[np.int8]

    @property
    def ok(self) -> bool:
        """True if every status is ok."""
        return not self.statuses.any()

    @property
    def failed(self) -> NDArray[np.intp]:
        """Indices of the rows whose status is not ok, the missing ones among them."""
        return np.flatnonzero(self.statuses)

    @property
    def missing(self) -> NDArray[np.intp]:
        """Indices of rows that were never computed: after a `WorkersLost` or an `Interrupted`."""
        return np.flatnonzero(self.statuses == MISSING)

    @property
    def counts(self) -> dict[str, int]:
        """Number of rows of each status, by its name; statuses without rows are left out."""
        found = {name: int((self.statuses == i).sum()) for i, name in self._names.items()}
        return {name: number for name, number in found.items() if number}

    @property
    def status_names(self) -> list[str]:
        """The status of each row, by its name."""
        return [self._names[i] for i in self.statuses.tolist()]

    @property
    def _names(self) -> dict[int, str]:
        return {MISSING: "missing"} | {i: s.name.lower() for i, s in enumerate(self._endings)}

    def _repr_html_(self) -> str:
        """HTML summary for notebooks."""
        bad = self._not_ok()
        title, *lines = [line for line in str(self).splitlines() if line not in bad]
        return page(title, notes(bad), facts(map(_in_two, lines)), ok=self.ok)

    def _counted(self) -> str:
        """Counts of the statuses as text."""
        return ", ".join(f"{number} {name}" for name, number in self.counts.items()) or "none"

    def _not_ok(self) -> list[str]:
        """Line for each status but ok: its first few rows, and its meaning."""
        texts = {MISSING: "missing: no worker got to it"}
        texts |= {i: str(ending) for i, ending in enumerate(self._endings)}
        lines = []
        for code in dict.fromkeys(self.statuses[self.failed].tolist()):
            rows = np.flatnonzero(self.statuses == code).tolist()
            some = ", ".join(map(self._named, rows[:_SHOWN]))
            lines.append(f"not ok: {some}{', ...' if rows[_SHOWN:] else ''} ({texts[code]})")
        return lines

    def _named(self, i: int) -> str:
        """Name of a row."""
        return str(i)


def _in_two(line: str) -> tuple[str, str]:
    """Label and text of a line of a summary."""
    label, gap, text = line.partition("  ")
    if not gap:  # a label that fills its column
        label, _, text = line.partition(" ")
    return label, text.strip()


# Native: who does the work in compiled code.


_MOST = 1000  # threads


@dataclass(frozen=True)
class Native:
    """The compiled core, as ``executor=`` of all batch verbs.

    It returns what Python would return. States whose check leaves a doubt, such as those near
    singular postures, are passed to Python.

    Parameters
    ----------
    threads : int, optional
        As many as there are cores for this process by default. They work at the same time: the
        core does not hold the GIL.
    executor : Executor, optional
        Whose workers use the core, each with so many threads: `Processes`, or Dask's
        ``client.get_executor()``. This process by default.
    where_possible : bool
        What the core does not take, such as torques that are a function, raises
        `UnsupportedBackend` by default; with True Python does that, and everything where no core is
        installed.

    Raises
    ------
    MissingExtra
        If the core is not installed, unless `where_possible`.

    Notes
    -----
    ``pip install ./native`` builds it (`docs/how-to-run-at-scale.md`).
    """

    threads: int | None = None
    executor: Executor | None = None
    where_possible: bool = False

    def __post_init__(self) -> None:
        if self.threads is not None:
            check_count("threads", self.threads, most=_MOST)
        if not isinstance(self.executor, Executor | None):
            raise InvalidArgument(
                f"executor = {self.executor!r}: a concurrent.futures.Executor is needed, such as "
                "Processes(2), or client.get_executor() of a Dask client"
            )
        if not isinstance(self.where_possible, bool):
            raise InvalidArgument(f"where_possible = {self.where_possible!r}: True or False")
        if not self.where_possible:
            compiled()

    @property
    def at_work(self) -> int:
        """Number of threads."""
        return cores() if self.threads is None else self.threads
