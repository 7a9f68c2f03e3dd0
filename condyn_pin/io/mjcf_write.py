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

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from math import inf
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Comment, Element, SubElement

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import dry_friction, pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import UNLIMITED, whole_data
from condyn_pin.constraints.constraint import Constraint, Vector3
from condyn_pin.constraints.contacts.contact import Contact
from condyn_pin.constraints.contacts.kinds import bind_contacts
from condyn_pin.constraints.contacts.shapes import Ellipsoid, Plane, Shape
from condyn_pin.constraints.places import WORLD
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name
from condyn_pin.io.meshes import read_mesh
from condyn_pin.io.mjcf import DRAWN, FAR, unused_name
from condyn_pin.io.shapes import Shape as Drawn
from condyn_pin.io.shapes import shapes_of
from condyn_pin.model.robot import Robot
from condyn_pin.model.springs import Spring


def to_mjcf(
    robot: Robot,
    *,
    without: Iterable[str] = (),
    contacts: Iterable[Contact] = (),
    shapes: bool = False,
) -> str:
    """Return a robot as the text of an MJCF; see `Robot.to_mjcf`."""
    robot.check_unedited()
    if isinstance(contacts, str) or not isinstance(contacts, Iterable):
        raise InvalidArgument(f"contacts = {contacts!r}: a list of contacts is needed")
    touching = tuple(contacts)
    bind_contacts(robot, touching)
    return RobotWriter(robot).write(_writable_loops(robot, without), touching, shapes)


def _writable_loops(robot: Robot, without: Iterable[str]) -> tuple[Constraint, ...]:
    """Loops to write; kinds that MuJoCo lacks are refused."""
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


def not_written(robot: Robot) -> str:
    """Sentence on the numbers of a robot that an MJCF has no place for; empty if there is none."""
    speeds = np.array(robot.model.velocityLimit)
    limited = np.flatnonzero((speeds > 0) & (speeds < UNLIMITED))
    return f"limits of {len(limited)} velocities: an MJCF has no place for them" * bool(
        len(limited)
    )


