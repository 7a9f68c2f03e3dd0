"""How the impact with which a step begins changes with the start of the step.

    lam_i by q, v, friction, restitution and inertias,    max(J_n v', 0) by the same

with v' behind the impact. Inertias act by G alone: G' = -Y^T M' Y, with Y what unit impulses move.

A law of restitution follows the path of a contact through slip, stop and slip, or phases of several
contacts: its impulses are differenced, at states beside that of the step, to order four. All else
is that of the step behind it (`LinearSteps`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.simulation.integrators.posed import Posed

if TYPE_CHECKING:
    from condyn_pin.simulation.routes.linear_steps import LinearSteps

# Steps of differences: of joints [rad, m], and of speeds, friction and restitution as shares. Half
# of the digits would be left by differences of order two; a path leaves twelve, of which three go.
_STEP: Final = 1e-4

# How far beside a step Newton's law has to be the same as another, to be so by more than chance
# [rad, m].
_BESIDE: Final = 1e-6


def impact_partials(steps: LinearSteps, posed: Posed) -> tuple[Array, Array]:
    """Return how impulses (m, columns), and velocities that they throw off (k, columns), change."""
    columns, strike = steps.columns, posed.strike
    assert strike is not None
    e, mu = posed.chosen.restitution, posed.chosen.friction
    m, k, n = len(posed.near.before), len(e), len(posed.v)
    speed = float(np.abs(posed.near.before).max())
    mine = strike.apart[posed.chosen.impact(posed.near).sets.blocks]

    def struck(problem: ContactProblem, restitution: Array) -> Array:
        law = steps.scheme.impacts
        assert law is not None
        found = law.strike(problem, restitution, always=True).lam * mine
        off = np.maximum(problem.velocities(found)[problem.sets.normals], 0.0) * strike.apart
        return np.concatenate((found, off))

    def beside(moved: Array) -> Array:
        at = steps.system.integrate(posed.at, moved[:n])
        return struck(steps.steps.impact_at(posed.chosen, posed.near, at, posed.v + moved[n:]), e)

    here = posed.chosen.impact(posed.near)

    def rougher(change: Array) -> Array:
        return struck(here.replaced(friction=mu + change), e)

    changes = columns.empty(len(mine) + k)
    for i, along in enumerate(np.eye(2 * n)):
        changes[:, i] = _slope(beside, along, _STEP if i < n else _STEP * speed)
    cones = [int(i) for i in np.flatnonzero(strike.apart[: len(mu)])]
    of_mu, of_e = (
        np.arange(columns.size)[columns.of_cones(name, posed.chosen.cones)]
        for name in ("friction", "restitution")
    )
    for i in cones:
        one = np.eye(k)[i]
        if mu[i]:
            changes[:, of_mu[i]] = _slope(rougher, one[: len(mu)], _STEP * mu[i])
        if e[i]:
            changes[:, of_e[i]] = _slope(lambda x: struck(here, e + x), one, _STEP * e[i])
    for i, heavier in _by_inertias(steps, posed, len(mine)):

        def weighing(share: Array, by: Array = heavier) -> Array:
            return struck(here.replaced(G=here.G + share * by), e)

        changes[:, i] = _slope(weighing, np.ones(1), _STEP * _size(here.G, heavier))
    lam = columns.empty(m)
    lam[: len(mine)] = changes[: len(mine)]
    return lam, changes[len(mine) :]


def is_open(posed: Posed) -> bool:
    """Whether redundant contacts strike at once: how they share the impact is not determined."""
    if posed.strike is None or np.count_nonzero(posed.strike.apart) < 2:
        return False
    problem = posed.chosen.impact(posed.near)
    struck = posed.strike.apart[problem.sets.blocks]
    G = problem.G[np.ix_(struck, struck)]
    return bool(np.linalg.matrix_rank(G, tolerances.CONTACT_RANK, hermitian=True) < len(G))


def agrees_by_chance(steps: LinearSteps, posed: Posed) -> bool:
    """Whether Newton's law is that of an impact here, and not at the states beside it."""
    near, chosen = posed.near, posed.chosen
    e = chosen.restitution
    if steps.scheme.impacts is None or not e.any() or not chosen.friction.any():
        return False
    if not ((near.before[near.normals] < 0.0) & (e > 0.0)).any():
        return False
    law, n = steps.scheme.impacts, len(posed.v)
    here = chosen.impact(near)

    def beside() -> Iterator[ContactProblem]:
        for along in np.eye(n):
            at = steps.system.integrate(posed.at, _BESIDE * along)
            yield steps.steps.impact_at(chosen, near, at, posed.v)
        for _, by in _by_inertias(steps, posed, here.rows):
            yield here.replaced(G=here.G + _BESIDE * _size(here.G, by) * by)

    for problem in beside():
        apart = law.strike(problem, e).apart
        if (apart if posed.strike is None else apart & ~posed.strike.apart).any():
            return True
    return False


def _by_inertias(steps: LinearSteps, posed: Posed, m: int) -> Iterator[tuple[int, Array]]:
    """Return the columns of inertias that G of an impact changes with, and how (m, m)."""
    if not steps.inertias:
        return
    Y = posed.condensed.factors.solve(posed.J_c[:m].T, np.zeros((steps.system.equations.m, m)))[0]
    momenta = np.array([steps.inertias.momenta(posed.at, y) for y in Y.T])  # (m, nv, columns)
    for i in range(steps.inertias.size):
        by = -Y.T.dot(momenta[:, :, i].T)
        if by.any():
            yield steps.columns.inertias.start + i, 0.5 * (by + by.T)


def _size(G: Array, by: Array) -> float:
    """Return how much of a parameter changes G by as much as it is."""
    return float(np.abs(G).max() / np.abs(by).max())


def _slope(function: Callable[[Array], Array], along: Array, h: float) -> Array:
    """Return the derivative of a function of a step along a direction, by differences."""
    near, far = (function(x * along) - function(-x * along) for x in (h, 2.0 * h))
    return np.asarray((8.0 * near - far) / (12.0 * h))
