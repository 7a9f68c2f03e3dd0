"""Margins: how far contacts are from the next event.

    open     gap                         then it touches
    closed   lam_n                       lets go
    stick    mu lam_n - |lam_t|          slips
    slide    sigma_t . s                 stands still

An event is where a margin falls to zero. A contact that leaves has a gap of zero to begin with: its
gap over the share of the step that is made has none, and is zero where it returns.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.problem import OPEN, SLIDE, STICK
from condyn_pin.simulation.between_events.contact_terms import ContactTerms
from condyn_pin.simulation.between_events.mode_dynamics import Held, ModeDynamics

# Gaps, forces relative to the largest, and speeds relative to that of the robot, that are zero but
# for rounding: redundant contacts have them all the time.
_GAP = 1e-12
_FORCE = 1e-9
_SPEED = 1e-9


class Margins(NamedTuple):
    """Margins at a state, each an array.

    Attributes
    ----------
    gaps, forces : (cones + half_lines,) array
        [m, rad], [N, N m]; infinite of what is in the other mode.
    cones, dry : array
        Of friction that sticks [N, N m]; infinite of what slides.
    slips, dry_slips : array
        Speeds of what slides [m/s, rad/s]; infinite of what sticks.
    """

    gaps: Array
    forces: Array
    cones: Array
    dry: Array
    slips: Array
    dry_slips: Array


def margins(
    candidates: Candidates,
    dynamics: ModeDynamics,
    begun: ContactTerms,
    terms: ContactTerms,
    held: Held,
    share: float,
) -> Margins:
    """Return the margins at a state that a share of a step leads to from where it began."""
    k, lines, mu = candidates.cones, candidates.cones + candidates.half_lines, candidates.friction
    is_open, inf = dynamics.modes[:lines] == OPEN, np.inf
    gone = (terms.gaps - np.minimum(begun.gaps, 0.0)) / (share or 1.0)
    gaps = np.where(begun.touches, gone, terms.gaps)
    F = held.lam[: 3 * k].reshape(-1, 3)
    stick = mu * F[:, 2] - np.hypot(F[:, 0], F[:, 1])
    slip = np.einsum("kx,kx->k", terms.tangent, dynamics.ahead(terms.t))
    dry = slice(candidates.rows - candidates.intervals, None)
    rough = mu > 0
    return Margins(
        np.where(is_open, gaps, inf),
        np.where(is_open, inf, held.lam[candidates.normals]),
        np.where((dynamics.of_cones == STICK) & rough, stick, inf),
        np.where(dynamics.of_dry == STICK, candidates.limits - np.abs(held.lam[dry]), inf),
        np.where((dynamics.of_cones == SLIDE) & rough, slip, inf),
        np.where(dynamics.of_dry == SLIDE, dynamics.sense * terms.sigma[dry], inf),
    )


def fallen(
    now: Margins, held: Held, terms: ContactTerms, begun: ContactTerms
) -> list[tuple[int, int]]:
    """Return which margins have fallen below zero, by more than rounding: part and place in it."""
    force = _FORCE * float(np.abs(held.lam).max(initial=0.0))
    speed = _SPEED * terms.fastest
    gap = np.where(begun.touches, _GAP, 0.0)
    least: tuple[Any, ...] = (gap, force, force, force, speed, speed)
    return [
        (part, int(i))
        for part, (values, zero) in enumerate(zip(now, least, strict=True))
        for i in np.flatnonzero(values < -zero)
    ]
