"""Joints by name, for what acts along their coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from condyn_pin.constraints.contacts.base import Contact, Mode
from condyn_pin.constraints.protocols import Machine
from condyn_pin.errors import UnsupportedConstraint, unknown_name


def joint_named(machine: Machine, name: str) -> Any:
    """Return a joint of the model, or raise UnknownName."""
    if name not in machine.joints:
        raise unknown_name("joint", name, machine.joints)
    return machine.model.joints[machine.model.getJointId(name)]


def not_held(contact: Contact, joint: str, modes: Mapping[str, Mode] | None) -> tuple[()]:
    """Return no constraints, or raise UnsupportedConstraint if a candidate of a joint sticks."""
    for candidate, mode in (modes or {}).items():
        if mode == "stick" and contact.owns(candidate):
            raise UnsupportedConstraint(
                f"{candidate}: a joint that sticks is no constraint; scene.lock([{joint!r}], q)"
            )
    return ()
