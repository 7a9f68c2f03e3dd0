"""Ladders: one machine, scene by scene smaller, with speed and price of each model.

The same motions are put into every model (`condyn_pin.mechanism.reduction`), and what
is watched is compared with the first model (`condyn_pin.mechanism.minimal_scene`). A ladder is
data: `condyn_pin/lab/hierarchies/` has one file each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from condyn_pin._core.joints import indices
from condyn_pin._core.timing import State, Times
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.solvers.dense_kkt import DenseKKT
from condyn_pin.dynamics.solvers.lcaba import LCABA
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.errors import unknown_name
from condyn_pin.lab.hierarchy_table import HierarchyRow, HierarchyTable
from condyn_pin.mechanism.minimal_scene import answers, compare
from condyn_pin.mechanism.reduction import same_motion, standing_torque, time_trials, trial
from condyn_pin.model.smaller import free_flyers

# Torque of each motor beside what standing takes, as a share of the weight at one metre.
_PUSH = 0.02


@dataclass(frozen=True)
class HierarchyModel:
    """One model of a hierarchy, made from the one above it.

    Parameters
    ----------
    label : str
        A few words.
    why : str
        What is left out, and what that presumes, in a sentence.
    make : callable
        From the scene of the model above to this one.
    """

    label: str
    why: str
    make: Callable[[Scene], Scene]


@dataclass(frozen=True)
class ModelHierarchy:
    """A machine as a sequence of smaller and smaller scenes.

    Parameters
    ----------
    name : str
    top : callable
        Returns the scene of the first model.
    label : str
        Of the first model.
    models : tuple of HierarchyModel
    sampled : str
        Label of the model that random states are drawn in: the smallest whose geometry is exact.
    """

    name: str
    top: Callable[[], Scene]
    label: str
    models: tuple[HierarchyModel, ...]
    sampled: str

    def scenes(self) -> dict[str, Scene]:
        """Return the scene of every model, by label, the first one first."""
        made = {self.label: self.top()}
        for model in self.models:
            made[model.label] = model.make(list(made.values())[-1])
        return made


@dataclass(frozen=True)
class HierarchyEffort:
    """How long to measure.

    Parameters
    ----------
    states : int
        Random motions.
    rounds, repeats : int
        As in `condyn_pin._core.timing.interleaved`.
    """

    states: int = 20
    rounds: int = 600
    repeats: int = 10


FULL = HierarchyEffort()
QUICK = HierarchyEffort(states=3, rounds=20, repeats=5)


def model_hierarchy(name: str, *, effort: HierarchyEffort = FULL) -> HierarchyTable:
    """Measure the models of a hierarchy, from the largest down: nv, rows, time and error of each.

    Parameters
    ----------
    name : str
        One of `condyn_pin.lab.HIERARCHIES`.
    effort : HierarchyEffort

    Returns
    -------
    HierarchyTable

    Raises
    ------
    UnknownName
        If there is no such hierarchy.

    Notes
    -----
    Cost: some seconds, in which every model is solved at 20 motions and timed.
    """
    from condyn_pin.lab.hierarchies import HIERARCHIES

    if name not in HIERARCHIES:
        raise unknown_name("ladder", name, HIERARCHIES)
    return climb(HIERARCHIES[name], effort=effort)


def climb(chosen: ModelHierarchy, *, effort: HierarchyEffort) -> HierarchyTable:
    """Measure every model of a ladder: errors on the same motions, times in one interleaved run."""
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
    reasons = {chosen.label: "the whole machine"} | {r.label: r.why for r in chosen.models}
    rows: list[HierarchyRow] = []
    for (label, scene), above in zip(scenes.items(), [first, *scenes], strict=False):
        errors = compare(scenes[first], found[first], found[label])
        step = compare(scenes[first], found[above], found[label])
        best = times[label]
        rows.append(
            HierarchyRow(
                label=label,
                why=reasons[label],
                nv=scene.robot.nv,
                rows=scene.rows,
                rank=scene.nominal.rank,
                mobility=scene.nominal.mobility,
                solver=best.solver,
                us=best.times.median,
                speedup=times[first].times.ratio(best.times),
                **asdict(errors),
                a_step=step.a_worst,
                force_step=step.force_worst,
                slower_as=_why_slower(best, [times[row.label] for row in rows]),
            )
        )
    return HierarchyTable(tuple(rows), name=chosen.name, states=effort.states)


def _standing(scene: Scene, rng: np.random.Generator) -> State:
    """Return a random motion, under the motor torques that carry the robot and random ones."""
    robot = scene.robot
    q, v = scene.sample(rng)
    _, motors = indices(robot.model, robot.actuated)
    tau = standing_torque(scene, q)
    tau[motors] += _PUSH * scene.nominal.weight * rng.normal(size=len(motors))
    return q, v, tau


@dataclass(frozen=True)
class _Best:
    """The fastest solver of a model that says ok at every state."""

    solver: str
    times: Times
    refused: Mapping[str, str]  # what the solvers said that could not be timed


def _fastest(
    scenes: Mapping[str, Scene], states: Mapping[str, Sequence[State]], effort: HierarchyEffort
) -> dict[str, _Best]:
    """Return the fastest solver of each model, timed in one run with all the others."""
    trials = {
        (label, solver.title): trial(scene, solver, states[label])
        for label, scene in scenes.items()
        for solver in _solvers()
    }
    times = time_trials(trials, rounds=effort.rounds, repeats=effort.repeats)
    best = {}
    for label in scenes:
        own = {title: spent for (of, title), spent in times.items() if of == label}
        title = min(own, key=lambda name: own[name].median, default="none says ok")
        refused = {t: one.said for (of, t), one in trials.items() if of == label and not one.call}
        best[label] = _Best(title, own.get(title, Times((math.nan,))), refused)
    return best


def _solvers() -> tuple[Solver, ...]:
    return tuple(kind() for kind in (LCABA, Proximal, DenseKKT) if not kind.missing())


def _why_slower(model: _Best, above: Sequence[_Best]) -> str:
    """Return why a model is slower than one above, if that one's solver cannot take it."""
    timed = [best for best in above if math.isfinite(best.times.median)]
    fastest = min(timed, key=lambda best: best.times.median, default=model)
    if fastest.times.median >= model.times.median or fastest.solver not in model.refused:
        return ""
    return f"{fastest.solver} {model.refused[fastest.solver]}"
