"""Modes of contacts: open, stick or slide, read off the impulses and velocities.

With x = lam - d / mean(diag G), where P_K(x) is lam in a solved problem: a contact is open where x
is in the polar cone of K, whatever the solver left of lam. Of the others those slide that move:
redundant contacts may be on the surface of their cones and stick all the same.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem

Modes = NDArray[np.int_]

# A mode as a number is its place here.
MODES: Final = ("open", "stick", "slide")
OPEN, STICK, SLIDE = range(3)

# Velocity along a row that is none, relative to |g|: ten times what a solved problem leaves.
_MOVES: Final = 10 * tolerances.CONTACT_SOLVED


def contact_modes(problem: ContactProblem, lam: Array, moves: float = _MOVES) -> Modes:
    """Return the mode of each contact of a problem that lam (m,) solves.

    A stop is open or sticks, dry friction sticks or slides. What is slower than the share `moves`
    of |g| sticks.
    """
    stiff, speed = problem.scale
    sigma = problem.velocities(lam)
    x, still = lam - problem.dual(sigma) / stiff, moves * speed
    t1, t2, n = problem.sets.axes
    presses = problem.friction * np.hypot(x[t1], x[t2]) > -x[n]
    codes = np.where(presses, STICK + (np.hypot(sigma[t1], sigma[t2]) > still), OPEN)
    cones = 3 * len(problem.friction)
    if len(x) == cones:
        return codes
    lines = cones + problem.half_lines
    of_lines = np.where(x[cones:lines] > 0, STICK, OPEN)
    return np.concatenate((codes, of_lines, STICK + (np.abs(sigma[lines:]) > still)))
