"""Elements of an XML description, whatever its format: their names and their numbers."""

from __future__ import annotations

from math import isnan
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin.arrays import Array
from condyn_pin.errors import InvalidModel

UNLIMITED: Final = 1e16  # the older way of SDF to write an infinite limit


def label(element: Element) -> str:
    """Return how errors call an element."""
    name = element.get("name")
    return f"<{element.tag}>" if name is None else f"<{element.tag}> {name!r}"


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


def floats(text: str | None, count: int, where: str, infinite: bool = False) -> Array:
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
