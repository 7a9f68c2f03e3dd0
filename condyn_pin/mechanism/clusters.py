"""Clusters: loops that share dependent joints, and on which side of their dead points they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import Indices
from condyn_pin.constraints.rows.bound import AnyBound
from condyn_pin.dynamics.scene import Scene


@dataclass(frozen=True, eq=False)
class Cluster:
    """Loops that share dependent joints."""

    name: str  # names of the loops
    rows: Indices
    columns: Indices  # velocity indices of the joints that depend on them
    basis: Array  # Q (rows, columns)
    sign: float  # of det(Q^T J_D) at the reference
    sided: bool  # whether Q spans what J_D can move nearby too: if not, the sign says nothing

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
    for name, own, moved in _groups(scene, J, rows, columns):
        block = np.ix_(own, moved)
        Q = np.linalg.qr(J[block])[0]
        sign = float(np.linalg.slogdet(Q.T @ J[block])[0])
        sided = all(_spans(Q, other[block]) for other in nearby)
        yield Cluster(name, own, moved, Q, sign, sided)


def _spans(Q: Array, J_D: Array) -> bool:
    """Whether the columns of J_D are combinations of those of Q."""
    left = np.linalg.norm(J_D - Q @ (Q.T @ J_D))
    return bool(left <= tolerances.DEAD_POINT * np.linalg.norm(J_D))


def _groups(
    scene: Scene, J: Array, rows: Indices, columns: Indices
) -> Iterator[tuple[str, Indices, Indices]]:
    """Yield the names of loops that share joints, their rows, and the velocity indices of these."""
    groups: list[tuple[list[AnyBound], set[int]]] = []
    scale = np.abs(J[rows]).max(initial=0.0)
    for bound in scene.bounds:
        if not bound.positioned:
            continue
        size = np.abs(J[bound.positioned][:, columns]).max(axis=0, initial=0.0)
        loops, touched = [bound], set(columns[size > tolerances.DEAD_POINT * scale].tolist())
        apart = [group for group in groups if not group[1] & touched]
        for group in groups:
            if group[1] & touched:
                loops, touched = loops + group[0], touched | group[1]
        groups = [*apart, (loops, touched)]
    for loops, touched in groups:
        if touched:
            loops.sort(key=lambda bound: bound.rows.start)
            own = np.array([row for bound in loops for row in bound.positioned], dtype=np.int_)
            name = " + ".join(bound.name for bound in loops)
            yield name, own, np.array(sorted(touched), dtype=np.int_)


def isolated(
    scene: Scene, moved: Array, jacobians: Sequence[Array], rows: Indices
) -> tuple[str, ...]:
    """Return the loops that close at one configuration only.

    Whatever was closed nearby came back to it, no joint further than `moved` (nv,), and J is nearly
    singular there: to first order there is a motion, and to second order there is none.
    """

    def nearly_singular(J: Array) -> bool:
        S = np.linalg.svd(J, compute_uv=False)
        more_than_rounding = tolerances.REFERENCE_RANK * S[0] < S
        return bool((more_than_rounding & (tolerances.ISOLATED * S[0] > S)).any())

    groups = _groups(scene, jacobians[0], rows, np.arange(len(moved)))
    return tuple(
        name
        for name, own, touched in groups
        if moved[touched].max() < tolerances.ISOLATED
        and any(nearly_singular(J[own]) for J in jacobians)
    )
