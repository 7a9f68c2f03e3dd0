"""The sets that contact impulses belong to, all rows of a problem at once.

Rows come in this order: cones, three rows each (t1, t2, n); half-lines; intervals.

    cone       K = {l : |l_t| <= mu l_n}          a point that touches, Coulomb friction mu
    half-line  K = {l >= 0}                       the stop of a joint
    interval   K = {|l| <= limit}                 dry friction of a joint
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array, Indices

_TINY: Final = float(np.finfo(np.float64).tiny)


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
    def parts(self) -> tuple[slice, slice, slice]:
        """The rows of cones, of half-lines and of intervals."""
        cones = 3 * len(self.friction)
        lines = cones + self.half_lines
        return slice(0, cones), slice(cones, lines), slice(lines, self.size)

    @cached_property
    def axes(self) -> tuple[slice, slice, slice]:
        """The rows t1, t2 and n of all cones."""
        end = 3 * len(self.friction)
        return slice(0, end, 3), slice(1, end, 3), slice(2, end, 3)

    @cached_property
    def blocks(self) -> Indices:
        """Which contact each row belongs to (m,), in the order of names."""
        k = len(self.friction)
        singles = self.half_lines + len(self.limits)
        return np.concatenate([np.repeat(np.arange(k), 3), k + np.arange(singles)])

    @cached_property
    def normals(self) -> Indices:
        """The rows of normals of cones and of half-lines, in the order of contacts."""
        cones, lines, _ = self.parts
        return np.array([*range(2, cones.stop, 3), *range(lines.start, lines.stop)], dtype=int)

    @cached_property
    def of_cones(self) -> Indices:
        """The three rows of each cone (k, 3)."""
        return np.arange(3 * len(self.friction)).reshape(-1, 3)

    @cached_property
    def ice(self) -> NDArray[np.bool_]:
        """Which cones have no friction (k,)."""
        return np.asarray(self.friction == 0)

    @cached_property
    def coefficients(self) -> list[float]:
        """Friction of the cones, as plain numbers."""
        return self.friction.tolist()  # type: ignore[no-any-return]

    @cached_property
    def _shrink(self) -> Array:
        return 1 / (1 + self.friction**2)

    def project(self, x: Array) -> Array:
        """Return P_K(x) (m,): the nearest point of the sets."""
        t1, t2, n = self.axes
        x_1, x_2, x_n, mu, result = x[t1], x[t2], x[n], self.friction, np.empty_like(x)
        slip = np.hypot(x_1, x_2)
        # x_n inside, the nearest point of the surface outside, the apex where both are below it
        normal = np.maximum(np.maximum(x_n, (mu * slip + x_n) * self._shrink), 0.0)
        most = mu * normal
        kept = most / np.maximum(np.maximum(slip, most), _TINY)
        result[t1], result[t2], result[n] = kept * x_1, kept * x_2, normal
        if self.half_lines:
            lines = self.parts[1]
            np.maximum(x[lines], 0.0, out=result[lines])
        if len(self.limits):
            intervals = self.parts[2]
            np.clip(x[intervals], -self.limits, self.limits, out=result[intervals])
        return result

    def slopes(self, x: Array) -> tuple[Array, Array]:
        """Return P_K'(x): blocks (k, 3, 3) of the cones, numbers (half_lines + b,) of the others.

        1 inside, 0 where x goes to one point, between them where it goes to the surface of a cone;
        one of the one-sided derivatives where there is none.
        """
        cones, lines, intervals = self.parts
        X, mu, shrink = x[cones].reshape(-1, 3), self.friction, self._shrink
        slip, n = np.hypot(X[:, 0], X[:, 1]), X[:, 2]
        somewhere = np.where(slip > 0, slip, 1.0)
        u = X[:, :2] / somewhere[:, None]
        along = u[:, :, None] * u[:, None, :]
        turn = mu * (mu * slip + n) * shrink / somewhere
        P = np.empty((len(X), 3, 3))
        P[:, :2, :2] = turn[:, None, None] * (np.eye(2) - along)
        P[:, :2, :2] += (mu**2 * shrink)[:, None, None] * along
        P[:, :2, 2] = P[:, 2, :2] = (mu * shrink)[:, None] * u
        P[:, 2, 2] = shrink
        P[slip <= mu * n] = np.eye(3)
        P[mu * slip <= -n] = 0.0
        free = np.concatenate([x[lines] > 0, np.abs(x[intervals]) < self.limits])
        return P, free.astype(np.float64)

    def de_saxce(self, sigma: Array) -> Array:
        """Return sigma + (0, 0, mu |sigma_t|) in the rows of cones: the dual of lam in an ncp."""
        t1, t2, n = self.axes
        dual = sigma.copy()
        dual[n] += self.friction * np.hypot(sigma[t1], sigma[t2])
        return dual
