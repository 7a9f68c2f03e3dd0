"""Recorder: the samples of a run, packed as they come."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene

# Rows are packed into one array each time there are so many: a small array takes a hundred bytes
# more than its numbers.
_BLOCK = 4096

Row = tuple[float, Array, Array, Array, Array, Array]  # t, q, v, a, lam, tau


@dataclass(frozen=True, eq=False)
class Phase:
    """A part of a run with the same constraints.

    Attributes
    ----------
    scene : Scene
        With every contact anchored.
    samples : slice
        Its samples.
    columns : tuple of int
        Where the rows of the scene are among those of the trajectory.
    """

    scene: Scene
    samples: slice
    columns: tuple[int, ...]


class Recorder:
    """The samples of one phase.

    Parameters
    ----------
    scene : Scene
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.count = 0
        self._rows: list[Row] = []
        self._blocks: list[tuple[Array, ...]] = []

    def add(self, row: Row) -> None:
        """Keep a sample; its arrays are not written to later."""
        if len(self._rows) == _BLOCK:
            self._pack()
        self._rows.append(row)
        self.count += 1

    @property
    def last(self) -> float | None:
        """The time of the last sample [s]."""
        return self._rows[-1][0] if self._rows else None

    def drop_after(self, t: float) -> None:
        """Drop the last sample if it is later than t."""
        if self._rows and self._rows[-1][0] > t:
            self._rows.pop()
            self.count -= 1

    def columns(self) -> tuple[Array, ...]:
        """Return t, q, v, a, lam and tau, a sample a row."""
        self._pack()
        return tuple(np.concatenate(parts) for parts in zip(*self._blocks, strict=True))

    def _pack(self) -> None:
        if self._rows:
            self._blocks.append(tuple(np.array(c) for c in zip(*self._rows, strict=True)))
            self._rows.clear()


def merge(recorders: Sequence[Recorder]) -> tuple[tuple[Phase, ...], tuple[Array, ...]]:
    """Return the phases of a run, and t, q, v, a, lam and tau over all of them.

    The rows of lam are those of all constraints that a phase has, in the order in which they came;
    they are zero while a constraint is away.
    """
    recorders = [recorder for recorder in recorders if recorder.count]
    places: dict[str, int] = {}
    for recorder in recorders:
        for name in recorder.scene.row_names:
            places.setdefault(name, len(places))
    phases, parts, start = [], [], 0
    for recorder in recorders:
        t, q, v, a, lam, tau = recorder.columns()
        columns = tuple(places[name] for name in recorder.scene.row_names)
        everything = np.zeros((recorder.count, len(places)))
        everything[:, list(columns)] = lam
        phases.append(Phase(recorder.scene, slice(start, start + recorder.count), columns))
        parts.append((t, q, v, a, everything, tau))
        start += recorder.count
    return tuple(phases), tuple(np.concatenate(p) for p in zip(*parts, strict=True))
