"""Redundancy: combinations of rows that follow from the others where the loops are closed.

Rows of closed machines depend on each other *on* the constraints. Beside them the combination that
was redundant becomes a row of its own, with a singular value as large as the gap. Let the move dq
close the loops, and let J(q (-) dq) have rank r. Then (Weyl)

    sigma_(r+1)(J(q)) <= |J(q) - J(q (-) dq)|:

what is no larger than what closing changes J by says nothing. With rows and moves in units in which
turning by 1 rad and sliding by one size of the loop are the same, closing changes J by about |dq|,
whatever the machine (1.4 |dq| in the median of 268; benchmarks/noise.py errors). So

    A = R J D,    (R = 1/l for lengths, 1 for angles; D = l for slides, 1 for turns)
    A^T P = Q T,  pivots d_k = |T_kk|,    y = T^-T P^T R c,

and k combinations count as long as d_k > 4 |y_1..k|, the length of the move that closes the loops
with them; never fewer than at closed states. The others are the singular subspace of A,

    N = orth(R P [x; 1]),    T_11^T (T_11 x + T_12) = x H,
    H = T_12^T (T_11 x + T_12) + T_22^T T_22,

and what is left out of the equations of motion:

    M a + h = tau + J^T lam,    (1 - N N^T) (J a + gamma - a_ref) = 0,    N^T lam = 0.

At closed states N is the left null space of J, and these are the equations as they stand.

Hot loops have that subspace at a third of the cost (`KeptRows`). The rows that are pivots where the
loops are closed come first, A = [A_1; A_2], and where they are independent enough to be squared,

    A_1 A_1^T x = -A_1 A_2^T,    E = A_2 + x^T A_1,    |y|^2 = g_1^T (A_1 A_1^T)^-1 g_1,    g = R c.

The largest row of E is the next pivot d_(k+1): where it is below 4 |y|, k rows count, and

    A_1 A_1^T x = -A_1 A_2^T + x H,    (1 + x_0^T x) H = E E^T.

Files round. A row that only their digits tell from a redundant one has a pivot of its own there, at
closed states too, and at all of them: `condyn_pin.dynamics.digits` finds the rank that is meant.

References
----------
Golub, Van Loan. Matrix Computations, 5.4 (pivoted QR) and 7.6 (invariant subspaces).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import inf
from typing import Final, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, Indices, read_only
from condyn_pin._core.linalg import lapack
from condyn_pin._core.models import whole_data
from condyn_pin.constraints.rows.equations import ConstraintRows

_EPS: Final = float(np.finfo(float).eps)

# Closing changes J by up to 3.8 times the move; pivots of redundant combinations were up to 2.2
# times as large (Cassie in float32, one state of 100), those of others 14 times or more at 1e-4.
_TIMES_THE_MOVE: Final = 4.0

# How much closing changes J by, as a multiple of the move: the median of 268 machines.
_OF_A_MOVE: Final = 1.4

# Pivots that the digits of a file make up, in units of its precision: 0.3 to 3 for angles that are
# off by that.
TIMES_THE_PRECISION: Final = 10.0

# Configurations at which sizes of loops are measured, and how far they are moved [rad, m].
_LOOKS, _APART = 4, 0.3

# Levers that are rounding [m].
_NO_LEVER: Final = 1e-9

# Pivots of kept rows over the largest, above which products of rows lose no digits that count:
# x is off by eps over the square of that.
_SQUARED: Final = 1e-2

# A step towards the singular subspace leaves (d_(k+1) / sigma_k)^2 of what the one before has
# turned it by, and sigma_k is a third of the last pivot or more. Below _FEW a few steps do.
_PER_PIVOT: Final = 10.0
_FEW: Final = 0.1

# Closed states at which the rank is counted, besides the nominal one: moved by so much [rad, l]
# along the motion that is left, and closed by Levenberg's and Marquardt's steps. Those end on the
# loops whatever their rank, if it was counted too low at a singular posture or not.
_NEARBY, _MOVED, _STEPS = 2, 0.2, 40

# Damping of these steps, as a share of the trace of A A^T: redundant rows are above rounding.
_DAMPED: Final = 1e-14

# T_22 as a share of d_k whose square is rounding beside 1: [x; 1] is the singular subspace then.
# Where it is not, steps towards it end when one turns it by less than _TURNED: each is smaller than
# the one before by that square, and what is left out is itself as small as the gap.
_SMALL: Final = 1e-8
_TURNED: Final = 1e-10
_TURNS: Final = 30


class RedundantRows(NamedTuple):
    """Combinations of rows that are left out at one state."""

    N: Array  # (m, m - rank) orthonormal combinations of the rows as they are
    rank: int  # independent rows that are kept
    # length of the closing move, or what it leaves open if that is more, over the last pivot: from
    # 0.1 on a is not determined [1]
    doubt: float
    pivot: float  # the last pivot that is kept

    def kept(self, s: Array) -> Array:
        """Rows s (m,) or (m, k) without the combinations that are left out: (1 - N N^T) s."""
        if not self.N.shape[1]:
            return s
        return np.asarray(s - self.N.dot(self.N.T.dot(s)))

    def rest(self, s: Array) -> Array:
        """Part of the rows s (m,) along the combinations that are left out: N N^T s."""
        return np.asarray(self.N.dot(self.N.T.dot(s)))


@dataclass(frozen=True, eq=False)
class Redundancy:
    """The redundancy of the rows of one scene."""

    R: Array  # (m,) scales of rows: 1/l for lengths [1/m], 1 for angles
    D: Array  # (nv,) scales of moves: l for slides [m], 1 for turns
    floor: int  # rank at closed states: fewer rows never count
    least: float  # pivots that rounding of J makes up
    size: float  # the usual size l of a loop [m]
    # rank that the file means, if its digits make up more: the others are left out where their
    # pivots are within ten times its precision, closed or not
    digits: int | None = None
    gap: float = 0.0  # how far the rows that are left out by digits stay open at most [rad, l]
    precision: float = 0.0  # precision of the file [rad, l]

    @classmethod
    def of(
        cls, rows: ConstraintRows, q: Array, P: Array, rank: int | None, closed: bool
    ) -> Redundancy:
        """Redundancy of the rows of a scene at its nominal state q, P (m, nv) its `Sizes`."""
        # `rank` is that at closed states, if it is known. Where the loops cannot be `closed` at q
        # every row counts that is more than rounding: there is no closed machine, and nothing is
        # redundant on it.
        R, D, size = scales(rows, q)
        least = tolerances.BLURRED * _EPS * float(np.linalg.norm(R[:, None] * P * D))
        if rank is not None or not closed:
            return cls(R, D, rows.m if rank is None else rank, least, size)
        found = cls(R, D, 0, least, size)
        ranks = [found.left_out(J, c).rank for c, J in found._closed_states(rows, q)]
        return replace(found, floor=max(ranks))

    def left_out(self, J: Array, c: Array, rank: int | None = None) -> RedundantRows:
        """Combinations of rows that are left out where the rows are J (m, nv), open by c (m,)."""
        return _Pivoted(self, J, c, rank).left_out

    def kept(self, s: Array, J: Array, c: Array) -> Array:
        """Rows s (m,) without the combinations that are left out: (1 - N N^T) s."""
        N = _Pivoted(self, J, c).N
        return s if N is None else np.asarray(s - N.dot(N.T.dot(s)))

    def kept_basis(self, J: Array, c: Array) -> Array:
        """Combinations of rows that are kept: a basis (m, rank) of those across N."""
        return _Pivoted(self, J, c).kept_basis

    def pivots(self, J: Array) -> Indices:
        """Rows of J (m, nv) in the order in which they are pivots (m,)."""
        return _Pivoted(self, J, np.zeros(len(J))).order

    def at(self, rows: ConstraintRows, q: Array) -> RedundantRows:
        """Combinations of rows that are left out at q."""
        # Where the move that closes the loops is long, `doubt` is measured: by how much A changes
        # on it, over the last pivot. A contact that slides to its anchor is far away, and in no
        # doubt.
        c, J = rows.position_level(q)
        found = _Pivoted(self, J, c)
        left = found.left_out
        if left.rank and left.doubt >= tolerances.DOUBT:
            there = pin.integrate(rows.model, q, found.closing_move)
            change = np.linalg.norm((rows.position_level(there)[1] - J).T * self.outer, 2)
            left = left._replace(doubt=min(left.doubt, float(change) / left.pivot))
        return left

    def changes(
        self, left: RedundantRows, v: Array, a: Array, pull: Array, rate: Array, gravity: float
    ) -> float:
        """Share of a that closing the loops and stopping J v changes, estimated by sizes [1]."""
        # The move dq, of length |y|, turns what J a and J^T lam are by |dq| over the last pivot,
        # and changes J v by |dq| |v|. To stop that and `rate` = J v takes dv, which changes gamma
        # by 2 |v| |dv|, and a by as much over the last pivot. `pull` is M^-1 J^T lam.
        speed, of_a, pulled = (float(np.linalg.norm(x / self.D)) for x in (v, a, pull))
        size = max(of_a, gravity / self.size)
        dv = _OF_A_MOVE * left.doubt * speed + float(np.linalg.norm(self.R * rate)) / left.pivot
        change = _OF_A_MOVE * (left.doubt * (of_a + pulled) + 2.0 * speed * dv / left.pivot)
        return change / size if size else change

    def blurred(self, left: RedundantRows, v: Array, a: Array, gravity: float) -> float:
        """Share of a that rounding of the closing move changes, estimated by sizes [1]."""
        rounded = left._replace(doubt=self.least / left.pivot**2)
        return self.changes(rounded, v, a, 0.0 * a, np.zeros(len(self.R)), gravity)

    def left_out_by_digits(self, J: Array) -> RedundantRows | None:
        """Combinations of rows that the digits of the file alone make count, if that is known."""
        if self.digits is None:
            return None
        found = _Pivoted(self, J, np.zeros(len(J)))
        return found.left_out if found.by_digits else None

    def to_close(self, J: Array, c: Array) -> Array:
        """Gap c (m,) without the part that the digits of the file explain, if it is within them."""
        # All of c where the gap is larger, or where digits make no row independent.
        left = self.left_out_by_digits(J)
        if left is None or np.abs(self.R * left.rest(c)).max() > self.precision:
            return c
        return left.kept(c)

    def closing_move(self, J: Array, c: Array, rank: int | None = None) -> Array:
        """Move dq (nv,) that closes the kept rows, J dq = -c, least in the scaled units."""
        return _Pivoted(self, J, c, rank).closing_move

    def free_move(self, J: Array, x: Array, size: float, rank: int | None = None) -> Array:
        """Move dq (nv,) of a size [rad, l] along which no kept row changes, by a random x (nv,)."""
        return _Pivoted(self, J, np.zeros(len(J)), rank).free_move(x, size)

    def singular_values(self, J: Array) -> Array:
        """Singular values of the scaled rows (min(m, nv),)."""
        return np.asarray(np.linalg.svd(self.R[:, None] * J * self.D, compute_uv=False))

    @cached_property
    def outer(self) -> Array:
        """Factors D R^T (nv, m) of the entries of J^T, in LAPACK's layout."""
        return np.asfortranarray(np.outer(self.D, self.R))

    def _closed_states(self, rows: ConstraintRows, q: Array) -> list[tuple[Array, Array]]:
        """Gaps and J at closed states: the nominal one, and others along the free motion."""
        c, J = rows.position_level(q)
        found, rng = [(0.0 * c, J)], np.random.default_rng(0)
        at = _Pivoted(self, J, 0.0 * c)
        for _ in range(_NEARBY):
            near = pin.integrate(rows.model, q, at.free_move(rng.normal(size=len(self.D)), _MOVED))
            c, J = rows.position_level(near)
            for _ in range(_STEPS):
                closed = np.abs(self.R * c).max() <= tolerances.CLOSED
                near = pin.integrate(rows.model, near, self._towards(c, J))
                c, J = rows.position_level(near)
                if closed:  # and by a step more, so that rounding is all that is left open
                    found.append((c, J))
                    break
        return found

    def _towards(self, c: Array, J: Array) -> Array:
        """Move dq (nv,) = -D A^T (A A^T + |R c|^2 1)^-1 R c towards closed loops."""
        A, gaps = self.R[:, None] * J * self.D, self.R * c
        G = A.dot(A.T)
        damping = max(float(gaps.dot(gaps)), _DAMPED * float(np.trace(G)))
        return np.asarray(-self.D * A.T.dot(np.linalg.solve(G + damping * np.eye(len(G)), gaps)))


