"""The types of joints: which the reader knows, and a universal joint as two hinges in series.

    universal, revolute2:  parent --name_axis--> cross --name_axis2--> child,
                           R = R(axis, q1) R(axis2, q2)

The cross is a link without mass. The two axes never become parallel, so both hinges always move
the inertia behind the joint, and M stays regular.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.sdf_types import NO_AXIS, Description, Joint, Link

# The degrees of freedom that each type leaves, as far as the tree is concerned.
FREEDOM: Final[Mapping[str, int]] = {
    "fixed": 0, "revolute": 1, "continuous": 1, "prismatic": 1, "ball": 3,
}  # fmt: skip
_SERIES: Final = ("universal", "revolute2")
KINDS: Final = (*FREEDOM, *_SERIES, "gearbox")
_NEEDED: Final[Mapping[str, tuple[str, ...]]] = {
    "revolute": ("axis",), "continuous": ("axis",), "prismatic": ("axis",),
    "universal": ("axis", "axis2"), "revolute2": ("axis", "axis2"), "gearbox": ("axis", "axis2"),
}  # fmt: skip


def chosen_joints(
    sdf: Description, kinds: Mapping[str, str], drop: Sequence[str]
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
