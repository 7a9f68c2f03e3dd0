"""ControlAnswer: what a controller wants of the motors, with its proof."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import count_text
from condyn_pin._core.arrays import Array, Indices, in_column
from condyn_pin._core.show import Outcome
from condyn_pin.constraints.rows.bound import Terms, largest_torque
from condyn_pin.contact.cones import Cones, Margin, margins
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.program import Program
from condyn_pin.control.qp.chain import ChainAnswer
from condyn_pin.control.qp.qp_solver import Constraints, Flags, peak
from condyn_pin.control.support import edge_notices
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import ConstraintForce, Sites

_AGAINST = 6  # rows that a text lists


class ControlStatus(Outcome):
    """Outcome of a control tick; the value is advice."""

    OK = "the program is solved, and the equations of motion hold"
    INACCURATE = (
        "what was found does not satisfy the program or the equations of motion well enough: look "
        "at the residuals; weights many decades apart and states off the loops do that"
    )
    INFEASIBLE = (
        "rows contradict each other, which an elastic program confirms: `infeasible` names those "
        "that have to be relaxed, by how much at least, and what they conflict with"
    )
    UNSOLVED = (
        "the rows do not contradict each other, and no solver found the answer: another qp, or "
        "weights that are fewer decades apart, would do"
    )
    OUT_OF_BUDGET = (
        "the budget of the solvers of quadratic programs ended before one of them found the "
        "answer: raise it, DAQP(budget=1000), or take weights that are fewer decades apart"
    )


class ControlResiduals(NamedTuple):
    """Residuals of the conditions that an answer has to satisfy.

    Attributes
    ----------
    kkt : float
        Of the program: equations, inequalities, signs and gradient [m/s^2]; the largest of all
        levels of a hierarchy.
    dynamics : float
        max abs(M a + h - tau - passive - J^T lam), by Newton-Euler [N, N m].
    constraints : float
        max abs(J a + gamma - a_ref), by forward kinematics [m/s^2, rad/s^2]. Redundant rows, such
        as those of two points of a foot, leave something where the foot moves.
    """

    kkt: float  # [m/s^2]
    dynamics: float  # [N, N m]
    constraints: float  # [m/s^2, rad/s^2]


class Relaxation(NamedTuple):
    """Least relaxation of a row.

    Attributes
    ----------
    row : str
    amount : float
        In its own unit [m/s^2, rad/s^2, N m, N].
    unit : str
    """

    row: str
    amount: float  # [m/s^2, rad/s^2, N m, N]
    unit: str


class Contradiction(NamedTuple):
    """Rows of a program that contradict each other.

    Attributes
    ----------
    gives : tuple of Relaxation
        What would make the program feasible, the most first: wishes (tasks of infinite weight) give
        before limits of joints, these before those of motors, and cones last.
    against : tuple of str
        The rows that stand against them, the one with the highest price first.
    """

    gives: tuple[Relaxation, ...]
    against: tuple[str, ...]

    def __str__(self) -> str:
        lines = [f"{each.row} gives {each.amount:.6g} {each.unit}" for each in self.gives]
        lines += [f"against {row}" for row in self.against[:_AGAINST]]
        more = len(self.against) - _AGAINST
        return "\n".join([*lines, f"and against {more} more"] if more > 0 else lines)


@dataclass(frozen=True, eq=False, repr=False)
class ControlAnswer:
    """Torques, accelerations and contact forces of one control tick.

    M a + h = B u + passive + rigid + J^T lam,    J a + gamma = a_ref

    Where the status is INFEASIBLE or UNSOLVED all numbers are NaN.

    Attributes
    ----------
    u : (k,) array
        Torques of the motors [N m, N]. Of all that do the same, those whose torques at the joints,
        `Actuation.gears` times u, have the least sum of squares.
    tau : (nv,) array
        Joint torques that the motors give, B u [N m, N].
    a : (nv,) array
        Accelerations that follow [rad/s^2, m/s^2].
    lam : (m,) array
        Constraint forces, all rows, in the axes of each constraint [N, N m].
    rigid : (r,) array
        Torques, beside `passive`, that keep the joints treated as rigid from accelerating: zero
        where springs are in equilibrium [N m, N].
    errors : dict of str to (r,) array
        J a + drift - a_wanted of each task by name, in the units of its rows.
    active : tuple of str
        The inequalities that hold with equality, by name, and on which side.
    infeasible : Contradiction or None
        Which rows have to give, and how much at least.
    residuals : ControlResiduals
        Of the program and of the equations of motion, recomputed.
    status : ControlStatus
    path : tuple of str
        What found the answer: "last active set", or the solvers that were tried, in order; or
        "compiled core".
    iterations : int
        Of the solvers, or changes of the active set in the core; 0 where the last active set was
        right.
    solve_time : float
        Of the program, without its assembly and without the proof [s].
    actuation : Actuation
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name.
    scene : Scene
    q, v : (nq,), (nv,) array
        Configuration, and velocity [rad/s, m/s], without the oscillation of joints treated as
        rigid; a free-flyer's in its body frame, linear first.
    t : float
        Of the tick [s].
    of_tick : tuple of str
        Notices of the program, a sentence each: contacts that cannot be kept, joints that are
        beyond their limits or cannot be stopped before them.
    """

    u: Array
    tau: Array
    a: Array
    lam: Array
    rigid: Array
    errors: dict[str, Array]
    active: tuple[str, ...]
    infeasible: Contradiction | None
    residuals: ControlResiduals
    status: ControlStatus
    path: tuple[str, ...]
    iterations: int
    solve_time: float  # [s]
    actuation: Actuation
    cones: Cones
    scene: Scene
    q: Array
    t: float  # [s]
    v: Array
    of_tick: tuple[str, ...] = ()

    @cached_property
    def notices(self) -> tuple[str, ...]:
        """Sentences on what deserves attention; they change no status.

        Those of the tick, forces on the edge of their cones, and centres of pressure (ZMP) or mass
        on the edge of the support, computed on first use.
        """
        return self.of_tick + edge_notices(self.scene, self.q, self.lam, self.active)

    @property
    def torques(self) -> dict[str, float]:
        """The torques of the motors by name [N m, N]."""
        return dict(zip(self.actuation.motors, self.u.tolist(), strict=True))

    @cached_property
    def forces(self) -> dict[str, ConstraintForce]:
        """The constraint forces by name, as those of a `Solution`."""
        return Sites(self.scene, self.q).forces(self.lam)

    @cached_property
    def margins(self) -> dict[str, Margin]:
        """Margin of each contact to its cone; empty where none has one."""
        pressing = any(contact.presses for contact in self.scene.constraints)
        return margins(self, self.cones) if pressing and self.cones else {}

    def __repr__(self) -> str:
        return (
            f"ControlAnswer({self.scene.robot.name}: {self.status.name}, "
            f"{count_text(len(self.active), 'active row')}, kkt {self.residuals.kkt:.1e}, "
            f"by {', '.join(each.partition('(')[0] for each in self.path)})"
        )

    def __str__(self) -> str:
        lines = [repr(self)]
        if self.infeasible:
            lines.append(str(self.infeasible))
        else:
            lines += [f"{name:<28} {text} N m" for name, text in in_column(self.torques)]
            lines += [f"at its bound: {row}" for row in self.active]
        lines += [f"note: {notice}" for notice in self.notices]
        return "\n".join(lines)


# Verdict: what became of the program of one control tick, as an answer with its proof.
#
# The equations of motion and of the constraints are evaluated anew, by Newton-Euler and forward
# kinematics: neither M, h, J nor the elimination has a part in that.


class Verdict(NamedTuple):
    """The part of a `ControlAnswer` that a program decides."""

    u: Array
    tau: Array
    a: Array
    lam: Array
    rigid: Array
    errors: dict[str, Array]
    active: tuple[str, ...]
    infeasible: Contradiction | None
    residuals: ControlResiduals
    status: ControlStatus
    of_tick: tuple[str, ...]


def verdict(
    program: Program, given: Constraints, x: Array | None, answers: Sequence[ChainAnswer]
) -> Verdict:
    """Return the motion, torques and forces of unknowns x, verified; NaN where x is None."""
    errors, infeasible = dict[str, Array](), None
    active = notices = tuple[str, ...]()
    if x is None:
        n, m = len(program.motion.v), program.equations.m
        sizes = (n, len(program.actuation.gears), n, m, len(program.rigid))
        a, u, tau, lam, rigid = (np.full(size, np.nan) for size in sizes)
        infeasible = _contradiction(program, given, answers[-1])
        status = ControlStatus.INFEASIBLE if infeasible else ControlStatus.UNSOLVED
        if answers[-1].stopped:
            status = ControlStatus.OUT_OF_BUDGET
        residuals = ControlResiduals(np.inf, np.inf, np.inf)
    else:
        a, u, tau, lam, rigid = program.recover(x)
        passive = program.passive + rigid @ program.rigid if len(rigid) else program.passive
        residuals, status = _proof(program, a, tau, passive, lam, answers)
        errors, last = program.errors(x), answers[-1].answer
        active = active_rows(program, last.active, last.at_upper) if last else ()
        notices = program.unviable()
        size = max(peak(a), tolerances.GRAVITY)
        if program.left_out or residuals.constraints > tolerances.SOLVED * size:
            notices += program.unkept(program.motion.q, program.motion.v, a, lam, size)
    return Verdict(u, tau, a, lam, rigid, errors, active, infeasible, residuals, status, notices)


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
    """True if the torques left over are rounding of those in the equations of motion."""
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
        Relaxation(rows[i].name, float(gives_by[i]) * rows[i].scale, rows[i].unit)
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
