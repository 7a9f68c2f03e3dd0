"""Verdict: what became of the program of one control tick, as an answer with its proof.

The equations of motion and of the constraints are evaluated anew, by Newton-Euler and forward
kinematics: neither M, h, J nor the elimination has a part in that.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices
from condyn_pin.constraints.rows.bound import Terms, largest_torque
from condyn_pin.control.answer import Contradiction, ControlResiduals, ControlStatus, Give
from condyn_pin.control.program import Program
from condyn_pin.control.qp.chain import ChainAnswer
from condyn_pin.control.qp.polish import Flags
from condyn_pin.control.qp.quadratic_program import Constraints, peak


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
    notices: tuple[str, ...] = ()


def verdict(
    program: Program,
    given: Constraints,
    x: Array | None,
    answers: Sequence[ChainAnswer],
) -> Verdict:
    """Return what the unknowns x mean, and whether they are right; None where there are none."""
    if x is None:
        nothing, none = np.full(len(program.motion.v), np.nan), np.full(program.equations.m, np.nan)
        infeasible = _contradiction(program, given, answers[-1])
        status = ControlStatus.INFEASIBLE if infeasible else ControlStatus.UNSOLVED
        if answers[-1].stopped:
            status = ControlStatus.OUT_OF_BUDGET
        unknown = ControlResiduals(np.inf, np.inf, np.inf)
        rigid = np.full(len(program.rigid), np.nan)
        return Verdict(nothing, nothing, none, rigid, {}, (), infeasible, unknown, status)
    a, tau, lam, rigid = program.recover(x)
    passive = program.passive + rigid @ program.rigid if len(rigid) else program.passive
    residuals, status = _proof(program, a, tau, passive, lam, answers)
    errors, last = program.errors(x), answers[-1].answer
    active = active_rows(program, last.active, last.at_upper) if last else ()
    notices = program.unviable()
    size = max(peak(a), tolerances.GRAVITY)
    if program.left_out or residuals.constraints > tolerances.SOLVED * size:
        notices += program.unkept(program.motion.q, program.motion.v, a, lam, size)
    return Verdict(tau, a, lam, rigid, errors, active, None, residuals, status, notices)


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
    if program.left_out:
        held = program.cones.held
        _, s = program.equations.residuals(motion.q, motion.v, applied, a, lam)
        s[held] = program.left_out.kept(s[held])
        largest[4] = float(np.abs(s).max(initial=0.0))
    kkt = max([each.answer.residual if each.answer else np.inf for each in answers])
    residuals = ControlResiduals(kkt, largest[0], largest[4])
    size = max(largest[1], tolerances.GRAVITY)
    holds = (
        kkt <= tolerances.KKT
        and _is_rounding(residuals.dynamics, motion.terms, applied, size)
        and residuals.constraints <= tolerances.SOLVED * size + program.unreached
    )
    return residuals, ControlStatus.OK if holds else ControlStatus.INACCURATE


def _is_rounding(dynamics: float, terms: Terms, tau: Array, size: float) -> bool:
    """Return whether torques that are left over are rounding of those that there are."""
    # |h| is one of them, and mostly large enough: the sums over M take longer
    return dynamics <= tolerances.SOLVED * peak(terms.h) or (
        dynamics <= tolerances.SOLVED * largest_torque(terms, tau, size)
    )


def active_rows(program: Program, active: Indices, at_upper: Flags) -> tuple[str, ...]:
    """Return the active inequalities by name, and the side of those that have two."""
    rows = program.inequalities
    first_cone = len(rows) - len(program.cones.names)
    named = []
    for i in active.tolist():
        side = " at upper" if at_upper[i] else " at lower"
        named.append(rows[i].name + (side if i < first_cone else ""))
    return tuple(named)


def _contradiction(
    program: Program, given: Constraints, answer: ChainAnswer
) -> Contradiction | None:
    """Return the rows that contradict each other, in their own units."""
    found = answer.elastic
    if found is None:
        return None
    rows = [*program.equation_rows(given), *program.inequalities]
    if len(found.of_equations) < len(given.b):  # of a level of a hierarchy: they are eliminated
        rows = program.inequalities
    gives_by = np.concatenate((found.of_equations, found.of_inequalities))
    prices = np.concatenate((found.against_equations, found.against_inequalities))
    gives = tuple(
        Give(rows[i].name, float(gives_by[i]) * rows[i].scale, rows[i].unit)
        for i in np.argsort(-gives_by, kind="stable").tolist()
        if gives_by[i] > tolerances.GIVES
    )
    giving = {each.row for each in gives}
    against = (
        rows[i].name
        for i in np.argsort(-prices, kind="stable").tolist()
        if prices[i] > tolerances.GIVES and np.isfinite(rows[i].cost) and rows[i].name not in giving
    )
    return Contradiction(gives, tuple(dict.fromkeys(against)))