class RobotWriter:
    """An MJCF under construction, to which loops write themselves."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, robot.model
        self.root = Element("mujoco", model=robot.name)
        self.drawn = drawn_configuration(robot)
        self.on: dict[int, tuple[Element, Any]] = {}  # by joint: its body, and B⁻¹
        self.bodies: set[str] = set()
        self.sites: set[str] = set()
        self.joints: dict[str, Element] = {}

    def write(
        self, loops: tuple[Constraint, ...], contacts: tuple[Contact, ...], shapes: bool
    ) -> str:
        """Return the whole file, as text."""
        if lost := not_written(self.robot):
            self.root.append(Comment(f" {lost} "))
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
        self._add_exclusions()
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
        """Write each frame as a site, except bodies, joints and the world."""
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
            before = len(self.equality)
            loop.write_mjcf(self)
            if loop.drift:
                for element in self.equality[before:]:
                    element.set("solref", numbers(loop.drift.to_solref()))

    def equate(self, tag: str, **words: str | Sequence[float]) -> None:
        """Write an equality."""
        said = {key: x if isinstance(x, str) else numbers(x) for key, x in words.items()}
        SubElement(self.equality, tag, said)

    def fixed_tendon(self, name: str, weights: Mapping[str, float]) -> str:
        """Return the name of a new tendon: a weighted sum of joint coordinates."""
        tendon = self._new_tendon("fixed", name)
        for joint, weight in weights.items():
            SubElement(tendon, "joint", joint=joint, coef=numbers(weight))
        return str(tendon.get("name"))

    def limited_tendon(self, name: str, frames: Sequence[str], least: float, most: float) -> None:
        """Write a tendon over frames whose length is limited [m]."""
        tendon = self._new_tendon("spatial", name)
        tendon.attrib |= {"limited": "true", "range": numbers([least, most])}
        for k, frame in enumerate(frames):
            SubElement(tendon, "site", site=self.site(frame, f"{name}_{k}"))

    def _new_tendon(self, kind: str, name: str) -> Element:
        name = unused_name(name, {str(tendon.get("name")) for tendon in self._tendons()})
        return SubElement(self._tendons(), kind, name=name)

    def _tendons(self) -> Element:
        found = self.root.find("tendon")
        return SubElement(self.root, "tendon") if found is None else found

    def coordinate(self, joint: str) -> float:
        """Return the coordinate of a joint where the file draws the model [rad or m]."""
        return reference(self.model, self.model.getJointId(joint), self.drawn)

    def _add_spring_dampers(self) -> None:
        """Write each spring-damper as a tendon that is straight from site to site."""
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
        return self._add_site(unused_name(new, self.sites | self.bodies), *self.robot.frame(frame))

    def site_beside(self, frame: str, new: str, shift: Vector3) -> str:
        """Return a new site, shifted from a frame in its axes [m]."""
        i, placement = self.robot.frame(frame)
        shifted = placement * pin.SE3(np.eye(3), np.array(shift))
        return self._add_site(unused_name(new, self.sites | self.bodies), i, shifted)

    def _add_geoms(self, contacts: tuple[Contact, ...], shapes: bool) -> None:
        """Write the visual shapes if `shapes`, and the unilateral contacts."""
        if not contacts and not shapes:
            return
        geoms = GeomWriter(self)
        if shapes:
            geoms.draw()
        for contact in contacts:
            contact.write_mjcf(geoms)

    def _add_motors(self) -> None:
        if not self.robot.motor_joints:
            return
        actuator, taken = SubElement(self.root, "actuator"), set[str]()
        for joint in self.robot.actuated:
            nv = self.model.joints[self.model.getJointId(joint)].nv
            for k in range(nv):
                said = {"name": joint if nv == 1 else f"{joint}_{k}", "joint": joint}
                SubElement(actuator, "motor", said | {"gear": numbers(np.eye(6)[k])})
                taken.add(said["name"])
        for motor in self.robot.coupled_motors:
            name = unused_name(motor.name, taken)
            taken.add(name)
            said = {"name": name, "tendon": self.fixed_tendon(motor.name, motor.weights)}
            if motor.limits != (-inf, inf):
                said["forcerange"] = numbers(np.clip(motor.limits, -FAR, FAR))
            SubElement(actuator, "motor", said)

    def _add_exclusions(self) -> None:
        """Write the pairs of bodies that do not touch each other."""
        pairs: dict[tuple[str, ...], None] = {}
        for names in self.robot.exclusions:
            on = {self.on[self.robot.frame(name)[0]][0].get("name", WORLD[0]) for name in names}
            pairs |= dict.fromkeys(combinations(sorted(on), 2))
        if pairs:
            contact = SubElement(self.root, "contact")
            for one, two in sorted(pairs):
                SubElement(contact, "exclude", body1=one, body2=two)

    def _add_postures(self) -> None:
        if not self.robot.postures:
            return
        keyframes = SubElement(self.root, "keyframe")
        for name, q in self.robot.postures.items():
            SubElement(keyframes, "key", name=name, qpos=write_configuration(self.model, q))


_TIP: Final = 1e-4  # [m] radius of what is a point
_DRAWN: Final = {"contype": "0", "conaffinity": "0", "group": "2"}
_TOUCHING: Final = {"contype": "0", "conaffinity": "0", "group": "3"}
# Upper end of a tendon that has none [m]: MuJoCo has both or neither.
_ENDLESS: Final = 1e6
# Slip, twist and roll; the last two act only where a pair has more than three dimensions.
_TWIST_AND_ROLL: Final = (0.005, 0.0001, 0.0001)


class GeomWriter:
    """Writer of geoms: visual shapes, and the shapes of contacts."""

    def __init__(self, to: RobotWriter) -> None:
        self.to, self.robot = to, to.robot
        self._meshes: dict[Any, str] = {}
        self._assets: Element | None = None
        self._pairs: Element | None = None

    def draw(self) -> None:
        """Write the visual shapes of the description."""
        robot = self.robot
        shapes, missing = shapes_of(
            robot.description, model=robot.name, package_dirs=robot.package_dirs
        )
        if missing:
            more = f" (and {len(missing) - 1} more)" if missing[1:] else ""
            raise InvalidModel(f"{missing[0]}{more}; leave shapes out with shapes=False")
        frames = self.robot.model.frames
        carriers = {f.name: f for f in frames if f.type == pin.FrameType.BODY}
        carriers[frames[0].name] = frames[0]
        for shape in shapes:
            if (frame := carriers.get(shape.link)) is None:
                continue  # what was left out of the robot is not drawn
            said = _DRAWN | self._drawn(shape) | {"rgba": numbers([*shape.colour, 1.0])}
            self._geom(int(frame.parentJoint), frame.placement * shape.placement, said)

    def collide(
        self,
        name: str,
        first: tuple[str, Vector3, Shape],
        second: Plane | tuple[str, Plane | Shape],
        friction: float,
    ) -> None:
        """Write a contact pair: a shape at an offset in a frame, and its plane or other shape."""
        frame, offset, shape = first
        joint, placement = self.robot.frame(frame)
        at = placement * pin.SE3(np.eye(3), np.array(offset))
        one = self._touching(joint, at, shape, f"{name}/robot")
        if isinstance(second, Plane):
            other = self._plane(0, second, pin.SE3.Identity(), f"{name}/ground")
        else:
            below, carried = second
            joint, placement = self.robot.frame(below)
            if isinstance(carried, Plane):
                other = self._plane(joint, carried, placement, f"{name}/ground")
            else:
                other = self._touching(joint, placement, carried, f"{name}/other")
        if self._pairs is None:
            self._pairs = SubElement(self.to.root, "contact")
        said = {"geom1": one, "geom2": other, "condim": "3" if friction else "1"}
        if friction:
            said["friction"] = numbers([friction, friction, *_TWIST_AND_ROLL])
        SubElement(self._pairs, "pair", {"name": name} | said)

    def cable(
        self, name: str, frames: Sequence[str], at_least: float | None, at_most: float | None
    ) -> None:
        """Write a tendon over frames with a shortest and a longest length [m]."""
        most = _ENDLESS if at_most is None else at_most
        self.to.limited_tendon(name, frames, at_least or 0.0, most)

    def dry(self, joint: str, torque: float | None) -> None:
        """Write the dry friction of a joint [N m, N]; by default that of the description."""
        place = self.robot.model.joints[self.robot.model.getJointId(joint)]
        described = dry_friction(self.robot.model)[place.idx_v : place.idx_v + place.nv]
        if torque is None and np.ptp(described) > 0.0:
            raise InvalidModel(
                f"joint {joint!r} has dry friction {described.tolist()}; MuJoCo has one number for "
                "a joint"
            )
        self.to.joints[joint].set(
            "frictionloss", numbers(described[0] if torque is None else torque)
        )

    def _touching(self, joint: int, at: Any, shape: Shape, name: str) -> str:
        return self._geom(joint, at, {"name": name} | _TOUCHING | self._solid(shape))

    def _plane(self, joint: int, plane: Plane, placement: Any, name: str) -> str:
        if joint:
            raise InvalidModel(
                f"{name}: a plane on a moving body, which MuJoCo does not have; a Box is needed"
            )
        said = {"name": name, **_TOUCHING, "type": "plane", "size": "0 0 0.1"}
        return self._geom(0, placement * plane.placement, said)

    def _geom(self, joint: int, at: Any, said: dict[str, str]) -> str:
        body, to_body = self.to.on[joint]
        SubElement(body, "geom", said | write_pose(to_body * at))
        return said.get("name", "")

    def _solid(self, shape: Shape) -> dict[str, str]:
        """Attributes of the geom of a contact shape."""
        patch, corners = shape.patch, [each.middle for each in shape.contact_points]
        if isinstance(shape, Ellipsoid):
            return {"type": "ellipsoid", "size": numbers([shape.x, shape.y, shape.z])}
        if patch is None:
            if len(corners) == 1:
                return {"type": "sphere", "size": numbers(_TIP)}
            return {"type": "mesh", "mesh": self._mesh(shape, corners, None)}
        if patch.shape == "box":
            return {"type": "box", "size": numbers(np.array(patch.size) / 2)}
        if patch.shape == "ball":
            return {"type": "sphere", "size": numbers(patch.size)}
        radius, length = patch.size
        kind = "cylinder" if patch.shape == "rod" else "capsule"
        return {"type": kind, "size": numbers([radius, length / 2])}

    def _drawn(self, shape: Drawn) -> dict[str, str]:
        """Attributes of the geom of a visual shape."""
        if shape.kind == "mesh":
            mesh = shape.triangles or read_mesh(Path(str(shape.file))).moved(
                np.diag([*shape.size, 1.0])
            )
            key = (shape.file, shape.size) if shape.triangles is None else id(shape.triangles)
            return {"type": "mesh", "mesh": self._mesh(key, mesh.vertices, mesh.faces)}
        size = np.array(shape.size)
        if shape.kind == "box":
            size = size / 2
        elif shape.kind in ("cylinder", "capsule"):
            size = size * (1.0, 0.5)
        return {"type": shape.kind, "size": numbers(size)}

    def _mesh(self, key: Any, vertices: ArrayLike, faces: ArrayLike | None) -> str:
        """Name of a mesh asset, written once for all geoms that use it."""
        if key not in self._meshes:
            if self._assets is None:
                self._assets = SubElement(self.to.root, "asset")
            name = f"mesh_{len(self._meshes)}"
            said = {"name": name, "vertex": _short_numbers(vertices)}
            if faces is not None:
                said |= {
                    "face": _short_numbers(faces),
                    "inertia": "shell",
                }  # what is drawn may be open
            SubElement(self._assets, "mesh", said)
            self._meshes[key] = name
        return self._meshes[key]


def _short_numbers(values: ArrayLike) -> str:
    return " ".join(f"{x:.7g}" for x in np.asarray(values).ravel().tolist())


_FLAT = 1e-12  # rounding of A + B = C in the principal moments of a flat body, relative to C
_LEAST = 2e-15  # [kg, kg m^2] MuJoCo refuses a body that moves with less than 1e-15


def chains_of(model: Any) -> Sequence[Sequence[int]]:
    """Return the joints of each body; one that carries nothing joins its child's."""
    children: Mapping[int, list[int]] = defaultdict(list)
    for i in range(1, model.njoints):
        children[model.parents[i]].append(i)
    marked = {frame.parentJoint for frame in model.frames if frame.type != pin.FrameType.JOINT}
    chains: list[list[int]] = []
    for i in range(1, model.njoints):
        parent = model.parents[i]
        empty = parent and parent not in marked and not np.any(model.inertias[parent].matrix())
        if empty and len(children[parent]) == 1:
            chains[-1].append(i)  # depth-first: the parent was the joint before
        else:
            chains.append([i])
    return chains


