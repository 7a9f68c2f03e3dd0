"""Rows that Pinocchio has itself, of points and of frames: J in one call, and gamma alone.

With the accelerations a1, a2 of the two ends at a = 0,

    point:  gamma = R1^T (a1 - a2)    classical, in the axes of the world
    frame:  gamma = a1                spatial, in its own axes; the other end is the world

`Equations.motion` finds the same with c and J v beside it, and where two bodies are welded.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.bound import POINT, Bound, PinocchioConstraint
from condyn_pin.constraints.rows.frames import rows_of

# bound once: these are called for every row
_classical = pin.getFrameClassicalAcceleration
_spatial = pin.getFrameAcceleration
_WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class PlainRows:
    """J and gamma of the points and frames of a scene; other rows are left as they are.

    `data` holds Jacobians of joints for `jacobian`, and forward kinematics with a = 0 for `gamma`.

    Attributes
    ----------
    rows : slice or array of int
        Which rows of J these are.
    are_all, have_gamma : bool
        Whether there are no others, and whether `gamma` is that of all rows.
    """

    def __init__(self, model: Any, data: Any, bounds: Sequence[AnyBound]) -> None:
        plain = [b for b in bounds if isinstance(b, Bound) and b.is_plain]
        self.rows, self.are_all = rows_of(plain), len(plain) == len(bounds)
        # a single column would come as a vector
        self._shape = sum(b.size for b in plain), model.nv
        models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for b in plain:
            made = PinocchioConstraint.of(b, b.size).to_pinocchio(model)
            models.append(made)
            datas.append(made.createData())
        self._jacobian = _pin.constraints_jacobian(model, data, models, datas)
        self.have_gamma = self.are_all and all(b.joint2 == 0 or b.selection == POINT for b in plain)
        gammas = plain if self.have_gamma else []
        self._gammas = [(b.rows, _gamma_of(model, data, b)) for b in gammas]

    def jacobian(self) -> Array:
        """Return the rows of J of these constraints."""
        if not self._shape[0]:
            return np.zeros(self._shape)
        return self._jacobian().reshape(self._shape)

    def gamma(self, out: Array) -> None:
        """Write gamma of these constraints into `out` (m,)."""
        for rows, gamma in self._gammas:
            out[rows] = gamma()


def _gamma_of(model: Any, data: Any, b: Bound) -> Callable[[], Array]:
    """Return what evaluates gamma of one constraint."""
    joint1, placement1, joint2, placement2 = b.joint1, b.placement1, b.joint2, b.placement2
    if joint2 == 0 and b.selection == POINT:
        return lambda: _classical(model, data, joint1, placement1, LOCAL).linear
    if joint2 == 0:
        return lambda: _spatial(model, data, joint1, placement1, LOCAL).vector
    oMi1 = data.oMi[joint1]

    def gamma() -> Array:
        one = _classical(model, data, joint1, placement1, _WORLD_AXES)
        two = _classical(model, data, joint2, placement2, _WORLD_AXES)
        return (one - two).linear.dot((oMi1 * placement1).rotation)  # type: ignore[no-any-return]

    return gamma
