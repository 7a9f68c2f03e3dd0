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

# Joints whose velocities do not commute.
_CURVED = ("JointModelFreeFlyer", "JointModelSpherical", "JointModelPlanar")


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
        self.is_flat = all(joint.shortname() not in _CURVED for joint in model.joints)

    def rate(self, theta: Array, v: Array) -> Array:
        """Return theta' = Jr(theta)^-1 v (nv,)."""
        if self.is_flat:
            return v
        # Jr^-1 is the derivative of difference(q0, q) by q, whatever q0 is
        moved = pin.integrate(self._model, self._origin, theta)
        Jr_inv = pin.dDifference(self._model, self._origin, moved, pin.ARG1)
        return np.asarray(Jr_inv.dot(v))
