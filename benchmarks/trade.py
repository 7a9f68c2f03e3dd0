"""Measure the trade on every robot, write benchmarks/results/trade.*, README and docs.

    python benchmarks/trade.py [--quick] [robot ...]

runs the study of all solvers with all knobs on the standard scenes, chooses the cheapest solver of
each scene to three errors, verifies the choices (`cheapest.py`), and writes from these results the
picture, the README's table and the tables of docs/how-to-choose-a-solver.md. With --from-results
only the last three are made anew, without running anything. A run that is stopped goes on from
demo/trade.jsonl when it is started again.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import trade_text
from cheapest import RESULTS, catalogue, read, verdicts, write

import condyn_pin as cp
from condyn_pin.commands.output import progress_bar
from condyn_pin.plots_trade import save_trade

ROOT = Path(__file__).resolve().parent.parent
SHOWN = ("talos contacts", "cassie loops", "cassie loops + contacts", "solo12 contacts",
         "stewart loops", "four_bar loops")  # fmt: skip
STATES = 1000


def run(robots: list[str], quick: bool, resume: Path) -> None:
    """Measure, choose, verify, and write the results."""
    scenes = catalogue(robots)
    effort = cp.TimingEffort(rounds=20) if quick else cp.TimingEffort()
    with progress_bar() as progress:
        table = cp.Study(scenes, effort=effort).run(progress=progress, results=resume)
    table.to_json(RESULTS / "trade.json")
    table.to_csv(RESULTS / "trade.csv")
    found = list(verdicts(table, scenes, STATES))
    write(found, RESULTS / "cheapest.csv", table.machine)


def rewrite() -> None:
    """Make the picture, the README's table and the page from the results."""
    table, found = cp.Table.from_json(RESULTS / "trade.json"), read()
    shown = [label for label in SHOWN if any(row.scene == label for row in table.rows)]
    picture = cp.Table(
        tuple(row for row in table.rows if row.scene in shown), table.machine, table.floors
    )
    save_trade(picture, RESULTS / "trade.png")
    for path, blocks in trade_text.pages(table, found, shown).items():
        page = (ROOT / path).read_text(encoding="utf-8")
        (ROOT / path).write_text(trade_text.filled(page, blocks), encoding="utf-8")


def main() -> None:
    """Run, write, and update README and docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*")
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    parser.add_argument("--from-results", action="store_true", help="do not run, only rewrite")
    parser.add_argument("--resume", type=Path, default=ROOT / "demo" / "trade.jsonl")
    arguments = parser.parse_args()
    if not arguments.from_results:
        arguments.resume.parent.mkdir(exist_ok=True)
        run(arguments.robots, arguments.quick, arguments.resume)
    rewrite()


if __name__ == "__main__":
    main()
