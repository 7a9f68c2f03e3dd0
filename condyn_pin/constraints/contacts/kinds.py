"""All kinds of contacts that may open, and how those of a scene are bound to a robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import get_args

from condyn_pin.constraints.constraint import Constraint, FramedModel
from condyn_pin.constraints.contacts.cable import Cable as Cable
from condyn_pin.constraints.contacts.contact import CONTACTS as CONTACTS
from condyn_pin.constraints.contacts.contact import Contact, Mode
from condyn_pin.constraints.contacts.frictional_contact import (
    FrictionalContact as FrictionalContact,
)
from condyn_pin.constraints.contacts.ground import Ground
from condyn_pin.constraints.contacts.joint_friction import JointFriction as JointFriction
from condyn_pin.constraints.contacts.joint_limit import JointLimit as JointLimit
from condyn_pin.constraints.contacts.shapes import Ball, Plane, Point
from condyn_pin.constraints.contacts.shapes import Convex as Convex
from condyn_pin.constraints.contacts.touches import BoundContact
from condyn_pin.errors import InvalidArgument, InvalidConstraint, unknown_name


def bind_contacts(
    robot: FramedModel, contacts: Sequence[Contact], taken: Sequence[str] = ()
) -> tuple[BoundContact, ...]:
    """Bind contacts to a robot, in the order given.

    Raises
    ------
    InvalidConstraint
        If something is no contact, or a name is there twice: `taken` are those of constraints.
    InvalidArgument, UnknownName
        If a contact does not fit the robot.
    """
    names = set(taken)
    bound = []
    for contact in contacts:
        if not isinstance(contact, Contact):
            raise InvalidConstraint(
                f"{contact!r}: a FrictionalContact, a JointLimit, a JointFriction or a Cable is "
                "needed; what never opens belongs into the constraints"
            )
        made = contact.bind(robot)
        for name in dict.fromkeys((made.name, *made.candidates)):
            if name in names:
                raise InvalidConstraint(
                    f"two contacts are named {name!r}; give one a name=..., or leave one out: feet "
                    "are in robot.collisions() and in robot.frictional_contacts()"
                )
            names.add(name)
        bound.append(made)
    return tuple(bound)


def held_contacts(
    contacts: Sequence[Contact],
    bounds: Sequence[BoundContact],
    modes: Mapping[str, Mode] | None,
) -> tuple[Constraint, ...]:
    """Constraints that hold the candidates of contacts in some modes."""
    known = [name for bound in bounds for name in bound.candidates]
    for name, mode in (modes or {}).items():
        if name not in known:
            raise unknown_name("contact", name, known)
        if mode not in get_args(Mode):
            raise InvalidArgument(f"modes[{name!r}] = {mode!r}: open, slide or stick is needed")
    return tuple(constraint for contact in contacts for constraint in contact.held(modes))


# The feet of a robot as contacts that may open.


def feet_of(
    contacts: Sequence[Constraint], friction: float, on: Plane | Ground | None
) -> tuple[FrictionalContact, ...]:
    """Contacts of a robot as contacts that may open, by their points."""
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
