"""From a robot.toml to a robot; `load` opens with the format, `entries` has what it may say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.files.text import parse_toml, read_text
from condyn_pin._core.names import few
from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.kinds import bind
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.violation import gap_of
from condyn_pin.errors import CondynError, InvalidModel
from condyn_pin.io.manifest.entries import FOR_SDF, check_card, contacts_of, loops_of, said
from condyn_pin.io.manifest.folders import description_file
from condyn_pin.io.manifest.postures import posture, srdf_postures
from condyn_pin.io.manifest.variants import chosen_card
from condyn_pin.io.mjcf import read_mjcf
from condyn_pin.io.sdf import read_sdf
from condyn_pin.io.urdf import check_root_joint, read_urdf
from condyn_pin.model.limits import Limits
from condyn_pin.model.lock import lock_joints
from condyn_pin.model.robot import Robot
from condyn_pin.model.spring import Spring

_UNKNOWN = "unknown"


def read_card(path: Path, variant: Mapping[str, str]) -> Robot:
    """Return the robot of a robot.toml."""
    try:
        card = parse_toml(read_text(path))
    except (OSError, ValueError) as error:
        raise InvalidModel(f"{path}: {error}") from error
    try:
        return _robot(chosen_card(card, variant), path.parent)
    except CondynError as error:
        raise said(str(path), error) from error


def read_alone(path: Path, root_joint: str) -> Robot:
    """Return the robot of a description that no robot.toml describes."""
    fields, _ = _read(path, {}, root_joint, ())
    try:
        robot = Robot(path.stem, source=str(path), description=str(path), **fields)
        for loop in robot.loops:
            bind(robot, [loop])
        return _with_notices(robot, path)
    except CondynError as error:
        raise said(str(path), error) from error


def _robot(card: Mapping[str, Any], folder: Path) -> Robot:
    check_card(card)
    description = card["description"]
    file = description_file(description["file"], folder)
    root_joint = description.get("root_joint", "fixed")
    check_root_joint(root_joint)
    fields, inverted = _read(file, description, root_joint, card.get("actuated", ()))
    postures = {}
    if "srdf" in description:
        srdf = description_file(description["srdf"], folder)
        rotors = description.get("rotors", False)
        postures = srdf_postures(fields["model"], srdf, rotors, inverted)
    for name, values in card.get("postures", {}).items():
        postures[name] = posture(fields["model"], values, f"postures.{name}")
    drawn = fields.get("postures", {})  # by an MJCF; they come last, and the card's own win
    fields["postures"] = {**postures, **drawn, **postures}
    own = loops_of(card.get("loops", ()))
    ends = {_ends(loop) for loop in own}
    fields["loops"] = (*(loop for loop in fields["loops"] if _ends(loop) not in ends), *own)
    fields["contacts"] = contacts_of(card.get("contacts", ()))
    if "actuated" in card:
        fields["actuated"] = tuple(card["actuated"])
    source, licence = (card.get(key, _UNKNOWN) for key in ("source", "licence"))
    origin = {"source": source, "licence": licence, "description": str(file)}
    robot = Robot(card["name"], **origin, **fields)
    for i, table in enumerate(card.get("frames", ())):
        try:
            robot = robot.with_frame(**table)
        except CondynError as error:
            raise said(f"frames[{i}]", error) from error
    _check_constraints(robot, own)
    return _with_notices(lock_joints(robot, description.get("lock", ())), file)


def _read(
    file: Path, description: Mapping[str, Any], root_joint: str, actuated: Sequence[str]
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return what a file says, as fields of a Robot, and the joints that it has reversed."""
    if file.suffix == ".xml":
        return dict(vars(read_mjcf(file))), ()
    if file.suffix != ".sdf":
        mimic = description.get("mimic", True)
        return dict(vars(read_urdf(file, root_joint, mimic=mimic))), ()
    options = {key: description[key] for key in FOR_SDF if key in description}
    if root_joint == "free_flyer":
        options["root_joint"] = pin.JointModelFreeFlyer()
    sdf = read_sdf(file, actuated=actuated, **options)
    closures = [Loop(c.frame_a, c.frame_b, c.kind, name=c.name) for c in sdf.closures]  # type: ignore[arg-type]
    fields = {
        "model": sdf.model,
        "loops": (*closures, *sdf.couplings),
        "springs": tuple(Spring(joint, k, ref) for joint, (k, ref) in sdf.springs.items()),
        "unused": sdf.unused,
    }
    return fields, sdf.reversed


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
        try:
            bind(robot, before)
        except CondynError as error:
            raise said(where, error) from error


def _with_notices(robot: Robot, file: Path) -> Robot:
    """Return the robot, its open loops and its locked joints among what it says of itself."""
    said = [*_locked(robot)]
    if file.suffix != ".xml":  # whose reader says it, at the pose that the file draws
        said += _gaps(robot)
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
            "them, unless within_limits=False; fix them, or give them a range"
        )


def _gaps(robot: Robot) -> Iterator[str]:
    """Say which loops are open at the first posture, or where the file draws the model."""
    if not robot.loops:
        return
    name, q = next(iter(robot.postures.items()), ("", pin.neutral(robot.model)))
    where = f"at the posture {name!r}" if name else "where the file draws the model"
    bounds = bind(robot, robot.loops)
    violation = Equations(robot.model, bounds).violation(np.array(q))
    for bound in bounds:
        gap = gap_of(robot.model, bound, violation[bound.rows])
        if gap.size > tolerances.DRAWN:
            yield f"loop {bound.name!r} is open by {gap} {where}: Scene.state closes it"


def _ends(loop: Constraint) -> frozenset[str]:
    """Return what it ties; joints are no frames of the same names."""
    return frozenset({*loop.joints, "joints"} if loop.joints else loop.frames)
