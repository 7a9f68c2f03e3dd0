"""CompiledCore: a workspace whose hot loops are compiled.

What the core answers is what Python would: the same Pinocchio, the same numbers, and the proof by
the same equations. Where the proof of a state leaves a doubt, or the iteration ends at nothing,
the state is answered by Python: what is hard is looked at in one place only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled
from condyn_pin.constraints.applied_force import AppliedForce, applied_forces
from condyn_pin.dynamics.compiled import arrays
from condyn_pin.dynamics.compiled.derivatives import CompiledDerivatives
from condyn_pin.dynamics.derivatives.differences import BLOCKS
from condyn_pin.dynamics.residuals import Residuals
from condyn_pin.dynamics.solution import Solution, Status
from condyn_pin.dynamics.verifier import LOOSE
from condyn_pin.errors import UnsupportedBackend

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace

State = tuple[Array, Array, Array]
Outputs = dict[str, NDArray[Any]]

# Columns of the sizes of an answer, as the core has them.
_DYNAMICS, _A, _VIOLATION, _VELOCITY, _CONSTRAINT, _LAM, _WEIGHTED, _EXACT, _PIVOTS = range(9)

# No acceleration of a machine, as in `Workspace`.
_LARGEST = 1e100


def refuse(reasons: Iterable[str]) -> None:
    """Raise `UnsupportedBackend` if there are reasons."""
    for reason in reasons:
        raise UnsupportedBackend(
            f"the compiled core does not take this: {reason}; leave it to Python, "
            "Native(where_possible=True) does where it must"
        )


def untaken_method(method: str) -> Iterator[str]:
    """Yield what it does not take of the methods of derivatives."""
    if method != "kkt":
        yield f"method = {method!r}: its derivatives are those of 'kkt'"


class CompiledCore:
    """The core of one workspace, with memory for its threads."""

    def __init__(self, workspace: Workspace) -> None:
        refuse(arrays.untaken(workspace))
        self._workspace = workspace
        self.core = compiled().Core(
            **arrays.of_model(workspace.model),
            **arrays.of_springs(workspace.scene.robot),
            **arrays.of_constraints(workspace),
            **arrays.of_solver(workspace),
        )

    def check(self, forces: Sequence[AppliedForce] = (), method: str = "kkt") -> None:
        """Refuse what it does not take beside a single state."""
        if applied_forces(forces):
            refuse([f"forces = {forces!r}: it has forces from outside for batches alone"])
        refuse(untaken_method(method))

    def solve(
        self, state: State, outputs: Outputs, *, accuracy: float | None, threads: int,
        forces: Sequence[AppliedForce] = (),
    ) -> NDArray[np.intp]:  # fmt: skip
        """Fill the outputs of a `BatchSolution`; return the rows that are left to Python.

        The others are ok. `state` is q (k, nq), v (k, nv) and tau, (k, nv) or (nv,); `forces` are
        the same for all, or have one row per state.
        """
        more = {"threads": threads}
        return self._answer(self.core.solve, state, outputs, accuracy, forces, more)

    def differentiate(
        self, state: State, outputs: Outputs, *, accuracy: float | None, threads: int,
        forces: Sequence[AppliedForce] = (),
    ) -> NDArray[np.intp]:  # fmt: skip
        """Fill the outputs of a `BatchDerivatives`; return the rows that are left to Python."""
        more = {"threads": threads, "blocks": [outputs[name] for name in BLOCKS]}
        return self._answer(self.core.differentiate, state, outputs, accuracy, forces, more)

    def one(self, q: Array, v: Array, tau: Array, accuracy: float) -> Solution | None:
        """Return the solution of one state; None where it is left to Python."""
        a, lam = np.empty(self._workspace.model.nv), np.empty(self._workspace.scene.rows)
        *sizes, iterations, seconds = self.core.solve_one(q, v, tau, a, lam)
        residuals = self._proved(q, tau, sizes, accuracy)
        if residuals is None:
            return None
        scene = self._workspace.scene
        return Solution(a, lam, residuals, Status.OK, iterations, seconds, scene, q.copy(), ())

    def derivatives(
        self, q: Array, v: Array, tau: Array, accuracy: float
    ) -> CompiledDerivatives | None:
        """Return the derivatives at one state; None where it is left to Python."""
        workspace = self._workspace
        n, m = workspace.model.nv, workspace.scene.rows
        a, lam, sizes = np.empty((1, n)), np.empty((1, m)), np.zeros((1, 9))
        iterations, times = np.zeros(1, np.int32), np.zeros(1)
        by_q, by_v, by_tau = np.zeros((3, n + m, n))
        blocks = by_q[:n], by_v[:n], by_tau[:n], by_q[n:], by_v[n:], by_tau[n:]
        self.core.differentiate(
            q[None], v[None], tau[None], a=a, lam=lam, sizes=sizes, iterations=iterations,
            times=times, **self._no_forces, loads=np.zeros((1, n)),
            blocks=[block[None] for block in blocks], threads=0,
        )  # fmt: skip
        residuals = self._proved(q, tau, sizes[0].tolist(), accuracy)
        if residuals is None:
            return None
        solution = Solution(
            a[0], lam[0], residuals, Status.OK, int(iterations[0]), float(times[0]),
            workspace.scene, q.copy(), (),
        )  # fmt: skip
        return CompiledDerivatives(workspace, solution, v, (by_q, by_v, by_tau))

    @cached_property
    def _no_forces(self) -> dict[str, Any]:
        return arrays.of_forces(self._workspace.loads, (), 1)

    def _proved(
        self, q: Array, tau: Array, sizes: Sequence[float], accuracy: float
    ) -> Residuals | None:
        """Return the residuals of an answer that is ok; None where there is a doubt."""
        *largest, weighted, exact, left = sizes
        estimator = self._workspace.scene.nominal.estimator
        residuals, doubtful = estimator.judge(weighted, largest, tau)
        size = max(largest[_A], estimator.gravity)
        clear = (
            not doubtful
            and exact == 1.0
            and largest[_A] < _LARGEST
            and residuals.bound <= accuracy
            and residuals.dynamics <= estimator.unheard * size
            and pin.isNormalized(self._workspace.model, q, LOOSE)
            and residuals.bound <= tolerances.SOLVED * left
        )
        return residuals if clear else None

    def _answer(
        self, work: Callable[..., None], state: State, outputs: Outputs, accuracy: float | None,
        forces: Sequence[AppliedForce], more: dict[str, Any],
    ) -> NDArray[np.intp]:  # fmt: skip
        accuracy = self._workspace.solver.accuracy if accuracy is None else accuracy
        q, v, tau = state
        tau, sizes = arrays.contiguous(tau, len(q)), np.zeros((len(q), 9))
        loads = np.zeros_like(tau)
        work(
            q, v, tau, a=outputs["a"], lam=outputs["lam"], sizes=sizes,
            iterations=outputs["iterations"], times=outputs["solve_times"],
            **arrays.of_forces(self._workspace.loads, forces, len(q)), loads=loads, **more,
        )  # fmt: skip
        torques = np.abs(tau) + loads if forces else tau
        outputs["residuals"][:], clear = self._judged(q, torques, sizes, accuracy)
        outputs["statuses"][:] = 0
        return np.flatnonzero(~clear)

    def _judged(
        self, q: Array, tau: Array, sizes: Array, accuracy: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the residuals (k, 5), and whether each answer is ok without a doubt (k,)."""
        nominal = self._workspace.scene.nominal
        estimator = nominal.estimator
        largest, slip, forces = (sizes[:, i] for i in (_A, _CONSTRAINT, _LAM))
        bound, doubtful = estimator.prove_many(largest, slip, forces, sizes[:, _WEIGHTED], tau)
        clear = (sizes[:, _EXACT] == 1.0) & (sizes[:, _A] < _LARGEST) & ~doubtful
        clear &= (bound <= accuracy) & self._normalised(q)
        size = np.maximum(sizes[:, _A], estimator.gravity)
        clear &= sizes[:, _DYNAMICS] <= estimator.unheard * size
        clear &= bound <= tolerances.SOLVED * sizes[:, _PIVOTS]
        columns = [_DYNAMICS, _CONSTRAINT, _VIOLATION, _VELOCITY]
        return np.column_stack([sizes[:, columns], bound]), clear

    def _normalised(self, q: Array) -> NDArray[np.bool_]:
        """Return for each configuration (k, nq) whether no proof need look at its quaternions."""
        fine = np.ones(len(q), bool)
        for part in self._workspace.scene.robot.arguments.units:
            fine &= np.abs(np.linalg.norm(q[:, part], axis=1) - 1.0) <= LOOSE
        return fine
