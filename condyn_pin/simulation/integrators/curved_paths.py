"""Curved paths: how far gaps end from where straight paths would take them within a step.

    s = gap(q (+) dt v) - gap - dt J_n v = dt^2 / 2 Jdot_n v + ...

The tip of a limb of 0.2 m at 200 rad/s is 1 mm off its tangent after 0.5 ms.
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, Indices
from condyn_pin.simulation.floating import Floating
from condyn_pin.simulation.integrators.chosen_contacts import Chosen
from condyn_pin.simulation.integrators.contact_scheme import allowed_gaps, fastest
from condyn_pin.simulation.integrators.posed import Posed
from condyn_pin.simulation.system import System

# A step in which joints turn less bends the path of a limb of a metre by 0.05 mm at most [rad, m].
_STRAIGHT = 1e-2

# How deep a step may go through what it was to close [m].
_THROUGH = 1e-4


class CurvedPaths:
    """The paths of what is over planes, and of pairs that meet in one point, in steps of one size.

    Others count as straight. Boxes and capsules meet in several points, which come and go along a
    path: on links at 100 rad/s those stop 0.4 mm apart in a step of 0.5 ms. Stops of joints are
    linear in q.
    """

    def __init__(self, system: System, floating: Floating, dt: float) -> None:
        self._system, self._floating, self._dt = system, floating, dt

    def bends(self, q: Array, v: Array, gaps: Array, speeds: Array, chosen: Chosen) -> Array:
        """Return s of the cones and half-lines that take part (k,) [m].

        Parameters
        ----------
        q, v : (nq,), (nv,) array
            Where the path begins, and the velocity along it.
        gaps : (k,) array
            At q [m, rad].
        speeds : (m,) array
            J_c v, of the contacts at q [m/s].
        chosen : Chosen

        Notes
        -----
        It takes 5 us, and leaves the placements of q (+) dt v in the data of the system. Pairs take
        more, and are followed where a step is long.
        """
        contacts, data, dt = self._system.contacts, self._system.equations.data, self._dt
        k, bends = chosen.contact_points, np.zeros(len(gaps))
        follows_pairs = self._follows_pairs(v, chosen)
        if not k and not follows_pairs:
            return bends
        pin.forwardKinematics(self._system.model, data, self._floating.integrate(q, dt * v))
        if k:
            ends = contacts.gaps_over_planes(data)[chosen.over_planes]
            bends[:k] = ends - gaps[:k] - dt * speeds[2 : 3 * k : 3]
        if follows_pairs:
            at = chosen.pairs_here
            bends[at] = contacts.gaps(data, q)[chosen.pairs] - gaps[at] - dt * speeds[3 * at + 2]
        return bends

    def followed(self, v: Array, chosen: Chosen) -> Indices:
        """Return which of the cones that take part have curved paths along v."""
        over_planes = np.arange(chosen.contact_points)
        if not self._follows_pairs(v, chosen):
            return over_planes
        return np.concatenate((over_planes, chosen.pairs_here))

    def _follows_pairs(self, v: Array, chosen: Chosen) -> bool:
        return len(chosen.pairs) > 0 and self._dt * fastest(v) >= _STRAIGHT

    def missed(self, posed: Posed, v1: Array) -> Array | None:
        """Return s along v+ if a contact goes through because those `posed` were along v, or None.

        An impact changes velocities, and with them how paths bend.
        """
        dt, near, chosen = self._dt, posed.near, posed.chosen
        if not chosen.contact_points and not len(chosen.pairs):
            return None
        if dt * fastest(v1) < _STRAIGHT and max(near.bends.tolist()) < _THROUGH:
            return None
        speeds = posed.J_c.dot(v1)
        bends = self.bends(posed.at, v1, near.gaps, speeds, chosen)
        moved = dt * speeds[chosen.normals] + bends
        return bends if (moved + allowed_gaps(near.gaps) < -_THROUGH).any() else None
