"""Which features of two shapes meet at a point, and how it moves with the bodies.

Points a of A and b of B are on a corner, an edge or a face each, in whose directions d they slide
along their bodies; the rest of what is across n is across a - b = G n, the gap between the cores.
A twist (v, w) of A past B, with v_a = v + w x a the velocity that A has at a, gives

    d . n' = d . (w x n),  0,  d . v_a / G     along A's directions, B's, and what is across both
    n' = U (w x n) + R v_a,    a' = v_a - U^T (v_a - G n')

with U and R the sums of c d^T over A's directions and of c d^T / G over the rest, c . d = 1 and c
across all others. A corner on a face of B has neither U nor R. Where corners and edges meet that
are on the rim of a face along n, that face counts: derivatives are those on one side.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.cores import Core, lengths_of, on_face, segments

CORNER, EDGE, FACE, NONE = 0, 1, 2, 3
_STILL: Final = np.zeros((3, 3))


class Sliding(NamedTuple):
    """How the point of A and the normal turn: U, R and G, as above."""

    U: Array  # (3, 3)
    R: Array  # (3, 3) [1/m]
    between: float  # G [m]


class Feature(NamedTuple):
    """What of a core has a point: a corner, an edge with its direction, a face, or nothing."""

    kind: int
    along: Array


def of_balls(normal: Array, between: float) -> Sliding:
    """Return how the nearest points of two balls move, `between` their middles [m]."""
    return Sliding(_STILL, _across(normal) / between, between)


def sliding(A: Core, B: Core, a: Array, normal: Array, between: float) -> Sliding | None:
    """Return how a point of the core of A moves that meets B, or None if that is in doubt."""
    b = a - between * normal
    one, two = feature(A, a), feature(B, b)
    if one.kind == CORNER and (two.kind == FACE or _has_face(B, b, normal)):
        return Sliding(_STILL, _STILL, between)
    if two.kind == CORNER and (one.kind == FACE or _has_face(A, a, -normal)):
        return Sliding(_across(normal), _STILL, between)
    if one.kind == two.kind == EDGE:
        c = np.cross(two.along, normal)
        return Sliding(np.outer(c / c.dot(one.along), one.along), _STILL, between)
    if one.kind + two.kind > EDGE or between <= tolerances.ON_FACE * max(A.size, B.size):
        return None
    along = one.along + two.along  # of the only edge
    rest = _across(normal) - np.outer(along, along)
    return Sliding(np.outer(one.along, one.along), rest / between, between)


def feature(core: Core, point: Array) -> Feature:
    """Return the smallest feature of a core that has a point."""
    off, none = tolerances.ON_FACE * core.size, np.zeros(3)
    if lengths_of(core.vertices - point)[0].min() <= off or core.is_point:
        return Feature(CORNER, none)
    start, along = segments(core)
    away = point - start
    share = (away * along).sum(axis=1) / (along**2).sum(axis=1)
    apart = lengths_of(away - np.clip(share, 0.0, 1.0)[:, None] * along)[0]
    nearest = int(apart.argmin())
    if apart[nearest] <= off:
        return Feature(EDGE, lengths_of(along[nearest : nearest + 1])[1][0])
    if core.is_solid:
        heights = core.normals.dot(point) - core.heights
        if np.abs(heights).min() <= off and on_face(core, point[None])[0]:
            return Feature(FACE, none)
    return Feature(NONE, none)


def _has_face(core: Core, point: Array, normal: Array) -> bool:
    """Return whether a point is in the plane of a face with a normal."""
    turned = np.abs(core.normals - normal).max(axis=1, initial=0.0)
    off = np.abs(core.normals.dot(point) - core.heights)
    near = (turned <= tolerances.ON_FACE) & (off <= tolerances.ON_FACE * core.size)
    return bool(near.any())


def _across(normal: Array) -> Array:
    return np.eye(3) - np.outer(normal, normal)
