"""How a chunk of rows is worked on: here, in shared memory, on copies.

A kernel fills rows of outputs from the same rows of inputs, in one workspace.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from condyn_pin.batch.memory import Address, Arrays, Kinds
from condyn_pin.batch.recipe import Recipe
from condyn_pin.workspace import Workspace

# To travel to workers it has to pickle: a function of a module, or a partial of one.
Kernel = Callable[[Workspace, Arrays, Arrays], None]


@dataclass(frozen=True)
class Here:
    """Work in this process."""

    kernel: Kernel
    workspace: Workspace
    inputs: Arrays
    outputs: Arrays

    def __call__(self, rows: slice) -> None:
        """Fill some rows."""
        self.kernel(self.workspace, inputs_of(self.inputs, rows), _outputs_of(self.outputs, rows))


@dataclass(frozen=True)
class Shared:
    """Work in a process that shares memory with the one that asks for it."""

    kernel: Kernel
    recipe: Recipe
    address: Address
    inputs: tuple[str, ...]

    def __call__(self, rows: slice) -> None:
        """Fill some rows."""
        outputs = self.address.open()
        inputs = {name: outputs.pop(name) for name in self.inputs}
        self.kernel(self.recipe.workspace(), inputs_of(inputs, rows), _outputs_of(outputs, rows))


@dataclass(frozen=True)
class Copied:
    """Work anywhere, on copies."""

    kernel: Kernel
    recipe: Recipe
    kinds: Kinds

    def __call__(self, inputs: Arrays) -> Arrays:
        """Return the outputs of some rows."""
        count = len(inputs["q"])
        outputs = {
            k: np.zeros((count, *kind.shape[1:]), kind.dtype) for k, kind in self.kinds.items()
        }
        self.kernel(self.recipe.workspace(), inputs, outputs)
        return outputs


def inputs_of(arrays: Arrays, rows: slice) -> Arrays:
    """Return some rows of the inputs; what has one axis is the same for all."""
    return {name: array if array.ndim == 1 else array[rows] for name, array in arrays.items()}


def _outputs_of(arrays: Arrays, rows: slice) -> Arrays:
    return {name: array[rows] for name, array in arrays.items()}
