"""Loops, motors and balls of a URDF, which authors write beside its tree.

A loop is a frame A on one link and a frame B on another.

By joints of the file
    <joint>                          one more parent of a link: the joint is cut, and closed again
    <loop_joint>, <constraint>       an origin on each link, as Isaac Sim and exporters write them
    <joint> in <gazebo>              one pose, on the child, as in an SDF

Both frames have z along the axis of the joint. What the file does not say of one of them is as it
is where the robot is drawn, at q = 0.

By names of links and joints
    closing_NAME_1, closing_NAME_2         a ball: onshape-to-robot exports these, placo closes them
    closedloopNAME_A, closedloopNAME_B     a weld, for the joint is in the tree beside it; a ball
                                           where a name says 3D, as in closedloop4_A_3D or
                                           closedloop3D_1A: the parallel robots of Gepetto

What the names leave open is said: a ball never locks a joint that could turn, and a weld does.

By a file ``ROBOT.yaml`` beside ``ROBOT.urdf``, or ``robot.yaml``; ``.yml`` and ``.toml`` as well
    closed_loop: [[FRAME, FRAME], ...]     the two ends of each loop
    type: [6D, 3D, ...]                    of each loop: 6D is a weld, 3D a ball; 6D if left out;
                                           or a kind of `Loop` with its axis, or a rod's length:
                                           hinge y, universal xy, slider x, rod 0.3
    name_mot: [JOINT, ...]                 joints with a motor
    joint_name: [JOINT, ...]               joints that a URDF cannot describe,
    joint_type: [SPHERICAL, ...]           and what they are: SPHERICAL, FIXED, or UJOINT_XY, two
                                           hinges about these axes of the joint's frame

One that says none of this is another one's, such as the robot.toml of this library.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from reprlib import repr as shortened  # aliases of a YAML may nest without end
from typing import Any, Final, get_args
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import listed, short_list
from condyn_pin._core.files import parse_toml, written_out
from condyn_pin._core.models import z_along
from condyn_pin.constraints.loop import Loop, LoopKind, axis_of
from condyn_pin.errors import InvalidModel, MissingExtra, unknown_name
from condyn_pin.io.xml import find, floats, label, place
from condyn_pin.model.whole_joints import Settings

_JOINTS: Final[Mapping[str, LoopKind]] = {
    "revolute": "hinge", "continuous": "hinge", "hinge": "hinge", "prismatic": "slider",
    "slider": "slider", "spherical": "ball", "ball": "ball", "fixed": "weld", "weld": "weld",
    "cylindrical": "cylindrical",
}  # fmt: skip
_AXIS: Final = "1 0 0"  # of the format, where it says none


@dataclass(frozen=True)
class LoopJoint:
    """A joint that closes a loop, by a frame on its parent link and one on its child link."""

    name: str
    kind: LoopKind
    parent: str
    child: str
    one: Any  # the frame on the parent; None if it coincides with the other one as drawn
    two: Any  # that on the child, likewise
    oriented: bool  # whether the axes of `two` are the file's; else they are those of `one`
    settings: Settings  # its limits, damping and friction


def cuts_of(robot: Element, beside: Iterable[Element]) -> Iterator[LoopJoint]:
    """Yield the loops of a URDF; `beside` the tree are joints whose child has a parent already."""
    for joint in beside:
        if find(joint, "mimic") is not None:
            raise InvalidModel(f"{label(joint)}: it closes a loop, and cannot mimic another joint")
        placed = _origin(joint, "origin") or pin.SE3.Identity()
        turn = rotation_onto(find(joint, "axis"))
        yield _cut(joint, _ends(joint), placed * turn, turn, oriented=True)
    for tag in ("loop_joint", "constraint"):
        for element in robot.findall(tag):
            yield _by_two_origins(element)
    for gazebo in robot.findall("gazebo"):
        for joint in () if gazebo.get("reference") else gazebo.findall("joint"):
            yield _of_gazebo(joint)


def close(model: Any, cuts: Sequence[LoopJoint]) -> list[Loop]:
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
        for name, end, placed in zip(names, ends, (one, two), strict=True):
            if model.existFrame(name):
                raise InvalidModel(f"{cut.name!r}: there is a frame {name!r} already; rename it")
            link = model.frames[end]
            of_joint = link.parentJoint, end, link.placement * placed
            model.addFrame(pin.Frame(name, *of_joint, pin.FrameType.OP_FRAME))
        loops.append(Loop(*names, cut.kind, axis=axis_of(cut.kind), name=cut.name))
    return loops


def _by_two_origins(element: Element) -> LoopJoint:
    halves = element.findall("link1") + element.findall("link2")
    if len(halves) == 2:
        links = halves[0].get("link", ""), halves[1].get("link", "")
        one, two = (_placement_of(half) for half in halves)
    else:
        links = _ends(element)
        one, two = (_origin(element, f"{end}_origin") for end in ("parent", "child"))
    if one is None and two is None:
        raise InvalidModel(
            f"{label(element)}: no origin on a link; give it <parent_origin xyz=...>"
        )
    axis, other = find(element, "parent_axis"), find(element, "child_axis")
    axis = find(element, "axis") if axis is None else axis
    turn = rotation_onto(axis)
    if axis is not None and axis.get("frame") == "parent" and one is not None:
        turn = pin.SE3(one.rotation.T, np.zeros(3)) * turn  # the axis is in the link, not in one
    if two is not None and (other is not None or one is None):
        two = two * rotation_onto(axis if other is None else other)
    one = None if one is None else one * turn
    return _cut(element, links, one, two, oriented=one is None or other is not None)


def _of_gazebo(joint: Element) -> LoopJoint:
    pose, axis = find(joint, "pose"), find(joint, "axis/xyz")
    x = np.zeros(6) if pose is None else floats(pose.text, 6, f"{label(joint)}: <pose>")
    placed = pin.SE3(pin.rpy.rpyToMatrix(*x[3:]), x[:3])
    turn = rotation_onto(Element("axis", xyz="0 0 1" if axis is None else axis.text or ""))
    links = joint.findtext("parent", "").strip(), joint.findtext("child", "").strip()
    return _cut(joint, links, None, placed * turn, oriented=True)


def _cut(
    element: Element, links: tuple[str, str], one: Any, two: Any, *, oriented: bool
) -> LoopJoint:
    name, kind = element.get("name", ""), element.get("type", "")
    if not name.strip():
        raise InvalidModel(f"a <{element.tag}> that closes a loop has no name; give it one")
    if kind not in _JOINTS:
        raise InvalidModel(f"{label(element)}: {unknown_name('type of a loop', kind, _JOINTS)}")
    return LoopJoint(name, _JOINTS[kind], *links, one, two, oriented, _settings(element))


def _settings(joint: Element) -> Settings:
    """Limits, damping and friction of a joint: attributes in a URDF, elements of an axis in SDF."""
    kind, numbers = joint.get("type", ""), dict[str, float]()
    ends = {} if kind == "continuous" else {"lower": -inf, "upper": inf}
    keys = {"limit": ("effort", "velocity", *ends), "dynamics": ("damping", "friction")}
    for path in ("limit", "dynamics", "axis/limit", "axis/dynamics"):
        element, tag = find(joint, path), path.rpartition("/")[2]
        if element is None:
            continue
        if tag == "limit" and {"lower", "upper"} & element.attrib.keys():
            numbers |= dict.fromkeys(ends, 0.0)  # of the format, for the one that is left out
        for key in keys[tag]:
            if text := element.get(key) or element.findtext(key):
                numbers[key] = float(floats(text, 1, f"<{tag} {key}>", infinite=True)[0])
    return Settings(**numbers)


def _ends(element: Element) -> tuple[str, str]:
    return link_at(element, "parent"), link_at(element, "child")


def _origin(element: Element, tag: str) -> Any:
    """Return the placement in <tag xyz= rpy=> below an element; None if there is none."""
    origin = find(element, tag)
    return None if origin is None else _placement_of(origin)


def _placement_of(origin: Element) -> Any:
    xyz, rpy = (
        floats(origin.get(key, "0 0 0"), 3, f"<{origin.tag} {key}>") for key in ("xyz", "rpy")
    )
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)


def rotation_onto(axis: Element | None) -> Any:
    """Return the least rotation of z onto an <axis xyz=>."""
    xyz = floats(_AXIS if axis is None else axis.get("xyz", _AXIS), 3, "<axis xyz>")
    if not xyz.any():
        raise InvalidModel("<axis xyz> is zero; give it a direction")
    return pin.SE3(z_along(xyz / np.abs(xyz).max()), np.zeros(3))  # squares of small ones are 0


def link_at(joint: Element, end: str) -> str:
    """Return the name of a joint's parent or child; empty if it has none."""
    element = find(joint, end)
    return "" if element is None else element.get("link", "")


