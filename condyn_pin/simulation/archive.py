"""Archives: npz files with a header in JSON, and a robot. Nothing in them is executed."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from condyn_pin._pin import VERSION_TEXT, pin
from condyn_pin.errors import InvalidArgument
from condyn_pin.robot import Robot
from condyn_pin.simulation.coding import decode, encode, plain

Path_ = str | PathLike[str]
Header = dict[str, Any]
Content = dict[str, NDArray[Any]]
Result = TypeVar("Result")

MOTION: Final = "condyn_pin trajectory 1"
MOTIONS: Final = "condyn_pin batch trajectory 1"

# What reads and what writes each.
_READERS: Final = {
    MOTION: "Trajectory.load reads it",
    MOTIONS: "BatchTrajectory.load reads it, and `condyn view --motion 0`",
}
_WRITERS: Final = {
    MOTION: "Trajectory.save and `condyn simulate --save` write one",
    MOTIONS: "BatchTrajectory.save writes one",
}
_TITLES: Final = {MOTION: "a trajectory", MOTIONS: "a batch of motions"}

_LISTS = ("loops", "contacts", "springs", "spring_dampers")
_WORDS = ("name", "actuated", "unused", "source", "licence", "description")
_POSTURE = "posture "


def write(
    path: Path_, kind: str, robot: Robot, header: Header, arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write a file of a kind: what is no array, in words and numbers, and arrays."""
    about = {key: getattr(robot, key) for key in _WORDS}
    about |= {key: [encode(c) for c in getattr(robot, key)] for key in _LISTS}
    header = {"format": kind, "pinocchio": VERSION_TEXT, "robot": about, **header}
    content = {
        "header": np.array(json.dumps(header, default=plain)),
        "model": np.array(robot.model.saveToString()),
        **arrays,
        **{f"{_POSTURE}{name}": q for name, q in robot.postures.items()},
    }
    with Path(path).open("wb") as file:  # a name without .npz stays as it is
        # compressed, Cassie's motions take three quarters of the space and forty times the time
        np.savez(file, allow_pickle=False, **content)


def read(path: Path_, kind: str, make: Callable[[Robot, Header, Content], Result]) -> Result:
    """Return what is made of a file of a kind.

    Raises
    ------
    InvalidArgument
        If the file is missing, is of another kind or Pinocchio, or nothing can be made of it.
    """
    no_file = f"{path}: no file of {_TITLES[kind]}"
    try:
        # numpy leaves a file open that is no archive
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
    except OSError as error:
        raise InvalidArgument(f"{no_file} ({error.strerror})") from error
    except Exception as error:  # numpy and zipfile raise whatever a damaged byte makes them
        raise InvalidArgument(
            f"{no_file} ({type(error).__name__} on reading it); {_WRITERS[kind]}"
        ) from error
    try:
        header = json.loads(str(content["header"]))
        written_by = header["pinocchio"]
        if header["format"] != kind:
            reader = _READERS.get(header["format"], "nothing here reads it")
            raise ValueError(f"{header['format']}: {reader}")
        if _series(written_by) == _series(VERSION_TEXT):
            return make(_robot(header["robot"], content), header, content)
    except (LookupError, AttributeError, TypeError, ValueError, RuntimeError) as error:
        raise InvalidArgument(f"{no_file} ({error!r})") from error
    # not tried: Pinocchio 4.1 crashes on a model that 3.9 wrote
    raise InvalidArgument(
        f"{path}: its model was written by Pinocchio {written_by}, and {VERSION_TEXT} is "
        "installed; use the same one, or Trajectory.to_csv"
    )


def _series(version: str) -> list[str]:
    """Return major and minor number of a version."""
    return version.split(".")[:2]


def _robot(about: dict[str, Any], content: Content) -> Robot:
    model = pin.Model()
    model.loadFromString(str(content["model"]))
    # files from before there were spring-dampers have none
    lists: dict[str, Any] = {key: [decode(c) for c in about.get(key, [])] for key in _LISTS}
    words: dict[str, Any] = {key: about[key] for key in _WORDS}
    postures = {k.removeprefix(_POSTURE): q for k, q in content.items() if k.startswith(_POSTURE)}
    return Robot(model=model, postures=postures, **lists, **words)
