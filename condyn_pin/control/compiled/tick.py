"""CompiledTick: terms, program, answer and proof of a control tick in the compiled core.

What the core answers is what Python would: the same program, which has one answer, and the proof by
the same equations. What it does not answer beyond doubt is done by Python: rows that contradict
each other, ranks at their edge, levels that leave it to rounding which rows those below them have,
numbers that are not finite. Hard cases are looked at in one place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled_tick
from condyn_pin.control.answer import ControlAnswer, ControlResiduals, ControlStatus
from condyn_pin.control.compiled import tick_arrays
from condyn_pin.control.verdict import active_rows
from condyn_pin.errors import UnsupportedBackend

if TYPE_CHECKING:
    from condyn_pin.contact.cones import Cones
    from condyn_pin.control.actuation import Actuation
    from condyn_pin.control.program import Program
    from condyn_pin.control.qp.polish import Polished
    from condyn_pin.dynamics.scene import Scene

_PATH = ("compiled core",)


class CompiledTick:
    """The tick of one controller, with the active set of the last one in each level."""

    def __init__(
        self, program: Program, scene: Scene, cones: Cones, actuation: Actuation,
        regularisation: float,
    ) -> None:  # fmt: skip
        for reason in tick_arrays.untaken(program):
            raise UnsupportedBackend(
                f"the compiled core does not take this: {reason}; leave it to Python, "
                "native='where possible' does where it must"
            )
        self._core = compiled_tick().Tick(**tick_arrays.of_program(program, regularisation))
        self._program, self._scene = program, scene
        self._cones, self._actuation = cones, actuation
        tasks = tick_arrays.tasks_of(program)
        self._references = tick_arrays.References(
            [bound.compiled for _, bound in tasks if bound.compiled], program.equations
        )
        self._sides = np.zeros((len(program.levels), len(program.inequalities)), np.int8)
        n, m, r = scene.robot.nv, scene.rows, len(program.rigid)
        self._parts = tuple(np.cumsum([0, n, n, n, m, r]).tolist())
        self._errors = dict(_rows([(task.name, len(bound.names)) for task, bound in tasks]))
        self._size = self._parts[-1] + sum(len(bound.names) for _, bound in tasks)

    def solve(self, q: Array, v: Array, t: float, passive: Array) -> ControlAnswer | None:
        """Return the answer of one tick; None where it is left to Python.

        The swing of joints that are taken for rigid is in `v`, and left out there.
        """
        if np.abs(self._program.gaps(q, t)).max(initial=0.0) > tolerances.OPEN:
            return None  # redundant rows look independent there
        out = np.empty(self._size)
        kkt, dynamics, constraints, *sizes, answered, changes, seconds = self._core.solve(
            q, v, passive, self._references.at(t), self._sides.reshape(-1), out
        )
        size, torque, unreached = sizes
        reached = tolerances.SOLVED * max(size, tolerances.GRAVITY) + unreached
        clear = (
            kkt <= tick_arrays.CLEAR
            and dynamics <= tolerances.SOLVED * torque
            and constraints <= reached
        )
        if not clear:
            return None
        at_v, at_a, at_tau, at_lam, at_rigid, at_errors = self._parts
        errors = out[at_errors:]
        notices: tuple[str, ...] = ()
        if constraints > tolerances.SOLVED * max(size, tolerances.GRAVITY):
            self._program.equations.at(t)
            a, lam = out[at_a:at_tau], out[at_lam:at_rigid]
            notices = self._program.unkept(q, out[at_v:at_a], a, lam, max(size, tolerances.GRAVITY))
        sides = self._sides[answered - 1]
        active = active_rows(self._program, sides.nonzero()[0], sides > 0) if sides.any() else ()
        return ControlAnswer(
            tau=out[at_tau:at_lam],
            a=out[at_a:at_tau],
            lam=out[at_lam:at_rigid],
            rigid=out[at_rigid:at_errors],
            errors={name: errors[rows] for name, rows in self._errors.items()},
            active=active,
            infeasible=None,
            residuals=ControlResiduals(kkt, dynamics, constraints),
            status=ControlStatus.OK,
            path=_PATH,
            iterations=changes,
            solve_time=seconds,
            actuation=self._actuation,
            cones=self._cones,
            scene=self._scene,
            q=q.copy(),
            t=t,
            v=out[at_v:at_a],
            notices=notices,
        )

    def begin_from(self, answers: Sequence[Polished | None]) -> None:
        """Begin the next tick from the active sets of an answer by Python, level after level."""
        self._sides[:] = 0
        for sides, answer in zip(self._sides, answers, strict=False):
            if answer:
                sides[answer.at_lower] = -1
                sides[answer.at_upper] = 1


def _rows(sizes: list[tuple[str, int]]) -> Iterator[tuple[str, slice]]:
    """Yield which rows belong to each name, one after the other."""
    start = 0
    for name, size in sizes:
        yield name, slice(start, start + size)
        start += size
