"""Simulated seconds a second of `simulate_batch` and of `mujoco.rollout` on Cassie, for `batch.py`.

The speed alone says nothing: a larger step is faster and worse. So each row has the largest gap of
its loops over all steps, and how far from the true motion it ends: the one of Runge-Kutta 4 with
a quarter of a millisecond, whose own error is its difference to that with half a millisecond.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import product
from math import inf
from time import perf_counter
from typing import Any

import numpy as np

import condyn_pin as cp
from condyn_pin._core._pin import pin

WORKERS = 2
MOTIONS, DURATION = 32, 1.0  # [s]
JUDGED = slice(None, None, 8)  # the motions that gaps and errors are taken from
FINE = (2.5e-4, 5e-4)  # [s]


@dataclass(frozen=True)
class Motions:
    """One way to simulate many motions of Cassie.

    Attributes
    ----------
    engine : str
    name : str
    dt : float
        [s]
    one, two : float
        Steps a second on one core, and on two [1/s].
    violation : float
        The largest [m].
    error : float
        The largest of the configuration at the end [m, rad].
    """

    engine: str
    name: str
    dt: float
    one: float
    two: float
    violation: float
    error: float

    @property
    def simulated(self) -> float:
        """Simulated seconds a second on two cores."""
        return self.two * self.dt


@dataclass(frozen=True)
class Way:
    """A way to simulate.

    Attributes
    ----------
    engine, name : str
    dt : float
        [s]
    one, two : callable
        () -> steps a second, on one core and on two [1/s].
    judge : callable
        () -> the largest gap [m], and where the judged motions end (k, nq).
    """

    engine: str
    name: str
    dt: float
    one: Callable[[], float]
    two: Callable[[], float]
    judge: Callable[[], tuple[float, np.ndarray]]


def moving(scene: cp.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return starts at the first posture, moving along the loops."""
    rng, (q, v) = np.random.default_rng(0), scene.state()
    some = [
        cp.mechanism.project_velocity(scene, q, 0.3 * rng.normal(size=len(v)))
        for _ in range(MOTIONS)
    ]
    return np.tile(q, (MOTIONS, 1)), np.array(some)


def ours(scene: cp.Scene, integrator: Any, drift: Any, dt: float, pool: Any) -> float:
    """Return steps a second of `simulate_batch`."""
    found = cp.simulate_batch(
        scene, *moving(scene), duration=DURATION, dt=dt, integrator=integrator, drift=drift,
        executor=pool,
    )  # fmt: skip
    assert found.ok, found.counts
    return MOTIONS * found.steps / found.seconds


def judge_ours(scene: cp.Scene, integrator: Any, drift: Any, dt: float) -> tuple[float, np.ndarray]:
    """Return the largest gap and the ends, every step looked at."""
    found = cp.simulate_batch(
        scene, *(each[JUDGED] for each in moving(scene)), duration=DURATION, dt=dt,
        integrator=integrator, drift=drift, record=1,
    )  # fmt: skip
    assert found.ok, found.counts
    return float(found.violation.max()), found.q


def rolled_out(
    scene: cp.Scene, setting: str, integrator: str, dt: float, threads: int
) -> tuple[Any, np.ndarray, float]:
    """Return MuJoCo's robot, its states (MOTIONS, steps, n), and what they took [s]."""
    import mujoco
    from mujoco.rollout import Rollout
    from mujoco_twin import Twin

    twin = Twin.of(scene.robot, setting, integrator, dt, conservative=False)
    starts = []
    for q, v in zip(*moving(scene), strict=True):
        twin.set(q, v)
        starts.append(twin.physics())
    datas = [mujoco.MjData(twin.model) for _ in range(threads)]
    with Rollout(nthread=threads if threads > 1 else 0) as rollout:
        begun = perf_counter()
        states, _ = rollout.rollout(twin.model, datas, np.array(starts), nstep=round(DURATION / dt))
        return twin, states, perf_counter() - begun


def theirs(scene: cp.Scene, setting: str, integrator: str, dt: float, threads: int) -> float:
    """Return steps a second of `mujoco.rollout`."""
    _, states, seconds = rolled_out(scene, setting, integrator, dt, threads)
    return states.shape[0] * states.shape[1] / seconds


