"""Constraints for Pinocchio's own methods, of 3 and of 6 rows.

A kind with other rows is handed to them as an equivalent of such rows, where there is one. A hinge
about the axis e is two points on it, at d and -d with d = lever e; their velocities are
those of the hinge by

    s(d) = s_xyz + s_rxryrz x d = E s,      and so      lam = E^T lam_native.

The equivalent has 6 rows of rank 5. A planar pin about e is a ball without the row along e. In a
linkage in a plane, where its bodies are always as far apart along e as they are now, that row is
zero, and a ball at c1 + (e . r) e and c2 is the pin:

    s_ball = E s,     E = columns of 1 but for that of e.

With T = J1 - X J2 the twist of body 1 past body 2, column by column, both stay in the plane across
e if no joint shifts one past the other along e, or turns it about another axis:

    e . T_lin = 0,      e x T_ang = 0       for every column.

T is made of analytic functions of q: zero at a place of no special choice, zero everywhere.

Both are exact where the loop is closed (`condyn_pin.dynamics.proof` has the others).

A planar pin in space, a slider, a cylindrical or universal joint, a rod, a plane, a coupling, a
blade and what rolls have no equivalent: three rows of a point, or six of a frame, hold more than
they do. A rod is one of them: the two rows across it could only be given back by joints of bodies
without mass, which have no M.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import whole_data
from condyn_pin.constraints.forces import frame_jacobian
from condyn_pin.constraints.rows.bound import (
    BoundBetweenFrames,
    BoundConstraint,
    PinocchioConstraint,
)
from condyn_pin.constraints.rows.equations import ROUNDED


@dataclass(frozen=True, eq=False)
class PinocchioConstraints:
    """Constraints of a scene in the form of Pinocchio."""

    constraints: tuple[PinocchioConstraint, ...]
    # (m, m_native) E^T with the signs of the scene: lam from Pinocchio's; None where they are the
    # same
    to_scene: Array | None
    # names of constraints that take rows of Pinocchio's with one too many
    approximated: tuple[str, ...]
    # those of them whose first frame is the world's, which `pin.lcaba` must not see
    world_first: tuple[str, ...]
    loops: tuple[str, ...]  # names of constraints that join two moving bodies
    unsupported: tuple[str, ...]  # names of constraints without an equivalent


def pinocchio_constraints(
    model: Any, bounds: Sequence[BoundConstraint], rows: Callable[[], Array]
) -> PinocchioConstraints:
    """Constraints of a scene in the form of Pinocchio."""
    # `rows` returns the Jacobian at the nominal state in the metric of M, J L^-T (m, nv).
    made: list[PinocchioConstraint] = []
    blocks: list[Array | None] = []
    approximated: list[tuple[str, int]] = []
    loops: list[str] = []
    unsupported: list[str] = []
    for bound in bounds:
        points, block = _equivalent(model, bound)
        made += points
        blocks.append(block)
        if not points:
            unsupported.append(bound.name)
            continue
        if points[0].approximates:
            approximated.append((bound.name, points[0].joint1))
        if points[0].joint1 and points[0].joint2:
            loops.append(bound.name)
    E_T = None if all(block is None for block in blocks) else _side_by_side(blocks, bounds)
    constraints, W = separate(made, lambda: rows() if E_T is None else E_T.T @ rows())
    to_scene = E_T if W is None else W.T if E_T is None else E_T @ W.T
    return PinocchioConstraints(
        constraints,
        to_scene,
        tuple(name for name, _ in approximated),
        tuple(name for name, joint1 in approximated if joint1 == 0),
        tuple(loops),
        tuple(unsupported),
    )


def _side_by_side(blocks: Sequence[Array | None], bounds: Sequence[BoundConstraint]) -> Array:
    """Matrix E^T of all constraints from that of each, None where it is 1."""
    whole = [np.eye(b.size) if E is None else E for E, b in zip(blocks, bounds, strict=True)]
    E_T = np.zeros((sum(len(E) for E in whole), sum(E.shape[1] for E in whole)))
    column = 0
    for bound, E in zip(bounds, whole, strict=True):
        E_T[bound.rows, column : column + E.shape[1]] = E
        column += E.shape[1]
    return E_T


def _equivalent(
    model: Any, bound: BoundConstraint
) -> tuple[list[PinocchioConstraint], Array | None]:
    """Equivalent of a constraint in Pinocchio, and E^T; None for E^T = 1."""
    # Nothing where it has nothing: neither of other rows, nor of rows that follow a path.
    if bound.drive:
        return [], np.zeros((bound.size, 0))
    if isinstance(bound, BoundBetweenFrames) and bound.is_plain:
        E_T = None if bound.sign > 0 else -np.eye(bound.size)
        return [PinocchioConstraint.of(bound, bound.size)], E_T
    if isinstance(bound, BoundBetweenFrames) and bound.is_hinge:
        ends = bound.lever * np.array([1.0, -1.0])[:, None] * np.eye(3)[bound.axis]
        E = np.vstack([np.hstack([np.eye(3), -pin.skew(d)]) for d in ends])
        points = [PinocchioConstraint.of(bound, 3, d, d) for d in ends]
        return points, bound.sign * E[:, list(bound.selection)].T
    if isinstance(bound, BoundBetweenFrames) and bound.is_planar:
        height = _height_of(model, bound)
        if height is not None:
            point = PinocchioConstraint.of(bound, 3, height * np.eye(3)[bound.axis])
            return [point], bound.sign * np.eye(3)[list(bound.selection)]
    return [], np.zeros((bound.size, 0))


def _height_of(model: Any, b: BoundBetweenFrames) -> float | None:
    """Distance from c1 to c2 along the axis of a planar pin [m]."""
    # None if that can change: the pin is one in space then.
    data = whole_data(model)
    anywhere = np.random.default_rng(0).normal(size=model.nv)
    pin.computeJointJacobians(model, data, pin.integrate(model, pin.neutral(model), anywhere))
    c1Mc2 = (data.oMi[b.joint1] * b.placement1).actInv(data.oMi[b.joint2] * b.placement2)

    def twist(joint: int, placement: Any) -> Array:
        if joint == 0:
            return np.zeros((6, model.nv))
        return frame_jacobian(model, data, joint, placement, LOCAL)

    first, second = (
        twist(b.joint1, b.placement1),
        c1Mc2.toActionMatrix() @ twist(b.joint2, b.placement2),
    )
    off = [b.axis, *(3 + i for i in range(3) if i != b.axis)]  # e . T_lin and e x T_ang
    rounding = ROUNDED * (np.abs(first) + np.abs(second)).max(axis=0)
    stays = (np.abs(first - second)[off] <= rounding).all()
    return float(c1Mc2.translation[b.axis]) if stays else None


# Points that are nearly one, taken further apart for Pinocchio's own methods.
#
# Two balls between the same two bodies are a hinge about the line through them, however near they
# are. At a distance d they leave the turns across the line an eigenvalue of about d^2 in G, which
# rounding hides where d is a 1e-7th of the body. But any two points of the line are that hinge. So
# Pinocchio has n points p' in place of p, k times as far from their middle on both bodies:
#
#     p' = W p,      s' = W s,      lam = W^T lam',      W = 1 1^T / n + k (1 - 1 1^T / n).
#
# The velocity of a point is affine in the point, and rows of W add up to one. W has an inverse: the
# scene is the same. Forces along the line, which no motion tells, are shared as before.
#
# Points stay where they are if others hold the turns that they hold, as a weld between the same two
# bodies does. Those rows are then redundant, and far apart they would contradict the others by k
# times as much rounding, and bear k times as much among themselves. Of points that hold one turn
# with others and another alone the second is what counts: a is right, and lam need not be the
# smallest.


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
class NearlyCoincident:
    """Points of the same two bodies that nearly coincide.

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
        """Weights 1 1^T / n + k (1 - 1 1^T / n), (n, n)."""
        n = len(self.points)
        mean = np.full((n, n), 1.0 / n)
        return np.asarray(mean + self.k * (np.eye(n) - mean))

    @cached_property
    def W(self) -> Array:
        """Weights for rows (3 n, 3 n), to the axes of the first point from those of each."""
        axes = self.points[0].placement1.rotation.T
        turns = [axes @ point.placement1.rotation for point in self.points]
        return np.block([[w * R for w, R in zip(row, turns, strict=True)] for row in self.weights])

    def moved(self) -> list[PinocchioConstraint]:
        """Points p' = W p on both bodies."""
        axes = self.points[0].placement1.rotation
        return [
            replace(point, placement1=pin.SE3(axes, p1), placement2=pin.SE3(axes, p2))
            for point, p1, p2 in zip(
                self.points, self._moved("placement1"), self._moved("placement2"), strict=True
            )
        ]

    def _moved(self, end: str) -> Array:
        """Points p' by differences to the first point: they are exact for near points."""
        p = np.array([getattr(point, end).translation for point in self.points])
        return np.asarray(p[0] + self.weights @ (p - p[0]))


