"""What an SDF file has and the model does not use, a sentence each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import inf
from typing import Any

from condyn_pin.io.sdf_types import Description, Joint
from condyn_pin.names import quoted


def unused_parts(
    sdf: Description,
    kinds: Mapping[str, str],
    drop: Sequence[str],
    root_pose: Any | None,
    idle: Sequence[str],
) -> Iterator[str]:
    """Say which parts of the file are not in the model."""
    if sdf.unread:
        counted = ", ".join(f"{n} <{tag}>" for tag, n in sorted(sdf.unread.items()))
        yield f"elements that are not read: {counted}"
    if drop:
        yield f"joints left out: {quoted(drop)}"
    changed = [
        f"{joint.name!r} ({joint.kind} as {kinds[joint.name]})"
        for joint in sdf.joints
        if joint.name not in drop and kinds.get(joint.name, joint.kind) != joint.kind
    ]
    if changed:
        yield f"joint types of the file: {', '.join(changed)}"
    if idle:
        yield f"joints between links that cannot move against each other: {quoted(idle)}"
    if root_pose is not None and not root_pose.isIdentity():
        yield "pose of the root link in the file: the root joint's configuration replaces it"


def unused_settings(joints: Iterable[Joint], cut: Sequence[Joint]) -> Iterator[str]:
    """Say which settings of the joints that are kept are not in the model."""
    lost: dict[str, list[str]] = {"friction": [], "damping": [], "spring": [], "limits": []}
    second = [
        joint.name
        for joint in joints
        if joint.axis2.direction is not None and joint.kind != "gearbox"
    ]
    if second:
        yield f"second axis: {quoted(second)}"
    for joint in joints:
        hanging = joint not in cut
        uses_axis = hanging and joint.has_axis
        axis = joint.axis
        limited = axis.lower > -inf or axis.upper < inf
        is_lost = {
            "friction": axis.friction != 0,
            "damping": axis.damping != 0 and (not hanging or joint.kind == "fixed"),
            "spring": axis.stiffness != 0 and not uses_axis,
            "limits": limited and (not uses_axis or joint.kind == "continuous"),
        }
        for setting, names in lost.items():
            if is_lost[setting]:
                names.append(joint.name)
    for setting, names in lost.items():
        if names:
            yield f"joint {setting}: {quoted(names)}"
