"""Gaps of many states at once, for what is measured after a motion.

Forward kinematics takes one state after the other, and what it leaves of the ends of each loop is
copied. Then the rows of all states are evaluated as those of one scene with so many loops: numpy
takes as long for a dozen of them as for one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms
from condyn_pin.constraints.rows.any_bound import OnFrames
from condyn_pin.constraints.rows.cut_joints import CutJoints
from condyn_pin.constraints.rows.ends import Ends
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.rows.groups import sorted_by_rows
from condyn_pin.constraints.rows.loops import Balls
from condyn_pin.constraints.rows.point_ends import AXES, MOVING
from condyn_pin.constraints.rows.rods import Rods
from condyn_pin.constraints.rows.rolling import Rolling

# States at once: what a call of numpy costs is spread over so many.
MANY: Final = 16


class ManyGaps:
    """Violations and constraint velocities of up to `MANY` states of one scene.

    Contacts, welds, relations, couplings and what is driven are evaluated by its equations, state
    by state, and so are all others of a scene that has any.
    """

    def __init__(self, equations: Equations) -> None:
        self._equations = equations
        self._gaps = np.zeros((2, MANY, equations.m))
        self._accelerations = np.zeros(MANY * equations.m)  # not asked for
        found = sorted_by_rows(equations.bounds)
        self._at_once = not (found.held or found.welds or found.related or found.coupled)
        self._at_once &= not equations.is_driven  # each state has a time of its own
        self._ends: list[ManyEnds] = []
        self._groups: list[Balls | CutJoints | Rods | Rolling] = []
        for group, bounds in (
            (Balls, found.balls), (CutJoints, found.cut), (Rods, found.rods),
            (Rolling, found.rolled),
        ):  # fmt: skip
            if self._at_once and bounds:
                ends = ManyEnds(equations.data, bounds)
                self._ends.append(ends)
                self._groups.append(group(ends, _repeated(bounds, equations.m)))

    def look(self, i: int, q: Array, v: Array, t: float | None = None) -> None:
        """Take (q, v) at t for state i; forward kinematics stays in the data of the equations."""
        equations = self._equations
        equations.at(t)
        if not self._at_once:
            self._gaps[:, i] = equations.gaps(q, v)
            return
        algorithms(equations.data).forwardKinematics(equations.model, equations.data, q, v)
        for ends in self._ends:
            ends.read(i)

    def gaps(self, count: int) -> Array:
        """Return c(q) and J v (2, count, m) of the first states; overwritten by the next call."""
        if not self._at_once:
            return self._gaps[:, :count]
        c, velocity = self._gaps.reshape(2, -1)
        for group in self._groups:
            group.evaluate(c, velocity, self._accelerations)
        return np.asarray(self._gaps[:, :count] * self._equations.sign)


class ManyEnds(Ends):
    """The ends of k loops in each of `MANY` states, as those of MANY k loops.

    Accelerations are left out: they are zero.
    """

    def __init__(self, data: Any, bounds: Sequence[OnFrames]) -> None:
        super().__init__(data, bounds)
        self._velocities = self._joints.sources[: len(self._joints.numbers)]
        self._placed = np.zeros((MANY, *self._of_joints.shape))
        self._moved = np.zeros((MANY, self._joints.size))
        # rows of each end, axes, (0, 1), (v, 0) and 0: with its placement, axes, p, p' and p''
        self._rows = np.zeros((2, MANY * self.k, 6, 4))
        self._rows[:, :, :4] = np.eye(4)

    def read(self, i: int) -> None:
        """Copy what forward kinematics has left, as state i."""
        np.concatenate(self._sources, out=self._placed[i].reshape(-1, 3))
        np.concatenate(self._velocities, out=self._moved[i])

    def placements(self) -> Array:
        """Return E (2, MANY k, 4, 3)."""
        E = self._in_joints @ self._placed
        return np.asarray(E.swapaxes(0, 1).reshape(2, -1, 4, 3))

    def evaluate(self) -> tuple[Array, Array]:
        """Return R1, and p, p' and zeros for p'' of c1 less those of c2, as `PointEnds` does."""
        self._rows[:, :, 4, :3] = self.linear()[0]
        one, two = self._rows @ self.placements()
        return one[:, AXES].swapaxes(1, 2), one[:, MOVING] - two[:, MOVING]

    def linear(self) -> Array:
        """Return (2, 2, MANY k, 3): velocities, and zeros for accelerations."""
        return self._of_ends(self._linearT)

    def angular(self) -> Array:
        """Return the same of the turning."""
        return self._of_ends(self._angularT)

    def _of_ends(self, mapT: Array) -> Array:
        both = np.zeros((2, 2, MANY * self.k, 3))
        each = (self._moved @ mapT).reshape(MANY, 2, self.k, 3)
        both[0] = each.swapaxes(0, 1).reshape(2, -1, 3)
        return both


def _repeated(bounds: Sequence[Any], rows: int) -> list[Any]:
    """Return the constraints once for each state, where a state has so many rows."""
    return [
        replace(b, rows=slice(b.rows.start + i * rows, b.rows.stop + i * rows))
        for i in range(MANY)
        for b in bounds
    ]
