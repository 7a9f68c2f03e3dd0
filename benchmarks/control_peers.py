"""Whole-body control beside tsid and placo: Talos stands; times as factors of Pinocchio's ABA.

    python benchmarks/control_peers.py [--quick] [--folder build/peers] [--passes 5]

Writes benchmarks/results/control_peers.json and docs/results.md; with --from-json the table is made
from the committed results, without running anything. `peers/control/` has the question, the clock,
and a script for each library, run in an environment of its own.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any
from xml.etree import ElementTree

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
from peers.environments import Environment, Missing
from peers.run import run_script

from condyn_pin._core.timing import machine
from condyn_pin.io.description import example_robot_data

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results" / "control_peers.json"
NAME = "control_peers"
STATES = 100

OURS = "condyn_pin"
# wheels of Pinocchio before 4 leave open which urdfdom and tinyxml2 they were built with
OLD_PARSERS = ("cmeel-urdfdom<5", "cmeel-tinyxml2<11")
ENVIRONMENTS = (
    # tsid 1.10 asks for any Pinocchio, takes 4.1, and crashes in its RobotWrapper
    Environment("tsid", ("tsid==1.7.1", "pin==3.4.0", *OLD_PARSERS, "numpy"), ("with_tsid",)),
    Environment("placo", ("placo==0.10.2", "numpy"), ("with_placo",)),
)


def bare_description(folder: Path) -> Path:
    """Write Talos without its meshes, which not every parser finds, and return the path."""
    tree = ElementTree.parse(example_robot_data() / "talos_data/robots/talos_reduced.urdf")
    for link in tree.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    path = folder / "talos.urdf"
    tree.write(path)
    return path


def measure(
    folder: Path, passes: int, effort: float
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Return the rows of all passes, and who is missing, with the reason."""
    from peers.control.with_condyn import active, question_of

    folder.mkdir(parents=True, exist_ok=True)
    first = question_of(str(bare_description(folder)), STATES)
    told = [first.save(folder / "question.json")]
    told += [each.save(folder / f"active{i}.json") for i, each in enumerate(active(first))]
    jobs = [(script, Path(sys.executable)) for script in ("with_condyn", "with_condyn_core")]
    missing = {}
    for environment in ENVIRONMENTS:
        try:
            python = environment.make(folder)
            jobs += [(script, python) for script in environment.scripts]
        except Missing as why:
            missing[environment.name] = str(why)
    rows = []
    for number in range(passes):
        for script, python in jobs:
            print(f"pass {number + 1} of {passes}: {script}", flush=True)
            output = folder / f"control-{script}.json"
            try:
                rows.append(run_script(python, f"control.{script}", told, output, effort))
            except Missing as why:
                missing[script] = str(why)
    return rows, missing


