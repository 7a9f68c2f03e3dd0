"""Closing: from a guess to a configuration near it that closes the loops.

With c(q) the gap and J its Jacobian, Levenberg-Marquardt on the manifold,

    dq = -J^T (J J^T + mu I)^-1 c,     q <- q (+) dq,     mu = nu |c|^2,

(+) being `pin.integrate`. With mu in proportion to |c|^2 it converges quadratically also where rows
are redundant. nu grows when a step closes less of the gap than the linear model promised, and falls
when it keeps the promise; a joint at a limit that the step would push through is left out of it.

Where this ends with a gap, or somewhere else than it should, the gap is closed in small shares,

    c(q) = (1 - s) c(q0),     s from 0 to 1,

and if that does not help either, from starts moved at random, further and further: a guess with the
bars in line, or with joints at their limits, can only be left sideways.

References
----------
Yamashita, Fukushima. On the rate of convergence of the Levenberg-Marquardt method. Computing
Suppl. 15, 2001.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.joints import lengths
from condyn_pin.rows.equations import Equations
from condyn_pin.states.gaps import Gap

_DONE = 1e-13  # |c|: rounding, for robots of some metres [m, rad]
_FLOOR = 1e-15  # of mu, relative to the trace of J J^T: redundant rows leave it singular
_STATIONARY = 1e-8  # |J^T c| relative to |J| |c|
_STILL = 1e-10  # share of |c| that a step gains where nothing is to be gained any more
_LONGEST_MOVE = 0.5  # of any joint in one iteration [rad, m]
_LONGEST_SHARE_MOVE = 0.3  # of any joint while one share is closed [rad, m]
_SMALLEST_SHARE = 1 / 256  # of the gap
_NUDGES = (0.1, 0.2, 0.3, 0.4, 0.5)  # standard deviation of each joint [rad, m]
_LAST_STEPS = 400  # to where the gap is stationary
_TINY = 1e-300  # a gain is never divided by zero
_REJECTIONS = 15  # in a row, each with ten times the damping


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the joints that have some, and whose coordinates are plain numbers.

    Attributes
    ----------
    joints : tuple of str
        Names, one for each limited coordinate.
    iv, iq : (k,) int array
        Where the coordinate is in v and in q.
    length : (k,) bool array
        Whether the coordinate is a length.
    lower, upper : (k,) array
        [rad, m]
    """

    joints: tuple[str, ...]
    iv: NDArray[np.int_]
    iq: NDArray[np.int_]
    length: NDArray[np.bool_]
    lower: Array
    upper: Array

    @classmethod
    def of(cls, model: Any) -> Limits:
        """Return the finite limits of a model; free-flyers, balls and the like have none here."""
        lowest, highest = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
        largest = np.finfo(np.float64).max  # what Pinocchio writes for "no limit"
        found = []
        for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
            plain = lengths(joint) if joint.nq == joint.nv else ()
            for k, length in enumerate(plain):
                iv, iq = joint.idx_v + k, joint.idx_q + k
                if lowest[iq] <= highest[iq] and (-largest < lowest[iq] or highest[iq] < largest):
                    found.append((name, iv, iq, length))
        iq_of = np.array([iq for _, _, iq, _ in found], dtype=np.int_)
        return cls(
            tuple(name for name, *_ in found),
            np.array([iv for _, iv, *_ in found], dtype=np.int_),
            iq_of,
            np.array([length for *_, length in found], dtype=np.bool_),
            lowest[iq_of],
            highest[iq_of],
        )

    def clip(self, q: Array) -> None:
        """Move every limited coordinate of q inside, in place."""
        q[self.iq] = np.minimum(np.maximum(q[self.iq], self.lower), self.upper)

    def beyond(self, q: Array) -> dict[str, Gap]:
        """Return the joints that are outside their limits, and how far; the most of a joint."""
        x = q[self.iq]
        out = np.maximum(self.lower - x, x - self.upper)
        found: dict[str, Gap] = {}
        for i in np.flatnonzero(out > 0):
            by, most = float(out[i]), found.get(self.joints[i], Gap(0.0, 0.0))
            found[self.joints[i]] = (
                Gap(max(by, most.length), most.angle)
                if self.length[i]
                else Gap(most.length, max(by, most.angle))
            )
        return found

    def pushed(self, q: Array, step: Array) -> NDArray[np.int_]:
        """Return the velocity indices at a limit that a step would push through."""
        x, dx = q[self.iq], step[self.iv]
        through = ((x <= self.lower) & (dx < 0)) | ((x >= self.upper) & (dx > 0))
        return self.iv[through]


