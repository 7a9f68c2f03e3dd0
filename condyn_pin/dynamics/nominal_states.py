"""Nominal states: what a method is measured by, with the accelerations of `Reference`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import MinimumNorm
from condyn_pin.constraints.rows.bound import Terms, largest_torque
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.solvers.reference import Reference


@dataclass(frozen=True, eq=False)
class NominalState:
    """A state on the constraints, and the accelerations there by `Reference`.

    Attributes
    ----------
    size : float
        What errors of a are relative to: the larger of |a|_inf and gravity [rad/s^2, m/s^2].
    torque : float
        The same for forces: the largest torque in the equation of a joint [N, N m].
    """

    q: Array
    v: Array
    tau: Array
    a: Array
    size: float
    torque: float

    @classmethod
    def of(
        cls, q: Array, v: Array, tau: Array, a: Array, terms: Terms, gravity: float
    ) -> NominalState:
        """Return the state with its sizes."""
        size = max(float(np.abs(a).max()), gravity) or 1.0
        return cls(q, v, tau, a, size, largest_torque(terms, tau, size))


def nominal_states(
    equations: Equations, q: Array, factors: MinimumNorm, P: Array
) -> tuple[NominalState, ...]:
    """Return a state at rest, and one moving along the constraints under random torques."""
    rng = np.random.default_rng(0)
    nv, gravity = equations.model.nv, float(np.linalg.norm(equations.model.gravity.linear))
    # torques that alone would accelerate every joint by about 1 rad/s^2 or 1 m/s^2
    push = factors.L @ (factors.L.T @ rng.normal(size=nv))
    made = []
    for v, tau in ((np.zeros(nv), np.zeros(nv)), (factors.tangent(rng.normal(size=nv)), push)):
        terms = equations.terms(q, v)
        a, _ = Reference().solve(terms, tau, P)
        made.append(NominalState.of(q, v, tau, a, terms, gravity))
    return tuple(made)
