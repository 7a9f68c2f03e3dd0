"""A held chain of rods that weigh next to nothing beside others of tons."""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.surface_contact import SurfaceContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, torques, with_inertias
from condyn_pin.lab.extremes.planar_chain import accelerations
from condyn_pin.model.mechanisms.base import rod
from condyn_pin.model.mechanisms.chain import chain
from condyn_pin.model.robot import Robot

_RODS, _HELD = 8, 3


@extreme(severities=(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0))
def wide_masses(severity: float, rng: np.random.Generator) -> Case:
    """Decades over which the masses of eight rods are spread, the third held four times over.

    A weld and two equal sliders hold its tip, 16 rows of rank 3. So the first three joints do not
    move, and the others are a chain of five, known to 50 digits.
    """
    masses = 10.0 ** (severity * (rng.permutation(_RODS) / (_RODS - 1) - 0.5))
    links = chain(_RODS)
    q = rng.normal(size=_RODS)
    data, tip = links.model.createData(), f"joint{_HELD - 1}_tip"
    pin.framesForwardKinematics(links.model, data, q)
    place = data.oMf[links.model.getFrameId(tip)]
    model = with_inertias(links.model, [links.model.inertias[0], *(rod(1.0, m) for m in masses)])
    robot = Robot("wide masses", model, postures={"held": q})
    robot = robot.with_frame("rail", "world", place.translation, place.rotation)
    sliders = [Loop(tip, "rail", "slider", axis="x", name=name) for name in ("one", "two")]
    scene = Scene(robot, [SurfaceContact(tip, name="weld"), *sliders])
    v = np.zeros(_RODS)
    v[_HELD:] = rng.normal(size=_RODS - _HELD)
    tau = torques(scene, rng)
    # the angle of the first rod of the rest is counted from the x axis
    outer = np.concatenate([[q[: _HELD + 1].sum()], q[_HELD + 1 :]])
    a = np.zeros(_RODS)
    a[_HELD:] = accelerations(outer, v[_HELD:], tau[_HELD:], masses[_HELD:].tolist())
    return Case(scene, q, v, tau, (a,))
