"""ConstrainedABA: articulated bodies that carry their contacts with the world, compiled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from condyn_pin._core import _pin
from condyn_pin._core.compiled import missing_constrained_aba
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.dynamics.at_state import without_gravity
from condyn_pin.dynamics.compiled import CompiledMethod
from condyn_pin.dynamics.mu import WeightChoice
from condyn_pin.dynamics.recursion import ArticulatedSolver, CorrectedRecursion
from condyn_pin.dynamics.solvers.solver import BoundSolver
from condyn_pin.dynamics.workspace import Workspace


@dataclass(frozen=True)
class ConstrainedABA(ArticulatedSolver):
    """Articulated-body recursion for bodies that are held to the world.

    A method of multipliers, in which a contact that lacks r = J a + gamma - a_ref is pushed back by
    r / mu, an inertia K K^T / mu at its body:

        (M + J^T J / mu) a = tau - h + J^T (lam - (gamma - a_ref) / mu),     lam <- lam - r / mu

    from lam = 0. Each sweep over the joints between the contacts and the world shrinks r by
    mu / (sigma + mu) for every nonzero eigenvalue sigma of G = J M^-1 J^T.

    Parameters
    ----------
    mu : float, optional
        Proximal weight [1/kg]. Rounding of inertias scaled by 1/mu ends up in a. By default
        measured on the scene, as that of `LCABA`: the fastest of seven that is accurate.
    max_iterations : int
        Upper limit on the sweeps over the tree; Talos on two feet takes up to 6.
    absolute_accuracy : float, optional
        Iterate until |J a + gamma - a_ref|_inf is below this [m/s^2]. By default a tenth of what
        a status of ok allows on the scene.
    refinements : int, optional
        Corrections by recomputed residuals (`condyn_pin.dynamics.recursion`); each costs as much as
        the verification in `solve`, and another recursion. By default one where no mu is within a
        tenth of what ok promises at the states that are measured.

    Notes
    -----
    Needs ``condyn_pin_native``, which compiles Pinocchio 3.9's passes over the joints, and runs
    beside any Pinocchio. Contacts with the world only: `LCABA` has loops. Defects of 3.9's own
    driver that are worked around: it takes the first residual from accelerations of the call
    before, and never recovers from one that was NaN; it weighs each contact once for every contact
    of the same body, so that the corners of a foot count four times; drift control reads placements
    that are not computed.

    References
    ----------
    Sathya, Carpentier. Constrained articulated body dynamics algorithms. IEEE Transactions on
    Robotics, 2025.
    """

    title: ClassVar[str] = "constrainedABA"
    cost: ClassVar[str] = "O(n + m)"
    use: ClassVar[str] = "contacts with the world on any Pinocchio; needs condyn_pin_native"
    takes_loops: ClassVar[bool] = False

    @classmethod
    def missing(cls) -> str:
        """Return a sentence if the compiled module is missing; empty otherwise."""
        return missing_constrained_aba()

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the compiled recursion with the constraints of `workspace`."""
        constraints = workspace.pinocchio_constraints.constraints
        wanted = self.wanted(workspace)

        def recursion(model: Any, drift: Baumgarte | None, chosen: WeightChoice) -> CompiledMethod:
            return CompiledMethod(
                "ConstrainedABA", model, constraints, drift,
                mu=chosen.mu, accuracy=wanted, limit=chosen.limit,
            )  # fmt: skip

        def start(chosen: WeightChoice) -> tuple[BoundSolver, Callable[[], int]]:
            workspace.proximal_settings = _pin.proximal_settings(
                wanted, 0.0, chosen.mu, chosen.limit
            )
            made = recursion(workspace.model, workspace.drift, chosen)
            if not chosen.refinements:
                bound = BoundSolver(
                    made.acceleration,
                    lambda: workspace.scene_forces(made.lam()),
                    lambda: made.iterations,
                )
                return bound, bound.iterations
            still = recursion(without_gravity(workspace.model), None, chosen)
            corrected = CorrectedRecursion(
                workspace,
                (made.acceleration, made.lam),
                (still.acceleration, still.lam),
                chosen.refinements,
            )
            bound = BoundSolver(
                corrected.acceleration,
                corrected.lam,
                lambda: chosen.refinements + made.iterations,
            )
            return bound, lambda: made.iterations

        return self.started(workspace, start)
