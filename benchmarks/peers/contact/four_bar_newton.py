"""A four-bar in Kamino: where its bars are after a second, and what its energy has become."""

from __future__ import annotations

import argparse
import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
import warp as wp

from peers.contact.scene import MODEL
from peers.contact.with_newton import ALPHA, Kamino, read, turned

BARS = ("crank", "coupler", "rocker")
GRAVITY = 9.81  # [m/s^2]

# Integrators, and which share of an open joint a step closes [1].
SETTINGS = (("euler", ALPHA), ("moreau", ALPHA), ("euler", 0.1))


def closed(folder: Path, integrator: str, dt: float, alpha: float) -> Kamino:
    """Return the four-bar of a file, with the ball that closes it in the axes of both bars."""
    about = json.loads((folder / "four_bar.json").read_text(encoding="utf-8"))
    robot = read(folder / MODEL)
    bars = {
        name: i for name in BARS for i, label in enumerate(robot.body_label) if label.endswith(name)
    }
    ends = {name: wp.transform(about[name], wp.quat_identity()) for name in BARS[1:]}
    robot.add_joint_ball(
        parent=bars["coupler"], child=bars["rocker"],
        parent_xform=ends["coupler"], child_xform=ends["rocker"],
    )  # fmt: skip
    return Kamino(robot, integrator, dt, alpha=alpha)


def energy(four_bar: Kamino) -> float:
    """Return kinetic and potential energy [J]."""
    model, total = four_bar.model, 0.0
    poses, speeds = four_bar.now.body_q.numpy(), four_bar.now.body_qd.numpy()
    bodies = zip(
        model.body_mass.numpy(), model.body_inertia.numpy(), four_bar.centres(), poses, speeds,
        strict=True,
    )  # fmt: skip
    for m, inertia, centre, pose, speed in bodies:
        conjugate = np.append(-pose[3:6], pose[6])
        w = turned(conjugate, speed[3:])
        total += 0.5 * m * speed[:3] @ speed[:3] + 0.5 * w @ inertia @ w + m * GRAVITY * centre[2]
    return float(total)


def main() -> None:
    """Measure: ``script FOLDER --output FILE``."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--effort", type=float, default=1.0, help="of no use here")
    given = parser.parse_args()
    dt, rows = 1e-3, []
    for integrator, alpha in SETTINGS:
        four_bar = closed(given.folder, integrator, dt, alpha)
        before = energy(four_bar)
        four_bar.advance(round(1 / dt))
        rows.append(
            {
                "method": f"Kamino, {integrator}, alpha {alpha:g}",
                "centres": four_bar.centres().tolist(),
                "energy": abs(energy(four_bar) - before),
            }
        )
    found = {"version": version("newton"), "rows": rows}
    given.output.write_text(json.dumps(found), encoding="utf-8")


if __name__ == "__main__":
    main()
