"""Samples: what is kept of many motions, and the arrays that hold it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.rows import Some
from condyn_pin._core.work import Arrays


@dataclass(frozen=True, eq=False, repr=False)
class Samples:
    """The samples of N motions; NaN after the end of one that broke down.

    Attributes
    ----------
    t : (N, k) array
        [s]
    q, v, a : (N, k, nq), (N, k, nv), (N, k, nv) array
    lam : (N, k, m) array
        Constraint forces in the axes of each constraint [N, N m].
    tau : (N, k, nv) array
        Torques applied, those of forces from outside with them, without springs and damping
        [N, N m].
    contact : (N, k, 4 + candidates) array or None
        `ContactRecord.columns` of each motion, where contacts may open.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    lam: Array
    tau: Array
    contact: Array | None = None

    @property
    def arrays(self) -> dict[str, Array]:
        """Those that there are, by name."""
        return {name: array for name, array in vars(self).items() if array is not None}

    def of(self, motions: Some) -> Samples:
        """Return those of some motions."""
        return Samples(**{name: read_only(x[motions]) for name, x in self.arrays.items()})


SAMPLED: Final = tuple(field.name for field in fields(Samples))


def samples_in(arrays: Arrays) -> Samples | None:
    """Return the samples among the arrays of a batch."""
    keys = {name: f"samples_{name}" for name in SAMPLED}
    found = {name: arrays[key] for name, key in keys.items() if key in arrays}
    return Samples(**found) if found else None
