"""Verdicts on runs: whether gaps close as drift control says, and whether an end is reached.

At rest, without weight and torques, nothing moves but the gaps, and semi-implicit Euler takes each
of them by

    u <- u - 2 alpha dt u - (beta dt)^2 c,    c <- c + u,    u = dt c'

That is the truth. Where an eigenvalue of this map is beyond the unit circle, the right answer is a
refusal.
"""

from __future__ import annotations

from math import nan

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.lab.extremes.base import Case, Flight, Motion
from condyn_pin.lab.extremes.verdict import Verdict
from condyn_pin.simulation.integrators.explicit import SemiImplicitEuler
from condyn_pin.simulation.notices import solver_notices
from condyn_pin.simulation.run import simulate
from condyn_pin.simulation.trajectory import Trajectory

# What a gap may be off, relative to the first: it is 1e-7 of a lever, whose turning is left out.
_FOLLOWED = 1e-4

# Contacts are anchored where they are at the start: what they are open by is rounding [m, rad].
_ROUNDED = 1e-9


def judge_run(case: Case, motion: Motion, solver: Solver) -> tuple[Verdict, float, str]:
    """Return the verdict on a solver in motion, the error of the gaps, and the status of the run.

    Raises
    ------
    CondynError
        If the run is refused.
    """
    run = simulate(
        case.scene, case.q, case.v, duration=motion.steps * motion.dt, dt=motion.dt,
        integrator=SemiImplicitEuler(), drift=case.drift, solver=solver,
        gravity=False, springs=False, damping=False,
    )  # fmt: skip
    status = run.run.status.name.lower()
    if not run.run.status.ok:
        return Verdict.SAID_SO, nan, status
    step = gap_map(case.drift or Baumgarte(0.0, 0.0), motion.dt)
    if np.abs(np.linalg.eigvals(step)).max() > 1.0:
        return Verdict.WRONG, nan, f"{status}, with gaps that grow"
    error = gap_error(run, step)
    if error <= _FOLLOWED:
        return Verdict.OK, error, status
    return (Verdict.SAID_SO if solver_notices(run) else Verdict.WRONG), error, status


def gap_map(drift: Baumgarte, dt: float) -> Array:
    """Return the map of (c, u)."""
    by_u, by_c = 1.0 - drift.Kd * dt, -drift.Kp * dt**2
    return np.array([[1.0 + by_c, by_u], [by_c, by_u]])


def gap_error(run: Trajectory, step: Array) -> float:
    """Return the largest difference of a gap from its map, relative to the first gap."""
    equations = Equations(run.scene.robot.model, run.scene.bounds)
    gaps = np.array([equations.violation(q) for q in run.q])
    state = np.array([gaps[0], np.zeros(equations.m)])
    worst = 0.0
    for gap in gaps:
        worst = max(worst, float(np.abs(gap - state[0]).max(initial=0.0)))
        state = step @ state
    return worst / max(float(np.abs(gaps[0]).max(initial=0.0)), _ROUNDED)


def judge_flight(case: Case, flight: Flight, solver: Solver) -> tuple[Verdict, float, str]:
    """Return the verdict on a solver in motion, what the run misses the end by, and its status.

    A run that breaks down has said so. A notice is not enough: energy that comes or goes is told of
    rough runs as of wrong ones.

    Raises
    ------
    CondynError
        If the run is refused.
    """
    run = simulate(
        case.scene, case.q, case.v, case.tau if flight.tau is None else flight.tau,
        duration=flight.duration, dt=flight.dt, integrator=flight.integrator, solver=solver,
    )  # fmt: skip
    status = run.run.status.name.lower()
    if not run.run.status.ok:
        return Verdict.SAID_SO, nan, status
    missed = pin.difference(case.scene.robot.model, flight.end, run.q[-1])
    error = float(np.abs(missed).max())
    return (Verdict.OK if error <= flight.within else Verdict.WRONG), error, status
