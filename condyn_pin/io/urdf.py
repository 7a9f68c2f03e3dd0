"""URDF: checked here, read by Pinocchio, closed by what authors write beside the tree.

Pinocchio gets a copy of the file with what was checked and nothing else: no meshes, no extensions,
numbers in one spelling. A URDF is a tree of hinges and sliders; conventions add what is missing:

    <mimic>              q = multiplier q_other + offset, a `Coupling`
    names of links       the two halves of a cut joint, see `urdf_closures`
    a YAML or a TOML     loops, motors, balls and universal joints, see `urdf_beside`

The kind of a cut joint is not in its name for certain; `robot.toml` can say another kind.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from condyn_pin._core._pin import pin
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.loop import Loop
from condyn_pin.errors import InvalidArgument, InvalidModel
from condyn_pin.io.urdf_beside import Beside, read_beside
from condyn_pin.io.urdf_check import checked
from condyn_pin.io.urdf_closures import closings
from condyn_pin.io.urdf_retyped import retyped, with_balls
from condyn_pin.io.urdf_unused import doubtful, unused
from condyn_pin.io.xml import parsed

ROOT_JOINTS = ("fixed", "free_flyer")


@dataclass(frozen=True)
class UrdfRobot:
    """What was read from a URDF; the fields are those of `Robot`."""

    model: Any
    loops: tuple[Loop | Coupling, ...]
    unused: tuple[str, ...]
    actuated: tuple[str, ...] = ()


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
        beside = read_beside(path)
        return _robot(robot, beside, root_joint, mimic)
    except InvalidModel as error:
        error.args = (f"{path}: {error}",)
        raise


def _robot(robot: ET.Element, beside: Beside, root_joint: str, mimic: bool) -> UrdfRobot:
    tree = retyped(robot, beside.joints)
    copy = checked(tree, floating=root_joint == "free_flyer", mimic=mimic)
    links, joints = ([e.attrib["name"] for e in tree.findall(tag)] for tag in ("link", "joint"))
    named = () if beside.loops is not None else tuple(closings(links, joints))
    couplings = _couplings(tree) if mimic else ()
    balls = [name for name, kind in beside.joints.items() if kind == "SPHERICAL"]
    open_questions = doubtful(
        tree,
        copy,
        mimicking=[joint.attrib["name"] for joint in _mimicking(tree)],
        coupled=mimic,
        cuts=named,
    )
    return UrdfRobot(
        with_balls(_model(ET.tostring(copy, encoding="unicode"), root_joint), balls),
        loops=(*couplings, *(beside.loops or named)),
        unused=(*unused(tree), *open_questions, *beside.unused()),
        actuated=beside.motors,
    )


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


def _mimicking(robot: ET.Element) -> list[ET.Element]:
    return [
        joint
        for joint in robot.findall("joint")
        if joint.get("type") != "fixed" and joint.find("mimic") is not None
    ]
