"""Routes to derivatives through contact: bias, spread and cost against closed forms.

    python benchmarks/contact_gradients.py [--quick]

Writes benchmarks/results/contact_gradients.json and .png, and the tables of
docs/gradients-through-contact.md; with --from-json these are made from the committed results.

A point of 1 kg on a floor with mu 0.5 is pushed for one step, from rest; slides from 1 m/s until it
stops; and a ball of restitution 0.8 falls half a metre, hits the floor once and is looked at after
0.6 s. Spread is the standard deviation over seeds. Cost is processor time of one step's
derivatives, relative to those of `ActiveSet`, interleaved in one run.

A second table is a study by `GradientMeasure`: Solo12 hits the floor, slides and lets go within
10 ms, by steps of 1 ms, against differences of the same motion with located events.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import sqrt
from pathlib import Path
from time import process_time
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
import numpy as np

import condyn_pin as cp
from condyn_pin._core.show import finished, line
from condyn_pin._core.timing import machine
from condyn_pin.constraints import Ball, Point
from condyn_pin.gradients import (
    ActiveSet,
    EventLocated,
    Kappa,
    Randomised,
    Route,
    Softened,
    trajectory_derivatives,
)
from condyn_pin.study import GradientMeasure, SampledStates, Study, TimingEffort

RESULTS = Path(__file__).resolve().parent / "results"
JSON = RESULTS / "contact_gradients.json"
PAGE = "docs/gradients-through-contact.md"

GRAVITY, MU = 9.81, 0.5  # [m/s^2], [1]
DT = 1e-2  # [s]
SEEDS = 10
FORCES = (3.0, 4.8, 5.0, 8.0)  # [N]; it slips at 4.905
ROUTES: tuple[Route, ...] = (
    ActiveSet(), EventLocated(), Kappa(1e-2), Kappa(1e-4), Kappa(1e-6), Softened(),
    Randomised(50, 1e-3), Randomised(50, 1e-2),
)  # fmt: skip


@dataclass(frozen=True)
class Found:
    """What a route finds of one slope, and how it differs from seed to seed."""

    problem: str
    route: str
    exact: float
    mean: float
    spread: float


def point() -> tuple[cp.Scene, np.ndarray]:
    """Return a point on the floor, a nanometre in it: no gap is about to open."""
    floor = cp.FrictionalContact("ball", Point(), friction=MU)
    scene = cp.Scene(cp.model.free_ball(mass=1.0, radius=0.05), contacts=[floor])
    q = scene.state()[0].copy()
    q[2] = -1e-9
    return scene, q


def pushed(force: float, route: Route) -> float:
    """Return dv/df of the point after one step [m/s/N]."""
    scene, q = point()
    tau = np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0])
    now = cp.step(scene, q, np.zeros(6), tau, dt=DT)
    return float(now.derivatives(route=route).dv_dtau[0, 0])


def stopped(route: Route) -> float:
    """Return how far the point goes by how fast it begins, dx/dv = v / (mu g) [s]."""
    scene, q = point()
    v = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    motion = cp.simulate(scene, q, v, duration=0.3, dt=DT)
    return float(trajectory_derivatives(motion, route=route).dx_dx[0, 6])


def bounced(route: Route, dt: float = DT) -> float:
    """Return the height of the ball after 0.6 s by that of its fall [1]."""
    floor = cp.FrictionalContact("ball", Ball(0.05), friction=0.2, restitution=0.8)
    scene = cp.Scene(cp.model.free_ball(mass=1.0, radius=0.05), contacts=[floor])
    q, v = scene.state()
    q = q.copy()
    q[2] = 0.55
    motion = cp.simulate(scene, q, v, duration=0.6, dt=dt, integrator=cp.Moreau())
    return float(trajectory_derivatives(motion, route=route).dx_dx[2, 2])


def bounce_exact(h: float = 0.5, t: float = 0.6, e: float = 0.8) -> float:
    """Return dz/dh of z = e g t0 (t - t0) - g (t - t0)^2 / 2, t0 = sqrt(2 h / g)."""
    first = sqrt(2 * h / GRAVITY)
    by_first = e * GRAVITY * (t - 2 * first) + GRAVITY * (t - first)
    return by_first / (GRAVITY * first)


def measured(seeds: int) -> list[Found]:
    """Return all rows."""
    problems = [
        *((f"dv/df at {f:g} N", 0.0 if f < MU * GRAVITY else DT, lambda r, f=f: pushed(f, r))
          for f in FORCES),
        ("dx/dv of the stop", 1.0 / (MU * GRAVITY), stopped),
        ("dz/dh of the bounce", bounce_exact(), bounced),
    ]  # fmt: skip
    found = []
    for name, exact, slope in problems:
        for route in ROUTES:
            drawn = [replace(route, seed=k) for k in range(seeds)] if _noisy(route) else [route]
            values = [slope(each) for each in drawn]
            spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
            found.append(Found(name, title(route), exact, float(np.mean(values)), spread))
            print(found[-1], flush=True)
    return found


def _noisy(route: Route) -> bool:
    return isinstance(route, Randomised)


def title(route: Route) -> str:
    """Return a route with what matters of its parameters."""
    if isinstance(route, Kappa):
        return f"Kappa({route.kappa:g})"
    if isinstance(route, Randomised):
        return f"Randomised({route.samples}, {route.sigma:g})"
    return f"{type(route).__name__}()"


def costs(repeats: int) -> dict[str, dict[str, float]]:
    """Return the processor time of each route, relative to ActiveSet; and its own to bilateral."""
    solo = cp.load_robot("solo12")
    scene = cp.Scene(solo, contacts=solo.frictional_contacts(friction=0.7))
    q = cp.mechanism.put_down(scene, scene.state()[0])
    v = 0.01 * np.random.default_rng(0).normal(size=18)
    ball, at = point()
    steps = {
        "point": cp.step(ball, at, np.full(6, 0.1), dt=1e-3),
        "Solo12": cp.step(scene, q, v, dt=1e-3),
    }
    held = cp.Workspace(scene.closed())
    found: dict[str, dict[str, float]] = {}
    for name, now in steps.items():
        calls = {title(route): (lambda route=route, now=now: now.derivatives(route=route))
                 for route in ROUTES if not isinstance(route, Randomised)}  # fmt: skip
        if name == "Solo12":
            calls["bilateral"] = lambda: held.derivatives(q, v, np.zeros(18), method="kkt").da_dq
        best = dict.fromkeys(calls, np.inf)
        for _ in range(repeats):
            for which, call in calls.items():
                begun = process_time()
                for _ in range(10):
                    call()
                best[which] = min(best[which], process_time() - begun)
        unit = best["ActiveSet()"]
        found[name] = {which: took / unit for which, took in best.items()}
    return found


def studied(states: int, rounds: int) -> list[dict[str, Any]]:
    """Return the rows of a study of routes on Solo12, with times relative to ActiveSet."""
    study = Study(
        "solo12", ROUTES, states=SampledStates(states, loads=["zero"]),
        measure=GradientMeasure(), effort=TimingEffort(rounds=rounds),
    )  # fmt: skip
    rows = study.run().rows
    unit = next(row.us for row in rows if row.solver == "ActiveSet()")
    return [
        {
            "route": title(route), "median": row.error_median, "worst": row.error_worst,
            "spread": row.dynamics_error, "end": row.constraint_error, "states": states,
            "cost": row.us / unit,
        }
        for route, row in zip(ROUTES, rows, strict=True)
    ]  # fmt: skip


def study_table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table of the study."""
    lines = ["| route | error, median | worst | spread | end | cost |", "|---|---|---|---|---|---|"]
    for row in rows:
        spread = f"{row['spread']:.1e}" if row["spread"] else ""
        lines.append(
            f"| `{row['route']}` | {row['median']:.1e} | {row['worst']:.1e} | {spread} | "
            f"{row['end']:.1e} | {row['cost']:.1f} |"
        )
    lines += [
        "",
        f"Solo12, {rows[0]['states']} random states on its lowest foot, 10 ms in steps of 1 ms by "
        "`Moreau()`, directions of v and tau; end: how far the end of the steps is from that of "
        "the motion [m/s]; cost relative to `ActiveSet()`. Same script, machine and day.",
    ]
    return "\n".join(lines)


