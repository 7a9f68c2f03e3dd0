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
    """Return what contacts have to say whose velocities Coulomb's law leaves open."""
    return [Note(each.kind, each.whole_names, each.text) for each in several]


@dataclass(frozen=True)
class Remark:
    """What steps of a run have to say.

    Attributes
    ----------
    text : str
        A sentence, as the first of them has it.
    t : float
        The time of the first [s].
    steps : int
        How many there are.
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
        """Count what a step from t has to say; one that is taken again counts once."""
        for kind, names, text in notes:
            made, last = self._made.get((kind, names), (Remark(text, t, 0), -1.0))
            if t > last:
                self._made[kind, names] = replace(made, steps=made.steps + 1), t

    def clear(self) -> None:
        """Forget all."""
        self._made.clear()

    @property
    def all(self) -> tuple[Remark, ...]:
        """All of them, in the order of their times."""
        return tuple(sorted((made for made, _ in self._made.values()), key=lambda one: one.t))
