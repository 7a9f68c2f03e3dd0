"""Plan: a solver that was chosen by measurement, kept for the machine that it was measured on.

A plan is a small json file. Its name says for what it holds: scene, measure and error, processor,
and the versions of this library, of Pinocchio and of numpy. Whoever changes one of them finds no
plan, and is told so; a plan of another machine is never used.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from dataclasses import asdict, dataclass, fields
from math import inf
from pathlib import Path
from typing import Any, Final

from condyn_pin._core.files.beside import check_writable, write_text
from condyn_pin._core.files.text import parse_json, read_text
from condyn_pin._core.machine import machine
from condyn_pin.errors import InvalidArgument

FORMAT: Final = 1
_FITS: Final = ("processor", "system", "pinocchio", "condyn_pin", "numpy")


@dataclass(frozen=True)
class Plan:
    """What a study chose.

    Attributes
    ----------
    fingerprint : str
        Of the scene.
    measure : str
    error : float
        What was asked for, relative.
    solver : str
        Class of the solver.
    parameters : dict
        Its parameters by name.
    median_us : float
        What it took [us].
    found, expected : float
        The worst error at the fresh states, and what is expected over a hundred times as many.
    states : int
        How many there were.
    where : dict of str to str
        Processor, system and versions.
    date : str
    """

    fingerprint: str
    measure: str
    error: float
    solver: str
    parameters: dict[str, Any]
    median_us: float
    found: float
    expected: float
    states: int
    where: dict[str, str]
    date: str


def here() -> dict[str, str]:
    """Return what a plan is only good for: this processor, this system, these versions."""
    found = machine()
    return {key: found[key] for key in _FITS}


def folder() -> Path:
    """Return where plans are kept: in the user's cache, ``$XDG_CACHE_HOME`` where that is set."""
    home = Path.home()
    if os.environ.get("XDG_CACHE_HOME"):
        cache = Path(os.environ["XDG_CACHE_HOME"])
    elif sys.platform == "darwin":
        cache = home / "Library" / "Caches"
    elif sys.platform == "win32":
        cache = Path(os.environ.get("LOCALAPPDATA", home / "AppData" / "Local"))
    else:
        cache = home / ".cache"
    return cache / "condyn_pin" / "plans"


def path_of(fingerprint: str, measure: str, error: float) -> Path:
    """Return the file of a plan for this machine; it need not exist."""
    key = json.dumps([measure, float(error), here()])
    return folder() / fingerprint[:32] / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.json"


def keep(plan: Plan) -> Path:
    """Write a plan, at once and whole: another process reads the old one or the new one."""
    path = path_of(plan.fingerprint, plan.measure, plan.error)
    text = json.dumps({"format": FORMAT} | asdict(plan), indent=1, allow_nan=False)
    try:
        _make(path.parent)
        write_text(path, text + "\n")
    except InvalidArgument as error:
        raise _no_place(error) from error
    return path


def check_folder() -> None:
    """Raise InvalidArgument if no plan could be kept; what takes half a minute asks first."""
    there = next(path for path in (folder(), *folder().parents) if path.exists())
    try:
        check_writable(there / "plan.json")
    except InvalidArgument as error:
        raise _no_place(error) from error


def _make(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidArgument(f"{path}: cannot be made: {error.strerror}") from error


def _no_place(error: InvalidArgument) -> InvalidArgument:
    return InvalidArgument(
        f"the plan has no place: {error}; set XDG_CACHE_HOME to a folder that can be written to, "
        "or pass save=False"
    )


def read(path: Path) -> Plan:
    """Return the plan in a file.

    Raises
    ------
    InvalidArgument
        If it is not one: cut off, edited, or of another format.
    """
    try:
        saved = parse_json(read_text(path))
        if saved.pop("format") != FORMAT:
            raise ValueError("another format")
        if set(saved) != {field.name for field in fields(Plan)}:
            raise ValueError("fields are missing, or unknown")
        for field in fields(Plan):
            _check_kind(field.name, str(field.type), saved[field.name])
        return Plan(**saved)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InvalidArgument(f"{path}: not a plan ({error})") from error


def _check_kind(name: str, kind: str, value: Any) -> None:
    """Refuse what is no text, number or table where a plan has one."""
    kinds: Any = {"str": str, "int": int, "float": (int, float)}.get(kind, dict)
    if not isinstance(value, kinds) or (kind == "float" and not 0 <= value < inf):
        raise ValueError(f"{name} = {value!r}")


def plans_of(fingerprint: str) -> tuple[Plan, ...]:
    """Return the plans that exist for a scene, of every machine; broken files are left out."""
    found = []
    for path in sorted((folder() / fingerprint[:32]).glob("*.json")):
        try:
            found.append(read(path))
        except InvalidArgument:
            continue
    return tuple(found)
