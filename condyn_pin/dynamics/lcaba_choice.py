"""What a recursion on articulated bodies needs on a scene, measured against `Reference`.

The weight, the limit of sweeps, and corrections, if any.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.errors import NotAssembled

if TYPE_CHECKING:
    from condyn_pin.dynamics.articulated import ArticulatedSolver
    from condyn_pin.dynamics.nominal_states import NominalState
    from condyn_pin.dynamics.solvers.base import BoundSolver
    from condyn_pin.dynamics.workspace import Workspace

# What `mu` is chosen from, times the largest eigenvalue of G.
_WEIGHT_SHARES = (1e-2, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)

# Error of a at the states that are measured, relative: a wide margin for all others. One that is
# larger than the second has no margin: then answers are corrected.
_ACCURATE = tolerances.SOLVED / 1000
_UNSURE = tolerances.SOLVED / 10

# Error of forces that counts, relative, and what it is worth beside one of a. Below that a alone
# decides: forces follow the stop of the sweeps, and mu would be taken for the last of their digits.
_FORCES_COUNT = tolerances.FORCES / 30
_FORCES = tolerances.SOLVED / tolerances.FORCES

# Joints beyond which a machine is measured at the nominal states alone, and its answers are not
# corrected: both take minutes there, and as much memory again.
_LARGE = 100

# With a limit of sweeps below this, a rough answer is what was asked for.
_PATIENT = 20

# States drawn at random besides the nominal ones, which are as symmetric as postures are. Loops
# that hardly close are tried nearer to these, and then given up: fifty guesses took 8 s.
_DRAWN = 3
_SPREADS = (0.2, 0.02)  # [rad, m]
_TRIES = 2

# Limits of sweeps that are tried where answers are corrected: rounding keeps the residual above
# what it should come to.
_LIMITS = (10, 20, 40, 80)


class Choice(NamedTuple):
    """What a scene was measured to need, for a and for the forces."""

    mu: float
    limit: int
    refinements: int


class Measured(NamedTuple):
    """How a choice did: the best one is the least."""

    rank: int
    cost: float
    error: float
    choice: Choice


# From a choice to the method that it makes, and how many sweeps the last answer took.
Start = Callable[[Choice], "tuple[BoundSolver, Callable[[], int]]"]


def best_choice(solver: ArticulatedSolver, workspace: Workspace, start: Start) -> Choice:
    """Return the fastest weight that is accurate at the states that are measured.

    If none is, the one with the best product of error and sweeps. A weight that needs more
    than a quarter of the sweeps there is left out: it would not converge elsewhere. Where none
    is left that is sure, answers are corrected.
    """
    nominal, large = workspace.scene.nominal, workspace.model.nv > _LARGE
    states = nominal.states if large else (*nominal.states, *_drawn_states(workspace))

    def best(refinements: int, limit: int) -> Measured:
        weights = (share * nominal.delassus_norm for share in _WEIGHT_SHARES)
        choices = [Choice(mu, limit, refinements) for mu in weights]
        return min(_measured(solver, workspace, start, states, choice) for choice in choices)

    if solver.refinements is not None:
        return best(solver.refinements, solver.max_iterations).choice
    plain = best(0, solver.max_iterations)
    rough = solver.max_iterations < _PATIENT or solver.absolute_accuracy is not None
    if rough or large or (plain.rank < 2 and plain.error <= _UNSURE):
        return plain.choice
    found = plain
    for limit in _LIMITS:
        found = min((found, best(1, limit)), key=lambda one: one.error)
        if found.error <= _ACCURATE:
            break
    mu, limit, refinements = found.choice
    return Choice(mu, min(2 * limit, solver.max_iterations), refinements)


def _measured(
    solver: ArticulatedSolver,
    workspace: Workspace,
    start: Start,
    states: Sequence[NominalState],
    choice: Choice,
) -> Measured:
    """Return how a choice does at some states."""
    method, made = start(choice)
    worst, sweeps = 0.0, 0
    for s in states:
        error = _error(workspace, method, s)
        worst = max(worst, error if np.isfinite(error) else np.inf)
        sweeps = max(sweeps, made())
    if not choice.refinements and sweeps > max(1, solver.max_iterations // 4):
        return Measured(2, worst, worst, choice)
    if worst < _ACCURATE:
        return Measured(0, sweeps, worst, choice)
    return Measured(1, worst * sweeps, worst, choice)


@np.errstate(over="ignore", invalid="ignore")  # the error says it
def _error(workspace: Workspace, method: BoundSolver, s: NominalState) -> float:
    """Return that of a and of what forces do to the joints, each relative to what it may be.

    Where a carries next to nothing of it, rounding of 1/mu goes into lam alone. The right a and the
    lam of the answer leave a residual r, which is what J^T lam lacks.
    """
    of_a = float(np.abs(method.acceleration(s.q, s.v, s.tau) - s.a).max() / s.size)
    r, _ = workspace.equations.residuals(s.q, s.v, s.tau, s.a, method.lam())
    of_forces = float(np.abs(r).max() / s.torque) if s.torque else 0.0
    if of_forces <= _FORCES_COUNT:
        return of_a
    return float(np.maximum(of_a, _FORCES * of_forces))  # not a number if either is none


def _drawn_states(workspace: Workspace) -> Iterator[NominalState]:
    """Yield random states, moved as the nominal one is, and their a where `Reference` proves it.

    Where a state is nearly singular even that cannot: nothing can be measured by it.
    """
    from condyn_pin.dynamics.nominal_states import NominalState  # it imports a solver

    scene, rng = workspace.scene, np.random.default_rng(1)
    if not scene.nominal.closed:
        return
    exact, spreads = type(workspace)(scene, Reference()), list(_SPREADS)
    drawn = 0
    while spreads and drawn < _DRAWN:
        try:
            q, v = scene.sample(rng, spread=spreads[0], tries=_TRIES)
        except NotAssembled:
            del spreads[0]
            continue
        drawn += 1
        tau = exact.terms(q, v).M @ rng.normal(size=len(v))
        solution = exact.solve(q, v, tau, throw=False)
        if solution.status.ok:
            terms, gravity = exact.terms(q, v), scene.nominal.estimator.gravity
            yield NominalState.of(q, v, tau, solution.a, terms, gravity)
