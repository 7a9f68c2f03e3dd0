"""Derivatives: how an answer changes with the state and the torques.

Columns are tangent: column i is the derivative along ``pin.integrate(model, q, t e_i)``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.blas_threads import one_blas_thread

if TYPE_CHECKING:
    from condyn_pin.dynamics.solution import Solution


# What answers are derived by.
_BY: Final = ("q", "v", "tau")


class Derivatives(ABC):
    """The derivatives of accelerations and constraint forces, as returned by `derivatives`.

    M da - J^T dlam = dtau - r_q dq - r_v dv,    J da = -s_q dq - s_v dv

    Columns are tangent: those for q belong to ``pin.integrate(model, q, dq)``. The six matrices are
    formed when one of them is accessed; `jvp` and `vjp` do without.

    Attributes
    ----------
    solution : Solution
        The answer.
    da_dq, da_dv, da_dtau : (nv, nv) array
        Of the joint accelerations a; the columns by q are tangent.
    dlam_dq, dlam_dv, dlam_dtau : (m, nv) array
        Where rows are redundant, those of the smallest lam.
    disagreement : float or None
        Largest difference to central differences, relative to the largest entry of its block [1],
        where these were taken (``check=True``).
    """

    _formed: tuple[Array, Array, Array] | None = None  # as soon as one of them was asked for
    disagreement: float | None = None  # relative to the largest entry of a block

    def __init__(self, solution: Solution) -> None:
        self.solution = solution
        self._n, self._m = len(solution.a), len(solution.lam)

    @abstractmethod
    def _form(self) -> tuple[Array, Array, Array]:
        """Return the derivatives of (a, lam) by q, v and tau, each (nv + m, nv)."""

    @property
    def _blocks(self) -> tuple[Array, Array, Array]:
        return self._formed or self._form_once()

    @one_blas_thread
    def _form_once(self) -> tuple[Array, Array, Array]:
        self._formed = self._form()
        return self._formed

    @property
    def da_dq(self) -> Array:
        """Accelerations by the configuration (nv, nv)."""
        return self._blocks[0][: self._n]

    @property
    def da_dv(self) -> Array:
        """Accelerations by the velocity (nv, nv)."""
        return self._blocks[1][: self._n]

    @property
    def da_dtau(self) -> Array:
        """Accelerations by the torques (nv, nv)."""
        return self._blocks[2][: self._n]

    @property
    def dlam_dq(self) -> Array:
        """Constraint forces by the configuration (m, nv)."""
        return self._blocks[0][self._n :]

    @property
    def dlam_dv(self) -> Array:
        """Constraint forces by the velocity (m, nv)."""
        return self._blocks[1][self._n :]

    @property
    def dlam_dtau(self) -> Array:
        """Constraint forces by the torques (m, nv)."""
        return self._blocks[2][self._n :]

    @one_blas_thread
    def jvp(self, dq: ArrayLike, dv: ArrayLike, dtau: ArrayLike) -> tuple[Array, Array]:
        """Return (da, dlam) along dq, dv and dtau, each (nv,): a direction of state and torques."""
        steps = [finite(name, x, self._n) for name, x in (("dq", dq), ("dv", dv), ("dtau", dtau))]
        return self._forward(*steps)

    @one_blas_thread
    def vjp(self, da: ArrayLike, dlam: ArrayLike) -> tuple[Array, Array, Array]:
        """Return the gradients by q, v and tau of da . a + dlam . lam, for da (nv,), dlam (m,)."""
        return self._backward(finite("da", da, self._n), finite("dlam", dlam, self._m))

    def _forward(self, dq: Array, dv: Array, dtau: Array) -> tuple[Array, Array]:
        by_q, by_v, by_tau = self._blocks
        answer = by_q @ dq + by_v @ dv + by_tau @ dtau
        return answer[: self._n], answer[self._n :]

    def _backward(self, da: Array, dlam: Array) -> tuple[Array, Array, Array]:
        answer = np.concatenate([da, dlam])
        by_q, by_v, by_tau = self._blocks
        return answer @ by_q, answer @ by_v, answer @ by_tau

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.solution!r})"

    def __str__(self) -> str:
        n, m = self._n, self._m
        blocks = [f"d{x}_d{y} {(k, n)}" for x, k in (("a", n), ("lam", m)) for y in _BY]
        checked = (
            "not checked by differences; check=True does"
            if self.disagreement is None
            else f"differ from central differences by {self.disagreement:.1e} of the largest entry"
        )
        return "\n".join([repr(self), ", ".join(blocks), checked])
