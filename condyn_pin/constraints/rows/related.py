"""Relations: rows that a kind writes itself as W s, with s the six relative velocities.

    J v = W s,        J a + gamma = W s' + W' s,        wrench at c2, in the axes of c1:  W^T lam

`condyn_pin.constraints.relation` says what W is, `cut_joints` what s and s' are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.any_bound import Drive, OnFrames
from condyn_pin.constraints.rows.compiled_rows import CUT, CompiledRows, placement
from condyn_pin.constraints.rows.cut_joints import relative_velocities
from condyn_pin.constraints.rows.ends import Ends
from condyn_pin.constraints.rows.frames import FrameJacobian


class Relation(Protocol):
    """What a kind knows of two frames: see `condyn_pin.constraints.relation.FrameRelation`."""

    @property
    def row_words(self) -> tuple[str, ...]:
        """What its rows are called, behind its name."""

    @property
    def angles(self) -> tuple[bool, ...]:
        """Which of its rows are angles, not lengths."""

    def violation(self, R: Array, r: Array) -> Array:
        """Return c (rows,)."""

    def weights(self, R: Array, r: Array) -> Array:
        """Return W (rows, 6)."""

    def weights_rate(self, R: Array, r: Array, s: Array) -> Array:
        """Return W' (rows, 6) while the frames move by s."""

    def weights_bend(self, R: Array, r: Array, s: Array) -> Array:
        """Return the partials of W' by moves of the frames (6, rows, 6)."""


@dataclass(frozen=True)
class Related(OnFrames):
    """A relation of two frames, bound; its `relation` has the equations."""

    name: str
    rows: slice
    joint1: int
    placement1: Any
    joint2: int
    placement2: Any
    relation: Relation
    anchored: bool = True
    sign: float = 1.0
    drive: Drive | None = None

    @property
    def row_names(self) -> tuple[str, ...]:
        """A name for each row."""
        return tuple(f"{self.name}.{word}" for word in self.relation.row_words)

    @property
    def is_scalar(self) -> bool:
        """True: only its rows tell the force, whose direction turns with the state."""
        return True

    @property
    def is_held(self) -> bool:
        """False: the world enters its rows."""
        return False

    def force(self, lam: Array, ends: Any) -> Array:
        """Return force and moment W^T lam in the axes of c1, at c2 (6,)."""
        c1, c2 = ends()
        between = c1.actInv(c2)
        W = self.relation.weights(between.rotation, between.translation)
        return np.asarray(W.T @ lam)

    def turns(self, model: Any) -> NDArray[np.bool_]:
        """Return for each row whether it is an angle."""
        return np.array(self.relation.angles)

    @property
    def leans(self) -> bool:
        """True if W changes with the state."""
        return not isinstance(self.relation, Apart)

    def shares(self, oMi: Any) -> Array:
        """Sizes of W, and of its change while frames move by the rounding of their places."""
        c1, c2 = self.ends(oMi)
        between = c1.actInv(c2)
        R, r = between.rotation, between.translation
        moves = np.diag(3 * [self.reach(oMi)] + 3 * [1.0])
        W, rate = self.relation.weights, self.relation.weights_rate
        sizes = np.abs(W(R, r)) + sum(np.abs(rate(R, r, move)) for move in moves)
        most = 1.0 / np.finfo(float).eps  # nothing is left of the direction
        return np.asarray(np.minimum(sizes, most).reshape(-1, 2, 3).max(axis=2))

    def compiled(self) -> CompiledRows | None:
        """Return its rows as the compiled core has them: of cut joints, where W chooses of s."""
        if not isinstance(self.relation, Apart):
            return None
        chosen = sum(1 << row for row in self.relation.chosen)
        integers = [
            CUT, self.rows.start, self.size, self.joint1, self.joint2, chosen, True,
            0, False, False, 0, 0, 0, 0,
        ]  # fmt: skip
        placed = [*placement(self.placement1), *placement(self.placement2)]
        return CompiledRows(integers, [*placed, self.sign, 0.0, 0.0])


@dataclass(frozen=True)
class Apart:
    """Where the origin of c2 is in the axes of c1, some of its three coordinates: -r = 0.

    A relation of two frames whose W, (1, 0), is constant: c' = J v wherever c2 is.
    """

    chosen: tuple[int, ...]

    @property
    def row_words(self) -> tuple[str, ...]:
        """The axes."""
        return tuple("xyz"[i] for i in self.chosen)

    @property
    def angles(self) -> tuple[bool, ...]:
        """None of them is an angle."""
        return (False,) * len(self.chosen)

    def violation(self, R: Array, r: Array) -> Array:
        """Return c (rows,) [m]."""
        return -r[list(self.chosen)]

    def weights(self, R: Array, r: Array) -> Array:
        """Return W (rows, 6)."""
        return np.eye(6)[list(self.chosen)]

    def weights_rate(self, R: Array, r: Array, s: Array) -> Array:
        """Return W' (rows, 6): zero."""
        return np.zeros((len(self.chosen), 6))

    def weights_bend(self, R: Array, r: Array, s: Array) -> Array:
        """Return the partials of W' (6, rows, 6): zero."""
        return np.zeros((6, len(self.chosen), 6))


class Relations:
    """All relations of one scene."""

    def __init__(self, ends: Ends, bounds: Sequence[Related]) -> None:
        self._ends, self._bounds = ends, tuple(bounds)
        self._at: list[tuple[Array, Array, Array]] = []  # W, R and r of the last evaluation

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows into the three vectors of all rows."""
        self._at = []
        for b, R, r, s, s_dot in zip(self._bounds, *relative_velocities(self._ends), strict=True):
            s, s_dot = s.ravel(), s_dot.ravel()
            W = b.relation.weights(R, r)
            c[b.rows], velocity[b.rows] = b.relation.violation(R, r), W @ s
            acceleration[b.rows] = W @ s_dot + b.relation.weights_rate(R, r, s) @ s
            self._at.append((W, R, r))

    def stack(self, lam: Array, f1: Array, f2: Array) -> None:
        """Write the forces and moments (6 k) at the origins of c1 and c2, each in its axes."""
        for b, (W, R, r), on1, on2 in zip(
            self._bounds, self._at, f1.reshape(-1, 6), f2.reshape(-1, 6), strict=True
        ):
            six = W.T @ lam[b.rows]
            on1[:3], on1[3:] = six[:3], six[3:] + pin.skew(r) @ six[:3]
            on2[:3], on2[3:] = R.T @ six[:3], R.T @ six[3:]

    def jacobian(self, J: Array, of_frame: FrameJacobian) -> None:
        """Write the rows into J (m, nv), at the last evaluation."""
        for b, (W, R, r) in zip(self._bounds, self._at, strict=True):
            J1, J2 = of_frame(b.joint1, b.placement1), of_frame(b.joint2, b.placement2)
            linear = J1[:3] - pin.skew(r) @ J1[3:] - R @ J2[:3]
            J[b.rows] = W @ np.vstack([linear, J1[3:] - R @ J2[3:]])
