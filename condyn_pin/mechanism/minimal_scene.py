"""The smallest scene with the same motion, and its error.

The smallest scene that still answers the question, found by trying.

Each simplification is made, the accelerations and forces that are asked for are compared with those
of the full scene at the states of the question, and it stays if the errors stay within the limit.

What was chosen by a few random states looks better at them than elsewhere. So the result is judged
again at fresh ones; while the limit does not hold there, the last simplification is undone, and
what it was in the way of is tried.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from typing import Any, TypeVar

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_type, checked_names
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.models import indices
from condyn_pin._core.threads import one_blas_thread
from condyn_pin._core.timing import Call, State, Times, interleaved
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.scene import Scene, check_bilateral, check_not_driven, motor_torque
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import Workspace, default_solver, unsupported_constraints
from condyn_pin.errors import CondynError, InvalidArgument, NotAssembled, UnsupportedConstraint
from condyn_pin.mechanism.reduction import (
    ReducedScene,
    reduced_scene,
)
from condyn_pin.mechanism.suggestions import Suggestion, suggestions
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller import free_flyers

# Minimal: the smaller scene that was found, and what was tried to find it.


@dataclass(frozen=True)
class ReductionStep:
    """A simplification that was tried.

    Attributes
    ----------
    what : str
        What it leaves out, and why that may do.
    kept : bool
        Whether the step was kept.
    errors : ReductionErrors or None
        Of all simplifications so far, this one included; None if it could not be made.
    reason : str
        Why it was not kept; empty if it was.
    """

    what: str
    kept: bool
    errors: ReductionErrors | None
    reason: str = ""

    def __str__(self) -> str:
        found = f": errors {self.errors}" if self.errors else ""
        return f"{'kept' if self.kept else 'not kept'}: {self.what}{found}{self.reason}"


@dataclass(frozen=True)
class Minimal:
    """The smaller scene, its error, and its speed.

    Attributes
    ----------
    scene : ReducedScene
    nv, rows : tuple of int
        Before and after.
    us : tuple of float
        `Workspace.acceleration` before and after [us], medians of one interleaved run on this
        machine; NaN where the solver does not say ok. A measurement, not a promise.
    said : tuple of str
        What the solver says before and after: "ok", or why it was not timed.
    solver : Solver
        The solver that was timed, and that takes the smaller scene.
    errors : ReductionErrors
        Against the full scene, at random states that no simplification was tried at; at those of
        the motion if one was given.
    limit : float
        The error that was allowed.
    states : int
        States that the errors are of.
    watch : tuple of str
        Joints whose accelerations were compared.
    steps : tuple of ReductionStep
        What was tried, in order.
    """

    scene: ReducedScene
    nv: tuple[int, int]
    rows: tuple[int, int]
    us: tuple[float, float]
    said: tuple[str, str]
    solver: Solver
    errors: ReductionErrors
    limit: float
    states: int
    watch: tuple[str, ...]
    steps: tuple[ReductionStep, ...]

    def __str__(self) -> str:
        timed = [
            f"{us:.1f} us" if math.isfinite(us) else said
            for us, said in zip(self.us, self.said, strict=True)
        ]
        return "\n".join(
            [
                f"nv {self.nv[0]} -> {self.nv[1]}, rows {self.rows[0]} -> {self.rows[1]}, "
                f"{timed[0]} before, {timed[1]} after, with {self.solver!r}",
                f"errors at {self.states} states, {self.limit:g} allowed: {self.errors}",
                *map(str, self.steps),
            ]
        )


# The price of a smaller scene: what it changes in the accelerations and forces that are asked for.
#
# At the same motion, of two scenes with the joints that are watched in common,
#
#     error of a      = |a_small - a_full|_inf / max(|a_full|_inf, g)
#     error of forces = |f_small - f_full|_inf / max(|f_full|_inf, m g)
#
# with a the accelerations of the watched joints, and f the wrench of all contacts on the floating
# base: the rows of the free-flyer in M a + h - tau = J^T lam, to which loops add nothing. It is
# unique also where the forces of single contacts are not. Moments count by the metre.


# Without corrections: errors of a model are not looked for below 1e-10.
_REFERENCE = Reference(refinements=0)


@dataclass(frozen=True)
class ReductionErrors:
    """Relative errors over some states: the worst and the median of each.

    Attributes
    ----------
    a_worst, a_median : float
        Of accelerations, over the larger of the largest of them and gravity.
    force_worst, force_median : float
        Of the wrench of all contacts, over the larger of it and the weight.
    """

    a_worst: float
    a_median: float
    force_worst: float
    force_median: float

    def __str__(self) -> str:
        return (
            f"a {self.a_worst:.1e} (median {self.a_median:.1e}), "
            f"contact wrench {self.force_worst:.1e} (median {self.force_median:.1e})"
        )

    @property
    def worst(self) -> float:
        """The larger one of the two worst errors."""
        return max(self.a_worst, self.force_worst)


def answers(scene: Scene, states: Sequence[State], joints: Sequence[str]) -> tuple[Array, Array]:
    """Return accelerations of the watched joints and contact wrenches, a line a state."""
    # The wrenches have no columns if the robot does not float or touches nothing.
    equations = equations_of(scene)
    _, watched = indices(scene.robot.model, joints)
    _, base = indices(scene.robot.model, free_flyers(scene.robot) if scene.rows else ())
    found_a, found_f = [], []
    for q, v, tau in states:
        terms = equations.terms(q, v)
        a, lam = _REFERENCE.solve(terms, tau)
        found_a.append(a[watched])
        found_f.append((terms.J.T @ lam)[base])
    return np.array(found_a), np.array(found_f)


def compare(scene: Scene, full: tuple[Array, Array], small: tuple[Array, Array]) -> ReductionErrors:
    """Return the errors of the answers of a smaller scene against those of the full one."""
    estimator = scene.nominal.estimator
    a = _relative(full[0], small[0], estimator.gravity)
    f = _relative(full[1], small[1], scene.nominal.weight)
    return ReductionErrors(float(a.max()), float(np.median(a)), float(f.max()), float(np.median(f)))


def _relative(full: Array, small: Array, floor: float) -> Array:
    if full.shape[1] == 0:
        return np.zeros(len(full))
    size = np.maximum(np.abs(full).max(axis=1), floor)
    errors: Array = np.abs(small - full).max(axis=1) / size
    return errors


# The smallest scene that still answers the question, found by trying.


_SAMPLES = 10  # states that simplifications are chosen by
_FRESH = 50  # states that the result is judged by
_ROUNDS = 100
_NONE = ReductionErrors(0.0, 0.0, 0.0, 0.0)


@one_blas_thread
def minimal(
    scene: Scene,
    *,
    error: float,
    motion: Sequence[Any] | None = None,
    watch: Sequence[str] | None = None,
    solver: Solver | None = None,
) -> Minimal:
    """Return a smaller scene that answers the same question within an error.

    Tried in this order, each kept if the errors stay within the limit: joints that do not move
    are locked, points of contact merged, implied constraints left out, linkages that only
    follow reflected onto what they follow, rods replaced by distances, balls of planar
    linkages by planar pins.

    Parameters
    ----------
    scene : Scene
    error : float
        Largest relative error of accelerations and contact wrench that is allowed.
        Zero allows only what is exact, to 1e-9.
    motion : sequence of (q, v, tau), optional
        Closed states that matter, by which everything is judged. By default random ones, in
        which every joint moves: some to choose by, 50 others to judge by.
    watch : sequence of str, optional
        Joints whose accelerations are asked for; by default the floating base and the motors
        that the motion moves, or all that it moves if it moves neither.
    solver : Solver, optional
        The solver that has to take the smaller scene, and is timed; by default that of `solve`.
        Proximal() takes neither distances nor planar pins, DenseKKT() does.

    Returns
    -------
    Minimal
        The scene, sizes and times before and after, the errors, and every step in words.

    Raises
    ------
    InvalidArgument
        If an argument is none of these, or nothing would be left to move.
    UnsupportedConstraint
        If the scene has contacts that may open: what it does without is measured on accelerations.
    NotAssembled
        If a state of the motion is not on the constraints; the text says which.
    """
    if not 0 <= finite("error", error, ()) < 1:
        raise InvalidArgument(f"error = {error!r}: a number from 0 to below 1 is needed")
    check_bilateral(scene)
    check_not_driven(scene, "minimal")
    limit = max(float(error), tolerances.EXACT)
    solver = default_solver(scene) if solver is None else solver
    check_type("solver", solver, Solver, "a solver object is needed")
    states = sampled(scene, 0, _SAMPLES) if motion is None else checked_states(scene, motion)
    asked = _watched_joints(scene, states, watch)
    question = judge = _ReferenceMotion(scene, states, asked)
    if motion is None:
        judge = _ReferenceMotion(scene, sampled(scene, 1, _FRESH), asked)
    search = _Search(question, solver, limit)
    errors = None
    while errors is None:
        search.run()
        errors = search.verified(judge)
    small = search.scenes[-1]
    us, said = _times(scene, small, solver, states)
    return Minimal(
        scene=small,
        nv=(scene.robot.nv, small.robot.nv),
        rows=(scene.rows, small.rows),
        us=us,
        said=said,
        solver=solver,
        errors=errors,
        limit=limit,
        states=len(judge.states),
        watch=asked,
        steps=tuple(search.steps),
    )


class _ReferenceMotion:
    """Accelerations and contact wrenches of the full scene, to compare smaller scenes with."""

    def __init__(self, scene: Scene, states: Sequence[State], asked: tuple[str, ...]) -> None:
        self.scene, self.states, self.asked = scene, states, asked
        self.full = answers(scene, states, asked)

    def errors(self, small: ReducedScene) -> ReductionErrors:
        """Return the errors of a smaller scene, or raise the CondynError that prevents them."""
        found = answers(small, [_reduce(small, state) for state in self.states], self.asked)
        return compare(self.scene, self.full, found)


class _Search:
    """Simplifications that were tried, in order, and the scene after each that is kept."""

    def __init__(self, question: _ReferenceMotion, solver: Solver, limit: float) -> None:
        self.question, self.solver, self.limit = question, solver, limit
        scene, q = question.scene, question.states[0][0]
        self.scenes = [reduced_scene(scene, scene.robot, scene.constraints, q, ())]
        self.steps: list[ReductionStep] = []

    def run(self) -> None:
        """Try the simplifications that were not tried yet."""
        while (suggestion := self._untried()) is not None:
            errors = None
            try:
                after = suggestion.make(self.scenes[-1])
                Workspace(after, self.solver)
                errors = self.question.errors(after)
                good = errors.worst <= self.limit
                reason = "" if good else f"; {self.limit:g} is allowed"
            except CondynError as refusal:
                good, reason = False, f"; {refusal}"
            self.steps.append(ReductionStep(suggestion.what, good, errors, reason))
            if good:
                self.scenes.append(after)

    def verified(self, judge: _ReferenceMotion) -> ReductionErrors | None:
        """Return the errors of the last scene if they are within the limit, or take it back."""
        if len(self.scenes) == 1:
            return _NONE
        errors = None
        said = f" at {len(judge.states)} other states; {self.limit:g} is allowed, so undone"
        try:
            errors = judge.errors(self.scenes[-1])
        except CondynError as refusal:
            said = f"; {refusal}"
        if errors is not None and errors.worst <= self.limit:
            return errors
        self.scenes.pop()
        last = max(i for i, step in enumerate(self.steps) if step.kept)
        self.steps[last] = replace(self.steps[last], kept=False, errors=errors, reason=said)
        return None

    def _untried(self) -> Suggestion | None:
        small, tried = self.scenes[-1], {step.what for step in self.steps}
        moving = _moving(small.full.robot, small.robot.joints, self.question.states)
        exact_rows = self.solver.takes_every_kind
        proposed = suggestions(small, moving, self.question.asked, exact_rows=exact_rows)
        return next((s for s in proposed if s.what not in tried), None)


def _watched_joints(
    scene: Scene, states: Sequence[State], watch: Sequence[str] | None
) -> tuple[str, ...]:
    """Return the joints to watch; by default the base, and those with motors that move."""
    # Without motors all that move.
    robot = scene.robot
    if watch is not None:
        return checked_names("watch", watch, robot.joints, "joint")
    base, moving = free_flyers(robot), _moving(robot, robot.joints, states)
    kept = (*base, *(name for name in robot.motor_joints or robot.joints if name in moving))
    return tuple(dict.fromkeys(kept)) or tuple(n for n in robot.joints if n in moving)


def _reduce(small: ReducedScene, state: State) -> State:
    q, v, tau = state
    return (*small.reduce_state(q, v), small.reduce_torque(tau))


def _moving(robot: Robot, joints: Sequence[str], states: Sequence[State]) -> set[str]:
    """Return the joints, among some, that the motion moves."""
    model = robot.model
    away = np.zeros(model.nv)
    for q, v, _ in states:
        step = np.array(pin.difference(model, states[0][0], q))
        away = np.maximum(away, np.maximum(np.abs(step), np.abs(v)))
    return {n for n in joints if away[indices(model, [n])[1]].max() > tolerances.CLOSED}


def _times(
    scene: Scene, small: ReducedScene, solver: Solver, states: Sequence[State]
) -> tuple[tuple[float, float], tuple[str, str]]:
    """Return times before and after [us], and what the solver said."""
    before = trial(scene, solver, states)
    after = trial(small, solver, [_reduce(small, state) for state in states])
    times = time_trials({"before": before, "after": after}, rounds=_ROUNDS)
    first, then = (times[k].median if k in times else math.nan for k in ("before", "after"))
    return (first, then), (before.said, after.said)


# The states at which a smaller scene is compared.


def sampled(scene: Scene, seed: int, count: int) -> list[State]:
    """Return random closed states, with torques of the motors."""
    rng = np.random.default_rng(seed)
    return [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(count)]


def checked_states(scene: Scene, motion: Any) -> list[State]:
    """Return the states of a motion, or raise InvalidArgument or NotAssembled."""
    if isinstance(motion, str) or not isinstance(motion, Iterable):
        raise InvalidArgument(f"motion = {motion!r}: a list of (q, v, tau) is needed")
    check = scene.robot.arguments.check
    states = []
    for k, state in enumerate(motion):
        try:
            q, v, tau = state
        except (TypeError, ValueError) as error:
            raise InvalidArgument(f"motion[{k}]: (q, v, tau) is needed ({error})") from error
        try:
            q, v, tau = check(q, v, tau)
            scene.check(q, v).raise_if_open()
        except InvalidArgument as error:
            raise InvalidArgument(f"motion[{k}]: {error}") from error
        except NotAssembled as error:
            raise NotAssembled(f"motion[{k}]: {error}", error.assembly) from error
        states.append((q, v, tau))
    if not states:
        raise InvalidArgument("motion: it is empty; one state (q, v, tau) at least is needed")
    return states


# Trials: solvers tried on scenes, and timed beside each other where they say ok.


_Key = TypeVar("_Key", bound=Hashable)


@dataclass(frozen=True)
class Trial:
    """A solver tried on a scene: "ok" and the call to time, or the reason for no time.

    The call goes from one state to the next, and does not check its arguments: scenes that are
    compared do not share their states.
    """

    call: Call | None
    said: str


def trial(scene: Scene, solver: Solver, states: Sequence[State]) -> Trial:
    """Return the trial of a solver: a call to time if it solves the scene at every state."""
    try:
        workspace = Workspace(scene, solver)
    except UnsupportedConstraint:
        missing = [c for c in scene.constraints if c.name in unsupported_constraints(scene, solver)]
        kinds = dict.fromkeys(str(getattr(c, "kind", type(c).__name__)) for c in missing)
        return Trial(None, f"takes no {' and no '.join(kinds)}")
    for state in states:
        status = workspace.solve(*state, throw=False).status
        if not status.ok:
            return Trial(None, status.word)
    turn = cycle(states)
    return Trial(lambda q, v, tau: workspace.acceleration(*next(turn)), "ok")


def time_trials(
    trials: Mapping[_Key, Trial], *, rounds: int, repeats: int = 10
) -> dict[_Key, Times]:
    """Return the times of the trials that have a call, in one interleaved run."""
    calls = {name: one.call for name, one in trials.items() if one.call is not None}
    nothing = (np.zeros(0),) * 3
    return interleaved(calls, [nothing], rounds=rounds, repeats=repeats)
