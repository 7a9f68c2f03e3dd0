"""Rods as distances: a light body with a joint at each end becomes one row.

A rod of mass m hangs on a body by a ball or a hinge at p1, and a loop ties its other end p2 to
another body. Without inertia it carries force along p2 - p1 only, so that all it does is

    |p2 - p1| = length.

Its mass goes, or is shared by its ends so that total mass and centre of mass along the rod stay:

    m1 = m (1 - s),   m2 = m s,   s the centre of mass in units of the length from p1.

Armature, damping and friction of its joint go with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import checked, listed
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import indices
from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, InvalidConstraint
from condyn_pin.mechanism.reduction.linkages import check_passive
from condyn_pin.mechanism.reduction.reduced_scene import ReducedScene, reduced
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller import smaller_robot

RodMass = Literal["ends", "drop"]

_PIVOTS = (
    "JointModelSpherical", "JointModelRX", "JointModelRY", "JointModelRZ",
    "JointModelRevoluteUnaligned", "JointModelRUBX", "JointModelRUBY", "JointModelRUBZ",
    "JointModelRevoluteUnboundedUnaligned",
)  # fmt: skip


@dataclass(frozen=True)
class _Rod:
    joint: str
    number: int
    loop: Constraint
    near: str  # name of a new frame, at p1 on the body that the rod hangs on
    far: str  # frame at p2 on the other body
    length: float  # [m]
    share: float  # s

    @property
    def distance(self) -> Loop:
        """The row that replaces the rod and its loop, under the loop's name.

        The end that takes the place of the loop's first frame comes first, as the force is on it.
        """
        ends = (self.near, self.far) if self.far == self.loop.frames[1] else (self.far, self.near)
        return Loop(*ends, "rod", length=self.length, name=self.loop.name)


def rods_as_distances(
    scene: Scene, joints: Sequence[str], *, mass: RodMass = "ends"
) -> ReducedScene:
    """Return the scene with each rod replaced by one row: the distance of its two ends.

    Parameters
    ----------
    scene : Scene
    joints : sequence of str
        The joints on which the rods hang: balls, or hinges of a planar linkage. Each rod ends
        a branch, and one loop of kind ball or planar ties its other end.
    mass : {"ends", "drop"}
        Whether a rod's mass is shared by its two ends, so that total mass and centre of mass
        along the rod stay, or dropped.

    Returns
    -------
    ReducedScene

    Raises
    ------
    UnknownName
        If there is no such joint.
    InvalidArgument
        If a body is no rod; the text says why.
    InvalidConstraint
        If a rod does more than keep a distance: without it the mobility is another.
    """
    if mass not in get_args(RodMass):
        raise InvalidArgument(f"mass = {mass!r}: one of {', '.join(get_args(RodMass))} is needed")
    names = checked("joints", joints, scene.robot.joints, "joint")
    q = scene.state()[0]
    rods = [_rod(scene, name) for name in names]
    for rod in rods:
        if scene.robot.frame(rod.far)[0] in {other.number for other in rods}:
            raise InvalidArgument(f"{rod.joint}: its other end is on a rod that is replaced too")
    robot = scene.robot
    for rod in rods:
        robot = _with_ends(robot, rod, mass)
    said = "shared by their ends" if mass == "ends" else "dropped"
    words = f"rods as distances: {listed(names)}; their mass is {said}"
    lost = [text for name in names for text in _lost(scene.robot, name)]
    small = smaller_robot(robot, names, q, words, cut=True)
    of_loop = {rod.loop.name: rod.distance for rod in rods}
    distances = tuple(rod.distance for rod in rods if rod.loop in scene.robot.loops)
    small = replace(small, loops=(*small.loops, *distances))
    constraints: list[Constraint] = [of_loop.get(c.name, c) for c in scene.constraints]
    result = reduced(scene, small, constraints, q, (words, *lost), found=names)
    _check_mobility(scene, result, rods)
    return result


def is_rod(scene: Scene, joint: str) -> bool:
    """Return whether the body of a joint could be replaced by a distance."""
    try:
        _rod(scene, joint)
    except InvalidArgument:
        return False
    return True


def _rod(scene: Scene, joint: str) -> _Rod:
    """Return the ends and mass of a rod, or say why the body is no rod."""
    robot, model = scene.robot, scene.robot.model
    check_passive(robot, joint)
    number = model.getJointId(joint)
    if model.joints[number].shortname() not in _PIVOTS:
        raise InvalidArgument(f"joint {joint!r} is a {model.joints[number].shortname()}: a rod "
                              "hangs on a ball or a hinge")  # fmt: skip
    if len(model.subtrees[number]) > 1:
        raise InvalidArgument(f"joint {joint!r} carries further joints: a rod ends a branch")
    on_it = [c for c in scene.constraints if number in c.sides(robot)]
    if len(on_it) != 1 or not on_it[0].is_pin:
        found = listed([c.name for c in on_it]) or "none"
        raise InvalidArgument(
            f"joint {joint!r}: a rod has one loop, of kind ball or planar, on it; found: {found}"
        )
    loop = on_it[0]
    own, far = loop.frames
    if robot.frame(own)[0] != number:
        own, far = far, own
    tip = robot.frame(own)[1].translation
    length = float(np.linalg.norm(tip))
    if length == 0.0:
        raise InvalidArgument(f"joint {joint!r}: the ends of the rod coincide")
    share = _share(joint, model.inertias[number].lever, tip / length, length)
    return _Rod(joint, number, loop, f"{joint}/seat", far, length, share)


def _share(joint: str, com: Array, along: Array, length: float) -> float:
    """Return s, or say that no two masses at the ends have this centre of mass."""
    x = float(com @ along)
    if not -tolerances.DRAWN <= x <= length + tolerances.DRAWN:
        raise InvalidArgument(
            f"joint {joint!r}: the centre of mass of a rod is between its ends; here it is at "
            f"{x / length:.3g} of its length"
        )
    return min(max(x / length, 0.0), 1.0)


def _lost(robot: Robot, joint: str) -> list[str]:
    """Return what acts along the joint of a rod and goes with it, as a sentence."""
    _, index = indices(robot.model, [joint])
    acting = ("armature", "damping", "friction")
    found = [name for name in acting if np.any(np.array(getattr(robot.model, name))[index])]
    return [f"joint {joint}: its {' and '.join(found)} left out with it"] if found else []


def _with_ends(robot: Robot, rod: _Rod, mass: RodMass) -> Robot:
    """Return the robot with a frame at the rod's seat, and the rod's mass at its ends."""
    model = pin.Model(robot.model)
    parent, seat = model.parents[rod.number], model.jointPlacements[rod.number]
    model.addFrame(pin.Frame(rod.near, parent, 0, seat, pin.FrameType.OP_FRAME))
    if mass == "ends":
        m = model.inertias[rod.number].mass
        other, place = robot.frame(rod.far)
        for joint, part, at in ((parent, 1 - rod.share, seat), (other, rod.share, place)):
            model.appendBodyToJoint(joint, _point(part * m), at)
    return replace(robot, model=model)


def _point(mass: float) -> Any:
    return pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))


def _check_mobility(before: Scene, after: Scene, rods: Sequence[_Rod]) -> None:
    """Refuse rods that carry more than force along themselves.

    What goes with a rod on a ball is its spin about itself, and nothing with one on a hinge.
    """
    spins = sum(before.robot.model.joints[rod.number].nv == 3 for rod in rods)
    wanted = before.nominal.mobility - spins
    if after.nominal.mobility != wanted:
        raise InvalidConstraint(
            f"rods {listed([rod.joint for rod in rods])}: as distances they leave mobility "
            f"{after.nominal.mobility} where {wanted} is right, so they do more than "
            "keep a distance"
        )
