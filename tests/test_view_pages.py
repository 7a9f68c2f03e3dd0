"""Pages: in files, from a server, from the command line, and in a browser."""

from __future__ import annotations

import colorsys
import contextlib
import html as markup
import json
import os
import re
import subprocess
import sys
import urllib.error
import urllib.request
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from shared import calls, each_row, robot
from shell import condyn
from viewed import bent, drawing, standing, swinging

import condyn_pin as cp
from condyn_pin.viewing import drawing as page
from condyn_pin.viewing import part as palette
from condyn_pin.viewing import viewer as chromium
from condyn_pin.viewing.motion import tracks

pytestmark = pytest.mark.once

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
PATIENCE = 300.0  # [s] that no machine needs, for what may hang


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


@pytest.mark.long
def test_the_same_picture_is_the_same_page():
    bar = cp.model.four_bar()
    assert drawing(bar).html() == drawing(bar).html()


def test_a_notebook_gets_the_page_itself():
    with cp.view(cp.model.pendulum(), browser=False) as viewer:
        text = viewer._repr_html_()
    assert text.startswith("<iframe srcdoc=")
    assert "<script" not in text


# The server


def test_ports_are_chosen_and_closing_frees_them():
    one, two = (cp.view(cp.model.pendulum(), browser=False) for _ in range(2))
    assert one.url != two.url
    with urllib.request.urlopen(one.url, timeout=PATIENCE) as answer:
        assert answer.read().decode() == one.html
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(f"{one.url}other", timeout=PATIENCE)
    refused.value.close()
    with pytest.raises(cp.InvalidArgument, match="a free one is taken"):
        cp.view(cp.model.pendulum(), browser=False, port=int(two.url.split(":")[2].strip("/")))
    server = one._server
    one.close()
    one.close()
    two.close()
    assert one.url == ""
    assert server.fileno() == -1


