"""Contact beside MuJoCo, Drake, Newton's Kamino and crocoddyl, each in an environment of its own.

    python benchmarks/contact_peers.py motions [--quick] [--only drake] [--folder build/peers]
    python benchmarks/contact_peers.py four_bar [--folder build/peers]
    python benchmarks/contact_peers.py crocoddyl [--folder build/peers]

motions: error against time on five known motions. `peers/contact/` has them, what the errors are,
the clock, and a script for each engine.

four_bar: what a first-order step makes of a four-bar that swings for a second at 1 ms.

crocoddyl: `crocoddyl_action` beside crocoddyl's own contact dynamics; it fails where something does
not hold, and `peers/with_crocoddyl_action.py` says what.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import script
from peers.environments import CONDYN_ALONE, Environment, Missing
from peers.run import run_script
from script import Printed, Table

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.show import COLOURS, write_figure

HERE = ("contact.with_condyn", "contact.with_mujoco")  # in the environment of this script
NEWTON = Environment("newton", ("numpy", "mujoco==4.0.0", "newton==1.8.0"), ("with_newton",))
ENVIRONMENTS = (
    Environment("drake_contact", ("numpy", "mujoco==4.0.0", "drake==1.51.1"), ("with_drake",)),
    NEWTON,
)
# crocoddyl's loaders ask for descriptions before 6: condyn_pin is not installed, but on the path
CROCODDYL = Environment(
    "crocoddyl_action",
    ("crocoddyl==3.2.1", "pin==4.0.0", "libpinocchio==4.0.0", *CONDYN_ALONE),
    ("with_crocoddyl_action",),
)
TARGETS = (1e-2, 1e-3, 1e-4, 1e-5)  # [m]
SHOWN = 2e-3  # the step of the table of all methods [s]
LOST = 1.0  # what is further away is lost [m]


def folder_option(parser: ArgumentParser) -> None:
    """Add the folder in which environments are made."""
    parser.add_argument("--folder", type=Path, default=script.ROOT / "build" / "peers")


# --- motions


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


def fastest(rows: Sequence[Row], scene: str, peer: str, error: float) -> Row | None:
    """Return a peer's fastest way to an error, if there is one."""
    found = [r for r in rows if r.scene == scene and r.peer == peer and r.error <= error]
    return min(found, key=lambda row: row.work, default=None)


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


def motions(given: Namespace) -> script.Saved:
    """Measure every engine; kept are rows, what the error of each motion is, and who is missing."""
    from peers.contact import export

    about, folder = script.measured_on(), given.folder.resolve()
    effort = 0.5 if given.quick else 1.0
    told = [export.export(motion, folder / "contact") for motion in export.motions()]
    jobs = [("here", Path(sys.executable), engine) for engine in HERE]
    missing = {}
    for environment in ENVIRONMENTS:
        try:
            python = environment.make(folder)
        except Missing as why:
            missing[environment.name] = str(why)
            continue
        jobs += [(environment.name, python, f"contact.{s}") for s in environment.scripts]
    rows = []
    for name, python, engine in jobs:
        if given.only and not any(word in engine for word in given.only):
            continue
        print(f"{engine} in {name}", flush=True)
        output = folder / f"{engine}.json"
        try:
            found = run_script(python, engine, [each.folder for each in told], output, effort)
        except Missing as why:
            missing[f"{engine} in {name}"] = str(why)
            continue
        peer = {"peer": found["peer"], "version": found["version"]}
        rows += [asdict(Row(**peer | row)) for row in found["rows"]]
    errors = {each.name: each.error for each in told}
    return {**about, "errors": errors, "missing": missing, "rows": rows}


def rows_of(saved: script.Saved) -> list[Row]:
    """Return the rows."""
    return [Row(**row) for row in saved["rows"]]


