"""The smallest scene that still answers the question, found by trying.

Each simplification is made, the accelerations and forces that are asked for are compared with those
of the full scene at the states of the question, and it stays if the errors stay within the limit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.arguments import Arguments
from condyn_pin.arrays import Array, finite
from condyn_pin.catalogue import motor_torque
from condyn_pin.errors import CondynError, InvalidArgument, UnsupportedConstraint
from condyn_pin.robot import Robot
from condyn_pin.scene import Scene
from condyn_pin.smaller.price import Errors, answers, compare, watched_joints
from condyn_pin.smaller.reduction import ReducedScene, reduced
from condyn_pin.smaller.smaller_robot import free_flyers
from condyn_pin.smaller.smaller_tree import indices
from condyn_pin.smaller.suggestions import Suggestion, suggestions
from condyn_pin.solvers.base import Solver
from condyn_pin.solvers.proximal import Proximal
from condyn_pin.timing import Call, State, interleaved
from condyn_pin.workspace import Workspace

_SAMPLES = 10
_ROUNDS = 100


@dataclass(frozen=True)
class Step:
    """A simplification that was tried.

    Attributes
    ----------
    what : str
        What it leaves out, and why that may do.
    kept : bool
    errors : Errors or None
        Of all simplifications so far, this one included; None if it could not be made.
    reason : str
        Why it was not kept; empty if it was.
    """

    what: str
    kept: bool
    errors: Errors | None
    reason: str = ""

    def __str__(self) -> str:
        found = f": errors {self.errors}" if self.errors else ""
        return f"{'kept' if self.kept else 'not kept'}: {self.what}{found}{self.reason}"


@dataclass(frozen=True)
class Minimal:
    """The smaller scene, and what it costs and brings.

    Attributes
    ----------
    scene : ReducedScene
    nv, rows : tuple of int
        Before and after.
    us : tuple of float
        `Workspace.acceleration` before and after [us], medians of one interleaved run on this
        machine; NaN where the solver does not say ok. A measurement, not a promise.
    solver : Solver
        What was timed, and has to take the smaller scene.
    errors : Errors
        Against the full scene.
    limit : float
        The error that was allowed.
    states : int
        States at which the scenes were compared.
    watch : tuple of str
        Joints whose accelerations were compared.
    steps : tuple of Step
        What was tried, in order.
    """

    scene: ReducedScene
    nv: tuple[int, int]
    rows: tuple[int, int]
    us: tuple[float, float]
    solver: Solver
    errors: Errors
    limit: float
    states: int
    watch: tuple[str, ...]
    steps: tuple[Step, ...]

    def __str__(self) -> str:
        return "\n".join(
            [
                f"nv {self.nv[0]} -> {self.nv[1]}, rows {self.rows[0]} -> {self.rows[1]}, "
                f"{self.us[0]:.1f} -> {self.us[1]:.1f} us with {self.solver!r}",
                f"errors at {self.states} states, {self.limit:g} allowed: {self.errors}",
                *map(str, self.steps),
            ]
        )


def minimal(
    scene: Scene,
    *,
    error: float,
    motion: Sequence[Any] | None = None,
    watch: Sequence[str] | None = None,
    solver: Solver | None = None,
) -> Minimal:
    """Return the smaller scene with its report; see `Scene.minimal`."""
    if not 0 < finite("error", error, ()) < 1:
        raise InvalidArgument(f"error = {error!r}: a number between 0 and 1 is needed")
    solver = Proximal() if solver is None else solver
    if not isinstance(solver, Solver):
        raise InvalidArgument(f"solver = {solver!r}: a solver object is needed")
    states = _sampled(scene) if motion is None else _checked(scene, motion)
    asked = _asked(scene, states, watch)
    full = answers(scene, states, asked)
    small = reduced(scene, scene.robot, scene.constraints, states[0][0], ())
    exact_rows = solver.takes_every_kind
    errors = Errors(0.0, 0.0, 0.0, 0.0)
    steps: list[Step] = []
    tried: set[str] = set()
    while (next_one := _untried(small, states, asked, tried, exact_rows)) is not None:
        tried.add(next_one.what)
        step, after = _try(next_one, small, solver, states, asked, full, error)
        steps.append(step)
        if step.kept and step.errors is not None:
            small, errors = after, step.errors
    return Minimal(
        small,
        (scene.robot.nv, small.robot.nv),
        (scene.rows, small.rows),
        _times(scene, small, solver, states),
        solver,
        errors,
        error,
        len(states),
        asked,
        tuple(steps),
    )


def _untried(
    small: ReducedScene,
    states: Sequence[State],
    asked: Sequence[str],
    tried: set[str],
    exact_rows: bool,
) -> Suggestion | None:
    moving = _moving(small.full.robot, small.robot.joints, states)
    proposed = suggestions(small, moving, asked, exact_rows=exact_rows)
    return next((s for s in proposed if s.what not in tried), None)


def _asked(scene: Scene, states: Sequence[State], watch: Sequence[str] | None) -> tuple[str, ...]:
    """Return the joints to watch; by default those of base and motors that the motion moves."""
    joints = watched_joints(scene, watch)
    if watch is not None:
        return joints
    moving = _moving(scene.robot, scene.robot.joints, states)
    kept = (*free_flyers(scene.robot), *(name for name in joints if name in moving))
    return tuple(dict.fromkeys(kept)) or tuple(n for n in scene.robot.joints if n in moving)


def _try(
    suggestion: Suggestion,
    small: ReducedScene,
    solver: Solver,
    states: Sequence[State],
    asked: Sequence[str],
    full: tuple[Array, Array],
    limit: float,
) -> tuple[Step, ReducedScene]:
    """Make a simplification and measure it; the scene comes back as it was if it cannot be made."""
    try:
        after = suggestion.make(small)
        Workspace(after, solver)
        found = answers(after, [_reduce(after, state) for state in states], asked)
    except CondynError as refusal:
        return Step(suggestion.what, kept=False, errors=None, reason=f"; {refusal}"), small
    errors = compare(small.full, full, found)
    good = errors.worst <= limit
    reason = "" if good else f"; {limit:g} is allowed"
    return Step(suggestion.what, kept=good, errors=errors, reason=reason), after if good else small


def _reduce(small: ReducedScene, state: State) -> State:
    q, v, tau = state
    return (*small.reduce_state(q, v), small.reduce_torque(tau))


def _moving(robot: Robot, joints: Sequence[str], states: Sequence[State]) -> set[str]:
    """Return which of some joints the motion moves."""
    model = robot.model
    away = np.zeros(model.nv)
    for q, v, _ in states:
        step = np.array(pin.difference(model, states[0][0], q))
        away = np.maximum(away, np.maximum(np.abs(step), np.abs(v)))
    return {n for n in joints if away[indices(model, [n])[1]].max() > tolerances.CLOSED}


def _sampled(scene: Scene) -> list[State]:
    rng = np.random.default_rng(0)
    return [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(_SAMPLES)]


def _checked(scene: Scene, motion: Any) -> list[State]:
    if isinstance(motion, str) or not isinstance(motion, Iterable):
        raise InvalidArgument(f"motion = {motion!r}: a list of (q, v, tau) is needed")
    check = Arguments(scene.robot.model).check
    states = []
    for k, state in enumerate(motion):
        try:
            q, v, tau = state
        except (TypeError, ValueError) as error:
            raise InvalidArgument(f"motion[{k}]: (q, v, tau) is needed ({error})") from error
        states.append(check(q, v, tau))
    if not states:
        raise InvalidArgument("motion: it is empty; one state (q, v, tau) at least is needed")
    return states


def _times(
    scene: Scene, small: ReducedScene, solver: Solver, states: Sequence[State]
) -> tuple[float, float]:
    after = [_reduce(small, state) for state in states]
    calls: dict[str, Call] = {}
    for label, one, own in (("before", scene, states), ("after", small, after)):
        call = _timed(one, solver, own)
        if call is not None:
            calls[label] = call
    nothing = (np.zeros(0),) * 3
    times = interleaved(calls, [nothing], rounds=_ROUNDS)
    before, then = (times[k].median if k in times else math.nan for k in ("before", "after"))
    return before, then


def _timed(scene: Scene, solver: Solver, states: Sequence[State]) -> Call | None:
    """Return a call on one state after the other, if the solver says ok at all of them."""
    try:
        workspace = Workspace(scene, solver)
    except UnsupportedConstraint:
        return None
    if not all(workspace.solve(*state, throw=False).status.ok for state in states):
        return None
    turn = cycle(states)
    run: Callable[..., Array] = workspace.acceleration
    return lambda q, v, tau: run(*next(turn))
