"""PGS: Pinocchio's projected Gauss-Seidel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core.arguments import Grid, check_accuracy, check_iterations
from condyn_pin._core.arrays import Array, finite
from condyn_pin.contact.padded import padded
from condyn_pin.contact.problem import ContactProblem, Law
from condyn_pin.contact.scaling import normalised
from condyn_pin.contact.solvers.base import Attempt, ContactSolver
from condyn_pin.errors import InvalidArgument, UnsupportedBackend

# Of the largest over-relaxation that a tangential block allows; at 1 it only just converges.
_SAFE = 0.6


@dataclass(frozen=True)
class PGS(ContactSolver):
    """Projected Gauss-Seidel: one contact after the other, in sweeps.

    lam_i <- P_K(lam_i - omega d_i / G_ii)

    Parameters
    ----------
    tolerance : float
        On which Pinocchio's iteration stops, in units of the problem [1]. A hundredth of the
        natural residual that is wanted, because it is compared with the change in the last sweep.
    max_iterations : int
        Sweeps.
    over_relaxation : float, optional
        omega [1]. The tangential step is by the smaller diagonal entry of a contact's block, so
        that omega has to be below 2 min(G_11, G_22) over the largest eigenvalue of that block, or
        it never ends. By default 1, or 0.6 of that bound where it is less.

    Raises
    ------
    InvalidArgument
        If the tolerance is negative, or `max_iterations` or `over_relaxation` is not positive.

    Notes
    -----
    Only for an ncp, as in Pinocchio. Cost O(m^2) per sweep. With large mass ratios or redundant
    contacts it takes thousands of sweeps. That of Pinocchio 3 stops after the first one if there is
    no friction at all.

    References
    ----------
    Jourdan, Alart, Jean. A Gauss-Seidel like algorithm to solve frictional contact problems.
    Computer Methods in Applied Mechanics and Engineering 155, 1998.
    """

    title: ClassVar[str] = "PGS"
    cost: ClassVar[str] = "O(m^2) a round"
    use: ClassVar[str] = "few contacts of light legs; what other simulators do"
    laws: ClassVar[tuple[Law, ...]] = ("ncp",)
    sweeps: ClassVar[tuple[Grid, ...]] = ({"tolerance": (1e-4, 1e-6, 1e-8, 1e-10)},)

    tolerance: float = 1e-10
    max_iterations: int = 5000
    over_relaxation: float | None = None

    def __post_init__(self) -> None:
        check_accuracy("tolerance", self.tolerance)
        check_iterations(self.max_iterations)
        if (
            self.over_relaxation is not None
            and not finite("over_relaxation", self.over_relaxation, ()) > 0
        ):
            raise InvalidArgument(f"over_relaxation = {self.over_relaxation!r}: a number > 0")

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> Attempt:
        """Return the impulses after the last sweep, from `guess` or from none."""
        if not _pin.solves_contacts(True, len(problem.limits)):
            raise UnsupportedBackend(
                "dry friction of joints by PGS needs Pinocchio 4; take SemismoothNewton()"
            )
        small, unit = normalised(problem)
        rows = padded(small)
        relaxation = self._relaxation(rows.G, problem)
        if not relaxation > 0:  # nothing moves a contact along t1 or t2, by which it divides
            return Attempt(np.zeros(problem.rows), 0, (self.title,))
        found = _pin.pgs(
            rows.G, rows.g, rows.friction, rows.limits,
            tolerance=self.tolerance, max_iterations=self.max_iterations,
            over_relaxation=relaxation,
            guess=rows.spread(None if guess is None else guess / unit),
        )  # fmt: skip
        return Attempt(found.lam[rows.kept] * unit, found.iterations, (self.title,))

    def _relaxation(self, G: Array, problem: ContactProblem) -> float:
        """Return omega, or refuse one that never ends."""
        bounds = _bounds(G, len(problem.friction))
        least = float(bounds.min(initial=2.0))
        if self.over_relaxation is None:
            return min(1.0, _SAFE * least)
        if self.over_relaxation >= least:
            at = problem.names[bounds.argmin()] if len(bounds) else "Gauss-Seidel"
            raise InvalidArgument(
                f"over_relaxation = {self.over_relaxation:g}: {at} needs less than {least:.3g}, by "
                "how its mass differs along t1 and t2"
            )
        return self.over_relaxation


def _bounds(G: Array, cones: int) -> Array:
    """Return 2 min(G_11, G_22) over the largest eigenvalue of the tangential blocks (k,)."""
    t1 = 3 * np.arange(cones)
    a, b, c = G[t1, t1], G[t1 + 1, t1 + 1], G[t1, t1 + 1]
    return np.asarray(4 * np.minimum(a, b) / (a + b + np.hypot(a - b, 2 * c)))
