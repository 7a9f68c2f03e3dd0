"""Steps with contacts by the compiled core beside Python, and beside `mujoco.rollout`.

    python benchmarks/native_contact.py [--quick]

Writes benchmarks/results/native_contact.json and docs/how-to-run-at-scale.md; with --from-json the
table is made from the committed results, without running anything.

Solo12 stands on four points under the torques that hold it, or slides on them: eight motions of
0.2 s in steps of 1 ms, all engines in turns, in one process and one thread, by processor time. A
figure is the median over the rounds. What a foot does beside it is measured by Pinocchio, in every
step: how deep it goes, and of who stands how far it is carried.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import contact_step
import marks
import numpy as np
import script
from native_core import turns, where

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled

JSON = marks.ROOT / "benchmarks" / "results" / "native_contact.json"
PAGE = "docs/how-to-run-at-scale.md"
MOTIONS, DURATION, DT = 8, 0.2, contact_step.DT  # [s]


@dataclass(frozen=True)
class Row:
    """A way to step.

    Attributes
    ----------
    motion, engine : str
    rate : float
        Steps a second of processor time [1/s].
    deepest : float
        Of all feet, in every step [m].
    carried : float
        How far a foot is moved that has to stand, at most [m]; NaN where feet slide.
    """

    motion: str
    engine: str
    rate: float
    deepest: float
    carried: float


@dataclass(frozen=True)
class Start:
    """Where motions begin: a scene, its states, and the torques applied."""

    scene: cp.Scene
    Q: Array
    V: Array
    tau: Array
    stands: bool


def start(speed: float, friction: float) -> Start:
    """Return Solo12 on its feet, pushed aside with some speed [m/s], each motion a little apart."""
    solo = contact_step.Scene("solo12", "4 points", push=0.0, friction=friction, settled=10)
    q, _, tau = solo.states[0]
    Q, V = np.tile(q, (MOTIONS, 1)), np.zeros((MOTIONS, solo.scene.robot.nv))
    V[:, 0] = speed + np.linspace(0.0, 0.01, MOTIONS)
    if not speed:  # feet that touch are at rest
        V[:] = 0.0
    return Start(solo.scene, Q, V, tau, speed == 0.0)


def ours(begin: Start, executor: Any, record: int | None = None) -> cp.simulation.BatchTrajectory:
    """Return the motions by this library."""
    found = cp.simulate_batch(
        begin.scene, begin.Q, begin.V, begin.tau, duration=DURATION, dt=DT, record=record,
        executor=executor,
    )  # fmt: skip
    assert found.ok, found.counts
    return found


class Rollout:
    """The same motions by `mujoco.rollout`."""

    def __init__(self, begin: Start) -> None:
        import mujoco
        from mujoco.rollout import Rollout as Pool

        self.model, self.bridge = contact_step.mujoco_twin(begin.scene)
        self._data, self._pool = mujoco.MjData(self.model), Pool(nthread=0)
        self._physics = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._applied = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
        self._steps, self._begin = round(DURATION / DT), begin
        starts, torque = [], self.bridge.torque_to_mujoco(begin.Q[0], begin.tau)
        for q, v in zip(begin.Q, begin.V, strict=True):
            self._data.qpos[:], self._data.qvel[:] = self.bridge.to_mujoco(q, v)
            state = np.zeros(mujoco.mj_stateSize(self.model, self._physics))
            mujoco.mj_getState(self.model, self._data, state, self._physics)
            starts.append(state)
        self._starts = np.array(starts)
        self._torques = np.tile(torque, (MOTIONS, self._steps, 1))

    def __call__(self) -> Array:
        """Return the states of all motions in every step."""
        states, _ = self._pool.rollout(
            self.model, [self._data], self._starts, self._torques, nstep=self._steps,
            control_spec=self._applied,
        )  # fmt: skip
        return np.asarray(states)

    def configurations(self) -> Array:
        """Return q of all motions in every step, as Pinocchio has it (motions, steps, nq)."""
        import mujoco

        states = self()
        Q = np.zeros((*states.shape[:2], self._begin.scene.robot.nq))
        for at in np.ndindex(*states.shape[:2]):
            mujoco.mj_setState(self.model, self._data, states[at], self._physics)
            Q[at] = self.bridge.from_mujoco(self._data.qpos, self._data.qvel)[0]
        return Q


def feet(begin: Start, Q: Array) -> tuple[float, float]:
    """Return how deep feet go, and how far they are carried (nan if they slide)."""
    model = begin.scene.robot.model
    data = model.createData()
    frames = [model.getFrameId(contact.frame) for contact in begin.scene.contacts]

    def places(q: Array) -> Array:
        pin.framesForwardKinematics(model, data, q)
        return np.array([data.oMf[frame].translation for frame in frames])

    now = np.array([[places(q) for q in motion] for motion in Q])
    first = np.array([places(q) for q in begin.Q])
    deepest = max(0.0, -float(now[..., 2].min()))
    carried = float(np.abs(now - first[:, None])[..., :2].max()) if begin.stands else float("nan")
    return deepest, carried


def measure(rounds: int) -> dict[str, Any]:
    """Return everything."""
    rows = []
    for motion, speed, friction in (("stands", 0.0, 0.7), ("slides", 1.0, 0.3)):
        begin = start(speed, friction)
        core = cp.Native(threads=1)
        calls: dict[str, Callable[[], Any]] = {
            "Python": partial(ours, begin, None),
            "core": partial(ours, begin, core),
        }
        feet_of = {
            "Python": lambda b=begin: feet(b, ours(b, None, 1).samples.q),
            "core": lambda b=begin, c=core: feet(b, ours(b, c, 1).samples.q),
        }
        if importlib.util.find_spec("mujoco"):
            theirs = Rollout(begin)
            calls["mujoco.rollout"] = theirs
            feet_of["mujoco.rollout"] = lambda b=begin, r=theirs: feet(b, r.configurations())
        times = turns(calls, rounds)
        steps = MOTIONS * DURATION / DT
        rows += [
            asdict(Row(motion, engine, steps / times[engine], *feet_of[engine]()))
            for engine in calls
        ]
    return {"rows": rows, "core": {"headers": compiled().pinocchio, "simd": compiled().simd}}


def table(saved: dict[str, Any]) -> str:
    """Return the table."""
    rows = [Row(**each) for each in saved["rows"]]
    rates = {(row.motion, row.engine): row.rate for row in rows}
    lines = [
        "| Solo12, 1 ms | by | steps a second a core | x Python | x mujoco | deepest [m] | "
        "carried [m] |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        python, theirs = (rates.get((row.motion, by)) for by in ("Python", "mujoco.rollout"))
        beside = f"{row.rate / theirs:.2f}" if theirs else ""
        carried = "" if np.isnan(row.carried) else f"{row.carried:.0e}"
        lines.append(
            f"| {row.motion} | {row.engine} | {row.rate:.0f} | {row.rate / (python or 1):.1f} | "
            f"{beside} | {row.deepest:.0e} | {carried} |"
        )
    return "\n".join([*lines, "", where(saved, "native_contact")])


def pages(saved: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Return the blocks of the page."""
    return {PAGE: {"core-contact": table(saved)}}


def main(words: Sequence[str] | None = None) -> None:
    """Run, write, and update the docs."""
    script.run(
        words, about=__doc__, quick="few rounds; nothing is written", path=JSON,
        measure=lambda given: measure(3 if given.quick else 15), table=table, pages=pages,
    )  # fmt: skip


if __name__ == "__main__":
    main()
