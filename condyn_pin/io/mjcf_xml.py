"""The XML of a plain MJCF file: attributes, their numbers and words, and what nobody reads."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import NoReturn
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel
from condyn_pin.io.mjcf_words import READ, REPORTED, SILENT
from condyn_pin.io.xml import floats, label


class NotPlain(Exception):
    """The file has something that only MuJoCo itself reads rightly."""


class Attributes:
    """The attributes of one element, those of its default class among them.

    Parameters
    ----------
    element : Element
    kind : str
        Its tag, or "equality/joint" for the equality of this tag.
    defaults : mapping of str to str
        Attributes that hold where the element itself says nothing.
    """

    def __init__(self, element: Element, kind: str, defaults: Mapping[str, str]) -> None:
        self.label = label(element)
        self._values = {**defaults, **element.attrib}
        unknown = (
            self._values.keys() - READ[kind] - REPORTED.get(kind, set()) - SILENT.get(kind, set())
        )
        if unknown:
            raise NotPlain(f"{self.label} has the attribute {sorted(unknown)[0]!r}")
        self.unread = Counter(
            f"{key} of <{element.tag}>" for key in REPORTED.get(kind, ()) if key in self._values
        )

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def text(self, key: str, default: str = "") -> str:
        """Return a text."""
        return self._values.get(key, default)

    def one_of(self, key: str, words: Mapping[str, str] | tuple[str, ...], default: str) -> str:
        """Return a word out of several."""
        word = self._values.get(key, default)
        if word not in words:
            self.refuse(key, f"one of {', '.join(words)} is needed")
        return word

    def flag(self, key: str) -> bool:
        """Return a truth value; true where the element says nothing."""
        return self.one_of(key, ("true", "false"), "true") == "true"

    def floats(self, key: str, count: int, default: Array | None = None) -> Array:
        """Return exactly `count` finite numbers."""
        if key not in self._values and default is not None:
            return default
        if key not in self._values:
            raise InvalidModel(f"{self.label}: no {key}; {count} number(s) are needed")
        return floats(self._values[key], count, f"{self.label}: {key}")

    def number(self, key: str, default: float | None = None) -> float:
        """Return a finite number."""
        return float(self.floats(key, 1, None if default is None else np.array([default]))[0])

    def positive(self, key: str, default: float | None = None) -> float:
        """Return a number that is not below zero."""
        value = self.number(key, default)
        if value < 0:
            self.refuse(key, "it must not be negative")
        return value

    def count(self, key: str) -> int:
        """Return how many numbers a text has."""
        return len(self._values.get(key, "").split())

    def given(self, *keys: str) -> Iterator[str]:
        """Yield those of the keys that are there."""
        return (key for key in keys if key in self._values)

    def refuse(self, key: str, wanted: str) -> NoReturn:
        """Raise InvalidModel about one attribute."""
        raise InvalidModel(f"{self.label}: {key} is {self._values.get(key)!r}; {wanted}")
