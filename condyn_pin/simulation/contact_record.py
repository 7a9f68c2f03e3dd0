"""ContactRecord: what a run keeps of contacts that open and slide, beside their forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import MODES, OPEN, Modes, mode_words
from condyn_pin.simulation.contact_work import ContactWork


@dataclass(frozen=True, eq=False)
class ContactRecord:
    """Contacts at the samples of a trajectory.

    Attributes
    ----------
    names : tuple of str
        Of the candidates.
    columns : (k, 4 + candidates) array
        Natural residual [1], three parts of `ContactWork` [J], and modes as places in `MODES` [1],
        open while a candidate is away: what a file has. Where constraints are driven, one column
        more has their work in steps with contacts [J].

    Raises
    ------
    ValueError
        If the columns are not those of so many contacts.
    """

    names: tuple[str, ...]
    columns: Array

    def __post_init__(self) -> None:
        more = self.columns.shape[1] - width(len(self.names))
        if more not in (0, 1) or not np.isin(self.codes, _CODES).all():
            raise ValueError(f"contact: modes of {len(self.names)} contacts are needed")

    @property
    def natural(self) -> Array:
        """Natural residual of the contact problem of the step that ends there (k,), no unit."""
        return self.columns[:, 0]

    @property
    def work(self) -> Array:
        """Work of friction and impacts since the start (k,) [J]; never positive."""
        return self.columns[:, 1]

    @property
    def correction(self) -> Array:
        """Work of pushing penetrations out, and of closing loops, since the start (k,) [J]."""
        return self.columns[:, 2]

    @property
    def algorithmic(self) -> Array:
        """Energy that impulses added against the contact laws since the start (k,) [J]."""
        return self.columns[:, 3]

    @property
    def codes(self) -> Array:
        """Modes (k, candidates), as places in `MODES`."""
        return codes_in(self.columns, len(self.names))

    @property
    def driven(self) -> Array | None:
        """Work of driven constraints in steps with contacts, since the start (k,) [J]."""
        last = width(len(self.names))
        return self.columns[:, last] if self.columns.shape[1] > last else None

    @property
    def modes(self) -> dict[str, NDArray[np.object_]]:
        """Open, stick or slide at each sample (k,), by candidate."""
        words = mode_words(self.codes)
        return {name: words[:, i] for i, name in enumerate(self.names)}


_CODES = range(len(MODES))

# Columns before the modes, and how many files of before have, whose work is all in one.
_WORKS, _WORKS_BEFORE = 4, 2


def width(candidates: int, *, is_driven: bool = False) -> int:
    """Return how many columns there are with so many candidates."""
    return _WORKS + candidates + is_driven


def touch_of(natural: float, work: ContactWork, modes: Modes, *, is_driven: bool = False) -> Array:
    """Return a row of the columns of a record."""
    *works, driven = work
    return np.concatenate(((natural, *works), modes, (driven,) if is_driven else ()))


def codes_in(columns: Array, candidates: int) -> Array:
    """Return the modes (..., candidates) in rows of a record, as places in `MODES`."""
    return columns[..., _WORKS : _WORKS + candidates]


def written_before(columns: Array, candidates: int) -> Array:
    """Return columns (..., 2 + candidates) of a file of before as they are now; others as is."""
    if columns.shape[-1] != _WORKS_BEFORE + candidates:
        return columns
    return np.insert(columns, [_WORKS_BEFORE] * (_WORKS - _WORKS_BEFORE), 0.0, axis=-1)


def joined(names: Sequence[tuple[str, ...]], parts: Sequence[Array]) -> ContactRecord:
    """Return the record of phases one after another, each with the names of its candidates."""
    places = {name: i for i, name in enumerate(dict.fromkeys(n for each in names for n in each))}
    widths = [width(len(its)) for its in names]
    is_driven = any(part.shape[1] > own for part, own in zip(parts, widths, strict=True))
    columns, driven = [], 0.0  # its work stays what it is while nothing is
    for its, own, part in zip(names, widths, parts, strict=True):
        everything = np.full((len(part), width(len(places), is_driven=is_driven)), float(OPEN))
        everything[:, [*range(_WORKS), *(_WORKS + places[name] for name in its)]] = part[:, :own]
        if is_driven:
            everything[:, -1] = part[:, own] if part.shape[1] > own else driven
            driven = everything[-1, -1]
        columns.append(everything)
    return ContactRecord(tuple(places), np.concatenate(columns))
