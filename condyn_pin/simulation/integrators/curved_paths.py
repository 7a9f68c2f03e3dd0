"""Curved paths: how far gaps end from where straight paths would take them within a step.

    s = gap(q (+) dt v) - gap - dt J_n v = dt^2 / 2 Jdot_n v + ...

The tip of a limb of 0.2 m at 200 rad/s is 1 mm off its tangent after 0.5 ms.
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms
from condyn_pin.simulation.integrators.chosen_contacts import Chosen
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.system import System


class CurvedPaths:
    """The paths of what is over planes, in steps of one size.

    Pairs of bodies count as straight at first, for they meet in other points at the end of a long
    step (`PathEnds`). Stops of joints are linear in q.
    """

    def __init__(self, system: System, floating: Manifold, dt: float) -> None:
        self._system, self._floating, self._dt = system, floating, dt

    def bends(
        self, q: Array, v: Array, gaps: Array, speeds: Array, chosen: Chosen
    ) -> tuple[Array, Array | None]:
        """Return s of the cones and half-lines that take part (k,) [m], and q (+) dt v.

        That is None where nothing that takes part is over a plane.

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
        It takes 5 us, and leaves the placements of q (+) dt v in the data of the system.
        """
        contacts, data, dt = self._system.contacts, self._system.equations.data, self._dt
        k, bends = chosen.contact_points, np.zeros(len(gaps))
        if not k:
            return bends, None
        end = self._floating.integrate(q, dt * v)
        algorithms(data).forwardKinematics(self._system.model, data, end)
        ends = contacts.gaps_over_planes(data)[chosen.over_planes]
        np.subtract(ends - gaps[:k], dt * speeds[2 : 3 * k : 3], out=bends[:k])
        return bends, end
