"""Residuals of an answer to a contact problem, and its certificate.

ContactResiduals: by how much impulses miss each condition of a contact problem.

Impulses are measured by |g| / mean diag (G + R), and velocities by |g| (`ContactProblem.scale`) of
the contacts that feel each other, so that all seven are plain numbers, and those of one body are
the same whatever stands beside it. With l and s the impulse and the velocity of one contact, t and
n their tangential and normal parts, and d what is dual to l,

    cone             distance of l from K
    dual             distance of d from the dual cone K*
    complementarity  |l . d|
    signorini        |l_n s_n|, and -s_n where that is positive
    uplift           s_n where l_n > 0
    dissipation      | |s_t| l_t + mu l_n s_t |
    natural          | l - P_K(l - d) |, or |s| of what sticks

and each is the largest over the contacts. `natural` is zero if and only if the problem is solved,
and has no threshold: the status is judged by it. What sticks is judged by s and not by d, whose mu
|s_t| makes mu times too much of a slip, or hides a fall behind one: where K contains l, impulses
solve the problem whose g is less by s. So |s| counts there if K contains l - d too, and else where
it is less. In a ccp, contacts that slide lift off: neither signorini nor uplift is a condition, and
what they are is the price of its convexity. Half-lines have no tangential part. Intervals have no
dual cone, and dissipate: | |s| l + limit s |.

The distances are closed forms, and no solver runs them.
"""

from __future__ import annotations

from math import hypot, inf, isfinite, nan
from typing import NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem, islands

_EPS = float(np.finfo(np.float64).eps)


class ContactResiduals(NamedTuple):
    """Sizes of the residuals of impulses, all without a unit.

    Attributes
    ----------
    cone : float
        Distance of lam from K [1].
    dual : float
        Distance of d from K* [1].
    complementarity : float
        |lam . d| [1].
    signorini : float
        |lam_n sigma_n|, or the speed at which bodies approach [1].
    uplift : float
        sigma_n where lam_n > 0: bodies that part while they press [1].
    dissipation : float
        How far friction is from opposing sliding with all it has [1].
    natural : float
        |lam - P_K(lam - d)|, or |sigma| of what sticks; zero if and only if the problem is solved
        [1].
    """

    cone: float
    dual: float
    complementarity: float
    signorini: float
    uplift: float
    dissipation: float
    natural: float


def natural_residual(problem: ContactProblem, lam: Array) -> float:
    """Return the natural residual of impulses, without a unit; NaN if lam has one.

    | lam - P_K(lam - d) |,  or |sigma| of what sticks

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    lam : (m,) array
        Impulses [N s].

    Returns
    -------
    float
        Zero if and only if the problem is solved, but for the rounding of lam [1].

    Notes
    -----
    Cost: one product G lam and 1 us a contact. No solver uses this code, so that it can judge all.
    """
    if not len(lam):
        return 0.0
    if apart := islands(problem):
        parts = [natural_residual(each.problem(problem), lam[each.rows]) for each in apart]
        return max(parts) if isfinite(sum(parts)) else nan
    sets, (stiff, speed) = problem.sets, problem.scale
    l = (lam * stiff).tolist()  # noqa: E741  of the equations above, times |g|
    s = problem.velocities(lam).tolist()
    mu = sets.coefficients
    missed = _missed_by_cones(mu, mu if problem.law == "ncp" else len(mu) * [0.0], l, s)
    missed.append(_EPS * max(map(abs, l)))  # d is lost beside an impulse that is huge
    if problem.half_lines:
        lines = sets.parts[1]
        missed += [abs(li - max(li - si, 0.0)) for li, si in zip(l[lines], s[lines], strict=True)]
    if len(problem.limits):
        dry, limits = sets.parts[2], (problem.limits * stiff).tolist()
        for most, li, si in zip(limits, l[dry], s[dry], strict=True):
            missed.append(abs(li - min(max(li - si, -most), most)))
    return max(missed) / speed if isfinite(sum(missed)) else nan


def _missed_by_cones(
    friction: list[float],
    lifts: list[float],
    l: list[float],  # noqa: E741
    s: list[float],
) -> list[float]:
    """Return |l - P_K(l - d)|_inf or |s|_inf of each cone, d = s + (0, 0, lift |s_t|)."""
    missed, impulses, velocities = [], iter(l), iter(s)
    by_threes = 3 * (impulses,) + 3 * (velocities,)
    for mu, lift, l1, l2, ln, d1, d2, sn in zip(friction, lifts, *by_threes, strict=False):
        dn = sn + lift * hypot(d1, d2)
        x1, x2, xn = l1 - d1, l2 - d2, ln - dn
        slip = hypot(x1, x2)
        held = ln >= 0.0 and hypot(l1, l2) <= mu * ln
        stuck = max(abs(d1), abs(d2), abs(sn)) if held else inf
        if mu * slip <= -xn < inf:  # the apex is nearest
            natural = max(abs(l1), abs(l2), abs(ln))
        elif slip <= mu * xn:  # inside
            natural = stuck if held else max(abs(d1), abs(d2), abs(dn))
        else:
            n = (mu * slip + xn) / (1.0 + mu * mu)
            share = mu * n / slip
            natural = max(abs(l1 - share * x1), abs(l2 - share * x2), abs(ln - n))
        missed.append(min(natural, stuck))  # NaN, if natural is
    return missed


