"""Contact problems of some contacts, and of those that go through the answer of these.

Of hundreds of points below a plate that is not quite flat, few carry it. Where lam_i = 0 and
sigma_n >= 0 the law is met: an answer for some contacts is one for all if the others part by
themselves, and if not, those that do not are asked as well. What does not press is left out again,
once for each contact, so that it ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.islands import island_of
from condyn_pin.contact.low_rank import factor_of
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.residuals import natural_residual
from condyn_pin.contact.solvers.base import Attempt

# Share of a problem's contacts from which fewer are no fewer.
_MOST: Final = 0.9

# Rank of G, as a share of its rows, of contacts that few bodies have among them.
_FEW: Final = 0.1

Solve = Callable[[ContactProblem, Array], Attempt]


def with_fewer(problem: ContactProblem, solve: Solve) -> Iterator[Attempt]:
    """Yield impulses (m,) that those of some contacts are, and what they took.

    None where bodies are not few, by the rank of G.

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    solve : (problem, guess) -> Attempt
        What solves the smaller ones.
    """
    normals, (_, speed) = problem.sets.normals, problem.scale
    count, lam = len(normals), np.zeros(problem.rows)
    asked = np.arange(len(problem.names)) >= count  # dry friction always
    X = factor_of(problem)
    if X is None or len(X) > _FEW * problem.rows:
        return
    at_once = max(len(X) // 6, 1)  # one of each body
    dropped = np.zeros(count, dtype=bool)
    while True:
        sigma = np.where(asked[:count], 0.0, problem.velocities(lam)[normals])
        through = np.argsort(sigma, kind="stable")[:at_once]
        through = through[sigma[through] < -tolerances.FINEST * speed]
        asked[through] = True
        if not len(through) or asked.sum() > _MOST * len(asked):
            return
        island = island_of(problem.sets, problem.names, np.flatnonzero(asked))
        part = island.problem(problem)
        found = solve(part, lam[island.rows])
        lam = np.zeros(problem.rows)
        lam[island.rows] = found.lam
        yield found._replace(lam=lam)
        if not natural_residual(part, found.lam) <= tolerances.CONTACT_SOLVED:
            return
        idle = asked[:count] & (lam[normals] <= 0) & ~dropped
        dropped |= idle
        asked[:count] &= ~idle
