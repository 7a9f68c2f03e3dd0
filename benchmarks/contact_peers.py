"""Contact beside MuJoCo, Drake and Newton's Kamino: error against time on five known motions.

    python benchmarks/contact_peers.py [--quick] [--only drake] [--folder build/peers]

Writes benchmarks/results/contact_peers.{json,csv,png} and docs/results.md; with --from-json the
tables are made from the committed results, without running anything. `peers/contact/` has the
motions, what the errors are, the clock, and a script for each engine, run in its own environment.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from math import isfinite
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
from peers.environments import Environment, Missing
from peers.run import run_script

from condyn_pin._core.show import COLOURS, write_figure
from condyn_pin._core.timing import machine

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
NAME = "contact_peers"

OURS = "condyn_pin"
HERE = ("contact.with_condyn", "contact.with_mujoco")  # in the environment of this script
ENVIRONMENTS = (
    Environment("drake_contact", ("numpy", "mujoco==4.0.0", "drake==1.51.1"), ("with_drake",)),
    Environment("newton", ("numpy", "mujoco==4.0.0", "newton==1.8.0"), ("with_newton",)),
)
TARGETS = (1e-2, 1e-3, 1e-4, 1e-5)  # [m]
SHOWN = 2e-3  # the step of the table of all methods [s]
LOST = 1.0  # what is further away is lost [m]


@dataclass(frozen=True)
class Row:
    """One method with one step on one motion.

    Attributes
    ----------
    scene, peer, version, method : str
    dt : float
        [s]
    error : float
        [m]
    step_us : float
        Processor time of a step [us].
    ratio : float
        The same over that of `mj_step` with MuJoCo's defaults on the same motion.
    """

    scene: str
    peer: str
    version: str
    method: str
    dt: float
    error: float
    step_us: float
    ratio: float

    @property
    def work(self) -> float:
        """Time for 1 ms of motion, in steps of MuJoCo's default, which are 1 ms long."""
        return self.ratio * 1e-3 / self.dt


def measure(
    folder: Path, effort: float, only: Sequence[str] | None
) -> tuple[list[Row], dict[str, str], dict[str, str]]:
    """Return all rows, what the error of each motion is, and who is missing, with the reason."""
    from peers.contact import export

    told = [export.export(motion, folder / "contact") for motion in export.motions()]
    jobs = [("here", Path(sys.executable), script) for script in HERE]
    missing = {}
    for environment in ENVIRONMENTS:
        try:
            python = environment.make(folder)
        except Missing as why:
            missing[environment.name] = str(why)
            continue
        jobs += [(environment.name, python, f"contact.{s}") for s in environment.scripts]
    rows = []
    for name, python, script in jobs:
        if only and not any(word in script for word in only):
            continue
        print(f"{script} in {name}", flush=True)
        output = folder / f"{script}.json"
        try:
            found = run_script(python, script, [each.folder for each in told], output, effort)
        except Missing as why:
            missing[f"{script} in {name}"] = str(why)
            continue
        about = {"peer": found["peer"], "version": found["version"]}
        rows += [Row(**about | row) for row in found["rows"]]
    return rows, {each.name: each.error for each in told}, missing


def fastest(rows: Sequence[Row], scene: str, peer: str, error: float) -> Row | None:
    """Return a peer's fastest way to an error, if there is one."""
    found = [r for r in rows if r.scene == scene and r.peer == peer and r.error <= error]
    return min(found, key=lambda row: row.work, default=None)


def markdown(
    rows: Sequence[Row], errors: dict[str, str], missing: dict[str, str], about: dict[str, str]
) -> str:
    """Return both tables, and what they mean."""
    peers, scenes = _names(rows, "peer"), _names(rows, "scene")
    lines = [
        f"| motion | error at most [m] | {' | '.join(peers)} |",
        "|---|---|" + "---|" * len(peers),
    ]
    for scene in scenes:
        for target in TARGETS:
            found = [fastest(rows, scene, peer, target) for peer in peers]
            cells = (f"{_short(r.work)} ({1e3 * r.dt:g} ms)" if r else "" for r in found)
            lines.append(f"| {scene} | {target:.0e} | {' | '.join(cells)} |")
    lines += [
        "",
        f"| engine | method, {1e3 * SHOWN:g} ms | {' | '.join(scenes)} |",
        "|---|---|" + "---|" * len(scenes),
    ]
    shown = {(r.peer, r.method, r.scene): r for r in rows if r.dt == SHOWN}
    for peer, method in dict.fromkeys((r.peer, r.method) for r in rows):
        cells = (_cell(shown.get((peer, method, scene))) for scene in scenes)
        lines.append(f"| {peer} | {method} | {' | '.join(cells)} |")
    versions = ", ".join(f"{r.peer} {r.version}" for r in {r.peer: r for r in rows}.values())
    lines += [
        "",
        "First table: processor time for 1 ms of motion with the fastest setting that meets the "
        "error, relative to one step of 1 ms by MuJoCo's default in the same process, and the step "
        "size used; an empty cell: no setting that was tried meets it. Second table: error [m], "
        "and the time of a step relative to one of MuJoCo's default.",
        "",
        *(f"- {scene}: {what}." for scene, what in errors.items()),
        *(f"- Not there: {name}: {why}." for name, why in missing.items()),
        "",
        f"`python benchmarks/contact_peers.py`: {versions}; "
        "{processor} ({cores} cores, one thread), {system}, Python {python}, Pinocchio "
        "{pinocchio}, {date}.".format(**about),
    ]
    return "\n".join(lines)


