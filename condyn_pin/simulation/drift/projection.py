"""Projection: back to the constraints after a step, as near as need be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from condyn_pin._core.arguments import check_count
from condyn_pin._core.arrays import Array, finite
from condyn_pin.constraints.drift import Correction, Drift
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.gaps import Gaps, gaps_of
from condyn_pin.simulation.system import System

Metric = Literal["mass", "euclidean"]
METRICS: tuple[Metric, ...] = ("mass", "euclidean")

# Newton's steps square a gap: from 1e-2 to rounding in four.
_MOST_STEPS = 8


@dataclass(frozen=True)
class Projection(Drift):
    """Newton's steps along W^-1 J^T onto the constraints.

    q <- integrate(q, -W^-1 J^T G^+ c),    v <- v - W^-1 J^T G^+ J v,    G = J W^-1 J^T

    Each move is the shortest in W that closes c to first order. From a gap g they lead to the
    closed state of least distance but for about g^2; v is at the least distance where q ends.

    Gaps are checked after every step and closed if they exceed `tolerance`. With `Proximal` in the
    metric of M the check costs next to nothing: it uses the first solve of the next step, and
    another solve is made only if something has to be closed.

    Energy is not kept: it drifts with the errors of the integrator, as it does without
    constraints. In the metric of M, the velocity part never raises the kinetic energy.

    Parameters
    ----------
    position, velocity : bool
        Which of c(q) = 0 and J v = 0 to keep. The velocity alone does most: with J v = 0 a gap
        grows by what each step leaves, not with the square of time.
    metric : {"mass", "euclidean"}
        W: the mass matrix, or the identity. The identity moves light and heavy bodies alike.
    every : int
        Steps from one look to the next.
    tolerance : float
        Violation [m, rad] and velocity [m/s, rad/s] that are left.

    Raises
    ------
    InvalidArgument
        If there is nothing to keep, the metric is unknown, `every` is not positive, or the
        tolerance is negative.

    References
    ----------
    Eich. Convergence results for a coordinate projection method applied to mechanical systems with
    algebraic constraints. SIAM Journal on Numerical Analysis 30, 1993.
    """

    title: ClassVar[str] = "projection"
    cost: ClassVar[str] = "a microsecond, and a solve where something is to close (Proximal)"
    use: ClassVar[str] = "to keep loops closed to a tolerance"
    corrects: ClassVar[bool] = True

    position: bool = True
    velocity: bool = True
    metric: Metric = "mass"
    every: int = 1
    tolerance: float = 1e-10  # [m, rad, m/s, rad/s]

    def __post_init__(self) -> None:
        check_projection(self.metric, self.every)
        if not (self.position or self.velocity):
            raise InvalidArgument("position = velocity = False: NoDrift() leaves both alone")
        if finite("tolerance", self.tolerance, ()) < 0:
            raise InvalidArgument(f"tolerance = {self.tolerance!r}: a number >= 0 is needed")

    @property
    def closes(self) -> bool:
        """True if the projection keeps c(q) = 0."""
        return self.position

    def start(self, system: System, dt: float) -> Correction:
        """Projection of the state, after every `every` steps of the integrator."""
        gaps, integrate = gaps_of(system, self.metric), system.integrate

        def correct(t: float, q: Array, v: Array) -> tuple[Array, Array]:
            gap, velocity = self._sizes(gaps, t, q, v)
            for k in range(_MOST_STEPS):
                if gap <= self.tolerance and velocity <= self.tolerance:
                    break
                dq, dv = gaps.step(k > 0)
                q1 = integrate(q, dq) if self.position else q
                v1 = v + dv if self.velocity else v
                before, (gap, velocity) = (gap, velocity), self._sizes(gaps, t, q1, v1)
                # the position first: where loops are open, rows contradict each other
                if not gap <= max(before[0], self.tolerance):
                    break
                q, v = q1, v1
                if not (_shrinks(before[0], gap) or _shrinks(before[1], velocity)):
                    break  # rounding, or out of reach
            return q, v

        return once_every(self.every, correct)

    def _sizes(self, gaps: Gaps, t: float, q: Array, v: Array) -> tuple[float, float]:
        """Return the largest violation and the largest |J v|, zero for what is not to be kept."""
        both = np.abs(gaps.look(t, q, v))
        gap = float(both[:, 0].max(initial=0.0)) if self.position else 0.0
        return gap, float(both[:, 1].max(initial=0.0)) if self.velocity else 0.0


def _shrinks(before: float, after: float) -> bool:
    return after < before / 2


def check_projection(metric: str, every: int) -> None:
    """Refuse an unknown metric, or a number of steps that is not a positive integer."""
    if metric not in METRICS:
        raise InvalidArgument(f"metric = {metric!r}: one of {', '.join(METRICS)} is needed")
    check_count("every", every)


def once_every(steps: int, correct: Correction) -> Correction:
    """Correction of the state after every `steps` steps; other states stay unchanged."""
    if steps == 1:
        return correct
    count = 0

    def correct_some(t: float, q: Array, v: Array) -> tuple[Array, Array]:
        nonlocal count
        count += 1
        return (q, v) if count % steps else correct(t, q, v)

    return correct_some
