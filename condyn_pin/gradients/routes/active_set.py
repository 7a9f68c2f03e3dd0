"""ActiveSet: the exact derivatives within the modes of a step."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf
from typing import ClassVar, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import (
    OPEN,
    SLIDE,
    ContactProblem,
    ContactsInModes,
    Modes,
    contact_modes,
)
from condyn_pin.contact.residuals import natural_residual
from condyn_pin.contact.solution import attempt_contact
from condyn_pin.contact.solvers.newton import SemismoothNewton, refine
from condyn_pin.errors import SolveFailed
from condyn_pin.gradients.routes.route import LawRoute
from condyn_pin.gradients.routes.step_derivatives import ContactLaw, minimum_norm_solution

# Steps of Newton's method from an answer: one or two, but for redundant contacts.
_STEPS = 50

# What redundant contacts leave of the natural map: modes are read there all the same.
_GOOD_ENOUGH = 100 * tolerances.CONTACT_POLISHED


@dataclass(frozen=True)
class ActiveSet(LawRoute):
    """The derivatives of the step itself, with each contact in its present mode.

    open   lam = 0
    stick  sigma = 0
    slide  sigma_n = 0,  lam_t + mu lam_n s = 0,  s = sigma_t / |sigma_t|

    In a ccp what slides has sigma_n = mu |sigma_t|. Modes are read off impulses that Newton's
    method has polished. Where contacts are redundant, the impulses change by the least that does
    it.

    Notes
    -----
    Exact, and one-sided if a contact is about to change its mode. A sticking contact has zero
    derivatives in the directions that it holds, however near it is to slipping. For a contact that
    closes within the step, the derivative is that of the time step and not of the time of impact,
    which `EventLocated` includes.

    References
    ----------
    Werling, Omens, Lee, Exarchos, Liu. Fast and feature-complete differentiable physics for
    articulated rigid bodies with contact. RSS, 2021.
    """

    title: ClassVar[str] = "active set"
    cost: ClassVar[str] = "two evaluations of Newton-Euler's derivatives"
    use: ClassVar[str] = "by default: exact within the modes of the step"

    def law(self, problem: ContactProblem, lam: Array, natural: float, size: float) -> ContactLaw:
        """Return the polished impulses of a problem, and the law of each mode."""
        lam, modes, equations = polished(problem, lam, natural)
        of = equations.at(lam)
        distance = margin(problem, lam, of.sigma, modes)
        return ContactLaw(lam, of.by_sigma, of.by_lam, of.by_friction, distance, modes=modes)


class PolishedImpulses(NamedTuple):
    """Impulses to rounding, the mode of each contact, and the equations that go with it."""

    lam: Array
    modes: Modes
    equations: ContactsInModes


def polished(problem: ContactProblem, lam: Array, natural: float) -> PolishedImpulses:
    """Return impulses to rounding, of some with a `natural` residual.

    SolveFailed if Newton's method does not find them.
    """
    good = tolerances.CONTACT_POLISHED
    if not len(lam) or natural <= good:
        return _read_modes(problem, lam)
    within = _within_modes(problem, lam)
    if natural_residual(problem, within.lam) <= good:
        return within
    found = refine(problem, lam, _STEPS).lam
    if natural_residual(problem, found) <= good:
        return _read_modes(problem, found)
    attempt, natural = attempt_contact(problem, SemismoothNewton(), found, good)
    if natural <= _GOOD_ENOUGH:
        return _read_modes(problem, attempt.lam)
    raise SolveFailed(
        f"contacts {', '.join(problem.names)}: the natural residual stays at {natural:.1e}, and "
        f"modes are read at {_GOOD_ENOUGH:g}; take Kappa(), which needs none",
        None,
    )


def _read_modes(problem: ContactProblem, lam: Array) -> PolishedImpulses:
    """Return polished impulses with the modes that they have."""
    modes = contact_modes(problem, lam, 100 * tolerances.CONTACT_POLISHED)
    return PolishedImpulses(lam, modes, ContactsInModes(problem, modes))


def _within_modes(problem: ContactProblem, lam: Array) -> PolishedImpulses:
    """Return the end of one step of Newton's method in the modes that impulses seem to have."""
    modes = contact_modes(problem, lam)
    equations = ContactsInModes(problem, modes)
    of = equations.at(lam)
    G = problem.G if problem.R is None else problem.G + np.diag(problem.R)
    return PolishedImpulses(
        lam - minimum_norm_solution(of.by_sigma.dot(G) + of.by_lam, of.left), modes, equations
    )


def margin(problem: ContactProblem, lam: Array, sigma: Array, modes: Modes) -> float:
    """Distance of the nearest contact from another mode, in units of the problem [1]."""
    (stiff, speed), sets, codes = problem.scale, problem.sets, modes.tolist()
    x, y = (lam * stiff / speed).tolist(), (sigma / speed).tolist()
    (t1, t2, n), mu = sets.axes, sets.coefficients
    lift = mu if problem.law == "ccp" else len(mu) * [0.0]
    off = [*map(_off_of_a_cone, codes, mu, lift, x[t1], x[t2], x[n], y[t1], y[t2], y[n])]
    if len(codes) > len(mu):
        (_, lines, dry), stops = sets.parts, len(mu) + problem.half_lines
        of_lines = zip(codes[len(mu) : stops], x[lines], y[lines], strict=True)
        off += [slow if mode == OPEN else pushed for mode, pushed, slow in of_lines]
        limits = (problem.limits * stiff / speed).tolist()
        of_dry = zip(codes[stops:], limits, x[dry], y[dry], strict=True)
        off += [_off_of_dry(*of_one) for of_one in of_dry]
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


def _off_of_dry(mode: int, most: float, l: float, s: float) -> float:  # noqa: E741
    if mode == SLIDE:
        return abs(s)
    return most - abs(l) if most else inf
