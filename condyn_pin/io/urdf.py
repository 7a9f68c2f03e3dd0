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
from pathlib import Path
from typing import Any

from condyn_pin._core._pin import pin
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.errors import InvalidModel
from condyn_pin.io.description import Description
from condyn_pin.io.files import check_root_joint
from condyn_pin.io.urdf_beside import Beside, read_beside
from condyn_pin.io.urdf_check import checked
from condyn_pin.io.urdf_closures import closings
from condyn_pin.io.urdf_retyped import retyped, with_balls
from condyn_pin.io.urdf_unused import unused
from condyn_pin.io.xml import open_xml, place


def read_urdf(path: Path, root_joint: str = "fixed", *, mimic: bool = True) -> Description:
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
    Description
        The model, its loops and couplings, and what the file has and the dynamics do not use.

    Raises
    ------
    InvalidModel
        If the file cannot be read; the text names the element.
    """
    check_root_joint(root_joint)
    with place(path):
        robot = open_xml(path, "robot")
        return _robot(robot, read_beside(path), root_joint, mimic)


def _robot(robot: ET.Element, beside: Beside, root_joint: str, mimic: bool) -> Description:
    tree = retyped(robot, beside.joints)
    copy = checked(tree, floating=root_joint == "free_flyer", mimic=mimic)
    links, joints = ([e.attrib["name"] for e in tree.findall(tag)] for tag in ("link", "joint"))
    named = () if beside.loops is not None else tuple(closings(links, joints))
    couplings = _couplings(tree) if mimic else ()
    balls = [name for name, kind in beside.joints.items() if kind == "SPHERICAL"]
    return Description(
        with_balls(_model(ET.tostring(copy, encoding="unicode"), root_joint), balls),
        loops=(*couplings, *(beside.loops or named)),
        unused=(
            *unused(tree, copy, coupled=mimic, cuts=named),
            *beside.unused(),
        ),
        actuated=beside.motors,
    )


def _model(text: str, root_joint: str) -> Any:
    try:
        if root_joint == "free_flyer":
            return pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
        return pin.buildModelFromXML(text)
    except (ValueError, RuntimeError) as error:
        raise InvalidModel(f"Pinocchio cannot read it: {error}") from error


def _couplings(robot: ET.Element) -> Iterator[Coupling]:
    for joint in robot.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and joint.get("type") != "fixed":
            yield Coupling(
                joint.attrib["name"],
                mimic.attrib["joint"],
                ratio=float(mimic.get("multiplier", 1.0)),
                offset=float(mimic.get("offset", 0.0)),
            )
