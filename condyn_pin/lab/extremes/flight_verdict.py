"""Verdicts on a motion whose end is known: whether a run that finishes gets there."""

from __future__ import annotations

from math import nan

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.lab.extremes.base import Case, Flight
from condyn_pin.lab.extremes.verdict import Verdict
from condyn_pin.simulation.run import simulate


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
    status = run.status.name.lower()
    if not run.status.ok:
        return Verdict.SAID_SO, nan, status
    missed = pin.difference(case.scene.robot.model, flight.end, run.q[-1])
    error = float(np.abs(missed).max())
    return (Verdict.OK if error <= flight.within else Verdict.WRONG), error, status
