"""PV: the Popov-Vereshchagin recursion for contacts with the world, compiled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from condyn_pin._core import _pin
from condyn_pin._core.arguments import (
    ACCURACIES,
    ITERATIONS,
    WEIGHTS,
    Grid,
    check_accuracy,
    check_proximal,
)
from condyn_pin._core.compiled import missing_constrained_aba
from condyn_pin.dynamics.compiled import CompiledMethod
from condyn_pin.dynamics.mu import default_accuracy, default_mu
from condyn_pin.dynamics.solvers.solver import BoundSolver, Solver
from condyn_pin.dynamics.workspace import Workspace


@dataclass(frozen=True)
class PV(Solver):
    """Popov-Vereshchagin recursion: articulated bodies carry the rows of contacts to the root.

    What arrives there is G = J M^-1 J^T and c = J a_free + gamma - a_ref. The proximal iteration
    of `Proximal` finds the forces,

        lam_(k+1) = (G + mu 1)^-1 (mu lam_k - c),     lam_0 = 0,

    and one more sweep, back to the leaves, the accelerations.

    Parameters
    ----------
    mu : float, optional
        Proximal weight [1/kg]; 0 is a plain solve, `singular` where rows are redundant. By default
        what `Proximal` takes on the scene.
    max_iterations : int
        Upper limit of iterations with (m, m) matrices; the recursion is made once.
    absolute_accuracy : float, optional
        Iterate until |lam_(k+1) - lam_k|_inf is below this [N]. By default what `Proximal` takes.

    Raises
    ------
    InvalidArgument
        If `mu` or an accuracy is negative or not finite, or `max_iterations` is not positive.

    Notes
    -----
    Needs ``condyn_pin_native``, which compiles Pinocchio 3.9's passes over the joints, and runs
    beside any Pinocchio. Contacts with the world only: `LCABA` has loops. Defects of 3.9's own
    driver that are worked around: it does not notice that a factorisation failed, and drift control
    reads placements and velocities that are not computed.

    References
    ----------
    Popov, Vereshchagin, Zenkevich. Manipulation robots: dynamics and algorithms. Nauka, 1978.
    Sathya, Carpentier. Constrained articulated body dynamics algorithms. IEEE Transactions on
    Robotics, 2025.
    """

    title: ClassVar[str] = "PV"
    cost: ClassVar[str] = "O(n d_m + m^3), d_m the rows that a joint carries"
    use: ClassVar[str] = "contacts with the world, to rounding; needs condyn_pin_native"
    takes_redundant: ClassVar[bool] = True
    takes_every_kind: ClassVar[bool] = False
    takes_world_first: ClassVar[bool] = False
    takes_open: ClassVar[bool] = False
    takes_loops: ClassVar[bool] = False
    sweeps: ClassVar[tuple[Grid, ...]] = (
        {"mu": WEIGHTS, "max_iterations": (1, 20)},
        {"max_iterations": ITERATIONS},
        {"absolute_accuracy": ACCURACIES},
    )

    mu: float | None = None  # [1/kg]
    max_iterations: int = 20
    absolute_accuracy: float | None = None  # [N]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_proximal(self.mu, self.max_iterations, smallest_mu=0.0)
        if self.absolute_accuracy is not None:
            check_accuracy("absolute_accuracy", self.absolute_accuracy)

    @classmethod
    def missing(cls) -> str:
        """Return a sentence if the compiled module is missing; empty otherwise."""
        return missing_constrained_aba()

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the compiled recursion with the constraints of `workspace`."""
        nominal = workspace.scene.nominal
        mu = default_mu(nominal) if self.mu is None else self.mu
        accuracy = self.absolute_accuracy
        if accuracy is None:
            accuracy = default_accuracy(nominal, mu)
        workspace.proximal_settings = _pin.proximal_settings(accuracy, 0.0, mu, self.max_iterations)
        made = CompiledMethod(
            "PV",
            workspace.model,
            workspace.pinocchio_constraints.constraints,
            workspace.drift,
            mu=mu,
            accuracy=accuracy,
            limit=self.max_iterations,
        )
        return BoundSolver(
            made.acceleration, lambda: workspace.scene_forces(made.lam()), lambda: made.iterations
        )
