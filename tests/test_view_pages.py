"""Pages: in files, from a server, from the command line, and in a browser."""

from __future__ import annotations

import colorsys
import json
import os
import re
import subprocess
import sys
import urllib.error
import urllib.request
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from shared import calls, robot
from typer.testing import CliRunner
from viewed import bent_cassie, drawing, falling_bar

import condyn_pin as cp
from condyn_pin.cli import app
from condyn_pin.viewing import chromium, page, palette
from condyn_pin.viewing.motion import tracks

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
PATIENCE = 300.0  # [s] that no machine needs, for what may hang


@pytest.fixture(scope="module")
def standing():
    return bent_cassie()


@pytest.fixture(scope="module")
def swinging():
    return falling_bar()


# Pages


class _Requests(HTMLParser):
    def __init__(self):
        super().__init__()
        self.asked = []

    def handle_starttag(self, tag, attrs):
        self.asked += [value for key, value in attrs if key in ("src", "href")]


def test_a_light_page_of_talos_is_small_and_asks_for_nothing(tmp_path):
    path = tmp_path / "talos.html"
    cp.view(cp.load_robot("talos"), html=path, light=True)
    assert path.stat().st_size < 3e6
    reader = _Requests()
    reader.feed(path.read_text(encoding="utf-8"))
    assert reader.asked == []


def test_the_same_picture_is_the_same_page():
    bar = cp.four_bar()
    assert drawing(bar).html() == drawing(bar).html()


def test_a_notebook_gets_the_page_itself():
    with cp.view(cp.pendulum(), browser=False) as viewer:
        text = viewer._repr_html_()
    assert text.startswith("<iframe srcdoc=")
    assert "<script" not in text


# The server


def test_ports_are_chosen_and_closing_frees_them():
    one, two = (cp.view(cp.pendulum(), browser=False) for _ in range(2))
    assert one.url != two.url
    with urllib.request.urlopen(one.url, timeout=PATIENCE) as answer:
        assert answer.read().decode() == one.html
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(f"{one.url}other", timeout=PATIENCE)
    refused.value.close()
    with pytest.raises(cp.InvalidArgument, match="a free one is taken"):
        cp.view(cp.pendulum(), browser=False, port=int(two.url.split(":")[2].strip("/")))
    server = one._server
    one.close()
    one.close()
    two.close()
    assert one.url == ""
    assert server.fileno() == -1


