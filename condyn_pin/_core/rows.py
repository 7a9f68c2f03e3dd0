"""Rows of batches over an executor, and the status of each row.

Rows of arrays over an executor: the common part of everything that is done to many states.
"""

from __future__ import annotations

import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from math import nan
from typing import Any, ClassVar, Final, Generic, Self, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import check_called, check_count, check_type
from condyn_pin._core.arrays import read_only
from condyn_pin._core.compiled import compiled, is_compiled, refuse
from condyn_pin._core.show import Outcome, facts, notes, page
from condyn_pin._core.work import (
    CAN_SHARE,
    Arrays,
    InProcessTransport,
    Kernel,
    Kinds,
    Messages,
    PickleTransport,
    Processes,
    Progress,
    SharedMemoryTransport,
    Transport,
    WorkspaceSource,
    cores,
    in_flight,
    rows_of,
    silent,
    workers_of,
)
from condyn_pin.errors import (
    Interrupted,
    InvalidArgument,
    MissingExtra,
    UnsupportedBackend,
    WorkersLost,
)

SomeBatch = TypeVar("SomeBatch")

# A chunk is this part of what is left at most, so that several workers end at about the same time;
_SHARES: Final = 16
# but not smaller than this part of a full one, unless all are.
_SMALLER: Final = 5


class RowWork(ABC):
    """Work on the rows of a batch, by Python and by the compiled core; it pickles.

    Inputs with two axes have one row per state; with one, they are the same for all.
    """

    # rows that a worker is handed at a time, at most: a tenth of a second of work, or less
    most: int = 1000
    # rows that a thread of the compiled core is handed at a time in this process
    most_of_core: int = 2000

    @abstractmethod
    def row(self, workspace: Any, inputs: Arrays, outputs: Arrays) -> str:
        """Fill the outputs of one row, NaN and 0 until then; return what there is to say of it."""

    @abstractmethod
    def core(
        self, workspace: Any, inputs: Arrays, outputs: Arrays, threads: int
    ) -> tuple[NDArray[np.intp], Messages]:
        """Fill the outputs of many rows by the compiled core."""
        # Return the rows that are left to Python, and what there is to say of others.

    @abstractmethod
    def why_not(self, workspace: Any) -> Iterator[str]:
        """Yield the reasons why the compiled core cannot do this work, in words."""

    def __call__(self, workspace: Any, inputs: Arrays, outputs: Arrays) -> Messages:
        """Fill the outputs row by row; return what there is to say of some."""
        said = {}
        for array in outputs.values():
            array[...] = nan if array.dtype.kind == "f" else 0
        for i in range(len(outputs["statuses"])):
            here = {name: x if x.ndim == 1 else x[i] for name, x in inputs.items()}
            said[i] = self.row(workspace, here, {name: x[i, ...] for name, x in outputs.items()})
        return {i: text for i, text in said.items() if text}


@dataclass(frozen=True)
class _Compiled:
    """Kernel of a verb in the compiled core; the rows that it leaves are Python's."""

    verb: RowWork
    threads: int

    def __call__(self, workspace: Any, inputs: Arrays, outputs: Arrays) -> Messages:
        left, said = self.verb.core(workspace, inputs, outputs, self.threads)
        if not left.size:
            return said
        found = {name: x[left] for name, x in outputs.items()}
        words = self.verb(workspace, rows_of(inputs, left), found)
        for name, x in found.items():
            outputs[name][left] = x
        return said | {int(left[i]): text for i, text in words.items()}


def run(
    verb: RowWork, recipe: WorkspaceSource, inputs: Arrays, kinds: Kinds,
    batch: Callable[[Arrays], SomeBatch], *,
    executor: Executor | Native | None, chunk: int | None, progress: Progress,
) -> SomeBatch:  # fmt: skip
    """Return the `batch` that is made of the outputs of a verb, one row per state."""
    # The first of the `inputs` has a row per state. `kinds` are shape and type of a row of each
    # output. One is ``statuses``: MISSING where nobody has worked on a row, and its floats are NaN.
    # ``words`` is what the verb has said of each. `executor`, `chunk` and `progress` are as the
    # user gave them: this process by default, where the core does what it can on one thread, and a
    # sixteenth of what is left, up to ``verb.most`` rows. UnsupportedBackend or MissingExtra where
    # a core that was named cannot do the work; WorkersLost or Interrupted with the batch of what
    # was worked on, as `done` and `table`.
    kernel: Kernel = verb
    if executor is None and is_compiled("auto"):
        executor = Native(threads=1, where_possible=True)
    if isinstance(executor, Native):
        kernel, executor, chunk = _by_core(executor, verb, chunk, recipe)
    if progress is not silent:
        check_called("progress", progress, "done, total")
    if chunk is not None:
        check_count("chunk", chunk)
    count = len(next(iter(inputs.values())))
    kinds = {name: kind.times(count) for name, kind in kinds.items()}
    outputs = {name: np.zeros(kind.shape, kind.dtype) for name, kind in kinds.items()}
    words, done = np.full(count, "", object), np.zeros(count, bool)
    chunks = chunks_of(count, chunk, verb.most)

    def found() -> SomeBatch:
        return batch(_read_only_outputs(outputs | {"words": words}, done))

    try:
        with closing(_transport(kernel, recipe, inputs, outputs, executor, chunks)) as transport:
            results = in_flight(
                transport.work, len(chunks), lambda i, place: transport.send(chunks[i], place),
                executor, transport.places,
            )  # fmt: skip
            with closing(results):  # an interrupt cancels what has not begun
                for i, answer in results:
                    for k, text in transport.receive(chunks[i], answer).items():
                        words[chunks[i].start + k] = text
                    done[chunks[i]] = True
                    progress(int(np.count_nonzero(done)), count)
    except WorkersLost as lost:
        lost.done = found()
        raise
    except KeyboardInterrupt as stop:
        raise Interrupted(found()) from stop
    return found()


