"""Every method on every extreme, and every contact solver on every hard contact problem.

    python benchmarks/stress.py solvers [--seeds 2]
    python benchmarks/stress.py contact [--seeds 1]

Lines of other versions of Pinocchio are kept: run it once with each. 1 if there is a defect.
"""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from functools import partial
from time import monotonic
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import script
from script import Table

from condyn_pin._core._pin import VERSION_TEXT
from condyn_pin._core.timing import machine
from lab import CONTACT_EXTREMES
from lab.extremes.base import EXTREMES
from lab.extremes.report import (
    Map,
    counts,
    maps,
    maps_of_csv,
    read_csv,
    save_maps,
    save_overview,
    write_csv,
)
from lab.extremes.stress import stress, tasks
from lab.extremes.verdicts import Outcome, Verdict

DRAWN = ("", "cassie")  # of the robots, in the picture


def run(given: Namespace, *, families: Sequence[str], subject: str) -> dict[str, Any]:
    """Run all cases; return the summaries of all versions of Pinocchio."""
    start, command = monotonic(), f"stress {subject}"
    outcomes = stress(tasks(tuple(families), seeds=given.seeds))
    for outcome in outcomes:
        if outcome.verdict.defect:
            print(outcome.verdict.name, outcome.method, outcome.task, outcome.said)
    print(f"{len(outcomes)} cases of {len(families)} families in {monotonic() - start:.0f} s")
    write_csv(maps(outcomes), script.result(command, ".csv"), VERSION_TEXT)
    runs = script.load(command) if script.result(command).exists() else {}
    return dict(sorted((runs | {VERSION_TEXT: summary(outcomes, given.seeds)}).items()))


def is_wrong(runs: Mapping[str, Any]) -> bool:
    """Whether the run on this Pinocchio had a defect."""
    found = runs.get(VERSION_TEXT, {"counts": {}})["counts"]
    return any(found.get(v.name.lower()) for v in Verdict if v.defect)


def summary(outcomes: Sequence[Outcome], seeds: int) -> dict[str, Any]:
    """Return the counts of a run, by method, and what it ran on."""
    methods = dict.fromkeys(outcome.method for outcome in outcomes)
    return {
        "cases": len(outcomes),
        "families": len({outcome.task.family for outcome in outcomes}),
        "seeds": seeds,
        "counts": counts(outcomes),
        "methods": {m: counts(o for o in outcomes if o.method == m) for m in methods},
        "machine": machine(),
    }


def essence(runs: Mapping[str, Any], subject: str) -> str:
    """Return how many cases there were, and how many defects."""
    total = sum(run["cases"] for run in runs.values())
    families = max(run["families"] for run in runs.values())
    defects = sum(
        run["counts"][v.name.lower()] for run in runs.values() for v in Verdict if v.defect
    )
    last = list(runs.values())[-1]
    source = script.source(f"stress {subject}", last["machine"], script.SHORT)
    return (
        f"{total} cases of {families} families on Pinocchio {' and '.join(runs)}: "
        f"**{defects} wrong, crashed or hung**.\n{source}; {last['seeds']} seeds."
    )


def table(runs: Mapping[str, Any], subject: str) -> str:
    """Return the whole table: a line a method, its verdicts on all versions of Pinocchio."""
    names = [verdict.name.lower() for verdict in Verdict]
    lines = [
        "| method | " + " | ".join(name.replace("_", " ") for name in names) + " |",
        "|---" * (len(names) + 1) + "|",
    ]
    for method in sorted({method for run in runs.values() for method in run["methods"]}):
        found = [run["methods"][method] for run in runs.values() if method in run["methods"]]
        numbers = [str(sum(each[name] for each in found)) for name in names]
        lines.append(f"| {method} | {' | '.join(numbers)} |")
    return "\n".join([essence(runs, subject), "", *lines])


def pictures(found: Sequence[Map]) -> dict[str, Sequence[Map]]:
    """Return which maps are in which picture, eight in each."""
    parts = [found[i : i + 8] for i in range(0, len(found), 8)]
    return {f"stress_solvers_{number}.png": part for number, part in enumerate(parts, start=1)}


def links(found: Sequence[Map]) -> str:
    """Return the links to the pictures, by the families that are in each."""
    parts = (
        f"[{', '.join(each.family for each in part)}](../benchmarks/results/{name})"
        for name, part in pictures(found).items()
    )
    return ";\n".join(parts) + "."


def drawn(version: str) -> list[Map]:
    """Return the maps of the committed results that are drawn."""
    rows = read_csv(script.result("stress solvers", ".csv"))
    return [each for each in maps_of_csv(rows, version) if each.robot in DRAWN]


def draw(version: str) -> None:
    """Draw the overview, and the maps of severity."""
    found, note = drawn(version), f"Pinocchio {version}; "
    save_overview(found, script.result("stress solvers", ".png"), note)
    for name, part in pictures(found).items():
        save_maps(part, script.RESULTS / name, note)


def _seeds(parser: ArgumentParser, default: int) -> None:
    parser.add_argument("--seeds", type=int, default=default)


SUBJECTS = [
    Table(
        "stress solvers",
        "every method on every extreme",
        partial(run, families=tuple(EXTREMES), subject="solvers"),
        partial(table, subject="solvers"),
        pages=lambda runs: {
            script.RESULTS_PAGE: {
                "stress": table(runs, "solvers"),
                "stress_maps": links(drawn(max(runs))),
            },
        },
        beside=lambda runs: draw(max(runs)),
        options=partial(_seeds, default=2),
        wrong=is_wrong,
    ),
    Table(
        "stress contact",
        "every contact solver on every hard contact problem",
        partial(run, families=tuple(CONTACT_EXTREMES), subject="contact"),
        partial(table, subject="contact"),
        pages=lambda runs: {script.RESULTS_PAGE: {"contact_stress": table(runs, "contact")}},
        options=partial(_seeds, default=1),
        wrong=is_wrong,
    ),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
