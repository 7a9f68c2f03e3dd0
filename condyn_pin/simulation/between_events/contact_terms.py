"""ContactTerms: all that equations of motion with contacts are made of, at one state.

M a + h = tau + J_b^T l_b + J_c^T lam,    J_b a + gamma = 0,    sigma' = J_c a + Jdot_c v

with gamma less s'' for rows that are driven along s(t): they move at J_b v = s'.
"""

from __future__ import annotations

from functools import cached_property
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.linalg import MinimumNorm, factorise
from condyn_pin._core.trees import algorithms
from condyn_pin.contact.condense import Condensed, condense
from condyn_pin.errors import StepFailed
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.system import System

# A contact that is nearer touches [m, rad]: what steps close is open by rounding.
_TOUCHING = 1e-9

# Speeds that are none: normal ones are taken away to rounding where a contact rests, and slip that
# would end within a nanosecond [m/s, rad/s]. Relative to the speed of the robot where it is faster.
_RESTING = 1e-10
_STILL = 1e-9


class ContactTerms:
    """A system with contacts at one state; no array is written to later.

    StepFailed if the state, or what acts there, is not finite.

    Attributes
    ----------
    t : float
        Time [s].
    q, v, tau : array
        The state, and the torques with springs and damping.
    M, h, J_b, gamma : array
        As in the equation.
    gaps : (k,) array
        Of cones and half-lines [m, rad].
    J, drift : (rows, nv), (rows,) array
        J_c and Jdot_c v of all candidates.
    sigma : (rows,) array
        J_c v [m/s, rad/s].
    path : (3, m) array
        s, s' and s'' of what is driven; zero of all other constraints.
    """

    def __init__(self, system: System, t: float, q: Array, v: Array) -> None:
        self._system, self.t, self.q, self.v = system, t, q, v
        self._check_finite(q, v)
        candidates, data = system.contacts, system.equations.data
        self.tau = system.torque(t, q, v)
        system.at(t)
        self.path = system.equations.wanted.copy()
        self.M, self.h, self.J_b, self.gamma = system.equations.consistent_parts(q, v)
        self.gaps, self.J = candidates.evaluate(data, q)
        algorithms(data).forwardKinematics(system.model, data, q, v, np.zeros(len(v)))
        self.drift = candidates.drift(data)
        self.sigma = self.J.dot(v)
        self._check_finite(self.tau, self.h, self.drift, self.gamma)

    def _check_finite(self, *parts: Array) -> None:
        if not isfinite(sum(float(part.dot(part)) for part in parts)):
            raise StepFailed(
                f"t = {self.t:g} s: the motion is not finite, its numbers overflow; look at v, tau "
                "and masses, or take a smaller dt"
            )

    @cached_property
    def factors(self) -> MinimumNorm:
        """Of M and J_b."""
        why = singular_mass(self._system.model, self.q)
        return factorise(self.M, self.J_b, tolerances.RANK, why=why)

    @cached_property
    def fastest(self) -> float:
        """The largest speed of the robot, or 1 [m/s, rad/s]."""
        return max(1.0, float(np.abs(self.v).max(initial=0.0)))

    @property
    def closing(self) -> Array:
        """D gap/dt of cones and half-lines [m/s, rad/s]."""
        return np.asarray(self.sigma[self._system.contacts.normals])

    @property
    def touches(self) -> NDArray[np.bool_]:
        """Which cones and half-lines touch."""
        return np.asarray(self.gaps <= _TOUCHING)

    @property
    def approaches(self) -> NDArray[np.bool_]:
        """Which of them touch and would go through."""
        return np.asarray(self.touches & (self.closing < -_RESTING * self.fastest))

    @property
    def rests(self) -> NDArray[np.bool_]:
        """Which of them touch, and neither go through nor leave."""
        return np.asarray(self.touches & (np.abs(self.closing) <= _RESTING * self.fastest))

    @cached_property
    def tangent(self) -> Array:
        """Slip of the cones along t1 and t2 (cones, 2) [m/s]."""
        return np.asarray(self.sigma[: 3 * self._system.contacts.cones].reshape(-1, 3)[:, :2])

    @cached_property
    def speed(self) -> Array:
        """How fast cones slide (cones,) [m/s]."""
        return np.hypot(self.tangent[:, 0], self.tangent[:, 1])

    @property
    def slides(self) -> NDArray[np.bool_]:
        """Which cones slide (cones,); what is slower than that counts as still."""
        return np.asarray(self.speed > _STILL * self.fastest)

    @property
    def dry(self) -> Array:
        """Velocities along dry friction [rad/s, m/s], zero where they are none."""
        count = self._system.contacts.intervals
        v = self.sigma[len(self.sigma) - count :]
        return np.where(np.abs(v) > _STILL * self.fastest, v, 0.0)

    def forced(self, rows: Indices) -> Condensed:
        """Return the rows of contacts with the constraints eliminated, for accelerations."""
        J_c, still = self.J[rows], np.zeros(len(self.v))
        rates = self.path[1:] if self._system.scene.is_driven else None
        return condense(self.factors, J_c, still, self.tau - self.h, -self.gamma, rates)

    def struck(self, rows: Indices) -> Condensed:
        """Return the same for impulses: finite forces have no part in them."""
        none = np.zeros(len(self.v))
        rates = self.path[1]
        driven = rates if self._system.scene.is_driven else None
        return condense(self.factors, self.J[rows], self.v, none, rates, driven)

    def held(self, v: Array, rows: Indices) -> Array:
        """Return the nearest velocity with which constraints are kept and these rows still."""
        if not len(rows) and not len(self.J_b):
            return v
        J = np.concatenate((self.J_b, self.J[rows]))
        why = singular_mass(self._system.model, self.q)
        wanted = np.concatenate((self.path[1], np.zeros(len(rows))))
        return factorise(self.M, J, tolerances.RANK, why=why).at_rates(v, wanted)
