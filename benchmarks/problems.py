"""Benchmark problems: integrator x drift scheme x dt, and the digits of their answers.

    python benchmarks/problems.py runs [--quick] [--only A02 A04]
    python benchmarks/problems.py answers [A03] [car_axis]

runs: every row is one run in this process; CPU time is that of `simulate`. Times of other codes are
as published, on other machines, and stand beside ours for their order of magnitude only.

answers: the digits that no closed form gives, in extended precision. The equations are those of the
literature (`tests/classical.py`), not the library's. They are integrated by Gragg's midpoint rule
with extrapolation, with several steps and orders, with and without projection onto the constraints;
what all of them agree in is printed. Where long double is double (not on x86), the agreement shows
it. A minute or two.
"""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.append(str(Path(__file__).resolve().parent.parent / "tests"))

import classical
import numpy as np
import script
from script import Printed, Table
from simulation_vs_mujoco import Lines

import condyn_pin as cp
import lab
from condyn_pin._core.show import panels
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.simulation.drift import DRIFTS, Drift, NoDrift, PostStabilization
from condyn_pin.simulation.integrators import INTEGRATORS, Integrator
from lab.problems.base import Problem, Setting

# --- runs

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
    figure, places = panels(len(names), width=3.4, height=3.2, columns=3)
    for ax, name in zip(places, names, strict=False):
        curves: dict[str, list[dict[str, Any]]] = {}
        for row in rows:
            if row["problem"] == name and row["error"]:
                curves.setdefault(_method(row), []).append(row)
        for method, points in curves.items():
            points.sort(key=lambda row: row["cpu_seconds"])
            x, y = ([row[key] for row in points] for key in ("cpu_seconds", "error"))
            ax.plot(x, y, **lines.of(method))
        ax.set(title=name, xlabel="CPU time [s]", ylabel="error", xscale="log", yscale="log")
        ax.set_ylim(1e-15, 10.0)  # what broke down is off the picture
        ax.xaxis.set_minor_formatter("")
        ax.grid(visible=True, color="0.92")
    figure.legend(
        handles=lines.legend(), loc="outside lower center", ncols=4, frameon=False, fontsize=8
    )
    figure.savefig(path, dpi=140)


def _method(row: dict[str, Any]) -> str:
    """Return integrator and drift scheme without their parameters."""
    return f"{row['integrator'].split('(')[0]}, {row['drift'].split('(')[0]}"


def as_set(saved: script.Saved) -> str:
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
    return "\n".join([*lines, "", f"{script.source('problems runs', saved['machine'])}."])


def table(saved: script.Saved) -> str:
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


def runs(given: Namespace) -> script.Saved:
    """Run the problems as they are set, then with everything else."""
    about, names = script.measured_on(), given.only or list(lab.PROBLEMS)
    problems = [lab.load_problem(name) for name in names]
    as_set = [problem.run().to_dict() for problem in problems]
    if "A02" in names:
        place = names.index("A02") + 1
        as_set.insert(place, lab.load_problem("A02", n=40).run().to_dict())
    rows = [
        run(problem, setting) for problem in problems for setting in cases(problem, given.quick)
    ]
    return {**about, "settings": as_set, "rows": [row for row in rows if row]}


# --- answers


Long = np.longdouble
Array = np.ndarray
Rate = Callable[[Long, Array], Array]


