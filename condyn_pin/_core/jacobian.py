"""Jacobian: derivatives of named outputs by named inputs.

    dy = sum_x A_yx dx

with one matrix A_yx of an output y by an input x, tangent where either is a configuration: `dv_dq`
is that of v by q. Of many states all matrices have a leading axis.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import overload

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.errors import CondynError, unknown_name


class Jacobian(ABC):
    """Derivatives of named outputs by named inputs, in tangent coordinates."""

    outputs: tuple[str, ...]
    inputs: tuple[str, ...] = ("q", "v", "tau")

    @abstractmethod
    def block(self, output: str, by: str) -> Array:
        """Return the derivative of an output by an input (..., rows, columns)."""

    def by(self, parameter: str) -> Array:
        """Return the derivatives of all outputs by an input, one below the other.

        A matrix (..., rows, columns); `parameter` is one of `inputs`.
        """
        if parameter not in self.inputs:
            raise self._unknown(parameter)
        return np.concatenate([self.block(output, parameter) for output in self.outputs], axis=-2)

    @property
    def matrix(self) -> Array:
        """Derivatives of all outputs by all inputs, side by side (..., rows, columns)."""
        return np.concatenate([self.by(name) for name in self.inputs], axis=-1)

    def _unknown(self, parameter: str) -> CondynError:
        return unknown_name("parameter", parameter, self.inputs)


class Block:
    """One matrix of a `Jacobian` as its attribute; its name says of what: `dlam_dq`."""

    def __init__(self, doc: str) -> None:
        self.__doc__ = doc

    def __set_name__(self, owner: type, name: str) -> None:
        self.output, self.by = name[1:].split("_d")

    @overload
    def __get__(self, of: None, kind: type) -> Block: ...

    @overload
    def __get__(self, of: Jacobian, kind: type) -> Array: ...

    def __get__(self, of: Jacobian | None, kind: type) -> Block | Array:
        """Matrix of a Jacobian; the descriptor itself on the class."""
        return self if of is None else of.block(self.output, self.by)
