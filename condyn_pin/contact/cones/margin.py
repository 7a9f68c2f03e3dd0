"""Margin and ConeRows: what a cone says of forces that are known, and of those to be found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from condyn_pin._core.arrays import Array

# What a contact does where its force leaves the cone. The later ones are often only consequences of
# the first: what pulls also slips, by numbers.
FAULTS: Final = ("pulls", "slips", "tips", "twists")


@dataclass(frozen=True, eq=False, repr=False)
class Margin:
    """How far forces are from leaving a cone; what is below zero has left it.

    Each has a number for each of k forces, and a single number for a single force. Where a contact
    is away all are infinite, and where there is no answer NaN. Impulses have [N s] in place of [N].

    Attributes
    ----------
    pulls : (k,) array
        Normal force [N].
    slips : (k,) array
        Tangential force that is left before it slips [N].
    tips : (k,) array
        Normal force on the edge that lifts first [N]; infinite for a point.
    twists : (k,) array
        Yaw torque that is left before it turns about the normal, over half_length + half_width, as
        a tangential force [N]; infinite for a point.
    noise : (k,) array
        The size of a force that counts as none [N].
    """

    pulls: Array
    slips: Array
    tips: Array
    twists: Array
    noise: Array  # [N]

    @property
    def least(self) -> Array:
        """The smallest of the four [N]; a floor can give the force if it is not negative."""
        return np.asarray(np.minimum.reduce(self._four))[()]

    @property
    def fault(self) -> str | Array:
        """Which of the four is violated, the first of them if several are; empty if none is.

        An array of text for many forces. "unknown" where there is no answer.
        """
        left = [four < -self.noise for four in self._four]
        found = np.select([np.isnan(self.least), *left], ["unknown", *FAULTS], "")
        return found if found.ndim else str(found)

    @property
    def _four(self) -> tuple[Array, ...]:
        return self.pulls, self.slips, self.tips, self.twists

    def __repr__(self) -> str:
        faults, least = np.ravel(self.fault), np.ravel(self.least)
        if least.size == 1:
            return f"Margin({least[0]:.4g} N{f': {faults[0]}' if faults[0] else ''})"
        counts = ((int((faults == each).sum()), each) for each in (*FAULTS, "unknown"))
        said = ", ".join(f"{n} {fault}" for n, fault in counts if n) or "no faults"
        worst = float(np.fmin.reduce(least, initial=np.inf))
        return f"Margin({least.size} forces, {worst:.4g} N at least: {said})"


@dataclass(frozen=True, eq=False)
class ConeRows:
    """Linear inequalities of forces, A f <= b, as a quadratic program takes them.

    Attributes
    ----------
    A : (r, m) array
        For the forces of a scene, columns in the order and sign of its `lam` [1, 1/m].
    names : tuple of str
        Of the rows: the contact, what it does where the row is violated, and on which side.
    """

    A: Array
    names: tuple[str, ...]

    @property
    def b(self) -> Array:
        """Zeros (r,) [N]: these are cones."""
        return np.zeros(len(self.A))
