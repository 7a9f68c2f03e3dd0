"""The graph of an SDF file: where each part is drawn, and the link that it moves with.

Every link, joint and frame x is placed by a pose in another one, and the poses multiply up to the
model frame o,

    oMx = oMbase · baseMx,    base = `relative_to`, else the model (link), the child (joint)
    R   = Rz(yaw) Ry(pitch) Rx(roll)
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any, Final
from xml.etree.ElementTree import Element

from condyn_pin._core._pin import pin
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.sdf_types import WORLD
from condyn_pin.io.xml import find, floats, label

MODEL: Final = "__model__"


def parts_of(model: Element) -> dict[str, Element]:
    """Return links, joints and frames by name, in the order of the file: they share one scope."""
    parts: dict[str, Element] = {}
    for element in model:
        if element.tag not in ("link", "joint", "frame"):
            continue
        name = element.get("name", "")
        if not name.strip() or name in (WORLD, MODEL):
            raise InvalidModel(f"a <{element.tag}> is named {name!r}; give it a name of its own")
        if name in parts:
            raise InvalidModel(f"{label(parts[name])} and {label(element)}: rename one of them")
        parts[name] = element
    if not any(element.tag == "link" for element in parts.values()):
        raise InvalidModel(f"{label(model)}: no <link>; at least one is needed")
    return parts


def model_poses(parts: Mapping[str, Element], oMw: Any) -> dict[str, Any]:
    """Return oMx of every part x, of the model and of the world."""
    base, placement = {}, {}
    for name, element in parts.items():
        placement[name], named = pose_in(element)
        if element.tag == "joint":
            base[name] = named or word(element, "child")
        else:
            base[name] = named or element.get("attached_to") or MODEL
    poses = {MODEL: pin.SE3.Identity(), WORLD: oMw}
    for name in parts:
        for member in reversed(_chain(name, base, poses, parts)[:-1]):
            poses[member] = poses[base[member]] * placement[member]
    return poses


def links_of(parts: Mapping[str, Element], canonical: str | None) -> dict[str, str]:
    """Return the link that every part moves with: a joint moves with its child."""
    links = [name for name, element in parts.items() if element.tag == "link"]
    base = {name: name for name in links}
    for name, element in parts.items():
        if element.tag == "joint":
            base[name] = word(element, "child")
        elif element.tag == "frame":
            base[name] = element.get("attached_to") or canonical or links[0]
    ends = {*links, WORLD}
    return {WORLD: WORLD} | {name: _chain(name, base, ends, parts)[-1] for name in parts}


def word(element: Element, tag: str) -> str:
    """Return the name that an element of a joint holds."""
    found = find(element, tag)
    name = "" if found is None else (found.text or "").strip()
    if not name:
        raise InvalidModel(f"{label(element)}: no <{tag}>; write the name of a link there")
    return name


def _chain(
    name: str, base: Mapping[str, str], ends: Container[str], parts: Mapping[str, Element]
) -> list[str]:
    """Return `name`, its base, the base of that, and so on up to one of `ends`."""
    chain = {name: None}  # a dict keeps the order and finds members at once
    while name not in ends:
        if base[name] not in base and base[name] not in ends:
            known = unknown_name("link or frame", base[name], base)
            raise InvalidModel(f"{label(parts[name])}: {known}")
        name = base[name]
        if name in chain:
            raise InvalidModel(
                f"{label(parts[name])}: {' -> '.join([*chain, name])} are placed in a circle; "
                "place one of them in the model"
            )
        chain[name] = None
    return list(chain)


def pose_in(element: Element, path: str = "pose") -> tuple[Any, str]:
    """Return baseMx and the name of its base, "" for the default one."""
    pose = find(element, path)
    if pose is None:
        return pin.SE3.Identity(), ""
    base = pose.get("relative_to") or pose.get("frame") or ""
    degrees = pose.get("degrees", "false") not in ("false", "0")
    if degrees or pose.get("rotation_format", "euler_rpy") != "euler_rpy":
        raise InvalidModel(
            f"{label(element)}: <{path}> has other units; write x y z [m], roll pitch yaw [rad]"
        )
    if not (pose.text or "").strip():
        return pin.SE3.Identity(), base
    x = floats(pose.text, 6, f"{label(element)}: <{path}>")
    return pin.SE3(pin.rpy.rpyToMatrix(x[3], x[4], x[5]), x[:3]), base


def pose_of(name: str, poses: Mapping[str, Any], element: Element) -> Any:
    """Return oMx of the part that an element names."""
    if name not in poses:
        raise InvalidModel(f"{label(element)}: {unknown_name('frame', name, poses)}")
    return poses[name]