def write_inertia(model: Any, i: int) -> dict[str, str]:
    """Return the inertia in principal axes, which MuJoCo itself finds to 1e-7 only, as attributes.

    Masses and moments below the least that MuJoCo allows are raised to it.
    """
    inertia = model.inertias[i]
    moments, axes = np.linalg.eigh(inertia.inertia)
    if inertia.mass < 0 or moments[0] < -tolerances.MOMENT * moments[2]:
        raise InvalidModel(
            f"joint {model.names[i]!r} carries {inertia.mass:g} kg with the principal moments "
            f"{', '.join(f'{m:g}' for m in moments)} kg m^2; none may be negative"
        )
    moments = np.maximum(moments, _LEAST)
    A, B, C = moments  # in ascending order
    if A + B < C * (1 - _FLAT):
        raise InvalidModel(
            f"joint {model.names[i]!r} carries a body with the principal moments {A:g}, {B:g} and "
            f"{C:g} kg m^2; MuJoCo needs that two of them add up to the third or more"
        )
    moments[2] = min(C, A + B)  # MuJoCo compares without a tolerance
    right_handed = axes * np.sign(np.linalg.det(axes))
    placed = pin.SE3(right_handed, inertia.lever)
    return {
        "mass": numbers(max(inertia.mass, _LEAST)),
        "diaginertia": numbers(moments),
    } | write_pose(placed)


