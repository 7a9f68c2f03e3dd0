"""Steps with contacts by the compiled core.

It takes steps of `StewartTrinkle` from the first attempts of their contact solver, and proves each.
A step that has no such answer, and a motion with one in it, are Python's.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import NORMALISED, normalised
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled
from condyn_pin._core.threads import Kept
from condyn_pin._core.work import Arrays, Messages
from condyn_pin.constraints.contacts.base import Contact
from condyn_pin.contact import problem
from condyn_pin.contact.solution import ContactStatus
from condyn_pin.contact.solvers.admm import ADMM, POLISH, RESCUE
from condyn_pin.contact.solvers.base import ContactSolver
from condyn_pin.contact.solvers.newton import SemismoothNewton
from condyn_pin.dynamics.compiled import contiguous, of_contacts, untaken_contacts
from condyn_pin.dynamics.scene import Scene, time_of
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.mechanism.closed_chains import chains_of
from condyn_pin.simulation.batch.batch_step import ERRORS, STATUSES
from condyn_pin.simulation.batch.driven_path import DrivenPath
from condyn_pin.simulation.batch.inputs import loose
from condyn_pin.simulation.integrators import Integrator, closings, path_ends
from condyn_pin.simulation.integrators.contact_scheme import sizes_of_gaps
from condyn_pin.simulation.integrators.stewart_trinkle import StewartTrinkle
from condyn_pin.simulation.manifold import Manifold

# A penetration at the start of a motion that none is looked at again for [m, rad].
_DEEP: Final = 0.9 * tolerances.NEARLY_CLOSED


def untaken_steps(scene: Scene, integrator: Integrator) -> Iterator[str]:
    """Yield what the core does not take of steps with contacts, in words."""
    if type(integrator) is not StewartTrinkle:
        yield f"integrator = {integrator!r}: with contacts it has StewartTrinkle alone"
    elif type(integrator.contact) not in (ADMM, SemismoothNewton):
        yield f"contact = {integrator.contact!r}: it has ADMM and SemismoothNewton"
    yield from untaken_contacts(scene)


def step_plan(integrator: Integrator, dt: float) -> Array:
    """Return how steps are taken, as ``StepPlan`` of the core has it."""
    assert isinstance(integrator, StewartTrinkle)
    return _plan(dt, _method(integrator.contact))


def rounded_plan(integrator: Integrator, dt: float) -> Array:
    """Return the same with impulses to rounding, from which modes can be read."""
    assert isinstance(integrator, StewartTrinkle)
    method = _method(integrator.contact)
    return _plan(dt, method._replace(alternates=False, newton_first=False, polish=0))


class _Method(NamedTuple):
    """How contact problems are answered, as ``ContactMethod`` of the core has it."""

    alternates: bool
    newton_first: bool
    sticks_first: bool
    polish: int
    tolerance: float
    max_iterations: int
    anderson: int
    steps: int


def _method(solver: ContactSolver) -> _Method:
    """Return how a solver answers.

    Where no parameter of `ADMM` is chosen, Newton's method comes first: compiled it takes less
    time, and ends at rounding.
    """
    if isinstance(solver, ADMM):
        return _Method(
            True, solver == ADMM(), not solver.polish, POLISH if solver.polish else 0,
            solver.tolerance, solver.max_iterations,
            min(solver.anderson, solver.max_iterations), RESCUE,  # more is never remembered
        )  # fmt: skip
    assert isinstance(solver, SemismoothNewton)
    return _Method(False, False, False, 0, 1.0, 0, 0, solver.max_iterations)


def _plan(dt: float, method: _Method) -> Array:
    return np.array(
        [
            *(dt, *method),
            *sizes_of_gaps(),
            *(tolerances.CONTACT_SOLVED, problem.MOVES),
            *(path_ends.STRAIGHT, path_ends.MISSED),
            *(closings.CLOSED, closings.SMALL),
            *(tolerances.RANK, _DEEP),
            *(tolerances.NOT_DRIVEN, tolerances.OUT_OF_REACH),
        ],
        dtype=float,
    )


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


_contacts = Kept[Any]()


def contacts_of(workspace: Workspace, contacts: tuple[Contact, ...]) -> Any:
    """Return the core's memory for a workspace with contacts, made once for all chunks."""

    def make() -> Any:
        scene = replace(workspace.scene, contacts=contacts)
        rank = chains_of(workspace.scene).rank if workspace.scene.rows else 0
        return compiled().Contacts(workspace.compiled.core, **of_contacts(scene, rank))

    return _contacts.of(workspace, contacts, make)


def paths_of(workspace: Workspace, dt: float) -> dict[str, Array]:
    """Return where driven rows are to be in a step from the time of a workspace, for the core."""
    paths = DrivenPath(workspace, dt, 1, time_of(workspace.scene))
    return {"driven": paths.rows, "path": paths.wanted}


def states_of(workspace: Workspace, inputs: Arrays) -> tuple[Array, Array, Array]:
    """Return q, v and tau of the rows of a chunk, as the core takes them."""
    robot, q0 = workspace.scene.robot, inputs["q0"].copy()
    # most have nothing to be normalised, and cost no call each; squared, the limit is half of it
    for i, _, _ in loose(robot, q0, 1.0 - NORMALISED, 1.0 + NORMALISED):
        q0[i] = normalised(workspace.model, "q", q0[i])
    return q0, inputs["v0"], contiguous(inputs["tau0"], len(q0))


@dataclass(frozen=True)
class SteppedRows:
    """What the core does to some states of a `step_batch`."""

    contacts: tuple[Contact, ...]
    dt: float  # [s]
    integrator: Integrator

    def __call__(
        self, workspace: Workspace, inputs: Arrays, outputs: Arrays, threads: int
    ) -> tuple[NDArray[np.intp], Messages]:
        """Fill the outputs; return the rows that are left to Python, and nothing to say."""
        count = len(inputs["q0"])
        done, codes = np.zeros(count, np.int32), np.zeros(outputs["codes"].shape, np.int32)
        contacts_of(workspace, self.contacts).step(
            *states_of(workspace, inputs), plan=step_plan(self.integrator, self.dt),
            q=outputs["q"], v=outputs["v"], lam=outputs["lam"], errors=outputs["errors"],
            modes=codes, done=done, threads=threads, **paths_of(workspace, self.dt),
        )  # fmt: skip
        outputs["codes"][:], outputs["statuses"][:] = codes, STATUSES.index(ContactStatus.OK)
        return left_to_python(workspace, inputs["v0"], outputs, done, self.dt), {}
