"""Dry friction of a joint.

|lam| <= torque,        lam = -torque sign(v) where it slides
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from condyn_pin._core._pin import dry_friction
from condyn_pin.constraints.constraint import (
    Constraint,
    FramedModel,
    MjcfGeomWriter,
    not_negative,
    text,
)
from condyn_pin.constraints.contacts.contact import Contact, Mode, joint_named, not_held
from condyn_pin.constraints.contacts.touches import BoundContact, BoundJointFriction
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class JointFriction(Contact):
    """Dry friction in a joint: it sticks up to a torque, and opposes sliding with it.

    |lam| <= torque,    lam = -torque sign(v) where it slides

    It has one row per coordinate.

    Parameters
    ----------
    joint : str
        Name of a joint of the robot.
    torque : float, optional
        The largest friction along each coordinate [N m, N]; that of the description by default.
    name : str, optional
        ``<joint>/friction`` by default.

    Raises
    ------
    InvalidArgument
        If `joint` is no name, or the torque is negative.
    """

    joint: str
    torque: float | None = None  # [N m, N]

    def __post_init__(self) -> None:
        text("joint", self.joint, "joint")
        if self.torque is not None:
            object.__setattr__(self, "torque", not_negative("torque", self.torque))
        self._set_name(f"{self.joint}/friction")

    def bind(self, machine: FramedModel) -> BoundContact:
        """Return a row for each coordinate of the joint."""
        joint = joint_named(machine, self.joint)
        numbers = range(joint.idx_v, joint.idx_v + joint.nv)
        described = dry_friction(machine.model)
        limits = [float(described[i]) if self.torque is None else self.torque for i in numbers]
        if self.torque is None and not any(limits):
            raise InvalidArgument(
                f"{self.name}: the description gives joint {self.joint!r} no friction; "
                "say torque=..."
            )
        names = [self.name] if joint.nv == 1 else [f"{self.name}/{i + 1}" for i in range(joint.nv)]
        return BoundContact(self.name, dry=tuple(map(BoundJointFriction, names, numbers, limits)))

    def held(self, modes: Mapping[str, Mode] | None) -> tuple[Constraint, ...]:
        """Return nothing; a joint that sticks is locked by `Scene.lock`, not by a constraint."""
        return not_held(self, self.joint, modes)

    def write_mjcf(self, to: MjcfGeomWriter) -> None:
        """Write the joint's frictionloss."""
        to.dry(self.joint, self.torque)
