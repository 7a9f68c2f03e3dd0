"""Run the full bench, write benchmarks/results, docs/results.md and the table of the README.

    python benchmarks/results.py [--native] [--from-json]

With --native what is compiled is timed beside. With --from-json the tables are made from the
committed results, without running anything: with both, only what is compiled is measured again.
"""

from __future__ import annotations

import argparse
import math
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks

from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.study.bench import BY_HAND, CPP, BenchRow, BenchTable, bench
from condyn_pin.study.plots import save_bench

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"

# Rows of the bench in C++ that the README has, and Pinocchio's names of them.
_CALLS = {
    "Proximal": "constraintDynamics",
    "LCABA": "lcaba",
    "constrainedABA": "constrainedABA",
    "PV": "pv",
}


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
        "a: `Workspace.acceleration`, median. x dense: times faster than the fastest dense method, "
        "dense KKT or by hand. By hand: Pinocchio's terms and the solver that is named, without "
        "guards, condition number or checks. Error: worst of 20 closed states, in motion and at "
        "rest, with and without torques, against `Reference`, relative to the larger of abs(a) "
        "and gravity."
    )
    return "\n".join([*lines, "", _where(table), meaning])


def essence(table: BenchTable) -> str:
    """Return the README's table: a row a scene, ours beside the fastest that is by hand."""
    lines = [
        "| scene | rows, rank | `LCABA` | `Proximal`, default | over bare call | best dense by "
        "hand | x | `solve`, verified |",
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
        "terms, then LAPACK or Pinocchio's Cholesky, without guards or checks. x: its time over "
        "that of `Proximal`."
    )
    return "\n".join([*lines, "", _where(table), meaning, *_in_cpp(table)])


def _in_cpp(table: BenchTable) -> list[str]:
    """Return what is left of x without Python: against Eigen, where the C++ program ran."""
    spans = []
    for method, said in _CALLS.items():
        found = [r.to_dense for r in table.rows if r.origin == CPP and r.method == method]
        if found:
            spans.append(f"{min(found):.1f}-{max(found):.1f} for `{said}`")
    if not spans:
        return []
    return [
        f"In C++ (`condyn bench --native`, against Eigen's LDLT and LLT) x is {', '.join(spans)}."
    ]


def in_cpp(table: BenchTable) -> str:
    """Return what is compiled: a row a method, a column a scene that bodies are held in."""
    rows = [row for row in table.of_origin(CPP).rows if row.rows]
    held = {row.scene for row in rows if row.method == "constrainedABA"}
    scenes = [scene for scene in dict.fromkeys(row.scene for row in rows) if scene in held]
    found = {(row.method, row.scene): row for row in rows}
    lines = ["| in C++ | " + " | ".join(scenes) + " |", "|---|" + "---|" * len(scenes)]
    for method in dict.fromkeys(row.method for row in rows if row.scene in held):
        here = [found[method, scene] for scene in scenes if (method, scene) in found]
        cells = [f"{row.bare_us:.1f} us, x {row.to_dense:.2f}, {row.error:.0e}" for row in here]
        name = f"`{_CALLS[method]}`" if method in _CALLS else method
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    where = (
        "`python benchmarks/results.py --native --from-json` on {processor}, {C++ compiler}, "
        "headers of {C++ headers}, {C++ date}. Median time per state of a batch of 20 closed "
        "states, without Python; x: times faster than the fastest dense method; worst error of a."
    ).format(**table.machine)
    return "\n".join([*lines, "", where])


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
    return {
        marks.README: {"bench": essence(table)},
        marks.RESULTS: {"bench": markdown(table)},
        marks.SOLVERS: {"compiled": in_cpp(table)},
    }


def _with_cpp(table: BenchTable, again: BenchTable) -> BenchTable:
    """Return a table with the rows of another one for what is compiled, and when they were made."""
    said = {name: text for name, text in again.machine.items() if name.startswith(CPP)}
    known = {name: text for name, text in table.machine.items() if not name.startswith("native")}
    rows = table.of_origin("python").rows + again.of_origin(CPP).rows
    return BenchTable(rows, known | said | {"C++ date": again.machine["date"]})


def main() -> None:
    """Run, write, and update README and docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--native", action="store_true", help="time C++ beside: `make native`")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    arguments = parser.parse_args()
    RESULTS.mkdir(exist_ok=True)
    if arguments.from_json:
        table = BenchTable.from_json(RESULTS / "bench.json")
    if arguments.native and arguments.from_json:
        table = _with_cpp(table, bench(solvers=[Proximal()], native=True))
    elif not arguments.from_json:
        table = bench(native=arguments.native)
    if arguments.native or not arguments.from_json:
        table.to_json(RESULTS / "bench.json")
        table.to_csv(RESULTS / "bench.csv")
    save_bench(table, RESULTS / "bench.png")
    marks.write(pages(table))


if __name__ == "__main__":
    main()
