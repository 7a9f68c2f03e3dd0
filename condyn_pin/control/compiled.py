"""A controller's tick in the compiled core: named fields across the border, answers back.

CompiledTick: terms, program, answer and proof of a control tick in the compiled core.

What the core answers is what Python would: the same program, which has one answer, and the proof by
the same equations. What it does not answer beyond doubt is done by Python: rows that contradict
each other, ranks at their edge, levels that leave it to rounding which rows those below them have,
numbers that are not finite. Hard cases are looked at in one place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import listed
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled_tick, refuse
from condyn_pin.constraints.rows.bound import STILL
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.contact.cones import Cones, FrictionCone, RoundCone, WrenchCone
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.answer import ControlAnswer, ControlResiduals, ControlStatus, active_rows
from condyn_pin.control.hierarchy import DECIDED, SLACK, STRICTLY
from condyn_pin.control.program import Program
from condyn_pin.control.qp.qp_solver import PolishedAnswer
from condyn_pin.control.tasks.task import BoundTask, CompiledTask, Task
from condyn_pin.dynamics.compiled import describe_rows, why_not_rows
from condyn_pin.dynamics.scene import Scene

# What a controller's tick is made of, in the fields that the core reads, and what it lacks.


# The KKT residual of an answer without a doubt: forces weigh 1e-5, and are off by the residual over
# that. Answers end at rounding, 1e-13; what does not is looked at by Python.
CLEAR: Final = 1e-2 * tolerances.KKT


def tasks_of(program: Program) -> list[tuple[Task, BoundTask]]:
    """Return the tasks of a program, in the order of the core."""
    return [each for stack in (*program.levels, program.hard) for each in stack.bound]


def why_not(program: Program) -> Iterator[str]:
    """Yield the features of a controller that the core lacks, in words."""
    yield from why_not_rows(program.equations.model, program.equations.bounds)
    motors = program.actuation.motors
    if coupled := [motors[k] for k in program.actuation.coupled]:
        yield f"actuation: motors that act on several joints ({listed(coupled)})"
    if len(program.levels) > 1:
        yield "tasks: it answers the levels of a Hierarchy with their regularisation"
    if program.bounds.dt is not None:
        yield "limits: it does not stop joints at their ends (dt)"
    if program.cones.rounds:
        yield "cones: it has pyramids, and no round ones"
    for cone in program.cones.turning:
        if type(cone.cone) not in (FrictionCone, RoundCone, WrenchCone):
            yield f"cones: it does not turn a {type(cone.cone).__name__}"
    for task, bound in tasks_of(program):
        made = bound.compiled
        if made is None:
            yield f"task {task.name!r}: it has no rows for this {type(task).__name__}"
        elif bound.over == "forces" and made.at not in _with_cones(program):
            yield f"task {task.name!r}: it is about the force of a contact that has no cone"


def _with_cones(program: Program) -> set[int]:
    """Return the places of the constraints that have a cone."""
    bounds, touching = program.equations.bounds, set(program.cones.touching.tolist())
    return {i for i, bound in enumerate(bounds) if bound.rows.start in touching}


def describe(program: Program, regularisation: float) -> dict[str, Any]:
    """All that stays the same from tick to tick."""
    equations, cones = program.equations, program.cones
    return {
        **describe_rows(equations.model, equations.bounds, equations.drift),
        "tasks": _describe_tasks(program),
        "levels": [len(stack.rows) for stack in program.levels],
        "cones": cones.standing,
        "turning": [
            {
                "constraint": equations.bounds.index(cone.bound),
                "row": cone.block[0].start, "column": cone.block[1].start, "edge": cone.edge,
                "floor": cone.floor, "A": cone.A, "to_wrench": cone.to_wrench,
            }
            for cone in cones.turning
        ],
        "accelerations": _describe_bounds(program),
        "held": cones.held,
        "touching": cones.touching,
        "driven": equations.driven,
        "motors": program.actuation.columns,
        "rigid": program.rigid.argmax(axis=1) if len(program.rigid) else (),
        "limited": program.torque.L.argmax(axis=1) if program.torque.names else (),
        "torque": program.torque.most / program.mass,
        "mass": program.mass, "regularisation": regularisation, "rank": tolerances.RANK,
        "parallel": tolerances.PARALLEL, "kkt": CLEAR, "least": equations.least,
        "strictly": STRICTLY, "slack": SLACK, "decided": DECIDED,
    }  # fmt: skip


def _describe_tasks(program: Program) -> list[dict[str, Any]]:
    hard, found = {task.name for task, _ in program.hard.bound}, []
    for task, bound in tasks_of(program):
        made: CompiledTask = bound.compiled  # type: ignore[assignment]  # `why_not` has looked
        is_hard, (of_x, of_v), (kp, kd) = task.name in hard, made.sizes, made.gains
        found.append({
            "kind": made.kind, "size": len(bound.names), "at": made.at, "hard": is_hard,
            "placement": STILL if made.placement is None else made.placement, "kp": kp, "kd": kd,
            "weight": 0.0 if is_hard else task.weight, "columns": made.columns, "of_x": of_x,
            "of_v": of_v,
        })  # fmt: skip
    return found


def _describe_bounds(program: Program) -> dict[str, Any]:
    bounds = program.bounds
    joints, (highest, lowest) = bounds.joints, bounds.reach
    return {
        "columns": bounds.columns, "most": bounds.most, "speed": bounds.speed,
        "dt": bounds.dt or 0.0, "at_q": joints.iq, "at_v": joints.iv, "lowest": lowest,
        "highest": highest,
    }  # fmt: skip


class References:
    """The references of tasks and driven rows as numbers: functions of t are asked each tick."""

    def __init__(self, tasks: Sequence[CompiledTask], equations: Equations) -> None:
        follow = [task.follow() for task in tasks]
        sizes = [x + 2 * v for x, v in (task.sizes for task in tasks)]
        ends = np.cumsum([0, *sizes]).tolist()
        self._equations, self._driven = equations, equations.driven
        self._numbers = np.zeros(ends[-1] + 3 * len(self._driven))
        self._paths = self._numbers[ends[-1] :].reshape(3, -1)
        self._moving = []
        for at, task, start, end in zip(follow, tasks, ends[:-1], ends[1:], strict=True):
            if task.changes:
                self._moving.append((at, slice(start, end)))
            else:
                self._numbers[start:end] = at(0.0)

    def at(self, t: float) -> Array:
        """Return x_r, v_r and a_r of all tasks one after the other, then s, s' and s'' of rows."""
        # The next call overwrites them.
        for at, where in self._moving:
            self._numbers[where] = at(t)
        if self._paths.size:
            self._equations.at(t)
            self._paths[:] = self._equations.wanted[:, self._driven]
        return self._numbers


