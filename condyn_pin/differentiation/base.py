"""Derivatives: how an answer changes with the state and the torques.

Columns are tangent: column i is the derivative along ``pin.integrate(model, q, t e_i)``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin.arrays import Array, finite

if TYPE_CHECKING:
    from condyn_pin.solution import Solution


class Derivatives(ABC):
    """The derivatives of an answer; the six matrices are formed when one of them is asked for.

    Attributes
    ----------
    solution : Solution
        The answer.
    da_dq, da_dv, da_dtau : (nv, nv) array
    dlam_dq, dlam_dv, dlam_dtau : (m, nv) array
        Where rows are redundant, those of the smallest lam.
    """

    def __init__(self, solution: Solution) -> None:
        self.solution = solution
        self._n, self._m = solution.scene.robot.nv, solution.scene.rows

    @abstractmethod
    def _form(self) -> tuple[Array, Array]:
        """Return the derivatives of a (nv, 3 nv) and of lam (m, 3 nv) by q, v and tau."""

    @cached_property
    def _blocks(self) -> tuple[Array, Array]:
        return self._form()

    def _part(self, which: int, by: int) -> Array:
        return self._blocks[which][:, by * self._n : (by + 1) * self._n]

    @property
    def da_dq(self) -> Array:
        """(nv, nv)."""
        return self._part(0, 0)

    @property
    def da_dv(self) -> Array:
        """(nv, nv)."""
        return self._part(0, 1)

    @property
    def da_dtau(self) -> Array:
        """(nv, nv)."""
        return self._part(0, 2)

    @property
    def dlam_dq(self) -> Array:
        """(m, nv)."""
        return self._part(1, 0)

    @property
    def dlam_dv(self) -> Array:
        """(m, nv)."""
        return self._part(1, 1)

    @property
    def dlam_dtau(self) -> Array:
        """(m, nv)."""
        return self._part(1, 2)

    def jvp(self, dq: ArrayLike, dv: ArrayLike, dtau: ArrayLike) -> tuple[Array, Array]:
        """Return (da, dlam) along a direction of the state and the torques, each (nv,)."""
        steps = [finite(name, x, self._n) for name, x in (("dq", dq), ("dv", dv), ("dtau", dtau))]
        return self._forward(*steps)

    def vjp(self, da: ArrayLike, dlam: ArrayLike) -> tuple[Array, Array, Array]:
        """Return the gradients by q, v and tau of da . a + dlam . lam, for da (nv,), dlam (m,)."""
        return self._backward(finite("da", da, self._n), finite("dlam", dlam, self._m))

    def _forward(self, dq: Array, dv: Array, dtau: Array) -> tuple[Array, Array]:
        step = np.concatenate([dq, dv, dtau])
        of_a, of_lam = self._blocks
        return of_a @ step, of_lam @ step

    def _backward(self, da: Array, dlam: Array) -> tuple[Array, Array, Array]:
        of_a, of_lam = self._blocks
        q, v, tau = (da @ of_a + dlam @ of_lam).reshape(3, self._n)
        return q, v, tau

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.solution!r})"
