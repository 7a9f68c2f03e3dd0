"""Cancellation: what the two bodies of a row bring to J before they cancel.

J = J1 - X J2 is rounded to eps (|J1| + |X J2|), however small it is itself. Pinocchio forms either
from columns at the origin of the world, so that each is rounded to eps times its distance from
there at least: far away that is what counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.any_bound import AnyBound, OnFrames, length
from condyn_pin.constraints.rows.couplings import Coupled

# What is rounding of a row, as a share of what its two bodies bring to it.
ROUNDED: Final = 1e-13


class Cancellation:
    """What the two bodies of each row bring to J; it keeps no state of `data`, but writes to it."""

    def __init__(self, model: Any, data: Any, bounds: Sequence[AnyBound]) -> None:
        self._model, self._data = model, data
        self._couplings = np.zeros((sum(b.size for b in bounds), model.nv))
        self._ends: list[tuple[int, Any]] = []  # joint and placement of those that move
        self._arms: list[OnFrames | None] = []  # what has an arm from c1 to c2
        rows: tuple[list[Any], list[Any]] = [], []  # of c1 and of c2: row, end, is it an angle
        for b in bounds:
            if isinstance(b, Coupled):
                self._couplings[b.rows, b.columns] = np.abs(b.entries)
                continue
            assert isinstance(b, OnFrames)
            angles = list(zip(range(b.rows.start, b.rows.stop), b.turns(model), strict=True))
            ends = (b.joint1, b.placement1, b), (b.joint2, b.placement2, None)
            for its_rows, (joint, placement, arm) in zip(rows, ends, strict=True):
                if joint:
                    its_rows.extend((row, len(self._ends), angle) for row, angle in angles)
                    self._ends.append((joint, placement))
                    self._arms.append(arm)
        self._origins = [data.oMi[joint] for joint, _ in self._ends]
        self._rows = [np.array(each, dtype=int).T for each in rows if each]

    def at(self, q: Array) -> Array:
        """Return the sizes of what J is a difference of (m, nv).

        The same for all shifts of a constraint, and for all its turns. Of all places of a machine
        it is least near the origin of the world.
        """
        model, data, found = self._model, self._data, self._couplings.copy()
        pin.computeJointJacobians(model, data, q)
        if not self._ends:
            return found
        sixes = [pin.getFrameJacobian(model, data, *end, LOCAL) for end in self._ends]
        # by end, linear or angular, component and column
        shift, turn = np.abs(sixes).reshape(len(sixes), 2, 3, -1).max(axis=2).swapaxes(0, 1)
        away = np.array([[length(origin.translation)] for origin in self._origins])
        arms = np.array([[b.arm(data.oMi) if b else 0.0] for b in self._arms])
        sizes = np.array([np.maximum(shift + arms * turn, away * turn), turn])
        for rows, ends, angles in self._rows:
            found[rows] += sizes[angles, ends]
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
