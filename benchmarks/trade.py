"""Accuracy for speed: every solver with every parameter, the cheapest to an error, smaller models.

    python benchmarks/trade.py study [--quick] [--states 1000] [robot ...]
    python benchmarks/trade.py cheapest [--states 1000] [--table FILE]
    python benchmarks/trade.py ladder [--quick]

study: of all solvers with all parameters on the standard scenes; then `cheapest`. Of some robots
alone the choices are printed, and nothing is written. Errors and choices are computed on all cores,
and do not care what else the machine does; times are taken in between, by this process alone. A run
that is stopped goes on from demo/trade.jsonl when it is started again, and takes the times again
that were taken on a shared core. When every time was taken on a core that nothing else used, the
file is removed.

cheapest: the committed study is asked for the cheapest solver of every scene to three errors, and
each is verified at 1000 states. Exits with 1 if a solver that was chosen to meet an error does not
meet it at one of the states, which neither the study nor the choice has seen; or if a scene of the
catalogue is not in the study, or nothing in it meets an error.

ladder: smaller and smaller models of a robot, their speed and their price.
"""

from __future__ import annotations

import csv
import os
import sys
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from time import perf_counter
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import script
from script import Printed, Table

import condyn_pin as cp
from condyn_pin._core.work import map_chunks
from condyn_pin.cli.output import progress_bar
from condyn_pin.dynamics.scene import standard_scenes
from condyn_pin.study.fresh import FreshErrors
from condyn_pin.study.measures import MEASURES
from condyn_pin.study.plots import save_trade
from condyn_pin.study.states import SampledStates
from condyn_pin.study.table import timing_sentence
from condyn_pin.study.tables import ALONE, pareto_front
from lab.hierarchy import (
    FULL,
    HIERARCHIES,
    QUICK,
    HierarchyTable,
    model_hierarchy,
    save_hierarchies,
)

CHEAPEST = script.result("trade cheapest", ".csv")

# --- cheapest

LEVELS = (1e-3, 1e-6, 1e-9)
MEASURE = "acceleration"
SEED = 1000  # neither the study's nor that of `Table.cheapest`


@dataclass(frozen=True)
class Verdict:
    """The cheapest solver of a scene to an error, and what it gave where nobody had looked.

    Attributes
    ----------
    scene : str
    rows : int
    error : float
        What was asked for.
    solver : str
        With the parameters that are not as usual; empty if nothing meets the error.
    us : float
        Median time [us].
    study, fresh, expected : float
        Worst error in the study, at the fresh states of the choice, and expected over a
        hundred times as many.
    rejected : int
        Faster solvers that met the error in the study, and not at the fresh states.
    states : int
        Of the verification.
    worst : float
        Worst error there.
    holds : bool
    note : str
        Why nothing was chosen.
    """

    scene: str
    rows: int
    error: float
    solver: str = ""
    us: float = 0.0
    study: float = 0.0
    fresh: float = 0.0
    expected: float = 0.0
    rejected: int = 0
    states: int = 0
    worst: float = 0.0
    holds: bool = False
    note: str = ""


def verdicts(
    table: cp.study.Table,
    scenes: Mapping[str, cp.Scene],
    states: int,
    executor: Executor | None = None,
) -> Iterator[list[Verdict]]:
    """Yield what was chosen for a scene at every level, verified; scene by scene as they come."""
    known = table.of(measure=MEASURE)
    measured = {row.scene for row in known.rows}
    tasks = []
    for label, scene in scenes.items():
        if label in measured:
            rows = known.of(scene=label).rows
            tasks.append((replace(known, rows=rows, scenes={label: scene}), states))
        else:
            yield [Verdict(label, scene.rows, level, note="not in the study") for level in LEVELS]
    for _, found in map_chunks(verified, tasks, executor=executor):
        yield found


def verified(task: tuple[cp.study.Table, int]) -> list[Verdict]:
    """Choose for the one scene of a table at every level, and verify at some other states."""
    table, states = task
    ((label, scene),) = table.scenes.items()
    others = FreshErrors(scene, MEASURES[MEASURE](), SampledStates(states, SEED))
    return [verdict(table, label, level, others) for level in LEVELS]


