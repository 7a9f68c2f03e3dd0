"""What is drawn of each kind of subject: a robot, a scene, an answer, a step, a motion."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arguments import check_flag, normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin.control.answer import ControlAnswer
from condyn_pin.control.balancing import Balance
from condyn_pin.control.balancing import balance as balance_of
from condyn_pin.control.inverse import InverseDynamics
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Sites, Solution
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.mechanism.closing import Assembly
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.step import StepSolution
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.viewing.drawing import Drawing, draw
from condyn_pin.viewing.instant import instant
from condyn_pin.viewing.motion import gaps_of, instants_of, peaks_of, shown
from condyn_pin.viewing.touching import Felt

Subject = (
    Robot
    | Scene
    | Solution
    | StepSolution
    | InverseDynamics
    | ControlAnswer
    | Trajectory
    | Assembly
)

_FPS = 30.0  # [1/s]


@dataclass(frozen=True)
class Look:
    """What is drawn of a subject, and how; `view` says what each flag means."""

    forces: bool = True
    light: bool = False
    cones: bool = False
    balance: bool = False

    def __post_init__(self) -> None:
        for flag in fields(self):
            check_flag(flag.name, getattr(self, flag.name))


_USUAL = Look()


def drawing_of(
    subject: Subject,
    q: ArrayLike | None = None,
    *,
    posture: str | None = None,
    t: float | None = None,
    speed: float = 1.0,
    look: Look = _USUAL,
) -> Drawing:
    """Return what `view` shows of a subject, without a page."""
    _check(subject, t, look)
    if isinstance(subject, Robot):
        subject = Scene(subject, subject.loops)
    if isinstance(subject, Scene):
        return _scene(subject, q, posture, look)
    if q is not None or posture is not None:
        given = "q" if q is not None else "posture"
        raise InvalidArgument(f"{given}: a {type(subject).__name__} has its own configuration")
    if isinstance(subject, Trajectory):
        return _motion(subject, speed, look) if t is None else _sample(subject, t, look)
    if isinstance(subject, StepSolution):
        return _step(subject, look)
    return _answer(subject, look)


def _check(subject: Subject, t: float | None, look: Look) -> None:
    """Refuse what cannot be drawn, and what a subject does not have."""
    if not isinstance(subject, Subject):
        if isinstance(subject, str):
            raise InvalidArgument(
                f"subject = {subject!r}: load_robot makes a Robot of a name or a path, and "
                "Trajectory.load a motion of a file"
            )
        raise InvalidArgument(
            f"subject = {subject!r}: a Robot, a Scene, a Solution, a StepSolution, an "
            "InverseDynamics, a ControlAnswer, a Trajectory or an Assembly is needed; of a batch, "
            "one: batch[i]"
        )
    if look.balance and not isinstance(subject, ControlAnswer | Trajectory):
        raise InvalidArgument(
            f"balance: a {type(subject).__name__} does not know v and forces; a ControlAnswer "
            "and a Trajectory do"
        )
    if t is not None and not isinstance(subject, Trajectory):
        raise InvalidArgument(f"t: a {type(subject).__name__} is not a motion, and has no times")


def _scene(scene: Scene, q: ArrayLike | None, posture: str | None, look: Look) -> Drawing:
    """Return the drawing of a scene in a configuration, or in a posture."""
    at, name = _configuration(scene, q, posture)
    title = f"{scene.robot.name}, {name}" if name else scene.robot.name
    return draw([scene], [instant(scene, at)], title=title, light=look.light, cones=look.cones)


def _configuration(scene: Scene, q: ArrayLike | None, posture: str | None) -> tuple[Array, str]:
    """Return what is shown of a scene, and how it is called."""
    if q is not None:
        if posture is not None:
            raise InvalidArgument("posture: q is given too; give only one of them")
        return normalised(scene.robot.model, "q", q), ""
    name = posture or next(iter(scene.robot.postures), "neutral")
    try:
        return scene.state(posture)[0], name
    except NotAssembled:
        return described_posture(scene, posture), f"{name}, as described: it cannot be closed"


def _answer(subject: Solution | InverseDynamics | ControlAnswer | Assembly, look: Look) -> Drawing:
    """Return the drawing of an answer at its state, with its forces; of an assembly, its start."""
    scene, said, before = subject.scene, "inverse dynamics", None
    acting = subject.forces if look.forces and not isinstance(subject, Assembly) else {}
    if isinstance(subject, Solution):
        said = subject.status.name.lower()
    elif isinstance(subject, ControlAnswer):
        said = f"control: {subject.status.name.lower()}"
    elif isinstance(subject, Assembly):
        said = f"assembled: {subject.status.name.lower().replace('_', ' ')}"
        before = instant(scene, subject.start)
    pressing = _balance(subject) if look.balance and isinstance(subject, ControlAnswer) else None
    at = instant(scene, subject.q, acting, balance=pressing)
    title = f"{scene.robot.name}, {said}"
    return draw([scene], [at], title=title, before=before, light=look.light, cones=look.cones)


def _balance(answer: ControlAnswer) -> Balance | None:
    """Return the balance of an answer; None of one that is none."""
    if not np.isfinite(answer.lam).all():
        return None
    return balance_of(answer.scene, answer.q, answer.v, answer.a, answer.lam)


def _step(step: StepSolution, look: Look) -> Drawing:
    """Return the drawing of a step at its end, with the mean forces in it."""
    scene, q = step.scene, step.q
    acting = Sites(scene, q).forces(step.lam / step.dt) if look.forces else {}
    at = instant(scene, q, acting, Felt(step.forces if look.forces else {}, step.modes))
    title = f"{scene.robot.name}, a step of {step.dt:g} s, {step.status.name.lower()}"
    return draw([scene], [at], title=title, light=look.light, cones=look.cones)


def _sample(trajectory: Trajectory, t: float, look: Look) -> Drawing:
    """Return the drawing of one sample of a motion."""
    start, end = trajectory.t[[0, -1]]
    if not start <= finite("t", t, ()) <= end:
        raise InvalidArgument(f"t = {t}: the motion goes from {start:g} s to {end:g} s")
    k = int(np.abs(trajectory.t - t).argmin())
    instants = instants_of(trajectory, [k], forces=look.forces, balance=look.balance)
    scenes = [phase.scene for phase in trajectory.phases]
    title = f"{scenes[0].robot.name} at {trajectory.t[k]:.4g} s"
    return draw(scenes, instants, title=title, light=look.light, cones=look.cones)


def _motion(trajectory: Trajectory, speed: float, look: Look) -> Drawing:
    """Return the drawing of a whole motion."""
    scenes = [phase.scene for phase in trajectory.phases]
    fps = _FPS / speed  # pictures for each second of the motion
    samples = shown(trajectory, fps)
    instants = instants_of(trajectory, samples.tolist(), forces=look.forces, balance=look.balance)
    frames = fps * (trajectory.t[samples] - trajectory.t[0])
    duration = trajectory.t[-1] - trajectory.t[0]
    title = f"{scenes[0].robot.name}, {duration:.4g} s"
    title += f", {speed:g} x speed" if speed != 1.0 else ""
    return draw(
        scenes, instants, title=title, frames=frames, gaps=gaps_of(trajectory),
        peaks=peaks_of(trajectory), fps=_FPS, speed=speed, light=look.light,
        cones=look.cones,
    )  # fmt: skip
