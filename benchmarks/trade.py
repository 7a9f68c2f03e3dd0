"""Measure the trade on every robot, write benchmarks/results/trade.*, docs.

    python benchmarks/trade.py [--from-results]
    python benchmarks/trade.py [--quick] [--states 1000] [robot ...]    # printed, nothing written

runs the study of all solvers with all parameters on the standard scenes, chooses the cheapest
solver of each scene to three errors, verifies the choices (`cheapest.py`), and writes from these
results the picture and the tables of docs/how-to-choose-a-solver.md. With --from-results only these
are made anew, without running anything.

Errors and choices are computed on all cores, and do not care what else the machine does; times are
taken in between, by this process alone. A run that is stopped goes on from demo/trade.jsonl when it
is started again, and takes the times again that were taken on a shared core. When every time was
taken on a core that nothing else used, the file is removed.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
import trade_text
from cheapest import RESULTS, catalogue, read, verify, write

import condyn_pin as cp
from condyn_pin.cli.output import progress_bar
from condyn_pin.study.plots import save_trade
from condyn_pin.study.printing import timed
from condyn_pin.study.tables import ALONE

ROOT = Path(__file__).resolve().parent.parent
SHOWN = ("talos contacts", "cassie loops", "cassie loops + contacts", "solo12 contacts",
         "stewart loops", "four_bar loops")  # fmt: skip
STATES = 1000


def study(
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
    print(f"{perf_counter() - start:.0f} s. {timed(table)}", flush=True)
    return table


def rewrite() -> None:
    """Make the picture and the page from the results."""
    table, found = cp.study.Table.from_json(RESULTS / "trade.json"), read()
    shown = [label for label in SHOWN if any(row.scene == label for row in table.rows)]
    picture = cp.study.Table(
        tuple(row for row in table.rows if row.scene in shown), table.machine, table.floors
    )
    save_trade(picture, RESULTS / "trade.png")
    marks.write(trade_text.pages(table, found, shown))


def run(arguments: argparse.Namespace) -> None:
    """Measure, choose and verify; write what was asked for."""
    scenes = catalogue(arguments.robots)
    if arguments.quick or arguments.robots:
        table = study(scenes, cp.study.TimingEffort(rounds=10 if arguments.quick else 50), None)
        print(trade_text.choices(verify(table, scenes, arguments.states)))
        return
    arguments.resume.parent.mkdir(exist_ok=True)
    table = study(scenes, cp.study.TimingEffort(alone=True), arguments.resume)
    table.to_json(RESULTS / "trade.json")
    table.to_csv(RESULTS / "trade.csv")
    write(verify(table, scenes, arguments.states), RESULTS / "cheapest.csv", table.machine)
    rewrite()
    if all(row.timed == ALONE for row in table.rows if row.median_us):
        arguments.resume.unlink()


def main() -> int:
    """Run, write, and update the docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*")
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    parser.add_argument("--states", type=int, default=STATES, help="to verify each choice at")
    parser.add_argument("--from-results", action="store_true", help="do not run, only rewrite")
    parser.add_argument("--resume", type=Path, default=ROOT / "demo" / "trade.jsonl")
    arguments = parser.parse_args()
    if arguments.from_results:
        rewrite()
        return 0
    try:
        run(arguments)
    except cp.errors.Interrupted as stop:
        print(f"stopped: {len(stop.table.rows)} rows are in {arguments.resume}", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
