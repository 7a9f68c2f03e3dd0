"""The verbs for many states: solve_batch, derivatives_batch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core.arguments import check_accuracy_of_a, check_count
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.rows import Native, Verb, run
from condyn_pin._core.work import Arrays, Kind, Messages, Progress, map_chunks, silent
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics.compiled import why_not, why_not_method
from condyn_pin.dynamics.derivatives import METHODS
from condyn_pin.dynamics.derivatives.differences import BLOCKS
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument, SolveFailed, unknown_name
from condyn_pin.mechanism.projection import check_generator, sample
from condyn_pin.simulation.batch.inputs import PickledRecipe, Recipe, check_states, forces_in, split
from condyn_pin.simulation.batch.solution import STATUSES, BatchDerivatives, BatchSolution


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
        To the bit what `solve` returns, in any process. States that are not ok raise
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
    inputs, applied, first = _inputs(scene, Q, V, TAU, forces, accuracy)
    recipe = Recipe(scene, solver, drift)
    return run(
        SolvedRows(accuracy, first), recipe, inputs, _of_solution(scene),
        partial(_solution, recipe, inputs, applied, start), executor=executor, chunk=chunk,
        progress=progress,
    )  # fmt: skip


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
    """Return the derivatives of accelerations and constraint forces at many states.

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
    inputs, applied, first = _inputs(scene, Q, V, TAU, forces, accuracy)
    recipe = Recipe(scene, solver, drift)

    def batch(outputs: Arrays) -> BatchDerivatives:
        solution = _solution(recipe, inputs, applied, start, outputs)
        arrays = {name: outputs[name] for name in BLOCKS}
        return BatchDerivatives(solution, **arrays, seconds=solution.seconds)

    n, m = scene.robot.nv, scene.rows
    blocks = {name: Kind((n if name.startswith("da") else m, n)) for name in BLOCKS}

    return run(
        SolvedRows(accuracy, first, method, most=100, most_of_core=500), recipe, inputs,
        _of_solution(scene) | blocks, batch, executor=executor, chunk=chunk,
        progress=progress,
    )  # fmt: skip


def _inputs(
    scene: Scene, Q: ArrayLike, V: ArrayLike, TAU: ArrayLike, forces: Sequence[AppliedForce],
    accuracy: float | None,
) -> tuple[Arrays, tuple[AppliedForce, ...], tuple[AppliedForce, ...]]:  # fmt: skip
    check_scene(scene)
    if accuracy is not None:
        check_accuracy_of_a(accuracy)
    q, v, tau = check_states(scene.robot, Q, V, TAU)
    applied, first, more = split(scene.robot, forces, len(q))
    return {"q": q, "v": v, "tau": tau} | more, applied, first


def _of_solution(scene: Scene) -> dict[str, Kind]:
    """Row shape and dtype of each array of a `BatchSolution`."""
    return {
        "a": Kind((scene.robot.nv,)),
        "lam": Kind((scene.rows,)),
        "residuals": Kind((5,)),
        "statuses": Kind((), "i1"),
        "iterations": Kind((), "i4"),
        "solve_times": Kind(()),
    }


def _solution(
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


# Many random states that satisfy the constraints, over an executor.


# States that a worker is handed at a time: they take it longer than the way there and back.
_CHUNK: Final = 64

Streams = list[np.random.Generator]


def sample_batch(
    scene: Scene,
    n: int,
    rng: np.random.Generator,
    *,
    spread: float = 0.2,
    speed: float = 1.0,
    executor: Executor | None = None,
) -> tuple[Array, Array]:
    """Return n random states that satisfy the constraints, a row each.

    Row i is ``scene.sample(rng.spawn(n)[i])``: each state has its own random stream, so the states
    do not depend on which process draws them. A second call with the same generator gives different
    states.

    Parameters
    ----------
    scene : Scene
    n : int
        Number of states.
    rng : numpy.random.Generator
        The source of randomness, made from a seed.
    spread, speed
        As in `Scene.sample`.
    executor : Executor, optional
        Who does the work, as in `solve_batch`; this process by default.

    Returns
    -------
    Q : (n, nq) array
    V : (n, nv) array

    Raises
    ------
    InvalidArgument
        If an argument is none of these.
    NotAssembled
        As in `Scene.sample`, for any of the states.
    WorkersLost
        As in `solve_batch`.
    """
    check_count("n", n, least=0)
    check_generator(rng)
    try:
        streams = rng.spawn(n)
    except (TypeError, AttributeError) as error:
        raise InvalidArgument(
            f"rng = {rng!r}: it has no seed to spawn from ({error}); "
            "numpy.random.default_rng(seed) makes one that has"
        ) from error
    Q, V = np.zeros((n, scene.robot.nq)), np.zeros((n, scene.robot.nv))
    where = scene if executor is None else Recipe(scene).pickled()
    work = partial(_sample, where, spread, speed)
    chunks = [streams[i : i + _CHUNK] for i in range(0, n, _CHUNK)]
    for i, (q, v) in map_chunks(work, chunks, executor=executor):
        rows = slice(i * _CHUNK, i * _CHUNK + len(q))
        Q[rows], V[rows] = q, v
    return Q, V


def _sample(
    where: Scene | PickledRecipe, spread: float, speed: float, streams: Streams
) -> tuple[Array, Array]:
    scene = where.workspace().scene if isinstance(where, PickledRecipe) else where
    states = [sample(scene, rng, spread=spread, speed=speed) for rng in streams]
    return np.array([q for q, _ in states]), np.array([v for _, v in states])


# What is done to the rows of a batch: they are solved, and differentiated.


@dataclass(frozen=True)
class SolvedRows(Verb):
    """Solution at each state, and its derivatives if there is a method for them."""

    accuracy: float | None
    forces: tuple[AppliedForce, ...]  # at the first state
    method: str | None = None
    most: int = 1000
    most_of_core: int = 2000

    def row(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> str:
        """Solve one row, and differentiate it; its status says why it has no derivatives."""
        state, forces = (inputs["q"], inputs["v"], inputs["tau"]), forces_in(inputs, self.forces)
        about: dict[str, Any] = {"forces": forces, "accuracy": self.accuracy}
        if self.method is None:
            _write_outputs(outputs, workspace.solve(*state, throw=False, **about))
            return ""
        try:
            found = workspace.derivatives(*state, method=self.method, **about)
        except SolveFailed as failed:
            _write_outputs(outputs, failed.solution)
        else:
            _write_outputs(outputs, found.solution)
            for name in BLOCKS:
                outputs[name][...] = getattr(found, name)
        return ""

    def core(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays, threads: int
    ) -> tuple[NDArray[np.intp], Messages]:
        """Solve the rows, and differentiate them; return those that are left."""
        core = workspace.compiled
        work = core.solve if self.method is None else core.differentiate
        state, forces = (inputs["q"], inputs["v"], inputs["tau"]), forces_in(inputs, self.forces)
        return work(state, outputs, accuracy=self.accuracy, threads=threads, forces=forces), {}

    def why_not(self, workspace: Workspace) -> Iterator[str]:
        """Yield the reasons why the core cannot solve the scene, or differentiate it."""
        yield from why_not_method(self.method)
        yield from why_not(workspace)


def _write_outputs(outputs: Arrays, solution: Solution) -> None:
    for name in ("a", "lam", "residuals", "iterations"):
        outputs[name][...] = getattr(solution, name)
    outputs["statuses"][...] = STATUSES.index(solution.status)
    outputs["solve_times"][...] = solution.solve_time
