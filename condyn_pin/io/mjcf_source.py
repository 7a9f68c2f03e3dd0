"""A plain MJCF file while it is read: its settings, and what of it nobody reads."""

from __future__ import annotations

from collections import Counter
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin.io.mjcf_defaults import Defaults
from condyn_pin.io.mjcf_pose import Settings
from condyn_pin.io.mjcf_words import EQUALITIES, PASSED_SECTIONS, PLAIN_SETTINGS, SECTIONS
from condyn_pin.io.mjcf_xml import Attributes, NotPlain


class Source:
    """A file that is being read.

    Attributes
    ----------
    root : Element
    settings : Settings
        What <compiler> says about numbers.
    defaults : Defaults
    passed, unread : Counter
        Elements and attributes that are not read.
    unused : list of str
        Sentences about what is not used.
    """

    def __init__(self, root: Element) -> None:
        self.root = root
        self.passed: Counter[str] = Counter()
        self.unread: Counter[str] = Counter()
        self.unused: list[str] = []
        for element in root:
            if element.tag in PASSED_SECTIONS:
                self.passed[f"<{element.tag}>"] += 1
            elif element.tag not in (*SECTIONS, "default"):
                raise NotPlain(f"<{element.tag}> is there")
        self.defaults = Defaults(root)
        self.settings = self._settings()

    def attributes(self, element: Element, kind: str = "", childclass: str = "") -> Attributes:
        """Return the attributes of an element; count those that are not read."""
        kind = kind or element.tag
        tag = "equality" if kind in EQUALITIES else kind
        said = Attributes(element, kind, self.defaults.of(element, tag, childclass))
        self.unread += said.unread
        return said

    def _settings(self) -> Settings:
        merged = Element("compiler")
        for section in self.root.findall("compiler"):
            merged.attrib.update(section.attrib)
        for key, plain in PLAIN_SETTINGS.items():
            if merged.attrib.pop(key, plain) != plain:
                raise NotPlain(f"<compiler> has {key} other than {plain!r}")
        said = Attributes(merged, "compiler", {})
        unit = said.one_of("angle", ("degree", "radian"), "degree")
        eulerseq = said.text("eulerseq", "xyz")
        if len(eulerseq) != 3 or set(eulerseq.lower()) - set("xyz"):
            said.refuse("eulerseq", "three letters out of x y z X Y Z are needed")
        return Settings(
            angle=np.pi / 180 if unit == "degree" else 1.0,
            eulerseq=eulerseq,
            autolimits=said.flag("autolimits"),
        )

    def remarks(self) -> tuple[str, ...]:
        """Return what is not used, a sentence each."""
        sentences = list(self.unused)
        for what, counts in (("elements", self.passed), ("attributes", self.unread)):
            if counts:
                listed = ", ".join(f"{n} {name}" for name, n in sorted(counts.items()))
                sentences.append(f"{what} that are not read: {listed}")
        return tuple(sentences)
