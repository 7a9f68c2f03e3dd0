"""A held chain of rods that weigh next to nothing beside others of tons."""

import numpy as np

from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.surface_contact import SurfaceContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, frame_at, rods, torques
from condyn_pin.lab.extremes.planar_chain import accelerations
from condyn_pin.model.robot import Robot

_RODS, _HELD = 8, 3


@extreme(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
def wide_masses(severity: float, rng: Rng) -> Case:
    """Decades over which the masses of eight rods are spread, the third held four times over.

    A weld and two equal sliders hold its tip, 16 rows of rank 3. So the first three joints do not
    move, and the others are a chain of five, known to 50 digits.
    """
    masses = 10.0 ** (severity * (rng.permutation(_RODS) / (_RODS - 1) - 0.5))
    q, tip = rng.normal(size=_RODS), f"joint{_HELD - 1}_tip"
    robot = Robot("wide masses", rods(masses.tolist()).model, postures={"held": q})
    place = frame_at(robot, q, tip)
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
