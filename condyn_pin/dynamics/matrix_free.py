"""Base of the solvers that apply their matrix by sweeps over the tree, and never form it."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arguments import (
    ACCURACIES,
    ITERATIONS,
    WEIGHTS,
    Grid,
    check_accuracy,
    check_damping,
    check_iterations,
)
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise
from condyn_pin._core.tolerances import RANK
from condyn_pin.dynamics.nominal import NominalAnalysis
from condyn_pin.dynamics.solvers.solver import BoundSolver, Solver
from condyn_pin.dynamics.workspace import Workspace


@dataclass(frozen=True)
class MatrixFreeSolver(Solver):
    """A solver by a Krylov method; each class documents its own parameters."""

    takes_redundant: ClassVar[bool] = True
    sweeps: ClassVar[tuple[Grid, ...]] = (
        {"mu": WEIGHTS},
        {"max_iterations": ITERATIONS},
        {"tolerance": ACCURACIES},
    )

    tolerance: float | None = None  # [m/s^2]
    max_iterations: int = 500
    mu: float = 0.0  # [1/kg]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.tolerance is not None:
            check_accuracy("tolerance", self.tolerance)
        check_iterations(self.max_iterations)
        check_damping(self.mu)

    @abstractmethod
    def start(self, workspace: Workspace) -> BoundSolver:
        """Return this solver bound to `workspace`."""

    def wanted(self, workspace: Workspace) -> float:
        """Return the |a_ref - gamma - J a - mu lam|_inf that ends the iterations [m/s^2]."""
        if self.tolerance is not None:
            return self.tolerance
        return workspace.scene.nominal.estimator.tolerated_constraint_error / 10


def inverse_delassus(nominal: NominalAnalysis) -> Array:
    """Return the inverse of G at the nominal state, a multiple of I on what is redundant there."""
    factors = factorise(nominal.terms.M, nominal.terms.J, RANK)
    U, S = factors.U, factors.S
    eigenvalues = np.full(U.shape[1], nominal.delassus_norm)
    eigenvalues[: factors.rank] = S[: factors.rank] ** 2
    return np.asarray((U / eigenvalues) @ U.T)
