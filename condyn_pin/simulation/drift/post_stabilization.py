"""PostStabilization: one Newton step back to the constraints after each step of the integrator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from condyn_pin.constraints.drift import Correction, Drift
from condyn_pin.simulation.drift.projection import Metric, check_projection, once_every
from condyn_pin.simulation.gaps import gaps_of
from condyn_pin.simulation.system import System


@dataclass(frozen=True)
class PostStabilization(Drift):
    """One correction of position and velocity per step, with one factorisation for both.

    q <- integrate(q, -W^-1 J^T G^+ c),    v <- v - W^-1 J^T G^+ J v,    G = J W^-1 J^T

    The remainder of one Newton step, of the order of the gap squared, is for the next step.
    The acceleration of the state before the correction is used for the state after it: they differ
    by the error of one step of the integrator. So with `Proximal` in the metric of M a step costs
    no more solves than without drift control.

    Parameters
    ----------
    metric : {"mass", "euclidean"}
        W: the mass matrix, or the identity.
    every : int
        Steps from one correction to the next.

    Raises
    ------
    InvalidArgument
        If the metric is unknown, or `every` is not positive.

    References
    ----------
    Ascher, Chin, Petzold, Reich. Stabilization of constrained mechanical systems with DAEs and
    invariant manifolds. Mechanics of Structures and Machines 23, 1995.
    """

    title: ClassVar[str] = "post-stabilization"
    cost: ClassVar[str] = "a few microseconds (Proximal)"
    use: ClassVar[str] = "by default: the cheapest that keeps both levels"
    corrects: ClassVar[bool] = True

    metric: Metric = "mass"
    every: int = 1

    def __post_init__(self) -> None:
        check_projection(self.metric, self.every)

    def start(self, system: System, dt: float) -> Correction:
        """Correction by one Newton step, after every `every` steps of the integrator."""
        return once_every(self.every, gaps_of(system, self.metric).newton_step)
