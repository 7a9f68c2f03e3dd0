"""Ways of a chunk of rows to a worker and back.

A kernel fills rows of outputs from the same rows of inputs, in one workspace: in the arrays
themselves, in this process; in memory that the processes of one machine share; in pickled copies,
anywhere. What a worker cannot reach is copied chunk by chunk, while others are worked on.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from condyn_pin.batch.memory import Address, Arrays, Kind, Kinds, SharedArrays
from condyn_pin.batch.recipe import Recipe
from condyn_pin.workspace import Workspace

# To travel to workers it has to pickle: a function of a module, or a partial of one.
Kernel = Callable[[Workspace, Arrays, Arrays], None]


class Way(ABC):
    """What a worker is sent, does, and sends back.

    Attributes
    ----------
    work : callable
        What the worker does with what it is sent.
    """

    work: Callable[[Any], Arrays | None]

    @abstractmethod
    def send(self, rows: slice) -> Any:
        """Return what the worker needs for some rows."""

    @abstractmethod
    def receive(self, rows: slice, found: Arrays | None) -> None:
        """Put into the outputs what the worker found."""


class InPlace(Way):
    """In this process: there is nothing to send."""

    def __init__(
        self, kernel: Kernel, workspace: Workspace, inputs: Arrays, outputs: Arrays
    ) -> None:
        self.work = partial(_fill, kernel, lambda: workspace, inputs, outputs)

    def send(self, rows: slice) -> slice:
        """Return the rows: the arrays are here."""
        return rows

    def receive(self, rows: slice, found: Arrays | None) -> None:
        """Do nothing: the outputs are filled."""


class ByMemory(Way):
    """To processes of this machine, in memory that they share with this one."""

    def __init__(
        self, kernel: Kernel, recipe: Recipe, inputs: Arrays, outputs: Arrays, shared: SharedArrays
    ) -> None:
        self._inputs, self._outputs, self._shared = inputs, outputs, shared.arrays
        self._for_all = {name for name, array in inputs.items() if array.ndim == 1}
        for name in self._for_all:
            self._shared[name][:] = inputs[name]
        self.work = _InMemory(kernel, recipe, shared.address, tuple(inputs))

    def send(self, rows: slice) -> slice:
        """Return the rows, whose inputs are in shared memory now."""
        for name in self._inputs.keys() - self._for_all:
            self._shared[name][rows] = self._inputs[name][rows]
        return rows

    def receive(self, rows: slice, found: Arrays | None) -> None:
        """Copy out of shared memory, which would hold a file open as long as the answer lives."""
        for name, array in self._outputs.items():
            array[rows] = self._shared[name][rows]


class ByCopies(Way):
    """To workers anywhere, as pickled copies."""

    def __init__(self, kernel: Kernel, recipe: Recipe, inputs: Arrays, outputs: Arrays) -> None:
        self._inputs, self._outputs = inputs, outputs
        kinds = {name: Kind(array.shape[1:], array.dtype.str) for name, array in outputs.items()}
        self.work = _OnCopies(kernel, recipe, kinds)

    def send(self, rows: slice) -> tuple[int, Arrays]:
        """Return the number of rows and their inputs."""
        return rows.stop - rows.start, _inputs_of(self._inputs, rows)

    def receive(self, rows: slice, found: Arrays | None) -> None:
        """Put the copies into their place."""
        for name, array in (found or {}).items():
            self._outputs[name][rows] = array


class Sent(Sequence[Any]):
    """What is sent for each chunk, made when the chunk is handed out."""

    def __init__(self, way: Way, chunks: list[slice]) -> None:
        self._way, self._chunks = way, chunks

    def __len__(self) -> int:
        return len(self._chunks)

    def __getitem__(self, i: Any) -> Any:
        return self._way.send(self._chunks[i])


@dataclass(frozen=True)
class _InMemory:
    """The work of a process that shares memory with the one that asks for it."""

    kernel: Kernel
    recipe: Recipe
    address: Address
    inputs: tuple[str, ...]

    def __call__(self, rows: slice) -> None:
        outputs = self.address.open()
        inputs = {name: outputs.pop(name) for name in self.inputs}
        _fill(self.kernel, self.recipe.workspace, inputs, outputs, rows)


@dataclass(frozen=True)
class _OnCopies:
    """The work of a worker anywhere."""

    kernel: Kernel
    recipe: Recipe
    kinds: Kinds  # of a row

    def __call__(self, sent: tuple[int, Arrays]) -> Arrays:
        count, inputs = sent
        kinds = {name: kind.times(count) for name, kind in self.kinds.items()}
        outputs = {name: np.zeros(kind.shape, kind.dtype) for name, kind in kinds.items()}
        self.kernel(self.recipe.workspace(), inputs, outputs)
        return outputs


def _fill(
    kernel: Kernel,
    workspace: Callable[[], Workspace],
    inputs: Arrays,
    outputs: Arrays,
    rows: slice,
) -> None:
    """Have a kernel fill some rows."""
    chosen = {name: array[rows] for name, array in outputs.items()}
    kernel(workspace(), _inputs_of(inputs, rows), chosen)


def _inputs_of(arrays: Arrays, rows: slice) -> Arrays:
    """Return some rows of the inputs; what has one axis is the same for all."""
    return {name: array if array.ndim == 1 else array[rows] for name, array in arrays.items()}
