"""run_problem: simulate, compare with the right motion, judge."""

from __future__ import annotations

import math
from time import process_time

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint_fields import check_positive
from condyn_pin.errors import InvalidArgument
from condyn_pin.lab.problems.base import Problem, Setting, Torque
from condyn_pin.lab.problems.result import MotionErrors, ProblemResult
from condyn_pin.simulation.run import simulate
from condyn_pin.simulation.trajectory import Trajectory

# Samples along a motion: as many as the library of problems asks for, or more.
_SAMPLES = 400


def run_problem(problem: Problem, setting: Setting, duration: float | None) -> ProblemResult:
    """Return errors, cost and verdict; `Problem.run` says how."""
    duration = _duration(problem, duration)
    steps = _steps(setting.dt, duration)
    scene, q0, v0 = problem.scene, problem.q0, problem.v0
    torque, evaluations = _counted(problem)
    start = process_time()
    trajectory = simulate(
        scene,
        q0,
        v0,
        torque,
        duration=duration,
        dt=duration / steps,
        integrator=setting.integrator,
        drift=setting.drift,
        solver=setting.solver,
        record=max(1, steps // _SAMPLES),
    )
    seconds = process_time() - start
    count = evaluations[0]  # to measure the motion asks for the torque again
    whole = trajectory.status.ok
    return ProblemResult(
        problem,
        setting,
        duration,
        measure(problem, trajectory) if whole else MotionErrors(),
        cpu_seconds=seconds,
        evaluations=count,
        trajectory=trajectory,
    )


def measure(problem: Problem, trajectory: Trajectory) -> MotionErrors:
    """Return what is wrong with a motion of a problem."""
    states = list(zip(trajectory.t.tolist(), trajectory.q, trajectory.v, strict=True))
    known = states[-1:] if problem.only_at else states
    found = np.array([problem.observe(q, v) for _, q, v in known])
    wanted = np.array([problem.answer(_near(t, problem.only_at)) for t, _, _ in known])
    energy_drift = None
    if problem.conservative:
        energies = np.array([problem.energy(q, v) for _, q, v in states])
        energy_drift = float(np.abs(energies - energies[0]).max())
    return MotionErrors(
        problem.error(found, wanted),
        float(np.abs(found - wanted).max()),
        energy_drift,
        float(trajectory.violation.max()),
        float(trajectory.constraint_velocity.max()),
    )


def _counted(problem: Problem) -> tuple[Torque, list[int]]:
    """Return the problem's torque, and how often it was asked for: once an evaluation."""
    evaluations, torque = [0], problem.torque
    nothing = np.zeros(problem.scene.robot.nv)

    def counted(t: float, q: Array, v: Array) -> Array:
        evaluations[0] += 1
        return nothing if torque is None else torque(t, q, v)

    return counted, evaluations


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
            f"{duration / math.ceil(duration / dt)!r} is"
        )
    return steps


def _near(t: float, known: tuple[float, ...]) -> float:
    """Return t, or the time that it means among those that are known."""
    return min(known, key=lambda each: abs(each - t)) if known else t
