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

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from enum import Enum
from math import nan

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise, rank_of
from condyn_pin.constraints.rows.bound import Terms
from condyn_pin.dynamics.solution import Status
from condyn_pin.dynamics.solvers.base import Singular, Solver
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import CondynError
from condyn_pin.lab.extremes.base import Case
from condyn_pin.study.measures.base import relative

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