class _Pivoted:
    """QR factorisation of the scaled rows at one state, and the number of rows that count.

    `rank` rows if it is given, else as many as the digits of the file allow, else by the pivots.
    """

    def __init__(self, of: Redundancy, J: Array, c: Array, rank: int | None = None) -> None:
        self._of, self._m, self._lapack = of, len(J), lapack()
        # arguments by place: by name they take half as long again
        T, order, self._reflectors, _, _ = self._lapack.dgeqp3(J.T * of.outer, 3 * (len(J) + 1), 1)
        self._T = T
        self.order: Indices = order - 1  # LAPACK counts from one
        self._gaps = (of.R * c)[self.order]
        if rank is None and self.by_digits:
            rank = of.digits
        self.rank = self._usual or self._counted if rank is None else min(rank, self._alive)

    @property
    def pivot(self) -> float:
        """The last pivot that is kept."""
        k = self.rank
        return abs(float(self._T.item(k - 1, k - 1))) if k else 1.0

    @property
    def doubt(self) -> float:
        """Length of the closing move over the last pivot."""
        k, y = self.rank, self._closes(self.rank)
        # what the kept rows leave open; where all are left out, all of the gap
        left = self._gaps[k:] - y.dot(self._T[:k, k:])
        return float(np.sqrt(max(y.dot(y), left.dot(left)))) / self.pivot

    @property
    def by_digits(self) -> bool:
        """Rows beyond the rank of the file have pivots that its digits make up."""
        T, k, of = self._T, self._of.digits, self._of
        if k is None or k >= min(T.shape):
            return k is not None
        return bool(abs(T.item(k, k)) <= TIMES_THE_PRECISION * of.precision)

    @property
    def _alive(self) -> int:
        """Pivots that are more than rounding."""
        return int(np.count_nonzero(np.abs(self._T.diagonal()) > self._rounding))

    @property
    def _usual(self) -> int:
        """The floor, if no more rows count and so many are more than rounding; 0 if not."""
        T, k = self._T, self._of.floor
        if not (0 < k < min(T.shape) and abs(T.item(k - 1, k - 1)) > self._rounding):
            return 0
        if abs(T.item(k, k)) <= self._rounding:
            return k
        y = self._closes(k)
        return k if T.item(k, k) ** 2 <= _TIMES_THE_MOVE**2 * y.dot(y) else 0

    @property
    def _counted(self) -> int:
        """Pivots larger than four times the move that closes so many rows, or the floor."""
        d = np.abs(self._T.diagonal())
        alive = self._alive
        moves = np.sqrt(np.cumsum(self._closes(alive) ** 2))
        counts = d[:alive] > _TIMES_THE_MOVE * moves
        k = alive if counts.all() else int(np.argmin(counts))
        return max(k, min(self._of.floor, alive))

    @property
    def _rounding(self) -> float:
        largest = abs(float(self._T.item(0, 0))) if self._m else 0.0
        return max(tolerances.REFERENCE_RANK * largest, self._of.least)

    def _closes(self, k: int) -> Array:
        """Closing move of k rows along those of Q: y (k,) = T^-T P^T R c."""
        if not k:
            return np.zeros(0)
        return self._lapack.dtrtrs(self._T[:k, :k], self._gaps[:k], 0, 1)[0]  # type: ignore[no-any-return]

    @property
    def left_out(self) -> RedundantRows:
        """Combinations of rows that are left out."""
        N = self.N
        if N is None:
            N = np.zeros((self._m, 0))
        return RedundantRows(N, self.rank, self.doubt, self.pivot)

    @property
    def N(self) -> Array | None:
        """Orthonormal combinations that are left out (m, m - rank), R P [x; 1]; None if all count.

        Of the rows as they are.
        """
        m, k = self._m, self.rank
        if k == m:
            return None
        Z = np.empty((m, m - k), order="F")
        Z[self.order[:k]], Z[self.order[k:]] = self._dependence, _unit(m - k)
        Z *= self._of.R[:, None]
        packed, tau, _, _ = self._lapack.dgeqrf(Z, m, 1)
        return self._lapack.dorgqr(packed, tau, m, 1)[0]  # type: ignore[no-any-return]

    @property
    def kept_basis(self) -> Array:
        """Combinations of rows that are kept, R^-1 P [1; -x^T] (m, rank)."""
        m, k = self._m, self.rank
        V = np.empty((m, k))
        V[self.order[:k]] = _unit(k)
        if k < m:
            V[self.order[k:]] = -self._dependence.T
        V /= self._of.R[:, None]
        return V

    @property
    def _dependence(self) -> Array:
        """Factors x (k, m - k) of the singular subspace [x; 1]: fixed point of T_11 x = -T_12."""
        m, k, T, solve = self._m, self.rank, self._T, self._lapack.dtrtrs
        if not k:
            return np.zeros((0, m))
        T11 = T[:k, :k].copy("F")
        T12 = T[:k, k:]
        x: Array
        x = x0 = -solve(T11, T12)[0]
        if not (k < len(T) and abs(T.item(k, k)) > _SMALL * abs(T.item(k - 1, k - 1))):
            return x
        T22 = T[k:m, k:] * _upper(m - k)[: len(T) - k]
        H22, one, off = T22.T.dot(T22), _unit(self._m - k), inf
        for _ in range(_TURNS):
            # T_12^T (T_11 x + T_12) = -x0^T x H: as an iteration by itself it may diverge
            H = self._lapack.dgesv(one + x0.T.dot(x), H22)[2]
            u = solve(T11, x.dot(H), 0, 1)[0]  # T_11 (x - x0)
            better = x0 + solve(T11, u)[0]
            change = float(abs(better - x).max())
            if not change < off:  # values too close to tell subspaces apart
                break
            x, off = better, change
            if change < _TURNED:
                break
        return x

    @property
    def closing_move(self) -> Array:
        """Closing move dq (nv,) = -D Q_1 y."""
        x = np.zeros(len(self._of.D))
        x[: self.rank] = -self._closes(self.rank)
        return self._of.D * self._turned(x)

    def free_move(self, x: Array, size: float) -> Array:
        """Free move dq (nv,): the part of x along which no row changes, of this size [rad, l]."""
        x = x.copy()
        x[: self.rank] = 0.0
        largest = float(np.abs(x).max(initial=0.0))
        return self._of.D * self._turned(x * (size / largest) if largest else x)

    def _turned(self, x: Array) -> Array:
        """Vector Q x (nv,)."""
        columns = self._T[:, : len(self._reflectors)]
        turned = self._lapack.dormqr("L", "N", columns, self._reflectors, x[:, None], len(x))[0]
        return np.asarray(turned[:, 0])


