"""Viewer: a picture, its page, and the server that shows it."""

from __future__ import annotations

import atexit
import html as markup
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from numpy.typing import ArrayLike

from condyn_pin._core.arguments import check_flag, is_whole
from condyn_pin._core.arrays import finite, text_of
from condyn_pin._core.files import atomic_write, check_format, check_writable, write_text
from condyn_pin.errors import BrowserFailed, InvalidArgument, MissingExtra
from condyn_pin.viewing.drawing import Drawing, Subject, ViewOptions, drawing_of, require_meshcat
from condyn_pin.viewing.part import Part

_PORTS: Final = 2**16
# What the names of a page and of a picture may end with.
HTML: Final = (".html", ".htm")
PNG: Final = (".png",)

_PATIENCE: Final = 10.0  # [s] in which a browser that was opened fetches the page


class Viewer:
    """A picture, and the server that shows it to a browser.

    The page holds everything, so once a browser has loaded it, it works without the server. The
    server runs in this process until `close` or the end of the program. A `Viewer` is also a
    context manager.

    Attributes
    ----------
    drawing : Drawing
        The picture; its `notes` name the parts that cannot be drawn.
    """

    def __init__(self, drawing: Drawing) -> None:
        self.drawing = drawing
        self._html: str | None = None
        self._server: Server | None = None
        self._thread: threading.Thread | None = None
        self._opened = False

    @property
    def parts(self) -> dict[str, Part]:
        """The parts of the picture by path."""
        return {part.path: part for part in self.drawing.parts}

    @property
    def notes(self) -> tuple[str, ...]:
        """Parts of the subject that cannot be drawn, a sentence each."""
        return self.drawing.notes

    @property
    def html(self) -> str:
        """The page: one text that holds everything, and needs no network."""
        if self._html is None:
            self._html = self.drawing.html()
        return self._html

    @property
    def url(self) -> str:
        """Address of the page for a browser on this machine; empty if it is not served."""
        return f"http://{HOST}:{self._server.server_port}/" if self._server else ""

    def save_html(self, path: str | Path) -> None:
        """Write the page to a file, which opens from disk without a network."""
        check_format(path, *HTML)
        write_text(path, self.html)

    def save_png(self, path: str | Path) -> None:
        """Write the first instant to a picture, drawn by headless Chromium.

        Raises
        ------
        MissingExtra
            If there is no Chromium; the text says how to get one.
        BrowserFailed
            If it made no picture.
        InvalidArgument
            If the name of the file says another format, or it cannot be written.
        """
        check_format(path, *PNG)
        check_writable(path)  # a picture takes seconds
        still = self.drawing.first.html()
        screenshot(still.replace("</style>", ".dg { display: none; }</style>", 1), Path(path))

    def serve(self, port: int) -> None:
        """Serve the page at a port; at a free one if it is 0."""
        if self._server is not None:
            return
        check_port(port)
        try:
            self._server = Server(self.html.encode(), port)
        except OSError as error:
            raise InvalidArgument(
                f"port = {port}: {error.strerror}; leave it out, and a free one is taken"
            ) from error
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()
        _open.add(self)

    def open(self) -> None:
        """Open the page in the user's browser, if there is a screen."""
        if not _has_screen():
            return
        self._opened = True
        # Another Python opens it, so that no process of the browser is a child of this one.
        words = [sys.executable, "-m", "webbrowser", self.url]
        try:
            subprocess.run(words, capture_output=True, timeout=_PATIENCE, check=False)
        except subprocess.TimeoutExpired:
            self._opened = False

    def wait(self) -> None:
        """Wait until `close`, or for Ctrl-C."""
        while self._thread is not None and self._thread.is_alive():
            self._thread.join(0.2)

    def close(self) -> None:
        """Stop the server; pages that a browser has stay as they are."""
        _open.discard(self)
        if self._server is not None and self._thread is not None:
            self._server.shutdown()
            self._thread.join()
            self._server.server_close()
        self._server = self._thread = None

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _repr_html_(self) -> str:
        """Return the picture for a notebook: the page itself, so it needs no server."""
        return (
            f'<iframe srcdoc="{markup.escape(self.html)}" style="width: 100%; height: 480px; '
            'border: none"></iframe>'
        )

    def __repr__(self) -> str:
        where = f" at {self.url}" if self._server else ""
        return f"Viewer({self.drawing.title}: {len(self.drawing.parts)} parts{where})"


_open: set[Viewer] = set()  # a viewer that nobody holds is still looked at


def check_port(port: object) -> None:
    """Refuse numbers that are no port of a server."""
    if not is_whole(port) or port not in range(_PORTS):
        raise InvalidArgument(
            f"port = {text_of(port)}: a whole number from 1 to {_PORTS - 1} is needed, or 0 for a "
            "free one"
        )


def _has_screen() -> bool:
    """True if a window can appear: without a screen, a text browser would block the terminal."""
    if sys.platform.startswith("linux"):
        return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    return True


@atexit.register
def _close_all() -> None:
    for viewer in tuple(_open):
        if viewer._opened and viewer._server is not None:
            viewer._server.fetched.wait(_PATIENCE)
        viewer.close()


# Server: one page, for browsers of this machine only.
#
# That it listens at 127.0.0.1 is not enough: a page of somebody else, in a browser of this machine,
# may have its own name resolved to that address (DNS rebinding), and would read what is served
# under it. So a request has to name this machine as its host, and as its origin if it has one. A
# few connections are served at a time, none of them for long: who opens many, or says nothing on
# them, takes no more of the process.


