"""How a run was made, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from enum import Enum
from typing import TYPE_CHECKING, Any

from condyn_pin._core._pin import pin
from condyn_pin.constraints.drift import Drift
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.events import Happened
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.motion_limits import MotionLimits
from condyn_pin.simulation.remarks import Remark

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Effects:
    """Which effects of a robot's model are on: gravity, springs, damping, armature.

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
            if not isinstance(value, bool):
                raise InvalidArgument(f"{name} = {value!r}: True or False is needed")

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
        """Return in words what is on, what is off, and what the robot does not have."""
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


class RunStatus(Enum):
    """How a run ended, or which of its limits a motion has left."""

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
    def ok(self) -> bool:
        """Whether the run came to its end, or to that of an event, within the limits."""
        return self in (RunStatus.FINISHED, RunStatus.ENDED)

    @property
    def went_on(self) -> bool:
        """Whether the run came to its end, within the limits of the motion or not."""
        return self.ok or self in (
            RunStatus.OPENED, RunStatus.PENETRATED, RunStatus.UNBALANCED,
        )  # fmt: skip

    def __str__(self) -> str:
        return f"{self.name.lower()}: {self.value}"


@dataclass(frozen=True, kw_only=True)
class Run:
    """How a trajectory was made.

    Attributes
    ----------
    duration, dt : float
        What was asked for, and the step [s].
    integrator, drift, solver
        What was used.
    effects : Effects
        What of the robot's model was on.
    limits : MotionLimits
        Of what `Trajectory.status` calls ok.
    status : RunStatus
        How it ended.
    reason : str
        Why it ended where it did; empty if it went to its end.
    happened : tuple of Happened
        The events.
    missed : tuple of str
        Events that did not happen, and why not.
    differenced : int
        How often the function of torques was called for its differences.
    remarks : tuple of Remark
        What its steps have to say, each once with its first time.
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
    happened: tuple[Happened, ...] = ()
    missed: tuple[str, ...] = ()
    differenced: int = 0
    remarks: tuple[Remark, ...] = ()
    wall_time: float = 0.0  # [s]

    @property
    def choices(self) -> str:
        """Integrator, drift scheme and solver, with what is not at its default."""
        return ", ".join(_short(choice) for choice in (self.integrator, self.drift, self.solver))


def _short(value: Any) -> str:
    """Return the repr of a choice with those parameters that are not at their defaults."""
    parameters = (
        f"{f.name}={x!r}" for f in fields(value) if (x := getattr(value, f.name)) != f.default
    )
    return f"{type(value).__name__}({', '.join(parameters)})"


def uninterrupted(motion: Trajectory) -> Trajectory:
    """Return a motion that others are made of, unless Ctrl-C ended it: that stops the whole.

    `simulate` keeps what it has and returns, which is right for viewing the motion, and
    wrong for comparing it with others: a part of one is no measurement.
    """
    if motion.run.status is RunStatus.INTERRUPTED:
        raise KeyboardInterrupt
    return motion