class KeptRows:
    """Combinations of rows that are kept at open states, where as many count as on closed loops.

    J (m, nv): the rows at a closed state: their pivots there come first at every state
    """

    def __init__(self, of: Redundancy, J: Array) -> None:
        m, k = J.shape[0], of.floor
        self.redundancy, self._k, self._lapack = of, k, lapack()
        self._order = of.pivots(J)
        self._scales = np.ascontiguousarray(of.outer.T[self._order])
        P = np.eye(m)[:, self._order]
        self._gaps = (P * of.R[:, None]).T[:k].copy()  # g_1 = (P^T R)_1 c
        P /= of.R[:, None]
        self._first, self._others = P[:, :k].copy(), P[:, k:].copy()
        self._goes = 0 < k < m and of.digits is None

    def basis(self, J: Array, c: Array) -> Array:
        """A basis (m, rank) of the combinations across N, where the rows are J, open by c."""
        if self._goes:
            X = self._dependence(J, c)
            if X is not None:
                return np.asarray(self._first + self._others.dot(X.T))
        return self.redundancy.kept_basis(J, c)

    def _dependence(self, J: Array, c: Array) -> Array | None:
        """Factors X = -x (k, m - k) of the singular subspace; None where pivots have to decide."""
        k, solve, solve_again = self._k, self._lapack.dposv, self._lapack.dpotrs
        A = J.take(self._order, 0) * self._scales
        A1 = A[:k]
        G = A.dot(A1.T).T  # columns, as LAPACK has them
        F, X0, info = solve(G[:, :k], G[:, k:], 0, 1, 1)
        if info:
            return None
        pivots = F.diagonal().tolist()
        least = min(pivots)
        if not least > _SQUARED * max(pivots):
            return None
        E = A[k:] - X0.T.dot(A1)
        S = E.dot(E.T)
        d, g = max(S.diagonal().tolist()), self._gaps.dot(c)
        if not d <= _TIMES_THE_MOVE**2 * g.dot(solve_again(F, g)[0]).item():
            return None
        turned = left = _PER_PIVOT * d / least**2
        if not turned < _FEW:
            return None
        X: Array = X0
        while left > _EPS:  # what the next step would turn it by
            H = solve(_unit(X0.shape[1]) + X0.T.dot(X), S)[1]
            X = X0 + solve_again(F, X.dot(H))[0]
            left *= turned
        return X


