"""How the two ends of many constraints move, all at once: velocities, accelerations, partials.

`pin.computeRNEADerivatives` leaves a column a joint coordinate, linear part at the world's origin:
J, dV, dA and dA_v, what v and q do to the velocity and the acceleration of every body that moves
with it. In the axes of a frame with the placement (R, p), a motion (lin, ang) is

    R^T (lin + ang x p),    R^T ang

and as those axes turn with the body, its acceleration changes by dA - v x dV with q, and by
dA_v - v x J with v.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.partials.formulas import End, Frames
from condyn_pin.constraints.partials.relative_motion import spatial_cross
from condyn_pin.constraints.rows.any_bound import OnFrames
from condyn_pin.constraints.rows.ends import Ends
from condyn_pin.constraints.rows.frames import Joints
from condyn_pin.constraints.rows.rolling import skews


class At(NamedTuple):
    """The ends of k constraints at one state."""

    one: End
    two: End
    X: Array  # (k, 6, 6), motions in the axes of c2 to those of c1
    R: Array  # (k, 3, 3), c1Mc2
    r: Array  # (k, 3)


class EndPartials:
    """The ends of all constraints between two frames in one scene."""

    def __init__(self, frames: Frames, bounds: Sequence[OnFrames]) -> None:
        data, n, k = frames.data, frames.nv, len(bounds)
        left = data.J, data.dJ, data.dAdq, data.dAdv
        self._left = tuple(part.reshape(6, n) for part in left)
        self._ends = Ends(data, bounds)
        ends = [(b.joint1, b.placement1) for b in bounds]
        ends += [(b.joint2, b.placement2) for b in bounds]
        self._joints = Joints(data, {joint for joint, _ in ends})
        maps = np.stack(self._joints.maps(ends), axis=1)  # (6 k, 2, size): linear, angular
        self._six = maps.reshape(2 * k, 3, 2, -1).swapaxes(1, 2).reshape(12 * k, -1)
        self._moved = np.array([frames.moves(joint) for joint, _ in ends])[:, None, None]
        self._columns = np.zeros((6, 4, n))  # v_q, J, a_q and a_v
        self._X = np.zeros((2 * k, 6, 6))

    def evaluate(self) -> At:
        """Return the ends, from what Newton-Euler's derivatives have left."""
        (J, dJ, A_q, A_v), columns, X = self._left, self._columns, self._X
        columns[:, 0], columns[:, 1], columns[:, 2], columns[:, 3] = A_v - dJ, J, A_q, A_v
        E = self._ends.placements().reshape(-1, 4, 3)
        axes, n = E[:, :3], columns.shape[2]
        X[:, :3, :3] = X[:, 3:, 3:] = axes
        X[:, :3, 3:] = -axes @ skews(E[:, 3])
        parts = X.reshape(-1, 6).dot(columns.reshape(6, -1)).reshape(-1, 6, 4, n)
        parts *= self._moved
        v, a = self._six.dot(self._joints.read().T).T.reshape(2, -1, 6)
        # the axes turn with the frame
        turned = spatial_cross(v) @ parts[:, :, :2].reshape(-1, 6, 2 * n)
        parts[:, :, 2:] -= turned.reshape(-1, 6, 2, n)
        k = len(X) // 2
        one, two = (
            End(v[half], a[half], v_q=of[:, :, 0], a_q=of[:, :, 2], a_v=of[:, :, 3], J=of[:, :, 1])
            for half, of in ((slice(k), parts[:k]), (slice(k, None), parts[k:]))
        )
        R = axes[:k] @ axes[k:].swapaxes(1, 2)
        r = (axes[:k] @ (E[k:, 3] - E[:k, 3])[:, :, None])[:, :, 0]
        between = np.zeros((k, 6, 6))
        between[:, :3, :3] = between[:, 3:, 3:] = R
        between[:, :3, 3:] = skews(r) @ R
        return At(one, two, between, R, r)
