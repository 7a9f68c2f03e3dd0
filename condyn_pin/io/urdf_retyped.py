"""Joints that a URDF cannot describe, or Pinocchio does not read from it.

A ball takes the place of its hinge in Pinocchio's model, a universal joint is two hinges with an
empty link between them, and a fixed joint is one of the file. Where it stands is where the hinge
stood; axis, limits, damping and friction of the hinge are gone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

from condyn_pin._core._pin import pin
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.urdf_cuts import along
from condyn_pin.model.smaller_robot import copy_numbers

_OF_A_HINGE: Final = ("axis", "limit", "dynamics", "mimic", "safety_controller", "calibration")
_AXES: Final[Mapping[str, str]] = {"X": "1 0 0", "Y": "0 1 0", "Z": "0 0 1"}


def retyped(robot: Element, kinds: Mapping[str, str]) -> Element:
    """Return a URDF with the joints of these kinds, as far as it can say them, in a copy of it.

    Parameters
    ----------
    robot : Element
        The root of the file.
    kinds : mapping of str to str
        Joint to SPHERICAL, FIXED or UJOINT_XY; balls stay hinges, see `with_balls`.
    """
    if not kinds:
        return robot
    copy = fromstring(tostring(robot, encoding="unicode"))
    joints = {joint.get("name", ""): joint for joint in copy.findall("joint")}
    for name, kind in kinds.items():
        if name not in joints:
            raise InvalidModel(f"joint_name: {unknown_name('joint', name, joints)}")
        joint = joints[name]
        if joint.get("type") == "fixed" and kind != "FIXED":
            raise InvalidModel(f"joint_name: {name!r} is fixed, and cannot be {kind}")
        for tag in _OF_A_HINGE:
            for element in joint.findall(tag):
                joint.remove(element)
        joint.set("type", "fixed" if kind == "FIXED" else "continuous")
        if kind.startswith("UJOINT"):
            _universal(copy, joint, name, kind[-2:])
    return copy


def _universal(robot: Element, joint: Element, name: str, axes: str) -> None:
    """Make a joint two hinges NAME_X and NAME_Y with an empty link NAME_cross between them."""
    first, second = axes[0], axes[1]
    cross = f"{name}_cross"
    child = joint.find("child")
    if child is None:
        raise InvalidModel(f"joint {name!r}: no <child link=...>; name its child link")
    SubElement(robot, "link", name=cross)
    other = SubElement(robot, "joint", name=f"{name}_{second}", type="revolute")
    SubElement(other, "parent", link=cross)
    SubElement(other, "child", dict(child.attrib))
    child.set("link", cross)
    joint.set("name", f"{name}_{first}")
    joint.set("type", "revolute")
    for hinge, axis in ((joint, first), (other, second)):
        SubElement(hinge, "axis", xyz=_AXES[axis])
        SubElement(hinge, "limit", lower="-inf", upper="inf", effort="inf", velocity="inf")


def with_balls(model: Any, names: Collection[str]) -> Any:
    """Return a model with balls in the place of joints, every other number of it kept."""
    if not names:
        return model
    made = pin.Model()
    made.name = model.name
    made.gravity = pin.Motion(model.gravity.vector.copy())
    made.inertias[0] = pin.Inertia(model.inertias[0])
    for i in range(1, model.njoints):
        name = model.names[i]
        joint = pin.JointModelSpherical() if name in names else model.joints[i]
        made.addJoint(model.parents[i], joint, model.jointPlacements[i], name)
        made.appendBodyToJoint(i, model.inertias[i], pin.SE3.Identity())
    for frame in list(model.frames)[1:]:
        made.addFrame(frame, False)  # the inertia is on the joint already
    copy_numbers(model, made, [name for name in list(model.names)[1:] if name not in names])
    return made


def turn_planes(model: Any, robot: Element) -> None:
    """Turn the planar joints of a model so that their planes are across their axes.

    Pinocchio has them across z: with R z = axis, the joint is placed by M R, and all that is on it
    by R^-1.
    """
    for joint in robot.findall("joint"):
        if joint.get("type") != "planar":
            continue
        i = model.getJointId(joint.attrib["name"])
        R = along(joint.find("axis"))
        model.jointPlacements[i] = model.jointPlacements[i] * R
        model.inertias[i] = R.actInv(model.inertias[i])
        for k in range(i + 1, model.njoints):
            if model.parents[k] == i:
                model.jointPlacements[k] = R.actInv(model.jointPlacements[k])
        for frame in model.frames:
            if frame.parentJoint == i and frame.type != pin.FrameType.JOINT:
                frame.placement = R.actInv(frame.placement)
