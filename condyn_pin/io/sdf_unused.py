"""What an SDF file has and the model does not use, a sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import inf
from typing import Any

from condyn_pin._core.names import quoted
from condyn_pin.io.sdf_types import Joint, SdfModel


def unused_parts(
    sdf: SdfModel,
    kinds: Mapping[str, str],
    drop: Sequence[str],
    root_pose: Any | None,
    idle: Sequence[str],
) -> Iterator[str]:
    """Say which parts of the file are not in the model."""
    yield from sdf.unread
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


def unused_settings(joints: Sequence[Joint], cut: Sequence[Joint]) -> Iterator[str]:
    """Say which settings of the joints that are kept are not in the model."""
    second = [
        joint.name
        for joint in joints
        if joint.axis2.direction is not None and joint.kind != "gearbox"
    ]
    if second:
        yield f"second axis: {quoted(second)}"
    lost = [(joint.name, tuple(_lost(joint, joint not in cut))) for joint in joints]
    for setting in ("friction", "damping", "spring", "limits"):
        names = [name for name, settings in lost if setting in settings]
        if names:
            yield f"joint {setting}: {quoted(names)}"


def _lost(joint: Joint, hanging: bool) -> Iterator[str]:
    """Yield the settings of a joint, hanging in the tree or cut, that are not in the model."""
    axis, uses_axis = joint.axis, hanging and joint.has_axis
    if axis.friction != 0:
        yield "friction"
    if axis.damping != 0 and (not hanging or joint.kind == "fixed"):
        yield "damping"
    if axis.stiffness != 0 and not uses_axis:
        yield "spring"
    limited = axis.lower > -inf or axis.upper < inf
    if limited and (not uses_axis or joint.kind == "continuous"):
        yield "limits"
