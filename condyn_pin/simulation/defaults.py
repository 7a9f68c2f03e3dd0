"""What a simulation takes that names no integrator, no drift scheme and no solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from condyn_pin.constraints.drift import Drift
from condyn_pin.dynamics import choice
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.simulation.drift.no_drift import NoDrift
from condyn_pin.simulation.drift.post_stabilization import PostStabilization
from condyn_pin.simulation.events import Event
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.integrators.runge_kutta4 import RungeKutta4

# Iterations where rows are redundant; see `default_solver`.
_ITERATIONS = 4


def default_integrator() -> Integrator:
    """Return the integrator for those who name none."""
    return RungeKutta4()


def default_drift(
    scene: Scene, integrator: Integrator, solver: Solver | None, events: Sequence[Event] = ()
) -> Drift:
    """Return the drift scheme for those who name none.

    One that has no gains to choose and costs no solve. Of a gap it leaves the square; moving the
    bodies then leaves some slip: below 1e-9 m and 1e-3 m/s on Cassie's loops with 1 ms.
    """
    # it has a spring of its own; what is no solver is refused where it is used
    soft = isinstance(solver, Solver) and not solver.exact
    scenes = (scene, *(event.scene for event in events if event.scene))
    if integrator.keeps_constraints or soft or not any(each.rows for each in scenes):
        return NoDrift()
    return PostStabilization()


def default_solver(scene: Scene) -> Solver:
    """Return the solver for those who name none: that of `solve`, without iterations in vain.

    Three iterations are enough where loops are closed. A step leaves them a little open; then rows
    that are redundant come to life and ask for a lam that grows with every iteration up to the
    limit, at three times the cost, and moves nothing: over runs on Cassie and on Bricard's loop the
    state differs by less than 1e-9 from that of twenty iterations, and by 1e-12 where loops close.
    """
    solver = choice.default_solver(scene)
    if isinstance(solver, Proximal) and not scene.nominal.independent:
        return replace(solver, max_iterations=_ITERATIONS)
    return solver
