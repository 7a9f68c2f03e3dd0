"""Notices: what deserves attention in a trajectory, a sentence each."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from math import pi
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import lengths
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.rows.bound import largest_violation
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import (
    Sites,
    Solution,
    pull_text,
    pulling,
    shared_normals,
    shared_text,
    upward,
)
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import CondynError
from condyn_pin.mechanism.rank import check
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.measures import gauge_of
from condyn_pin.simulation.motion_status import (
    LARGER,
    energy_cure,
    energy_fault,
    left_open,
    of_a_step,
    opening_cure,
    smallest_energy,
    unexplained_energy,
)
from condyn_pin.simulation.plan import default_solver
from condyn_pin.simulation.records import Phase
from condyn_pin.simulation.torques import Passive
from condyn_pin.simulation.unmodelled_contacts import bodies_passed, limits_passed
from condyn_pin.stepping.single_step import ProvedSteps

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory

# Samples of a phase that are checked. A solver that does not converge misses at most of them.
_LOOKS: Final = 20

# Energy in or out that an error is compared with, as a share of what was exchanged, at least.
_LITTLE: Final = 0.1

# Order of the methods that are advised where others are not accurate.
_HIGH: Final = 4

# What the fastest joint turns by in a step that is worth naming [rad].
_FAST: Final = 0.05

# Times of samples [s], and answers there.
Answers = list[tuple[float, Solution]]

# Numbers in a sentence.
_NUMBER: Final = re.compile(r"\d+(\.\d+)?(e[-+]?\d+)?")


def notices_of(trajectory: Trajectory) -> tuple[str, ...]:
    """Warnings about a motion: its end, gaps, solutions, pulls, energy, error and limits."""
    said = []
    if not trajectory.status.ok:
        said.append(f"{trajectory.status}; {trajectory.reason}")
    went_on = trajectory.run.status.ok
    said += _open_constraints(trajectory)
    said += [str(remark) for remark in trajectory.run.remarks]
    said += _stays_deep(trajectory)
    said += _coarse_turns(trajectory) + _differenced(trajectory) + _shocks(trajectory)
    answers = _answers(trajectory) if went_on and not trajectory.contact else []
    said += solver_notices(trajectory, answers) + _tensile_contacts(trajectory)
    if np.isfinite(trajectory.energy.error).all():  # else the run was lost
        said += _energy(trajectory)
    said += _error(trajectory) if went_on else []
    said += [*limits_passed(trajectory), *bodies_passed(trajectory)]
    return tuple(said + answer_notices(trajectory, answers))


def _open_constraints(trajectory: Trajectory) -> list[str]:
    """Return a sentence on the largest gap, if it is larger than a closed state has."""
    violation, course = trajectory.violation, trajectory.course
    largest, first = float(violation.max()), float(violation[0])
    if not largest > tolerances.NEARLY_CLOSED or left_open(course):  # its status says it
        return []
    if first > tolerances.NEARLY_CLOSED and largest < LARGER * first:
        left = float(violation[-1])
        return [
            f"the constraints were open by {first:.2g} m or rad at the start, as close_start=False "
            f"allows, and are by {left:.2g} at the end"
        ]
    when = int(violation.argmax())
    t = float(trajectory.t[when])
    scene = course.scene_at(when).at(t)
    name, gap = largest_violation(check(scene, trajectory.q[when], None).violation)
    return [f"{name} is open by {gap} at t = {t:.4g} s: {opening_cure(trajectory.run.solver)}"]


def _energy(trajectory: Trajectory) -> list[str]:
    """Return sentences on energy that no work accounts for, and on what steps added."""
    course, energy, said = trajectory.course, trajectory.energy, []
    rest, least, scale = unexplained_energy(course), smallest_energy(course), energy.scale
    if not energy.passed > least:  # half a step late, energy is not lost
        rest = np.maximum(rest - 0.5 * of_a_step(course), 0.0)
    most, share = float(rest.max(initial=0.0)), tolerances.BALANCED
    # of what went in or out, unless that is next to nothing beside what went to and fro
    limit = max(least, share * max(min(energy.passed, scale), _LITTLE * scale))
    status_says = trajectory.run.status.ok and energy_fault(course)
    if not most <= limit and not status_says:
        t = float(trajectory.t[int(rest.argmax())])
        passed = f", {energy.passed:.3g} J in or out" if energy.passed < scale else ""
        said.append(
            f"{most:.3g} J of energy appeared or vanished without work until t = {t:.4g} s, of "
            f"{scale:.3g} J exchanged{passed}: {energy_cure(course)}"
        )
    if (added := float(energy.algorithmic[-1])) > max(least, share * scale):
        said.append(
            f"steps added {added:.3g} J that no contact would, of {scale:.3g} J exchanged: use a "
            "smaller dt"
        )
    return said


def _error(trajectory: Trajectory) -> list[str]:
    """Return a sentence on the estimated error of a motion by fixed steps, if it is large."""
    run, (off, moved, size, turned) = trajectory.run, trajectory._error
    if not off > max(run.limits.error * moved, tolerances.HARDLY_OFF * size):
        return []
    order, cures = run.integrator.order.q, ["a smaller dt"]
    if not trajectory.contact:
        cures += ["RungeKutta4()"] * (order < _HIGH) + ["DormandPrince()"]
    turns = f", in which the fastest joint turns by {turned:.2g} rad" if turned > _FAST else ""
    return [
        f"bodies that moved by {moved:.2g} m may be off by {off:.2g} m at the end, estimated by "
        f"doubled steps: {run.integrator.title} of order {order} in steps of "
        f"{1e3 * run.dt:.4g} ms{turns}; use {' or '.join(cures)}"
    ]


def _stays_deep(trajectory: Trajectory) -> list[str]:
    """Return a sentence on the contact that carries deepest in another body, if none pushes out."""
    scheme, record = trajectory.run.integrator, trajectory.contact
    if not isinstance(scheme, ContactScheme) or scheme.closes_gaps or scheme.penetrates_at_rest:
        return []
    deepest, name, when = 0.0, "", 0
    for each, modes in (record.modes if record else {}).items():
        if each not in trajectory.gaps:  # dry friction
            continue
        deep = np.where(modes != "open", -trajectory.gaps[each], 0.0)
        i = int(np.nanargmax(deep))
        if deep[i] > deepest:
            deepest, name, when = float(deep[i]), each, i
    if not deepest > tolerances.NEARLY_CLOSED:
        return []
    return [
        f"{name} is {deepest:.3g} m or rad deep at t = {trajectory.t[when]:.4g} s: "
        f"steps of {scheme.title} do not push out what an impact takes in, up to dt times its "
        "speed; take a smaller dt, StewartTrinkle(), or EventDriven()"
    ]


def _coarse_turns(trajectory: Trajectory) -> list[str]:
    """Return a sentence on the joint that turns fastest, if by half a turn a step or more."""
    run, model = trajectory.run, trajectory.scene.robot.model
    if run.integrator.between_events.is_adaptive:
        return []
    speed, curved = np.abs(trajectory.v).max(axis=0), dict(Manifold(model).turns)
    turns = {
        model.names[i]: float(speed[joint.idx_v + k])
        for i, joint in enumerate(list(model.joints)[1:], start=1)
        for k, length in enumerate(lengths(joint))
        if not length and model.names[i] not in curved
    } | {
        name: float(np.linalg.norm(trajectory.v[:, at], axis=1).max())
        for name, at in curved.items()
    }
    turns = {joint: speed for joint, speed in turns.items() if speed * run.dt > pi}
    if not turns or not run.status.ok:
        return []
    joint = max(turns, key=turns.__getitem__)
    what = "too much to resolve its effect on other joints"
    if joint in curved:  # others end the run
        what = "right for a ball, too much to resolve what is fixed to it off its centre"
    return [
        f"joint {joint!r} turns by {turns[joint] * run.dt:.3g} rad in a step of {run.dt:.3g} s, "
        f"{what}: take dt below {pi / turns[joint]:.2g} s"
    ]


def _shocks(trajectory: Trajectory) -> list[str]:
    """Return a sentence for each instant in which friction took an impulse although nothing hit."""
    return [
        f"{event.name} at t = {event.t:.4g} s: no force lets it slide on (Painlevé), and an "
        "impulse has stopped it"
        for event in trajectory.run.happened
        if event.is_of_contacts and event.name.startswith("shock of ")
    ]


def _differenced(trajectory: Trajectory) -> list[str]:
    """Return a sentence on torques that were stiff, and what their differences cost."""
    calls, nv = trajectory.run.differenced, trajectory.scene.robot.nv
    if not calls:
        return []
    return [
        f"tau(t, q, v) is stiff, and was called {calls} times for its differences, {2 * nv + 1} "
        "times per step: pass jacobian=... to avoid them"
    ]


def solver_notices(trajectory: Trajectory, answers: Answers | None = None) -> list[str]:
    """Return a sentence on the error of the accelerations, if it is larger than its solver's."""
    # A run calls the hot loop, which proves nothing, and a drift scheme closes what a wrong a has
    # opened: the constraints hold, and the motion is another one. So some samples are solved once
    # more, with the proof that `solve` gives. Nothing is said of a run that broke down, nor of a
    # solver that answers another question; nor of contacts that open, proved in every step.
    run = trajectory.run
    rows = any(phase.scene.rows for phase in trajectory.phases)
    if not (run.status.ok and run.solver.exact and rows) or trajectory.contact:
        return []
    answers = _answers(trajectory) if answers is None else answers
    largest, when = max((each.error_bound, t) for t, each in answers)
    if largest <= run.solver.accuracy:
        return []
    return [
        f"the accelerations may be off by {largest:.2g}, relative, at t = {when:.4g} s: give "
        f"{run.solver.title} more iterations or a smaller mu, or take Proximal() or Reference()"
    ]


