"""LCABA: Pinocchio 4's loop-constrained articulated body algorithm, with its state cured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from condyn_pin._core import _pin
from condyn_pin._core.models import whole_data
from condyn_pin.dynamics.at_state import raw_constraints, without_gravity
from condyn_pin.dynamics.mu import WeightChoice
from condyn_pin.dynamics.recursion import ArticulatedSolver, CorrectedRecursion, LcabaRecursion
from condyn_pin.dynamics.solvers.solver import BoundSolver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import UnsupportedConstraint


@dataclass(frozen=True)
class LCABA(ArticulatedSolver):
    """Articulated-body recursion that carries the constraints up the tree.

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
        Corrections by recomputed residuals (`condyn_pin.dynamics.recursion`); each costs as much as
        the verification in `solve`, and another recursion. By default one where no mu is within a
        tenth of what ok promises at the states that are measured, as with light rods under a body
        on its feet: rounding of 1/mu in their inertia is more than that. None otherwise, nor with a
        mu of your own, nor where few sweeps or a rough accuracy are asked for.

    Notes
    -----
    Needs Pinocchio 4. The fastest for feet on the ground (`condyn bench`). Defects that are worked
    around: `lcaba` reads `data.oa` of the constrained joints before it writes it, so that every
    second call with 6 rows is wrong; it segfaults with the world first, or with an elimination
    order made for other constraints; it overwrites what `constraintDynamics` reads in the
    constraint datas, so that these must never be shared; its force is minus lam; and its rounding
    grows with the square of the distance to the world's origin, 6e-4 of a for Cassie at 1 km. So a
    robot that can move freely is taken there: placements in `Workspace.data` are those of a base at
    the origin.

    References
    ----------
    Sathya, Carpentier. Constrained articulated body dynamics algorithms. IEEE Transactions on
    Robotics, 2025.
    """

    title: ClassVar[str] = "LCABA"
    cost: ClassVar[str] = "O(n + m) for contacts with the world; loops add cross terms"
    use: ClassVar[str] = "the fastest for contacts with the world; needs Pinocchio 4"

    @classmethod
    def missing(cls) -> str:
        """Return a sentence if Pinocchio 4 is missing; empty otherwise."""
        return _pin.missing_lcaba()

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return `pin.lcaba`, its defects worked around, bound to the memory of `workspace`."""
        if workspace.drift:
            raise UnsupportedConstraint(
                "LCABA: Pinocchio's lcaba ignores drift control on constraints of 3 rows; "
                "use Proximal() with drift"
            )
        pinocchio_constraints = workspace.pinocchio_constraints.constraints
        models, datas = workspace.constraint_models, workspace.constraint_datas
        recursion = LcabaRecursion(
            workspace.model, workspace.data, pinocchio_constraints, models, datas
        )
        wanted = self.wanted(workspace)

        def start(chosen: WeightChoice) -> tuple[BoundSolver, Callable[[], int]]:
            settings = _pin.proximal_settings(wanted, 0.0, chosen.mu, chosen.limit)
            workspace.proximal_settings = settings
            bound = _method(workspace, recursion, settings, chosen.refinements)
            return bound, lambda: int(settings.iter)

        return self.started(workspace, start)


def _method(
    workspace: Workspace, recursion: LcabaRecursion, settings: Any, refinements: int
) -> BoundSolver:
    run = recursion.bind(settings)
    if not refinements:
        return BoundSolver(
            run, lambda: workspace.scene_forces(recursion.lam()), lambda: int(settings.iter)
        )
    model = without_gravity(workspace.model)
    constraints = workspace.pinocchio_constraints.constraints
    still = LcabaRecursion(
        model, whole_data(model), constraints, *raw_constraints(model, constraints, None)
    )
    corrected = CorrectedRecursion(
        workspace, (run, recursion.lam), (still.bind(settings), still.lam), refinements
    )
    return BoundSolver(
        corrected.acceleration, corrected.lam, lambda: refinements + int(settings.iter)
    )
