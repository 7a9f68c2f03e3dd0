"""The centre of mass, and where it is above the ground."""

from __future__ import annotations

from collections.abc import Iterator

from condyn_pin.viewing import meshes
from condyn_pin.viewing.labels import label
from condyn_pin.viewing.palette import MASS
from condyn_pin.viewing.part import Part, at_point


def mass_parts(size: float) -> Iterator[Part]:
    """Return a ball in the centre of mass."""
    ball = meshes.sphere(0.015 * size)
    yield Part(
        "mass/centre", lambda at: at_point(at.com), ((ball, MASS),), opacity=0.9, on_top=True
    )
    yield label("mass/label", "centre of mass", MASS, lambda at: at_point(at.com), 0.024 * size)
