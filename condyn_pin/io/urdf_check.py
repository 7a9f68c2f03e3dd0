"""What a URDF has to be before Pinocchio may read it.

Its parser prints where it should raise, drops the mass of a link whose numbers it cannot read, and
accepts NaN. So every element that it reads is checked first and copied out; the rest stays behind.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import WORLD
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.xml import check_counts, find, floats, label
from condyn_pin.model.tree import NO_LIMIT

_TYPES: Final = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_WITH_AXIS: Final = ("revolute", "continuous", "prismatic", "planar")
_SCALAR: Final = ("revolute", "continuous", "prismatic")
_MOMENTS: Final = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def checked(robot: Element, *, floating: bool, mimic: bool) -> Element:
    """Return a copy of a URDF with what Pinocchio reads, after a look at all of it.

    Parameters
    ----------
    robot : Element
        The root of the file.
    floating : bool
        Whether the root link moves.
    mimic : bool
        Whether <mimic> is read.

    Raises
    ------
    InvalidModel
        Naming the element, what was found, and what would do.
    """
    if not robot.get("name"):
        raise InvalidModel("<robot> has no name; give it one")
    links, joints = _named(robot, "link"), _named(robot, "joint")
    if not links:
        raise InvalidModel("<robot> has no <link>; at least one is needed")
    check_counts(len(links), sum(joint.get("type") != "fixed" for joint in joints.values()))
    root = _root(links, joints)
    for name in (*links, *joints):
        if name in WORLD and (name != root or floating):
            advice = "rename it, or take the root joint 'fixed'" if name == root else "rename it"
            raise InvalidModel(f"the name {name!r} is the world's: {advice}")
    mimicking = set(_mimicking(joints)) if mimic else set()
    copy = Element("robot", name=robot.attrib["name"])
    for link in links.values():
        _copy_link(copy, link)
    for joint in joints.values():
        _copy_joint(copy, joint, one_number=joint.attrib["name"] in mimicking)
    return copy


def _named(robot: Element, tag: str) -> dict[str, Element]:
    """Return elements by name, in the order of the file."""
    found: dict[str, Element] = {}
    for element in robot.findall(tag):
        name = element.get("name", "")
        if not name.strip():
            raise InvalidModel(f"a <{tag}> has no name; give it one")
        if name in found:
            raise InvalidModel(f"two <{tag}> are named {name!r}; rename one")
        found[name] = element
    return found


def _root(links: Mapping[str, Element], joints: Mapping[str, Element]) -> str:
    """Return the link on which the tree stands, after a look at the tree."""
    parent_of: dict[str, str] = {}
    for name, joint in joints.items():
        parent, child = (_end(joint, end, links) for end in ("parent", "child"))
        if child in parent_of:
            raise InvalidModel(
                f"joint {name!r}: link {child!r} has another parent joint; a URDF is a tree: cut "
                "the loop, and close it by [[loops]] in a robot.toml"
            )
        parent_of[child] = parent
    roots = [link for link in links if link not in parent_of]
    if len(roots) != 1:
        found = f"the links {', '.join(map(repr, roots[:4]))} have" if roots else "no link has"
        raise InvalidModel(f"{found} no parent joint; exactly one link, the root, must have none")
    reached = {roots[0]}
    waiting = [roots[0]]
    children: dict[str, list[str]] = {}
    for child, parent in parent_of.items():
        children.setdefault(parent, []).append(child)
    while waiting:
        below = children.get(waiting.pop(), [])
        reached.update(below)
        waiting.extend(below)
    lost = [link for link in links if link not in reached]
    if lost:
        raise InvalidModel(f"no joint leads from {roots[0]!r} to the links {lost[:4]}; add one")
    return roots[0]


def _end(joint: Element, end: str, links: Mapping[str, Element]) -> str:
    name = _link_at(joint, end)
    if not name:
        raise InvalidModel(f"{label(joint)}: no <{end} link=...>; name its {end} link")
    if name not in links:
        raise InvalidModel(f"{label(joint)}: <{end}>: {unknown_name('link', name, links)}")
    return name


def _link_at(joint: Element, end: str) -> str:
    element = find(joint, end)
    return "" if element is None else element.get("link", "")


def _mimicking(joints: Mapping[str, Element]) -> Iterator[str]:
    """Yield the joints that move with another one, and those others."""
    for name, joint in joints.items():
        mimic = find(joint, "mimic")
        if mimic is None or joint.get("type") == "fixed":
            continue
        other = mimic.get("joint", "")
        if other not in joints:
            known = unknown_name("joint", other, joints)
            raise InvalidModel(f"{label(joint)}: <mimic>: {known}")
        for who in (name, other):
            kind = joints[who].get("type", "")
            if kind not in _SCALAR:
                raise InvalidModel(
                    f"{label(joint)}: <mimic>: joint {who!r} is {kind}; joints with one degree of "
                    "freedom are needed"
                )
        if other == name:
            raise InvalidModel(f"{label(joint)}: <mimic>: it mimics itself; name another joint")
        if _number(mimic, "multiplier", label(joint), "1") == 0:
            raise InvalidModel(f"{label(joint)}: <mimic multiplier=0> locks it; make it fixed")
        _number(mimic, "offset", label(joint), "0")
        yield from (name, other)
    _check_circles(joints)


def _check_circles(joints: Mapping[str, Element]) -> None:
    """Refuse joints that mimic each other in a circle: none of them leads."""
    for start in joints:
        name, way = start, [start]
        while (mimic := find(joints[name], "mimic")) is not None:
            name = mimic.get("joint", "")
            if name == start:
                raise InvalidModel(
                    f"{label(joints[start])}: <mimic>: the joints {', '.join(map(repr, way))} "
                    "mimic each other in a circle; let one of them lead"
                )
            if name in way or name not in joints:
                break
            way.append(name)


def _copy_link(copy: Element, link: Element) -> None:
    made = SubElement(copy, "link", name=link.attrib["name"])
    inertial = find(link, "inertial")
    if inertial is None:
        return
    where = label(link)
    mass, inertia = find(inertial, "mass"), find(inertial, "inertia")
    if mass is None or inertia is None:
        lacks = "mass" if mass is None else "inertia"
        raise InvalidModel(f"{where}: <inertial> has no <{lacks}>; give it one")
    kilograms = _number(mass, "value", where)
    if kilograms < 0:
        raise InvalidModel(f"{where}: <mass value={kilograms:g}>: it must not be negative")
    moments = {key: repr(_number(inertia, key, where)) for key in _MOMENTS}
    body = SubElement(made, "inertial")
    _copy_origin(body, inertial, where)
    SubElement(body, "mass", value=repr(kilograms))
    SubElement(body, "inertia", moments)


def _copy_joint(copy: Element, joint: Element, *, one_number: bool) -> None:
    where, kind = label(joint), joint.get("type", "")
    if kind not in _TYPES:
        raise InvalidModel(f"{where}: {unknown_name('joint type', kind, _TYPES)}")
    # A continuous joint is (cos, sin) in Pinocchio; what is proportional needs an angle.
    unbounded = kind == "continuous" and one_number
    made = SubElement(copy, "joint", name=joint.attrib["name"])
    made.set("type", "revolute" if unbounded else kind)
    for end in ("parent", "child"):
        SubElement(made, end, link=_link_at(joint, end))
    _copy_origin(made, joint, where)
    axis = find(joint, "axis")
    if kind in _WITH_AXIS and axis is not None:
        xyz = floats(axis.get("xyz"), 3, f"{where}: <axis xyz>")
        if not xyz.any():
            raise InvalidModel(f"{where}: <axis xyz> is zero; give it a direction")
        SubElement(made, "axis", xyz=_text(xyz))
    _copy_limit(made, joint, kind, unbounded=unbounded)
    dynamics = find(joint, "dynamics")
    if dynamics is not None:
        said = {key: repr(_number(dynamics, key, where, "0")) for key in ("damping", "friction")}
        SubElement(made, "dynamics", said)


def _copy_limit(made: Element, joint: Element, kind: str, *, unbounded: bool) -> None:
    where, limit = label(joint), find(joint, "limit")
    if limit is None and kind in ("revolute", "prismatic"):
        raise InvalidModel(
            f"{where}: a {kind} joint needs <limit lower=.. upper=.. effort=.. velocity=..>; "
            "without limits it is continuous"
        )
    if limit is None and not unbounded:
        return
    limit = Element("limit") if limit is None else limit
    free = repr(NO_LIMIT)
    given = {"lower": "0", "upper": "0", "effort": free, "velocity": free} | limit.attrib
    if unbounded or without_bounds(joint):
        given |= {"lower": f"-{free}", "upper": free}
    said = {}
    for key in ("lower", "upper", "effort", "velocity"):
        value = floats(given[key], 1, f"{where}: <limit {key}>", infinite=True)
        said[key] = float(np.clip(value, -NO_LIMIT, NO_LIMIT)[0])
    if said["lower"] > said["upper"]:
        missing = [key for key in ("lower", "upper") if key not in limit.attrib]
        advice = (
            f"the {missing[0]} one is not there, which is 0; give it"
            if missing
            else "exchange them"
        )
        raise InvalidModel(f"{where}: limits {said['lower']:g} to {said['upper']:g}; {advice}")
    SubElement(made, "limit", {key: repr(value) for key, value in said.items()})


def without_bounds(joint: Element) -> bool:
    """Whether a joint that needs limits has some of effort and velocity only.

    By the format both bounds are then 0, which locks it. Exporters mean that there are none.
    """
    limit = find(joint, "limit")
    if joint.get("type") not in ("revolute", "prismatic") or limit is None:
        return False
    return not {"lower", "upper"} & limit.attrib.keys()


def _copy_origin(made: Element, element: Element, where: str) -> None:
    origin = find(element, "origin")
    if origin is None:
        return
    said = {}
    for key in ("xyz", "rpy"):
        if origin.get(key) is not None:
            said[key] = _text(floats(origin.get(key), 3, f"{where}: <origin {key}>"))
    SubElement(made, "origin", said)


def _number(element: Element, key: str, where: str, default: str | None = None) -> float:
    return float(floats(element.get(key, default), 1, f"{where}: <{element.tag} {key}>")[0])


def _text(values: Array) -> str:
    return " ".join(repr(float(x)) for x in values)