def answer_notices(trajectory: Trajectory, answers: Answers) -> list[str]:
    """Return the notices of `answers`, or of steps, at some samples: each once, with its time."""
    # Two that differ in their numbers alone are one.
    run = trajectory.run
    if not (run.status.ok and run.solver.exact):
        return []
    digits = [phase.scene.nominal.digits for phase in trajectory.phases]
    of_file = {each.note for each in digits if each}  # is of the scene, not of its motion
    if isinstance(run.integrator, ContactScheme):
        found = _step_notices(trajectory)
    elif trajectory.contact:
        return []  # modes have rows of their own between events
    else:
        found = [
            (t, notice)
            for t, answer in answers
            for notice in answer.notices
            if notice not in of_file  # and the largest pull is said below
            and notice not in pulling(answer.forces, Sites(answer.scene, answer.q))
        ]
    said: dict[str, str] = {}
    remarked = [str(remark) for remark in run.remarks]
    for t, notice in found:
        if not any(notice in remark for remark in remarked):
            said.setdefault(_NUMBER.sub("#", notice), f"t = {t:.4g} s: {notice}")
    return list(said.values())


def _answers(trajectory: Trajectory) -> Answers:
    """Return times of some samples [s], and the answers there with their proof."""
    return [each for phase in trajectory.phases for each in _answers_in(trajectory, phase)]


