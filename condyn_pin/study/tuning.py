"""tune and tuned: a solver chosen by a short study, and the choice looked up again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, cast

from condyn_pin._core.arguments import check_called
from condyn_pin._core.timing import machine
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.errors import CondynError, NotReached, NotTuned
from condyn_pin.study import plan as plans
from condyn_pin.study.bench import Progress, silent
from condyn_pin.study.cheapest import Choice, check_error, made, promising, solver_of
from condyn_pin.study.clocks import TimingEffort
from condyn_pin.study.method import Method
from condyn_pin.study.plan import Plan, fingerprint
from condyn_pin.study.row import Row
from condyn_pin.study.study import Study
from condyn_pin.study.table import Table

# All that meet the error are timed at a glance, those near the fastest are looked at.
_GLANCE: Final = TimingEffort(rounds=10, repeats=2, overhead=False)
_LOOK: Final = TimingEffort(rounds=100, overhead=False)
_NEAR: Final = 1.5


def tune(
    scene: Scene,
    error: float = SOLVED,
    *,
    measure: str = "acceleration",
    solvers: Sequence[Method] | None = None,
    progress: Progress = silent,
    save: bool = True,
) -> Solver:
    """Return the fastest solver that meets an error on a scene, by a short study.

    Parameters
    ----------
    scene : Scene
    error : float
        The worst that is good enough, relative, as in `Row.error_worst`.
    measure : str
        A name of `MEASURES`: what is timed, and what the error is one of.
    solvers : sequence of Solver, optional
        What to choose from; as in `Study` by default: all, with the parameters that are worth a
        look.
    progress : callable
        Called with (what, done, total).
    save : bool
        Keep the choice on this machine, where `tuned` finds it.

    Returns
    -------
    Solver, or ContactSolver for the measure ``contact``
        Its `accuracy` is the error that was asked for, so that `solve` says ok to it; 1e-8 where
        that was less.

    Raises
    ------
    NotReached
        If no solver meets the error; nothing is kept.
    NotAssembled
        If the loops of the scene cannot be closed.

    Notes
    -----
    Takes from seconds to half a minute. On a machine that is busy with other work, another solver
    may seem the fastest.
    """
    if save:
        plans.check_folder()
    choice = choose(scene, error, measure=measure, solvers=solvers, progress=progress)
    if save:
        keep(scene, choice)
    return cast(Solver, choice.solver)  # or a contact solver, where the measure asks those


def choose(
    scene: Scene,
    error: float,
    *,
    measure: str,
    solvers: Sequence[Method] | None,
    progress: Progress,
) -> Choice:
    """Return what `tune` chooses, with all that was found of it; nothing is kept."""
    check_scene(scene)
    check_error(error)
    check_called("progress", progress, "what, done, total")
    seen = Study(scene, solvers, measure=measure).run(timed=False, progress=progress)
    label, asked = seen.rows[0].scene, seen.rows[0].measure
    meeting = [row for row in seen.rows if row.answered and row.error_worst <= error]
    if not meeting:
        return seen.cheapest(error, measure=asked)  # raises, with the best that was found
    glance = _timed(seen.scenes[label], meeting, _GLANCE, measure, progress)
    rows = [row for row in glance.rows if row.comparable]
    near = [row for row in rows if row.us <= _NEAR * min(r.us for r in rows)]
    looked = _timed(seen.scenes[label], near, _LOOK, measure, progress)
    try:
        return looked.cheapest(error, measure=asked)
    except NotReached:  # all that are near the fastest fail at fresh states: slower ones may not
        return glance.cheapest(error, measure=asked)


def _timed(
    scene: Scene, rows: Sequence[Row], effort: TimingEffort, measure: str, progress: Progress
) -> Table:
    solvers = [solver_of(row) for row in rows]
    return Study(scene, solvers, measure=measure, effort=effort).run(progress=progress)


def tuned(scene: Scene, error: float = SOLVED, *, measure: str = "acceleration") -> Solver:
    """Return the solver that `tune` chose for this scene, on this machine, with these versions.

    Parameters
    ----------
    scene : Scene
        One with the same content; it need not be the same object.
    error : float
        The same that `tune` was asked for.
    measure : str

    Returns
    -------
    Solver

    Raises
    ------
    NotTuned
        If there is no such plan; the text says what there is, and the line that makes one.

    Notes
    -----
    Reads a file, and writes the model as text to recognise it, which takes milliseconds: call it
    once, not in a loop.
    """
    check_scene(scene)
    check_error(error)
    found = fingerprint(scene)
    path = plans.path_of(found, measure, error)
    call = _call(error, measure)
    if not path.exists():
        raise NotTuned(f"no plan for this scene to {error:g}{_others(found)}; {call} makes one")
    try:
        plan = plans.read(path)
        return cast(Solver, promising(made(plan.solver, plan.parameters), error))
    except CondynError as reason:
        raise NotTuned(f"{reason}; {call} makes a new one") from reason


def _call(error: float, measure: str) -> str:
    more = "" if measure == "acceleration" else f", measure={measure!r}"
    return f"condyn_pin.study.tune(scene, {error:g}{more})"


def _others(found: str) -> str:
    """Say which plans of the scene there are, and why they are of no use here."""
    here, said = plans.here(), []
    for plan in plans.plans_of(found):
        differs = [
            f"{key} {plan.where.get(key)}" for key in here if plan.where.get(key) != here[key]
        ]
        said.append(
            f"{plan.measure} to {plan.error:g}" + (f" with {differs[0]}" if differs else "")
        )
    return f" (there is one for {', '.join(said)})" if said else ""


def keep(scene: Scene, choice: Choice) -> Plan:
    """Write what was chosen for a scene where `tuned` finds it."""
    plan = plan_for(scene, choice)
    plans.keep(plan)
    return plan


def plan_for(scene: Scene, choice: Choice) -> Plan:
    """Return the plan of what was chosen for a scene."""
    return Plan(
        fingerprint=fingerprint(scene),
        measure=choice.row.measure,
        error=choice.error,
        solver=type(choice.solver).__name__,
        parameters=dict(choice.row.parameters),
        median_us=choice.row.us,
        found=choice.fresh.error,
        expected=choice.fresh.expected,
        states=choice.fresh.states,
        where=plans.here(),
        date=machine()["date"],
    )
