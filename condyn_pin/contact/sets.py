"""The sets that contact impulses belong to, all rows of a problem at once.

Rows come in this order: cones, three rows each (t1, t2, n); half-lines; intervals.

    cone       K = {l : |l_t| <= mu l_n}          a point that touches, Coulomb friction mu
    half-line  K = {l >= 0}                       the stop of a joint
    interval   K = {|l| <= limit}                 dry friction of a joint
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from condyn_pin._core.arrays import Array


@dataclass(frozen=True, eq=False)
class ContactSets:
    """The set K of a contact problem: a product of cones, half-lines and intervals.

    Attributes
    ----------
    friction : (k,) array
        Coefficients of the cones [1].
    half_lines : int
        Number of half-lines.
    limits : (b,) array
        Of the intervals [N s].
    """

    friction: Array
    half_lines: int
    limits: Array  # [N s]

    @property
    def size(self) -> int:
        """Number of rows, m = 3 k + half_lines + b."""
        return 3 * len(self.friction) + self.half_lines + len(self.limits)

    @cached_property
    def _ends(self) -> tuple[int, int]:
        cones = 3 * len(self.friction)
        return cones, cones + self.half_lines

    @cached_property
    def _shrink(self) -> Array:
        return 1 / (1 + self.friction**2)

    def project(self, x: Array) -> Array:
        """Return P_K(x) (m,): the nearest point of the sets."""
        cones, lines = self._ends
        result = np.empty_like(x)
        X = x[:cones].reshape(-1, 3)
        slip = np.hypot(X[:, 0], X[:, 1])
        mu, n = self.friction, X[:, 2]
        # on the surface, unless x is in the polar cone, which is asked first (mu may be 0), or in K
        normal = (mu * slip + n) * self._shrink
        normal = np.where(mu * slip <= -n, 0.0, np.where(slip <= mu * n, n, normal))
        tangential = np.minimum(slip, mu * normal)
        Y = result[:cones].reshape(-1, 3)
        Y[:, :2] = X[:, :2] * (tangential / np.where(slip > 0, slip, 1.0))[:, None]
        Y[:, 2] = normal
        np.maximum(x[cones:lines], 0.0, out=result[cones:lines])
        np.clip(x[lines:], -self.limits, self.limits, out=result[lines:])
        return result

    def de_saxce(self, sigma: Array) -> Array:
        """Return sigma + (0, 0, mu |sigma_t|) in the rows of cones: what is dual to lam in an ncp."""
        cones, _ = self._ends
        S = sigma[:cones].reshape(-1, 3)
        dual = sigma.copy()
        dual[2:cones:3] += self.friction * np.hypot(S[:, 0], S[:, 1])
        return dual

    def scaled(self, by: float) -> ContactSets:
        """Return the sets of `by` times the impulses."""
        return ContactSets(self.friction, self.half_lines, self.limits * by)