def write_joint(robot: Robot, i: int, B: Any, drawn: Array) -> dict[str, str]:
    """Return the attributes of joint i; B is the pose of its body in it, at the q that is drawn."""
    model = robot.model
    name, joint = model.names[i], model.joints[i]
    kind, here = joint.shortname(), B.isIdentity(0.0)
    if joint.nv == 1:
        said = _scalar(model, i, B, drawn)
    elif kind == "JointModelSpherical" and here:
        said = {"type": "ball"}
    elif kind == "JointModelFreeFlyer" and here and model.parents[i] == 0:
        said = {"type": "free"}
    else:
        raise InvalidModel(
            f"joint {name!r} is a {kind}, which MuJoCo does not have there; "
            "a hinge, a slider, a ball, or a free-flyer on the world is needed"
        )
    for key in ("armature", "damping"):
        values = np.array(getattr(model, key)[joint.idx_v : joint.idx_v + joint.nv])
        # on a free joint MuJoCo's armature is along the axes of the world: another bias
        if np.ptp(values) > 0 or (key == "armature" and joint.nv == 6 and values.any()):
            raise InvalidModel(
                f"joint {name!r}: {key} {values.tolist()}; MuJoCo has one number for a joint, and "
                "no armature for a free one"
            )
        if values[0]:
            said[key] = numbers(values[0])
    most = float(model.effortLimit[joint.idx_v])
    if joint.nv == 1 and name in robot.motor_joints and 0.0 < most < UNLIMITED:
        said["actuatorfrcrange"] = numbers([-most, most])
    return {"name": str(name)} | said | _spring([s for s in robot.springs if s.joint == name])


