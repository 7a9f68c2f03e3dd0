"""The orientation of a frame: the error is the turn that is left, log(R_r R^T)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.models import rotation_fault
from condyn_pin.constraints.constraint import floats, unit
from condyn_pin.constraints.places import set_frames
from condyn_pin.control.tasks.task import (
    BoundTask,
    DefaultReference,
    RobotMotion,
    Tracking,
    approach_by_turns,
    moving,
    placement_at,
)
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class Orientation(Tracking):
    """The orientation of a frame of the robot follows a reference: 3 rows.

    Parameters
    ----------
    frame : str, (joint, pin.SE3) or pin.Frame
        Name of a frame of the robot.
    reference : (4,) or (3, 3) array_like or callable, optional
        Quaternion x y z w or rotation matrix, from the frame to the world; or a function of t that
        returns one with angular velocity [rad/s] and acceleration [rad/s^2] (3,), in the axes of
        the world. By default how the frame is turned in the first posture of the robot.

    Raises
    ------
    InvalidArgument
        If `frame` is no frame.
    """

    unit: ClassVar[str] = "rad/s^2"

    frame: str

    def __post_init__(self) -> None:
        set_frames(self, "frame")
        super().__post_init__()

    @property
    def _called(self) -> str:
        return f"{self.frame} orientation"

    def _value(self, reference: Any) -> Any:
        if np.shape(reference) == (3, 3):
            R = finite("reference", reference, (3, 3))
            if fault := rotation_fault(R):
                raise InvalidArgument(f"reference: it is not a rotation: {fault}")
            return tuple(pin.Quaternion(R).coeffs().tolist())
        fault = "reference: the quaternion (x y z w) is zero; use 0 0 0 1"
        return unit(floats("reference", reference, 4), fault)

    def bind(self, scene: Scene, home: DefaultReference) -> BoundTask:
        """Return the task bound to a scene; by default it stays as it is at `home`."""
        joint, place = moving(scene, self.frame)

        def start() -> Any:
            return pin.SE3ToXYZQUAT(placement_at(scene, joint, place, home()))[3:]

        wanted = self._feedback(3, start, _turn_left)

        def rows(motion: RobotMotion, t: float) -> tuple[Array, Array]:
            now = motion.frame(joint, place)
            return now.J[3:], wanted(now.x, now.v[3:], t) - now.drift[3:]

        names = self._row_names(("about x", "about y", "about z"))
        compiled = self._compiled(
            "orientation", (9, 3), start, _turn_numbers, at=joint, placement=place
        )
        approach = approach_by_turns(rows, 0)
        return self._chosen(
            BoundTask("accelerations", names, self.unit, rows, compiled, approach=approach)
        )


def turn_to(wanted: Array, R: Array) -> Array:
    """Return the turn that takes the axes R to those that are wanted, in the world [rad]."""
    return np.asarray(pin.log3(wanted.dot(R.T)))


def _turn_numbers(reference: Any) -> Array:
    return np.asarray(pin.Quaternion(np.array(reference)).matrix().ravel())


def _turn_left(reference: Any) -> Callable[[Any], Array]:
    R = pin.Quaternion(np.array(reference)).matrix()
    return lambda x: turn_to(R, x.rotation)
