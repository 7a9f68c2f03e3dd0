"""The manifold of configurations: how a velocity moves coordinates of a step.

During a step q = integrate(q0, theta), with theta in the tangent space at q0. There

    theta' = Jr(theta)^-1 v,

where Jr is the right Jacobian of the exponential map: the identity for revolute and prismatic
joints, and near it for free-flyers, balls and planes. Methods of an order above 2 need it.

References
----------
Munthe-Kaas. High order Runge-Kutta methods on manifolds. Applied Numerical Mathematics 29, 1999.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array

_FREE = "JointModelFreeFlyer"
_BALL = "JointModelSpherical"
_PLANE = "JointModelPlanar"

# x, y and the turn about z of a planar joint, among the six of a body.
_PLANAR = [0, 1, 5]


class Manifold:
    """The configurations of one model.

    Parameters
    ----------
    model : pin.Model

    Attributes
    ----------
    is_flat : bool
        Whether Jr is the identity everywhere.
    """

    def __init__(self, model: Any) -> None:
        self._curved = tuple(
            (joint.shortname(), slice(joint.idx_v, joint.idx_v + joint.nv))
            for joint in model.joints
            if joint.shortname() in (_FREE, _BALL, _PLANE)
        )
        self.is_flat = not self._curved

    def rate(self, theta: Array, v: Array) -> Array:
        """Return theta' = Jr(theta)^-1 v (nv,)."""
        if self.is_flat:
            return v
        rate = v.copy()
        for kind, part in self._curved:
            rate[part] = _rate(kind, theta[part], v[part])
        return rate


def _rate(kind: str, theta: Array, v: Array) -> Array:
    """Return the rate of one joint's coordinates."""
    if kind == _BALL:
        return np.asarray(pin.Jlog3(pin.exp3(theta)).dot(v))
    if kind == _FREE:
        return np.asarray(pin.Jlog6(pin.exp6(theta)).dot(v))
    twist, velocity = np.zeros((2, 6))
    twist[_PLANAR], velocity[_PLANAR] = theta, v
    return np.asarray(pin.Jlog6(pin.exp6(twist)).dot(velocity)[_PLANAR])