def verdict(table: cp.study.Table, label: str, level: float, others: FreshErrors) -> Verdict:
    """Choose for one scene and level, and verify at other states."""
    rows = table.scenes[label].rows
    try:
        choice = table.cheapest(level, measure=MEASURE, scene=label)
    except cp.errors.NotReached as error:
        return Verdict(label, rows, level, note=str(error))
    there = others(choice.solver)
    return Verdict(
        scene=label,
        rows=rows,
        error=level,
        solver=choice.row.short,
        us=choice.row.median_us or 0.0,
        study=choice.row.error_worst,
        fresh=choice.fresh.error,
        expected=choice.fresh.expected,
        rejected=len(choice.rejected),
        states=there.states,
        worst=there.error,
        holds=there.error <= level,
    )


def catalogue(robots: Sequence[str] = ()) -> dict[str, cp.Scene]:
    """Return the standard scenes of every robot, or of some, that have constraints."""
    return {
        label: scene
        for name in robots or cp.io.available_robots()
        for label, scene in standard_scenes(cp.load_robot(name)).items()
        if scene.rows
    }


def verdicts_of_csv(path: Path = CHEAPEST) -> list[Verdict]:
    """Return the verdicts that were written."""
    kinds = {"str": str, "int": int, "float": float, "bool": "True".__eq__}
    with path.open(encoding="utf-8") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return [Verdict(**{f.name: kinds[str(f.type)](row[f.name]) for f in fields(Verdict)})
                for row in rows]  # fmt: skip


def verify(table: cp.study.Table, scenes: Mapping[str, cp.Scene], states: int) -> list[Verdict]:
    """Return all verdicts in the order of the scenes, and print each scene's as they come."""
    found: dict[str, list[Verdict]] = {}
    with cp.Processes() as executor:
        for some in verdicts(table, scenes, states, executor):
            found[some[0].scene] = some
            for one in some:
                print(said(one), flush=True)
    return [one for label in scenes for one in found[label]]


def said(one: Verdict) -> str:
    """Return a verdict in a line."""
    what = f"{one.solver}: {one.us:.1f} us, worst {one.worst:.1e}" if one.solver else one.note
    return f"{one.scene}, {one.error:g}: {what}{'' if one.holds else '  FAILS'}"


def cheapest(given: Namespace) -> int:
    """Choose, verify and write; 1 if a choice does not hold."""
    table = cp.study.Table.from_json(given.table)
    found = verify(table, catalogue(), given.states)
    script.write(given.csv, map(asdict, found), table.machine)
    return int(not all(one.holds for one in found))


# --- study

SHOWN = ("talos contacts", "cassie loops", "cassie loops + contacts", "solo12 contacts",
         "stewart loops", "four_bar loops")  # fmt: skip


def run_study(
    scenes: Mapping[str, cp.Scene], effort: cp.study.TimingEffort, resume: Path | None
) -> cp.study.Table:
    """Measure; errors in as many processes as there are cores, times here."""
    start = perf_counter()
    if resume and resume.exists():
        print(f"going on from {resume}; remove it to measure everything", flush=True)
    with cp.Processes() as executor, progress_bar() as progress:
        table = cp.Study(scenes, effort=effort).run(
            executor=executor, progress=progress, results=resume
        )
    print(f"{perf_counter() - start:.0f} s. {timing_sentence(table)}", flush=True)
    return table


