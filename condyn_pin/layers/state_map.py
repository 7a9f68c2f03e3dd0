"""StateMap: what a layer is made of, a function of (q, v, tau) with its derivatives.

    (x, y) = f(q, v, tau),    each with the same leading axes

1. A map says the sizes of x and y, and for one state what they are, and how they change:
   `Change`, with `jvp` and `vjp` in the tangent. Derivatives of solves and of steps are such;
   `matrices` is what they do to all directions.
2. Where x is a configuration (`ends_in_q`), it is one number for each of q, and its change comes
   in the tangent as well; all else about manifolds is here.
3. Maps are called from the threads of other libraries, one at a time.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from math import prod
from typing import Any, ClassVar, Protocol

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.layers.configurations import Configurations
from condyn_pin.model.robot import Robot

State = tuple[Array, Array, Array]
Pair = tuple[Array, Array]


class Change(Protocol):
    """How x and y change with q, v and tau, in the tangent."""

    def jvp(self, dq: Array, dv: Array, dtau: Array, /) -> Pair:
        """Return (dx, dy) along a direction, each part (nv,)."""

    def vjp(self, dx: Array, dy: Array, /) -> State:
        """Return the gradients by q, v and tau, each (nv,), of dx . x + dy . y."""


class StateMap(ABC):
    """A function of (q, v, tau), for arrays with any leading axes."""

    ends_in_q: ClassVar[bool] = False
    x_size: int
    y_size: int

    def __init__(self, robot: Robot) -> None:
        self.space, self._lock = Configurations(robot), threading.Lock()
        self.nq, self.nv = self.space.nq, self.space.nv

    @abstractmethod
    def answer(self, q: Array, v: Array, tau: Array) -> Pair:
        """Return x and y at one state."""

    @abstractmethod
    def change(self, q: Array, v: Array, tau: Array) -> tuple[Pair, Any]:
        """Return x and y at one state, and their `Change`."""

    @abstractmethod
    def matrices(self, change: Any) -> Pair:
        """Return the derivatives of x and of y by q, v and tau, (size, 3 nv) each."""

    def value(self, q: Array, v: Array, tau: Array) -> Pair:
        """Return x and y."""

        def one(*state: Array) -> Pair:
            q, v, tau = state
            return self.answer(self.space.unit(q)[0], v, tau)

        x, y = self._each(one, (q, v, tau), (self.x_size, self.y_size))
        return x, y

    def jvp(self, q: Array, v: Array, tau: Array, dq: Array, dv: Array, dtau: Array) -> Pair:
        """Return the changes of x and y along (dq, dv, dtau), numbers of the same shapes."""

        def one(q: Array, v: Array, tau: Array, dq: Array, dv: Array, dtau: Array) -> Pair:
            T, end, change = self._at(q, v, tau)
            dx, dy = change.jvp(T @ dq, dv, dtau)
            return (dx if end is None else end @ dx), dy

        sizes = self.x_size, self.y_size
        dx, dy = self._each(one, (q, v, tau, dq, dv, dtau), sizes)
        return dx, dy

    def vjp(self, q: Array, v: Array, tau: Array, dx: Array, dy: Array) -> State:
        """Return the gradients by the numbers of q, v and tau of dx . x + dy . y."""

        def one(q: Array, v: Array, tau: Array, dx: Array, dy: Array) -> State:
            T, end, change = self._at(q, v, tau)
            by_q, by_v, by_tau = change.vjp(dx if end is None else dx @ end, dy)
            return by_q @ T, by_v, by_tau

        sizes = self.nq, self.nv, self.nv
        by_q, by_v, by_tau = self._each(one, (q, v, tau, dx, dy), sizes)
        return by_q, by_v, by_tau

    def linear(self, q: Array, v: Array, tau: Array) -> tuple[Array, Array, Array]:
        """Return x, y, and their derivatives (..., x_size + y_size, nq + 2 nv)."""
        nq, nv = self.nq, self.nv
        size = self.x_size + self.y_size

        def one(q: Array, v: Array, tau: Array) -> tuple[Array, Array, Array]:
            unit, lengths = self.space.unit(q)
            (x, y), change = self.change(unit, v, tau)
            T, end = self.space.steps(unit, lengths), self._end(x)
            of_x, of_y = self.matrices(change)
            A = np.vstack([of_x if end is None else end @ of_x, of_y])
            return x, y, np.hstack([A[:, :nv] @ T, A[:, nv:]]).ravel()

        x, y, A = self._each(one, (q, v, tau), (self.x_size, self.y_size, size * (nq + 2 * nv)))
        return x, y, A.reshape(*A.shape[:-1], size, nq + 2 * nv)

    def _at(self, q: Array, v: Array, tau: Array) -> tuple[Array, Array | None, Change]:
        """Return T at the start, D at the end where there is one, and the change."""
        unit, lengths = self.space.unit(q)
        (x, _), change = self.change(unit, v, tau)
        return self.space.steps(unit, lengths), self._end(x), change

    def _end(self, x: Array) -> Array | None:
        return self.space.rates(x) if self.ends_in_q else None

    def _each(self, one: Any, arrays: tuple[Array, ...], sizes: tuple[int, ...]) -> Any:
        """Return what `one` gives for each state, stacked."""
        leading = arrays[0].shape[:-1]
        count = prod(leading)
        rows = [np.ascontiguousarray(each).reshape(count, each.shape[-1]) for each in arrays]
        out = [np.empty((count, size)) for size in sizes]
        with self._lock, one_blas_thread:
            for i, state in enumerate(zip(*rows, strict=True)):
                for array, found in zip(out, one(*state), strict=True):
                    array[i] = found
        return tuple(array.reshape(*leading, size) for array, size in zip(out, sizes, strict=True))
