"""One joint at a value: c = q - value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

from condyn_pin._core.arrays import finite
from condyn_pin.constraints.constraint import (
    Constraint,
    FramedModel,
    MjcfWriter,
    check_size,
    no_joint,
    text,
)
from condyn_pin.constraints.coupling import one_coordinate
from condyn_pin.constraints.rows.special import BoundCoupling


@dataclass(frozen=True)
class HeldJoint(Constraint):
    """A joint held at a value, as by a brake or a stiff motor. 1 row.

    q = value

    Driven, it is the motor of a given motion: ``Driven(HeldJoint("crank"), along=Sine(0.3))``. A
    joint that never moves is better left out: `Scene.lock`.

    Parameters
    ----------
    joint : str
        A joint with one degree of freedom.
    value : float
        Where the joint is held [rad or m].
    name : str, optional
        Name of the constraint; that of the joint by default.

    Raises
    ------
    InvalidArgument
        If `joint` is no name, or the value is not finite.

    Notes
    -----
    The force is the one on the joint, along its coordinate [N m or N].
    """

    rows: ClassVar[int] = 1
    closes: ClassVar[bool] = True
    in_mjcf: ClassVar[bool] = True

    joint: str
    value: float = 0.0  # [rad or m]

    def __post_init__(self) -> None:
        text("joint", self.joint, "joint")
        number = float(finite("value", self.value, ()))
        check_size("value", number)
        object.__setattr__(self, "value", number)
        self._set_name(self.joint)

    @property
    def joints(self) -> tuple[str, ...]:
        """The joint."""
        return (self.joint,)

    def bind(self, machine: FramedModel, rows: slice) -> BoundCoupling:
        """Return the constraint on the coordinate of its joint."""
        joint = one_coordinate(machine, self.joint, self.name)
        q, v = int(joint.idx_q), int(joint.idx_v)
        return BoundCoupling(self.name, rows, (q,), (v,), (1.0,), self.value)

    def bind_to_drive(self, machine: FramedModel, rows: slice) -> BoundCoupling:
        """Return the constraint as it is."""
        return self.bind(machine, rows)

    def sides(self, machine: FramedModel) -> tuple[int, ...]:
        """Return the joint and its parent."""
        if self.joint not in machine.joints:
            raise no_joint(machine, self.joint)
        joint = machine.model.getJointId(self.joint)
        return joint, int(machine.model.parents[joint])

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return the joint, the body before it, and no axes."""
        return self.joint, "the body before it", ""

    def in_units(self, length: float, of_joint: Callable[[str], float]) -> HeldJoint:
        """Return the constraint with its coordinate in other units."""
        return replace(self, value=of_joint(self.joint) * self.value)

    def write_mjcf(self, to: MjcfWriter) -> None:
        """Write an equality of one joint; MuJoCo counts from the coordinate in the file."""
        shift = self.value - to.coordinate(self.joint)
        polynomial = [shift, 0.0, 0.0, 0.0, 0.0]
        to.equate("joint", name=self.name, joint1=self.joint, polycoef=polynomial)
