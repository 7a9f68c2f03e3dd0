"""Run the full bench, write benchmarks/results, docs/results.md and the table of the README.

    python benchmarks/results.py [--native native.json]

With --from-json the table is made from the committed results, without running anything.
"""

from __future__ import annotations

import argparse
import math
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks

from condyn_pin.study.bench import BY_HAND, bench
from condyn_pin.study.bench_table import BenchRow, BenchTable
from condyn_pin.study.plots import save_bench

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"


def markdown(table: BenchTable) -> str:
    """Return the whole table, a row a method."""
    lines = [
        "| scene | method | a [us] | to bare call | x dense | error of a | status |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in table.rows:
        if row.origin == "python" and row.rows:
            cells = (
                f"{row.scene} ({row.rows} rows, rank {row.rank})",
                row.method,
                _number(row.acceleration_us, ".1f"),
                _number(row.to_bare, ".2f"),
                _number(row.to_dense, ".1f"),
                _number(row.error, ".0e"),
                row.status,
            )
            lines.append("| " + " | ".join(cells) + " |")
    meaning = (
        "a: `Workspace.acceleration`, median. x dense: times faster than the fastest of dense KKT "
        "and what is by hand. By hand: Pinocchio's terms and the solver that is named, without "
        "guard, condition or proof. Error: worst of 20 closed states, in motion and at rest, with "
        "and without torques, against `Reference`, relative to the larger of abs(a) and gravity."
    )
    return "\n".join([*lines, "", _where(table), meaning])


def essence(table: BenchTable) -> str:
    """Return the README's table: a row a scene, ours beside the fastest that is by hand."""
    lines = [
        "| scene | rows, rank | `LCABA` | `Proximal`, default | over bare call | best dense by "
        "hand | x | `solve`, proved |",
        "|---|---|---|---|---|---|---|---|",
    ]
    rows = [row for row in table.rows if row.origin == "python" and row.rows]
    for scene in dict.fromkeys(row.scene for row in rows):
        here = [row for row in rows if row.scene == scene]
        mine = {row.method: row for row in here}
        one = mine["Proximal"]
        by_hand = [row for row in here if row.status == BY_HAND]
        fastest = min(by_hand, key=lambda row: row.acceleration_us)
        cells = (
            scene,
            f"{one.rows}, {one.rank}",
            _cell(mine["LCABA"]),
            _cell(one),
            f"{one.to_bare:.2f}",
            f"{_cell(fastest)}, {fastest.method.split(',')[0]}",
            f"{fastest.acceleration_us / one.acceleration_us:.1f}",
            f"{one.solve_us:.0f} us",
        )
        lines.append("| " + " | ".join(cells) + " |")
    meaning = (
        "Median time of `Workspace.acceleration`, and the worst error of a at 20 closed states "
        "against `Reference`, relative to the larger of abs(a) and gravity. By hand: Pinocchio's "
        "terms, then LAPACK or Pinocchio's Cholesky, without guard or proof. x: its time over that "
        "of `Proximal`."
    )
    return "\n".join([*lines, "", _where(table), meaning, *_in_cpp(table)])


def _in_cpp(table: BenchTable) -> list[str]:
    """Return what is left of x without Python: against Eigen, where the C++ program ran."""
    spans = []
    for method in ("constraintDynamics", "lcaba"):
        found = [r.to_dense for r in table.rows if r.origin == "C++" and f"{method}," in r.method]
        if found:
            spans.append(f"{min(found):.1f} to {max(found):.1f} for `{method}`")
    if not spans:
        return []
    return [
        f"In C++ (`make native-bench`, against Eigen's block Cholesky) x is {' and '.join(spans)}: "
        "much of the gain is that `Proximal` is one call from Python."
    ]


def _cell(row: BenchRow) -> str:
    quiet = row.status == BY_HAND or row.status.split()[1:] == ["ok"]
    said = "" if quiet else f", {row.status}"
    return f"{row.acceleration_us:.1f} us, {row.error:.0e}{said}"


def _where(table: BenchTable) -> str:
    return (
        "`python benchmarks/results.py` on {processor} ({cores} cores, one thread), "
        "{system}, Python {python}, Pinocchio {pinocchio}, {date}."
    ).format(**table.machine)


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else ""


def pages(table: BenchTable) -> dict[str, dict[str, str]]:
    """Return the blocks of README and docs."""
    return {marks.README: {"bench": essence(table)}, marks.RESULTS: {"bench": markdown(table)}}


def main() -> None:
    """Run, write, and update README and docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--native", type=Path, help="merge this result of `make native-bench`")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    arguments = parser.parse_args()
    RESULTS.mkdir(exist_ok=True)
    if arguments.from_json:
        table = BenchTable.from_json(RESULTS / "bench.json")
    else:
        table = bench()
        if arguments.native:
            table = table.with_native(arguments.native)
        table.to_json(RESULTS / "bench.json")
        table.to_csv(RESULTS / "bench.csv")
    save_bench(table, RESULTS / "bench.png")
    marks.write(pages(table))


if __name__ == "__main__":
    main()
