"""ContactProblem: which impulses keep bodies apart and obey Coulomb's law; it knows no robot.

    sigma = G lam + g + R lam

    ncp    K  contains lam,  K* contains d = sigma + (0, 0, mu |sigma_t|),  lam . d = 0
    ccp    K  contains lam,  K* contains sigma,                             lam . sigma = 0

sigma is the velocity of the contacts after the step, lam the impulse on the robot, z along the
normal from the ground to the robot. A ccp is convex: what slides lifts off by mu |sigma_t|.

References
----------
De Saxcé, Feng. The bipotential method. Mathematical and Computer Modelling 28, 1998.
Acary, Cadoux, Lemaréchal, Malick. A formulation of the linear discrete Coulomb friction problem via
convex optimization. ZAMM 91, 2011.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property, lru_cache, partial
from math import copysign, frexp, hypot, inf
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices, finite, read_only
from condyn_pin._core.tolerances import HUGE
from condyn_pin.errors import InvalidArgument

Law = Literal["ncp", "ccp"]
Level = Literal["impulse", "acceleration"]

# Velocities below are none: numbers relative to them, or their squares, are not numbers [m/s].
STILL = 1e-150


@dataclass(frozen=True, eq=False, repr=False)
class ContactProblem:
    """A contact problem: G, g and the sets that the impulses belong to.

    K contains lam,  K* contains d,  lam . d = 0,    sigma = G lam + g + R lam

    with d = sigma in a ccp, and sigma + (0, 0, mu |sigma_t|) in an ncp.

    Rows: three of each cone (t1, t2, n), then one of each half-line, then one of each interval.

    Parameters
    ----------
    G : (m, m) array_like
        J M^-1 J^T along the constraints, which never open, symmetric, not negative [1/kg].
    g : (m,) array_like
        Velocity of the contacts without impulses, with what the scheme adds to it [m/s].
    friction : (k,) array_like
        Coefficients of the cones [1].
    half_lines : int
        Number of rows that can only push: stops of joints.
    limits : (b,) array_like
        Largest impulses of rows with dry friction [N s].
    R : (m,) array_like, optional
        Compliance on the diagonal [1/kg]; none by default.
    law : {"ncp", "ccp"}
        Coulomb's law with Signorini's condition, or its convex relaxation.
    level : {"impulse", "acceleration"}
        What lam and sigma are: [N s] and [m/s], or [N] and [m/s^2].
    names : sequence of str, optional
        Of cones, half-lines and intervals.

    Raises
    ------
    InvalidArgument
        If sizes do not fit, G is not symmetric, or a number is not finite or negative.
    """

    G: Array  # [1/kg]
    g: Array  # [m/s]
    friction: Array
    half_lines: int = 0
    limits: Array = ()  # type: ignore[assignment]  # [N s]
    R: Array | None = None  # [1/kg]
    law: Law = "ncp"
    level: Level = "impulse"
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        m = np.size(self.g)
        put(self, "g", _checked_copy("g", self.g, (m,)))
        G = _checked_copy("G", self.G, (m, m))
        worst = float(np.abs(G - G.T).max(initial=0.0))
        if worst > tolerances.SYMMETRIC * float(np.abs(G).max(initial=0.0)):
            raise InvalidArgument(
                f"G: it differs from its transpose by {worst:.3g}; J M^-1 J^T is symmetric, "
                "(G + G.T) / 2 takes rounding out of it"
            )
        put(self, "G", read_only((G + G.T) / 2))
        put(self, "friction", _not_negative("friction", self.friction, tolerances.MOST_FRICTION))
        put(self, "limits", _not_negative("limits", self.limits))
        if self.R is not None:
            put(self, "R", _not_negative("R", self.R))
            if len(self.R) != m:
                raise InvalidArgument(f"R: {len(self.R)} numbers; {m} are needed, one a row")
        if isinstance(self.half_lines, bool) or not isinstance(self.half_lines, int):
            raise InvalidArgument(f"half_lines = {self.half_lines!r}: a count is needed")
        if self.half_lines < 0 or self.sets.size != m:
            raise InvalidArgument(
                f"g has {m} rows; 3 x {len(self.friction)} of cones, {self.half_lines} of "
                f"half-lines and {len(self.limits)} of intervals are {self.sets.size}"
            )
        if self.law not in get_args(Law):
            raise InvalidArgument(f"law = {self.law!r}: ncp or ccp is needed")
        if self.level not in get_args(Level):
            raise InvalidArgument(f"level = {self.level!r}: impulse or acceleration is needed")
        blocks = len(self.friction) + self.half_lines + len(self.limits)
        put(self, "names", tuple(self.names) or tuple(f"contact {i}" for i in range(blocks)))
        if len(self.names) != blocks:
            raise InvalidArgument(f"names: {len(self.names)} for {blocks} contacts")

    @classmethod
    def trusted(cls, **values: Any) -> ContactProblem:
        """Return a problem of fields that are known to be right; the checks (30 us) are left out.

        `values` are all fields by name. What else is known may be among them: `sets`, of an earlier
        problem with the same, `stiffness` and `scale`.
        """
        made = object.__new__(cls)
        vars(made).update(values)
        return made

    def replaced(self, **changes: Any) -> ContactProblem:
        """Return the problem with `changes` of fields that are known to be right, unchecked."""
        kept = {each.name: getattr(self, each.name) for each in fields(self)}
        return self.trusted(**{**kept, **changes})

    @property
    def rows(self) -> int:
        """Number of rows, m."""
        return len(self.g)

    @cached_property
    def sets(self) -> ContactSets:
        """The sets of the rows."""
        return ContactSets(self.friction, self.half_lines, self.limits)

    @cached_property
    def stiffness(self) -> list[float]:
        """The diagonal of G + R (m,), as plain numbers: what an impulse does to its own row."""
        return stiffness_of(self.G, self.R)

    @cached_property
    def scale(self) -> tuple[float, float]:
        """The sizes that errors are measured by: mean diagonal of G + R [1/kg], and |g| [m/s].

        1 where there is nothing to measure by, or so little that its square is no number.
        """
        return scale_of(self.stiffness, self.g)

    def velocities(self, lam: Array) -> Array:
        """Return sigma = G lam + g + R lam (m,)."""
        sigma = self.G.dot(lam) + self.g
        if self.R is not None:
            sigma += self.R * lam
        return np.asarray(sigma)

    def dual(self, sigma: Array) -> Array:
        """Return the dual of lam: sigma in a ccp, sigma with mu |sigma_t| added to it in an ncp."""
        return self.sets.de_saxce(sigma) if self.law == "ncp" else sigma

    def __repr__(self) -> str:
        return (
            f"ContactProblem({self.law}, {len(self.friction)} cones, {self.half_lines} half-lines, "
            f"{len(self.limits)} intervals)"
        )


def stiffness_of(G: Array, R: Array | None) -> list[float]:
    """Return the diagonal of G + R as plain numbers; see `ContactProblem.stiffness`."""
    diagonal = G.diagonal() if R is None else G.diagonal() + R
    return diagonal.tolist()  # type: ignore[no-any-return]


def scale_of(stiffness: list[float], g: Array) -> tuple[float, float]:
    """Return the sizes that errors are measured by; see `ContactProblem.scale`."""
    # numpy's own mean and max take three times as long for the few rows of a robot
    stiff = sum(stiffness) / max(len(stiffness), 1)
    speed = max(map(abs, g.tolist()), default=0.0)
    return stiff or 1.0, 1.0 if speed < STILL else speed


def _checked_copy(name: str, value: ArrayLike, shape: tuple[int, ...], most: float = HUGE) -> Array:
    """Return a read-only copy of numbers that are finite and not too large."""
    array = finite(name, value, shape)
    largest = float(np.abs(array).max(initial=0.0))
    if largest > most:
        raise InvalidArgument(
            f"{name}: {largest:g} is in it, and {most:g} is the most; rounding or squares of what "
            "is larger hide the rest"
        )
    return read_only(np.array(array))


def _not_negative(name: str, value: ArrayLike, most: float = HUGE) -> Array:
    array = _checked_copy(name, value, (np.size(value),), most)
    if (array < 0).any():
        k = int(array.argmin())
        raise InvalidArgument(f"{name}[{k}] = {array[k]:g}: a number >= 0 is needed")
    return array


# The sets that contact impulses belong to, all rows of a problem at once.
#
# Rows come in this order: cones, three rows each (t1, t2, n); half-lines; intervals.
#
#     cone       K = {l : |l_t| <= mu l_n}          a point that touches, Coulomb friction mu
#     half-line  K = {l >= 0}                       the stop of a joint
#     interval   K = {|l| <= limit}                 dry friction of a joint


_TINY: Final = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, eq=False)
class ContactSets:
    """The set K of a contact problem: a product of cones, half-lines and intervals.

    Attributes
    ----------
    friction : (k,) array
        Coefficients of the cones [1].
    half_lines : int
        Number of half-lines.
    limits : (b,) array
        Of the intervals [N s].
    """

    friction: Array
    half_lines: int
    limits: Array  # [N s]

    @property
    def size(self) -> int:
        """Number of rows, m = 3 k + half_lines + b."""
        return 3 * len(self.friction) + self.half_lines + len(self.limits)

    @cached_property
    def parts(self) -> tuple[slice, slice, slice]:
        """The rows of cones, of half-lines and of intervals."""
        cones = 3 * len(self.friction)
        lines = cones + self.half_lines
        return slice(0, cones), slice(cones, lines), slice(lines, self.size)

    @cached_property
    def axes(self) -> tuple[slice, slice, slice]:
        """The rows t1, t2 and n of all cones."""
        end = 3 * len(self.friction)
        return slice(0, end, 3), slice(1, end, 3), slice(2, end, 3)

    @cached_property
    def blocks(self) -> Indices:
        """Contact of each row (m,), in the order of names."""
        k = len(self.friction)
        singles = self.half_lines + len(self.limits)
        return np.concatenate([np.repeat(np.arange(k), 3), k + np.arange(singles)])

    @cached_property
    def normals(self) -> Indices:
        """The rows of normals of cones and of half-lines, in the order of contacts."""
        cones, lines, _ = self.parts
        return np.array([*range(2, cones.stop, 3), *range(lines.start, lines.stop)], dtype=int)

    @cached_property
    def of_cones(self) -> Indices:
        """The three rows of each cone (k, 3)."""
        return np.arange(3 * len(self.friction)).reshape(-1, 3)

    @cached_property
    def coefficients(self) -> list[float]:
        """Friction of the cones, as plain numbers."""
        return self.friction.tolist()  # type: ignore[no-any-return]

    @cached_property
    def _shrink(self) -> Array:
        return 1 / (1 + self.friction**2)

    def project(self, x: Array) -> Array:
        """Return P_K(x) (m,): the nearest point of the sets."""
        t1, t2, n = self.axes
        x_1, x_2, x_n, mu, result = x[t1], x[t2], x[n], self.friction, np.empty_like(x)
        slip = np.hypot(x_1, x_2)
        # x_n inside, the nearest point of the surface outside, the apex where both are below it
        normal = np.maximum(np.maximum(x_n, (mu * slip + x_n) * self._shrink), 0.0)
        most = mu * normal
        kept = most / np.maximum(np.maximum(slip, most), _TINY)
        result[t1], result[t2], result[n] = kept * x_1, kept * x_2, normal
        if self.half_lines:
            lines = self.parts[1]
            np.maximum(x[lines], 0.0, out=result[lines])
        if len(self.limits):
            intervals = self.parts[2]
            np.clip(x[intervals], -self.limits, self.limits, out=result[intervals])
        return result

    def slopes(self, x: Array) -> tuple[Array, Array]:
        """Return P_K'(x): blocks (k, 3, 3) of the cones, numbers (half_lines + b,) of the others.

        1 inside, 0 where x goes to one point, between them where it goes to the surface of a cone;
        one of the one-sided derivatives where there is none.
        """
        cones, lines, intervals = self.parts
        X, mu, shrink = x[cones].reshape(-1, 3), self.friction, self._shrink
        slip, n = np.hypot(X[:, 0], X[:, 1]), X[:, 2]
        somewhere = np.where(slip > 0, slip, 1.0)
        u = X[:, :2] / somewhere[:, None]
        along = u[:, :, None] * u[:, None, :]
        turn = mu * (mu * slip + n) * shrink / somewhere
        P = np.empty((len(X), 3, 3))
        P[:, :2, :2] = turn[:, None, None] * (np.eye(2) - along)
        P[:, :2, :2] += (mu**2 * shrink)[:, None, None] * along
        P[:, :2, 2] = P[:, 2, :2] = (mu * shrink)[:, None] * u
        P[:, 2, 2] = shrink
        P[slip <= mu * n] = np.eye(3)
        P[mu * slip <= -n] = 0.0
        free = np.concatenate([x[lines] > 0, np.abs(x[intervals]) < self.limits])
        return P, free.astype(np.float64)

    def de_saxce(self, sigma: Array) -> Array:
        """Return sigma + (0, 0, mu |sigma_t|) in the rows of cones: the dual of lam in an ncp."""
        t1, t2, n = self.axes
        dual = sigma.copy()
        dual[n] += self.friction * np.hypot(sigma[t1], sigma[t2])
        return dual


# Islands: contacts that feel each other, apart from those that they do not feel.


class Island(NamedTuple):
    """Contacts of a problem that feel each other and no others."""

    rows: Indices  # (r,) of the problem
    block: tuple[Indices, ...]  # the same as indices of G
    sets: ContactSets  # of these rows
    names: tuple[str, ...]  # of these contacts
    contacts: Indices  # (k,) their places among the names of the problem

    def problem(self, whole: ContactProblem) -> ContactProblem:
        """Return the problem that they are by themselves."""
        return ContactProblem.trusted(
            G=whole.G[self.block], g=whole.g[self.rows], friction=self.sets.friction,
            half_lines=self.sets.half_lines, limits=self.sets.limits,
            R=None if whole.R is None else whole.R[self.rows], law=whole.law, level=whole.level,
            names=self.names, sets=self.sets,
        )  # fmt: skip


def islands(problem: ContactProblem) -> tuple[Island, ...]:
    """Return the components of the graph of G; none where all contacts are connected."""
    # Two contacts feel each other if their block of G has a number that is not zero. What no
    # impulse of the one does to the other is zero to the last bit where bodies share no joint, so
    # that nothing is neglected. Those of the last problems are kept: the next step often has the
    # same.
    G, sets, names = problem.G, problem.sets, problem.names
    if np.count_nonzero(G) == G.size or len(names) < 2:
        return ()
    starts = np.flatnonzero(np.diff(sets.blocks, prepend=-1))
    by_rows = np.logical_or.reduceat(G != 0, starts, axis=0)
    felt = np.logical_or.reduceat(by_rows, starts, axis=1)
    return _islands(sets, names, felt.tobytes())


@lru_cache(maxsize=16)
def _islands(sets: ContactSets, names: tuple[str, ...], pattern: bytes) -> tuple[Island, ...]:
    """Return the components of a graph of contacts, given by its matrix."""
    felt = np.frombuffer(pattern, dtype=bool).reshape(len(names), len(names))
    found = components(felt)
    if len(found) == 1:
        return ()
    return tuple(island_of(sets, names, np.flatnonzero(each)) for each in found)


def components(felt: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Return the masks of the contacts in each component of a graph (k, k)."""
    felt = felt | np.eye(len(felt), dtype=bool)
    label, least = None, np.arange(len(felt))
    while label is None or (least != label).any():  # the smallest index of those connected to each
        label, least = least, np.where(felt, least, len(felt)).min(axis=1)
    return [label == each for each in np.unique(label)]


