"""Stiff damping: how fast the damping of joints alone would stop them, beside the step of a run.

    v' = -P D v,    P = M^-1 - M^-1 J^T (J M^-1 J^T)^+ J M^-1

P is the inverse inertia that the constraints leave. An explicit method is stable while dt times the
largest eigenvalue of P D is below its wall on the negative axis: 2 for Euler's, 2.785 for
Runge-Kutta 4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin import tolerances
from condyn_pin.algebra.minimum_norm import factorise
from condyn_pin.algebra.pivots import first_of_largest
from condyn_pin.arrays import Array
from condyn_pin.simulation.walls import wall

if TYPE_CHECKING:
    from condyn_pin.simulation.integrators.base import Integrator
    from condyn_pin.simulation.system import System


def stiff_damping(system: System, integrator: Integrator, dt: float, q: Array) -> str:
    """Return which joint's damping an integrator cannot follow at dt, and what would do.

    Parameters
    ----------
    system : System
    integrator : Integrator
    dt : float
        [s]
    q : (nq,) array
        Where the inertia is that of the machine.

    Returns
    -------
    str
        Empty if there is none.
    """
    if integrator.takes_stiff_damping or not system.passive.d.any():
        return ""
    rate, i = _fastest(system, q)
    limit = 2 * wall(integrator, beta_per_alpha=0.0)  # c'' + 2 alpha c' = 0
    if rate * dt < limit:
        return ""
    joint = next(k for k, each in enumerate(system.model.joints) if 0 <= i - each.idx_v < each.nv)
    return (
        f"the damping of joint {system.model.names[joint]!r} ({system.passive.d[i]:.3g} N m s/rad "
        f"or N s/m) has a rate of {rate:.3g} / s, and {integrator.title} follows no more than "
        f"{limit:.3g} / dt: use SemiImplicitEuler(), LinearlyImplicitMidpoint(), or dt below "
        f"{limit / rate:.2g} s"
    )


def _fastest(system: System, q: Array) -> tuple[float, int]:
    """Return the largest eigenvalue of P D [1/s], and the velocity that takes most part in it.

    Of several that do, the first.
    """
    factors = factorise(system.mass(q), system.jacobian(q), tolerances.RANK)
    root = np.sqrt(system.passive.d)
    # those of D^1/2 P D^1/2, where P r is the a of M a - J^T lam = r, J a = 0
    P_root, _ = factors.solve(np.diag(root), np.zeros((system.m, len(root))))
    rates, modes = np.linalg.eigh(root[:, None] * P_root)
    # two legs have the same rate, and any mixture of their modes is one
    fastest = modes[:, rates >= (1.0 - tolerances.TIED) * rates[-1]]
    return float(rates[-1]), first_of_largest(np.linalg.norm(fastest, axis=1))
