"""What a simulation takes that names no integrator and no drift scheme."""

from __future__ import annotations

from condyn_pin.drift.base import Drift
from condyn_pin.drift.no_drift import NoDrift
from condyn_pin.drift.post_stabilization import PostStabilization
from condyn_pin.scene import Scene
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.integrators.runge_kutta4 import RungeKutta4
from condyn_pin.solvers.base import Solver


def default_integrator() -> Integrator:
    """Return the integrator for those who name none."""
    return RungeKutta4()


def default_drift(scene: Scene, integrator: Integrator, solver: Solver | None) -> Drift:
    """Return the drift scheme for those who name none.

    One that has no gains to choose, keeps gap and slip near rounding whatever the step, and costs
    no solve.
    """
    soft = solver is not None and not solver.exact  # it has a spring of its own
    if integrator.keeps_constraints or soft or not scene.rows:
        return NoDrift()
    return PostStabilization()
