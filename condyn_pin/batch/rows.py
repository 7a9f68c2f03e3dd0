"""Rows of arrays over an executor: the common part of everything that is done to many states."""

from __future__ import annotations

from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from typing import Final

import numpy as np

from condyn_pin.batch.chunks import Progress, map_chunks, silent
from condyn_pin.batch.memory import CAN_SHARE, Arrays, Kind, Kinds, SharedArrays
from condyn_pin.batch.processes import Processes
from condyn_pin.batch.recipe import Recipe
from condyn_pin.batch.ways import ByCopies, ByMemory, InPlace, Kernel, Sent, Way
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
        outputs = {name: np.zeros(kind.shape, kind.dtype) for name, kind in kinds.items()}
        outputs["statuses"][:] = MISSING
        if self.executor is None:
            workspace = workspace_for(self.scene, self.solver, self.drift)
            self._drain(count, InPlace(self.kernel, workspace, inputs, outputs), outputs)
            return outputs
        recipe = Recipe.of(self.scene, self.solver, self.drift)
        shared = self._shared(inputs, kinds)
        if shared is None:
            self._drain(count, ByCopies(self.kernel, recipe, inputs, outputs), outputs)
            return outputs
        with shared:
            self._drain(count, ByMemory(self.kernel, recipe, inputs, outputs, shared), outputs)
        return outputs

    def _shared(self, inputs: Arrays, kinds: Kinds) -> SharedArrays | None:
        """Return memory for everything, if the workers are processes of this machine."""
        if not (CAN_SHARE and isinstance(self.executor, ProcessPoolExecutor | Processes)):
            return None
        given = {name: Kind(array.shape, array.dtype.str) for name, array in inputs.items()}
        try:
            return SharedArrays(given | dict(kinds))
        except OSError:  # not so much at once: chunk by chunk, then
            return None

    def _drain(self, count: int, way: Way, outputs: Arrays) -> None:
        """Have all chunks done."""
        step = self.chunk or min(self.most, max(1, -(-count // _CHUNKS)))
        chunks = [slice(i, min(i + step, count)) for i in range(0, count, step)]
        done = 0
        results = map_chunks(way.work, Sent(way, chunks), executor=self.executor)
        try:
            with closing(results):  # an interrupt cancels what nobody has begun
                for i, found in results:
                    way.receive(chunks[i], found)
                    done += chunks[i].stop - chunks[i].start
                    self.progress(done, count)
        except WorkersLost as lost:
            lost.done = outputs
            raise
