"""Derivatives of one answer, formed by the compiled core."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.derivatives.base import Derivatives
from condyn_pin.dynamics.derivatives.kkt import KktDerivatives
from condyn_pin.dynamics.solution import Solution

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace


class CompiledDerivatives(KktDerivatives):
    """Those of `KktDerivatives`, whose matrices are there already.

    What else may be asked for, derivatives by the parameters of a model, is as in Python. Of small
    robots it takes a tenth of all the time to make the solution: it is made when it is asked for.
    """

    def __init__(
        self, workspace: Workspace, v: Array, blocks: Array, answer: Callable[[], Solution]
    ) -> None:
        _, size, self._n = blocks.shape
        self._m = size - self._n
        self._hold(workspace, v)
        self._answer, self._formed = answer, (blocks[0], blocks[1], blocks[2])

    @cached_property
    def solution(self) -> Solution:  # type: ignore[override]
        """The answer."""
        return self._answer()

    @property
    def _forces(self) -> tuple[Array, Array, Array]:
        by_q, by_v, by_tau = self._blocks
        return by_q[self._n :], by_v[self._n :], by_tau[self._n :]

    def _forward(self, dq: Array, dv: Array, dtau: Array) -> tuple[Array, Array]:
        return Derivatives._forward(self, dq, dv, dtau)

    def _backward(self, da: Array, dlam: Array) -> tuple[Array, Array, Array]:
        return Derivatives._backward(self, da, dlam)
