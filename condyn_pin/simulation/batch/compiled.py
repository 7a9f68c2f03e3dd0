"""Rows of a batch by the compiled core; those that it leaves, and what it does not take, by Python.

A kernel like any other, so that chunks, executors, progress and interrupts are those of all
batches: the core works on the rows of a chunk with its threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.compiled import compiled
from condyn_pin._core.rows import Native
from condyn_pin._core.work import Arrays, Kernel, Messages
from condyn_pin.dynamics.compiled import refuse
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import MissingExtra, UnsupportedBackend

# What the core of a workspace does to the rows of a chunk with some threads: those that it leaves,
# and what there is to say of others.
Work = Callable[[Workspace, Arrays, Arrays, int], tuple[NDArray[np.intp], Messages]]


@dataclass(frozen=True)
class CompiledRows:
    """The kernel: `work` by the core of a workspace, what is left by the kernel in `python`."""

    work: Work
    python: Kernel
    threads: int

    def __call__(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> Messages:
        """Fill the outputs; return what there is to say of rows."""
        left, said = self.work(workspace, inputs, outputs, self.threads)
        if not left.size:
            return said
        some = {name: x if x.ndim == 1 else x[left] for name, x in inputs.items()}
        found = {name: x[left] for name, x in outputs.items()}
        words = self.python(workspace, some, found)
        for name, x in found.items():
            outputs[name][left] = x
        return said | {int(left[i]): text for i, text in words.items()}


class Workers(NamedTuple):
    """Who does the work of a batch: by which kernel, where, and how many rows at a time."""

    kernel: Kernel
    executor: Executor | None
    chunk: int | None


def workers(
    executor: Executor | Native | None, work: Work, python: Kernel, *, reasons: Iterable[str],
    untaken: Callable[[], Iterable[str]], chunk: int | None, most: int,
) -> Workers:  # fmt: skip
    """Return who does the work of a batch.

    Parameters
    ----------
    executor : Executor or Native or None
        As the user has it.
    work, python : callable
        What the core does, and what Python does.
    reasons : iterable of str
        Why the core does not take the batch, if there are any.
    untaken : callable
        Returns why it does not take the workspace; asked where there is no other reason.
    chunk : int or None
        As the user has it.
    most : int
        Rows that are handed to the threads of this process at a time, unless there is a `chunk`.

    Raises
    ------
    UnsupportedBackend
        If the core does not take it.
    MissingExtra
        If the core is not installed.
    """
    if not isinstance(executor, Native):
        return Workers(python, executor, chunk)
    try:
        compiled()
        refuse(chain(reasons, _later(untaken)))
    except (UnsupportedBackend, MissingExtra):
        if not executor.where_possible:
            raise
        return Workers(python, executor.executor, chunk)
    if executor.executor is None and chunk is None:
        chunk = most * executor.at_work
    return Workers(CompiledRows(work, python, executor.at_work), executor.executor, chunk)


def _later(untaken: Callable[[], Iterable[str]]) -> Iterable[str]:
    yield from untaken()