def markdown(rows: Sequence[dict[str, Any]], missing: dict[str, str], about: dict[str, str]) -> str:
    """Return the table, and what it means."""
    lines = [
        "| library | program solved [x ABA] | whole tick [x ABA] | tick [us] | ABA [us] | size "
        "| equations of motion [N m] | feet [m/s^2] | CoM [m/s^2] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for peer in dict.fromkeys(row["peer"] for row in rows):
        mine = [row for row in rows if row["peer"] == peer]
        last = mine[-1]
        cells = (
            f"{peer} {last['version']}, Pinocchio {last['pinocchio']}",
            _factor(mine, "program"),
            _factor(mine, "tick"),
            f"{min(r['tick_min_us'] for r in mine):.0f} "
            f"({median(r['tick_median_us'] for r in mine):.0f})",
            f"{min(r['aba_min_us'] for r in mine):.1f}",
            last["size"],
            f"{last['dynamics']:.0e}",
            f"{last['feet']:.0e}",
            f"{last['com']:.0e}",
        )
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", *_active(rows)]
    notes = {row["peer"]: row["note"] for row in rows if row["note"]}
    lines += [
        "",
        "Talos on both feet, the same tasks, weights, limits and states; no inequality is active. "
        "Factors are relative to Pinocchio's ABA, called from Python in the same environment "
        "between the ticks: the ratio of minima, as the median of the passes with the smallest and "
        "the largest, and the ratio of medians in brackets. Times: the minimum, and the median. "
        "Errors are the worst over the states: the equations of motion by Newton-Euler; the "
        "acceleration of the feet, which should be zero; and the error of the centre of mass, "
        "against which other tasks weigh.",
        "",
        *(f"- {peer}: {note}." for peer, note in notes.items()),
        *(f"- Not there: {name}: {why}." for name, why in missing.items()),
        "",
        "`python benchmarks/control_peers.py` on {processor} ({cores} cores, one thread), "
        "{system}, Python {python}, {date}".format(**about)
        + f"; {STATES} states.",
    ]
    return "\n".join(lines)


def _active(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the table of questions in which inequalities are active."""
    last = {row["peer"]: row["active"] for row in rows}
    peers = [peer for peer in last if peer != OURS]
    lines = [
        f"| the mass is drawn | {OURS}: objective | motors at their limit | "
        + " | ".join(f"{peer}: more by | motors" for peer in peers)
        + " |",
        "|---" * (3 + 2 * len(peers)) + "|",
    ]
    for i, ours in enumerate(last[OURS]):
        cells = [ours["title"]]
        for peer in (OURS, *peers):
            row = last[peer][i]
            if row["answer"] != "ok":
                cells += [row["answer"].splitlines()[0], ""]
                continue
            more = row["objective"] - ours["objective"]
            cells.append(f"{ours['objective']:.7g}" if peer == OURS else f"{more:+.1e}")
            cells.append(str(row["motors"]))
        lines.append("| " + " | ".join(cells) + " |")
    return [
        *lines,
        "",
        "At rest in the posture, where soles, friction and motors give no more. The objective is "
        "sum w |J a - wanted|^2 of mass, trunk and joints [m^2/s^4, rad^2/s^4], of each answer by "
        "its own Pinocchio; a smaller one is better, and ours has to be that of tsid, whose cones "
        "are the same and whose forces have a weight of 1e-9 here. placo does not limit "
        "the moment about the normal of a sole, which lets it do more where friction counts.",
    ]


def _factor(rows: Sequence[dict[str, Any]], name: str) -> str:
    """Return a time over that of ABA: of least times with its spread, and of medians."""
    least = [row[f"{name}_min_us"] / row["aba_min_us"] for row in rows]
    if any(value != value for value in least):
        return ""
    middle = median(row[f"{name}_median_us"] / row["aba_median_us"] for row in rows)
    return f"{median(least):.1f}, {min(least):.1f}-{max(least):.1f} ({middle:.1f})"


def pages(
    rows: Sequence[dict[str, Any]], missing: dict[str, str], about: dict[str, str]
) -> dict[str, dict[str, str]]:
    """Return the block of docs/results.md."""
    return {marks.RESULTS: {NAME: markdown(rows, missing, about)}}


def load() -> tuple[list[dict[str, Any]], dict[str, str], dict[str, str]]:
    """Return the committed results."""
    saved = json.loads(RESULTS.read_text(encoding="utf-8"))
    for row in saved["rows"]:  # NaN is no number of json
        row |= {key: float("nan") for key, value in row.items() if value is None}
    return saved["rows"], saved["missing"], saved["machine"]


def main() -> None:
    """Run, write, and update the docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one short pass; nothing is written")
    parser.add_argument("--passes", type=int, default=5)
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "peers")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    given = parser.parse_args()
    if not given.from_json:
        passes, effort = (1, 0.2) if given.quick else (given.passes, 1.0)
        rows, missing = measure(given.folder.resolve(), passes, effort)
        print(markdown(rows, missing, machine()))
        if given.quick:
            return
        kept = [{k: None if v != v else v for k, v in row.items()} for row in rows]
        saved = {"machine": machine(), "missing": missing, "rows": kept}
        RESULTS.write_text(json.dumps(saved, indent=1) + "\n", encoding="utf-8")
    marks.write(pages(*load()))


if __name__ == "__main__":
    main()
