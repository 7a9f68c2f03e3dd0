"""Redundant contacts that are asked for velocities which no rigid body can have.

Where impulses z do nothing, G z = 0, they see nothing either: z . sigma = z . g, whatever lam is. A
scheme that closes the gaps of two points of one body in the same step asks them to approach each
other by gap^2 / (L dt), which a rigid body does not. They would have to slide by that, under inner
forces that grow up to friction; no solver finds them where it is 1e-8 of the other velocities.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem

# What is left out of g, relative to |g|, at most: a creep of a micrometre where a metre is moved.
_SMALL: Final = 1e-6

# What is left in, relative to |g|: no residual feels it.
_FELT: Final = 0.01 * tolerances.CONTACT_SOLVED


def without_contradiction(problem: ContactProblem, lam: Array) -> ContactProblem | None:
    """Return the problem without the part of g that no motion of what touches has.

    g_A - Z Z^T g_A,    Z an orthonormal basis of G_AA z = 0

    with A the rows along which nothing moves: the normals of contacts that press, and all of those
    that stick.

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    lam : (m,) array
        The best impulses that were found: they say which contacts press and stick.

    Returns
    -------
    ContactProblem or None
        None if there is no such part, or it is not small beside g.

    Notes
    -----
    Cost O(m^3).
    """
    stiff, speed = problem.scale
    sigma, cones = problem.velocities(lam), 3 * len(problem.friction)
    L, S = lam[:cones].reshape(-1, 3), sigma[:cones].reshape(-1, 3)
    presses = L[:, 2] * stiff > np.abs(S[:, 2])
    sticks = presses & (np.hypot(S[:, 0], S[:, 1]) <= _SMALL * speed)
    A = np.flatnonzero(np.column_stack((sticks, sticks, presses)))
    if problem.R is not None or not len(A):
        return None
    values, vectors = np.linalg.eigh(problem.G[np.ix_(A, A)])
    Z = vectors[:, values <= tolerances.CONTACT_RANK * values[-1]]
    out = Z.dot(Z.T.dot(problem.g[A]))
    if not _FELT * speed < np.abs(out).max() <= _SMALL * speed:
        return None
    g = problem.g.copy()
    g[A] -= out
    return problem.replaced(g=g)
