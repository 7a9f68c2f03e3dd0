"""Closing loops: Newton's method, branches, anchors.

Closing: from a guess to a configuration near it that closes the loops.

With c(q) the gap and J its Jacobian, Levenberg-Marquardt on the manifold,

    dq = -J^T (J J^T + mu I)^-1 c,     q <- q (+) dq,     mu = nu |c|^2,

(+) being `pin.integrate`. With mu in proportion to |c|^2 it converges quadratically also where rows
are redundant. nu grows when a step closes less of the gap than the linear model promised, and falls
when it keeps the promise; a joint at a limit that the step would push through is left out of it.

Where this ends with a gap, or somewhere else than it should, the gap is closed in small shares,

    c(q) = (1 - s) c(q0),     s from 0 to 1,

and if that does not help either, from starts moved at random, further and further: a guess with the
bars in line, or with joints at their limits, can only be left sideways.

Where digits of a file make redundant rows count (`condyn_pin.dynamics.digits`), all rows lead to
nearly closed loops only, and the rank that is meant closes these.

References
----------
Yamashita, Fukushima. On the rate of convergence of the Levenberg-Marquardt method. Computing
Suppl. 15, 2001.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import count_text, normalised, renamed
from condyn_pin._core.arrays import Array
from condyn_pin._core.show import Outcome
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.rows.bound import (
    ConstraintViolation,
    beyond_text,
    closed,
    largest_violation,
    length,
)
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.rows.redundancy import Redundancy
from condyn_pin.dynamics.at_state import by_digits, equations_of, penetration
from condyn_pin.dynamics.nominal import digits_of
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.errors import BranchChanged, NotAssembled
from condyn_pin.model.joints import NO_LIMITS, Limits

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
# Steps that an ordinary closing is counted as, and closings that all runs together may take.
ORDINARY, BUDGET = 10, 100

_REJECTIONS = 15  # in a row, each with ten times the damping


@dataclass(frozen=True, eq=False)
class ClosingResult:
    """End of a run: configuration, its gap c, accepted steps, and if no smaller gap is near.

    J (m, nv) is that of all rows of the scene at q. Neither has what digits of a file make up.
    """

    q: Array
    c: Array
    iterations: int
    stationary: bool
    J: Array

    @property
    def size(self) -> float:
        """|c| [m, rad]."""
        return float(np.linalg.norm(self.c))


@dataclass(frozen=True, eq=False)
class LoopCloser:
    """Newton's method on the loops of one scene: equations, rows with a position, moving joints.

    A contact that belongs wherever it is has no position error, and no rows here.
    """

    equations: Equations
    rows: NDArray[np.int_]
    moving: NDArray[np.bool_]  # (nv,)
    limits: Limits
    rounded: Redundancy | None = None  # if digits of a file hide it

    @classmethod
    def of(
        cls, scene: Scene, moving: NDArray[np.bool_] | None = None, limits: Limits = NO_LIMITS
    ) -> LoopCloser:
        """Return the closer of the loops of a scene with all joints, or with some."""
        # What digits of a file make up is known once the closed chains of the scene are.
        everything = np.ones(scene.robot.nv, dtype=bool)
        rows = np.array([row for b in scene.bounds for row in b.positioned], dtype=np.int_)
        some = everything if moving is None else moving
        return cls(equations_of(scene), rows, some, limits, by_digits(scene))

    def _look(self, q: Array, rank: int | None = None) -> tuple[Array, Array]:
        """Return c(q) of these rows, and J of all rows: together they take little more than c."""
        # Without all combinations but those that count, if the rank is known.
        c, J = self.equations.position_level(q)
        if rank is not None and self.rounded is not None:
            left = self.rounded.left_out(J, c, rank)
            c, J = left.kept(c), left.kept(J)
        return c[self.rows], J

    def ends(self, start: Array) -> Iterator[ClosingResult]:
        """Try one run after the other: plain, in shares, from starts nearby, on from the best."""
        q, rng, found = start.copy(), np.random.default_rng(0), []
        self.limits.clip(q)
        for run in (self.close, self.follow):
            found.append(run(q))
            yield found[-1]
        for nudge in _NUDGES:
            away = np.where(self.moving, nudge * rng.normal(size=len(self.moving)), 0.0)
            found.append(self.close(self._moved(q, away)))
            yield found[-1]
        best = min(found, key=lambda end: end.size)
        if best.size > tolerances.CLOSED and not best.stationary:
            yield self.close(best.q, most=_LAST_STEPS)

    def close(self, q: Array, *, most: int = 60) -> ClosingResult:
        """Return the end of one run from q towards closed loops, in at most `most` steps."""
        if self.rounded is None:
            return self._run(q, most=most)
        nearly = tolerances.LEAST_PRECISE / float(self.rounded.R[self.rows].max(initial=1.0))
        near = self._run(q, most=most, done=nearly)
        end = self._run(near.q, most=most, rank=self.rounded.digits)
        iterations = near.iterations + end.iterations
        c, J = self.equations.position_level(end.q)
        left = self.rounded.left_out_by_digits(J)
        if left is None:  # all rows count here
            end = self._run(near.q, most=most)
            return replace(end, iterations=iterations + end.iterations)
        c = self.rounded.to_close(J, c)[self.rows]
        stationary = end.stationary or length(c) > end.size
        return ClosingResult(end.q, c, iterations, stationary, left.kept(J))

    def _run(
        self, q: Array, *, target: Array | float = 0.0, most: int = 60, done: float = _DONE,
        rank: int | None = None,
    ) -> ClosingResult:  # fmt: skip
        """Return the end of one run from q towards c = target, until |c - target| is `done`."""
        nu, iterations = 1.0, 0
        c, of_all = self._look(q, rank)
        c = c - target
        while (size := length(c)) > done and iterations < most:
            J = of_all[self.rows]
            for _ in range(_REJECTIONS):
                step = self._step(q, J, c, nu * size**2)
                if step is None:
                    return ClosingResult(q, c, iterations, True, of_all)
                nearer = self._moved(q, step)
                c_nearer, J_nearer = self._look(nearer, rank)
                c_nearer = c_nearer - target
                size_nearer = length(c_nearer)
                if size_nearer < size:
                    break
                if size <= tolerances.CLOSED:  # at rounding
                    return ClosingResult(q, c, iterations, True, of_all)
                nu *= 10.0
            else:
                return ClosingResult(q, c, iterations, True, of_all)
            # what came of the step, relative to what the linear model promised
            promised = size**2 - length(c + J @ step) ** 2
            gain = (size**2 - size_nearer**2) / max(promised, _TINY)
            nu *= 4.0 if gain < 0.25 else 0.1 if gain > 0.75 else 1.0
            q, c, of_all = nearer, c_nearer, J_nearer
            iterations += 1
            if size - size_nearer < _STILL * size and size > tolerances.CLOSED:
                return ClosingResult(q, c, iterations, True, of_all)
        return ClosingResult(q, c, iterations, size <= tolerances.CLOSED, of_all)

    def follow(self, q: Array) -> ClosingResult:
        """Return the end of a run that closes the gap in shares, no joint moving far in one."""
        c0, _ = self._look(q)
        s, share, iterations = 0.0, 0.25, 0
        while s < 1.0 and share > _SMALLEST_SHARE:
            aim = min(1.0, s + share)
            left = 0.003 * share * float(np.linalg.norm(c0)) if self.rounded else _DONE
            end = self._run(q, target=(1.0 - aim) * c0, most=8, done=left)
            iterations += end.iterations
            moved = np.abs(pin.difference(self.equations.model, q, end.q)).max()
            if end.size < 0.01 * share * np.linalg.norm(c0) and moved < _LONGEST_SHARE_MOVE:
                q, s, share = end.q, aim, 1.5 * share
            else:
                share /= 2
        end = self.close(q)
        return replace(end, iterations=iterations + end.iterations)

    def _step(self, q: Array, J: Array, c: Array, mu: float) -> Array | None:
        """Return the step, clamped, or None if no step of what may move closes the gap."""
        free = self.moving
        while True:
            Jf = J if free.all() else np.where(free, J, 0.0)
            A = Jf @ Jf.T
            trace = float(A.trace())
            if length(Jf.T @ c) <= _STATIONARY * math.sqrt(trace) * length(c):
                return None
            A.flat[:: len(c) + 1] += mu + _FLOOR * trace
            step: Array = -Jf.T @ np.linalg.solve(A, c)
            pushed = self.limits.pushed(q, step)
            if not pushed.size:
                break
            free = free.copy()
            free[pushed] = False
        longest = float(np.abs(step).max())
        return step if longest <= _LONGEST_MOVE else step * (_LONGEST_MOVE / longest)

    def _moved(self, q: Array, step: Array) -> Array:
        nearer = np.array(pin.integrate(self.equations.model, q, step))
        self.limits.clip(nearer)
        return nearer


# anchored: a scene whose contacts say where in the world they belong.


def anchored(scene: Scene, q: ArrayLike) -> Scene:
    """Return the scene with its contacts anchored: those without an anchor where they are at q.

    c(q) = 0,    and wherever else a contact is, c is its gap

    A contact without an anchor holds its frame wherever that is: a foot that has slid or come off
    has no gap, and `Baumgarte` does not draw it back. With an anchor it is drawn back to where it
    stood.

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        Configuration [rad, m]; quaternions x y z w.

    Returns
    -------
    Scene
        The same where every contact has an anchor.

    Raises
    ------
    InvalidArgument
        If q is no configuration.
    """
    check_scene(scene)
    return with_anchors(scene, normalised(scene.robot.unedited, "q", q), {})


def with_anchors(scene: Scene, q: Array, places: MutableMapping[Constraint, Constraint]) -> Scene:
    """Return the scene anchored at q; contacts that `places` has get theirs, new ones are added."""
    if all(bound.anchored for bound in scene.bounds):
        return scene
    frames: list[Any] = equations_of(scene).placements(q)
    pairs = zip(scene.constraints, scene.bounds, frames, strict=True)
    for constraint, bound, frame in pairs:
        if constraint not in places:
            stays = bound.anchored or frame is None
            places[constraint] = constraint if stays else constraint.anchored_at(*frame)
    placed = replace(scene, constraints=tuple(places[c] for c in scene.constraints))
    # J, and all that was measured with it, is the same where the contacts touch
    vars(placed)["nominal"] = scene.nominal
    return placed


# Assembly: a configuration near a guess that closes the loops, and what is known of it.


class AssemblyStatus(Outcome):
    """Outcome of an assembly; the value is advice."""

    CLOSED = "every loop is closed"
    BRANCH_CHANGED = (
        "the loops are closed, but on the other side of a dead point; start nearer, or move there "
        "in smaller steps"
    )
    BEYOND_LIMITS = (
        "the loops close only beyond the joint limits; start elsewhere, or pass within_limits=False"
    )
    UNREACHABLE = (
        "this is the smallest gap near the start; start nearer to a closed configuration, or fix "
        "fewer joints"
    )
    OUT_OF_BUDGET = (
        "the budget ended before the loops were closed; start nearer to a closed configuration, or "
        "raise it, assemble(q0, budget=1000)"
    )
    STALLED = "the gap was still getting smaller when the steps ran out; start from where it ended"


@dataclass(frozen=True, eq=False)
class Assembly:
    """Configuration that an assembly ended at, with its gaps, rank and branch.

    Attributes
    ----------
    q : (nq,) array
        The configuration with the smallest gap found [rad, m].
    violation : dict of str to ConstraintViolation
        How far each loop is open at q: a length [m] and an angle [rad].
    iterations : int
        Of all runs that were needed.
    rank : int
        Independent rows among those of the loops, at q.
    smallest_singular_value : float
        Of J_D, the columns of the joints that the others determine, [1, m], not whitened:
        zero in a dead point. Without motors, the smallest nonzero one of J.
    branch : dict of str to int
        For every cluster of loops that share such joints: +1 on the side of its dead points where
        the first posture is, -1 across one, 0 in one; `condyn_pin.mechanism.closed_chains` defines
        them. Empty for a robot without motors: what is not driven has no branches. Nor have loops
        in space with redundant rows.
    flipped : tuple of str
        The clusters that changed sides, if the status is BRANCH_CHANGED.
    beyond_limits : dict of str to ConstraintViolation
        Joints that the closure takes out of their limits, and how far [rad, m]. Of q; or, if the
        status is BEYOND_LIMITS, of the closure that was not taken.
    status : AssemblyStatus
    scene : Scene
    start : (nq,) array
        What was assembled, and from where.
    to_close : dict of str to ConstraintViolation
        `violation` without what the digits of a file leave open, within `Robot.precision`.
    """

    q: Array
    violation: Mapping[str, ConstraintViolation]
    iterations: int
    rank: int
    smallest_singular_value: float  # [m, rad]
    branch: Mapping[str, int]
    flipped: tuple[str, ...]
    beyond_limits: Mapping[str, ConstraintViolation]  # [rad, m]
    status: AssemblyStatus
    scene: Scene
    start: Array
    to_close: Mapping[str, ConstraintViolation]

    gap = renamed("violation")

    @property
    def closed(self) -> bool:
        """True if every gap is within tolerance (1e-10), but for what digits leave open."""
        return closed(self.to_close)

    @property
    def penetration(self) -> dict[str, ConstraintViolation]:
        """Contacts and stops of the scene that are passed at q, by name, and how far [m, rad]."""
        return penetration(self.scene, self.q)

    def error(self) -> NotAssembled | BranchChanged:
        """Return the error that `assemble` raises if the status is not CLOSED."""
        if self.status is AssemblyStatus.BRANCH_CHANGED:
            return BranchChanged(f"{', '.join(self.flipped)}: {self.status.value}", self)
        name, gap = largest_violation(self.to_close)
        text = f"{name} is open by {gap} after {self.iterations} iterations; "
        text += f"{beyond_text(self.beyond_limits)}; " if self.beyond_limits else ""
        text += self.status.value
        digits = digits_of(self.scene)
        return NotAssembled(f"{text}; {digits.note}" if digits else text, self)

    def __str__(self) -> str:
        lines = [str(self.status), f"{count_text(self.iterations, 'iteration')}, rank {self.rank}"]
        lines[1] += f", smallest singular value {self.smallest_singular_value:.3g}"
        lines += [f"{name:<28} open by {gap}" for name, gap in self.violation.items()]
        lines += [
            f"branch of {name}: {f'{side:+d}' if side else 'in a dead point'}"
            for name, side in self.branch.items()
        ]
        lines += [f"{name:<28} penetrates by {by}" for name, by in self.penetration.items()]
        lines += [beyond_text(self.beyond_limits)] if self.beyond_limits else []
        return "\n".join(lines)
