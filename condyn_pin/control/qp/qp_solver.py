"""The contract of a solver of quadratic programs, and how to write one.

1. Add one file to this folder with one frozen dataclass that inherits from `QPSolver`. Its fields
   are its parameters, each with a default, and in the docstring the reason of the default.
2. Set `title` and `use`. The class registers itself under its lower-case name in `QPS`, and the
   tests find it there.
3. Write `_start()`. It imports the package, with `package` for the error of one that is missing,
   and returns a function of a `QuadraticProgram` that returns a `QPResult`. The function may keep
   memory and a start from one call to the next, where the sizes are the same.
4. It is called by `start()`, which lets through programs whose bounds leave a value to each row.
   Bounds that do not exist are infinite. z has the signs of `QuadraticProgram`. Rows of A are
   independent in the programs of a chain.
5. Nothing is believed: an answer is polished on its active set and judged by its KKT residual, and
   "infeasible" is asked again elsewhere (`condyn_pin.control.qp.chain`). Rough answers are welcome.
6. A solver that can answer more roughly, where it says "infeasible" by mistake, returns itself with
   another tolerance as its `rougher`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib import import_module
from importlib.util import find_spec
from math import isfinite
from typing import Any, ClassVar, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_count, register
from condyn_pin._core.arrays import Array, Indices, diagonal_of
from condyn_pin.errors import MissingExtra

# QuadraticProgram: a strictly convex quadratic program, and what is left of its optimality.
#
#     min  1/2 x^T H x + g^T x    with    A x = b,    lower <= C x <= upper
#
# At its answer, with multipliers y and z, z > 0 at an upper bound and z < 0 at a lower one,
#
#     H x + g + A^T y + C^T z = 0,    A x = b,    C x = clip(C x + z, lower, upper).


Verdict = Literal["solved", "infeasible", "failed"]


class Constraints(NamedTuple):
    """Equations and inequalities of programs with the same unknowns, whatever their objective."""

    # A (p, n), b (p,): equations [1], [m/s^2]; rows may depend on each other
    A: Array
    b: Array
    # C (r, n), lower (r,), upper (r,): inequalities [1], [m/s^2]
    C: Array
    lower: Array
    upper: Array


@dataclass(frozen=True, eq=False)
class QuadraticProgram:
    """The data of one program; bounds that do not exist are infinite.

    min over x of x^T H x / 2 + g^T x    with  A x = b,    lower <= C x <= upper

    Attributes
    ----------
    H : (n, n) array
        Positive definite [1].
    g : (n,) array
        Linear term of the cost [m/s^2].
    A, b : (p, n), (p,) array
        Equations [1], [m/s^2]; rows may depend on each other.
    C, lower, upper : (r, n), (r,), (r,) array
        Inequalities [1], [m/s^2].
    """

    H: Array
    g: Array
    A: Array
    b: Array
    C: Array
    lower: Array
    upper: Array

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of unknowns, of equations and of inequalities."""
        return len(self.g), len(self.b), len(self.lower)

    @property
    def has_room(self) -> bool:
        """True if the bounds of each row leave a finite value: not if they are crossed or NaN."""
        least, most = self.lower, self.upper
        return bool(((least <= most) & (least < np.inf) & (most > -np.inf)).all())

    @cached_property
    def pinned(self) -> NDArray[np.bool_]:
        """Mask of the inequalities that are equations, their bounds being the same (r,)."""
        return np.asarray(self.lower == self.upper)

    @property
    def has_nan_bounds(self) -> bool:
        """True if a bound is NaN."""
        return bool(np.isnan(self.lower).any() or np.isnan(self.upper).any())

    def kkt_residual(self, x: Array, y: Array, z: Array) -> float:
        """Return the largest of the three; that of the gradient relative to its largest term.

        Bounds that are crossed leave what one of them is violated by.

        Parameters
        ----------
        x, y, z : (n,), (p,), (r,) array
            An answer, and the multipliers of equations and inequalities.
        """
        # asked in every tick: of a vector `dot` takes two thirds of the time of @
        Hx, Cx = self.H.dot(x), self.C.dot(x)
        size = 1.0 + max(peak(self.g), peak(Hx))  # what is not finite shows in the gradient
        nearest = np.minimum(np.maximum(Cx + z / size, self.lower), self.upper)
        gradient = Hx + self.g + y.dot(self.A) + z.dot(self.C)
        gradient /= size
        missed = self.A.dot(x) - self.b, Cx - nearest, np.maximum(self.lower - nearest, 0.0)
        found = largest_norm(np.concatenate((gradient, *missed)))
        return found if isfinite(found) else np.inf


