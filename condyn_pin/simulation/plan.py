"""Plan: what a simulation does from whatever state it begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import ceil

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_called, check_count, check_type, seconds, step_size
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.drift import Drift
from condyn_pin.constraints.forces import AppliedForce, applied_forces
from condyn_pin.dynamics import workspace
from condyn_pin.dynamics.at_state import (
    constraint_velocities,
    equations_of,
    gaps,
    gaps_at,
    to_close,
)
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.errors import InvalidArgument, NotAssembled, UnsupportedConstraint
from condyn_pin.mechanism.rank import Check
from condyn_pin.simulation import integrators
from condyn_pin.simulation.drift import NoDrift, PostStabilization
from condyn_pin.simulation.events import Event, checked_events
from condyn_pin.simulation.integrators.contact_scheme import PUSHES, ContactScheme
from condyn_pin.simulation.integrators.explicit import RungeKutta4
from condyn_pin.simulation.integrators.integrator import Integrator
from condyn_pin.simulation.measures import gauge_of
from condyn_pin.simulation.motion_status import Effects, MotionLimits, check_limits
from condyn_pin.simulation.records import candidates_of
from condyn_pin.simulation.stability import check_stability_limit
from condyn_pin.simulation.torques import AppliedTorques, Torque, TorqueJacobian
from condyn_pin.stepping.schemes.stewart_trinkle import StewartTrinkle

# More samples do not fit into a memory.
_MOST_STEPS = 10**9

# Iterations where rows are redundant; see `default_solver`.
_ITERATIONS = 4


@dataclass(frozen=True)
class Plan:
    """The choices of a run, checked; without a solver each scene takes its own by default."""

    scene: Scene
    tau: AppliedTorques
    duration: float  # [s], what was asked for
    dt: float  # [s], the step
    steps: int
    every: int  # which sample is kept
    integrator: Integrator
    drift: Drift
    solver: Solver | None
    effects: Effects
    events: tuple[Event, ...]
    limits: MotionLimits = field(default_factory=MotionLimits)
    at_events: bool = True  # whether samples are kept where contacts strike, open or slide


def plan(
    scene: Scene, tau: float | ArrayLike | Torque, *, duration: float, dt: float,
    integrator: Integrator | None, drift: Drift | None, solver: Solver | None, record: int,
    effects: Effects | None = None, events: Sequence[Event] = (),
    forces: Sequence[AppliedForce] = (),
    jacobian: TorqueJacobian | None = None, limits: MotionLimits | None = None,
) -> Plan:  # fmt: skip
    """Return the plan of a run; arguments and errors are those of `simulate`."""
    check_scene(scene)
    effects, happenings = effects or Effects(), checked_events(scene, events)
    steps, dt = _steps(duration, dt)
    integrator = default_integrator(scene, happenings) if integrator is None else integrator
    check_type(
        "integrator", integrator, Integrator, "an integrator is needed, such as RungeKutta4()"
    )
    _check_contacts(scene, integrator, happenings)
    drift = default_drift(scene, integrator, solver, happenings) if drift is None else drift
    check_type("drift", drift, Drift, "a drift scheme is needed, such as Baumgarte")
    _check_drift(integrator, drift, dt)
    for each in _scenes(scene, happenings):
        for constraint in each.constraints:
            if constraint.drift:
                check_stability_limit(integrator, constraint.drift, dt)
    check_count("record", record)
    _check_jacobian(tau, jacobian, integrator)
    torque = AppliedTorques(scene.robot, tau, jacobian, applied_forces(forces, functions=True))
    return Plan(
        scene=scene, tau=torque, duration=duration, dt=dt, steps=steps, every=record,
        integrator=integrator, drift=drift, solver=solver, effects=effects, events=happenings,
        limits=check_limits(limits),
    )  # fmt: skip


def _steps(duration: float, dt: float) -> tuple[int, float]:
    """Number of steps, and their size [s]."""
    duration, dt = seconds("duration", duration), seconds("dt", dt)
    ratio = duration / dt
    if ratio > _MOST_STEPS:
        raise InvalidArgument(
            f"duration = {duration:g} s in steps of dt = {dt:g} s: more than {_MOST_STEPS:g} steps"
        )
    steps = max(ceil(ratio * (1 - 1e-12)), 1)
    # dt itself where it fits: duration / steps would be another number
    dt = dt if abs(steps - ratio) < 1e-9 * ratio else duration / steps
    return steps, step_size(dt)


def check_closing(scene: Scene, integrator: Integrator, drift: Drift) -> None:
    """Refuse choices with which an open start would stay open, or be closed by a leap."""
    if integrator.keeps_constraints:
        raise InvalidArgument(
            f"close_start = False: {integrator.title} would close the start within one step, and "
            "move by that; use RungeKutta4() with Baumgarte.critical(10.0)"
        )
    if drift.corrects and drift.closes:
        return
    for constraint in scene.constraints:
        if not (constraint.drift or drift).closes:
            whose = (
                f"{constraint.name} has a drift of its own, and its " if constraint.drift else ""
            )
            raise InvalidArgument(
                f"close_start = False: {whose}drift = {constraint.drift or drift!r} closes no gap "
                f"of {constraint.name}; use Baumgarte.critical(10.0) there, or a state of "
                "Scene.assemble()"
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
    if not integrator.uses_torque_jacobian:
        can = ", ".join(
            sorted(k.__name__ for k in integrators.INTEGRATORS.values() if k().uses_torque_jacobian)
        )
        raise InvalidArgument(f"jacobian: {integrator.title} does not use it; {can} do")


def _check_drift(integrator: Integrator, drift: Drift, dt: float) -> None:
    """Refuse gains that the integrator cannot take."""
    if drift.rows is None:
        return
    if integrator.keeps_constraints:
        raise InvalidArgument(
            f"drift = {drift!r}: {integrator.title} keeps the constraints itself; use NoDrift()"
        )
    check_stability_limit(integrator, drift.rows, dt)


def default_integrator(scene: Scene, events: Sequence[Event]) -> Integrator:
    """Return the default integrator: contacts that may open take one of their own."""
    scenes = _scenes(scene, events)
    return StewartTrinkle() if any(each.contacts for each in scenes) else RungeKutta4()


def _scenes(scene: Scene, events: Sequence[Event]) -> tuple[Scene, ...]:
    """Scenes of a motion: the first, and those that events bring."""
    return (scene, *(event.scene for event in events if event.scene))


def check_scheme(scene: Scene, integrator: Integrator) -> None:
    """Refuse an integrator that cannot do with contacts or gains what a scene says of them."""
    if scene.contacts and not integrator.takes_contacts:
        raise UnsupportedConstraint(
            f"integrator = {integrator!r}: contacts of the scene may open and slide, and "
            f"{integrator.title} never lets them go; use StewartTrinkle() or Moreau(), "
            "EventDriven(RungeKutta4()), or scene.closed()"
        )
    if integrator.takes_contacts:
        integrator.check(candidates_of(scene))
    for constraint in scene.constraints:
        if constraint.drift and integrator.keeps_constraints:
            raise InvalidArgument(
                f"{constraint.name}: its drift = {constraint.drift!r}, and {integrator.title} "
                "keeps the constraints itself; use dataclasses.replace(constraint, drift=None)"
            )


def _check_contacts(scene: Scene, integrator: Integrator, events: Sequence[Event]) -> None:
    for each in _scenes(scene, events):
        check_scheme(each, integrator)


def default_drift(
    scene: Scene, integrator: Integrator, solver: Solver | None, events: Sequence[Event]
) -> Drift:
    """Return the default drift scheme."""
    # One that has no gains to choose and costs no solve. Of a gap it leaves the square; moving the
    # bodies then leaves J v a little off: below 1e-9 m and 1e-3 m/s on Cassie's loops with 1 ms.
    # it has a spring of its own; what is no solver is refused where it is used
    soft = isinstance(solver, Solver) and not solver.exact
    scenes = _scenes(scene, events)
    if integrator.keeps_constraints or soft or not any(each.rows for each in scenes):
        return NoDrift()
    return PostStabilization()


def default_solver(scene: Scene) -> Solver:
    """Return the default solver: that of `solve`, without iterations that change nothing."""
    # Three iterations are enough where loops are closed. A step leaves them a little open; then
    # rows that are redundant come to life and ask for a lam that grows with every iteration up to
    # the limit, at three times the cost, and moves nothing: over runs on Cassie and on Bricard's
    # loop the state differs by less than 1e-9 from that of twenty iterations, and by 1e-12 where
    # loops close.
    solver = workspace.default_solver(scene)
    if isinstance(solver, Proximal) and not scene.nominal.independent:
        return replace(solver, max_iterations=_ITERATIONS)
    return solver


# Where a scene takes up a state: its loops have to be closed, and its contacts apart.


def check_initial_state(
    scene: Scene, q: Array, v: Array, *, allowed: float = 0.0, what: str = ""
) -> None:
    """Raise NotAssembled, said after `what`, if a loop or an anchored contact is open or opening.

    A |J v| of `allowed` [m/s, rad/s] is added to what is tolerated.
    """
    equations = equations_of(scene)
    c, J = equations.position_level(q)
    velocity, left = J @ v - equations.wanted[1], equations.left_out(J, c)
    velocity = left.kept(velocity) if left else velocity
    _raise(scene, to_close(scene, q, c), velocity, v, what, allowed)


def velocity_of_steps(scene: Scene, q: Array, v: Array, integrator: Integrator, dt: float) -> float:
    """Return the |J v| [m/s, rad/s] of states that an integrator goes through."""
    # Schemes with contacts make v+ tangent in the middle of the step: J v is dt gamma / 2 at its
    # end. Four times that is allowed.
    if not (scene.rows and isinstance(integrator, ContactScheme)):
        return 0.0
    equations = gauge_of(scene).equations
    equations.at(None)
    _, _, _, gamma = equations.parts(q, v)
    return 2 * dt * float(np.abs(gamma).max())


def check_penetration(scene: Scene, q: Array, integrator: Integrator) -> None:
    """Raise NotAssembled if a contact penetrates at q, unless it does at rest too."""
    pushes = isinstance(integrator, ContactScheme) and integrator.closes_gaps
    steps = "the steps" if pushes else "steps of StewartTrinkle()"
    cure = (
        "mechanism.place_on_ground(scene, q) puts a floating robot onto the floor; with "
        f"close_start=False {steps} push it out, at {PUSHES:g} m/s at most"
    )
    _raise_if_deep(scene, q, integrator, tolerances.NEARLY_CLOSED, "", f" at the start: {cure}")


def check_deeper(
    scene: Scene, before: Scene, q: Array, integrator: Integrator, *, what: str
) -> None:
    """Raise NotAssembled if a contact penetrates at q that a scene brings, by what no step left."""
    left = max(0.0, -float(gaps_at(before, q)[1].min(initial=0.0)))
    fresh = tuple(each for each in scene.contacts if each not in before.contacts)
    scene = replace(scene, constraints=(), contacts=fresh)
    cure = ": move what it touches, or let the event come before"
    _raise_if_deep(scene, q, integrator, max(tolerances.NEARLY_APART, left), what, cure)


def _raise_if_deep(
    scene: Scene, q: Array, integrator: Integrator, limit: float, what: str, cure: str
) -> None:
    if not scene.contacts or (
        isinstance(integrator, ContactScheme) and integrator.penetrates_at_rest
    ):
        return
    candidates, gaps = gaps_at(scene, q)
    if gaps.min(initial=0.0) < -limit:
        k = int(gaps.argmin())
        unit = "m" if candidates.is_length[k] else "rad"
        raise NotAssembled(f"{what}{candidates.names[k]} penetrates by {-gaps[k]:.3g} {unit}{cure}")


def check_velocity(scene: Scene, q: Array, v: Array, *, what: str = "") -> None:
    """Raise NotAssembled unless J v = 0, however open the loops are, driven or not."""
    _raise(scene, np.zeros(scene.rows), equations_of(scene).consistent_jacobian(q) @ v, v, what)


def _raise(
    scene: Scene, c: Array, velocity: Array, v: Array, what: str, allowed: float = 0.0
) -> None:
    speed = max(1.0, float(np.abs(v).max(initial=0.0)))
    fit = Check(gaps(scene, c), constraint_velocities(scene, velocity), speed, {})
    limit = tolerances.NEARLY_CLOSED
    try:
        fit.raise_if_open(violation=limit, constraint_velocity=limit + allowed / speed)
    except NotAssembled as error:
        raise NotAssembled(f"{what}{error}") from None


def check_solver(solver: Solver, plan: Plan) -> None:
    """Refuse constraints that would be both soft and rigid."""
    if solver.exact:
        return
    if plan.integrator.keeps_constraints:
        raise InvalidArgument(
            f"solver = {solver!r}: {plan.integrator.title} keeps hard constraints itself, and "
            "would leave none of them soft; use RungeKutta4() or another solver"
        )
    if plan.drift.corrects:
        raise InvalidArgument(
            f"drift = {plan.drift!r}: it closes what {solver.title} lets open, and would "
            "leave nothing soft; use NoDrift() or another solver"
        )


def check_rows(scene: Scene, integrator: Integrator) -> None:
    """Refuse rows that an integrator cannot hold."""
    if not integrator.needs_positions:
        return
    for bound in scene.bounds:
        if len(bound.positioned) < bound.size:
            raise UnsupportedConstraint(
                f"{bound.name}: {integrator.title} holds positions, and it has rows that restrict "
                "velocities only; use RungeKutta4() or GearGuptaLeimkuhler()"
            )
