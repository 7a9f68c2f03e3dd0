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

from functools import cached_property
from math import pi
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.errors import StepFailed

# Joints whose velocities do not commute, and which of their coordinates turn.
_CURVED = {
    "JointModelFreeFlyer": (3, 4, 5),
    "JointModelSpherical": (0, 1, 2),
    "JointModelPlanar": (2,),
}


class Manifold:
    """The configurations of one model: flat where Jr is the identity everywhere."""

    def __init__(self, model: Any) -> None:
        self._model, self.origin = model, pin.neutral(model)
        self._turns = {
            model.names[i]: [joint.idx_v + k for k in _CURVED[joint.shortname()]]
            for i, joint in enumerate(model.joints)
            if joint.shortname() in _CURVED
        }
        self.is_flat = not self._turns

    def largest_turn(self, theta: Array) -> tuple[str, float]:
        """Return which of the curved joints turns furthest in theta, and by what angle [rad]."""
        largest = "", 0.0
        for name, at in self._turns.items():
            angle = float(np.linalg.norm(theta[at]))
            if angle > largest[1]:
                largest = name, angle
        return largest

    def slow(self, dt: float) -> float | None:
        """Return the v^T v below which no step of dt leaves its chart; None if there is no end."""
        return None if self.is_flat else (pi / dt) ** 2

    def check_turn(self, v: Array, dt: float) -> None:
        """Refuse a step of dt in which a body turns further than one chart goes."""
        joint, speed = self.largest_turn(v)
        if speed * dt > pi:
            raise StepFailed(
                f"joint {joint!r} turns by {speed * dt:.3g} rad in a step of {dt:.3g} s, and the "
                f"coordinates of a step end at pi: take dt below {pi / speed:.2g} s, better a "
                "tenth of that, or DormandPrince(), which takes smaller steps where it must"
            )

    @cached_property
    def reach(self) -> float:
        """How far joints may be from the world's origin, all shifts at zero [m], at most."""
        placements = self._model.jointPlacements
        return sum(float(np.abs(p.translation).max()) for p in placements)