def markdown(found: Sequence[Found], times: dict[str, Any], about: dict[str, str]) -> str:
    """Return the table."""
    problems = list(dict.fromkeys(row.problem for row in found))
    exact = {row.problem: row.exact for row in found}
    lines = [f"| route | {' | '.join(problems)} | cost |", "|---|" + "---|" * (len(problems) + 1)]
    lines.append("| exact | " + " | ".join(f"{exact[p]:.5g}" for p in problems) + " | |")
    for route in dict.fromkeys(row.route for row in found):
        rows = {row.problem: row for row in found if row.route == route}
        cells = [
            f"{rows[p].mean:.4g}" + (f" ± {rows[p].spread:.1g}" if rows[p].spread else "")
            for p in problems
        ]
        cost = times["Solo12"].get(route)
        lines.append(f"| `{route}` | {' | '.join(cells)} | {f'{cost:.1f}' if cost else ''} |")
    lines += [
        "",
        "dt 10 ms; ±: standard deviation over seeds; cost: of Solo12 on four feet, relative to "
        f"`ActiveSet()`, which takes {1 / times['Solo12']['bilateral']:.1f} times what the "
        "derivatives of the held robot take. `python benchmarks/contact_gradients.py` on "
        + "{processor} ({cores} cores), {system}, Python {python}, ".format(**about)
        + "Pinocchio {pinocchio}, {date}.".format(**about),
    ]
    return "\n".join(lines)


