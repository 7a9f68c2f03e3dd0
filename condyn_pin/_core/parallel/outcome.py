"""Batches: many answers, a row each, and how each of them ended."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from enum import Enum
from typing import Any, ClassVar, Final, Generic, Self, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.html import facts, notes, page

# The status of a row that was not worked on.
MISSING: Final = -1

_SHOWN: Final = 10

One = TypeVar("One")
Some = slice | list[int] | NDArray[Any]  # of the rows, as NumPy takes them


class Batch(ABC, Generic[One]):
    """Many answers: ``batch[i]`` is one, ``batch[2:4]`` a batch of some."""

    @abstractmethod
    def __len__(self) -> int:
        """Return how many there are."""

    @abstractmethod
    def _one(self, i: int) -> One:
        """Return one answer."""

    @abstractmethod
    def _some(self, rows: Some) -> Self:
        """Return a batch of some."""

    @overload
    def __getitem__(self, i: int | np.integer[Any]) -> One: ...

    @overload
    def __getitem__(self, i: Some) -> Self: ...

    def __getitem__(self, i: int | np.integer[Any] | Some) -> One | Self:
        if isinstance(i, slice | list | np.ndarray):
            return self._some(i)
        return self._one(range(len(self))[i])

    def __iter__(self) -> Iterator[One]:
        return (self[i] for i in range(len(self)))


class Outcome:
    """What a batch says of its rows; `statuses` are places in `_endings`, and 0 is ok."""

    _endings: ClassVar[Sequence[Enum]]

    statuses: NDArray[np.int8]

    @property
    def ok(self) -> bool:
        """Whether every status is ok."""
        return not self.statuses.any()

    @property
    def failed(self) -> NDArray[np.intp]:
        """Indices of the rows whose status is not ok, the missing ones among them."""
        return np.flatnonzero(self.statuses)

    @property
    def missing(self) -> NDArray[np.intp]:
        """Indices of the rows that no worker got to: after a `WorkersLost` or an `Interrupted`."""
        return np.flatnonzero(self.statuses == MISSING)

    @property
    def counts(self) -> dict[str, int]:
        """How many rows have which status, by its name; those that none has are left out."""
        found = {name: int((self.statuses == i).sum()) for i, name in self._names.items()}
        return {name: number for name, number in found.items() if number}

    @property
    def status_names(self) -> list[str]:
        """The status of each row, by its name."""
        return [self._names[i] for i in self.statuses.tolist()]

    @property
    def _names(self) -> dict[int, str]:
        return {MISSING: "missing"} | {i: s.name.lower() for i, s in enumerate(self._endings)}

    def _repr_html_(self) -> str:
        """Return its summary as a notebook shows it."""
        bad = self._not_ok()
        title, *lines = [line for line in str(self).splitlines() if line not in bad]
        return page(title, notes(bad), facts(map(_in_two, lines)), ok=self.ok)

    def _counted(self) -> str:
        """Return the counts in words."""
        return ", ".join(f"{number} {name}" for name, number in self.counts.items()) or "none"

    def _not_ok(self) -> list[str]:
        """Return a line for each status but ok: the first few rows that have it, and what it is."""
        texts = {MISSING: "missing: no worker got to it"}
        texts |= {i: str(ending) for i, ending in enumerate(self._endings)}
        lines = []
        for code in dict.fromkeys(self.statuses[self.failed].tolist()):
            rows = np.flatnonzero(self.statuses == code).tolist()
            some = ", ".join(map(self._named, rows[:_SHOWN]))
            lines.append(f"not ok: {some}{', ...' if rows[_SHOWN:] else ''} ({texts[code]})")
        return lines

    def _named(self, i: int) -> str:
        """Return what to call a row."""
        return str(i)


def _in_two(line: str) -> tuple[str, str]:
    """Return what a line of a summary is about, and what it says."""
    label, gap, text = line.partition("  ")
    if not gap:  # a label that fills its column
        label, _, text = line.partition(" ")
    return label, text.strip()