def island_of(sets: ContactSets, names: tuple[str, ...], contacts: Indices) -> Island:
    """Return some contacts of a problem, by their places among its names."""
    rows = np.flatnonzero(np.isin(sets.blocks, contacts))
    k, lines = len(sets.friction), sets.half_lines
    cones, intervals = contacts[contacts < k], contacts[contacts >= k + lines]
    stops = len(contacts) - len(cones) - len(intervals)
    its_sets = ContactSets(sets.friction[cones], stops, sets.limits[intervals - k - lines])
    its_names = tuple(names[i] for i in contacts)
    return Island(rows, np.ix_(rows, rows), its_sets, its_names, contacts)


# Modes of contacts: open, stick or slide, read off the impulses and velocities.
#
# With x = lam - d / mean(diag G), where P_K(x) is lam in a solved problem: a contact is open where
# x is in the polar cone of K, whatever the solver left of lam. Of the others those slide that move:
# redundant contacts may be on the surface of their cones and stick all the same.
#
# In its mode a contact has three equations, the same number as impulses,
#
#     open   lam = 0
#     stick  sigma = 0
#     slide  sigma_n = 0,  lam_t + mu lam_n s = 0,  s = sigma_t / |sigma_t|


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
    """Return the mode of each contact of a problem that lam (m,) solves."""
    # A stop is open or sticks, dry friction sticks or slides. What is slower than the share `moves`
    # of |g| sticks, by the contacts that feel each other.
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


