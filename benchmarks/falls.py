"""Falls: limp robots from random states, every step looked at; write results/falls.{json,md}.

    python benchmarks/falls.py [--falls 1000] [--only solo12] [--dt 1e-3]

With --from-json the table in docs/results.md is made from the committed results.

Each robot is let go 2 cm above the floor, in a random state, without torques. Of every step: the
natural residual of the contact problem, how far loops are open, how deep contacts penetrate, and
what they do to the energy; `contact_step.py` has what a step costs.
With --only the row of one robot is measured, and those of the others stay.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
import numpy as np

import condyn_pin as cp
from condyn_pin._core.timing import machine
from condyn_pin.dynamics import contact_gaps

RESULTS = Path(__file__).resolve().parent / "results"
ROBOTS = {"solo12": {}, "go2": {}, "talos": {}, "cassie": {"variant": {"feet": "points"}}}
FRICTION = 0.7  # [1]
HEIGHT = 0.02  # [m]
DURATION = 1.0  # [s]

# What is allowed: natural residual [1], loops [m, rad], penetration [m].
NATURAL, LOOPS, DEPTH = 1e-8, 1e-5, 1e-3


@dataclass
class Falls:
    """The falls of one robot."""

    robot: str
    falls: int = 0
    steps: int = 0
    broken: list[str] = field(default_factory=list)  # why runs did not go to their end
    natural: float = 0.0  # [1], the largest
    loops: float = 0.0  # [m, rad]
    penetration: float = 0.0  # [m]
    deep: int = 0  # falls that penetrate further than DEPTH
    fastest: float = 0.0  # [rad/s, m/s]
    # of the energy that a fall loses, at most: what corrections have done, and what steps gave
    corrected: float = 0.0  # [1]
    algorithmic: float = 0.0  # [1]
    given: float = 0.0  # the same in a single step [1]
    taken: float = 0.0  # median work of friction and impacts [J]


def fall(robot: str, count: int, dt: float) -> Falls:
    """Return what `count` falls of a robot have shown."""
    scene = scene_of(robot)
    found, taken = Falls(robot), []
    for seed in range(count):
        q, v = scene.sample(np.random.default_rng(seed), spread=0.3)
        q[2] += HEIGHT - min(contact_gaps(scene, q).values())
        run = cp.simulate(scene, q, v, duration=DURATION, dt=dt)
        assert run.contact is not None
        depth = -min(float(gap.min()) for gap in run.gaps.values())
        found.falls += 1
        found.steps += len(run) - 1
        if not run.status.ok:
            found.broken.append(f"{robot}, seed {seed}: {run.reason}")
        found.natural = max(found.natural, float(run.contact.natural.max()))
        found.loops = max(found.loops, float(run.violation.max()))
        found.penetration = max(found.penetration, depth)
        found.deep += int(depth > DEPTH)
        found.fastest = max(found.fastest, float(np.abs(run.v).max()))
        energy = run.energy
        size = float(np.ptp(energy.total))
        found.corrected = max(found.corrected, float(np.abs(energy.correction).max()) / size)
        found.algorithmic = max(found.algorithmic, float(energy.algorithmic[-1]) / size)
        found.given = max(found.given, float(np.diff(energy.algorithmic).max()) / size)
        taken.append(float(energy.contact[-1]))
    found.taken = float(np.median(taken))
    return found


def scene_of(robot: str) -> cp.Scene:
    """Return a robot on its loops, its feet over the floor."""
    loaded = cp.load_robot(robot, **ROBOTS[robot])
    return cp.Scene(loaded, loaded.loops, contacts=loaded.frictional_contacts(FRICTION))


def table(rows: list[Falls], dt: float, about: dict[str, str]) -> str:
    """Return the falls as text."""
    lines = [
        f"{DURATION:g} s in steps of {1e3 * dt:g} ms from {1e2 * HEIGHT:g} cm; allowed: natural "
        f"{NATURAL:g}, loops {LOOPS:g} m, penetration {1e3 * DEPTH:g} mm.",
        "",
        "| robot | falls | broken | natural | loops [m] | deepest [mm] | deeper than 1 mm "
        "| contacts took [J] | corrections | algorithmic | in a step | fastest [rad/s] |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r.robot} | {r.falls} | {len(r.broken)} | {r.natural:.1e} | {r.loops:.1e} | "
        f"{1e3 * r.penetration:.2f} | {r.deep} | {-r.taken:.3g} | "
        f"{r.corrected:.1e} | {r.algorithmic:.1e} | {r.given:.1e} | {r.fastest:.0f} |"
        for r in rows
    ]
    where = (
        "`python benchmarks/falls.py` on {processor} ({cores} cores, one thread), {system}, Python "
        "{python}, Pinocchio {pinocchio}, {date}; contacts took: friction and impacts, median. Of "
        "the energy that a fall loses, at most: corrections, which push penetrations out and close "
        "loops; algorithmic, which steps gave, in a fall and in a step."
    )
    return "\n".join([*lines, "", where.format(**about)])


def reasons(rows: list[Falls]) -> str:
    """Return why runs broke, a line each."""
    return "\n".join(reason for row in rows for reason in row.broken)


def load() -> tuple[list[Falls], float, dict[str, str]]:
    """Return what `main` wrote."""
    saved = json.loads((RESULTS / "falls.json").read_text(encoding="utf-8"))
    return [Falls(**row) for row in saved["rows"]], saved["dt"], saved["machine"]


def pages(*measured: Any) -> dict[str, dict[str, str]]:
    """Return the block of docs/results.md."""
    return {marks.RESULTS: {"falls": table(*measured)}}


def main() -> None:
    """Let them fall."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--falls", type=int, default=1000)
    parser.add_argument("--only", choices=ROBOTS)
    parser.add_argument("--dt", type=float, default=1e-3, help="[s]")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    asked = parser.parse_args()
    if not asked.from_json:
        rows = [fall(name, asked.falls, asked.dt) for name in ROBOTS if asked.only in (None, name)]
        if asked.only is not None:
            new, (rows, dt, _) = rows[0], load()
            if dt != asked.dt:
                parser.error(f"the other rows are of steps of {dt:g} s")
            rows = [new if row.robot == new.robot else row for row in rows]
        saved = {"machine": machine(), "dt": asked.dt, "rows": [asdict(row) for row in rows]}
        (RESULTS / "falls.json").write_text(json.dumps(saved, indent=1) + "\n", encoding="utf-8")
    rows, dt, about = load()
    text = table(rows, dt, about) + "\n\n" + reasons(rows)
    (RESULTS / "falls.md").write_text(text.rstrip() + "\n", encoding="utf-8")
    marks.write(pages(rows, dt, about))


if __name__ == "__main__":
    main()
