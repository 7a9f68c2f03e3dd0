"""ContactRecord: what a run keeps of contacts that open and slide, beside their forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.contact.modes import MODES, OPEN, Modes


@dataclass(frozen=True, eq=False)
class ContactRecord:
    """Contacts at the samples of a trajectory.

    Attributes
    ----------
    names : tuple of str
        Of the candidates.
    columns : (k, 2 + candidates) array
        Natural residual [1], work [J], and modes as places in `MODES` [1], open while a candidate
        is away: what a file has.
    """

    names: tuple[str, ...]
    columns: Array

    def __post_init__(self) -> None:
        if self.columns.shape[1] != 2 + len(self.names) or not np.isin(self.codes, _CODES).all():
            raise ValueError(f"contact: modes of {len(self.names)} contacts are needed")

    @property
    def natural(self) -> Array:
        """Natural residual of the contact problem of the step that ends there (k,), no unit."""
        return self.columns[:, 0]

    @property
    def work(self) -> Array:
        """Work of all contacts since the start (k,) [J]; friction and impacts make it negative."""
        return self.columns[:, 1]

    @property
    def codes(self) -> Array:
        """Modes (k, candidates), as places in `MODES`."""
        return self.columns[:, 2:]

    @property
    def modes(self) -> dict[str, NDArray[np.str_]]:
        """Open, stick or slide at each sample (k,), by candidate."""
        words = np.array(MODES)[self.codes.astype(int)]
        return {name: words[:, i] for i, name in enumerate(self.names)}


_CODES = range(len(MODES))


def touch_of(natural: float, work: float, modes: Modes) -> Array:
    """Return a row of the columns of a record."""
    return np.concatenate(((natural, work), modes))


def joined(names: Sequence[tuple[str, ...]], parts: Sequence[Array]) -> ContactRecord:
    """Return the record of phases one after another, each with the names of its candidates."""
    places = {name: i for i, name in enumerate(dict.fromkeys(n for each in names for n in each))}
    columns = []
    for its, part in zip(names, parts, strict=True):
        everything = np.full((len(part), 2 + len(places)), float(OPEN))
        everything[:, [0, 1, *(2 + places[name] for name in its)]] = part
        columns.append(everything)
    return ContactRecord(tuple(places), np.concatenate(columns))
