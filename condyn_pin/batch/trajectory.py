"""BatchTrajectory: many motions of one scene, each with its errors and its status."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin.arrays import Array
from condyn_pin.batch.outcome import Outcome
from condyn_pin.batch.rows import MISSING
from condyn_pin.drift.base import Drift
from condyn_pin.scene import Scene
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.outcome import RunStatus

# A status as a number is its place here.
RUN_STATUSES: Final = tuple(RunStatus)


@dataclass(frozen=True, eq=False, repr=False)
class Samples:
    """The samples of N motions; NaN after the end of one that broke down.

    Attributes
    ----------
    t : (N, k) array
        [s]
    q, v, a : (N, k, nq), (N, k, nv), (N, k, nv) array
    lam : (N, k, m) array
        Constraint forces in the axes of each constraint [N, N m].
    tau : (N, k, nv) array
        Torques applied, without springs and damping [N, N m].
    """

    t: Array
    q: Array
    v: Array
    a: Array
    lam: Array
    tau: Array


@dataclass(frozen=True, eq=False, repr=False)
class BatchTrajectory(Outcome):
    """The ends of N motions, and how well each kept constraints and energy.

    Attributes
    ----------
    scene : Scene
    integrator, drift
        What was used.
    dt : float
        [s]
    steps : int
        Of each motion that went to its end.
    t : (N,) array
        How far each motion went [s]; 0 where it could not begin.
    q, v : (N, nq), (N, nv) array
        Where it ended.
    violation, slip : (N,) array
        The largest abs(c(q)) [m, rad] and abs(J v) [m/s, rad/s] among the samples looked at.
    energy_error : (N,) array
        The largest energy that came or went without work, among the samples looked at [J]. Work is
        integrated over them: where torques or damping act, ``record=1`` makes it accurate.
    statuses : (N,) int8 array
        Place in ``tuple(RunStatus)``: 0 is finished. -1 where no worker got that far, which only
        the batch of a `WorkersLost` has.
    run_times : (N,) array
        Of each motion [s], while other processes used the machine too.
    samples : Samples or None
        None if nothing was to be recorded.
    seconds : float
        Wall time of the whole batch [s].

    Notes
    -----
    Printing it names the motions that are not ok. There is no ``batch[i]``: neither the anchors of
    a motion nor the words of its end are kept. `simulate` from the state of a row gives its
    `Trajectory`, to the bit, and says why it ended.
    """

    scene: Scene
    integrator: Integrator
    drift: Drift
    dt: float  # [s]
    steps: int
    t: Array
    q: Array
    v: Array
    violation: Array
    slip: Array
    energy_error: Array
    statuses: NDArray[np.int8]
    run_times: Array  # [s]
    samples: Samples | None
    seconds: float  # [s]

    _endings: ClassVar[Sequence[Enum]] = RUN_STATUSES

    def __len__(self) -> int:
        return len(self.q)

    def __repr__(self) -> str:
        counts = ", ".join(f"{number} {name}" for name, number in self.counts.items())
        return f"BatchTrajectory({self.scene.robot.name}, {len(self)} motions: {counts or 'none'})"

    def __str__(self) -> str:
        steps = float(self.t.sum()) / self.dt
        return "\n".join(
            (
                f"{repr(self)[len('BatchTrajectory(') : -1]}, {self.steps} steps of "
                f"{1e3 * self.dt:.4g} ms, in {self.seconds:.3g} s: {steps / self.seconds:.4g} "
                "steps/s",
                f"violation   {self._worst(self.violation)} m, rad at most; "
                f"{self._worst(self.slip)} m/s, rad/s",
                f"unexplained {self._worst(self.energy_error)} J at most",
                *self._not_ok(),
            )
        )

    def _named(self, i: int) -> str:
        return str(i) if self.statuses[i] == MISSING else f"{i} after {self.t[i]:.4g} s"

    @staticmethod
    def _worst(values: Array) -> str:
        known = values[np.isfinite(values)]
        return f"{known.max():.1e}" if known.size else "?"
