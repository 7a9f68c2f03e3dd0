"""Tasks of one's own, registered while a test looks at them, and then no more."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from condyn_pin.control import TASKS, Task
from condyn_pin.control.tasks.task import BoundTask


@contextmanager
def own_task(rows: Callable, unit: str) -> Iterator[type[Task]]:
    """Yield a class of tasks that ask `rows(motion, t)` of all accelerations."""

    @dataclass(frozen=True)
    class Own(Task):
        def bind(self, scene, home):
            names = self._row_names([str(i) for i in range(scene.robot.nv)])
            return BoundTask("accelerations", names, unit, rows)

    try:
        yield Own
    finally:
        del TASKS["Own"]


def still(motion, t):
    """a = -v: what moves slows down."""
    return np.eye(len(motion.v)), -motion.v


def nearest(motion, t):
    """|a - a_free| in the metric of M, which Gauss's principle has least."""
    M, h = motion.terms.M, motion.terms.h
    root = np.linalg.cholesky(M).T
    return root, root @ np.linalg.solve(M, -h)