def study(given: Namespace) -> int:
    """Measure, choose and verify; write what was asked for."""
    if given.from_json:
        rewrite()
        return 0
    scenes = catalogue(given.robots)
    try:
        if given.quick or given.robots:
            table = run_study(scenes, cp.study.TimingEffort(rounds=10 if given.quick else 50), None)
            print(choices(verify(table, scenes, given.states)))
            return 0
        given.resume.parent.mkdir(exist_ok=True)
        table = run_study(scenes, cp.study.TimingEffort(alone=True), given.resume)
    except cp.errors.Interrupted as stop:
        print(f"stopped: {len(stop.table.rows)} rows are in {given.resume}", file=sys.stderr)
        return 130
    script.write(script.result("trade study"), table)
    script.write(CHEAPEST, map(asdict, verify(table, scenes, given.states)), table.machine)
    rewrite()
    if all(row.timed == ALONE for row in table.rows if row.median_us):
        given.resume.unlink()
    return 0


def rewrite() -> None:
    """Make the picture and the page from the results."""
    table = cp.study.Table.from_json(script.result("trade study"))
    picture = cp.study.Table(
        tuple(row for row in table.rows if row.scene in SHOWN), table.machine, table.floors
    )
    save_trade(picture, script.result("trade study", ".png"))
    script.fill(pages(table, verdicts_of_csv()))


def pages(table: cp.study.Table, found: Sequence[Verdict]) -> script.Pages:
    """Return the blocks of the page of results."""
    return {
        script.RESULTS_PAGE: {
            "choices": f"{choices(found)}\n\n{where(table)}",
            "wins": wins(found),
            "methods": methods(table),
            "exact": exact(table, SHOWN),
            "failures": failures(table),
        },
    }


