"""Run the full bench, write benchmarks/results, and put its table into the README.

    python benchmarks/results.py [--native native.json]

With --from-json the table is made from the committed results, without running anything.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

from condyn_pin.bench import bench
from condyn_pin.bench_table import BenchRow, BenchTable
from condyn_pin.plots import save_bench

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
BEGIN, END = "<!-- bench:begin -->", "<!-- bench:end -->"


def load(path: Path) -> BenchTable:
    """Return the table that `to_json` wrote."""
    saved = json.loads(path.read_text(encoding="utf-8"))
    rows = tuple(
        BenchRow(**{key: math.nan if value is None else value for key, value in row.items()})
        for row in saved["rows"]
    )
    return BenchTable(rows, saved["machine"])


def markdown(table: BenchTable) -> str:
    """Return the README's table."""
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
    where = (
        "`python benchmarks/results.py` on {processor} ({cores} cores, one thread), "
        "{system}, Python {python}, Pinocchio {pinocchio}, {date}."
    ).format(**table.machine)
    meaning = (
        "a: `Workspace.acceleration`, median. x dense: times faster than dense KKT. Error: worst "
        "of 20 closed states against `Reference`, relative to the larger of abs(a) and gravity."
    )
    lines += ["", where, meaning]
    return "\n".join(lines)


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else ""


def with_table(readme: str, table: BenchTable) -> str:
    """Return the README with the table between its two marks."""
    head, rest = readme.split(BEGIN)
    return f"{head}{BEGIN}\n{markdown(table)}\n{END}{rest.split(END)[1]}"


def main() -> None:
    """Run, write, and update the README."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--native", type=Path, help="merge this result of `make native`")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    arguments = parser.parse_args()
    RESULTS.mkdir(exist_ok=True)
    if arguments.from_json:
        table = load(RESULTS / "bench.json")
    else:
        table = bench()
        if arguments.native:
            table = table.with_native(arguments.native)
        table.to_json(RESULTS / "bench.json")
        table.to_csv(RESULTS / "bench.csv")
    save_bench(table, RESULTS / "bench.png")
    readme = ROOT / "README.md"
    readme.write_text(with_table(readme.read_text(encoding="utf-8"), table), encoding="utf-8")


if __name__ == "__main__":
    main()
