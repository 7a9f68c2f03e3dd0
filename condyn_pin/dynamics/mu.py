"""The proximal weight mu, measured on the scene.

Weights: the proximal weight that suits a scene, and another at states where it does not do.

An eigenvalue sigma of G = J M^-1 J^T converges like mu / (sigma + mu). So mu has to be below the
smallest sigma that is more than rounding. But not far below: rows that depend on others have a
sigma of zero; where they contradict the others by c, as those of open loops do, lam grows along
them by c / mu an iteration, and rounding of G, eps |G| / mu, mixes it into the rest.

The smallest sigma is that of the nominal state, nearly always. It is another near singular
postures, and where loops are open by a gap: redundant rows come to life there, with a sigma of
about gap^2. What does not converge in a few iterations is at such a state; then the smallest sigma
is read off the factor that is there already, and mu is the largest that gains fifteen digits in
the iterations k that are left:

    (mu / (sigma + mu))^k = 1e-15.

G is that of the rows that Pinocchio has: two points in place of an edge or a hinge.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import frexp, inf, ldexp
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from condyn_pin._core import _pin, tolerances
from condyn_pin.dynamics.nominal import NominalAnalysis, NominalState
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.solvers.solver import BoundSolver
from condyn_pin.errors import NotAssembled

if TYPE_CHECKING:
    from condyn_pin.dynamics.recursion import ArticulatedSolver
    from condyn_pin.dynamics.workspace import Workspace


# Shares of the largest eigenvalue of G, and of the smallest nonzero one. The first of each are for
# redundant rows, the others for rows of which none depends on others, wherever the loops are. Rows
# that are zero but for rounding are of the first kind: lam grows along them as well. That kind has
# a least share of the largest, too. The others have none: a body of next to no mass makes the
# largest huge, and what the last step of lam leaves, mu / sigma of it, moves that body most.
_LARGEST, _SMALLEST, _LEAST = 1e-6, 1e-2, 1e-12
_LARGEST_FREE, _SMALLEST_FREE = 1e-12, 1e-5

# Iterations after which the default weight does not do: machines take up to six with it.
FEW = 6

# Iterations with the weight for a state, of those that are left: more would only take time. They
# stop at a smaller step than those of the default weight, since each gains less. Five are enough
# where corrections follow that G needs, eps |G| > SOLVED sigma: they leave a share mu / sigma of
# rounding. And where sigma is strong: lam of rows that contradict others by c ends at 5 c / mu, and
# eps |G| of that is the error of a, with mu = 0.001 sigma and sigma > 0.01 |G| below 1e-10 c.
_MORE, _FEWER, _STEP, _STRONG = 18, 5, 0.01, 0.01

# What those leave of an error: the last digits are not worth a smaller mu, which adds noise. And a
# multiple of eps |G|: rows that depend on others may have a sigma of as much below zero.
_LEFT, _NOISE = 1e-15, 4.0

_EPS = 2.0**-53

# The step of lam after which an iteration ends, as a share of the robot's weight. Along redundant
# rows rounding of G lam makes lam grow by a few eps |G| / mu of itself in every step, and |lam| is
# a few weights: a step that has to be less ends by chance, on one processor and not on another.
_USUAL, _FINEST = 1e-9, 1e-12
_USUAL_REDUNDANT = 32.0 * _EPS / _LARGEST


def default_mu(nominal: NominalAnalysis) -> float:
    """Return a proximal weight with which every part of lam converges in a few iterations."""
    largest, smallest = nominal.delassus_spectrum
    if nominal.independent and not nominal.rounded:
        return min(_LARGEST_FREE * largest, _SMALLEST_FREE * smallest)
    return max(min(_LARGEST * largest, _SMALLEST * smallest), _LEAST * largest)


def default_accuracy(nominal: NominalAnalysis, mu: float) -> float:
    """Return the step of lam after which an iteration may end [N]."""
    # 1e-9 of the robot's weight, or 4e-9 where rows are redundant. The next one is smaller by mu /
    # (sigma + mu), and moves a joint by up to max(w) sigma^1/2 of it, w the
    # `ErrorEstimator.weights`: where that is more than 1e-9 of gravity, as along points that hold
    # light bodies and weigh little in G, the step has to be less: unless rounding of J^T lam moves
    # that joint by more than this anyway.
    estimator, (_, smallest) = nominal.estimator, nominal.delassus_spectrum
    moved = estimator.largest_weight * smallest**0.5 * mu / (smallest + mu)
    enough = max(tolerances.SOLVED / 10.0, estimator.force_rounding) * (estimator.gravity or 1.0)
    free = nominal.independent and not nominal.rounded
    usual = (_USUAL if free else _USUAL_REDUNDANT) * nominal.weight
    return max(min(usual, enough / moved), _FINEST * nominal.weight) if moved > 0.0 else usual


class MuAtState:
    """The weight for a state at which an iteration has just not converged.

    With pivots on the diagonal, P^T G P = R^T R, the squares of the diagonal of R fall as the
    eigenvalues of G do, and the last is close to the smallest. LAPACK stops where what is left is
    rounding, m eps |G|. The last counts, however near to that: rows of loops that are open by 1e-4
    are as near, and below the widest gap between two pivots.

    `mu` [1/kg] and `accuracy` [N] are those of the iteration; `left` iterations may be made, and
    `corrected` says whether corrections follow that the scene needs.
    """

    def __init__(
        self, workspace: Workspace, mu: float, accuracy: float, left: int, corrected: bool
    ) -> None:
        # imported here: scipy.linalg takes as long to import as Pinocchio
        from scipy.linalg.lapack import dpstrf

        self._mu, self._accuracy = mu, _STEP * accuracy
        self._usual, self._few = _plan(min(left, _MORE)), _plan(_FEWER)
        self._cholesky, self._factorise = _pin.constraint_cholesky(workspace.data), dpstrf
        # a row that is rounding has sigma < m eps |G|: a force f along it moves a by w sigma^1/2 f,
        # and ten steps of lam are more than were made
        nominal, rows = (
            workspace.scene.nominal,
            sum(c.size for c in workspace.pinocchio_constraints.constraints),
        )
        largest, _ = nominal.delassus_spectrum
        rounding = _EPS * largest
        moved = nominal.estimator.largest_weight * (rows * rounding) ** 0.5
        self._harmless = (
            tolerances.SOLVED * nominal.estimator.gravity / (10.0 * moved) if rows else 0.0
        )
        self._damping, self._least = self._mu * np.eye(rows), _NOISE * rounding
        self._weak = rounding / tolerances.SOLVED if corrected else 0.0
        self._strong = _STRONG * largest

    @property
    def better(self) -> dict[str, float]:
        """Constants of `settings` for the compiled core, which decides likewise."""
        (usual, usual_share, _), (few, few_share, _) = self._usual, self._few
        return {
            "finer": self._accuracy, "usual": usual, "few": few, "usual_share": usual_share,
            "few_share": few_share, "weak": self._weak, "strong": self._strong,
            "least": self._least, "harmless": self._harmless,
        }  # fmt: skip

    def settings(self, step: float) -> Any:
        """Return settings for better than the last `step` [N]; None where only rounding is left."""
        G = self._cholesky.getInverseOperationalSpaceInertiaMatrix()
        G -= self._damping
        R, _, rank, _ = self._factorise(G)
        sigma = R.item(rank - 1, rank - 1) ** 2 if rank else 0.0
        if not 0.0 < sigma < inf:
            return None
        few = not self._weak <= sigma <= self._strong
        limit, share, made = self._few if few else self._usual
        # five bits of mu will do: there are few such numbers, and settings take long to make
        mantissa, power = frexp(max(share * sigma, self._least))
        mu = ldexp(int(32.0 * mantissa), power - 5)
        if self._mu <= mu and step < self._harmless:
            return None
        settings = made.get(mu)
        if settings is None:
            settings = made[mu] = _pin.proximal_settings(0.0, self._accuracy, mu, limit)
        return settings


def _plan(limit: int) -> tuple[int, float, dict[float, Any]]:
    """Return a number of iterations, the mu / sigma with which they leave `_LEFT`, and no settings.

    Settings are added where they are made, by their mu.
    """
    return limit, 1.0 / (_LEFT ** (-1.0 / limit) - 1.0), {}


# What a recursion on articulated bodies needs on a scene, measured against `Reference`.
#
# The weight, the limit of sweeps, and corrections, if any.


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


class WeightChoice(NamedTuple):
    """Weight, iteration limit and corrections that a scene was measured to need."""

    mu: float
    limit: int
    refinements: int


class WeightMeasurement(NamedTuple):
    """Measured rank, cost and error of a choice; the best one is the least."""

    rank: int
    cost: float
    error: float
    choice: WeightChoice


# From a choice to the method that it makes, and how many sweeps the last answer took.
MakeSolver = Callable[[WeightChoice], "tuple[BoundSolver, Callable[[], int]]"]


def best_choice(solver: ArticulatedSolver, workspace: Workspace, start: MakeSolver) -> WeightChoice:
    """Return the fastest weight that is accurate at the states that are measured."""
    # If none is, the one with the best product of error and sweeps. A weight that needs more than a
    # quarter of the sweeps there is left out: it would not converge elsewhere. Where none is left
    # that is sure, answers are corrected.
    nominal, large = workspace.scene.nominal, workspace.model.nv > _LARGE
    states = nominal.states if large else (*nominal.states, *_drawn_states(workspace))

    def best(refinements: int, limit: int) -> WeightMeasurement:
        weights = (share * nominal.delassus_norm for share in _WEIGHT_SHARES)
        choices = [WeightChoice(mu, limit, refinements) for mu in weights]
        return min(_measure_weight(solver, workspace, start, states, choice) for choice in choices)

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
    return WeightChoice(mu, min(2 * limit, solver.max_iterations), refinements)


def _measure_weight(
    solver: ArticulatedSolver,
    workspace: Workspace,
    start: MakeSolver,
    states: Sequence[NominalState],
    choice: WeightChoice,
) -> WeightMeasurement:
    """Return the measured rank, cost and error of a choice at some states."""
    method, made = start(choice)
    worst, sweeps = 0.0, 0
    for s in states:
        error = _error(workspace, method, s)
        worst = max(worst, error if np.isfinite(error) else np.inf)
        sweeps = max(sweeps, made())
    if not choice.refinements and sweeps > max(1, solver.max_iterations // 4):
        return WeightMeasurement(2, worst, worst, choice)
    if worst < _ACCURATE:
        return WeightMeasurement(0, sweeps, worst, choice)
    return WeightMeasurement(1, worst * sweeps, worst, choice)


@np.errstate(over="ignore", invalid="ignore")  # the error says it
def _error(workspace: Workspace, method: BoundSolver, s: NominalState) -> float:
    """Return the relative error of a, or of the joint torques of the forces where that is larger.

    Where a hardly depends on lam, rounding of order eps / mu shows in lam only. The right a and the
    lam of the answer leave a residual r, which is what J^T lam lacks.
    """
    of_a = float(np.abs(method.acceleration(s.q, s.v, s.tau) - s.a).max() / s.size)
    r, _ = workspace.equations.residuals(s.q, s.v, s.tau, s.a, method.lam())
    of_forces = float(np.abs(r).max() / s.torque) if s.torque else 0.0
    if of_forces <= _FORCES_COUNT:
        return of_a
    return float(np.maximum(of_a, _FORCES * of_forces))  # not a number if either is none


def _drawn_states(workspace: Workspace) -> Iterator[NominalState]:
    """Yield random states, moved as the nominal one is, and their a where `Reference` proves it."""
    # Where a state is nearly singular even that cannot: nothing can be measured by it.
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