def judge_theirs(
    scene: cp.Scene, setting: str, integrator: str, dt: float
) -> tuple[float, np.ndarray]:
    """Return the largest gap and the ends, every step looked at by Pinocchio."""
    import mujoco

    twin, states, _ = rolled_out(scene, setting, integrator, dt, 1)
    equations = cp.Workspace(scene).equations
    gap, ends = 0.0, []
    for motion in states[JUDGED]:
        for state in motion:
            mujoco.mj_setState(twin.model, twin.data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
            q, v = twin.state()
            gap = max(gap, equations.open_by(q, v)[0])
        ends.append(q)
    return gap, np.array(ends)


def workers(pool: Executor) -> list[tuple[str, Any, Any]]:
    """Return who does the work on one core and on two: Python, and the compiled core if built."""
    found: list[tuple[str, Any, Any]] = [("", None, pool)]
    if importlib.util.find_spec("condyn_pin_native"):
        found.append((", compiled", cp.Native(threads=1), cp.Native(threads=WORKERS)))
    return found


def ways(scene: cp.Scene, pool: Executor) -> list[Way]:
    """Return the ways to simulate: ours, and those of MuJoCo where it is installed."""
    found = []
    semi, middle = cp.SemiImplicitEuler(), cp.simulation.LinearlyImplicitMidpoint()
    for integrator, gain, steps in (
        (semi, 0.3, (1e-3, 2e-3, 4e-3, 8e-3)),
        (middle, 0.1, (5e-4, 1e-3, 2e-3, 5e-3, 6.25e-3)),
        (cp.simulation.ImplicitMidpoint(), 0.1, (4e-3,)),
    ):
        for dt, closed in product(steps, (False, True)):
            drift = (
                cp.simulation.PostStabilization() if closed else cp.Baumgarte.critical(gain / dt)
            )
            run = partial(ours, scene, integrator, drift, dt)
            judge = partial(judge_ours, scene, integrator, drift, dt)
            for by, one, two in workers(pool):
                name = f"{integrator.title}, {drift.title}{by}"
                found.append(
                    Way("condyn_pin", name, dt, partial(run, one), partial(run, two), judge)
                )
    if not importlib.util.find_spec("mujoco"):
        return found
    for integrator, setting, dt in (
        ("Euler", "default", 2e-3), ("Euler", "solref .005, solimp .9999", 2e-3),
        ("Euler", "default", 1e-3), ("Euler", "solref .002, solimp .9999", 1e-3),
        ("implicitfast", "solref .002, solimp .9999", 1e-3),
        ("Euler", "solref .0005, solimp .9999", 2.5e-4),
        ("Euler", "solref .0002, solimp .9999", 1e-4), ("RK4", "solref .005, solimp .9999", 1e-3),
    ):  # fmt: skip
        run = partial(theirs, scene, setting, integrator, dt)
        found.append(Way(
            "mujoco.rollout", f"{integrator}, {setting}", dt,
            partial(run, 1), partial(run, WORKERS),
            partial(judge_theirs, scene, setting, integrator, dt),
        ))  # fmt: skip
    return found


def apart(scene: cp.Scene, ends: np.ndarray, true: np.ndarray) -> float:
    """Return the largest difference of two configurations [m, rad]; of what is lost, infinity."""
    found = [
        np.abs(pin.difference(scene.robot.model, *pair)).max()
        for pair in zip(true, ends, strict=True)
    ]
    return float(np.max(found)) if np.isfinite(found).all() else inf


def motions(scene: cp.Scene, pool: Executor, rounds: int) -> tuple[list[Motions], float]:
    """Return every way, measured in turns, and the error of what they are judged by [m, rad]."""
    true, coarser = (
        judge_ours(scene, cp.RungeKutta4(), cp.simulation.PostStabilization(), dt)[1] for dt in FINE
    )
    tried = ways(scene, pool)
    judged = [way.judge() for way in tried]
    for way in tried:  # warm-up: processes, workspaces
        way.one(), way.two()
    rates = np.array([[(way.one(), way.two()) for way in tried] for _ in range(rounds)])
    rows = [
        Motions(way.engine, way.name, way.dt, float(one), float(two), gap, apart(scene, ends, true))
        for way, (one, two), (gap, ends) in zip(
            tried, np.median(rates, axis=0), judged, strict=True
        )
    ]
    return rows, apart(scene, coarser, true)


def answer(rows: list[Motions], theirs: Motions) -> Motions | None:
    """Return the fastest way of ours with no larger gap and no larger error."""
    as_good = [
        row
        for row in rows
        if row.engine == "condyn_pin"
        and row.violation <= theirs.violation
        and row.error <= theirs.error
    ]
    return max(as_good, key=lambda row: row.simulated, default=None)