def draw() -> None:
    """Write the figure: the slope of stick and slip beside the force at which it slips."""
    import matplotlib.pyplot as plt

    forces = np.linspace(3.5, 6.5, 61)
    figure, ax = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
    routes = (ActiveSet(), Kappa(1e-2), Kappa(1e-4), Kappa(1e-6), Randomised(50, 1e-2))
    for i, route in enumerate(routes):
        slopes = [1e3 * pushed(float(f), route) for f in forces]
        ax.plot(forces, slopes, label=title(route), **line(i))
    ax.axvline(MU * GRAVITY, color="0.6", lw=0.8)
    finished(ax, title="", x="force [N]", y="dv/df [mm/s/N]")
    figure.savefig(RESULTS / "contact_gradients.png", dpi=150)


def load() -> tuple[list[Found], dict[str, Any], dict[str, str], list[dict[str, Any]]]:
    """Return what `main` wrote."""
    saved = json.loads(JSON.read_text(encoding="utf-8"))
    slopes = [Found(**row) for row in saved["slopes"]]
    return slopes, saved["costs"], saved["machine"], saved["study"]


def pages(*found: Any) -> dict[str, dict[str, str]]:
    """Return the blocks of the page."""
    *slopes, rows = found
    return {PAGE: {"contact_gradients": markdown(*slopes), "route_study": study_table(rows)}}


def main() -> None:
    """Run, write, and update the docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two seeds, nothing is written")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    given = parser.parse_args()
    if given.from_json:
        marks.write(pages(*load()))
        return
    found, times, about = measured(2 if given.quick else SEEDS), costs(25), machine()
    rows = studied(1, 1) if given.quick else studied(8, 3)
    print(markdown(found, times, about), study_table(rows), sep="\n\n")
    if given.quick:
        return
    saved = {
        "machine": about,
        "slopes": [asdict(row) for row in found],
        "costs": times,
        "study": rows,
    }
    JSON.write_text(json.dumps(saved, indent=1) + "\n", encoding="utf-8")
    draw()
    marks.write(pages(*load()))


if __name__ == "__main__":
    main()
