"""LCABA: Pinocchio 4's loop-constrained articulated body algorithm, with its state cured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from condyn_pin._core import _pin, tolerances
from condyn_pin._core.parameters import (
    ACCURACIES,
    ITERATIONS,
    WEIGHTS,
    Grid,
    check_accuracy,
    check_knobs,
    check_refinements,
)
from condyn_pin.dynamics.recursion import Corrected, Recursion
from condyn_pin.dynamics.solvers.base import BoundSolver, Solver
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.errors import NotAssembled, UnsupportedConstraint

if TYPE_CHECKING:
    from condyn_pin.dynamics.nominal import NominalAnalysis
    from condyn_pin.dynamics.nominal_states import NominalState
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

# States drawn at random besides the nominal ones, which are as symmetric as postures are.
_DRAWN = 3

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


@dataclass(frozen=True)
class LCABA(Solver):
    """Articulated body recursion with the constraints carried up the tree.

    The proximal iteration of `Proximal`, without forming G: the constraints enter the articulated
    inertias with weight 1/mu. Linear in the number of joints for constraints to the world.

    Parameters
    ----------
    mu : float, optional
        Proximal weight [1/kg]. Rounding of inertias scaled by 1/mu ends up in a, and a too small
        mu is silently wrong: on Cassie's closed loops 1e-8 is off by a per cent. J a stays at
        1e-13 all the while; only M a + h - tau - J^T lam shows it. The right value depends on the
        scene, so by default the first workspace of a scene measures seven of them against
        `Reference`, at the scene's nominal states and at three that are drawn at random, and takes
        the fastest that is accurate.
    max_iterations : int
        Upper limit on the sweeps over the tree; Talos on two feet takes 5, Cassie up to 40.
    absolute_accuracy : float, optional
        Iterate until |J a + gamma - a_ref|_inf is below this [m/s^2]. By default a tenth of what
        a status of ok allows on the scene: 1e-10 on Talos, 1e-11 on Cassie with her light rods.
    refinements : int, optional
        Corrections with residuals of our own (`condyn_pin.dynamics.recursion`), each for the price
        of a look as in `solve` and another recursion. By default one where no mu is within a tenth
        of what ok promises at the states that are measured, as with light rods under a body on its
        feet: rounding of 1/mu in their inertia is more than that. None anywhere else, with a mu of
        yours, or where few sweeps or a rough accuracy are asked for.

    Notes
    -----
    Needs Pinocchio 4. The fastest for feet on the ground (`condyn bench`). What is cured: `lcaba`
    reads `data.oa` of the constrained joints before it writes it, so that every second call with
    6 rows is wrong; it segfaults with the world first, or with an elimination order made for other
    constraints; it overwrites what `constraintDynamics` reads in the constraint datas, so that
    these must never be shared; its force is minus lam; and its rounding grows with the square of
    the distance to the world's origin, 6e-4 of a for Cassie at 1 km. So a robot that can move
    freely is taken there: placements in `Workspace.data` are those of a base at the origin.

    References
    ----------
    Sathya, Carpentier. Constrained articulated body dynamics algorithms. IEEE Transactions on
    Robotics, 2025.
    """

    title: ClassVar[str] = "LCABA"
    cost: ClassVar[str] = "O(n + m) for contacts with the world; loops add cross terms"
    use: ClassVar[str] = "the fastest for contacts with the world; needs Pinocchio 4"
    takes_redundant: ClassVar[bool] = True
    takes_every_kind: ClassVar[bool] = False
    takes_world_first: ClassVar[bool] = False
    sweeps: ClassVar[tuple[Grid, ...]] = (
        {"mu": WEIGHTS, "max_iterations": (1, 20)},
        {"max_iterations": ITERATIONS},
        {"absolute_accuracy": ACCURACIES},
    )

    mu: float | None = None  # [1/kg]
    max_iterations: int = 200
    absolute_accuracy: float | None = None  # [m/s^2]
    refinements: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_knobs(self.mu, self.max_iterations, smallest_mu=1e-300)
        if self.absolute_accuracy is not None:
            check_accuracy("absolute_accuracy", self.absolute_accuracy)
        if self.refinements is not None:
            check_refinements(self.refinements)

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the cured `pin.lcaba` bound to the memory of `workspace`."""
        if workspace.drift:
            raise UnsupportedConstraint(
                "LCABA: Pinocchio's lcaba ignores drift control on constraints of 3 rows; "
                "use Proximal() with drift"
            )
        pinocchio_constraints = workspace.pinocchio_constraints.constraints
        models, datas = workspace.constraint_models, workspace.constraint_datas
        recursion = Recursion(workspace.model, workspace.data, pinocchio_constraints, models, datas)
        nominal = workspace.scene.nominal
        if self.mu is not None:
            chosen = Choice(self.mu, self.max_iterations, self.refinements or 0)
        elif (found := nominal.measured.get(self)) is not None:
            chosen = Choice(*found)
        else:
            nominal.measured[self] = chosen = self._best(workspace, recursion)
        settings = workspace.proximal_settings = self._settings(nominal, chosen)
        return self._method(workspace, recursion, settings, chosen.refinements)

    def _method(
        self, workspace: Workspace, recursion: Recursion, settings: Any, refinements: int
    ) -> BoundSolver:
        if not refinements:
            run = recursion.bind(settings)
            return BoundSolver(
                run, lambda: workspace.scene_forces(recursion.lam()), lambda: int(settings.iter)
            )
        corrected = Corrected(workspace, recursion, settings, refinements)
        return BoundSolver(
            corrected.acceleration, corrected.lam, lambda: refinements + int(settings.iter)
        )

    def _settings(self, nominal: NominalAnalysis, chosen: Choice) -> Any:
        accuracy = self.absolute_accuracy
        if accuracy is None:
            accuracy = nominal.estimator.enough / 10
        return _pin.proximal_settings(accuracy, 0.0, chosen.mu, chosen.limit)

    def _best(self, workspace: Workspace, recursion: Recursion) -> Choice:
        """Return the fastest weight that is accurate at the states that are measured.

        If none is, the one with the best product of error and sweeps. A weight that needs more
        than a quarter of the sweeps there is left out: it would not converge elsewhere. Where none
        is left that is sure, answers are corrected.
        """
        nominal, large = workspace.scene.nominal, workspace.model.nv > _LARGE
        states = nominal.states if large else (*nominal.states, *_drawn_states(workspace))

        def best(refinements: int, limit: int) -> Measured:
            return min(
                self._measured(
                    workspace,
                    recursion,
                    states,
                    Choice(share * nominal.delassus_norm, limit, refinements),
                )
                for share in _WEIGHT_SHARES
            )

        if self.refinements is not None:
            return best(self.refinements, self.max_iterations).choice
        plain = best(0, self.max_iterations)
        rough = self.max_iterations < _PATIENT or self.absolute_accuracy is not None
        if rough or large or (plain.rank < 2 and plain.error <= _UNSURE):
            return plain.choice
        found = plain
        for limit in _LIMITS:
            found = min((found, best(1, limit)), key=lambda one: one.error)
            if found.error <= _ACCURATE:
                break
        mu, limit, refinements = found.choice
        return Choice(mu, min(2 * limit, self.max_iterations), refinements)

    def _measured(
        self,
        workspace: Workspace,
        recursion: Recursion,
        states: Sequence[NominalState],
        choice: Choice,
    ) -> Measured:
        """Return how a choice does at some states."""
        nominal = workspace.scene.nominal
        settings = self._settings(nominal, choice)
        method = self._method(workspace, recursion, settings, choice.refinements)
        worst, sweeps = 0.0, 0
        for s in states:
            error = _error(workspace, method, s)
            worst = max(worst, error if np.isfinite(error) else np.inf)
            sweeps = max(sweeps, int(settings.iter))
        if not choice.refinements and sweeps > max(1, self.max_iterations // 4):
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
    exact = type(workspace)(scene, Reference())
    for _ in range(_DRAWN):
        try:
            q, v = scene.sample(rng)
        except NotAssembled:
            return
        tau = exact.terms(q, v).M @ rng.normal(size=len(v))
        solution = exact.solve(q, v, tau, throw=False)
        if solution.status.ok:
            terms, gravity = exact.terms(q, v), scene.nominal.estimator.gravity
            yield NominalState.of(q, v, tau, solution.a, terms, gravity)