def _cell(row: Row | None) -> str:
    if row is None:
        return ""
    return "lost" if not row.error < LOST else f"{row.error:.0e}, {_short(row.ratio)}"


def _short(ratio: float) -> str:
    return f"{ratio:.2g}" if ratio < 99.5 else f"{ratio:.0f}"


def _names(rows: Sequence[Row], field: str) -> list[str]:
    return list(dict.fromkeys(getattr(row, field) for row in rows))


_DASHES = ("-", "--", "-.", ":", (0, (1, 3)), (0, (5, 1, 1, 1, 1, 1)))
_MARKERS = "os^vD*"


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw error against time, a panel a motion: colours of engines, dashes of their methods."""
    from matplotlib.figure import Figure

    scenes, peers = _names(rows, "scene"), _names(rows, "peer")
    figure = Figure(figsize=(15, 10), layout="constrained")
    places = figure.subplots(2, 3).ravel()
    curves: dict[tuple[str, str], Any] = {}
    for ax, scene in zip(places, scenes, strict=False):
        for i, peer in enumerate(peers):
            mine = [row for row in rows if row.peer == peer]
            for k, method in enumerate(_names(mine, "method")):
                points = [r for r in mine if r.method == method and r.scene == scene]
                points = [r for r in points if r.error < LOST]
                curves[peer, method] = ax.plot(
                    [r.work for r in points], [max(r.error, 1e-15) for r in points],
                    color=COLOURS[i], ls=_DASHES[k], marker=_MARKERS[k], ms=4, lw=1.0,
                )[0]  # fmt: skip
        ax.set(xscale="log", yscale="log", title=scene, ylabel="error [m]")
        ax.set(xlabel="time for 1 ms of motion / one step of MuJoCo's default")
        ax.grid(visible=True, color="0.92")
    names = [f"{peer}: {method}" for peer, method in curves]
    places[-1].axis("off")
    places[-1].legend(list(curves.values()), names, loc="center", frameon=False, fontsize=9)
    write_figure(figure, path, dpi=110)


def save(
    rows: Sequence[Row], errors: dict[str, str], missing: dict[str, str], about: dict[str, str]
) -> None:
    """Write the results."""
    saved = {"machine": about, "errors": errors, "missing": missing}
    plain = [asdict(row) for row in rows]
    for row in plain:
        row["error"] = row["error"] if isfinite(row["error"]) else 1e999
    text = json.dumps(saved | {"rows": plain}, indent=1).replace("Infinity", "1e999")
    (RESULTS / f"{NAME}.json").write_text(text + "\n", encoding="utf-8")
    with (RESULTS / f"{NAME}.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(plain)


def load() -> tuple[list[Row], dict[str, str], dict[str, str], dict[str, str]]:
    """Return what `save` wrote."""
    saved = json.loads((RESULTS / f"{NAME}.json").read_text(encoding="utf-8"))
    rows = [Row(**row) for row in saved["rows"]]
    return rows, saved["errors"], saved["missing"], saved["machine"]


def pages(*measured: Any) -> dict[str, dict[str, str]]:
    """Return the block of docs/results.md."""
    return {marks.RESULTS: {NAME: markdown(*measured)}}


def main() -> None:
    """Run, write, and update the docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="steps of 2 ms, nothing is written")
    parser.add_argument("--only", nargs="+", help="words of scripts; nothing is written")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "peers")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    given = parser.parse_args()
    if not given.from_json:
        measured = measure(given.folder.resolve(), 0.5 if given.quick else 1.0, given.only)
        print(markdown(*measured, machine()))
        if given.quick or given.only:
            return
        save(*measured, machine())
    rows, *about = load()
    draw(rows, RESULTS / f"{NAME}.png")
    marks.write(pages(rows, *about))


if __name__ == "__main__":
    main()
