"""The frames of a model with their partials, from what Pinocchio's derivatives left in its data."""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.partials.formulas import End
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.constraints.rows.related import Related


class Frames:
    """The frames that constraints hold.

    Parameters
    ----------
    model : pin.Model
    data : pin.Data
        Holds `oMi`, and for all but `between` what derivatives of frames read.
    """

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self.data = model, data
        self._world = End(*np.zeros((2, 6)), *np.zeros((4, 6, model.nv)))

    def between(self, b: Bound | Related) -> Any:
        """Return c1Mc2."""
        oMi = self.data.oMi
        return (oMi[b.joint1] * b.placement1).actInv(oMi[b.joint2] * b.placement2)

    def ends(self, b: Bound | Related) -> tuple[End, End]:
        """Return c1 and c2."""
        return self.end(b.joint1, b.placement1), self.end(b.joint2, b.placement2)

    def end(self, joint: int, placement: Any) -> End:
        """Return a frame on a joint as the end of a constraint."""
        if joint == 0:
            return self._world
        v, a = placement.actInv(self.data.v[joint]), placement.actInv(self.data.a[joint])
        return End(v.vector, a.vector, *self.partials(joint, placement))

    def partials(self, joint: int, placement: Any) -> tuple[Array, Array, Array, Array]:
        """Return v_q, a_q, a_v and J of a frame on a joint."""
        found: tuple[Array, Array, Array, Array] = pin.getFrameAccelerationDerivatives(
            self._model, self.data, joint, placement, LOCAL
        )
        if self._model.nv > 1:
            return found
        v_q, a_q, a_v, J = (part.reshape(6, 1) for part in found)  # Pinocchio gives vectors
        return v_q, a_q, a_v, J