def largest_norm(v: Array) -> float:
    """Return the largest size of an entry; NaN if one is."""
    return float(np.maximum.reduce(np.abs(v))) if len(v) else 0.0


def peak(v: Array) -> float:
    """Return the largest size of an entry of finite numbers, in half the time of `largest_norm`."""
    return abs(float(v[_blas()(v)])) if len(v) else 0.0


@cache
def _blas() -> Any:
    # imported here: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.blas import idamax

    return idamax


class QPResult(NamedTuple):
    """Answer of a solver of quadratic programs, not yet checked."""

    # x (n,), z (r,): answer, and multipliers of the inequalities; they tell which rows are active
    x: Array
    z: Array
    # what the solver itself says; it is not checked yet
    verdict: Verdict
    iterations: int


# The contract of a solver of quadratic programs, and how to write one.


QPS: dict[str, type[QPSolver]] = {}

# Iterations that an ordinary program is counted as; a tick of a robot on its feet takes 5 to 40.
ORDINARY: Final = 50

BoundQP = Callable[[QuadraticProgram], QPResult]


@dataclass(frozen=True)
class QPSolver(ABC):
    """A way to solve quadratic programs; a frozen value.

    Parameters
    ----------
    budget : int
        What this solver, and those that are tried where it fails, may take together for a program,
        in ordinary programs: fifty iterations each. Without an answer by then the status of a
        control tick is `out_of_budget`.
    """

    title: ClassVar[str]
    use: ClassVar[str]  # when to take it
    module: ClassVar[str]  # of the package that solves

    budget: int = field(default=100, kw_only=True, repr=False)

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if getattr(cls._start, "__isabstractmethod__", False):
            return
        register(QPS, cls.__name__.lower(), cls, f"a QP solver named {cls.__name__}")

    def start(self) -> BoundQP:
        """Return this solver with memory of its own.

        What it returns says "infeasible" of rows whose bounds leave no value, such as a lower one
        above its upper one, and "failed" where numbers of the program or of the answer are NaN or
        infinite: solvers call some of these solved.
        """
        check_count("budget", self.budget)
        work = self._start()

        def solve(program: QuadraticProgram) -> QPResult:
            if not program.has_room:
                verdict: Verdict = "failed" if program.has_nan_bounds else "infeasible"
                n, _, r = program.sizes
                return QPResult(np.zeros(n), np.zeros(r), verdict, 0)
            found = work(program)
            if found.verdict == "solved" and not np.isfinite(found.x).all():
                return found._replace(verdict="failed")
            return found

        return solve

    @abstractmethod
    def _start(self) -> BoundQP:
        """Return the bound solver."""

    @property
    def rougher(self) -> QPSolver | None:
        """The solver with a tolerance that finds no false infeasibility; None if it has none."""
        return None

    @property
    def installed(self) -> bool:
        """True if its package is installed."""
        return find_spec(self.module) is not None


def package(name: str) -> Any:
    """Return a package that solves quadratic programs, or raise MissingExtra."""
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingExtra(
            f'{name} is missing: python -m pip install "condyn_pin[control]"'
        ) from error


# Saddle: where a program has its optimum if some rows hold with equality, G x = d.
#
#     [H    G^T    ] [x]   [-g]
#     [G  -delta I ] [y] = [ d]
#
# delta lets rows depend on each other. What it changes is taken out again by repetition, each from
# what is left of the equations with delta = 0. Where rows depend on each other, multipliers stay
# near those that it starts from.


# delta, where the largest entry of H is 1: rows of size 1 that depend on each other are told from
# those that do not at its square root, and each repetition takes a factor of 1e-5 or more off.
_DELTA = 1e-11
_REPETITIONS = 4
_SETTLED = 1e-13  # of what is wanted: a step that changes the last digits alone


class Saddle:
    """The matrix and its factors, in memory that is kept from program to program of one size."""

    _sizes = -1, -1

    def factorise(self, program: QuadraticProgram, G: Array, d: Array) -> None:
        """Take a program with rows G (m, n) that are equal to d (m,)."""
        n, m = G.shape[1], len(d)
        if self._sizes != (n, m):
            self._make(n, m)
        self._H[:], self._G[:], self._GT[:] = program.H, G, G.T
        np.negative(program.g, out=self._wanted[:n])
        self._wanted[n:] = d
        self._corner[:] = -_DELTA / peak(program.H.diagonal())  # the largest entry of H
        # symmetric, and LAPACK reads columns
        self._factor, self._pivots, _ = _lapack()[0](self._K.T)
        self._corner[:] = 0.0

    def improve(self, xy: Array) -> None:
        """Make x and its multipliers (n + m,) exact, in place."""
        dgetrs, wanted = _lapack()[1], self._wanted
        settled = _SETTLED**2 * wanted.dot(wanted)
        for _ in range(_REPETITIONS):
            left = wanted - self._K.dot(xy)
            xy += dgetrs(self._factor, self._pivots, left)[0]
            if left.dot(left) <= settled:
                break

    def _make(self, n: int, m: int) -> None:
        self._sizes = n, m
        self._K, self._wanted = np.zeros((n + m, n + m)), np.zeros(n + m)
        self._H, self._G, self._GT = self._K[:n, :n], self._K[n:, :n], self._K[:n, n:]
        self._corner = diagonal_of(self._K)[n:]


