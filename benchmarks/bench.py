"""The full bench: time and error of every method on every main robot, and of what is compiled.

    python benchmarks/bench.py [--native [--alone]]

With --native what is compiled is timed beside: `make native`; with --alone only that is measured
again.
"""

from __future__ import annotations

import math
import os
import sys
from argparse import ArgumentParser, Namespace

os.environ.setdefault("OMP_NUM_THREADS", "1")

import script
from script import Table

from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.study.bench import BY_HAND, CPP, BenchRow, BenchTable, bench
from condyn_pin.study.plots import save_bench

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
    return "\n".join([*lines, "", f"{script.source('bench', table.machine)}.", meaning])


def essence(table: BenchTable) -> str:
    """Return the README's table: a row a scene, ours beside the fastest that is by hand."""
    lines = [
        "| scene | rows, rank | in a hot loop | over Pinocchio's call | best dense by hand | "
        "`solve`, verified |",
        "|---|---|---|---|---|---|",
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
            _cell(one),
            f"{one.to_bare:.2f}",
            _cell(fastest),
            f"{one.solve_us:.0f} us",
        )
        lines.append("| " + " | ".join(cells) + " |")
    meaning = (
        "Median time and worst error of a at 20 closed states. By hand: Pinocchio's terms, then "
        "LAPACK or Pinocchio's Cholesky, without guards or checks."
    )
    where = f"{script.source('bench', table.machine, script.SHORT)}."
    return "\n".join([*lines, "", where, meaning])


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
    on = "{processor}, {C++ compiler}, headers of {C++ headers}, {C++ date}"
    where = (
        f"{script.source('bench', table.machine, on)}, by `--native`. Median time per state of a "
        "batch of 20 closed states, without Python; x: times faster than the fastest dense method; "
        "worst error of a."
    )
    return "\n".join([*lines, "", where])


def _cell(row: BenchRow) -> str:
    quiet = row.status == BY_HAND or row.status.split()[1:] == ["ok"]
    said = "" if quiet else f", {row.status}"
    return f"{row.acceleration_us:.1f} us, {row.error:.0e}{said}"


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else ""


def measure(given: Namespace) -> BenchTable:
    """Measure everything, or what is compiled alone, whose rows say when they were made."""
    if not given.alone:
        return bench(native=given.native)
    table = BenchTable.from_json(script.result("bench"))
    again = bench(solvers=[Proximal()], native=True)
    said = {name: text for name, text in again.machine.items() if name.startswith(CPP)}
    known = {name: text for name, text in table.machine.items() if not name.startswith("native")}
    rows = table.of_origin("python").rows + again.of_origin(CPP).rows
    return BenchTable(rows, known | said | {"C++ date": again.machine["date"]})


def pages(table: BenchTable) -> script.Pages:
    """Return the blocks of README and docs."""
    return {
        script.README: {"bench": essence(table)},
        script.RESULTS_PAGE: {"bench": markdown(table), "compiled": in_cpp(table)},
    }


def _native(parser: ArgumentParser) -> None:
    parser.add_argument("--native", action="store_true", help="time C++ beside: `make native`")
    parser.add_argument("--alone", action="store_true", help="C++ alone; the other rows stay")


SUBJECTS = [
    Table(
        "bench",
        "time and error of every method",
        measure,
        markdown,
        pages=pages,
        beside=lambda table: save_bench(table, script.result("bench", ".png")),
        options=_native,
        read=BenchTable.from_json,
    )
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
