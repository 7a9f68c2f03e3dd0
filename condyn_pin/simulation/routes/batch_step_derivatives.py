"""BatchStepDerivatives: how the ends of steps with contacts change, at many states."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.rows import MISSING, Batch, Some
from condyn_pin.contact.problem import MODES, mode_words
from condyn_pin.errors import SolveFailed, WorkersLost
from condyn_pin.simulation.batch.batch_step import BatchStep
from condyn_pin.simulation.contact_columns import candidates_of
from condyn_pin.simulation.routes.base import Route
from condyn_pin.simulation.routes.columns import Columns
from condyn_pin.simulation.routes.step_derivatives import StepDerivatives

# The arrays with a row a state, beside those of the steps.
ROWS: Final = ("q", "v", "dq", "dv", "codes", "margins", "reasons")


@dataclass(frozen=True, eq=False, repr=False)
class BatchStepDerivatives(Batch[StepDerivatives]):
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

    @property
    def failed(self) -> NDArray[np.intp]:
        """Indices of the states without derivatives, missing ones among them."""
        return np.flatnonzero(np.isnan(self.margins))

    @property
    def ok(self) -> bool:
        """Whether all states have derivatives."""
        return not self.failed.size

    @property
    def one_sided(self) -> NDArray[np.bool_]:
        """Which have a contact so near to another mode that they hold on one side (N,)."""
        return np.asarray(self.margins < tolerances.SWITCHES)

    @property
    def modes(self) -> dict[str, NDArray[np.object_]]:
        """Mode of each contact in each step (N,): open, stick or slide."""
        words = mode_words(self.codes)
        names = candidates_of(self.step.scene).names
        return {name: words[:, i] for i, name in enumerate(names)}

    @property
    def dq_dq(self) -> Array:
        """q+ by q (N, nv, nv)."""
        return self.dq[:, :, self.columns.q]

    @property
    def dq_dv(self) -> Array:
        """q+ by v (N, nv, nv)."""
        return self.dq[:, :, self.columns.v]

    @property
    def dq_dtau(self) -> Array:
        """q+ by the torques (N, nv, nv)."""
        return self.dq[:, :, self.columns.tau]

    @property
    def dv_dq(self) -> Array:
        """v+ by q (N, nv, nv)."""
        return self.dv[:, :, self.columns.q]

    @property
    def dv_dv(self) -> Array:
        """v+ by v (N, nv, nv)."""
        return self.dv[:, :, self.columns.v]

    @property
    def dv_dtau(self) -> Array:
        """v+ by the torques (N, nv, nv)."""
        return self.dv[:, :, self.columns.tau]

    @property
    def columns(self) -> Columns:
        """Where each part stands in `dq` and `dv`."""
        n, cones = self.v.shape[1], candidates_of(self.step.scene).cones
        return Columns(n, cones, self.dv.shape[2] - Columns(n, cones).size)

    def __len__(self) -> int:
        return len(self.margins)

    def _some(self, rows: Some) -> BatchStepDerivatives:
        some = {name: read_only(getattr(self, name)[rows]) for name in ROWS}
        return replace(self, step=self.step[rows], **some)

    def _one(self, i: int) -> StepDerivatives:
        if self.step.statuses[i] == MISSING:
            raise WorkersLost(f"no worker got to state {i}; `missing` has all of them", self)
        if np.isnan(self.margins[i]):
            raise SolveFailed(f"state {i}: {self.reasons[i]}", None)
        candidates = candidates_of(self.step.scene)
        codes = self.codes[i].tolist()
        modes = dict(zip(candidates.names, (MODES[code] for code in codes), strict=True))
        return StepDerivatives(
            self.q[i], self.v[i], modes, float(self.margins[i]), self.route,
            candidates.names[: candidates.cones], (self.dq[i], self.dv[i]), self.parameters,
        )  # fmt: skip

    def __repr__(self) -> str:
        missing = f", {len(self.failed)} without" if self.failed.size else ""
        sided = int(self.one_sided.sum())
        sides = f", {sided} one-sided" if sided else ""
        return f"BatchStepDerivatives({self.route!r}: {len(self)} states{missing}{sides})"