def test_a_program_that_forgets_its_viewer_ends_cleanly():
    code = (
        "import condyn_pin as cp, urllib.request, gc\n"
        "url = cp.view(cp.pendulum(), browser=False).url; gc.collect()\n"
        "assert urllib.request.urlopen(url, timeout=300).read(15) == b'<!DOCTYPE html>'\n"
    )
    words = [sys.executable, "-W", "error", "-W", "ignore:Please update:DeprecationWarning"]
    done = subprocess.run([*words, "-c", code], capture_output=True, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", ["cassie", "talos"])
def test_the_command_shows_a_robot(name, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import viewing

    assert viewing.start(name).triangles > 10_000


@pytest.mark.parametrize("name", ["cassie", "talos"])
def test_a_page_takes_few_calls(name):
    """Meshes go through arrays, not number by number; `benchmarks/viewing.py` has the seconds."""
    loaded = robot(name)
    assert calls(lambda: drawing(loaded).html()) < 300_000


# What cannot be


def test_without_meshcat_the_remedy_is_named(monkeypatch):
    monkeypatch.setattr(page.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(cp.MissingExtra, match=r"pip install \"condyn_pin\[view\]\""):
        cp.view(cp.pendulum(), html="never.html")
    assert not Path("never.html").exists()


def test_without_chromium_the_remedy_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(cp.MissingExtra, match="apt-get install chromium"):
        cp.view(cp.pendulum(), png=tmp_path / "p.png")


def test_a_browser_that_fails_is_quoted(monkeypatch, tmp_path):
    broken = tmp_path / "chromium"
    broken.write_text("#!/bin/sh\necho no such screen >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    with pytest.raises(cp.BrowserFailed, match="no such screen"):
        cp.view(cp.pendulum(), png=tmp_path / "p.png")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: cp.view("cassie"), "a Robot, a Scene"),
        (lambda: cp.view(cp.pendulum(), [1.0, 2.0]), "shape"),
        (lambda: cp.view(cp.pendulum(), [0.0], posture="up"), "leave one of them out"),
        (lambda: cp.view(cp.pendulum(), posture="nothing"), "nothing"),
        (lambda: cp.view(cp.pendulum(), speed=0.0), "positive"),
        (lambda: cp.view(cp.pendulum(), html="/nowhere/at/all.html"), "cannot be written"),
        (lambda: cp.view(cp.pendulum(), png="/nowhere/at/all.png"), "no folder"),
    ],
)
def test_a_mistake_is_named(wrong, said):
    with pytest.raises(cp.CondynError, match=said):
        wrong()


# The command line


def run(*words):
    return CliRunner().invoke(app, ["view", *words])


def test_the_command_writes_a_page(tmp_path):
    path = tmp_path / "cassie.html"
    result = run("cassie", "--posture", "standing", "--forces", "--light", "--html", str(path))
    assert result.exit_code == 0, result.output
    assert "left-achilles-spring-joint" not in path.read_text()  # names are in base 64
    assert "force on the other body" in path.read_text()


def test_the_command_plays_a_motion(tmp_path, swinging):
    swinging.save(tmp_path / "run.npz")
    result = run(str(tmp_path / "run.npz"), "--html", str(tmp_path / "run.html"))
    assert result.exit_code == 0, result.output
    result = run(str(tmp_path / "run.npz"), "--forces")
    assert isinstance(result.exception, cp.InvalidArgument)


# In a browser

_QUESTION = """<script>
document.title = "";
var errors = [];
window.addEventListener("error", e => errors.push(e.message));
window.addEventListener("load", () => setTimeout(() => {
  viewer.animator.pause();
  viewer.animator.seek(0.3);
  let node = path => viewer.scene_tree.find(path.split("/")).object;
  let found = {errors: errors, duration: viewer.animator.duration,
               actions: viewer.animator.actions.length};
  for (let path of PATHS) {
    node(path).updateMatrix();
    found[path] = node(path).matrix.elements;
  }
  let answer = document.createElement("pre");
  answer.id = "answer";
  answer.textContent = JSON.stringify(found);
  document.body.appendChild(answer);
}, 50));
</script></body>"""


def test_a_browser_plays_the_motion_without_a_network(tmp_path, swinging):
    found = drawing(swinging)
    paths = [p.path for p in found.parts if p.path.startswith(("robot/", "forces/"))]
    question = _QUESTION.replace("PATHS", json.dumps(paths))
    file = tmp_path / "run.html"
    file.write_text(found.html().replace("</body>", question), encoding="utf-8")
    words = chromium.command(chromium.find_chromium(), str(tmp_path / "profile"))
    words += ["--host-resolver-rules=MAP * ~NOTFOUND", "--virtual-time-budget=400", "--dump-dom"]
    done = subprocess.run([*words, file.as_uri()], capture_output=True, text=True, timeout=PATIENCE)
    answer = json.loads(re.search(r'<pre id="answer">(.*?)</pre>', done.stdout)[1])
    assert answer["errors"] == []
    assert answer["duration"] == pytest.approx(0.5, abs=1e-6)
    assert answer["actions"] == len(tracks(found.parts, found.moments))
    for part in found.parts:
        if part.path in paths:
            seen = np.array(answer[part.path]).reshape(4, 4).T
            assert np.allclose(seen, part.place(found.moments[9]), atol=1e-5), part.path


def test_a_browser_plays_by_itself(monkeypatch, swinging):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import viewing

    seen = viewing.play(drawing(swinging).html(), seconds=0.0, warm=0.1)
    assert seen.count == 2  # of different times; it waits for the second
    assert seen.triangles > 100


_SHARPNESS = """<script>
function ratio_after(drawn) {  // [pictures] in one second
  pictures = drawn;
  look(since + 1000);
  return viewer.renderer.getPixelRatio();
}
let answer = document.createElement("pre");
answer.id = "answer";
for (let playing of [false, true]) {  // whatever was drawn, or was not, while the page was loaded
  viewer.animator.playing = playing;
  ratio_after(40);
}
let ratios = [ratio_after(40), ratio_after(10), ratio_after(10)];
viewer.animator.playing = false;
ratios.push(ratio_after(10));
viewer.animator.playing = true;
answer.textContent = JSON.stringify([...ratios, ratio_after(10)]);
document.body.appendChild(answer);
</script></body>"""


def test_a_slow_browser_draws_fewer_pixels_until_the_pause(tmp_path, swinging):
    assert "rate < 28" not in drawing(cp.pendulum()).html()  # a picture that rests is sharp
    file = tmp_path / "run.html"
    text = drawing(swinging).html().replace("</body>", _SHARPNESS)
    file.write_text(text, encoding="utf-8")
    words = chromium.command(chromium.find_chromium(), str(tmp_path / "profile"))
    words += ["--virtual-time-budget=1000", "--window-size=64,48", "--dump-dom", file.as_uri()]
    done = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE)
    answer = re.search(r'<pre id="answer">(.*?)</pre>', done.stdout)[1]
    fast, slow, slower, paused, again = json.loads(answer)
    assert slower < slow < fast == again == 1  # what was drawn at the pause is not counted
    assert paused == 2  # four pixels for each one: how a processor smooths edges


