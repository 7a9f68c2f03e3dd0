"""StateMap: a layer of (q, v, tau) whose derivatives are matrices in the tangent.

    (x, y) = f(q, v, tau, p)

1. A map says the sizes of x and y, and for one state what they are, and how they change:
   `Change`, with `jvp` and `vjp` in the tangent. Derivatives of solves and of steps are such;
   `matrices` is what they do to all directions.
2. Where x is a configuration (`ends_in_q`), it is one number for each of q, and its change comes
   in the tangent as well; all else about manifolds is here.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from math import prod
from typing import Any, ClassVar, Protocol

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.layers.configurations import Configurations
from condyn_pin.layers.layer_map import LayerMap, Pair, Shape
from condyn_pin.model.robot import Robot


class Change(Protocol):
    """How x and y change with q, v, tau and parameters, in the tangent."""

    def jvp(self, dq: Array, dv: Array, dtau: Array, /, *more: Array) -> Pair:
        """Return (dx, dy) along a direction, each part (nv,)."""

    def vjp(self, dx: Array, dy: Array, /) -> tuple[Array, ...]:
        """Return the gradients by q, v, tau and parameters of dx . x + dy . y."""


class StateMap(LayerMap):
    """A function of (q, v, tau) and of parameters."""

    ends_in_q: ClassVar[bool] = False
    x_size: int
    y_size: int

    def __init__(self, robot: Robot, parameters: Mapping[str, Shape] | None = None) -> None:
        self.space = Configurations(robot)
        self.nq, self.nv = self.space.nq, self.space.nv
        state = {"q": (self.nq,), "v": (self.nv,), "tau": (self.nv,)}
        super().__init__({**state, **(parameters or {})})

    @abstractmethod
    def answer(self, q: Array, v: Array, tau: Array, *p: Array) -> Pair:
        """Return x and y at one state."""

    @abstractmethod
    def change(self, q: Array, v: Array, tau: Array, *p: Array) -> tuple[Pair, Any]:
        """Return x and y at one state, and their `Change`."""

    @abstractmethod
    def matrices(self, change: Any) -> Pair:
        """Return the derivatives of x and of y, (size, 3 nv + parameters) each."""

    def outputs(self, shapes: Sequence[Shape]) -> tuple[Shape, Shape]:
        """Return the shapes of x and y."""
        return (self.x_size,), (self.y_size,)

    def value_of(self, *inputs: Array) -> Pair:
        """Return x and y of one state."""
        q, *others = inputs
        return self.answer(self.space.unit(q)[0], *others)

    def jvp_of(self, inputs: Sequence[Array], steps: Sequence[Array]) -> Pair:
        """Return the changes of x and y of one state."""
        T, end, _, change = self._at(*inputs)
        dq, *others = steps
        dx, dy = change.jvp(T @ dq, *others)
        return (dx if end is None else end @ dx), dy

    def vjp_of(self, inputs: Sequence[Array], dx: Array, dy: Array) -> tuple[Array, ...]:
        """Return the gradients by the inputs of one state."""
        T, end, _, change = self._at(*inputs)
        by_q, *others = change.vjp(dx if end is None else dx @ end, dy)
        return (by_q @ T, *others)

    def linear(self, *arrays: Array) -> tuple[Array, ...]:
        """Return x, y, and their derivatives (..., x_size + y_size, numbers of all inputs)."""
        size = self.x_size + self.y_size
        numbers = sum(map(prod, self.shapes(arrays)))

        def one(*inputs: Array) -> tuple[Array, ...]:
            T, end, (x, y), change = self._at(*inputs)
            of_x, of_y = self.matrices(change)
            A = np.vstack([of_x if end is None else end @ of_x, of_y])
            return x, y, np.hstack([A[:, : self.nv] @ T, A[:, self.nv :]])

        return self.each(one, arrays, ((self.x_size,), (self.y_size,), (size, numbers)))

    def _at(self, q: Array, *others: Array) -> tuple[Array, Array | None, Pair, Change]:
        """Return T at the start, D at the end where there is one, x and y, and their change."""
        unit, lengths = self.space.unit(q)
        pair, change = self.change(unit, *others)
        end = self.space.rates(pair[0]) if self.ends_in_q else None
        return self.space.steps(unit, lengths), end, pair, change
