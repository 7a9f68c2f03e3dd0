"""Coulomb's law by convex problems, each by proximal points: slow, and right where others stall.

With the slips s = |sigma_t| of the answer before in its g, an ncp is a ccp,

    sigma_n + mu s >= mu |sigma_t|,    and its answer is that of the ncp where s = |sigma_t|.

A ccp whose contacts are redundant and about to slide has flat directions, in which Newton's method
stalls. One that costs R/2 |lam - lam_k|^2 more has one minimum, which `SAP` finds from anywhere,
and lam_k goes to the answer of the ccp.

References
----------
Cadoux. An optimization-based algorithm for Coulomb's frictional contact. ESAIM: Proceedings 27,
2009.
Rockafellar. Monotone operators and the proximal point algorithm. SIAM Journal on Control and
Optimization 14, 1976.
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.residuals import natural_residual
from condyn_pin.contact.solvers.sap import SAP

# Steps of all, proximal points of a convex problem, and steps to each point, at most: boxes on
# their corners take 70 to 180, and what has not been found by 500 is not found.
_ALL, _POINTS, _STEPS = 500, 15, 50

# R of the first point, in units of G, what it shrinks by, and its least.
_SOFTEST, _HARDER, _HARDEST = 1e-3, 0.1, 1e-5

# Natural residuals at which a point, a convex problem, and all of it are solved.
_POINT, _SOLVED, _ANSWERED = 1e-9, 1e-11, 1e-9


def cadoux(problem: ContactProblem, most: int = _ALL) -> tuple[Array, int]:
    """Return impulses (m,) of a normalised ncp, and how many steps it took, `most` if not fewer."""
    cones = problem.sets.parts[0]
    slips, lam, steps = np.zeros(len(problem.friction)), np.zeros(problem.rows), 0
    while steps < min(most, _ALL):
        g = problem.g.copy()
        g[2 : cones.stop : 3] += problem.friction * slips
        lam, taken = _convex(problem.replaced(g=g, law="ccp"), lam, min(most, _ALL) - steps)
        steps += max(taken, 1)
        if natural_residual(problem, lam) <= _ANSWERED:
            break
        S = problem.velocities(lam)[cones].reshape(-1, 3)
        slips = np.hypot(S[:, 0], S[:, 1])
    return lam, steps


def _convex(problem: ContactProblem, lam: Array, most: int) -> tuple[Array, int]:
    """Return impulses of a normalised ccp from lam, and how many steps it took."""
    G = problem.G if problem.R is None else problem.G + np.diag(problem.R)
    R, steps = _SOFTEST, 0
    for _ in range(_POINTS):
        if steps >= most or natural_residual(problem, lam) <= _SOLVED:
            break
        centred = problem.replaced(G=G, R=np.full(len(lam), R), g=problem.g - R * lam)
        end = SAP(min(_STEPS, most - steps)).attempt(centred, lam)
        steps += end.iterations
        if natural_residual(centred, end.lam) <= _POINT:
            lam, R = end.lam, max(R * _HARDER, _HARDEST)
        else:
            R /= _HARDER
    return lam, steps
