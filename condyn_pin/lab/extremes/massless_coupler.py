"""A four-bar whose coupler weighs less and less."""

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, closed, extreme, with_inertias
from condyn_pin.model.mechanisms.base import rod
from condyn_pin.model.mechanisms.four_bar import four_bar
from condyn_pin.model.robot import Robot

_CRANK, _COUPLER, _ROCKER, _DENSITY, _GRAVITY = 0.3, 0.8, 0.6, 2.5, 9.81


@extreme(1.0, 1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 1e-13, 1e-15, 1e-30, 1e-300, 0.0)
def massless_coupler(severity: float, rng: Rng) -> Case:
    """Mass of the coupler of a four-bar, which ends one side of its loop [kg].

    Without mass M is singular, and the linkage moves like any other: crank and rocker hold it.
    """
    linkage = four_bar(crank=_CRANK, coupler=_COUPLER, rocker=_ROCKER, density=_DENSITY)
    q, v = closed(linkage).sample(rng)
    tau = rng.normal(size=3)
    inertias = list(linkage.model.inertias)
    inertias[2] = rod(_COUPLER, severity)
    light = Robot("light four-bar", with_inertias(linkage.model, inertias), linkage.postures)
    return Case(Scene(light, linkage.loops), q, v, tau, (_right(q, v, tau, severity),))


def _right(q: Array, v: Array, tau: Array, mass: float) -> Array:
    """Return q'' from the one equation of motion, with the mass of the coupler.

    In the angles of the rods to the ground, M theta'' + h = torques + J^T lam; the loop gives
    theta'' = t alpha + b, with t their rates per turn of the crank, and so

        t^T M t alpha = t^T (torques - h - M b).
    """
    theta, omega = np.array([q[0], q[0] + q[1], q[2]]), np.array([v[0], v[0] + v[1], v[2]])
    along, across = (np.array(f(theta)) for f in (np.cos, np.sin))
    lengths = np.array([_CRANK, _COUPLER, -_ROCKER])  # round the loop
    J = lengths * np.array([-across, along])
    centripetal = lengths * omega**2 @ np.array([along, across]).T
    t = np.array([1.0, *np.linalg.solve(J[:, 1:], -J[:, 0])])
    b = np.array([0.0, *np.linalg.solve(J[:, 1:], centripetal)])
    crank, rocker = _DENSITY * _CRANK, _DENSITY * _ROCKER
    M = np.diag([(crank / 3 + mass) * _CRANK**2, mass * _COUPLER**2 / 3, rocker * _ROCKER**2 / 3])
    between = mass * _CRANK * _COUPLER / 2
    M[0, 1] = M[1, 0] = between * np.cos(theta[0] - theta[1])
    levers = np.array([(crank / 2 + mass) * _CRANK, mass * _COUPLER / 2, rocker * _ROCKER / 2])
    turning = between * np.sin(theta[0] - theta[1])
    h = _GRAVITY * levers * along + turning * np.array([omega[1] ** 2, -(omega[0] ** 2), 0.0])
    torques = np.array([tau[0] - tau[1], tau[1], tau[2]])
    alpha = t @ (torques - h - M @ b) / (t @ M @ t)
    a = alpha * t + b
    return np.array([a[0], a[1] - a[0], a[2]])
