"""ActiveSet: the exact derivatives within the modes of a step."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf
from typing import ClassVar, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.judge import attempt_contact
from condyn_pin.contact.modes import OPEN, SLIDE, STICK, Modes, contact_modes
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.residuals import natural_residual
from condyn_pin.contact.solvers.newton import SemismoothNewton, refine
from condyn_pin.errors import SolveFailed
from condyn_pin.simulation.routes.base import LawRoute
from condyn_pin.simulation.routes.law import Law, least

# Steps of Newton's method from an answer: one or two, but for redundant contacts.
_STEPS = 50

# What redundant contacts leave of the natural map: modes are read there all the same.
_GOOD_ENOUGH = 100 * tolerances.CONTACT_POLISHED


@dataclass(frozen=True)
class ActiveSet(LawRoute):
    """The derivatives of the step itself, each contact in the mode that it has.

    open   lam = 0
    stick  sigma = 0
    slide  sigma_n = 0,  lam_t + mu lam_n s = 0,  s = sigma_t / |sigma_t|

    In a ccp what slides has sigma_n = mu |sigma_t|. Modes are read off impulses that Newton's
    method has polished. Where contacts are redundant, the impulses change by the least that does
    it.

    Notes
    -----
    Exact, and one-sided where a contact is about to change its mode. A contact that sticks has no
    slope in the directions that it holds, however near it is to slipping, and one that closes
    within the step has that of the time step, not of the time of the impact: `EventLocated` has it.

    References
    ----------
    Werling, Omens, Lee, Exarchos, Liu. Fast and feature-complete differentiable physics for
    articulated rigid bodies with contact. RSS, 2021.
    """

    title: ClassVar[str] = "active set"
    cost: ClassVar[str] = "two evaluations of Newton-Euler's derivatives"
    use: ClassVar[str] = "by default: exact within the modes of the step"

    def law(self, problem: ContactProblem, lam: Array, size: float) -> Law:
        """Return the polished impulses of a problem, and the law of each mode."""
        lam = polished(problem, lam)
        modes = contact_modes(problem, lam, 100 * tolerances.CONTACT_POLISHED)
        of = _in_modes(problem, lam, modes)
        distance = margin(problem, lam, problem.velocities(lam), modes)
        return Law(lam, of.by_sigma, of.by_lam, of.by_friction, distance)


def polished(problem: ContactProblem, lam: Array) -> Array:
    """Return impulses to rounding; SolveFailed if Newton's method does not find them."""
    if not len(lam) or natural_residual(problem, lam) <= tolerances.CONTACT_POLISHED:
        return lam
    for newton in (_within_modes, _of_the_natural_map):
        found = newton(problem, lam)
        if natural_residual(problem, found) <= tolerances.CONTACT_POLISHED:
            return found
    attempt, natural = attempt_contact(
        problem, SemismoothNewton(), found, tolerances.CONTACT_POLISHED
    )
    if natural <= _GOOD_ENOUGH:
        return attempt.lam
    raise SolveFailed(
        f"contacts {', '.join(problem.names)}: the natural residual stays at {natural:.1e}, and "
        f"modes are read at {_GOOD_ENOUGH:g}; take Kappa(), which needs none",
        None,
    )


def _within_modes(problem: ContactProblem, lam: Array) -> Array:
    """Return the end of one step of Newton's method in the modes that impulses seem to have."""
    of = _in_modes(problem, lam, contact_modes(problem, lam))
    G = problem.G if problem.R is None else problem.G + np.diag(problem.R)
    return lam - least(of.by_sigma @ G + of.by_lam, of.left)


def _of_the_natural_map(problem: ContactProblem, lam: Array) -> Array:
    """Return the end of Newton's method whatever the modes are."""
    return refine(problem, lam, _STEPS).lam


class _Equations(NamedTuple):
    """The equations of contacts in their modes, and how they change."""

    left: Array  # (m,), what impulses leave of them
    by_sigma: Array  # (m, m)
    by_lam: Array  # (m, m)
    by_friction: Array  # (m, k)


