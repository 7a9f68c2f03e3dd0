"""A controller's tick in the compiled core: arrays across the border, answers back.

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
from condyn_pin.constraints.rows.bound import STILL, placement
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.contact.cones import Cones, FrictionCone, RoundCone, WrenchCone
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.answer import ControlAnswer, ControlResiduals, ControlStatus, active_rows
from condyn_pin.control.hierarchy import DECIDED, SLACK, STRICTLY
from condyn_pin.control.program import Program
from condyn_pin.control.qp.qp_solver import PolishedAnswer
from condyn_pin.control.support import edge_notices
from condyn_pin.control.tasks.task import BoundTask, CompiledTask, Task
from condyn_pin.dynamics.compiled import of_model, of_rows, why_not_rows
from condyn_pin.dynamics.scene import Scene

# What a controller's tick is made of as plain arrays, and what of it the compiled core has not.
#
# The places of the fields are those that ``native/src/tick/ticks.cpp`` reads.


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


def of_program(program: Program, regularisation: float) -> dict[str, Any]:
    """Return all numbers that stay the same from tick to tick."""
    equations, cones = program.equations, program.cones
    model = of_model(equations.model)
    del model["damping"]  # of `passive`, which the caller knows
    numbers = [
        program.mass, regularisation, tolerances.RANK, tolerances.PARALLEL, CLEAR, equations.least,
        STRICTLY, SLACK, DECIDED,
    ]  # fmt: skip
    return {
        **model,
        **of_rows(equations.bounds, equations.drift),
        **_of_tasks(program),
        "levels": [len(stack.rows) for stack in program.levels],
        **_of_cones(program),
        **_of_bounds(program),
        "held": cones.held.tolist(),
        "touching": cones.touching.tolist(),
        "driven": equations.driven.tolist(),
        "motors": program.actuation.columns.tolist(),
        "rigid": program.rigid.argmax(axis=1).tolist() if len(program.rigid) else [],
        "limited": program.torque.L.argmax(axis=1).tolist() if program.torque.names else [],
        "torque": program.torque.most / program.mass,
        "numbers": np.array(numbers),
    }


def _of_tasks(program: Program) -> dict[str, Any]:
    integers, numbers = [], []
    columns: list[int] = []
    hard = {task.name for task, _ in program.hard.bound}
    for task, bound in tasks_of(program):
        made: CompiledTask = bound.compiled  # type: ignore[assignment]  # `why_not` has looked
        count, is_hard = len(made.columns), task.name in hard
        integers.append([made.kind, len(bound.names), made.at, is_hard, *made.sizes, count])
        placed = STILL if made.placement is None else placement(made.placement)
        numbers.append([*placed, *made.gains, 0.0 if is_hard else task.weight])
        columns += made.columns
    return {
        "tasks": np.array(integers, np.int32).reshape(-1, 7),
        "of_tasks": np.array(numbers, float).reshape(-1, 15),
        "task_columns": columns,
    }


def _of_cones(program: Program) -> dict[str, Any]:
    bounds, turning = program.equations.bounds, program.cones.turning
    places = [
        [bounds.index(cone.bound), cone.block[0].start, cone.block[1].start, cone.edge]
        for cone in turning
    ]
    return {
        "cones": program.cones.standing,
        "turning": np.array(places, np.int32).reshape(-1, 4),
        "floors": np.array([cone.floor.ravel() for cone in turning]).reshape(-1, 9),
        "A": [np.ascontiguousarray(cone.A) for cone in turning],
        "to_wrench": [np.ascontiguousarray(cone.to_wrench) for cone in turning],
    }


def _of_bounds(program: Program) -> dict[str, Any]:
    bounds = program.bounds
    joints, (highest, lowest) = bounds.joints, bounds.reach
    return {
        "bounded": bounds.columns.tolist(),
        "most": bounds.most,
        "speed": bounds.speed,
        "dt": bounds.dt or 0.0,
        "at_q": np.asarray(joints.iq).tolist(),
        "at_v": np.asarray(joints.iv).tolist(),
        "lowest": np.ascontiguousarray(lowest),
        "highest": np.ascontiguousarray(highest),
    }


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
        self._core = compiled_tick().Tick(**of_program(program, regularisation))
        self._program, self._scene = program, scene
        self._cones, self._actuation = cones, actuation
        tasks = tasks_of(program)
        self._references = References(
            [bound.compiled for _, bound in tasks if bound.compiled], program.equations
        )
        self._sides = np.zeros((len(program.levels), len(program.inequalities)), np.int8)
        n, m, r = scene.robot.nv, scene.rows, len(program.rigid)
        self._parts = tuple(np.cumsum([0, n, n, n, m, r]).tolist())
        self._errors = dict(_rows([(task.name, len(bound.names)) for task, bound in tasks]))
        self._size = self._parts[-1] + sum(len(bound.names) for _, bound in tasks)

    def solve(self, q: Array, v: Array, t: float, passive: Array) -> ControlAnswer | None:
        """Return the answer of one tick; None where Python has to answer."""
        # The swing of joints that are taken for rigid is in `v`, and left out there.
        if np.abs(self._program.gaps(q, t)).max(initial=0.0) > tolerances.OPEN:
            return None  # redundant rows look independent there
        out = np.empty(self._size)
        kkt, dynamics, constraints, *sizes, answered, changes, seconds = self._core.solve(
            q, v, passive, self._references.at(t), self._sides.reshape(-1), out
        )
        size, torque, unreached = sizes
        reached = tolerances.SOLVED * max(size, tolerances.GRAVITY) + unreached
        clear = kkt <= CLEAR and dynamics <= tolerances.SOLVED * torque and constraints <= reached
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
        lam = out[at_lam:at_rigid]
        notices += edge_notices(self._scene, q, lam, active)
        tau, motors = out[at_tau:at_lam], self._actuation
        return ControlAnswer(
            u=tau[motors.columns] / motors.gears,
            tau=tau,
            a=out[at_a:at_tau],
            lam=lam,
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
