"""BatchSolution, BatchDerivatives: answers at many states, each with its proof and status."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import renamed
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.jacobian import Jacobian
from condyn_pin._core.rows import Batch, BatchResult, Some
from condyn_pin._core.show import require_pandas
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics.derivatives.differences import BLOCKS
from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives
from condyn_pin.dynamics.residuals import Residuals
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import (
    Question,
    Solution,
    Status,
    forces_in_axes,
    solution_columns,
)

# A status as a number is its place here.
STATUSES: Final = tuple(Status)


@dataclass(frozen=True, eq=False, repr=False)
class BatchSolution(BatchResult[Solution]):
    """Accelerations and constraint forces at N states, with the errors of each recomputed.

    M a + h = tau + J^T lam + sum J_f^T f,  J a + gamma = a_ref,  in every row

    Attributes
    ----------
    scene : Scene
    q, v, tau : (N, nq), (N, nv), (N, nv) array
        Configurations, velocities and torques, one row per state.
    a : (N, nv) array
        Joint accelerations [rad/s^2, m/s^2].
    lam : (N, m) array
        Constraint forces in the axes of each constraint [N, N m].
    residuals : (N, 5) array
        A `Residuals` a row; the properties below name its columns.
    statuses : (N,) int8 array
        Place in ``tuple(Status)``: 0 is ok. -1 where no worker got that far, which only the
        batch of a `WorkersLost` or an `Interrupted` has.
    iterations : (N,) int32 array
        Of the solver.
    solve_times : (N,) array
        Of each solve without its proof [s], while other processes used the machine too.
    seconds : float
        Wall time of the whole batch [s].
    applied : tuple of AppliedForce
        The forces from outside that were applied.
    drift : Baumgarte or None
        What gave a_ref; None where it is zero.

    Notes
    -----
    ``batch[i]`` is the `Solution` of state i, and iterating gives all of them; ``batch[2:4]`` and
    ``batch[batch.failed]`` are batches of some. The arrays include rows that are not ok, with NaN
    where there is no answer; `failed` has their indices.
    """

    scene: Scene
    q: Array
    v: Array
    tau: Array
    a: Array
    lam: Array
    residuals: Array
    statuses: NDArray[np.int8]
    iterations: NDArray[np.int32]
    solve_times: Array  # [s]
    seconds: float  # [s]
    applied: tuple[AppliedForce, ...] = ()
    drift: Baumgarte | None = None

    _rows = ("q", "v", "tau", "a", "lam", "residuals", "statuses", "iterations", "solve_times")
    _endings = STATUSES

    proofs = renamed("residuals")

    @property
    def dynamics_error(self) -> Array:
        """|M a + h - tau - J^T lam - sum J_f^T f|_inf [N, N m], (N,)."""
        return self.residuals[:, 0]

    @property
    def constraint_error(self) -> Array:
        """|J a + gamma - a_ref|_inf [m/s^2, rad/s^2], (N,)."""
        return self.residuals[:, 1]

    @property
    def violation(self) -> Array:
        """|c(q)|_inf [m, rad] of each state given, (N,)."""
        return self.residuals[:, 2]

    @property
    def velocity_violation(self) -> Array:
        """|J v|_inf [m/s, rad/s] of each state given, (N,)."""
        return self.residuals[:, 3]

    @property
    def error_bound(self) -> Array:
        """Bound on the error of a, relative to the larger of |a|_inf and gravity, (N,)."""
        return self.residuals[:, 4]

    @property
    def forces(self) -> dict[str, Array]:
        """Force on the first-named body by constraint, (N, rows of it), views of `lam`.

        Of a constraint with `axes` they are (N, 3) or (N, 6), in these, as in a `Solution`.
        """
        found, row = {}, 0
        for bound in self.scene.bounds:
            found[bound.name] = self.lam[:, row : row + bound.size]
            row += bound.size
        return found | forces_in_axes(self.scene, self.q, self.lam)

    def to_pandas(self) -> Any:
        """Return the solutions as a `pandas.DataFrame`, one state per row.

        Columns: status, q and a by joint, lam by row, the errors, iterations and solve_times [s].

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        of_states = self.status_names, self.q, self.a, self.lam, self.residuals
        table = solution_columns(self.scene, *of_states)
        table |= {"iterations": self.iterations, "solve_times": self.solve_times}
        return require_pandas().DataFrame(table)

    def _some(self, rows: Some) -> BatchSolution:
        return replace(super()._some(rows), applied=self._applied(rows))

    def _one(self, i: int) -> Solution:
        self._check_found(i, self.statuses)
        residuals = Residuals(*self.residuals[i].tolist())
        return Solution(
            a=self.a[i],
            lam=self.lam[i],
            residuals=residuals,
            status=STATUSES[self.statuses[i]],
            iterations=int(self.iterations[i]),
            solve_time=float(self.solve_times[i]),
            scene=self.scene,
            question=Question(self.q[i], self.v[i], self.tau[i], self._applied(i), self.drift),
        )

    def _applied(self, i: int | Some) -> tuple[AppliedForce, ...]:
        return tuple(force.row(i) for force in self.applied)

    def _worst(self) -> list[str]:
        worst = float(self.error_bound.max(initial=0.0))
        return [f"largest error bound of a  {worst:.1e} (relative)"]


@dataclass(frozen=True, eq=False, repr=False)
class BatchDerivatives(Jacobian, Batch[Derivatives]):
    """Derivatives at N states; columns are tangent, as in `Derivatives`.

    Attributes
    ----------
    solution : BatchSolution
        The answers, with their statuses.
    da_dq, da_dv, da_dtau : (N, nv, nv) array
        Of the joint accelerations a; the columns by q are tangent.
    dlam_dq, dlam_dv, dlam_dtau : (N, m, nv) array
        Of the rows, in the axes of each constraint, whatever its `axes`. Where rows are redundant,
        those of the smallest lam.
    seconds : float
        Wall time of the whole batch [s].

    Notes
    -----
    ``batch[i]`` is the `Derivatives` of state i, and ``batch[2:4]`` a batch of some. Where the
    status of a state is not ok, there is nothing to differentiate: its rows are NaN, and
    ``solution.failed`` has its index.
    """

    solution: BatchSolution
    da_dq: Array
    da_dv: Array
    da_dtau: Array
    dlam_dq: Array
    dlam_dv: Array
    dlam_dtau: Array
    seconds: float  # [s]

    outputs = "a", "lam"
    _rows = ("solution", *BLOCKS)

    def block(self, output: str, by: str) -> Array:
        """Return the derivatives of a (N, nv, nv) or lam (N, m, nv) by q, v or tau."""
        found: Array = getattr(self, f"d{output}_d{by}")
        return found

    def _one(self, i: int) -> Derivatives:
        blocks = (np.vstack([self.block(y, x)[i] for y in self.outputs]) for x in self.inputs)
        return Derivatives(self.solution[i], *map(read_only, blocks))

    def __repr__(self) -> str:
        return f"BatchDerivatives({self.solution!r})"
