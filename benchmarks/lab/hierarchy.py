"""Model hierarchies: one machine, scene by scene smaller, with speed and price of each model.

The same motions are put into every model (`lab.same_motion`), and what is watched is compared with
the first model (`condyn_pin.mechanism.minimal_scene`). A hierarchy is data: to add one is to add a
`ModelHierarchy` at the end of this file and to `HIERARCHIES`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import isfinite, log10
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.models import indices
from condyn_pin._core.timing import State, Times
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.dense_kkt import DenseKKT
from condyn_pin.dynamics.solvers.lcaba import LCABA
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.errors import unknown_name
from condyn_pin.io.load import load_robot
from condyn_pin.mechanism.minimal_scene import answers, compare, time_trials, trial
from condyn_pin.mechanism.reduction import keep, reduced_scene
from condyn_pin.mechanism.suggestions import merge_points, rods_as_distances, without_linkage
from condyn_pin.model.smaller import free_flyers
from condyn_pin.study.tables import Columns, Measurements, Record, markdown
from lab.same_motion import loaded, same_motion, standing_torque

if TYPE_CHECKING:
    from rich.console import Console


_FLOOR: Final = 1e-6  # where exact models are drawn


@dataclass(frozen=True)
class HierarchyRow(Record):
    """One model; NaN where no solver said ok at every state.

    Attributes
    ----------
    label, why : str
    nv, rows, rank, mobility : int
    solver : str
        The fastest that says ok at every state.
    us : float
        `Workspace.acceleration` with it, median [us].
    speedup : float
        Times faster than the first model, median of ratios within a round.
    a_worst, a_median : float
        Error of the accelerations of floating base and motors against the first model, relative to
        the larger of |a| and gravity.
    force_worst, force_median : float
        Error of the wrench of all contacts, relative to the larger of it and the weight.
    a_step, force_step : float
        The worst errors against the model above: the price of this step alone.
    slower_as : str
        Why it is slower than a model above, if the solver of that one cannot take it; empty if not.
    """

    label: str
    why: str
    nv: int
    rows: int
    rank: int
    mobility: int
    solver: str
    us: float
    speedup: float
    a_worst: float
    a_median: float
    force_worst: float
    force_median: float
    a_step: float
    force_step: float
    slower_as: str = ""


@dataclass(frozen=True)
class HierarchyTable(Measurements[HierarchyRow]):
    """The models of one hierarchy, the states that they were compared at, and the machine.

    Attributes
    ----------
    rows : tuple of HierarchyRow
        The first model, and those below it.
    machine : dict of str to str
    name : str
        Of the hierarchy.
    states : int
        How many motions they were compared at.
    """

    kind: ClassVar[type[HierarchyRow]] = HierarchyRow
    parts: ClassVar[tuple[str, ...]] = ("name", "states", "machine")
    columns: ClassVar[Columns[HierarchyRow]] = (
        ("model", lambda row: row.label),
        ("nv", lambda row: str(row.nv)),
        ("rows", lambda row: f"{row.rows}, rank {row.rank}"),
        ("solver", lambda row: row.solver + (f"; {row.slower_as}" if row.slower_as else "")),
        ("a [us]", lambda row: f"{row.us:.1f}"),
        ("x faster", lambda row: f"{row.speedup:.2f}"),
        ("error of a: all / this step", lambda row: _share(row.a_worst, row.a_step)),
        (
            "of contact wrench: all / this step",
            lambda row: _share(row.force_worst, row.force_step),
        ),
    )

    name: str = ""
    states: int = 0

    def fastest(self, error: float) -> HierarchyRow:
        """Return the fastest model whose errors all stay below `error`."""
        good = [r for r in self.rows if max(r.a_worst, r.force_worst) <= error]
        return max(good, key=lambda row: row.speedup if isfinite(row.speedup) else 0.0)

    def to_markdown(self) -> str:
        """Return the rows as a table in Markdown, under the name of the hierarchy."""
        headings = [heading for heading, _ in self.columns]
        return markdown((self.name, *headings[1:]), self.cells())


def _share(*errors: float) -> str:
    return " / ".join(f"{100 * e:.2g} %" if e >= tolerances.EXACT else "0" for e in errors)


def print_hierarchy(table: HierarchyTable, console: Console) -> None:
    """Print what every model costs and saves, and why it is there."""
    from condyn_pin.study.table import print_columns

    print_columns(table, console, left=[heading for heading, _ in table.columns])
    for row in table.rows:
        console.print(f"{row.label}: {row.why}", soft_wrap=True)
    console.print(
        f"worst of {table.states} motions on both feet, against the first model / the model above",
        soft_wrap=True,
    )


def draw_hierarchy(table: HierarchyTable, ax: Any = None) -> Any:
    """Draw the worst error of a against the speed of every model: down and to the right is better.

    On `ax` or new axes, which are returned.
    """
    from condyn_pin._core.show import METHODS, OTHER, axes, labelled_axes

    ax = axes(ax)
    rows = [row for row in table.rows if isfinite(row.speedup)]
    points = [(row.speedup, max(row.a_worst, _FLOOR)) for row in rows]
    end = 1.15 * max(speed for speed, _ in points)
    ax.plot(*zip(*points, strict=True), color="0.8", lw=0.8, zorder=0)
    drawn: set[str] = set()
    upwards = sorted(points, key=lambda point: (round(log10(point[1]), 1), point[0]))
    for row, point in zip(rows, points, strict=True):
        colour, marker = METHODS.get(row.solver, OTHER)
        label = "" if row.solver in drawn else row.solver
        drawn.add(row.solver)
        ax.plot(*point, marker, color=colour, ms=7, label=label)
        # below and above in turn, and towards the middle: neighbours do not overlap
        above, left = upwards.index(point) % 2 == 1, point[0] > end / 2
        ax.annotate(
            f"{row.label}\nnv {row.nv}, {row.rows} rows", point, textcoords="offset points",
            xytext=(-8 if left else 8, 5 if above else -5), fontsize=7,
            ha="right" if left else "left", va="bottom" if above else "top",
        )  # fmt: skip
    ax.set(xlim=(0.0, end), yscale="log", ylim=(_FLOOR / 10, 10.0))
    error = "worst error of a, 0 drawn at 1e-6"
    return labelled_axes(ax, title=table.name, x="times faster than the first model", y=error)


def save_hierarchies(tables: Sequence[HierarchyTable], path: str | Path) -> None:
    """Draw hierarchies side by side into a file; the ending of `path` says which format."""
    from condyn_pin.study.plots import save_panels

    draw = [partial(draw_hierarchy, table) for table in tables]
    note, machine = "{processor}, Pinocchio {pinocchio}", tables[0].machine
    save_panels(draw, path, size=(4.8, 4.0), columns=len(draw), note=note, machine=machine)


# Measured

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
        As in `condyn_pin._core.threads.interleaved`.
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
        One of `HIERARCHIES`.
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
    if name not in HIERARCHIES:
        raise unknown_name("ladder", name, HIERARCHIES)
    return climb(HIERARCHIES[name], effort=effort)


def climb(chosen: ModelHierarchy, *, effort: HierarchyEffort) -> HierarchyTable:
    """Measure every model of a ladder: errors on the same motions, times in one interleaved run."""
    scenes = chosen.scenes()
    source, smallest = scenes[chosen.sampled], list(scenes.values())[-1]
    watched = (*free_flyers(smallest.robot), *smallest.robot.motor_joints)
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
    _, motors = indices(robot.model, robot.motor_joints)
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


# Cassie on both feet: feet driven directly, springs locked, rods as distances, then a gear.


_SIDES = ("left", "right")


def _whole() -> Scene:
    cassie = load_robot("cassie")
    return Scene(cassie, [*cassie.loops, *cassie.contacts])


def _feet_driven_directly(scene: Scene) -> Scene:
    links = ("tarsus-crank-joint", "crank-rod-joint")
    return without_linkage(
        scene,
        [f"{side}-plantar-foot-joint" for side in _SIDES],
        [f"{side}-{link}" for side in _SIDES for link in links],
    )


def _springs_locked(scene: Scene) -> Scene:
    """Lock the springs where they carry the robot while it stands."""
    return scene.lock([spring.joint for spring in scene.robot.springs], loaded(scene))


def _rods_as_distances(scene: Scene) -> Scene:
    """Replace the rods, and the points of the feet by edges: independent rows."""
    edges = merge_points(scene)
    return rods_as_distances(edges, [f"{side}-pitch-rod-joint" for side in _SIDES])


def _geared(scene: Scene) -> Scene:
    """Replace each distance by the proportion of knee and tarsus that it gives while standing."""
    q, v = scene.state()
    equations = Equations(scene.robot.model, scene.bounds)
    J = equations.terms(q, v).J
    constraints = {c.name: c for c in scene.constraints}
    for bound in scene.bounds:
        if bound.name.endswith("-achilles-spring-joint"):
            side = bound.name.split("-")[0]
            names = (f"{side}-shin-tarsus-joint", f"{side}-knee-op")
            (q_tarsus, q_knee), (tarsus, knee) = indices(scene.robot.model, names)
            row = J[bound.rows][0]
            ratio = -row[knee] / row[tarsus]
            offset = q[q_tarsus] - ratio * q[q_knee]
            constraints[bound.name] = Coupling(*names, ratio, offset, name=bound.name)
    words = "linkages of knee and tarsus: the proportion that they have at the nominal state"
    return reduced_scene(scene, scene.robot, list(constraints.values()), q, (words,))


CASSIE = ModelHierarchy(
    name="cassie",
    top=_whole,
    label="springs free",
    models=(
        HierarchyModel(
            "feet driven directly",
            "cranks and plantar rods are reflected inertia, and their loops dropped",
            _feet_driven_directly,
        ),
        HierarchyModel(
            "springs locked",
            "at what they are bent by standing; compared where free springs carry their load",
            _springs_locked,
        ),
        HierarchyModel(
            "achilles rods as distances",
            "their mass is shared by their ends; two points a foot are one edge",
            _rods_as_distances,
        ),
        HierarchyModel(
            "knee and tarsus geared",
            "the proportion of the linkage while standing, in place of the linkage",
            _geared,
        ),
    ),
    sampled="achilles rods as distances",
)


# Talos on both feet: eight corners, two surfaces, no arms, nothing but legs.


def _corners() -> Scene:
    talos = load_robot("talos")
    return Scene(talos, [corner for foot in talos.contacts for corner in foot.by_points(talos)[1]])


def _surfaces(scene: Scene) -> Scene:
    return Scene(scene.robot, scene.robot.contacts)


def _without_arms(scene: Scene) -> Scene:
    limbs = ("arm_", "gripper_", "head_")
    return scene.lock([name for name in scene.robot.joints if name.startswith(limbs)])


def _legs(scene: Scene) -> Scene:
    return keep(scene, [name for name in scene.robot.joints if name.startswith("leg_")])


TALOS = ModelHierarchy(
    name="talos",
    top=_corners,
    label="eight corners",
    models=(
        HierarchyModel("two surfaces", "the same support in half the rows: exact", _surfaces),
        HierarchyModel(
            "arms and head locked",
            "exact if they do not move; here their motors only carry their weight",
            _without_arms,
        ),
        HierarchyModel("legs alone", "the torso is locked too", _legs),
    ),
    sampled="legs alone",
)

HIERARCHIES: dict[str, ModelHierarchy] = {one.name: one for one in (CASSIE, TALOS)}
