"""Remarks: sentences of the steps of a run, each once, with its first time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

from condyn_pin.contact.indeterminacy import Indeterminacy


class Note(NamedTuple):
    """A sentence of one step, with the contacts that it is of."""

    kind: str
    names: tuple[str, ...]  # of contacts
    text: str


def notes_of(several: Iterable[Indeterminacy]) -> list[Note]:
    """Notes on contacts whose velocities Coulomb's law does not determine."""
    return [Note(each.kind, each.whole_names, each.text) for each in several]


@dataclass(frozen=True)
class Remark:
    """Message of one or more steps of a run, with its first time.

    Attributes
    ----------
    text : str
        Sentence of the first step.
    t : float
        Time of the first step [s].
    steps : int
        Number of steps with this message.
    """

    text: str
    t: float  # [s]
    steps: int = 1

    def __str__(self) -> str:
        more = f", in {self.steps} steps" if self.steps > 1 else ""
        return f"from t = {self.t:.4g} s{more}: {self.text}"


class Remarks:
    """Remarks of a run in progress: one of a kind for the same contacts."""

    def __init__(self) -> None:
        self._made: dict[tuple[str, tuple[str, ...]], tuple[Remark, float]] = {}

    def note(self, t: float, notes: Iterable[Note]) -> None:
        """Count the notes of a step from t; a step that is taken again counts once."""
        for kind, names, text in notes:
            made, last = self._made.get((kind, names), (Remark(text, t, 0), -1.0))
            if t > last:
                self._made[kind, names] = replace(made, steps=made.steps + 1), t

    def clear(self) -> None:
        """Remove all remarks."""
        self._made.clear()

    @property
    def all(self) -> tuple[Remark, ...]:
        """Remarks in the order of their times."""
        return tuple(sorted((made for made, _ in self._made.values()), key=lambda one: one.t))
