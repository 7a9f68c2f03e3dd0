"""XML files of strangers: opened, measured, and named in what is said of them, whatever the format.

`open_xml` is the only way in, and `place` puts the file before the text of every error.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterator, Mapping
from contextlib import contextmanager
from math import isnan
from os import PathLike
from types import MappingProxyType
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.files.text import check_size, read_bytes, written_out
from condyn_pin.errors import CondynError, InvalidModel
from condyn_pin.model.soundness import MOST_JOINTS

_MOST_ELEMENTS: Final = 500_000
_MOST_LINKS: Final = 5000
_SHOWN: Final = 60  # characters
UNLIMITED: Final = 1e16  # the older way of SDF to write an infinite limit


@contextmanager
def place(where: object) -> Iterator[None]:
    """Put a file, or an entry of it, before the text of an error."""
    try:
        yield
    except CondynError as error:
        error.args = (f"{where}: {error}", *error.args[1:])
        raise


def open_xml(source: str | PathLike[str], tag: str = "") -> Element:
    """Return the root of an XML, whose tag has to be this one, or raise InvalidModel.

    The source is a file, or a text that begins with an element.
    """
    try:
        if isinstance(source, str) and source.lstrip().startswith("<"):
            check_size(len(source))
            root = ElementTree.fromstring(source)
        else:
            root = ElementTree.fromstring(read_bytes(source))
        if sum(1 for _ in root.iter()) > _MOST_ELEMENTS:
            raise ValueError(f"it has more than {_MOST_ELEMENTS} elements")
        for element in root.iter():
            for key, value in element.attrib.items():
                if not value.isprintable():  # lines and tabs are spaces by now
                    element.set(key, written_out(value))
            if element.text and not element.text.isprintable():
                element.text = written_out(element.text)
    except OSError as error:
        raise InvalidModel(f"cannot be opened: {error.strerror or error}") from error
    # LookupError: an unknown encoding
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise InvalidModel(f"cannot be read as XML: {error}") from error
    if tag and root.tag != tag:
        raise InvalidModel(f"its root element is <{root.tag}>; <{tag}> is needed")
    return root


def check_counts(links: int, joints: int) -> None:
    """Refuse more links, and joints that move, than can be computed with."""
    for count, most, what in ((links, _MOST_LINKS, "links"), (joints, MOST_JOINTS, "joints")):
        if count > most:
            raise InvalidModel(f"{count} {what} found; at most {most} can be read")


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


def not_read(
    root: Element,
    elements: Mapping[str, Container[str]],
    attributes: Mapping[str, Container[str]] = MappingProxyType({}),
) -> Iterator[str]:
    """Say which elements and attributes of a file are not read.

    Parameters
    ----------
    root : Element
    elements : mapping of str to container of str
        Tag to the tags that are read below it; what is below others is ignored.
    attributes : mapping of str to container of str
        Tag to the attributes that are read; of other tags, none are counted.
    """
    counts = {"elements": Counter[str](), "attributes": Counter[str]()}
    waiting = [root]
    while waiting:
        element = waiting.pop()
        read = attributes.get(element.tag, element.attrib)
        counts["attributes"].update(
            f"{_short(key)} of <{element.tag}>" for key in element.attrib if key not in read
        )
        for child in element:
            if child.tag not in elements[element.tag]:
                counts["elements"][f"<{_short(child.tag)}>"] += 1
            elif child.tag in elements:
                waiting.append(child)
    for what, found in counts.items():
        if found:
            listed = ", ".join(f"{n} {name}" for name, n in sorted(found.items()))
            yield f"{what} that are not read: {listed}"


def _short(name: str) -> str:
    """Return a name without the address of its namespace."""
    return name.rpartition("}")[2]
