"""SparseKKT: Pinocchio's sparse Cholesky factor of the whole matrix, used directly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core import _pin, tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import WEIGHTS, Grid, check_damping
from condyn_pin._core.arrays import Array, ignore_float_errors
from condyn_pin._core.linalg import whiten
from condyn_pin.dynamics.nominal import NominalAnalysis
from condyn_pin.dynamics.solvers.solver import BoundSolver, Singular, Solver, free_force
from condyn_pin.dynamics.workspace import Workspace


@dataclass(frozen=True)
class SparseKKT(Solver):
    """One solve with the factor U D U^T that the branches of the tree keep sparse.

    [ -mu I  J ] [ -lam ]   [ a_ref - gamma ]
    [  J^T   M ] [   a  ] = [    tau - h    ]

    Parameters
    ----------
    mu : float
        Damping [1/kg]. With 0 the answer is exact where the rows are independent, and `singular`
        where they are not. With mu > 0 it always exists, and a is off by about mu / sigma
        relative, sigma the smallest nonzero eigenvalue of J M^-1 J^T.

    Raises
    ------
    InvalidArgument
        If `mu` is negative or not finite.

    Notes
    -----
    Cost O(n d^2 + m d^2 + m^2 d), d the depth of the tree. `Proximal` repeats this solve until mu
    no longer counts, all of it in C++, and is faster for that; this one shows what the iteration
    buys. Defects that are worked around: Pinocchio 4 factorises another matrix unless each
    constraint's `calc` was called, and neither version reports a zero pivot. The first m entries of
    D are minus the part of each row of J M^-1 J^T that the rows after it do not span; where that is
    rounding beside the row, it is redundant.

    SciPy's sparse LU is left out: on Talos's matrix, a third of it filled, it takes four times as
    long as LAPACK's dense factorisation, and eight times with the conversion.

    References
    ----------
    Carpentier, Budhiraja, Mansard. Proximal and sparse resolution of constrained dynamic
    equations. Robotics: Science and Systems, 2021.
    """

    title: ClassVar[str] = "Sparse KKT"
    cost: ClassVar[str] = "O(n d^2 + m d^2 + m^2 d), d the depth of the tree"
    use: ClassVar[str] = "to compare with; independent rows of points and welds"
    takes_redundant: ClassVar[bool] = False
    takes_every_kind: ClassVar[bool] = False
    takes_approximated: ClassVar[bool] = False
    takes_open: ClassVar[bool] = False
    sweeps: ClassVar[tuple[Grid, ...]] = ({"mu": WEIGHTS},)

    mu: float = 0.0  # [1/kg]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_damping(self.mu)

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the factorisation bound to the memory of `workspace`."""
        model, data = workspace.model, workspace.data
        models, datas = workspace.constraint_models, workspace.constraint_datas
        m, mu = workspace.scene.rows, self.mu
        of_pinocchio, scene_forces = workspace.pinocchio_velocity, workspace.scene_forces
        # pivots of what is left of a row are squares of those of J L^-T
        own = _delassus_diagonal(workspace.scene.nominal, of_pinocchio)
        limits = np.full(m, -mu / 2) if mu else -(tolerances.RANK**2) * own
        answer = np.zeros(m + model.nv)

        @ignore_float_errors  # the status says it
        def acceleration(q: Array, v: Array, tau: Array) -> Array:
            factor = _pin.factorise_constraints(model, data, models, datas, q, mu)
            if not (factor.D[:m] < limits).all():
                raise Singular
            forces = free_force(tau, pin.nonLinearEffects(model, data, q, v))
            target = of_pinocchio(workspace.equations.target(q, v))
            answer[:] = factor.solve(np.concatenate([target, forces]))
            return answer[m:].copy()

        return BoundSolver(acceleration, lambda: scene_forces(-answer[:m]), lambda: 1)


def _delassus_diagonal(nominal: NominalAnalysis, of_pinocchio: Callable[[Array], Array]) -> Array:
    """Return the diagonal of J M^-1 J^T of Pinocchio's rows at the nominal state [1/kg]."""
    whitened = whiten(nominal.terms.M, of_pinocchio(nominal.terms.J))
    return np.zeros(0) if whitened is None else np.array(whitened[2].diagonal())