@cache
def _lapack() -> tuple[Any, Any]:
    # imported here: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.lapack import dgetrf, dgetrs

    return dgetrf, dgetrs


# Polish: a rough answer of a quadratic program made exact on its active set.
#
# The active rows are taken as equations, and the optimum that they leave is found exactly
# (`saddle`). Rows that are then violated become active, and those whose multiplier has the wrong
# sign are released: the primal-dual active-set method, a semismooth Newton method on
# `QuadraticProgram.kkt_residual`. Where rows depend on each other, multipliers stay near those that
# the rough answer has, and so do their signs.
#
# It has ended where the active set stays as it is. A small residual alone does not prove it: what
# only the regularisation decides is wrong by the residual over that, which is 1e-5 where tasks have
# 1e4.
#
# References
# ----------
# Hintermüller, Ito, Kunisch. The primal-dual active set strategy as a semismooth Newton method.
# SIAM
# Journal on Optimization, 2002.


Flags = NDArray[np.bool_]


class PolishedAnswer(NamedTuple):
    """The answer of a program on an active set, and its KKT residual."""

    x: Array
    y: Array
    z: Array
    # at_lower, at_upper (r,): the active rows
    at_lower: Flags
    at_upper: Flags
    active: Indices  # (k,) their numbers
    residual: float
    settled: bool = False  # whether no row would become active or be released

    @classmethod
    def rough(
        cls, x: Array, y: Array, z: Array, at_lower: Flags, at_upper: Flags
    ) -> PolishedAnswer:
        """Return an answer that has not been judged yet."""
        return cls(x, y, z, at_lower, at_upper, (at_lower | at_upper).nonzero()[0], np.inf)


def start_from_active_set(
    program: QuadraticProgram, x: Array, z: Array, active: PolishedAnswer | None = None
) -> PolishedAnswer:
    """Return a rough answer with the rows that are active in it, or in another one."""
    y = np.zeros(len(program.b))
    if active:
        y = active.y if len(active.y) == len(y) else y
        return PolishedAnswer(x, y, z, active.at_lower, active.at_upper, active.active, np.inf)
    moved = program.C @ x + z
    # where rows depend on each other a solver holds only some of them, and its choice has the signs
    at_lower, at_upper = (z < 0) & (moved < program.lower), (z > 0) & (moved > program.upper)
    return PolishedAnswer.rough(x, y, z, at_lower & ~program.pinned, at_upper | program.pinned)


def polish(
    program: QuadraticProgram, rough: PolishedAnswer, tolerance: float, rounds: int, saddle: Saddle
) -> PolishedAnswer:
    """Return the answer that the active-set method ends at, or the best of some rounds."""
    # Violations of rows below `tolerance` are rounding [m/s^2].
    best = now = rough
    for _ in range(rounds):
        now = _on_active_rows(program, now, saddle)
        if not isfinite(now.residual):
            break
        if now.residual <= tolerance and _signs_hold(now):
            return now._replace(settled=True)
        other = _on_other_rows(program, now, tolerance)
        if _same_rows(now, other):  # another round takes off what rounding has left
            now = now._replace(settled=True)
        if _rank(now) < _rank(best):
            best = now
        if now.settled and now.residual <= tolerance:
            break
        now = other
    return best


def _rank(at: PolishedAnswer) -> tuple[bool, float]:
    """Return the sort key of an answer, less for a better one: settled and accurate is first."""
    return not (at.settled and at.residual <= tolerances.KKT), at.residual


def _signs_hold(at: PolishedAnswer) -> bool:
    """True if the multipliers of active rows have the signs of their sides."""
    active = at.active
    return not len(active) or np.array_equal(at.z[active] > 0, at.at_upper[active])


def _same_rows(one: PolishedAnswer, two: PolishedAnswer) -> bool:
    lower, upper = one.at_lower, one.at_upper
    return np.array_equal(lower, two.at_lower) and np.array_equal(upper, two.at_upper)


