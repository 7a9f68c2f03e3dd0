"""Loops that a URDF has beside its tree, each a frame A on one link and a frame B on another.

    <joint>                          one more parent of a link: the joint is cut, and closed again
    <loop_joint>, <constraint>       an origin on each link, as Isaac Sim and exporters write them
    <joint> in <gazebo>              one pose, on the child, as in an SDF

Both frames have z along the axis of the joint. What the file does not say of one of them is as it
is where the robot is drawn, at q = 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.rotations import z_along
from condyn_pin.constraints.loop import Loop, LoopKind, axis_of
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.urdf_elements import link_at
from condyn_pin.io.xml import find, floats, label

_KINDS: Final[Mapping[str, LoopKind]] = {
    "revolute": "hinge", "continuous": "hinge", "hinge": "hinge", "prismatic": "slider",
    "slider": "slider", "spherical": "ball", "ball": "ball", "fixed": "weld", "weld": "weld",
}  # fmt: skip
_AXIS: Final = "1 0 0"  # of the format, where it says none


@dataclass(frozen=True)
class Cut:
    """A joint that closes a loop, by a frame on its parent link and one on its child link.

    Attributes
    ----------
    name, parent, child : str
    kind : LoopKind
    one, two : pin.SE3 or None
        The frames on both links; None where it is drawn as the other one.
    oriented : bool
        Whether the axes of `two` are the file's; else they are drawn as those of `one`.
    """

    name: str
    kind: LoopKind
    parent: str
    child: str
    one: Any
    two: Any
    oriented: bool


def cuts_of(robot: Element, beside: Iterable[Element]) -> Iterator[Cut]:
    """Yield the loops of a URDF; `beside` the tree are joints whose child has a parent already."""
    for joint in beside:
        if find(joint, "mimic") is not None:
            raise InvalidModel(f"{label(joint)}: it closes a loop, and cannot mimic another joint")
        place = _origin(joint, "origin") or pin.SE3.Identity()
        turn = along(find(joint, "axis"))
        yield _cut(joint, _ends(joint), place * turn, turn, oriented=True)
    for tag in ("loop_joint", "constraint"):
        for element in robot.findall(tag):
            yield _by_two_origins(element)
    for gazebo in robot.findall("gazebo"):
        for joint in gazebo.findall("joint"):
            yield _of_gazebo(joint)


def close(model: Any, cuts: Sequence[Cut]) -> list[Loop]:
    """Add the frames NAME_a and NAME_b of all cuts to a model, and return their loops."""
    data, loops = model.createData(), list[Loop]()
    pin.framesForwardKinematics(model, data, np.array(pin.neutral(model)))
    links = {f.name: i for i, f in enumerate(model.frames) if f.type == pin.FrameType.BODY}
    for cut in cuts:
        for link in (cut.parent, cut.child):
            if link not in links:
                raise InvalidModel(f"{cut.name!r}: {unknown_name('link', link, links)}")
        ends = links[cut.parent], links[cut.child]
        drawn = data.oMf[ends[0]].actInv(data.oMf[ends[1]])
        one = drawn * cut.two if cut.one is None else cut.one
        two = drawn.actInv(one) if cut.two is None else cut.two
        if not cut.oriented:
            two = pin.SE3(drawn.actInv(one).rotation, two.translation)
        names = f"{cut.name}_a", f"{cut.name}_b"
        for name, end, place in zip(names, ends, (one, two), strict=True):
            if model.existFrame(name):
                raise InvalidModel(f"{cut.name!r}: there is a frame {name!r} already; rename it")
            link = model.frames[end]
            of_joint = link.parentJoint, end, link.placement * place
            model.addFrame(pin.Frame(name, *of_joint, pin.FrameType.OP_FRAME))
        loops.append(Loop(*names, cut.kind, axis=axis_of(cut.kind), name=cut.name))
    return loops


def _by_two_origins(element: Element) -> Cut:
    halves = element.findall("link1") + element.findall("link2")
    if len(halves) == 2:
        links = halves[0].get("link", ""), halves[1].get("link", "")
        one, two = (_placed(half) for half in halves)
    else:
        links = _ends(element)
        one, two = (_origin(element, f"{end}_origin") for end in ("parent", "child"))
    if one is None and two is None:
        raise InvalidModel(
            f"{label(element)}: no origin on a link; give it <parent_origin xyz=...>"
        )
    axis, other = find(element, "parent_axis"), find(element, "child_axis")
    axis = find(element, "axis") if axis is None else axis
    turn = along(axis)
    if axis is not None and axis.get("frame") == "parent" and one is not None:
        turn = pin.SE3(one.rotation.T, np.zeros(3)) * turn  # the axis is in the link, not in one
    one = None if one is None else one * turn
    two = (
        two
        if two is None or (other is None and one is not None)
        else two * along(axis if other is None else other)
    )
    return _cut(element, links, one, two, oriented=one is None or other is not None)


def _of_gazebo(joint: Element) -> Cut:
    pose, axis = find(joint, "pose"), find(joint, "axis/xyz")
    x = np.zeros(6) if pose is None else floats(pose.text, 6, f"{label(joint)}: <pose>")
    place = pin.SE3(pin.rpy.rpyToMatrix(*x[3:]), x[:3])
    turn = along(Element("axis", xyz="0 0 1" if axis is None else axis.text or ""))
    links = joint.findtext("parent", "").strip(), joint.findtext("child", "").strip()
    return _cut(joint, links, None, place * turn, oriented=True)


def _cut(element: Element, links: tuple[str, str], one: Any, two: Any, *, oriented: bool) -> Cut:
    name, kind = element.get("name", ""), element.get("type", "")
    if not name.strip():
        raise InvalidModel(f"a <{element.tag}> that closes a loop has no name; give it one")
    if kind not in _KINDS:
        raise InvalidModel(f"{label(element)}: {unknown_name('type of a loop', kind, _KINDS)}")
    return Cut(name, _KINDS[kind], *links, one, two, oriented)


def _ends(element: Element) -> tuple[str, str]:
    return link_at(element, "parent"), link_at(element, "child")


def _origin(element: Element, tag: str) -> Any:
    """Return the placement in <tag xyz= rpy=> below an element; None if there is none."""
    origin = find(element, tag)
    return None if origin is None else _placed(origin)


def _placed(origin: Element) -> Any:
    xyz, rpy = (
        floats(origin.get(key, "0 0 0"), 3, f"<{origin.tag} {key}>") for key in ("xyz", "rpy")
    )
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)


def along(axis: Element | None) -> Any:
    """Return the least turn after which z is along an <axis xyz=>."""
    xyz = floats(_AXIS if axis is None else axis.get("xyz", _AXIS), 3, "<axis xyz>")
    if not xyz.any():
        raise InvalidModel("<axis xyz> is zero; give it a direction")
    return pin.SE3(z_along(xyz / np.abs(xyz).max()), np.zeros(3))  # squares of small ones are 0
