"""Levels: tasks at work, whose rows stand below each other, with a name for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array, Indices, entries
from condyn_pin.control.motion import Motion
from condyn_pin.control.tasks.base import Home, Task
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument

# What it costs that a row gives: wishes before limits of joints, those before motors, and the floor
# last. Equations of motion and contacts never give.
WISH, JOINT, MOTOR, FLOOR, LAW = 1.0, 1e1, 1e2, 1e3, np.inf


@dataclass(frozen=True, eq=False)
class Row:
    """What a row of the program is.

    Attributes
    ----------
    name : str
    unit : str
    scale : float
        What a number of the program is in its unit.
    cost : float
        Of giving, where rows contradict each other.
    """

    name: str
    unit: str
    scale: float
    cost: float


class Rows(NamedTuple):
    """Rows of tasks: G x = b, as far as they can be had.

    Attributes
    ----------
    G, b : (r, c), (r,) array
        Over the first c unknowns; the others have no part in them.
    """

    G: Array
    b: Array

    def of(self, x: Array) -> Array:
        """Return G x of unknowns (n,), or of some at once (n, s)."""
        return self.G.dot(x[: self.G.shape[1]])  # type: ignore[no-any-return]


class Level(NamedTuple):
    """Rows of tasks and what they count: w |G x - b|^2.

    Attributes
    ----------
    rows : Rows
    weights : (r,) array
    changing : slice or int array
        The rows of G that change from tick to tick.
    W : (s, n) array
        Their weights, for each of their entries; not to be written to.
    H : (n, n) array
        G^T w G of the others, and the regularisation; not to be written to.
    """

    rows: Rows
    weights: Array
    changing: slice | Indices
    W: Array
    H: Array


class Stack:
    """Tasks whose rows stand below each other: accelerations first, then forces.

    Attributes
    ----------
    rows : list of Row
    tasks : dict of str to slice
        Which rows belong to a task.
    weights : (r,) array
    changing : slice or int array
        The rows that change from tick to tick.
    bound : list of (Task, BoundTask)
        The tasks at work, in the order of the rows.
    """

    def __init__(self, scene: Scene, tasks: Sequence[Task], home: Home) -> None:
        bound = [(task, task.bind(scene, home)) for task in tasks]
        self.bound = [each for each in bound if each[1].over == "accelerations"]
        self.bound += [each for each in bound if each[1].over == "forces"]
        self.tasks: dict[str, slice] = {}
        self.rows: list[Row] = []
        weights: list[float] = []
        of_a = 0
        for task, each in self.bound:
            start = len(self.rows)
            self.rows += [Row(name, each.unit, 1.0, WISH) for name in each.names]
            weights += [task.weight] * len(each.names)
            self.tasks[task.name] = slice(start, len(self.rows))
            of_a = len(self.rows) if each.over == "accelerations" else of_a
        self.weights = np.array(weights)
        self._J = np.zeros((of_a, scene.robot.nv))
        self._F = np.zeros((len(self.rows) - of_a, scene.rows))
        self._b = np.zeros(len(self.rows))
        self._bind()

    def _bind(self) -> None:
        """Write what does not change, and find where the rest goes."""
        changing: list[int] = []
        self._places = []
        for (task, each), at in zip(self.bound, self.tasks.values(), strict=True):
            of_a = each.over == "accelerations"
            J = self._J[at] if of_a else self._F[at.start - len(self._J) :][: len(each.names)]
            if each.fixed is None:
                changing += range(at.start, at.stop)
            else:
                J[:] = each.fixed
            self._places.append((task.name, each, J, self._b[at]))
        self.changing = entries(np.array(changing, dtype=int))

    @cached_property
    def H(self) -> Array:
        """J^T w J (nv, nv) of the rows that do not change."""
        fixed = [(task.weight, each.fixed) for task, each in self.bound if each.fixed is not None]
        nv = self._J.shape[1]
        return sum((w * J.T @ J for w, J in fixed), np.zeros((nv, nv)))

    def at(self, motion: Motion, t: float) -> tuple[Array, Array, Array]:
        """Return rows of accelerations (r, nv), of forces (s, m), and what they want (r + s,).

        They are in the memory of this object: the next call overwrites them.
        """
        for name, each, J, b in self._places:
            found, wanted = each.rows(motion, t)
            # of arrays at once: `np.shape` takes a microsecond
            if getattr(found, "shape", 0) != J.shape or getattr(wanted, "shape", 0) != b.shape:
                _check_shapes(name, found, wanted, J, b)
            b[:] = wanted
            if each.fixed is None:
                J[:] = found
        return self._J, self._F, self._b


def _check_shapes(name: str, found: ArrayLike, wanted: ArrayLike, J: Array, b: Array) -> None:
    """Refuse rows that would be spread over places that are larger."""
    shapes = np.shape(found), np.shape(wanted)
    if shapes != (J.shape, b.shape):
        raise InvalidArgument(
            f"tasks: {name} has rows J and b of shapes {shapes[0]} and {shapes[1]}: {J.shape} and "
            f"{b.shape} are needed, one row for each of its names"
        )
