"""Hard motions: at rest, too fast, too strong, slipping, stiff, in few iterations."""

from __future__ import annotations

import math

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.scene import Scene
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.integrators.dormand_prince import DormandPrince
from condyn_pin.simulation.integrators.radau import RadauIIA
from lab.extremes.base import (
    Case,
    Flight,
    Rng,
    ajar,
    by_reference,
    extreme,
    moving,
    one_joint,
    powers,
    sized,
    unit,
)

# Robots that stand still, with less and less to do.


@extreme(1.0, *powers(-1, -6, -1), 1e-8, 1e-10, 1e-12, 0.0)
def rest(severity: float, rng: Rng, scene: Scene) -> Case:
    """Share of the weight that no torque holds, at rest; at 1 nothing is held, at 0 all of it.

    At rest a is linear in tau - h, and so a share of that of the free fall.
    """
    q, _ = scene.sample(rng)
    still = np.zeros(scene.robot.nv)
    h = Equations(scene.robot.model, scene.bounds).terms(q, still).h
    falling = by_reference(scene, q, still, still)
    return Case(scene, q, still, (1.0 - severity) * h, (severity * falling,))


# Joints that turn faster and faster.


@extreme(0.0, 1.0, 1e1, 1e2, 1e3, 1e4, 1e6, 1e9)
def fast(severity: float, rng: Rng, scene: Scene) -> Case:
    """Speed of the fastest joint [rad/s, m/s]; forces grow with its square."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, sized(v, severity), tau)


# A free body that turns further and further within one step.


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


# Motors that are stronger and stronger.


@extreme(0.0, 1.0, 1e2, 1e4, 1e6, 1e8, 1e12, 1e16)
def strong(severity: float, rng: Rng, scene: Scene) -> Case:
    """Largest torque on a joint [N m, N]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, v, sized(tau, severity))


# Velocities that the constraints do not allow.


@extreme(0.0, *powers(-15, 2))
def slipping(severity: float, rng: Rng, scene: Scene) -> Case:
    """How fast each joint moves across the constraints [rad/s, m/s]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, v + severity * rng.normal(size=len(v)), tau)


# A limit on the iterations, from very many to one.


@extreme(1e4, 1e3, 1e2, 20.0, 10.0, 5.0, 3.0, 2.0, 1.0, 0.0)
def few_iterations(severity: float, rng: Rng, scene: Scene) -> Case:
    """How large the parameter max_iterations is."""
    return Case(scene, *moving(scene, rng), parameters={"max_iterations": round(severity)})


# A slider on a spring and a damper that only its torque function knows.


_DURATION, _SLIDER_DT = 0.05, 1e-3  # [s]


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

    flight = Flight(_DURATION, _SLIDER_DT, RadauIIA(2), q * math.exp(-s * _DURATION), 1e-5, torque)
    return Case(scene, q, -s * q, np.zeros(1), flight=flight)


# Drift control with larger and larger gains.


@extreme(0.0, *powers(0, 12))
def stiff_drift(severity: float, rng: Rng, scene: Scene) -> Case:
    """Gains alpha = beta of Baumgarte on loops that are open by 1e-7 [1/s]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, ajar(scene, q, rng), v, tau, drift=Baumgarte(severity, severity))
