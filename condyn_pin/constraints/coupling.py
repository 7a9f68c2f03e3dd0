"""Joints in proportion: gears, belts, differentials, mimic joints.

c = q_a - ratio q_b - offset,    or    c = sum w_i q_i - offset
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import Polynomial

from condyn_pin._core.arguments import listed
from condyn_pin._core.arrays import finite, text_of
from condyn_pin.constraints.constraint import (
    Constraint,
    FramedModel,
    MjcfWriter,
    check_size,
    floats,
    no_joint,
    text,
)
from condyn_pin.constraints.rows.special import BoundCoupling
from condyn_pin.errors import InvalidArgument, InvalidConstraint

_MJCF_DEGREE = 4  # of its polynomials


@dataclass(frozen=True)
class Coupling(Constraint):
    """Joints that move in fixed ratios: a gear, a belt, a differential, a mimic joint. 1 row.

    q_a = ratio q_b + offset,    or    sum w_i q_i = offset

    Parameters
    ----------
    joint_a : str or mapping of str to float
        A joint with one degree of freedom; or all joints that are coupled, each with its weight
        w_i: ``Coupling({"sun": 30.0, "ring": 70.0, "carrier": -100.0})``.
    joint_b : str
        The other joint; none where `joint_a` has them all.
    ratio : float
        [1], or [m/rad] and [rad/m] between a hinge and a slider.
    offset : float
        q_a where q_b is zero; the weighted sum [rad or m].
    higher : sequence of float
        k_2, k_3, ... of a curve, q_a = ratio q_b + offset + k_2 q_b^2 + k_3 q_b^3 + ..., in units
        of joint a by powers of those of joint b [rad, m].
    name : str, optional
        Name of the constraint; ``joint_a~joint_b`` by default.

    Raises
    ------
    InvalidArgument
        If a joint is no name, a number is not finite, or a weight or the ratio is zero: `HeldJoint`
        does that.

    Notes
    -----
    The force acts on joint a, along its coordinate [N m or N]; joint b feels -`ratio` times it.
    With weights the row is lam, and joint i feels w_i lam.
    """

    rows: ClassVar[int] = 1
    word: ClassVar[str] = "coupling"
    closes: ClassVar[bool] = True

    joint_a: str | Mapping[str, float]
    joint_b: str = ""
    ratio: float = 1.0
    offset: float = 0.0  # [rad or m]
    higher: Sequence[float] = ()

    def __post_init__(self) -> None:
        for argument in ("ratio", "offset"):
            number = float(finite(argument, getattr(self, argument), ()))
            check_size(argument, number)
            object.__setattr__(self, argument, number)
        count = len(self.higher) if isinstance(self.higher, Sequence) else 0
        object.__setattr__(self, "higher", floats("higher", self.higher, count))
        if isinstance(self.joint_a, str):
            text("joint_a", self.joint_a, "joint")
            text("joint_b", self.joint_b, "joint")
            if self.ratio == 0.0 and not any(self.higher):
                raise InvalidArgument(
                    "ratio = 0: that holds joint a still; HeldJoint does, or lock the joint"
                )
        else:
            object.__setattr__(self, "joint_a", _weights(self.joint_a))
            if self.joint_b or self.ratio != 1.0 or self.higher:
                raise InvalidArgument(
                    "joint_a has all joints with their weights: joint_b, ratio and higher are for "
                    "two joints"
                )
        self._set_name("~".join(self.joints))

    @property
    def weights(self) -> dict[str, float]:
        """Weight w_i of each joint, in c = sum w_i q_i - offset."""
        if isinstance(self.joint_a, str):
            return {self.joint_a: 1.0, self.joint_b: -self.ratio}
        return dict(self.joint_a)

    @property
    def joints(self) -> tuple[str, ...]:
        """All its joints."""
        return (self.joint_a, self.joint_b) if isinstance(self.joint_a, str) else (*self.weights,)

    def bind(self, machine: FramedModel, rows: slice) -> BoundCoupling:
        """Return the coupling on the coordinates of its joints."""
        if self.joint_a == self.joint_b:
            raise InvalidConstraint(f"{self.name}: both joints are {self.joint_a!r}")
        joints = [one_coordinate(machine, joint, self.name) for joint in self.joints]
        return BoundCoupling(
            self.name,
            rows,
            tuple(int(joint.idx_q) for joint in joints),
            tuple(int(joint.idx_v) for joint in joints),
            tuple(self.weights.values()),
            self.offset,
            ((), tuple(-k for k in self.higher)) if any(self.higher) else (),
        )

    def bind_to_drive(self, machine: FramedModel, rows: slice) -> BoundCoupling:
        """Return the coupling as it is."""
        return self.bind(machine, rows)

    def sides(self, machine: FramedModel) -> tuple[int, ...]:
        """Return the joints of the coupling."""
        for joint in self.joints:
            if joint not in machine.joints:
                raise no_joint(machine, joint)
        return tuple(machine.model.getJointId(joint) for joint in self.joints)

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return the first joint, the other joints, and no axes."""
        first, *others = self.joints
        return first, listed(others), ""

    def renamed(self, new: Callable[[str], str]) -> Coupling:
        """Return the coupling between joints of other names."""
        if isinstance(self.joint_a, str):
            return replace(
                self, name=new(self.name), joint_a=new(self.joint_a), joint_b=new(self.joint_b)
            )
        weights = {new(joint): weight for joint, weight in self.weights.items()}
        return replace(self, name=new(self.name), joint_a=weights)

    def with_held(self, values: Mapping[str, float]) -> Coupling:
        """Return the coupling of the joints not held; itself where fewer than two are left."""
        left = {joint: w for joint, w in self.weights.items() if joint not in values}
        if isinstance(self.joint_a, str) or len(left) < 2:
            return self
        held = sum(w * values[joint] for joint, w in self.weights.items() if joint in values)
        return replace(self, joint_a=left, offset=self.offset - held)

    def in_units(self, length: float, of_joint: Callable[[str], float]) -> Coupling:
        """Return the coupling with its coordinates in other units."""
        units = [of_joint(joint) for joint in self.joints]
        first, offset = units[0], units[0] * self.offset
        if isinstance(self.joint_a, str):
            a, b = units
            higher = tuple(k * a / b**n for n, k in enumerate(self.higher, 2))
            return replace(self, ratio=a / b * self.ratio, offset=offset, higher=higher)
        weights = {
            joint: first / unit * weight
            for unit, (joint, weight) in zip(units, self.weights.items(), strict=True)
        }
        return replace(self, joint_a=weights, offset=offset)

    @property
    def in_mjcf(self) -> bool:
        """True unless the curve is of a degree above 4."""
        return len(self.higher) < _MJCF_DEGREE

    def write_mjcf(self, to: MjcfWriter) -> None:
        """Write an equality of joints or of a tendon, which count from where the file draws them.

        With joints at r there, q_a - r_a = p(q_b - r_b), and sum w_i (q_i - r_i) = p(0).
        """
        drawn = np.array([to.coordinate(joint) for joint in self.joints])
        if isinstance(self.joint_a, str):
            a, b = drawn
            shifted = Polynomial((self.offset, self.ratio, *self.higher))(Polynomial((b, 1.0))) - a
            p = [*shifted.coef, *5 * [0.0]][:5]
            to.equate("joint", name=self.name, joint1=self.joint_a, joint2=self.joint_b, polycoef=p)
            return
        tendon = to.fixed_tendon(self.name, self.weights)
        shift = self.offset - float(np.dot([*self.weights.values()], drawn))
        to.equate("tendon", name=self.name, tendon1=tendon, polycoef=[shift, 0.0, 0.0, 0.0, 0.0])


