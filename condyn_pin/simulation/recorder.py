"""Recorder: the samples of a run, packed as they come."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene
from condyn_pin.simulation.contact_columns import candidates_of, row_names
from condyn_pin.simulation.contact_record import ContactRecord, joined

# Rows are packed into one array each time there are so many: a small array takes a hundred bytes
# more than its numbers.
BLOCK = 4096

# t, q, v, a, lam, tau, and of contacts that open and slide a row of their `ContactRecord`
Row = tuple[float, Array, Array, Array, Array, Array, Array]


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
        Where the rows of the scene, those of its contacts last, are among those of the trajectory.
    """

    scene: Scene
    samples: slice
    columns: tuple[int, ...]


class Recorder:
    """The samples of one phase.

    `rows` are the last ones, whose arrays are not written to later. Who appends packs at `BLOCK`.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.rows: list[Row] = []
        self._blocks: list[tuple[Array, ...]] = []
        self._packed = 0

    def add(self, row: Row) -> None:
        """Keep a sample."""
        if len(self.rows) >= BLOCK:
            self.pack()
        self.rows.append(row)

    @property
    def count(self) -> int:
        """How many samples there are."""
        return self._packed + len(self.rows)

    @property
    def last(self) -> float | None:
        """The time of the last sample [s]."""
        return self.rows[-1][0] if self.rows else None

    def drop_after(self, t: float) -> None:
        """Drop the last sample if it is later than t."""
        if self.rows and self.rows[-1][0] > t:
            self.rows.pop()

    def columns(self) -> tuple[Array, ...]:
        """Return t, q, v, a, lam and tau, a sample a row; of contacts what a row has of them."""
        blocks = [*self._blocks, _columns(self.rows)]
        return tuple(np.concatenate(parts) for parts in zip(*blocks, strict=True))

    def pack(self) -> None:
        """Put the rows into arrays, but for the last one, which may have to be dropped."""
        self._blocks.append(_columns(self.rows[:-1]))
        self._packed += len(self.rows) - 1
        del self.rows[:-1]


def _columns(rows: Sequence[Row]) -> tuple[Array, ...]:
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def merge(
    recorders: Sequence[Recorder],
) -> tuple[tuple[Phase, ...], tuple[Array, ...], ContactRecord | None]:
    """Return the phases of a run, t, q, v, a, lam and tau over all of them, and the contacts.

    The rows of lam are those of all constraints and contacts that a phase has, in the order in
    which they came; they are zero while one is away.
    """
    recorders = [recorder for recorder in recorders if recorder.count]
    names = [row_names(recorder.scene) for recorder in recorders]
    places = {name: i for i, name in enumerate(dict.fromkeys(n for each in names for n in each))}
    phases, parts, touches, start = [], [], [], 0
    for recorder, its in zip(recorders, names, strict=True):
        t, q, v, a, lam, tau, touch = recorder.columns()
        columns = tuple(places[name] for name in its)
        everything = np.zeros((recorder.count, len(places)))
        everything[:, list(columns)] = lam
        phases.append(Phase(recorder.scene, slice(start, start + recorder.count), columns))
        parts.append((t, q, v, a, everything, tau))
        touches.append(touch)
        start += recorder.count
    contact = None
    if touches[0].shape[1]:
        contact = joined([candidates_of(phase.scene).names for phase in phases], touches)
    return tuple(phases), tuple(np.concatenate(p) for p in zip(*parts, strict=True)), contact
