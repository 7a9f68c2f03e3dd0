"""Cassie with rods that spin about themselves, on states further and further from standing."""

from condyn_pin.dynamics.scene import motor_torque
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, Rng, closed, extreme


@extreme(0.0, 1e-3, 1e-2, 5e-2, 1e-1, 2e-1, 3e-1)
def spinning_rods(severity: float, rng: Rng) -> Case:
    """How far each joint of Cassie is from standing, loops as in her file, springs locked [rad, m].

    Her rods have balls at both ends there: each is free to spin, with an inertia of 1e-6 kg m^2.
    """
    cassie = load_robot("cassie", variant={"springs": "locked", "achilles": "as_file"})
    scene = closed(cassie)
    q, v = scene.sample(rng, spread=severity)
    return Case(scene, q, v, motor_torque(cassie, rng))
