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
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from condyn_pin._core.files import check_writable, parse_json, read_text, write_text
from condyn_pin._core.timing import machine
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.study.tables import FORMAT, Record

_FITS: Final = ("processor", "system", "pinocchio", "condyn_pin", "numpy")


@dataclass(frozen=True)
class Plan(Record):
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

    unknown: ClassVar[float | None] = None  # every number is known

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


def fingerprint(scene: Scene) -> str:
    """Return 64 hexadecimal digits, the same for the same content, in every process; takes 1 ms.

    sha256 of the model as Pinocchio writes it, the constraints, the motors, the springs and the
    nominal posture: what accelerations and motions depend on, and what states are drawn from.
    """
    robot = scene.robot
    robot.check_unedited()
    nominal = np.ascontiguousarray(described_posture(scene), dtype="<f8")
    named: tuple[object, ...] = (scene.constraints, tuple(robot.actuated), robot.springs)
    if robot.spring_dampers:  # those of scenes without stay as they were
        named += (robot.spring_dampers,)
    if scene.contacts:
        named += (scene.contacts,)
    parts = (robot.model.saveToString(), *map(repr, named))
    digest = hashlib.sha256()
    for part in (*(text.encode() for text in parts), nominal.tobytes()):
        digest.update(len(part).to_bytes(8, "little"))  # so that parts cannot run together
        digest.update(part)
    return digest.hexdigest()


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


def keep(plan: Plan) -> None:
    """Write a plan, at once and whole: another process reads the old one or the new one."""
    path = path_of(plan.fingerprint, plan.measure, plan.error)
    text = json.dumps({"format": FORMAT} | plan.as_dict(), indent=1, allow_nan=False)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text + "\n")
    except OSError as error:
        raise _no_place(f"{path.parent}: cannot be made: {error.strerror}") from error
    except InvalidArgument as error:
        raise _no_place(str(error)) from error


def check_folder() -> None:
    """Raise InvalidArgument if no plan could be kept; what takes half a minute asks first."""
    there = next(path for path in (folder(), *folder().parents) if path.exists())
    try:
        check_writable(there / "plan.json")
    except InvalidArgument as error:
        raise _no_place(str(error)) from error


def _no_place(why: str) -> InvalidArgument:
    return InvalidArgument(
        f"the plan cannot be saved: {why}; set XDG_CACHE_HOME to a folder that can be written to, "
        "or pass save=False"
    )


def read(path: Path) -> Plan:
    """Return the plan in a file; InvalidArgument if it is cut off, edited, or of another format."""
    try:
        saved = parse_json(read_text(path))
        if saved.pop("format") != FORMAT:
            raise ValueError("another format")
        return Plan.from_dict(saved)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InvalidArgument(f"{path}: not a plan ({error})") from error


def plans_of(fingerprint: str) -> tuple[Plan, ...]:
    """Return the plans that exist for a scene, of every machine; broken files are left out."""
    found = []
    for path in sorted((folder() / fingerprint[:32]).glob("*.json")):
        try:
            found.append(read(path))
        except InvalidArgument:
            continue
    return tuple(found)
