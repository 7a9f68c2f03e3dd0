"""Why a run broke down, and what may help."""

from __future__ import annotations

from math import isfinite
from typing import Final

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.hybrid_simulator import HybridSimulator
from condyn_pin.simulation.stiffness import stiff_damping, stiff_springs

# A velocity beyond this is no motion of a machine [rad/s, m/s].
LOST: Final = 1e10


def is_lost(v: Array) -> bool:
    """Whether a velocity is beyond that of any machine."""
    speed = float(np.abs(v).max(initial=0.0))
    return not (isfinite(speed) and speed < LOST)


def hint_of(simulator: HybridSimulator, q0: Array) -> str:
    """Return which damping or spring is too stiff for a run from q0, if there is one."""
    plan, system = simulator.plan, simulator.phase.system
    integrator = plan.integrator.between_events
    hint = stiff_damping(system, integrator, plan.dt, q0)
    hint = hint or stiff_springs(system, integrator, plan.dt, q0)
    return f"{hint}; " if hint else ""


def remedy_of(simulator: HybridSimulator) -> str:
    """Return what may help a run whose torques are those of a function."""
    plan = simulator.plan
    if not (plan.integrator.takes_jacobian and plan.tau.could_be_differenced):
        return ""
    return "; if tau(t, q, v) is stiff, pass its derivatives as jacobian=..."
