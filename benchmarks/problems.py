"""Work and precision of the benchmark problems: integrator x drift scheme x dt.

    python benchmarks/problems.py [--quick] [--only A02 A04]

writes benchmarks/results/problems.{csv,json,png,md}. Every row is one run in this process; CPU time
is that of `simulate`. Times of other codes are as published, on other machines, and stand beside
ours for their order of magnitude only.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import condyn_pin as cp
from condyn_pin.drift import DRIFTS, Baumgarte, Drift
from condyn_pin.machine import machine
from condyn_pin.plots import ready_axes
from condyn_pin.problems.base import Problem, Setting
from condyn_pin.simulation.integrators import INTEGRATORS

RESULTS = Path(__file__).resolve().parent / "results"

# Steps of each problem [s]: from useful to fine; and gains that suit the finest of them [1/s].
STEPS: dict[str, tuple[float, ...]] = {
    "A01": (0.05, 0.02, 0.01, 0.005),
    "A02": (0.01, 0.005, 0.0025, 0.001),
    "A03": (5e-5, 2e-5, 1e-5, 5e-6),
    "A04": (0.05, 0.02, 0.01, 0.005, 0.002),
    "car_axis": (0.01, 0.005, 0.0025),
    "heavy_top": (2e-3, 1e-3, 5e-4, 2e-4),
}
GAINS = {"A01": 5.0, "A02": 30.0, "A03": 1000.0, "A04": 10.0, "car_axis": 10.0, "heavy_top": 10.0}
TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-11, 1e-13)
COLUMNS = (
    "problem", "integrator", "drift", "solver", "dt", "error", "difference", "energy_drift",
    "violation", "slip", "cpu_seconds", "solves", "verdict",
)  # fmt: skip


def cases(problem: Problem, quick: bool) -> Iterator[Setting]:
    """Return every setting of a problem: fixed steps with every scheme, and tolerances."""
    solver = problem.setting.solver
    steps = STEPS[problem.name][: 2 if quick else None]
    for name, kind in INTEGRATORS.items():
        if name == "dormandprince":
            for tolerance in TOLERANCES[: 2 if quick else None]:
                adaptive = kind(relative_tolerance=tolerance, absolute_tolerance=tolerance)
                gain = Baumgarte.critical(GAINS[problem.name])
                yield Setting(problem.setting.dt, adaptive, gain, solver)
            continue
        integrator = kind()
        for dt in steps:
            for drift in drifts(problem, integrator.keeps_constraints):
                yield Setting(dt, integrator, drift, solver)


def drifts(problem: Problem, kept: bool) -> Iterator[Drift]:
    """Return the drift schemes that an integrator may be run with."""
    for kind in DRIFTS.values():
        if kind is Baumgarte:
            if not kept:
                yield Baumgarte.critical(GAINS[problem.name])
        elif not kept or kind.__name__ == "NoDrift":
            yield kind()


def run(problem: Problem, setting: Setting) -> dict[str, Any] | None:
    """Return one row; None where a scheme and an integrator do not go together."""
    try:
        result = problem.run(
            dt=setting.dt,
            integrator=setting.integrator,
            drift=setting.drift,
            solver=setting.solver,
        )
    except cp.CondynError as refusal:
        print(f"{problem.label}: {setting.integrator!r}, {setting.drift!r}: {refusal}")
        return None
    row = result.to_dict()
    print(
        f"{row['problem']:<12} {row['integrator']:<75.75} {row['drift']:<36.36} dt {row['dt']:<8g}"
        f" error {result.error:<9.2g} {result.cpu_seconds:.3f} s",
        flush=True,
    )
    return row


def plot(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw error against CPU seconds, one panel a problem, one line a method."""
    import matplotlib.pyplot as plt

    names = list(dict.fromkeys(row["problem"] for row in rows))
    figure, panels = plt.subplots(2, 3, figsize=(14, 8), squeeze=False)
    for ax, name in zip(panels.flat, names, strict=False):
        lines: dict[tuple[str, str], list[dict[str, Any]]] = {}
        for row in rows:
            if row["problem"] == name and row["error"]:
                method = (row["integrator"].split("(")[0], row["drift"].split("(")[0])
                lines.setdefault(method, []).append(row)
        for (integrator, drift), line in lines.items():
            line.sort(key=lambda row: row["cpu_seconds"])
            x = [row["cpu_seconds"] for row in line]
            ax.plot(x, [row["error"] for row in line], "o-", ms=4, label=f"{integrator}, {drift}")
        ready_axes(ax, name)
    handles = {}
    for ax in panels.flat:
        handles |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=3, frameon=False)
    figure.tight_layout(rect=(0, 0.08, 1, 1))
    figure.savefig(path, dpi=110)


def markdown(best: list[dict[str, Any]], where: dict[str, str]) -> str:
    """Return the table of the settings of the problems, and that of other codes."""
    lines = [
        "| problem | run with | dt [s] | error | energy [J] | CPU [s] | solves | verdict |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in best:
        energy = "" if row["energy_drift"] is None else f"{row['energy_drift']:.1g}"
        method = f"{row['integrator'].split('(')[0]}, {row['drift']}"
        lines.append(
            f"| {row['problem']} | {method} | {row['dt']:g} | {row['error']:.1g} | {energy} | "
            f"{row['cpu_seconds']:.2g} | {row['solves']} | {row['verdict']} |"
        )
    lines += [
        "",
        "`python benchmarks/problems.py` on {processor} ({cores} cores, one thread), {system}, "
        "Python {python}, Pinocchio {pinocchio}, {date}.".format(**where),
        "",
        "As published, on other machines:",
        "",
        "| problem | code | what was run | CPU [s] | error stated | processor | source |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind in cp.PROBLEMS.values():
        lines += [
            f"| {kind.name} | {p.code} | {p.case} | {p.seconds:g} | {p.error or 'none'} | "
            f"{p.processor} | {p.source} |"
            for p in kind.published
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run everything and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two steps a method")
    parser.add_argument("--only", nargs="*", default=list(cp.PROBLEMS), help="problems by name")
    parser.add_argument("--output", type=Path, default=RESULTS)
    options = parser.parse_args()
    problems = [cp.load_problem(name) for name in options.only]
    best = [problem.run().to_dict() for problem in problems]
    if "A02" in options.only and not options.quick:
        best.insert(options.only.index("A02") + 1, cp.load_problem("A02", n=40).run().to_dict())
    found = (
        run(problem, setting)
        for problem in problems
        for setting in cases(problem, options.quick)
    )
    rows = [row for row in found if row]
    where = machine()
    options.output.mkdir(parents=True, exist_ok=True)
    saved = {"machine": where, "settings": best, "rows": rows}
    (options.output / "problems.json").write_text(json.dumps(saved, indent=1), encoding="utf-8")
    with (options.output / "problems.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    (options.output / "problems.md").write_text(markdown(best, where), encoding="utf-8")
    plot(rows, options.output / "problems.png")


if __name__ == "__main__":
    main()
