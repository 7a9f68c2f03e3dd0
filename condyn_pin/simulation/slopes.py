"""Slopes: how the torques of a function change with the state, for steps that are implicit.

    tau(q1, v1) ~ tau(q, v) + tau_q (q1 - q) + tau_v (v1 - v)

They are those that come with the function, or forward differences of it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array, finite, locked
from condyn_pin.errors import InvalidArgument, StepFailed
from condyn_pin.simulation.torques import Applied

# (t, q, v) -> tau by q and by v, (nv, nv) each [N m/rad, N m s/rad and so on]
TorqueJacobian = Callable[[float, Array, Array], tuple[ArrayLike, ArrayLike]]

# (t, q, v) -> (q, v, a), as the step of an integrator
_Step = Callable[[float, Array, Array], tuple[Array, Array, Array]]

# A step of a difference, relative to what it is added to: it leaves half of the digits.
_H: Final = 2.0**-26


class Slopes:
    """The slopes of what is applied.

    Parameters
    ----------
    applied : Applied
    integrate : callable
        (q, dq) -> q moved along dq.

    Attributes
    ----------
    differencing : bool
        Whether differences are taken where the function has no derivatives of its own: not before
        a step has failed without.
    """

    def __init__(self, applied: Applied, integrate: Callable[[Array, Array], Array]) -> None:
        self._applied, self._integrate = applied, integrate
        self.differencing = False

    @property
    def are_known(self) -> bool:
        """Whether a step may ask for them."""
        return self._applied.jacobian is not None or self.differencing

    @property
    def could_be_differenced(self) -> bool:
        """Whether there is a function without derivatives, of which none are taken so far."""
        return self._applied.constant is None and not self.are_known

    def begin(self, t: float, q: Array, v: Array) -> None:
        """Begin a run, or to go on with other constraints; derivatives are looked at once."""
        self.differencing = False
        if self._applied.jacobian is not None:
            self.at(t, q, v)

    def at(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return tau by q and by v (nv, nv) each, tangent columns."""
        if self._applied.jacobian is None:
            return self._differences(t, q, v)
        found = self._applied.jacobian(t, locked(q), locked(v))
        if not (isinstance(found, tuple | list) and len(found) == 2):
            raise InvalidArgument(
                f"jacobian({t:g}, q, v) returns {type(found).__name__}: a pair is needed, tau by q "
                "and tau by v"
            )
        n = len(v)
        by_q, by_v = (
            finite(f"jacobian({t:g}, q, v)[{i}]", part, (n, n)) for i, part in enumerate(found)
        )
        return by_q, by_v

    def retried(self, step: _Step) -> _Step:
        """Return a step that, where its iteration fails, tries again with differences."""
        if self._applied.constant is not None or self._applied.jacobian is not None:
            return step

        def again(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            try:
                return step(t, q, v)
            except StepFailed:
                if self.differencing:
                    raise
            self.differencing = True
            return step(t, q, v)

        return again

    def _differences(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        value = self._applied.difference_at
        still, size = value(t, q, v), _H * max(1.0, float(np.abs(v).max(initial=0.0)))
        moves = np.eye(len(v))
        by_q = [(value(t, self._integrate(q, _H * one), v) - still) / _H for one in moves]
        by_v = [(value(t, q, v + size * one) - still) / size for one in moves]
        return np.column_stack(by_q), np.column_stack(by_v)
