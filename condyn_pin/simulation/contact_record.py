"""ContactRecord: what a run keeps of contacts that open and slide, beside their forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.contact.modes import MODES, OPEN, Modes

# Of one step: modes of all candidates, natural residual, work of all contacts since the start [J].
Touch = tuple[Modes, float, float]


@dataclass(frozen=True, eq=False)
class ContactRecord:
    """Contacts at the samples of a trajectory.

    Attributes
    ----------
    names : tuple of str
        Of the candidates.
    codes : (k, candidates) array of int
        Modes, as places in `MODES`; open while a candidate is away.
    natural : (k,) array
        Natural residual of the contact problem of the step that ends there, without a unit.
    work : (k,) array
        Of all contacts since the start [J]; friction and impacts make it negative.
    """

    names: tuple[str, ...]
    codes: Modes
    natural: Array
    work: Array  # [J]

    @property
    def packed(self) -> Array:
        """All of it as one array (k, 2 + candidates): natural, work and codes."""
        return np.column_stack((self.natural, self.work, self.codes))

    @staticmethod
    def unpacked(names: Sequence[str], packed: Array) -> ContactRecord:
        """Return what was packed, with the names of the candidates."""
        natural, work, codes = packed[:, 0], packed[:, 1], packed[:, 2:]
        if codes.shape[1] != len(names) or not np.isin(codes, range(len(MODES))).all():
            raise ValueError(f"contact: modes of {len(names)} contacts are needed")
        return ContactRecord(tuple(names), codes.astype(np.int8), natural, work)

    @property
    def modes(self) -> dict[str, np.ndarray]:
        """Open, stick or slide at each sample (k,), by candidate."""
        words = np.array(MODES)[self.codes]
        return {name: words[:, i] for i, name in enumerate(self.names)}


def joined(
    names: Sequence[tuple[str, ...]], parts: Sequence[tuple[Modes, Array, Array]]
) -> ContactRecord:
    """Return the record of phases one after another, each with the names of its candidates."""
    places = {name: i for i, name in enumerate(dict.fromkeys(n for each in names for n in each))}
    codes = []
    for its, (modes, _, _) in zip(names, parts, strict=True):
        everything = np.full((len(modes), len(places)), OPEN, dtype=np.int8)
        everything[:, [places[name] for name in its]] = modes
        codes.append(everything)
    natural, work = (np.concatenate([part[i] for part in parts]) for i in (1, 2))
    return ContactRecord(tuple(places), np.concatenate(codes), natural, work)
