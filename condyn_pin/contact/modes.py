"""Modes of contacts: open, stick or slide, read off the impulses.

P_K(lam - rho d) is lam where a problem is solved. It is zero where a contact is open, and on the
surface of the cone where it slides: exactly, whatever the solver left of lam. Redundant contacts
may be there and stick all the same, so that what slides has to move, too.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem

Modes = NDArray[np.int8]

# A mode as a number is its place here.
MODES: Final = ("open", "stick", "slide")
OPEN, STICK, SLIDE = range(3)

# How far inside of the surface rounding puts what is on it, relative.
_ROUNDED: Final = 1e-12

# Velocity along a row that is none, relative to |g|: ten times what a solved problem leaves.
_MOVES: Final = 10 * tolerances.CONTACT_SOLVED


def contact_modes(problem: ContactProblem, lam: Array) -> Modes:
    """Return the mode of each contact of a problem that lam (m,) solves.

    A stop is open or sticks, dry friction sticks or slides.
    """
    stiff, speed = problem.scale
    sigma = problem.velocities(lam)
    nearest = problem.sets.project(lam - problem.dual(sigma) / stiff)
    moves = np.abs(sigma) > _MOVES * speed
    cones = 3 * len(problem.friction)
    lines = cones + problem.half_lines
    t1, t2, n = nearest[:cones].reshape(-1, 3).T
    slides = np.hypot(t1, t2) >= problem.friction * n * (1 - _ROUNDED)
    slides &= moves[0:cones:3] | moves[1:cones:3]
    of_cones = np.where(n > 0, np.where(slides, SLIDE, STICK), OPEN)
    of_lines = np.where(nearest[cones:lines] > 0, STICK, OPEN)
    slides = (np.abs(nearest[lines:]) >= problem.limits) & moves[lines:]
    of_intervals = np.where(slides, SLIDE, STICK)
    return np.concatenate((of_cones, of_lines, of_intervals)).astype(np.int8)