@cache
def _unit(k: int) -> Array:
    return read_only(np.eye(k))


@cache
def _upper(k: int) -> Array:
    return read_only(np.triu(np.ones((k, k))))


def scales(rows: ConstraintRows, q: Array, J: Array | None = None) -> tuple[Array, Array, float]:
    """Scales R (m,), D (nv,) and the usual l, by the size l of each loop."""
    # l is the largest lever of a turn on a row that is a length, over some configurations, or at q
    # alone if its J is given. One number a loop, not one a column: a spin about a rod has no lever,
    # but turns what hangs on it by 1 rad.
    model, rng = rows.model, np.random.default_rng(0)
    if J is None:
        moves = [_APART * rng.normal(size=model.nv) if look else 0.0 for look in range(_LOOKS)]
        states = [pin.integrate(model, q, move + np.zeros(model.nv)) for move in moves]
        levers = np.max([np.abs(rows.position_level(state)[1]) for state in states], axis=0)
    else:
        levers = np.abs(J)
    twists = pin.computeJointJacobians(model, whole_data(model), q).reshape(6, -1)
    turns = np.linalg.norm(twists[3:], axis=0) > 0.0
    R = np.ones(rows.m)
    sizes: list[float] = []
    slides: list[Indices] = []  # rows that are lengths, and that no turn moves
    for bound in rows.bounds:
        of_lengths = np.arange(bound.rows.start, bound.rows.stop)[~bound.turns(model)]
        size = float(levers[np.ix_(of_lengths, turns)].max(initial=0.0))
        if size > _NO_LEVER:
            R[of_lengths] = 1.0 / size
            sizes.append(size)
        else:
            slides.append(of_lengths)
    usual = float(np.median(sizes)) if sizes else 1.0
    for of_lengths in slides:
        R[of_lengths] = 1.0 / usual
    return R, np.where(turns, 1.0, usual), usual
