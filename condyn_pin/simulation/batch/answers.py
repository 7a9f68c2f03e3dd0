"""The verbs for many states: solve_batch, derivatives_batch."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import chain
from math import nan
from time import perf_counter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core.arguments import check_accuracy_of_a, check_count
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.compiled import compiled
from condyn_pin._core.rows import Native, Rows
from condyn_pin._core.work import Arrays, Kernel, Kind, Messages, Progress, in_flight, silent
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics.compiled import refuse, unsupported, unsupported_method
from condyn_pin.dynamics.derivatives import METHODS
from condyn_pin.dynamics.derivatives.differences import BLOCKS
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import (
    InvalidArgument,
    MissingExtra,
    SolveFailed,
    UnsupportedBackend,
    unknown_name,
)
from condyn_pin.mechanism.projection import check_generator, sample
from condyn_pin.simulation.batch.inputs import PickledRecipe, Recipe, RowForces, check_states, split
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
        unsupported=lambda: unsupported(recipe.workspace()), chunk=chunk, most=2000,
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
    inputs, count = _inputs(scene, Q, V, TAU, accuracy)
    applied, of_rows, more = split(scene.robot, forces, count)
    recipe = Recipe(scene, solver, drift)
    python = partial(answer_rows, method, accuracy, of_rows)
    kernel, executor, chunk = workers(
        executor, partial(by_core, True, accuracy, of_rows), python,
        reasons=unsupported_method(method), unsupported=lambda: unsupported(recipe.workspace()),
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
    """Row shape and dtype of each array of a `BatchSolution`."""
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
    starts = range(0, n, _CHUNK)
    chunks = in_flight(
        work, len(starts), lambda i, _: streams[starts[i] : starts[i] + _CHUNK], executor
    )
    with closing(chunks):
        for i, (q, v) in chunks:
            rows = slice(starts[i], starts[i] + len(q))
            Q[rows], V[rows] = q, v
    return Q, V


def _sample(
    where: Scene | PickledRecipe, spread: float, speed: float, streams: Streams
) -> tuple[Array, Array]:
    scene = where.workspace().scene if isinstance(where, PickledRecipe) else where
    states = [sample(scene, rng, spread=spread, speed=speed) for rng in streams]
    return np.array([q for q, _ in states]), np.array([v for _, v in states])


# What a worker does to some rows of a batch: it solves, and differentiates, state by state.


_CODES: Final = {status: code for code, status in enumerate(STATUSES)}


def answer_rows(
    method: str | None,
    accuracy: float | None,
    forces: RowForces,
    workspace: Workspace,
    inputs: Arrays,
    outputs: Arrays,
) -> Messages:
    """Solve some rows, and differentiate them if there is a method for it."""
    q, v, tau = inputs["q"], inputs["v"], inputs["tau"]
    for i, state in enumerate(zip(q, v, np.broadcast_to(tau, v.shape), strict=True)):
        applied = forces.at(inputs, i)
        if method is None:
            solution = workspace.solve(*state, forces=applied, accuracy=accuracy, throw=False)
            _put(outputs, i, solution)
            continue
        try:
            found = workspace.derivatives(*state, forces=applied, method=method, accuracy=accuracy)
        except SolveFailed as failed:
            _put(outputs, i, failed.solution)
            for name in BLOCKS:
                outputs[name][i] = nan
        else:
            _put(outputs, i, found.solution)
            for name in BLOCKS:
                outputs[name][i] = getattr(found, name)
    return {}


def by_core(
    differentiates: bool,
    accuracy: float | None,
    forces: RowForces,
    workspace: Workspace,
    inputs: Arrays,
    outputs: Arrays,
    threads: int,
) -> tuple[NDArray[np.intp], Messages]:
    """Answer some rows by the compiled core; return those that are left."""
    core = workspace.compiled
    work = core.differentiate if differentiates else core.solve
    state = inputs["q"], inputs["v"], inputs["tau"]
    applied = forces.of_all(inputs)
    return work(state, outputs, accuracy=accuracy, threads=threads, forces=applied), {}


def _put(outputs: Arrays, i: int, solution: Solution) -> None:
    for name in ("a", "lam", "residuals", "iterations"):
        outputs[name][i] = getattr(solution, name)
    outputs["statuses"][i] = _CODES[solution.status]
    outputs["solve_times"][i] = solution.solve_time


# Rows of a batch by the compiled core; those that it leaves, and what it does not take, by Python.
#
# A kernel like any other, so that chunks, executors, progress and interrupts are those of all
# batches: the core works on the rows of a chunk with its threads.


# What the core of a workspace does to the rows of a chunk with some threads: those that it leaves,
# and what there is to say of others.
Work = Callable[[Workspace, Arrays, Arrays, int], tuple[NDArray[np.intp], Messages]]


@dataclass(frozen=True)
class CompiledRows:
    """The kernel: `work` by the core of a workspace, what is left by the kernel in `python`."""

    work: Work
    python: Kernel
    threads: int

    def __call__(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> Messages:
        """Fill the outputs; return the messages of the rows."""
        left, said = self.work(workspace, inputs, outputs, self.threads)
        if not left.size:
            return said
        some = {name: x if x.ndim == 1 else x[left] for name, x in inputs.items()}
        found = {name: x[left] for name, x in outputs.items()}
        words = self.python(workspace, some, found)
        for name, x in found.items():
            outputs[name][left] = x
        return said | {int(left[i]): text for i, text in words.items()}


class Workers(NamedTuple):
    """Kernel and executor of a batch, and the number of rows in a chunk."""

    kernel: Kernel
    executor: Executor | None
    chunk: int | None


def workers(
    executor: Executor | Native | None, work: Work, python: Kernel, *, reasons: Iterable[str],
    unsupported: Callable[[], Iterable[str]], chunk: int | None, most: int,
) -> Workers:  # fmt: skip
    """Kernel, executor and chunk size of a batch: the compiled core, or Python.

    Parameters
    ----------
    executor : Executor or Native or None
        Argument of the user.
    work, python : callable
        Work of the core, and kernel in Python.
    reasons : iterable of str
        Reasons why the core cannot solve the batch, if there are any.
    unsupported : callable
        Returns the reasons in the workspace itself; called where there is no other reason.
    chunk : int or None
        Argument of the user.
    most : int
        Rows that are handed to the threads of this process at a time, unless there is a `chunk`.

    Raises
    ------
    UnsupportedBackend
        If the core cannot solve the batch.
    MissingExtra
        If the core is not installed.
    """
    if not isinstance(executor, Native):
        return Workers(python, executor, chunk)
    try:
        compiled()
        refuse(chain(reasons, _later(unsupported)))
    except (UnsupportedBackend, MissingExtra):
        if not executor.where_possible:
            raise
        return Workers(python, executor.executor, chunk)
    if executor.executor is None and chunk is None:
        chunk = most * executor.at_work
    return Workers(CompiledRows(work, python, executor.at_work), executor.executor, chunk)


def _later(unsupported: Callable[[], Iterable[str]]) -> Iterable[str]:
    yield from unsupported()
