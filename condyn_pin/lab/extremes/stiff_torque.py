"""A slider on a spring and a damper that only its torque function knows."""

import math

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Flight, Rng, extreme, one_joint
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.integrators.radau import RadauIIA

_DURATION, _DT = 0.05, 1e-3  # [s]


@extreme(1.0, 1e2, 1e4, 1e5, 8e5, 1e7, 1e9, 1e12)
def stiff_torque(severity: float, rng: Rng) -> Case:
    """Stiffness of a user's torque -k x - c v on 1 kg, c = 2 k^1/2 + k / 20, Radau IIA [N/m].

    It starts on the slow one of its two motions, x = x0 exp(-s t), s = 2 k / (c + (c^2 - 4 k)^1/2).
    """
    k = severity
    c = 2.0 * math.sqrt(k) + k / 20.0
    s = 2.0 * k / (c + math.sqrt(c * c - 4.0 * k))
    body = pin.Inertia(1.0, np.zeros(3), np.eye(3))
    scene = Scene(Robot("slider", one_joint("slider", pin.JointModelPX(), body)))
    q = rng.uniform(0.05, 0.15, size=1)

    def torque(t: float, q: Array, v: Array) -> Array:
        return -k * q - c * v

    flight = Flight(_DURATION, _DT, RadauIIA(2), q * math.exp(-s * _DURATION), 1e-5, torque)
    return Case(scene, q, -s * q, np.zeros(1), flight=flight)
