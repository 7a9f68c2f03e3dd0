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

    One that has no gains to choose and costs no solve. Of a gap it leaves the square; moving the
    bodies then leaves some slip: below 1e-9 m and 1e-3 m/s on Cassie's loops with 1 ms.
    """
    # it has a spring of its own; what is no solver is refused where it is used
    soft = isinstance(solver, Solver) and not solver.exact
    if integrator.keeps_constraints or soft or not scene.rows:
        return NoDrift()
    return PostStabilization()
