"""view: look at a robot, a scene, an answer, a motion or an assembly."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from numpy.typing import ArrayLike

from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.files.beside import check_writable
from condyn_pin.control.inverse import InverseDynamics
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Solution
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.mechanism.assembly import Assembly
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.viewing.drawing import Drawing, draw
from condyn_pin.viewing.moment import moment
from condyn_pin.viewing.motion import gaps_of, moments_of, peaks_of, shown
from condyn_pin.viewing.page import require_meshcat
from condyn_pin.viewing.viewer import Viewer, check_port

Subject = Robot | Scene | Solution | InverseDynamics | Trajectory | Assembly

_FPS = 30.0  # [1/s]


def view(
    subject: Subject,
    q: ArrayLike | None = None,
    *,
    posture: str | None = None,
    forces: bool = True,
    speed: float = 1.0,
    light: bool = False,
    html: str | Path | None = None,
    png: str | Path | None = None,
    browser: bool = True,
    port: int = 0,
) -> Viewer:
    """Look at something in meshcat's viewer: in a browser, in a notebook, or in a file.

    What is seen: the robot as its description draws it, or else rods between its joints and the
    ellipsoids of its inertias; joints with a motor orange, passive ones dark; both frames of every
    loop, and the gap between them coloured by its length, with its size in mm; contacts; the forces
    of an answer or of a motion on the bodies that feel them; the centre of mass. A motion has
    buttons to play and to pause, a slider for time, and `timeScale` for speed, under Animations. An
    assembly is seen beside the pale robot that it started from.

    Parameters
    ----------
    subject : Robot, Scene, Solution, InverseDynamics, Trajectory or Assembly
        A robot is shown with all its loops.
    q : (nq,) array_like, optional
        For a robot or a scene: its configuration, taken as it is, loops open or not.
    posture : str, optional
        For a robot or a scene, in place of q: a posture, its loops closed if they can be. The first
        one by default.
    forces : bool
        Draw the forces of a `Solution`, an `InverseDynamics` or a `Trajectory`.
    speed : float
        Seconds of a motion that are played in one second; 30 pictures in each.
    light : bool
        Draw the robot with at most 30 000 triangles, for a small page.
    html, png : path, optional
        Write a page that opens from disk without a network; a picture of the first moment, for
        which headless Chromium has to be there. With one of them nothing is opened, and no server
        is started.
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

    Where a processor draws, without a graphics card, what moves has 10 000 triangles at most, and
    as many pixels as 30 pictures a second allow; what rests is whole and sharp.
    """
    if not finite("speed", speed, ()) > 0:
        raise InvalidArgument(f"speed = {speed!r}: a positive number is needed")
    require_meshcat()
    check_port(port)
    for path in (html, png):
        if path is not None:
            check_writable(path)
    viewer = Viewer(_drawing(_Wish(q, posture, forces, float(speed), light), subject))
    if html is not None:
        viewer.save_html(html)
    if png is not None:
        viewer.save_png(png)
    if html is None and png is None:
        viewer.serve(port)
        if browser and "ipykernel" not in sys.modules:
            viewer.open()
    return viewer


@dataclass(frozen=True, eq=False)
class _Wish:
    """How a subject is to be seen."""

    q: ArrayLike | None
    posture: str | None
    forces: bool
    speed: float
    light: bool


def _drawing(wish: _Wish, subject: Subject) -> Drawing:
    if not isinstance(subject, Subject):
        raise InvalidArgument(
            f"subject = {subject!r}: a Robot, a Scene, a Solution, an InverseDynamics, a "
            "Trajectory or an Assembly is needed; of a batch, one: batch[i]"
        )
    if isinstance(subject, Robot):
        subject = Scene(subject, subject.loops)
    if isinstance(subject, Scene):
        q, name = _configuration(subject, wish)
        title = f"{subject.robot.name}, {name}" if name else subject.robot.name
        return draw([subject], [moment(subject, q)], title=title, light=wish.light)
    if wish.q is not None or wish.posture is not None:
        given = "q" if wish.q is not None else "posture"
        raise InvalidArgument(f"{given}: a {type(subject).__name__} has its own configuration")
    if isinstance(subject, Solution | InverseDynamics):
        forces = subject.forces if wish.forces else {}
        at = moment(subject.scene, subject.q, forces)
        said = "inverse dynamics"
        if isinstance(subject, Solution):
            said = subject.status.name.lower()
        title = f"{subject.scene.robot.name}, {said}"
        return draw([subject.scene], [at], title=title, light=wish.light)
    if isinstance(subject, Assembly):
        scene = subject.scene
        title = f"{scene.robot.name}, assembled: {subject.status.name.lower().replace('_', ' ')}"
        before, after = moment(scene, subject.start), moment(scene, subject.q)
        return draw([scene], [after], title=title, before=before, light=wish.light)
    return _motion(wish, subject)


def _configuration(scene: Scene, wish: _Wish) -> tuple[Array, str]:
    """Return what is shown of a scene, and how it is called."""
    if wish.q is not None:
        if wish.posture is not None:
            raise InvalidArgument("posture: q is given too; leave one of them out")
        return normalised(scene.robot.model, "q", wish.q), ""
    name = wish.posture or next(iter(scene.robot.postures), "neutral")
    try:
        return scene.state(wish.posture)[0], name
    except NotAssembled:
        return scene.guess(wish.posture), f"{name}, as described: it cannot be closed"


def _motion(wish: _Wish, trajectory: Trajectory) -> Drawing:
    scenes = [phase.scene for phase in trajectory.phases]
    fps = _FPS / wish.speed  # pictures for each second of the motion
    samples = shown(trajectory, fps)
    moments = moments_of(trajectory, samples, forces=wish.forces)
    frames = fps * (trajectory.t[samples] - trajectory.t[0])
    duration = trajectory.t[-1] - trajectory.t[0]
    title = f"{scenes[0].robot.name}, {duration:.4g} s"
    title += f", {wish.speed:g} x speed" if wish.speed != 1.0 else ""
    return draw(
        scenes, moments, title=title, frames=frames, gaps=gaps_of(trajectory),
        peaks=peaks_of(trajectory), fps=_FPS, light=wish.light,
    )  # fmt: skip
