"""The verb simulate_batch: many motions of one scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Final

from numpy.typing import ArrayLike

from condyn_pin._core.rows import Native, Rows
from condyn_pin._core.threads import Kept
from condyn_pin._core.work import Arrays, Progress, silent
from condyn_pin.constraints.drift import Drift
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics import compiled
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.simulation.batch.compiled import Work, workers
from condyn_pin.simulation.batch.compiled_contact_motions import SteppedMotions
from condyn_pin.simulation.batch.compiled_motions import MovedRows, untaken, untaken_rows
from condyn_pin.simulation.batch.inputs import check_states, split
from condyn_pin.simulation.batch.motions import Motions
from condyn_pin.simulation.batch.recipe import Recipe
from condyn_pin.simulation.batch.samples import samples_in
from condyn_pin.simulation.batch.trajectory import ENDS, BatchTrajectory, kinds_of
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.motion_limits import MotionLimits, check_limits
from condyn_pin.simulation.plan import Plan, default_solver
from condyn_pin.simulation.torques import Torque, TorqueJacobian

# Samples that are checked where none is to be kept, at most, and how many steps are between two
# of them, at least: gaps and energies change slowly, and a look costs half a step.
_LOOKS: Final = 50
_APART: Final = 10

# A chunk that takes about a tenth of a second, for steps of some microseconds a solve.
_SOLVES: Final = 10_000

# Motions a thread of the compiled core that it is handed at a time.
_MOTIONS: Final = 16


def simulate_batch(
    scene: Scene,
    Q0: ArrayLike,
    V0: ArrayLike,
    TAU: float | ArrayLike | Torque = 0.0,
    *,
    forces: Sequence[AppliedForce] = (),
    jacobian: TorqueJacobian | None = None,
    duration: float,
    dt: float = 1e-3,
    integrator: Integrator | None = None,
    drift: Drift | None = None,
    solver: Solver | None = None,
    record: int | None = None,
    limits: MotionLimits | None = None,
    executor: Executor | Native | None = None,
    chunk: int | None = None,
    progress: Progress = silent,
) -> BatchTrajectory:
    """Return the motions of a scene from many states.

    M(q) a + h(q, v) = tau - k (q - q0) - d v + J(q)^T lam + sum J_f(q)^T f,
    J a + gamma = a_ref,    row by row

    Parameters
    ----------
    scene : Scene
        Contacts without an anchor are anchored where they are at the start of each motion.
    Q0, V0 : (N, nq), (N, nv) array_like
        States that satisfy the constraints, up to 1e-4 m and rad. As all numbers here they are
        taken in double precision: those of float32 have its 1e-7.
    TAU : 0, (nv,) or (N, nv) array_like, or callable, optional
        The torques applied [N, N m]: the same for all, constant for each, or tau(t, q, v), a
        function that is defined in a module, or an instance of a class there, if there are
        processes.
    forces : sequence of AppliedForce, optional
        Forces from outside, as in `simulate`; with two axes one row per motion. None by default.
    jacobian, duration, dt, integrator, drift, solver
        As in `simulate`.
    record : int, optional
        Keep every `record`-th sample, in 8 (1 + nq + 3 nv + m) bytes each: 1.2 kB of Cassie on its
        loops. By default none is: every tenth is checked, or fifty of each motion.
    limits
        As in `simulate`, at the samples that are checked.
    executor, chunk, progress
        As in `solve_batch`; a chunk takes about a tenth of a second by default.

    Returns
    -------
    BatchTrajectory
        To the bit what `simulate` returns, whoever did the work. Motions that break down, leave
        their `limits`, or cannot begin, raise nothing: ``failed`` has their indices, ``counts``
        their number, ``reasons`` what, where, when and how far.

    Raises
    ------
    InvalidArgument
        If an argument cannot be used; the text names the row.
    WorkersLost
        As in `solve_batch`; its ``done`` is the BatchTrajectory of what was simulated.
    Interrupted
        After Ctrl-C; its ``table`` is the same.
    UnknownName, UnsupportedConstraint, StaleModel, UnsupportedBackend
        As in `solve_batch`.

    Notes
    -----
    Cost: that of the steps, divided by the workers, and half a millisecond per motion, or two if
    contacts have to be anchored. Only `simulate` has events, and can switch effects off.
    """
    begun = perf_counter()
    function = TAU if callable(TAU) else None
    every = 1 if record is None else record
    limits = check_limits(limits)
    motions = Motions(function, jacobian, duration, dt, integrator, drift, solver, every, limits)
    planned = motions.plan(scene)
    every = max(planned.steps // _LOOKS, _APART) if record is None else record
    given: ArrayLike = 0.0 if function is not None else TAU  # type: ignore[assignment]
    q, v, tau = check_states(scene.robot, Q0, V0, given, suffix="0")
    applied, of_rows, more = split(scene.robot, forces, len(q), functions=True)
    motions = replace(motions, every=every, forces=of_rows, contacts=tuple(scene.contacts))
    most = max(1, int(_SOLVES / planned.steps / max(planned.integrator.solves_per_step, 1)))
    held = _begun(scene.bilateral)
    recipe = Recipe(held, solver)
    if isinstance(executor, Native):  # whose workspace is that of the motions
        recipe = Recipe(held, solver or default_solver(held), planned.drift.rows)
    moved: Work = MovedRows(
        planned.integrator, planned.drift, planned.dt, planned.steps, every, limits
    )
    if scene.contacts:
        moved = SteppedMotions(
            tuple(scene.contacts), planned.integrator, planned.dt, planned.steps, every, limits
        )
    kernel, executor, chunk = workers(
        executor, moved, motions, reasons=untaken(planned, bool(applied)),
        untaken=lambda: untaken_by_core(recipe.workspace(), planned), chunk=chunk,
        most=_MOTIONS,
    )  # fmt: skip
    rows = Rows(kernel, recipe, executor, chunk, most, progress)
    kinds = kinds_of(scene, 0 if record is None else len(range(0, planned.steps, every)) + 1)
    inputs = {"q0": q, "v0": v, "tau0": tau} | more
    return rows.fill(len(q), inputs, kinds, partial(_batch, planned, begun))


def untaken_by_core(workspace: Workspace, planned: Plan) -> Iterator[str]:
    """Yield what the compiled core does not take of a workspace that is to move."""
    yield from compiled.untaken(workspace)
    if not planned.scene.contacts:  # whose steps have the rows of the scene themselves
        yield from untaken_rows(workspace, planned.drift)


_started = Kept[Scene]()


def _begun(scene: Scene) -> Scene:
    """Return a scene where motions begin: the same one each time, so that its workspace is."""
    return _started.of(scene, None, lambda: scene.at(0.0)) if scene.is_driven else scene


def _batch(planned: Plan, begun: float, outputs: Arrays) -> BatchTrajectory:
    """Return the outputs as a value."""
    solver = default_solver(planned.scene.bilateral) if planned.solver is None else planned.solver
    return BatchTrajectory(
        planned.scene, planned.integrator, planned.drift, solver, planned.duration, planned.dt,
        planned.steps, planned.limits, **{name: outputs[name] for name in ENDS},
        reasons=outputs["words"], samples=samples_in(outputs), seconds=perf_counter() - begun,
    )  # fmt: skip
