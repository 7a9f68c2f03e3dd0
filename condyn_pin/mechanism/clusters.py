"""Clusters: loops that share dependent joints, and on which side of their dead points they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import Indices
from condyn_pin.constraints.rows.any_bound import AnyBound

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene


@dataclass(frozen=True, eq=False)
class Cluster:
    """Loops that share dependent joints.

    Attributes
    ----------
    name : str
        Names of the loops.
    rows, columns : int array
        Their rows, and the velocity indices of the joints that depend on them.
    basis : (rows, columns) array
        Q.
    sign : float
        Of det(Q^T J_D) at the reference.
    sided : bool
        Whether Q spans what J_D can move also at configurations nearby. If not, the sign changes
        where that turns orthogonal to Q too, and says nothing.
    """

    name: str
    rows: Indices
    columns: Indices
    basis: Array
    sign: float
    sided: bool

    @cached_property
    def block(self) -> tuple[Indices, ...]:
        """Where J holds J_D."""
        return np.ix_(self.rows, self.columns)

    def singular_values(self, J: Array) -> Array:
        """Return those of J_D."""
        return np.asarray(np.linalg.svd(J[self.block], compute_uv=False), dtype=np.float64)

    def side(self, J: Array) -> int:
        """Return +1 on the side of the reference, -1 across a dead point, 0 in one."""
        S = self.singular_values(J)
        if S[-1] <= tolerances.DEAD_POINT * S[0]:
            return 0
        return int(self.sign * np.linalg.slogdet(self.basis.T @ J[self.block])[0])


def clusters(
    scene: Scene, J: Array, nearby: Sequence[Array], rows: Indices, columns: Indices
) -> Iterator[Cluster]:
    """Group the loops that share dependent joints: the blocks of J_D, at a reference and nearby."""
    for names, touched in _groups(scene, J, rows, columns):
        own = _rows(scene, names)
        moved = np.array(sorted(touched), dtype=np.int_)
        block = J[np.ix_(own, moved)]
        Q = np.linalg.qr(block)[0]
        sign = float(np.linalg.slogdet(Q.T @ block)[0])
        sided = all(_spans(Q, other[np.ix_(own, moved)]) for other in nearby)
        yield Cluster(_name(scene, names), own, moved, Q, sign, sided)


def _spans(Q: Array, J_D: Array) -> bool:
    """Whether the columns of J_D are combinations of those of Q."""
    left = np.linalg.norm(J_D - Q @ (Q.T @ J_D))
    return bool(left <= tolerances.DEAD_POINT * np.linalg.norm(J_D))


def _groups(
    scene: Scene, J: Array, rows: Indices, columns: Indices
) -> list[tuple[set[str], set[int]]]:
    """Return the names of loops and the velocity indices of each cluster."""
    groups: list[tuple[set[str], set[int]]] = []
    scale = np.abs(J[rows]).max(initial=0.0)
    for bound in scene.bounds:
        if not bound.positioned:
            continue
        size = np.abs(J[bound.positioned][:, columns]).max(axis=0, initial=0.0)
        names, touched = {bound.name}, set(columns[size > tolerances.DEAD_POINT * scale].tolist())
        apart = [group for group in groups if not group[1] & touched]
        for group in groups:
            if group[1] & touched:
                names, touched = names | group[0], touched | group[1]
        groups = [*apart, (names, touched)]
    return [(names, touched) for names, touched in groups if touched]


def isolated(
    scene: Scene, moved: Array, jacobians: Sequence[Array], rows: Indices
) -> tuple[str, ...]:
    """Return the loops that close at one configuration only.

    Whatever was closed nearby came back to it, and J is nearly singular there: to first order
    there is a motion, and to second order there is none.

    Parameters
    ----------
    moved : (nv,) array
        How far the configurations that were closed nearby are from each other [rad, m].
    jacobians : sequence of (m, nv) array
        Theirs.
    rows : int array
        Rows that have a position error.
    """
    found = []
    for names, touched in _groups(scene, jacobians[0], rows, np.arange(len(moved))):
        own = _rows(scene, names)
        for J in jacobians:
            S = np.linalg.svd(J[own], compute_uv=False)
            vanishing = (tolerances.REFERENCE_RANK * S[0] < S) & (tolerances.ISOLATED * S[0] > S)
            if vanishing.any() and moved[list(touched)].max() < tolerances.ISOLATED:
                found.append(_name(scene, names))
                break
    return tuple(found)


def _rows(scene: Scene, names: set[str]) -> Indices:
    """Return the rows of some loops that have a position error."""
    return np.array([row for b in _bounds(scene, names) for row in b.positioned], dtype=np.int_)


def _bounds(scene: Scene, names: set[str]) -> list[AnyBound]:
    return [bound for bound in scene.bounds if bound.name in names]


def _name(scene: Scene, names: set[str]) -> str:
    return " + ".join(bound.name for bound in _bounds(scene, names))
