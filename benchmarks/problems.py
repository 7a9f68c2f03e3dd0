"""Work and precision of the benchmark problems: integrator x drift scheme x dt.

    python benchmarks/problems.py [--quick] [--only A02 A04]

writes benchmarks/results/problems.{csv,json,png} and docs/results.md. Every row is one run
in this process; CPU time is that of `simulate`. Times of other codes are as published, on other
machines, and stand beside ours for their order of magnitude only. With --from-json the
tables are made from the committed results, without running anything.
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

import marks
from method_lines import Lines

import condyn_pin as cp
import lab
from condyn_pin._core.show import panels
from condyn_pin._core.timing import machine
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.simulation.drift import DRIFTS, Drift
from condyn_pin.simulation.drift.no_drift import NoDrift
from condyn_pin.simulation.drift.post_stabilization import PostStabilization
from condyn_pin.simulation.integrators import INTEGRATORS, Integrator
from lab.problems.base import Problem, Setting

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"

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
    "violation", "constraint_velocity", "cpu_seconds", "evaluations", "verdict",
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
            for drift in drifts(problem, integrator):
                yield Setting(dt, integrator, drift, solver)


def drifts(problem: Problem, integrator: Integrator) -> Iterator[Drift]:
    """Return the drift schemes that an integrator is run with.

    All of them with the default one; with the others that keep no constraint, the default scheme
    and gains: what a scheme leaves of its order shows there too, in half the time.
    """
    if integrator.keeps_constraints:
        yield NoDrift()
        return
    every = integrator == cp.RungeKutta4()
    for kind in DRIFTS.values() if every else (PostStabilization, Baumgarte):
        yield Baumgarte.critical(GAINS[problem.name]) if kind is Baumgarte else kind()


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
    names = list(dict.fromkeys(row["problem"] for row in rows))
    lines = Lines(dict.fromkeys(_method(row) for row in rows))
    figure, places = panels(len(names), width=14 / 3, height=4.5, columns=3)
    for ax, name in zip(places, names, strict=False):
        curves: dict[str, list[dict[str, Any]]] = {}
        for row in rows:
            if row["problem"] == name and row["error"]:
                curves.setdefault(_method(row), []).append(row)
        for method, points in curves.items():
            points.sort(key=lambda row: row["cpu_seconds"])
            x, y = ([row[key] for row in points] for key in ("cpu_seconds", "error"))
            ax.plot(x, y, **lines.of(method))
        ax.set(title=name, xlabel="CPU [s]", ylabel="error", xscale="log", yscale="log")
        ax.set_ylim(1e-15, 10.0)  # what broke down is off the picture
        ax.xaxis.set_minor_formatter("")
        ax.grid(visible=True, color="0.92")
    figure.legend(handles=lines.legend(), loc="outside lower center", ncols=5, frameon=False)
    figure.savefig(path, dpi=110)


def _method(row: dict[str, Any]) -> str:
    """Return integrator and drift scheme without their parameters."""
    return f"{row['integrator'].split('(')[0]}, {row['drift'].split('(')[0]}"


def as_set(saved: dict[str, Any]) -> str:
    """Return the problems as they are set."""
    lines = [
        "| problem | integrator, drift control | dt [s] | error | energy [J] | CPU [s] | "
        "evaluations |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in saved["settings"]:
        energy = "" if row["energy_drift"] is None else f"{row['energy_drift']:.0e}"
        gain = row["drift"].split("alpha=")[-1].split(",")[0]
        lines.append(
            f"| {row['problem']} | {_method(row)}({gain}) | {row['dt']:g} | {row['error']:.0e} | "
            f"{energy} | {row['cpu_seconds']:.2g} | {row['evaluations']} |"
        )
    where = (
        "`python benchmarks/problems.py` on {processor} ({cores} cores, one thread), {system}, "
        "Python {python}, Pinocchio {pinocchio}, {date}."
    )
    return "\n".join([*lines, "", where.format(**saved["machine"])])


def markdown(saved: dict[str, Any]) -> str:
    """Return the problems as they are set, and what others published."""
    lines = [
        as_set(saved),
        "",
        "As published by others, on their machines:",
        "",
        "| problem | code | what was run | CPU [s] | error stated | processor |",
        "|---|---|---|---|---|---|",
    ]
    for kind in lab.PROBLEMS.values():
        lines += [
            f"| {kind.name} | {p.code} | {p.case} | {p.seconds:g} | {p.error or 'none'} | "
            f"{p.processor} |"
            for p in kind.published
        ]
    return "\n".join(lines)


def pages(saved: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Return the block of docs/results.md."""
    return {marks.RESULTS: {"problems": markdown(saved)}}


def measure(names: list[str], quick: bool) -> dict[str, Any]:
    """Run the problems as they are set, then with everything else."""
    problems = [lab.load_problem(name) for name in names]
    as_set = [problem.run().to_dict() for problem in problems]
    if "A02" in names:
        place = names.index("A02") + 1
        as_set.insert(place, lab.load_problem("A02", n=40).run().to_dict())
    rows = [run(problem, setting) for problem in problems for setting in cases(problem, quick)]
    return {"machine": machine(), "settings": as_set, "rows": [row for row in rows if row]}


def main() -> None:
    """Run everything, write the results, and update the docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two steps a method")
    parser.add_argument("--only", nargs="*", default=list(lab.PROBLEMS), help="problems by name")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    options = parser.parse_args()
    path = RESULTS / "problems.json"
    if options.from_json:
        saved = json.loads(path.read_text(encoding="utf-8"))
    else:
        saved = measure(options.only, options.quick)
        path.write_text(json.dumps(saved, indent=1) + "\n", encoding="utf-8")
        with (RESULTS / "problems.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
            writer.writeheader()
            writer.writerows(saved["rows"])
    plot(saved["rows"], RESULTS / "problems.png")
    marks.write(pages(saved))
    print(markdown(saved))


if __name__ == "__main__":
    main()
