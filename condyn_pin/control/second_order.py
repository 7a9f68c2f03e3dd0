"""Second-order program of a control tick: its friction cones are round.

    min  1/2 x^T H x + g^T x    with    A x = b,    lower <= C x <= upper,    |f_t| <= mu f_n

where f_t and f_n of each contact are rows over x. With the direction n of f_t the cone touches the
plane n . f_t <= mu f_n, and there the program has the answer of a quadratic one, with that row and

    H + sum z (1 - n n^T) / |f_t|,    z >= 0 the multiplier of the row,

the curvature of the cone (sequential quadratic programming). From a start near enough each of them
squares the error, so that the answer is exact to rounding, and proved by the conditions of the
round cones themselves. The start is the last tick, or else Clarabel, an interior-point method for
cones; at the tip, where f_t has no direction, n is that of its multiplier.

References
----------
Goulart, Chen. Clarabel: An interior-point solver for conic programs with quadratic objectives.
arXiv:2405.12762, 2024.
Boggs, Tolle. Sequential quadratic programming. Acta Numerica 4, 1995.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import atan2, hypot, pi
from typing import Any, Final

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.contact.cones import RoundCone
from condyn_pin.control.cones import ContactCones
from condyn_pin.control.hierarchy import Costs, Level, weighted
from condyn_pin.control.qp.chain import ChainAnswer, SolverLadder
from condyn_pin.control.qp.qp_solver import (
    Constraints,
    PolishedAnswer,
    QPSolver,
    QuadraticProgram,
    package,
)

# Steps from the last tick, and from Clarabel's answer, which is right to seven digits.
_FROM_LAST: Final = 3
_FROM_CLARABEL: Final = 8

# What steps end at [m/s^2]: rounding.
_SETTLED: Final = 1e-12

# |f_t| over the mass of the robot below which a force has no direction of its own [m/s^2]: forces
# weigh 1e-5, and those that are zero are rounded to 1e-8.
_AT_TIP: Final = 1e-6

# Clarabel's own tolerances: steps do the digits.
_TOLERANCE: Final = 1e-9

_SIDES: Final = RoundCone(1.0).sides


@dataclass(frozen=True, eq=False)
class _Touching:
    """Answer and planes that touch the cones there: directions n of f_t, multipliers z of rows."""

    x: Array  # (n,)
    angles: Array  # (k,) of n, from x of each floor [rad]
    z: Array  # (k,)


class SecondOrder:
    """The program of one controller with round cones, and the memory of its last answer."""

    def __init__(self, qp: QPSolver, cones: ContactCones) -> None:
        self._ladder, self._rounds = SolverLadder(qp), cones.rounds
        self._names = len(cones.names)
        self._clarabel = package("clarabel")
        self._last: _Touching | None = None

    def solve(
        self, given: Constraints, levels: Sequence[Level], costs: Costs
    ) -> tuple[Array | None, list[ChainAnswer]]:
        """Return x, and its answer; the rows that contradict each other where there is none."""
        program = weighted(given, levels[0])
        path, steps = list[str](), 0
        if self._last is not None and len(self._last.x) == len(program.g):
            found = self._steps(program, self._last, costs, _FROM_LAST)
            path, steps = ["last cones", *found.path], found.iterations
            if found.solved:
                return self._counts(found, path, steps)
        start, count, feasible = self._start(program)
        path.append("clarabel")
        steps += count
        if feasible:
            found = self._steps(program, start, costs, _FROM_CLARABEL)
        else:  # what contradicts round cones contradicts pyramids within them
            found = self._ladder.solve(self._within(program), costs)
            if found.answer is not None:  # not of round cones
                found = replace(found, answer=found.answer._replace(residual=np.inf))
        return self._counts(found, [*path, *found.path], steps + found.iterations)

    def _counts(
        self, found: ChainAnswer, path: list[str], steps: int
    ) -> tuple[Array | None, list[ChainAnswer]]:
        if not found.solved:
            self._last = None
        told = replace(found, path=tuple(path), iterations=steps)
        return found.answer.x if found.answer is not None else None, [told]

    def _steps(
        self, program: QuadraticProgram, at: _Touching, costs: Costs, most: int
    ) -> ChainAnswer:
        """Return the answer that steps of sequential quadratic programming end at."""
        rows = self._rows(program)
        best: ChainAnswer | None = None
        for _ in range(most):
            curved = self._touched(self._curved(program, at), at)
            found = self._ladder.solve(curved, costs)
            if found.answer is None:
                return found
            at = self._from_answer(rows, found.answer, at)
            judged = self._judged(program, at, found.answer)
            found = replace(found, answer=judged)
            if best is None or judged.residual < best.answer.residual:  # type: ignore[union-attr]
                best, self._last = found, at
            if judged.residual <= _SETTLED:
                break
        assert best is not None
        return best

    def _rows(self, program: QuadraticProgram) -> list[tuple[slice, float, Array]]:
        """Rows of each cone in C, its friction, and f_x, f_y and mu f_n over x (3, n)."""
        first = len(program.C) - self._names
        found = []
        for block, mu in self._rounds:
            at = slice(first + block.start, first + block.stop)
            pulls, sides = program.C[at][0], program.C[at][1:]
            half, quarter = _SIDES // 2, _SIDES // 4
            f_x, f_y = (sides[0] - sides[half]) / 2, (sides[quarter] - sides[quarter + half]) / 2
            found.append((at, mu, np.array([f_x, f_y, -mu * pulls])))
        return found

    def _touched(self, program: QuadraticProgram, at: _Touching) -> QuadraticProgram:
        """Return the quadratic program with the planes in place of the cones."""
        C = program.C.copy()
        for (rows, _, three), angle in zip(self._rows(program), at.angles, strict=True):
            C[rows.start + 1 : rows.stop] = _sides(three, angle, three[2])
        return replace(program, C=C)

    def _curved(self, program: QuadraticProgram, at: _Touching) -> QuadraticProgram:
        """Return the program with the curvature of the cones about an answer."""
        H, g = program.H.copy(), program.g.copy()
        for (_, _, three), angle, z in zip(self._rows(program), at.angles, at.z, strict=True):
            across = np.array([-np.sin(angle), np.cos(angle)]) @ three[:2]
            size = float(np.hypot(*(three[:2] @ at.x)))
            if size > _AT_TIP and z > 0.0:
                bend = z / size * np.outer(across, across)
                H += bend
                g -= bend @ at.x
        return replace(program, H=H, g=g)

    def _within(self, program: QuadraticProgram) -> QuadraticProgram:
        """Return the program with pyramids within the cones."""
        C = program.C.copy()
        for rows, _, three in self._rows(program):
            C[rows.start + 1 : rows.stop] = _sides(three, 0.0, np.cos(pi / _SIDES) * three[2])
        return replace(program, C=C)

    def _from_answer(
        self, rows: list[tuple[slice, float, Array]], answer: PolishedAnswer, before: _Touching
    ) -> _Touching:
        """Return the planes that touch the cones at an answer."""
        angles, multipliers = before.angles.copy(), np.zeros(len(rows))
        for i, (at, _, three) in enumerate(rows):
            f_x, f_y = (three[:2] @ answer.x).tolist()
            sides = before.angles[i] + 2 * pi * np.arange(_SIDES) / _SIDES
            z = answer.z[at.start + 1 : at.stop]
            z_x, z_y = float(z @ np.cos(sides)), float(z @ np.sin(sides))  # of all sides together
            multipliers[i] = hypot(z_x, z_y)
            if hypot(f_x, f_y) > _AT_TIP:
                angles[i] = atan2(f_y, f_x)
            elif multipliers[i] > 0.0:
                angles[i] = atan2(z_y, z_x)
        return _Touching(answer.x, angles, multipliers)

    def _judged(
        self, program: QuadraticProgram, at: _Touching, answer: PolishedAnswer
    ) -> PolishedAnswer:
        """Return an answer with the residual of the round cones, each by the plane at its force."""
        touched, z = self._touched(program, at), answer.z.copy()
        for (rows, mu, _), multiplier in zip(self._rows(program), at.z, strict=True):
            # what the sides press together more than along n, they press along the normal
            z[rows.start] += mu * (z[rows.start + 1 : rows.stop].sum() - multiplier)
            z[rows.start + 1 : rows.stop] = 0.0
            z[rows.start + 1] = multiplier
        return answer._replace(z=z, residual=touched.kkt_residual(answer.x, answer.y, z))

    def _start(self, program: QuadraticProgram) -> tuple[_Touching, int, bool]:
        """Return the planes that Clarabel finds, its iterations, and False for a contradiction."""
        # imported here: scipy.sparse takes as long to import as Pinocchio
        from scipy.sparse import csc_matrix, triu

        clarabel, rows = self._clarabel, self._rows(program)
        linear = np.ones(len(program.C), dtype=bool)
        for at, _, _ in rows:
            linear[at.start + 1 : at.stop] = False
        above, below = (linear & np.isfinite(each) for each in (program.upper, program.lower))
        cones = [three[[2, 0, 1]] for _, _, three in rows]
        G = np.vstack((program.A, program.C[above], -program.C[below], *(-each for each in cones)))
        rest = np.zeros(3 * len(cones))
        h = np.concatenate((program.b, program.upper[above], -program.lower[below], rest))
        inequalities = int(above.sum() + below.sum())
        kinds: list[Any] = [clarabel.ZeroConeT(len(program.b))]
        kinds.append(clarabel.NonnegativeConeT(inequalities))
        kinds += [clarabel.SecondOrderConeT(3) for _ in cones]
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
        found = clarabel.DefaultSolver(
            csc_matrix(triu(csc_matrix(program.H))), program.g, csc_matrix(G), h, kinds, settings
        ).solve()
        feasible = "PrimalInfeasible" not in str(found.status)
        x, dual = np.array(found.x), np.array(found.z)[len(program.b) + inequalities :]
        angles, multipliers = np.zeros(len(rows)), np.zeros(len(rows))
        if feasible and np.isfinite(x).all() and np.isfinite(dual).all():
            for i, (_, _, three) in enumerate(rows):
                # where the cone is at its tip, or not felt, n is that of the multiplier, or any
                _, z_x, z_y = dual[3 * i : 3 * i + 3].tolist()
                f_x, f_y = (three[:2] @ x).tolist()
                multipliers[i] = hypot(z_x, z_y)
                is_free = hypot(f_x, f_y) > _AT_TIP
                angles[i] = atan2(f_y, f_x) if is_free else atan2(-z_y, -z_x)
        return _Touching(x, angles, multipliers), int(found.iterations), feasible


def _sides(three: Array, angle: float, most: Array) -> Array:
    """Rows (k, n) of a pyramid whose first side faces an angle: n . f_t - most <= 0."""
    turns = angle + 2 * pi * np.arange(_SIDES) / _SIDES
    return np.outer(np.cos(turns), three[0]) + np.outer(np.sin(turns), three[1]) - most
