"""Notices of a trajectory: what deserves attention, and what its scene leaves out of the file.

    out   = max(lower - q, q - upper) > 0          a joint without a stop
    depth = height - min_k n . (R x_k + p) > 0     corners x_k of a shape in ground n . x <= height

and of the convex parts of a `Ground` the least depth under all their faces.

Shapes are looked at where they are at some samples; those that cannot be read are passed over.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from math import inf, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import algorithms, data_of, lengths
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.contacts.touches import Pair, PlaneContact
from condyn_pin.constraints.places import WORLD
from condyn_pin.constraints.rows.bound import ConstraintViolation, beyond_text, largest_violation
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
from condyn_pin.io.shapes import shapes_of
from condyn_pin.mechanism.rank import check
from condyn_pin.model.joints import Limits
from condyn_pin.model.robot import Robot
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
from condyn_pin.simulation.torques import PassiveForces
from condyn_pin.stepping.single_step import ProvedSteps

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory

# Samples at which shapes are looked at: a body that falls by 1 m moves 2 cm from one to the next.
_LEFT_OUT_SAMPLES: Final = 100

# How many bodies a notice names.
_LISTED: Final = 3


def limits_passed(trajectory: Trajectory) -> list[str]:
    """Sentences on joints that leave their limits, unless they began so."""
    q, limits = trajectory.q, Limits.of(trajectory.scene.robot.model)
    inside = limits.beyond(q[0]).keys()
    most = limits.beyond(q.min(axis=0)) | limits.beyond(q.max(axis=0))
    stops = {stop.iq for bound in trajectory.scene.contact_bounds for stop in bound.stops}
    held = {joint for joint, iq in zip(limits.joints, limits.iq, strict=True) if iq in stops}
    beyond: dict[bool, dict[str, ConstraintViolation]] = {True: {}, False: {}}
    for joint, gap in most.items():
        least = tolerances.NEARLY_CLOSED if joint in held else tolerances.CLOSED
        if joint not in inside and gap.size > least:
            beyond[joint in held][joint] = gap
    said = []
    if beyond[False]:
        said.append(
            f"{beyond_text(beyond[False])}, and the scene has no stops there: "
            "Scene(..., contacts=[..., *robot.limits()]) adds them"
        )
    if beyond[True]:
        said.append(f"{beyond_text(beyond[True])}, although the scene has stops: use a smaller dt")
    return said


class _Solid(NamedTuple):
    """A collision shape of the file on a joint."""

    link: str
    joint: int
    corners: Array  # (k, 3), on the joint [m]
    middle: Array  # (3,) [m]
    radius: float  # of the ball around the middle that holds all corners [m]
    kind: str


class _Ground(NamedTuple):
    """A plane that contacts of a scene may touch."""

    name: str
    made: str  # how `Robot.collisions` names it; empty where that is the default
    ground: int  # the joint that carries it
    placement: Any  # z out of the ground
    friction: float
    allowed: dict[int, float]  # by joint: how deep its shapes may be [m]
    apart: frozenset[str]  # bodies that do not touch it, by the description
    surface: Any = None  # of a `Ground`


class _Penetration(NamedTuple):
    """Deepest penetration of a collision shape into a plane of the ground."""

    solid: _Solid
    plane: _Ground
    depth: float  # [m]
    t: float  # [s], when it was deepest
    first: float  # [s], when it was first seen inside


def bodies_passed(trajectory: Trajectory) -> list[str]:
    """Sentences on bodies whose collision shape of the file goes into the ground of the scene."""
    if not any(_planes(phase.scene) + _worlds(phase.scene) for phase in trajectory.phases):
        return []
    solids = _solids(trajectory.scene.robot)
    looks = np.unique(np.linspace(0, len(trajectory.t) - 1, _LEFT_OUT_SAMPLES).astype(int))
    worst: dict[tuple[str, str], _Penetration] = {}
    for phase in trajectory.phases if solids else ():
        start, stop, _ = phase.samples.indices(len(trajectory.t))
        here = looks[(start <= looks) & (looks < stop)]
        for found in _penetrating_bodies(trajectory, phase.scene, here, solids):
            key = found.solid.link, found.plane.name
            before = worst.get(key)
            first = min(found.first, before.first) if before else found.first
            deepest = found if before is None or found.depth > before.depth else before
            worst[key] = deepest._replace(first=first)
    deepest_first = sorted(worst.values(), key=lambda each: -each.depth)
    return [_text(each, float(trajectory.t[0])) for each in deepest_first[:_LISTED]]


def _text(found: _Penetration, t0: float) -> str:
    solid, plane = found.solid, found.plane
    when = "from the start" if found.first <= t0 else f"from t = {found.first:.3g} s on"
    cure = "a FrictionalContact(..., on=..., on_shape=Plane(...)) of its shape does too"
    if not plane.ground:
        named = f'friction={plane.friction:g}{plane.made}, shapes=["{solid.link}"]'
        cure = f"Scene(..., contacts=[..., *robot.collisions({named})]) adds its shapes"
    return (
        f"{solid.link} (a {solid.kind} in the file) is in the ground {plane.name} {when}, "
        f"{1e3 * found.depth:.3g} mm deep at t = {found.t:.3g} s: only the scene's contacts touch; "
        f"{cure}"
    )


def _penetrating_bodies(
    trajectory: Trajectory, scene: Scene, looks: NDArray[np.int_], solids: tuple[_Solid, ...]
) -> list[_Penetration]:
    """Bodies that are in the ground of a scene at some samples, by more than they may be."""
    grounds = [*_planes(scene), *_worlds(scene)]
    model = scene.robot.unedited
    data = data_of(model)
    found: dict[tuple[int, int], _Penetration] = {}
    for i in looks:
        algorithms(data).forwardKinematics(model, data, trajectory.q[i])
        t = float(trajectory.t[i])
        for k, ground in enumerate(grounds):
            for s, solid in enumerate(solids):
                if solid.joint == ground.ground or solid.link in ground.apart:
                    continue
                allowed = ground.allowed.get(solid.joint, tolerances.IN_THE_GROUND)
                if ground.surface is None:
                    depth = _depth_in_plane(ground, solid, data.oMi, allowed)
                else:
                    depth = _depth_in_parts(ground.surface, solid, data.oMi[solid.joint])
                before = found.get((k, s))
                if depth > allowed and (before is None or depth > before.depth):
                    first = before.first if before else t
                    found[k, s] = _Penetration(solid, ground, depth, t, first)
    return list(found.values())


def _depth_in_plane(plane: _Ground, solid: _Solid, oMi: Any, allowed: float) -> float:
    """Depth of the lowest corner of a solid under a plane [m]; 0 where its ball has less."""
    oMp, at = oMi[plane.ground] * plane.placement, oMi[solid.joint]
    n = oMp.rotation[:, 2]
    down = at.rotation.T @ n
    level = float(n @ oMp.translation) - float(n @ at.translation)
    if level + solid.radius - float(down @ solid.middle) <= allowed:
        return 0.0
    return level - float((solid.corners @ down).min())


def _depth_in_parts(surface: Any, solid: _Solid, at: Any) -> float:
    """Depth of the deepest corner of a solid in the convex parts of a ground [m]."""
    middle, (low, high) = at.act(solid.middle), surface.bounds
    near = (low <= middle + solid.radius) & (high >= middle - solid.radius)
    corners, deepest = None, 0.0
    for part in np.flatnonzero(near.all(axis=1)).tolist():
        if surface.solids[part] is None:
            continue
        n, heights, _ = surface.solids[part]
        if (n.dot(middle) - heights).max() < solid.radius:
            if corners is None:
                corners = solid.corners.dot(at.rotation.T) + at.translation
            deepest = max(deepest, -float((corners.dot(n.T) - heights).max(axis=1).min()))
    return deepest


def _planes(scene: Scene) -> list[_Ground]:
    """Planes of the contacts of a scene, each once."""
    found: dict[tuple[Any, ...], _Ground] = {}
    for bound in scene.contact_bounds:
        over: list[tuple[PlaneContact | Pair, Any]] = [
            (touch, touch.plane) for touch in bound.touches
        ]
        over += [(p, p.ground_placement) for p in bound.pairs if p.ground_shape.is_plane]
        for touch, plane in over:
            n, height = plane.rotation[:, 2], float(plane.rotation[:, 2] @ plane.translation)
            key = (touch.ground, *np.round([*n, height], 9).tolist())
            if key not in found:
                words = _plane_in_words(scene, touch.ground, n, height)
                apart = _excluded_bodies(scene.robot, touch.ground)
                found[key] = _Ground(*words, touch.ground, plane, touch.friction, {}, apart)
            found[key].allowed[touch.joint] = tolerances.FEET_IN_THE_GROUND
    return list(found.values())


def _worlds(scene: Scene) -> list[_Ground]:
    """Grounds of the contacts of a scene that are no planes, each once."""
    found: dict[int, _Ground] = {}
    for bound in scene.contact_bounds:
        for pair in bound.pairs:
            if pair.surface is not None:
                apart = _excluded_bodies(scene.robot, 0)
                world = found.setdefault(
                    id(pair.surface),
                    _Ground("of the scene", ", ground=...", 0, None, pair.friction, {}, apart,
                            pair.surface),
                )  # fmt: skip
                world.allowed[pair.joint] = tolerances.FEET_IN_THE_GROUND
    return list(found.values())


def _excluded_bodies(robot: Robot, joint: int) -> frozenset[str]:
    """Bodies that a description lets pass through the world, or through those on a joint."""
    here = {*WORLD}
    if joint:
        here = {frame.name for frame in robot.model.frames if frame.parentJoint == joint}
    return frozenset().union(*(names for names in robot.exclusions if here.intersection(names)))


def _plane_in_words(scene: Scene, ground: int, n: Array, height: float) -> tuple[str, str]:
    """Name of a plane, and how `Robot.collisions` names it."""
    if ground:
        return f"that {scene.robot.model.names[ground]} carries", ""
    normal = ", ".join(f"{x:.6g}" for x in n)
    if n[2] < 1.0 - tolerances.CLOSED:
        return f"({normal}) . x = {height:.4g} m", f", ground=Plane(({normal}), {height:.6g})"
    made = f", ground=Plane(height={height:.6g})" if abs(height) > tolerances.CLOSED else ""
    return f"z = {height:.4g} m", made


def _solids(robot: Robot) -> tuple[_Solid, ...]:
    """Collision shapes of a robot's file on the joints that move."""
    frames = {f.name: f for f in robot.model.frames if f.type == pin.FrameType.BODY}
    made = []
    file = robot.description
    for link, kind, corners in _collision_corners(
        file, robot.name, (*robot.package_dirs,), _age(file)
    ):
        frame = frames.get(link)
        if frame is None or not frame.parentJoint:
            continue
        placed = corners @ frame.placement.rotation.T + frame.placement.translation
        middle = (placed.min(axis=0) + placed.max(axis=0)) / 2.0
        radius = float(np.linalg.norm(placed - middle, axis=1).max())
        made.append(
            _Solid(
                link=link,
                joint=int(frame.parentJoint),
                corners=placed,
                middle=middle,
                radius=radius,
                kind=kind,
            )
        )
    return tuple(made)


