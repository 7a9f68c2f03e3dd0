"""Rows of arrays over an executor: the common part of everything that is done to many states.

Where the rows are is decided here: in the arrays themselves in this process, in memory that the
processes of one machine share, or in pickled copies of each chunk for workers anywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from condyn_pin.batch.chunks import Progress, map_chunks, silent
from condyn_pin.batch.memory import CAN_SHARE, Arrays, Kind, Kinds, SharedArrays
from condyn_pin.batch.processes import Processes
from condyn_pin.batch.recipe import Recipe
from condyn_pin.batch.workers import Copied, Here, Kernel, Shared, inputs_of
from condyn_pin.drift import Baumgarte
from condyn_pin.errors import WorkersLost
from condyn_pin.scene import Scene
from condyn_pin.solvers.base import Solver
from condyn_pin.verbs import workspace_for

# The status of a row that nobody has worked on.
MISSING: Final = -1

# At least so many chunks, so that several workers end at about the same time.
_CHUNKS: Final = 16


@dataclass(frozen=True)
class Rows:
    """What is done to the rows of arrays, and by whom.

    Parameters
    ----------
    kernel : Kernel
    scene, solver, drift
        Of the workspace.
    executor : Executor, optional
    chunk : int, optional
        Rows that a worker is handed at a time; by default a sixteenth of all, up to `most`.
    most : int
        Rows that take a tenth of a second or less.
    progress : callable
        Called with the number of rows done and that of all.
    """

    kernel: Kernel
    scene: Scene
    solver: Solver | None = None
    drift: Baumgarte | None = None
    executor: Executor | None = None
    chunk: int | None = None
    most: int = 1000
    progress: Progress = silent

    def fill(self, count: int, inputs: Arrays, kinds: Kinds) -> Arrays:
        """Return the outputs, a row a state; one of them is ``statuses``.

        Parameters
        ----------
        count : int
            Number of states.
        inputs : mapping of str to array
            With two axes, a row a state; with one, the same for all.
        kinds : mapping of str to Kind
            What a row of each output is.

        Raises
        ------
        WorkersLost
            Its `done` has the outputs, ``statuses`` MISSING where a row was not worked on.
        """
        kinds = {name: kind.times(count) for name, kind in kinds.items()}
        shared = self._shared(inputs, kinds)
        if shared is None:
            return self._drain(count, self._apart(inputs, kinds))
        with shared:
            outputs = self._drain(count, self._together(shared, inputs, kinds))
        # copies: shared memory would keep a file open for as long as the answer lives
        return {name: array.copy() for name, array in outputs.items()}

    def _apart(self, inputs: Arrays, kinds: Kinds) -> _Plan:
        """Return the plan for this process, or for workers that are sent copies."""
        outputs = {name: np.zeros(kind.shape, kind.dtype) for name, kind in kinds.items()}
        if self.executor is None:
            workspace = workspace_for(self.scene, self.solver, self.drift)
            return _Plan(Here(self.kernel, workspace, inputs, outputs), None, outputs)
        recipe = Recipe.of(self.scene, self.solver, self.drift)
        return _Plan(Copied(self.kernel, recipe, kinds), inputs, outputs)

    def _together(self, shared: SharedArrays, inputs: Arrays, kinds: Kinds) -> _Plan:
        """Return the plan for processes that share memory with this one."""
        for name, array in inputs.items():
            shared.arrays[name][:] = array
        recipe = Recipe.of(self.scene, self.solver, self.drift)
        work = Shared(self.kernel, recipe, shared.address, tuple(inputs))
        return _Plan(work, None, {name: shared.arrays[name] for name in kinds})

    def _shared(self, inputs: Arrays, kinds: Kinds) -> SharedArrays | None:
        """Return memory for everything, if the workers are processes of this machine."""
        if not (CAN_SHARE and isinstance(self.executor, ProcessPoolExecutor | Processes)):
            return None
        given = {name: Kind(array.shape, array.dtype.str) for name, array in inputs.items()}
        try:
            return SharedArrays(given | dict(kinds))
        except OSError:  # not so much at once: chunk by chunk, then
            return None

    def _drain(self, count: int, plan: _Plan) -> Arrays:
        """Have all chunks done."""
        step = self.chunk or min(self.most, max(1, -(-count // _CHUNKS)))
        chunks = [slice(i, min(i + step, count)) for i in range(0, count, step)]
        sent = chunks if plan.copied is None else [inputs_of(plan.copied, rows) for rows in chunks]
        outputs, done = plan.outputs, 0
        outputs["statuses"][:] = MISSING
        try:
            for i, found in map_chunks(plan.work, sent, executor=self.executor):
                for name, array in (found or {}).items():
                    outputs[name][chunks[i]] = array
                done += chunks[i].stop - chunks[i].start
                self.progress(done, count)
        except WorkersLost as lost:
            lost.done = {name: array.copy() for name, array in outputs.items()}
            raise
        return outputs


@dataclass(frozen=True)
class _Plan:
    """Who does the work, what is sent along with each chunk, and where it ends up."""

    work: Callable[[Any], Arrays | None]
    copied: Arrays | None
    outputs: Arrays
