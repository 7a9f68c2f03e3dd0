"""Climb down every ladder, write benchmarks/results/ladder.{csv,json,png}, docs.

    python benchmarks/ladder.py [--quick]

With --from-json the tables are made from the committed results, without running anything.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks

from condyn_pin._core.files import parse_json, read_text
from condyn_pin.study.tables import write_csv
from lab.hierarchy import (
    FULL,
    HIERARCHIES,
    QUICK,
    HierarchyRow,
    HierarchyTable,
    model_hierarchy,
    save_hierarchies,
)

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
GOOD = 0.01  # the error that the docs name the fastest model for


def load(path: Path) -> list[HierarchyTable]:
    """Return the tables that `main` wrote."""
    return [HierarchyTable.from_dict(saved) for saved in parse_json(read_text(path))]


def markdown(tables: Sequence[HierarchyTable]) -> str:
    """Return the fastest good model of every ladder, and all models."""
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
    where = (
        "`python benchmarks/ladder.py` on {processor} ({cores} cores, one thread), "
        "{system}, Python {python}, Pinocchio {pinocchio}, {date}."
    ).format(**tables[0].machine)
    return "\n".join([*lines, f"{where} Errors: worst of {tables[0].states} motions."])


def pages(tables: Sequence[HierarchyTable]) -> dict[str, dict[str, str]]:
    """Return the block of docs/results.md."""
    return {marks.RESULTS: {"ladder": markdown(tables)}}


def main() -> None:
    """Run, write, and update the docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer states and rounds")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    arguments = parser.parse_args()
    if arguments.from_json:
        tables = load(RESULTS / "ladder.json")
    else:
        tables = [
            model_hierarchy(name, effort=QUICK if arguments.quick else FULL) for name in HIERARCHIES
        ]
        columns = ["hierarchy", *(field.name for field in fields(HierarchyRow))]
        rows = [{"hierarchy": table.name} | asdict(row) for table in tables for row in table.rows]
        write_csv(RESULTS / "ladder.csv", tables[0].machine, columns, rows)
        text = json.dumps([table.as_dict() for table in tables], indent=1)
        (RESULTS / "ladder.json").write_text(text + "\n", encoding="utf-8")
    save_hierarchies(tables, RESULTS / "ladder.png")
    marks.write(pages(tables))
    print(markdown(tables))


if __name__ == "__main__":
    main()
