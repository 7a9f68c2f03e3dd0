"""The plain part of MJCF, read without MuJoCo.

Bodies with an explicit <inertial>, their joints and sites, default classes, equalities, actuators
and keyframes. What needs MuJoCo's compiler, such as an inertia that follows from geoms, raises
`NotPlain` with the name of the element.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from math import inf
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.errors import InvalidModel
from condyn_pin.io.mjcf_defaults import Defaults
from condyn_pin.io.mjcf_equality import read_equality
from condyn_pin.io.mjcf_pose import Settings, direction, pose
from condyn_pin.io.mjcf_types import COORDINATES, WORLD, Body, Closure, Description, Gear, Joint
from condyn_pin.io.mjcf_words import (
    EQUALITIES,
    ORIENTATIONS,
    PASSED_IN_BODY,
    PASSED_SECTIONS,
    PLAIN_SETTINGS,
    SECTIONS,
)
from condyn_pin.io.mjcf_xml import Attributes, NotPlain

# Of principal moments A <= B <= C, relative to C: what rounding leaves of a zero moment, and of
# A + B = C in numbers typed with few digits.
_ZERO, _FLAT = 1e-12, 1e-6


def read_plain(root: Element) -> Description:
    """Return what a plain file says.

    Raises
    ------
    NotPlain
        If only MuJoCo itself reads the file rightly.
    InvalidModel
        If something in it is wrong.
    """
    return _Reader(root).description()


class _Reader:
    """A file that is being read: its settings, and what was met so far."""

    def __init__(self, root: Element) -> None:
        self.root = root
        self.passed: Counter[str] = Counter()
        self.unread: Counter[str] = Counter()
        self.unused: list[str] = []
        for element in root:
            if element.tag in PASSED_SECTIONS:
                self.passed[f"<{element.tag}>"] += 1
            elif element.tag not in (*SECTIONS, "default"):
                raise NotPlain(f"<{element.tag}> is there")
        self.defaults = Defaults(root)
        self.settings = self._settings()
        self.bodies: list[Body] = []

    def description(self) -> Description:
        gravity, equalities_hold = self._options()
        world = Element("body", name=WORLD)
        for section in self.root.findall("worldbody"):
            world.extend(section)
        for element in world:
            if element.tag in ("inertial", "joint", "freejoint"):
                raise InvalidModel(f"<{element.tag}> in <worldbody>: the world does not move")
        try:
            self._body(world, 0, "", moves=False)
        except RecursionError as error:
            raise InvalidModel("bodies are nested too deeply") from error
        equalities = tuple(self._equalities(equalities_hold))
        actuated = tuple(self._actuated())
        keyframes = dict(self._keyframes())
        for what, counts in (("elements", self.passed), ("attributes", self.unread)):
            if counts:
                listed = ", ".join(f"{n} {name}" for name, n in sorted(counts.items()))
                self.unused.append(f"{what} that are not read: {listed}")
        return Description(
            name=self.root.get("model", ""),
            gravity=gravity,
            bodies=tuple(self.bodies),
            equalities=equalities,
            actuated=actuated,
            keyframes=keyframes,
            unused=tuple(self.unused),
        )

    def attributes(self, element: Element, kind: str = "", childclass: str = "") -> Attributes:
        """Return the attributes of an element; count those that are not read."""
        kind = kind or element.tag
        tag = "equality" if kind in EQUALITIES else kind
        said = Attributes(element, kind, self.defaults.of(element, tag, childclass))
        self.unread += said.unread
        return said

    def _settings(self) -> Settings:
        merged = Element("compiler")
        for section in self.root.findall("compiler"):
            merged.attrib.update(section.attrib)
        for key, plain in PLAIN_SETTINGS.items():
            if merged.attrib.pop(key, plain) != plain:
                raise NotPlain(f"<compiler> has {key} other than {plain!r}")
        said = Attributes(merged, "compiler", {})
        unit = said.one_of("angle", ("degree", "radian"), "degree")
        eulerseq = said.text("eulerseq", "xyz")
        if len(eulerseq) != 3 or set(eulerseq.lower()) - set("xyz"):
            said.refuse("eulerseq", "three letters out of x y z X Y Z are needed")
        return Settings(
            angle=np.pi / 180 if unit == "degree" else 1.0,
            eulerseq=eulerseq,
            autolimits=said.flag("autolimits", True),
        )

    def _options(self) -> tuple[Array, bool]:
        """Return gravity [m/s^2], and whether the equalities hold at all."""
        gravity, falls, equalities_hold = np.array([0.0, 0.0, -9.81]), True, True
        for section in self.root.findall("option"):
            gravity = self.attributes(section).floats("gravity", 3, gravity)
            for flag in section.findall("flag"):
                said = self.attributes(flag)
                words = ("enable", "disable")
                falls = said.one_of("gravity", words, "enable") == "enable"
                equalities_hold = said.one_of("equality", words, "enable") == "enable"
        return gravity * falls, equalities_hold

    def _body(self, element: Element, parent: int, childclass: str, *, moves: bool) -> None:
        said = self.attributes(element)
        number = len(self.bodies)
        childclass = said.text("childclass", childclass)
        name = said.text("name") or f"body{number}"
        joints = [e for e in element if e.tag in ("joint", "freejoint")]
        moves = moves or bool(joints)
        for child in element:
            if child.tag in PASSED_IN_BODY:
                self.passed[f"<{child.tag}>"] += 1
            elif child.tag not in ("inertial", "joint", "freejoint", "site", "body"):
                raise NotPlain(f"<{child.tag}> is in body {name!r}")
        self.bodies.append(
            Body(
                name=name,
                parent=parent,
                pose=pose(said, self.settings),
                inertia=self._inertia(element, name, moves),
                joints=tuple(
                    self._joint(joint, k, name, childclass) for k, joint in enumerate(joints)
                ),
                sites=dict(self._sites(element, childclass)),
            )
        )
        for child in element.findall("body"):
            self._body(child, number, childclass, moves=moves)

    def _inertia(self, body: Element, name: str, moves: bool) -> Any | None:
        """Return the inertia of a body in its own axes; None if the file gives none."""
        found = body.findall("inertial")
        if len(found) > 1:
            raise InvalidModel(f"body {name!r}: <inertial> is there {len(found)} times; keep one")
        if not found:
            if moves and body.find("geom") is not None:
                raise NotPlain(f"the inertia of body {name!r} follows from its geoms")
            return None
        said = self.attributes(found[0])
        if "pos" not in said:
            raise InvalidModel(f"body {name!r}: <inertial> has no pos; say where the mass is")
        placed = pose(said, self.settings)
        if "fullinertia" in said:
            if len(list(said.given("diaginertia", *ORIENTATIONS))):
                said.refuse("fullinertia", "it excludes diaginertia and an orientation")
            xx, yy, zz, xy, xz, yz = said.floats("fullinertia", 6)
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        else:
            tensor = np.diag(said.floats("diaginertia", 3))
        A, B, C = np.linalg.eigvalsh(tensor)  # [kg m^2]
        if A + _ZERO * abs(C) < 0 or A + B < (1 - _FLAT) * C:
            raise InvalidModel(
                f"body {name!r}: the principal moments are {A:g}, {B:g} and {C:g}; of a solid none "
                "is negative, and two add up to the third or more"
            )
        R = placed.rotation
        return pin.Inertia(said.positive("mass"), placed.translation, R @ tensor @ R.T)

    def _joint(self, element: Element, number: int, body: str, childclass: str) -> Joint:
        said = self.attributes(element, childclass=childclass)
        kind = (
            said.one_of("type", tuple(COORDINATES), "hinge") if element.tag == "joint" else "free"
        )
        unit = self.settings.angle if kind == "hinge" else 1.0
        for key in ("stiffness", "damping"):
            if said.count(key) > 1:
                raise NotPlain(f"{said.label} has a {key} that is a polynomial")
        lower, upper = self._limits(said, kind)
        armature = said.positive("armature", 0.0)
        name = said.text("name") or f"{body}_joint{number or ''}"
        if kind == "free" and armature:
            self.unused.append(f"armature of the free joint {name!r}")
            armature = 0.0
        return Joint(
            name=name,
            kind=kind,
            point=said.floats("pos", 3, np.zeros(3)),
            axis=direction(said, "axis", said.floats("axis", 3, np.array([0.0, 0.0, 1.0]))),
            reference=said.number("ref", 0.0) * unit if COORDINATES[kind] == 1 else 0.0,
            lower=lower,
            upper=upper,
            armature=armature,
            damping=said.number("damping", 0.0),
            stiffness=said.number("stiffness", 0.0),
            rest=said.number("springref", 0.0) * unit,
        )

    def _limits(self, said: Attributes, kind: str) -> tuple[float, float]:
        """Return the limits of a joint [rad or m], infinite where there is none."""
        limited = said.one_of("limited", ("true", "false", "auto"), "auto")
        if limited == "auto" and "range" in said and not self.settings.autolimits:
            said.refuse("range", "without autolimits it needs limited as well")
        if limited == "false" or (limited == "auto" and "range" not in said):
            return -inf, inf
        lower, upper = said.floats("range", 2)
        if lower > upper:
            said.refuse("range", "exchange the two")
        if kind in ("free", "ball"):
            self.unread["range of <joint> that is a ball"] += 1
            return -inf, inf
        unit = self.settings.angle if kind == "hinge" else 1.0
        return lower * unit, upper * unit

    def _sites(self, body: Element, childclass: str) -> Iterator[tuple[str, Any]]:
        for element in body.findall("site"):
            said = self.attributes(element, childclass=childclass)
            if said.text("name"):
                yield said.text("name"), pose(said, self.settings)

    def _equalities(self, hold: bool) -> Iterator[Closure | Gear]:
        sites = {name: body.name for body in self.bodies for name in body.sites}
        for section in self.root.findall("equality"):
            for number, element in enumerate(section):
                if element.tag not in ("connect", "weld", "joint"):
                    if element.tag.startswith("flex"):
                        raise NotPlain(f"<{element.tag}> is in <equality>")
                    self.passed[f"<{element.tag}> in <equality>"] += 1
                    continue
                kind = "equality/joint" if element.tag == "joint" else element.tag
                said = self.attributes(element, kind)
                name = said.text("name") or f"{element.tag}{number}"
                if not (said.flag("active", True) and hold):
                    self.unused.append(f"equality {name!r} is not active")
                    continue
                equality = read_equality(said, element.tag, name, sites)
                if isinstance(equality, str):
                    self.unused.append(equality)
                else:
                    yield equality

    def _actuated(self) -> Iterator[str]:
        for section in self.root.findall("actuator"):
            for element in section:
                joint = element.get("joint") or element.get("jointinparent")
                if joint:
                    self.passed["<actuator> but for its joint"] += 1
                    yield joint
                else:
                    self.passed["<actuator> that drives no joint"] += 1

    def _keyframes(self) -> Iterator[tuple[str, Array]]:
        number = 0
        for section in self.root.findall("keyframe"):
            for element in section.findall("key"):
                said = self.attributes(element)
                if "qpos" in said:
                    yield (
                        said.text("name") or f"key{number}",
                        said.floats("qpos", said.count("qpos")),
                    )
                number += 1
