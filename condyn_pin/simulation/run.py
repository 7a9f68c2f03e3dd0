"""The verb simulate: a scene in motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arguments import check_called
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.constraints.drift import Drift
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.constraints.path import check_along
from condyn_pin.dynamics.scene import Scene, check_at_all_times, check_scene
from condyn_pin.dynamics.solvers import Solver
from condyn_pin.errors import CondynError, InvalidArgument, NotAssembled
from condyn_pin.simulation.breakdown import hint_of, is_lost, remedy_of
from condyn_pin.simulation.events import Ended, Event, ZenoDetected
from condyn_pin.simulation.fit import check_fit, check_penetration, velocity_of_steps
from condyn_pin.simulation.hybrid_phase import HybridPhase
from condyn_pin.simulation.hybrid_simulator import HybridSimulator
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.motion_limits import MotionLimits
from condyn_pin.simulation.outcome import Effects, Run, RunStatus
from condyn_pin.simulation.plan import Plan, check_closing, plan
from condyn_pin.simulation.recorder import merge
from condyn_pin.simulation.torques import Torque, TorqueJacobian
from condyn_pin.simulation.trajectory import Trajectory

# Where the rates of a path are compared with its differences, as shares of the duration.
_LOOKS = (0.21, 0.47, 0.83)


def simulate(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: float | ArrayLike | Torque = 0.0,
    *,
    forces: Sequence[AppliedForce] = (),
    jacobian: TorqueJacobian | None = None,
    duration: float,
    dt: float = 1e-3,
    integrator: Integrator | None = None,
    drift: Drift | None = None,
    solver: Solver | None = None,
    record: int = 1,
    events: Sequence[Event] = (),
    close_start: bool = True,
    gravity: bool = True,
    springs: bool = True,
    damping: bool = True,
    armature: bool = True,
    limits: MotionLimits | None = None,
    progress: Callable[[float], object] | None = None,
) -> Trajectory:
    """Return the motion of a scene from a state.

    M(q) a + h(q, v) = tau - k (q - q0) - d v + J(q)^T lam + sum J_f(q)^T f,
    J a + gamma = a_ref

    Parameters
    ----------
    scene : Scene
        Contacts without an anchor are anchored where they are at the start.
    q, v : (nq,), (nv,) array_like
        A state that satisfies the constraints, up to 1e-4 m and rad, unless `close_start` is False.
    tau : 0, (nv,) array_like or callable, optional
        The torques applied [N, N m]: constant, or tau(t, q, v). A function is called at every stage
        of a step, with states that may be thrown away, and may not write to its arguments.
    forces : sequence of AppliedForce, optional
        Forces from outside, constant or functions of (t, q, v), called as tau is; none by default.
        The `tau` of the trajectory, and its work, have J_f^T f in them.
    jacobian : callable, optional
        (t, q, v) -> the derivatives of the function tau by q and by v, (nv, nv) each, for the
        integrators that are implicit (`Integrator.takes_jacobian`): stiff springs and dampers in it
        need no small dt then. Without it the fully implicit ones take differences where they need
        them, for 2 nv + 1 calls of tau a step, and `notices` says so. What `forces` do is added.
    duration : float
        Length of the motion [s].
    dt : float
        The step [s]. If `duration` is not a whole number of steps, it is reduced a little.
    integrator : Integrator, optional
        `StewartTrinkle()` by default where contacts may open (`EventDriven()` locates their
        events), else `RungeKutta4()`: four solves a step, and an error of order dt^4. For six
        digits it takes a tenth of the steps of a method of order 2, a thousandth of Euler's. For
        very long motions, or where energy matters most, take an integrator that keeps the
        constraints.
    drift : Drift, optional
        What keeps the constraints closed. By default `PostStabilization()`, which has no gains to
        choose; `NoDrift()` if no scene has constraints, events' scenes included, the integrator
        keeps them itself, or the solver makes them soft.
    solver : Solver, optional
        As in `solve`; by default with four iterations at most where rows are redundant, since more
        change nothing (`condyn_pin.simulation.plan`).
    record : int
        Keep every `record`-th sample. The first and the last one, and those at events, are always
        kept.
    events : sequence of Event, optional
        Changes on the way: other contacts, impacts, the end.
    close_start : bool
        Whether the start has to satisfy the constraints, and bodies to be apart. With False the
        drift scheme closes what is open, as `Baumgarte` does at the rate of its gains; it has to be
        one that does. Penetrations are pushed out by `StewartTrinkle`, at 0.2 m/s at most.
    gravity, springs, damping, armature : bool
        Which effects of the robot's model are on; see `Effects`.
    limits : MotionLimits, optional
        What gaps, penetrations and energy without work may be in a motion that is ok; by default
        after dt and the size of the machine.
    progress : callable, optional
        Called with the share of the motion that is done, from 0 to 1, a hundred times.

    Returns
    -------
    Trajectory
        Also of a run that broke down: its `status` and `reason` say so, and its samples go to the
        last state that could be solved. They say too where loops came open, bodies penetrated, or
        energy appeared or vanished without work, by more than `limits`.

    Raises
    ------
    InvalidArgument
        If an argument cannot be used, gains of `drift` are beyond the stability limit of the
        integrator, or `drift` cannot close the start.
    UnknownName
        If a force is on a frame that does not exist.
    NotAssembled
        If a loop is open at q, v does not keep it closed, or a contact penetrates.
    SolveFailed, StepFailed
        If not even the first state can be solved, or no step with contacts leads away from it.
    UnsupportedConstraint
        If the solver cannot take a kind of constraint, or the integrator lets no contact open.

    Notes
    -----
    Cost: `Integrator.solves_per_step` solves per step, and a few microseconds; an event with
    another scene costs about as much as a hundred solves.
    """
    check_scene(scene)
    check_at_all_times(scene, "a motion begins at t = 0")
    if progress is not None:
        check_called("progress", progress, "share")
    effects = Effects(gravity=gravity, springs=springs, damping=damping, armature=armature)
    if not isinstance(close_start, bool):
        raise InvalidArgument(f"close_start = {close_start!r}: True or False is needed")
    planned = plan(
        scene, tau, duration=duration, dt=dt, integrator=integrator, drift=drift, solver=solver,
        record=record, effects=effects, events=events, forces=forces, jacobian=jacobian,
        limits=limits,
    )  # fmt: skip
    for bound in scene.bounds:
        if bound.drive:
            times = [share * planned.duration for share in _LOOKS]
            check_along(bound.drive.along, bound.size, bound.name, times)
    state = start(scene, q, v, planned, closed=close_start)
    if close_start:
        check_penetration(scene, state[0], planned.integrator)
    elif scene.rows and not _is_closed(scene, *state, planned):
        check_closing(planned.integrator, planned.drift)
    return follow(planned, *state, progress)[0]


def _is_closed(scene: Scene, q: Array, v: Array, plan: Plan) -> bool:
    """Return whether loops are closed at a state, and their velocities."""
    try:
        check_fit(scene, q, v, allowed=velocity_of_steps(scene, q, v, plan.integrator, plan.dt))
    except NotAssembled:
        return False
    return True


@one_blas_thread
def follow(
    plan: Plan,
    q: Array,
    v: Array,
    progress: Callable[[float], object] | None = None,
    phase: HybridPhase | None = None,
) -> tuple[Trajectory, HybridPhase]:
    """Return the motion from a state that was checked, and the phase that it ended on.

    A phase of the same plan, on which no event has changed the scene, spares the work of making
    another.
    """
    begun = perf_counter()
    plan.tau.differenced = 0
    with np.errstate(all="ignore"):  # what overflows is found by the next solve
        simulator = HybridSimulator(plan, q, v, phase)
        status, reason = _run(simulator, progress)
    phases, (t, positions, velocities, a, lam, torques), contact = merge(simulator.recorders)
    run = Run(
        duration=plan.duration, dt=plan.dt, integrator=plan.integrator, drift=plan.drift,
        solver=simulator.phase.solver, effects=plan.effects, limits=plan.limits, status=status,
        reason=reason,
        happened=tuple(simulator.happened), missed=simulator.missed(),
        differenced=plan.tau.differenced, remarks=simulator.remarks,
        wall_time=perf_counter() - begun,
    )  # fmt: skip
    motion = Trajectory(phases, t, positions, velocities, a, lam, torques, run, contact)
    return motion, simulator.phase


def _run(
    simulator: HybridSimulator, progress: Callable[[float], object] | None
) -> tuple[RunStatus, str]:
    """Take a run to its end: how it ended, and why."""
    steps, q0 = simulator.plan.steps, simulator.q
    stride = max(steps // 100, 1)

    def tick(done: int) -> None:
        if done % stride == 0 or done == steps:
            progress(done / steps)  # type: ignore[misc]

    try:
        simulator.run(tick if progress else None)
    except Ended as end:
        return RunStatus.ENDED, str(end)
    except ZenoDetected as end:
        return RunStatus.PILED_UP, str(end)
    except KeyboardInterrupt:
        if not any(recorder.count for recorder in simulator.recorders):
            raise
        return RunStatus.INTERRUPTED, f"interrupted after t = {simulator.t:g} s"
    except CondynError as error:
        lost = is_lost(simulator.v)
        if not lost:
            with suppress(CondynError):  # no step leads away from it, but it may be a sample
                simulator.phase.end(simulator.t, simulator.q, simulator.v)
        if not any(recorder.count for recorder in simulator.recorders):
            raise
        hint = hint_of(simulator, q0)
        # what no step can follow grows without bound, whatever it meets on the way
        grown = lost or (hint and simulator.t > 0)
        status = RunStatus.DIVERGED if grown else RunStatus.FAILED
        return status, f"after t = {simulator.t:g} s: {hint}{error}{remedy_of(simulator)}"
    if is_lost(simulator.v):
        fastest = np.abs(simulator.v).max()
        reason = (
            f"{hint_of(simulator, q0)}it moves at {fastest:.3g} rad/s or m/s{remedy_of(simulator)}"
        )
        return RunStatus.DIVERGED, reason
    return RunStatus.FINISHED, ""


def start(
    scene: Scene, q: ArrayLike, v: ArrayLike, plan: Plan, *, closed: bool = True
) -> tuple[Array, Array]:
    """Return the first state, which has to satisfy the constraints if it is to be closed."""
    q_ = scene.robot.arguments.configuration("q", q)
    v_ = np.array(finite("v", v, scene.robot.nv))
    scene.robot.check_unedited()
    if closed:
        check_fit(scene, q_, v_, allowed=velocity_of_steps(scene, q_, v_, plan.integrator, plan.dt))
    return q_, v_