_CLOSING: Final = re.compile(r"(?P<name>closing_.+)_(?P<half>[12])")
# The side stands last, or before 3D or 6D, with an underscore before it or without.
_CLOSED_LOOP: Final = re.compile(r"(?P<name>.*(?i:closed_?loop).*?)_?(?P<half>[AB])(?i:_[36]D)?")
_POINT: Final = re.compile(r"3D", re.IGNORECASE)


def closings(links: Iterable[str], joints: Iterable[str]) -> Iterator[Loop]:
    """Yield the loops of pairs of links, or of joints, with names of closures."""
    links = sorted(links)
    for name, first, second in _pairs(links, _CLOSING):
        yield Loop(first, second, "ball", name=name)
    for name, first, second in _pairs(sorted({*links, *joints}), _CLOSED_LOOP):
        point = _POINT.search(first) and _POINT.search(second)
        yield Loop(first, second, "ball" if point else "weld", name=name)


def unpaired_halves(links: Iterable[str], joints: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield the names that look like halves of a loop and close nothing, with the reason."""
    links, joints = set(links), set(joints)
    used = {end for loop in closings(links, joints) for end in (loop.frame_a, loop.frame_b)}
    for name in sorted((links | joints) - used):
        if name.startswith("closing_") and name in links:
            whole = _CLOSING.fullmatch(name)
            yield name, "its other half is missing" if whole else "it does not end in _1 or _2"
        elif _CLOSED_LOOP.fullmatch(name):
            yield name, "not just one name with A and one with B is like it"


def stem(name: str) -> str:
    """Return the name of the loop of which a name is one half; empty if it is none."""
    found = _CLOSING.fullmatch(name) or _CLOSED_LOOP.fullmatch(name)
    return found["name"] if found else ""


def _pairs(names: Iterable[str], rule: re.Pattern[str]) -> Iterator[tuple[str, str, str]]:
    """Name of each loop with exactly one name for each half, and both halves in order."""
    halves: dict[str, list[tuple[str, str]]] = {}
    for name in names:
        if found := rule.fullmatch(name):
            halves.setdefault(found["name"], []).append((found["half"].upper(), name))
    for name, found_halves in halves.items():
        if len(found_halves) == 2 and found_halves[0][0] != found_halves[1][0]:
            (_, first), (_, second) = sorted(found_halves)
            yield name, first, second


_KEYS: Final = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")
_OWN: Final = ("closed_loop", "name_mot", "joint_name")  # "type" is in files of others too
_KINDS: Final[Mapping[str, str]] = {"6D": "weld", "3D": "ball"}
_TYPES: Final = (*_KINDS, *get_args(LoopKind))
_PAIRS_OF_AXES: Final = tuple(a + b for a in "XYZ" for b in "XYZ" if a != b)
JOINT_TYPES: Final = ("SPHERICAL", "FIXED", *(f"UJOINT_{axes}" for axes in _PAIRS_OF_AXES))
_LARGEST: Final = 2**20  # bytes: a robot with a thousand loops has a tenth


@dataclass(frozen=True)
class CompanionFile:
    """Content of a file beside a URDF: loops, motors and joint types."""

    path: Path | None = None  # None where there is no such file
    loops: tuple[Loop, ...] | None = None  # None if the file names no loops
    motors: tuple[str, ...] = ()
    joints: Mapping[str, str] = field(default_factory=dict)  # type of each, one of `JOINT_TYPES`
    unread: tuple[str, ...] = ()  # its other entries

    def unused(self) -> Iterator[str]:
        """Yield the unread entries, and the unused numbers of retyped joints, as sentences."""
        if self.path is None:
            return
        if self.joints:
            by_kind: dict[str, list[str]] = {}
            for name, kind in self.joints.items():
                by_kind.setdefault(kind, []).append(name)
            made = "; ".join(f"{kind} ({short_list(names)})" for kind, names in by_kind.items())
            yield f"axes, limits, damping and friction of joints that {self.path.name} makes {made}"
        if self.unread:
            yield f"entries of {self.path.name} that are not read: {listed(self.unread)}"


def read_beside(urdf: Path) -> CompanionFile:
    """Return the content of the file beside a URDF; empty if there is none."""
    places = [urdf.with_name(name) for name in dict.fromkeys((urdf.stem, "robot"))]
    paths = [Path(f"{start}{suffix}") for start in places for suffix in (".yaml", ".yml", ".toml")]
    for path in filter(Path.is_file, paths):
        with place(path):
            said = _entries(path)
            if said.keys() & set(_OWN):
                return _read_beside(path, said)
    return CompanionFile()


def _text(path: Path) -> str:
    """Text of a file beside a URDF; empty if it has no entry of such a file."""
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST + 1)
        text = content.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError):  # it may be anybody's
        return ""
    if not any(key in text for key in _OWN):
        return ""
    if len(content) > _LARGEST:
        raise InvalidModel(f"it has more than {_LARGEST} bytes; is it of a robot?")
    return text


def _entries(path: Path) -> Mapping[str, Any]:
    """Entries of a TOML or a YAML; none if it has none of ours."""
    text = _text(path)
    if not text:
        return {}
    if path.suffix == ".toml":
        try:
            return parse_toml(text)
        except ValueError as error:
            raise InvalidModel(f"it is not valid TOML: {error}") from error
    try:
        import yaml
    except ImportError as error:
        raise MissingExtra(
            "a YAML needs PyYAML: python -m pip install 'condyn_pin[yaml]'"
        ) from error

    # of lists that hold themselves each text is met once
    class Printable(yaml.SafeLoader):  # type: ignore[misc]
        def construct_scalar(self, node: Any) -> Any:
            return written_out(super().construct_scalar(node))

    try:
        said = yaml.load(text, Loader=Printable)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise InvalidModel(f"it is not valid YAML: {' '.join(str(error).split())}") from error
    return said if isinstance(said, dict) else {}


def _read_beside(path: Path, said: Mapping[str, Any]) -> CompanionFile:
    joints, types = (_texts_of(said, key) for key in ("joint_name", "joint_type"))
    if len(joints) != len(types) or len(set(joints)) != len(joints):
        raise InvalidModel(
            f"joint_name has {len(joints)} names, {len(set(joints))} of them different, and "
            f"joint_type has {len(types)}: as many are needed"
        )
    for kind in types:
        if kind.upper() not in JOINT_TYPES:
            raise InvalidModel(f"joint_type: {unknown_name('joint type', kind, JOINT_TYPES)}")
    return CompanionFile(
        path=path,
        loops=tuple(_loops(said)) if "closed_loop" in said else None,
        motors=_texts_of(said, "name_mot"),
        joints={name: kind.upper() for name, kind in zip(joints, types, strict=True)},
        unread=tuple(str(key) for key in said if key not in _KEYS),
    )


def _loops(said: Mapping[str, Any]) -> list[Loop]:
    pairs = said["closed_loop"]
    if not isinstance(pairs, list) or not all(
        isinstance(pair, list) and len(pair) == 2 and all(isinstance(end, str) for end in pair)
        for pair in pairs
    ):
        raise InvalidModel(f"closed_loop = {shortened(pairs)}: a list of pairs of frames is needed")
    kinds = _texts_of(said, "type") if "type" in said else ("6D",) * len(pairs)
    if len(kinds) == 1:  # one for all
        kinds *= len(pairs)
    if len(kinds) != len(pairs):
        raise InvalidModel(f"closed_loop has {len(pairs)} pairs and type {len(kinds)}: as many")
    loops: list[Loop] = []
    for (first, second), kind in zip(pairs, kinds, strict=True):
        name = stem(first) if stem(first) == stem(second) else ""
        taken = name in {loop.name for loop in loops}
        named: dict[str, Any] = {"name": name} if name and not taken else {}
        with place("type"):
            loops.append(Loop(first, second, **_kind(kind), **named))
    return loops


def _kind(text: str) -> dict[str, Any]:
    """Kind, axis and length of a loop, from the text of its type."""
    word, *more = text.split() or [""]
    kind = _KINDS.get(word.upper(), word.lower())
    if kind not in get_args(LoopKind):
        raise InvalidModel(str(unknown_name("type of loop", text, _TYPES)))
    said: dict[str, Any] = {"kind": kind}
    if axis_of(kind) and len(more) == 1:
        return said | {"axis": more[0].lower()}
    if kind == "rod" and len(more) == 1:
        try:
            return said | {"length": float(more[0])}
        except ValueError:
            more = []
    if kind in _KINDS.values() and not more:
        return said
    wanted = {"rod": "a length [m] is needed, as in rod 0.3", "ball": "it stands alone"}
    example = "universal xy" if kind == "universal" else f"{kind} y"
    said_of = wanted.get("ball" if kind == "weld" else kind, f"an axis is needed, as in {example}")
    raise InvalidModel(f"{text!r}: {said_of}")


def _texts_of(said: Mapping[str, Any], key: str) -> tuple[str, ...]:
    words = said.get(key, [])
    words = [words] if isinstance(words, str) else words
    if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
        raise InvalidModel(f"{key} = {shortened(words)}: a list of texts is needed")
    return tuple(words)
