"""How large an MJCF becomes in MuJoCo: a word of it can ask for more than any machine has.

    copies = sum of (product of <replicate count> around an element) - 1

Its parser makes all of them before it looks at any, in a time that grows with their square.
"""

from __future__ import annotations

from math import prod
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

from condyn_pin.errors import InvalidModel
from condyn_pin.io.mjcf_include import insert_includes, parse
from condyn_pin.io.xml import label, shown

_PARTS: Final = 10_000  # a robot has hundreds; MuJoCo makes so many in seconds
_ENTRIES: Final = 10_000_000  # of one table: a picture of 3000 x 3000

# Numbers that multiply to the parts, or to the entries of a table, of an element.
_MULTIPLIES: Final = {"replicate": "count"}
_MAKES: Final = {"flexcomp": "count", "composite": "count", "mesh": "params"}
_TABLES: Final = {
    "hfield": ("nrow", "ncol"),
    "texture": ("width", "height"),
    "numeric": ("size",),
    "size": ("nkey", "nuserdata"),
    "user": ("dim",),
}
_HISTORY: Final = ("nsample", "actdim")
_DEEPEST: Final = 16  # models that attach models


def check_size(root: Element, folder: Path) -> None:
    """Refuse a file from which MuJoCo would make more than any robot is.

    Parameters
    ----------
    root : Element
        Of the file, what it includes inserted.
    folder : Path
        Of the file.
    """
    _parts(root, folder, 1)


def _parts(root: Element, folder: Path, depth: int) -> float:
    """Return how many copies there will be, those in attached files among them."""
    if depth > _DEEPEST:
        raise InvalidModel("<attach>: models attach each other without an end")
    attached = {
        model.get("name", model.get("file")): _parts_of_file(folder / model.get("file", ""), depth)
        for model in root.iter("model")
        if model.get("file")
    }
    total, waiting = 0.0, [(root, 1.0)]
    while waiting:
        element, times = waiting.pop()
        _check_tables(element)
        made = prod(_counts(element, _MAKES.get(element.tag, "")))
        made += attached.get(element.get("model"), 0) if element.tag == "attach" else 0
        total += times * made - 1
        times *= prod(_counts(element, _MULTIPLIES.get(element.tag, "")))
        if total > _PARTS or times > _PARTS:
            raise InvalidModel(
                f"{label(element)} makes more than {_PARTS} parts, and no robot has so many"
            )
        waiting.extend((child, times) for child in element)
    return total


def _parts_of_file(path: Path, depth: int) -> float:
    if path.suffix != ".xml" or not path.is_file():  # MuJoCo reads, or misses, it
        return 1
    root = parse(path)
    insert_includes(root, path.parent)
    return _parts(root, path.parent, depth + 1)


def _check_tables(element: Element) -> None:
    names = (*_TABLES.get(element.tag, ()), *(n for n in _HISTORY if n in element.attrib))
    names += tuple(n for n in element.attrib if n.startswith("nuser_"))
    numbers = {name: prod(_counts(element, name)) for name in names}
    if prod(numbers.values()) > _ENTRIES:
        said = ", ".join(f"{name} = {shown(element.get(name, ''))}" for name in numbers)
        raise InvalidModel(f"{label(element)}: {said}: more than {_ENTRIES} entries")


def _counts(element: Element, name: str) -> list[float]:
    """Return the numbers of an attribute that count; MuJoCo says what is none of them."""
    try:
        return [max(float(word), 1.0) for word in element.get(name, "1").split()]
    except ValueError:
        return [1.0]