def separate(
    pinocchio_constraints: Sequence[PinocchioConstraint], rows: Callable[[], Array]
) -> tuple[tuple[PinocchioConstraint, ...], Array | None]:
    """Constraints whose nearly coincident points are spread apart where they alone hold a turn."""
    # `rows` returns their Jacobian at the nominal state in the metric of M, J L^-T (m, nv); it is
    # called where points are nearly one. Beside as many constraints comes W (m, m), with lam = W^T
    # lam', or None where all are as before.
    clusters = _clusters(pinocchio_constraints)
    if not clusters:
        return tuple(pinocchio_constraints), None
    made, J = list(pinocchio_constraints), rows()
    W, needed = np.eye(len(J)), _clusters_that_hold_turns(clusters, J)
    for cluster in needed:
        W[np.ix_(cluster.rows, cluster.rows)] = cluster.W
        for i, point in zip(cluster.places, cluster.moved(), strict=True):
            made[i] = point
    return tuple(made), W if needed else None


def _clusters(pinocchio_constraints: Sequence[PinocchioConstraint]) -> list[NearlyCoincident]:
    """Nearly coincident points, if no others of their two bodies are far from them."""
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
            found.append(NearlyCoincident(tuple(places), rows, points, _APART * lever / radius))
    return found


def _clusters_that_hold_turns(
    clusters: Sequence[NearlyCoincident], J: Array
) -> list[NearlyCoincident]:
    """Clusters that hold a turn which neither other rows nor clusters before them hold."""
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
    """Number of independent rows."""
    S = np.linalg.svd(J, compute_uv=False)
    return int(np.count_nonzero(_NONE * S.max(initial=0.0) < S))
