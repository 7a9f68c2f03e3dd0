"""Rows of a constraint as numbers: what the compiled core has in place of a bound constraint."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

# How the core evaluates rows, by their number there (`native/src/core/constraint.hpp`).
HELD, BALL, WELD, CUT, ROD, COUPLING, ROLL = range(7)

# Rotation by rows and translation of a frame that stays where its joint is.
STILL: Final = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


class CompiledRows(NamedTuple):
    """The rows of one constraint.

    Attributes
    ----------
    integers : list of int
        How they are evaluated, first row and number of rows, joint 1 and 2, which of the six rows
        as bits, anchored, axis or axle (-1 of a ball), hinge, slider, and of a coupling where q and
        v hold its joints: 14.
    numbers : list of float
        Placements 1 and 2, 12 each; sign, length or radius [m] or ratio, offset: 27.
    """

    integers: list[int]
    numbers: list[float]


def placement(M: Any) -> list[float]:
    """Return 12 numbers of a placement: the rotation by rows, and the translation [m]."""
    return [*M.rotation.ravel(), *M.translation]
