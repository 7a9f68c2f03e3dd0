"""view: look at a robot, a scene, an answer, a motion or an assembly."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.files.beside import check_format, check_writable
from condyn_pin._core.parameters import check_flag
from condyn_pin.control.answer import ControlAnswer
from condyn_pin.control.balancing import Balance
from condyn_pin.control.balancing import balance as balance_of
from condyn_pin.control.inverse import InverseDynamics
from condyn_pin.dynamics.force import Sites
from condyn_pin.dynamics.postures import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Solution
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.mechanism.assembly import Assembly
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.step_solution import StepSolution
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.viewing.drawing import Drawing, draw
from condyn_pin.viewing.moment import moment
from condyn_pin.viewing.motion import gaps_of, moments_of, peaks_of, shown
from condyn_pin.viewing.page import require_meshcat
from condyn_pin.viewing.touching import Felt
from condyn_pin.viewing.viewer import HTML, PNG, Viewer, check_port

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


def view(
    subject: Subject,
    q: ArrayLike | None = None,
    *,
    posture: str | None = None,
    t: float | None = None,
    forces: bool = True,
    speed: float = 1.0,
    light: bool = False,
    cones: bool = False,
    balance: bool = False,
    html: str | Path | None = None,
    png: str | Path | None = None,
    browser: bool = True,
    port: int = 0,
) -> Viewer:
    """Show a robot, an answer or a motion in meshcat's viewer: in a browser, a notebook, or a file.

    It shows the robot as its description draws it, or else rods between its joints and the
    ellipsoids of its inertias; driven joints in orange, passive ones dark; both frames of every
    loop, and the gap between them coloured by its length and labelled in mm; contacts, and for
    those that may open the planes that they may touch, coloured by whether they stick or slide; the
    forces of an answer or of a motion on the bodies that feel them; and the centre of mass. A
    motion has buttons to play and pause, with sliders for time and speed. A planar linkage is
    viewed along the normal of its plane. An assembly is shown next to a pale robot in the
    configuration where it started.

    Parameters
    ----------
    subject : Robot, Scene, Solution, StepSolution, InverseDynamics, ControlAnswer, Trajectory, \
            Assembly
        A robot is shown with all its loops, a step at its end.
    q : (nq,) array_like, optional
        For a robot or a scene: its configuration, taken as it is, loops open or not.
    posture : str, optional
        For a robot or a scene, in place of q: a posture, its loops closed if they can be. The first
        one by default.
    t : float, optional
        For a motion: only its sample nearest to this time [s]. All of it is played by default.
    forces : bool
        Draw the forces of an answer, a step or a motion.
    speed : float
        Seconds of a motion that are played in one second; 30 pictures in each.
    light : bool
        Draw the robot with at most 30 000 triangles, for a small page.
    cones : bool
        Draw the friction cones of contacts that may let go, unless they are open.
    balance : bool
        Draw the support polygon, the centre of pressure, the capture point and the DCM of a
        `ControlAnswer` or a `Trajectory`, where they exist; `control.Balance` says what they are.
    html, png : path, optional
        Write a page that opens from disk without a network; a picture, of a motion its
        first moment or that of `t`, for which headless Chromium has to be there. With one of them
        nothing is opened, and no server is started.
    browser : bool
        Open the browser of the user, where there is a screen. A notebook shows the picture itself.
    port : int
        For the server; a free one by default.

    Returns
    -------
    Viewer
        With `url`, `save_html`, `save_png` and `close`.

    Raises
    ------
    MissingExtra
        If meshcat is not installed, or Chromium is not, for a PNG.
    InvalidArgument
        If the subject is none of these, or an argument does not fit it.
    UnknownName
        If there is no such posture.

    Notes
    -----
    A page of Talos has 3.8 MB, and 1.6 MB if it is light; 0.9 MB of them are meshcat's viewer.

    Without a graphics card, moving parts are drawn with at most 10 000 triangles, and with as many
    pixels as 30 frames per second allow; at rest everything is drawn in full detail.
    """
    if not finite("speed", speed, ()) > 0:
        raise InvalidArgument(f"speed = {speed!r}: a positive number is needed")
    require_meshcat()
    check_port(port)
    check_flag("browser", browser)
    for path, endings in ((html, HTML), (png, PNG)):
        if path is not None:
            check_format(path, *endings)
            check_writable(path)
    viewer = Viewer(
        drawing_of(
            subject,
            q,
            posture=posture,
            t=t,
            forces=forces,
            speed=float(speed),
            light=light,
            cones=cones,
            balance=balance,
        )
    )
    if html is not None:
        viewer.save_html(html)
    if png is not None:
        viewer.save_png(png)
    if html is None and png is None:
        viewer.serve(port)
        if browser and "ipykernel" not in sys.modules:
            viewer.open()
    return viewer


def drawing_of(
    subject: Subject,
    q: ArrayLike | None = None,
    *,
    posture: str | None = None,
    t: float | None = None,
    forces: bool = True,
    speed: float = 1.0,
    light: bool = False,
    cones: bool = False,
    balance: bool = False,
) -> Drawing:
    """Return what `view` shows of a subject, without a page."""
    flags = {"forces": forces, "light": light, "cones": cones, "balance": balance}
    for name, value in flags.items():
        check_flag(name, value)
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
    if balance and not isinstance(subject, ControlAnswer | Trajectory):
        raise InvalidArgument(
            f"balance: a {type(subject).__name__} does not know v and forces; a ControlAnswer "
            "and a Trajectory do"
        )
    if t is not None and not isinstance(subject, Trajectory):
        raise InvalidArgument(f"t: a {type(subject).__name__} is not a motion, and has no times")
    if isinstance(subject, Robot):
        subject = Scene(subject, subject.loops)
    if isinstance(subject, Scene):
        q, name = _configuration(subject, q, posture)
        title = f"{subject.robot.name}, {name}" if name else subject.robot.name
        return draw([subject], [moment(subject, q)], title=title, light=light, cones=cones)
    if q is not None or posture is not None:
        given = "q" if q is not None else "posture"
        raise InvalidArgument(f"{given}: a {type(subject).__name__} has its own configuration")
    if isinstance(subject, Trajectory):
        if t is not None:
            return _sample(subject, t, forces, light, cones, balance)
        return _motion(subject, forces, speed, light, cones, balance)
    if isinstance(subject, StepSolution):
        return _step(subject, forces, light, cones)
    scene, said, before = subject.scene, "inverse dynamics", None
    acting = subject.forces if forces and not isinstance(subject, Assembly) else {}
    if isinstance(subject, Solution):
        said = subject.status.name.lower()
    elif isinstance(subject, ControlAnswer):
        said = f"control: {subject.status.name.lower()}"
    elif isinstance(subject, Assembly):
        said = f"assembled: {subject.status.name.lower().replace('_', ' ')}"
        before = moment(scene, subject.start)
    pressing = _balance(subject) if balance and isinstance(subject, ControlAnswer) else None
    at = moment(scene, subject.q, acting, balance=pressing)
    title = f"{scene.robot.name}, {said}"
    return draw([scene], [at], title=title, before=before, light=light, cones=cones)


def _balance(answer: ControlAnswer) -> Balance | None:
    """Return the balance of an answer; None of one that is none."""
    if not np.isfinite(answer.lam).all():
        return None
    return balance_of(answer.scene, answer.q, answer.v, answer.a, answer.lam)


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


def _step(step: StepSolution, forces: bool, light: bool, cones: bool) -> Drawing:
    """Return the drawing of a step at its end, with the mean forces in it."""
    scene, q = step.scene, step.q
    acting = Sites(scene, q).forces(step.lam / step.dt) if forces else {}
    at = moment(scene, q, acting, Felt(step.forces if forces else {}, step.modes))
    title = f"{scene.robot.name}, a step of {step.dt:g} s, {step.status.name.lower()}"
    return draw([scene], [at], title=title, light=light, cones=cones)


def _sample(
    trajectory: Trajectory, t: float, forces: bool, light: bool, cones: bool, balance: bool
) -> Drawing:
    """Return the drawing of one sample of a motion."""
    start, end = trajectory.t[[0, -1]]
    if not start <= finite("t", t, ()) <= end:
        raise InvalidArgument(f"t = {t}: the motion goes from {start:g} s to {end:g} s")
    k = int(np.abs(trajectory.t - t).argmin())
    moments = moments_of(trajectory, [k], forces=forces, balance=balance)
    scenes = [phase.scene for phase in trajectory.phases]
    title = f"{scenes[0].robot.name} at {trajectory.t[k]:.4g} s"
    return draw(scenes, moments, title=title, light=light, cones=cones)


def _motion(
    trajectory: Trajectory, forces: bool, speed: float, light: bool, cones: bool, balance: bool
) -> Drawing:
    scenes = [phase.scene for phase in trajectory.phases]
    fps = _FPS / speed  # pictures for each second of the motion
    samples = shown(trajectory, fps)
    moments = moments_of(trajectory, samples.tolist(), forces=forces, balance=balance)
    frames = fps * (trajectory.t[samples] - trajectory.t[0])
    duration = trajectory.t[-1] - trajectory.t[0]
    title = f"{scenes[0].robot.name}, {duration:.4g} s"
    title += f", {speed:g} x speed" if speed != 1.0 else ""
    return draw(
        scenes, moments, title=title, frames=frames, gaps=gaps_of(trajectory),
        peaks=peaks_of(trajectory), fps=_FPS, speed=speed, light=light, cones=cones,
    )  # fmt: skip
