"""Constraints sorted by the way in which their rows are evaluated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from condyn_pin.constraints.rows.bound import FRAME, POINT, AnyBound, Bound, Coupled, Rolled
from condyn_pin.constraints.rows.related import Related


class Sorted(NamedTuple):
    """The constraints of one scene, each in one of these, in the order of the scene."""

    held: list[Bound]  # on the world, in the axes of the body
    balls: list[Bound]
    welds: list[Bound]
    cut: list[Bound]  # with other rows than Pinocchio's
    rods: list[Bound]
    rolled: list[Rolled]
    related: list[Related]
    coupled: list[Coupled]


def sorted_by_rows(bounds: Sequence[AnyBound]) -> Sorted:
    """Return the constraints sorted."""
    pairs = [b for b in bounds if isinstance(b, Bound)]
    loops = [b for b in pairs if not b.is_held]
    return Sorted(
        held=[b for b in pairs if b.is_held],
        balls=[b for b in loops if b.selection == POINT],
        welds=[b for b in loops if b.selection == FRAME],
        cut=[b for b in loops if not (b.is_plain or b.is_rod)],
        rods=[b for b in loops if b.is_rod],
        rolled=[b for b in bounds if isinstance(b, Rolled)],
        related=[b for b in bounds if isinstance(b, Related)],
        coupled=[b for b in bounds if isinstance(b, Coupled)],
    )
