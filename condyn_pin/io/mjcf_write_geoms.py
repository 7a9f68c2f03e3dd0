"""Shapes and contacts of a robot as MJCF.

What the description draws becomes geoms of group 2 that touch nothing; meshes are in the file
itself. Each contact of a scene becomes two geoms of group 3 that touch nothing but each other, by a
`pair` with its coefficient of friction; MuJoCo's friction cone is the round one of Coulomb's law.

    contact                    MuJoCo
    Ball, Capsule, Box         sphere, capsule, box
    Convex                     mesh, whose convex hull touches
    Point                      a sphere of 0.1 mm
    Plane                      plane
    JointFriction              frictionloss
    JointLimit                 range, which joints have anyway
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, Protocol
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import dry_friction, pin
from condyn_pin.constraints.constraint_fields import Vector3
from condyn_pin.constraints.contacts.plane import Plane
from condyn_pin.constraints.contacts.shapes import Shape
from condyn_pin.errors import InvalidModel
from condyn_pin.io.mesh_files import read_mesh
from condyn_pin.io.meshes import Mesh
from condyn_pin.io.mjcf_geoms import WORLD
from condyn_pin.io.mjcf_write_joint import numbers, write_pose
from condyn_pin.io.shape import Shape as Drawn
from condyn_pin.io.shapes import shapes_of
from condyn_pin.model.robot import Robot

_TIP: Final = 1e-4  # [m] radius of what is a point
_DRAWN: Final = {"contype": "0", "conaffinity": "0", "group": "2"}
_TOUCHING: Final = {"contype": "0", "conaffinity": "0", "group": "3"}
# Slip, twist and roll; the last two act only where a pair has more than three dimensions.
_TWIST_AND_ROLL: Final = (0.005, 0.0001, 0.0001)


class Writer(Protocol):
    """The file while it grows."""

    robot: Robot
    root: Element
    on: dict[int, tuple[Element, Any]]  # by joint: its body, and the inverse pose of that in it
    joints: dict[str, Element]


class GeomWriter:
    """What writes geoms into a file: shapes that are drawn, and contacts that write themselves."""

    def __init__(self, to: Writer) -> None:
        self.to, self.robot = to, to.robot
        self._meshes: dict[Any, str] = {}
        self._assets: Element | None = None
        self._pairs: Element | None = None

    def draw(self) -> None:
        """Write what the description draws."""
        robot = self.robot
        shapes, missing = shapes_of(
            robot.description, model=robot.name, package_dirs=robot.package_dirs
        )
        if missing:
            more = f" (and {len(missing) - 1} more)" if missing[1:] else ""
            raise InvalidModel(f"{missing[0]}{more}; leave shapes out with shapes=False")
        frames = self.robot.model.frames
        carriers = {f.name: f for f in frames if f.type == pin.FrameType.BODY} | {WORLD: frames[0]}
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
        """Write a shape at an offset in a frame, and what it may touch."""
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

    def dry(self, joint: str, torque: float | None) -> None:
        """Write the dry friction of a joint [N m, N]; that of the description without a torque."""
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
        """Return the attributes of what touches."""
        patch, corners = shape.patch, [each.middle for each in shape.contact_points]
        if patch is None:
            if len(corners) == 1:
                return {"type": "sphere", "size": numbers(_TIP)}
            return {"type": "mesh", "mesh": self._mesh(shape, corners, None)}
        if patch.shape == "box":
            return {"type": "box", "size": numbers(np.array(patch.size) / 2)}
        if patch.shape == "ball":
            return {"type": "sphere", "size": numbers(patch.size)}
        radius, length = patch.size
        return {"type": "capsule", "size": numbers([radius, length / 2])}

    def _drawn(self, shape: Drawn) -> dict[str, str]:
        """Return the attributes of what is drawn."""
        if shape.kind == "mesh":
            mesh = shape.triangles or self._read(shape)
            key = (shape.file, shape.size) if shape.triangles is None else id(shape.triangles)
            return {"type": "mesh", "mesh": self._mesh(key, mesh.vertices, mesh.faces)}
        size = np.array(shape.size)
        if shape.kind == "box":
            size = size / 2
        elif shape.kind in ("cylinder", "capsule"):
            size = size * (1.0, 0.5)
        return {"type": shape.kind, "size": numbers(size)}

    def _read(self, shape: Drawn) -> Mesh:
        assert shape.file is not None
        return read_mesh(Path(shape.file)).moved(np.diag([*shape.size, 1.0]))

    def _mesh(self, key: Any, vertices: ArrayLike, faces: ArrayLike | None) -> str:
        """Return the name of a mesh, which is in the file once however often it is used."""
        if key not in self._meshes:
            if self._assets is None:
                self._assets = SubElement(self.to.root, "asset")
            name = f"mesh_{len(self._meshes)}"
            said = {"name": name, "vertex": _short(vertices)}
            if faces is not None:
                said |= {"face": _short(faces), "inertia": "shell"}  # what is drawn may be open
            SubElement(self._assets, "mesh", said)
            self._meshes[key] = name
        return self._meshes[key]


def _short(values: ArrayLike) -> str:
    return " ".join(f"{x:.7g}" for x in np.asarray(values).ravel().tolist())
