"""Pushed: the torques of a run together with its forces from outside.

tau(t, q, v) + sum_f J_f(q)^T f(t, q, v)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin.applied_force import AppliedForce
from condyn_pin.arrays import Array
from condyn_pin.differentiation.loads import load_partial
from condyn_pin.loads import Loads
from condyn_pin.robot import Robot
from condyn_pin.simulation.slopes import TorqueJacobian
from condyn_pin.simulation.torques import Applied, Torque


class Pushed:
    """A torque function (t, q, v) -> (nv,) [N, N m] that has forces from outside in it.

    Parameters
    ----------
    robot : Robot
    tau : 0, (nv,) array_like or callable
        The torques themselves.
    forces : sequence of AppliedForce
        Constant, or functions of (t, q, v).
    """

    def __init__(
        self, robot: Robot, tau: float | ArrayLike | Torque, forces: Sequence[AppliedForce]
    ) -> None:
        self._tau, self._forces = Applied(robot.nv, tau), tuple(forces)
        self._loads = Loads(robot, robot.unedited, robot.unedited.createData())
        for force in self._forces:
            self._loads.place(force.frame)  # what is no frame is refused before the run

    def hold(self, tau: Array | None, forces: Sequence[AppliedForce]) -> None:
        """Apply these forces on the same frames from now on, and these torques unless None."""
        self._forces = tuple(forces)
        if tau is not None:
            self._tau.hold(tau)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques with what the forces do."""
        return self._tau(t, q, v) + self._loads.at(q, self._at(t, q, v)).torque

    def jacobian_with(self, jacobian: TorqueJacobian) -> TorqueJacobian:
        """Return the derivatives of the torques with those of sum_f J_f^T f by q.

        The numbers of a force that is a function of the state count as constant.
        """

        def whole(t: float, q: Array, v: Array) -> tuple[Array, Array]:
            by_q, by_v = jacobian(t, q, v)
            of_forces = load_partial(self._loads, np.asarray(q), self._at(t, q, v))
            return np.asarray(by_q) + of_forces, np.asarray(by_v)

        return whole

    def _at(self, t: float, q: Array, v: Array) -> list[AppliedForce]:
        return [force.at(t, q, v) for force in self._forces]
