"""Notices: what deserves attention in a trajectory, a sentence each."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import lengths
from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.violation import worst
from condyn_pin.dynamics.force import Sites, pull_text, shared_normals, shared_text, upward
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.mechanism.check import check
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.left_out import bodies_passed, limits_passed
from condyn_pin.simulation.measures import gauge_of
from condyn_pin.simulation.passive import Passive
from condyn_pin.simulation.plan import default_solver

if TYPE_CHECKING:
    from condyn_pin.dynamics.solvers.base import Solver
    from condyn_pin.simulation.recorder import Phase
    from condyn_pin.simulation.trajectory import Trajectory

# A gap that is larger than that of an open start by this factor has opened on the way: one that
# closes at a critical rate grows first by what its velocity brings.
_LARGER = 2.0

# Samples of a phase that are checked. A solver that does not converge misses at most of them.
_LOOKS = 20


def notices_of(trajectory: Trajectory) -> tuple[str, ...]:
    """Return what there is to say: of its end, gaps, solver, pulls, energy, limits and bodies."""
    said = []
    if not trajectory.status.ok:
        said.append(f"{trajectory.status}; {trajectory.reason}")
    said += _open_constraints(trajectory)
    said += [str(remark) for remark in trajectory.run.remarks]
    said += _stays_deep(trajectory)
    said += _coarse_turns(trajectory) + _differenced(trajectory) + _shocks(trajectory)
    said += solver_notices(trajectory) + _tensile_contacts(trajectory)
    energy = trajectory.energy
    error, scale = float(np.abs(energy.error).max()), energy.scale
    small = max(tolerances.BALANCED * scale, energy.kept, _hardly_lifted(trajectory.scene))
    if error > small:
        said.append(
            f"{error:.3g} J of energy appeared or vanished without work, of {scale:.3g} J exchanged"
        )
    if (added := float(energy.algorithmic[-1])) > small:
        said.append(
            f"steps added {added:.3g} J that no contact would, of {scale:.3g} J exchanged: use a "
            "smaller dt"
        )
    return (*said, *limits_passed(trajectory), *bodies_passed(trajectory))


def _open_constraints(trajectory: Trajectory) -> list[str]:
    """Return a sentence on the largest gap, if it is larger than a closed state has."""
    violation, run = trajectory.violation, trajectory.run
    largest, first = float(violation.max()), float(violation[0])
    if not largest > tolerances.NEARLY_CLOSED:
        return []
    if first > tolerances.NEARLY_CLOSED and largest < _LARGER * first:
        left = float(violation[-1])
        return [
            f"the constraints were open by {first:.2g} m or rad at the start, as close_start=False "
            f"allows, and are by {left:.2g} at the end"
        ]
    when = int(violation.argmax())
    scenes = [
        p.scene for p in trajectory.phases if when in range(*p.samples.indices(len(violation)))
    ]
    open_by = [worst(check(scene, trajectory.q[when], None).violation) for scene in scenes]
    name, gap = max(open_by, key=lambda item: item[1].size)
    remedy = "use a smaller dt, a higher order, or another drift scheme"
    if not run.solver.exact:
        remedy = f"{run.solver.title} lets them give way; use a stiffer solref"
    return [f"{name} is open by {gap} at t = {trajectory.t[when]:.4g} s: {remedy}"]


def _stays_deep(trajectory: Trajectory) -> list[str]:
    """Return a sentence on the contact that carries deepest in another body, if none pushes out."""
    scheme, record = trajectory.run.integrator, trajectory.contact
    if not isinstance(scheme, ContactScheme) or scheme.closes_gaps or scheme.gives_way:
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
    speed = np.abs(trajectory.v).max(axis=0)
    turns = {
        model.names[i]: float(speed[joint.idx_v + k])
        for i, joint in enumerate(list(model.joints)[1:], start=1)
        for k, length in enumerate(lengths(joint))
        if not length and speed[joint.idx_v + k] * run.dt > pi
    }
    if not turns or not trajectory.status.ok:
        return []
    joint = max(turns, key=turns.__getitem__)
    return [
        f"joint {joint!r} turns by {turns[joint] * run.dt:.3g} rad in a step of {run.dt:.3g} s, "
        "too much to resolve its effect on other joints: take dt below "
        f"{pi / turns[joint]:.2g} s"
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


def _hardly_lifted(scene: Scene) -> float:
    """Return what lifts the robot by a nanometre [J]; one at rest may have no energies at all."""
    gravity = float(np.linalg.norm(scene.robot.model.gravity.linear))
    return tolerances.ENERGY_KEPT * scene.robot.mass * gravity


def solver_notices(trajectory: Trajectory) -> list[str]:
    """Return a sentence on the error of the accelerations, if it is larger than its solver's.

    A run calls the hot loop, which proves nothing, and a drift scheme closes what a wrong a has
    opened: the constraints hold, and the motion is another one. So some samples are solved once
    more, with the proof that `solve` gives. Nothing is said of a run that broke down, nor of a
    solver that answers another question; nor of contacts that open, proved in every step.
    """
    run = trajectory.run
    rows = any(phase.scene.rows for phase in trajectory.phases)
    if not (run.status.ok and run.solver.exact and rows) or trajectory.contact:
        return []
    by_default = run.solver == default_solver(trajectory.phases[-1].scene)
    worst, when = max(
        _bound(trajectory, phase, default_solver(phase.scene) if by_default else run.solver)
        for phase in trajectory.phases
    )
    if worst <= run.solver.accuracy:
        return []
    return [
        f"the accelerations may be off by {worst:.2g}, relative, at t = {when:.4g} s: give "
        f"{run.solver.title} more iterations or a smaller mu, or take Proximal() or Reference()"
    ]


def _bound(trajectory: Trajectory, phase: Phase, solver: Solver) -> tuple[float, float]:
    """Return the largest error bound at some samples of a phase, and its time [s]."""
    run, effects = trajectory.run, trajectory.run.effects
    workspace = Workspace(phase.scene.at(0.0), solver, drift=run.drift.rows)
    passive = Passive.of(phase.scene.robot, springs=effects.springs, damping=effects.damping)
    start, stop = phase.samples.start, phase.samples.stop
    bounds = []
    for i in np.unique(np.linspace(start, stop - 1, _LOOKS).astype(int)):
        q, v = trajectory.q[i], trajectory.v[i]
        tau = trajectory.tau[i] + passive.torque(q, v)
        workspace.equations.at(float(trajectory.t[i]))
        solution = workspace.solve(q, v, tau, throw=False)
        bounds.append((solution.error_bound, float(trajectory.t[i])))
    return max(bounds)


def _tensile_contacts(trajectory: Trajectory) -> list[str]:
    """Return a sentence for each contact that pulls, with the largest pull and its time.

    A run keeps its contacts until an event takes them off: between events they are bilateral.
    """
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
            k = int(its.argmin())
            here = {name: float(each[k]) for name, each in normals.items()}
            shared = shared_normals(Sites(phase.scene, q[k]), here)
            if constraint.name not in shared.names:
                if constraint.name not in worst or its[k] < worst[constraint.name][0]:
                    worst[constraint.name] = float(its[k]), float(t[k]), constraint
            elif shared.most < min(least, together[0]):
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
