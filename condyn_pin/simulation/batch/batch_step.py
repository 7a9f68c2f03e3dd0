"""BatchStep: one step with contacts from many states, each with its errors and its status."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.rows import MISSING, Batch, Outcome, Some
from condyn_pin.contact.problem import mode_words
from condyn_pin.contact.solution import ContactStatus
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import WorkersLost
from condyn_pin.simulation.contact_columns import candidates_of
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.step import step
from condyn_pin.simulation.step_solution import StepSolution

# A status as a number is its place here.
STATUSES: Final = tuple(ContactStatus)

# Columns of the errors of a step.
ERRORS: Final = (
    *("natural", "dynamics_error", "constraint_error", "violation", "penetration"),
    *("energy_lost", "correction_work", "algorithmic_work"),
)

# The arrays with one row per state.
ROWS: Final = ("q", "v", "lam", "codes", "errors", "statuses", "q0", "v0", "tau0")


@dataclass(frozen=True, eq=False, repr=False)
class BatchStep(Outcome, Batch[StepSolution]):
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

    _endings: ClassVar[Sequence[Enum]] = STATUSES

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
        """Return it as a `pandas.DataFrame`, a step a row.

        Columns: status, q and v by joint at the end of the step, the mode of each contact, and the
        errors.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        from condyn_pin._core.show import require_pandas
        from condyn_pin.simulation.columns import step_columns

        return require_pandas().DataFrame(step_columns(self, ERRORS))

    def __len__(self) -> int:
        return len(self.q)

    def _some(self, rows: Some) -> BatchStep:
        return replace(self, **{name: read_only(getattr(self, name)[rows]) for name in ROWS})

    def _one(self, i: int) -> StepSolution:
        if self.statuses[i] == MISSING:
            raise WorkersLost(f"no worker got to state {i}; `missing` has all of them", self)
        asked = self.q0[i], self.v0[i], self.tau0[i]
        return step(self.scene, *asked, dt=self.dt, integrator=self.integrator, throw=False)

    def __repr__(self) -> str:
        return f"BatchStep({self.scene.robot.name}, {len(self)} states: {self._counted()})"

    def __str__(self) -> str:
        worst = float(np.nanmax(self.natural, initial=0.0))
        lines = [
            f"{repr(self)[len('BatchStep(') : -1]}, in {self.seconds:.3g} s",
            f"largest natural residual  {worst:.1e}",
            *self._not_ok(),
        ]
        return "\n".join(lines)
