"""Passive: the robot's own springs and damping.

tau_i = - k_i (q_i - q0_i) - d_i v_i - sum_s (J_s^T n_s f_s)_i
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import Indices, indices
from condyn_pin.model.robot import Robot
from condyn_pin.model.springs import SpringDampers


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
