"""The outcome of a run, and the status of its motion: which limits it has left, and how to keep it.

Run: settings, status and events of a run.

    |c(q)|, |J v|, -gap      within `MotionLimits`, beyond what the start was open by
    |E - E_0 - work|         within a share of the energy exchanged

at the samples. What is named is the constraint, the contact or the stop that is furthest off, its
time and the cure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from math import inf, isfinite, isnan, nan
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_type, short_repr
from condyn_pin._core.arrays import Array, text_of
from condyn_pin._core.show import Outcome
from condyn_pin._core.threads import ThreadCache, one_blas_thread
from condyn_pin.constraints.drift import Drift
from condyn_pin.constraints.rows.bound import largest_violation
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import CondynError, InvalidArgument
from condyn_pin.mechanism.rank import check
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.events import EventRecord
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.integrator import Integrator
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.measures import Energy, gauge_of
from condyn_pin.simulation.records import Phase, Remark, gaps_along
from condyn_pin.simulation.system import CorrectedStepper, System
from condyn_pin.simulation.torques import AppliedTorques

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory

# MotionLimits: how far a motion may stray from its own laws and still be ok.


# Every motion of a batch is judged by it.
_gaps = ThreadCache[float]()


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """Limits on violation, penetration and energy error of a motion that is ok.

    Sizes are those of the machine: a thousandth of the distance over which its joints are spread,
    0.2 mm or mrad at least and 1 cm or 10 mrad at most. ``inf`` switches a limit off.

    Parameters
    ----------
    violation : float, optional
        Gap of a constraint [m, rad]. By default the size above; no limit where `solver` lets
        constraints are compliant. Twice the gap of a start that ``close_start=False`` left open is
        always within it.
    constraint_velocity : float, optional
        abs(J v) [m/s, rad/s]. By default 1 % of the largest velocity, or of 1 rad/s, and 2 dt gamma
        more, for schemes with contacts are tangent in the middle of a step; from where an open
        start is closed, and not where constraints are compliant.
    penetration : float, optional
        Depth of a contact [m], and how far a joint passes a stop of the scene [rad, m], beyond the
        depth at the start. By default the size above, 1 mm or mrad at least, and dt times the
        fastest rate of the gap more by schemes that push nothing out; no limit where contacts
        are compliant, as in `SoftStep`.
    energy : float
        Energy that appeared or vanished without work, as a share of the largest exchange [1].
        What gravity and torques exchange in one step is within it by schemes of order 1.
    error : float
        `Trajectory.error` from which on a notice names it, as a share of how far bodies moved [1].

    Raises
    ------
    InvalidArgument
        If one is not positive.
    """

    violation: float | None = None  # [m, rad]
    constraint_velocity: float | None = None  # [m/s, rad/s]
    penetration: float | None = None  # [m, rad]
    energy: float = tolerances.UNBALANCED
    error: float = tolerances.OFF

    def __post_init__(self) -> None:
        for name in (each.name for each in fields(self)):
            value = getattr(self, name)
            if value is None and name not in ("energy", "error"):
                continue
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if not is_number or isnan(value) or value <= 0:
                raise InvalidArgument(f"{name} = {text_of(value)}: a number > 0 is needed")


def check_limits(limits: MotionLimits | None) -> MotionLimits:
    """Return the limits of a motion: those by default for None."""
    if limits is None:
        return MotionLimits()
    check_type("limits", limits, MotionLimits, "MotionLimits(...) is needed")
    return limits


def default_gap(robot: Robot) -> float:
    """Largest gap of a constraint [m, rad] in a motion that is ok, by default."""
    return _gaps.of(robot, None, lambda: _gap_of(robot.unedited))


def _gap_of(model: Any) -> float:
    size = tolerances.LEFT_OPEN * Manifold(model).reach
    return min(max(size, 2 * tolerances.NEARLY_CLOSED), tolerances.OUT_OF_REACH)


# How a run was made, and how it ended.


@dataclass(frozen=True, kw_only=True)
class Effects:
    """Effects of a robot's model in a run: gravity, springs, damping, armature.

    Parameters
    ----------
    gravity : bool
        Otherwise nothing has weight.
    springs, damping : bool
        Those of the joints and between frames. Pinocchio leaves them out of its dynamics; a
        simulation adds them.
    armature : bool
        The inertia of the rotors. Otherwise M is that of the links alone.

    Raises
    ------
    InvalidArgument
        If one is neither True nor False.
    """

    gravity: bool = True
    springs: bool = True
    damping: bool = True
    armature: bool = True

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_type(name, value, bool, "True or False is needed")

    def applied_to(self, scene: Scene) -> Scene:
        """Return the scene whose model has no gravity or armature where these are off."""
        if self.gravity and self.armature:
            return scene
        model = pin.Model(scene.robot.model)
        if not self.gravity:
            model.gravity = pin.Motion.Zero()
        if not self.armature:
            model.armature[:] = 0.0
        return replace(scene, robot=replace(scene.robot, model=model))

    def text(self, robot: Robot) -> str:
        """Text of the effects that are on, those that are off, and those the robot lacks."""
        model = robot.model
        between = robot.spring_dampers
        springs = sum(spring.stiffness != 0 for spring in robot.springs)
        springs += sum(spring.stiffness != 0 for spring in between)
        has = {
            "gravity": bool(model.gravity.linear.any()) or not self.gravity,
            "springs": springs > 0,
            "damping": bool(model.damping.any()) or any(each.damping for each in between),
            "armature": bool(model.armature.any()) or not self.armature,
        }
        on = [name for name in has if getattr(self, name) and has[name]]
        off = [name for name in has if not getattr(self, name)]
        none = [name for name in has if getattr(self, name) and not has[name]]
        parts = (("on: ", on), ("off: ", off), ("not in the model: ", none))
        return "; ".join(title + ", ".join(names) for title, names in parts if names)


class RunStatus(Outcome):
    """Outcome of a run, or the limit that a motion has left; ok within all of them."""

    FINISHED = "it went to its end"
    ENDED = "an event ended it"
    DIVERGED = "its numbers grew without bound: use a smaller dt, or other gains"
    FAILED = "a step could not be taken"
    PILED_UP = "events piled up"
    INTERRUPTED = "what came before is kept"
    OPENED = "constraints came open, or their sides moved apart"
    PENETRATED = "bodies went into each other, or joints past their stops"
    UNBALANCED = "energy appeared or vanished without work"

    @property
    def went_on(self) -> bool:
        """True if the run came to its end, within the limits of the motion or not."""
        return self.ok or self in (
            RunStatus.OPENED, RunStatus.PENETRATED, RunStatus.UNBALANCED,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Run:
    """Settings, status and events of a run.

    Attributes
    ----------
    duration, dt : float
        Duration as given, and the step [s].
    integrator, drift, solver
        Methods of the run.
    effects : Effects
        Effects of the robot's model that were on.
    limits : MotionLimits
        Limits of a motion whose `Trajectory.status` is ok.
    status : RunStatus
        Outcome of the run.
    reason : str
        Reason for an early end; empty if the run went to its end.
    happened : tuple of Happened
        The events.
    missed : tuple of str
        Events that did not happen, and why not.
    differenced : int
        Number of calls of the torque function for its differences.
    remarks : tuple of Remark
        Messages of the steps, each once with its first time.
    wall_time : float
        [s]
    """

    duration: float  # [s]
    dt: float  # [s]
    integrator: Integrator
    drift: Drift
    solver: Solver
    effects: Effects = field(default_factory=Effects)
    limits: MotionLimits = field(default_factory=MotionLimits)
    status: RunStatus = RunStatus.FINISHED
    reason: str = ""
    happened: tuple[EventRecord, ...] = ()
    missed: tuple[str, ...] = ()
    differenced: int = 0
    remarks: tuple[Remark, ...] = ()
    wall_time: float = 0.0  # [s]

    @property
    def choices(self) -> str:
        """Integrator, drift scheme and solver, with parameters that differ from the default."""
        return ", ".join(
            short_repr(choice) for choice in (self.integrator, self.drift, self.solver)
        )


def uninterrupted(motion: Trajectory) -> Trajectory:
    """Motion that others depend on; KeyboardInterrupt if Ctrl-C ended it."""
    # `simulate` keeps what it has and returns, which is right for viewing the motion, and wrong for
    # comparing it with others: a part of one is no measurement.
    if motion.run.status is RunStatus.INTERRUPTED:
        raise KeyboardInterrupt
    return motion


# A gap that is larger than that of an open start by this factor has opened on the way: one that
# closes at a critical rate grows first by what its velocity brings.
LARGER = 2.0

# Share of the largest velocity that |J v| may be.
_SLIP = 1e-2

# Kinetic energy that a motion may lose, as a share: half of it in speed. One without forces
# exchanges nothing that its errors could be compared with.
_OF_KINETIC = 1e-3


@dataclass(frozen=True, eq=False)
class JudgedMotion:
    """A motion as it is judged: its samples, what they measure, and how they were made.

    t, q, v: samples, (k,), (k, nq) and (k, nv)
    violation, constraint_velocity (k,): max abs(c(q)) [m, rad] and max abs(J v) [m/s, rad/s]
    dt: time step [s]
    integrator, solver, limits: as in `Run`
    """

    phases: Sequence[Phase]
    t: Array
    q: Array
    v: Array
    violation: Array
    constraint_velocity: Array
    energy: Energy
    dt: float  # [s]
    integrator: Integrator
    solver: Solver
    limits: MotionLimits

    @property
    def scene(self) -> Scene:
        """The scene at the start."""
        return self.phases[0].scene

    def scene_at(self, sample: int) -> Scene:
        """The scene of a sample."""
        found = [p.scene for p in self.phases if p.samples.start <= sample < p.samples.stop]
        return found[0]


def judged_status(course: JudgedMotion) -> tuple[RunStatus, str]:
    """Status of a motion that came to its end, and each limit that it has left, in a sentence."""
    found = [
        (RunStatus.OPENED, left_open(course)),
        (RunStatus.OPENED, moved_apart(course)),
        (RunStatus.PENETRATED, penetration_fault(course)),
        (RunStatus.UNBALANCED, energy_fault(course)),
    ]
    left = [(status, said) for status, said in found if said]
    if not left:
        return RunStatus.FINISHED, ""
    return left[0][0], "; ".join(said for _, said in left)


def left_open(course: JudgedMotion) -> str:
    """Largest gap of a constraint, if it is beyond the limit."""
    limit, first = course.limits.violation, float(course.violation[0])
    if limit is None:
        limit = default_gap(course.scene.robot) if _is_hard(course) else inf
    if first > tolerances.NEARLY_CLOSED:
        limit = max(limit, LARGER * first)
    when = int(course.violation.argmax())
    if course.violation[when] <= limit:
        return ""
    scene = _at(course, when)
    name, gap = largest_violation(check(scene, course.q[when], None).violation)
    return (
        f"{name} is open by {gap} at t = {course.t[when]:.4g} s, more than {limit:.2g} m or rad: "
        f"{opening_cure(course.solver)}"
    )


def opening_cure(solver: Solver) -> str:
    """Advice on how to keep constraints closed."""
    if not solver.exact:
        return f"{solver.title} has compliant constraints; use a stiffer solref"
    return "use a smaller dt, a higher order, or another drift scheme"


def moved_apart(course: JudgedMotion) -> str:
    """Largest |J v|, if it is beyond the limit."""
    limit, speeds = course.limits.constraint_velocity, course.constraint_velocity.copy()
    speeds[: _closed_from(course)] = 0.0  # an open start closes at some speed
    when = int(speeds.argmax())
    if limit is None:
        if not _is_hard(course):
            return ""
        fastest = max(1.0, float(np.abs(course.v).max(initial=0.0)))
        limit = max(_SLIP * fastest, LARGER * float(speeds[0]))
        if speeds[when] > limit:  # curved paths are tangent in the middle of a step
            limit += _bend(course, when)
    if speeds[when] <= limit:
        return ""
    scene = _at(course, when)
    of_each = check(scene, course.q[when], course.v[when]).constraint_velocity
    name, rate = largest_violation(of_each)
    return (
        f"the sides of {name} move apart at {rate.text('/s')} at t = {course.t[when]:.4g} s, more "
        f"than {limit:.2g} m/s or rad/s: use a smaller dt, or Projection(), which keeps J v = 0"
    )


def _bend(course: JudgedMotion, when: int) -> float:
    """|J v| [m/s, rad/s] at the end of a step whose velocity is tangent to curved paths within."""
    equations = gauge_of(course.scene_at(when)).equations
    equations.at(float(course.t[when]))
    gamma = equations.parts(course.q[when], course.v[when])[3]
    return 2 * course.dt * float(np.abs(gamma).max(initial=0.0))


def penetration_fault(course: JudgedMotion) -> str:
    """Deepest contact, or joint past its stop, if it is beyond the limit."""
    worst_excess, said = 0.0, ""
    found = [
        (phase, *gaps_along(phase.scene, course.q[phase.samples]))
        for phase in course.phases
        if phase.scene.contacts
    ]
    fastest = _closing_speeds(course, found)
    for phase, names, gaps in found:
        if not gaps.size:
            continue
        t, limits = course.t[phase.samples], _depth_limits(course, phase, gaps)
        limits += course.dt * np.array([fastest.get(name, 0.0) for name in names])
        excess = -gaps - limits
        k, i = np.unravel_index(int(excess.argmax()), excess.shape)
        if excess[k, i] <= worst_excess:
            continue
        worst_excess = float(excess[k, i])
        said = (
            f"{names[i]} is {-gaps[k, i]:.3g} m or rad deep at t = {t[k]:.4g} s, more than "
            f"{limits[i]:.2g}: {_depth_cure(course)}"
        )
    return said


def _depth_limits(course: JudgedMotion, phase: Phase, gaps: Array) -> Array:
    """Depth of each contact and stop [m, rad] that is within the limit."""
    limit, scheme = course.limits.penetration, course.integrator
    begun = np.maximum(-gaps[0], 0.0) if phase.samples.start == 0 else np.zeros(gaps.shape[1])
    if limit is not None:
        return np.asarray(limit + np.where(begun > tolerances.NEARLY_CLOSED, begun, 0.0))
    if isinstance(scheme, ContactScheme) and scheme.penetrates_at_rest:
        return np.full(gaps.shape[1], inf)
    size = max(default_gap(course.scene.robot), tolerances.NEARLY_APART)
    return np.asarray(size + begun)


def _closing_speeds(
    course: JudgedMotion, found: Sequence[tuple[Phase, Sequence[str], Array]]
) -> dict[str, float]:
    """Fastest rate of each gap [m/s, rad/s] in the motion, by schemes that push nothing out."""
    # Depth stays from one phase to the next: in its own, a contact may be at rest.
    scheme, fastest = course.integrator, dict[str, float]()
    is_limited = course.limits.penetration is not None
    if is_limited or not isinstance(scheme, ContactScheme) or scheme.closes_gaps:
        return fastest
    for phase, names, gaps in found:
        spans = np.diff(course.t[phase.samples])[:, None]
        rates = np.abs(np.diff(gaps, axis=0) / spans).max(axis=0, initial=0.0)
        for name, rate in zip(names, rates, strict=True):
            fastest[name] = max(float(rate), fastest.get(name, 0.0))
    return fastest


def _depth_cure(course: JudgedMotion) -> str:
    scheme = course.integrator
    if isinstance(scheme, ContactScheme) and scheme.closes_gaps:
        return "use a smaller dt"
    return "use a smaller dt, or StewartTrinkle(), which pushes out what penetrates"


def energy_fault(course: JudgedMotion) -> str:
    """Largest energy without work, if it is beyond the limit."""
    energy, limit = course.energy, course.limits.energy
    rest, scale = unexplained_energy(course), energy.scale
    if _is_of_first_order(course.integrator):
        rest, lost = np.maximum(rest - of_a_step(course), 0.0), np.ptp(energy.springs)
        rest = np.where(energy.error < 0.0, np.maximum(rest - lost, 0.0), rest)
    most = float(rest.max(initial=0.0))
    moving = _OF_KINETIC * float(energy.kinetic.max(initial=0.0))
    if most <= max(limit * scale, smallest_energy(course), moving):
        return ""
    since = int(np.argmax(~(rest <= limit * scale)))
    return (
        f"{most:.3g} J of energy appeared or vanished without work, of {scale:.3g} J exchanged, "
        f"more than {100 * limit:.3g} % from t = {course.t[since]:.4g} s on: {energy_cure(course)}"
    )


def energy_cure(course: JudgedMotion) -> str:
    """Advice on how to reduce the energy error."""
    if course.integrator.between_events.is_adaptive:
        return "use finer tolerances"
    if course.scene.contacts:
        return f"use a dt below {1e3 * course.dt:.3g} ms"
    return (
        f"use a dt below {1e3 * course.dt:.3g} ms, an integrator of a higher order, or "
        "DormandPrince(), which takes smaller steps where it must"
    )


def unexplained_energy(course: JudgedMotion) -> Array:
    """Energy that appeared or vanished without work since the loops were closed (k,) [J]."""
    # Less what the quadrature of work over the samples may be off by. Compliant constraints, or
    # that close an open start, do work: it is zero while they do.
    error, doubt = course.energy.error, course.energy.doubt
    if not _is_hard(course):
        return np.zeros_like(error)
    start = min(_closed_from(course), len(error) - 1)
    rest = np.abs(error - error[start]) - (doubt - doubt[start])
    rest[:start] = 0.0
    return np.asarray(np.where(rest < 0.0, 0.0, rest))


def of_a_step(course: JudgedMotion) -> float:
    """Energy [J] that gravity and torques exchange in one step, by schemes of first order."""
    # They are half a step late or early: m g v dt / 2 of a free fall, a share of 1 / k after k
    # steps.
    if not _is_of_first_order(course.integrator) or len(course.t) < 2:
        return 0.0
    spans = np.diff(course.t)
    by_each = [np.abs(np.diff(part)) for part in (course.energy.potential, course.energy.work)]
    return float(max((course.dt / np.maximum(spans, course.dt) * each).max() for each in by_each))


def smallest_energy(course: JudgedMotion) -> float:
    """Negligible energy [J]: rounding of energies, and work to lift the robot by 1 nm."""
    gravity = float(np.linalg.norm(course.scene.robot.model.gravity.linear))
    lifted = tolerances.ENERGY_KEPT * course.scene.robot.mass * gravity
    return max(course.energy.kept, lifted)


def _closed_from(course: JudgedMotion) -> int:
    """The first sample at which an open start is closed; the number of samples if it never is."""
    closed = course.violation <= tolerances.NEARLY_CLOSED
    return int(closed.argmax()) if closed.any() else len(closed)


def _is_of_first_order(integrator: Integrator) -> bool:
    """True if a scheme has contacts, or is of order 1 in q."""
    return isinstance(integrator, ContactScheme) or integrator.order.q == 1


def _is_hard(course: JudgedMotion) -> bool:
    """True if constraints are rigid, not softened by the choice of a solver."""
    return course.solver.exact or not any(phase.scene.rows for phase in course.phases)


def _at(course: JudgedMotion, when: int) -> Scene:
    """Scene of a sample, its driven rows where they are then."""
    return course.scene_at(when).at(float(course.t[when]))


# Error of a motion by fixed steps, estimated by doubled ones.
#
#     e(window) = |x_dt - x_2dt| / (2^p - 1),    x = points of the bodies, p the order for q
#     e = T / window * mean of e(window)
#
# From samples spread over the motion a few steps are taken again, with dt and with 2 dt: at most a
# twentieth of the steps of the motion. Points are the centre of mass of each body, and those at its
# radii of gyration along its principal axes.


# Share of the steps of a motion that are taken again, steps of 2 dt in a window, and windows.
_SHARE: Final = 0.05
_DOUBLED, _WINDOWS = 4, 8

# Samples at which bodies are looked for, to know how far they have moved.
_LOOKS: Final = 50


class MotionError(NamedTuple):
    """An estimated error beside the motion it is an error of."""

    off: float  # how far points of bodies may be off at the end [m]; NaN if nothing is known
    moved: float  # how far points of bodies were from where they began, at most [m]
    size: float  # how far points of bodies are from each other where they began [m]
    turned: float  # what the fastest joint turns by in a step [rad]


class Points:
    """Points of the bodies of a model: centres of mass, and radii of gyration from them."""

    def __init__(self, model: Any) -> None:
        self._model, self._data = model, model.createData()
        self._of_bodies = [
            (i, _points(inertia))
            for i, inertia in enumerate(list(model.inertias))
            if i > 0 and inertia.mass > 0
        ]

    def at(self, q: Array) -> Array:
        """Return the points (k, 3) in the world at q [m]."""
        pin.forwardKinematics(self._model, self._data, q)
        placements = self._data.oMi
        found = [
            points @ placements[i].rotation.T + placements[i].translation
            for i, points in self._of_bodies
        ]
        return np.concatenate(found) if found else np.zeros((0, 3))

    def apart(self, q: Array, other: Array) -> float:
        """Largest distance of a point between two configurations [m]."""
        return float(np.linalg.norm(self.at(q) - self.at(other), axis=1).max(initial=0.0))


def _points(inertia: Any) -> Array:
    """Return four points (4, 3) of a body, in its axes [m]."""
    moments, axes = np.linalg.eigh(inertia.inertia)
    radii = np.sqrt(np.maximum(moments.sum() / 2 - moments, 0.0) / inertia.mass)
    return np.vstack((inertia.lever, inertia.lever + (axes * radii).T))


@one_blas_thread
def estimated_error(trajectory: Trajectory) -> MotionError:
    """Return the estimated error of a motion, and how far it moved."""
    run, points = trajectory.run, Points(trajectory.scene.robot.model)
    t, q = trajectory.t, trajectory.q
    looks = np.unique(np.linspace(0, len(t) - 1, _LOOKS).astype(int))
    moved = max(points.apart(q[0], q[i]) for i in looks)
    size = float(np.ptp(points.at(q[0]), axis=0).max()) if moved else 0.0
    turned = run.dt * float(np.abs(trajectory.v).max(initial=0.0))
    steps = round(float(t[-1]) / run.dt)
    if run.integrator.between_events.is_adaptive or steps < 2 or not moved:
        return MotionError(nan, moved, size, turned)
    budget = _SHARE * steps
    doubled = int(np.clip(budget // 9, 1, _DOUBLED))
    windows = int(np.clip(budget // (3 * doubled), 1, _WINDOWS))
    window = 2 * doubled * run.dt
    again, shares = (
        _RepeatedSteps(trajectory, points, doubled),
        (np.arange(windows) + 0.5) / windows,
    )
    errors = [again.error_from(share * (float(t[-1]) - window)) for share in shares]
    known = [error for error in errors if isfinite(error)]
    if not known:
        return MotionError(nan, moved, size, turned)
    # an impact in one window is not in all of them
    typical = np.median(known) if trajectory.contact else np.mean(known)
    return MotionError(float(typical) * float(t[-1]) / window, moved, size, turned)


class _RepeatedSteps:
    """Some steps of a motion taken again, from where they began."""

    def __init__(self, trajectory: Trajectory, points: Points, doubled: int) -> None:
        self._motion, self._points, self._doubled = trajectory, points, doubled
        self._systems: dict[int, System] = {}
        self._torque = _Line(trajectory.scene.robot.nv)

    def error_from(self, t: float) -> float:
        """Return the error at the end of a window that begins at the sample before t [m]."""
        motion, dt = self._motion, self._motion.run.dt
        i = max(int(np.searchsorted(motion.t, t, side="right")) - 1, 0)
        phase = next(p for p in motion.phases if p.samples.start <= i < p.samples.stop)
        t0, window = float(motion.t[i]), 2 * self._doubled * dt
        end = min(int(np.searchsorted(motion.t, t0 + window)), phase.samples.stop - 1)
        self._torque.through(t0, motion.tau[i], float(motion.t[end]), motion.tau[end])
        try:
            fine = self._end(phase, i, t0, dt, 2 * self._doubled)
            coarse = self._end(phase, i, t0, 2 * dt, self._doubled)
        except CondynError:
            return nan  # steps of 2 dt do not follow the motion
        order = motion.run.integrator.order.q
        return float(self._points.apart(fine, coarse) / (2.0**order - 1.0))

    def _end(self, phase: Phase, i: int, t: float, dt: float, steps: int) -> Array:
        run, system = self._motion.run, self._system(phase)
        q, v = self._motion.q[i].copy(), self._motion.v[i].copy()
        system.applied.begin(t, q, v)
        stepper = CorrectedStepper(system, run.integrator, run.drift, dt)
        with np.errstate(all="ignore"):
            for k in range(steps):
                q, v = stepper.take(t + k * dt, q, v, t + (k + 1) * dt)
        return np.asarray(q)

    def _system(self, phase: Phase) -> System:
        """Return the system of a phase, with torques on a line between two samples."""
        key = phase.samples.start
        if key not in self._systems:
            run, scene = self._motion.run, phase.scene
            workspace = Workspace(scene.bilateral.at(0.0), run.solver, drift=run.drift.rows)
            torque = AppliedTorques(scene.robot, self._torque, self._torque.slopes)
            self._systems[key] = System(
                workspace, torque, springs=run.effects.springs, damping=run.effects.damping,
                contacts=scene.contact_bounds,
            )  # fmt: skip
        return self._systems[key]


class _Line:
    """Torques that go from those of one sample to those of another along a line."""

    def __init__(self, nv: int) -> None:
        self._none = np.zeros((nv, nv))
        self.through(0.0, np.zeros(nv), 0.0, np.zeros(nv))

    def through(self, t0: float, tau0: Array, t1: float, tau1: Array) -> None:
        """Lead from tau0 at t0 to tau1 at t1 [s]."""
        self._t, self._tau = t0, tau0
        self._rate: Array = (tau1 - tau0) / (t1 - t0) if t1 > t0 else 0.0 * tau0

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques (nv,) at t [s]."""
        return np.asarray(self._tau + (t - self._t) * self._rate)

    def slopes(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Derivatives of the torques by q and v (nv, nv) each: zero."""
        return self._none, self._none
