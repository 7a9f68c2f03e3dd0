"""Torques: those that are applied, and the robot's own springs and damping.

tau_i = applied_i - k_i (q_i - q0_i) - d_i v_i
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin.arguments import FLOAT
from condyn_pin.arrays import Array, finite, locked
from condyn_pin.joints import Indices, indices
from condyn_pin.knobs import check_called
from condyn_pin.robot import Robot

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

    Attributes
    ----------
    constant : (nv,) array or None
        Not to be written to; None if they are a function.
    """

    def __init__(self, nv: int, tau: float | ArrayLike | Torque) -> None:
        self._shape = (nv,)
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
        tau = self._function(t, locked(q), locked(v))
        if not (type(tau) is np.ndarray and tau.shape == self._shape and tau.dtype == FLOAT):
            tau = finite(f"tau({t:g}, q, v)", tau, self._shape)
        if self._first is None:
            self._first, self._state = tau.copy(), (q, v)
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
    """

    d: Array
    k: Array
    rest: Array
    at_q: Indices
    at_v: Indices

    @staticmethod
    def of(robot: Robot, *, springs: bool = True, damping: bool = True) -> Passive:
        """Return those of a robot that are on."""
        chosen = [spring for spring in robot.springs if springs and spring.stiffness]
        at_q, at_v = indices(robot.model, [spring.joint for spring in chosen])
        return Passive(
            np.array(robot.model.damping, dtype=float) * damping,
            np.array([spring.stiffness for spring in chosen]),
            np.array([spring.reference for spring in chosen]),
            at_q,
            at_v,
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
        return not (self.d.any() or self.k.any())

    def inertia(self, dt: float) -> Array:
        """Return dt D + dt^2 K (nv,): what they add to M at the end of a step [kg, kg m^2]."""
        return dt * self.d + dt**2 * self.stiffness

    def energy(self, q: Array) -> Array:
        """Return the energy of the springs at configurations q (..., nq) [J]."""
        return np.asarray(0.5 * (q[..., self.at_q] - self.rest) ** 2 @ self.k)

    def torque(self, q: Array, v: Array) -> Array:
        """Return the torques of springs and damping (nv,) [N, N m]."""
        return np.asarray(-self.d * v - self.K.dot(q[self.at_q] - self.rest))

    def with_torques(self, applied: Applied, drag: Array | None = None) -> Torque:
        """Return the torques applied with those of springs and damping; drag is more damping."""
        d = self.d if drag is None else self.d + drag
        sprung = len(self.k) > 0
        if not (d.any() or sprung):
            return applied
        K, at_q, rest = self.K, self.at_q, self.rest

        def torque(t: float, q: Array, v: Array) -> Array:
            pull = d * v
            if sprung:
                pull += K.dot(q[at_q] - rest)
            return applied(t, q, v) - pull

        return torque


def _same(one: tuple[Array, Array], other: tuple[Array, Array]) -> bool:
    """Whether two states are the very same arrays."""
    return one[0] is other[0] and one[1] is other[1]


def _is_zero(tau: object) -> bool:
    """Whether it is the number zero, which stands for no torque."""
    return isinstance(tau, (int, float)) and tau == 0
