"""Description: the content of a robot's file in any format, and the folders of descriptions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from warnings import warn

from condyn_pin._core.arguments import check_type
from condyn_pin.errors import (
    InvalidArgument,
    InvalidModel,
    UnmodelledWarning,
    unknown_name,
)
from condyn_pin.io.description import (
    check_root_joint,
    example_robot_data,
    robots_folder,
)
from condyn_pin.model.mechanisms import MECHANISMS
from condyn_pin.model.robot import Robot

__all__ = ["available_robots", "example_robot_data", "load_robot", "robots_folder"]

_ROOTED = (".urdf", ".sdf")  # formats that leave it open how the root link is attached


def available_robots() -> dict[str, Callable[[], Robot]]:
    """Return the robots that `load_robot` finds by name: robot.toml folders, and mechanisms.

    Returns
    -------
    dict of str to callable
        Called without arguments, each loads its `Robot`.
    """
    folders = sorted(path.parent for path in robots_folder().glob("*/robot.toml"))
    configs = {folder.name: partial(_read_config, folder / "robot.toml", {}) for folder in folders}
    return configs | MECHANISMS


def load_robot(
    name: str | Path,
    *,
    floating: bool | None = None,
    root_joint: str | None = None,
    model: str | Sequence[str] | None = None,
    variant: Mapping[str, str] | None = None,
    precision: float | None = None,
    actuated: Sequence[str] | None = None,
    package_dirs: Sequence[str | Path] = (),
) -> Robot:
    """Load a robot by its name, or from a URDF, SDF, MJCF or robot.toml.

    Parameters
    ----------
    name : str or Path
        A name that `condyn robots` lists, or one of the package `robot_descriptions`, if that is
        installed; the text of a URDF, from ``<robot`` on; or a path: of a URDF, of an SDF, of an
        MJCF (.xml), of a folder with a robot.toml, or of such a file, whatever it is called.
    floating : bool, optional
        For a URDF or an SDF: whether its root link floats; it is fixed to the world by default.
        Named robots and folders say it themselves.
    root_joint : {"fixed", "free_flyer"}, optional
        The same in the words of robot.toml.
    model : str or sequence of str, optional
        For an SDF: the <model> of the file; by default the only one that is not static. Several,
        ``model=["arm", "table"]``, are one robot, with the joints of the world between them.
    variant : mapping of str to str, optional
        Option to value, such as ``{"springs": "locked"}``, for a robot whose robot.toml has
        variants; each option that is left out has its default.
    precision : float, optional
        `Robot.precision`: how right the numbers of the file are [rad, sizes of a loop]. By default
        what a robot.toml says, or 1e-5, as five digits are: 1.5708 for pi/2 is off by 3.7e-6. 0
        takes them at their word.
    actuated : sequence of str, optional
        The joints with a motor, and no others; by default the motors that the file names.
    package_dirs : sequence of str or Path, optional
        Folders in which ``package://`` of the file leads to meshes, before those beside the file
        and above it, and those of ROS_PACKAGE_PATH. Meshes are drawn; the dynamics need none.

    Returns
    -------
    Robot

    Raises
    ------
    UnknownName
        If there is no such robot, model or variant; the text lists the nearest names.
    InvalidArgument
        If `root_joint` is unknown or contradicts `floating`, one of them is given for what is
        neither a URDF nor an SDF, `model` for what is no SDF, or `precision` is no number from 0 to
        1e-3.
    MissingExtra
        If the package with the description is not installed.
    InvalidModel
        If a file cannot be read; the text names the file and the element.

    Warns
    -----
    UnmodelledWarning
        If the file has what changes the motion and is not in the model: `Robot.unmodelled`.
    """
    robot = _cached_robot(name, _root_joint(floating, root_joint), model, variant)
    if actuated is not None:
        robot = replace(robot, actuated=actuated, coupled_motors=())
    changes: dict[str, Any] = {"precision": precision}
    if package_dirs:
        if isinstance(package_dirs, (str, Path)) or not all(Path(d).is_dir() for d in package_dirs):
            raise InvalidArgument(f"package_dirs = {package_dirs!r}: a list of folders is needed")
        changes["package_dirs"] = [str(folder) for folder in package_dirs]
    if changes := {key: value for key, value in changes.items() if value is not None}:
        robot = replace(robot, **changes)
    if robot.unmodelled:
        said = "; ".join(robot.unmodelled)
        text = f"{robot.name}: changes the motion, and is not modelled: {said}"
        warn(text, UnmodelledWarning, stacklevel=2)
    return robot


def _root_joint(floating: bool | None, root_joint: str | None) -> str | None:
    """Type of the root joint as in robot.toml, from `floating` or `root_joint`."""
    if floating is None:
        return root_joint
    check_type("floating", floating, bool, "True or False is needed")
    said = "free_flyer" if floating else "fixed"
    if root_joint not in (None, said):
        raise InvalidArgument(f"floating = {floating}: root_joint = {root_joint!r} contradicts it")
    return said


def _cached_robot(
    name: str | Path,
    root_joint: str | None,
    model: str | Sequence[str] | None,
    variant: Mapping[str, str] | None,
) -> Robot:
    # what reads files is imported when there is one to read: mechanisms need none of it
    from condyn_pin.io.robot_toml import check_variant

    check_type("name", name, (str, Path), "a name or a path is needed")
    if root_joint is not None:
        check_root_joint(root_joint)
    known, chosen = available_robots(), {} if variant is None else variant
    if isinstance(name, str) and name.lstrip().startswith("<"):
        from condyn_pin.io.robot_toml import read_alone

        check_variant(chosen, {})
        _check_model(model, "the text of a URDF", False)
        return read_alone(name, root_joint or "fixed")
    path = _path(name)
    described = None if str(name) in known or path.exists() else _named_description(str(name))
    plain = path.suffix in _ROOTED or (path.suffix == ".xml" and root_joint is None)
    if str(name) not in known and plain and not path.is_dir():
        from condyn_pin.io.robot_toml import read_alone

        check_variant(chosen, {})
        _check_model(model, name, path.suffix == ".sdf")
        return read_alone(path, root_joint or "fixed", model)
    _check_model(model, name, False)
    if described is not None:
        return _cached_robot(described, root_joint, None, variant)
    if root_joint is not None:
        raise InvalidArgument(
            f"root_joint = {root_joint!r}: it is for a URDF or an SDF; {str(name)!r} says itself "
            "how its base is attached; load_robot(robot.description, floating=True) loads its file "
            "alone"
        )
    if str(name) in MECHANISMS:
        check_variant(chosen, {})
        return MECHANISMS[str(name)]()
    config = robots_folder() / str(name) if str(name) in known else path
    if not (config.suffix == ".toml" and config.is_file()):
        config = config / "robot.toml"
    if config.is_file():
        return _read_config(config, chosen)
    if path.suffix == ".xacro":
        raise InvalidModel(
            f"{path}: a .xacro makes a URDF: expand it with `xacro {path.name} > robot.urdf`"
        )
    if path.suffix or path.exists():
        raise InvalidModel(
            f"{path}: a .urdf, an .sdf or an .xml with an MJCF is needed, or a folder with a "
            "robot.toml"
        )
    raise unknown_name("robot", str(name), known)


def _named_description(name: str) -> Path | None:
    """Path of a named description of the package `robot_descriptions`; None if it has none."""
    if not name.endswith("_description") or find_spec("robot_descriptions") is None:
        return None
    if not name.isidentifier() or find_spec(f"robot_descriptions.{name}") is None:
        return None
    found = import_module(f"robot_descriptions.{name}")
    paths = (getattr(found, key, None) for key in ("URDF_PATH", "MJCF_PATH"))
    return next((Path(path) for path in paths if path), None)


def _check_model(model: Any, name: str | Path, sdf: bool) -> None:
    names = [model] if isinstance(model, str) else model
    known = isinstance(names, Sequence) and names and all(isinstance(each, str) for each in names)
    if model is not None and not (sdf and known):
        raise InvalidArgument(
            f"model = {model!r}: the name of a <model> of an SDF; {str(name)!r} "
            + ("has them by name" if sdf else "is none, leave it out")
        )


def _read_config(path: Path, variant: Mapping[str, str]) -> Robot:
    from condyn_pin.io.robot_toml import read_config

    return read_config(path, variant)


def _path(name: str | Path) -> Path:
    """Path of a name, whether or not it exists."""
    try:
        path = Path(name).expanduser()
        path.exists()
    except (OSError, RuntimeError) as error:  # too long, or of a user that does not exist
        raise InvalidArgument(f"name = {str(name)[:80]!r}: no name and no path: {error}") from error
    return path