def _by_core(
    native: Native, verb: RowWork, chunk: int | None, recipe: WorkspaceSource
) -> tuple[Kernel, Executor | None, int | None]:
    """Kernel, executor and chunk size of a verb: the core, or Python where that may be."""
    try:
        compiled()
        refuse(verb.why_not(recipe.workspace()))
    except (UnsupportedBackend, MissingExtra):
        if not native.where_possible:
            raise
        return verb, native.executor, chunk
    if native.executor is None and chunk is None:
        chunk = verb.most_of_core * native.at_work
    return _Compiled(verb, native.at_work), native.executor, chunk


def chunks_of(count: int, chunk: int | None, most: int) -> list[slice]:
    """Rows of each chunk; the last chunks are small, so that workers finish together."""
    chunks, start = [], 0
    least = min(_part(count, _SHARES), _part(most, _SMALLER))
    while start < count:
        share = min(most, max(least, _part(count - start, _SHARES)))
        stop = min(start + (chunk or share), count)
        chunks.append(slice(start, stop))
        start = stop
    return chunks


def _transport(
    kernel: Kernel, recipe: WorkspaceSource, inputs: Arrays, outputs: Arrays,
    executor: Executor | None, chunks: list[slice],
) -> Transport:  # fmt: skip
    """Transport to the workers of the executor, or within this process."""
    if executor is None:
        return InProcessTransport(kernel, recipe, inputs, outputs)
    made = recipe.pickled()
    if not isinstance(executor, ProcessPoolExecutor | Processes):
        return PickleTransport(kernel, made, inputs, outputs)
    try:
        pickle.dumps(kernel)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InvalidArgument(
            f"executor = {executor!r}: its processes need what pickles, such as torques "
            f"that are a function of a module, no lambda ({error})"
        ) from error
    if CAN_SHARE:
        try:
            return SharedMemoryTransport(
                kernel, made, inputs, outputs,
                most=max((rows.stop - rows.start for rows in chunks), default=0),
                places=min(2 * workers_of(executor) + 1, len(chunks)),
            )  # fmt: skip
        except OSError:  # not so much memory at once: copies, then
            pass
    return PickleTransport(kernel, made, inputs, outputs)


def _read_only_outputs(outputs: Arrays, done: NDArray[np.bool_]) -> Arrays:
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
    """Sequence of solutions: ``batch[i]`` is one, ``batch[2:4]`` a batch of some.

    `_rows` names the fields with one row per state: arrays, and batches.
    """

    _rows: ClassVar[tuple[str, ...]]

    def __len__(self) -> int:
        return len(getattr(self, self._rows[0]))

    @abstractmethod
    def _one(self, i: int) -> One:
        """Solution of one row."""

    def _some(self, rows: Some) -> Self:
        """Batch of some rows."""
        some = {name: getattr(self, name)[rows] for name in self._rows}
        read_only(tuple(x for x in some.values() if isinstance(x, np.ndarray)))
        return replace(self, **some)  # type: ignore[type-var]

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

    def _check_found(self, i: int, statuses: NDArray[np.int8], row: str = "state") -> None:
        """Raise WorkersLost if nobody has worked on a row."""
        if statuses[i] == MISSING:
            raise WorkersLost(f"no worker got to {row} {i}; `missing` has all of them", self)


class BatchResult(Batch[One]):
    """Statuses of the rows of a batch, as indices into `_endings`; 0 is ok."""

    _endings: ClassVar[Sequence[Outcome]]
    _row: ClassVar[str] = "state"

    statuses: NDArray[np.int8]
    scene: Any
    seconds: float  # [s]

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
        return {MISSING: "missing"} | {i: s.word for i, s in enumerate(self._endings)}

    def _repr_html_(self) -> str:
        """HTML summary for notebooks."""
        bad = self._not_ok()
        title, *lines = [line for line in str(self).splitlines() if line not in bad]
        return page(title, notes(bad), facts(map(_in_two, lines)), ok=self.ok)

    def _counted(self) -> str:
        """Name of the robot, and counts of the statuses."""
        counts = ", ".join(f"{number} {name}" for name, number in self.counts.items()) or "none"
        return f"{self.scene.robot.name}, {len(self)} {self._row}s: {counts}"

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._counted()})"

    def __str__(self) -> str:
        return "\n".join((f"{self._counted()}, {self._how()}", *self._worst(), *self._not_ok()))

    def _how(self) -> str:
        """How the work was done."""
        return f"in {self.seconds:.3g} s"

    @abstractmethod
    def _worst(self) -> list[str]:
        """Lines with the largest errors."""

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
        check_type("where_possible", self.where_possible, bool, "True or False")
        if not self.where_possible:
            compiled()

    @property
    def at_work(self) -> int:
        """Number of threads."""
        return cores() if self.threads is None else self.threads
