"""The verb step_derivatives_batch: how one step with contacts changes, from many states."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from math import nan
from time import perf_counter
from typing import Final

from numpy.typing import ArrayLike

from condyn_pin._core.rows import Native, Rows
from condyn_pin._core.work import Arrays, Kind, Messages, Progress, silent
from condyn_pin.contact.problem import MODES
from condyn_pin.dynamics.compiled import untaken
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import CondynError, InvalidArgument
from condyn_pin.simulation.batch.compiled import workers
from condyn_pin.simulation.batch.compiled_steps import untaken_steps
from condyn_pin.simulation.batch.recipe import Recipe
from condyn_pin.simulation.batch.steps import (
    StepKernel,
    batch_of_steps,
    kinds_of_steps,
    starts_of_steps,
)
from condyn_pin.simulation.contact_columns import candidates_of
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.stewart_trinkle import StewartTrinkle
from condyn_pin.simulation.routes.active_set import ActiveSet
from condyn_pin.simulation.routes.base import Route, check_parameters
from condyn_pin.simulation.routes.batch_step_derivatives import BatchStepDerivatives
from condyn_pin.simulation.routes.columns import Columns
from condyn_pin.simulation.routes.compiled_steps import DifferentiatedRows, untaken_route
from condyn_pin.simulation.routes.step_derivatives import found_parameters

_DEFAULT: Final = StewartTrinkle()
_ACTIVE_SET: Final = ActiveSet()

# Steps a thread of the compiled core that it is handed at a time.
_STEPS: Final = 500


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
    """Return how the ends of one step with contacts change with its start, from many states.

    M dv+ - J_b^T dl_b - J_c^T dlam = df,    J_b dv+ = ds,    the law of the route for dlam

    Parameters
    ----------
    scene, Q, V, TAU, dt, integrator
        As in `step_batch`.
    route : Route, optional
        What is made of kinks and jumps: `ActiveSet()` by default, the derivatives within the modes
        of the step.
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
    if not isinstance(route, Route):
        raise InvalidArgument(f"route = {route!r}: a Route is needed, such as ActiveSet()")
    inputs = starts_of_steps(scene, Q, V, TAU, dt, integrator)
    names = check_parameters(route, integrator, wrt)
    about, recipe = (tuple(scene.contacts), float(dt), integrator), Recipe(scene.bilateral)
    reasons = (*untaken_steps(scene, integrator), *untaken_route(route, names))
    kernel, executor, chunk = workers(
        executor, DifferentiatedRows(*about), DerivativesKernel(StepKernel(*about), route, names),
        reasons=reasons, untaken=lambda: untaken(recipe.workspace()), chunk=chunk, most=_STEPS,
    )  # fmt: skip
    rows = Rows(kernel, recipe, executor, chunk, 100, progress)

    def made(outputs: Arrays) -> BatchStepDerivatives:
        taken = batch_of_steps(scene, float(dt), integrator, inputs, begun, outputs)
        return BatchStepDerivatives(
            taken, route, found_parameters(route, route.scheme(integrator), names),
            q=outputs["q_end"], v=outputs["v_end"], dq=outputs["dq"], dv=outputs["dv"],
            codes=outputs["read"], margins=outputs["margins"], reasons=outputs["words"],
            seconds=taken.seconds,
        )  # fmt: skip

    return rows.fill(len(inputs["q0"]), inputs, kinds_of(scene, names), made)


def kinds_of(scene: Scene, wrt: Sequence[str]) -> dict[str, Kind]:
    """Return what a row of each output is."""
    robot, candidates = scene.robot, candidates_of(scene)
    inertias = 10 * (robot.model.njoints - 1) if "inertias" in wrt else 0
    matrix = Kind((robot.nv, Columns(robot.nv, candidates.cones, inertias).size))
    return kinds_of_steps(scene) | {
        "q_end": Kind((robot.nq,)), "v_end": Kind((robot.nv,)), "dq": matrix, "dv": matrix,
        "read": Kind((len(candidates.names),), "i1"), "margins": Kind(()),
    }  # fmt: skip


@dataclass(frozen=True)
class DerivativesKernel:
    """The kernel: some rows of states in, their steps out, and how those change."""

    steps: StepKernel
    route: Route
    wrt: tuple[str, ...]

    def __call__(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> Messages:
        """Take the steps and differentiate them; return why there is nothing of some states."""
        reasons = {}
        for i in range(len(inputs["q0"])):
            reason = self._row(workspace, inputs, outputs, i)
            if reason:
                reasons[i] = reason
                for name in ("q_end", "v_end", "dq", "dv", "margins"):
                    outputs[name][i] = nan
                outputs["read"][i] = 0
        return reasons

    def _row(self, workspace: Workspace, inputs: Arrays, outputs: Arrays, i: int) -> str:
        """Fill row i; return why it has no derivatives, if it has none."""
        taken = self.steps.take(workspace, inputs, outputs, i)
        if isinstance(taken, CondynError):
            return str(taken)
        if not taken.status.ok:
            why = "; ".join((f"{taken.status}", *taken.notices))
            return f"the step has no derivatives: {why}"
        try:
            of = taken.derivatives(route=self.route, wrt=self.wrt)
        except CondynError as error:
            return str(error)
        outputs["q_end"][i], outputs["v_end"][i], outputs["margins"][i] = of.q, of.v, of.margin
        outputs["dq"][i], outputs["dv"][i] = of.matrices
        outputs["read"][i] = [MODES.index(mode) for mode in of.modes.values()]
        return ""
