"""TickConstraints: equations and inequalities of a control tick, in memory that is kept.

    A x = b                  what no motor reaches, contacts, tasks that are equations
    lower <= C x <= upper    torques, accelerations of joints, cones

Zeros, and cones that do not turn with the robot, are written once for all ticks of one size.
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array, Indices, entries
from condyn_pin.control.contact_cones import ContactCones
from condyn_pin.control.control_limits import AccelerationBounds
from condyn_pin.control.elimination import reached
from condyn_pin.control.levels import Rows
from condyn_pin.control.motion import Motion
from condyn_pin.control.qp.quadratic_program import Constraints
from condyn_pin.control.reduction import Reduction


class TickConstraints:
    """The constraints of one program, and their memory.

    Parameters
    ----------
    cones : ContactCones
    bounds : AccelerationBounds
    limited, most : (l,) int array, (l,) array
        Which motors have a limit, and that limit over the mass of the robot [m/s^2].

    Attributes
    ----------
    unreached : float
        How far contacts with redundant rows are from what they demand, whatever moves, in the last
        tick: zero where their velocity is [m/s^2, rad/s^2].
    """

    unreached: float = 0.0
    _sizes: tuple[int, int, int] | None = None  # of the reductions that there is memory for
    _redundant: bool | None = None  # not known before the first tick

    def __init__(
        self, cones: ContactCones, bounds: AccelerationBounds, limited: Indices, most: Array
    ) -> None:
        self._cones, self._bounds = cones, bounds
        self._limited, self._most, self._least = entries(limited), most, -most

    def of(self, at: Reduction, wished: Rows, motion: Motion, load: Array) -> Constraints:
        """Return the constraints of a tick; overwritten by the next call.

        Parameters
        ----------
        at : Reduction
        wished : Rows
            Of the tasks that are equations.
        motion : Motion
            The state, for joints near their limits and cones that turn.
        load : (nv,) array
            h - passive [N m, N].
        """
        if at.sizes != self._sizes:
            self._sizes, self._memory = at.sizes, self._blank(at, wished)
        A, b, _, _, _ = self._memory
        first, m = len(at.unreached_0), len(at.touch)
        A[:first, : at.unreached.shape[1]] = at.unreached
        A[first : first + m, : at.touch.shape[1]] = at.touch
        A[first + m :, : wished.G.shape[1]] = wished.G
        np.negative(at.unreached_0, out=b[:first])
        b[first : first + m] = self._within_reach(at.touch, at.wanted)
        b[first + m :] = wished.b
        self._limit(at, motion, load)
        return self._memory

    def _blank(self, at: Reduction, wished: Rows) -> Constraints:
        """Return memory for as many unknowns and equations."""
        n, k, law = at.sizes
        m, cones = len(at.touch), self._cones
        p, first_cone = law + m + len(wished.b), len(self._most) + len(self._bounds.columns)
        r = first_cone + len(cones.names)
        made = Constraints(
            np.zeros((p, n)), np.zeros(p), np.zeros((r, n)), np.zeros(r), np.zeros(r)
        )
        made.lower[first_cone:], made.upper[first_cone:] = cones.lower, cones.upper
        if cones.constant is not None:
            made.C[first_cone:, k : k + m] = cones.constant
        return made

    def _limit(self, at: Reduction, motion: Motion, load: Array) -> None:
        """Write the inequalities."""
        _, _, C, lower, upper = self._memory
        k, columns, first = at.touch.shape[1], self._bounds.columns, len(self._most)
        last = first + len(columns)
        given = at.torque_0[self._limited]
        C[:first] = at.torque[self._limited]
        np.subtract(self._least, given, out=lower[:first])
        np.subtract(self._most, given, out=upper[:first])
        if len(columns):
            C[first:last, :k] = at.map.N[columns]
            least, most = self._bounds.at(motion.q, motion.v, motion.terms.M.diagonal(), load)
            lower[first:last], upper[first:last] = least - at.a_0[columns], most - at.a_0[columns]
        if self._cones.constant is None:
            C[last:, k : k + len(at.touch)] = self._cones.rows(motion.data.oMi)

    def _within_reach(self, touch: Array, wanted: Array) -> Array:
        """Return what contacts demand, as near as their rows can come to it.

        Two points of a foot that turns cannot both keep their places: equations that contradict
        each other would leave no torques at all.
        """
        if self._redundant is False:
            return wanted
        best, rank = reached(touch, wanted)
        if self._redundant is None:
            self._redundant = rank < len(touch)
        self.unreached = float(np.abs(best - wanted).max(initial=0.0))
        return best