_NONE = np.zeros(0, dtype=np.int_)
NO_LIMITS = Limits((), _NONE, _NONE, np.zeros(0, dtype=np.bool_), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Closing:
    """How a run ended: the configuration, its gap c, accepted steps, and whether none is better."""

    q: Array
    c: Array
    iterations: int
    stationary: bool

    @property
    def size(self) -> float:
        """|c| [m, rad]."""
        return float(np.linalg.norm(self.c))


@dataclass(frozen=True, eq=False)
class Closer:
    """What closes the loops of one scene: its equations, the rows with a position, and what moves.

    Attributes
    ----------
    equations : Equations
    rows : (k,) int array
        Rows that have a position error; a contact that belongs wherever it is has none.
    moving : (nv,) bool array
        Which velocity indices may change.
    limits : Limits
    """

    equations: Equations
    rows: NDArray[np.int_]
    moving: NDArray[np.bool_]
    limits: Limits = NO_LIMITS

    def gap(self, q: Array) -> Array:
        """Return c(q) of these rows."""
        c: Array = self.equations.violation(q)[self.rows]
        return c

    def ends(self, start: Array) -> Iterator[Closing]:
        """Try one run after the other: plain, in shares, from starts nearby, on from the best."""
        q = start.copy()
        self.limits.clip(q)
        found = [self.close(q)]
        yield found[-1]
        found.append(self.follow(q))
        yield found[-1]
        rng = np.random.default_rng(0)
        for nudge in _NUDGES:
            away = np.where(self.moving, nudge * rng.normal(size=len(self.moving)), 0.0)
            near = np.array(pin.integrate(self.equations.model, q, away))
            self.limits.clip(near)
            found.append(self.close(near))
            yield found[-1]
        best = min(found, key=lambda end: end.size)
        if best.size > tolerances.CLOSED and not best.stationary:
            yield self.close(best.q, most=_LAST_STEPS)

    def close(self, q: Array, *, target: Array | float = 0.0, most: int = 60) -> Closing:
        """Return the end of one run from q towards c = target, in at most `most` steps."""
        nu, iterations = 1.0, 0
        c = self.gap(q) - target
        while (size := float(np.linalg.norm(c))) > _DONE and iterations < most:
            J = self.equations.jacobian(q)[self.rows]
            for _ in range(_REJECTIONS):
                step = self._step(q, J, c, nu * size**2)
                if step is None:
                    return Closing(q, c, iterations, True)
                nearer = self._moved(q, step)
                c_nearer = self.gap(nearer) - target
                size_nearer = float(np.linalg.norm(c_nearer))
                if size_nearer < size:
                    break
                if size <= tolerances.CLOSED:  # at rounding
                    return Closing(q, c, iterations, True)
                nu *= 10.0
            else:
                return Closing(q, c, iterations, True)
            # what came of the step, relative to what the linear model promised
            promised = size**2 - float(np.linalg.norm(c + J @ step)) ** 2
            gain = (size**2 - size_nearer**2) / max(promised, _TINY)
            nu *= 4.0 if gain < 0.25 else 0.1 if gain > 0.75 else 1.0
            q, c = nearer, c_nearer
            iterations += 1
            if size - size_nearer < _STILL * size and size > tolerances.CLOSED:
                return Closing(q, c, iterations, True)
        return Closing(q, c, iterations, size <= tolerances.CLOSED)

    def follow(self, q: Array) -> Closing:
        """Return the end of a run that closes the gap in shares, no joint moving far in one."""
        c0 = self.gap(q)
        s, share, iterations = 0.0, 0.25, 0
        while s < 1.0 and share > _SMALLEST_SHARE:
            aim = min(1.0, s + share)
            end = self.close(q, target=(1.0 - aim) * c0, most=8)
            iterations += end.iterations
            moved = np.abs(pin.difference(self.equations.model, q, end.q)).max()
            if end.size < 0.01 * share * np.linalg.norm(c0) and moved < _LONGEST_SHARE_MOVE:
                q, s, share = end.q, aim, 1.5 * share
            else:
                share /= 2
        end = self.close(q)
        return Closing(end.q, end.c, iterations + end.iterations, end.stationary)

    def _step(self, q: Array, J: Array, c: Array, mu: float) -> Array | None:
        """Return the step, clamped, or None if no step of what may move closes the gap."""
        free = self.moving.copy()
        step = np.zeros(len(free))
        while True:
            Jf = J[:, free]
            A = Jf @ Jf.T
            trace = float(A.trace())
            if np.linalg.norm(Jf.T @ c) <= _STATIONARY * np.sqrt(trace) * np.linalg.norm(c):
                return None
            A.flat[:: len(c) + 1] += mu + _FLOOR * trace
            step[:] = 0.0
            step[free] = -Jf.T @ np.linalg.solve(A, c)
            pushed = self.limits.pushed(q, step)
            if not pushed.size:
                break
            free[pushed] = False
        longest = float(np.abs(step).max())
        return step if longest <= _LONGEST_MOVE else step * (_LONGEST_MOVE / longest)

    def _moved(self, q: Array, step: Array) -> Array:
        nearer = np.array(pin.integrate(self.equations.model, q, step))
        self.limits.clip(nearer)
        return nearer
