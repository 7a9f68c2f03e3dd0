"""How redundant contacts share a load: evenly if they can, else as far from limits as there is.

    lam = E x + f,    R (G E) x + R (G f + g) = 0,    x = x_0 + Z y,    (R G E) Z = 0

All of them move the robot alike. The smallest forces are a function of the state alone; where they
would pull, or leave a cone, y is found that keeps all within by as much as possible,

    max s,    lam_n >= s,    mu lam_n - d . lam_t >= s  for directions d in the ground,

a linear program, with the directions of the forces that it finds among d the next time. Only where
none are within has a contact come to its end.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.problem import OPEN, SLIDE, STICK
from condyn_pin.simulation.between_events.contact_terms import ContactTerms
from condyn_pin.simulation.between_events.margins import margins
from condyn_pin.simulation.between_events.mode_dynamics import Held, ModeDynamics

# A margin, relative to the largest force, that is zero: an event is found to rounding of its time.
AT_ITS_END = 1e-6

# Directions in the ground to begin with, and how often more are added.
_SIDES, _MORE = 8, 12


class Shares(NamedTuple):
    """The modes of a scene with the forces that redundant contacts stay near to."""

    dynamics: ModeDynamics
    held: Held
    least: float  # the least margin, relative to the largest force


def shared(candidates: Candidates, dynamics: ModeDynamics, terms: ContactTerms) -> Shares:
    """Return the same modes with forces of contacts within their limits, if there are any."""
    even = _with(candidates, dynamics, terms, np.zeros(len(terms.J)))
    if even.least > AT_ITS_END:
        return even
    found = _with(candidates, dynamics, terms, dynamics.lam)
    if found.least > AT_ITS_END:
        return found
    lam = _centred(candidates, found, terms)
    return found if lam is None else max(found, _with(candidates, dynamics, terms, lam), key=_least)


def _least(shares: Shares) -> float:
    return shares.least


def _with(
    candidates: Candidates, dynamics: ModeDynamics, terms: ContactTerms, lam: Array
) -> Shares:
    dynamics = dynamics.with_forces(lam)
    held = dynamics.solve(terms)
    parts = margins(candidates, dynamics, terms, terms, held, 0.0)[1:4]
    largest = float(np.abs(held.lam).max(initial=0.0)) or 1.0
    return Shares(dynamics, held, min(float(part.min(initial=np.inf)) for part in parts) / largest)


def _centred(candidates: Candidates, found: Shares, terms: ContactTerms) -> Array | None:
    """Return forces (rows,) as far within their limits as any; None if there is no choice."""
    from scipy.optimize import linprog

    free = found.dynamics.free_forces(terms)
    if not free.shape[1]:
        return None
    lam0 = best = found.held.lam
    size = float(np.abs(lam0).max(initial=0.0)) or 1.0
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    facets = [np.column_stack((np.cos(angles), np.sin(angles)))] * candidates.cones
    for _ in range(_MORE):
        C, b = _limits(candidates, found.dynamics, facets)
        # C (lam0 + free y) + b >= s size
        A = np.column_stack((-C @ free, np.full(len(C), size)))
        cost = np.r_[np.zeros(free.shape[1]), -1.0]
        bounds = [(None, None)] * free.shape[1] + [(None, 1.0)]
        answer = linprog(cost, A_ub=A, b_ub=C @ lam0 + b, bounds=bounds)
        if answer.status != 0:
            return best
        best = np.asarray(lam0 + free @ answer.x[:-1])
        F = best[: 3 * candidates.cones].reshape(-1, 3)[:, :2]
        pull = np.hypot(F[:, 0], F[:, 1])
        within = _with(candidates, found.dynamics, terms, best).least
        if within > answer.x[-1] / 2 or not answer.x[-1] > AT_ITS_END:
            return best
        facets = [
            np.vstack((d, f / p)) if p else d for d, f, p in zip(facets, F, pull, strict=True)
        ]
    return best


def _limits(
    candidates: Candidates, dynamics: ModeDynamics, facets: list[Array]
) -> tuple[Array, Array]:
    """Return C and b of the limits C lam + b >= 0 of what presses and sticks."""
    rows, first = list[Array](), candidates.rows - candidates.intervals
    one, mu = np.eye(candidates.rows), candidates.friction
    for i, mode in enumerate(dynamics.of_cones):
        if mode != OPEN:
            rows.append(one[3 * i + 2])
        if mode == STICK and mu[i] > 0:
            rows += [mu[i] * one[3 * i + 2] - d @ one[3 * i : 3 * i + 2] for d in facets[i]]
    lines = dynamics.modes[candidates.cones : candidates.cones + candidates.half_lines]
    rows += [one[3 * candidates.cones + k] for k in np.flatnonzero(lines == STICK)]
    b = [0.0] * len(rows)
    for k in np.flatnonzero(dynamics.of_dry == STICK):
        rows += [one[first + k], -one[first + k]]
        b += [float(candidates.limits[k])] * 2
    return np.array(rows).reshape(-1, candidates.rows), np.array(b)


def let_go(candidates: Candidates, shares: Shares) -> ModeDynamics:
    """Return the modes in which what has come to its end lets go, or slips."""
    dynamics, lam = shares.dynamics, shares.held.lam
    k, lines, first = (
        candidates.cones,
        candidates.half_lines,
        candidates.rows - candidates.intervals,
    )
    end = AT_ITS_END * float(np.abs(lam).max(initial=0.0))
    F, mu, modes = lam[: 3 * k].reshape(-1, 3), candidates.friction, dynamics.modes.copy()
    along, sense = dynamics.along.copy(), dynamics.sense.copy()
    pull = np.hypot(F[:, 0], F[:, 1])
    slips = (modes[:k] == STICK) & (mu > 0) & (mu * F[:, 2] - pull < end) & (pull > 0)
    along[slips] = -F[slips, :2] / pull[slips, None]
    modes[:k][slips] = SLIDE
    modes[: k + lines][lam[candidates.normals] < end] = OPEN
    dry = (modes[k + lines :] == STICK) & (candidates.limits - np.abs(lam[first:]) < end)
    sense[dry] = -np.sign(lam[first:][dry])
    modes[k + lines :][dry] = SLIDE
    return ModeDynamics(candidates, modes, along, sense, lam)
