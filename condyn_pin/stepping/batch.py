"""The verb step_batch: one step with contacts from many states."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import NORMALISED, normalised
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.compiled import compiled
from condyn_pin._core.rows import BatchResult, Native, RowWork, run
from condyn_pin._core.show import require_pandas
from condyn_pin._core.threads import ThreadCache
from condyn_pin._core.work import Arrays, Kind, Messages, Progress, silent
from condyn_pin.constraints.contacts.contact import Contact
from condyn_pin.contact import problem
from condyn_pin.contact.problem import MODES, mode_words
from condyn_pin.contact.solution import ContactStatus
from condyn_pin.contact.solvers.admm import ADMM, POLISH, RESCUE
from condyn_pin.contact.solvers.contact_solver import ContactSolver
from condyn_pin.contact.solvers.newton import SemismoothNewton
from condyn_pin.dynamics.compiled import contiguous, describe_contacts, why_not, why_not_contacts
from condyn_pin.dynamics.scene import Scene, check_scene, time_of
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import CondynError
from condyn_pin.mechanism.closed_chains import chains_of
from condyn_pin.model.joints import by_joint
from condyn_pin.simulation.batch.inputs import DrivenPath, Recipe, check_states, denormalised_parts
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme, sizes_of_gaps
from condyn_pin.simulation.integrators.integrator import Integrator
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.records import candidates_of, row_names
from condyn_pin.stepping import contact_steps, step_problem
from condyn_pin.stepping.schemes.stewart_trinkle import StewartTrinkle
from condyn_pin.stepping.single_step import StepSolution, contact_problem, step

_DEFAULT: Final = StewartTrinkle()


def step_batch(
    scene: Scene,
    Q: ArrayLike,
    V: ArrayLike,
    TAU: float | ArrayLike = 0.0,
    *,
    dt: float,
    integrator: ContactScheme = _DEFAULT,
    executor: Executor | Native | None = None,
    chunk: int | None = None,
    progress: Progress = silent,
) -> BatchStep:
    """Return the states after one step with contacts from many states, with the errors of each.

    M (v+ - v) = dt (tau - h) + J_b^T l_b + J_c^T lam,    J_b v+ = -dt gamma / 2,    row by row

    Parameters
    ----------
    scene : Scene
    Q, V : (N, nq), (N, nv) array_like
        States, as in `step`. As all numbers here they are taken in double precision.
    TAU : 0, (nv,) or (N, nv) array_like, optional
        Torques applied [N, N m].
    dt : float
        Time step [s].
    integrator : ContactScheme, optional
        As in `step`.
    executor, chunk, progress
        As in `solve_batch`.

    Returns
    -------
    BatchStep
        To the bit what `step` returns, in any process: every step begins cold. By the
        compiled core to rounding; where contacts slide it ends at rounding, and `ADMM` at 1e-8.
        Steps that are not ok raise nothing: ``failed`` has their indices, ``counts`` their number.

    Raises
    ------
    InvalidArgument
        If an argument cannot be used; the text names the row.
    WorkersLost, Interrupted, UnsupportedBackend
        As in `solve_batch`.

    Notes
    -----
    Cost: that of N steps, divided by the workers.
    """
    begun = perf_counter()
    inputs = starts_of_steps(scene, Q, V, TAU, dt, integrator)
    return run(
        SteppedRows(tuple(scene.contacts), float(dt), integrator), Recipe(scene.bilateral), inputs,
        kinds_of_steps(scene), partial(batch_of_steps, scene, float(dt), integrator, inputs, begun),
        executor=executor, chunk=chunk, progress=progress,
    )  # fmt: skip


def starts_of_steps(
    scene: Scene, Q: ArrayLike, V: ArrayLike, TAU: float | ArrayLike, dt: float,
    integrator: ContactScheme,
) -> Arrays:  # fmt: skip
    """Return the states that steps begin at, one row each; InvalidArgument before the work."""
    check_scene(scene)
    q, v, tau = check_states(scene.robot, Q, V, TAU)
    tau = np.broadcast_to(tau, v.shape).copy()
    if len(q):
        contact_problem(scene, q[0], v[0], tau[0], dt=dt, integrator=integrator)
    return {"q0": q.copy(), "v0": v.copy(), "tau0": tau}  # kept: those of the caller stay his own


def kinds_of_steps(scene: Scene) -> dict[str, Kind]:
    """Row shape and dtype of each output."""
    robot, contacts = scene.robot, len(candidates_of(scene).names)
    return {
        "q": Kind((robot.nq,)), "v": Kind((robot.nv,)), "lam": Kind((len(row_names(scene)),)),
        "codes": Kind((contacts,), "i1"), "errors": Kind((len(ERRORS),)),
        "statuses": Kind((), "i1"),
    }  # fmt: skip


def batch_of_steps(
    scene: Scene, dt: float, integrator: ContactScheme, inputs: Arrays, begun: float,
    outputs: Arrays,
) -> BatchStep:  # fmt: skip
    """Return inputs and outputs as a value."""
    read_only(tuple(inputs.values()))
    arrays = {name: (inputs | outputs)[name] for name in BatchStep._rows}
    seconds = perf_counter() - begun
    return BatchStep(scene=scene, dt=dt, integrator=integrator, seconds=seconds, **arrays)


_scenes = ThreadCache[Scene]()


@dataclass(frozen=True)
class SteppedRows(RowWork):
    """One step from each state; workspaces know no contacts."""

    contacts: tuple[Contact, ...]
    dt: float  # [s]
    integrator: ContactScheme
    most = 500

    def row(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> str:
        """Take the step of one state; return why there is none."""
        taken = self.take(workspace, inputs, outputs)
        return str(taken) if isinstance(taken, CondynError) else ""

    def take(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays
    ) -> StepSolution | CondynError:
        """Return the step of one state, or why there is none; both are in the outputs."""
        state = (inputs[name] for name in ("q0", "v0", "tau0"))
        by = self.integrator
        try:
            now = step(self._scene(workspace), *state, dt=self.dt, integrator=by, throw=False)
        except CondynError as error:  # equations cannot be made
            outputs["statuses"][...] = STATUSES.index(ContactStatus.NOT_FINITE)
            return error
        outputs["q"][...], outputs["v"][...], outputs["lam"][...] = now.q, now.v, now.lam
        outputs["codes"][...] = [MODES.index(mode) for mode in now.modes.values()]
        outputs["errors"][...] = now.contact.natural, *(getattr(now, name) for name in ERRORS[1:])
        outputs["statuses"][...] = STATUSES.index(now.status)
        return now

    def _scene(self, workspace: Workspace) -> Scene:
        bilateral, contacts = workspace.scene, self.contacts
        return _scenes.of(workspace, contacts, lambda: replace(bilateral, contacts=contacts))

    def core(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays, threads: int
    ) -> tuple[NDArray[np.intp], Messages]:
        """Take the steps; return those that are left."""
        count = len(inputs["q0"])
        done, codes = np.zeros(count, np.int32), np.zeros(outputs["codes"].shape, np.int32)
        contacts_of(workspace, self.contacts).step(
            **states_of(workspace, inputs), plan=step_plan(self.integrator, self.dt),
            q=outputs["q"], v=outputs["v"], lam=outputs["lam"], errors=outputs["errors"],
            modes=codes, done=done, threads=threads, **paths_of(workspace, self.dt),
        )  # fmt: skip
        outputs["codes"][:], outputs["statuses"][:] = codes, STATUSES.index(ContactStatus.OK)
        return left_to_python(workspace, inputs["v0"], outputs, done, self.dt), {}

    def why_not(self, workspace: Workspace) -> Iterator[str]:
        """Yield the reasons why the core cannot take such steps."""
        by = self.integrator
        if type(by) is not StewartTrinkle:
            yield f"integrator = {by!r}: with contacts it has StewartTrinkle alone"
        elif type(by.contact) not in (ADMM, SemismoothNewton):
            yield f"contact = {by.contact!r}: it has ADMM and SemismoothNewton"
        yield from why_not_contacts(self._scene(workspace))
        yield from why_not(workspace)


# BatchStep: one step with contacts from many states, each with its errors and its status.


# A status as a number is its place here.
STATUSES: Final = tuple(ContactStatus)

# Columns of the errors of a step.
ERRORS: Final = (
    *("natural", "dynamics_error", "constraint_error", "violation", "penetration"),
    *("energy_lost", "correction_work", "algorithmic_work"),
)


@dataclass(frozen=True, eq=False, repr=False)
class BatchStep(BatchResult[StepSolution]):
    """The states after one step from N states, with the errors of each.

    Attributes
    ----------
    scene : Scene
    dt : float
        Time step [s].
    integrator : ContactScheme
        The scheme that took the step.
    q, v : (N, nq), (N, nv) array
        At the end of the step.
    lam : (N, m) array
        Impulses of constraints, then of all contacts [N s, N m s].
    codes : (N, candidates) int8 array
        Modes, as places in ("open", "stick", "slide").
    errors : (N, 8) array
        Natural residual [1], dynamics error [N s], constraint error [m/s], violation [m],
        penetration [m], energy lost, correction work and algorithmic work [J] of each, as in
        `StepSolution`.
    statuses : (N,) int8 array
        Place in ``tuple(ContactStatus)``: 0 is ok. -1 where no worker got that far.
    q0, v0, tau0 : (N, nq), (N, nv), (N, nv) array
        What it was asked for; tau0 in [N, N m].
    seconds : float
        Wall time of the whole batch [s].

    Notes
    -----
    ``batch[i]`` takes the step of state i again, in Python, and has its proof: to the bit, but for
    steps of the compiled core, which are equal as far as its page says. ``batch[2:4]`` and
    ``batch[batch.failed]`` are batches of some.
    """

    scene: Scene
    dt: float  # [s]
    integrator: ContactScheme
    q: Array
    v: Array
    lam: Array  # [N s, N m s]
    codes: NDArray[np.int8]
    errors: Array
    statuses: NDArray[np.int8]
    q0: Array
    v0: Array
    tau0: Array
    seconds: float  # [s]

    _rows = ("q", "v", "lam", "codes", "errors", "statuses", "q0", "v0", "tau0")
    _endings = STATUSES

    @property
    def modes(self) -> dict[str, NDArray[np.object_]]:
        """Mode of each contact in each step (N,): open, stick or slide."""
        words = mode_words(self.codes)
        names = candidates_of(self.scene).names
        return {name: words[:, i] for i, name in enumerate(names)}

    @property
    def natural(self) -> Array:
        """Natural residual of each contact problem (N,), without a unit."""
        return self.errors[:, 0]

    def to_pandas(self) -> Any:
        """Return the steps as a `pandas.DataFrame`, one step per row.

        Columns: status, q and v by joint at the end of the step, the mode of each contact, and the
        errors.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        table: dict[str, Any] = {"status": self.status_names}
        table |= by_joint(self.scene.robot.model, {"q": self.q, "v": self.v})
        table |= {f"mode {name}": modes for name, modes in self.modes.items()}
        return require_pandas().DataFrame(table | dict(zip(ERRORS, self.errors.T, strict=True)))

    def _one(self, i: int) -> StepSolution:
        self._check_found(i, self.statuses)
        asked = self.q0[i], self.v0[i], self.tau0[i]
        return step(self.scene, *asked, dt=self.dt, integrator=self.integrator, throw=False)

    def _worst(self) -> list[str]:
        worst = float(np.nanmax(self.natural, initial=0.0))
        return [f"largest natural residual  {worst:.1e}"]


