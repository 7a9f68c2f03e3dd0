"""The verbs for many states: solve_batch, derivatives_batch."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arguments import check_accuracy_of_a
from condyn_pin._core.arrays import read_only
from condyn_pin._core.rows import Native, Rows
from condyn_pin._core.work import Arrays, Kind, Progress, silent
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics.compiled import untaken, untaken_method
from condyn_pin.dynamics.derivatives import METHODS
from condyn_pin.dynamics.derivatives.differences import BLOCKS
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.errors import unknown_name
from condyn_pin.simulation.batch.answers import answer_rows, by_core
from condyn_pin.simulation.batch.compiled import workers
from condyn_pin.simulation.batch.inputs import check_states, split
from condyn_pin.simulation.batch.recipe import Recipe
from condyn_pin.simulation.batch.solution import BatchDerivatives, BatchSolution


def solve_batch(
    scene: Scene,
    Q: ArrayLike,
    V: ArrayLike,
    TAU: ArrayLike,
    *,
    forces: Sequence[AppliedForce] = (),
    solver: Solver | None = None,
    drift: Baumgarte | None = None,
    accuracy: float | None = None,
    executor: Executor | Native | None = None,
    chunk: int | None = None,
    progress: Progress = silent,
) -> BatchSolution:
    """Return accelerations and constraint forces at many states, with the errors of each.

    M(q) a + h(q, v) = tau + J(q)^T lam + sum J_f(q)^T f,    J a + gamma = a_ref,    row by row

    Parameters
    ----------
    scene : Scene
    Q : (N, nq) array_like
        Configurations [rad, m], one row per state; quaternions x y z w, normalised. As all numbers
        here they are taken in double precision: those of float32 have its 1e-7.
    V : (N, nv) array_like
        Velocities [rad/s, m/s]; a free-flyer's in its body frame, linear first.
    TAU : (N, nv) or (nv,) array_like, or 0
        Joint torques [N, N m]; with one axis the same for all states.
    forces : sequence of AppliedForce, optional
        Forces from outside; with two axes one row per state, else the same for all. None by
        default.
    solver, drift, accuracy
        As in `solve`.
    executor : Executor or Native, optional
        Who does the work: `Processes(2)`, any other `concurrent.futures.Executor`, Dask's
        ``client.get_executor()``, or ``Native(threads=2)``, the compiled core. This process by
        default. Threads of Python gain nothing: Pinocchio does not release the GIL.
    chunk : int, optional
        States that a worker is handed at a time; by default a sixteenth of what is left, 1000 at
        most.
    progress : callable
        Called with the number of states done and that of all, after each chunk.

    Returns
    -------
    BatchSolution
        To the bit what `solve` returns, whoever did the work. States that are not ok raise
        nothing: ``failed`` has their indices, ``counts`` their number.

    Raises
    ------
    InvalidArgument
        If an argument has a wrong shape, is not finite, or has an unnormalised quaternion; the
        text names the row.
    UnknownName
        If a force is on a frame that does not exist.
    WorkersLost
        If workers were lost and the executor cannot go on, or it is shut down; its ``done`` is the
        BatchSolution of what was solved (`map_chunks` says when).
    Interrupted
        After Ctrl-C; its ``table`` is the same.
    UnsupportedConstraint, StaleModel
        As in `solve`.
    UnsupportedBackend
        If the compiled core does not take what is asked for.

    Notes
    -----
    Cost: that of N solves, divided by the workers. A worker builds its workspace when it first gets
    a scene and solver, and keeps it for later chunks and calls. Processes on this machine read and
    write arrays in shared memory (Linux); other workers are sent copies of their rows.
    """
    start = perf_counter()
    inputs, count = _inputs(scene, Q, V, TAU, accuracy)
    applied, of_rows, more = split(scene.robot, forces, count)
    recipe = Recipe(scene, solver, drift)
    python = partial(answer_rows, None, accuracy, of_rows)
    kernel, executor, chunk = workers(
        executor, partial(by_core, False, accuracy, of_rows), python, reasons=(),
        untaken=lambda: untaken(recipe.workspace()), chunk=chunk, most=2000,
    )  # fmt: skip
    rows = Rows(kernel, recipe, executor, chunk, 1000, progress)
    batch = partial(_batch, recipe, inputs, applied, start)
    return rows.fill(count, inputs | more, _of_solution(scene), batch)


def derivatives_batch(
    scene: Scene,
    Q: ArrayLike,
    V: ArrayLike,
    TAU: ArrayLike,
    *,
    forces: Sequence[AppliedForce] = (),
    solver: Solver | None = None,
    drift: Baumgarte | None = None,
    method: str = "kkt",
    accuracy: float | None = None,
    executor: Executor | Native | None = None,
    chunk: int | None = None,
    progress: Progress = silent,
) -> BatchDerivatives:
    """Return how accelerations and constraint forces change, at many states.

    M da - J^T dlam = dtau - r_q dq - r_v dv,    J da = -s_q dq - s_v dv,    state by state

    Parameters
    ----------
    scene, Q, V, TAU, forces, executor, progress
        As in `solve_batch`.
    solver, drift, method, accuracy
        As in `derivatives`.
    chunk : int, optional
        As in `solve_batch`, but 100 states at most.

    Returns
    -------
    BatchDerivatives
        Six arrays, which take 24 nv (nv + m) bytes a state: 45 kB for Talos on two feet.

    Raises
    ------
    InvalidArgument, WorkersLost, UnsupportedConstraint, StaleModel, UnsupportedBackend
        As in `solve_batch` and `derivatives`. States that are not ok raise nothing.
    Interrupted
        As in `solve_batch`, with a BatchDerivatives.

    Notes
    -----
    Cost: that of `derivatives` a state, over the number of workers.
    """
    start = perf_counter()
    if method not in METHODS:
        raise unknown_name("method", str(method), METHODS)
    inputs, count = _inputs(scene, Q, V, TAU, accuracy)
    applied, of_rows, more = split(scene.robot, forces, count)
    recipe = Recipe(scene, solver, drift)
    python = partial(answer_rows, method, accuracy, of_rows)
    kernel, executor, chunk = workers(
        executor, partial(by_core, True, accuracy, of_rows), python,
        reasons=untaken_method(method), untaken=lambda: untaken(recipe.workspace()),
        chunk=chunk, most=500,
    )  # fmt: skip
    rows = Rows(kernel, recipe, executor, chunk, 100, progress)
    kinds = _of_solution(scene) | _of_derivatives(scene)
    batch = partial(_derivatives, recipe, inputs, applied, start)
    return rows.fill(count, inputs | more, kinds, batch)


def _inputs(
    scene: Scene, Q: ArrayLike, V: ArrayLike, TAU: ArrayLike, accuracy: float | None
) -> tuple[Arrays, int]:
    check_scene(scene)
    if accuracy is not None:
        check_accuracy_of_a(accuracy)
    q, v, tau = check_states(scene.robot, Q, V, TAU)
    return {"q": q, "v": v, "tau": tau}, len(q)


def _of_solution(scene: Scene) -> dict[str, Kind]:
    """Return what a row of each array of a `BatchSolution` is."""
    return {
        "a": Kind((scene.robot.nv,)),
        "lam": Kind((scene.rows,)),
        "residuals": Kind((5,)),
        "statuses": Kind((), "i1"),
        "iterations": Kind((), "i4"),
        "solve_times": Kind(()),
    }


def _of_derivatives(scene: Scene) -> dict[str, Kind]:
    n, m = scene.robot.nv, scene.rows
    return {name: Kind((n if name.startswith("da") else m, n)) for name in BLOCKS}


def _batch(
    recipe: Recipe, inputs: Arrays, applied: tuple[AppliedForce, ...], start: float, outputs: Arrays
) -> BatchSolution:
    """Return the outputs as a value."""
    scene, drift = recipe.scene, recipe.drift
    parts = {name: outputs[name] for name in _of_solution(scene)}
    q, v, tau = (inputs[name] for name in ("q", "v", "tau"))
    tau = np.broadcast_to(tau, (len(q), scene.robot.nv))
    q, v, tau = (read_only(each.copy()) for each in (q, v, tau))
    seconds = perf_counter() - start
    return BatchSolution(scene, q, v, tau, **parts, seconds=seconds, applied=applied, drift=drift)


def _derivatives(
    recipe: Recipe, inputs: Arrays, applied: tuple[AppliedForce, ...], start: float, outputs: Arrays
) -> BatchDerivatives:
    solution = _batch(recipe, inputs, applied, start, outputs)
    blocks = {name: outputs[name] for name in BLOCKS}
    return BatchDerivatives(solution, **blocks, seconds=solution.seconds)
