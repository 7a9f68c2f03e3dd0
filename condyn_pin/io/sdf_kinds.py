"""The types of joints: what the tree cannot have becomes joints and links that it can.

universal, revolute2 are two hinges in series with a link without mass between them,

    parent --name_axis--> cross --name_axis2--> child,       R = R(axis, q1) R(axis2, q2)

whose axes never become parallel, so that both hinges always move the inertia behind the joint.

gearbox is no joint of the tree, but a proportion between two hinges. It names a reference link.
With theta_1 the angle from there to its parent about `axis`, and theta_2 the one to its child about
`axis2`, both zero as drawn, the format asks for

    theta_2 = -ratio theta_1

where theta = q if the hinge between the reference link and the other has the same direction and the
reference link is its parent; each of the two that is the other way round changes the sign.

A joint with <mimic> is a proportion too, with an offset; its two joints stay as they are.

`with_copies` opens loops as Pinocchio's C++ parser does: every joint in the tree, on a copy of its
child. A link with n parent joints is drawn n times, with m/n and I/n each. The first joint of the
file carries the link itself, every other one a copy that is welded to it by 6 rows: a joint that
closes a loop keeps its coordinate, at the price of as many freedoms and rows more.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.names import quoted
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.loop import Loop
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.sdf_types import NO_AXIS, Axis, Gear, Joint, Link, SdfModel

# The degrees of freedom that each type leaves, as far as the tree is concerned.
FREEDOM: Final[Mapping[str, int]] = {
    "fixed": 0, "revolute": 1, "continuous": 1, "prismatic": 1, "screw": 1, "ball": 3,
}  # fmt: skip
_SERIES: Final = ("universal", "revolute2")
KINDS: Final = (*FREEDOM, *_SERIES, "gearbox")
_NEEDED: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("revolute", "continuous", "prismatic", "screw"), ("axis",)),
    "universal": ("axis", "axis2"), "revolute2": ("axis", "axis2"), "gearbox": ("axis", "axis2"),
}  # fmt: skip


def chosen_joints(
    sdf: SdfModel, kinds: Mapping[str, str], drop: Sequence[str]
) -> tuple[Joint, ...]:
    """Return the joints that are kept, each with its type."""
    names = [joint.name for joint in sdf.joints]
    for name in (*kinds, *drop):
        if name not in names:
            raise unknown_name("joint", name, names)
    for kind in kinds.values():
        if kind not in KINDS:
            raise unknown_name("joint type", kind, KINDS)
    joints = tuple(
        replace(joint, kind=kinds.get(joint.name, joint.kind))
        for joint in sdf.joints
        if joint.name not in drop
    )
    for joint in joints:
        _check(joint)
    return joints


def _check(joint: Joint) -> None:
    """Refuse a joint of an unknown type, or without what its type needs."""
    if joint.kind not in KINDS:
        raise InvalidModel(
            f"joint {joint.name!r} has the type {joint.kind!r}, which is not supported: read "
            f"it as {', '.join(KINDS[:-1])} or {KINDS[-1]} with kinds={{{joint.name!r}: ...}}, "
            f"or leave it out with drop=[{joint.name!r}]"
        )
    for tag in _NEEDED.get(joint.kind, ()):
        if getattr(joint, tag).direction is None:
            raise InvalidModel(
                f"joint {joint.name!r} is {joint.kind} and has no <{tag}/xyz>; give it one"
            )
    if joint.kind == "gearbox" and joint.gear is None:
        raise InvalidModel(
            f"joint {joint.name!r} is a gearbox and has no <gearbox_reference_body>; name the link "
            "from which both of its angles are measured"
        )
    if joint.kind == "screw" and joint.pitch == 0:
        raise InvalidModel(
            f"joint {joint.name!r} is a screw and has no <screw_thread_pitch> [m per turn]; write "
            "one other than zero"
        )
    if joint.kind in _SERIES:
        a, b = np.asarray(joint.axis.direction), np.asarray(joint.axis2.direction)
        sine = np.linalg.norm(np.cross(a, b))
        if sine < tolerances.PARALLEL:
            raise InvalidModel(
                f"joint {joint.name!r} is {joint.kind} and its <axis> and <axis2> are parallel, "
                "which is one freedom twice; write it as revolute"
            )


def in_series(
    links: Sequence[Link], joints: Sequence[Joint]
) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Return links and joints with each universal joint as two hinges and a cross."""
    taken = {link.name for link in links} | {joint.name for joint in joints}
    crosses: list[Link] = []
    hinges: list[Joint] = []
    for joint in joints:
        if joint.kind not in _SERIES:
            hinges.append(joint)
            continue
        first, cross, second = (f"{joint.name}_{part}" for part in ("axis", "cross", "axis2"))
        for name in (first, cross, second):
            if name in taken:
                raise InvalidModel(
                    f"joint {joint.name!r} is {joint.kind} and needs the name {name!r}, which is "
                    "taken; rename one of them"
                )
        crosses.append(Link(cross, joint.pose, None, massless=True))
        hinge = replace(joint, kind="revolute", axis2=NO_AXIS)
        hinges.append(replace(hinge, name=first, child=cross))
        hinges.append(replace(hinge, name=second, parent=cross, axis=joint.axis2))
    return (*links, *crosses), tuple(hinges)


