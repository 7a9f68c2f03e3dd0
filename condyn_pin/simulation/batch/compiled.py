"""Rows of a batch by the compiled core; those that it leaves, and what it does not take, by Python.

A kernel like any other, so that chunks, executors, progress and interrupts are those of all
batches: the core works on the rows of a chunk with its threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.parallel.memory import Arrays
from condyn_pin._core.parallel.native import Native
from condyn_pin._core.parallel.transports import Kernel, Messages
from condyn_pin.dynamics.compiled.core import CompiledCore, refuse
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import UnsupportedBackend

# Work of a core on the rows of a chunk, with some threads; it returns those that it leaves.
Work = Callable[[CompiledCore, Arrays, Arrays, int], NDArray[np.intp]]


@dataclass(frozen=True)
class CompiledRows:
    """The kernel: `work` by the core of a workspace, what is left by the kernel in `python`."""

    work: Work
    python: Kernel
    threads: int
    reasons: tuple[str, ...] = field(default=())  # why the core takes none of it

    def __call__(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> Messages:
        """Fill the outputs; return what there is to say of rows."""
        if self.reasons:
            return self.python(workspace, inputs, outputs)
        left = self.work(workspace.compiled, inputs, outputs, self.threads)
        if not left.size:
            return {}
        some = {name: x if x.ndim == 1 else x[left] for name, x in inputs.items()}
        found = {name: x[left] for name, x in outputs.items()}
        words = self.python(workspace, some, found)
        for name, x in found.items():
            outputs[name][left] = x
        return {int(left[i]): text for i, text in words.items()}


def by_whom(
    executor: Executor | Native | None, work: Work, python: Kernel, reasons: Iterator[str],
    workspace: Callable[[], Workspace],
) -> tuple[Kernel, Executor | None]:  # fmt: skip
    """Return the kernel of a batch, and the executor whose workers run it.

    Raises
    ------
    UnsupportedBackend
        If the core does not take it, for one of the `reasons` or those of the workspace.
    """
    if not isinstance(executor, Native):
        return python, executor
    found = []
    try:
        refuse(reasons)
        workspace().compiled  # noqa: B018 - what it does not take is refused before the work
    except UnsupportedBackend as error:
        if not executor.where_possible:
            raise
        found.append(str(error))
    return CompiledRows(work, python, executor.at_work, tuple(found)), executor.executor
