"""ContactEvent: an instant in which contacts strike, open, close, stick or slip."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import listed
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.problem import MODES, OPEN, SLIDE, STICK, Modes
from condyn_pin.simulation.contact_columns import contact_rows
from condyn_pin.simulation.events import Happened
from condyn_pin.simulation.recorder import Row

# An impulse that is rounding, relative to the largest.
_NONE = 1e-12


@dataclass(frozen=True, eq=False)
class ContactEvent:
    """What happened, with the samples before and after it.

    Attributes
    ----------
    what : str
        ``impact``, ``shock``, or nothing where only modes have changed.
    candidates : Candidates
    modes : pair of (candidates,) array
        Before and after.
    back : (candidates,) bool array
        Which of them slide before and after, in opposite directions.
    impulse : (rows,) array
        [N s, N m s]
    energy_lost : float
        [J]
    before, after : Row
        Samples.
    driven : float
        Work of driven constraints in it [J].
    """

    what: str
    candidates: Candidates
    modes: tuple[Modes, Modes]
    back: NDArray[np.bool_]
    impulse: Array
    energy_lost: float
    before: Row
    after: Row
    driven: float = 0.0

    @property
    def t(self) -> float:
        """When [s]."""
        return self.after[0]

    def at(self, t: float) -> ContactEvent:
        """Return the same at a time that differs by rounding."""
        return replace(self, before=(t, *self.before[1:]), after=(t, *self.after[1:]))

    def happened(self, sample: int) -> Happened:
        """Return it as a trajectory keeps it, with the place of the sample after it."""
        rows, names = contact_rows(self.candidates), self.candidates.names
        impulses = {name: self.impulse[rows[name]] for name in names}
        least = _NONE * float(np.abs(self.impulse).max(initial=0.0))
        struck = tuple((n, *x.tolist()) for n, x in impulses.items() if np.abs(x).max() > least)
        before, after = self.modes
        changed = tuple(
            (names[i], MODES[before[i]], MODES[after[i]])
            for i in np.flatnonzero((before != after) | self.back)
        )
        return Happened(
            self._called([name for name, *_ in struck]), self.t, sample, self.energy_lost,
            modes=changed, impulses=struck, driven=self.driven,
        )  # fmt: skip

    def _called(self, struck: list[str]) -> str:
        if self.what:
            return f"{self.what} of {listed(struck)}"
        before, after = self.modes
        kinds = {
            "lift-off": (before != OPEN) & (after == OPEN),
            "touch": (before == OPEN) & (after != OPEN),
            "slip": (before == STICK) & (after == SLIDE),
            "stick": (before == SLIDE) & (after == STICK),
            "reversal": self.back,
        }
        what, which = next((what, its) for what, its in kinds.items() if its.any())
        return f"{what} of {listed([self.candidates.names[i] for i in np.flatnonzero(which)])}"
