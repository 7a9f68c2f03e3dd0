"""Untrusted XML files: opened, limited in size, and named in error texts, for all formats.

`open_xml` is the only way in, and `place` puts the file before the text of every error.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Container, Iterator, Mapping
from contextlib import contextmanager
from math import isnan
from os import PathLike
from types import MappingProxyType
from typing import Final, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.files import check_size, read_bytes, written_out
from condyn_pin.errors import CondynError, InvalidModel
from condyn_pin.model.soundness import MOST_JOINTS

_MOST_ELEMENTS: Final = 500_000
_MOST_LINKS: Final = 5000
_SHOWN: Final = 60  # characters
_PREFIX: Final = re.compile(rb"[<\s]/?([A-Za-z_][\w.-]*):[A-Za-z_]")  # of an element, an attribute
_DECLARED: Final = re.compile(rb"xmlns:([\w.-]+)\s*=")
_ROOT: Final = re.compile(rb"<[A-Za-z_][^\s/>]*")
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
    """Return the root of an XML, whose tag has to be this one, or raise InvalidModel."""
    # The source is a file, or a text that begins with an element.
    try:
        if isinstance(source, str) and source.lstrip().startswith("<"):
            check_size(len(source))
            content = source.encode()
        else:
            content = read_bytes(source)
        try:
            root = ElementTree.fromstring(content)
        except ElementTree.ParseError as error:
            root = _lenient(content, error)
        for count, element in enumerate(root.iter(), 1):
            if count > _MOST_ELEMENTS:
                raise ValueError(f"it has more than {_MOST_ELEMENTS} elements")
            for key, value in element.attrib.items():
                if not value.isprintable():  # lines and tabs are spaces by now
                    element.set(key, written_out(value))
            text = element.text
            if text and not (text.isspace() or text.isprintable()):
                element.text = written_out(text)
    except OSError as error:
        raise InvalidModel(f"cannot be opened: {error.strerror or error}") from error
    # LookupError: an unknown encoding
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise InvalidModel(f"cannot be read as XML: {error}") from error
    if tag and root.tag != tag:
        raise InvalidModel(f"its root element is <{root.tag}>; <{tag}> is needed")
    return root


def _lenient(content: bytes, fault: ElementTree.ParseError) -> Element:
    """Root of a malformed XML that simulators read all the same."""
    # Text before the declaration, -- in a comment, and prefixes of names that nothing declares.
    content = _without_comments(content[max(content.find(b"<?xml"), 0) :])
    root = _ROOT.search(content)
    at = root.end() if root else 0
    known = {b"xml", b"xmlns", *_DECLARED.findall(content, at, content.find(b">", at))}
    prefixes = {*_PREFIX.findall(content)} - known
    added = b"".join(b' xmlns:%s="%s"' % (prefix, prefix) for prefix in prefixes)
    try:
        return ElementTree.fromstring(content[:at] + added + content[at:])
    except ElementTree.ParseError:
        raise fault from None


def _without_comments(content: bytes) -> bytes:
    """Text without comments, in linear time."""
    first, *others = content.split(b"<!--")
    kept = [first]
    inside = False
    for part in others:
        _, end, after = part.partition(b"-->")
        inside = not end
        if end:
            kept.append(after)
    return content if inside else b"".join(kept)


def check_counts(links: int, joints: int) -> None:
    """Refuse more links, or moving joints, than the dynamics can handle."""
    for count, most, what in ((links, _MOST_LINKS, "links"), (joints, MOST_JOINTS, "joints")):
        if count > most:
            raise InvalidModel(f"{count} {what} found; at most {most} can be read")


def quoted_text(text: str) -> str:
    """Return a text for an error: in quotes, and shortened."""
    if len(text) <= _SHOWN:
        return repr(text)
    return f"{text[:_SHOWN]!r}... ({len(text)} characters)"


def label(element: Element) -> str:
    """Return the name of an element in error texts: its tag, and its attribute `name`."""
    name = element.get("name")
    return f"<{element.tag}>" if name is None else f"<{element.tag}> {quoted_text(name)}"


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
    """Return exactly `count` numbers of a text; errors begin with `where`."""
    return np.array(_numbers(text, count, where, infinite))


def _numbers(text: str | None, count: int, where: str, infinite: bool) -> list[float]:
    words = (text or "").split()
    try:
        values = [float(word) for word in words if "_" not in word]  # Python reads 1_0 as 10
    except ValueError:
        values = []
    fits = len(values) == len(words) == count
    if fits and not any(isnan(x) or (abs(x) >= UNLIMITED and not infinite) for x in values):
        return values
    given = "None" if text is None else quoted_text(text)
    if not fits:
        raise InvalidModel(f"{where} is {given}; {count} number(s) are needed")
    raise InvalidModel(f"{where} is {given}; finite numbers are needed, less than 1e16")


class ElementSchema(NamedTuple):
    """Schema of an element; of names there may be several, with spaces between."""

    words: str = ""  # attributes that are texts; "*" for all
    numbers: Mapping[str, int] = MappingProxyType({})  # attributes that are, and how many in each
    needed: str = ""  # those of them that cannot be left out
    text: int = 0  # how many numbers its text has; 0 where it is none
    one: str = ""  # elements below it, of which there may be one; ``{*}NAME`` in any namespace
    many: str = ""  # those of which there may be many; one without a schema is taken as it is
    infinite: bool = False  # whether its numbers may be infinite
    raw: bool = False  # whether what is below it is taken as it is, by no schema


class Schema:
    """Schema of a format by tag; `checked` copies the elements in it, and counts all others."""

    def __init__(self, tags: Mapping[str, ElementSchema]) -> None:
        self._tags = {
            name: (tag, {*tag.words.split()}, {*tag.one.split()}, {*tag.many.split()})
            for name, tag in tags.items()
        }
        self.elements, self.attributes = Counter[str](), Counter[str]()

    def checked(self, element: Element, where: str = "", path: str = "") -> Element:
        """Return a copy of the read part of an element: numbers checked, single children once."""
        # In error texts it is the `path` of tags in the part `where`, by default itself.
        tag, words, one, many = self._tags[element.tag]
        where = where or label(element)
        copy, seen = Element(element.tag), set[str]()
        for key, value in element.attrib.items():
            if count := tag.numbers.get(key, 0):
                said = f"{where}: <{element.tag} {key}>"
                copy.set(key, _parsed_numbers(value, count, said, tag.infinite))
            elif key in words or tag.words == "*":
                copy.set(key, value)
            else:
                self.attributes[f"{_local_name(key)} of <{element.tag}>"] += 1
        for key in tag.needed.split():
            if key not in element.attrib:
                floats(None, tag.numbers[key], f"{where}: <{element.tag} {key}>")
        copy.text = element.text
        if tag.text:
            copy.text = _parsed_numbers(element.text, tag.text, f"{where}: <{path}>", tag.infinite)
        for child in element:
            name = _any_namespace(child.tag)
            if name in seen:
                count = len(element.findall(child.tag))
                raise InvalidModel(f"{where}: <{child.tag}> is there {count} times; keep one")
            if name in one:
                seen.add(name)
            elif name not in many:
                self.elements[f"<{_local_name(name)}>"] += 1
                continue
            if child.tag in self._tags and not tag.raw:
                named = "name" in child.attrib
                below = f"{path}/{child.tag}" if path else child.tag
                child = self.checked(child, "" if named else where, "" if named else below)
            copy.append(child)
        return copy

    def count(self, element: Element, known: Container[str]) -> None:
        """Count the unknown children of an unchecked element."""
        for child in element:
            if _any_namespace(child.tag) not in known:
                self.elements[f"<{_local_name(child.tag)}>"] += 1

    def not_read(self) -> Iterator[str]:
        """Yield the elements and attributes that were not read, with counts, as sentences."""
        for what, found in (("elements", self.elements), ("attributes", self.attributes)):
            if found:
                listed = ", ".join(f"{n} {name}" for name, n in sorted(found.items()))
                yield f"{what} that are not read: {listed}"


def _parsed_numbers(text: str | None, count: int, where: str, infinite: bool) -> str:
    """Numbers of a text in Python's spelling, which every reader accepts."""
    return " ".join(map(repr, _numbers(text, count, where, infinite)))


def _any_namespace(tag: str) -> str:
    """Tag with its namespace, if any, replaced by ``{*}``."""
    return "{*}" + _local_name(tag) if tag.startswith("{") else tag


def _local_name(name: str) -> str:
    """Name without its namespace."""
    return name.rpartition("}")[2]
