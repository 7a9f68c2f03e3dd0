"""Points that are nearly one, taken further apart for Pinocchio's own methods.

Two balls between the same two bodies are a hinge about the line through them, however near they
are. At a distance d they leave the turns across the line an eigenvalue of about d^2 in G, which
rounding hides where d is a 1e-7th of the body. But any two points of the line are that hinge. So
Pinocchio has n points p' in place of p, k times as far from their middle on both bodies:

    p' = W p,      s' = W s,      lam = W^T lam',      W = 1 1^T / n + k (1 - 1 1^T / n).

The velocity of a point is affine in the point, and rows of W add up to one. W has an inverse: the
scene is the same. Forces along the line, which no motion tells, are shared as before.

Points stay where they are if others hold the turns that they hold, as a weld between the same two
bodies does. Those rows are then redundant, and far apart they would contradict the others by k
times as much rounding, and bear k times as much among themselves. Of points that hold one turn with
others and another alone the second is what counts: a is right, and lam need not be the smallest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import PinocchioConstraint

# Distance from their middle, as a share of the lever, at which points are nearly one. At 1e-2 they
# leave 1e-4 in G, and so twelve digits. Below 1e-9 rounding of the placements alone, eps |p|, turns
# the line through them by 1e-7, and on each body by another: there is no line to be had.
NEARLY: Final = 1e-2
ONE: Final = 1e-9

# The distance to which they are taken apart. Further, and what a state leaves open between them
# would count for more, and contradict the others.
_APART: Final = 0.1

# Singular value of rows, relative to the largest, that counts as zero: above rounding.
_NONE: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Cluster:
    """Points of the same two bodies that are nearly one.

    c1 of all is on the same body, and c2: so their axes are those of the first, turned for good.
    They are to be k times as far apart. `places` and `rows` (3 n,) are theirs among all constraints
    and rows.
    """

    places: tuple[int, ...]
    rows: NDArray[np.intp]
    points: tuple[PinocchioConstraint, ...]
    k: float

    @cached_property
    def weights(self) -> Array:
        """1 1^T / n + k (1 - 1 1^T / n), (n, n)."""
        n = len(self.points)
        mean = np.full((n, n), 1.0 / n)
        return np.asarray(mean + self.k * (np.eye(n) - mean))

    @cached_property
    def W(self) -> Array:
        """The same for rows (3 n, 3 n), to the axes of the first point from those of each."""
        axes = self.points[0].placement1.rotation.T
        turns = [axes @ point.placement1.rotation for point in self.points]
        return np.block([[w * R for w, R in zip(row, turns, strict=True)] for row in self.weights])

    def moved(self) -> list[PinocchioConstraint]:
        """Return the points p' = W p on both bodies."""
        axes = self.points[0].placement1.rotation
        return [
            replace(point, placement1=pin.SE3(axes, p1), placement2=pin.SE3(axes, p2))
            for point, p1, p2 in zip(
                self.points, self._moved("placement1"), self._moved("placement2"), strict=True
            )
        ]

    def _moved(self, end: str) -> Array:
        """Return p' from differences to the first point: they are exact where points are near."""
        p = np.array([getattr(point, end).translation for point in self.points])
        return np.asarray(p[0] + self.weights @ (p - p[0]))


def spread(
    pinocchio_constraints: Sequence[PinocchioConstraint], rows: Callable[[], Array]
) -> tuple[tuple[PinocchioConstraint, ...], Array | None]:
    """Return constraints in which no two points are nearly one that alone hold a turn.

    `rows` returns their Jacobian at the nominal state in the metric of M, J L^-T (m, nv); it is
    called where points are nearly one. Beside as many constraints comes W (m, m), with lam = W^T
    lam', or None where all are as before.
    """
    clusters = _clusters(pinocchio_constraints)
    if not clusters:
        return tuple(pinocchio_constraints), None
    made, J = list(pinocchio_constraints), rows()
    W, needed = np.eye(len(J)), _needed(clusters, J)
    for cluster in needed:
        W[np.ix_(cluster.rows, cluster.rows)] = cluster.W
        for i, point in zip(cluster.places, cluster.moved(), strict=True):
            made[i] = point
    return tuple(made), W if needed else None


def _clusters(pinocchio_constraints: Sequence[PinocchioConstraint]) -> list[Cluster]:
    """Return the points that are nearly one, if no others of their two bodies are far from them."""
    groups: dict[tuple[int, int, bool], list[int]] = {}
    for i, native in enumerate(pinocchio_constraints):
        if native.size == 3:
            bodies = native.joint1, native.joint2, native.anchored
            groups.setdefault(bodies, []).append(i)
    found = []
    for places in groups.values():
        if len(places) == 1:
            continue
        points = tuple(pinocchio_constraints[i] for i in places)
        p = np.array([point.placement1.translation for point in points])
        radius = float(np.linalg.norm(p - p.mean(axis=0), axis=1).max())
        lever = max(point.lever for point in points)
        if ONE * lever < radius < NEARLY * lever:
            ends = np.cumsum([native.size for native in pinocchio_constraints])
            rows = np.concatenate([ends[i] + np.arange(-3, 0) for i in places])
            found.append(Cluster(tuple(places), rows, points, _APART * lever / radius))
    return found


def _needed(clusters: Sequence[Cluster], J: Array) -> list[Cluster]:
    """Return the clusters that hold a turn that neither other rows nor clusters before them do."""
    held, turns = np.delete(J, np.concatenate([c.rows for c in clusters]), axis=0), []
    for cluster in clusters:
        moves = (cluster.W @ J[cluster.rows]).reshape(len(cluster.points), 3, -1)
        middle = moves.mean(axis=0)
        held = np.vstack([held, middle])
        turns.append((moves - middle).reshape(len(cluster.rows), -1))
    needed, rank = [], _rank(held)
    for cluster, moves in zip(clusters, turns, strict=True):
        both = np.vstack([held, moves])
        if (more := _rank(both)) > rank:
            held, rank = both, more
            needed.append(cluster)
    return needed


def _rank(J: Array) -> int:
    """Return the number of rows that are independent."""
    S = np.linalg.svd(J, compute_uv=False)
    return int(np.count_nonzero(_NONE * S.max(initial=0.0) < S))