def extrapolated_step(rate: Rate, t: Long, y: Array, h: Long, order: int) -> Array:
    """Return y at t + h: midpoint rules of 2, 4, ... substeps, extrapolated in their square."""
    counts = [2 * (k + 1) for k in range(order // 2)]
    start, above = rate(t, y), []
    for j, count in enumerate(counts):
        small = h / Long(count)
        before, now = y, y + small * start
        for k in range(1, count):
            before, now = now, before + 2 * small * rate(t + k * small, now)
        row = [(before + now + small * rate(t + h, now)) / 2]
        for k in range(j):
            ratio = (Long(count) / Long(counts[j - k - 1])) ** 2
            row.append(row[k] + (row[k] - above[k]) / (ratio - 1))
        above = row
    return above[-1]


def integrate(
    rate: Rate, y: Array, until: str, steps: int, order: int, project: Callable | None
) -> Array:
    """Return y at the end of equal steps from t = 0."""
    h = Long(until) / Long(steps)
    for k in range(steps):
        y = extrapolated_step(rate, k * h, y, h, order)
        if project:
            y = project((k + 1) * h, y)
    return y


def andrews_rate(t: Long, y: Array) -> Array:
    """Return q' and v' of Andrews' mechanism."""
    a, _ = classical.accelerations(classical.andrews(y[:7], y[7:]))
    return np.concatenate([y[7:], a])


def andrews_projected(t: Long, y: Array) -> Array:
    """Return the state moved onto the constraints."""
    q, v = y[:7].copy(), y[7:]
    for _ in range(2):
        q -= least(classical.andrews_jacobian(q), classical.andrews_gap(q))
    G = classical.andrews_jacobian(q)
    return np.concatenate([q, v - least(G, G @ v)])


def car_axis_rate(t: Long, y: Array) -> Array:
    """Return p' and v' of the car axis."""
    a, _ = classical.accelerations(classical.car_axis(t, y[:4], y[4:]))
    return np.concatenate([y[4:], a])


def car_axis_projected(t: Long, y: Array) -> Array:
    """Return the state moved onto the constraints."""
    p, v = y[:4].copy(), y[4:]
    for _ in range(2):
        p -= least(classical.car_axis(t, p, v).G, classical.car_axis_gap(t, p))
    G = classical.car_axis(t, p, v).G
    _, dB, _ = classical.road(t)
    return np.concatenate([p, v - least(G, G @ v + np.array([p[:2] @ dB, 0], dtype=Long))])


def least(G: Array, gap: Array) -> Array:
    """Return the smallest x with G x = gap."""
    return G.T @ classical.eliminate(G @ G.T, gap)


def numbers(digits: tuple[str, ...]) -> Array:
    """Return digits as extended numbers."""
    return np.array([Long(each) for each in digits])


ANSWERED = {
    "A03": (
        andrews_rate,
        andrews_projected,
        np.concatenate([numbers(classical.ANDREWS_START), np.zeros(7, dtype=Long)]),
        (("0.03", 300), ("0.05", 500)),
        7,
    ),
    "car_axis": (
        car_axis_rate,
        car_axis_projected,
        np.concatenate([numbers(part) for part in classical.CAR_AXIS_START]),
        (("3", 300),),
        4,
    ),
}


def answers(given: Namespace) -> None:
    """Print the digits, and what the settings agree to."""
    for name in given.problems:
        rate, project, start, ends, size = ANSWERED[name]
        for until, steps in ends:
            found = [
                integrate(rate, start, until, steps, 16, None)[:size],
                integrate(rate, start, until, 2 * steps, 14, None)[:size],
                integrate(rate, start, until, steps, 18, project)[:size],
            ]
            spread = max(float(np.abs(each / found[-1] - 1).max()) for each in found[:-1])
            print(f"{name} at {until} s, three settings agree to {spread:.1e}:")
            for each in found[-1]:
                print(f"    {np.format_float_scientific(each, precision=18)}")


def _only(parser: ArgumentParser) -> None:
    parser.add_argument("--only", nargs="*", help="problems by name; nothing is written")


def _some(parser: ArgumentParser) -> None:
    known = ", ".join(ANSWERED)
    parser.add_argument("problems", nargs="*", default=list(ANSWERED), help=known)


SUBJECTS = [
    Table(
        "problems runs",
        "integrator x drift scheme x dt",
        runs,
        table,
        pages=lambda saved: {script.RESULTS_PAGE: {"problems": table(saved)}},
        beside=lambda saved: plot(saved["rows"], script.result("problems runs", ".png")),
        quick="two steps a method; nothing is written",
        options=_only,
        draft=("quick", "only"),
    ),
    Printed("problems answers", "digits of answers, in extended precision", answers, options=_some),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
