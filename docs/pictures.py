"""The committed pictures of README and gallery, from pages of `view`.

python docs/pictures.py docs/pictures

The moving one has Cassie that squats and a platform that rolls. Its page is opened in headless
Chromium, which draws each picture at its time and hands them all back.
"""

from __future__ import annotations

import base64
import html
import io
import json
import re
import runpy
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import condyn_pin as cp
from condyn_pin.constraints import Driven, HeldJoint, Sine
from condyn_pin.contact import FrictionCone
from condyn_pin.control import CenterOfMass, Controller, Orientation, Posture, at_rate
from condyn_pin.viewing.viewer import command, find_chromium

PERIOD = 1.6  # [s] after which both motions repeat
FRAMES = 24  # pictures of a period
SIZE = (600, 450)  # [px] of a window
SEEN = (75, 0, 525, 450)  # [px] of it that is shown, from left and top to right and bottom

# Pictures are drawn twice as large: the mean of four pixels has smooth edges.
SHOOT = """<script>
window.addEventListener("load", () => setTimeout(() => {
  viewer.renderer.setPixelRatio(2);
  viewer.scene.traverse(({geometry, userData: {whole}}) => {
    if (whole) geometry.setDrawRange(0, whole);
  });
  let shots = TIMES.map(time => {
    viewer.animator.seek(time);
    viewer.renderer.render(viewer.scene, viewer.camera);
    return viewer.renderer.domElement.toDataURL("image/png").split(",")[1];
  });
  let answer = document.createElement("pre");
  answer.id = "answer";
  answer.textContent = JSON.stringify(shots);
  document.body.appendChild(answer);
}, 100));
</script></body>"""


def stewart() -> cp.Trajectory:
    """A period of a platform whose legs follow sinusoids, each a sixth behind the one before."""
    robot = cp.model.stewart()
    home = cp.Scene(robot, robot.loops).state()[0]
    wave = np.linspace(0.0, 2.0 * np.pi, 6, endpoint=False)
    legs = [
        Driven(HeldJoint(f"leg{k + 1}", home[robot.index_q(f"leg{k + 1}")]),
               along=Sine(0.07, 1.0 / PERIOD, phase))
        for k, phase in enumerate(wave)
    ]  # fmt: skip
    scene = cp.Scene(robot, [*robot.loops, *legs])
    return cp.simulate(scene, *scene.state(), duration=PERIOD, dt=2e-3)


