"""Verdicts: what a method made of a hard question.

An answer is right if the error of a, relative to the larger of |a| and gravity, is within SOLVED:
that is what a status of ok promises. A residual is rounded to about eps |a|, and a direction
with the singular value sigma of J L^-T turns that into an error of eps / sigma. So where sigma is
below eps / SOLVED of the largest, 2e-8, no residual tells whether its row holds: the equations can
be read with it and without it, and either answer counts as right. It takes singular values at
every state to know of that; `Scene.rank` has them.

Where loops are open, rows that are redundant on closed ones are left out; `noisy_states` judges
that by the closed machine itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from decimal import Decimal, localcontext
from enum import Enum
from math import nan

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise, rank_of
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.rows.bound import Terms
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.solution import ContactStatus, solve_contact
from condyn_pin.contact.solvers.contact_solver import ContactSolver
from condyn_pin.dynamics.solution import Status
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.solvers.solver import Singular, Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import CondynError
from condyn_pin.simulation.integrators.explicit import SemiImplicitEuler
from condyn_pin.simulation.notices import solver_notices
from condyn_pin.simulation.run import simulate
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.study.measures.measure import relative
from lab.extremes.base import Case, Flight, Motion

# Shares of the largest singular value: below the first all is rounding, and below the last no
# residual in double precision tells whether a row holds.
_READINGS = (1e-14, tolerances.REFERENCE_RANK, float(np.finfo(float).eps) / tolerances.SOLVED)

_CORRECTIONS = 2

# Hot loops have Pinocchio's own rows where loops are open, whose a differs by this multiple of the
# gap or of J v, relative.
_PER_GAP = 100.0


class Verdict(Enum):
    """The verdict on the answer of a method to a case; the value describes it."""

    OK = "said ok, and is right to 1e-8"
    SAID_SO = "said that it is inaccurate, singular or not finite"
    REFUSED = "refused, with an error that names the reason"
    WRONG = "said ok, and is not right"
    CRASHED = "the interpreter died, or an error came out that is none of the library's"
    HUNG = "no answer in time"

    @property
    def defect(self) -> bool:
        """Whether it is a defect of the library."""
        return self in (Verdict.WRONG, Verdict.CRASHED, Verdict.HUNG)


@dataclass(frozen=True)
class Task:
    """One case: a family, its severity, a seed, and the robot that it is put on."""

    family: str
    severity: float
    seed: int = 0
    robot: str = ""


@dataclass(frozen=True)
class Outcome:
    """What one method made of one case."""

    task: Task
    method: str  # name of the solver
    verdict: Verdict
    error: float  # of a, relative; NaN where there is no answer, or nothing to hold it against
    said: str  # the status, or the error


def turned(kind: type[Solver], parameters: Mapping[str, float | int]) -> Solver:
    """Return a solver with those of the parameters that it has."""
    own = {field.name for field in fields(kind)}
    return replace(kind(), **{name: value for name, value in parameters.items() if name in own})


def judge(case: Case, solver: Solver, right: tuple[Array, ...]) -> tuple[Verdict, float, str]:
    """Return the verdict on a solver.

    Parameters
    ----------
    case : Case
    solver : Solver
    right : tuple of (nv,) array
        The answers that are right, as `right_answers` returns them [rad/s^2, m/s^2].

    Returns
    -------
    verdict : Verdict
    error : float
        Of a, relative.
    status : str

    Raises
    ------
    CondynError
        If the solver refuses the case.
    """
    workspace = Workspace(case.scene, solver, drift=case.drift)
    solution = workspace.solve(case.q, case.v, case.tau, throw=False)
    status = solution.status.name.lower()
    error = min((error_of(case, solution.a, a) for a in right), default=nan)
    if solution.status is not Status.OK:
        return Verdict.SAID_SO, error, status
    finite = np.isfinite(solution.a).all() and np.isfinite(solution.lam).all()
    if not (finite and error <= case.within):
        return Verdict.WRONG, error, status
    again = workspace.acceleration(case.q, case.v, case.tau)
    if not np.array_equal(again, solution.a):
        apart = error_of(case, again, solution.a)
        gap = max(solution.state_error)
        # hot loops have Pinocchio's rows for hinges and planar pins, which differ off the loops
        others = workspace.pinocchio_constraints.approximated and gap > tolerances.OPEN
        if not (others or apart <= case.within or apart <= _PER_GAP * gap):
            return Verdict.WRONG, apart, "another a on the second call"
    return Verdict.OK, error, status


def right_answers(case: Case) -> tuple[Array, ...]:
    """Return the exact accelerations, in closed form or by `Reference`.

    Parameters
    ----------
    case : Case

    Returns
    -------
    right : tuple of (nv,) array
        More than one where the rank is not clear; none where `Reference` refuses the case
        [rad/s^2, m/s^2].
    """
    found = list(case.right)
    if case.within > tolerances.SOLVED:
        return case.right
    try:
        workspace = Workspace(case.scene, Reference(), drift=case.drift)
        with np.errstate(all="ignore"):
            if workspace.equations.left_out_at(case.q) is not None:
                return *found, _consistent(workspace, case)
            terms = workspace.terms(case.q, case.v)
            S = factorise(terms.M, terms.J, tolerances.REFERENCE_RANK).S
            ranks = {rank_of(S, share): share for share in _READINGS}
            clearest = max(ranks, default=0)
            for rank, share in ranks.items():
                if not (case.right and rank == clearest):
                    found.append(_by_reference(workspace, case, terms, share))
    except (CondynError, Singular):
        return case.right
    return tuple(a for a in found if np.isfinite(a).all())


def _consistent(workspace: Workspace, case: Case) -> Array:
    """Return the a of `Reference` with the rows that are kept at the precision of the state."""
    equations = workspace.equations
    terms = equations.consistent_terms(case.q, case.v)
    return Reference().solve(terms, case.tau, equations.cancellation(case.q))[0]


def _by_reference(workspace: Workspace, case: Case, terms: Terms, share: float) -> Array:
    """Return the a of `Reference`, corrected by what Newton-Euler says that it leaves.

    M is rounded: where bodies are light beside others, an a that belongs to it is off by more than
    the residuals of the recursion are.
    """
    a, lam = Reference(rank_tolerance=share).solve(terms, case.tau)
    factors, better = factorise(terms.M, terms.J, share), a
    with np.errstate(all="ignore"):
        for _ in range(_CORRECTIONS):
            r, s = workspace.equations.residuals(case.q, case.v, case.tau, better, lam)
            if np.abs(s).max(initial=0.0) > 100 * tolerances.FINEST * np.abs(a).max(initial=0.0):
                return a  # rows contradict each other, and their large lam is rounded in r
            e, dlam = factors.solve(-r, -s)
            better, lam = better + e, lam + dlam
    return better if np.isfinite(better).all() else a


def error_of(case: Case, a: Array, right: Array) -> float:
    """Return the error of a, relative to the larger of |a|_inf and gravity.

    Lengths and angles are taken as numbers, in m and rad: in another unit of length a shift of a
    floating base weighs more or less beside the turn of a joint, and the larger of the two rules,
    as gravity does beside turns where machines are tiny or huge.
    """
    gravity = float(np.linalg.norm(case.scene.robot.model.gravity.linear))
    return relative(a, right, gravity)


# Verdicts on runs: whether gaps close as drift control says, and whether an end is reached.
#
# At rest, without weight and torques, nothing moves but the gaps, and semi-implicit Euler takes
# each of them by
#
#     u <- u - 2 alpha dt u - (beta dt)^2 c,    c <- c + u,    u = dt c'
#
# That is the truth. Where an eigenvalue of this map is beyond the unit circle, the right answer is
# a refusal.


# What a gap may be off, relative to the first: it is 1e-7 of a lever, whose turning is left out.
_FOLLOWED = 1e-4

# Contacts are anchored where they are at the start: what they are open by is rounding [m, rad].
_ROUNDED = 1e-9


def judge_run(case: Case, motion: Motion, solver: Solver) -> tuple[Verdict, float, str]:
    """Return the verdict on a solver in motion, the error of the gaps, and the status of the run.

    Raises
    ------
    CondynError
        If the run is refused.
    """
    run = simulate(
        case.scene, case.q, case.v, duration=motion.steps * motion.dt, dt=motion.dt,
        integrator=SemiImplicitEuler(), drift=case.drift, solver=solver,
        gravity=False, springs=False, damping=False,
    )  # fmt: skip
    status = run.run.status.name.lower()
    if not run.run.status.ok:
        return Verdict.SAID_SO, nan, status
    step = gap_map(case.drift or Baumgarte(0.0, 0.0), motion.dt)
    if np.abs(np.linalg.eigvals(step)).max() > 1.0:
        return Verdict.WRONG, nan, f"{status}, with gaps that grow"
    error = gap_error(run, step)
    if error <= _FOLLOWED:
        return Verdict.OK, error, status
    return (Verdict.SAID_SO if solver_notices(run) else Verdict.WRONG), error, status


def gap_map(drift: Baumgarte, dt: float) -> Array:
    """Return the map of (c, u)."""
    by_u, by_c = 1.0 - drift.Kd * dt, -drift.Kp * dt**2
    return np.array([[1.0 + by_c, by_u], [by_c, by_u]])


def gap_error(run: Trajectory, step: Array) -> float:
    """Return the largest difference of a gap from its map, relative to the first gap."""
    equations = Equations(run.scene.robot.model, run.scene.bounds)
    gaps = np.array([equations.violation(q) for q in run.q])
    state = np.array([gaps[0], np.zeros(equations.m)])
    worst = 0.0
    for gap in gaps:
        worst = max(worst, float(np.abs(gap - state[0]).max(initial=0.0)))
        state = step @ state
    return worst / max(float(np.abs(gaps[0]).max(initial=0.0)), _ROUNDED)


def judge_flight(case: Case, flight: Flight, solver: Solver) -> tuple[Verdict, float, str]:
    """Return the verdict on a solver in motion, what the run misses the end by, and its status.

    A run that breaks down has said so. A notice is not enough: energy that comes or goes is told of
    rough runs as of wrong ones.

    Raises
    ------
    CondynError
        If the run is refused.
    """
    run = simulate(
        case.scene, case.q, case.v, case.tau if flight.tau is None else flight.tau,
        duration=flight.duration, dt=flight.dt, integrator=flight.integrator, solver=solver,
    )  # fmt: skip
    status = run.run.status.name.lower()
    if not run.run.status.ok:
        return Verdict.SAID_SO, nan, status
    missed = pin.difference(case.scene.robot.model, flight.end, run.q[-1])
    error = float(np.abs(missed).max())
    return (Verdict.OK if error <= flight.within else Verdict.WRONG), error, status


# Verdicts on contact solvers: whether what is said to be ok is, in 50 digits.
#
# With S = mean diag G and s = |g|_inf, an answer is right if
#
#     |lam - P_K(lam - d / S)|_inf S / s <= 1e-8,    d = sigma + (0, 0, mu |sigma_t|)
#
# or, of a contact that sticks, |sigma|_inf / s <= 1e-8: where K contains its lam, this is asked in
# the place of the other if K contains lam - d / S as well, and else is enough. In both of them
# sigma = G lam + g (+ R lam) and P_K are formed anew, contact by contact, in decimal numbers.


_DIGITS = 50
_ZERO = Decimal(0)

# What rounding decides: the judge of the library has doubles.
_EDGE = 1 + 1e-3


def judge_contact(problem: ContactProblem, solver: ContactSolver) -> tuple[Verdict, float, str]:
    """Return the verdict on a contact solver.

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    solver : ContactSolver

    Returns
    -------
    verdict : Verdict
    error : float
        The natural residual of its answer, in 50 digits [1].
    status : str

    Raises
    ------
    CondynError
        If the solver refuses the problem.
    """
    solution = solve_contact(problem, solver, throw=False)
    status, error = solution.status.name.lower(), long_residual(problem, solution.lam)
    if solution.status is not ContactStatus.OK:
        return Verdict.SAID_SO, error, status
    if not error <= _EDGE * tolerances.CONTACT_SOLVED:
        return Verdict.WRONG, error, status
    again = solve_contact(problem, solver, throw=False)
    if not np.array_equal(again.lam, solution.lam):
        return Verdict.WRONG, error, "another lam on the second call"
    return Verdict.OK, error, status


def long_residual(problem: ContactProblem, lam: Array) -> float:
    """Return the natural residual of impulses (m,) in 50 digits; NaN if one is no number."""
    if not np.isfinite(lam).all():
        return nan
    with localcontext() as context:
        context.prec = _DIGITS
        stiff, speed = map(Decimal, problem.scale)
        x = [Decimal(each) for each in lam.tolist()]
        sigma = list(_velocities(problem, x))
        missed = (abs(each) for each in _missed(problem, x, sigma, stiff))
        return float(max(missed, default=_ZERO) * stiff / speed)


def _velocities(problem: ContactProblem, lam: Sequence[Decimal]) -> Iterator[Decimal]:
    """Yield the entries of sigma = G lam + g + R lam."""
    R = np.zeros(problem.rows) if problem.R is None else problem.R
    for i, (row, g, r) in enumerate(zip(problem.G.tolist(), problem.g.tolist(), R.tolist(),
                                        strict=True)):  # fmt: skip
        products = (Decimal(entry) * x for entry, x in zip(row, lam, strict=True) if entry and x)
        yield sum(products, Decimal(g) + Decimal(r) * lam[i])


def _missed(
    problem: ContactProblem, lam: Sequence[Decimal], sigma: Sequence[Decimal], stiff: Decimal
) -> Iterator[Decimal]:
    """Yield what each contact misses, with either sign."""
    moved = [x - s / stiff for x, s in zip(lam, sigma, strict=True)]
    row = 0
    for friction in problem.friction.tolist():
        mu, (t1, t2, n) = Decimal(friction), moved[row : row + 3]
        if problem.law == "ncp":
            n -= mu * _hypot(*sigma[row : row + 2]) / stiff
        of_cone = _missed_by_a_cone(lam[row : row + 3], (t1, t2, n), mu)
        if _in_cone(lam[row : row + 3], mu):
            stuck = max(map(abs, sigma[row : row + 3])) / stiff
            of_cone = stuck if _in_cone((t1, t2, n), mu) else min(of_cone, stuck)
        yield of_cone
        row += 3
    for _ in range(problem.half_lines):
        yield lam[row] - max(moved[row], _ZERO)
        row += 1
    for limit in map(Decimal, problem.limits.tolist()):
        yield lam[row] - min(max(moved[row], -limit), limit)
        row += 1


def _missed_by_a_cone(lam: Sequence[Decimal], moved: Sequence[Decimal], mu: Decimal) -> Decimal:
    """Return how far impulses are from the nearest point of the cone to others."""
    nearest = _on_cone(moved, mu)
    return max(abs(x - there) for x, there in zip(lam, nearest, strict=True))


def _in_cone(x: Sequence[Decimal], mu: Decimal) -> bool:
    """Return whether |x_t| <= mu x_n."""
    t1, t2, n = x
    return n >= 0 and _hypot(t1, t2) <= mu * n


def _on_cone(x: Sequence[Decimal], mu: Decimal) -> tuple[Decimal, ...]:
    """Return the point of |x_t| <= mu x_n that is nearest to x."""
    t1, t2, n = x
    slip = _hypot(t1, t2)
    if mu * slip <= -n:
        return _ZERO, _ZERO, _ZERO
    if slip <= mu * n:
        return t1, t2, n
    height = (n + mu * slip) / (1 + mu * mu)
    share = mu * height / slip
    return share * t1, share * t2, height


def _hypot(x: Decimal, y: Decimal) -> Decimal:
    return (x * x + y * y).sqrt()
