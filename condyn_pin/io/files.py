"""Where descriptions are: robots that come with the package, and what a robot.toml names."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import condyn_pin
from condyn_pin.errors import InvalidArgument, InvalidModel, MissingExtra

ROOT_JOINTS = ("fixed", "free_flyer")


def check_root_joint(root_joint: str) -> None:
    """Refuse a way to attach the root link that is not known."""
    if root_joint not in ROOT_JOINTS:
        raise InvalidArgument(
            f"root_joint = {root_joint!r}: one of {', '.join(ROOT_JOINTS)} is needed"
        )


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
