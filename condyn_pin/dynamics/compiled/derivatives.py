"""Derivatives of one answer, formed by the compiled core."""

from __future__ import annotations

from typing import TYPE_CHECKING

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.derivatives.base import Derivatives
from condyn_pin.dynamics.derivatives.kkt import KktDerivatives
from condyn_pin.dynamics.solution import Solution

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace

Blocks = tuple[Array, Array, Array]


class CompiledDerivatives(KktDerivatives):
    """Those of `KktDerivatives`, whose matrices are there already.

    What else may be asked for, derivatives by the parameters of a model, is as in Python.
    """

    def __init__(self, workspace: Workspace, solution: Solution, v: Array, blocks: Blocks) -> None:
        self._hold(workspace, solution, v)
        self._found = blocks

    @property
    def _forces(self) -> Blocks:
        by_q, by_v, by_tau = self._found
        return by_q[self._n :], by_v[self._n :], by_tau[self._n :]

    def _form(self) -> Blocks:
        return self._found

    def _forward(self, dq: Array, dv: Array, dtau: Array) -> tuple[Array, Array]:
        return Derivatives._forward(self, dq, dv, dtau)

    def _backward(self, da: Array, dlam: Array) -> tuple[Array, Array, Array]:
        return Derivatives._backward(self, da, dlam)
