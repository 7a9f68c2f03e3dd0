"""What a first-order step makes of a four-bar that swings for a second at 1 ms.

    python benchmarks/contact_four_bar.py [--folder build/peers]

Writes benchmarks/results/contact_four_bar.json and docs/results.md; with --from-json the table is
made from the committed results, without running anything. Newton's Kamino runs in an environment
of its own, as in `contact_peers.py`.
"""

from __future__ import annotations

import argparse
import json
import os
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
import numpy as np
from peers.run import run_script

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.timing import machine

ROOT = Path(__file__).resolve().parent.parent
JSON = ROOT / "benchmarks" / "results" / "contact_four_bar.json"
DURATION, DT = 1.0, 1e-3  # [s]
BARS = ("coupler", "rocker")  # that the loop joins

# Where in the time for which it moves the bars a velocity is tangent to the loop.
BEGINNING, MIDDLE, END = "at the beginning", "in the middle", "at the end"


@dataclass(frozen=True)
class Row:
    """A step, and what is left after a second.

    Attributes
    ----------
    method, tangent : str
        `tangent` is where on its way the velocity is tangent to the loop.
    distance : float
        Of the middle of a bar from where it has to be, the largest [m].
    energy : float
        What is lost or won [J].
    """

    method: str
    tangent: str
    distance: float
    energy: float


def ours() -> tuple[list[Row], np.ndarray]:
    """Return our rows, and where the middles of the bars have to be (3, 3) [m]."""
    scene, q, v = four_bar()
    exact = cp.simulate(
        scene, q, v, duration=DURATION, dt=DT, integrator=cp.simulation.DormandPrince()
    )
    wanted = middles(scene, exact.q[-1])
    rows = []
    schemes = {
        cp.SemiImplicitEuler(): END,
        cp.StewartTrinkle(): MIDDLE,
        cp.Moreau(): MIDDLE,
    }
    for scheme, tangent in schemes.items():
        run = cp.simulate(scene, q, v, duration=DURATION, dt=DT, integrator=scheme)
        far = distance(middles(scene, run.q[-1]), wanted)
        rows.append(Row(scheme.title, tangent, far, abs(float(run.energy.error[-1]))))
    return rows, wanted


def four_bar() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """Return the four-bar at rest in its posture."""
    robot = cp.load_robot("four_bar")
    scene = cp.Scene(robot, robot.loops)
    return scene, *scene.state()


def middles(scene: cp.Scene, q: np.ndarray) -> np.ndarray:
    """Return the centres of mass of the bars (3, 3) [m]."""
    model = scene.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return np.array([data.oMi[i].act(model.inertias[i].lever) for i in range(1, model.njoints)])


def distance(found: Any, wanted: np.ndarray) -> float:
    """Return the largest distance of a middle from where it has to be [m]."""
    return float(np.linalg.norm(np.array(found) - wanted, axis=1).max())


def kamino(folder: Path, wanted: np.ndarray) -> tuple[list[Row], str]:
    """Return the rows of Newton's Kamino, and its version."""
    from contact_peers import ENVIRONMENTS
    from peers.contact import export, scene

    linkage, q, v = four_bar()
    robot, files = linkage.robot, folder / "four_bar"
    files.mkdir(parents=True, exist_ok=True)
    tree = ET.fromstring(robot.to_mjcf())
    (files / scene.MODEL).write_text(export.with_start(tree, robot, q, v), encoding="utf-8")
    ends = {name: robot.model.frames[robot.model.getFrameId(f"{name}_tip")] for name in BARS}
    tips = {name: frame.placement.translation.tolist() for name, frame in ends.items()}
    (files / "four_bar.json").write_text(json.dumps(tips), encoding="utf-8")
    environment = next(each for each in ENVIRONMENTS if each.name == "newton")
    python, output = environment.make(folder), folder / "four_bar_newton.json"
    found = run_script(python, "contact.four_bar_newton", [files], output, 1.0)
    rows = [
        Row(f"Newton's {r['method']}", BEGINNING, distance(r["centres"], wanted), r["energy"])
        for r in found["rows"]
    ]
    return rows, found["version"]


def markdown(rows: Sequence[Row], about: dict[str, str]) -> str:
    """Return the table."""
    lines = [
        "| four-bar, 1 s at 1 ms | velocity tangent to the loop | a bar off [m] | energy [J] |",
        "|---|---|---|---|",
        *(f"| {r.method} | {r.tangent} | {r.distance:.1e} | {r.energy:.1e} |" for r in rows),
        "",
        "`python benchmarks/contact_four_bar.py` on {processor} ({cores} cores), {system}, Python "
        "{python}, Pinocchio {pinocchio}, Newton {newton}, {date}.".format(**about),
    ]
    return "\n".join(lines)


def load() -> tuple[list[Row], dict[str, str]]:
    """Return what `main` wrote."""
    saved = json.loads(JSON.read_text(encoding="utf-8"))
    return [Row(**row) for row in saved["rows"]], saved["machine"]


def pages(*measured: Any) -> dict[str, dict[str, str]]:
    """Return the block of docs/results.md."""
    return {marks.RESULTS: {"contact_four_bar": markdown(*measured)}}


def main() -> None:
    """Run, write, and update the docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "peers")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    given = parser.parse_args()
    if not given.from_json:
        rows, wanted = ours()
        theirs, newton = kamino(given.folder.resolve(), wanted)
        saved = {"machine": machine() | {"newton": newton}}
        saved |= {"rows": [asdict(row) for row in (*rows, *theirs)]}
        JSON.write_text(json.dumps(saved, indent=1) + "\n", encoding="utf-8")
    measured = load()
    print(markdown(*measured))
    marks.write(pages(*measured))


if __name__ == "__main__":
    main()