HOST: Final = "127.0.0.1"

_LOCAL: Final = (HOST, "localhost", "::1")
_CONNECTIONS: Final = 16  # at a time: a browser opens six
_REQUEST_TIMEOUT: Final = 10.0  # [s] for the next bytes of a request, or of an answer to be taken


class Server(ThreadingHTTPServer):
    """Serves one page, to this machine only.

    port: A free one if it is 0
    """

    daemon_threads = True
    request_queue_size = 4 * _CONNECTIONS

    def __init__(self, page: bytes, port: int) -> None:
        self.page, self.fetched = page, threading.Event()
        self._free = threading.BoundedSemaphore(_CONNECTIONS)
        super().__init__((HOST, port), _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread of its own, or hang up if there are too many."""
        if not self._free.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except BaseException:  # no thread could be started
            self._free.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection, and release its slot."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing about a broken connection: the terminal is the user's."""


class _Handler(BaseHTTPRequestHandler):
    server: Server
    timeout = _REQUEST_TIMEOUT

    def do_GET(self) -> None:
        """Send the page."""
        if not self._is_local():
            self.send_error(403, "Only this machine is served")
            return
        if self.path != "/":
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(self.server.page)))
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        with suppress(OSError):  # who reads no further has seen enough
            self.wfile.write(self.server.page)
            self.server.fetched.set()

    def _is_local(self) -> bool:
        """True if the only Host of a request is this machine, and so is its Origin, if any."""
        hosts, origins = (self.headers.get_all(name, []) for name in ("Host", "Origin"))
        if len(hosts) != 1 or not _local(f"//{hosts[0]}"):
            return False
        return all(_local(origin) for origin in origins)

    def log_message(self, format: str, *args: Any) -> None:
        """Print no log."""


def _local(address: str) -> bool:
    """True if an address is of this machine, at any port: ports may be forwarded."""
    try:
        return urlsplit(address).hostname in _LOCAL
    except ValueError:
        return False


# A picture without a screen: headless Chromium draws a page into a PNG.


_NAMES: Final = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome",
    "microsoft-edge", "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
)  # fmt: skip

# As without a graphics card: SwiftShader draws WebGL on the processor, and Chromium all else.
_SOFTWARE: Final = (
    "--use-gl=angle", "--use-angle=swiftshader-webgl", "--enable-unsafe-swiftshader"
)  # fmt: skip

_VIRTUAL: Final = 100  # [ms] of the page's own clock, which runs as fast as the work is done
# A picture takes some seconds. On a machine with other work Chromium hangs once in 25 starts, and
# the next one does not.
_LIMIT: Final = 60.0  # [s]
_STARTS: Final = 2

SIZE: Final = (1280, 960)  # [px]


def find_chromium() -> str:
    """Return the path of Chromium or one of its relatives, or raise MissingExtra."""
    for name in _NAMES:
        if path := shutil.which(name):
            return path
    raise MissingExtra(
        "a PNG needs Chromium, and none is on the PATH: apt-get install chromium (Debian, Ubuntu "
        "from its own archive), or brew install --cask chromium; or write html=..., which any "
        "browser shows"
    )


def command(chromium: str, profile: str) -> list[str]:
    """Return the command line of headless Chromium with a profile of its own."""
    words = [chromium, "--headless", *_SOFTWARE, "--hide-scrollbars", "--no-first-run",
             "--disable-extensions", "--disable-dev-shm-usage"]  # fmt: skip
    words.append(f"--user-data-dir={profile}")
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        words.append("--no-sandbox")  # as root it starts in no other way
    return words


def screenshot(html: str, png: Path) -> None:
    """Draw a page into a file.

    Raises
    ------
    MissingExtra
        If there is no Chromium.
    BrowserFailed
        If it made no picture; the text has its last words.
    """
    chromium, said = find_chromium(), ""
    for _ in range(_STARTS):
        # a folder that is not empty when it is removed: Chromium's last processes still write there
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            picture, said, hung = _start(chromium, html, Path(folder))
            if picture.is_file():
                with atomic_write(png) as new:
                    shutil.copyfile(picture, new)
                return
        if not hung:
            break
    raise BrowserFailed(f"{chromium} made no picture: {said or 'no reason'}")


def _start(chromium: str, html: str, folder: Path) -> tuple[Path, str, bool]:
    """Path of the picture, last line of Chromium's stderr, and True if it timed out."""
    page, picture = folder / "page.html", folder / "picture.png"
    page.write_text(html, encoding="utf-8")
    words = [
        *command(chromium, str(folder / "profile")),
        f"--window-size={SIZE[0]},{SIZE[1]}",
        f"--virtual-time-budget={_VIRTUAL}",
        f"--screenshot={picture}",
        page.as_uri(),
    ]
    try:
        done = subprocess.run(words, capture_output=True, timeout=_LIMIT, check=False)
    except subprocess.TimeoutExpired:
        return picture, f"it did not end within {_LIMIT:g} s", True
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    return picture, lines[-1] if lines else "", False


# view: look at a robot, a scene, an answer, a motion or an assembly.


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
        Draw the friction cones of contacts that may open, unless they are open.
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
            look=ViewOptions(forces, light, cones, balance),
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
