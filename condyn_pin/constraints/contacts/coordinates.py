"""Joints by name, for what acts along their coordinates."""

from __future__ import annotations

from typing import Any

from condyn_pin.constraints.protocols import Machine
from condyn_pin.errors import unknown_name


def joint_named(machine: Machine, name: str) -> Any:
    """Return a joint of the model, or raise UnknownName."""
    if name not in machine.joints:
        raise unknown_name("joint", name, machine.joints)
    return machine.model.joints[machine.model.getJointId(name)]
