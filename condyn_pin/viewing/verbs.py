"""view: look at a robot, a scene, an answer, a motion or an assembly."""

from __future__ import annotations

import sys
from pathlib import Path

from numpy.typing import ArrayLike

from condyn_pin._core.arguments import check_flag
from condyn_pin._core.arrays import finite
from condyn_pin._core.files import check_format, check_writable
from condyn_pin.errors import InvalidArgument
from condyn_pin.viewing.page import require_meshcat
from condyn_pin.viewing.subjects import Look, Subject, drawing_of
from condyn_pin.viewing.viewer import HTML, PNG, Viewer, check_port


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
        Write a page that opens from disk without a network; a picture, of a motion its first
        instant or that of `t`, for which headless Chromium has to be there. With one of them
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
            speed=float(speed),
            look=Look(forces, light, cones, balance),
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
