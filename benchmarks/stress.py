"""Put every method through every extreme; write results/stress*.{csv,json,png}, README, docs.

    python benchmarks/stress.py [--seeds 2]

Lines of other versions of Pinocchio are kept: run it once with each. With --from-json the README's
table is made from the committed results, without running anything.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import monotonic
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks

from condyn_pin._core._pin import VERSION_TEXT
from condyn_pin._core.timing import machine
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

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
DRAWN = ("", "cassie")  # of the robots, in the picture


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


def essence(runs: Mapping[str, Any]) -> str:
    """Return the README's sentence: how many cases, and how many defects."""
    total = sum(run["cases"] for run in runs.values())
    families = max(run["families"] for run in runs.values())
    defects = sum(
        run["counts"][v.name.lower()] for run in runs.values() for v in Verdict if v.defect
    )
    last = list(runs.values())[-1]
    where = "`make stress`, {seeds} seeds; {processor}, {system}, Python {python}, {date}."
    said = (
        f"{total} cases of {families} families on Pinocchio {' and '.join(runs)}: "
        f"**{defects} wrong, crashed or hung**."
    )
    return f"{said}\n{where.format(seeds=last['seeds'], **last['machine'])}"


def markdown(runs: Mapping[str, Any]) -> str:
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
    return "\n".join([essence(runs), "", *lines])


def pages(runs: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Return the blocks of README and docs."""
    return {
        marks.README: {"stress": essence(runs)},
        marks.RESULTS: {"stress": markdown(runs), "stress_maps": links(drawn(max(runs)))},
    }


def pictures(found: Sequence[Map]) -> dict[str, Sequence[Map]]:
    """Return which maps are in which picture, eight in each."""
    parts = [found[i : i + 8] for i in range(0, len(found), 8)]
    return {f"stress_{number}.png": part for number, part in enumerate(parts, start=1)}


def links(found: Sequence[Map]) -> str:
    """Return the links to the pictures, by the families that are in each."""
    parts = (
        f"[{', '.join(each.family for each in part)}](../benchmarks/results/{name})"
        for name, part in pictures(found).items()
    )
    return ";\n".join(parts) + "."


def drawn(version: str) -> list[Map]:
    """Return the maps of the committed results that are drawn."""
    rows = read_csv(RESULTS / "stress.csv")
    return [each for each in maps_of_csv(rows, version) if each.robot in DRAWN]


def draw(version: str) -> None:
    """Draw the overview, and the maps of severity."""
    found, note = drawn(version), f"Pinocchio {version}; "
    save_overview(found, RESULTS / "stress.png", note)
    for name, part in pictures(found).items():
        save_maps(part, RESULTS / name, note)


def load(path: Path) -> dict[str, Any]:
    """Return the runs that were committed, by version of Pinocchio."""
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def main() -> int:
    """Run, write, and update README and docs; 1 if there is a defect."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    arguments = parser.parse_args()
    bad = 0
    if not arguments.from_json:
        start = monotonic()
        outcomes = stress(tasks(seeds=arguments.seeds))
        for outcome in outcomes:
            if outcome.verdict.defect:
                print(outcome.verdict.name, outcome.method, outcome.task, outcome.said)
                bad = 1
        run = summary(outcomes, arguments.seeds)
        found = maps(outcomes)
        write_csv(found, RESULTS / "stress.csv", VERSION_TEXT)
        runs = dict(sorted((load(RESULTS / "stress.json") | {VERSION_TEXT: run}).items()))
        text = json.dumps(runs, indent=1)
        (RESULTS / "stress.json").write_text(text + "\n", encoding="utf-8")
        print(f"{len(outcomes)} cases of {len(EXTREMES)} families in {monotonic() - start:.0f} s")
    runs = load(RESULTS / "stress.json")
    draw(max(runs))
    marks.write(pages(runs))
    print(markdown(runs))
    return bad


if __name__ == "__main__":
    sys.exit(main())
