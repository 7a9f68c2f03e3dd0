"""Torques that are applied, with what forces from outside do, and how they change with the state.

    tau(t, q, v) + sum_f J_f(q)^T f(t, q, v)
    tau(t, q1, v1) ~ tau(t, q, v) + tau_q (q1 - q) + tau_v (v1 - v)

The slopes tau_q and tau_v, for steps that are implicit, are those that come with a function, or
forward differences of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import FLOAT, check_called, joint_torques
from condyn_pin._core.arrays import Array, finite, read_only_view
from condyn_pin._core.models import Indices, indices, whole_data
from condyn_pin.constraints.forces import AppliedForce, Loads
from condyn_pin.dynamics.derivatives.solution_derivatives import load_partial
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot
from condyn_pin.model.springs import SpringDampers

Torque = Callable[[float, Array, Array], Array]  # (t, q, v) -> (nv,) [N, N m]

# (t, q, v) -> tau by q and by v, (nv, nv) each [N m/rad, N m s/rad and so on]
TorqueJacobian = Callable[[float, Array, Array], tuple[ArrayLike, ArrayLike]]

# A step of a difference, relative to what it is added to: it leaves half of the digits.
_H: Final = 2.0**-26


class AppliedTorques:
    """Torques and external forces of a run; arguments are those of `simulate`.

    The shape of a user function's torques is checked: numpy would broadcast other shapes
    silently.
    """

    def __init__(
        self,
        robot: Robot,
        tau: float | ArrayLike | Torque = 0.0,
        jacobian: TorqueJacobian | None = None,
        forces: Sequence[AppliedForce] = (),
    ) -> None:
        self._model, self._shape = robot.unedited, (robot.nv,)
        # derivatives that came with the function; whether differences are taken where there are
        # none, not before a step has failed without; and the calls of the function for them
        self.jacobian, self.differencing, self.differenced = jacobian, False, 0
        self._function: Torque | None = tau if callable(tau) else None
        self._tau: Array | None = None  # where there is no function
        # (nv,) the torques, not to be written to; None if a function or a force is among them
        self.constant: Array | None = None
        self._first: Array | None = None
        self._state: tuple[Array, Array] | None = None  # q and v that the first were asked for
        self._robot = robot
        for force in forces:
            self._loads.place(force.frame)  # what is no frame is refused before the run
        if hasattr(tau, "solve") and not hasattr(tau, "__array__"):
            raise InvalidArgument(
                f"tau = {type(tau).__name__}: torques or a function of (t, q, v) are needed; "
                "control.at_rate(controller, 1e-3) makes one of a Controller"
            )
        if callable(tau):
            check_called("tau", tau, "t, q, v")
            self.hold(None, forces)
        else:
            self.hold(joint_torques("tau", tau, robot.nv), forces)

    @cached_property
    def _loads(self) -> Loads:
        return Loads(self._robot, self._model, whole_data(self._model))

    def hold(self, tau: Array | None, forces: Sequence[AppliedForce]) -> None:
        """Apply these from now on: torques (nv,), None for the function's, and forces."""
        self._forces = tuple(forces)
        if tau is not None:
            self._tau = np.array(tau)
            self._tau.flags.writeable = False
        self.constant = self._first = None if self._forces else self._tau

    def begin(self, t: float, q: Array, v: Array) -> None:
        """Begin a run, or to go on with other constraints; derivatives are looked at once."""
        self.differencing = False
        if self.jacobian is not None:
            self.slopes(t, q, v)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques (nv,), not to be written to."""
        if self.constant is not None:
            return self.constant
        tau = self._value(t, q, v)
        if self._first is None:
            self._first, self._state = tau.copy(), (q, v)
        return tau

    def _value(self, t: float, q: Array, v: Array) -> Array:
        q, v = read_only_view(q), read_only_view(v)
        tau = self._tau
        if self._function is not None:
            tau = self._function(t, q, v)
            if not (type(tau) is np.ndarray and tau.shape == self._shape and tau.dtype == FLOAT):
                tau = finite(f"tau({t:g}, q, v)", tau, self._shape)
            elif not isfinite(tau.dot(tau)) and isfinite(v.dot(v)):  # else v is to blame
                finite(f"tau({t:g}, q, v)", tau, self._shape)
        assert tau is not None
        return tau + self._loads.at(q, self._forces_at(t, q, v)).torque if self._forces else tau

    def _forces_at(self, t: float, q: Array, v: Array) -> list[AppliedForce]:
        return [force.at(t, q, v) for force in self._forces]

    def forget(self) -> None:
        """Begin another step."""
        self._first = self.constant

    def first(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques at the start of the step (nv,), not to be written to."""
        # Where the answer at its start was known from before, the first that were asked for are
        # those of a later stage: then they are asked for now.
        asked = self._state is None or (self._state[0] is q and self._state[1] is v)
        return self._first if self._first is not None and asked else self(t, q, v).copy()

    def at_sample(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques at a state that no step has asked for (nv,), not to be written to."""
        self.forget()
        return self.first(t, q, v)

    @property
    def slopes_are_known(self) -> bool:
        """True if derivatives of the torques by q and v are available."""
        return self.jacobian is not None or self.differencing

    @property
    def could_be_differenced(self) -> bool:
        """True if there is a function without derivatives that is not differenced so far."""
        return self.constant is None and not self.slopes_are_known

    def slopes(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return tau by q and by v (nv, nv) each, tangent columns."""
        if self._function is None and not any(callable(each.force) for each in self._forces):
            n = self._shape[0]
            by_q = load_partial(self._loads, q, self._forces) if self._forces else np.zeros((n, n))
            return by_q, np.zeros((n, n))
        if self.jacobian is None:
            return self._differences(t, q, v)
        q, v = read_only_view(q), read_only_view(v)
        found = self.jacobian(t, q, v)
        if not (isinstance(found, tuple | list) and len(found) == 2):
            raise InvalidArgument(
                f"jacobian({t:g}, q, v) returns {type(found).__name__}: a pair is needed, tau by q "
                "and tau by v"
            )
        n = len(v)
        by_q, by_v = (
            finite(f"jacobian({t:g}, q, v)[{i}]", part, (n, n)) for i, part in enumerate(found)
        )
        if self._forces:
            by_q = by_q + load_partial(self._loads, q, self._forces_at(t, q, v))
        return by_q, by_v

    def _differences(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        moves, model = np.eye(len(v)), self._model
        self.differenced += 2 * len(v) + 1
        still, size = self._value(t, q, v).copy(), _H * max(1.0, float(np.abs(v).max(initial=0.0)))
        by_q = [(self._value(t, pin.integrate(model, q, _H * x), v) - still) / _H for x in moves]
        by_v = [(self._value(t, q, v + size * x) - still) / size for x in moves]
        return np.column_stack(by_q), np.column_stack(by_v)


# Passive: the robot's own springs and damping.
#
# tau_i = - k_i (q_i - q0_i) - d_i v_i - sum_s (J_s^T n_s f_s)_i


@dataclass(frozen=True, eq=False)
class PassiveForces:
    """Springs and damping of a robot, as arrays."""

    d: Array  # (nv,) damping [N m s/rad, N s/m]
    # k, rest (s,): stiffness [N m/rad, N/m] and reference [rad, m] of each spring
    k: Array
    rest: Array
    # at_q, at_v (s,): where q and v hold its joint
    at_q: Indices
    at_v: Indices
    # springs and dampers between two frames, where there are any
    between: SpringDampers | None = None

    @staticmethod
    def of(robot: Robot, *, springs: bool = True, damping: bool = True) -> PassiveForces:
        """Springs and damping of a robot that are on."""
        chosen = [spring for spring in robot.springs if springs and spring.stiffness]
        at_q, at_v = indices(robot.model, [spring.joint for spring in chosen])
        acting = [
            each
            for each in robot.spring_dampers
            if (springs and each.stiffness) or (damping and each.damping)
        ]
        return PassiveForces(
            np.array(robot.model.damping, dtype=float) * damping,
            np.array([spring.stiffness for spring in chosen]),
            np.array([spring.reference for spring in chosen]),
            at_q,
            at_v,
            SpringDampers(robot, acting, springs=springs, damping=damping) if acting else None,
        )

    @cached_property
    def K(self) -> Array:
        """Stiffness of each joint by spring (nv, s): springs on one joint add up."""
        K = np.zeros((len(self.d), len(self.k)))
        K[self.at_v, range(len(self.k))] = self.k
        return K

    @property
    def stiffness(self) -> Array:
        """Stiffness of each joint (nv,)."""
        return np.asarray(self.K.sum(axis=1))

    @property
    def is_nothing(self) -> bool:
        """True if no spring and no damper acts."""
        return self.between is None and not (self.d.any() or self.k.any())

    def inertia(self, dt: float) -> Array:
        """Return dt D + dt^2 K (nv,) of the joints: what they add to M in a step [kg, kg m^2]."""
        return dt * self.d + dt**2 * self.stiffness

    def stiffness_matrix(self, q: Array) -> Array:
        """Return K (nv, nv), how the torques fall with q."""
        K = np.diag(self.stiffness)
        return K + self.between.stiffness(q) if self.between else K

    def damping_matrix(self, q: Array) -> Array:
        """Return D (nv, nv), how the torques fall with v."""
        D = np.diag(self.d)
        return D + self.between.damping(q) if self.between else D

    def energy(self, q: Array) -> Array:
        """Return the energy of the springs at configurations q (..., nq) [J]."""
        energy = np.asarray(0.5 * (q[..., self.at_q] - self.rest) ** 2 @ self.k)
        return energy + self.between.energy(q) if self.between else energy

    def dissipation(self, q: Array, v: Array) -> Array:
        """Power dissipated by the damping at states q (k, nq), v (k, nv), (k,) [W]."""
        power = np.asarray(v**2 @ self.d)
        return power + self.between.dissipation(q, v) if self.between else power

    def torque(self, q: Array, v: Array) -> Array:
        """Return the torques of springs and damping (nv,) [N, N m]."""
        tau = np.asarray(-self.d * v - self.K.dot(q[self.at_q] - self.rest))
        return tau + self.between.torque(q, v) if self.between else tau
