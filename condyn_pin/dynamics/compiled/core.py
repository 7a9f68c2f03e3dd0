"""CompiledCore: a workspace whose hot loops are compiled.

What the core answers is what Python would: the same Pinocchio, the same numbers, and the proof by
the same equations. Where the proof of a state leaves a doubt, or the iteration ends at nothing,
the state is answered by Python: what is hard is looked at in one place only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled
from condyn_pin.dynamics.compiled import arrays
from condyn_pin.dynamics.verifier import LOOSE
from condyn_pin.errors import UnsupportedBackend

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace

# Columns of the sizes of an answer, as the core has them.
_DYNAMICS, _A, _VIOLATION, _VELOCITY, _CONSTRAINT, _LAM, _WEIGHTED, _EXACT = range(8)

# No acceleration of a machine, as in `Workspace`.
_LARGEST = 1e100


def refuse(reasons: Any) -> None:
    """Raise `UnsupportedBackend` if there are reasons."""
    for reason in reasons:
        raise UnsupportedBackend(
            f"the compiled core does not take this: {reason}; leave it to Python, "
            "Native(where_possible=True) does where it must"
        )


class CompiledCore:
    """The core of one workspace, with memory for its threads."""

    def __init__(self, workspace: Workspace) -> None:
        refuse(arrays.untaken(workspace))
        self._workspace = workspace
        self.core = compiled().Core(
            **arrays.of_model(workspace.model),
            **arrays.of_constraints(workspace),
            **arrays.of_solver(workspace),
        )

    def solve(
        self, q: Array, v: Array, tau: Array, outputs: dict[str, NDArray[Any]], *,
        accuracy: float | None, threads: int,
    ) -> NDArray[np.intp]:  # fmt: skip
        """Fill the outputs of a `BatchSolution`; return the rows that are left to Python.

        q (k, nq), v (k, nv), tau (k, nv) or (nv,). The rows that are not returned are ok.
        """
        accuracy = self._workspace.solver.accuracy if accuracy is None else accuracy
        tau = arrays.contiguous(tau, len(q))
        sizes = np.zeros((len(q), 8))
        self.core.solve(
            q, v, tau, a=outputs["a"], lam=outputs["lam"], sizes=sizes,
            iterations=outputs["iterations"], times=outputs["solve_times"], threads=threads,
        )  # fmt: skip
        outputs["residuals"][:], clear = self._judged(q, tau, sizes, accuracy)
        outputs["statuses"][:] = 0
        return np.flatnonzero(~clear)

    def _judged(
        self, q: Array, tau: Array, sizes: Array, accuracy: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the residuals (k, 5), and whether each answer is ok without a doubt (k,)."""
        nominal = self._workspace.scene.nominal
        estimator, pivots = nominal.estimator, nominal.pivots
        largest, slip, forces = (sizes[:, i] for i in (_A, _CONSTRAINT, _LAM))
        bound, doubtful = estimator.prove_many(largest, slip, forces, sizes[:, _WEIGHTED], tau)
        clear = (sizes[:, _EXACT] == 1.0) & (sizes[:, _A] < _LARGEST) & ~doubtful
        clear &= (bound <= accuracy) & self._normalised(q)
        size = np.maximum(sizes[:, _A], estimator.gravity)
        clear &= sizes[:, _DYNAMICS] <= estimator.unheard * size
        if pivots.may_fall:
            for i in np.flatnonzero(clear & (bound > 0.0)):
                clear[i] = pivots.holds(bound[i], self._workspace.equations.mass(q[i]))
        columns = [_DYNAMICS, _CONSTRAINT, _VIOLATION, _VELOCITY]
        return np.column_stack([sizes[:, columns], bound]), clear

    def _normalised(self, q: Array) -> NDArray[np.bool_]:
        """Return for each configuration (k, nq) whether no proof need look at its quaternions."""
        fine = np.ones(len(q), bool)
        for part in self._workspace.scene.robot.arguments.units:
            fine &= np.abs(np.linalg.norm(q[:, part], axis=1) - 1.0) <= LOOSE
        return fine