def _answers_in(trajectory: Trajectory, phase: Phase) -> Iterator[tuple[float, Solution]]:
    run, effects = trajectory.run, trajectory.run.effects
    by_default = run.solver == default_solver(trajectory.phases[-1].scene)
    solver = default_solver(phase.scene) if by_default else run.solver
    workspace = Workspace(phase.scene.at(0.0), solver, drift=run.drift.rows)
    passive = Passive.of(phase.scene.robot, springs=effects.springs, damping=effects.damping)
    start, stop = phase.samples.start, phase.samples.stop
    for i in np.unique(np.linspace(start, stop - 1, _LOOKS).astype(int)):
        t, q, v = float(trajectory.t[i]), trajectory.q[i], trajectory.v[i]
        tau = trajectory.tau[i] + passive.torque(q, v)
        workspace.equations.at(t)
        yield t, workspace.solve(q, v, tau, throw=False)


def _step_notices(trajectory: Trajectory) -> list[tuple[float, str]]:
    """Warnings of the steps with contacts that begin at some samples, and their times [s]."""
    run, found = trajectory.run, []
    scheme, effects = run.integrator, run.effects
    if not isinstance(scheme, ContactScheme) or not (effects.springs and effects.damping):
        return []
    for phase in trajectory.phases:
        steps = None
        for i in _telling(trajectory, phase):
            t = float(trajectory.t[i])
            with suppress(CondynError):  # a path that leads on no further, at the last sample
                if steps is None or phase.scene.is_driven:
                    steps = ProvedSteps(phase.scene.at(t), run.dt, scheme)
                step = steps.step(trajectory.q[i], trajectory.v[i], trajectory.tau[i], ())
                found += [(t, notice) for notice in step.notices]
    return found