def _weights(given: Any) -> tuple[tuple[str, float], ...]:
    """Pairs of joints and their weights."""
    pairs = tuple(given.items()) if isinstance(given, Mapping) else given
    if not isinstance(pairs, Sequence) or not all(
        isinstance(pair, Sequence) and len(pair) == 2 for pair in pairs
    ):
        raise InvalidArgument(
            f"joint_a = {text_of(given)}: the name of a joint, or a weight by joint, is needed"
        )
    names = [text("joint_a", name, "joint") for name, _ in pairs]
    weights = floats("joint_a", [weight for _, weight in pairs], len(pairs))
    if len(set(names)) != len(names) or len(names) < 2:
        raise InvalidArgument(
            f"joint_a = {text_of(given)}: two different joints are needed or more"
        )
    for name, weight in zip(names, weights, strict=True):
        if weight == 0.0:
            raise InvalidArgument(f"joint_a: the weight of {name!r} is 0; leave it out")
    return tuple(zip(names, weights, strict=True))


def one_coordinate(machine: FramedModel, name: str, of: str) -> Any:
    """Joint of the model with one coordinate, for a constraint of some name, or raise."""
    if name not in machine.joints:
        raise no_joint(machine, name)
    joint = machine.model.joints[machine.model.getJointId(name)]
    if joint.nq != 1 or joint.nv != 1:
        raise InvalidConstraint(
            f"{of}: joint {name!r} has nq {joint.nq}, nv {joint.nv}; joints with "
            "one number are needed (a continuous joint counts as cos and sin: read it as "
            "revolute)"
        )
    return joint
