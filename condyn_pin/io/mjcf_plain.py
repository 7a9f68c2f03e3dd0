"""The plain part of MJCF, read without MuJoCo.

Bodies with an explicit <inertial>, their joints and sites, default classes, equalities, actuators
and keyframes. What needs MuJoCo's compiler, such as an inertia that follows from geoms, raises
`NotPlain` with the name of the element.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel
from condyn_pin.io.mjcf_body import read_bodies
from condyn_pin.io.mjcf_equality import read_equality
from condyn_pin.io.mjcf_source import Source
from condyn_pin.io.mjcf_types import Body, Closure, Description, End, Gear
from condyn_pin.io.mjcf_xml import NotPlain


def read_plain(root: Element) -> Description:
    """Return what a plain file says.

    Raises
    ------
    NotPlain
        If only MuJoCo itself reads the file rightly.
    InvalidModel
        If something in it is wrong.
    """
    source = Source(root)
    gravity, equalities_hold = _options(source)
    bodies = read_bodies(source)
    return Description(
        name=root.get("model", "MuJoCo Model"),
        gravity=gravity,
        bodies=bodies,
        equalities=tuple(_equalities(source, bodies, equalities_hold)),
        actuated=tuple(_actuated(source)),
        keyframes=_keyframes(source),
        unused=source.remarks(),
    )


def _options(source: Source) -> tuple[Array, bool]:
    """Return gravity [m/s^2], and whether the equalities hold at all."""
    gravity, falls, equalities_hold = np.array([0.0, 0.0, -9.81]), True, True
    for section in source.root.findall("option"):
        gravity = source.attributes(section).floats("gravity", 3, gravity)
        for flag in section.findall("flag"):
            said = source.attributes(flag)
            words = ("enable", "disable")
            falls = said.one_of("gravity", words, "enable") == "enable"
            equalities_hold = said.one_of("equality", words, "enable") == "enable"
    return gravity * falls, equalities_hold


def _equalities(source: Source, bodies: Iterable[Body], hold: bool) -> Iterator[Closure | Gear]:
    sites = {name: End(body.name, bMs, name) for body in bodies for name, bMs in body.sites.items()}
    sections = source.root.findall("equality")
    for number, element in enumerate(element for section in sections for element in section):
        if element.tag not in ("connect", "weld", "joint"):
            if element.tag.startswith("flex"):
                raise NotPlain(f"<{element.tag}> is in <equality>")
            source.passed[f"<{element.tag}> in <equality>"] += 1
            continue
        kind = "equality/joint" if element.tag == "joint" else element.tag
        said = source.attributes(element, kind)
        name = said.text("name") or f"{element.tag}{number}"
        if not (said.flag("active") and hold):
            source.unused.append(f"equality {name!r} is not active")
            continue
        equality = read_equality(said, element.tag, name, sites)
        if isinstance(equality, str):
            source.unused.append(equality)
        else:
            yield equality


def _actuated(source: Source) -> Iterator[str]:
    for section in source.root.findall("actuator"):
        for element in section:
            joint = element.get("joint") or element.get("jointinparent")
            if joint:
                source.passed["<actuator> but for its joint"] += 1
                yield joint
            else:
                source.passed["<actuator> that drives no joint"] += 1


def _keyframes(source: Source) -> dict[str, Array]:
    found: dict[str, Array] = {}
    sections = source.root.findall("keyframe")
    for number, element in enumerate(e for section in sections for e in section.findall("key")):
        said = source.attributes(element)
        name = said.text("name") or f"key{number}"
        if name in found:
            raise InvalidModel(f"two keyframes are named {name!r}; rename one")
        if "qpos" in said:
            found[name] = said.floats("qpos", said.count("qpos"))
    return found
