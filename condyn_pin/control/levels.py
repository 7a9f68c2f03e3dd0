"""Levels: tasks at work, whose rows stand below each other, with a name for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.control.motion import Motion
from condyn_pin.control.tasks.base import BoundTask, Home, Task
from condyn_pin.dynamics.scene import Scene

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


class Level(NamedTuple):
    """Rows of tasks over x: w |G x - b|^2.

    Attributes
    ----------
    G, b, weights : (r, n), (r,), (r,) array
    """

    G: Array
    b: Array
    weights: Array


class Stack:
    """Tasks whose rows stand below each other: accelerations first, then forces.

    Attributes
    ----------
    rows : list of Row
    tasks : dict of str to slice
        Which rows belong to a task.
    weights : (r,) array
    bound : list of (Task, BoundTask)
        The tasks at work, in the order of the rows.
    none : tuple of array
        No rows of accelerations (0, nv), and none of forces (0, m).
    """

    def __init__(self, scene: Scene, tasks: Sequence[Task], home: Home) -> None:
        bound = [(task, task.bind(scene, home)) for task in tasks]
        self.tasks: dict[str, slice] = {}
        self._over_a = [each for _, each in bound if each.over == "accelerations"]
        self._over_f = [each for _, each in bound if each.over == "forces"]
        self.bound: list[tuple[Task, BoundTask]] = []
        self.rows: list[Row] = []
        weights: list[float] = []
        for over in ("accelerations", "forces"):
            for task, each in bound:
                if each.over != over:
                    continue
                self.bound.append((task, each))
                start = len(self.rows)
                self.rows += [Row(name, each.unit, 1.0, WISH) for name in each.names]
                weights += [task.weight] * len(each.names)
                self.tasks[task.name] = slice(start, len(self.rows))
        self.weights = np.array(weights)
        self.none = np.zeros((0, scene.robot.nv)), np.zeros((0, scene.rows))

    def at(self, motion: Motion, t: float) -> tuple[Array, Array, Array]:
        """Return rows of accelerations (r, nv), of forces (s, m), and what they want (r + s,)."""
        of_a = [each.rows(motion, t) for each in self._over_a]
        of_f = [each.rows(motion, t) for each in self._over_f]
        J = np.concatenate([rows for rows, _ in of_a]) if of_a else self.none[0]
        F = np.concatenate([rows for rows, _ in of_f]) if of_f else self.none[1]
        wanted = [b for _, b in (*of_a, *of_f)]
        return J, F, np.concatenate(wanted) if wanted else np.zeros(0)
