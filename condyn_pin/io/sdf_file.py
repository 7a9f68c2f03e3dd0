"""An SDF file: the one model in it, its links, joints and frames placed, and what nobody reads.

`sdf_graph` has where each part is drawn. The axis a of a joint j is, however the file writes it,

    a in the joint's axes:  oRjᵀ · oRx · a           x = `expressed_in`, else the joint itself
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from math import copysign, inf
from os import PathLike
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.description import tensor
from condyn_pin.io.sdf_graph import MODEL, links_of, model_poses, parts_of, pose_in, pose_of, word
from condyn_pin.io.sdf_types import WORLD, Axis, Gear, Joint, Link, SdfModel
from condyn_pin.io.xml import UNLIMITED, check_counts, find, floats, label, not_read, open_xml

# What is read below each element; everything else is counted and reported.
_READ: Final[Mapping[str, Container[str]]] = {
    "sdf": ("model", "world"),
    "world": ("model",),
    "model": ("pose", "link", "joint", "frame"),
    "link": ("pose", "inertial"),
    "inertial": ("pose", "mass", "inertia"),
    "inertia": ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"),
    "joint": (
        "pose", "parent", "child", "axis", "axis2", "gearbox_ratio", "gearbox_reference_body",
    ),
    "axis": ("xyz", "limit", "dynamics", "use_parent_model_frame"),
    "axis2": ("xyz", "limit", "dynamics", "use_parent_model_frame"),
    "limit": ("lower", "upper", "effort", "velocity"),
    "dynamics": ("damping", "friction", "spring_stiffness", "spring_reference"),
    "frame": ("pose",),
}  # fmt: skip


def parse(path: str | PathLike[str]) -> SdfModel:
    """Return what a file says."""
    sdf = open_xml(path, "sdf")
    model = _only_model(sdf)
    joints = [joint for joint in model.findall("joint") if joint.get("type") != "fixed"]
    check_counts(len(model.findall("link")), len(joints))
    parts = parts_of(model)
    wMo, base = pose_in(model)
    if base not in ("", WORLD):
        raise InvalidModel(f"{label(model)}: pose relative to {base!r}; place it in the world")
    link_of = links_of(parts, model.get("canonical_link"))
    poses = model_poses(parts, wMo.inverse())

    def tagged(tag: str) -> list[tuple[str, Element]]:
        return [(name, element) for name, element in parts.items() if element.tag == tag]

    return SdfModel(
        name=model.get("name", ""),
        pose=wMo,
        links=tuple(Link(n, poses[n], _inertia(e, n, poses)) for n, e in tagged("link")),
        joints=tuple(_joint(e, n, poses, link_of) for n, e in tagged("joint")),
        frames={n: (link_of[n], poses[n]) for n, _ in tagged("frame")},
        unread=tuple(not_read(sdf, _READ)),
    )


def _only_model(sdf: Element) -> Element:
    version = sdf.get("version", "")
    parts = version.split(".")
    # Before 1.5 an axis without a frame was meant in the axes of the model.
    if not all(part.isdecimal() for part in parts) or tuple(map(int, parts)) < (1, 5):
        raise InvalidModel(f"<sdf> has version {version!r}; 1.5 or later is needed")
    models = [*sdf.findall("model"), *sdf.findall("world/model")]
    if len(models) != 1:
        found = ", ".join(repr(m.get("name")) for m in models) or "no <model>"
        included = _includes([*sdf.findall("include"), *sdf.findall("world/include")])
        found += f", but{included}" if included else ""
        raise InvalidModel(f"the file has {found}; exactly one <model> is needed")
    if models[0].get("placement_frame"):
        raise InvalidModel("<model> has a placement_frame, which is not supported; write its pose")
    nested = models[0].find("model")
    if nested is not None:
        raise InvalidModel(
            f"{label(models[0])}: {label(nested)} in it is not followed; write its links and "
            "joints out in the model around it"
        )
    included = _includes(models[0].findall("include"))
    if included:
        raise InvalidModel(
            f"{label(models[0])} has{included}, which is not followed; write out what is included"
        )
    return models[0]


def _includes(elements: Sequence[Element]) -> str:
    """Return how errors list what a file includes."""
    uris = [repr((element.findtext("uri") or "").strip()) for element in elements]
    return f" <include> {', '.join(uris)}" if uris else ""


def _inertia(element: Element, name: str, poses: Mapping[str, Any]) -> Any | None:
    """Return the inertia of a link in its own frame; None if the file gives none."""
    inertial = find(element, "inertial")
    if inertial is None:
        return None
    if inertial.get("auto", "false") not in ("false", "0"):
        raise InvalidModel(f"{label(element)}: <inertial auto>; write its mass and inertia out")
    mass = _number(element, "inertial/mass")
    moments = (_number(element, f"inertial/inertia/i{ab}") for ab in ("xx", "yy", "zz"))
    products = (_number(element, f"inertial/inertia/i{ab}", 0.0) for ab in ("xy", "xz", "yz"))
    inertia = tensor(*moments, *products)
    smallest, _, largest = np.linalg.eigvalsh(inertia)
    if smallest < -tolerances.MOMENT * abs(largest):
        raise InvalidModel(
            f"{label(element)}: <inertia> has the principal moment {smallest:g}; none may be < 0"
        )
    linkMc, base = pose_in(element, "inertial/pose")
    if base not in ("", name):
        linkMc = poses[name].actInv(pose_of(base, poses, element) * linkMc)
    R = linkMc.rotation
    Y = pin.Inertia(mass, linkMc.translation, np.eye(3))
    Y.inertia = R @ inertia @ R.T  # the constructor refuses a moment that is zero but for rounding
    return Y


def _joint(
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
    ratio = _number(element, "gearbox_ratio", 1.0)
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
        damping=_number(element, f"{tag}/dynamics/damping", 0.0),
        friction=_number(element, f"{tag}/dynamics/friction", 0.0),
        stiffness=_number(element, f"{tag}/dynamics/spring_stiffness", 0.0),
        reference=_number(element, f"{tag}/dynamics/spring_reference", 0.0),
    )
    if axis.lower > axis.upper:
        raise InvalidModel(
            f"{label(element)}: <{tag}/limit>: {axis.lower:g} to {axis.upper:g}; exchange them"
        )
    return axis


def _direction(element: Element, tag: str, name: str, poses: Mapping[str, Any]) -> Array | None:
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
    value = _number(element, path, unlimited, infinite=True)
    return copysign(inf, value) if abs(value) >= UNLIMITED else value


def _bound(element: Element, path: str) -> float:
    value = _limit(element, path, inf)
    return inf if value < 0 else value  # the format's way to say that it is not enforced


def _number(
    element: Element, path: str, default: float | None = None, *, infinite: bool = False
) -> float:
    """Return the one number at a path, or the default where there is no such element."""
    found = find(element, path)
    if found is not None:
        return float(floats(found.text, 1, f"{label(element)}: <{path}>", infinite)[0])
    if default is None:
        raise InvalidModel(f"{label(element)}: no <{path}>; one number is needed")
    return default
