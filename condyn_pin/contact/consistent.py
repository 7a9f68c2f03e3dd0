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
from condyn_pin.contact.problem import ContactProblem

# What is left out of g, relative to |g|, at most: a creep of a micrometre where a metre is moved.
_SMALL: Final = 1e-6


def without_contradiction(problem: ContactProblem) -> ContactProblem | None:
    """Return the problem with the part of g left out that no motion has; None if it is not small.

    g - Z Z^T g,    Z an orthonormal basis of G z = 0

    Cost O(m^3).
    """
    values, vectors = np.linalg.eigh(problem.G)
    Z = vectors[:, values <= tolerances.CONTACT_RANK * values[-1]]
    out = Z.dot(Z.T.dot(problem.g))
    if problem.R is not None or not 0 < np.abs(out).max(initial=0.0) <= _SMALL * problem.scale[1]:
        return None
    return problem.replaced(g=problem.g - out)
