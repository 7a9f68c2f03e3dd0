"""Pivots of M: whether it is much closer to singular at a state than where a scene was measured.

    M = U D U^T,    U unit upper triangular

eliminates the tips of the tree first, so that D_j is the inertia that coordinate j feels while all
that it carries moves freely. That is at least what its own body and its armature have about its own
axis: where these are enough, D_j cannot fall, and nothing has to be looked at again. It falls where
links without inertia hold hinges in the place of a ball, and two of the axes meet.
"""

from __future__ import annotations

from math import isnan
from typing import Any, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import axes, turning
from condyn_pin._core.linalg import cholesky_pivots

# A pivot that cannot fall below this share of its nominal value is not watched: an estimate of the
# error that is too small by less than the inverse of it is within the margin of most answers.
_SHARE: Final = 1e-2


class MassPivots:
    """The pivots of a robot that may fall, to `least` at any q, from the `nominal` ones.

    `watched` are their numbers, and `nominal` those of them alone.
    """

    def __init__(self, least: Array, nominal: Array) -> None:
        self.watched = np.flatnonzero(~(least > _SHARE * nominal))
        self.nominal = nominal[self.watched]

    @property
    def may_fall(self) -> bool:
        """Whether there is any such pivot."""
        return bool(self.watched.size)

    def holds(self, bound: float, M: Array) -> bool:
        """Whether a bound from the nominal state is not worth another look in M (nv, nv)."""
        return bound <= tolerances.SOLVED * self.left(M)

    def left(self, M: Array) -> float:
        """Return what is left of them in M (nv, nv), the least of their shares of the nominal ones.

        Accelerations are off by 1 over it times what an estimate at the nominal state says.
        """
        shares = (cholesky_pivots(M).take(self.watched) / self.nominal).tolist()
        least: float = min([*shares, 1.0])  # of nothing but NaN, or of none
        return 0.0 if isnan(least) else least


def least_pivots(model: Any) -> Array:
    """Return what the pivots are at least, at any q (nv,): zero where axes turn with q."""
    q, found, turn = pin.neutral(model), np.zeros(model.nv), turning(model)
    for i in range(1, model.njoints):
        joint = model.joints[i]
        if joint.nv <= 0 or joint.idx_v < 0 or i in turn:
            continue
        its = slice(joint.idx_v, joint.idx_v + joint.nv)
        S = axes(joint, q)
        own = S.T @ model.inertias[i].matrix() @ S + np.diag(model.armature[its])
        found[its] = np.nan_to_num(cholesky_pivots(own))
    return found
