"""The verb simulate: a scene in motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil, isfinite
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin.arguments import normalised
from condyn_pin.arrays import Array, finite
from condyn_pin.drift.base import Drift
from condyn_pin.errors import CondynError, InvalidArgument
from condyn_pin.scene import Scene
from condyn_pin.simulation.defaults import default_drift, default_integrator
from condyn_pin.simulation.effects import Effects
from condyn_pin.simulation.events import Event
from condyn_pin.simulation.fit import check_fit
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.leg import Method
from condyn_pin.simulation.loop import Ended, Loop, PiledUp
from condyn_pin.simulation.outcome import Run, RunStatus
from condyn_pin.simulation.recorder import merge
from condyn_pin.simulation.torques import Applied, Torque
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.simulation.walls import check_wall
from condyn_pin.solvers.base import Solver

# A velocity beyond this is no motion of a machine [rad/s, m/s].
_LOST = 1e10

# More samples do not fit into a memory.
_MOST_STEPS = 10**9


def simulate(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: float | ArrayLike | Torque = 0.0,
    *,
    duration: float,
    dt: float = 1e-3,
    integrator: Integrator | None = None,
    drift: Drift | None = None,
    solver: Solver | None = None,
    record: int = 1,
    events: Sequence[Event] = (),
    gravity: bool = True,
    springs: bool = True,
    damping: bool = True,
    armature: bool = True,
    progress: Callable[[float], object] | None = None,
) -> Trajectory:
    """Return the motion of a scene from a state.

    M(q) a + h(q, v) = tau - k (q - q0) - d v + J(q)^T lam,    J a + gamma = a_ref

    Parameters
    ----------
    scene : Scene
        Contacts without an anchor are anchored where they are at the start.
    q, v : (nq,), (nv,) array_like
        A state that satisfies the constraints, up to 1e-4 m and rad.
    tau : 0, (nv,) array_like or callable, optional
        The torques applied [N, N m]: constant, or tau(t, q, v). A function is called at every stage
        of a step, with states that may be thrown away, and may not write to its arguments.
    duration : float
        [s]
    dt : float
        The step [s]. If `duration` is not a whole number of steps, they are a little smaller.
    integrator : Integrator, optional
        `RungeKutta4()` by default: for the time of four solves a step its error falls with dt^4,
        so that it needs a tenth of the steps of a method of order 2, and a thousandth of those of
        Euler's, for six digits. Over very long times, and where energy is all that counts, take one
        that keeps the constraints.
    drift : Drift, optional
        What keeps the constraints closed. By default `PostStabilization()`, which has no gains to
        choose; `NoDrift()` where there is nothing to do.
    solver : Solver, optional
        As in `solve`.
    record : int
        Every which sample is kept. The first and the last one, and those at events, always are.
    events : sequence of Event, optional
        What happens on the way: other contacts, impacts, the end.
    gravity, springs, damping, armature : bool
        Which effects of the robot's model are on; see `Effects`.
    progress : callable, optional
        Called with the share that is done, a hundred times.

    Returns
    -------
    Trajectory
        Also of a run that broke down: its `status` and `reason` say so, and its samples go to the
        last state that could be solved.

    Raises
    ------
    InvalidArgument
        If an argument cannot be used, or gains of `drift` are beyond the wall of the integrator.
    NotAssembled
        If a loop is open at q, or slips with v.
    SolveFailed
        If not even the first state can be solved.
    UnsupportedConstraint
        If the solver cannot take a kind of constraint.

    Notes
    -----
    Cost: `Integrator.solves_per_step` solves a step, and a few microseconds.
    """
    if not isinstance(scene, Scene):
        raise InvalidArgument(f"scene = {type(scene).__name__}: a Scene is needed")
    effects = Effects(gravity=gravity, springs=springs, damping=damping, armature=armature)
    q_, v_ = _start(scene, q, v)
    steps, dt = _steps(duration, dt)
    integrator = default_integrator() if integrator is None else integrator
    if not isinstance(integrator, Integrator):
        raise InvalidArgument(
            f"integrator = {integrator!r}: an integrator is needed, such as RungeKutta4()"
        )
    drift = default_drift(scene, integrator, solver) if drift is None else drift
    if not isinstance(drift, Drift):
        raise InvalidArgument(f"drift = {drift!r}: a drift scheme is needed, such as Baumgarte")
    _check_drift(integrator, drift, dt)
    _check_record(record)
    events = _events(scene, events)
    method = Method(Applied(scene.robot.nv, tau), dt, integrator, drift, solver, effects)
    begun = perf_counter()
    with np.errstate(all="ignore"):  # what overflows is found by the next solve
        loop = Loop(scene, q_, v_, method, events)
        status, reason = _run(loop, steps, record, progress)
    phases, (t, positions, velocities, a, lam, torques) = merge(loop.recorders)
    run = Run(
        duration=duration, dt=dt, integrator=integrator, drift=drift, solver=loop.leg.solver,
        effects=effects, status=status, reason=reason, happened=tuple(loop.happened),
        wall_time=perf_counter() - begun,
    )  # fmt: skip
    return Trajectory(phases, t, positions, velocities, a, lam, torques, run)


def _run(
    loop: Loop, steps: int, every: int, progress: Callable[[float], object] | None
) -> tuple[RunStatus, str]:
    """Run a loop to its end: how it ended, and why."""
    stride = max(steps // 100, 1)

    def tick(done: int) -> None:
        if progress and (done % stride == 0 or done == steps):
            progress(done / steps)

    try:
        loop.run(steps, every, tick)
    except Ended as end:
        return RunStatus.ENDED, str(end)
    except PiledUp as end:
        return RunStatus.PILED_UP, str(end)
    except KeyboardInterrupt:
        return RunStatus.INTERRUPTED, f"interrupted after t = {loop.t:g} s"
    except CondynError as error:
        if not any(recorder.count for recorder in loop.recorders):
            raise
        speed = float(np.abs(loop.v).max(initial=0.0))
        lost = not (isfinite(speed) and speed < _LOST)
        status = RunStatus.DIVERGED if lost else RunStatus.FAILED
        return status, f"after t = {loop.t:g} s: {error}"
    return RunStatus.FINISHED, ""


def _start(scene: Scene, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
    """Return the first state, which has to satisfy the constraints."""
    q_ = normalised(scene.robot.model, "q", q)
    v_ = np.array(finite("v", v, scene.robot.nv))
    scene.robot.check_unedited()
    check_fit(scene, q_, v_)
    return q_, v_


def _steps(duration: float, dt: float) -> tuple[int, float]:
    """Return how many steps there are, and their size."""
    for argument, value in (("duration", duration), ("dt", dt)):
        if not finite(argument, value, ()) > 0:
            raise InvalidArgument(f"{argument} = {value!r}: a number > 0 [s] is needed")
    ratio = duration / dt
    if ratio > _MOST_STEPS:
        raise InvalidArgument(
            f"duration = {duration:g} s in steps of dt = {dt:g} s: more than {_MOST_STEPS:g} steps"
        )
    steps = max(ceil(ratio * (1 - 1e-12)), 1)
    # dt itself where it fits: duration / steps would be another number
    return steps, float(dt) if abs(steps - ratio) < 1e-9 * ratio else duration / steps


def _check_drift(integrator: Integrator, drift: Drift, dt: float) -> None:
    """Refuse gains that the integrator cannot take."""
    if drift.rows is None:
        return
    if integrator.keeps_constraints:
        raise InvalidArgument(
            f"drift = {drift!r}: {integrator.title} keeps the constraints itself; use NoDrift()"
        )
    check_wall(integrator, drift.rows, dt)


def _check_record(record: int) -> None:
    whole = isinstance(record, (int, np.integer)) and not isinstance(record, bool)
    if not whole or record < 1:
        raise InvalidArgument(f"record = {record!r}: a whole number from 1 is needed")


def _events(scene: Scene, events: Sequence[Event]) -> tuple[Event, ...]:
    """Return the events, which have to fit the scene and to have names of their own."""
    if isinstance(events, Event):
        raise InvalidArgument("events: a list is needed, also for a single event")
    checked = tuple(events)
    for event in checked:
        if not isinstance(event, Event):
            raise InvalidArgument(f"events: {event!r} is not an Event")
        if sum(other.name == event.name for other in checked) > 1:
            raise InvalidArgument(f"two events are named {event.name!r}")
        for other in (event.scene, event.met):
            if other is not None and other.robot.model != scene.robot.model:
                raise InvalidArgument(
                    f"event {event.name!r}: its scene is of another model than the one simulated"
                )
        if event.at is not None and event.at <= 0:
            raise InvalidArgument(f"event {event.name!r}: at = {event.at:g}: after the start")
    return checked
