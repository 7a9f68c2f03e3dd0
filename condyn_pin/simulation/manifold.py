"""The manifold of configurations: how a velocity moves coordinates of a step.

During a step q = integrate(q0, theta), with theta in the tangent space at q0. There

    theta' = Jr(theta)^-1 v,

where Jr is the right Jacobian of the exponential map: the identity for revolute and prismatic
joints, and near it for free-flyers, balls and planes. Methods of an order above 2 need it.

Coordinates are those of one chart, which ends where a free-flyer, a ball or a plane has turned by
pi: the same rotation has other coordinates then.

References
----------
Munthe-Kaas. High order Runge-Kutta methods on manifolds. Applied Numerical Mathematics 29, 1999.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array

# Joints whose velocities do not commute, and which of their coordinates turn.
_CURVED = {
    "JointModelFreeFlyer": (3, 4, 5),
    "JointModelSpherical": (0, 1, 2),
    "JointModelPlanar": (2,),
}


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
        self._model, self._origin = model, pin.neutral(model)
        self._turns = {
            model.names[i]: [joint.idx_v + k for k in _CURVED[joint.shortname()]]
            for i, joint in enumerate(model.joints)
            if joint.shortname() in _CURVED
        }
        self.is_flat = not self._turns

    def turn(self, theta: Array) -> float:
        """Return the angle of the largest rotation in theta [rad], of those that make it curved."""
        return self.largest_turn(theta)[1]

    def largest_turn(self, theta: Array) -> tuple[str, float]:
        """Return which joint that is, and its angle [rad]."""
        largest = "", 0.0
        for name, at in self._turns.items():
            angle = float(np.linalg.norm(theta[at]))
            if angle > largest[1]:
                largest = name, angle
        return largest

    def rate(self, theta: Array, v: Array) -> Array:
        """Return theta' = Jr(theta)^-1 v (nv,)."""
        if self.is_flat:
            return v
        # Jr^-1 is the derivative of difference(q0, q) by q, whatever q0 is
        moved = pin.integrate(self._model, self._origin, theta)
        Jr_inv = pin.dDifference(self._model, self._origin, moved, pin.ARG1)
        return np.asarray(Jr_inv.dot(v))
