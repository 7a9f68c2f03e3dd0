"""Verdict: what became of the program of one control tick, as an answer with its proof.

The equations of motion and of the constraints are evaluated anew, by Newton-Euler and forward
kinematics: neither M, h, J nor the elimination has a part in that.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.terms import largest_torque
from condyn_pin.control.answer import Contradiction, ControlResiduals, ControlStatus, Give
from condyn_pin.control.levels import Level
from condyn_pin.control.program import Program
from condyn_pin.control.qp.chain import ChainAnswer
from condyn_pin.control.qp.quadratic_program import QuadraticProgram


class Verdict(NamedTuple):
    """The part of a `ControlAnswer` that a program decides."""

    tau: Array
    a: Array
    lam: Array
    rigid: Array
    errors: dict[str, Array]
    active: tuple[str, ...]
    infeasible: Contradiction | None
    residuals: ControlResiduals
    status: ControlStatus


def verdict(
    program: Program,
    asked: QuadraticProgram,
    levels: Sequence[Level],
    x: Array | None,
    answers: Sequence[ChainAnswer],
) -> Verdict:
    """Return what the unknowns x mean, and whether they are right; None where there are none."""
    if x is None:
        nothing, none = np.full(len(program.motion.v), np.nan), np.full(program.equations.m, np.nan)
        infeasible = _contradiction(program, asked, answers[-1])
        status = ControlStatus.INFEASIBLE if infeasible else ControlStatus.UNSOLVED
        unknown = ControlResiduals(np.inf, np.inf, np.inf)
        rigid = np.full(len(program.rigid), np.nan)
        return Verdict(nothing, nothing, none, rigid, {}, (), infeasible, unknown, status)
    a, tau, lam, rigid = program.recover(x)
    passive = program.passive + rigid @ program.rigid
    residuals, status = _proof(program, a, tau, passive, lam, answers)
    errors, active = program.errors(levels, x), _active(program, answers[-1])
    return Verdict(tau, a, lam, rigid, errors, active, None, residuals, status)


def _proof(
    program: Program,
    a: Array,
    tau: Array,
    passive: Array,
    lam: Array,
    answers: Sequence[ChainAnswer],
) -> tuple[ControlResiduals, ControlStatus]:
    """Return the residuals of an answer, and what they amount to."""
    motion, applied = program.motion, tau + passive
    _, largest = program.equations.errors(motion.q, motion.v, applied, a, lam)
    kkt = max(each.answer.residual if each.answer else np.inf for each in answers)
    residuals = ControlResiduals(kkt, largest[0], largest[4])
    size = max(largest[1], tolerances.GRAVITY)
    holds = (
        kkt <= tolerances.KKT
        and residuals.dynamics <= tolerances.SOLVED * largest_torque(motion.terms, applied, size)
        and residuals.constraints <= tolerances.SOLVED * size + program.unreached
    )
    return residuals, ControlStatus.OK if holds else ControlStatus.INACCURATE


def _active(program: Program, last: ChainAnswer) -> tuple[str, ...]:
    """Return the active inequalities by name, and the side of those that have two."""
    if last.answer is None:
        return ()
    rows = program.inequalities
    first_cone = len(rows) - len(program.cones.names)
    named = []
    for i in np.flatnonzero(last.answer.at_lower | last.answer.at_upper).tolist():
        side = " at upper" if last.answer.at_upper[i] else " at lower"
        named.append(rows[i].name + (side if i < first_cone else ""))
    return tuple(named)


def _contradiction(
    program: Program, asked: QuadraticProgram, answer: ChainAnswer
) -> Contradiction | None:
    """Return the rows that contradict each other, in their own units."""
    found = answer.elastic
    if found is None:
        return None
    rows = [*program.equation_rows(asked), *program.inequalities]
    if len(found.of_equations) < len(asked.b):  # of a level of a hierarchy: they are eliminated
        rows = program.inequalities
    given = np.concatenate((found.of_equations, found.of_inequalities))
    prices = np.concatenate((found.against_equations, found.against_inequalities))
    gives = tuple(
        Give(rows[i].name, float(given[i]) * rows[i].scale, rows[i].unit)
        for i in np.argsort(-given, kind="stable").tolist()
        if given[i] > tolerances.GIVES
    )
    giving = {each.row for each in gives}
    against = (
        row.name
        for row, price in zip(rows, prices, strict=True)
        if price > tolerances.GIVES and np.isfinite(row.cost) and row.name not in giving
    )
    return Contradiction(gives, tuple(dict.fromkeys(against)))
