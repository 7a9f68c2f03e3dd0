"""The joints of an SDF file: their axes, limits, springs and gears, read into `Joint`.

With oMx the pose of a part x in the model frame o, the axis a of a joint j is, however the file
writes it,

    a in the joint's axes:  oRjᵀ · oRx · a           x = `expressed_in`, else the joint itself
"""

from __future__ import annotations

from collections.abc import Mapping
from math import copysign, inf
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.sdf_graph import MODEL, pose_of
from condyn_pin.io.sdf_types import WORLD, Axis, Gear, Joint
from condyn_pin.io.sdf_xml import number, word
from condyn_pin.io.xml import UNLIMITED, find, floats, label


def joint_of(
    element: Element, name: str, poses: Mapping[str, Any], link_of: Mapping[str, str]
) -> Joint:
    """Return the joint that an element describes."""
    parent, child = (_link(element, end, link_of) for end in ("parent", "child"))
    if child in (WORLD, parent):
        raise InvalidModel(f"{label(element)}: joins {parent!r} to {child!r}; name another child")
    geared = find(element, "gearbox_reference_body") is not None
    return Joint(
        name=name,
        kind=element.get("type", ""),
        parent=parent,
        child=child,
        pose=poses[name],
        axis=_axis(element, "axis", name, poses),
        axis2=_axis(element, "axis2", name, poses),
        gear=_gear(element, link_of) if geared else None,
    )


def _link(element: Element, tag: str, link_of: Mapping[str, str]) -> str:
    name = word(element, tag)
    if name not in link_of:
        raise InvalidModel(f"{label(element)}: <{tag}>: {unknown_name('link', name, link_of)}")
    return link_of[name]


def _gear(element: Element, link_of: Mapping[str, str]) -> Gear:
    ratio = number(element, "gearbox_ratio", 1.0)
    if ratio == 0:
        raise InvalidModel(
            f"{label(element)}: <gearbox_ratio> is 0, which holds the child still; "
            "write the ratio, or make its hinge fixed"
        )
    return Gear(ratio, _link(element, "gearbox_reference_body", link_of))


def _axis(element: Element, tag: str, name: str, poses: Mapping[str, Any]) -> Axis:
    axis = Axis(
        direction=_direction(element, tag, name, poses),
        lower=_limit(element, f"{tag}/limit/lower", -inf),
        upper=_limit(element, f"{tag}/limit/upper", inf),
        effort=_bound(element, f"{tag}/limit/effort"),
        velocity=_bound(element, f"{tag}/limit/velocity"),
        damping=number(element, f"{tag}/dynamics/damping", 0.0),
        friction=number(element, f"{tag}/dynamics/friction", 0.0),
        stiffness=number(element, f"{tag}/dynamics/spring_stiffness", 0.0),
        reference=number(element, f"{tag}/dynamics/spring_reference", 0.0),
    )
    if axis.lower > axis.upper:
        raise InvalidModel(
            f"{label(element)}: <{tag}/limit>: {axis.lower:g} to {axis.upper:g}; exchange them"
        )
    return axis


def _direction(
    element: Element, tag: str, name: str, poses: Mapping[str, Any]
) -> NDArray[np.float64] | None:
    xyz = find(element, f"{tag}/xyz")
    if xyz is None:
        return None
    axis = floats(xyz.text, 3, f"{label(element)}: <{tag}/xyz>")
    if not axis.any():
        raise InvalidModel(f"{label(element)}: <{tag}/xyz> is zero; give it a direction")
    flag = find(element, f"{tag}/use_parent_model_frame")
    in_model = "0" if flag is None else (flag.text or "").strip()
    if in_model not in ("0", "1", "false", "true"):
        raise InvalidModel(
            f"{label(element)}: <{tag}/use_parent_model_frame> is {in_model!r}; write 0 or 1"
        )
    frame = xyz.get("expressed_in") or (MODEL if in_model in ("1", "true") else name)
    if frame != name:
        oRx = pose_of(frame, poses, element).rotation
        axis = poses[name].rotation.T @ (oRx @ axis)
    axis = axis / np.abs(axis).max()  # first, so that the squares cannot overflow or vanish
    return np.asarray(axis / np.linalg.norm(axis))


def _limit(element: Element, path: str, unlimited: float) -> float:
    value = number(element, path, unlimited, infinite=True)
    return copysign(inf, value) if abs(value) >= UNLIMITED else value


def _bound(element: Element, path: str) -> float:
    value = _limit(element, path, inf)
    return inf if value < 0 else value  # the format's way to say that it is not enforced