def _in_modes(problem: ContactProblem, lam: Array, modes: Modes) -> _Equations:
    """Return the equations of all contacts, each in the mode that it has."""
    mu, sets = problem.friction, problem.sets
    k, sigma, held = len(mu), problem.velocities(lam), (modes == STICK)[sets.blocks]
    left, by_friction = np.where(held, sigma, lam), np.zeros((problem.rows, k))
    by_sigma, by_lam = np.diag(1.0 * held), np.diag(1.0 * ~held)
    # ice holds nothing
    i = np.flatnonzero((modes[:k] == SLIDE) | ((modes[:k] == STICK) & (mu == 0)))
    if len(i):
        own = 3 * i[:, None] + np.arange(3)
        of = _sliding(lam[own], sigma[own], mu[i, None], problem.law == "ccp")
        left[own], by_friction[own, i[:, None]] = of.left, of.by_friction
        square = own[:, :, None], own[:, None]
        by_sigma[square], by_lam[square] = of.by_sigma, of.by_lam
    return _Equations(left, by_sigma, by_lam, by_friction)


def _sliding(lam: Array, sigma: Array, mu: Array, is_convex: bool) -> _Equations:
    """Return the equations of k contacts that slide, three rows and three columns each.

    With s' = (1 - s s^T) sigma_t' / |sigma_t|. What stands without friction has any s.
    """
    slip = np.hypot(sigma[:, :1], sigma[:, 1:2])
    moving = np.where(slip > 0, slip, 1.0)
    s, l_n = sigma[:, :2] / moving, lam[:, 2:]
    left, by_friction = np.empty_like(lam), np.zeros_like(lam)
    by_sigma, by_lam = np.zeros((2, len(lam), 3, 3))
    left[:, :2], left[:, 2] = lam[:, :2] + mu * l_n * s, sigma[:, 2]
    across = np.eye(2) - s[:, :, None] * s[:, None]
    by_sigma[:, :2, :2], by_sigma[:, 2, 2] = (mu * l_n / moving)[:, :, None] * across, 1.0
    by_lam[:, :2, :2], by_lam[:, :2, 2], by_friction[:, :2] = np.eye(2), mu * s, l_n * s
    if is_convex:
        left[:, 2:] -= mu * slip
        by_sigma[:, 2, :2], by_friction[:, 2] = -mu * s, -slip[:, 0]
    return _Equations(left, by_sigma, by_lam, by_friction)


def margin(problem: ContactProblem, lam: Array, sigma: Array, modes: Modes) -> float:
    """Return how far the nearest contact is from another mode."""
    (stiff, speed), sets, codes = problem.scale, problem.sets, modes.tolist()
    x, y = (lam * stiff / speed).tolist(), (sigma / speed).tolist()
    (t1, t2, n), (_, lines, dry), mu = sets.axes, sets.parts, sets.coefficients
    lift = mu if problem.law == "ccp" else len(mu) * [0.0]
    off = [*map(_off_of_a_cone, codes, mu, lift, x[t1], x[t2], x[n], y[t1], y[t2], y[n])]
    stops = len(mu) + problem.half_lines
    off += [
        slow if mode == OPEN else pushed
        for mode, pushed, slow in zip(codes[len(mu) : stops], x[lines], y[lines], strict=True)
    ]
    limits = (problem.limits * stiff / speed).tolist()
    off += [
        most - abs(held) if mode == STICK else abs(slow)
        for mode, most, held, slow in zip(codes[stops:], limits, x[dry], y[dry], strict=True)
    ]
    return min(off, default=inf)


def _off_of_a_cone(
    mode: int, mu: float, lift: float,
    l1: float, l2: float, ln: float, s1: float, s2: float, sn: float,
) -> float:  # fmt: skip
    slip = hypot(s1, s2)
    if mode == OPEN:
        return sn - lift * slip
    if not mu:
        return ln
    return min(ln, slip if mode == SLIDE else mu * ln - hypot(l1, l2))