def motions_table(saved: script.Saved) -> str:
    """Return both tables, and what they mean."""
    rows = rows_of(saved)
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
        *(f"- {scene}: {what}." for scene, what in saved["errors"].items()),
        *(f"- Not there: {name}: {why}." for name, why in saved["missing"].items()),
        "",
        f"{script.source('contact_peers motions', saved['machine'])}; {versions}.",
    ]
    return "\n".join(lines)


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw error against time, a panel a motion: colours of engines, dashes of their methods."""
    from matplotlib.figure import Figure

    scenes, peers = _names(rows, "scene"), _names(rows, "peer")
    figure = Figure(figsize=(10.5, 7.4), layout="constrained")
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
        ax.set(xlabel="time of 1 ms over a step of MuJoCo")
        ax.grid(visible=True, color="0.92")
    names = [f"{peer}: {method}" for peer, method in curves]
    places[-1].axis("off")
    places[-1].legend(list(curves.values()), names, loc="center", frameon=False, fontsize=7)
    write_figure(figure, path, dpi=140)


# --- four_bar


SWING, SWING_DT = 1.0, 1e-3  # [s]
BARS = ("coupler", "rocker")  # that the loop joins

# Where in the time for which it moves the bars a velocity is tangent to the loop.
BEGINNING, MIDDLE, END = "at the beginning", "in the middle", "at the end"


@dataclass(frozen=True)
class BarRow:
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


def ours() -> tuple[list[BarRow], np.ndarray]:
    """Return our rows, and where the middles of the bars have to be (3, 3) [m]."""
    scene, q, v = four_bar()
    exact = cp.simulate(
        scene, q, v, duration=SWING, dt=SWING_DT, integrator=cp.simulation.DormandPrince()
    )
    wanted = middles(scene, exact.q[-1])
    rows = []
    schemes = {
        cp.SemiImplicitEuler(): END,
        cp.StewartTrinkle(): MIDDLE,
        cp.Moreau(): MIDDLE,
    }
    for scheme, tangent in schemes.items():
        run = cp.simulate(scene, q, v, duration=SWING, dt=SWING_DT, integrator=scheme)
        far = distance(middles(scene, run.q[-1]), wanted)
        rows.append(BarRow(scheme.title, tangent, far, abs(float(run.energy.error[-1]))))
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


def kamino(folder: Path, wanted: np.ndarray) -> tuple[list[BarRow], str]:
    """Return the rows of Newton's Kamino, and its version."""
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
        BarRow(f"Newton's {r['method']}", BEGINNING, distance(r["centres"], wanted), r["energy"])
        for r in found["rows"]
    ]
    return rows, found["version"]


def swing(given: Namespace) -> script.Saved:
    """Measure our steps, and Kamino's."""
    about, (rows, wanted) = script.measured_on(), ours()
    theirs, about["machine"]["newton"] = kamino(given.folder.resolve(), wanted)
    return about | {"rows": [asdict(row) for row in (*rows, *theirs)]}


def swing_table(saved: script.Saved) -> str:
    """Return a row a step."""
    rows = [BarRow(**row) for row in saved["rows"]]
    source = script.source("contact_peers four_bar", saved["machine"], script.OF_CORES)
    lines = [
        "| four-bar, 1 s at 1 ms | velocity tangent to the loop | a bar off [m] | energy [J] |",
        "|---|---|---|---|",
        *(f"| {r.method} | {r.tangent} | {r.distance:.1e} | {r.energy:.1e} |" for r in rows),
    ]
    return "\n".join([*lines, "", f"{source}; Newton {saved['machine']['newton']}."])


# --- crocoddyl


def crocoddyl(given: Namespace) -> int:
    """Run the comparison, and return its exit code."""
    folder = given.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    paths = os.pathsep.join([str(script.ROOT / "benchmarks"), str(script.ROOT)])
    return subprocess.run(
        [str(CROCODDYL.make(folder)), "-m", f"peers.{CROCODDYL.scripts[0]}"],
        env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": paths},
        cwd=folder,
    ).returncode


def _options(parser: ArgumentParser) -> None:
    parser.add_argument("--only", nargs="+", help="words of scripts; nothing is written")
    folder_option(parser)


SUBJECTS = [
    Table(
        "contact_peers motions",
        "error against time of every engine on five motions",
        motions,
        motions_table,
        pages=lambda saved: {script.RESULTS_PAGE: {"contact_peers": motions_table(saved)}},
        beside=lambda saved: draw(rows_of(saved), script.result("contact_peers motions", ".png")),
        quick="steps of 2 ms; nothing is written",
        options=_options,
        draft=("quick", "only"),
    ),
    Table(
        "contact_peers four_bar",
        "first-order steps of a loop, Kamino's too",
        swing,
        swing_table,
        pages=lambda saved: {script.RESULTS_PAGE: {"contact_four_bar": swing_table(saved)}},
        options=folder_option,
    ),
    Printed(
        "contact_peers crocoddyl",
        "our steps in crocoddyl, beside its own",
        crocoddyl,
        options=folder_option,
    ),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
