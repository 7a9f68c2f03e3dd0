"""Colours: those of Okabe and Ito, told apart by colour-blind eyes."""

from __future__ import annotations

import math
from typing import Final

from condyn_pin._core import tolerances
from condyn_pin.io.shapes import BODY as BODY
from condyn_pin.io.shapes import Colour as Colour

GHOST: Final[Colour] = (0.55, 0.55, 0.60)
ACTUATED: Final[Colour] = (0.902, 0.624, 0.0)  # orange
PASSIVE: Final[Colour] = (0.25, 0.25, 0.25)
CONTACT: Final[Colour] = (0.8, 0.475, 0.655)  # purple
GROUND: Final[Colour] = (0.80, 0.74, 0.62)
CONE: Final[Colour] = (0.941, 0.894, 0.259)  # yellow
AWAY: Final[Colour] = (0.55, 0.55, 0.55)
STICKS: Final[Colour] = CONTACT
SLIDES: Final[Colour] = (0.835, 0.369, 0.0)  # vermillion
FORCE: Final[Colour] = (0.0, 0.447, 0.698)  # blue
REACTION: Final[Colour] = (0.337, 0.706, 0.914)  # sky blue
MOMENT: Final[Colour] = (0.533, 0.133, 0.333)  # wine
SPRING: Final[Colour] = (0.35, 0.40, 0.55)
SUPPORT: Final[Colour] = (0.0, 0.62, 0.451)  # green
PRESSURE: Final[Colour] = (0.835, 0.369, 0.0)  # vermillion
CAPTURE: Final[Colour] = (0.941, 0.894, 0.259)  # yellow
DIVERGENT: Final[Colour] = (0.337, 0.706, 0.914)  # sky blue
GRID: Final[Colour] = (0.88, 0.88, 0.88)
MASS: Final[Colour] = (0.0, 0.0, 0.0)
AXES: Final[tuple[Colour, Colour, Colour]] = ((0.85, 0.1, 0.1), (0.1, 0.6, 0.1), (0.1, 0.2, 0.9))

CLOSED: Final[Colour] = (0.0, 0.62, 0.451)  # green
AJAR: Final[Colour] = (0.941, 0.894, 0.259)  # yellow
OPEN: Final[Colour] = (0.835, 0.369, 0.0)  # vermillion

_MODES: Final = {"open": AWAY, "stick": STICKS, "slide": SLIDES}
_WIDE: Final = 1e-2  # [m] a gap that everybody sees


def gap_colour(length: float) -> Colour:
    """Return the colour of a gap: green is closed, then from yellow to vermillion.

    Parameters
    ----------
    length : float
        [m]. Up to 1e-10 it is closed; from 1 cm on it is vermillion, and on a scale of
        logarithms in between.
    """
    if length <= tolerances.CLOSED:
        return CLOSED
    decades = math.log(_WIDE / tolerances.CLOSED)
    x = min(math.log(length / tolerances.CLOSED) / decades, 1.0)
    red, green, blue = (a + x * (b - a) for a, b in zip(AJAR, OPEN, strict=True))
    return red, green, blue


def mode_colour(mode: str) -> Colour:
    """Return the colour of a contact that is open, sticks or slides; of one that nobody asked."""
    return _MODES.get(mode, CONTACT)