def choices(found: Sequence[Verdict]) -> str:
    """Return the cheapest solver of each scene, a column an error."""
    lines = ["| scene | " + " | ".join(f"error {level:g}" for level in LEVELS) + " |"]
    lines.append("|---" * (1 + len(LEVELS)) + "|")
    for scene in dict.fromkeys(one.scene for one in found):
        mine = {one.error: one for one in found if one.scene == scene}
        rows = next(iter(mine.values())).rows
        cells = [f"{scene} ({rows} rows)", *(_choice(mine[level]) for level in LEVELS)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _choice(one: Verdict) -> str:
    if not one.solver:
        return "none"
    return f"`{one.solver}` {one.us:.1f} us, {one.worst:.0e}" + ("" if one.holds else " (missed)")


def wins(found: Sequence[Verdict]) -> str:
    """Return how often each method is the cheapest, by error."""
    names = Counter(one.solver.split("(")[0] for one in found if one.solver)
    lines = ["| method | " + " | ".join(f"error {level:g}" for level in LEVELS) + " |"]
    lines.append("|---" * (1 + len(LEVELS)) + "|")
    for name, _ in names.most_common():
        mine = Counter(one.error for one in found if one.solver.split("(")[0] == name)
        lines.append(f"| `{name}` | " + " | ".join(str(mine[level]) for level in LEVELS) + " |")
    return "\n".join(lines)


def methods(table: cp.study.Table) -> str:
    """Return of every method how it does with its default parameters, over all scenes."""
    lines = [
        "| method, default parameters | scenes with every answer ok "
        "| times slower than the fastest "
        "that is ok: least, median, most | worst error |",
        "|---|---|---|---|",
    ]
    fastest = {
        scene: min(
            (r.us for r in table.rows if r.scene == scene and r.comparable and r.ok),
            default=None,
        )
        for scene in dict.fromkeys(row.scene for row in table.rows)
    }
    plain = [row for row in table.rows if row.short.endswith("()")]
    for name in dict.fromkeys(row.short for row in plain):
        rows = [row for row in plain if row.short == name]
        good = [row for row in rows if row.ok and row.comparable]
        times = sorted(row.us / (fastest[row.scene] or 1.0) for row in good)
        spread = f"{times[0]:.2f}, {times[len(times) // 2]:.2f}, {times[-1]:.2f}" if times else ""
        worst = f"{max(row.error_worst for row in good):.0e}" if good else ""
        lines.append(f"| `{name}` | {len(good)} of {len(rows)} | {spread} | {worst} |")
    return "\n".join(lines)


def exact(table: cp.study.Table, shown: Sequence[str]) -> str:
    """Return the front of some scenes: what each further digit costs."""
    lines = ["| scene | solver | time [us] | worst error |", "|---|---|---|---|"]
    for scene in shown:
        for row in pareto_front([r for r in table.rows if r.scene == scene]):
            time, error = row.us, row.error_worst
            lines.append(f"| {scene} | `{row.short}` | {time:.1f} | {error:.0e} |")
    return "\n".join(lines)


def failures(table: cp.study.Table) -> str:
    """Return which methods do not answer on which scenes, with their default parameters."""
    lines = ["| method | scene | statuses |", "|---|---|---|"]
    for row in table.rows:
        if row.short.endswith("()") and not row.answered:
            said = ", ".join(f"{n} {status}" for status, n in row.statuses.items())
            lines.append(f"| `{row.short}` | {row.scene} | {said} |")
    return "\n".join(lines)


def where(table: cp.study.Table) -> str:
    """Return what was measured how, and on what."""
    n, states = table.rows[0].n, table.rows[0].states
    loads = "" if "under" in states else (
        " All of these were in motion under random torques of the motors: at rest, or where the "
        "motors carry the weight, the error of an early stop may be a thousand times larger, and "
        "`tune` would choose otherwise."
    )  # fmt: skip
    return (
        f"{script.source('trade study', table.machine)}. Median time of "
        "`Workspace.acceleration`; worst error at 1000 states that neither the study "
        f"({n} states) nor the choice (200) had seen (`python benchmarks/trade.py cheapest`, "
        f"`{CHEAPEST.relative_to(script.ROOT)}`).{loads} {timing_sentence(table)}"
    )


# --- ladder

GOOD = 0.01  # the error that the docs name the fastest model for


def ladder(given: Namespace) -> list[script.Saved]:
    """Measure every hierarchy of models."""
    effort = QUICK if given.quick else FULL
    return [model_hierarchy(name, effort=effort).as_dict() for name in HIERARCHIES]


def tables_of(saved: Sequence[Mapping[str, Any]]) -> list[HierarchyTable]:
    """Return the tables of the hierarchies."""
    return [HierarchyTable.from_dict(each) for each in saved]


def ladder_table(saved: Sequence[Mapping[str, Any]]) -> str:
    """Return the fastest good model of every ladder, and all models."""
    tables = tables_of(saved)
    lines = []
    for table in tables:
        best = table.fastest(GOOD)
        lines += [
            f"The fastest model of {table.name} with every error below {GOOD:.0%} is "
            f"**{best.label}** (nv {best.nv}, {best.rows} rows, {best.solver}): "
            f"{best.speedup:.2f} times as fast, a off by {best.a_worst:.2g}.",
            "",
            table.to_markdown(),
            "",
        ]
    source = script.source("trade ladder", tables[0].machine)
    return "\n".join([*lines, f"{source}. Errors: worst of {tables[0].states} motions."])


def _study_options(parser: ArgumentParser) -> None:
    parser.add_argument("robots", nargs="*")
    parser.add_argument("--quick", action="store_true", help="fewer rounds; nothing is written")
    parser.add_argument("--states", type=int, default=1000, help="to verify each choice at")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    parser.add_argument("--resume", type=Path, default=script.ROOT / "demo" / "trade.jsonl")


def _cheapest_options(parser: ArgumentParser) -> None:
    parser.add_argument("--states", type=int, default=1000)
    parser.add_argument("--table", type=Path, default=script.result("trade study"))
    parser.add_argument("--csv", type=Path, default=CHEAPEST)


SUBJECTS = [
    Printed("trade study", "every solver with every parameter", study, _study_options),
    Printed("trade cheapest", "choices, verified at fresh states", cheapest, _cheapest_options),
    Table(
        "trade ladder",
        "smaller models, their speed and price",
        ladder,
        ladder_table,
        pages=lambda saved: {script.RESULTS_PAGE: {"ladder": ladder_table(saved)}},
        beside=lambda saved: save_hierarchies(
            tables_of(saved), script.result("trade ladder", ".png")
        ),
        quick="fewer states and rounds; nothing is written",
    ),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
