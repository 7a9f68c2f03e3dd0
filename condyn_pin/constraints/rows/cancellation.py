"""Cancellation: what the two bodies of a row bring to J before they cancel.

J = J1 - X J2 is rounded to eps (|J1| + |X J2|), however small it is itself. Pinocchio forms either
from columns at the origin of the world, so that each is rounded to eps times its distance from
there at least: far away that is what counts.

A row along a direction that is computed is off by as much as that: of a rod, n = (p2 - p1) / |r|
turns by eps (|p1| + |p2|) / |r|, however well the two bodies agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms
from condyn_pin.constraints.rows.any_bound import AnyBound, OnFrames, length
from condyn_pin.constraints.rows.couplings import Coupled

# What is rounding of a row, as a share of what its two bodies bring to it.
ROUNDED: Final = 1e-13


class Cancellation:
    """What the two bodies of each row bring to J; it keeps no state of `data`, but writes to it."""

    def __init__(self, model: Any, data: Any, bounds: Sequence[AnyBound]) -> None:
        self._model, self._data = model, data
        self._couplings = np.zeros((sum(b.size for b in bounds), model.nv))
        self._bent: list[Coupled] = []
        self._ends: list[tuple[int, Any]] = []  # joint and placement of those that move
        self._arms: list[OnFrames | None] = []  # what has an arm from c1 to c2
        self._shares = np.zeros((len(self._couplings), 2, 1))  # of shifts and of turns in each row
        self._leaning: list[OnFrames] = []  # along directions that are computed
        rows: tuple[list[Any], list[Any]] = [], []  # of c1 and of c2: row, end
        for b in bounds:
            if isinstance(b, Coupled):
                self._couplings[b.rows, b.columns] = np.abs(b.weights)
                self._bent += [b] if b.bends else []
                continue
            assert isinstance(b, OnFrames)
            turns = b.turns(model)
            self._shares[b.rows, :, 0] = np.array([~turns, turns]).T
            if b.leans:
                self._leaning.append(b)
            ends = (b.joint1, b.placement1, b), (b.joint2, b.placement2, None)
            for its_rows, (joint, placement, arm) in zip(rows, ends, strict=True):
                if joint:
                    its_rows.extend(
                        (row, len(self._ends)) for row in range(b.rows.start, b.rows.stop)
                    )
                    self._ends.append((joint, placement))
                    self._arms.append(arm)
        self._origins = [data.oMi[joint] for joint, _ in self._ends]
        self._rows = [np.array(each, dtype=int).T for each in rows if each]

    def at(self, q: Array, *, leaning: bool = False) -> Array:
        """Return the sizes of what J is a difference of (m, nv).

        The same for all shifts of a constraint, and for all its turns. Of all places of a machine
        it is least near the origin of the world. With `leaning` also what directions that are
        computed are off by, over eps.
        """
        model, data, found = self._model, self._data, self._couplings.copy()
        for curve in self._bent:
            found[curve.rows, curve.columns] += np.abs(curve.bent(q, 1))
        algorithms(data).computeJointJacobians(model, data, q)
        if not self._ends:
            return found
        sixes = [pin.getFrameJacobian(model, data, *end, LOCAL) for end in self._ends]
        # by end, linear or angular, component and column
        shift, turn = np.abs(sixes).reshape(len(sixes), 2, 3, -1).max(axis=2).swapaxes(0, 1)
        away = np.array([[length(origin.translation)] for origin in self._origins])
        arms = np.array([[b.arm(data.oMi) if b else 0.0] for b in self._arms])
        shift = np.maximum(shift + arms * turn, away * turn)
        shares = self._shares
        if leaning and self._leaning:
            shares = shares.copy()
            for b in self._leaning:
                shares[b.rows, :, 0] = b.shares(data.oMi)
        for rows, ends in self._rows:
            of_shifts, of_turns = shares[rows].swapaxes(0, 1)
            found[rows] += of_shifts * shift[ends] + of_turns * turn[ends]
        return found


def least_of(P: Array) -> float:
    """Return what |J|^2 is at least, if J is more than rounding."""
    return ROUNDED**2 * float(np.vdot(P, P))


def more_than(least: float, J: Array) -> Array:
    """Return J, or zeros where |J|^2 is no more than `least`.

    The rank is relative to the largest singular value: such rows would hold what they cannot.
    """
    entries = J.ravel()
    return np.zeros_like(J) if entries.dot(entries) <= least else J