@pytest.mark.long
def test_a_program_that_forgets_its_viewer_ends_cleanly():
    code = (
        "import condyn_pin as cp, urllib.request, gc\n"
        "url = cp.view(cp.model.pendulum(), browser=False).url; gc.collect()\n"
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


@pytest.mark.long
@pytest.mark.parametrize("name", ["cassie", "talos"])
def test_a_page_takes_few_calls(name):
    """Meshes go through arrays, not number by number; `benchmarks/viewing.py` has the seconds."""
    loaded = robot(name)
    assert calls(lambda: drawing(loaded).html()) < 300_000


# What cannot be


def test_without_meshcat_the_remedy_is_named(monkeypatch):
    monkeypatch.setattr(page.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(cp.errors.MissingExtra, match=r"pip install \"condyn_pin\[view\]\""):
        cp.view(cp.model.pendulum(), html="never.html")
    assert not Path("never.html").exists()


def test_without_chromium_the_remedy_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(cp.errors.MissingExtra, match="apt-get install chromium"):
        cp.view(cp.model.pendulum(), png=tmp_path / "p.png")


@pytest.mark.long
@pytest.mark.parametrize(("variables", "code"), [({}, 0), ({"CI": "true"}, 1)])
def test_tests_without_a_browser_are_left_out_aloud_and_fail_in_ci(tmp_path, variables, code):
    test = tmp_path / "test_it.py"
    test.write_text(
        "import pytest\nfrom condyn_pin.viewing.viewer import find_chromium\n"
        "@pytest.mark.chromium\n@pytest.mark.parametrize('k', range(2))\n"
        "def test_it(k): find_chromium()\ndef test_else(): pass\n"
    )
    here = str(Path(__file__).parent)
    kept = {name: value for name, value in os.environ.items() if name != "CI"}
    paths = {"PATH": str(tmp_path), "PYTHONPATH": os.pathsep.join([here, *sys.path])}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "conftest", "--strict-markers", str(test)],
        cwd=tmp_path, env=kept | paths | variables, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == code, done.stdout + done.stderr
    told = "2 tests were left out, since there is no Chromium: apt-get in"
    assert (told in done.stdout) == (code == 0)
    assert ("2 failed, 1 passed" if code else "1 passed, 2 skipped") in done.stdout


def test_a_browser_that_fails_is_quoted(monkeypatch, tmp_path):
    broken = tmp_path / "chromium"
    broken.write_text("#!/bin/sh\necho no such screen >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    with pytest.raises(cp.errors.BrowserFailed, match="no such screen"):
        cp.view(cp.model.pendulum(), png=tmp_path / "p.png")


def test_a_chromium_that_hangs_is_started_once_more(monkeypatch, tmp_path):
    fake, png = tmp_path / "chromium", tmp_path / "picture.png"
    fake.write_text(
        "#!/bin/sh\n"
        f"test -e {tmp_path}/before || {{ touch {tmp_path}/before; exec sleep 60; }}\n"
        'for word; do case "$word" in --screenshot=*) echo drawn > "${word#*=}";; esac; done\n'
    )
    fake.chmod(0o755)
    monkeypatch.setattr(chromium, "_NAMES", (str(fake),))
    monkeypatch.setattr(chromium, "_LIMIT", 2.0)
    chromium.screenshot("<html></html>", png)
    assert png.read_text() == "drawn\n"
    (tmp_path / "before").unlink()
    monkeypatch.setattr(chromium, "_STARTS", 1)
    with pytest.raises(cp.errors.BrowserFailed, match="did not end within 2 s"):
        chromium.screenshot("<html></html>", png)


@each_row(
    ("wrong", "said"),
    [
        (lambda: cp.view("cassie"), "load_robot makes a Robot of a name"),
        (lambda: cp.view(cp.model.pendulum(), [1.0, 2.0]), "shape"),
        (lambda: cp.view(cp.model.pendulum(), [0.0], posture="up"), "give only one of them"),
        (lambda: cp.view(cp.model.pendulum(), posture="nothing"), "nothing"),
        (lambda: cp.view(cp.model.pendulum(), speed=0.0), "positive"),
        (lambda: cp.view(cp.model.pendulum(), speed="fast"), "speed = 'fast'"),
        (lambda: cp.view(cp.model.pendulum(), html="/nowhere/at/all.html"), "cannot be written"),
        (lambda: cp.view(cp.model.pendulum(), png="/nowhere/at/all.png"), "no folder"),
    ],
)
def test_a_mistake_is_named(wrong, said):
    with pytest.raises(cp.CondynError, match=said):
        wrong()


# The command line


def run(*words):
    return condyn("view", *words)


@pytest.mark.long
def test_the_command_writes_a_page(tmp_path):
    path = tmp_path / "cassie.html"
    result = run("cassie", "--posture", "standing", "--forces", "--light", "--html", str(path))
    assert result.exit_code == 0, result.output
    assert "left-achilles-spring-joint" not in path.read_text()  # names are in base 64
    assert "force on the other body" in path.read_text()


def test_the_command_plays_a_motion_and_one_of_a_batch(tmp_path):
    one, many, page = (str(tmp_path / name) for name in ("run.npz", "many.npz", "run.html"))
    swinging().save(one)
    q, v = swinging().q[0], swinging().v[0]
    cp.simulate_batch(swinging().scene, [q, q], [v, 2 * v], duration=0.1, record=5).save(many)
    for words in ((one,), (many, "--motion", "1")):
        result = run(*words, "--html", page)
        assert result.exit_code == 0, result.output
        assert Path(page).stat().st_size > 10**5
        Path(page).unlink()
    for words, said in (
        ((one, "--forces"), "a motion has its own"),
        ((many, "--motion", "2"), "many.npz has 2, from 0"),
        ((many,), "`condyn view --motion 0`"),
        (("cassie", "--motion", "0"), "for a batch"),
    ):
        found = run(*words)
        assert isinstance(found.exception, cp.InvalidArgument)
        assert said in str(found.exception)


# In a browser


_ANSWER = """
let answer = document.createElement("pre");
answer.id = "answer";
answer.textContent = JSON.stringify(found);
document.body.appendChild(answer);
"""
_LOADED = "window.addEventListener('load', () => setTimeout(() => {SCRIPT}, 50));"


def asked(folder, html, script, *, before=None):
    """What a script finds on a page, in a browser without a network.

    It runs at the end of the page; or when it has been loaded, and something else `before`.
    """
    script += _ANSWER
    if before is not None:
        script = before + _LOADED.replace("SCRIPT", script)
    file = folder / "asked.html"
    file.write_text(html.replace("</body>", f"<script>{script}</script></body>"), encoding="utf-8")
    options = ["--host-resolver-rules=MAP * ~NOTFOUND", "--virtual-time-budget=400"]
    options += ["--window-size=64,48", "--dump-dom", file.as_uri()]
    for start in ("first", "second"):  # one start in 25 hangs where the machine has other work
        words = chromium.command(chromium.find_chromium(), str(folder / start)) + options
        with contextlib.suppress(subprocess.TimeoutExpired):
            done = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE / 3)
            found = re.search(r'<pre id="answer">(.*?)</pre>', done.stdout)[1]
            return json.loads(markup.unescape(found))
    raise AssertionError("Chromium hung twice")


_QUESTION = """
viewer.animator.pause();
viewer.animator.seek(0.3);
let node = path => viewer.scene_tree.find(path.split("/")).object;
let found = {errors: errors, duration: viewer.animator.duration,
             actions: viewer.animator.actions.length};
for (let path of PATHS) {
  node(path).updateMatrix();
  found[path] = node(path).matrix.elements;
}
"""
_ERRORS = """
document.title = "";
var errors = [];
window.addEventListener("error", e => errors.push(e.message));
"""


@pytest.mark.chromium
def test_a_browser_plays_the_motion_without_a_network(tmp_path):
    found = drawing(swinging())
    paths = [p.path for p in found.parts if p.path.startswith(("robot/", "forces/"))]
    question = _QUESTION.replace("PATHS", json.dumps(paths))
    answer = asked(tmp_path, found.html(), question, before=_ERRORS)
    assert answer["errors"] == []
    assert answer["duration"] == pytest.approx(0.5, abs=1e-6)
    assert answer["actions"] == len(tracks(found.parts, found.instants, found.frames))
    for part in found.parts:
        if part.path in paths:
            seen = np.array(answer[part.path]).reshape(4, 4).T
            assert np.allclose(seen, part.place(found.instants[9]), atol=1e-5), part.path


@pytest.mark.long
@pytest.mark.chromium
def test_a_browser_plays_by_itself(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import viewing

    seen = viewing.play(drawing(swinging()).html(), seconds=0.0, warm=0.1)
    assert seen.count == 2  # of different times; it waits for the second
    assert seen.triangles > 100


_SLOW = """
let seen = [];
viewer.animator.reset();
viewer.animator.play();
viewer.animator.clock.getDelta = () => 0.2;  // [s] that a picture takes
for (let picture = 0; picture < 3; ++picture) {
  viewer.animator.update();
  seen.push(viewer.animator.time);
}
let kinds = new Set();
viewer.scene.traverse(object => { if (object.isMesh) kinds.add(object.material.type); });
let found = {seen, kinds: [...kinds], smoothed: viewer.renderer.getContextAttributes().antialias};
"""


@pytest.mark.chromium
def test_a_slow_browser_leaves_pictures_out_and_keeps_the_speed(tmp_path):
    found = asked(tmp_path, drawing(swinging()).html(), _SLOW)
    assert found["seen"] == pytest.approx([0.2, 0.4, 0.1])  # of half a second, again and again
    assert found["kinds"] == ["MeshLambertMaterial"]
    assert found["smoothed"] is False  # by more pixels at a pause


_PACE = """
let clock = 0, found = {};
performance.now = () => clock;
function seen() {
  viewer.render();
  return [viewer.renderer.getPixelRatio(), viewer.renderer.info.render.triangles];
}
function play(seconds, rate) {  // [pictures/s]
  viewer.animator.playing = true;
  for (let picture = 0; picture < seconds * rate; ++picture) {
    viewer.animator.display_progress(0.001 * clock);
    look(clock += 1000 / rate);
  }
  return seen();
}
function rest() {
  viewer.animator.playing = false;
  look(clock += 1000);
  return seen();
}
found.first = seen();
pane.dispatchEvent(new WheelEvent("wheel", {deltaY: 1}));
look(clock += 10);
found.turned = seen();
found.rest = rest();
found.fast = play(2, 60);
found.slow = play(1, 10);
found.slower = play(9, 10);
found.paused = rest();
found.again = play(0.2, 60);
found.faster = play(9, 60);
found.steady = [15, 31, 41].map(rate => { rest(); return play(2, rate); });
"""


@pytest.fixture(scope="module")
def pace(tmp_path_factory):
    """Pixels each way and triangles of what a browser without a graphics card draws, and when."""
    found = drawing(standing(), posture="standing", light=True)
    found = replace(found, instants=2 * found.instants)  # a motion, which the questions play
    return asked(tmp_path_factory.mktemp("pace"), found.html(), _PACE)


@pytest.mark.long
@pytest.mark.chromium
def test_what_rests_is_whole_and_sharp(pace):
    assert pace["first"] == pace["rest"] == pace["paused"]
    assert pace["first"][0] == 2  # four pixels for each one: how a processor smooths edges
    assert pace["first"][1] > 20_000


@pytest.mark.long
@pytest.mark.chromium
def test_what_moves_has_few_triangles(pace):
    few = {pace[when][1] for when in ("turned", "fast", "slow", "slower", "again", "faster")}
    assert len(few) == 1
    assert few.pop() < 0.7 * pace["first"][1]  # with marks, which stay as they are
    assert pace["turned"][0] == 0.5


@pytest.mark.long
@pytest.mark.chromium
def test_a_slow_motion_has_fewer_pixels_until_it_is_fast_again(pace):
    pixels = {when: pace[when][0] for when in ("fast", "slow", "slower", "again", "faster")}
    assert pixels["slower"] < pixels["slow"] < pixels["fast"] == pixels["faster"] == 1
    assert pixels["again"] == pixels["slower"] == 0.25  # a pause does not change what it needs
    low, *others = (pixels for pixels, _ in pace["steady"])
    assert others == [low, low]  # from 30 to 42 pictures a second
    assert low < 1


@pytest.mark.chromium
def test_the_slider_follows_the_motion(tmp_path):
    script = """
    let clock = performance.now(), {animator} = viewer, found = [];
    animator.pause();
    let said = () => animator.time_scrubber.domElement.querySelector("input").value;
    for (let time of [0.1, 0.2, 0.3]) { animator.display_progress(time); look(clock += 400); }
    found.push(said());
    animator.display_progress(0.4);
    look(clock += 10);
    look(clock += 1000);
    found.push(said());
    """
    moving, resting = asked(tmp_path, drawing(swinging()).html(), script)
    assert float(moving) > 0.0
    assert float(resting) == 0.4


@pytest.mark.chromium
def test_a_bar_plays_seeks_and_sets_the_speed(tmp_path):
    script = """
    let bar = document.getElementById("player"), {animator} = viewer;
    let press = name => bar.querySelector("." + name);
    let slide = (name, value) => { press(name).value = value; press(name).oninput(); };
    let found = {shown: getComputedStyle(bar).display, playing: [animator.playing]};
    press("play").onclick();
    found.playing.push(animator.playing);
    slide("time", 0.25);
    look(performance.now() + 1000);
    found.time = animator.time;
    found.clock = press("clock").textContent;
    found.button = press("play").textContent;
    slide("speed", -1);
    found.scale = animator.mixer.timeScale;
    found.times = press("times").textContent;
    """
    slow = drawing(swinging(), speed=0.1)
    found = asked(tmp_path, slow.html(), script)
    assert found["shown"] == "flex"
    assert found["playing"] == [False, True]
    assert found["time"] == pytest.approx(0.25)
    assert found["clock"] == "0.025 s"  # of the motion, which is played at a tenth of its speed
    assert found["button"] == "\N{BLACK RIGHT-POINTING TRIANGLE}"
    assert (found["scale"], found["times"]) == (0.5, "0.50 x")


@pytest.mark.long
@pytest.mark.chromium
def test_a_still_picture_has_no_bar(tmp_path):
    script = """let found = getComputedStyle(document.getElementById("player")).display;"""
    assert asked(tmp_path, drawing(cp.model.four_bar()).html(), script) == "none"


_WORDS = """
viewer.animator.pause();
let canvas = document.getElementById("labels"), paint = canvas.getContext("2d"), painted = [];
canvas.style.width = "800px";
canvas.style.height = "600px";
viewer.camera.aspect = 4 / 3;
viewer.camera.updateProjectionMatrix();
paint.drawImage = (image, x, y, w, h) => painted.push([x, y, w, h]);
let seen = [];
let view = () => { painted = []; viewer.render(); seen.push(painted); };
for (let time of [0.0, 0.1, 0.3]) { viewer.animator.seek(time); view(); }
viewer.camera.position.set(0.05, 1.5, 0.05);
viewer.camera.lookAt(0, 0, 0);
viewer.camera.updateMatrixWorld();
view();
let sprites = [];
viewer.scene.traverse(object => { if (object.isSprite) sprites.push(object.material.visible); });
let found = {seen, sprites};
"""


@pytest.mark.long
@pytest.mark.chromium
def test_words_are_painted_over_the_picture_and_never_over_each_other(tmp_path):
    found = asked(tmp_path, drawing(swinging()).html(), _WORDS, before="")
    labels = [part for part in drawing(swinging()).parts if part.picture]
    assert not any(found["sprites"])  # the picture itself, which has fewer pixels, has none
    assert len(found["seen"][0]) == len(labels) > 2
    for painted in found["seen"]:
        for i, (x, y, w, h) in enumerate(painted):
            for x2, y2, w2, h2 in painted[:i]:
                apart = abs(x + w / 2 - x2 - w2 / 2) >= 0.499 * (w + w2)
                below = abs(y + h / 2 - y2 - h2 / 2) >= 0.399 * (h + h2)
                assert apart or below


_PAUSE = """<script>
viewer.animator.clock.getDelta = () => 0.01;  // [s] has been played, however fast the machine is
viewer.animator.update();
look(performance.now());
viewer.animator.pause();
viewer.animator.seek(0);
look(performance.now());
moved -= 250;  // [ms] for which what moved is still drawn with fewer pixels
</script></body>"""


@pytest.mark.long
@pytest.mark.chromium
def test_a_rest_is_as_smooth_as_a_graphics_card_draws_it(tmp_path, monkeypatch):
    from PIL import Image

    monkeypatch.setattr(chromium, "SIZE", (320, 240))
    still, moving = drawing(swinging()).first.html(), drawing(swinging()).html()
    one = ("software ? 2 : 1", "1")
    pages = {
        "smooth": still.replace(*one).replace("antialias: !software", "antialias: true"),
        "rough": still.replace(*one),
        "still": still,
        "paused": moving.replace("</body>", _PAUSE),
    }
    seen = {}
    for name, text in pages.items():
        file = tmp_path / f"{name}.png"
        hidden = ".dg, #player { display: none !important; }</style>"
        chromium.screenshot(text.replace("</style>", hidden, 1), file)
        seen[name] = np.asarray(Image.open(file).convert("RGB"), dtype=float)
    assert (seen["smooth"] < 200).any()
    off = {name: np.abs(seen[name] - seen["smooth"]).mean() for name in pages}
    # samples of a pixel lie elsewhere
    assert max(off["still"], off["paused"]) < 0.75 * off["rough"]


@pytest.mark.chromium
def test_a_browser_draws_robot_arrows_and_closures(tmp_path):
    from PIL import Image

    v = standing().state("standing")[1]
    sol = cp.solve(standing(), bent(), v, 0 * v, throw=False)  # one loop is open, three are closed
    cp.view(sol, png=tmp_path / "c.png", light=True)
    picture = Image.open(tmp_path / "c.png").convert("RGB")
    assert picture.size == chromium.SIZE
    rgb = np.asarray(picture, dtype=float)[170:] / 255.0  # below the legend
    assert rgb[:, :40].mean() > 0.85  # a margin, of white and of the floor
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


_STRANGE = "</script><img src=x onerror='window.strange = 1'><script>window.strange = 2</script>"
_NAMES = """
let found = {
  ran: window.strange || 0, scripts: document.scripts.length, images: document.images.length,
  legend: document.getElementById("legend").textContent, title: document.title,
};
"""


@pytest.mark.chromium
def test_names_are_words_on_a_page_and_nothing_else(tmp_path):
    """A description is a stranger's: a name may be markup."""
    model = pin.Model()
    inertia = pin.Inertia.FromEllipsoid(1.0, 0.3, 0.2, 0.1)
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), f"j{_STRANGE}")
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5]))
    model.addFrame(pin.Frame(f"f{_STRANGE}", joint, 0, tip, pin.FrameType.OP_FRAME))
    strange = cp.Robot(f"r{_STRANGE}", model, actuated=[f"j{_STRANGE}"])
    scene = cp.Scene(strange, [cp.PointContact(f"f{_STRANGE}", name=f"c{_STRANGE}")])
    cp.simulate(scene, [0.3], [0.0], duration=0.02, dt=0.01).save(tmp_path / "run.npz")
    page = drawing(cp.Trajectory.load(tmp_path / "run.npz")).html()
    answer = asked(tmp_path, page, _NAMES, before="")
    assert answer["ran"] == answer["images"] == 0
    assert answer["scripts"] == page.count("<script>") + 1 == 3
    assert f"r{_STRANGE}" in answer["legend"]
    assert answer["title"].startswith("r</script><img")


@pytest.mark.parametrize(
    ("argument", "name", "cure"), [("png", "x.jpg", "x.png"), ("html", "x.png", "x.html")]
)
def test_a_name_that_says_another_format_is_refused(tmp_path, argument, name, cure):
    bar = cp.model.four_bar()
    with pytest.raises(cp.InvalidArgument, match=rf"name it .*{cure}"):
        cp.view(bar, browser=False, **{argument: tmp_path / name})
    assert not list(tmp_path.iterdir())
