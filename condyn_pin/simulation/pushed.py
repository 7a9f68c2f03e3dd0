"""Pushed: the torques of a run together with its forces from outside.

tau(t, q, v) + sum_f J_f(q)^T f(t, q, v)
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.applied_force import AppliedForce
from condyn_pin.constraints.loads import Loads
from condyn_pin.dynamics.derivatives.loads import load_partial
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.slopes import Slopes
from condyn_pin.simulation.torques import Applied


class Pushed:
    """A torque function (t, q, v) -> (nv,) [N, N m] that has forces from outside in it.

    Parameters
    ----------
    robot : Robot
    tau : Applied
        The torques themselves.
    forces : sequence of AppliedForce
        Constant, or functions of (t, q, v).

    Attributes
    ----------
    jacobian : callable or None
        The derivatives by q and by v, of the forces at their numbers, if those of the torques came
        with them.
    """

    def __init__(self, robot: Robot, tau: Applied, forces: Sequence[AppliedForce]) -> None:
        self._tau, self._forces = tau, tuple(forces)
        self.jacobian = self._slopes if tau.jacobian else None
        self._of_torques = Slopes(tau, partial(pin.integrate, robot.unedited))
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

    def _slopes(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        by_q, by_v = self._of_torques.at(t, q, v)
        return by_q + load_partial(self._loads, np.asarray(q), self._at(t, q, v)), by_v

    def _at(self, t: float, q: Array, v: Array) -> list[AppliedForce]:
        return [force.at(t, q, v) for force in self._forces]
