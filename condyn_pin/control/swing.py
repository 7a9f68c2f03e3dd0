"""Swing: of springs that a controller takes for rigid, and does not answer.

A mass m_1 with a motor, a spring, and a mass m_2, whose place is to decay as x'' + 2 alpha x' +
beta^2 x = 0. What a rigid spring asks for, u = -(m_1 + m_2) (2 alpha x_2' + beta^2 x_2), gives

    p^4 + Omega^2 (p^2 + 2 alpha p + beta^2) = 0,    Omega^2 = k (m_1 + m_2) / (m_1 m_2).

The sum of the roots is zero: what the place decays with, the spring swings up with. A foot in the
air rattles on its spring until it comes down where it did not stand. With the velocity that the
robot would have if its springs were locked at once, which keeps its momentum,

    min (w - v)^T M (w - v)    with    J_l w = J_l v,    w = 0 of what is rigid,

here (m_1 x_1' + m_2 x_2') / (m_1 + m_2), it is

    p^4 + 2 alpha p^3 + Omega^2 (p^2 + 2 alpha p + beta^2) = 0,

and the swing grows with alpha (beta / Omega)^2 only: little beside what springs lose.
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise_mass, least_change


def locked(v: Array, M: Array, J: Array, rigid: Array) -> Array:
    """Return the velocity (nv,) after joints were locked at once.

    Parameters
    ----------
    v : (nv,) array
    M : (nv, nv) array
    J, rigid : (m, nv), (r, nv) array
        Rows that keep their velocities, and a row of the identity for each of the joints.
    """
    rows = np.vstack((J, rigid))
    change = np.concatenate((np.zeros(len(J)), -(rigid @ v)))
    # what is added is the same for all that keep the rows: springs may carry links without mass
    mass = factorise_mass(M + M.diagonal().mean() * (rows.T @ rows))
    return np.asarray(v + least_change(mass, rows, change, tolerances.RANK))
