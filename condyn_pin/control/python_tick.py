"""PythonTick: terms, program, answer and proof of a control tick, here in Python.

`CompiledTick` does the same in the compiled core, and leaves to this what it is in doubt of.
"""

from __future__ import annotations

from math import isfinite
from time import perf_counter

import numpy as np

from condyn_pin._core.arguments import Arguments
from condyn_pin._core.arrays import Array, check_overflow
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.contact.cones import Cones
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.answer import ControlAnswer
from condyn_pin.control.hierarchy import Cascade
from condyn_pin.control.levels import Level
from condyn_pin.control.program import Program
from condyn_pin.control.qp.chain import ChainAnswer
from condyn_pin.control.qp.polish import Polished
from condyn_pin.control.qp.quadratic_program import Constraints
from condyn_pin.control.verdict import verdict
from condyn_pin.dynamics.scene import Scene


class PythonTick:
    """The tick of one controller, with the active set of the last one.

    Attributes
    ----------
    polished : list of Polished or None
        The last answer of each level with its active set, of those that were asked for.
    """

    def __init__(
        self, program: Program, scene: Scene, cones: Cones, actuation: Actuation,
        cascade: Cascade, arguments: Arguments,
    ) -> None:  # fmt: skip
        self._program, self._scene = program, scene
        self._cones, self._actuation = cones, actuation
        self._cascade, self._arguments = cascade, arguments
        self._still = np.zeros(scene.robot.nv)
        self.polished: list[Polished | None] = []

    @one_blas_thread
    def solve(self, q: Array, v: Array, t: float, passive: Array) -> ControlAnswer:
        """Return the answer of one tick."""
        given, levels = self.assembled(q, v, t, passive)
        start = perf_counter()
        x, answers = self._cascade.solve(given, levels, lambda: self._costs(given))
        asked: list[ChainAnswer] = answers
        said: tuple[str, ...] = ()
        gives = answers[-1].elastic if x is None else None
        if gives and (less := self._program.relaxed(given, gives)):
            given, said = less[0], (less[1],)
            x, answers = self._cascade.solve(given, levels, lambda: self._costs(given))
            asked = [*asked, *answers]
        elapsed = perf_counter() - start
        self.polished = [each.answer for each in answers]
        found = verdict(self._program, given, x, answers)
        return ControlAnswer(
            **found._replace(notices=said + found.notices)._asdict(),
            path=tuple(step for each in asked for step in each.path),
            iterations=sum(each.iterations for each in asked),
            solve_time=elapsed,
            actuation=self._actuation,
            cones=self._cones,
            scene=self._scene,
            q=q.copy(),
            t=t,
            v=self._program.motion.v.copy(),
        )

    def assembled(
        self, q: Array, v: Array, t: float, passive: Array
    ) -> tuple[Constraints, list[Level]]:
        """Return the constraints of a tick and its levels; what is not finite is refused."""
        with np.errstate(all="ignore"):  # what overflows is refused
            if not isfinite(q.dot(q) + v.dot(v)):  # not finite, or very large
                self._arguments.check(q, v, self._still)
            if not isfinite(passive.dot(passive)):
                check_overflow("passive", passive, passive**2)
            if len(self._program.rigid):
                v = self._program.without_swing(q, v)
            given, levels = self._program.assemble(q, v, t, passive)
            size = given.b.dot(given.b)
            for level in levels:
                size += level.rows.b.dot(level.rows.b)
            if not isfinite(size):
                check_overflow("v", v, given.b, *(level.rows.b for level in levels))
        return given, levels

    def _costs(self, given: Constraints) -> tuple[Array, Array]:
        """Return what breaking each equation and each inequality costs."""
        equations = self._program.equation_rows(given)
        of_equations = np.array([row.cost for row in equations])
        return of_equations, np.array([row.cost for row in self._program.inequalities])
