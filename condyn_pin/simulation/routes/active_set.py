"""ActiveSet: the exact derivatives within the modes of a step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

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
from condyn_pin.simulation.routes.law import Law

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
        return _of_modes(problem, lam, modes)


def polished(problem: ContactProblem, lam: Array) -> Array:
    """Return impulses to rounding; SolveFailed if Newton's method does not find them."""
    if not len(lam) or natural_residual(problem, lam) <= tolerances.CONTACT_POLISHED:
        return lam
    found = refine(problem, lam, _STEPS).lam
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


def _of_modes(problem: ContactProblem, lam: Array, modes: Modes) -> Law:
    """Return the law of contacts in their modes."""
    m, mu, sets = problem.rows, problem.friction, problem.sets
    k, sigma = len(mu), problem.velocities(lam)
    of_cones = modes[:k]
    slides = (of_cones == SLIDE) | ((of_cones == STICK) & (mu == 0))  # ice holds nothing
    held = (modes == STICK) & ~np.pad(slides, (0, len(modes) - k))
    rows = held[sets.blocks].astype(np.float64)
    by_sigma, by_lam, by_friction = np.diag(rows), np.diag(1.0 - rows), np.zeros((m, k))
    if slides.any():
        i = np.flatnonzero(slides)
        n, t = 3 * i + 2, 3 * i[:, None] + np.arange(2)
        S = sigma[t]
        slip = np.hypot(S[:, 0], S[:, 1])
        s = S / np.where(slip > 0, slip, 1.0)[:, None]  # without friction there may be none
        across = np.stack((-s[:, 1], s[:, 0]), axis=1)
        turns = mu[i] * lam[n] / np.where(slip > 0, slip, 1.0)
        by_sigma[t[:, :, None], t[:, None]] = (
            turns[:, None, None] * across[:, :, None] * across[:, None]
        )
        by_lam[t, n[:, None]] = mu[i][:, None] * s
        by_friction[t, i[:, None]] = lam[n][:, None] * s
        by_lam[n, n], by_sigma[n, n] = 0.0, 1.0
        if problem.law == "ccp":
            by_sigma[n[:, None], t], by_friction[n, i] = -mu[i][:, None] * s, -slip
    return Law(lam, by_sigma, by_lam, by_friction, margin(problem, lam, sigma, modes))


def margin(problem: ContactProblem, lam: Array, sigma: Array, modes: Modes) -> float:
    """Return how far the nearest contact is from another mode."""
    stiff, speed = problem.scale
    x, y, (cones, lines, dry) = lam * stiff / speed, sigma / speed, problem.sets.parts
    X, Y, mu = x[cones].reshape(-1, 3), y[cones].reshape(-1, 3), problem.friction
    k, stops = len(mu), problem.half_lines
    slip, pull = np.hypot(Y[:, 0], Y[:, 1]), np.hypot(X[:, 0], X[:, 1])
    dual = Y[:, 2] - (mu * slip if problem.law == "ccp" else 0.0)
    off = np.where(modes[:k] == OPEN, dual, X[:, 2])
    off = np.where(modes[:k] == STICK, np.minimum(off, mu * X[:, 2] - pull), off)
    off = np.where((modes[:k] == SLIDE) & (mu > 0), np.minimum(off, slip), off)
    off = np.where((modes[:k] == STICK) & (mu == 0), X[:, 2], off)
    of_lines = np.where(modes[k : k + stops] == OPEN, y[lines], x[lines])
    limits = problem.limits * stiff / speed
    of_dry = np.where(modes[k + stops :] == STICK, limits - np.abs(x[dry]), np.abs(y[dry]))
    return float(np.concatenate((off, of_lines, of_dry)).min(initial=np.inf))