class ModeEquations(NamedTuple):
    """Residuals of the equations of contacts in their modes at one lam, and their partials."""

    sigma: Array  # (m,)
    left: Array  # (m,), what impulses leave of them
    by_sigma: Array  # (m, m)
    by_lam: Array  # (m, m)
    by_friction: Array  # (m, k)


@lru_cache(maxsize=16)
def _places(k: int, m: int) -> Indices:
    """Return the flat indices of the numbers of cones, then rows, in an array (m, 1 + 2 m + k)."""
    # Columns are what is left, by sigma, by lam and by friction.
    width, rows, singles = 1 + 2 * m + k, np.arange(3 * k).reshape(k, 3), np.arange(3 * k, m)
    columns = np.zeros((k, 3, 8), dtype=np.intp)
    columns[:, :, 1:4], columns[:, :, 4:7] = 1 + rows[:, None], 1 + m + rows[:, None]
    columns[:, :, 7] = 1 + 2 * m + np.arange(k)[:, None]
    of_cones = width * rows[:, :, None] + columns
    of_rows = width * singles + np.stack((0 * singles, 1 + singles, 1 + m + singles))
    return read_only(np.concatenate((of_cones.ravel(), of_rows.T.ravel())))


class ContactsInModes:
    """The equations of the contacts of a problem, each in the mode that it has."""

    def __init__(self, problem: ContactProblem, modes: Modes) -> None:
        self._problem, self._modes = problem, modes.tolist()

    def at(self, lam: Array) -> ModeEquations:
        """Residuals of the equations at impulses lam, and partials; in a ccp what slides lifts."""
        problem, modes, sets = self._problem, self._modes, self._problem.sets
        m, sigma, lifts = len(lam), problem.velocities(lam), float(problem.law == "ccp")
        (t1, t2, n), mu = sets.axes, sets.coefficients
        k, l, s = len(mu), lam.tolist(), sigma.tolist()  # noqa: E741  of the equations above
        numbers: list[float] = []
        for cone in zip(modes, mu, l[t1], l[t2], l[n], s[t1], s[t2], s[n], strict=False):
            numbers += _of_a_cone(lifts, *cone)
        limits = problem.half_lines * [inf] + problem.limits.tolist()
        for mode, limit, li, si in zip(modes[k:], limits, l[3 * k :], s[3 * k :], strict=True):
            # a stop has no limit; dry friction of zero holds nothing
            if mode == STICK and limit:
                numbers += (si, 1.0, 0.0)
            else:
                numbers += (li + copysign(limit, si) if mode == SLIDE else li, 0.0, 1.0)
        equations = np.zeros((m, 1 + 2 * m + k))
        equations.put(_places(k, m), numbers)
        parts = equations[:, 1 : 1 + m], equations[:, 1 + m : 1 + 2 * m], equations[:, 1 + 2 * m :]
        return ModeEquations(sigma, equations[:, 0], *parts)