def scalar_axis(model: Any, i: int) -> tuple[str, Array]:
    """Return "slide" or "hinge", and the axis in the joint, from S = (slide axis, hinge axis)."""
    # The kind is empty if a joint of one coordinate is neither, such as a screw.
    joint = model.joints[i]
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    slide, hinge = np.array(data.S).reshape(2, 3)
    if slide.any() and hinge.any():
        return "", hinge
    return ("slide", slide) if slide.any() else ("hinge", hinge)


def reference(model: Any, i: int, q: Array) -> float:
    """Return the coordinate of joint i of one coordinate, as MuJoCo counts it [rad or m]."""
    joint = model.joints[i]
    x = q[joint.idx_q : joint.idx_q + joint.nq]
    return float(np.arctan2(x[1], x[0]) if joint.nq == 2 else x[0])


def _scalar(model: Any, i: int, B: Any, drawn: Array) -> dict[str, str]:
    """Return the attributes of a joint of one coordinate."""
    joint = model.joints[i]
    kind, axis = scalar_axis(model, i)
    if not kind:
        raise InvalidModel(f"joint {model.names[i]!r}: MuJoCo has no {joint.shortname()}")
    said = {"type": kind, "axis": numbers(B.rotation.T @ axis)}
    if not B.isIdentity(0.0):
        said["pos"] = numbers(B.inverse().translation)
    if ref := reference(model, i, drawn):
        said["ref"] = numbers(ref)
    limits = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
    # MuJoCo refuses a range without width
    if joint.nq == 1 and limits[0] < limits[1] and (limits[0] > -FAR or limits[1] < FAR):
        said["range"] = numbers(np.clip(limits, -FAR, FAR))
    return said


def _spring(springs: Sequence[Spring]) -> dict[str, str]:
    """Return several springs on a joint as one: k = sum k_i, k q0 = sum k_i q0_i."""
    stiffness = sum(spring.stiffness for spring in springs)
    if not stiffness:
        return {}
    rest = sum(spring.stiffness * spring.reference for spring in springs) / stiffness
    return {"stiffness": numbers(stiffness), "springref": numbers(rest)}


def write_configuration(model: Any, q: Array) -> str:
    """Return q as MuJoCo counts it."""
    positions: list[ArrayLike] = []
    for i in range(1, model.njoints):
        joint = model.joints[i]
        x = q[joint.idx_q : joint.idx_q + joint.nq]
        if joint.nq == 7:
            pose = model.jointPlacements[i] * pin.XYZQUATToSE3(x)
            positions += [pose.translation, _wxyz(pose.rotation)]
        elif joint.nq == 4:
            positions.append(np.roll(x, 1))
        else:
            positions.append([reference(model, i, q)])
    return numbers(np.concatenate(positions))


def write_pose(placement: Any) -> dict[str, str]:
    """Return the attributes of a pose."""
    said = {"pos": numbers(placement.translation)}
    if not np.array_equal(placement.rotation, np.eye(3)):
        said["quat"] = numbers(_wxyz(placement.rotation))
    return said


def numbers(values: ArrayLike) -> str:
    """Return numbers with as few digits as give them back to the last bit."""
    return " ".join(repr(float(x)).removesuffix(".0") for x in np.atleast_1d(values))


def _wxyz(rotation: Array) -> Array:
    return np.roll(pin.Quaternion(rotation).coeffs(), 1)


def drawn_configuration(robot: Robot) -> Array:
    """Return the configuration (nq,) in which an MJCF of the robot draws it."""
    # That of its posture ``qpos0``, which comes with every MJCF, else neutral. A ball has no `ref`:
    # in MuJoCo it is drawn at 1 0 0 0.
    neutral = np.array(pin.neutral(robot.model))
    q = np.array(robot.postures.get(DRAWN, neutral))
    for joint in robot.model.joints[1:]:
        if joint.nq == 4 and joint.nv == 3:
            turned = slice(joint.idx_q, joint.idx_q + 4)
            q[turned] = neutral[turned]
    return q