def cassie() -> cp.Trajectory:
    """A period of Cassie that sways and bends its knees, by whole-body control."""
    robot = cp.load_robot("cassie", variant={"springs": "locked"})
    floor = cp.Scene(robot, robot.loops, contacts=robot.frictional_contacts(friction=0.7))
    closed = cp.Scene(robot, [*robot.loops, *robot.contacts])
    q, v = closed.state("standing")
    q = cp.mechanism.place_on_ground(floor, q)
    middle = cp.control.support_polygon(closed, q).in_world.mean(axis=0)
    com = np.array([*middle[:2], robot.center_of_mass(q)[2] - 0.1])
    size, rate = np.array([0.0, 0.045, 0.07]), 2.0 * np.pi / PERIOD * np.array([1.0, 1.0, 2.0])

    def sway(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity and acceleration of the centre of mass."""
        wave = size * np.sin(rate * t)
        return com + wave, size * rate * np.cos(rate * t), -(rate**2) * wave

    tasks = [
        CenterOfMass(reference=sway, kp=100, weight=100),
        Orientation("pelvis", kp=100, weight=50),
        Posture(weight=0.1),
    ]
    controller = Controller(
        closed, tasks, cones=FrictionCone(0.6, sides=8), native="where possible"
    )
    return cp.simulate(floor, q, v, at_rate(controller, 2e-3), duration=2.0 * PERIOD, dt=2e-3)


def shots(run: cp.Trajectory, start: float) -> list[Image.Image]:
    """Pictures of a period of a motion from a start on [s]."""
    page = cp.view(run, browser=False).html
    times = [start + PERIOD * k / FRAMES for k in range(FRAMES)]
    text = page.replace("</body>", SHOOT.replace("TIMES", json.dumps(times)))
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        file = Path(folder) / "page.html"
        file.write_text(text, encoding="utf-8")
        words = [*command(find_chromium(), f"{folder}/profile"), "--virtual-time-budget=1000"]
        words += [f"--window-size={SIZE[0]},{SIZE[1]}", "--dump-dom", file.as_uri()]
        done = subprocess.run(words, capture_output=True, text=True, timeout=600.0, check=True)
    found = re.search(r'<pre id="answer">(.*?)</pre>', done.stdout)
    assert found is not None, done.stderr
    pictures = (base64.b64decode(each) for each in json.loads(html.unescape(found[1])))
    drawn = [Image.open(io.BytesIO(each)).convert("RGB") for each in pictures]
    return [each.resize(SIZE, Image.Resampling.BOX).crop(SEEN) for each in drawn]


def film(path: Path) -> None:
    """Write both machines, side by side, as a GIF that repeats."""
    frames = []
    for pair in zip(shots(cassie(), PERIOD), shots(stewart(), 0.0), strict=True):
        both = Image.new("RGB", (2 * pair[0].width, pair[0].height), "white")
        for i, each in enumerate(pair):
            both.paste(each, (i * each.width, 0))
        frames.append(both)
    palette = frames[len(frames) // 2].quantize(128, Image.Quantize.FASTOCTREE)
    frames = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in frames]
    frames[0].save(
        path, save_all=True, append_images=frames[1:], loop=0, optimize=True,
        duration=round(1000.0 * PERIOD / FRAMES),
    )  # fmt: skip


def held(name: str, posture: str | None = None) -> cp.Solution:
    """Answer of a robot that its motors hold still, springs locked."""
    robot = cp.load_robot(name, variant={"springs": "locked"} if name == "cassie" else {})
    scene = cp.Scene(robot, [*robot.loops, *robot.contacts])
    q, v = scene.state(posture)
    return cp.solve(scene, q, v, cp.control.gravity_compensation(scene, q).tau)


def standing(name: str) -> cp.stepping.StepSolution:
    """Step of a robot that stands on contacts that may open."""
    robot = cp.load_robot(name)
    feet = cp.Scene(robot, robot.contacts)
    floor = cp.Scene(robot, contacts=robot.frictional_contacts(friction=0.7))
    q, v = floor.state(on_ground=True)
    return cp.step(floor, q, v, cp.control.gravity_compensation(feet, q).tau, dt=1e-3)


def on_slope() -> cp.Trajectory:
    """Motion of the example in which Solo12 puts a foot onto a slope."""
    arguments, sys.argv = sys.argv, ["16_step_onto_a_slope.py", "--no-view"]
    example = Path(__file__).parent.parent / "examples" / sys.argv[0]
    try:
        return runpy.run_path(str(example))["run"]
    finally:
        sys.argv = arguments


def stills(folder: Path) -> None:
    """Write a picture of each machine."""
    cp.view(held("cassie", "standing"), png=folder / "cassie.png")
    cp.view(held("stewart"), png=folder / "stewart.png")
    cp.view(held("talos", "half_sitting"), png=folder / "talos.png")
    cp.view(standing("solo12"), cones=True, png=folder / "solo12.png")
    cp.view(cp.load_robot("four_bar"), png=folder / "four_bar.png")
    slope = on_slope()
    cp.view(slope, t=slope.t[-1], cones=True, png=folder / "slope.png")
    for path in folder.glob("*.png"):
        with Image.open(path) as picture:
            small = picture.convert("RGB").resize((960, 720), Image.Resampling.LANCZOS)
        small.quantize(128, Image.Quantize.FASTOCTREE).save(path, optimize=True)


if __name__ == "__main__":
    stills(Path(sys.argv[1]))
    film(Path(sys.argv[1]) / "machines.gif")
