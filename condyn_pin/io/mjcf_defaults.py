"""Default classes of MJCF: attributes that hold where an element itself says nothing."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree.ElementTree import Element

from condyn_pin.errors import InvalidModel, unknown_name

MAIN = "main"


class Defaults:
    """The attributes of each class, by tag; a class has those of the class around it."""

    def __init__(self, root: Element) -> None:
        self._main = MAIN
        self._classes: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}
        for section in root.findall("default"):
            self._main = section.get("class", MAIN)
            self._read(section, self._main, self._classes.get(self._main, self._classes[MAIN]))

    def of(self, element: Element, tag: str, childclass: str) -> Mapping[str, str]:
        """Return the default attributes of an element of a body with this child class."""
        name = element.get("class") or childclass or self._main
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
            if not inner.get("class"):
                raise InvalidModel(f"a <default> in class {name!r} has no class; name it")
            self._read(inner, inner.attrib["class"], own)
