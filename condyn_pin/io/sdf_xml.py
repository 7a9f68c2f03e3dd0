"""The XML of an SDF file: elements by path, their words and numbers, and what nobody reads."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Mapping
from math import isnan
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from condyn_pin.errors import InvalidModel

UNLIMITED: Final = 1e16  # the format's older way to write an infinite limit

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


def label(element: Element) -> str:
    """Return how errors call an element."""
    return f"<{element.tag}> {element.get('name', '')!r}"


def find(element: Element, path: str) -> Element | None:
    """Return the element at ``tag/tag/...`` below another one; there may be one at most."""
    for tag in path.split("/"):
        found = element.findall(tag)
        if len(found) > 1:
            raise InvalidModel(f"{label(element)}: <{tag}> is there {len(found)} times; keep one")
        if not found:
            return None
        element = found[0]
    return element


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


def floats(text: str | None, count: int, where: str, infinite: bool = False) -> NDArray[np.float64]:
    """Return exactly `count` numbers of a text; `where` is what an error says first."""
    words = (text or "").split()
    try:
        values = [float(word) for word in words if "_" not in word]  # Python reads 1_0 as 10
    except ValueError:
        values = []
    if len(values) != count or len(words) != count:
        raise InvalidModel(f"{where} is {text!r}; {count} number(s) are needed")
    if any(isnan(x) or (abs(x) >= UNLIMITED and not infinite) for x in values):
        raise InvalidModel(f"{where} is {text!r}; finite numbers are needed, less than 1e16")
    return np.array(values)


def unread(element: Element) -> Counter[str]:
    """Count, by tag, the elements whose content is not read."""
    counts: Counter[str] = Counter()
    for child in element:
        if child.tag not in _READ[element.tag]:
            counts[child.tag] += 1
        elif child.tag in _READ:
            counts += unread(child)
    return counts
