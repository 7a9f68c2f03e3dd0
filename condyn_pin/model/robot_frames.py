"""The frames of a Robot: which joint carries one, and a model with one more."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import finite
from condyn_pin._core.joints import rotation_fault
from condyn_pin.constraints.base import WORLD, check_size
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name

if TYPE_CHECKING:
    from condyn_pin.model.robot import Robot


def find_frame(robot: Robot, name: str) -> tuple[int, Any]:
    """Return the joint that carries a frame, and where it is on it; see `Robot.frame`."""
    if not isinstance(name, str):
        raise InvalidArgument(f"frame = {name!r}: the name of a frame is needed")
    found = [frame for frame in robot.model.frames if frame.name == name]
    if name in WORLD:
        if any(f.parentJoint or f.placement != pin.SE3.Identity() for f in found):
            raise InvalidModel(
                f"frame {name!r} of {robot.name} has the world's name and is elsewhere; rename it"
            )
        return 0, pin.SE3.Identity()
    if not found and name in robot.joints:  # a model that was built has joints, and no frames
        return int(robot.model.getJointId(name)), pin.SE3.Identity()
    if not found:
        raise unknown_name("frame", name, robot.frames)
    first = found[0]
    for other in found[1:]:
        if other.parentJoint != first.parentJoint or other.placement != first.placement:
            raise InvalidModel(
                f"frame {name!r} of {robot.name} exists {len(found)} times in different "
                "places; rename one of them or add your own with Robot.with_frame"
            )
    return int(first.parentJoint), pin.SE3(first.placement)


def model_with_frame(
    robot: Robot, name: str, parent: str, translation: Any, rotation: ArrayLike | None
) -> Any:
    """Return the robot's model with one more frame; see `Robot.with_frame`."""
    if not isinstance(name, str) or not name:
        raise InvalidArgument(f"name = {name!r}: a text is needed")
    if name in robot.frames or name in WORLD:
        raise InvalidArgument(f"name = {name!r}: {robot.name} has a frame of this name")
    joint, placement = find_frame(robot, parent)
    if isinstance(translation, pin.SE3):
        if rotation is not None:
            raise InvalidArgument("rotation: the placement has one; leave it out")
        translation, rotation = translation.translation, translation.rotation
    p = finite("translation", translation, (3,))
    check_size("translation", *p)
    R = finite("rotation", np.eye(3) if rotation is None else rotation, (3, 3))
    fault = rotation_fault(R)
    if fault:
        raise InvalidArgument(
            f"rotation = {R.tolist()}: {fault}; an orthonormal matrix with determinant 1 is needed"
        )
    model = pin.Model(robot.model)
    model.addFrame(pin.Frame(name, joint, 0, placement * pin.SE3(R, p), pin.FrameType.OP_FRAME))
    return model
