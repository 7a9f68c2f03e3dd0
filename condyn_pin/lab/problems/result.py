"""ProblemResult: how far a simulated motion is from the right one, and what it cost."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil, inf, isfinite
from time import process_time
from typing import Any

import numpy as np

from condyn_pin._core.arguments import renamed
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import check_positive
from condyn_pin.errors import InvalidArgument
from condyn_pin.lab.problems.base import Problem
from condyn_pin.lab.problems.setting import Limit, Setting
from condyn_pin.simulation.run import simulate
from condyn_pin.simulation.trajectory import Trajectory

# Samples along a motion: as many as the library of problems asks for, or more.
_SAMPLES = 400


@dataclass(frozen=True)
class ProblemResult:
    """A problem that was run, and the verdict.

    The errors of a motion that ended early are infinite.

    Attributes
    ----------
    problem : Problem
    setting : Setting
        What was asked for.
    duration : float
        Length of the motion [s].
    cpu_seconds : float
        Processor time of `simulate`, its workspace included [s].
    evaluations : int
        Of the equations of motion: solves, and residuals of implicit integrators.
    trajectory : Trajectory
        The motion; its `run` says what was used, and how it ended.
    error : float
        By the problem's own measure, in its own unit.
    difference : float
        The largest of a number that is compared [m, rad, m/s: its own unit].
    energy_drift : float or None
        Largest change of the energy along the motion [J]; None where it is not conserved.
    violation, constraint_velocity : float
        Largest |c(q)| [m, rad] and |J v| [m/s, rad/s] along it.
    """

    problem: Problem
    setting: Setting
    duration: float  # [s]
    cpu_seconds: float  # [s]
    evaluations: int
    trajectory: Trajectory = field(repr=False, compare=False)
    error: float = inf
    difference: float = inf
    energy_drift: float | None = inf  # [J]
    violation: float = inf  # [m, rad]
    constraint_velocity: float = inf  # [m/s, rad/s]

    slip = renamed("constraint_velocity")

    @property
    def dt(self) -> float:
        """The step [s]."""
        return self.trajectory.run.dt

    @property
    def ended(self) -> str:
        """Why it ended early; empty if it did not."""
        run = self.trajectory.run
        return "" if run.status.ok else run.reason

    @property
    def judged(self) -> float:
        """The number that the limits are about."""
        if self.problem.judged == "error":
            return self.error
        return inf if self.energy_drift is None else self.energy_drift

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
        """Return what `condyn lab problem` prints, by its label."""
        drift = "not conserved in this problem"
        if self.energy_drift is not None:
            drift = f"{self.energy_drift:.2g} J"
        took = f"{self.cpu_seconds:.3g} s for {self.duration:g} s"
        return {
            "run with": f"dt {self.dt:g} s, {self.method}",
            "error": f"{self.error:.2g}: {self.problem.measure}",
            "difference": f"{self.difference:.2g}, the largest of a number that is compared",
            "energy drift": drift,
            "violation": f"{self.violation:.2g} in c(q), {self.constraint_velocity:.2g} in J v",
            "CPU": f"{took}, {self.evaluations} evaluations",
            "verdict": self.verdict,
        }

    def to_dict(self) -> dict[str, Any]:
        """Return every number, for a file; what is not finite is None."""
        run = self.trajectory.run
        errors = ("error", "difference", "energy_drift", "violation", "constraint_velocity")
        numbers = {name: getattr(self, name) for name in errors}
        return {
            "problem": self.problem.label,
            "integrator": repr(run.integrator),
            "drift": repr(run.drift),
            "solver": repr(run.solver),
            "dt": self.dt,
            "duration": self.duration,
            **{k: x if x is not None and isfinite(x) else None for k, x in numbers.items()},
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


def run_problem(problem: Problem, setting: Setting, duration: float | None) -> ProblemResult:
    """Simulate, compare with the right motion, and give a verdict; `Problem.run` says how."""
    duration = _duration(problem, duration)
    steps = _steps(setting.dt, duration)
    scene, q0, v0 = problem.scene, problem.q0, problem.v0
    torque, nothing, evaluations = problem.torque, np.zeros(scene.robot.nv), 0

    def counted(t: float, q: Array, v: Array) -> Array:
        nonlocal evaluations
        evaluations += 1
        return nothing if torque is None else torque(t, q, v)

    start = process_time()
    trajectory = simulate(
        scene,
        q0,
        v0,
        counted,
        duration=duration,
        dt=duration / steps,
        integrator=setting.integrator,
        drift=setting.drift,
        solver=setting.solver,
        record=max(1, steps // _SAMPLES),
    )
    seconds = process_time() - start
    count = evaluations  # to measure the motion asks for the torque again
    found = _errors(problem, trajectory) if trajectory.run.status.ok else {}
    return ProblemResult(problem, setting, duration, seconds, count, trajectory, **found)


def _errors(problem: Problem, trajectory: Trajectory) -> dict[str, Any]:
    """Return what is wrong with a motion of a problem, by the fields of its result."""
    states = list(zip(trajectory.t.tolist(), trajectory.q, trajectory.v, strict=True))
    known = states[-1:] if problem.only_at else states
    found = np.array([problem.observe(q, v) for _, q, v in known])
    wanted = np.array([problem.answer(_near(t, problem.only_at)) for t, _, _ in known])
    energy_drift = None
    if problem.conservative:
        energies = np.array([problem.energy(q, v) for _, q, v in states])
        energy_drift = float(np.abs(energies - energies[0]).max())
    return {
        "error": problem.error(found, wanted),
        "difference": float(np.abs(found - wanted).max()),
        "energy_drift": energy_drift,
        "violation": float(trajectory.violation.max()),
        "constraint_velocity": float(trajectory.constraint_velocity.max()),
    }


def _duration(problem: Problem, duration: float | None) -> float:
    if duration is None:
        return problem.duration
    check_positive(duration=duration)
    if problem.only_at and duration not in problem.only_at:
        known = " and ".join(f"{t:g}" for t in problem.only_at)
        raise InvalidArgument(
            f"duration = {duration!r}: the answer of {problem.name} is known at {known} s"
        )
    return float(duration)


def _steps(dt: float, duration: float) -> int:
    """Return the number of steps; the last one has to end where the motion does."""
    check_positive(dt=dt)
    steps = max(1, round(duration / dt))
    if abs(steps * dt - duration) > 1e-9 * duration:
        raise InvalidArgument(
            f"dt = {dt!r}: {duration:g} s is not a whole number of steps; "
            f"{duration / ceil(duration / dt)!r} is"
        )
    return steps


def _near(t: float, known: tuple[float, ...]) -> float:
    """Return t, or the time that it means among those that are known."""
    return min(known, key=lambda each: abs(each - t)) if known else t
