"""Folders: where robots and their descriptions are."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import condyn_pin
from condyn_pin.errors import InvalidModel, MissingExtra


def robots_folder() -> Path:
    """Return the folder of robots: inside the installed package, or beside it in a checkout."""
    package = Path(condyn_pin.__file__).parent
    packed = package / "robots"
    return packed if packed.is_dir() else package.parent / "robots"


def example_robot_data() -> Path:
    """Return the folder of robots that the package example-robot-data installed."""
    try:
        package = metadata.distribution("example-robot-data")
    except metadata.PackageNotFoundError as error:
        raise MissingExtra(
            "the robot descriptions are missing: python -m pip install example-robot-data"
        ) from error
    return Path(str(package.locate_file("cmeel.prefix/share/example-robot-data/robots")))


def description_file(name: str, folder: Path) -> Path:
    """Return a file that a robot.toml names: beside it, or in example-robot-data."""
    beside = folder / name
    try:
        if beside.is_file():
            return beside
        packed = example_robot_data() / name
        if packed.is_file():
            return packed
    except OSError as error:
        raise InvalidModel(f"file {name[:80]!r}: {error.strerror}") from error
    raise InvalidModel(f"no file {name!r}: neither {beside} nor {packed} is one")