def mimics_of(joints: Sequence[Joint]) -> tuple[Coupling, ...]:
    """Return the couplings q = multiplier (q_leader - reference) + offset of joints that mimic."""
    led = {joint.name: joint.axis.mimic for joint in joints if joint.axis.mimic is not None}
    scalar = [joint.name for joint in joints if joint.has_axis]
    couplings = []
    for name, mimic in led.items():
        leader = mimic.leader if mimic.axis == "axis" else ""
        if leader not in scalar:
            leader = f"{mimic.leader}_{mimic.axis}"  # of a universal joint
        for role, who in (("it", name), (f"{mimic.leader!r} by its {mimic.axis!r}", leader)):
            if who not in scalar:
                raise InvalidModel(
                    f"joint {name!r} mimics {mimic.leader!r}, and {role} is no hinge, slider or "
                    "screw of the model; take <mimic> out, or leave the joint out with drop"
                )
        couplings.append(Coupling(name, leader, mimic.ratio, mimic.offset))
    leaders = {c.joints[0]: c.joints[1] for c in couplings}
    for start in leaders:
        way = [start]
        while (after := leaders.get(way[-1], "")) and after not in way:
            way.append(after)
        if after == start:
            raise InvalidModel(
                f"the joints {quoted(way)} mimic each other in a circle; let one of them lead"
            )
    return tuple(couplings)


def coupling_of(gearbox: Joint, joints: Sequence[Joint]) -> Coupling:
    """Return the coupling q_a = ratio q_b of a gearbox; a is the hinge of its child."""
    gear = gearbox.gear
    assert gear is not None  # chosen_joints has looked
    hinge_1, sign_1 = _hinge(gearbox, gear, gearbox.parent, gearbox.axis, joints)
    hinge_2, sign_2 = _hinge(gearbox, gear, gearbox.child, gearbox.axis2, joints)
    ratio = -gear.ratio * sign_1 * sign_2
    return Coupling(hinge_2.name, hinge_1.name, ratio, name=gearbox.name)


def _hinge(
    gearbox: Joint, gear: Gear, link: str, axis: Axis, joints: Sequence[Joint]
) -> tuple[Joint, float]:
    """Return the hinge between the reference link and another, and the sign of theta / q."""
    for hinge in joints:
        if hinge.kind not in ("revolute", "continuous"):
            continue
        if {hinge.parent, hinge.child} != {gear.reference, link}:
            continue
        turns = 1.0 if hinge.child == link else -1.0
        a = gearbox.pose.rotation @ np.asarray(axis.direction)
        b = hinge.pose.rotation @ np.asarray(hinge.axis.direction)
        if np.linalg.norm(np.cross(a, b)) > tolerances.PARALLEL:
            raise InvalidModel(
                f"joint {gearbox.name!r} is a gearbox, and its axis for {link!r} is not that of "
                f"the hinge {hinge.name!r}: make them parallel"
            )
        return hinge, float(turns * np.sign(a @ b))
    raise InvalidModel(
        f"joint {gearbox.name!r} is a gearbox, and no revolute joint connects {link!r} to its "
        f"reference body {gear.reference!r}: add one, or read the gearbox as another type with "
        f"kinds={{{gearbox.name!r}: ...}}"
    )


def with_copies(
    links: Sequence[Link], joints: Sequence[Joint]
) -> tuple[tuple[Link, ...], tuple[Joint, ...], tuple[Loop, ...]]:
    """Return links and joints without loops, and the welds that close them again."""
    parents = Counter(joint.child for joint in joints)
    shared = {link.name: _share(link, parents[link.name]) for link in links}
    copies: list[Link] = []
    hanging: list[Joint] = []
    welds: list[Loop] = []
    carried: set[str] = set()
    for joint in joints:
        if joint.child in carried:
            name = f"{joint.child}_{joint.name}"
            if name in shared or any(name == other.name for other in joints):
                raise InvalidModel(
                    f"joint {joint.name!r}: the copy of {joint.child!r} needs the name {name!r}, "
                    "which is taken; rename one of them"
                )
            copies.append(replace(shared[joint.child], name=name))
            welds.append(Loop(name, joint.child, "weld", name=joint.name))
            joint = replace(joint, child=name)
        carried.add(joint.child)
        hanging.append(joint)
    return (*shared.values(), *copies), tuple(hanging), tuple(welds)


def _share(link: Link, n: int) -> Link:
    """Return a link with one n-th of its inertia."""
    if link.inertia is None or n < 2:
        return link
    Y = link.inertia
    return replace(link, inertia=pin.Inertia(Y.mass / n, Y.lever, Y.inertia / n))
