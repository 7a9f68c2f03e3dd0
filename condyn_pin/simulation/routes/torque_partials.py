"""How the torques of a step change with its start: applied ones, springs and damping.

tau = tau_a - (D + dt K) v - K (q - q_0) + J_f^T f
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.derivatives.base import slope
from condyn_pin.simulation.system import System


def torque_partials(
    system: System, t: float, q: Array, v: Array, ahead: float
) -> tuple[Array, Array]:
    """Return the torques by q and by v (nv, nv), springs and damping as they act `ahead` [s]."""
    passive, n = system.passive, len(v)
    by_q = np.diag(-passive.stiffness)
    by_v = np.diag(-passive.d - ahead * passive.stiffness)
    if system.applied.constant is None:
        of_q, of_v = system.applied.slopes(t, q, v)
        by_q, by_v = by_q + of_q, by_v + of_v
    between = passive.between
    if between is not None:

        def pull(step: Array) -> Array:
            return between.torque(pin.integrate(system.model, q, step), v, ahead)

        by_q = by_q + np.column_stack([slope(pull, along) for along in np.eye(n)])
        by_v = by_v - between.damping(q) - ahead * between.stiffness(q)
    return by_q, by_v
