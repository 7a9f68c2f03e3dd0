"""Texts of json and toml that may come from strangers: their size, depth, numbers and letters."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any, Final

from condyn_pin.errors import printable

# A text takes up to thirty times its size when it is parsed: a gigabyte. The largest robots and
# tables have a tenth of this.
LARGEST: Final = 2**25  # [bytes]

_SHOWN: Final = 60  # characters of a line in an error
_LINES: Final = str.maketrans("\n\r\t", "   ")


def read_bytes(path: str | PathLike[str]) -> bytes:
    """Return a file; OSError or ValueError if there is none, or it is no text file."""
    path = Path(path)
    if path.exists() and not (path.is_file() or path.is_dir()):  # a device without an end
        raise ValueError("it is not a file")
    with path.open("rb") as file:
        content = file.read(LARGEST + 1)
    check_size(len(content))
    return content


def check_size(size: int) -> None:
    """Raise ValueError if a text is larger than any that is read here."""
    if size > LARGEST:
        raise ValueError(f"it is larger than {LARGEST / 1e6:.0f} MB")


def read_text(path: str | PathLike[str]) -> str:
    """Return a text in UTF-8, with or without a byte order mark."""
    return read_bytes(path).decode("utf-8-sig")


def parse_json(text: str | bytes) -> Any:
    """Return what a json says, or raise ValueError."""
    return _parsed(json.loads, text, json.JSONDecodeError)


def parse_toml(text: str) -> dict[str, Any]:
    """Return what a toml says, or raise ValueError."""
    try:
        config: dict[str, Any] = _parsed(tomllib.loads, text, tomllib.TOMLDecodeError)
    except tomllib.TOMLDecodeError as error:
        raise tomllib.TOMLDecodeError(f"{error}{_line_of(text, str(error))}") from error
    _check_depth(config)
    return config


def _line_of(text: str, said: str) -> str:
    """Return the line that an error speaks of, and what is wrong there most often."""
    found = re.search(r"at line (\d+)", said)
    if not found:
        return ""
    line = text.splitlines()[int(found[1]) - 1 :][:1]
    short = any(re.search(r"=\s*[+-]?\.\d|=\s*[+-]?\d+\.(\D|$)", each) for each in line)
    why = "; numbers have digits on both sides of the point, 0.5 and 1.0" if short else ""
    return "".join(f": {each.strip()[:_SHOWN]!r}{why}" for each in line)


def written_out(value: Any) -> Any:
    """Return what was parsed with its texts printable: who reads them prints them."""
    if isinstance(value, str):
        return printable(value.replace("\t", " "))
    if isinstance(value, dict):
        return {written_out(key): written_out(each) for key, each in value.items()}
    if isinstance(value, list):
        return [written_out(each) for each in value]
    return value


def _parsed(parse: Callable[[Any], Any], text: Any, known: type[ValueError]) -> Any:
    check_size(len(text))
    try:
        return written_out(parse(text)) if _may_need_it(text) else parse(text)
    except (known, UnicodeDecodeError):
        raise
    except ValueError as error:  # Python's own limit, against numbers that take minutes to read
        raise ValueError("a number in it has thousands of digits") from error
    except RecursionError as error:
        raise ValueError("it is nested too deep") from error


def _may_need_it(text: str | bytes) -> bool:
    """Whether a text may have other letters than those that are printed, as they are or escaped."""
    letters = text if isinstance(text, str) else text.decode("latin-1")
    return "\\" in letters or not letters.translate(_LINES).isprintable()


def _check_depth(value: Any, most: int = 32) -> None:
    """Refuse tables of tables of tables: keys with dots in them make some without brackets."""
    level = [value]
    for _ in range(most):
        inner = (x.values() if isinstance(x, dict) else x for x in level)
        level = [y for x in inner for y in x if isinstance(y, (dict, list))]
    if level:
        raise ValueError(f"it is nested more than {most} deep")
