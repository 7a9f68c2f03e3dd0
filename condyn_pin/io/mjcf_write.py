"""Write a robot with its loops as MJCF.

A Pinocchio joint and what it carries become a body that stands where the joint does at q0: the
posture ``qpos0``, which a robot has from an MJCF, else neutral; what is not zero there is the `ref`
of its joint. A joint that carries nothing and has one child, as in a universal joint, moves the
same body as its child: with B the pose of the body in the joint, its point is that of B⁻¹ and its
axis s becomes B⁻¹ s.

Coordinates mean the same in both, but for

    joint        Pinocchio                    MuJoCo
    free-flyer   pose in its placement xyzw   pose in the world, wxyz
    spherical    xyzw                         wxyz
    unbounded    (cos α, sin α)               α

Loops are given by sites, since an anchor would take its second point from where the file draws the
model. MuJoCo has two equalities between bodies; a hinge is two points of its axis.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import WORLD, Constraint
from condyn_pin.constraints.constraint_fields import Vector3
from condyn_pin.constraints.contacts.base import Contact
from condyn_pin.constraints.contacts.kinds import bind_contacts
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name
from condyn_pin.io.mjcf import DRAWN
from condyn_pin.io.mjcf_write_joint import (
    chains_of,
    numbers,
    reference,
    write_configuration,
    write_inertia,
    write_joint,
    write_pose,
)
from condyn_pin.model.robot import Robot


def to_mjcf(
    robot: Robot,
    *,
    without: Iterable[str] = (),
    contacts: Iterable[Contact] = (),
    shapes: bool = False,
) -> str:
    """Return a robot as MJCF; `Robot.to_mjcf` says what is written.

    Parameters
    ----------
    robot : Robot
    without : iterable of str
        Names of loops to leave out.
    contacts : iterable of Contact
        What may open and slide.
    shapes : bool
        Write what the description draws.
    """
    robot.check_unedited()
    if isinstance(contacts, str) or not isinstance(contacts, Iterable):
        raise InvalidArgument(f"contacts = {contacts!r}: a list of contacts is needed")
    touching = tuple(contacts)
    bind_contacts(robot, touching)
    return _Writer(robot).write(_kept(robot, without), touching, shapes)


def drawn(robot: Robot) -> Array:
    """Return the configuration (nq,) in which an MJCF of the robot draws it.

    That of its posture ``qpos0``, which comes with every MJCF, else neutral. A ball has no `ref`:
    in MuJoCo it is drawn at 1 0 0 0.
    """
    neutral = np.array(pin.neutral(robot.model))
    q = np.array(robot.postures.get(DRAWN, neutral))
    for joint in robot.model.joints[1:]:
        if joint.nq == 4 and joint.nv == 3:
            turned = slice(joint.idx_q, joint.idx_q + 4)
            q[turned] = neutral[turned]
    return q


def _kept(robot: Robot, without: Iterable[str]) -> tuple[Constraint, ...]:
    """Return the loops to write, after a look at their kinds."""
    if isinstance(without, str) or not isinstance(without, Iterable):
        raise InvalidArgument(f"without = {without!r}: a list of names of loops is needed")
    left_out = tuple(without)
    names = [loop.name for loop in robot.loops]
    for name in left_out:
        if name not in names:
            raise unknown_name("loop", str(name), names)
    kept = tuple(loop for loop in robot.loops if loop.name not in left_out)
    for loop in kept:
        if not loop.in_mjcf:
            pin = "a ball does the same in a mechanism that moves in a plane, kind='ball'; "
            raise InvalidModel(
                f"loop {loop.name!r} is a {loop.called}, for which MuJoCo has no equality; "
                f"{pin if loop.called == 'planar' else ''}to_mjcf(without=[{loop.name!r}]) writes "
                "the machine without it"
            )
    return kept


class _Writer:
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
        data = self.model.createData()
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

    def coordinate(self, joint: str) -> float:
        """Return the coordinate of a joint where the file draws the model [rad or m]."""
        return reference(self.model, self.model.getJointId(joint), self.drawn)

    def _add_spring_dampers(self) -> None:
        """Make each spring-damper a tendon that is straight from site to site."""
        if not self.robot.spring_dampers:
            return
        tendons = SubElement(self.root, "tendon")
        for k, each in enumerate(self.robot.spring_dampers):
            said = {"stiffness": each.stiffness, "damping": each.damping}
            said["springlength"] = each.rest_length
            words = {"name": f"spring_damper_{k}"} | {key: numbers([x]) for key, x in said.items()}
            tendon = SubElement(tendons, "spatial", words)
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
