"""Two joints in proportion.

c = q_a - ratio q_b - offset
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from condyn_pin._core.arrays import finite
from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.constraint_fields import check_size, text
from condyn_pin.constraints.protocols import Machine, MjcfWriter
from condyn_pin.constraints.rows.couplings import Coupled
from condyn_pin.errors import InvalidArgument, InvalidConstraint, unknown_name


@dataclass(frozen=True)
class Coupling(Constraint):
    """Two joints that move in a fixed ratio: a gear, a belt, a mimic joint. 1 row.

    q_a = ratio q_b + offset

    Parameters
    ----------
    joint_a, joint_b : str
        Joints with one degree of freedom.
    ratio : float
        [1], or [m/rad] and [rad/m] between a hinge and a slider.
    offset : float
        q_a where q_b is zero [rad or m].
    name : str, optional
        Name of the constraint; ``joint_a~joint_b`` by default.

    Raises
    ------
    InvalidArgument
        If a joint is no name, a number is not finite, or the ratio is zero: `HeldJoint` does that.

    Notes
    -----
    The force acts on joint a, along its coordinate [N m or N]; joint b feels -`ratio` times it.
    """

    rows: ClassVar[int] = 1
    word: ClassVar[str] = "coupling"
    closes: ClassVar[bool] = True
    in_mjcf: ClassVar[bool] = True

    joint_a: str
    joint_b: str
    ratio: float = 1.0
    offset: float = 0.0  # [rad or m]

    def __post_init__(self) -> None:
        text("joint_a", self.joint_a, "joint")
        text("joint_b", self.joint_b, "joint")
        for argument in ("ratio", "offset"):
            number = float(finite(argument, getattr(self, argument), ()))
            check_size(argument, number)
            object.__setattr__(self, argument, number)
        if self.ratio == 0.0:
            raise InvalidArgument(
                "ratio = 0: that holds joint a still; HeldJoint does, or lock the joint"
            )
        self._set_name(f"{self.joint_a}~{self.joint_b}")

    @property
    def joints(self) -> tuple[str, ...]:
        """Both joints."""
        return self.joint_a, self.joint_b

    def bind(self, machine: Machine, rows: slice) -> Coupled:
        """Return it on the coordinates of its joints."""
        if self.joint_a == self.joint_b:
            raise InvalidConstraint(f"{self.name}: both joints are {self.joint_a!r}")
        a, b = (one_coordinate(machine, joint, self.name) for joint in self.joints)
        return Coupled(
            self.name, rows, (int(a.idx_q), int(b.idx_q)), (int(a.idx_v), int(b.idx_v)),
            self.ratio, self.offset,
        )  # fmt: skip

    def bind_to_drive(self, machine: Machine, rows: slice) -> Coupled:
        """Return it as it is."""
        return self.bind(machine, rows)

    def sides(self, machine: Machine) -> tuple[int, int]:
        """Return the two joints."""
        for joint in self.joints:
            if joint not in machine.joints:
                raise unknown_name("joint", joint, machine.joints)
        a, b = (machine.model.getJointId(joint) for joint in self.joints)
        return a, b

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return that its force is on joint a by joint b, in no axes."""
        return self.joint_a, self.joint_b, ""

    def in_units(self, length: float, of_joint: Callable[[str], float]) -> Coupling:
        """Return it with both coordinates in other units."""
        a, b = of_joint(self.joint_a), of_joint(self.joint_b)
        return replace(self, ratio=a / b * self.ratio, offset=a * self.offset)

    def write_mjcf(self, to: MjcfWriter) -> None:
        """Write an equality of joints: MuJoCo counts both from where the file draws them."""
        a, b = (to.coordinate(joint) for joint in self.joints)
        shift = self.offset - a + self.ratio * b
        polynomial = [shift, self.ratio, 0.0, 0.0, 0.0]
        to.equate(
            "joint", name=self.name, joint1=self.joint_a, joint2=self.joint_b, polycoef=polynomial
        )


def one_coordinate(machine: Machine, name: str, of: str) -> Any:
    """Return a joint of the model with one coordinate, for a constraint of some name, or raise."""
    if name not in machine.joints:
        raise unknown_name("joint", name, machine.joints)
    joint = machine.model.joints[machine.model.getJointId(name)]
    if joint.nq != 1 or joint.nv != 1:
        raise InvalidConstraint(
            f"{of}: joint {name!r} has nq {joint.nq}, nv {joint.nv}; joints with "
            "one number are needed (a continuous joint counts as cos and sin: read it as "
            "revolute)"
        )
    return joint