def _of_a_cone(
    lifts: float, mode: int, mu: float,
    l1: float, l2: float, ln: float, v1: float, v2: float, vn: float,
) -> tuple[float, ...]:  # fmt: skip
    """Return the three equations of a contact, eight numbers each."""
    # What is left, its partials by sigma, those by lam, and that by mu. What slides has s' = (1 - s
    # s^T) sigma_t' / |sigma_t|, and any s on ice, which holds nothing. It `lifts` off, 1, or does
    # not, 0.
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


# The same contact problem in units where its numbers are near one.
#
# With S positive, the same in the rows of one contact, and w a velocity,
#
#     G' = S (G + R) S,   g' = S g / w,   limits' = limits / (S w),   lam = w S lam'
#
# has the same contacts that open, stick and slide. All factors are powers of two: no digit changes.
# Where all rows are cones and bodies are about as heavy, S is one number, by the mean diagonal of
# G; rows of joints have other units than those of points, and each contact has its own then.


# Ratio of how far impulses move contacts from which each has its own S. Feet of a robot are closer;
# with one S, bodies of 1 kg on others of 1 t take ADMM ten times the iterations, and Newton stalls.
_APART = 64.0


def normalised(problem: ContactProblem) -> tuple[ContactProblem, float | Array]:
    """Return the normalised problem, without R, and the unit (m,) or one number of its impulses."""
    if problem.half_lines or len(problem.limits) or _differ(problem):
        return _normalised_by_contact(problem)
    stiff, speed = problem.scale
    G = problem.G if problem.R is None else problem.G + np.diag(problem.R)
    softened, slowed = 1.0 / _power_of_two(stiff), 1.0 / _power_of_two(speed)  # S^2 and S / w
    made = ContactProblem.trusted(
        G=G * softened, g=problem.g * slowed, friction=problem.friction, half_lines=0,
        limits=problem.limits, R=None, law=problem.law, level=problem.level, names=problem.names,
        sets=problem.sets,
    )  # fmt: skip
    return made, softened / slowed


