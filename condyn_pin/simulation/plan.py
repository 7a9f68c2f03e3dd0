"""Plan: what a simulation does from whatever state it begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

from numpy.typing import ArrayLike

from condyn_pin._core.arrays import finite
from condyn_pin._core.errors import InvalidArgument
from condyn_pin._core.knobs import check_called, check_count
from condyn_pin.constraints.applied_force import AppliedForce, applied_forces
from condyn_pin.constraints.drift import Drift
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.simulation.defaults import default_drift, default_integrator
from condyn_pin.simulation.effects import Effects
from condyn_pin.simulation.events import Event
from condyn_pin.simulation.integrators import INTEGRATORS, Integrator
from condyn_pin.simulation.leg import Method
from condyn_pin.simulation.pushed import Pushed
from condyn_pin.simulation.slopes import TorqueJacobian
from condyn_pin.simulation.torques import Applied, Torque
from condyn_pin.simulation.walls import check_wall

# More samples do not fit into a memory.
_MOST_STEPS = 10**9

# Steps whose squares are numbers [s].
_SHORTEST, _LONGEST = 1e-150, 1e150


@dataclass(frozen=True)
class Plan:
    """The choices of a run, checked.

    Attributes
    ----------
    scene : Scene
    method : Method
    duration : float
        What was asked for [s].
    steps, every : int
        How many steps there are, and every which sample is kept.
    pushed : Pushed or None
        The torques with the forces from outside, where there are any: what `method` applies.
    """

    scene: Scene
    method: Method
    duration: float  # [s]
    steps: int
    every: int
    pushed: Pushed | None = None


def plan(
    scene: Scene, tau: float | ArrayLike | Torque, *, duration: float, dt: float,
    integrator: Integrator | None, drift: Drift | None, solver: Solver | None, record: int,
    effects: Effects | None = None, events: Sequence[Event] = (),
    forces: Sequence[AppliedForce] = (),
    jacobian: TorqueJacobian | None = None,
) -> Plan:  # fmt: skip
    """Return the plan of a run; arguments and errors are those of `simulate`."""
    check_scene(scene)
    effects = Effects() if effects is None else effects
    steps, dt = _steps(duration, dt)
    integrator = default_integrator() if integrator is None else integrator
    if not isinstance(integrator, Integrator):
        raise InvalidArgument(
            f"integrator = {integrator!r}: an integrator is needed, such as RungeKutta4()"
        )
    drift = default_drift(scene, integrator, solver, events) if drift is None else drift
    if not isinstance(drift, Drift):
        raise InvalidArgument(f"drift = {drift!r}: a drift scheme is needed, such as Baumgarte")
    _check_drift(integrator, drift, dt)
    check_count("record", record)
    _check_jacobian(tau, jacobian, integrator)
    checked, torque = applied_forces(forces, functions=True), Applied(scene.robot.nv, tau, jacobian)
    pushed = Pushed(scene.robot, torque, checked) if checked else None
    if pushed:
        torque = Applied(scene.robot.nv, pushed, pushed.jacobian)
    method = Method(torque, dt, integrator, drift, solver, effects)
    return Plan(scene, method, duration, steps, record, pushed)


def _steps(duration: float, dt: float) -> tuple[int, float]:
    """Return how many steps there are, and their size."""
    for argument, value in (("duration", duration), ("dt", dt)):
        if not finite(argument, value, ()) > 0:
            raise InvalidArgument(f"{argument} = {value!r}: a number > 0 [s] is needed")
    duration, dt = float(duration), float(dt)  # of numpy they may have fewer digits
    ratio = duration / dt
    if ratio > _MOST_STEPS:
        raise InvalidArgument(
            f"duration = {duration:g} s in steps of dt = {dt:g} s: more than {_MOST_STEPS:g} steps"
        )
    steps = max(ceil(ratio * (1 - 1e-12)), 1)
    # dt itself where it fits: duration / steps would be another number
    dt = dt if abs(steps - ratio) < 1e-9 * ratio else duration / steps
    if not _SHORTEST <= dt <= _LONGEST:
        raise InvalidArgument(
            f"dt = {dt:g}: its square is no number; a step between {_SHORTEST:g} and "
            f"{_LONGEST:g} s is needed"
        )
    return steps, dt


def check_closing(integrator: Integrator, drift: Drift) -> None:
    """Refuse choices with which an open start would stay open, or be closed by a leap."""
    if integrator.keeps_constraints:
        raise InvalidArgument(
            f"close_start = False: {integrator.title} would close the start within one step, and "
            "move by that; use RungeKutta4() with Baumgarte.critical(10.0)"
        )
    if not drift.closes:
        raise InvalidArgument(
            f"close_start = False: drift = {drift!r} closes no gap; use Baumgarte.critical(10.0), "
            "or a state of Scene.assemble()"
        )


def _check_jacobian(tau: object, jacobian: object, integrator: Integrator) -> None:
    """Refuse derivatives of torques that nothing would use."""
    if jacobian is None:
        return
    if not callable(jacobian):
        raise InvalidArgument(
            f"jacobian = {jacobian!r}: a function of (t, q, v) is needed, that returns tau by q "
            "and tau by v"
        )
    check_called("jacobian", jacobian, "t, q, v")
    if not callable(tau):
        raise InvalidArgument("jacobian: tau is no function, and its derivatives are zero")
    if not integrator.takes_jacobian:
        can = ", ".join(sorted(k.__name__ for k in INTEGRATORS.values() if k().takes_jacobian))
        raise InvalidArgument(f"jacobian: {integrator.title} does not use it; {can} do")


def _check_drift(integrator: Integrator, drift: Drift, dt: float) -> None:
    """Refuse gains that the integrator cannot take."""
    if drift.rows is None:
        return
    if integrator.keeps_constraints:
        raise InvalidArgument(
            f"drift = {drift!r}: {integrator.title} keeps the constraints itself; use NoDrift()"
        )
    check_wall(integrator, drift.rows, dt)
