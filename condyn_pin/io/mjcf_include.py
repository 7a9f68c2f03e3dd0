"""<include> of MJCF: the content of another file stands in place of the element."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

from condyn_pin.errors import InvalidModel
from condyn_pin.io.xml import parsed


def parse(path: Path) -> Element:
    """Return the root of an XML file."""
    try:
        return parsed(path)
    except (OSError, ValueError) as error:
        raise InvalidModel(f"{path}: cannot be read as XML: {error}") from error


def insert_includes(root: Element, folder: Path) -> None:
    """Insert the files that a file names, which may name others.

    Parameters
    ----------
    root : Element
        Of the file; it is changed.
    folder : Path
        Of the first file; every name is relative to it.

    Raises
    ------
    InvalidModel
        If a file cannot be read, or is included a second time, as MuJoCo has it.
    """
    seen: set[Path] = set()
    waiting = [root]
    while waiting:
        parent = waiting.pop()
        while (found := parent.find("include")) is not None:
            path = (folder / found.get("file", "")).resolve()
            if path in seen:
                raise InvalidModel(f"<include>: {path} is included twice")
            seen.add(path)
            at = list(parent).index(found)
            parent[at : at + 1] = list(parse(path))
        waiting.extend(parent)
