"""From a robot.toml to a robot; `load` opens with the format, `config` has what it may say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.files.text import parse_toml, read_text
from condyn_pin._core.names import few
from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.kinds import bind
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.violation import gap_of
from condyn_pin.errors import InvalidModel, UnknownName
from condyn_pin.io.config import FOR_SDF, check_config, chosen_config, contacts_of, loops_of
from condyn_pin.io.description import Description
from condyn_pin.io.files import check_root_joint, description_file
from condyn_pin.io.xml import place
from condyn_pin.model.limits import Limits
from condyn_pin.model.lock import lock_joints
from condyn_pin.model.robot import Robot
from condyn_pin.model.robot_joints import with_values

_UNKNOWN = "unknown"


def read_config(path: Path, variant: Mapping[str, str]) -> Robot:
    """Return the robot of a robot.toml."""
    with place(path):
        try:
            config = parse_toml(read_text(path))
        except (OSError, ValueError) as error:
            raise InvalidModel(str(error)) from error
        return _robot(chosen_config(config, variant), path.parent)


def read_alone(source: Path | str, root_joint: str, model: str | None = None) -> Robot:
    """Return the robot of a description that no robot.toml describes: a file, or a URDF's text."""
    if isinstance(source, Path):
        about = {} if model is None else {"model": model}
        read, where = _read(source, about, root_joint, ()), str(source)
        of_file = {"source": where, "description": where}
    else:
        from condyn_pin.io.urdf import read_urdf

        read, where, of_file = read_urdf(source, root_joint), "the text of a URDF", {}
    with place(where):
        fields = _fields(read) | of_file | {"precision": tolerances.WRITTEN_GEOMETRY}
        fields["name"] = read.name or (source.stem if isinstance(source, Path) else "robot")
        robot = Robot(**fields)
        for loop in robot.loops:
            bind(robot, [loop])
        return _with_notices(robot)


def _robot(config: Mapping[str, Any], folder: Path) -> Robot:
    check_config(config)
    description = config["description"]
    file = description_file(description["file"], folder)
    root_joint = description.get("root_joint", "fixed")
    check_root_joint(root_joint)
    read = _read(file, description, root_joint, config.get("actuated", ()))
    own = loops_of(config.get("loops", ()))
    ends = {_ends(loop) for loop in own}
    robot = Robot(
        **_fields(read)
        | {
            "name": config["name"],
            "postures": _postures(config, folder, read),
            "loops": (*(loop for loop in read.loops if _ends(loop) not in ends), *own),
            "contacts": contacts_of(config.get("contacts", ())),
            "actuated": tuple(config.get("actuated", read.actuated)),
            "source": config.get("source", _UNKNOWN),
            "licence": config.get("licence", _UNKNOWN),
            "description": str(file),
            "precision": config.get("precision", tolerances.WRITTEN_GEOMETRY),
        },
    )
    for i, table in enumerate(config.get("frames", ())):
        with place(f"frames[{i}]"):
            robot = robot.with_frame(**table)
    _check_constraints(robot, own)
    return _with_notices(lock_joints(robot, description.get("lock", ())))


def _read(
    file: Path, description: Mapping[str, Any], root_joint: str, actuated: Sequence[str]
) -> Description:
    """Return what a file says; the reader of its format is imported when there is one to read."""
    if file.suffix == ".xml":
        from condyn_pin.io.mjcf import read_mjcf

        return read_mjcf(file)
    if file.suffix != ".sdf":
        from condyn_pin.io.urdf import read_urdf

        return read_urdf(file, root_joint, mimic=description.get("mimic", True))
    from condyn_pin.io.sdf import read_sdf

    options = {key: description[key] for key in FOR_SDF if key in description}
    if root_joint == "free_flyer":
        options["root_joint"] = pin.JointModelFreeFlyer()
    read = read_sdf(file, actuated=actuated, **options)
    if read.model.nv == 0:
        raise InvalidModel(
            f"{file}: the model has no degree of freedom: no joint moves, and the root link is "
            'fixed; floating=True, in a robot.toml root_joint = "free_flyer", lets it float'
        )
    return read


def _fields(read: Description) -> dict[str, Any]:
    """Return the fields of a Robot."""
    return {key: value for key, value in vars(read).items() if key != "reversed"}


def _postures(config: Mapping[str, Any], folder: Path, read: Description) -> dict[str, Array]:
    """Return the postures of the SRDF, of the config, and of an MJCF, which come last."""
    found, description = {}, config["description"]
    if "srdf" in description:
        from condyn_pin.io.srdf import read_srdf

        srdf = description_file(description["srdf"], folder)
        rotors = description.get("rotors", False)
        found = read_srdf(read.model, srdf, rotors=rotors, inverted=read.reversed)
    for name, values in config.get("postures", {}).items():
        found[name] = _posture(read.model, values, f"postures.{name}")
    return {**found, **read.postures, **found}


def _posture(model: Any, values: Mapping[str, Any], where: str) -> Array:
    """Return the configuration with these values by joint, and neutral otherwise."""
    try:
        return with_values(model, np.array(pin.neutral(model)), values, f"{where}: ")
    except UnknownName as error:
        raise UnknownName(f"{where}: {error}") from error


def _check_constraints(robot: Robot, own: Sequence[Constraint]) -> None:
    """Refuse loops and contacts that do not fit the robot, now and not when a scene is made."""
    first = len(robot.loops) - len(own)
    places: list[tuple[str, Constraint]] = [
        *((f"loop {loop.name!r} of the description", loop) for loop in robot.loops[:first]),
        *((f"loops[{i}]", loop) for i, loop in enumerate(own)),
        *((f"contacts[{i}]", contact) for i, contact in enumerate(robot.contacts)),
    ]
    before: list[Constraint] = []
    for where, constraint in places:
        before.append(constraint)
        with place(where):
            bind(robot, before)


def _with_notices(robot: Robot) -> Robot:
    """Return the robot, its open loops and its locked joints among what it says of itself."""
    said = [*_locked(robot), *_gaps(robot)]
    return replace(robot, unused=(*robot.unused, *said)) if said else robot


def _locked(robot: Robot) -> Iterator[str]:
    """Say which joints have limits without width."""
    limits = Limits.of(robot.model)
    names = [
        name
        for name, lower, upper in zip(limits.joints, limits.lower, limits.upper, strict=True)
        if lower == upper
    ]
    if names:
        yield (
            f"the lower limit is the upper one ({few(names)}): loops are closed without moving "
            "them, unless you pass within_limits=False; fix them, or give them a range"
        )


def _gaps(robot: Robot) -> Iterator[str]:
    """Say which loops are open at the first posture, or at the zero configuration of the file."""
    if not robot.loops:
        return
    name, q = next(iter(robot.postures.items()), ("", pin.neutral(robot.model)))
    where = f"at the posture {name!r}" if name else "at the zero configuration of the file"
    bounds = bind(robot, robot.loops)
    violation = Equations(robot.model, bounds).violation(np.array(q))
    for bound in bounds:
        gap = gap_of(robot.model, bound, violation[bound.rows])
        if gap.size > tolerances.DRAWN:
            yield f"loop {bound.name!r} is open by {gap} {where}: Scene.state closes it"


def _ends(loop: Constraint) -> frozenset[str]:
    """Return what it ties; joints are no frames of the same names."""
    return frozenset({*loop.joints, "joints"} if loop.joints else loop.frames)
