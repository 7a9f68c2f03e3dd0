"""Modes of contacts: open, stick or slide, read off the impulses and velocities.

With x = lam - d / mean(diag G), where P_K(x) is lam in a solved problem: a contact is open where x
is in the polar cone of K, whatever the solver left of lam. Of the others those slide that move:
redundant contacts may be on the surface of their cones and stick all the same.

In its mode a contact has three equations, the same number as impulses,

    open   lam = 0
    stick  sigma = 0
    slide  sigma_n = 0,  lam_t + mu lam_n s = 0,  s = sigma_t / |sigma_t|
"""

from __future__ import annotations

from functools import lru_cache, partial
from math import copysign, hypot, inf
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices, read_only
from condyn_pin.contact.islands import islands
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
    of |g| sticks, by the contacts that feel each other.
    """
    if apart := islands(problem):
        codes_of = np.empty(len(problem.names), dtype=np.int_)
        for each in apart:
            codes_of[each.contacts] = contact_modes(each.problem(problem), lam[each.rows], moves)
        return codes_of
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


class Equations(NamedTuple):
    """The equations of contacts in their modes at one lam, and how they change."""

    sigma: Array  # (m,)
    left: Array  # (m,), what impulses leave of them
    by_sigma: Array  # (m, m)
    by_lam: Array  # (m, m)
    by_friction: Array  # (m, k)


@lru_cache(maxsize=16)
def _places(k: int, m: int) -> Indices:
    """Return where the numbers of `_of_a_cone` and then of `_of_a_row` belong, in (m, 1 + 2 m + k).

    Columns are what is left, by sigma, by lam and by friction.
    """
    width, rows, singles = 1 + 2 * m + k, np.arange(3 * k).reshape(k, 3), np.arange(3 * k, m)
    columns = np.zeros((k, 3, 8), dtype=np.intp)
    columns[:, :, 1:4], columns[:, :, 4:7] = 1 + rows[:, None], 1 + m + rows[:, None]
    columns[:, :, 7] = 1 + 2 * m + np.arange(k)[:, None]
    of_cones = width * rows[:, :, None] + columns
    of_rows = width * singles + np.stack((0 * singles, 1 + singles, 1 + m + singles))
    return read_only(np.concatenate((of_cones.ravel(), of_rows.T.ravel())))


class InModes:
    """The equations of the contacts of a problem, each in the mode that it has."""

    def __init__(self, problem: ContactProblem, modes: Modes) -> None:
        self._problem, self._modes = problem, modes.tolist()

    def at(self, lam: Array) -> Equations:
        """Return what impulses leave of the equations, and their partials."""
        problem, m = self._problem, len(lam)
        k, sigma = len(problem.friction), problem.velocities(lam)
        found = np.zeros((m, 1 + 2 * m + k))
        found.put(_places(k, m), self._numbers(lam.tolist(), sigma.tolist()))
        parts = found[:, 1 : 1 + m], found[:, 1 + m : 1 + 2 * m], found[:, 1 + 2 * m :]
        return Equations(sigma, found[:, 0], *parts)

    def _numbers(self, l: list[float], s: list[float]) -> list[float]:  # noqa: E741
        """Return the equations of all contacts, at their `_places`; in a ccp what slides lifts."""
        problem, modes, sets = self._problem, self._modes, self._problem.sets
        (t1, t2, n), mu = sets.axes, sets.coefficients
        k, lifts = len(mu), float(problem.law == "ccp")
        numbers: list[float] = []
        for of_one in zip(modes, mu, l[t1], l[t2], l[n], s[t1], s[t2], s[n], strict=False):
            numbers += _of_a_cone(lifts, *of_one)
        if len(l) > 3 * k:
            limits = problem.half_lines * [inf] + problem.limits.tolist()
            for of_one in zip(modes[k:], limits, l[3 * k :], s[3 * k :], strict=True):
                numbers += _of_a_row(*of_one)
        return numbers


def _of_a_cone(
    lifts: float, mode: int, mu: float,
    l1: float, l2: float, ln: float, v1: float, v2: float, vn: float,
) -> tuple[float, ...]:  # fmt: skip
    """Return the three equations of a contact, eight numbers each.

    What is left, its partials by sigma, those by lam, and that by mu. What slides has
    s' = (1 - s s^T) sigma_t' / |sigma_t|, and any s on ice, which holds nothing. It `lifts` off, 1,
    or does not, 0.
    """
    if mode == OPEN:
        return (
            l1, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0,
            l2, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0,
            ln, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0,
        )  # fmt: skip
    if mode == STICK and mu:
        return (
            v1, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
            v2, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0,
            vn, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0,
        )  # fmt: skip
    slip, lift = hypot(v1, v2), lifts * mu
    x, y = (v1 / slip, v2 / slip) if slip else (0.0, 0.0)
    w = mu * ln / slip if slip else 0.0
    return (
        l1 + mu * ln * x, w * y * y, -w * x * y, 0.0, 1.0, 0.0, mu * x, ln * x,
        l2 + mu * ln * y, -w * x * y, w * x * x, 0.0, 0.0, 1.0, mu * y, ln * y,
        vn - lift * slip, -lift * x, -lift * y, 1.0, 0.0, 0.0, 0.0, -lifts * slip,
    )  # fmt: skip


def _of_a_row(mode: int, limit: float, l: float, s: float) -> tuple[float, float, float]:  # noqa: E741
    """Return what is left of a stop or of dry friction, by sigma and by lam.

    A stop has no `limit`; dry friction of zero holds nothing.
    """
    if mode == STICK and limit:
        return (s, 1.0, 0.0)
    return (l + copysign(limit, s) if mode == SLIDE else l, 0.0, 1.0)
