"""The contract of a measure: which error a study has, against what truth, and what is timed.

1. Add one file to this folder with one frozen dataclass that inherits from `Measure`. Its fields
   are its parameters, each with a default. Set `name`: the class registers itself under it in
   `MEASURES`, and studies and the command line find it there.
2. `truth(scene, state)` is what an answer is compared with: an array, by `Reference`, by a closed
   form, or by a computation that is converged far beyond what is measured. It may take
   milliseconds.
3. `answer(workspace, state, truth, accuracy)` lets a method answer one state, and returns a
   `ComparedAnswer`. `workspace` is what `open(scene, method)` returned: that of a solver, unless
   the measure overrides it; then `asks` is the type of its methods, `methods` their registry, and
   `scenes_of` has the scenes that the name of a robot stands for. An answer that is not finite has
   an infinite error. A `CondynError` that is raised counts as a refusal, and its text is kept.
4. `calls(workspace)` returns what is timed, each called with (q, v, tau): "once", what a user of
   this measure would call; and, where they exist, "bare", Pinocchio's own call behind it, and
   "solve", with the proof. None of them may raise at a state that `answer` took.
5. Parameters that change the question are in `label`, by default all: rows of one label compare
   with each other. Those that belong to the answer, such as a step size, are in `how`.
6. A relative error is relative to something that cannot be zero by accident, and named.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from math import inf, isfinite
from typing import Any, ClassVar

import numpy as np

from condyn_pin._core.arguments import Grid, register
from condyn_pin._core.arrays import Array
from condyn_pin._core.timing import Call, State
from condyn_pin.dynamics.scene import Scene, standard_scenes
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.solvers import SOLVERS, Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import unknown_name
from condyn_pin.model.robot import Robot
from condyn_pin.study.tables import Methods, Parameter

MEASURES: dict[str, type[Measure]] = {}

# The status of an answer that says ok and is wrong.
WRONG = "wrong"


@dataclass(frozen=True)
class ComparedAnswer:
    """One answer, compared with the truth.

    Attributes
    ----------
    error : float
        Relative; infinite if the answer is not finite.
    status : str
        Of the solution, in small letters; "wrong" if it is ok and the error is not.
    dynamics_error, constraint_error : float
        Residuals of the solution [N, N m] and [m/s^2, rad/s^2].
    iterations : int
    """

    error: float
    status: str
    dynamics_error: float  # [N, N m]
    constraint_error: float  # [m/s^2, rad/s^2]
    iterations: int

    @classmethod
    def of(cls, solution: Solution, error: float, promised: float) -> ComparedAnswer:
        """Return the answer of a solution; "wrong" if ok with an error above `promised`."""
        status = solution.status.word
        return cls(
            error=error,
            status=WRONG if status == "ok" and not error <= promised else status,
            dynamics_error=or_inf(solution.dynamics_error),
            constraint_error=or_inf(solution.constraint_error),
            iterations=solution.iterations,
        )


class Measure(ABC):
    """A quantity whose error a study measures; a frozen value."""

    name: ClassVar[str]
    sweeps: ClassVar[tuple[Grid, ...]] = ()  # values of parameters that are worth a look
    asks: ClassVar[type] = Solver  # type of its methods
    methods: ClassVar[Methods] = SOLVERS  # their registry

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        register(MEASURES, cls.name, cls, f"a measure named {cls.name!r}")

    @property
    def label(self) -> str:
        """Label in tables: the name, and the parameters that differ from their defaults."""
        mine = [f.name for f in fields(self) if getattr(self, f.name) != f.default]  # type: ignore[arg-type]
        parameters = ", ".join(f"{name}={getattr(self, name)!r}" for name in mine)
        return f"{self.name}({parameters})" if parameters else self.name

    @property
    def how(self) -> Mapping[str, Parameter]:
        """The parameters that belong to the answer, as rows keep them; none by default."""
        return {}

    def with_how(self, how: Mapping[str, Parameter]) -> Measure:
        """Return the measure with parameters of the answer, as `how` has them."""
        return replace(self, **how)  # type: ignore[type-var]

    def scenes_of(self, robot: Robot) -> Mapping[str, Scene]:
        """Return the scenes that the name of a robot stands for, by label."""
        return standard_scenes(robot)

    def open(self, scene: Scene, method: Any) -> Any:
        """Return the workspace of a method on a scene, for `answer` and `calls`."""
        return Workspace(scene, method)

    @abstractmethod
    def truth(self, scene: Scene, state: State) -> Array:
        """Return the true value at a state, with which answers are compared."""

    @abstractmethod
    def answer(self, workspace: Any, state: State, truth: Array, accuracy: float) -> ComparedAnswer:
        """Return the answer of a method at a state, judged by `truth` and `accuracy`."""

    @abstractmethod
    def calls(self, workspace: Any) -> Mapping[str, Call]:
        """Return the calls to time, by "once", "bare" and "solve"."""


def as_measure(measure: Measure | str) -> Measure:
    """Return a measure; a name stands for the one with default parameters."""
    if isinstance(measure, Measure):
        return measure
    if measure not in MEASURES:
        raise unknown_name("measure", str(measure), MEASURES)
    return MEASURES[measure]()


def relative(x: Array, truth: Array, least: float) -> float:
    """Return |x - truth|_inf over the larger of |truth|_inf and `least`; inf if not finite."""
    with np.errstate(all="ignore"):
        worst = float(np.abs(x - truth).max(initial=0.0))
    if not isfinite(worst):
        return inf
    return worst / (max(float(np.abs(truth).max(initial=0.0)), least) or 1.0)


def solve_without_throw(workspace: Workspace) -> Call:
    """Return `Workspace.solve` with throw=False: no exception, whatever the status."""
    return partial(workspace.solve, throw=False)


def or_inf(x: float) -> float:
    """Return a number that is finite, or infinity."""
    return float(x) if isfinite(x) else inf
