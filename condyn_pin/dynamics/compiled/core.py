"""CompiledCore: a workspace whose hot loops are compiled.

What the core answers is what Python would: the same Pinocchio, the same numbers, and the proof by
the same equations. Where the proof of a state leaves a doubt, or the iteration ends at nothing,
the state is answered by Python: hard cases are handled in one place only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core.arguments import State
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics.compiled import arrays
from condyn_pin.dynamics.compiled.derivatives import CompiledDerivatives
from condyn_pin.dynamics.derivatives.differences import BLOCKS
from condyn_pin.dynamics.residuals import Residuals
from condyn_pin.dynamics.solution import Question, Solution, Status
from condyn_pin.errors import UnsupportedBackend

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.equations import Equations
    from condyn_pin.dynamics.derivatives.linearised import Linearisation
    from condyn_pin.dynamics.workspace import Workspace

_OK: Final = Status.OK

Outputs = dict[str, NDArray[Any]]


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
        self.workspace, self._arguments = workspace, workspace.scene.robot.arguments
        self._scene = workspace.scene
        nq, n, m = workspace.model.nq, workspace.model.nv, self._scene.rows
        # of what comes back of one state: a, lam, q, v, and seven numbers
        self._ends, self._size = (n, n + m, n + m + nq, n + m + nq + n), n + m + nq + n + 7
        self._blocks = 3, n + m, n
        self.core = compiled().Core(
            **arrays.of_model(workspace.model),
            **arrays.of_springs(workspace.scene.robot),
            **arrays.of_constraints(workspace),
            **arrays.of_solver(workspace),
            **arrays.of_precision(workspace.scene),
        )
        self._solve, self._differentiate = self.core.solve_one, self.core.differentiate_one

    def check(self, forces: Sequence[AppliedForce] = (), method: str = "kkt") -> None:
        """Refuse what it does not take beside a single state."""
        if forces:
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

    def one(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, accuracy: float) -> Solution | None:
        """Return the solution of one state; None where it is left to Python.

        Arrays that are right already are checked in the core alone.
        """
        out = np.empty(self._size)
        try:
            said = self._solve(q, v, tau, accuracy, out)
        except (TypeError, ValueError):
            said = self._solve(*self._converted(q, v, tau), accuracy, out)
        return said and self._solution(out, tau, *said)

    def derivatives(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, accuracy: float
    ) -> CompiledDerivatives | None:
        """Return the derivatives at one state; None where it is left to Python."""
        out, blocks = np.empty(self._size), np.empty(self._blocks)
        try:
            clear = self._differentiate(q, v, tau, accuracy, out, blocks)
        except (TypeError, ValueError):
            clear = self._differentiate(*self._converted(q, v, tau), accuracy, out, blocks)
        return CompiledDerivatives(self, out, blocks, _owned(tau)) if clear else None

    def solution(self, out: Array, tau: Array) -> Solution:
        """Return what the core has written of one state beside its derivatives."""
        *residuals, iterations, seconds = out[self._ends[-1] :].tolist()
        return self._solution(out, tau, residuals, int(iterations), seconds)

    def _solution(
        self, out: Array, tau: ArrayLike, residuals: Iterable[float], iterations: int,
        seconds: float,
    ) -> Solution:  # fmt: skip
        a, lam, q, v = self._ends
        question = Question(out[lam:q], out[q:v], _owned(tau), (), self.workspace.drift)
        return Solution(
            out[:a], out[a:lam], Residuals._make(residuals), _OK, iterations, seconds, self._scene,
            question,
        )  # fmt: skip

    def velocity(self, out: Array) -> Array:
        """Return v (nv,) of one state."""
        _, _, q, v = self._ends
        return out[q:v]

    @cached_property
    def equations(self) -> tuple[Equations, Linearisation]:
        """Those of the scene of this core, whatever the workspace is used for later."""
        return self.workspace.equations, self.workspace.linearisation

    def _converted(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> list[Array]:
        """Return the state as the core takes it, or raise `InvalidArgument`."""
        return [np.ascontiguousarray(x, float) for x in self._arguments.check(q, v, tau)]

    def _answer(
        self, work: Callable[..., None], state: State, outputs: Outputs, accuracy: float | None,
        forces: Sequence[AppliedForce], more: dict[str, Any],
    ) -> NDArray[np.intp]:  # fmt: skip
        q, v, tau = state
        clear = np.zeros(len(q), np.int32)
        work(
            q, v, arrays.contiguous(tau, len(q)), a=outputs["a"], lam=outputs["lam"],
            residuals=outputs["residuals"], iterations=outputs["iterations"], clear=clear,
            times=outputs["solve_times"], **more,
            **arrays.of_forces(self.workspace.loads, forces, len(q)),
            accuracy=self.workspace.solver.accuracy if accuracy is None else accuracy,
        )  # fmt: skip
        outputs["statuses"][:] = 0
        return np.flatnonzero(clear == 0)


def _owned(tau: ArrayLike) -> Array:
    """Torques (nv,) that the caller cannot write to."""
    return np.array(tau, dtype=float)
