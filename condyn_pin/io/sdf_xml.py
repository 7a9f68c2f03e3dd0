"""The XML of an SDF file: the words and numbers of its elements, and what nobody reads."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Mapping
from typing import Final
from xml.etree.ElementTree import Element

from condyn_pin.errors import InvalidModel
from condyn_pin.io.xml import find, floats, label

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


def word(element: Element, tag: str) -> str:
    """Return the name that an element of a joint holds."""
    found = find(element, tag)
    name = "" if found is None else (found.text or "").strip()
    if not name:
        raise InvalidModel(f"{label(element)}: no <{tag}>; write the name of a link there")
    return name


def number(
    element: Element, path: str, default: float | None = None, *, infinite: bool = False
) -> float:
    """Return the one number at a path, or the default where there is no such element."""
    found = find(element, path)
    if found is not None:
        return float(floats(found.text, 1, f"{label(element)}: <{path}>", infinite)[0])
    if default is None:
        raise InvalidModel(f"{label(element)}: no <{path}>; one number is needed")
    return default


def unread(element: Element) -> Counter[str]:
    """Count, by tag, the elements whose content is not read."""
    counts: Counter[str] = Counter()
    for child in element:
        if child.tag not in _READ[element.tag]:
            counts[child.tag] += 1
        elif child.tag in _READ:
            counts += unread(child)
    return counts
