"""Motion: what tasks read of a robot at one state, computed once for all of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.forces import ALIGNED, frame_jacobian
from condyn_pin.constraints.rows.bound import Terms
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument


class Point(NamedTuple):
    """Where a quantity is, how fast it changes, and J and Jdot v of it: J a + drift."""

    x: Any
    v: Array
    J: Array
    drift: Array


class Motion:
    """The robot of a scene at one state, in the memory of its equations.

    Attributes
    ----------
    q, v : (nq,), (nv,) array
        Configuration, and velocity [rad/s, m/s]; a free-flyer's in its body frame, linear first.
    terms : Terms
        M, h, J, gamma and a_ref of the scene.
    """

    q: Array
    v: Array
    terms: Terms

    def __init__(self, scene: Scene, equations: Equations) -> None:
        self.scene = scene
        self.model, self.data = equations.model, equations.data
        self._equations = equations
        # views of data: what Pinocchio writes is read there
        self._oMi = [self.data.oMi[joint] for joint in range(self.model.njoints)]
        self._com = self.data.com[0], self.data.vcom[0]
        self._acom = self.data.acom[0]

    def move(self, q: Array, v: Array) -> None:
        """Go to a state: the terms of the scene, joint Jacobians and accelerations with a = 0."""
        self.q, self.v = q, v
        self.terms = self._equations.terms(q, v)
        if not self._equations.m:  # data.a is still that of the last answer
            pin.forwardKinematics(self.model, self.data, q, v, np.zeros_like(v))

    def frame(self, joint: int, placement: Any) -> Point:
        """Return a frame: its placement in the world, and 6 rows in the axes of the world."""
        model, data = self.model, self.data
        velocity = pin.getFrameVelocity(model, data, joint, placement, ALIGNED)
        drift = pin.getFrameClassicalAcceleration(model, data, joint, placement, ALIGNED)
        J = frame_jacobian(model, data, joint, placement, ALIGNED)
        return Point(self._oMi[joint] * placement, velocity.vector, J, drift.vector)

    def center_of_mass(self) -> Point:
        """Return the centre of mass: 3 rows in the axes of the world."""
        data = self.data
        pin.centerOfMass(self.model, data, pin.KinematicLevel.ACCELERATION, False)
        # a single column comes as a vector
        J = pin.jacobianCenterOfMass(self.model, data, False).reshape(3, -1)
        return Point(*self._com, J, self._acom)

    def angular_momentum(self) -> Point:
        """Return the angular momentum about the centre of mass; it is its own "velocity"."""
        model, data = self.model, self.data
        drift = np.array(pin.computeCentroidalMomentumTimeVariation(model, data).angular)
        momentum = np.array(data.hg.angular)
        J = np.array(pin.ccrba(model, data, self.q, self.v).reshape(6, -1)[3:])
        return Point(momentum, momentum, J, drift)


def moving(scene: Scene, frame: str) -> tuple[int, Any]:
    """Return the joint of a frame and its placement there; the frame has to move."""
    joint, place = scene.robot.frame(frame)
    if joint == 0:
        raise InvalidArgument(f"frame = {frame!r}: it belongs to the world, which does not move")
    return joint, place


def placed(scene: Scene, joint: int, place: Any, q: Array) -> Any:
    """Return the placement of a frame in the world at q."""
    model = scene.robot.unedited
    data = whole_data(model)
    pin.forwardKinematics(model, data, q)
    return data.oMi[joint] * place


def entry_names(model: Any, columns: NDArray[np.int_]) -> tuple[str, ...]:
    """Return a name for each of some entries of v: the joint, numbered where it has several."""
    names = [""] * int(model.nv)
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        for i in range(joint.nv):
            names[joint.idx_v + i] = str(name) if joint.nv == 1 else f"{name}.{i}"
    return tuple(names[i] for i in columns.tolist())
