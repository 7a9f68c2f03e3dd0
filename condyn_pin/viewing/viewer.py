"""Viewer: a picture that is looked at."""

from __future__ import annotations

import atexit
import html as markup
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Final

from condyn_pin._core.arguments import is_whole
from condyn_pin._core.arrays import shown
from condyn_pin._core.files import check_format, check_writable, write_text
from condyn_pin.errors import InvalidArgument
from condyn_pin.viewing.chromium import screenshot
from condyn_pin.viewing.drawing import Drawing
from condyn_pin.viewing.part import Part
from condyn_pin.viewing.server import HOST, Server

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
        What is seen; `notes` says what could not be drawn.
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
        """What could not be drawn, a sentence each."""
        return self.drawing.notes

    @property
    def html(self) -> str:
        """The page: one text that holds everything, and needs no network."""
        if self._html is None:
            self._html = self.drawing.html()
        return self._html

    @property
    def url(self) -> str:
        """Where a browser of this machine finds the page; empty if it is not served."""
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
    """Refuse what is no port of a server."""
    if not is_whole(port) or port not in range(_PORTS):
        raise InvalidArgument(
            f"port = {shown(port)}: a whole number from 1 to {_PORTS - 1} is needed, or 0 for a "
            "free one"
        )


def _has_screen() -> bool:
    """Whether a window can appear: without one, a browser of the terminal would take it over."""
    if sys.platform.startswith("linux"):
        return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    return True


@atexit.register
def _close_all() -> None:
    for viewer in tuple(_open):
        if viewer._opened and viewer._server is not None:
            viewer._server.fetched.wait(_PATIENCE)
        viewer.close()
