"""The verb step_batch: one step with contacts from many states."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from math import nan
from time import perf_counter
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import read_only
from condyn_pin._core.rows import Native, Rows
from condyn_pin._core.threads import Kept
from condyn_pin._core.work import Arrays, Kind, Messages, Progress, silent
from condyn_pin.constraints.contacts.base import Contact
from condyn_pin.contact.problem import MODES
from condyn_pin.contact.solution import ContactStatus
from condyn_pin.dynamics.compiled import untaken
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import CondynError
from condyn_pin.simulation.batch.batch_step import ERRORS, ROWS, STATUSES, BatchStep
from condyn_pin.simulation.batch.compiled import workers
from condyn_pin.simulation.batch.compiled_steps import SteppedRows, untaken_steps
from condyn_pin.simulation.batch.inputs import check_states
from condyn_pin.simulation.batch.recipe import Recipe
from condyn_pin.simulation.contact_columns import candidates_of, row_names
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.stewart_trinkle import StewartTrinkle
from condyn_pin.simulation.step import contact_problem, step
from condyn_pin.simulation.step_solution import StepSolution

_DEFAULT: Final = StewartTrinkle()

# Steps a thread of the compiled core that it is handed at a time.
_STEPS: Final = 2000


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
        To the bit what `step` returns, whoever did the work: every step begins cold. By the
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
    about, recipe = (tuple(scene.contacts), float(dt), integrator), Recipe(scene.bilateral)
    kernel, executor, chunk = workers(
        executor, SteppedRows(*about), StepKernel(*about),
        reasons=untaken_steps(scene, integrator), untaken=lambda: untaken(recipe.workspace()),
        chunk=chunk, most=_STEPS,
    )  # fmt: skip
    rows = Rows(kernel, recipe, executor, chunk, 500, progress)
    made = partial(batch_of_steps, scene, float(dt), integrator, inputs, begun)
    return rows.fill(len(inputs["q0"]), inputs, kinds_of_steps(scene), made)


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
    """Return what a row of each output is."""
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
    arrays = {name: (inputs | outputs)[name] for name in ROWS}
    seconds = perf_counter() - begun
    return BatchStep(scene=scene, dt=dt, integrator=integrator, seconds=seconds, **arrays)


_scenes = Kept[Scene]()


@dataclass(frozen=True)
class StepKernel:
    """The kernel: some rows of states in, their steps out; workspaces know no contacts."""

    contacts: tuple[Contact, ...]
    dt: float  # [s]
    integrator: ContactScheme = field(default=_DEFAULT)

    def __call__(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> Messages:
        """Take the steps; return why there are none of some states."""
        words = {}
        for i in range(len(inputs["q0"])):
            taken = self.take(workspace, inputs, outputs, i)
            if isinstance(taken, CondynError):
                words[i] = str(taken)
        return words

    def take(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays, i: int
    ) -> StepSolution | CondynError:
        """Return the step of row i, or why there is none; both are in the outputs."""
        state = (inputs[name][i] for name in ("q0", "v0", "tau0"))
        by = self.integrator
        try:
            now = step(self._scene(workspace), *state, dt=self.dt, integrator=by, throw=False)
        except CondynError as error:
            _put_nothing(outputs, i)
            return error
        _put(outputs, i, now)
        return now

    def _scene(self, workspace: Workspace) -> Scene:
        bilateral, contacts = workspace.scene, self.contacts
        return _scenes.of(workspace, contacts, lambda: replace(bilateral, contacts=contacts))


def _put(outputs: Arrays, i: int, now: StepSolution) -> None:
    outputs["q"][i], outputs["v"][i], outputs["lam"][i] = now.q, now.v, now.lam
    outputs["codes"][i] = [MODES.index(mode) for mode in now.modes.values()]
    errors = [getattr(now, name) for name in ERRORS[1:]]
    outputs["errors"][i] = now.contact.natural, *errors
    outputs["statuses"][i] = STATUSES.index(now.status)


def _put_nothing(outputs: Arrays, i: int) -> None:
    """Put the status of a state whose equations cannot be made."""
    for name in ("q", "v", "lam", "errors"):
        outputs[name][i] = nan
    outputs["codes"][i] = 0
    outputs["statuses"][i] = STATUSES.index(ContactStatus.NOT_FINITE)
