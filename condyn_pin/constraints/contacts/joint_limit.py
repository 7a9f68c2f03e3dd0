"""Stops of a joint.

lower <= q <= upper,        lam >= 0 at each,        (q - lower) lam = 0
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from condyn_pin._core.models import UNLIMITED, lengths
from condyn_pin.constraints.constraint import Constraint, FramedModel, MjcfGeomWriter, text
from condyn_pin.constraints.contacts.contact import Contact, Mode, joint_named, not_held
from condyn_pin.constraints.contacts.touches import BoundContact, BoundJointLimit
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class JointLimit(Contact):
    """The stops at the ends of the range of a joint: one row for each finite end.

    lower <= q <= upper,    lam >= 0,    lam = 0 where no stop is touched

    Parameters
    ----------
    joint : str
        A joint whose coordinates are plain numbers; its limits are those of the model.
    name : str, optional
        The joint's name by default.

    Raises
    ------
    InvalidArgument
        If `joint` is no name.

    Notes
    -----
    The force is the one away from the stop [N m, N].
    """

    joint: str

    def __post_init__(self) -> None:
        text("joint", self.joint, "joint")
        self._set_name(self.joint)

    def bind(self, machine: FramedModel) -> BoundContact:
        """Return its stops, the lower end of each coordinate first."""
        joint = joint_named(machine, self.joint)
        if joint.nq != joint.nv:
            raise InvalidArgument(
                f"{self.name}: joint {self.joint!r} is a {joint.shortname()}, whose coordinates "
                "have no ends; a joint that turns or shifts along its coordinates is needed"
            )
        ends = (("lower", 1.0, machine.model.lowerPositionLimit),
                ("upper", -1.0, machine.model.upperPositionLimit))  # fmt: skip
        coordinates = range(joint.idx_q, joint.idx_q + joint.nq)
        lower, upper = (limits[coordinates] for _, _, limits in ends)
        if (lower > upper).any():
            raise InvalidArgument(
                f"{self.name}: joint {self.joint!r} has its lower limit {lower.max():g} above the "
                f"upper one, {upper.min():g}; exchange those of the model"
            )
        stops = [
            BoundJointLimit(
                f"{self.name}/{end}" if joint.nv == 1 else f"{self.name}/{end} {k + 1}",
                joint.idx_q + k, joint.idx_v + k, sign, float(limits[joint.idx_q + k]), is_length,
            )
            for k, is_length in enumerate(lengths(joint))
            for end, sign, limits in ends
            if abs(limits[joint.idx_q + k]) < UNLIMITED
        ]  # fmt: skip
        if not stops:
            raise InvalidArgument(
                f"{self.name}: joint {self.joint!r} has no finite limit; set lowerPositionLimit "
                "and upperPositionLimit of the model, or leave it out"
            )
        return BoundContact(self.name, stops=tuple(stops))

    def held(self, modes: Mapping[str, Mode] | None) -> tuple[Constraint, ...]:
        """Return nothing; a joint that sticks is locked by `Scene.lock`, not by a constraint."""
        return not_held(self, self.joint, modes)

    def write_mjcf(self, to: MjcfGeomWriter) -> None:
        """Write nothing: each joint has its range."""
