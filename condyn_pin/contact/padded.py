"""Contact problems as Pinocchio takes them: a stop is a cone without friction and two empty rows.

Tangential rows that nothing moves along, of stops and in mechanisms that stay in a plane, get a
number on the diagonal, so that Gauss-Seidel may divide by it: their impulse is zero then, which is
one of the answers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array, Indices
from condyn_pin.contact.problem import ContactProblem


class Padded(NamedTuple):
    """Rows of cones, stops among them, then of intervals."""

    G: Array
    g: Array
    friction: Array
    limits: Array
    kept: Indices | slice  # rows of the problem among them

    def spread(self, lam: Array | None) -> Array | None:
        """Return impulses of the problem in these rows."""
        if lam is None:
            return None
        whole = np.zeros(len(self.g))
        whole[self.kept] = lam
        return whole


def padded(problem: ContactProblem) -> Padded:
    """Return the problem with three rows for each half-line; itself if no row has to be added."""
    h, mu = problem.half_lines, problem.friction
    if not h and problem.G.diagonal().all():
        return Padded(problem.G, problem.g, mu, problem.limits, slice(None))
    cones, lines, _ = problem.sets.parts
    stops = cones.stop + 2 + 3 * np.arange(h)
    size = problem.rows + 2 * h
    kept = np.concatenate([np.arange(cones.stop), stops, np.arange(lines.stop + 2 * h, size)])
    G, g = np.zeros((size, size)), np.zeros(size)
    G[np.ix_(kept, kept)] = problem.G
    g[kept] = problem.g
    three = np.arange(cones.stop + 3 * h).reshape(-1, 3)
    diagonal = G[three, three]
    empty = (diagonal == 0) & (g[three] == 0)
    empty[:, 2] = False  # what nothing moves along the normal stays as it is
    largest = diagonal.max(axis=1, keepdims=True)
    G[three, three] = np.where(empty, np.where(largest > 0, largest, 1.0), diagonal)
    return Padded(G, g, np.concatenate([mu, np.zeros(h)]), problem.limits, kept)
