"""Law: what a route takes the law of the contacts for, at one answer.

    by_sigma dsigma + by_lam dlam + by_friction dmu + by_size dsize = 0

One such row for each of the problem: with sigma = G lam + g it is what a change of g, G and mu asks
of lam.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetri, dlange

from condyn_pin._core.arrays import Array
from condyn_pin.contact.indeterminacy import COMPLIANCE, compliance
from condyn_pin.contact.problem import ContactProblem, Modes

# Singular values of a law that redundant contacts leave, relative to the largest.
_REDUNDANT: Final = 1e-10


class Law(NamedTuple):
    """A linearised law of contacts.

    Attributes
    ----------
    lam : (m,) array
        Impulses that the law holds for [N s].
    by_sigma, by_lam : (m, m) array
    by_friction : (m, k) array
        By the coefficient of each cone of the problem.
    margin : float
        How far the nearest contact is from another mode, in units of the problem [1].
    by_size : (m,) array, optional
        By (m g dt) (g dt) of the robot and the step, of a law whose smoothness goes with it [1/J].
    modes : (contacts,) array of int, optional
        Of a law that is made of them.
    """

    lam: Array
    by_sigma: Array
    by_lam: Array
    by_friction: Array
    margin: float
    by_size: Array | None = None
    modes: Modes | None = None

    def giving_way(self, problem: ContactProblem) -> Law:
        """Return the law of contacts that give way alike, a little: of an answer chosen by that."""
        if self.modes is None:
            return self
        R = COMPLIANCE * compliance(problem)
        return self._replace(by_lam=self.by_lam + self.by_sigma * R)


def least(A: Array, b: Array) -> Array:
    """Return x of A x = b (m,) or (m, columns), the smallest one where contacts are redundant.

    By A^-1 and one step of refinement, which is as exact as LAPACK's solution for each column: of
    many columns that takes ten times as long as products do.
    """
    lu, pivots, info = dgetrf(A)
    if not info:
        inverse, info = dgetri(lu, pivots)
    if info or not dlange("1", A) * dlange("1", inverse) * _REDUNDANT < 1:
        return np.asarray(np.linalg.lstsq(A, b, rcond=_REDUNDANT)[0])
    x = inverse.dot(b)
    x += inverse.dot(b - A.dot(x))
    return np.asarray(x)
