"""URDF: Pinocchio reads it; this says clearly what is wrong with a file, and what is not used."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from math import isfinite
from pathlib import Path
from typing import Any

from condyn_pin._pin import pin
from condyn_pin.errors import InvalidArgument, InvalidModel
from condyn_pin.io.words import few

ROOT_JOINTS = ("fixed", "free_flyer")


def read_urdf(path: Path, root_joint: str = "fixed") -> tuple[Any, tuple[str, ...]]:
    """Read a URDF.

    Parameters
    ----------
    path : Path
        The file. Meshes are not needed.
    root_joint : {"fixed", "free_flyer"}
        How the root link is attached to the world.

    Returns
    -------
    model : pin.Model
    unused : tuple of str
        What the file has and the dynamics do not use, a sentence each.
    """
    check_root_joint(root_joint)
    if not path.is_file():
        raise InvalidModel(f"{path}: no such file")
    try:
        robot = ET.parse(path).getroot()
    except ET.ParseError as error:
        raise InvalidModel(f"{path}: not well-formed XML: {error}") from error
    if robot.tag != "robot":
        raise InvalidModel(f"{path}: its root element is <{robot.tag}>, a URDF has <robot>")
    _check_inertials(path, robot)
    try:
        if root_joint == "free_flyer":
            model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
        else:
            model = pin.buildModelFromUrdf(str(path))
    except (ValueError, RuntimeError) as error:
        raise InvalidModel(f"{path}: Pinocchio cannot read it: {error}") from error
    return model, unused_elements(robot)


def check_root_joint(root_joint: str) -> None:
    """Refuse a way to attach the root link that is not known."""
    if root_joint not in ROOT_JOINTS:
        raise InvalidArgument(
            f"root_joint = {root_joint!r}: one of {', '.join(ROOT_JOINTS)} is needed"
        )


def _check_inertials(path: Path, robot: ET.Element) -> None:
    """Refuse numbers that cannot be read: the parser would drop the link's mass and go on."""
    for link in robot.findall("link"):
        for part in (*link.findall("inertial/mass"), *link.findall("inertial/inertia")):
            for key, text in part.attrib.items():
                if not _is_number(text):
                    raise InvalidModel(
                        f"{path}: link {link.get('name')!r}: <{part.tag} {key}={text!r}>: "
                        "a finite number is needed"
                    )


def _is_number(text: str) -> bool:
    try:
        return isfinite(float(text))
    except ValueError:
        return False


def unused_elements(robot: ET.Element) -> tuple[str, ...]:
    """Return what a URDF has and the constrained dynamics do not use, a sentence each."""
    joints = [joint for joint in robot.findall("joint") if joint.get("type") != "fixed"]
    found = []
    for attribute in ("damping", "friction"):
        names = [joint.get("name", "?") for joint in joints if _dynamics(joint, attribute)]
        if names:
            advice = ": add Robot.passive_torque to tau" if attribute == "damping" else ""
            found.append(f"joint {attribute} ({few(names)}){advice}")
    limited = [joint.get("name", "?") for joint in joints if joint.find("limit") is not None]
    if limited:
        found.append(f"limits of position, velocity and effort ({len(limited)} joints)")
    mimic = [joint.get("name", "?") for joint in joints if joint.find("mimic") is not None]
    if mimic:
        found.append(f"mimic ({few(mimic)}): these joints move on their own")
    for tag in ("transmission", "gazebo"):
        count = len(robot.findall(tag))
        if count:
            found.append(f"<{tag}> ({count} elements)")
    return tuple(found)


def _dynamics(joint: ET.Element, attribute: str) -> float:
    element = joint.find("dynamics")
    return 0.0 if element is None else float(element.get(attribute) or 0)
