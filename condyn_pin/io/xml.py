"""Elements of an XML description, whatever its format: their names and their numbers."""

from __future__ import annotations

from math import isnan
from os import PathLike
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.files.text import read_bytes
from condyn_pin.errors import InvalidModel
from condyn_pin.model.soundness import MOST_JOINTS

_MOST_ELEMENTS: Final = 500_000
_SHOWN: Final = 60  # characters
UNLIMITED: Final = 1e16  # the older way of SDF to write an infinite limit


MOST_LINKS: Final = 5000


def parsed(path: str | PathLike[str]) -> Element:
    """Return the root of an XML file, or raise OSError or ValueError."""
    try:
        root = ElementTree.fromstring(read_bytes(path))
    except (ElementTree.ParseError, LookupError) as error:  # an encoding that nobody knows
        raise ValueError(error) from error
    if sum(1 for _ in root.iter()) > _MOST_ELEMENTS:
        raise ValueError(f"it has more than {_MOST_ELEMENTS} elements")
    return root


def check_counts(links: int, joints: int) -> None:
    """Refuse more links, and joints that move, than can be computed with."""
    for count, most, what in ((links, MOST_LINKS, "links"), (joints, MOST_JOINTS, "joints")):
        if count > most:
            raise InvalidModel(f"{count} {what} are there, and {most} can be read at most")


def shown(text: str) -> str:
    """Return a text as errors show it: in quotes, and not too long."""
    if len(text) <= _SHOWN:
        return repr(text)
    return f"{text[:_SHOWN]!r}... ({len(text)} characters)"


def label(element: Element) -> str:
    """Return how errors call an element."""
    name = element.get("name")
    return f"<{element.tag}>" if name is None else f"<{element.tag}> {shown(name)}"


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
    words, given = (text or "").split(), "None" if text is None else shown(text)
    try:
        values = [float(word) for word in words if "_" not in word]  # Python reads 1_0 as 10
    except ValueError:
        values = []
    if len(values) != count or len(words) != count:
        raise InvalidModel(f"{where} is {given}; {count} number(s) are needed")
    if any(isnan(x) or (abs(x) >= UNLIMITED and not infinite) for x in values):
        raise InvalidModel(f"{where} is {given}; finite numbers are needed, less than 1e16")
    return np.array(values)