# Steps with contacts by the compiled core.
#
# It takes steps of `StewartTrinkle` from the first attempts of their contact solver, and proves
# each. A step that has no such answer, and a motion with one in it, are Python's.


# A penetration at the start of a motion that none is looked at again for [m, rad].
_DEEP: Final = 0.9 * tolerances.NEARLY_CLOSED


def step_plan(integrator: Integrator, dt: float, *, to_rounding: bool = False) -> StepPlan:
    """Settings of a step for the core."""
    # `to_rounding` makes impulses so accurate that modes can be read from them.
    assert isinstance(integrator, StewartTrinkle)
    method = _method(integrator.contact)
    if to_rounding:
        method = method._replace(alternates=False, newton_first=False, polish=0)
    return StepPlan(dt, method, *sizes_of_gaps())


class _Method(NamedTuple):
    """Settings of a contact solver for the core: Newton's by default."""

    alternates: bool = False
    newton_first: bool = False
    sticks_first: bool = False
    polish: int = 0
    tolerance: float = 1.0
    max_iterations: int = 0
    anderson: int = 0
    steps: int = RESCUE


def _method(solver: ContactSolver) -> _Method:
    """Settings of a contact solver."""
    # Where no parameter of `ADMM` is chosen, Newton's method comes first: compiled it takes less
    # time, and ends at rounding.
    if isinstance(solver, ADMM):
        return _Method(
            alternates=True, newton_first=solver == ADMM(), sticks_first=not solver.polish,
            polish=POLISH if solver.polish else 0, tolerance=solver.tolerance,
            max_iterations=solver.max_iterations,
            anderson=min(solver.anderson, solver.max_iterations),  # more is never remembered
        )  # fmt: skip
    assert isinstance(solver, SemismoothNewton)
    return _Method(steps=solver.max_iterations)


