"""Construction of a Pinocchio tree, joint by joint, for readers and mechanisms.

`DrawnTree` takes bodies where they are drawn, as MJCF has them. A body b moves from there by its
joints one after the other. With p the point and s the axis of a joint, q its coordinate and q0 the
one as drawn,

    parentMb(q) = parentMb · Π T(p) · E(q - q0) · T(-p),      E(q - q0) = E(-q0) · E(q),

E(q) the turn about s by q, or the shift along it. Pinocchio's joint stands after T(p) · E(-q0) and
what follows it at T(-p), so that a coordinate means the same as in MuJoCo. A free joint is the pose
in the world.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import UNLIMITED
from condyn_pin.errors import InvalidModel


class TreeBuilder:
    """Pinocchio model under construction."""

    def __init__(self, name: str) -> None:
        self.model = pin.Model()
        self.model.name = name
        self._names = {"universe"}

    def add_joint(
        self,
        carrier: int,
        joint: Any,
        iMj: Any,
        name: str,
        *,
        limits: Sequence[float] = (),
        armature: float = 0.0,
        damping: float = 0.0,
    ) -> int:
        """Add a joint on another one; its limits are effort, velocity, lower and upper position."""
        given = [np.array([x]) for x in np.clip(limits, -UNLIMITED, UNLIMITED)]
        i = int(self.model.addJoint(carrier, joint, orthonormal(iMj), name, *given))
        rows = slice(self.model.joints[i].idx_v, self.model.nv)
        for key, value in (("armature", armature), ("damping", damping)):
            values = getattr(self.model, key).copy()
            values[rows] = value
            setattr(self.model, key, values)
        return i

    def add_frame(
        self, name: str, carrier: int, iMf: Any, kind: str, inertia: Any = None, before: int = 0
    ) -> int:
        """Add a frame, and the inertia that it brings, to a joint; return its number."""
        # Pinocchio would return the older frame of the same name and type without a word.
        if name in self._names:
            raise InvalidModel(f"two frames would be named {name!r}; rename one")
        self._names.add(name)
        inertia = pin.Inertia.Zero() if inertia is None else inertia
        kind = getattr(pin.FrameType, kind)
        frame = pin.Frame(name, carrier, before, orthonormal(iMf), kind, inertia)
        return int(self.model.addFrame(frame))


@dataclass(frozen=True, eq=False)
class DrawnJoint:
    """A joint of kind free, ball, slide or hinge, where it is drawn in the axes of its body."""

    name: str
    kind: str
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # unit vector
    point: Array = field(default_factory=lambda: np.zeros(3))  # where it is [m]
    reference: float = 0.0  # its coordinate as drawn [rad or m]
    lower: float = -inf  # [rad or m]
    upper: float = inf
    armature: float = 0.0  # [kg m^2 or kg]
    damping: float = 0.0  # [N m s/rad or N s/m]
    effort: float = inf  # largest torque of its motors [N m or N]

    @property
    def scalar(self) -> bool:
        """True if the joint has one coordinate."""
        return self.kind in ("slide", "hinge")


class DrawnTree(TreeBuilder):
    """A tree of bodies that are given where they are drawn.

    bodies: names that bodies will have: a joint of such a name gets no frame
    """

    def __init__(self, name: str, bodies: Collection[str] = ()) -> None:
        super().__init__(name)
        self.drawn = {"world": pin.SE3.Identity()}  # oMb
        self.joints: dict[str, DrawnJoint] = {}
        self._bodies = bodies
        self._on = {"world": (0, pin.SE3.Identity())}  # by body: Pinocchio's joint i, and iMb
        self._floating: dict[str, str] = {}  # free joints, and what they move

    def add_body(
        self,
        name: str,
        parent: str,
        parentMb: Any,
        joints: Iterable[DrawnJoint] = (),
        inertia: Any = None,
    ) -> None:
        """Add a body on another one, and the joints between them, each moving what comes after it.

        What is fixed to the world moves nothing: its inertia is left out.
        """
        self.drawn[name] = self.drawn[parent] * parentMb
        i, iMparent = self._on[parent]
        iMb = iMparent * parentMb
        for joint in joints:
            i, iMb = self._add(joint, i, iMb)
            if joint.kind == "free":
                self._floating[joint.name] = name
            if joint.name not in self._bodies:
                self.model.addJointFrame(i)
        self._on[name] = i, iMb
        self.add_frame(name, i, iMb, "BODY", inertia if i else None)

    def mark(self, name: str, body: str, bMx: Any) -> None:
        """Add a frame x that moves with a body."""
        i, iMb = self._on[body]
        self.add_frame(name, i, iMb * bMx, "OP_FRAME")

    def _add(self, joint: DrawnJoint, carrier: int, iMb: Any) -> tuple[int, Any]:
        """Pinocchio's joint, and the placement of the body on it."""
        if joint.name in self.joints:
            raise InvalidModel(f"two joints are named {joint.name!r}; rename one")
        self.joints[joint.name] = joint
        to_point = pin.SE3(np.eye(3), joint.point)
        limits: tuple[float, ...] = ()
        if joint.kind == "free":
            made, carrier, iMj, jMb = pin.JointModelFreeFlyer(), 0, *[pin.SE3.Identity()] * 2
        elif joint.kind == "ball":
            made, iMj, jMb = pin.JointModelSpherical(), iMb * to_point, to_point.inverse()
        else:
            hinge, back = joint.kind == "hinge", -joint.reference * joint.axis
            E = pin.SE3(pin.exp3(back), np.zeros(3)) if hinge else pin.SE3(np.eye(3), back)
            made = one_coordinate(joint.axis, hinge=hinge)
            iMj, jMb = iMb * to_point * E, to_point.inverse()
            limits = (joint.effort, inf, joint.lower, joint.upper)
        settings = {"armature": joint.armature, "damping": joint.damping}
        return self.add_joint(carrier, made, iMj, joint.name, limits=limits, **settings), jMb

    def configuration(self) -> Array:
        """Configuration (nq,) of the tree as drawn."""
        q = np.array(pin.neutral(self.model))
        for name, joint in self.joints.items():
            start = self.model.joints[self.model.getJointId(name)].idx_q
            if joint.kind == "free":
                q[start : start + 7] = pin.SE3ToXYZQUAT(self.drawn[self._floating[name]])
            elif joint.scalar:
                q[start] = joint.reference
        return q


def orthonormal(M: Any) -> Any:
    """Pose with the nearest rotation: R + R (1 - RᵀR) / 2, a step of Newton's method."""
    # This ends at 4e-16 off orthonormal; the normalised quaternion and the SVD end at 2e-15.
    R = M.rotation
    return pin.SE3(R + 0.5 * R @ (np.eye(3) - R.T @ R), M.translation)


def one_coordinate(axis: Array | None, *, hinge: bool) -> Any:
    """Pinocchio's hinge or slider along a unit vector."""
    x, y, z = np.asarray(axis)
    along = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}.get((x, y, z))
    if along is not None:  # Pinocchio computes faster along these
        return getattr(pin, f"JointModel{'R' if hinge else 'P'}{along}")()
    return (pin.JointModelRevoluteUnaligned if hinge else pin.JointModelPrismaticUnaligned)(x, y, z)
