"""Outcome of a run, and the limits of its motion.

Run: settings, status and events of a run.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from math import isnan
from typing import TYPE_CHECKING, Any

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_type
from condyn_pin._core.arrays import text_of
from condyn_pin._core.show import Outcome
from condyn_pin._core.threads import ThreadCache
from condyn_pin.constraints.drift import Drift
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.events import EventRecord
from condyn_pin.simulation.integrators.integrator import Integrator
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.records import Remark

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
            _short_repr(choice) for choice in (self.integrator, self.drift, self.solver)
        )


def _short_repr(value: Any) -> str:
    """Return the repr of a choice with those parameters that are not at their defaults."""
    parameters = (
        f"{f.name}={x!r}" for f in fields(value) if (x := getattr(value, f.name)) != f.default
    )
    return f"{type(value).__name__}({', '.join(parameters)})"


def uninterrupted(motion: Trajectory) -> Trajectory:
    """Motion that others depend on; KeyboardInterrupt if Ctrl-C ended it."""
    # `simulate` keeps what it has and returns, which is right for viewing the motion, and wrong for
    # comparing it with others: a part of one is no measurement.
    if motion.run.status is RunStatus.INTERRUPTED:
        raise KeyboardInterrupt
    return motion
