"""The model of an SDF file: its links, joints and frames placed, and its unread content.

`sdf_parts` has where each part is drawn. The axis a of a joint j is, however the file writes it,

    a in the joint's axes:  oRjᵀ · oRx · a           x = `expressed_in`, else the joint itself
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import copysign, inf, pi
from os import PathLike
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import quoted_names
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.description import tensor
from condyn_pin.io.sdf_parts import (
    MODEL,
    WORLD,
    ModelInWorld,
    SdfFiles,
    SdfPart,
    flag,
    is_model,
    links_of,
    model_poses,
    parts_of,
    pose_of,
    short_names,
    truth,
)
from condyn_pin.io.xml import UNLIMITED, ElementSchema, Schema, check_counts, label


@dataclass(frozen=True, eq=False)
class Link:
    """A link of the file, or the cross of a universal joint, which has no mass of its own."""

    name: str
    pose: Any  # oMlink
    inertia: Any | None  # in the link's frame; None for a cross
    massless: bool = False
    weighs: bool = True


@dataclass(frozen=True)
class Mimic:
    """Mimic relation of a joint axis: q = ratio q_leader + offset."""

    leader: str
    axis: str  # axis or axis2
    ratio: float
    offset: float  # [rad or m]


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis of a joint; numbers that the file leaves out are infinite or zero."""

    direction: Array | None = None  # unit vector in the joint's axes
    lower: float = -inf  # [rad or m]
    upper: float = inf
    effort: float = inf  # [N m or N]
    velocity: float = inf  # [rad/s or m/s]
    damping: float = 0.0  # [N m s/rad or N s/m]
    friction: float = 0.0  # [N m or N]
    stiffness: float = 0.0  # of its spring [N m/rad or N/m]
    reference: float = 0.0  # where the spring rests [rad or m]
    mimic: Mimic | None = None


NO_AXIS: Final = Axis()