def contact_residuals(problem: ContactProblem, lam: Array) -> ContactResiduals:
    """Return all seven residuals of impulses.

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    lam : (m,) array
        Impulses [N s].

    Returns
    -------
    ContactResiduals

    Notes
    -----
    Cost: one product G lam and some forty passes over the rows.
    """
    if apart := islands(problem):
        parts = [contact_residuals(each.problem(problem), lam[each.rows]) for each in apart]
        return ContactResiduals(*(float(np.max(each)) for each in zip(*parts, strict=True)))
    stiff, speed = problem.scale
    sigma = problem.velocities(lam)
    d = problem.dual(sigma)
    cones, lines, _ = problem.sets.parts
    l, s, d = lam * (stiff / speed), sigma / speed, d / speed  # noqa: E741  of the equations above
    L, S, D = (x[cones].reshape(-1, 3) for x in (l, s, d))
    mu = problem.friction
    pushes = np.concatenate([L[:, 2], l[lines]])
    leaves = np.concatenate([S[:, 2], s[lines]])
    l_b, s_b, limits = *(x[lines.stop :] for x in (l, s)), problem.limits * (stiff / speed)
    slip = np.hypot(S[:, 0], S[:, 1])[:, None]
    undone = slip * L[:, :2] + (mu * L[:, 2])[:, None] * S[:, :2]
    return ContactResiduals(
        cone=_largest(_distances_from_cones(L, mu), -l[lines], np.abs(l_b) - limits),
        # K* is where mu |d_t| <= d_n
        dual=_largest(_beyond_dual(D, mu), -d[lines]),
        complementarity=_largest(np.abs((L * D).sum(axis=1)), np.abs(l[lines] * d[lines])),
        signorini=_largest(np.abs(pushes * leaves), -leaves),
        uplift=_largest(leaves[pushes > tolerances.CONTACT_SOLVED]),
        dissipation=_largest(
            np.hypot(undone[:, 0], undone[:, 1]), np.abs(np.abs(s_b) * l_b + limits * s_b)
        ),
        natural=natural_residual(problem, lam),
    )


def _distances_from_cones(X: Array, mu: Array) -> Array:
    """Return the distances (k,) of points (k, 3) from the cones |x_t| <= mu x_n."""
    slip, n = np.hypot(X[:, 0], X[:, 1]), X[:, 2]
    beside = np.maximum(slip - mu * n, 0.0) / np.hypot(1.0, mu)
    return np.where(mu * slip <= -n, np.hypot(slip, n), beside)


def _beyond_dual(X: Array, mu: Array) -> Array:
    """Return the distances (k,) of points (k, 3) from the cones mu |x_t| <= x_n."""
    slip, n = np.hypot(X[:, 0], X[:, 1]), X[:, 2]
    below = np.maximum(mu * slip - n, 0.0) / np.hypot(1.0, mu)
    return np.where(slip <= -mu * n, np.hypot(slip, n), below)


def _largest(*sizes: Array) -> float:
    """Return the largest number of some arrays, at least zero; NaN if there is one."""
    return float(np.concatenate(sizes).max(initial=0.0))


# A certificate that no impulse meets a contact problem, where there is one.
#
# What a solution has to meet, N^T sigma >= 0 for the columns of some N, is out of reach if
#
#     z = N x,    x >= 0,    (G + R) z = 0,    g . z < 0,
#
# for then sigma . z = g . z < 0 whatever the impulses are. In an ncp only normals are asked to
# part, and N has those; in a ccp sigma is in K*, and N has edges of K as well. Stops are normals.
#
# What proves a ccp to have no answer leaves an ncp without one often, but not always. Of 1300
# random ncp ADMM and Newton answered all but eight, and in each of those friction locks contacts
# so.


_EDGES = 16  # of a cone: the certificates of a polygon inside of it are certificates


def infeasible_contacts(
    problem: ContactProblem, by: float = tolerances.CONTACT_SOLVED
) -> tuple[str, ...]:
    """Return the names of contacts that no impulse can meet together; none if none is proved."""
    # They contradict each other by more than `by`, relative: less is rounding, most often, or
    # within a low accuracy.
    # Nonnegative least squares, min |(G + R) N x|^2 + (g . N x + 1)^2, find the x that is asked
    # for.
    # imported here: scipy.optimize takes as long to import as Pinocchio
    from scipy.optimize import nnls

    stiff, speed = problem.scale
    N = np.eye(problem.rows)[:, problem.sets.normals]
    if problem.law == "ccp":
        N = np.hstack([N, _edges(problem)])
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


def _edges(problem: ContactProblem) -> Array:
    """Return edges of the cones, as columns."""
    angles = 2 * np.pi * np.arange(_EDGES) / _EDGES
    N = np.zeros((problem.rows, _EDGES * len(problem.friction)))
    for i, mu in enumerate(problem.friction):
        rows, columns = slice(3 * i, 3 * i + 3), slice(_EDGES * i, _EDGES * (i + 1))
        N[rows, columns] = mu * np.cos(angles), mu * np.sin(angles), np.ones(_EDGES)
    return N