class StepPlan(NamedTuple):
    """Settings and tolerances of a step, by the names that the core reads."""

    dt: float  # [s]
    method: _Method
    near: float  # gap of an active contact [m]
    pushed_out: float  # share of a penetration that a step removes [1]
    pushes: float  # its largest speed [m/s, rad/s]
    at_rest: float  # penetration that stays [m, rad]
    touches: float  # gap of a touching contact [m, rad]
    solved: float = tolerances.CONTACT_SOLVED
    moves: float = problem.MOVES
    straight: float = step_problem.STRAIGHT
    missed: float = step_problem.MISSED
    closed: float = contact_steps.CLOSED
    small: float = contact_steps.SMALL
    rank: float = tolerances.RANK
    deep: float = _DEEP
    not_driven: float = tolerances.NOT_DRIVEN
    out_of_reach: float = tolerances.OUT_OF_REACH


# The columns of what momentum is off by and loops are open by, and a share of the weight from which
# on it is Python that judges whether that is much: a hundredth of what may be ok.
_DYNAMICS: Final = ERRORS.index("dynamics_error")
_VIOLATION: Final = ERRORS.index("violation")
_DOUBTFUL: Final = tolerances.FORCES / 100


def left_to_python(
    workspace: Workspace, v0: Array, outputs: Arrays, done: NDArray[np.int32], dt: float
) -> NDArray[np.intp]:
    """Return the rows that the core has not done, or whose steps may not be ok."""
    errors, weight = outputs["errors"], workspace.scene.nominal.weight
    doubtful = errors[:, _DYNAMICS] > _DOUBTFUL * dt * weight
    doubtful |= errors[:, _VIOLATION] > tolerances.OUT_OF_REACH
    slow = Manifold(workspace.model).slow(dt)
    if slow is not None:
        for v in (v0, outputs["v"]):
            doubtful |= np.einsum("ni,ni->n", v, v) > slow
    return np.flatnonzero((done == 0) | doubtful)


