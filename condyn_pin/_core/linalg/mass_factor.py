"""The factor of one mass matrix, M = L L^T, and what it says whatever is constrained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Final

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.errors import InvalidModel

_EPS = float(np.finfo(np.float64).eps)

_NOT_POSITIVE: Final = "the mass matrix is not positive definite at this q"


@dataclass(eq=False)
class MassFactor:
    """One mass matrix, factorised.

    Attributes
    ----------
    M : (nv, nv) array
    L : (nv, nv) array
        Its lower Cholesky factor.
    """

    M: Array
    L: Array

    @cached_property
    def L_inv(self) -> Array:
        """L^-1 (nv, nv): a product takes a tenth of the time that LAPACK needs for many columns."""
        return np.asarray(lapack().dtrtri(self.L, lower=1)[0])

    @cached_property
    def weights(self) -> Array:
        """W (nv,): square roots of the diagonal of M^-1."""
        return np.asarray(np.sqrt(np.einsum("ij,ij->j", self.L_inv, self.L_inv)))

    @cached_property
    @one_blas_thread
    def rounding(self) -> float:
        """What no acceleration can be better than: eps cond(D M D), D = diag(M_jj^-1/2)."""
        rows = np.linalg.norm(self.L, axis=1)  # M_jj^1/2
        return _EPS * float(np.linalg.cond(self.L / rows[:, None])) ** 2

    @cached_property
    @one_blas_thread
    def condition(self) -> float:
        """Condition number of M."""
        return float(np.linalg.cond(self.M))

    @cached_property
    def pivots(self) -> Array:
        """D (nv,) of M = U D U^T."""
        return pivots(self.M)

    def condition_exceeds(self, limit: float) -> bool:
        """Whether the condition number is above a limit: traces say no at less cost.

        |M| |M^-1| <= tr M tr M^-1
        """
        at_most = float(self.M.trace()) * float((self.weights**2).sum())
        return not at_most <= limit and self.condition > limit


def factorise_mass(M: Array, *, why: Callable[[], str] = str) -> MassFactor:
    """Factorise M (nv, nv); `why` says why it is not positive definite, or nothing.

    Raises
    ------
    InvalidModel
        If M is not positive definite.
    """
    upper, info = lapack().dpotrf(M.T)  # what is below the diagonal, as in np.linalg.cholesky
    if info:
        raise InvalidModel(why() or _NOT_POSITIVE)
    return MassFactor(M, upper.T)


def inverse_factor(M: Array) -> Array:
    """Return L^-1 (nv, nv) of M = L L^T.

    Raises
    ------
    InvalidModel
        If M is not positive definite.
    """
    of = lapack()
    upper, info = of.dpotrf(M.T)
    if info:
        raise InvalidModel(_NOT_POSITIVE)
    return of.dtrtri(upper, 0, 0, 1)[0].T  # type: ignore[no-any-return]


def pivots(M: Array) -> Array:
    """Return D (nv,) of M = U D U^T; NaN if M is not positive definite."""
    from_the_tips = M.ravel()[::-1].copy().reshape(M.shape)
    factor, info = lapack().dpotrf(from_the_tips.T, 1, 0, 1)  # M is symmetric
    if info:
        return np.full(len(M), np.nan)
    roots = factor.diagonal()[::-1]
    return np.asarray(roots * roots)


@cache
def lapack() -> Any:
    """Return LAPACK's own routines: half the time of numpy's at the size of robots."""
    from scipy.linalg import lapack  # takes as long to import as Pinocchio

    return lapack
