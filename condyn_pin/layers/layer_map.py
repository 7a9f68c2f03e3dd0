"""LayerMap: what a layer is made of, a function of arrays with its derivatives.

    (x, y) = f(q, v, tau, ...)

1. A map says by name what it is a function of, with the shape that each has for one state (None
   for an axis of any length), and `outputs`, the shapes of x and y.
2. It says for one state what x and y are, how they change along steps of the inputs, and what a
   gradient by x and y is by the inputs. Leading axes are here.
3. Steps and gradients by configurations are numbers, one for each of q: `Configurations`.
4. Maps are called from the threads of other libraries, one at a time.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from math import prod

import numpy as np

from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.errors import InvalidArgument

Pair = tuple[Array, Array]
Shape = tuple[int, ...]
Wanted = tuple[int | None, ...]  # a shape of which some axes may have any length


class LayerMap(ABC):
    """A function of arrays with any leading axes, and its derivatives.

    Attributes
    ----------
    inputs : mapping of str to shape
        What it is a function of, in order.
    """

    def __init__(self, inputs: Mapping[str, Wanted]) -> None:
        self.inputs, self._lock = dict(inputs), threading.Lock()

    @abstractmethod
    def outputs(self, shapes: Sequence[Shape]) -> tuple[Shape, Shape]:
        """Return the shapes of x and y of one state, for inputs of these."""

    @abstractmethod
    def value_of(self, *inputs: Array) -> Pair:
        """Return x and y of one state."""

    @abstractmethod
    def jvp_of(self, inputs: Sequence[Array], steps: Sequence[Array]) -> Pair:
        """Return the changes of x and y of one state along steps of the inputs."""

    @abstractmethod
    def vjp_of(self, inputs: Sequence[Array], dx: Array, dy: Array) -> tuple[Array, ...]:
        """Return the gradients by the inputs of one state of dx . x + dy . y."""

    def value(self, *arrays: Array) -> tuple[Array, ...]:
        """Return x and y."""
        return self.each(self.value_of, arrays, self.outputs(self.shapes(arrays)))

    def jvp(self, *arrays: Array) -> tuple[Array, ...]:
        """Return the changes of x and y: of inputs, and then of their steps."""
        k = len(self.inputs)

        def one(*of: Array) -> Pair:
            return self.jvp_of(of[:k], of[k:])

        return self.each(one, arrays, self.outputs(self.shapes(arrays)))

    def vjp(self, *arrays: Array) -> tuple[Array, ...]:
        """Return the gradients by the inputs: of inputs, and then of dx and dy."""

        def one(*of: Array) -> tuple[Array, ...]:
            return self.vjp_of(of[:-2], *of[-2:])

        return self.each(one, arrays, self.shapes(arrays))

    def shapes(self, arrays: Sequence[Array]) -> list[Shape]:
        """Return the shapes of the inputs without their leading axes."""
        wanted = self.inputs.values()
        return [each.shape[-len(w) :] for each, w in zip(arrays, wanted, strict=False)]

    def leading(self, shapes: Sequence[Shape]) -> list[Shape]:
        """Return the leading axes of inputs; InvalidArgument if one has a wrong shape."""
        if len(shapes) != len(self.inputs):
            raise InvalidArgument(
                f"{len(shapes)} arrays: {len(self.inputs)} are needed, {', '.join(self.inputs)}"
            )
        found = []
        for (name, wanted), shape in zip(self.inputs.items(), shapes, strict=True):
            k = len(wanted)
            fits = len(shape) >= k and all(
                w in (None, n) for w, n in zip(wanted, shape[-k:], strict=True)
            )
            if not fits:
                axes = ", ".join("steps" if w is None else str(w) for w in wanted)
                last = "axis has" if k == 1 else f"{k} axes have"
                raise InvalidArgument(
                    f"{name} has shape {tuple(shape)}: the last {last} to be "
                    f"{axes if k == 1 else f'({axes})'} long"
                )
            found.append(tuple(shape[:-k]))
        return found

    def not_broadcast(self, shapes: Sequence[Shape]) -> str:
        """Return what to say of leading axes that do not broadcast."""
        shown = ", ".join(str(tuple(shape)) for shape in shapes)
        return (
            f"{', '.join(self.inputs)} have the shapes {shown}: leading axes that broadcast are "
            "needed"
        )

    def each(
        self, one: Callable[..., Sequence[Array]], arrays: Sequence[Array], shapes: Sequence[Shape]
    ) -> tuple[Array, ...]:
        """Return what `one` gives for each state, arrays of these `shapes`, stacked."""
        for name, array in zip(self.inputs, arrays, strict=False):
            finite(name, array, array.shape)
        first = next(iter(self.inputs.values()))
        leading = arrays[0].shape[: arrays[0].ndim - len(first)]
        count = prod(leading)
        rows = [
            np.ascontiguousarray(each).reshape(count, *each.shape[len(leading) :])
            for each in arrays
        ]
        out = [np.empty((count, *shape)) for shape in shapes]
        quiet = np.errstate(all="ignore")  # what is not finite is refused
        with self._lock, one_blas_thread, quiet:
            for i in range(count):
                found = one(*(each[i] for each in rows))
                for array, part in zip(out, found, strict=True):
                    array[i] = part
        return tuple(array.reshape(*leading, *array.shape[1:]) for array in out)
