"""A frame of the robot: the position of its origin, or its pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin.constraints.constraint import placement
from condyn_pin.constraints.places import set_frames, short_frames
from condyn_pin.control.tasks.orientation import turn_to
from condyn_pin.control.tasks.task import (
    BoundTask,
    DefaultReference,
    RobotMotion,
    TaskKind,
    Tracking,
    approach_by_turns,
    difference,
    moving,
    placement_at,
)
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument

Of = Literal["position", "pose"]


@dataclass(frozen=True)
class FrameTask(Tracking):
    """A frame of the robot follows a point or a placement of the world: 3 rows or 6.

    a_wanted = a_r + kp (x_r - x) + kd (v_r - v)

    Parameters
    ----------
    frame : str, (joint, pin.SE3) or pin.Frame
        Name of a frame of the robot.
    reference : (3,) or (7,) array_like, pin.SE3 or callable, optional
        Position [m], and for a pose the quaternion x y z w after it; or a function of t that
        returns (x, v, a), of a pose v and a (6,) linear first in the axes of the world. By default
        where the frame is in the first posture of the robot.
    of : {"position", "pose"}
        Three rows, those of the origin, or six.

    Raises
    ------
    InvalidArgument
        If `frame` is no frame, or `of` is unknown.
    """

    frame: str
    of: Of = field(default="position", kw_only=True)

    def __post_init__(self) -> None:
        set_frames(self, "frame")
        if self.of not in get_args(Of):
            raise InvalidArgument(f"of = {self.of!r}: one of {', '.join(get_args(Of))} is needed")
        super().__post_init__()

    @property
    def _called(self) -> str:
        return f"{short_frames(self.frame)} {self.of}"

    def _value(self, reference: Any) -> Any:
        if self.of == "pose":
            return placement("reference", reference)
        return tuple(finite("reference", reference, 3).tolist())

    def bind(self, scene: Scene, home: DefaultReference) -> BoundTask:
        """Return the task bound to a scene; by default it stays where it is at `home`."""
        joint, place = moving(scene, self.frame)
        size, axes = (3, "xyz") if self.of == "position" else (6, _SIX)
        left = _way_left if self.of == "position" else _pose_left

        def start() -> Any:
            pose = tuple(pin.SE3ToXYZQUAT(placement_at(scene, joint, place, home())).tolist())
            return pose[: 7 if size == 6 else 3]

        wanted = self._feedback(size, start, left)

        def rows(motion: RobotMotion, t: float) -> tuple[Array, Array]:
            now = motion.frame(joint, place)
            return now.J[:size], wanted(now.x, now.v[:size], t) - now.drift[:size]

        kind: TaskKind = "position" if size == 3 else "pose"
        x_r = np.array if size == 3 else _pose_numbers
        sizes = (3, 3) if size == 3 else (12, 6)
        compiled = self._compiled(kind, sizes, start, x_r, at=joint, placement=place)
        approach = approach_by_turns(rows, 3) if size == 6 else None
        names = self._row_names(axes)
        return self._chosen(
            BoundTask("accelerations", names, self.unit, rows, compiled, approach=approach)
        )


_SIX = ("x", "y", "z", "about x", "about y", "about z")


def _way_left(reference: Any) -> Callable[[Any], Array]:
    left = difference(reference)
    return lambda x: left(x.translation)


def _pose_numbers(reference: Any) -> Array:
    target = pin.XYZQUATToSE3(np.array(reference))
    return np.concatenate((target.translation, target.rotation.ravel()))


def _pose_left(reference: Any) -> Callable[[Any], Array]:
    target = pin.XYZQUATToSE3(np.array(reference))
    p, R = np.array(target.translation), np.array(target.rotation)
    return lambda x: np.concatenate((p - x.translation, turn_to(R, x.rotation)))