def _age(description: str) -> float:
    """When a file was written last; never if there is none."""
    try:
        return Path(description).stat().st_mtime
    except (OSError, ValueError):
        return -inf


@lru_cache(maxsize=16)
def _collision_corners(
    description: str, model: str, package_dirs: tuple[str, ...], _age: float
) -> tuple[tuple[str, str, Array], ...]:
    """Link, kind and corners (k, 3) in the axes of the link of each collision shape of a file."""
    if _age == -inf:
        return ()
    found = []
    shapes, _ = shapes_of(description, "collision", model=model, package_dirs=package_dirs)
    for shape in shapes:
        try:
            found.append((shape.link, shape.kind, shape.mesh().vertices))
        except (CondynError, ValueError, OSError):
            continue
    return tuple(found)


# Samples of a phase that are checked. A solver that does not converge misses at most of them.
_SAMPLES: Final = 20

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
    passive = PassiveForces.of(phase.scene.robot, springs=effects.springs, damping=effects.damping)
    start, stop = phase.samples.start, phase.samples.stop
    for i in np.unique(np.linspace(start, stop - 1, _SAMPLES).astype(int)):
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
    looks = set(np.linspace(start, stop - 1, _SAMPLES // 2).astype(int).tolist())
    if trajectory.contact:
        codes = trajectory.contact.codes[start:stop]
        changes = start + np.flatnonzero((codes[1:] != codes[:-1]).any(axis=1))
        spread = np.linspace(0, len(changes) - 1, min(_SAMPLES // 2, len(changes)))
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