# CompiledTick: terms, program, answer and proof of a control tick in the compiled core.


_PATH = ("compiled core",)


class CompiledTick:
    """The tick of one controller, with the active set of the last one in each level."""

    def __init__(
        self, program: Program, scene: Scene, cones: Cones, actuation: Actuation,
        regularisation: float,
    ) -> None:  # fmt: skip
        refuse(why_not(program), "engine='auto'")
        self._core = compiled_tick().Tick(**describe(program, regularisation))
        self._program, self._scene = program, scene
        self._cones, self._actuation = cones, actuation
        tasks = tasks_of(program)
        self._references = References(
            [bound.compiled for _, bound in tasks if bound.compiled], program.equations
        )
        self._sides = np.zeros((len(program.levels), len(program.inequalities)), np.int8)
        parts = self._core.parts
        self._v, self._a, self._tau, self._lam, self._rigid, self._task_errors = (
            parts[name] for name in ("v", "a", "tau", "lam", "rigid", "errors")
        )
        self._errors = dict(_rows([(task.name, len(bound.names)) for task, bound in tasks]))
        self._size = self._task_errors.stop

    def solve(self, q: Array, v: Array, t: float, passive: Array) -> ControlAnswer | None:
        """Return the answer of one tick; None where Python has to answer."""
        # The swing of joints that are taken for rigid is in `v`, and left out there.
        if np.abs(self._program.gaps(q, t)).max(initial=0.0) > tolerances.OPEN:
            return None  # redundant rows look independent there
        out = np.empty(self._size)
        sizes = self._core.solve(
            q, v, passive, self._references.at(t), self._sides.reshape(-1), out
        )
        kkt, dynamics, constraints = sizes.kkt, sizes.dynamics, sizes.constraints
        size = max(sizes.a, tolerances.GRAVITY)
        kept = constraints <= tolerances.SOLVED * size
        if not (
            kkt <= CLEAR
            and dynamics <= tolerances.SOLVED * sizes.torque
            and (kept or constraints <= tolerances.SOLVED * size + sizes.unreached)
        ):
            return None
        v, a, tau, lam = out[self._v], out[self._a], out[self._tau], out[self._lam]
        errors = out[self._task_errors]
        notices: tuple[str, ...] = ()
        if not kept:
            self._program.equations.at(t)
            notices = self._program.unkept(q, v, a, lam, size)
        sides = self._sides[sizes.answered - 1]
        active = active_rows(self._program, sides.nonzero()[0], sides > 0) if sides.any() else ()
        motors = self._actuation
        return ControlAnswer(
            u=tau[motors.columns] / motors.gears,
            tau=tau,
            a=a,
            lam=lam,
            rigid=out[self._rigid],
            errors={name: errors[rows] for name, rows in self._errors.items()},
            active=active,
            infeasible=None,
            residuals=ControlResiduals(kkt, dynamics, constraints),
            status=ControlStatus.OK,
            path=_PATH,
            iterations=sizes.changes,
            solve_time=sizes.seconds,
            actuation=self._actuation,
            cones=self._cones,
            scene=self._scene,
            q=q.copy(),
            t=t,
            v=v,
            of_tick=notices,
        )

    def begin_from(self, answers: Sequence[PolishedAnswer | None]) -> None:
        """Begin the next tick from the active sets of an answer by Python, level after level."""
        self._sides[:] = 0
        for sides, answer in zip(self._sides, answers, strict=False):
            if answer:
                sides[answer.at_lower] = -1
                sides[answer.at_upper] = 1


def _rows(sizes: list[tuple[str, int]]) -> Iterator[tuple[str, slice]]:
    """Yield names with the rows that belong to each, one after the other."""
    start = 0
    for name, size in sizes:
        yield name, slice(start, start + size)
        start += size
