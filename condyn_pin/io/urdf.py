"""URDF: checked here, read by Pinocchio, closed by what authors write beside the tree.

Pinocchio gets a copy of the file with what was checked and nothing else: no meshes, no extensions,
numbers in one spelling. A URDF is a tree of hinges and sliders; conventions add what is missing:

    <mimic>              q = multiplier q_other + offset, a `Coupling`
    a second parent      a joint that is cut, and closed by a `Loop`; <loop_joint>, <constraint>
                         and <joint> in <gazebo> as well, see `urdf_cuts`
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
from condyn_pin.io.urdf_cuts import close, cuts_of
from condyn_pin.io.urdf_retyped import retyped, turn_planes, with_balls
from condyn_pin.io.urdf_unused import unmodelled, unused
from condyn_pin.io.xml import open_xml, place


def read_urdf(source: Path | str, root_joint: str = "fixed", *, mimic: bool = True) -> Description:
    """Read a URDF.

    Parameters
    ----------
    source : Path or str
        The file, or its text. Meshes are not needed.
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
    is_file = isinstance(source, Path)
    with place(source if is_file else "the text of a URDF"):
        robot = open_xml(source, "robot")
        if macro := next((e.tag for e in robot.iter() if "/xacro}" in e.tag), ""):
            tag = macro.rpartition("}")[2]
            raise InvalidModel(f"<xacro:{tag}>: a macro; expand it with `xacro FILE > robot.urdf`")
        beside = read_beside(source) if isinstance(source, Path) else Beside()
        return _robot(robot, beside, root_joint, mimic)


def _robot(robot: ET.Element, beside: Beside, root_joint: str, mimic: bool) -> Description:
    tree = retyped(robot, beside.joints)
    copy, past_the_tree = checked(tree, floating=root_joint == "free_flyer", mimic=mimic)
    links, joints = ([e.attrib["name"] for e in tree.findall(tag)] for tag in ("link", "joint"))
    named = () if beside.loops is not None else tuple(closings(links, joints))
    couplings = _couplings(tree) if mimic else ()
    balls = [name for name, kind in beside.joints.items() if kind == "SPHERICAL"]
    model = with_balls(_model(ET.tostring(copy, encoding="unicode"), root_joint), balls)
    cuts = tuple(cuts_of(tree, past_the_tree))
    turn_planes(model, tree)
    return Description(
        model,
        loops=(*couplings, *(beside.loops or named), *close(model, cuts)),
        unused=(
            *unused(tree, copy, coupled=mimic, cuts=named),
            *beside.unused(),
        ),
        unmodelled=tuple(unmodelled(tree, past_the_tree)),
        actuated=beside.motors,
        name=robot.attrib["name"],
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
