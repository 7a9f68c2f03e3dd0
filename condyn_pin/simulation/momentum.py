"""The equations of motion as Hamilton has them, in the momentum p = M v.

    q' = v,    p' = C(q, v)^T v - g(q) + tau + J^T lam,    c(q) = 0

since p' = M v' + M' v and M' = C + C^T, with C the Coriolis matrix for which M' - 2 C is
skew-symmetric. On free-flyers and balls p is that of the body frame.

References
----------
Hairer, Lubich, Wanner. Geometric Numerical Integration. Springer, 2006, chapter VII.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv

from condyn_pin._pin import pin
from condyn_pin.arrays import Array

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System

# Damping of J M^-1 J^T relative to its diagonal. Redundant rows are singular without; an iteration
# to the end makes up for what it leaves, a billionth of each gap over the smallest eigenvalue.
_DAMPING = 1e-9


class Place(NamedTuple):
    """What belongs to one configuration."""

    M: Array  # (nv, nv)
    J: Array  # (m, nv)
    M_inv: Array  # (nv, nv)
    G_inv: Array  # (m, m), of J M^-1 J^T, damped


class Momentum:
    """The terms of one system."""

    def __init__(self, system: System) -> None:
        self._system, self._model = system, system.model
        self._data = system.model.createData()

    def force(self, t: float, q: Array, v: Array) -> Array:
        """Return C^T v - g + tau (nv,)."""
        C = pin.computeCoriolisMatrix(self._model, self._data, q, v)
        g = pin.computeGeneralizedGravity(self._model, self._data, q)
        return np.asarray(v.dot(C) - g + self._system.torque(t, q, v))

    def velocity(self, q: Array, p: Array) -> Array:
        """Return M^-1 p (nv,)."""
        velocity: Array = dposv(self._system.mass(q), p)[1]
        return velocity

    def place(self, q: Array) -> Place:
        """Return what belongs to q."""
        M, J = self._system.mass(q), self._system.jacobian(q)
        M_inv = np.asarray(np.linalg.inv(M), dtype=np.float64)
        place = Place(M, J, M_inv, np.zeros((0, 0)))
        return place._replace(G_inv=self.between(place, J))

    def between(self, place: Place, J1: Array) -> Array:
        """Return (J1 M^-1 J^T)^-1 (m, m), damped, with M and J of a place and another J1."""
        G: Array = J1.dot(place.M_inv).dot(place.J.T)
        if len(G):
            G[np.diag_indices(len(G))] += _DAMPING * G.diagonal().max()
        return np.asarray(np.linalg.inv(G), dtype=np.float64)
