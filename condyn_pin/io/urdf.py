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
from condyn_pin.io.urdf_check import checked
from condyn_pin.io.urdf_unused import doubtful, unused
from condyn_pin.io.xml import parsed

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
        robot = parsed(path)
    except (OSError, ValueError) as error:
        raise InvalidModel(f"{path}: cannot be read as XML: {error}") from error
    try:
        if robot.tag != "robot":
            raise InvalidModel(f"its root element is <{robot.tag}>, a URDF has <robot>")
        copy = checked(robot, floating=root_joint == "free_flyer", mimic=mimic)
        cuts = tuple(_closings(robot))
        loops: tuple[Loop | Coupling, ...] = (*(_couplings(robot) if mimic else ()), *cuts)
        model = _model(ET.tostring(copy, encoding="unicode"), root_joint)
        open_questions = doubtful(
            robot,
            copy,
            mimicking=[joint.attrib["name"] for joint in _mimicking(robot)],
            coupled=mimic,
            cuts=[loop.name for loop in cuts],
        )
        return UrdfRobot(model, loops, (*unused(robot), *open_questions))
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


def _mimicking(robot: ET.Element) -> list[ET.Element]:
    return [
        joint
        for joint in robot.findall("joint")
        if joint.get("type") != "fixed" and joint.find("mimic") is not None
    ]
