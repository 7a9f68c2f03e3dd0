"""Entries of a robot.toml: which there are, and what each has to be.

What is wrong is said in the words of the file: the entry, its value, and what would do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any, Final, TypeVar

from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.kinds import Loop, worded
from condyn_pin.errors import CondynError, InvalidModel, unknown_name

Made = TypeVar("Made")
Table = Mapping[str, Any]
Check = tuple[Callable[[Any], bool], str]


def _is_list(kind: type) -> Callable[[Any], bool]:
    return lambda x: isinstance(x, list) and all(isinstance(entry, kind) for entry in x)


_TEXT: Final[Check] = (lambda x: isinstance(x, str), "a text")
_TEXTS: Final[Check] = (_is_list(str), "a list of texts")
_TRUTH: Final[Check] = (lambda x: isinstance(x, bool), "true or false")
_TABLE: Final[Check] = (lambda x: isinstance(x, dict), "a table")
_TABLES: Final[Check] = (_is_list(dict), "a list of tables")

_CARD: Final[Mapping[str, Check]] = {
    "name": _TEXT, "source": _TEXT, "licence": _TEXT, "actuated": _TEXTS, "description": _TABLE,
    "frames": _TABLES, "loops": _TABLES, "contacts": _TABLES, "postures": _TABLE,
}  # fmt: skip
FOR_SDF: Final[Mapping[str, Check]] = {
    "root": _TEXT, "kinds": _TABLE, "drop": _TEXTS, "cut": _TEXTS, "as_file": _TRUTH,
}  # fmt: skip
_DESCRIPTION: Final[Mapping[str, Check]] = {
    "file": _TEXT, "srdf": _TEXT, "root_joint": _TEXT, "rotors": _TRUTH, "lock": _TEXTS,
    "mimic": _TRUTH, **FOR_SDF,
}  # fmt: skip
_FRAME: Final = ("name", "parent", "translation", "rotation")


def check_card(card: Table) -> None:
    """Refuse entries that no card has, and values that are not what their entry needs."""
    for key in ("name", "description"):
        if key not in card:
            raise InvalidModel(f"the entry {key!r} is missing")
    _check_table("", card, _CARD)
    description = card["description"]
    if "file" not in description:
        raise InvalidModel("the entry description.file is missing")
    _check_table("description.", description, _DESCRIPTION)
    for name, values in card.get("postures", {}).items():
        _check("postures.", name, values, _TABLE)
    for i, frame in enumerate(card.get("frames", ())):
        _check_names(f"frames[{i}]", frame, _FRAME, _FRAME[:3])
    _check_file(description)


def _check_file(description: Table) -> None:
    """Refuse entries that belong to another format than that of the file."""
    file = description["file"]
    if not file.endswith(".sdf"):
        for key in FOR_SDF:
            if key in description:
                raise InvalidModel(f"the entry description.{key} is for an SDF, not for {file!r}")
    if "mimic" in description and not file.endswith(".urdf"):
        raise InvalidModel("the entry description.mimic is for a URDF")
    if "root_joint" in description and file.endswith(".xml"):
        raise InvalidModel("the entry description.root_joint is for others: an MJCF says it itself")


def loops_of(tables: Sequence[Table]) -> tuple[Constraint, ...]:
    """Return the loops that a card lists: a kind without a word of its own is one of `Loop`."""
    made: list[Constraint] = []
    known = worded(closes=True)
    for i, table in enumerate(tables):
        kind = table.get("kind")
        if isinstance(kind, str) and kind in known:
            rest = {key: value for key, value in table.items() if key != "kind"}
            made.append(_made(known[kind], rest, f"loops[{i}]"))
        else:
            made.append(_made(Loop, table, f"loops[{i}]"))
    return tuple(made)


def contacts_of(tables: Sequence[Table]) -> tuple[Constraint, ...]:
    """Return the contacts that a card lists."""
    made: list[Constraint] = []
    known = worded(closes=False)
    for i, table in enumerate(tables):
        where = f"contacts[{i}]"
        kind = table.get("kind")
        if kind is None:
            raise InvalidModel(f"{where}: the entry 'kind' is missing: one of {', '.join(known)}")
        if not isinstance(kind, str) or kind not in known:
            raise InvalidModel(f"{where}: {unknown_name('kind of contact', str(kind), known)}")
        rest = {key: value for key, value in table.items() if key != "kind"}
        made.append(_made(known[kind], rest, where))
    return tuple(made)


def said(where: str, error: CondynError) -> CondynError:
    """Return an error with the place in the file before its text."""
    error.args = (f"{where}: {error}", *error.args[1:])
    return error


def _made(kind: Callable[..., Made], table: Table, where: str) -> Made:
    """Return the value whose fields a table gives."""
    known = fields(kind)  # type: ignore[arg-type]
    needed = [f.name for f in known if f.default is MISSING and f.default_factory is MISSING]
    _check_names(where, table, [f.name for f in known], needed)
    try:
        return kind(**table)
    except CondynError as error:
        raise said(where, error) from error


def _check_names(where: str, table: Table, known: Sequence[str], needed: Sequence[str]) -> None:
    for key in table:
        if key not in known:
            raise InvalidModel(f"{where}: {unknown_name('entry', key, known)}")
    for key in needed:
        if key not in table:
            raise InvalidModel(f"{where}: the entry {key!r} is missing")


def _check_table(where: str, table: Table, known: Mapping[str, Check]) -> None:
    for key, value in table.items():
        if key not in known:
            raise InvalidModel(str(unknown_name("entry", f"{where}{key}", known)))
        _check(where, key, value, known[key])


def _check(where: str, key: str, value: Any, check: Check) -> None:
    fits, needed = check
    if not fits(value):
        raise InvalidModel(f"the entry {where}{key} = {value!r}: {needed} is needed")
