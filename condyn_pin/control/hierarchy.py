"""Hierarchy: levels of tasks, of which none takes anything from those above it.

Level i is answered within what the levels above it leave,

    min_s  w |G_i (x_(i-1) + Z_(i-1) s) - b_i|^2,     x_i = x_(i-1) + Z_(i-1) s,
    Z_i = Z_(i-1) null(G_i Z_(i-1)),

with all inequalities, those that are strictly active in it from then on as equations, and Z_0 the
null space of the equations. A level yields nothing to the regularisation either: it is repeated
about its own answer s',

    min_s  w |G_i (x_(i-1) + Z_(i-1) s) - b_i|^2 + eps |s - s'|^2,

(proximal point algorithm), until s stays, which also leaves rows active that the tasks press on and
no others. What the last level leaves is decided by the least |x|^2.

References
----------
Escande, Mansard, Wieber. Hierarchical quadratic programming: fast online humanoid-robot motion
generation. International Journal of Robotics Research, 2014. Rockafellar. Monotone operators and
the proximal point algorithm. SIAM Journal on Control and Optimization, 1976.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices, entries
from condyn_pin._core.linalg import null_space, rank_of
from condyn_pin.control.qp.chain import ChainAnswer, SolverLadder
from condyn_pin.control.qp.qp_solver import Constraints, QPSolver, QuadraticProgram, peak
from condyn_pin.control.tasks.task import DefaultReference, RobotMotion, Task
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument

Costs = Callable[[], tuple[Array, Array]]

# Multipliers, as a share of the largest, of rows that stay active for the levels below: a level at
# its best in a corner leaves nothing of it, and rounding would make that a contradiction.
STRICTLY: Final = 1e-3

# The same over the gradient of the tasks where x is that of the levels above: below it is rounding
# of a level that has all it wants.
PRESSED: Final = 1e-9

# eps, as a share of the largest entry of the objective: mostly no repetition is needed then, and
# flat directions, which lower levels decide, are rounded to 1e-5.
_NEARLY_NONE: Final = 1e-11

# What the last repetition may have changed, eps |s - s'|, as a share of the same [m/s^2].
_SETTLED: Final = 1e-10

_REPETITIONS: Final = 8

# What rows at their bounds may give for the levels below [m/s^2], so that a corner has an inside:
# 1e-10 of gravity, a hundredth of what counts as no force.
SLACK: Final = 1e-9

# Rows that the levels above have decided: what is left of them is rounding. Relative, of tasks.
DECIDED: Final = 1e-9


@dataclass(frozen=True, init=False, repr=False)
class Hierarchy:
    """Levels of tasks in strict order; within a level, weights count.

    Parameters
    ----------
    levels : sequence of Task
        Each an argument. The first is never worse for what the others want.

    Raises
    ------
    InvalidArgument
        If there is no level, or a level is no list of tasks.
    """

    levels: tuple[tuple[Task, ...], ...]

    def __init__(self, *levels: Sequence[Task]) -> None:
        if not levels:
            raise InvalidArgument("levels: none; Hierarchy([task, ...], [task, ...]) is needed")
        object.__setattr__(self, "levels", tuple(check_tasks(level) for level in levels))

    def __repr__(self) -> str:
        named = ", ".join(f"[{', '.join(task.name for task in level)}]" for level in self.levels)
        return f"Hierarchy({named})"


def check_tasks(tasks: object) -> tuple[Task, ...]:
    """Return a list of tasks with names of their own, or raise InvalidArgument."""
    if isinstance(tasks, Task):
        raise InvalidArgument("tasks: a list is needed, also for a single task")
    if isinstance(tasks, str) or not isinstance(tasks, Iterable):
        raise InvalidArgument(f"tasks = {tasks!r}: a list of tasks is needed")
    found = tuple(tasks)
    if not found:
        raise InvalidArgument("tasks: none; a controller needs one, such as Posture()")
    for task in found:
        if not isinstance(task, Task):
            levels = "; levels go side by side, Hierarchy([a], [b])"
            nested = levels if isinstance(task, list | tuple) else ""
            raise InvalidArgument(f"tasks: {task!r} is no task{nested}")
    return found


class Cascade:
    """The programs of the levels, each with the memory of its own last answer."""

    def __init__(self, qp: QPSolver, levels: int, regularisation: float) -> None:
        self._chains = [SolverLadder(qp) for _ in range(levels)]
        self._rest = SolverLadder(qp)
        self._regularisation = regularisation

    def solve(
        self, given: Constraints, levels: Sequence[Level], costs: Costs
    ) -> tuple[Array | None, list[ChainAnswer]]:
        """Return x, and the answers of the levels up to the first that has none."""
        if len(levels) == 1:
            return self._at_once(given, levels[0], costs)
        x, Z, off = _start(given)
        if off > tolerances.GIVES or not Z.shape[1]:
            # equations contradict each other, which the chain names, or leave nothing
            return self._at_once(given, levels[0], costs)
        answers: list[ChainAnswer] = []
        for chain, level in zip(self._chains, levels, strict=True):
            if not Z.shape[1]:
                break  # those above leave nothing
            inner = _level_program(given, level, x, Z)
            found = self._answer(chain, inner, -Z.T @ x, lambda: (np.zeros(0), costs()[1]))
            if found.elastic and not answers:  # once more with equations, which may be wishes
                return self._at_once(given, level, costs)
            answers.append(found)
            if found.answer is None or not found.solved:
                return (x if len(answers) > 1 else None), answers  # what those above have, stays
            x = x + Z @ found.answer.x
            z = np.abs(found.answer.z)
            least = PRESSED * (peak(inner.H.diagonal()) + peak(inner.g))
            strictly = z > max(STRICTLY * z.max(initial=0.0), least)
            Z = Z @ null_space(np.vstack((_undecided_rows(level, Z), inner.C[strictly]))).T
        if Z.shape[1]:
            found = self._least(given, x, Z, lambda: (np.zeros(0), costs()[1]))
            answers.append(found)
            if found.answer is not None and found.solved:
                x = x + Z @ found.answer.x
        return x, answers

    def _answer(
        self, chain: SolverLadder, level: QuadraticProgram, centre: Array, costs: Costs
    ) -> ChainAnswer:
        """Return the answer of a level over s, of many that nearest to a centre, but for digits."""
        size = peak(level.H.diagonal())
        if not size > 0.0:  # those above have decided it
            return chain.solve(_regularised(level, self._regularisation, centre), costs)
        eps = min(self._regularisation, _NEARLY_NONE * size)
        found = chain.solve(_regularised(level, eps, centre), costs)
        if found.answer is None or not found.solved:  # flat directions are hard on solvers
            rough = chain.solve(_regularised(level, self._regularisation, centre), costs)
            if rough.answer is None or not rough.solved:
                return rough
            found = rough
            eps = self._regularisation
        for _ in range(_REPETITIONS):
            x = found.answer.x  # type: ignore[union-attr]
            if eps * peak(x - centre) <= _SETTLED * size:
                break
            again = chain.solve(_regularised(level, eps, x), costs)
            if again.answer is None or not again.solved:
                break
            path = found.path if len(again.path) == 1 else found.path + again.path
            found = replace(again, path=path, iterations=found.iterations + again.iterations)
            centre = x
        return found

    def _least(self, given: Constraints, x: Array, Z: Array, costs: Costs) -> ChainAnswer:
        """Return the s of the least |x + Z s|^2: what the last level leaves."""
        C, lower, upper = _remaining_inequalities(given, x, Z)
        none = np.zeros((0, Z.shape[1]))
        program = QuadraticProgram(np.eye(Z.shape[1]), Z.T @ x, none, np.zeros(0), C, lower, upper)
        return self._rest.solve(program, costs)

    def _at_once(
        self, given: Constraints, level: Level, costs: Costs
    ) -> tuple[Array | None, list[ChainAnswer]]:
        """Return the answer of a level with the equations in its program."""
        found = self._chains[0].solve(weighted(given, level), costs)
        return found.answer.x if found.answer else None, [found]


def weighted(constraints: Constraints, level: Level) -> QuadraticProgram:
    """Return the program with the objective of a level."""
    G, b = level.rows
    c, changing, g = G.shape[1], np.zeros(level.W.shape), np.zeros(len(level.H))
    changing[:, :c] = G[level.changing]
    H = changing.T.dot(level.W * changing)
    H += level.H
    g[:c] = (level.weights * -b).dot(G)
    return QuadraticProgram(H, g, *constraints)


def _level_program(given: Constraints, level: Level, x: Array, Z: Array) -> QuadraticProgram:
    """Return the program of a level over s, with the point x = x + Z s at s = 0 feasible."""
    GZ = _undecided_rows(level, Z)
    WG = level.weights[:, None] * GZ
    g = WG.T @ (level.rows.of(x) - level.rows.b)
    none = np.zeros((0, Z.shape[1]))
    return QuadraticProgram(GZ.T @ WG, g, none, np.zeros(0), *_remaining_inequalities(given, x, Z))


def _regularised(level: QuadraticProgram, eps: float, centre: Array) -> QuadraticProgram:
    """Return a program with eps |s - centre|^2 / 2 beside its objective."""
    H = level.H.copy()
    H.ravel()[:: len(H) + 1] += eps
    return replace(level, H=H, g=level.g - eps * centre)


def _remaining_inequalities(given: Constraints, x: Array, Z: Array) -> tuple[Array, Array, Array]:
    """Return the inequalities over s, C Z and its bounds."""
    CZ, Cx = given.C @ Z, given.C @ x
    lower, upper = given.lower - Cx, given.upper - Cx
    # what the levels above left at a bound is there but for rounding
    lower[(lower > -SLACK) & (lower < 10 * SLACK)] = -SLACK
    upper[(upper < SLACK) & (upper > -10 * SLACK)] = SLACK
    decided = (np.linalg.norm(CZ, axis=1) < DECIDED) & (lower <= 0) & (upper >= 0)
    lower[decided], upper[decided] = -np.inf, np.inf
    return CZ, lower, upper


def _undecided_rows(level: Level, Z: Array) -> Array:
    """Return the rows of a level over s; zero where the levels above have decided them."""
    GZ = level.rows.of(Z)
    left, whole = np.linalg.norm(GZ, axis=1), np.linalg.norm(level.rows.G, axis=1)
    GZ[left <= DECIDED * whole] = 0.0  # rounding has any direction
    return GZ


def _start(given: Constraints) -> tuple[Array, Array, float]:
    """Return the smallest x with A x = b, the null space of A, and what A x - b leaves."""
    pinned = given.lower == given.upper
    A, b = np.vstack((given.A, given.C[pinned])), np.append(given.b, given.lower[pinned])
    U, S, Vt = np.linalg.svd(A)
    rank = rank_of(S)
    x = Vt[:rank].T @ ((U[:, :rank].T @ b) / S[:rank])
    return x, Vt[rank:].T, float(np.abs(A @ x - b).max(initial=0.0))


# Levels: tasks at work, whose rows stand below each other, with a name for each.


# What it costs that a row gives: wishes before limits of joints, those before motors, and the floor
# last. Equations of motion and contacts never give.
WISH, JOINT, MOTOR, FLOOR, LAW = 1.0, 1e1, 1e2, 1e3, np.inf


@dataclass(frozen=True, eq=False)
class TaskRow:
    """Name, unit, scale and cost of a row of the program.

    Attributes
    ----------
    name : str
    unit : str
    scale : float
        What a number of the program is in its unit.
    cost : float
        Of giving, where rows contradict each other.
    """

    name: str
    unit: str
    scale: float
    cost: float


class TaskRows(NamedTuple):
    """Rows of tasks: G x = b, as far as they can be had."""

    # G (r, c), b (r,): over the first c unknowns; the others have no part in them
    G: Array
    b: Array

    def of(self, x: Array) -> Array:
        """Return G x of unknowns (n,), or of some at once (n, s)."""
        return self.G.dot(x[: self.G.shape[1]])  # type: ignore[no-any-return]


class Level(NamedTuple):
    """Rows of tasks and what they count: w |G x - b|^2."""

    rows: TaskRows
    weights: Array  # (r,)
    changing: slice | Indices  # the rows of G that change from tick to tick
    W: Array  # (s, n) their weights, for each of their entries; not to be written to
    H: Array  # (n, n) G^T w G of the others, and the regularisation; not to be written to


class Stack:
    """Tasks whose rows stand below each other: accelerations first, then forces.

    tasks: which rows belong to a task
    weights (r,)
    changing: the rows that change from tick to tick
    bound: the tasks at work, in the order of the rows
    """

    def __init__(self, scene: Scene, tasks: Sequence[Task], home: DefaultReference) -> None:
        bound = [(task, task.bind(scene, home)) for task in tasks]
        self.bound = [each for each in bound if each[1].over == "accelerations"]
        self.bound += [each for each in bound if each[1].over == "forces"]
        self.tasks: dict[str, slice] = {}
        self.rows: list[TaskRow] = []
        weights: list[float] = []
        of_a = 0
        for task, each in self.bound:
            start = len(self.rows)
            self.rows += [TaskRow(name, each.unit, 1.0, WISH) for name in each.names]
            weights += [task.weight] * len(each.names)
            self.tasks[task.name] = slice(start, len(self.rows))
            of_a = len(self.rows) if each.over == "accelerations" else of_a
        self.weights = np.array(weights)
        self._J = np.zeros((of_a, scene.robot.nv))
        self._F = np.zeros((len(self.rows) - of_a, scene.rows))
        self._b = np.zeros(len(self.rows))
        self._bind()

    def _bind(self) -> None:
        """Write what does not change, and find where the rest goes."""
        changing: list[int] = []
        self._places = []
        for (task, each), at in zip(self.bound, self.tasks.values(), strict=True):
            of_a = each.over == "accelerations"
            J = self._J[at] if of_a else self._F[at.start - len(self._J) :][: len(each.names)]
            if each.fixed is None:
                changing += range(at.start, at.stop)
            else:
                J[:] = each.fixed
            self._places.append((task.name, each, J, self._b[at]))
        self.changing = entries(np.array(changing, dtype=int))

    @cached_property
    def H(self) -> Array:
        """J^T w J (nv, nv) of the rows that do not change."""
        fixed = [(task.weight, each.fixed) for task, each in self.bound if each.fixed is not None]
        nv = self._J.shape[1]
        return sum((w * J.T @ J for w, J in fixed), np.zeros((nv, nv)))

    def at(self, motion: RobotMotion, t: float) -> tuple[Array, Array, Array]:
        """Return rows of accelerations (r, nv), of forces (s, m), and what they want (r + s,)."""
        # They are in the memory of this object: the next call overwrites them.
        for name, each, J, b in self._places:
            found, wanted = each.rows(motion, t)
            # of arrays at once: `np.shape` takes a microsecond
            if getattr(found, "shape", 0) != J.shape or getattr(wanted, "shape", 0) != b.shape:
                _check_shapes(name, found, wanted, J, b)
            b[:] = wanted
            if each.fixed is None:
                J[:] = found
        return self._J, self._F, self._b


def _check_shapes(name: str, found: ArrayLike, wanted: ArrayLike, J: Array, b: Array) -> None:
    """Refuse rows that would be spread over places that are larger."""
    shapes = np.shape(found), np.shape(wanted)
    if shapes != (J.shape, b.shape):
        raise InvalidArgument(
            f"tasks: {name} has rows J and b of shapes {shapes[0]} and {shapes[1]}: {J.shape} and "
            f"{b.shape} are needed, one row for each of its names"
        )
