"""Indeterminacy: contact problems with several motions, and the rule by which one is chosen.

    sigma = G lam + g,    K contains lam,    K* contains sigma + (0, 0, mu |sigma_t|),  orthogonal

has one sigma where friction is small, and may have several in three ways:

    wedge      z in K, z != 0, G z = 0, g . z = 0:  contacts that carry t z beside their load hold
               whatever pushes them, for a large t. There is none if and only if a motion opens all
               contacts, S = G x with S_n > mu |S_t| (Gordan), and either is a proof.
    continuum  redundant contacts that slide and turn: the equations of their modes leave a dlam
               open that has G dlam != 0.
    Painlevé   no impulse, and one that stops the contact. One contact alone has one answer where
               G_nn > mu |G_nt|.

The rule is that of contacts which are all equally compliant, in the limit of rigid ones,

    lam = lim lam(eps),    sigma = (G + eps R) lam + g,    R = trace G / m  of cones, G_ii of joints

without history, order or axes: walls that do not approach carry no pressure, equal springs share a
load, and Painlevé's contact opens. By Newton's method from eps = 1 down to 1e-5, far above where
rounding hides the load by R, and a parabola in eps through the last three.

References
----------
Klarbring. Examples of non-uniqueness and non-existence of solutions to quasistatic contact problems
with friction. Ingenieur-Archiv 60, 1990.
Génot, Brogliato. New results on Painlevé paradoxes. European Journal of Mechanics A 18, 1999.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv, dpotrf

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, read_only
from condyn_pin.contact.problem import (
    MOVES,
    OPEN,
    SLIDE,
    STICK,
    ContactProblem,
    ContactsInModes,
    Modes,
    contact_modes,
    islands,
    normalised,
)
from condyn_pin.contact.residuals import natural_residual
from condyn_pin.contact.solvers.contact_solver import SolverResult
from condyn_pin.contact.solvers.newton import SemismoothNewton, newton, refine, sticking

# Sides of the polygons in the cones of a stress, and their share of the friction: their corners are
# inside the cones, so that a contact with a part of the stress can be held.
_SIDES: Final = 32
_INSIDE: Final = 1 - 1e-6

# Rows of contacts that feel each other, at most, of which is decided whether they wedge or slide in
# several ways: the search is by factorisations and costs their cube, 0.1 s for these.
_MOST: Final = 300

# By how much a motion opens contacts, and what a stress moves, relative; and what it meets of g, as
# a share of |g|: gaps that steps leave are below, and of what is above no solver holds anything.
_OPENS: Final = 1e-9
_BALANCED: Final = 1e-9
_TOUCHING: Final = 100 * tolerances.CONTACT_SOLVED

# Eigenvalues of G that are none, as a share of its trace.
_NO_MOTION: Final = 1e-13

# Weight of balance against equal shares, in search of all contacts with a part in a stress, and the
# least part.
_BALANCE: Final = 1e4
_PART: Final = 1e-3

# Singular values that the equations of modes leave, rows of length one, and velocities, in units of
# the normalised problem, that are a motion.
_LEFT: Final = 1e-9
_MOVED: Final = 1e-6

# Pivot of a Cholesky factorisation, relative, below which rows of G may be combinations of others.
_PIVOT: Final = 1e-5

# Compliances of the rule, in units of R, the last three for its limit; and closer ones, where a
# contact changes its mode between those.
_SOFT: Final = (1.0, 0.1, 0.01)
_ENDS: Final = ((1e-3, 1e-4, 1e-5), (1e-5, 1e-6, 1e-7))

# Compliance, in units of R, of which derivatives by the rule are.
COMPLIANCE: Final = 1e-5

# Newton's steps from one compliance to the next, and between looks at them; the natural residual
# that they have to reach, and that of the limit.
_STEPS: Final = 48
_POLISH: Final = 3
_RUNG: Final = 1e-10
_GOOD_ENOUGH: Final = tolerances.CONTACT_SOLVED

# Directions of slip that are looked at, and bisections of one [1].
_SLIPS: Final = 720
_BISECTIONS: Final = 60


class Indeterminacy(NamedTuple):
    """Contacts whose velocities Coulomb's law does not determine.

    Attributes
    ----------
    kind : {"wedge", "continuum", "painleve"}
    names : tuple of str
        Of the contacts.
    other : float
        The normal impulse of another answer, in Painlevé's case [N s].
    by_rule : bool
        Whether the answer is that of the rule; else one of many.
    """

    kind: str
    names: tuple[str, ...]
    other: float = 0.0  # [N s]
    by_rule: bool = True

    @property
    def whole_names(self) -> tuple[str, ...]:
        """Names of the contacts, once for all corners of a shape."""
        return tuple(dict.fromkeys(_CORNER.sub("", name) for name in self.names))

    @property
    def text(self) -> str:
        """A sentence with the cause, the rule and the cure."""
        names, several = ", ".join(self.whole_names), "not determined by Coulomb's law"
        if self.kind == "wedge":
            chosen = (
                "this is that of equally compliant contacts, without pressure that no force "
                "causes (model a preload as a spring or a force)"
            )
            return (
                f"{names} could hold what they touch whatever pushes it: the motion is {several}, "
                f"which has several motions here; {chosen if self.by_rule else _ANY}"
            )
        if self.kind == "continuum":
            chosen = "equal springs share the load here"
            return (
                f"{len(self.names)} contacts slide and turn together ({names}): the velocities "
                f"are {several}, as their loads are not; {chosen if self.by_rule else _ANY}"
            )
        chosen = "this is that of equally compliant contacts, in the limit of rigid ones"
        return (
            f"{names}: several answers obey Coulomb's law (Painlevé), another one with "
            f"{self.other:.3g} N s along the normal: the motion is {several}; "
            f"{chosen if self.by_rule else _ANY}"
        )


# What the name of a shape's corner has more than that of its contact.
_CORNER: Final = re.compile(r"/[a-z]+ \d+$")

_ANY: Final = "this is one of them, as the solver found it"


def by_rule(
    problem: ContactProblem, found: SolverResult, natural: float, accuracy: float
) -> tuple[SolverResult, float]:
    """Return an answer and its natural residual; that of the rule where there are several.

    Notes
    -----
    Cost: 10 us where rows are independent, 30 us where a motion along all normals opens all
    contacts, as on a floor; 0.1 to 1 ms where that takes a search, 0.3 ms where redundant contacts
    slide, and 2 to 20 ms where there are several answers.
    """
    if problem.law != "ncp" or problem.R is not None or not any(problem.sets.coefficients):
        return found, natural  # convex: G lam is the same in all answers
    case = None
    if problem.rows <= _MOST and not _is_independent(problem.G):
        opens = _all_contacts_open(problem, _along_normals(problem))
        stress = None if opens else _stress(problem)
        if stress is not None:
            return _wedged(problem, found, natural, accuracy, stress)
        if natural <= max(accuracy, tolerances.CONTACT_SOLVED):
            case = _continuum(problem, found.lam, _closed_modes(problem, found.lam))
    if case is None and natural <= max(accuracy, tolerances.CONTACT_SOLVED):
        case = _painleve(problem, found.lam)
    if case is None:
        return found, natural
    lam = _limit(problem)
    if lam is None:
        return found._replace(several=(case._replace(by_rule=False),)), natural
    again = _continuum(problem, lam) or _painleve(problem, lam)
    apart = np.abs(problem.velocities(lam) - problem.velocities(found.lam)).max()
    if again is None and apart <= _MOVED * problem.scale[1]:
        return found, natural  # it had only just met its accuracy, and seemed to slide
    return _with_indeterminacy(found, lam, again or case), natural_residual(problem, lam)


def is_determined(problem: ContactProblem) -> bool:
    """True if all answers of a problem are proved to have one sigma."""
    # It is convex, or each of its islands is, or has one contact with G_nn > mu |G_nt|.
    for island in islands(problem) or (None,):
        part = problem if island is None else island.problem(problem)
        if part.law == "ccp" or not any(part.sets.coefficients):
            continue
        if (
            part.R is not None
            or len(part.names) > 1
            or not _all_contacts_open(part, _along_normals(part))
        ):
            return False
    return True


def _with_indeterminacy(found: SolverResult, lam: Array, *several: Indeterminacy) -> SolverResult:
    return found._replace(lam=lam, path=(*found.path, "equal compliance"), several=several)


# ------------------------------------------------------------------------------------------------
# Wedges.


def _wedged(
    problem: ContactProblem, found: SolverResult, natural: float, accuracy: float, stress: Array
) -> tuple[SolverResult, float]:
    """Return the answer of the rule, and what the wedge could hold and does not."""
    lam = _sticking_impulses(problem, accuracy)
    if lam is None:
        lam = _limit(problem)
    is_by_rule = lam is not None
    if lam is not None:
        found, natural = _with_indeterminacy(found, lam), natural_residual(problem, lam)
    moving = _moving(problem, found.lam)
    if not any(moving):
        return found, natural
    held = _could_hold(problem, stress)
    if not (held & np.array(moving)).any():
        return found, natural
    names = tuple(problem.names[i] for i in np.flatnonzero(held))
    return found._replace(several=(Indeterminacy("wedge", names, by_rule=is_by_rule),)), natural


def _sticking_impulses(problem: ContactProblem, accuracy: float) -> Array | None:
    """Return impulses with which all that closes sticks, if they are an answer."""
    # It stays one with equally compliant contacts: the rule has the same motion.
    lam = sticking(problem)
    return lam if lam is not None and natural_residual(problem, lam) <= accuracy else None


def _moving(problem: ContactProblem, lam: Array) -> list[bool]:
    """Return True for each cone with friction that does not stick."""
    still, s = MOVES * problem.scale[1], problem.velocities(lam).tolist()
    sets = problem.sets
    t1, t2, n = sets.axes
    speeds = zip(sets.coefficients, s[t1], s[t2], s[n], strict=True)
    return [mu > 0 and max(map(abs, each)) > still for mu, *each in speeds]


def _is_independent(G: Array) -> bool:
    """True if no row of G is a combination of others: every impulse moves something."""
    factor, info = dpotrf(G)
    if info:
        return False
    pivots = factor.diagonal().tolist()
    return bool(min(pivots) > _PIVOT * max(pivots))


def _along_normals(problem: ContactProblem) -> Array:
    """Return the velocities (m,) that equal impulses along all normals give."""
    return np.asarray(
        problem.G.dot(_normals(problem.rows, len(problem.friction), problem.half_lines))
    )


@lru_cache(maxsize=16)
def _normals(rows: int, cones: int, half_lines: int) -> Array:
    """Return one in the normal rows, zero elsewhere (m,)."""
    e = np.zeros(rows)
    e[2 : 3 * cones : 3] = e[3 * cones : 3 * cones + half_lines] = 1.0
    return read_only(e)


def _all_contacts_open(problem: ContactProblem, S: Array) -> bool:
    """True if velocities (m,) open every contact that impulses move: sigma_n > mu |sigma_t|."""
    (t1, t2, n), lines = problem.sets.axes, problem.sets.parts[1]
    margin = S[n] - problem.friction * np.hypot(S[t1], S[t2])
    enough = _OPENS * float(np.abs(S).max())
    if margin.min(initial=np.inf) > enough and S[lines].min(initial=np.inf) > enough:
        return True
    diagonal = problem.G.diagonal()
    stuck = np.concatenate((diagonal[n], diagonal[lines])) == 0.0
    return bool(stuck.any()) and bool((stuck | (np.append(margin, S[lines]) > enough)).all())


def _stress(problem: ContactProblem) -> Array | None:
    """Return z (m,) in K with G z = 0 and g . z = 0, of a sum of normals near one; None without."""
    # By nonnegative least squares over the edges N of polygons inside the cones,
    #     min |X N x|^2 + (g . N x)^2 + (1 . x - 1)^2,    X^T X = G.
    # imported here: scipy.optimize takes as long to import as Pinocchio
    from scipy.optimize import nnls

    G, (stiff, speed) = problem.G, problem.scale
    rows = problem.sets.parts[1].stop
    G = G[:rows, :rows] / stiff
    if not np.isfinite(G).all() or _opens_by_motion(problem, G):
        return None
    X = np.vstack((_factor(G), problem.g[:rows] / speed))
    N, _ = _edges(problem)
    A = X @ N
    try:
        x, _ = nnls(np.vstack((A, np.ones(N.shape[1]))), np.append(np.zeros(len(A)), 1.0))
    except (RuntimeError, ValueError):  # out of iterations: nothing is proved
        return None
    z = N @ x
    size = np.abs(z).max()
    balanced = np.abs(G @ z).max() <= _BALANCED * size and abs(X[-1] @ z) <= _TOUCHING * size
    return z if balanced else None


def _opens_by_motion(problem: ContactProblem, G: Array) -> bool:
    """True if the motion nearest to one that opens all contacts alike opens them all."""
    rows = len(G)
    more = G + 1e-10 * np.eye(rows)
    _, x, info = dposv(more, _normals(rows, len(problem.friction), problem.half_lines))
    if info:
        return False
    S = np.zeros(problem.rows)
    S[:rows] = G @ x
    return _all_contacts_open(problem, S)


def _factor(G: Array) -> Array:
    """Return X (r, m) with X^T X = G."""
    values, vectors = np.linalg.eigh(G)
    kept = values > _NO_MOTION * np.trace(G)
    return np.asarray(np.sqrt(values[kept])[:, None] * vectors[:, kept].T)


def _edges(problem: ContactProblem) -> tuple[Array, Array]:
    """Return edges N (rows, columns) of polygons in the cones, and of half-lines; whose each is."""
    k, lines, diagonal = len(problem.friction), problem.half_lines, problem.G.diagonal()
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    columns, owners = list[Array](), list[int]()
    for i in range(k + lines):
        row = 3 * i + 2 if i < k else 2 * k + i
        if diagonal[row] == 0.0:  # constraints hold it: no impulse does anything there
            continue
        mu = problem.sets.coefficients[i] * _INSIDE if i < k else 0.0
        edges = np.zeros((_SIDES if mu else 1, 3 * k + lines))
        edges[:, row] = 1.0
        if mu:
            edges[:, row - 2 : row] = mu * circle
        columns.append(edges)
        owners += len(edges) * [i]
    if not columns:
        return np.zeros((3 * k + lines, 0)), np.zeros(0, dtype=int)
    return np.vstack(columns).T, np.array(owners)


def _could_hold(problem: ContactProblem, stress: Array) -> Array:
    """Return the mask (k,) of as many cones with friction in a stress as there are."""
    # By the same least squares, each contact near to a part of one, and balance with a large
    # weight.
    from scipy.optimize import nnls

    (stiff, speed), rows, k = problem.scale, problem.sets.parts[1].stop, len(problem.friction)
    X = np.vstack((_factor(problem.G[:rows, :rows] / stiff), problem.g[:rows] / speed))
    N, owners = _edges(problem)
    share = (owners == np.unique(owners)[:, None]).astype(float)
    b = np.append(np.zeros(len(X)), np.ones(len(share)))
    parts = stress[2 : 3 * k : 3] > _PART * stress.max()
    try:
        x, _ = nnls(np.vstack((_BALANCE * (X @ N), share)), b)
    except (RuntimeError, ValueError):
        return np.asarray(parts & (problem.friction > 0))
    parts |= (N @ x)[2 : 3 * k : 3] > _PART
    return np.asarray(parts & (problem.friction > 0))


# ------------------------------------------------------------------------------------------------
# Redundant contacts that slide.


def _continuum(
    problem: ContactProblem, lam: Array, modes: Modes | None = None
) -> Indeterminacy | None:
    """Return the contacts that slide where the equations of their modes leave velocities open."""
    # The modes are those of lam (m,), or given.
    if modes is None:
        modes = contact_modes(problem, lam)
    slides = (modes[: len(problem.friction)] == SLIDE) & (problem.friction > 0)
    if not slides.any() or not _may_be_redundant(problem, modes):
        return None
    small, unit = normalised(problem)
    lam_at_end = newton(small, np.asarray(lam / unit), _POLISH).lam
    equations = ContactsInModes(small, modes).at(lam_at_end)
    A = equations.by_sigma.dot(small.G) + equations.by_lam
    if not np.isfinite(A).all():
        return None
    _, values, vectors = np.linalg.svd(A / np.linalg.norm(A, axis=1, keepdims=True))
    free = vectors[values <= _LEFT * values[0]]
    if not len(free) or not np.abs(small.G.dot(free.T)).max() > _MOVED:
        return None
    return Indeterminacy("continuum", tuple(problem.names[i] for i in np.flatnonzero(slides)))


def _closed_modes(problem: ContactProblem, lam: Array) -> Modes:
    """Return modes in which contacts that touch without a load are closed, too."""
    # An answer may be at the end of its continuum, where a contact has lost its load to others.
    modes, sigma = contact_modes(problem, lam).copy(), problem.velocities(lam)
    still, (t1, t2, n) = MOVES * problem.scale[1], problem.sets.axes
    of_cones = modes[: len(problem.friction)]
    slips = np.maximum(np.abs(sigma[t1]), np.abs(sigma[t2])) > still
    touches = (of_cones == OPEN) & (sigma[n] <= still)
    of_cones[touches] = np.where(slips[touches], SLIDE, STICK)
    return modes


def _may_be_redundant(problem: ContactProblem, modes: Modes) -> bool:
    """True if rows of contacts that are not open may be combinations of others."""
    rows = np.flatnonzero((modes > 0)[problem.sets.blocks])
    diagonal = problem.G.diagonal()[rows]
    if not diagonal.all():
        rows, diagonal = rows[diagonal > 0], diagonal[diagonal > 0]
    size = np.sqrt(diagonal)
    factor, info = dpotrf(problem.G[rows[:, None], rows] / (size[:, None] * size))
    return bool(info) or not factor.diagonal().min(initial=1.0) > _PIVOT


# ------------------------------------------------------------------------------------------------
# Painlevé.


def _painleve(problem: ContactProblem, lam: Array) -> Indeterminacy | None:
    """Return the contact at which another answer was found, with that answer's impulse."""
    n, G = problem.sets.axes[2], problem.G
    # G_nn, and G_nt beside it
    across = np.hypot(G.diagonal(2)[: n.stop : 3], G.diagonal(1)[1 : n.stop : 3])
    if not (G.diagonal()[n] <= problem.friction * across).any():
        return None
    is_alone = len(problem.names) == 1
    stuck = -np.linalg.pinv(G, rcond=1e-12, hermitian=True) @ problem.g
    others = _answers_of_one(problem) if is_alone else [np.zeros(problem.rows), stuck]
    sigma, speed = problem.velocities(lam), problem.scale[1]
    for other in others:
        natural = natural_residual(problem, other)
        if not (natural <= tolerances.CONTACT_SOLVED or is_alone):
            other = refine(problem, other, 4 * _POLISH).lam
            natural = natural_residual(problem, other)
        apart = np.abs(problem.velocities(other) - sigma)
        if natural <= tolerances.CONTACT_SOLVED and apart.max() > _MOVED * speed:
            i = int(np.abs(other - lam)[n].argmax())
            return Indeterminacy("painleve", (problem.names[i],), float(other[3 * i + 2]))
    return None


