"""What a URDF has to be before Pinocchio may read it.

Its parser prints where it should raise, drops the mass of a link whose numbers it cannot read, and
accepts NaN. So every element that it reads is checked first and copied out (`urdf_elements`); the
rest stays behind.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final
from xml.etree.ElementTree import Element

from condyn_pin.constraints.base import WORLD
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.urdf_elements import copy_joint, copy_link, link_at, number
from condyn_pin.io.xml import check_counts, find, label

_SCALAR: Final = ("revolute", "continuous", "prismatic")


def checked(robot: Element, *, floating: bool, mimic: bool) -> tuple[Element, list[Element]]:
    """Return a copy of a URDF with what Pinocchio reads, all of it checked, and what it cannot.

    That are the joints whose child has a parent already: each closes a loop of the tree.

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
    beside = _beside_the_tree(links, joints)
    joints = {name: joint for name, joint in joints.items() if name not in beside}
    root = _root(links, joints)
    for name in (*links, *joints):
        if name in WORLD and (name != root or floating):
            advice = "rename it, or take the root joint 'fixed'" if name == root else "rename it"
            raise InvalidModel(f"the name {name!r} is the world's: {advice}")
    mimicking = set(_mimicking(joints)) if mimic else set()
    copy = Element("robot", name=robot.attrib["name"])
    for link in links.values():
        copy_link(copy, link)
    for joint in joints.values():
        copy_joint(copy, joint, one_number=joint.attrib["name"] in mimicking)
    return copy, list(beside.values())


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


def _beside_the_tree(
    links: Mapping[str, Element], joints: Mapping[str, Element]
) -> dict[str, Element]:
    """Return the joints whose child has a parent already, in the order of the file."""
    have_parents, beside = set[str](), dict[str, Element]()
    for name, joint in joints.items():
        child = _end(joint, "child", links)
        if child in have_parents:
            beside[name] = joint
        have_parents.add(child)
    return beside


def _root(links: Mapping[str, Element], joints: Mapping[str, Element]) -> str:
    """Return the root link; refuse what is no tree."""
    parent_of = {_end(j, "child", links): _end(j, "parent", links) for j in joints.values()}
    roots = [link for link in links if link not in parent_of]
    if len(roots) != 1:
        found = f"the links {', '.join(map(repr, roots[:4]))} have" if roots else "no link has"
        advice = "" if roots else "; exchange parent and child of the joint that closes the loop"
        raise InvalidModel(
            f"{found} no parent joint; exactly one link, the root, must have none{advice}"
        )
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
    name = link_at(joint, end)
    if not name:
        raise InvalidModel(f"{label(joint)}: no <{end} link=...>; name its {end} link")
    if name not in links:
        raise InvalidModel(f"{label(joint)}: <{end}>: {unknown_name('link', name, links)}")
    return name


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
        if number(mimic, "multiplier", label(joint), "1") == 0:
            raise InvalidModel(f"{label(joint)}: <mimic multiplier=0> locks it; make it fixed")
        number(mimic, "offset", label(joint), "0")
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
