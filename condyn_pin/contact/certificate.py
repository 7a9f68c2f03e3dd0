"""A certificate that no impulse meets a contact problem, where there is one.

What a solution has to meet, N^T sigma >= 0 for the columns of some N, is out of reach if

    z = N x,    x >= 0,    (G + R) z = 0,    g . z < 0,

for then sigma . z = g . z < 0 whatever the impulses are. In an ncp only normals are asked to part,
and N has those; in a ccp sigma is in K*, and N has edges of K as well. Stops are normals.

What proves a ccp to have no answer leaves an ncp without one often, but not always. Of 1300 random
ncp ADMM and Newton answered all but eight, and in each of those friction locks contacts so.
"""

from __future__ import annotations

from math import isfinite

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem

_EDGES = 16  # of a cone: the certificates of a polygon inside of it are certificates


def unmet_contacts(
    problem: ContactProblem, by: float = tolerances.CONTACT_SOLVED
) -> tuple[str, ...]:
    """Return the names of contacts that no impulse can meet together; none if none is proved.

    They contradict each other by more than `by`, relative: less is rounding, most often, or what
    who asks for little accepts.

    Nonnegative least squares, min |(G + R) N x|^2 + (g . N x + 1)^2, find the x that is asked for.
    """
    # imported here: scipy.optimize takes as long to import as Pinocchio
    from scipy.optimize import nnls

    stiff, speed = problem.scale
    N = (
        _normals(problem)
        if problem.law == "ncp"
        else np.hstack([_normals(problem), _edges(problem)])
    )
    if not N.shape[1] or not isfinite(stiff * speed):
        return ()
    G = problem.G if problem.R is None else problem.G + np.diag(problem.R)
    A = np.vstack([G @ N / stiff, problem.g @ N / speed])
    b = np.append(np.zeros(problem.rows), -1.0)
    try:
        x, _ = nnls(A, b)
    except (RuntimeError, ValueError):  # out of iterations, or not finite: nothing is proved
        return ()
    z = N @ x
    size = float(np.abs(z).max())
    if size * by > 1.0:  # a larger one tells of a smaller contradiction
        return ()
    if not np.abs(A[:-1] @ x).max() <= tolerances.CERTIFICATE * size or not A[-1] @ x < -0.5:
        return ()
    blocks = problem.sets.blocks[np.abs(z) > tolerances.CERTIFICATE * size]
    return tuple(problem.names[i] for i in np.unique(blocks))


def _normals(problem: ContactProblem) -> Array:
    """Return the normals of cones and the rows of half-lines, as columns."""
    return np.eye(problem.rows)[:, problem.sets.normals]


def _edges(problem: ContactProblem) -> Array:
    """Return edges of the cones, as columns."""
    angles = 2 * np.pi * np.arange(_EDGES) / _EDGES
    N = np.zeros((problem.rows, _EDGES * len(problem.friction)))
    for i, mu in enumerate(problem.friction):
        rows, columns = slice(3 * i, 3 * i + 3), slice(_EDGES * i, _EDGES * (i + 1))
        N[rows, columns] = mu * np.cos(angles), mu * np.sin(angles), np.ones(_EDGES)
    return N