def _answers_of_one(problem: ContactProblem) -> list[Array]:
    """Return answers of one contact: open, stuck, and slipping in each direction that does."""
    #     lam = lam_n (-mu cos a, -mu sin a, 1),  sigma_n = 0,  sigma_t along (cos a, sin a)
    # is a root of one function of a.
    G, g, mu = problem.G, problem.g, float(problem.friction[0])

    def at(angles: Array) -> tuple[Array, Array]:
        c, s = np.cos(angles), np.sin(angles)
        lam = np.stack((-mu * c, -mu * s, np.ones_like(c)))
        lam *= -g[2] / (G[2] @ lam)
        sigma = g[:, None] + G @ lam
        return c * sigma[1] - s * sigma[0], lam

    with np.errstate(all="ignore"):
        angles = 2 * np.pi * np.arange(_SLIPS + 1) / _SLIPS
        off = at(angles)[0]
        roots = np.flatnonzero(off[:-1] * off[1:] <= 0)
        low, high, sign = angles[roots], angles[roots + 1], off[roots]
        for _ in range(_BISECTIONS):
            mid = 0.5 * (low + high)
            before = at(mid)[0] * sign > 0
            low, high = np.where(before, mid, low), np.where(before, high, mid)
        slipping = at(high)[1].T
    stuck = -np.linalg.pinv(G, rcond=1e-12, hermitian=True) @ g
    return [lam for lam in (np.zeros(3), stuck, *slipping) if np.isfinite(lam).all()]


