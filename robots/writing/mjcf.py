"""Mjcf: a mechanism while it is written, and the solids it is made of."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from math import cos, sin
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

X, Y, Z = np.eye(3)


class Mjcf:
    """A mechanism while it is written. Bodies are given by their frames in the world, as drawn."""

    def __init__(self, name: str) -> None:
        self.root = ET.Element("mujoco", model=name)
        self.root.append(ET.Comment(" Written by robots/write_mechanisms.py: edit that instead. "))
        _add(self.root, "compiler", angle="radian", autolimits="true")
        _add(self.root, "option", gravity=-9.81 * Z)
        world = _add(self.root, "worldbody")
        self._bodies = {"base": _add(world, "body", name="base")}
        self._drawn = {"base": pin.SE3.Identity()}

    def body(
        self,
        name: str,
        parent: str,
        p: ArrayLike,
        R: ArrayLike,
        joint: Mapping[str, Any],
        solid: Solid,
    ) -> None:
        """Add a body with origin p and axes R in the world, its joint at the origin."""
        drawn = pin.SE3(np.asarray(R), np.asarray(p))
        parentMbody = self._drawn[parent].actInv(drawn)
        wxyz = np.roll(pin.Quaternion(parentMbody.rotation).coeffs(), 1)
        element = _add(
            self._bodies[parent], "body", name=name, pos=parentMbody.translation, quat=wxyz
        )
        _add(element, "joint", **joint)
        _add(element, "inertial", pos=solid.centre, mass=solid.mass, diaginertia=solid.moments)
        self._bodies[name], self._drawn[name] = element, drawn

    def connect(self, name: str, body1: str, body2: str, point: np.ndarray) -> None:
        """Hold two bodies together at a point of the world."""
        anchor = self._drawn[body1].actInv(point)
        _add(
            self._section("equality"), "connect", name=name, body1=body1, body2=body2, anchor=anchor
        )

    def site(self, name: str, body: str, point: np.ndarray) -> None:
        """Mark a point of the world on a body."""
        _add(self._bodies[body], "site", name=name, pos=self._drawn[body].actInv(point))

    def motors(self, *joints: str) -> None:
        """Drive some joints."""
        for joint in joints:
            _add(self._section("actuator"), "motor", name=f"{joint}_motor", joint=joint)

    def posture(self, name: str, moved: Mapping[str, ArrayLike]) -> None:
        """Add a posture: coordinates of some joints; the others stay as drawn."""
        q: list[float] = []
        for joint in self.root.iter("joint"):
            drawn = (1, 0, 0, 0) if joint.get("type") == "ball" else float(joint.get("ref", 0))
            q.extend(np.atleast_1d(moved.get(joint.get("name", ""), drawn)))
        _add(self._section("keyframe"), "key", name=name, qpos=q)

    def text(self) -> str:
        """Return the file."""
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="unicode") + "\n"

    def _section(self, tag: str) -> ET.Element:
        found = self.root.find(tag)
        return _add(self.root, tag) if found is None else found


def hinge(name: str, axis: np.ndarray, ref: float = 0.0) -> dict[str, Any]:
    """Return a hinge; `ref` is its angle as drawn."""
    return {"name": name, "type": "hinge", "axis": axis} | ({"ref": ref} if ref else {})


def slide(name: str, axis: np.ndarray, stroke: tuple[float, float]) -> dict[str, Any]:
    """Return a slider with the ends of its stroke [m]."""
    return {"name": name, "type": "slide", "axis": axis, "range": stroke}


def ball(name: str) -> dict[str, Any]:
    """Return a ball joint."""
    return {"name": name, "type": "ball"}


class Solid(NamedTuple):
    """A mass, its centre in the axes of the body, and its principal moments along them."""

    mass: float
    centre: ArrayLike
    moments: ArrayLike


def rod(length: float, mass: float, radius: float) -> Solid:
    """Return a round rod that lies along x from the origin."""
    across = mass * (3 * radius**2 + length**2) / 12
    return Solid(mass, (length / 2, 0, 0), (mass * radius**2 / 2, across, across))


def square_rod(length: float, mass: float, side: float) -> Solid:
    """Return a rod of square section that lies along x from the origin."""
    across = mass * (length**2 + side**2) / 12
    return Solid(mass, (length / 2, 0, 0), (mass * side**2 / 6, across, across))


def disc(radius: float, height: float, mass: float, centre: ArrayLike) -> Solid:
    """Return a disc across z."""
    across = mass * (3 * radius**2 + height**2) / 12
    return Solid(mass, centre, (across, across, mass * radius**2 / 2))


def round_body(radius: float, mass: float) -> Solid:
    """Return a ball about the origin."""
    return Solid(mass, (0, 0, 0), [0.4 * mass * radius**2] * 3)


def along(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return axes with x along the first direction and y as near the second as can be."""
    z = np.cross(x, y)
    columns = x, np.cross(z, x), z
    return np.column_stack([c / np.linalg.norm(c) for c in columns])


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the quaternion w x y z of a turn about a unit vector."""
    return np.array([cos(angle / 2), *(sin(angle / 2) * axis)])


def _add(parent: ET.Element, tag: str, **attributes: Any) -> ET.Element:
    text = {k: v if isinstance(v, str) else _numbers(v) for k, v in attributes.items()}
    return ET.SubElement(parent, tag, text)


def _numbers(values: ArrayLike) -> str:
    return " ".join(_number(float(x)) for x in np.atleast_1d(values))


def _number(x: float) -> str:
    """Return a number in the shortest form that reads back; rounding about zero is left out."""
    short = f"{x:.15g}"
    return "0" if abs(x) < 1e-15 else short if abs(float(short) - x) < 1e-17 else repr(x)
