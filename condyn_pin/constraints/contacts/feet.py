"""The feet of a robot as contacts that may let go."""

from __future__ import annotations

from collections.abc import Sequence

from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
from condyn_pin.constraints.contacts.plane import Plane
from condyn_pin.constraints.contacts.shapes import Ball, Point
from condyn_pin.errors import InvalidArgument


def feet_of(
    contacts: Sequence[Constraint], friction: float, on: Plane | None
) -> tuple[FrictionalContact, ...]:
    """Return contacts of a robot as contacts that may let go, by their points."""
    for contact in contacts:
        if not contact.feet:
            raise InvalidArgument(
                f"{contact.name}: nothing says which points of a {contact.called} touch; "
                "write a FrictionalContact for it yourself"
            )
    return tuple(
        FrictionalContact(
            foot.frame, Ball(foot.radius) if foot.radius else Point(), foot.offset,
            Plane() if on is None else on,
            friction=friction, name=foot.name,
        )
        for contact in contacts
        for foot in contact.feet
    )  # fmt: skip
