"""How soon a picture is there, and how many pictures of a motion a browser shows in a second.

    python benchmarks/viewing.py

Two questions, for Cassie and for Talos:

    start    from the start of the process `condyn view` until its page answers with the robot in it
    play     five seconds of a motion with forces, in headless Chromium, in windows of three sizes:
             how many times of the animation are drawn in a second, what one picture costs and
             consists of, and whether the motion has its real speed; a page without anything beside

Chromium draws here on the processor (SwiftShader), without a graphics card: a lower bound.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import queue
import re
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from argparse import Namespace
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import script
import umsgpack
from script import Printed

import condyn_pin as cp
from condyn_pin._core.timing import machine
from condyn_pin.viewing import part
from condyn_pin.viewing import viewer as chromium
from condyn_pin.viewing.drawing import page, stage

PLAYED = 5.0  # [s]
SIZES = ((640, 480), chromium.SIZE, (1920, 1080))  # [px]
PATIENCE = 300.0  # [s] for a page to answer, and for Chromium to have played


@dataclass(frozen=True)
class Start:
    """How soon `condyn view` showed a robot.

    Attributes
    ----------
    wall : float
        From the start of the process to the whole page [s].
    cpu : float
        Time of the processor that this took [s].
    triangles : int
        Of the robot, in the page.
    """

    wall: float  # [s]
    cpu: float  # [s]
    triangles: int


def start(robot: str) -> Start:
    """Start `condyn view` as a user does, until its page answers with the robot in it."""
    words = [sys.executable, "-m", "condyn_pin", "view", robot, "--no-browser"]
    before = time.perf_counter()
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            html = _page(process)
            wall = time.perf_counter() - before
        finally:
            process.terminate()  # not by SIGINT, which a shell lets its background jobs ignore
            _, _, used = os.wait4(process.pid, 0)
            process.returncode = 0  # it is reaped
    return Start(wall, used.ru_utime + used.ru_stime, triangles_of_robot(html))


def _page(process: subprocess.Popen[str]) -> str:
    """Return the page of a process that prints where it is."""
    assert process.stdout is not None
    for line in process.stdout:
        if found := re.search(r"http://\S+", line):
            with urllib.request.urlopen(found[0], timeout=PATIENCE) as answer:
                return str(answer.read().decode())
    raise RuntimeError("it ended, and served no page")


def triangles_of_robot(html: str) -> int:
    """Return how many triangles a page draws under ``robot/``, of what rests."""
    found = 0
    for packed in re.findall(r'^draw\("(.*)"\);$', html, flags=re.MULTILINE):
        command = umsgpack.unpackb(base64.b64decode(packed))
        if command["type"] == "set_object" and command["path"].startswith("robot/"):
            drawn = command["object"]
            for geometry in drawn.get("geometries", ()):
                index = geometry["data"]["index"]
                width = 2 if index["type"] == "Uint16Array" else 4
                corners = len(index["array"].data) // width
                found += drawn["object"].get("userData", {}).get("whole", corners) // 3
    return found


@dataclass(frozen=True)
class Play:
    """What a browser showed of a motion.

    Attributes
    ----------
    count : int
        Of distinct times of the animation that were drawn.
    pictures : float
        The same in a second [1/s].
    cpu : float
        Time of all processors that one of them took: Chromium's, in all its processes [ms].
    calls, triangles : int
        That one picture consists of, at most.
    ratio : float
        Pixels of the canvas over those of the window, each way.
    speed : float
        Seconds of the motion that went by in one second.
    """

    count: int
    pictures: float  # [1/s]
    cpu: float  # [ms]
    calls: int
    triangles: int
    ratio: float
    speed: float


_COUNT = """<script>
window.addEventListener("load", () => setTimeout(() => {
  viewer.animator.play();  // a page opens still
  let seen = new Set(), first = null, gone = 0, last = 0, calls = 0, triangles = 0;
  function say(what) { return fetch("/", {method: "POST", body: JSON.stringify(what)}); }
  function look(now) {
    let {time, duration} = viewer.animator;
    if (first === null) first = now;
    else gone += (time - last + duration) % duration;
    last = time;
    seen.add(time);
    let drawn = viewer.renderer.info.render;
    calls = Math.max(calls, drawn.calls);
    triangles = Math.max(triangles, drawn.triangles);
    if (now - first < MILLISECONDS || seen.size < 2) { requestAnimationFrame(look); return; }
    say({count: seen.size, seconds: 0.001 * (now - first), gone, calls, triangles,
         ratio: viewer.renderer.getPixelRatio()});
  }
  say({}).then(() => requestAnimationFrame(look));
}, WARM));
</script></body>"""


class _Counter(HTTPServer):
    """Serves a page, and keeps what it says."""

    def __init__(self, page: str) -> None:
        self.page, self.said = page, queue.Queue[dict[str, Any]]()
        super().__init__(("127.0.0.1", 0), _Handler)


class _Handler(BaseHTTPRequestHandler):
    server: _Counter

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.end_headers()
        self.wfile.write(self.server.page.encode())

    def do_POST(self) -> None:
        said = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.said.put(json.loads(said))
        self.send_response(204)
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        pass


def play(
    html: str, seconds: float = PLAYED, warm: float = 3.0, size: tuple[int, int] = chromium.SIZE
) -> Play:
    """Play a page in headless Chromium, in real time, and count what it draws.

    Parameters
    ----------
    html : str
    seconds : float
        That are counted [s]; longer, until there are two pictures.
    warm : float
        That are played before them [s].
    size : (int, int)
        Of the window [px].
    """
    count = _COUNT.replace("MILLISECONDS", str(1e3 * seconds)).replace("WARM", str(1e3 * warm))
    with (
        _Counter(html.replace("</body>", count)) as server,
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
    ):
        threading.Thread(target=server.serve_forever, daemon=True).start()
        words = chromium.command(chromium.find_chromium(), profile)
        words += [f"--window-size={size[0]},{size[1]}"]
        words += ["--remote-debugging-port=0"]  # else it ends as soon as the page is loaded
        words += [f"http://127.0.0.1:{server.server_port}/"]
        with subprocess.Popen(words, stderr=subprocess.DEVNULL) as browser:
            try:
                server.said.get(timeout=PATIENCE)
                before = processor_time(browser.pid)
                said = server.said.get(timeout=PATIENCE)
                used = processor_time(browser.pid) - before
            finally:
                browser.terminate()
                server.shutdown()
    return Play(
        said["count"], said["count"] / said["seconds"], 1e3 * used / said["count"], said["calls"],
        said["triangles"], said["ratio"], said["gone"] / said["seconds"],
    )  # fmt: skip


def processor_time(pid: int) -> float:
    """Return the time that a process and all below it have had [s], as Linux counts it."""
    below: dict[int, list[int]] = {}
    ticks: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            words = stat.read_text(errors="replace").rpartition(")")[2].split()
            below.setdefault(int(words[1]), []).append(int(stat.parent.name))
            ticks[int(stat.parent.name)] = int(words[11]) + int(words[12])
    family = [pid]
    for each in family:  # it grows
        family += below.get(each, [])
    return sum(ticks.get(each, 0) for each in family) / os.sysconf("SC_CLK_TCK")


def motion(robot: str) -> cp.Trajectory:
    """Return five seconds of a robot that swings, held by its pelvis or by its feet."""
    loaded = cp.load_robot(robot)
    held = [cp.SurfaceContact("pelvis")] if robot == "cassie" else list(loaded.contacts)
    scene = cp.Scene(loaded, [*loaded.loops, *held])
    swing = cp.simulate(
        scene, *scene.state(), duration=PLAYED, dt=1e-3,
        integrator=cp.SemiImplicitEuler(), drift=cp.Baumgarte.critical(50.0),
    )  # fmt: skip
    assert swing.status.ok, swing
    return swing


def nothing() -> str:
    """Return a page that plays a motion of nothing: what a picture costs by itself."""
    still = part.track("position", "vector3", np.zeros((round(30 * PLAYED) + 1, 3)))
    commands = [*stage(), part.animation({"nothing": [still]}, 30.0)]
    eye, middle = np.array([1.0, 0.0, 0.0]), np.zeros(3)
    return page("nothing", (), commands, camera=eye, target=middle)


def _played(name: str, html: str, size: tuple[int, int] = chromium.SIZE) -> None:
    seen = play(html, size=size)
    print(f"  {name}, {size[0]} x {size[1]}: {seen.pictures:.1f} pictures a second, "
          f"{seen.cpu:.0f} ms of the processor each, {seen.ratio:.2f} of the pixels each way, "
          f"{seen.calls} draw calls, {seen.triangles} triangles, "
          f"{seen.speed:.2f} of the real speed")  # fmt: skip


def show(_: Namespace) -> None:
    """Print the table."""
    print("{processor} ({cores} cores), {system}, Python {python}, {date}".format(**machine()))
    _played("nothing", nothing())
    for robot in ("cassie", "talos"):
        starts = [start(robot) for _ in range(5)]
        best = min(starts, key=lambda each: each.wall)
        print(f"{robot}: page after {best.wall:.2f} s, {best.cpu:.2f} s of the processor, "
              f"{best.triangles} triangles")  # fmt: skip
        swing = motion(robot)
        for light in (False, True):
            with cp.view(swing, light=light, browser=False) as viewer:
                for size in SIZES:
                    _played("light" if light else "whole", viewer.html, size)


SUBJECTS = [Printed("viewing", "time to a picture, and pictures a second", show)]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
