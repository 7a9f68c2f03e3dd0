"""Solvers that carry constraints in the inertias of articulated bodies: their parameters.

Their weight mu is measured on the scene (`condyn_pin.dynamics.lcaba_choice`).
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from condyn_pin._core.arguments import (
    ACCURACIES,
    ITERATIONS,
    WEIGHTS,
    Grid,
    check_accuracy,
    check_proximal,
    check_refinements,
)
from condyn_pin.dynamics.lcaba_choice import Choice, Start, best_choice
from condyn_pin.dynamics.solvers.base import BoundSolver, Solver

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace


@dataclass(frozen=True)
class ArticulatedSolver(Solver):
    """A solver on articulated bodies; each says in its own words what its parameters are."""

    takes_redundant: ClassVar[bool] = True
    takes_every_kind: ClassVar[bool] = False
    takes_world_first: ClassVar[bool] = False
    takes_open: ClassVar[bool] = False
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

    @abstractmethod
    def start(self, workspace: Workspace) -> BoundSolver:
        """Return this solver at work in `workspace`."""

    def started(self, workspace: Workspace, start: Start) -> BoundSolver:
        """Return what `start` makes of the choice for the scene, which is measured once."""
        nominal = workspace.scene.nominal
        if self.mu is not None:
            chosen = Choice(self.mu, self.max_iterations, self.refinements or 0)
        elif (found := nominal.measured.get(self)) is not None:
            chosen = Choice(*found)
        else:
            nominal.measured[self] = chosen = best_choice(self, workspace, start)
        bound, _ = start(chosen)
        return bound

    def wanted(self, workspace: Workspace) -> float:
        """Return the |J a + gamma - a_ref|_inf that ends the iterations [m/s^2]."""
        if self.absolute_accuracy is not None:
            return self.absolute_accuracy
        return workspace.scene.nominal.estimator.tolerated_constraint_error / 10
