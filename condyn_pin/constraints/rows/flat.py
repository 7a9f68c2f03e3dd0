"""Planar pins whose two bodies move in a plane: the shift along the pin's axis never changes.

With e the axis of the pin and T = J1 - X J2 the twist of body 1 past body 2, column by column, both
stay in the plane across e if no joint shifts one past the other along e, or turns it about another
axis:

    e . T_lin = 0,      e x T_ang = 0       for every column.

T is made of analytic functions of q: zero at a place of no special choice, zero everywhere.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.constraints.rows.cancellation import ROUNDED


def height_of(model: Any, b: Bound) -> float | None:
    """Return how far c2 is from c1 along the axis of a planar pin [m].

    None if that can change: the pin is one in space then.
    """
    data = model.createData()
    anywhere = np.random.default_rng(0).normal(size=model.nv)
    pin.computeJointJacobians(model, data, pin.integrate(model, pin.neutral(model), anywhere))
    c1Mc2 = (data.oMi[b.joint1] * b.placement1).actInv(data.oMi[b.joint2] * b.placement2)

    def twist(joint: int, placement: Any) -> Array:
        if joint == 0:
            return np.zeros((6, model.nv))
        # a single column comes as a vector
        return np.reshape(pin.getFrameJacobian(model, data, joint, placement, LOCAL), (6, -1))

    first, second = (
        twist(b.joint1, b.placement1),
        c1Mc2.toActionMatrix() @ twist(b.joint2, b.placement2),
    )
    off = [b.axis, *(3 + i for i in range(3) if i != b.axis)]  # e . T_lin and e x T_ang
    rounding = ROUNDED * (np.abs(first) + np.abs(second)).max(axis=0)
    stays = (np.abs(first - second)[off] <= rounding).all()
    return float(c1Mc2.translation[b.axis]) if stays else None
