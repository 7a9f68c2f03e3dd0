"""Derivatives of one answer, formed by the compiled core."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.derivatives.base import Derivatives
from condyn_pin.dynamics.derivatives.kkt import KktDerivatives
from condyn_pin.dynamics.solution import Solution

if TYPE_CHECKING:
    from condyn_pin.dynamics.compiled.core import CompiledCore


class CompiledDerivatives(KktDerivatives):
    """Those of `KktDerivatives`, whose matrices are there already.

    What else may be asked for, derivatives by the parameters of a model, is as in Python. Of small
    robots it takes a tenth of all the time to make the solution: it is made when it is asked for.
    Each matrix is one view of what the core wrote, where those of the base class are two.
    """

    def __init__(self, core: CompiledCore, answer: Array, matrices: Array, tau: Array) -> None:
        self._core, self._answer, self._matrices, self._tau = core, answer, matrices, tau
        self._workspace, (self._equations, self._linearisation) = core.workspace, core.equations
        _, size, self._n = matrices.shape
        self._m, self._v = size - self._n, core.velocity(answer)

    @cached_property
    def solution(self) -> Solution:  # type: ignore[override]
        """The answer."""
        return self._core.solution(self._answer, self._tau)

    @property
    def da_dq(self) -> Array:
        """Accelerations by the configuration (nv, nv)."""
        return self._matrices[0, : self._n]

    @property
    def da_dv(self) -> Array:
        """Accelerations by the velocity (nv, nv)."""
        return self._matrices[1, : self._n]

    @property
    def da_dtau(self) -> Array:
        """Accelerations by the torques (nv, nv)."""
        return self._matrices[2, : self._n]

    @property
    def _blocks(self) -> tuple[Array, Array, Array]:
        by_q, by_v, by_tau = self._matrices
        return by_q, by_v, by_tau

    @property
    def _forces(self) -> tuple[Array, Array, Array]:
        by_q, by_v, by_tau = self._matrices
        return by_q[self._n :], by_v[self._n :], by_tau[self._n :]

    def _forward(self, dq: Array, dv: Array, dtau: Array) -> tuple[Array, Array]:
        return Derivatives._forward(self, dq, dv, dtau)

    def _backward(self, da: Array, dlam: Array) -> tuple[Array, Array, Array]:
        return Derivatives._backward(self, da, dlam)
