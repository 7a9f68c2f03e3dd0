"""RobotWriter: a robot as an MJCF that grows; `mjcf_write` has the conventions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.base import WORLD, Constraint
from condyn_pin.constraints.constraint_fields import Vector3
from condyn_pin.constraints.contacts.base import Contact
from condyn_pin.errors import InvalidModel
from condyn_pin.io.mjcf_write_joint import (
    chains_of,
    drawn,
    numbers,
    reference,
    write_configuration,
    write_inertia,
    write_joint,
    write_pose,
)
from condyn_pin.model.robot import Robot


class RobotWriter:
    """A file while it grows; what loops write themselves to."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, robot.model
        self.root = Element("mujoco", model=robot.name)
        self.drawn = drawn(robot)
        self.on: dict[int, tuple[Element, Any]] = {}  # by joint: its body, and B⁻¹
        self.bodies: set[str] = set()
        self.sites: set[str] = set()
        self.joints: dict[str, Element] = {}

    def write(
        self, loops: tuple[Constraint, ...], contacts: tuple[Contact, ...], shapes: bool
    ) -> str:
        """Return the whole file, as text."""
        SubElement(self.root, "compiler", angle="radian", autolimits="true")
        if np.any(self.model.gravity.angular):
            raise InvalidModel("the model's gravity turns; MuJoCo has only a linear one")
        option = {"gravity": numbers(self.model.gravity.linear)}
        SubElement(self.root, "option", option | ({"cone": "elliptic"} if contacts else {}))
        self._add_bodies(SubElement(self.root, "worldbody"))
        self._add_frames()
        self._add_loops(loops)
        self._add_spring_dampers()
        self._add_geoms(contacts, shapes)
        self._add_motors()
        self._add_postures()
        ElementTree.indent(self.root)
        return ElementTree.tostring(self.root, encoding="unicode") + "\n"

    def _add_bodies(self, world: Element) -> None:
        data = whole_data(self.model)
        pin.forwardKinematics(self.model, data, self.drawn)
        placements = data.liMi  # of each joint in the one before, as drawn
        self.on[0] = world, pin.SE3.Identity()
        for chain in chains_of(self.model):
            parent, to_parent = self.on[self.model.parents[chain[0]]]
            to_body = [pin.SE3.Identity()]  # from each joint to the last, where the body stands
            for i in reversed(chain[1:]):
                to_body.insert(0, placements[i] * to_body[0])
            pose = to_parent * placements[chain[0]] * to_body[0]
            name = self._body_name(chain[-1])
            body = SubElement(parent, "body", {"name": name} | write_pose(pose))
            SubElement(body, "inertial", write_inertia(self.model, chain[-1]))
            for i, B in zip(chain, to_body, strict=True):
                written = SubElement(body, "joint", write_joint(self.robot, i, B, self.drawn))
                self.joints[self.model.names[i]] = written
                self.on[i] = body, B.inverse()

    def _body_name(self, i: int) -> str:
        """Return the name of the link that stands exactly in the joint, else the joint's."""
        here = [
            frame.name
            for frame in self.model.frames
            if frame.parentJoint == i
            and frame.type == pin.FrameType.BODY
            and frame.placement.isIdentity(0.0)
        ]
        elsewhere = {f.name for f in self.model.frames if f.type != pin.FrameType.JOINT}
        joint = str(self.model.names[i])
        spare = (f"{joint}_body{'_' * k}" for k in range(len(elsewhere) + self.model.njoints))
        others = (name for name in (joint, *spare) if name not in elsewhere)
        taken = self.bodies | set(WORLD)
        name = next(str(name) for name in (*here, *others) if name not in taken)
        self.bodies.add(name)
        return name

    def _add_frames(self) -> None:
        """Make each frame a site, but for those that are bodies, joints or the world."""
        for frame in self.model.frames:
            taken = frame.name in (*self.bodies, *self.sites, *WORLD)
            if not taken and frame.type != pin.FrameType.JOINT:
                self._add_site(frame.name, frame.parentJoint, frame.placement)

    def _add_site(self, name: str, i: int, placement: Any) -> str:
        body, B_inverse = self.on[i]
        SubElement(body, "site", {"name": name} | write_pose(B_inverse * placement))
        self.sites.add(name)
        return name

    def _add_loops(self, loops: tuple[Constraint, ...]) -> None:
        if loops:
            self.equality = SubElement(self.root, "equality")
        for loop in loops:
            loop.write_mjcf(self)

    def equate(self, tag: str, **words: str | Sequence[float]) -> None:
        """Write an equality."""
        said = {key: x if isinstance(x, str) else numbers(x) for key, x in words.items()}
        SubElement(self.equality, tag, said)

    def fixed_tendon(self, name: str, weights: Mapping[str, float]) -> str:
        """Return the name of a new tendon: a weighted sum of joint coordinates."""
        tendon = SubElement(self._tendons(), "fixed", name=name)
        for joint, weight in weights.items():
            SubElement(tendon, "joint", joint=joint, coef=numbers(weight))
        return name

    def _tendons(self) -> Element:
        found = self.root.find("tendon")
        return SubElement(self.root, "tendon") if found is None else found

    def coordinate(self, joint: str) -> float:
        """Return the coordinate of a joint where the file draws the model [rad or m]."""
        return reference(self.model, self.model.getJointId(joint), self.drawn)

    def _add_spring_dampers(self) -> None:
        """Make each spring-damper a tendon that is straight from site to site."""
        for k, each in enumerate(self.robot.spring_dampers):
            said = {"stiffness": each.stiffness, "damping": each.damping}
            said["springlength"] = each.rest_length
            words = {"name": f"spring_damper_{k}"} | {key: numbers([x]) for key, x in said.items()}
            tendon = SubElement(self._tendons(), "spatial", words)
            for frame, end in ((each.frame_a, "a"), (each.frame_b, "b")):
                SubElement(tendon, "site", site=self.site(frame, f"spring_damper_{k}_{end}"))

    def site(self, frame: str, new: str) -> str:
        """Return the site of a frame; a body's or the world's own frame gets one."""
        if frame in self.sites:
            return frame
        return self._add_site(self._spare(new), *self.robot.frame(frame))

    def site_beside(self, frame: str, new: str, shift: Vector3) -> str:
        """Return a new site, shifted from a frame in its axes [m]."""
        i, placement = self.robot.frame(frame)
        shifted = placement * pin.SE3(np.eye(3), np.array(shift))
        return self._add_site(self._spare(new), i, shifted)

    def _spare(self, name: str) -> str:
        while name in self.sites or name in self.bodies:
            name += "_"
        return name

    def _add_geoms(self, contacts: tuple[Contact, ...], shapes: bool) -> None:
        """Write what is drawn, and what may open and slide."""
        if not contacts and not shapes:
            return
        from condyn_pin.io.mjcf_write_geoms import GeomWriter  # reads meshes, too

        geoms = GeomWriter(self)
        if shapes:
            geoms.draw()
        for contact in contacts:
            contact.write_mjcf(geoms)

    def _add_motors(self) -> None:
        if not self.robot.actuated:
            return
        actuator = SubElement(self.root, "actuator")
        for joint in self.robot.actuated:
            nv = self.model.joints[self.model.getJointId(joint)].nv
            for k in range(nv):
                said = {"name": joint if nv == 1 else f"{joint}_{k}", "joint": joint}
                SubElement(actuator, "motor", said | {"gear": numbers(np.eye(6)[k])})

    def _add_postures(self) -> None:
        if not self.robot.postures:
            return
        keyframes = SubElement(self.root, "keyframe")
        for name, q in self.robot.postures.items():
            SubElement(keyframes, "key", name=name, qpos=write_configuration(self.model, q))
