"""LCABA: Pinocchio 4's loop-constrained articulated body algorithm, with its state cured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from condyn_pin._core import _pin
from condyn_pin._core.parameters import (
    ACCURACIES,
    ITERATIONS,
    WEIGHTS,
    Grid,
    check_accuracy,
    check_proximal,
    check_refinements,
)
from condyn_pin.dynamics.lcaba_choice import Choice, best_choice
from condyn_pin.dynamics.recursion import Corrected, Recursion
from condyn_pin.dynamics.solvers.base import BoundSolver, Solver
from condyn_pin.errors import UnsupportedConstraint

if TYPE_CHECKING:
    from condyn_pin.dynamics.nominal import NominalAnalysis
    from condyn_pin.dynamics.workspace import Workspace


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
        check_proximal(self.mu, self.max_iterations, smallest_mu=1e-300)
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

        def method(choice: Choice) -> tuple[BoundSolver, Any]:
            settings = self._settings(nominal, choice)
            return self._method(workspace, recursion, settings, choice.refinements), settings

        if self.mu is not None:
            chosen = Choice(self.mu, self.max_iterations, self.refinements or 0)
        elif (found := nominal.measured.get(self)) is not None:
            chosen = Choice(*found)
        else:
            nominal.measured[self] = chosen = best_choice(self, workspace, method)
        bound, workspace.proximal_settings = method(chosen)
        return bound

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
