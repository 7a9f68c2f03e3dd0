"""What Pinocchio's own methods take: constraints of 3 and of 6 rows.

A kind with other rows is handed to them as an equivalent of such rows, where there is one. A hinge
about the axis e is two points on it, at d and -d with d = lever e; their slips are those of the
hinge by

    s(d) = s_xyz + s_rxryrz x d = E s,      and so      lam = E^T lam_native.

The equivalent has 6 rows of rank 5. A slider, a planar pin, a rod, a plane, a coupling, a blade and
what rolls have none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.rows.bound import AnyBound, Bound
from condyn_pin.rows.native import Native
from condyn_pin.rows.spread import spread


@dataclass(frozen=True, eq=False)
class Natives:
    """The constraints of a scene as Pinocchio takes them.

    Attributes
    ----------
    constraints : tuple of Native
    to_scene : (m, m_native) array or None
        E^T with the signs of the scene: lam from Pinocchio's; None where they are the same.
    imitated : tuple of str
        Names of constraints that take several of Pinocchio's, with a row too many.
    missing : tuple of str
        Names of constraints without an equivalent.
    """

    constraints: tuple[Native, ...]
    to_scene: Array | None
    imitated: tuple[str, ...]
    missing: tuple[str, ...]


def natives(bounds: Sequence[AnyBound], rows: Callable[[], Array]) -> Natives:
    """Return the constraints of a scene as Pinocchio takes them.

    Parameters
    ----------
    bounds : sequence of AnyBound
    rows : callable
        Returns the Jacobian of the scene at its nominal state in the metric of M, J L^-T (m, nv).
    """
    made: list[Native] = []
    blocks: list[Array] = []
    imitated: list[str] = []
    missing: list[str] = []
    for bound in bounds:
        if isinstance(bound, Bound) and bound.is_plain:
            made.append(_native(bound, bound.size, np.zeros(3)))
            blocks.append(bound.sign * np.eye(bound.size))
        elif isinstance(bound, Bound) and bound.is_hinge:
            ends = bound.lever * np.array([1.0, -1.0])[:, None] * np.eye(3)[bound.axis]
            made.extend(_native(bound, 3, d) for d in ends)
            E = np.vstack([np.hstack([np.eye(3), -pin.skew(d)]) for d in ends])
            blocks.append(bound.sign * E[:, list(bound.selection)].T)
            imitated.append(bound.name)
        else:
            missing.append(bound.name)
            blocks.append(np.zeros((bound.size, 0)))
    blocked = _block_diagonal(blocks)
    constraints, W = spread(made, lambda: blocked.T @ rows())
    to_scene = blocked if W is None else blocked @ W.T
    same = to_scene.shape[0] == to_scene.shape[1] and (to_scene == np.eye(len(to_scene))).all()
    return Natives(constraints, None if same else to_scene, tuple(imitated), tuple(missing))


def _native(bound: Bound, size: int, d: Array) -> Native:
    shift = pin.SE3(np.eye(3), d)
    # where a contact is unanchored, c2 is not looked at
    return Native(
        bound.name if size == bound.size else f"{bound.name}{'+' if d.sum() > 0 else '-'}",
        size,
        bound.joint1,
        bound.placement1 * shift,
        bound.joint2,
        bound.placement2 * shift,
        bound.anchored,
        bound.lever,
    )


def _block_diagonal(blocks: Sequence[Array]) -> Array:
    rows, columns = (sum(block.shape[i] for block in blocks) for i in (0, 1))
    matrix = np.zeros((rows, columns))
    row = column = 0
    for block in blocks:
        height, width = block.shape
        matrix[row : row + height, column : column + width] = block
        row, column = row + height, column + width
    return matrix