def test_a_pause_is_as_smooth_as_a_picture_that_rests(tmp_path, swinging, monkeypatch):
    from PIL import Image

    monkeypatch.setattr(chromium, "SIZE", (320, 240))
    found = drawing(swinging)
    stop = "<script>viewer.animator.pause(); viewer.animator.seek(0);</script></body>"
    paused = found.html().replace("</body>", stop)
    pages = {"still": found.first.html(), "paused": paused,
             "rough": paused.replace("software ? 2 : 1", "1")}  # fmt: skip
    seen = {}
    for name, text in pages.items():
        file = tmp_path / f"{name}.png"
        chromium.screenshot(text.replace("</style>", ".dg { display: none; }</style>", 1), file)
        seen[name] = np.asarray(Image.open(file).convert("RGB"), dtype=float)
    assert (seen["still"] < 200).any()
    smooth, rough = (np.abs(seen[each] - seen["still"]).mean() for each in ("paused", "rough"))
    assert smooth < 0.75 * rough  # the samples of a pixel lie elsewhere


def test_a_browser_draws_robot_arrows_and_closures(tmp_path, standing):
    from PIL import Image

    scene, _, v, bent = standing
    sol = cp.solve(scene, bent, v, 0 * v, throw=False)  # one loop is open, three are closed
    cp.view(sol, png=tmp_path / "c.png", light=True)
    picture = Image.open(tmp_path / "c.png").convert("RGB")
    assert picture.size == chromium.SIZE
    rgb = np.asarray(picture, dtype=float)[170:] / 255.0  # below the legend
    assert (rgb[:, :40] > 0.99).mean() > 0.9  # a white margin
    grey = (np.ptp(rgb, axis=2) < 0.08) & (rgb.mean(axis=2) < 0.75) & (rgb.mean(axis=2) > 0.3)
    assert grey.mean() > 0.02  # the robot, and not only its outlines
    hue, saturation, _ = np.moveaxis(np.asarray(picture.convert("HSV"), float)[170:], 2, 0)

    def seen(colour):
        wanted = 255.0 * colorsys.rgb_to_hsv(*colour)[0]
        near = np.abs((hue - wanted + 127.5) % 255.0 - 127.5) < 5.0
        return int((near & (saturation > 130)).sum())

    for name in ("ACTUATED", "FORCE", "OPEN", "CLOSED"):
        assert seen(getattr(palette, name)) > 60, name
    assert seen((0.6, 0.0, 1.0)) < 20  # violet is nowhere
