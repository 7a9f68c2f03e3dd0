"""Default classes of MJCF: attributes that hold where an element itself says nothing."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree.ElementTree import Element

from condyn_pin.errors import InvalidModel, unknown_name

MAIN = "main"


class Defaults:
    """The attributes of each class, by tag; a class has those of the class around it."""

    def __init__(self, root: Element) -> None:
        self._classes: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}
        for section in root.findall("default"):
            if section.get("class", MAIN) != MAIN:
                raise InvalidModel(
                    f"the outermost <default> is of class {section.get('class')!r}; it is "
                    f"{MAIN!r}: put another one around it"
                )
            self._read(section, MAIN, self._classes[MAIN])

    def of(self, element: Element, tag: str, childclass: str) -> Mapping[str, str]:
        """Return the default attributes of an element of a body with this child class."""
        name = element.get("class") or childclass or MAIN
        if name not in self._classes:
            raise InvalidModel(
                f"<{element.tag}> {element.get('name', '')!r}: "
                f"{unknown_name('default class', name, self._classes)}"
            )
        return self._classes[name].get(tag, {})

    def _read(self, section: Element, name: str, around: dict[str, dict[str, str]]) -> None:
        own = {tag: dict(attributes) for tag, attributes in around.items()}
        for element in section:
            if element.tag != "default":
                own[element.tag] = own.get(element.tag, {}) | element.attrib
        self._classes[name] = own
        for inner in section.findall("default"):
            inner_name = inner.get("class", "")
            if not inner_name:
                raise InvalidModel(f"a <default> in class {name!r} has no class; name it")
            if inner_name in self._classes:
                raise InvalidModel(f"two default classes are named {inner_name!r}; rename one")
            self._read(inner, inner_name, own)
