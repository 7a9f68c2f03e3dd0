"""QuadraticProgram: a strictly convex quadratic program, and what is left of its optimality.

    min  1/2 x^T H x + g^T x    with    A x = b,    lower <= C x <= upper

At its answer, with multipliers y and z, z > 0 at an upper bound and z < 0 at a lower one,

    H x + g + A^T y + C^T z = 0,    A x = b,    C x = clip(C x + z, lower, upper).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from math import isfinite
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array

Verdict = Literal["solved", "infeasible", "failed"]


class Constraints(NamedTuple):
    """What programs with the same unknowns share, whatever their objective.

    Attributes
    ----------
    A, b : (p, n), (p,) array
        Equations [1], [m/s^2]; rows may depend on each other.
    C, lower, upper : (r, n), (r,), (r,) array
        Inequalities [1], [m/s^2].
    """

    A: Array
    b: Array
    C: Array
    lower: Array
    upper: Array


@dataclass(frozen=True, eq=False)
class QuadraticProgram:
    """The data of one program; bounds that do not exist are infinite.

    min over x of x^T H x / 2 + g^T x    with  A x = b,    lower <= C x <= upper

    Attributes
    ----------
    H : (n, n) array
        Positive definite [1].
    g : (n,) array
        Linear term of the cost [m/s^2].
    A, b : (p, n), (p,) array
        Equations [1], [m/s^2]; rows may depend on each other.
    C, lower, upper : (r, n), (r,), (r,) array
        Inequalities [1], [m/s^2].
    """

    H: Array
    g: Array
    A: Array
    b: Array
    C: Array
    lower: Array
    upper: Array

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of unknowns, of equations and of inequalities."""
        return len(self.g), len(self.b), len(self.lower)

    @property
    def has_room(self) -> bool:
        """Whether the bounds of each row leave a value to it: none does that are crossed or NaN."""
        least, most = self.lower, self.upper
        return bool(((least <= most) & (least < np.inf) & (most > -np.inf)).all())

    @cached_property
    def pinned(self) -> NDArray[np.bool_]:
        """Which inequalities are equations, their bounds being the same (r,)."""
        return np.asarray(self.lower == self.upper)

    @property
    def has_nan_bounds(self) -> bool:
        """Whether a bound is NaN."""
        return bool(np.isnan(self.lower).any() or np.isnan(self.upper).any())

    def kkt_residual(self, x: Array, y: Array, z: Array) -> float:
        """Return the largest of the three; that of the gradient relative to its largest term.

        Bounds that are crossed leave what one of them is violated by.

        Parameters
        ----------
        x, y, z : (n,), (p,), (r,) array
            An answer, and the multipliers of equations and inequalities.
        """
        # asked in every tick: of a vector `dot` takes two thirds of the time of @
        Hx, Cx = self.H.dot(x), self.C.dot(x)
        size = 1.0 + max(peak(self.g), peak(Hx))  # what is not finite shows in the gradient
        nearest = np.minimum(np.maximum(Cx + z / size, self.lower), self.upper)
        gradient = Hx + self.g + y.dot(self.A) + z.dot(self.C)
        gradient /= size
        missed = self.A.dot(x) - self.b, Cx - nearest, np.maximum(self.lower - nearest, 0.0)
        found = largest(np.concatenate((gradient, *missed)))
        return found if isfinite(found) else np.inf


def largest(v: Array) -> float:
    """Return the largest size of an entry; NaN if one is."""
    return float(np.maximum.reduce(np.abs(v))) if len(v) else 0.0


def peak(v: Array) -> float:
    """Return the largest size of an entry of finite numbers, in half the time of `largest`."""
    return abs(float(v[_blas()(v)])) if len(v) else 0.0


@cache
def _blas() -> Any:
    # imported here: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.blas import idamax

    return idamax


class QPResult(NamedTuple):
    """What a solver of quadratic programs returns.

    Attributes
    ----------
    x, z : (n,), (r,) array
        Answer, and multipliers of the inequalities; they tell which rows are active.
    verdict : {"solved", "infeasible", "failed"}
        What the solver itself says; it is not checked yet.
    iterations : int
    """

    x: Array
    z: Array
    verdict: Verdict
    iterations: int
