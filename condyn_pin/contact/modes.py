"""Modes of contacts: open, stick or slide, read off the impulses and velocities.

With x = lam - d / mean(diag G), where P_K(x) is lam in a solved problem: a contact is open where x
is in the polar cone of K, whatever the solver left of lam. Of the others those slide that move:
redundant contacts may be on the surface of their cones and stick all the same.
"""

from __future__ import annotations

from functools import partial
from math import hypot
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


def mode_words(codes: NDArray[np.generic]) -> NDArray[np.object_]:
    """Return modes as texts, an entry each, of places in `MODES`."""
    words: NDArray[np.object_] = np.array(MODES, dtype=object)[codes.astype(int)]
    return words


# Velocity along a row that counts as zero, relative to |g|: ten times what a solved problem leaves.
MOVES: Final = 10 * tolerances.CONTACT_SOLVED


def contact_modes(problem: ContactProblem, lam: Array, moves: float = MOVES) -> Modes:
    """Return the mode of each contact of a problem that lam (m,) solves.

    A stop is open or sticks, dry friction sticks or slides. What is slower than the share `moves`
    of |g| sticks.
    """
    stiff, speed = problem.scale
    l, s = lam.tolist(), problem.velocities(lam).tolist()  # noqa: E741  of the equations above
    still, sets = moves * speed, problem.sets
    (t1, t2, n), mu = sets.axes, sets.coefficients
    lift = mu if problem.law == "ncp" else len(mu) * [0.0]
    of_cone = partial(_mode_of_a_cone, stiff, still)
    codes = [*map(of_cone, mu, lift, l[t1], l[t2], l[n], s[t1], s[t2], s[n])]
    if len(l) > len(codes) * 3:
        _, lines, dry = sets.parts
        pushes = zip(l[lines], s[lines], strict=True)
        codes += [STICK if li - si / stiff > 0 else OPEN for li, si in pushes]
        codes += [SLIDE if abs(speed) > still else STICK for speed in s[dry]]
    return np.array(codes, dtype=np.int_)


def _mode_of_a_cone(
    stiff: float, still: float, mu: float, lift: float,
    l1: float, l2: float, ln: float, s1: float, s2: float, sn: float,
) -> int:  # fmt: skip
    slip = hypot(s1, s2)
    x1, x2, xn = l1 - s1 / stiff, l2 - s2 / stiff, ln - (sn + lift * slip) / stiff
    if not mu * hypot(x1, x2) > -xn:
        return OPEN
    return SLIDE if slip > still else STICK
