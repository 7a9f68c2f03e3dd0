"""A free body that turns further and further within one step."""

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Flight, Rng, extreme, one_joint, unit
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.integrators.dormand_prince import DormandPrince

_DT = 0.4  # [s]
_ACROSS, _ALONG = 0.3, 0.2  # moments of inertia of a symmetric top [kg m^2]


@extreme(0.0, 0.01, 0.1, 1.0, 3.0, 3.3, 6.0, 6.5, 10.0, 30.0, 100.0)
def fast_spins(severity: float, rng: Rng) -> Case:
    """Angle that a free symmetric top turns by within one step of 0.4 s, Dormand-Prince [rad].

    With L its angular momentum, and e its axis, it turns as two turns that are each constant:

        R(t) = exp(L t / I_across) R(0) exp(e w_e (1 - I_along / I_across) t).
    """
    moments = np.array([_ACROSS, _ACROSS, _ALONG])
    body = pin.Inertia(2.0, np.zeros(3), np.diag(moments))
    model = one_joint("top", pin.JointModelFreeFlyer(), body)
    model.gravity = pin.Motion.Zero()
    v = np.zeros(6)
    v[3:] = severity / _DT * unit(rng)
    R, duration = pin.exp3(rng.normal(size=3)), 2.0 * _DT
    about_L = pin.exp3(R @ (moments * v[3:]) * duration / _ACROSS)
    about_e = pin.exp3(np.array([0.0, 0.0, v[5] * (1.0 - _ALONG / _ACROSS) * duration]))
    end = _standing(about_L @ R @ about_e)
    flight = Flight(duration, _DT, DormandPrince(1e-10, 1e-10), end, 1e-6)
    return Case(Scene(Robot("top", model)), _standing(R), v, np.zeros(6), flight=flight)


def _standing(R: Array) -> Array:
    return np.asarray(pin.SE3ToXYZQUAT(pin.SE3(R, np.zeros(3))))
