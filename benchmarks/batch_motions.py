"""Steps a second of `simulate_batch` and of `mujoco.rollout` on Cassie, for `batch.py`."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

import condyn_pin as cp

WORKERS = 2
MOTIONS, DURATION = 32, 0.2  # [s]


@dataclass(frozen=True)
class Motions:
    """One way to simulate many motions of Cassie.

    Attributes
    ----------
    name : str
    dt : float
        [s]
    one, two : float
        Steps a second on one core, and on two [1/s].
    gap : float
        The largest [m].
    """

    name: str
    dt: float
    one: float
    two: float
    gap: float


def moving(scene: cp.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return starts at the first posture, moving along the loops."""
    rng, (q, v) = np.random.default_rng(0), scene.state()
    some = [scene.project_velocity(q, 0.3 * rng.normal(size=len(v))) for _ in range(MOTIONS)]
    return np.tile(q, (MOTIONS, 1)), np.array(some)


def ours(
    scene: cp.Scene, drift: Any, integrator: Any, dt: float, pool: Executor | None
) -> tuple[float, float]:
    """Return steps a second and the largest gap [m]."""
    found = cp.simulate_batch(
        scene, *moving(scene), duration=DURATION, dt=dt, integrator=integrator, drift=drift,
        executor=pool,
    )  # fmt: skip
    return MOTIONS * found.steps / found.seconds, float(np.max(found.violation))


def theirs(
    scene: cp.Scene, setting: str, integrator: str, dt: float, threads: int
) -> tuple[float, float]:
    """Return the same of `mujoco.rollout`."""
    import mujoco
    from mujoco.rollout import Rollout
    from mujoco_twin import Twin

    twin = Twin.of(scene.robot, setting, integrator, dt, conservative=False)
    starts = []
    for q, v in zip(*moving(scene), strict=True):
        twin.set(q, v)
        starts.append(twin.physics())
    datas, steps = [mujoco.MjData(twin.model) for _ in range(threads)], round(DURATION / dt)
    with Rollout(nthread=threads if threads > 1 else 0) as rollout:
        begun = perf_counter()
        states, _ = rollout.rollout(twin.model, datas, np.array(starts), nstep=steps)
        seconds = perf_counter() - begun
    gaps, equations = [], cp.Workspace(scene).equations
    for motion in states[::8]:
        for state in motion[:: steps // 50]:
            mujoco.mj_setState(twin.model, twin.data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
            gaps.append(equations.open_by(*twin.state())[0])
    return MOTIONS * steps / seconds, max(gaps)


def ways(scene: cp.Scene, pool: Executor) -> dict[tuple[str, float], list[Callable[[], Any]]]:
    """Return the ways to simulate, by name and dt: on one core, and on two."""
    found: dict[tuple[str, float], list[Callable[[], Any]]] = {}
    semi, rk4, dt = cp.SemiImplicitEuler(), cp.RungeKutta4(), 1e-3
    for integrator, drift in (
        (semi, cp.Baumgarte.critical(0.3 / dt)), (semi, cp.PostStabilization()),
        (rk4, cp.PostStabilization()),
    ):  # fmt: skip
        name = f"condyn_pin {integrator.title}, {drift.title}"
        found[name, dt] = [
            partial(ours, scene, drift, integrator, dt, each) for each in (None, pool)
        ]
    if not importlib.util.find_spec("mujoco"):
        return found
    for setting, integrator, dt in (
        ("default", "Euler", 1e-3), ("solref .002, solimp .9999", "Euler", 1e-3),
        ("solref .0005, solimp .9999", "Euler", 2.5e-4),
        ("solref .0002, solimp .9999", "Euler", 1e-4), ("solref .005, solimp .9999", "RK4", 1e-3),
    ):  # fmt: skip
        rates = [partial(theirs, scene, setting, integrator, dt, k) for k in (1, WORKERS)]
        found[f"mujoco.rollout {integrator}, {setting}", dt] = rates
    return found


def motions(scene: cp.Scene, pool: Executor, rounds: int) -> list[Motions]:
    """Measure every way, in turns."""
    tried = ways(scene, pool)
    for one, both in tried.values():  # warm-up: processes, workspaces
        one(), both()
    found: dict[Any, list[Any]] = {key: [] for key in tried}
    for _ in range(rounds):
        for key, (one, both) in tried.items():
            found[key].append((one(), both()))
    rows = []
    for (name, dt), pairs in found.items():
        one, two = np.median([[each[0] for each in pair] for pair in pairs], axis=0)
        rows.append(Motions(name, dt, float(one), float(two), pairs[-1][1][1]))
    return rows
