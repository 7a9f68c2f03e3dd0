"""MuJoCo: contacts that give way, by a convex problem.

It has no restitution. A contact that swings is as near as it comes: with the damping ratio
zeta = -ln(e) / sqrt(pi^2 + ln(e)^2) a body leaves it with e of its speed. It is as stiff as ten
steps resolve the half of a swing, pi / w, where w = 1 / (timeconst zeta).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log, pi, sqrt

import mujoco
import numpy as np

from peers.contact.harness import Played, Way, main, played
from peers.contact.scene import ContactScene


@dataclass(frozen=True)
class Softness:
    """Options of MuJoCo's contacts."""

    title: str
    timeconst: float = 0.02  # [s], no less than two steps
    impedance: float | None = None  # both ends of solimp; None: 0.9 ... 0.95
    elliptic: bool = False
    impratio: float = 1.0


RESOLVED = 10  # steps of half a swing

REFERENCE = Softness("default")
SETTINGS = (
    REFERENCE,
    Softness("elliptic", elliptic=True),
    Softness("elliptic, impratio 10", elliptic=True, impratio=10.0),
    Softness("elliptic, solref .002, solimp .9999", 0.002, 0.9999, elliptic=True),
    Softness("elliptic, solref .01, solimp .99", 0.01, 0.99, elliptic=True),
)


def ways(scene: ContactScene) -> list[Way]:
    """Return all settings at all steps; solref is two steps at least."""
    return [way(scene, setting, dt) for setting in SETTINGS for dt in scene.steps]


def way(scene: ContactScene, setting: Softness, dt: float) -> Way:
    """Return a setting."""
    model = mujoco.MjModel.from_xml_path(str(scene.model))
    model.opt.timestep, model.opt.impratio = dt, setting.impratio
    model.opt.cone = int(setting.elliptic)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.geom_solref[:, 0] = max(setting.timeconst, 2 * dt)
    if setting.impedance:
        model.geom_solimp[:, :2] = setting.impedance
    if scene.restitution:
        e = log(scene.restitution)
        zeta = -e / sqrt(pi**2 + e**2)
        swing = RESOLVED * dt / (pi * zeta)
        model.geom_solref[:] = max(setting.timeconst, swing), zeta
    data = mujoco.MjData(model)
    bodies = [model.body(name).id for name in scene.bodies]

    def play() -> Played:
        mujoco.mj_resetDataKeyframe(model, data, 0)
        return played(scene, dt, advance, centres)

    def advance(count: int) -> None:
        mujoco.mj_step(model, data, count)

    def centres() -> np.ndarray:
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        return np.array(data.xipos[bodies])

    return Way(setting.title, dt, play)


if __name__ == "__main__":
    main("MuJoCo", mujoco.__version__, ways)
