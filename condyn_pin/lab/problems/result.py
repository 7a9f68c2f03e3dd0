"""ProblemResult: how far a simulated motion is from the right one, and what it cost."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from condyn_pin._core.renamed import renamed
from condyn_pin.lab.problems.base import Limit, Problem, Setting
from condyn_pin.simulation.trajectory import Trajectory


@dataclass(frozen=True)
class MotionErrors:
    """What is wrong with a motion; by default everything."""

    error: float = math.inf  # by the problem's own measure
    difference: float = math.inf  # largest of a number that is compared, in its own unit
    energy_drift: float | None = math.inf  # largest change along the motion [J]
    violation: float = math.inf  # largest |c(q)| along it [m, rad]
    constraint_velocity: float = math.inf  # largest |J v| along it [m/s, rad/s]


@dataclass(frozen=True)
class ProblemResult:
    """A problem that was run, and the verdict.

    Attributes
    ----------
    problem : Problem
    setting : Setting
        What was asked for.
    duration : float
        [s].
    errors : MotionErrors
        Infinite for a motion that ended early.
    cpu_seconds : float
        Processor time of `simulate`, its workspace included [s].
    evaluations : int
        Of the equations of motion: solves, and residuals of implicit integrators.
    trajectory : Trajectory
        The motion; its `run` says what was used, and how it ended.
    """

    problem: Problem
    setting: Setting
    duration: float  # [s]
    errors: MotionErrors
    cpu_seconds: float  # [s]
    evaluations: int
    trajectory: Trajectory = field(repr=False, compare=False)

    slip = renamed("constraint_velocity")

    @property
    def dt(self) -> float:
        """The step [s]."""
        return self.trajectory.run.dt

    @property
    def ended(self) -> str:
        """Why it ended early; empty if it did not."""
        return "" if self.trajectory.status.ok else self.trajectory.reason

    @property
    def error(self) -> float:
        """By the problem's own measure."""
        return self.errors.error

    @property
    def energy_drift(self) -> float | None:
        """Largest change of the energy [J]; None where it is not conserved."""
        return self.errors.energy_drift

    @property
    def violation(self) -> float:
        """Largest |c(q)| along the motion [m, rad]."""
        return self.errors.violation

    @property
    def judged(self) -> float:
        """The number that the limits are about."""
        if self.problem.judged == "error":
            return self.error
        return math.inf if self.energy_drift is None else self.energy_drift

    @property
    def met(self) -> tuple[Limit, ...]:
        """The limits that are met; none unless the motion is whole."""
        whole = not self.ended and self.duration >= self.problem.duration * (1 - 1e-12)
        return tuple(limit for limit in self.problem.limits if whole and self.judged <= limit.value)

    @property
    def verdict(self) -> str:
        """The finest limit that is met, in words."""
        if self.ended:
            return f"failed: {self.ended}"
        if self.duration < self.problem.duration * (1 - 1e-12):
            return f"no verdict: {self.duration:g} s of {self.problem.duration:g} s"
        if not self.met:
            coarsest = self.problem.limits[0]
            return f"not met: {_said(coarsest)}; found {self.judged:.2g}"
        finest = self.met[-1]
        return f"met: {_said(finest)}; found {self.judged:.2g}"

    @property
    def method(self) -> str:
        """Integrator, drift scheme and solver, every parameter said."""
        run = self.trajectory.run
        return f"{run.integrator!r}, {run.drift!r}, {run.solver!r}"

    def facts(self) -> dict[str, str]:
        """Return what `condyn problem` prints, by its label."""
        drift = "not conserved in this problem"
        if self.energy_drift is not None:
            drift = f"{self.energy_drift:.2g} J"
        e = self.errors
        return {
            "run with": f"dt {self.dt:g} s, {self.method}",
            "error": f"{e.error:.2g}: {self.problem.measure}",
            "difference": f"{e.difference:.2g}, the largest of a number that is compared",
            "energy drift": drift,
            "violation": f"{e.violation:.2g} in c(q), {e.constraint_velocity:.2g} in J v",
            "CPU": f"{self.cpu_seconds:.3g} s for {self.duration:g} s, "
            f"{self.evaluations} evaluations",
            "verdict": self.verdict,
        }

    def to_dict(self) -> dict[str, Any]:
        """Return every number, for a file; what is not finite is None."""
        run, e = self.trajectory.run, self.errors
        numbers = {
            "error": e.error,
            "difference": e.difference,
            "energy_drift": e.energy_drift,
            "violation": e.violation,
            "constraint_velocity": e.constraint_velocity,
        }
        return {
            "problem": self.problem.label,
            "integrator": repr(run.integrator),
            "drift": repr(run.drift),
            "solver": repr(run.solver),
            "dt": self.dt,
            "duration": self.duration,
            **{k: x if x is not None and math.isfinite(x) else None for k, x in numbers.items()},
            "cpu_seconds": self.cpu_seconds,
            "evaluations": self.evaluations,
            "verdict": self.verdict,
        }

    def __str__(self) -> str:
        facts = self.facts().items()
        head = f"{self.problem.label}: {self.problem.title}"
        return "\n".join([head, *(f"  {label:<13} {text}" for label, text in facts)])


def _said(limit: Limit) -> str:
    return f"{limit.level}, {limit.value:g} ({limit.source})"