# ------------------------------------------------------------------------------------------------
# The rule.


def compliance(problem: ContactProblem) -> Array:
    """Return R (m,) of the rule: the mean of G over cones, its own entry of joints [1/kg]."""
    R = problem.G.diagonal().copy()
    cones = problem.sets.parts[0]
    R[cones] = R[cones].mean()
    return R


def _limit(problem: ContactProblem) -> Array | None:
    """Impulses of equally compliant contacts, in the limit of rigid ones."""
    R, lam = compliance(problem), None
    for eps in _SOFT:
        lam = _compliant(problem, eps * R, lam)
    for ends in _ENDS:
        kept = []
        for eps in ends:
            lam = _compliant(problem, eps * R, lam)
            if lam is None:
                return None
            kept.append(lam)
        end = np.array(_weights(ends)) @ np.array(kept)
        for best in (end, refine(problem, end, _POLISH).lam):
            if natural_residual(problem, best) <= tolerances.CONTACT_POLISHED:
                return np.asarray(best)
    return np.asarray(best) if natural_residual(problem, best) <= _GOOD_ENOUGH else None


def _weights(ends: tuple[float, ...]) -> list[float]:
    """Return the shares of values at `ends` in that at zero of the parabola through them."""
    return [
        float(np.prod([other / (other - one) for other in ends if other != one])) for one in ends
    ]


def _compliant(problem: ContactProblem, R: Array, guess: Array | None) -> Array | None:
    """Return the answer of a problem with compliance, from a guess; None if none is found."""
    soft = problem.replaced(R=R)
    for _ in range(_STEPS // _POLISH):  # it goes on at rounding, which costs more than the rest
        found = refine(soft, guess, _POLISH)
        natural, guess = natural_residual(soft, found.lam), found.lam
        if natural <= tolerances.FINEST:
            break
    if natural <= _RUNG:
        return found.lam
    for found in SemismoothNewton().alternatives(soft, found):  # noqa: B020
        if natural_residual(soft, found.lam) <= _RUNG:
            return found.lam
    return None
