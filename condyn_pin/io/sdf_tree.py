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

from condyn_pin._core._pin import dry_friction, pin, set_dry_friction
from condyn_pin._core.rotations import z_along
from condyn_pin.constraints.constraint_fields import Axis
from condyn_pin.constraints.loop import Loop, LoopKind
from condyn_pin.errors import InvalidModel
from condyn_pin.io.sdf_span import Span
from condyn_pin.io.sdf_types import WORLD, Joint, SdfModel
from condyn_pin.model.tree import Tree, one_coordinate

_LOOP_KINDS: Final[Mapping[str, LoopKind]] = {
    "ball": "ball",
    "fixed": "weld",
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slider",
}
_Z: Final[Axis] = "z"  # to which the frames of a cut hinge or slider are turned


class SdfTree(Tree):
    """The Pinocchio model of a spanning tree.

    Parameters
    ----------
    sdf : SdfModel
    spanned : Span
    root_joint : pin.JointModel, optional
        Between the world and the root link; without one the link stands where the file puts it.
    """

    def __init__(self, sdf: SdfModel, spanned: Span, root_joint: Any | None) -> None:
        super().__init__(sdf.name)
        self.poses = {link.name: link.pose for link in sdf.links} | {WORLD: sdf.pose.inverse()}
        self._links = {link.name: link for link in sdf.links}
        self._frames = {WORLD: 0}  # Pinocchio's frame 0 is the universe
        self._plant(spanned.start, root_joint)
        for joint in spanned.tree:
            self._attach(joint)

    def _plant(self, start: str, root_joint: Any | None) -> None:
        """Add the root link; the world itself is there already."""
        if start == WORLD:
            return
        if root_joint is None:
            wMlink = self.poses[WORLD].actInv(self.poses[start])
            self._carry(start, 0, 0, wMlink)
            return
        identity = pin.SE3.Identity()
        i = self.add_joint(0, root_joint, identity, "root_joint")
        self._carry(start, i, self.add_frame("root_joint", i, identity, "JOINT"), identity)

    def _attach(self, joint: Joint) -> None:
        """Add a joint of the tree and its child link."""
        carrier, iMj = self._placement(joint.parent, joint.pose)
        before = self._frames[joint.parent]
        if joint.kind == "fixed":
            frame = self.add_frame(joint.name, carrier, iMj, "FIXED_JOINT", before=before)
        else:
            carrier = self._add(joint, carrier, iMj)
            iMj = pin.SE3.Identity()
            frame = self.add_frame(joint.name, carrier, iMj, "JOINT", before=before)
        jMc = joint.pose.actInv(self.poses[joint.child])
        self._carry(joint.child, carrier, frame, iMj * jMc)

    def parts(self, joint: Joint) -> bool:
        """Whether the two links of a joint can move against each other."""
        first, second = (self._frames[link] for link in (joint.parent, joint.child))
        frames = self.model.frames
        return bool(frames[first].parentJoint != frames[second].parentJoint)

    def moves(self, link: str) -> bool:
        """Whether a link can move."""
        return bool(self.model.frames[self._frames[link]].parentJoint)

    def close(self, joint: Joint) -> Loop:
        """Add the two frames of a cut joint, and return what closes it."""
        oMj = joint.pose
        axis: Axis | None = None
        if joint.has_axis:
            oMj, axis = oMj * pin.SE3(z_along(np.asarray(joint.axis.direction)), np.zeros(3)), _Z
        ends = f"{joint.name}_a", f"{joint.name}_b"
        for name, link in zip(ends, (joint.parent, joint.child), strict=True):
            self.mark(name, link, oMj)
        return Loop(*ends, _LOOP_KINDS[joint.kind], axis, name=joint.name)

    def mark(self, name: str, link: str, oMx: Any) -> None:
        """Add a frame x that moves with a link."""
        carrier, iMx = self._placement(link, oMx)
        self.add_frame(name, carrier, iMx, "OP_FRAME", before=self._frames[link])

    def _placement(self, link: str, oMx: Any) -> tuple[int, Any]:
        """Return the Pinocchio joint i that carries the link, and iMx = iMlink · linkMx."""
        on_link = self.model.frames[self._frames[link]]
        return on_link.parentJoint, on_link.placement * self.poses[link].actInv(oMx)

    def _add(self, joint: Joint, carrier: int, iMj: Any) -> int:
        axis, limits = joint.axis, list[float]()
        if joint.kind == "ball":
            made = pin.JointModelSpherical()
        else:
            if joint.kind == "screw":
                made = pin.JointModelHelicalUnaligned(np.asarray(axis.direction), joint.pitch)
            else:
                made = one_coordinate(axis.direction, hinge=joint.kind != "prismatic")
            bounded = joint.kind != "continuous"
            bounds = (axis.lower, axis.upper) if bounded else (-inf, inf)
            limits = [axis.effort, axis.velocity, *bounds]
        i = self.add_joint(carrier, made, iMj, joint.name, limits=limits, damping=axis.damping)
        first = self.model.joints[i].idx_v
        friction = dry_friction(self.model)
        friction[first:] = axis.friction
        set_dry_friction(self.model, friction)
        return i

    def _carry(self, link: str, carrier: int, before: int, iMlink: Any) -> None:
        inertia, massless = self._links[link].inertia, self._links[link].massless
        if carrier and not massless and inertia is not None and inertia.mass <= 0:
            mass = inertia.mass
            raise InvalidModel(
                f"link {link!r} moves and has the mass {mass:g} kg; give it a mass > 0"
            )
        self._frames[link] = self.add_frame(link, carrier, iMlink, "BODY", inertia, before)
