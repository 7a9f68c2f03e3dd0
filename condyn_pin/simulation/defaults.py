"""What a simulation takes that names no integrator and no drift scheme."""

from __future__ import annotations

from condyn_pin.drift.base import Drift
from condyn_pin.drift.baumgarte import Baumgarte
from condyn_pin.drift.no_drift import NoDrift
from condyn_pin.scene import Scene
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.integrators.runge_kutta4 import RungeKutta4
from condyn_pin.solvers.base import Solver

# alpha dt of critical damping with the smallest gaps and energy errors, on a pendulum for 10 s.
# Higher orders have little drift, and larger gains disturb them; Euler's methods drift so much that
# only strong gains hold it, far from their wall still.
_GENTLE, _STRONG = 0.03, 0.3


def default_integrator() -> Integrator:
    """Return the integrator for those who name none."""
    return RungeKutta4()


def default_drift(scene: Scene, integrator: Integrator, solver: Solver | None, dt: float) -> Drift:
    """Return the drift scheme for those who name none."""
    soft = solver is not None and not solver.exact  # it has a spring of its own
    if integrator.keeps_constraints or soft or not scene.rows:
        return NoDrift()
    return Baumgarte.critical((_GENTLE if integrator.order.q > 2 else _STRONG) / dt)