@dataclass(frozen=True)
class Gear:
    """Gear relation theta_child = -ratio theta_parent, both relative to the reference link."""

    ratio: float
    reference: str


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of the file between two links, its type as the file writes it."""

    name: str
    kind: str
    parent: str
    child: str
    pose: Any  # oMj
    axis: Axis
    axis2: Axis  # of a universal joint or a gearbox
    gear: Gear | None  # of a gearbox
    pitch: float = 0.0  # of a screw, right-handed [m/rad]

    @property
    def has_axis(self) -> bool:
        """True for a hinge, a slider or a screw: one coordinate, about or along the axis."""
        return self.kind in ("revolute", "continuous", "prismatic", "screw")

    def reversed(self) -> Joint:
        """Return the joint with parent and child exchanged, and the axis opposite."""
        # R(-a, q) = R(a, q)⁻¹: a hinge, slider or screw about the opposite axis keeps its
        # coordinate q, and with it limits, spring and damping. The quaternion of a ball becomes its
        # inverse.
        axis = self.axis
        if axis.direction is not None:
            axis = replace(axis, direction=-axis.direction)
        return replace(self, parent=self.child, child=self.parent, axis=axis)


@dataclass(frozen=True)
class SdfModel:
    """The model of a file, its links and joints in the order of the file."""

    name: str
    pose: Any  # wMo, the model frame in the world
    canonical: tuple[str, ...]  # the link with which the frame of each model moves
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    frames: Mapping[str, tuple[str, Any]]  # the link that carries each, and its pose in the model
    gravity: Array | None  # [m/s^2]
    defaults: Mapping[str, Sequence[str]]  # inertias that the file leaves out, with their links
    unread: tuple[str, ...]  # sentences
    unmodelled: tuple[str, ...]  # sentences
    lost_rows: tuple[str, ...]  # sentences among them
    exclusions: frozenset[frozenset[str]]  # links that do not touch each other


# What changes the motion and is not modelled, unless it is zero or false: by the element that has
# it, and in the words of what is said of it.
_CHANGES: Final[Mapping[str, Mapping[str, str]]] = {
    "world": {"wind/linear_velocity": "wind", "joint": "joints of the world"},
    "model": {
        "enable_wind": "wind on the model",
        "{*}joint": "Drake's joints",
        "{*}ball_constraint": "Drake's ball constraints",
        "{*}tendon_constraint": "Drake's tendons",
        "{*}linear_bushing_rpy": "Drake's bushings",
        "{*}linear_spring_damper": "Drake's springs and dampers between points",
    },
    "link": {
        "enable_wind": "wind on the links",
        "kinematic": "links that others move, <kinematic>",
        "must_be_base_link": "links that float, <must_be_base_link>",
        "velocity_decay/linear": "decay of the velocity of the links",
        "velocity_decay/angular": "decay of the turning of the links",
        "inertial/fluid_added_mass/*": "added mass of the fluid around the links",
    },
    "joint": {
        "physics/ode/max_force": "motors in <physics> of the joints",
        "physics/ode/cfm": "softness of the joints, <cfm>",
        "physics/ode/suspension/cfm": "suspension of the joints",
        "{*}rotor_inertia": "Drake's rotors behind the joints",
        "{*}mimic": "Drake's mimic joints",
    },
}
# Those of them that close the robot, which without them is another mechanism.
_CLOSURES: Final = (
    "joints of the world", "Drake's joints", "Drake's ball constraints", "Drake's mimic joints",
)  # fmt: skip
_AXIS: Final = ElementSchema("*", one="xyz limit dynamics use_parent_model_frame mimic")
_NUMBER: Final = ElementSchema(text=1)
_MOMENTS: Final = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_TAGS: Final[Mapping[str, ElementSchema]] = {
    "link": ElementSchema(
        "*",
        one="pose inertial gravity enable_wind kinematic must_be_base_link velocity_decay "
        "self_collide",
    ),
    "inertial": ElementSchema("*", one="pose mass inertia fluid_added_mass"),
    "inertia": ElementSchema(one=" ".join(_MOMENTS)),
    "joint": ElementSchema(
        "*",
        one="pose parent child axis axis2 gearbox_ratio gearbox_reference_body thread_pitch "
        "screw_thread_pitch physics {*}rotor_inertia {*}mimic",
    ),
    "axis": _AXIS,
    "axis2": _AXIS,
    "xyz": ElementSchema("*", text=3),
    "limit": ElementSchema(one="lower upper effort velocity"),
    "dynamics": ElementSchema(one="damping friction spring_stiffness spring_reference"),
    "mimic": ElementSchema("*", one="multiplier offset reference"),
    "frame": ElementSchema("*", one="pose"),
    **dict.fromkeys(("mass", "gearbox_ratio", "thread_pitch", "screw_thread_pitch"), _NUMBER),
    **dict.fromkeys((*_MOMENTS, "multiplier", "offset", "reference"), _NUMBER),
    **dict.fromkeys(("lower", "upper", "effort", "velocity"), ElementSchema(text=1, infinite=True)),
    **dict.fromkeys(("damping", "friction", "spring_stiffness", "spring_reference"), _NUMBER),
}
_OF_MODEL: Final = (
    "pose", "link", "joint", "frame", "model", "include", "static", "plugin", "self_collide",
)  # fmt: skip
_OF_WORLD: Final = ("world", "model", "include", "gravity", "plugin", "physics")
_DRIVES: Final = re.compile(  # in the name or the file of a plugin
    "actuat|attach|buoyan|control|conveyor|damp|drag|drive|force(?!.?torque)|friction|gear|grasp|"
    "grip|hydro|lift|mimic|motor|mover|propel|servo|spring|steer|suction|thrust|vacuum|velocity|"
    "wind|wrench"
)


def parse(path: str | PathLike[str], name: str | Sequence[str] | None) -> SdfModel:
    """Return the only moving model of a file, the one of a name, or those of several as one."""
    files = SdfFiles(Path(path))
    chosen = files.chosen(name)
    top = chosen.model
    parts, schema = parts_of(top, files), Schema(_TAGS)
    parts = {
        each: part if is_model(part) else part._replace(element=schema.checked(part.element))
        for each, part in parts.items()
    }
    tagged: dict[str, dict[str, SdfPart]] = {"link": {}, "joint": {}}
    for each, part in parts.items():
        tagged.setdefault(part.element.tag, {})[each] = part
    joints = [part for part in tagged["joint"].values() if part.element.get("type") != "fixed"]
    check_counts(len(tagged["link"]), len(joints))
    poses, link_of = model_poses(parts, top), links_of(parts, top)
    short = short_names(parts, chosen.models)
    defaults: dict[str, list[str]] = defaultdict(list)
    links = [_link(part, each, poses, defaults) for each, part in tagged["link"].items()]
    unmodelled = {
        what: f"{what}: {quoted_names(short.get(name, name) for name in dict.fromkeys(names))}"
        for what, names in _unmodelled(chosen, parts).items()
    }
    return SdfModel(
        name=top.name,
        pose=poses[WORLD].inverse(),
        canonical=tuple(short[link_of[each]] for each in chosen.models or (MODEL,)),
        links=tuple(replace(link, name=short[link.name]) for link in links),
        joints=tuple(
            _shortened(_joint(part, each, poses, link_of), short | {WORLD: WORLD})
            for each, part in tagged["joint"].items()
        ),
        frames={
            short[each]: (short[link_of[each]], poses[each])
            for each, part in parts.items()
            if part.element.tag == "frame" or is_model(part)
        },
        gravity=chosen.gravity,
        defaults={value: [short[each] for each in names] for value, names in defaults.items()},
        unread=(*chosen.unused, *_unread_elements(chosen, parts, schema)),
        unmodelled=tuple(unmodelled.values()),
        lost_rows=tuple(text for what, text in unmodelled.items() if what in _CLOSURES),
        exclusions=frozenset(
            frozenset(short[each] for each in names) for names in _exclusions(tagged["link"])
        ),
    )


def _shortened(joint: Joint, short: Mapping[str, str]) -> Joint:
    """Joint with the short names of itself, of its links, and of what it follows."""
    axes = [
        axis if axis.mimic is None else replace(axis, mimic=replace(
            axis.mimic, leader=short.get(axis.mimic.leader, axis.mimic.leader)
        ))
        for axis in (joint.axis, joint.axis2)
    ]  # fmt: skip
    gear = joint.gear and replace(joint.gear, reference=short[joint.gear.reference])
    name, parent, child = (short[each] for each in (joint.name, joint.parent, joint.child))
    joint = replace(joint, name=name, parent=parent, child=child)
    return replace(joint, axis=axes[0], axis2=axes[1], gear=gear)


def _roots(chosen: ModelInWorld, parts: Mapping[str, SdfPart]) -> list[Element]:
    """Elements of the model and the models in it, each once."""
    inner = [part.model.model for part in parts.values() if is_model(part)]
    return list({id(model): model for model in (chosen.model.model, *inner)}.values())


def _unread_elements(
    chosen: ModelInWorld, parts: Mapping[str, SdfPart], schema: Schema
) -> Iterator[str]:
    """Elements of the world and the models that are not read, and idle plugins, as sentences."""
    schema.count(chosen.world, (*_OF_WORLD, *_changing("world")))
    for root in _roots(chosen, parts):
        schema.count(root, (*_OF_MODEL, *_changing("model")))
    yield from schema.not_read()
    if idle := [_plugin_name(p) for p in _plugins(chosen, parts) if not _drives(p)]:
        yield f"plugins: {quoted_names(idle)}"


def _changing(tag: str) -> Iterable[str]:
    """Tags of the child elements that `_CHANGES` covers."""
    return (path.partition("/")[0] for path in _CHANGES.get(tag, ()))


def _unmodelled(chosen: ModelInWorld, parts: Mapping[str, SdfPart]) -> dict[str, list[str]]:
    """Parts that change the motion and are not modelled, with their places."""
    places = [(chosen.world.get("name", ""), chosen.world), (chosen.model.name, chosen.model.model)]
    places += [(name, part.model.model if is_model(part) else part.element)
               for name, part in parts.items()]  # fmt: skip
    found: dict[str, list[str]] = defaultdict(list)
    for name, element in places:
        for path, what in _CHANGES.get(element.tag, {}).items():
            spaced = path.startswith("{*}")  # which matches no namespace, too
            if any(
                _has_effect(e) for e in element.findall(path) if e.tag.startswith("{") or not spaced
            ):
                found[what].append(name)
    if driving := [_plugin_name(p) for p in _plugins(chosen, parts) if _drives(p)]:
        found["plugins that may drive it or push"] = driving
    return found


def _exclusions(links: Mapping[str, SdfPart]) -> frozenset[frozenset[str]]:
    """Links of each model that must not touch each other: <self_collide> is false, if written."""
    of_model: dict[str, str] = {}
    apart: dict[str, set[str]] = defaultdict(set)
    for name, part in links.items():
        if part.home not in of_model:
            of_model[part.home] = str(flag(part.model.model, "self_collide", "true"))
        if not flag(part.element, "self_collide", of_model[part.home]):
            apart[part.home].add(name)
    return frozenset(frozenset(names) for names in apart.values() if len(names) > 1)


def _has_effect(element: Element) -> bool:
    """True if an element has a value other than zero and false."""
    return len(element) > 0 or any(
        word.lower() != "false" and word.strip("+-0.") != ""
        for word in (element.text or "").split()
    )


def _plugins(chosen: ModelInWorld, parts: Mapping[str, SdfPart]) -> list[Element]:
    owners = [chosen.world, chosen.model.model, chosen.model.owner]
    owners += [e for p in parts.values() if is_model(p) for e in (p.element, p.model.model)]
    plugins = [plugin for owner in owners for plugin in owner.findall("plugin")]
    return list({id(plugin): plugin for plugin in plugins}.values())


def _plugin_name(plugin: Element) -> str:
    return plugin.get("name", "") or plugin.get("filename", "")


def _drives(plugin: Element) -> bool:
    """True if the name or the file of a plugin hints that it drives or pushes the robot."""
    said = f"{plugin.get('name', '')} {plugin.get('filename', '')}".lower()
    return _DRIVES.search(said) is not None


def _link(
    part: SdfPart, name: str, poses: Mapping[str, Any], defaults: Mapping[str, list[str]]
) -> Link:
    """Link with its inertia in its own frame; missing values have the defaults of the format."""
    element = part.element
    weighs = flag(element, "gravity", "true")
    inertial = element.find("inertial")
    if inertial is not None and truth(inertial.get("auto", "false"), f"{label(element)}: auto"):
        raise InvalidModel(f"{label(element)}: <inertial auto>; write its mass and inertia out")
    for path, value in (("mass", "1 kg"), ("inertia", "1 kg m^2 about each axis")):
        if element.find(f"inertial/{path}") is None:
            defaults[value].append(name)
    mass = _number(element, "inertial/mass", 1.0)
    moments = (_number(element, f"inertial/inertia/i{ab}", 1.0) for ab in ("xx", "yy", "zz"))
    products = (_number(element, f"inertial/inertia/i{ab}", 0.0) for ab in ("xy", "xz", "yz"))
    inertia = tensor(*moments, *products)
    smallest, _, largest = np.linalg.eigvalsh(inertia)
    if smallest < -tolerances.MOMENT * abs(largest):
        raise InvalidModel(
            f"{label(element)}: <inertia> has the principal moment {smallest:g}; none may be < 0"
        )
    linkMc, base = part.pose("inertial/pose")
    if base not in ("", name):
        linkMc = poses[name].actInv(pose_of(base, poses, element) * linkMc)
    R = linkMc.rotation
    Y = pin.Inertia(mass, linkMc.translation, np.eye(3))
    Y.inertia = R @ inertia @ R.T  # the constructor refuses a moment that is zero but for rounding
    return Link(name, poses[name], Y, weighs=weighs)


def _joint(part: SdfPart, name: str, poses: Mapping[str, Any], link_of: Mapping[str, str]) -> Joint:
    """Return the joint that an element describes."""
    element = part.element
    parent, child = (_joint_end(part, end, link_of) for end in ("parent", "child"))
    if child in (WORLD, parent):
        raise InvalidModel(f"{label(element)}: joins {parent!r} to {child!r}; name another child")
    geared = element.find("gearbox_reference_body") is not None
    return Joint(
        name=name,
        kind=element.get("type", ""),
        parent=parent,
        child=child,
        pose=poses[name],
        axis=_axis(part, "axis", name, poses),
        axis2=_axis(part, "axis2", name, poses),
        gear=_gear(part, link_of) if geared else None,
        pitch=_pitch(element),
    )


def _joint_end(part: SdfPart, tag: str, link_of: Mapping[str, str]) -> str:
    name = part.word(tag)
    if name not in link_of:
        known = unknown_name("link", name, link_of)
        raise InvalidModel(f"{label(part.element)}: <{tag}>: {known}")
    return link_of[name]


def _gear(part: SdfPart, link_of: Mapping[str, str]) -> Gear:
    ratio = _number(part.element, "gearbox_ratio", 1.0)
    if ratio == 0:
        raise InvalidModel(
            f"{label(part.element)}: <gearbox_ratio> is 0, which holds the child still; "
            "write the ratio, or make its hinge fixed"
        )
    return Gear(ratio, _joint_end(part, "gearbox_reference_body", link_of))


def _pitch(joint: Element) -> float:
    """Pitch of a screw [m/rad], right-handed; 0 if the file has none."""
    turns = _number(joint, "screw_thread_pitch", 0.0) / (2 * pi)  # metres in a turn
    old = _number(joint, "thread_pitch", 0.0)  # radians in a metre, left-handed
    return turns if turns or not old else -1 / old


def _axis(part: SdfPart, tag: str, name: str, poses: Mapping[str, Any]) -> Axis:
    element = part.element
    axis = Axis(
        direction=_direction(part, tag, name, poses),
        lower=_limit(element, f"{tag}/limit/lower", -inf),
        upper=_limit(element, f"{tag}/limit/upper", inf),
        effort=_bound(element, f"{tag}/limit/effort"),
        velocity=_bound(element, f"{tag}/limit/velocity"),
        damping=_number(element, f"{tag}/dynamics/damping", 0.0),
        friction=_number(element, f"{tag}/dynamics/friction", 0.0),
        stiffness=_number(element, f"{tag}/dynamics/spring_stiffness", 0.0),
        reference=_number(element, f"{tag}/dynamics/spring_reference", 0.0),
        mimic=_mimic(part, f"{tag}/mimic"),
    )
    if axis.lower > axis.upper:
        raise InvalidModel(
            f"{label(element)}: <{tag}/limit>: {axis.lower:g} to {axis.upper:g}; exchange them"
        )
    if axis.friction < 0:
        raise InvalidModel(f"{label(element)}: <friction> is {axis.friction:g}; none may be < 0")
    return axis


def _mimic(part: SdfPart, path: str) -> Mimic | None:
    mimic = part.element.find(path)
    if mimic is None:
        return None
    leader, axis = part.named(mimic.get("joint", "")), mimic.get("axis", "axis")
    numbers = (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
    ratio, offset, zero = (_number(part.element, f"{path}/{key}", x) for key, x in numbers)
    if ratio == 0:
        raise InvalidModel(
            f"{label(part.element)}: <mimic> with the <multiplier> 0 holds it still; make it fixed"
        )
    return Mimic(leader, axis, ratio, offset - ratio * zero)


def _direction(part: SdfPart, tag: str, name: str, poses: Mapping[str, Any]) -> Array | None:
    element = part.element
    xyz = element.find(f"{tag}/xyz")
    if xyz is None:
        return None
    axis = np.array([float(x) for x in (xyz.text or "").split()])
    if not axis.any():
        raise InvalidModel(f"{label(element)}: <{tag}/xyz> is zero; give it a direction")
    in_model = "true" if part.model.version < (1, 5) else "false"
    frame = part.named(xyz.get("expressed_in", "")) or (
        part.home if flag(element, f"{tag}/use_parent_model_frame", in_model) else name
    )
    if frame != name:
        oRx = pose_of(frame, poses, element).rotation
        axis = poses[name].rotation.T @ (oRx @ axis)
    axis = axis / np.abs(axis).max()  # first, so that the squares cannot overflow or vanish
    return np.asarray(axis / np.linalg.norm(axis))


def _limit(element: Element, path: str, unlimited: float) -> float:
    value = _number(element, path, unlimited)
    return copysign(inf, value) if abs(value) >= UNLIMITED else value


def _bound(element: Element, path: str) -> float:
    value = _limit(element, path, inf)
    return inf if value < 0 else value  # the format's way to say that it is not enforced


def _number(element: Element, path: str, default: float) -> float:
    """Number at a path, checked before; the default if there is none."""
    found = element.findtext(path)
    return default if found is None else float(found)
