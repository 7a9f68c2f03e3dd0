"""Points that are nearly one, taken further apart for Pinocchio's own methods.

Two balls between the same two bodies are a hinge about the line through them, however near they
are. At a distance d they leave the turns across the line an eigenvalue of about d^2 in G, which
rounding hides where d is a 1e-7th of the body. But any two points of the line are that hinge. So
Pinocchio has n points p' in place of p, k times as far from their middle on both bodies:

    p' = W p,      s' = W s,      lam = W^T lam',      W = 1 1^T / n + k (1 - 1 1^T / n).

The slip of a point is affine in the point, and rows of W add up to one. W has an inverse: the scene
is the same. And all forces that add up to nothing become k times smaller, so that those that bodies
bear among the points, which no motion tells, stay the least as well.
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
    """Return constraints in which no two points of the same bodies are nearly one.

    Points stay where they are if others of the same bodies are not near: those hold the turns.

    Parameters
    ----------
    natives : sequence of Native

    Returns
    -------
    natives : tuple of Native
        As many, in the same order.
    W : (m, m) array or None
        lam = W^T lam'; None where all are as before.
    """
    made = list(natives)
    starts = np.cumsum([0, *(native.size for native in natives)])
    W, changed = np.eye(starts[-1]), False
    for group in _groups(natives):
        points = [natives[i] for i in group]
        k = _times(points)
        if k is None:
            continue
        mean, changed = np.full((len(group), len(group)), 1.0 / len(group)), True
        weights = mean + k * (np.eye(len(group)) - mean)
        for i, point, row in zip(group, _moved(points, weights), weights, strict=True):
            made[i] = point
            for j, weight in zip(group, row, strict=True):
                turn = point.placement1.rotation.T @ natives[j].placement1.rotation
                W[starts[i] : starts[i] + 3, starts[j] : starts[j] + 3] = weight * turn
    return tuple(made), W if changed else None


def _groups(natives: Sequence[Native]) -> list[list[int]]:
    """Return the points of each two bodies, c1 on the one and c2 on the other.

    The axes of one c1 are those of another of its group, turned for good.
    """
    groups: dict[tuple[int, int, bool], list[int]] = {}
    for i, native in enumerate(natives):
        if native.size == 3:
            bodies = native.joint1, native.joint2, native.anchored
            groups.setdefault(bodies, []).append(i)
    return list(groups.values())


def _times(points: Sequence[Native]) -> float | None:
    """Return how many times as far apart points are to be; None where they are not nearly one."""
    p = np.array([point.placement1.translation for point in points])
    radius = float(np.linalg.norm(p - p.mean(axis=0), axis=1).max())
    lever = max(point.lever for point in points)
    return lever / radius if ONE * lever < radius < NEARLY * lever else None


def _moved(points: Sequence[Native], weights: Array) -> list[Native]:
    """Return the points p' = W p on both bodies, all with the axes of the first."""
    axes = points[0].placement1.rotation
    p1, p2 = (
        _combined(weights, np.array([getattr(point, end).translation for point in points]))
        for end in ("placement1", "placement2")
    )
    return [
        replace(
            points[i],
            placement1=pin.SE3(axes, p1[i]),
            placement2=pin.SE3(points[i].placement2.rotation, p2[i]),
        )
        for i in range(len(points))
    ]


def _combined(weights: Array, p: Array) -> Array:
    """Return W p, from differences to the first: they are exact where points are near."""
    return np.asarray(p[0] + weights @ (p - p[0]))
