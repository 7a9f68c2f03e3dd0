"""Ways of a chunk of rows to a worker and back.

A kernel fills rows of outputs from the same rows of inputs, in one workspace: in the arrays
themselves, in this process; in memory that the processes of one machine share; in pickled copies,
anywhere. What a worker cannot reach is copied chunk by chunk, while others are worked on.

Shared memory has room for the chunks that are in flight, not for all: what is touched for the first
time costs a page fault each 4 kB, in every process, and a place that is used again is still in the
cache.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Protocol

import numpy as np

from condyn_pin._core.parallel.chunks import IN_FLIGHT
from condyn_pin._core.parallel.memory import Address, Arrays, Kind, Kinds, SharedArrays

# What there is to say of some rows, by their place in the chunk: most have nothing.
Messages = dict[int, str]

# It writes every number of its outputs, where those of another chunk may have been, and returns
# words. To travel to workers it has to pickle: a function of a module, or a partial of one.
Kernel = Callable[[Any, Arrays, Arrays], Messages]


class Maker(Protocol):
    """What makes the workspace of a kernel."""

    def workspace(self) -> Any:
        """Return the workspace of this thread, made when it is first asked for."""


class Recipe(Maker, Protocol):
    """What makes it here, and can be sent to make it elsewhere."""

    def pickled(self) -> Maker:
        """Return what travels, pickled once for all chunks."""


class Transport(ABC):
    """What a worker is sent, does, and sends back."""

    work: Callable[[Any], Any]  # what the worker does with what it is sent
    places: int = IN_FLIGHT  # chunks that may be in flight at a time

    @abstractmethod
    def send(self, rows: slice, place: int) -> Any:
        """Return what the worker needs for some rows; while it works, the place is theirs."""

    @abstractmethod
    def receive(self, rows: slice, found: Any) -> Messages:
        """Put into the outputs what the worker found, as `work` returned it; return its words."""

    def close(self) -> None:  # noqa: B027 - most ways take nothing
        """Give back what the way took."""


class InPlace(Transport):
    """In this process: there is nothing to send."""

    def __init__(self, kernel: Kernel, recipe: Maker, inputs: Arrays, outputs: Arrays) -> None:
        self.work = partial(_fill, kernel, recipe.workspace(), inputs, outputs)

    def send(self, rows: slice, place: int) -> slice:
        """Return the rows: the arrays are here."""
        return rows

    def receive(self, rows: slice, found: Messages) -> Messages:
        """Return the words: the outputs are filled."""
        return found


class ByMemory(Transport):
    """To processes of this machine, in memory that they share with this one.

    It has room for so many chunks (`places`) of so many rows (`most`); OSError if there is not.
    """

    def __init__(
        self,
        kernel: Kernel,
        recipe: Maker,
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
        self.work = _InMemory(kernel, recipe, memory.address, tuple(inputs))

    def send(self, rows: slice, place: int) -> slice:
        """Return where the inputs of the rows are in shared memory now."""
        there = slice(place * self._most, place * self._most + rows.stop - rows.start)
        for name, array in self._inputs.items():
            self._shared[name][there] = array[rows]
        return there

    def receive(self, rows: slice, found: tuple[slice, Messages]) -> Messages:
        """Copy out of shared memory."""
        there, words = found
        for name, array in self._outputs.items():
            array[rows] = self._shared[name][there]
        return words

    def close(self) -> None:
        """Let no worker open the memory any more."""
        self._memory.close()


class ByCopies(Transport):
    """To workers anywhere, as pickled copies."""

    def __init__(self, kernel: Kernel, recipe: Maker, inputs: Arrays, outputs: Arrays) -> None:
        self._inputs, self._outputs = inputs, outputs
        kinds = {name: Kind(array.shape[1:], array.dtype.str) for name, array in outputs.items()}
        self.work = _OnCopies(kernel, recipe, kinds)

    def send(self, rows: slice, place: int) -> tuple[int, Arrays]:
        """Return the number of rows and their inputs."""
        return rows.stop - rows.start, _inputs_of(self._inputs, rows)

    def receive(self, rows: slice, found: tuple[Arrays, Messages]) -> Messages:
        """Put the copies into their place."""
        arrays, words = found
        for name, array in arrays.items():
            self._outputs[name][rows] = array
        return words


@dataclass(frozen=True)
class _InMemory:
    """The work of a process that shares memory with the one that asks for it."""

    kernel: Kernel
    recipe: Maker
    address: Address
    inputs: tuple[str, ...]

    def __call__(self, rows: slice) -> tuple[slice, Messages]:
        arrays = _opened(self.address)
        inputs = {name: arrays[name] for name in self.inputs}
        outputs = {name: arrays[name] for name in arrays.keys() - inputs.keys()}
        return rows, _fill(self.kernel, self.recipe.workspace(), inputs, outputs, rows)


@lru_cache(maxsize=1)
def _opened(address: Address) -> Arrays:
    """Return the arrays of a batch, kept from one chunk to the next."""
    return address.open()


@dataclass(frozen=True)
class _OnCopies:
    """The work of a worker anywhere."""

    kernel: Kernel
    recipe: Maker
    kinds: Kinds  # of a row

    def __call__(self, sent: tuple[int, Arrays]) -> tuple[Arrays, Messages]:
        count, inputs = sent
        kinds = {name: kind.times(count) for name, kind in self.kinds.items()}
        outputs = {name: np.zeros(kind.shape, kind.dtype) for name, kind in kinds.items()}
        return outputs, self.kernel(self.recipe.workspace(), inputs, outputs)


def _fill(kernel: Kernel, workspace: Any, inputs: Arrays, outputs: Arrays, rows: slice) -> Messages:
    """Have a kernel fill some rows."""
    chosen = {name: array[rows] for name, array in outputs.items()}
    return kernel(workspace, _inputs_of(inputs, rows), chosen)


def _inputs_of(arrays: Arrays, rows: slice) -> Arrays:
    """Return some rows of the inputs; what has one axis is the same for all."""
    return {name: array if array.ndim == 1 else array[rows] for name, array in arrays.items()}
