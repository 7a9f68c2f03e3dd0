"""The partial derivatives of all constraints of one scene, group by group.

Of what the linearised equations ask for,

    -[[r_q, r_v], [s_q, s_v]],             r = M a + h - tau - J^T lam,    s = J a + gamma - a_ref

groups add what turns of J^T lam to -r_q, the `pulls` (nv, nv), and write `by_state`, -[s_q, s_v]
(m, 2 nv) and their rows of J.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.partials.formulas import Frames
from condyn_pin.constraints.partials.pairs import PairPartials
from condyn_pin.constraints.partials.points import PointPartials
from condyn_pin.constraints.partials.rolling import RollingPartials
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.constraints.rows.couplings import Coupled
from condyn_pin.constraints.rows.point_ends import PointEnds
from condyn_pin.constraints.rows.related import Related
from condyn_pin.constraints.rows.rolling import Rolled


class ConstraintPartials:
    """The partials of all constraints of one scene.

    `data` holds what `pin.computeRNEADerivatives` leaves.

    Attributes
    ----------
    make : callable
        What makes arrays for `write`: zeros where there are couplings, all other rows are written.
    """

    def __init__(
        self, model: Any, data: Any, bounds: Sequence[AnyBound], drift: Baumgarte | None
    ) -> None:
        frames = Frames(model, data)
        self._bounds, self._drift = {b.name: b for b in bounds}, drift
        self._pairs = PairPartials(frames, bounds, drift)
        self._rolling = RollingPartials(frames, bounds, drift)
        self._points = PointPartials(model, data, bounds, drift)
        self._couplings = [b for b in bounds if isinstance(b, Coupled)]
        self.make: Callable[[tuple[int, ...]], Array] = np.zeros if self._couplings else np.empty

    def write(
        self, lam: Array, pulls: Array, by_state: Array, J: Array, ends: PointEnds | None = None
    ) -> None:
        """Write all rows but those of couplings into by_state and J, arrays that `make` has made.

        `ends` are those of the loops of three rows, where this answer was evaluated already.
        """
        if self._pairs.k:
            self._pairs.write(lam, pulls, by_state, J)
        if self._rolling.k:
            self._rolling.write(lam, pulls, by_state, J)
        if self._points.k:
            known = self._points.k == self._points.between
            self._points.write(lam, pulls, by_state, J, ends if known else None)

    def write_couplings(
        self, state: tuple[Array, Array, Array, Array], rhs: Array, J: Array
    ) -> None:
        """Write the rows of couplings at (q, v, a, lam), and what those that bend do to -r_q."""
        q, v, a, lam = state
        n = J.shape[1]
        by_state = rhs[n:]
        for b in self._couplings:
            row, columns = b.rows.start, b.columns
            J[row, columns] = b.bent(q, 1) if b.bends else b.weights
            if self._drift:
                by_state[row, :n] = -self._drift.Kp * J[row]
                by_state[row, n:] = -self._drift.Kd * J[row]
            if b.bends:
                second, third, v_i = b.bent(q, 2), b.bent(q, 3), v[columns]
                Kd = self._drift.Kd if self._drift else 0.0
                rhs[columns, columns] += lam[row] * second
                by_state[row, columns] -= second * (a[columns] + Kd * v_i) + third * v_i**2
                by_state[row, [n + column for column in columns]] -= 2.0 * second * v_i

    def turn_couplings(self, q: Array, w: Array, out: Array) -> None:
        """Write the partials (m, nv) of J w by q of couplings that bend."""
        for b in self._couplings:
            if b.bends:
                out[b.rows.start, b.columns] = b.bent(q, 2) * w[b.columns]

    def turning(self, out: Array) -> None:
        """Write the partials (m, nv) of J v by q, but for couplings."""
        for part in (self._pairs, self._rolling, self._points):
            if part.k:
                part.turning(out)

    def by_frame(self, name: str, lam: Array, end: int) -> tuple[Array, Array]:
        """Return r (nv, 6) and s (rows, 6) by a twist of c1 or c2 of a constraint, in its axes."""
        b = self._bounds[name]
        if isinstance(b, Rolled):
            return self._rolling.by_frame(b, lam[b.rows])
        assert isinstance(b, Bound | Related)  # a coupling has no frames
        return self._pairs.by_frame(b, lam[b.rows], end)
