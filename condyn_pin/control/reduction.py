"""The equations of one control tick, with what is held and the torques eliminated.

    M a + h = passive + E t + J_l^T lam_l + J_c^T lam_c,     J_l a = r_l,     J_c a = r_c

become, with f = lam_c / m over the mass of the robot, a = a_0 + N z (`elimination`), and w torques
that do nothing,

    X_2^T N^T (M a + h - passive - J_c^T lam_c) / m = 0,     J_c N z = r_c - J_c a_0,
    t / m = T x + t_0,     x = (z, f, w / m).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import Terms
from condyn_pin.control.elimination import Elimination


class Reduction(NamedTuple):
    """The equations of a tick over z and f = lam_c / m.

    Attributes
    ----------
    map : Elimination
    a_0 : (nv,) array
        What the held rows alone demand [rad/s^2, m/s^2].
    J_c, touch : (m_c, nv), (m_c, k) array
        Rows of contacts with a cone, over a and over z.
    wanted : (m_c,) array
        What they demand of z [m/s^2, rad/s^2].
    unreached, unreached_0 : (p, k + m_c), (p,) array
        What no motor reaches of N^T (M a + h - passive - J_c^T lam_c) / m, over (z, f) and with
        both zero.
    torque, torque_0 : (motors, n), (motors,) array
        T and t_0: what motors give, over x and with x = 0.
    """

    map: Elimination
    a_0: Array
    J_c: Array
    touch: Array
    wanted: Array
    unreached: Array
    unreached_0: Array
    torque: Array
    torque_0: Array

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of unknowns, of those in z, and of equations that no motor reaches."""
        return self.torque.shape[1], self.touch.shape[1], len(self.unreached_0)


def reduced(
    terms: Terms, given: Array, E: Elimination, held: Array, J_c: Array, r_c: Array, mass: float
) -> Reduction:
    """Return the equations over z and lam_c / m.

    Parameters
    ----------
    terms : Terms
    given : (nv,) array
        h - passive [N m, N].
    E : Elimination
        Of the rows that are held.
    held, r_c : (l,), (m_c,) array
        What these rows and those of the contacts have to be, J_l a and J_c a [m/s^2, rad/s^2].
    J_c : (m_c, nv) array
    mass : float
        Of the robot [kg].
    """
    a_0 = E.particular(held)
    if E.holds:
        given, r_c = given + terms.M @ a_0, r_c - J_c @ a_0
    touch = E.along(J_c)
    force = np.concatenate((E.within(terms.M) * (1.0 / mass), -touch.T), axis=1)
    force_0 = E.along(given) / mass
    torque = E.torques(force)
    if E.inner.shape[1]:
        torque = np.hstack((torque, E.inner))
    law = E.unreached(force), E.unreached(force_0)
    return Reduction(E, a_0, J_c, touch, r_c, *law, torque, E.torques(force_0))
