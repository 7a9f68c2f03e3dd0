"""A Pinocchio tree, joint by joint, and the frames of what closes its loops.

With o the model frame, j a joint between the links p (parent) and c (child), and i the Pinocchio
joint that carries a link, the placements are

    pMj = oMp⁻¹ · oMj        jMc = oMj⁻¹ · oMc
    joint j in the tree:  placed in p's Pinocchio joint at  iMp · pMj;  it carries c at  jMc
    fixed joint:          c is carried by p's Pinocchio joint at  iMp · pMj · jMc
    cut joint:            frame_a at  iMp · pMj  and  frame_b at  iMc · jMc⁻¹  must coincide,
                          both turned so that z is the axis of a hinge or slider

and at the configuration in which the file draws the model, they do. Each factor of these products
adds a rounding to the rotation; what goes into the model is made orthonormal once more.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.errors import InvalidModel
from condyn_pin.io.sdf_types import WORLD, Closure, Description, Joint
from condyn_pin.io.tree import NO_LIMIT, one_coordinate, orthonormal

_CLOSURE_KINDS: Final[Mapping[str, str]] = {
    "ball": "ball",
    "fixed": "weld",
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slider",
}


class Tree:
    """A Pinocchio model while it grows: where each link is drawn, and its frame in the model."""

    def __init__(self, sdf: Description) -> None:
        self.model = pin.Model()
        self.model.name = sdf.name
        self.poses = {link.name: link.pose for link in sdf.links} | {WORLD: sdf.pose.inverse()}
        self.links = {link.name: link for link in sdf.links}
        self.frames = {WORLD: 0}  # Pinocchio's frame 0 is the universe

    def plant(self, start: str, root_joint: Any | None) -> None:
        """Add the root link; the world itself is there already."""
        if start == WORLD:
            return
        if root_joint is None:
            wMlink = self.poses[WORLD].actInv(self.poses[start])
            self._carry(start, 0, 0, wMlink)
            return
        identity = pin.SE3.Identity()
        i = self.model.addJoint(0, root_joint, identity, "root_joint")
        self._carry(start, i, self._frame("root_joint", i, 0, identity, "JOINT"), identity)

    def attach(self, joint: Joint) -> None:
        """Add a joint of the tree and its child link."""
        carrier, iMj = self._placement(joint.parent, joint.pose)
        before = self.frames[joint.parent]
        if joint.kind == "fixed":
            frame = self._frame(joint.name, carrier, before, iMj, "FIXED_JOINT")
        else:
            carrier = self._add_joint(joint, carrier, iMj)
            iMj = pin.SE3.Identity()
            frame = self._frame(joint.name, carrier, before, iMj, "JOINT")
        jMc = joint.pose.actInv(self.poses[joint.child])
        self._carry(joint.child, carrier, frame, iMj * jMc)

    def parts(self, joint: Joint) -> bool:
        """Whether the two links of a joint can move against each other."""
        first, second = (self.frames[link] for link in (joint.parent, joint.child))
        frames = self.model.frames
        return bool(frames[first].parentJoint != frames[second].parentJoint)

    def close(self, joint: Joint) -> Closure:
        """Add the two frames of a cut joint."""
        oMj = joint.pose
        if joint.has_axis:
            oMj = oMj * pin.SE3(_z_along(joint.axis.direction), np.zeros(3))
        ends = f"{joint.name}_a", f"{joint.name}_b"
        for name, link in zip(ends, (joint.parent, joint.child), strict=True):
            self.mark(name, link, oMj)
        return Closure(joint.name, _CLOSURE_KINDS[joint.kind], *ends)

    def mark(self, name: str, link: str, oMx: Any) -> None:
        """Add a frame x that moves with a link."""
        carrier, iMx = self._placement(link, oMx)
        self._frame(name, carrier, self.frames[link], iMx, "OP_FRAME")

    def _placement(self, link: str, oMx: Any) -> tuple[int, Any]:
        """Return the Pinocchio joint i that carries the link, and iMx = iMlink · linkMx."""
        on_link = self.model.frames[self.frames[link]]
        return on_link.parentJoint, on_link.placement * self.poses[link].actInv(oMx)

    def _add_joint(self, joint: Joint, carrier: int, iMj: Any) -> int:
        iMj = orthonormal(iMj)
        if joint.kind == "ball":
            i = self.model.addJoint(carrier, pin.JointModelSpherical(), iMj, joint.name)
        else:
            axis = joint.axis
            lower, upper = axis.lower, axis.upper
            if joint.kind == "continuous":
                lower, upper = -inf, inf
            limits = np.clip([axis.effort, axis.velocity, lower, upper], -NO_LIMIT, NO_LIMIT)
            i = self.model.addJoint(
                carrier,
                one_coordinate(joint.axis.direction, hinge=joint.kind != "prismatic"),
                iMj,
                joint.name,
                *limits.reshape(4, 1),
            )
        added = self.model.joints[i]
        damping = self.model.damping.copy()
        damping[added.idx_v : added.idx_v + added.nv] = joint.axis.damping
        self.model.damping = damping
        return int(i)

    def _carry(self, link: str, carrier: int, before: int, iMlink: Any) -> None:
        inertia, massless = self.links[link].inertia, self.links[link].massless
        if carrier and not massless and (inertia is None or inertia.mass <= 0):
            has = "no <inertial>" if inertia is None else f"the mass {inertia.mass:g} kg"
            raise InvalidModel(f"link {link!r} moves and has {has}; give it a mass > 0")
        self.frames[link] = self._frame(link, carrier, before, iMlink, "BODY", inertia)

    def _frame(
        self, name: str, carrier: int, before: int, iMf: Any, kind: str, inertia: Any | None = None
    ) -> int:
        # Pinocchio would return the older frame of the same name and type without a word.
        if self.model.existFrame(name):
            raise InvalidModel(f"two things of the model would be named {name!r}; rename one")
        inertia = pin.Inertia.Zero() if inertia is None else inertia
        frame_type = getattr(pin.FrameType, kind)
        frame = pin.Frame(name, carrier, before, orthonormal(iMf), frame_type, inertia)
        return int(self.model.addFrame(frame))  # adds the inertia to the joint as well


def _z_along(direction: Any) -> Any:
    """Return the smallest rotation that takes z to a direction."""
    return pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), direction).toRotationMatrix()
