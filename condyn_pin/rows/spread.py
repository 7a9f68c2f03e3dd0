"""Points that are nearly one, taken further apart for Pinocchio's own methods.

Two balls between the same two bodies are a hinge about the line through them, however near they
are. At a distance d they leave the turns across it an eigenvalue of about d^2 in G, which rounding
hides where d is a 1e-7th of the body. But the line can be had from other points of it. Weights of a
row of W that add up to one make points of a body one of its points again, and their slips its slip:

    p' = W p,      s' = W s,      lam = W^T lam',      W = 1 1^T / n + k (1 - 1 1^T / n).

W keeps the middle of n points and takes them k times as far from it. It has an inverse, so that the
scene is the same; and as it is symmetric, forces along the line are shared as before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.rows.native import Native

# Distance from their middle, as a share of the lever, at which points are nearly one. At 1e-2 they
# leave 1e-4 in G, and so twelve digits. Below 1e-9 rounding of the placements alone, eps |p|, turns
# the line through them by 1e-7, and on each body by another: there is no line to be had.
NEARLY: Final = 1e-2
ONE: Final = 1e-9


def spread(natives: Sequence[Native]) -> tuple[tuple[Native, ...], Array | None]:
    """Return constraints in which no points of two bodies are nearly one, and lam = W^T lam'.

    Points are left where they are if others of the same bodies are not near; they hold the turns.

    Parameters
    ----------
    natives : sequence of Native

    Returns
    -------
    natives : tuple of Native
        As many, in the same order.
    W : (m, m) array or None
        None where all are as before.

    Notes
    -----
    Groups are points with c1 on the same body, and c2 on the same: the axes of one c1 are then
    those of another, turned for good.
    """
    groups: dict[tuple[int, int, bool], list[int]] = {}
    for i, native in enumerate(natives):
        if native.size == 3:
            key = native.joint1, native.joint2, native.anchored
            groups.setdefault(key, []).append(i)
    starts = np.cumsum([0, *(native.size for native in natives)])
    made, W = list(natives), np.eye(starts[-1])
    for group in groups.values():
        points = [natives[i] for i in group]
        if (k := _factor(points)) == 1.0:
            continue
        weights = _weights(len(points), k)
        for i, moved in zip(group, _moved(points, weights), strict=True):
            made[i] = moved
        axes = points[0].placement1.rotation.T
        for i, row in zip(group, weights, strict=True):
            for j, weight in zip(group, row, strict=True):
                turned = axes @ natives[j].placement1.rotation
                W[starts[i] : starts[i] + 3, starts[j] : starts[j] + 3] = weight * turned
    changed = any(new is not old for new, old in zip(made, natives, strict=True))
    return tuple(made), W if changed else None


def _weights(n: int, k: float) -> Array:
    """Return 1 1^T / n + k (1 - 1 1^T / n)."""
    mean = np.full((n, n), 1.0 / n)
    return np.asarray(mean + k * (np.eye(n) - mean))


def _factor(points: Sequence[Native]) -> float:
    """Return how many times as far apart points should be: 1 where they are not nearly one."""
    one = np.array([p.placement1.translation for p in points])
    radius = float(np.linalg.norm(one - one.mean(axis=0), axis=1).max())
    lever = max(p.lever for p in points)
    return lever / radius if ONE * lever < radius < NEARLY * lever else 1.0


def _moved(points: Sequence[Native], weights: Array) -> list[Native]:
    """Return the points p' = W p on both bodies, all with the axes of the first."""
    axes = points[0].placement1.rotation
    ends = [
        np.array([getattr(p, end).translation for p in points])
        for end in ("placement1", "placement2")
    ]
    moved1, moved2 = (_combined(weights, p) for p in ends)
    return [
        replace(
            point,
            placement1=pin.SE3(axes, p1),
            placement2=pin.SE3(point.placement2.rotation, p2),
        )
        for point, p1, p2 in zip(points, moved1, moved2, strict=True)
    ]


def _combined(weights: Array, p: Array) -> Array:
    """Return W p, from differences to the first: they are exact where points are near."""
    return np.asarray(p[0] + weights @ (p - p[0]))
