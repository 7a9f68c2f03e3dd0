"""Torques: those that are applied, and the robot's own springs and damping.

tau_i = applied_i - k_i (q_i - q0_i) - d_i v_i - sum_s (J_s^T n_s f_s)_i
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arguments import FLOAT
from condyn_pin._core.arrays import Array, finite, locked
from condyn_pin._core.joints import Indices, indices
from condyn_pin._core.parameters import check_called
from condyn_pin.model.robot import Robot
from condyn_pin.model.spring_dampers import SpringDampers

Torque = Callable[[float, Array, Array], Array]  # (t, q, v) -> (nv,) [N, N m]


class Applied:
    """The torques that are applied, and what they were when they were first asked for in a step.

    What a user's function returns is looked at: numbers of another shape would be broadcast
    without a word.

    Parameters
    ----------
    nv : int
    tau : 0, (nv,) array_like or callable
        Constant, or a function of (t, q, v) [N, N m].
    jacobian : callable, optional
        (t, q, v) -> the derivatives of that function by q and v, (nv, nv) each.

    Attributes
    ----------
    constant : (nv,) array or None
        Not to be written to; None if they are a function.
    jacobian : callable or None
    differenced : int
        How often the function was called for differences.
    """

    def __init__(
        self, nv: int, tau: float | ArrayLike | Torque, jacobian: Callable[..., Any] | None = None
    ) -> None:
        self._shape = (nv,)
        self.jacobian, self.differenced = jacobian, 0
        self._function: Torque | None = tau if callable(tau) else None
        self.constant: Array | None = None
        self._first: Array | None = None
        self._state: tuple[Array, Array] | None = None  # q and v that the first were asked for
        if callable(tau):
            check_called("tau", tau, "t, q, v")
        else:
            self.hold(finite("tau", np.zeros(nv) if _is_zero(tau) else tau, nv))

    def hold(self, tau: Array) -> None:
        """Apply these constant torques (nv,) from now on."""
        self.constant = self._first = np.array(tau)
        self.constant.flags.writeable = False

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques (nv,), not to be written to."""
        if self._function is None:
            return self.constant  # type: ignore[return-value]
        tau = self._value(self._function, t, q, v)
        if self._first is None:
            self._first, self._state = tau.copy(), (q, v)
        return tau

    def difference_at(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques of the function for a difference: they are no torques of a step."""
        assert self._function is not None
        self.differenced += 1
        return self._value(self._function, t, q, v).copy()

    def _value(self, function: Torque, t: float, q: Array, v: Array) -> Array:
        tau = function(t, locked(q), locked(v))
        if not (type(tau) is np.ndarray and tau.shape == self._shape and tau.dtype == FLOAT):
            return finite(f"tau({t:g}, q, v)", tau, self._shape)
        return tau

    def forget(self) -> None:
        """Begin another step."""
        self._first = self.constant

    def first(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques at the start of the step (nv,), not to be written to.

        Where the answer at its start was known from before, the first that were asked for are those
        of a later stage: then they are asked for now.
        """
        if self._first is None or (self._state and not _same(self._state, (q, v))):
            return self(t, q, v).copy()
        return self._first

    def at_sample(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques at a state that no step has asked for (nv,), not to be written to."""
        self.forget()
        return self.first(t, q, v)


@dataclass(frozen=True, eq=False)
class Passive:
    """Springs and damping of a robot, as arrays.

    Attributes
    ----------
    d : (nv,) array
        Damping [N m s/rad, N s/m].
    k, rest : (s,) array
        Stiffness [N m/rad, N/m] and reference [rad, m] of each spring.
    at_q, at_v : (s,) array of int
        Where q and v hold its joint.
    between : SpringDampers or None
        Springs and dampers between two frames, where there are any.
    """

    d: Array
    k: Array
    rest: Array
    at_q: Indices
    at_v: Indices
    between: SpringDampers | None = None

    @staticmethod
    def of(robot: Robot, *, springs: bool = True, damping: bool = True) -> Passive:
        """Return those of a robot that are on."""
        chosen = [spring for spring in robot.springs if springs and spring.stiffness]
        at_q, at_v = indices(robot.model, [spring.joint for spring in chosen])
        acting = [
            each
            for each in robot.spring_dampers
            if (springs and each.stiffness) or (damping and each.damping)
        ]
        return Passive(
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
        """Whether no spring and no damping acts."""
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
        """Return what the damping takes at states q (k, nq), v (k, nv), (k,) [W]."""
        power = np.asarray(v**2 @ self.d)
        return power + self.between.dissipation(q, v) if self.between else power

    def torque(self, q: Array, v: Array) -> Array:
        """Return the torques of springs and damping (nv,) [N, N m]."""
        tau = np.asarray(-self.d * v - self.K.dot(q[self.at_q] - self.rest))
        return tau + self.between.torque(q, v) if self.between else tau


def _same(one: tuple[Array, Array], other: tuple[Array, Array]) -> bool:
    """Whether two states are the very same arrays."""
    return one[0] is other[0] and one[1] is other[1]


def _is_zero(tau: object) -> bool:
    """Whether it is the number zero, which stands for no torque."""
    return isinstance(tau, (int, float)) and tau == 0