def _telling(trajectory: Trajectory, phase: Phase) -> list[int]:
    """Return samples of a phase to look at: some spread over it, and some where modes change."""
    start, stop = phase.samples.start, phase.samples.stop
    looks = set(np.linspace(start, stop - 1, _LOOKS // 2).astype(int).tolist())
    if trajectory.contact:
        codes = trajectory.contact.codes[start:stop]
        changes = start + np.flatnonzero((codes[1:] != codes[:-1]).any(axis=1))
        spread = np.linspace(0, len(changes) - 1, min(_LOOKS // 2, len(changes)))
        looks |= set(changes[spread.astype(int)].tolist())
    return sorted(looks)


def _tensile_contacts(trajectory: Trajectory) -> list[str]:
    """Return a sentence for each contact that pulls, with the largest pull and its time."""
    # A run keeps its contacts until an event takes them off: between events they are bilateral.
    forces = trajectory.forces
    worst: dict[str, tuple[float, float, Constraint]] = {}  # normal force [N], t [s]
    together: tuple[float, str] = (0.0, "")  # of contacts that share a load [N], and the sentence
    least = -tolerances.SOLVED * float(np.abs(trajectory.lam).max(initial=0.0))
    for phase in trajectory.phases:
        t, q = trajectory.t[phase.samples], trajectory.q[phase.samples]
        normals: dict[str, Array] = {}
        for i, constraint in enumerate(phase.scene.constraints):
            force = forces[constraint.name][phase.samples]
            if not constraint.presses:
                continue
            along = force[:, :3]
            normal = force[:, 2] if constraint.has_normal else _upwards(phase.scene, i, q, along)
            normals[constraint.name] = normal
        for constraint in phase.scene.constraints:
            its = normals.get(constraint.name)
            if its is None or its.min() >= least:
                continue
            k = int(np.argmax(its <= (1.0 - tolerances.SOLVED) * its.min()))  # the first of equals
            here = {name: float(each[k]) for name, each in normals.items()}
            shared = shared_normals(Sites(phase.scene, q[k]), here)
            if constraint.name not in shared.names:
                if constraint.name not in worst or its[k] < worst[constraint.name][0]:
                    worst[constraint.name] = float(its[k]), float(t[k]), constraint
            elif shared.most < min(least, (1.0 + tolerances.SOLVED) * together[0]):
                pull = f"{-shared.most:.4g} N at t = {t[k]:.4g} s"
                together = shared.most, f"{shared_text(shared, pull)}; an Event takes it off"
    return [together[1]] * bool(together[1]) + [
        f"{pull_text(constraint, f'{-normal:.4g} N at t = {t:.4g} s')}; an Event takes it off"
        for normal, t, constraint in worst.values()
    ]


def _upwards(scene: Scene, i: int, q: Array, force: Array) -> Array:
    """Return the parts (k,) against gravity of the forces (k, 3) of constraint i, its own axes."""
    up, equations = upward(scene), gauge_of(scene).equations
    ends: list[Any] = [equations.placements(each)[i] for each in q]
    return np.array([up @ one.rotation @ f for (one, _), f in zip(ends, force, strict=True)])
