"""Links and joints of a URDF, copied out with every number checked."""

from __future__ import annotations

from typing import Final
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import UNLIMITED
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.xml import find, floats, label

_TYPES: Final = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_WITH_AXIS: Final = ("revolute", "continuous", "prismatic", "planar")
_MOMENTS: Final = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def copy_link(copy: Element, link: Element) -> None:
    """Add a link to a copy, with its inertia."""
    made = SubElement(copy, "link", name=link.attrib["name"])
    inertial = find(link, "inertial")
    if inertial is None:
        return
    where = label(link)
    mass, inertia = find(inertial, "mass"), find(inertial, "inertia")
    if mass is None or inertia is None:
        lacks = "mass" if mass is None else "inertia"
        raise InvalidModel(f"{where}: <inertial> has no <{lacks}>; give it one")
    kilograms = number(mass, "value", where)
    if kilograms < 0:
        raise InvalidModel(f"{where}: <mass value={kilograms:g}>: it must not be negative")
    moments = {key: repr(number(inertia, key, where)) for key in _MOMENTS}
    body = SubElement(made, "inertial")
    _copy_origin(body, inertial, where)
    SubElement(body, "mass", value=repr(kilograms))
    SubElement(body, "inertia", moments)


def copy_joint(copy: Element, joint: Element, *, one_number: bool) -> None:
    """Add a joint to a copy; one with `one_number` is an angle, also where it has no limits."""
    where, kind = label(joint), joint.get("type", "")
    if kind not in _TYPES:
        raise InvalidModel(f"{where}: {unknown_name('joint type', kind, _TYPES)}")
    # A continuous joint is (cos, sin) in Pinocchio; what is proportional needs an angle.
    unbounded = kind == "continuous" and one_number
    made = SubElement(copy, "joint", name=joint.attrib["name"])
    made.set("type", "revolute" if unbounded else kind)
    for end in ("parent", "child"):
        SubElement(made, end, link=link_at(joint, end))
    _copy_origin(made, joint, where)
    axis = find(joint, "axis")
    if kind in _WITH_AXIS and axis is not None:
        xyz = floats(axis.get("xyz"), 3, f"{where}: <axis xyz>")
        if not xyz.any():
            raise InvalidModel(f"{where}: <axis xyz> is zero; give it a direction")
        SubElement(made, "axis", xyz=_text(xyz))
    _copy_limit(made, joint, kind, unbounded=unbounded)
    dynamics = find(joint, "dynamics")
    if dynamics is not None:
        said = {key: repr(number(dynamics, key, where, "0")) for key in ("damping", "friction")}
        SubElement(made, "dynamics", said)


def link_at(joint: Element, end: str) -> str:
    """Return the name of a joint's parent or child; empty if it has none."""
    element = find(joint, end)
    return "" if element is None else element.get("link", "")


def _copy_limit(made: Element, joint: Element, kind: str, *, unbounded: bool) -> None:
    where, limit = label(joint), find(joint, "limit")
    if limit is None and kind in ("revolute", "prismatic"):
        raise InvalidModel(
            f"{where}: a {kind} joint needs <limit lower=.. upper=.. effort=.. velocity=..>; "
            "without limits it is continuous"
        )
    if limit is None and not unbounded:
        return
    limit = Element("limit") if limit is None else limit
    free = repr(UNLIMITED)
    given = {"lower": "0", "upper": "0", "effort": free, "velocity": free} | limit.attrib
    if unbounded or without_bounds(joint):
        given |= {"lower": f"-{free}", "upper": free}
    said = {}
    for key in ("lower", "upper", "effort", "velocity"):
        value = floats(given[key], 1, f"{where}: <limit {key}>", infinite=True)
        said[key] = float(np.clip(value, -UNLIMITED, UNLIMITED)[0])
    if said["lower"] > said["upper"]:
        missing = [key for key in ("lower", "upper") if key not in limit.attrib]
        advice = (
            f"the {missing[0]} one is not there, which is 0; give it"
            if missing
            else "exchange them"
        )
        raise InvalidModel(f"{where}: limits {said['lower']:g} to {said['upper']:g}; {advice}")
    SubElement(made, "limit", {key: repr(value) for key, value in said.items()})


def without_bounds(joint: Element) -> bool:
    """Whether a joint that needs limits has some of effort and velocity only.

    By the format both bounds are then 0, which locks it. Exporters mean that there are none.
    """
    limit = find(joint, "limit")
    if joint.get("type") not in ("revolute", "prismatic") or limit is None:
        return False
    return not {"lower", "upper"} & limit.attrib.keys()


def _copy_origin(made: Element, element: Element, where: str) -> None:
    origin = find(element, "origin")
    if origin is None:
        return
    said = {}
    for key in ("xyz", "rpy"):
        if origin.get(key) is not None:
            said[key] = _text(floats(origin.get(key), 3, f"{where}: <origin {key}>"))
    SubElement(made, "origin", said)


def number(element: Element, key: str, where: str, default: str | None = None) -> float:
    """Return the number in an attribute, or raise InvalidModel that says `where` it is."""
    return float(floats(element.get(key, default), 1, f"{where}: <{element.tag} {key}>")[0])


def _text(values: Array) -> str:
    return " ".join(repr(float(x)) for x in values)
