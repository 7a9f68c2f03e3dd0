"""All families of hard questions by name: those of scenes, and those of contact."""

from __future__ import annotations

from condyn_pin.lab.contact_extremes import CONTACT_EXTREMES
from condyn_pin.lab.contact_extremes.base import ContactExtreme
from condyn_pin.lab.extremes.base import EXTREMES, Extreme


def families() -> dict[str, Extreme | ContactExtreme]:
    """Return what `EXTREMES` and `CONTACT_EXTREMES` have; a severity is one of each."""
    return {**EXTREMES, **CONTACT_EXTREMES}
