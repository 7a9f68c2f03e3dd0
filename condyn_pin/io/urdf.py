"""URDF: checked here, read by Pinocchio, closed by what authors write beside the tree.

Pinocchio gets a copy of the file with what was checked and nothing else: no meshes, no extensions,
numbers in one spelling. A URDF is a tree; two conventions close its loops:

    <mimic>                              q = multiplier q_other + offset, a `Coupling`
    links closing_NAME_1, closing_NAME_2 the two halves of a cut joint, as onshape-to-robot
                                         exports them and placo closes them: a ball `Loop`

The kind of the cut joint is not in the file. A ball is what placo's task for them holds, and it
never locks a joint that could turn, as a weld would; `robot.toml` can say another kind.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from condyn_pin._pin import pin
from condyn_pin.constraints import Coupling, Loop
from condyn_pin.errors import InvalidArgument, InvalidModel
from condyn_pin.io.urdf_check import checked, impossible_links
from condyn_pin.io.words import few

ROOT_JOINTS = ("fixed", "free_flyer")
_CLOSING = re.compile(r"(closing_.+)_([12])")


@dataclass(frozen=True)
class UrdfRobot:
    """What was read from a URDF; the fields are those of `Robot`."""

    model: Any
    loops: tuple[Loop | Coupling, ...]
    unused: tuple[str, ...]


def read_urdf(path: Path, root_joint: str = "fixed", *, mimic: bool = True) -> UrdfRobot:
    """Read a URDF.

    Parameters
    ----------
    path : Path
        The file. Meshes are not needed.
    root_joint : {"fixed", "free_flyer"}
        How the root link is attached to the world.
    mimic : bool
        Whether <mimic> makes couplings; else such joints move on their own.

    Returns
    -------
    UrdfRobot
        The model, its loops and couplings, and what the file has and the dynamics do not use.

    Raises
    ------
    InvalidModel
        If the file cannot be read; the text names the element.
    """
    check_root_joint(root_joint)
    if not path.is_file():
        raise InvalidModel(f"{path}: no such file")
    try:
        robot = ET.parse(path).getroot()
    except (ET.ParseError, OSError, ValueError, LookupError) as error:
        raise InvalidModel(f"{path}: not well-formed XML: {error}") from error
    try:
        if robot.tag != "robot":
            raise InvalidModel(f"its root element is <{robot.tag}>, a URDF has <robot>")
        copy = checked(robot, floating=root_joint == "free_flyer", mimic=mimic)
        loops: tuple[Loop | Coupling, ...] = (
            *(_couplings(robot) if mimic else ()),
            *_closings(robot),
        )
        model = _model(ET.tostring(copy, encoding="unicode"), root_joint)
        return UrdfRobot(model, loops, (*_unused(robot), *_doubts(robot, copy, mimic)))
    except InvalidModel as error:
        error.args = (f"{path}: {error}",)
        raise


def check_root_joint(root_joint: str) -> None:
    """Refuse a way to attach the root link that is not known."""
    if root_joint not in ROOT_JOINTS:
        raise InvalidArgument(
            f"root_joint = {root_joint!r}: one of {', '.join(ROOT_JOINTS)} is needed"
        )


def _model(text: str, root_joint: str) -> Any:
    try:
        if root_joint == "free_flyer":
            return pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
        return pin.buildModelFromXML(text)
    except (ValueError, RuntimeError) as error:
        raise InvalidModel(f"Pinocchio cannot read it: {error}") from error


def _couplings(robot: ET.Element) -> Iterator[Coupling]:
    for joint in _mimicking(robot):
        mimic = joint.find("mimic")
        assert mimic is not None
        yield Coupling(
            joint.attrib["name"],
            mimic.attrib["joint"],
            ratio=float(mimic.get("multiplier", 1.0)),
            offset=float(mimic.get("offset", 0.0)),
        )


def _closings(robot: ET.Element) -> Iterator[Loop]:
    names = {link.get("name", "") for link in robot.findall("link")}
    for name in sorted(names):
        found = _CLOSING.fullmatch(name)
        if found and found[2] == "1" and f"{found[1]}_2" in names:
            yield Loop(name, f"{found[1]}_2", "ball", name=found[1])


def _unused(robot: ET.Element) -> Iterator[str]:
    """Say what a URDF has and the constrained dynamics do not use, a sentence each."""
    joints = [joint for joint in robot.findall("joint") if joint.get("type") != "fixed"]
    for attribute in ("damping", "friction"):
        names = [joint.get("name", "?") for joint in joints if _dynamics(joint, attribute)]
        if names:
            advice = ": add Robot.passive_torque to tau" if attribute == "damping" else ""
            yield f"joint {attribute} ({few(names)}){advice}"
    limited = [joint.get("name", "?") for joint in joints if joint.find("limit") is not None]
    if limited:
        yield f"limits of position, velocity and effort ({len(limited)} joints)"
    for tag in ("transmission", "gazebo"):
        count = len(robot.findall(tag))
        if count:
            yield f"<{tag}> ({count} elements)"


def _doubts(robot: ET.Element, copy: ET.Element, mimic: bool) -> Iterator[str]:
    """Say what the reader made of a file that leaves it open, a sentence each."""
    joints = _mimicking(robot)
    if joints:
        names = few([joint.attrib["name"] for joint in joints])
        coupled = "couplings of Robot.loops, which hold in scenes that contain them"
        yield f"mimic ({names}): {coupled if mimic else 'these joints move on their own'}"
    closings = [loop.name for loop in _closings(robot)]
    if closings:
        yield (
            f"the kind of the joints cut at {few(closings)}: balls here, unless [[loops]] of a "
            "robot.toml name the same two frames"
        )
    halves = {link.get("name", "") for link in robot.findall("link")}
    for name in sorted(halves):
        found = _CLOSING.fullmatch(name)
        if found and f"{found[1]}_{3 - int(found[2])}" not in halves:
            yield f"link {name!r}: its other half is missing, so it closes nothing"
    impossible = list(impossible_links(copy))
    if impossible:
        yield (
            f"doubts about the inertia of {', '.join(impossible)}: a principal moment is negative, "
            "which no solid has; it is used as written"
        )


def _mimicking(robot: ET.Element) -> list[ET.Element]:
    return [
        joint
        for joint in robot.findall("joint")
        if joint.get("type") != "fixed" and joint.find("mimic") is not None
    ]


def _dynamics(joint: ET.Element, attribute: str) -> float:
    element = joint.find("dynamics")
    return 0.0 if element is None else float(element.get(attribute) or 0)
