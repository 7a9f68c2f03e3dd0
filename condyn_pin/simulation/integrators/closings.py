"""Closings: what a step leaves open of loops is closed behind it.

    q (+) -M^-1 J_b^T (J_b M^-1 J_b^T)^-1 c(q),    again and again, to rounding

With the factors of the step, where that will do.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import NamedTuple

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import MinimumNorm
from condyn_pin.simulation.system import System

# Newton's steps that close loops behind a step, at most: a few, and more beside a dead point.
_CLOSINGS = 10

# A gap that is left to rounding [m, rad].
CLOSED = 1e-13

# Gaps that the factors of the step still close, each time up to a share dt |v| [m, rad].
SMALL = 1e-6


class Closing(NamedTuple):
    """A part of the way on which loops are closed, by the same factors."""

    factors: MinimumNorm  # of the step, or of `begin`
    begin: Array
    end: Array


class Closings:
    """The closing of the loops of one system.

    Parameters
    ----------
    system : System
    factors : (M, J_b, q) -> MinimumNorm
        Those that a step at q would have.
    """

    def __init__(
        self, system: System, factors: Callable[[Array, Array, Array], MinimumNorm]
    ) -> None:
        self._system, self._equations, self._factors = system, system.equations, factors

    def closed(self, of_step: MinimumNorm, q: Array) -> Array:
        """Return q with loops closed."""
        return self.way(of_step, q)[-1].end if of_step.rank else q

    def work(self, q: Array, q1: Array, v: Array) -> float:
        """Return what it does to the energy to move q to q1 where loops are closed [J]."""
        model, data, passive = self._system.model, self._equations.data, self._system.passive
        won = pin.computeMechanicalEnergy(model, data, q1, v)
        won -= pin.computeMechanicalEnergy(model, data, q, v)
        if len(passive.k) or passive.between:
            won += float(passive.energy(q1) - passive.energy(q))
        return float(won)

    def way(self, of_step: MinimumNorm, q: Array) -> list[Closing]:
        """Return how q goes to where its loops are closed: a part of the way for all factors."""
        way, least = [Closing(of_step, q, q)], inf
        for _ in range(_CLOSINGS if of_step.rank else 0):
            c = self._equations.violation(q)
            gap = max(map(abs, c.tolist()))
            if not gap < least:  # rounding, or out of reach
                break
            way[-1], least = way[-1]._replace(end=q), gap
            if gap <= CLOSED:
                break
            if gap > SMALL:
                J = self._equations.consistent_jacobian(q)
                factors = self._factors(self._system.mass(q), J, q)
                way.append(Closing(factors, q, q))
            q = self._system.integrate(q, way[-1].factors.closing(c))
        return way
