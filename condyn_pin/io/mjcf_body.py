"""Bodies of a plain MJCF file: inertia, joints, sites, and the bodies on them."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin.errors import InvalidModel
from condyn_pin.io.inertia import fault, inertia_in, tensor
from condyn_pin.io.mjcf_pose import direction, pose
from condyn_pin.io.mjcf_source import Source
from condyn_pin.io.mjcf_types import COORDINATES, WORLD, Body, Joint
from condyn_pin.io.mjcf_words import ORIENTATIONS, PASSED_IN_BODY
from condyn_pin.io.mjcf_xml import Attributes, NotPlain

_JOINTS = ("joint", "freejoint")


def read_bodies(source: Source) -> tuple[Body, ...]:
    """Return the bodies of a file depth-first, the world first."""
    world = Element("body", name=WORLD)
    for section in source.root.findall("worldbody"):
        world.extend(section)
    for element in world:
        if element.tag in ("inertial", *_JOINTS):
            raise InvalidModel(f"<{element.tag}> in <worldbody>: the world does not move")
    reader = _Reader(source)
    try:
        reader.read(world, 0, "", moves=False)
    except RecursionError as error:
        raise InvalidModel("bodies are nested too deeply") from error
    return tuple(reader.bodies)


class _Reader:
    """The bodies that were read so far."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.bodies: list[Body] = []
        self._sites: set[str] = set()

    def read(self, element: Element, parent: int, childclass: str, *, moves: bool) -> None:
        said = self.source.attributes(element)
        number = len(self.bodies)
        childclass = said.text("childclass", childclass)
        name = said.text("name") or f"body{number}"
        joints = [e for e in element if e.tag in _JOINTS]
        moves = moves or bool(joints)
        for child in element:
            if child.tag in PASSED_IN_BODY:
                self.source.passed[f"<{child.tag}>"] += 1
            elif child.tag not in ("inertial", *_JOINTS, "site", "body"):
                raise NotPlain(f"<{child.tag}> is in body {name!r}")
        self.bodies.append(
            Body(
                name=name,
                parent=parent,
                pose=pose(said, self.source.settings),
                inertia=self._inertia(element, name, moves),
                joints=tuple(
                    self._joint(joint, k, name, childclass) for k, joint in enumerate(joints)
                ),
                sites=dict(self._read_sites(element, childclass)),
            )
        )
        for child in element.findall("body"):
            self.read(child, number, childclass, moves=moves)

    def _inertia(self, body: Element, name: str, moves: bool) -> Any | None:
        """Return the inertia of a body in its own axes; None if the file gives none."""
        found = body.findall("inertial")
        if len(found) > 1:
            raise InvalidModel(f"body {name!r}: <inertial> is there {len(found)} times; keep one")
        if not found:
            if moves and body.find("geom") is not None:
                raise NotPlain(f"the inertia of body {name!r} follows from its geoms")
            return None
        said = self.source.attributes(found[0])
        if "pos" not in said:
            raise InvalidModel(f"body {name!r}: <inertial> has no pos; say where the mass is")
        placed = pose(said, self.source.settings)
        if "fullinertia" in said:
            if len(list(said.given("diaginertia", *ORIENTATIONS))):
                said.refuse("fullinertia", "it excludes diaginertia and an orientation")
            inertia = tensor(*said.floats("fullinertia", 6))
        else:
            inertia = np.diag(said.floats("diaginertia", 3))
        mass = said.positive("mass")
        reason = fault(inertia)
        if reason:
            raise InvalidModel(f"body {name!r}: {reason}, as in no solid; MuJoCo refuses it too")
        return inertia_in(mass, placed, inertia)

    def _joint(self, element: Element, number: int, body: str, childclass: str) -> Joint:
        said = self.source.attributes(element, childclass=childclass)
        kind = (
            said.one_of("type", tuple(COORDINATES), "hinge") if element.tag == "joint" else "free"
        )
        unit = self.source.settings.angle if kind == "hinge" else 1.0
        for key in ("stiffness", "damping"):
            if said.count(key) > 1:
                raise NotPlain(f"{said.label} has a {key} that is a polynomial")
        lower, upper = self._limits(said, kind)
        armature = said.positive("armature", 0.0)
        name = said.text("name") or f"{body}_joint{number or ''}"
        if kind == "free" and armature:
            self.source.unused.append(f"armature of the free joint {name!r}")
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
        if limited == "auto" and "range" in said and not self.source.settings.autolimits:
            said.refuse("range", "without autolimits it needs limited as well")
        if limited == "false" or (limited == "auto" and "range" not in said):
            return -inf, inf
        lower, upper = said.floats("range", 2)
        if lower > upper:
            said.refuse("range", "exchange the two")
        if kind in ("free", "ball"):
            self.source.unread["range of <joint> that is a ball"] += 1
            return -inf, inf
        if lower == upper and limited == "true":
            said.refuse("range", "it has no width: fix the joint, or give it limits")
        if lower == upper:  # MuJoCo's own default, and its word for no limit
            self.source.unread["range of <joint> without width, which is no limit"] += 1
            return -inf, inf
        unit = self.source.settings.angle if kind == "hinge" else 1.0
        return lower * unit, upper * unit

    def _read_sites(self, body: Element, childclass: str) -> Iterator[tuple[str, Any]]:
        for element in body.findall("site"):
            said = self.source.attributes(element, childclass=childclass)
            name = said.text("name")
            if name in self._sites:
                raise InvalidModel(f"two sites are named {name!r}; rename one")
            if name:
                self._sites.add(name)
                yield name, pose(said, self.source.settings)