def _differ(problem: ContactProblem) -> bool:
    """True if impulses move some contacts of cones far more than others."""
    diagonal: list[float] = problem.G.diagonal().tolist()
    axes = (diagonal[axis] for axis in problem.sets.axes)
    stiff = [sum(each) for each in zip(*axes, strict=True)]
    return max(stiff, default=0.0) > _APART * min(stiff, default=0.0)


def _normalised_by_contact(problem: ContactProblem) -> tuple[ContactProblem, Array]:
    """Normalised problem with S (m,) by the mean of the diagonal over each contact."""
    G = problem.G if problem.R is None else problem.G + np.diag(problem.R)
    blocks = problem.sets.blocks
    mean = (np.bincount(blocks, G.diagonal()) / np.bincount(blocks))[blocks]
    S = np.ldexp(1.0, -(np.frexp(np.where(mean > 0, mean, 1.0))[1] // 2))
    g = problem.g * S
    fast = float(np.abs(g).max())
    w = 1.0 if fast < STILL else _power_of_two(fast)
    limits = problem.limits / S[problem.sets.parts[2]] / w
    made = problem.replaced(G=G * np.multiply.outer(S, S), g=g / w, limits=limits, R=None)
    return made, S * w


def _power_of_two(x: float) -> float:
    """Return the power of two below x > 0."""
    return float(2.0 ** (frexp(x)[1] - 1))
