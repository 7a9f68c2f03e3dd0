"""Ladders: one machine, scene by scene smaller, with speed and price of each rung.

The same motions are put into every rung (`condyn_pin.smaller.same_motion`), and what is watched is
compared with the first rung (`condyn_pin.smaller.price`). A ladder is data: `condyn_pin/ladders/`
has one file each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np

from condyn_pin import _pin
from condyn_pin.arrays import Array
from condyn_pin.errors import UnsupportedConstraint, unknown_name
from condyn_pin.machine import machine
from condyn_pin.scene import Scene
from condyn_pin.smaller.ladder_table import LadderRow, LadderTable
from condyn_pin.smaller.price import answers, compare
from condyn_pin.smaller.same_motion import same_motion, standing_torque
from condyn_pin.smaller.smaller_robot import free_flyers
from condyn_pin.smaller.smaller_tree import indices
from condyn_pin.solvers.base import Solver
from condyn_pin.solvers.dense_kkt import DenseKKT
from condyn_pin.solvers.lcaba import LCABA
from condyn_pin.solvers.proximal import Proximal
from condyn_pin.timing import Call, State, Times, interleaved
from condyn_pin.workspace import Workspace

# Torque of each motor beside what standing takes, as a share of the weight at one metre.
_PUSH = 0.02


@dataclass(frozen=True)
class Rung:
    """One step down.

    Parameters
    ----------
    label : str
        A few words.
    why : str
        What is left out, and what that presumes, in a sentence.
    make : callable
        From the scene of the rung above to this one.
    """

    label: str
    why: str
    make: Callable[[Scene], Scene]


@dataclass(frozen=True)
class Ladder:
    """A machine, scene by scene smaller.

    Parameters
    ----------
    name : str
    top : callable
        Returns the scene of the first rung.
    label : str
        Of the first rung.
    rungs : tuple of Rung
    sampled : str
        Label of the rung that random states are drawn in: the smallest whose geometry is exact.
    """

    name: str
    top: Callable[[], Scene]
    label: str
    rungs: tuple[Rung, ...]
    sampled: str

    def scenes(self) -> dict[str, Scene]:
        """Return the scene of every rung, by label, the first one first."""
        made = {self.label: self.top()}
        for rung in self.rungs:
            made[rung.label] = rung.make(list(made.values())[-1])
        return made


@dataclass(frozen=True)
class LadderEffort:
    """How long to look.

    Parameters
    ----------
    states : int
        Random motions.
    rounds, repeats : int
        As in `condyn_pin.timing.interleaved`.
    """

    states: int = 20
    rounds: int = 600
    repeats: int = 10


FULL = LadderEffort()
QUICK = LadderEffort(states=3, rounds=20, repeats=5)


def ladder(name: str, *, effort: LadderEffort = FULL) -> LadderTable:
    """Climb down a ladder: nv, rows, time and error of every rung.

    Parameters
    ----------
    name : str
        One of `condyn_pin.LADDERS`.
    effort : LadderEffort

    Returns
    -------
    LadderTable

    Raises
    ------
    UnknownName
        If there is no such ladder.
    """
    from condyn_pin.ladders import LADDERS

    if name not in LADDERS:
        raise unknown_name("ladder", name, LADDERS)
    return climb(LADDERS[name], effort=effort)


def climb(chosen: Ladder, *, effort: LadderEffort = FULL) -> LadderTable:
    """Measure every rung of a ladder: errors on the same motions, times in one interleaved run."""
    scenes = chosen.scenes()
    source, smallest = scenes[chosen.sampled], list(scenes.values())[-1]
    watched = (*free_flyers(smallest.robot), *smallest.robot.actuated)
    rng = np.random.default_rng(0)
    motions = [_standing(source, rng) for _ in range(effort.states)]
    states = {
        label: [same_motion(source, scene, motion, watched) for motion in motions]
        for label, scene in scenes.items()
    }
    found = {label: answers(scenes[label], states[label], watched) for label in scenes}
    times = _fastest(scenes, states, effort)
    first = next(iter(scenes))
    reasons = {chosen.label: "the whole machine"} | {r.label: r.why for r in chosen.rungs}
    rows = []
    above = first
    for label, scene in scenes.items():
        errors = compare(scenes[first], found[first], found[label])
        step = compare(scenes[first], found[above], found[label])
        above = label
        solver, spent = times[label]
        rows.append(
            LadderRow(
                label=label,
                why=reasons[label],
                nv=scene.robot.nv,
                rows=scene.rows,
                rank=scene.audit.rank,
                mobility=scene.audit.mobility,
                solver=solver,
                us=spent.median,
                speedup=times[first][1].ratio(spent),
                a_worst=errors.a_worst,
                a_median=errors.a_median,
                force_worst=errors.force_worst,
                force_median=errors.force_median,
                a_step=step.a_worst,
                force_step=step.force_worst,
            )
        )
    return LadderTable(chosen.name, tuple(rows), effort.states, machine())


def _standing(scene: Scene, rng: np.random.Generator) -> State:
    """Return a random motion, under the motor torques that carry the robot and random ones."""
    robot = scene.robot
    q, v = scene.sample(rng)
    _, motors = indices(robot.model, robot.actuated)
    tau = standing_torque(scene, q)
    tau[motors] += _PUSH * scene.audit.weight * rng.normal(size=len(motors))
    return q, v, tau


def _fastest(
    scenes: dict[str, Scene], states: dict[str, list[State]], effort: LadderEffort
) -> dict[str, tuple[str, Times]]:
    """Return the fastest solver of each rung that says ok at every state, and its times."""
    calls: dict[str, Call] = {}
    of: dict[str, tuple[str, str]] = {}
    for label, scene in scenes.items():
        for solver in _solvers():
            workspace = _willing(scene, solver, states[label])
            if workspace is not None:
                key = f"{label}: {solver.title}"
                calls[key], of[key] = _call(workspace, states[label]), (label, solver.title)
    nothing = (np.zeros(0),) * 3
    times = interleaved(calls, [nothing], rounds=effort.rounds, repeats=effort.repeats)
    best: dict[str, tuple[str, Times]] = {}
    for key, (label, title) in of.items():
        if label not in best or times[key].median < best[label][1].median:
            best[label] = (title, times[key])
    none = Times((math.nan,))
    return {label: best.get(label, ("none says ok", none)) for label in scenes}


def _solvers() -> tuple[Solver, ...]:
    lcaba: tuple[Solver, ...] = (LCABA(),) if _pin.HAS_LCABA else ()
    return (*lcaba, Proximal(), DenseKKT())


def _willing(scene: Scene, solver: Solver, states: Sequence[State]) -> Workspace | None:
    """Return a workspace if the solver takes the scene and says ok at every state."""
    try:
        workspace = Workspace(scene, solver)
    except UnsupportedConstraint:
        return None
    ok = all(workspace.solve(*state, throw=False).status.ok for state in states)
    return workspace if ok else None


def _call(workspace: Workspace, states: Sequence[State]) -> Call:
    """Return a call that takes its own next state each time: rungs do not share theirs."""
    turn = cycle(states)

    def call(q: Array, v: Array, tau: Array) -> Array:
        return workspace.acceleration(*next(turn))

    return call