_contacts = ThreadCache[Any]()


def contacts_of(workspace: Workspace, contacts: tuple[Contact, ...]) -> Any:
    """Return the core's memory for a workspace with contacts, made once for all chunks."""

    def make() -> Any:
        scene = replace(workspace.scene, contacts=contacts)
        rank = chains_of(workspace.scene).rank if workspace.scene.rows else 0
        return compiled().Contacts(workspace.compiled.core, **describe_contacts(scene, rank))

    return _contacts.of(workspace, contacts, make)


def paths_of(workspace: Workspace, dt: float) -> dict[str, Array]:
    """Driven rows and their paths in a step from the time of a workspace, for the core."""
    paths = DrivenPath(workspace, dt, 1, time_of(workspace.scene))
    return {"driven": paths.rows, "path": paths.wanted}


def states_of(workspace: Workspace, inputs: Arrays) -> dict[str, Array]:
    """Return Q, V and TAU of the rows of a chunk, for the core."""
    robot, q0 = workspace.scene.robot, inputs["q0"].copy()
    # most have nothing to be normalised, and cost no call each; squared, the limit is half of it
    for i, _, _ in denormalised_parts(robot, q0, 1.0 - NORMALISED, 1.0 + NORMALISED):
        q0[i] = normalised(workspace.model, "q", q0[i])
    return {"Q": q0, "V": inputs["v0"], "TAU": contiguous(inputs["tau0"], len(q0))}
