"""Curved paths: how far gaps end from where straight paths would take them within a step.

    s = gap(q (+) dt v) - gap - dt J_n v = dt^2 / 2 Jdot_n v + ...

The tip of a limb of 0.2 m at 200 rad/s is 1 mm off its tangent after 0.5 ms.
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.simulation.floating import Floating
from condyn_pin.simulation.integrators.chosen_contacts import Chosen
from condyn_pin.simulation.integrators.contact_scheme import allowed_gaps
from condyn_pin.simulation.integrators.posed import Posed
from condyn_pin.simulation.system import System

# A step in which joints turn less bends the path of a limb of a metre by 0.05 mm at most [rad, m].
_STRAIGHT = 1e-2

# How deep a step may go through what it was to close [m].
_THROUGH = 1e-4


class CurvedPaths:
    """The paths of what is over planes, in steps of one size; others count as straight.

    Where two shapes meet changes along a path, and stops of joints are linear in q.
    """

    def __init__(self, system: System, floating: Floating, dt: float) -> None:
        self._system, self._floating, self._dt = system, floating, dt

    def bends(self, q: Array, v: Array, gaps: Array, J_c: Array, chosen: Chosen) -> Array:
        """Return s of the cones and half-lines that take part (k,) [m].

        Parameters
        ----------
        q, v : (nq,), (nv,) array
            Where the path begins, and the velocity along it.
        gaps : (k,) array
            At q [m, rad].
        J_c : (m, nv) array
            Rows of the contacts at q.
        chosen : Chosen

        Notes
        -----
        It takes 6 us, and leaves the placements of q (+) dt v in the data of the system.
        """
        system, dt, k = self._system, self._dt, chosen.contact_points
        bends = np.zeros(len(gaps))
        if k:
            data = system.equations.data
            pin.forwardKinematics(system.model, data, self._floating.integrate(q, dt * v))
            ends = system.contacts.gaps_over_planes(data)[chosen.over_planes]
            bends[:k] = ends - gaps[:k] - dt * J_c[2 : 3 * k : 3].dot(v)
        return bends

    def missed(self, posed: Posed, v1: Array) -> Array | None:
        """Return s along v+ if a contact goes through because those `posed` were along v, or None.

        An impact changes velocities, and with them how paths bend.
        """
        dt, near, chosen = self._dt, posed.near, posed.chosen
        if not chosen.contact_points:
            return None
        if dt * float(np.abs(v1).max()) < _STRAIGHT and float(near.bends.max()) < _THROUGH:
            return None
        J_c = posed.J[chosen.rows]
        bends = self.bends(posed.at, v1, near.gaps, J_c, chosen)
        moved = dt * J_c[chosen.normals].dot(v1) + bends
        return bends if (moved + allowed_gaps(near.gaps) < -_THROUGH).any() else None
