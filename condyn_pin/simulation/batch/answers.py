"""The verbs solve_batch and derivatives_batch: many states, each answer with proof and status."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core.arguments import check_accuracy_of_a, check_count, renamed
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.jacobian import Jacobian
from condyn_pin._core.rows import Batch, BatchResult, Native, RowWork, Some, run
from condyn_pin._core.show import require_pandas
from condyn_pin._core.work import Arrays, Kind, Messages, Progress, map_chunks, silent
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics.compiled import why_not, why_not_method
from condyn_pin.dynamics.derivatives import METHODS
from condyn_pin.dynamics.derivatives.others import BLOCKS
from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives
from condyn_pin.dynamics.residuals import Residuals
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solution import (
    Question,
    Solution,
    Status,
    forces_in_axes,
    solution_columns,
)
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument, SolveFailed, unknown_name
from condyn_pin.mechanism.projection import check_generator, sample
from condyn_pin.simulation.batch.inputs import PickledRecipe, Recipe, check_states, forces_in, split

# A status as a number is its place here.
STATUSES: Final = tuple(Status)


@dataclass(frozen=True, eq=False, repr=False)
class BatchSolution(BatchResult[Solution]):
    """Accelerations and constraint forces at N states, with the errors of each recomputed.

    M a + h = tau + J^T lam + sum J_f^T f,  J a + gamma = a_ref,  in every row

    Attributes
    ----------
    scene : Scene
    q, v, tau : (N, nq), (N, nv), (N, nv) array
        Configurations, velocities and torques, one row per state.
    a : (N, nv) array
        Joint accelerations [rad/s^2, m/s^2].
    lam : (N, m) array
        Constraint forces in the axes of each constraint [N, N m].
    residuals : (N, 5) array
        A `Residuals` a row; the properties below name its columns.
    statuses : (N,) int8 array
        Place in ``tuple(Status)``: 0 is ok. -1 where no worker got that far, which only the
        batch of a `WorkersLost` or an `Interrupted` has.
    iterations : (N,) int32 array
        Of the solver.
    solve_times : (N,) array
        Of each solve without its proof [s], while other processes used the machine too.
    seconds : float
        Wall time of the whole batch [s].
    applied : tuple of AppliedForce
        The forces from outside that were applied.
    drift : Baumgarte or None
        What gave a_ref; None where it is zero.

    Notes
    -----
    ``batch[i]`` is the `Solution` of state i, and iterating gives all of them; ``batch[2:4]`` and
    ``batch[batch.failed]`` are batches of some. The arrays include rows that are not ok, with NaN
    where there is no answer; `failed` has their indices.
    """

    scene: Scene
    q: Array
    v: Array
    tau: Array
    a: Array
    lam: Array
    residuals: Array
    statuses: NDArray[np.int8]
    iterations: NDArray[np.int32]
    solve_times: Array  # [s]
    seconds: float  # [s]
    applied: tuple[AppliedForce, ...] = ()
    drift: Baumgarte | None = None

    _rows = ("q", "v", "tau", "a", "lam", "residuals", "statuses", "iterations", "solve_times")
    _endings = STATUSES

    proofs = renamed("residuals")

    @property
    def dynamics_error(self) -> Array:
        """|M a + h - tau - J^T lam - sum J_f^T f|_inf [N, N m], (N,)."""
        return self.residuals[:, 0]

    @property
    def constraint_error(self) -> Array:
        """|J a + gamma - a_ref|_inf [m/s^2, rad/s^2], (N,)."""
        return self.residuals[:, 1]

    @property
    def violation(self) -> Array:
        """|c(q)|_inf [m, rad] of each state given, (N,)."""
        return self.residuals[:, 2]

    @property
    def velocity_violation(self) -> Array:
        """|J v|_inf [m/s, rad/s] of each state given, (N,)."""
        return self.residuals[:, 3]

    @property
    def error_bound(self) -> Array:
        """Bound on the error of a, relative to the larger of |a|_inf and gravity, (N,)."""
        return self.residuals[:, 4]

    @property
    def forces(self) -> dict[str, Array]:
        """Force on the first-named body by constraint, (N, rows of it), views of `lam`.

        Of a constraint with `axes` they are (N, 3) or (N, 6), in these, as in a `Solution`.
        """
        found, row = {}, 0
        for bound in self.scene.bounds:
            found[bound.name] = self.lam[:, row : row + bound.size]
            row += bound.size
        return found | forces_in_axes(self.scene, self.q, self.lam)

    def to_pandas(self) -> Any:
        """Return the solutions as a `pandas.DataFrame`, one state per row.

        Columns: status, q and a by joint, lam by row, the errors, iterations and solve_times [s].

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        of_states = self.status_names, self.q, self.a, self.lam, self.residuals
        table = solution_columns(self.scene, *of_states)
        table |= {"iterations": self.iterations, "solve_times": self.solve_times}
        return require_pandas().DataFrame(table)

    def _some(self, rows: Some) -> BatchSolution:
        return replace(super()._some(rows), applied=self._applied(rows))

    def _one(self, i: int) -> Solution:
        self._check_found(i, self.statuses)
        residuals = Residuals(*self.residuals[i].tolist())
        return Solution(
            a=self.a[i],
            lam=self.lam[i],
            residuals=residuals,
            status=STATUSES[self.statuses[i]],
            iterations=int(self.iterations[i]),
            solve_time=float(self.solve_times[i]),
            scene=self.scene,
            question=Question(self.q[i], self.v[i], self.tau[i], self._applied(i), self.drift),
        )

    def _applied(self, i: int | Some) -> tuple[AppliedForce, ...]:
        return tuple(force.row(i) for force in self.applied)

    def _worst(self) -> list[str]:
        worst = float(self.error_bound.max(initial=0.0))
        return [f"largest error bound of a  {worst:.1e} (relative)"]


@dataclass(frozen=True, eq=False, repr=False)
class BatchDerivatives(Jacobian, Batch[Derivatives]):
    """Derivatives at N states; columns are tangent, as in `Derivatives`.

    Attributes
    ----------
    solution : BatchSolution
        The answers, with their statuses.
    da_dq, da_dv, da_dtau : (N, nv, nv) array
        Of the joint accelerations a; the columns by q are tangent.
    dlam_dq, dlam_dv, dlam_dtau : (N, m, nv) array
        Of the rows, in the axes of each constraint, whatever its `axes`. Where rows are redundant,
        those of the smallest lam.
    seconds : float
        Wall time of the whole batch [s].

    Notes
    -----
    ``batch[i]`` is the `Derivatives` of state i, and ``batch[2:4]`` a batch of some. Where the
    status of a state is not ok, there is nothing to differentiate: its rows are NaN, and
    ``solution.failed`` has its index.
    """

    solution: BatchSolution
    da_dq: Array
    da_dv: Array
    da_dtau: Array
    dlam_dq: Array
    dlam_dv: Array
    dlam_dtau: Array
    seconds: float  # [s]

    outputs = "a", "lam"
    _rows = ("solution", *BLOCKS)

    def block(self, output: str, by: str) -> Array:
        """Return the derivatives of a (N, nv, nv) or lam (N, m, nv) by q, v or tau."""
        found: Array = getattr(self, f"d{output}_d{by}")
        return found

    def _one(self, i: int) -> Derivatives:
        blocks = (np.vstack([self.block(y, x)[i] for y in self.outputs]) for x in self.inputs)
        return Derivatives(self.solution[i], *map(read_only, blocks))

    def __repr__(self) -> str:
        return f"BatchDerivatives({self.solution!r})"


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
class SolvedRows(RowWork):
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
