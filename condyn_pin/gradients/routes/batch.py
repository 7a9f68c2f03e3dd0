"""The verb step_derivatives_batch: derivatives of one step with contacts, at many states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from time import perf_counter
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_type
from condyn_pin._core.arrays import Array
from condyn_pin._core.rows import Batch, Native, RowWork, run
from condyn_pin._core.work import Arrays, Kind, Messages, Progress, silent
from condyn_pin.contact.problem import MODES, mode_words
from condyn_pin.contact.solution import ContactStatus
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import CondynError, SolveFailed
from condyn_pin.gradients.routes.active_set import ActiveSet
from condyn_pin.gradients.routes.linear_steps import falls, rows_with_a_place
from condyn_pin.gradients.routes.route import Route, check_parameters
from condyn_pin.gradients.routes.step_derivatives import (
    Columns,
    StepDerivatives,
    StepJacobian,
    found_parameters,
)
from condyn_pin.simulation.batch.inputs import Recipe
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.records import candidates_of
from condyn_pin.stepping.batch import (
    STATUSES,
    BatchStep,
    SteppedRows,
    batch_of_steps,
    contacts_of,
    kinds_of_steps,
    left_to_python,
    paths_of,
    starts_of_steps,
    states_of,
    step_plan,
)
from condyn_pin.stepping.schemes.stewart_trinkle import StewartTrinkle

_DEFAULT: Final = StewartTrinkle()
_ACTIVE_SET: Final = ActiveSet()


def step_derivatives_batch(
    scene: Scene,
    Q: ArrayLike,
    V: ArrayLike,
    TAU: float | ArrayLike = 0.0,
    *,
    dt: float,
    integrator: ContactScheme = _DEFAULT,
    route: Route = _ACTIVE_SET,
    wrt: Sequence[str] = (),
    executor: Executor | Native | None = None,
    chunk: int | None = None,
    progress: Progress = silent,
) -> BatchStepDerivatives:
    """Return the derivatives of one step with contacts by its start, from many states.

    M dv+ - J_b^T dl_b - J_c^T dlam = df,    J_b dv+ = ds,    the law of the route for dlam

    Parameters
    ----------
    scene, Q, V, TAU, dt, integrator
        As in `step_batch`.
    route : Route, optional
        Treatment of kinks and jumps: `ActiveSet()` by default, the derivatives within the modes of
        the step.
    wrt : sequence of {"friction", "restitution", "solref", "inertias"}
        As in `StepSolution.derivatives`.
    executor, progress
        As in `solve_batch`. The compiled core takes steps of `StewartTrinkle` by `ActiveSet`.
    chunk : int, optional
        As in `solve_batch`, but 100 states at most.

    Returns
    -------
    BatchStepDerivatives
        To the bit what ``step(...).derivatives(...)`` returns; by the compiled core to rounding.
        Its matrices take 48 nv^2 bytes a state and more: 70 kB for Talos.

    Raises
    ------
    InvalidArgument
        If an argument cannot be used; the text names the row. States that have no derivatives
        raise nothing: ``failed`` has their indices, and ``reasons`` says why.
    WorkersLost, Interrupted, UnsupportedBackend
        As in `solve_batch`.

    Notes
    -----
    Cost: that of a step and `Route.cost` a state, divided by the workers.
    """
    begun = perf_counter()
    check_type("route", route, Route, "a Route is needed, such as ActiveSet()")
    inputs = starts_of_steps(scene, Q, V, TAU, dt, integrator)
    names = check_parameters(route, integrator, wrt)

    def made(outputs: Arrays) -> BatchStepDerivatives:
        taken = batch_of_steps(scene, float(dt), integrator, inputs, begun, outputs)
        return BatchStepDerivatives(
            taken, route, found_parameters(route, route.scheme(integrator), names),
            q=outputs["q_end"], v=outputs["v_end"], dq=outputs["dq"], dv=outputs["dv"],
            codes=outputs["read"], margins=outputs["margins"], reasons=outputs["words"],
            seconds=taken.seconds,
        )  # fmt: skip

    steps = SteppedRows(tuple(scene.contacts), float(dt), integrator)
    return run(
        DifferentiatedRows(steps, route, names), Recipe(scene.bilateral), inputs,
        output_kinds(scene, names), made,
        executor=executor, chunk=chunk, progress=progress,
    )  # fmt: skip


def output_kinds(scene: Scene, wrt: Sequence[str]) -> dict[str, Kind]:
    """Row shape and dtype of each output."""
    robot, candidates = scene.robot, candidates_of(scene)
    inertias = 10 * (robot.model.njoints - 1) if "inertias" in wrt else 0
    matrix = Kind((robot.nv, Columns(robot.nv, candidates.cones, inertias).size))
    return kinds_of_steps(scene) | {
        "q_end": Kind((robot.nq,)), "v_end": Kind((robot.nv,)), "dq": matrix, "dv": matrix,
        "read": Kind((len(candidates.names),), "i1"), "margins": Kind(()),
    }  # fmt: skip


@dataclass(frozen=True)
class DifferentiatedRows(RowWork):
    """One step from each state, and its derivatives.

    The compiled core has those of `ActiveSet`. Steps that end elsewhere than along straight paths,
    and those whose modes or rank leave a doubt, are Python's.
    """

    steps: SteppedRows
    route: Route
    wrt: tuple[str, ...]
    most = 100
    most_of_core = 500

    def row(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> str:
        """Take the step of one state, differentiate it; return why it has no derivatives."""
        taken = self.steps.take(workspace, inputs, outputs)
        if isinstance(taken, CondynError):
            return str(taken)
        if not taken.status.ok:
            why = "; ".join((f"{taken.status}", *taken.notices))
            return f"the step has no derivatives: {why}"
        try:
            of = taken.derivatives(route=self.route, wrt=self.wrt)
        except CondynError as error:
            return str(error)
        outputs["q_end"][...], outputs["v_end"][...], outputs["margins"][...] = (
            of.q,
            of.v,
            of.margin,
        )
        outputs["dq"][...], outputs["dv"][...] = of.matrices
        outputs["read"][...] = [MODES.index(mode) for mode in of.modes.values()]
        return ""

    def core(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays, threads: int
    ) -> tuple[NDArray[np.intp], Messages]:
        """Take the steps and differentiate them; return those that are left."""
        steps = self.steps
        count, shape = len(inputs["q0"]), outputs["codes"].shape
        done, codes, read = np.zeros(count, np.int32), *np.zeros((2, *shape), np.int32)
        contacts_of(workspace, steps.contacts).differentiate(
            **states_of(workspace, inputs),
            plan=step_plan(steps.integrator, steps.dt, to_rounding=True),
            polished=tolerances.CONTACT_POLISHED, falls=falls(workspace.model, steps.dt),
            placed=rows_with_a_place(workspace.bounds),
            q=outputs["q"], v=outputs["v"], lam=outputs["lam"], errors=outputs["errors"],
            modes=codes, done=done, dq=outputs["dq"], dv=outputs["dv"], margins=outputs["margins"],
            read_modes=read, threads=threads, **paths_of(workspace, steps.dt),
        )  # fmt: skip
        outputs["codes"][:], outputs["read"][:] = codes, read
        outputs["q_end"][:], outputs["v_end"][:] = outputs["q"], outputs["v"]
        outputs["statuses"][:] = STATUSES.index(ContactStatus.OK)
        return left_to_python(workspace, inputs["v0"], outputs, done, steps.dt), {}

    def why_not(self, workspace: Workspace) -> Iterator[str]:
        """Yield the reasons why the core cannot differentiate such steps."""
        yield from self.steps.why_not(workspace)
        if type(self.route) is not ActiveSet:
            yield f"route = {self.route!r}: it has ActiveSet() alone"
        if "inertias" in self.wrt:
            yield "wrt: it has no derivatives by inertias"


# BatchStepDerivatives: how the ends of steps with contacts change, at many states.


@dataclass(frozen=True, eq=False, repr=False)
class BatchStepDerivatives(StepJacobian, Batch[StepDerivatives]):
    """The derivatives of one step from N states; columns and rows of q are tangent.

    Attributes
    ----------
    step : BatchStep
        The steps, with their errors and statuses.
    route : Route
    parameters : tuple of str
        What there are derivatives by, beside q, v and tau.
    q, v : (N, nq), (N, nv) array
        The ends of the steps that are differentiated: those of the route's own law of contacts.
    dq, dv : (N, nv, columns) array
        q+ and v+ by q, v, tau and `parameters`, as in `StepDerivatives` [mixed].
    codes : (N, candidates) int8 array
        Modes that the route has read, as places in ("open", "stick", "slide").
    margins : (N,) array
        How far the nearest contact is from another mode, as in `StepDerivatives` [1].
    reasons : (N,) array of str
        Why a step has no derivatives, empty where it has.
    seconds : float
        Wall time of the whole batch [s].

    Notes
    -----
    ``batch[i]`` is the `StepDerivatives` of state i, and ``batch[2:4]`` a batch of some. Where
    there are none the rows are NaN, and ``failed`` has their indices.
    """

    step: BatchStep
    route: Route
    parameters: tuple[str, ...]
    q: Array
    v: Array
    dq: Array
    dv: Array
    codes: NDArray[np.int8]
    margins: Array
    reasons: NDArray[np.object_]
    seconds: float  # [s]

    _rows = ("q", "v", "dq", "dv", "codes", "margins", "reasons", "step")

    @property
    def failed(self) -> NDArray[np.intp]:
        """Indices of the states without derivatives, missing ones among them."""
        return np.flatnonzero(np.isnan(self.margins))

    @property
    def ok(self) -> bool:
        """True if all states have derivatives."""
        return not self.failed.size

    @property
    def one_sided(self) -> NDArray[np.bool_]:
        """True where a contact is near another mode, and derivatives hold on one side (N,)."""
        return np.asarray(self.margins < tolerances.SWITCHES)

    @property
    def modes(self) -> dict[str, NDArray[np.object_]]:
        """Mode of each contact in each step (N,): open, stick or slide."""
        words = mode_words(self.codes)
        names = candidates_of(self.step.scene).names
        return {name: words[:, i] for i, name in enumerate(names)}

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Contacts with friction, the columns by friction and by restitution."""
        candidates = candidates_of(self.step.scene)
        return candidates.names[: candidates.cones]

    @property
    def matrices(self) -> tuple[Array, Array]:  # type: ignore[override]
        """Derivatives of q+ and of v+, `dq` and `dv`."""
        return self.dq, self.dv

    def _one(self, i: int) -> StepDerivatives:
        self._check_found(i, self.step.statuses)
        if np.isnan(self.margins[i]):
            raise SolveFailed(f"state {i}: {self.reasons[i]}", None)
        names = candidates_of(self.step.scene).names
        modes = dict(zip(names, mode_words(self.codes[i]).tolist(), strict=True))
        return StepDerivatives(
            q=self.q[i], v=self.v[i], modes=modes, margin=float(self.margins[i]), route=self.route,
            names=self.names, matrices=(self.dq[i], self.dv[i]), parameters=self.parameters,
        )  # fmt: skip

    def __repr__(self) -> str:
        missing = f", {len(self.failed)} without" if self.failed.size else ""
        sided = int(self.one_sided.sum())
        sides = f", {sided} one-sided" if sided else ""
        return f"BatchStepDerivatives({self.route!r}: {len(self)} states{missing}{sides})"