def _on_other_rows(
    program: QuadraticProgram, now: PolishedAnswer, tolerance: float
) -> PolishedAnswer:
    """Return an answer with the rows that it violates active, and without those of wrong sign."""
    Cx = program.C @ now.x
    inactive = ~(now.at_lower | now.at_upper)
    below, above = Cx < program.lower - tolerance, Cx > program.upper + tolerance
    at_lower = (now.at_lower & (now.z < 0)) | (inactive & below)
    at_upper = (now.at_upper & (now.z > 0)) | (inactive & above)
    at_lower &= ~program.pinned
    at_upper |= program.pinned
    return PolishedAnswer.rough(now.x, now.y, now.z, at_lower, at_upper)


def _on_active_rows(
    program: QuadraticProgram, at: PolishedAnswer, saddle: Saddle
) -> PolishedAnswer:
    """Return the answer with the active rows as equations."""
    n, p, active = len(program.g), len(program.b), at.active
    G, d = _active_equations(program, active, at.at_upper)
    xy = np.concatenate((at.x, at.y, at.z[active]))
    saddle.factorise(program, G, d)
    saddle.improve(xy)
    x, y, z = xy[:n], xy[n : n + p], np.zeros(len(program.lower))
    z[active] = xy[n + p :]
    residual = program.kkt_residual(x, y, z)
    return PolishedAnswer(x, y, z, at.at_lower, at.at_upper, active, residual)


def _active_equations(
    program: QuadraticProgram, active: Indices, at_upper: Flags
) -> tuple[Array, Array]:
    """Return the rows that hold with equality, and what they are equal to: G x = d."""
    if not len(active):  # as in most control ticks
        return program.A, program.b
    bound = np.where(at_upper[active], program.upper[active], program.lower[active])
    return np.concatenate((program.A, program.C[active])), np.concatenate((program.b, bound))


# The elastic program: what has to give where rows contradict each other.
#
# With t >= 0 for the rows that may give, in order of how readily they do,
#
#     min  sum_i c_i t_i    with    A x = b,    lower - t <= C x <= upper + t.
#
# t = 0 proves that the program is feasible. Else rows with t > 0 give, and rows that stand against
# them are those with a multiplier. A linear program, answered by HiGHS: no solver of quadratic
# programs has a part in it.


@dataclass(frozen=True, eq=False)
class Elastic:
    """Least relaxation of the rows of a program."""

    x: Array  # (n,) A point where they give no more than that
    # of_equations (p,), of_inequalities (r,): what each gives
    of_equations: Array
    of_inequalities: Array
    # against_equations (p,), against_inequalities (r,): multipliers: what giving would save, of
    # rows that stand in the way
    against_equations: Array
    against_inequalities: Array


def elastic(
    program: QuadraticProgram, equations: Array, inequalities: Array, *, most: int | None = None
) -> Elastic | None:
    """Return the least relaxation of the rows; None if HiGHS finds none in `most` iterations."""
    # `equations` (p,) and `inequalities` (r,) are the cost c of a row for what it gives; infinite
    # for rows that never give.
    # imported here: scipy.optimize takes as long to import as Pinocchio
    from scipy.optimize import linprog

    n, p, r = len(program.g), len(program.b), len(program.lower)
    soft_A, soft_C = np.isfinite(equations), np.isfinite(inequalities)
    s_A = np.eye(p)[:, soft_A]
    s_C = np.eye(r)[:, soft_C]
    k, m = s_A.shape[1], s_C.shape[1]
    above, below = np.isfinite(program.upper), np.isfinite(program.lower)
    G = np.vstack((
        np.hstack((program.C, np.zeros((r, 2 * k)), -s_C))[above],
        np.hstack((-program.C, np.zeros((r, 2 * k)), -s_C))[below],
    ))  # fmt: skip
    above_all = np.concatenate((program.upper[above], -program.lower[below]))
    A = np.hstack((program.A, s_A, -s_A, np.zeros((p, m))))
    cost = np.concatenate((np.zeros(n), equations[soft_A], equations[soft_A], inequalities[soft_C]))
    free = [(None, None)] * n + [(0.0, None)] * (2 * k + m)
    found = linprog(
        cost, G, above_all, A, program.b, bounds=free, method="highs-ds",
        options={} if most is None else {"maxiter": most},
    )  # fmt: skip
    if found.status != 0:
        return None
    t = found.x[n:]
    gives_A, gives_C = np.zeros(p), np.zeros(r)
    gives_A[soft_A] = t[:k] + t[k : 2 * k]
    gives_C[soft_C] = t[2 * k :]
    against_C = np.zeros(r)
    marginals = np.abs(found.ineqlin.marginals)
    against_C[above] += marginals[: int(above.sum())]
    against_C[below] += marginals[int(above.sum()) :]
    return Elastic(
        np.array(found.x[:n]), gives_A, gives_C, np.abs(found.eqlin.marginals), against_C
    )
