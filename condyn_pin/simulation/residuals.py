"""The residuals of implicit integrators and the matrix of their Newton iterations.

    r = M a + h - tau - J^T lam,    c(q)

References
----------
Hairer, Wanner. Solving Ordinary Differential Equations II. Springer, 1996, chapter VII.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System

# What is added to the zero block, relative to the largest eigenvalue of J M^-1 J^T: redundant rows
# make the matrix singular without, and the iteration makes up for it.
_DAMPING = 1e-9


class Residual(NamedTuple):
    """The residuals at one state."""

    r: Array  # (nv,) [N, N m]
    c: Array  # (m,) [m, rad]
    J: Array  # (m, nv)


class Partials(NamedTuple):
    """Their partial derivatives."""

    M: Array  # (nv, nv)
    J: Array  # (m, nv)
    r_q: Array  # (nv, nv)
    r_v: Array  # (nv, nv)


class Residuals:
    """The residuals of one system.

    Attributes
    ----------
    damping : float
        What belongs into the zero block of [[M, -J^T], [J, 0]].
    """

    def __init__(self, system: System) -> None:
        self._system, self._model = system, system.model
        self._data = system.model.createData()
        self.damping = _DAMPING * system.scene.nominal.delassus_norm

    def at(self, t: float, q: Array, v: Array, a: Array, lam: Array) -> Residual:
        """Return the residuals."""
        system = self._system
        c, J = system.equations.position_level(q)
        bodies = pin.rnea(self._model, self._data, q, v, a)
        return Residual(bodies - system.torque(t, q, v) - J.T.dot(lam), c, J)

    def partials(self, t: float, q: Array, v: Array, a: Array, lam: Array) -> Partials:
        """Return the partial derivatives; torques applied count as constant without slopes."""
        of, n = self._system.workspace.linearisation.at(q, v, a, lam), len(v)
        passive = self._system.passive
        r_q = of.r_q + passive.stiffness_matrix(q)
        r_v = passive.damping_matrix(q) - of.rhs[:n, n:]
        if self._system.slopes.are_known:
            by_q, by_v = self._system.slopes.at(t, q, v)
            r_q, r_v = r_q - by_q, r_v - by_v
        return Partials(self._system.mass(q), of.J, r_q, r_v)
