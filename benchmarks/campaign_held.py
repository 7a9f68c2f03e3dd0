"""ConstrainedABA and PV on random trees whose bodies are held at the world, against Reference.

    python benchmarks/campaign_held.py [--seeds 0:3000]     # on each Pinocchio
    python benchmarks/campaign_held.py --from-json

Trees are those of the campaign, with up to ten joints of every type that is compiled and masses
over up to eight decades. On them are one to four contacts: points, welds, edges and plates by their
four corners, some of them twice. The script writes benchmarks/results/campaign_held.json and
docs/how-to-choose-a-solver.md, and ends with 1 if an answer said ok and was wrong, by more than
1e-8 of the larger of |a| and gravity where Reference says ok.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import Counter
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
import numpy as np
import pinocchio as pin
from campaign_problems import configuration, placement, tree

import condyn_pin as cp
from condyn_pin._core.compiled import constrained_aba
from condyn_pin._core.timing import machine
from condyn_pin._core.tolerances import SOLVED

JSON = Path(__file__).resolve().parent / "results" / "campaign_held.json"
SOLVERS = (cp.dynamics.ConstrainedABA, cp.dynamics.PV, cp.Proximal)


def held(seed: int) -> tuple[cp.Scene, np.ndarray, np.ndarray, np.ndarray] | None:
    """Return a scene with a state on its constraints; None with joints that are not compiled."""
    rng = np.random.default_rng([20261, seed])
    model = tree(rng)
    if any(j.shortname() not in constrained_aba().joints for j in list(model.joints)[1:]):
        return None
    q = configuration(model, rng)
    names = [frame.name for frame in model.frames if frame.name.startswith("body")]
    constraints: list[Any] = []
    for k in range(int(rng.integers(1, 5))):
        name = names[int(rng.integers(len(names)))]
        constraints += _contacts(model, name, f"c{k}", rng)
    scene = cp.Scene(cp.Robot("random", model, postures={"here": q}), constraints)
    v = rng.normal(scale=float(rng.choice([0.0, 1.0, 10.0])), size=model.nv)
    v = cp.mechanism.project_velocity(scene, q, v)
    tau = cp.Workspace(scene).terms(q, v).M @ rng.normal(scale=10.0, size=model.nv)
    return scene, q, v, tau


def _contacts(model: Any, frame: str, name: str, rng: np.random.Generator) -> list[Any]:
    """Return what holds one frame: a point, a weld, an edge or corners; or some of it twice."""
    pick = int(rng.integers(4))
    if pick == 0:
        offset = tuple(placement(rng).translation)
        made = [cp.PointContact(frame, offset=offset, name=name)]
    elif pick == 1:
        made = [cp.SurfaceContact(frame, name=name)]
    elif pick == 2:
        made = [cp.constraints.LineContact(frame, "xyz"[int(rng.integers(3))], name=name)]
    else:
        length, width = rng.uniform(0.01, 0.3, size=2)
        corners = [(x * length, y * width, 0.0) for x in (-1, 1) for y in (-1, 1)]
        made = [
            cp.PointContact(frame, offset=corner, name=f"{name}.{i}")
            for i, corner in enumerate(corners)
        ]
    if rng.random() < 0.2:
        made.append(cp.PointContact(frame, name=f"{name} again"))
    return made


def run(seeds: range) -> dict[str, dict[str, Any]]:
    """Return what became of each solver: statuses, wrong ones, and the worst that was ok."""
    said = {kind.__name__: Counter[str]() for kind in SOLVERS}
    worst = dict.fromkeys(said, 0.0)
    for seed in seeds:
        try:
            problem = held(seed)
        except (cp.errors.InvalidModel, cp.errors.InvalidConstraint):
            problem = None
        if problem is None:
            continue
        scene, *state = problem
        right = cp.solve(scene, *state, solver=cp.dynamics.Reference(), throw=False)
        if not right.status.ok:
            continue
        size = max(float(np.abs(right.a).max()), scene.nominal.estimator.gravity)
        for kind in SOLVERS:
            name = kind.__name__
            found = cp.solve(scene, *state, solver=kind(), throw=False)
            said[name][found.status.name.lower()] += 1
            if found.status.ok:
                error = float(np.abs(found.a - right.a).max()) / size if size else 0.0
                worst[name] = max(worst[name], error)
                if error > SOLVED:
                    said[name]["wrong"] += 1
                    print(f"seed {seed}, {name}: ok and off by {error:.1e}", flush=True)
    return {
        name: {"problems": sum(count.values()) - count["wrong"], "worst": worst[name], **count}
        for name, count in said.items()
    }


def table(saved: dict[str, Any]) -> str:
    """Return a row a solver on each Pinocchio."""
    lines = [
        "| solver | Pinocchio | scenes | ok | of these wrong | not ok | worst error of ok |",
        "|---|---|---|---|---|---|---|",
    ]
    for version, here in saved.items():
        for name, row in here["solvers"].items():
            ok, wrong = row.get("ok", 0), row.get("wrong", 0)
            cells = (row["problems"], ok, wrong, row["problems"] - ok, f"{row['worst']:.0e}")
            lines.append(f"| `{name}` | {version} | " + " | ".join(map(str, cells)) + " |")
    where = next(iter(saved.values()))["machine"]
    lines += ["", f"`python benchmarks/campaign_held.py` on {where['processor']}, {where['date']}."]
    return "\n".join(lines)


def pages(saved: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Return the block of the page of solvers."""
    return {marks.SOLVERS: {"campaign_held": table(saved)}}


def main() -> int:
    """Run some seeds on the Pinocchio that is installed, and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0:3000", help="first:last+1")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    given = parser.parse_args()
    saved = json.loads(JSON.read_text()) if JSON.exists() else {}
    if not given.from_json:
        first, last = map(int, given.seeds.split(":"))
        saved[pin.__version__] = {"machine": machine(), "solvers": run(range(first, last))}
        JSON.write_text(json.dumps(saved, indent=1, sort_keys=True) + "\n")
    marks.write(pages(saved))
    wrong = [row.get("wrong", 0) for here in saved.values() for row in here["solvers"].values()]
    return 1 if any(wrong) else 0


if __name__ == "__main__":
    sys.exit(main())
