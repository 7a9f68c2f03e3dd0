"""Modes of contacts: open, stick or slide, read off the impulses.

P_K(lam - rho d) is lam where a problem is solved. It is zero where a contact is open, inside of the
cone where it sticks, and on its surface where it slides: exactly, whatever the solver left of lam.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem

Modes = NDArray[np.int8]

# A mode as a number is its place here.
MODES: Final = ("open", "stick", "slide")
OPEN, STICK, SLIDE = range(3)

# How far inside of the surface rounding puts what is on it, relative.
_ROUNDED: Final = 1e-12


def contact_modes(problem: ContactProblem, lam: Array) -> Modes:
    """Return the mode of each contact of a problem that lam (m,) solves.

    A stop is open or sticks, dry friction sticks or slides; without friction what touches slides.
    """
    stiff, _ = problem.scale
    nearest = problem.sets.project(lam - problem.dual(problem.velocities(lam)) / stiff)
    cones = 3 * len(problem.friction)
    lines = cones + problem.half_lines
    t1, t2, n = nearest[:cones].reshape(-1, 3).T
    inside = np.hypot(t1, t2) < problem.friction * n * (1 - _ROUNDED)
    of_cones = np.where(n > 0, np.where(inside, STICK, SLIDE), OPEN)
    of_lines = np.where(nearest[cones:lines] > 0, STICK, OPEN)
    of_intervals = np.where(np.abs(nearest[lines:]) < problem.limits, STICK, SLIDE)
    return np.concatenate((of_cones, of_lines, of_intervals)).astype(np.int8)
