"""Pictures: what is drawn, where, in which colour; in files, from a server, and in a browser."""

from __future__ import annotations

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
import pinocchio as pin
import pytest
from typer.testing import CliRunner

import condyn_pin as cp
from condyn_pin.cli import app
from condyn_pin.viewing import chromium, meshes, page, palette
from condyn_pin.viewing.descriptions import shapes_of
from condyn_pin.viewing.motion import tracks
from condyn_pin.viewing.part import span
from condyn_pin.viewing.skeleton import skeleton
from condyn_pin.viewing.verbs import _drawing, _Wish


def drawing(subject, q=None, *, posture=None, forces=True, speed=1.0, light=False):
    """What `view` draws, without the page."""
    return _drawing(_Wish(q, posture, forces, speed, light), subject)


def parts(subject, *args, **options):
    return {part.path: part for part in drawing(subject, *args, **options).parts}


@pytest.fixture(scope="module")
def cassie():
    return cp.load_robot("cassie")


@pytest.fixture(scope="module")
def standing(cassie):
    """Cassie with its loops and its feet, and a configuration with one loop open."""
    scene = cp.Scene(cassie, (*cassie.loops, *cassie.contacts))
    q, v = scene.state("standing")
    bent = q.copy()
    bent[cassie.model.joints[cassie.model.getJointId("left-knee-op")].idx_q] -= 0.5
    return scene, q, v, bent


@pytest.fixture(scope="module")
def swinging():
    """Half a second of a four-bar that falls."""
    bar = cp.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    return cp.simulate(scene, q, v, duration=0.5, dt=0.005)


# Meshes


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0


def test_solids_have_their_volume_and_point_outward():
    assert volume(meshes.box(1.0, 2.0, 3.0)) == pytest.approx(6.0)
    assert volume(meshes.cylinder(0.5, 2.0)) == pytest.approx(0.5 * np.pi, rel=0.02)
    assert volume(meshes.sphere(0.5)) == pytest.approx(np.pi / 6.0, rel=0.04)
    whole = meshes.capsule(0.5, 2.0)
    assert volume(whole) == pytest.approx(0.5 * np.pi + np.pi / 6.0, rel=0.06)
    assert whole.vertices[:, 2].min() == pytest.approx(-0.5)
    assert whole.vertices[:, 2].max() == pytest.approx(2.5)


def test_a_mesh_is_what_assimp_reads(cassie):
    shape = next(s for s in shapes_of(cassie.description)[0] if s.file)
    ours, theirs = meshes.read_mesh(shape.file), meshes._by_assimp(shape.file)
    assert volume(ours) == pytest.approx(volume(theirs), rel=1e-6)
    assert np.allclose(ours.vertices.min(axis=0), theirs.vertices.min(axis=0))
    assert np.allclose(ours.vertices.max(axis=0), theirs.vertices.max(axis=0))


def test_a_simplified_mesh_keeps_its_form_to_a_cell(cassie):
    shape = next(s for s in shapes_of(cassie.description)[0] if s.link == "pelvis")
    fine = meshes.read_mesh(shape.file)
    coarse = fine.simplified(0.02)
    assert len(coarse.faces) < 0.3 * len(fine.faces)
    assert np.abs(coarse.vertices.min(axis=0) - fine.vertices.min(axis=0)).max() < 0.02
    assert np.abs(coarse.vertices.max(axis=0) - fine.vertices.max(axis=0)).max() < 0.02
    assert coarse.faces.max() < len(coarse.vertices)


def test_a_span_takes_the_unit_length_to_a_segment():
    rng = np.random.default_rng(0)
    for _ in range(20):
        start, end = rng.normal(size=(2, 3))
        T = span(start, end)
        assert np.allclose(T @ [0, 0, 1, 1], [*end, 1])
        assert np.allclose(T @ [0, 0, 0, 1], [*start, 1])
        assert np.linalg.det(T[:3, :3]) == pytest.approx(np.linalg.norm(end - start))
    assert np.isfinite(span(start, start)).all()


def test_gaps_are_coloured_by_their_length():
    assert palette.gap_colour(0.0) == palette.CLOSED
    assert palette.gap_colour(1.0) == pytest.approx(palette.OPEN)
    greens = [palette.gap_colour(x)[1] for x in np.logspace(-9, -2, 8)]
    assert all(a > b for a, b in zip(greens[:-1], greens[1:], strict=True))


# What is drawn


@pytest.mark.parametrize("name", cp.available_robots())
def test_every_robot_can_be_seen(name):
    robot = cp.load_robot(name)
    found = drawing(robot, robot.postures.get("standing", pin.neutral(robot.model)))
    bodies = [p for p in found.parts if p.path.startswith("robot/")]
    assert sum(len(mesh.faces) for part in bodies for mesh, _ in part.meshes) > 50
    assert found.notes == ()
    for part in found.parts:
        assert np.isfinite(part.place(found.moments[0])).all(), part.path
        for mesh, _ in part.meshes:
            assert np.isfinite(mesh.vertices).all()
            assert mesh.faces.max() < len(mesh.vertices)
    seen = np.vstack(
        [
            mesh.moved(part.place(found.moments[0])).vertices
            for part in bodies
            for mesh, _ in part.meshes
        ]
    )
    distance = np.abs(seen - found.middle).max()  # a mesh in millimetres would be far outside
    assert distance < 2.0 * found.size


def test_joints_with_a_motor_are_told_apart(cassie):
    found = parts(cassie)
    motors = {p.split("/", 2)[2] for p in found if p.startswith("joints/actuated/")}
    passive = {p.split("/", 2)[2] for p in found if p.startswith("joints/passive/")}
    assert motors == set(cassie.actuated)
    assert motors | passive == set(cassie.joints) - {"root_joint"}
    (_, colour), *_ = found["joints/actuated/left-knee-op"].meshes
    assert colour == palette.ACTUATED


def test_a_joint_mark_lies_along_its_axis():
    bar = cp.four_bar()
    mark = parts(bar)[f"joints/actuated/{bar.actuated[0]}"].meshes[0][0]
    spread = np.ptp(mark.vertices, axis=0)
    joint = bar.model.joints[bar.model.getJointId(bar.actuated[0])]
    assert joint.shortname() == "JointModelRY"
    assert int(spread.argmax()) == 1


def test_both_frames_of_a_closure_and_its_gap(cassie, standing):
    scene, _, _, bent = standing
    found = drawing(scene, bent)
    at, name = found.moments[0], "left-achilles-spring-joint"
    picture = {part.path: part for part in found.parts}
    data = cassie.model.createData()
    pin.forwardKinematics(cassie.model, data, bent)
    loop = next(loop for loop in cassie.loops if loop.name == name)
    ends = []
    for frame, path in ((loop.frame_a, "frame_a"), (loop.frame_b, "frame_b")):
        joint, placement = cassie.frame(frame)
        ends.append(data.oMi[joint] * placement)
        drawn = picture[f"closures/{name}/{path}"].place(at)
        assert np.allclose(drawn, ends[-1].homogeneous)
    gap = picture[f"closures/{name}/gap"]
    T = gap.place(at)
    assert {tuple(np.round(T @ [0, 0, z, 1], 9)) for z in (0, 1)} == {
        tuple(np.round([*end.translation, 1], 9)) for end in ends
    }
    length = float(np.linalg.norm(ends[0].translation - ends[1].translation))
    assert length > 0.1
    assert gap.tint(at) == pytest.approx(palette.OPEN)
    assert picture["closures/right-achilles-spring-joint/gap"].tint(at) == palette.CLOSED
    assert at.gaps[name].length == pytest.approx(length)


def test_forces_are_arrows_where_and_how_they_act(standing):
    scene, q, v, _ = standing
    sol = cp.solve(scene, q, v, scene.robot.passive_torque(q, v))
    found = drawing(sol)
    at = found.moments[0]
    arrows = {p.path: p for p in found.parts if p.path.startswith("forces/") and not p.picture}
    scales = []
    for name, force in sol.forces.items():
        path = next(p for p in arrows if p.startswith(f"forces/{name}/on "))
        T = arrows[path].place(at)
        vector = force.in_world()[:3]
        assert np.allclose(T[:3, 3], force.at)
        scales.append(np.linalg.norm(T[:3, 2]) / np.linalg.norm(vector))
        assert np.allclose(T[:3, 2], scales[-1] * vector)
    assert np.allclose(scales, scales[0])  # one scale for all
    assert "forces/left-foot/toe/on left-foot" in arrows
    both = [p for p in arrows if p.startswith("forces/left-achilles-spring-joint/on ")]
    assert len(both) == 2  # on the rod, and on the heel spring
    a, b = (arrows[p].place(at)[:3, 2] for p in both)
    assert np.allclose(a, -b)
    assert not [p for p in parts(sol, forces=False) if p.startswith("forces/")]


def test_a_contact_patch_has_its_size():
    talos = cp.load_robot("talos")
    foot = cp.SurfaceContact("left_sole_link", half_length=0.1, half_width=0.06)
    found = parts(cp.Scene(talos, [foot]), talos.postures["half_sitting"])
    mesh, _ = found["contacts/left_sole_link/patch"].meshes[0]
    assert np.allclose(np.ptp(mesh.vertices, axis=0)[:2], (0.2, 0.12))


def test_the_centre_of_mass_is_where_it_is(standing):
    scene, q, _, _ = standing
    found = drawing(scene, q)
    mark = next(p for p in found.parts if p.path == "mass/centre")
    com = pin.centerOfMass(scene.robot.model, scene.robot.model.createData(), q)
    assert np.allclose(mark.place(found.moments[0])[:3, 3], com)


def test_what_nobody_drew_has_its_inertia():
    model = pin.Model()
    inertia = pin.Inertia.FromEllipsoid(2.0, 0.3, 0.2, 0.1)
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    robot = cp.Robot("egg", model)
    (part,) = skeleton(robot, 0.1)
    half = 0.5 * np.ptp(part.meshes[-1][0].vertices, axis=0)
    assert np.allclose(np.sort(half), (0.1, 0.2, 0.3), rtol=0.06)


def test_an_assembly_is_seen_before_and_after(standing):
    scene, _, _, bent = standing
    loops = cp.Scene(scene.robot, scene.robot.loops)
    assembly = loops.assemble(bent, fixed=["left-knee-op"])
    found = drawing(assembly)
    picture, at = {p.path: p for p in found.parts}, found.moments[0]
    before = picture["before/closures/left-achilles-spring-joint/gap"]
    after = picture["closures/left-achilles-spring-joint/gap"]
    assert before.tint(at) == pytest.approx(palette.OPEN)
    assert after.tint(at) == palette.CLOSED
    assert (
        picture["before/robot/left-tarsus"].opacity < 0.5
        if ("before/robot/left-tarsus" in picture)
        else any(p.startswith("before/robot/") for p in picture)
    )
    assert np.linalg.norm(before.place(at)[:3, 2]) > 0.1
    assert np.linalg.norm(after.place(at)[:3, 2]) < 1e-9


def test_a_smaller_robot_keeps_its_shapes(cassie):
    locked = cp.Scene(cassie, cassie.loops).lock(["left-knee-op"])
    assert locked.robot.description == cassie.description
    whole = parts(cassie, cassie.postures["standing"])
    small = parts(locked.robot, pin.neutral(locked.robot.model))
    assert len([p for p in small if p.startswith("robot/")]) > 0
    assert "robot/left-knee-op" in whole
    assert "robot/left-knee-op" not in small


def test_a_mesh_that_is_missing_is_said(tmp_path):
    text = """<robot name="r"><link name="base"/><link name="arm">
      <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
      <visual><geometry><mesh filename="package://nowhere/arm.stl"/></geometry></visual>
      <visual><origin xyz="0 0 1"/><geometry><box size="1 2 3"/></geometry>
        <material name="m"><color rgba="1 0 0 1"/></material></visual></link>
      <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
      </joint></robot>"""
    path = tmp_path / "r.urdf"
    path.write_text(text)
    found = drawing(cp.load_robot(path))
    assert found.notes == ("link 'arm' is not drawn whole: no file 'package://nowhere/arm.stl'",)
    ((mesh, colour),) = next(p for p in found.parts if p.path == "robot/j").meshes
    assert colour == (1.0, 0.0, 0.0)
    assert np.allclose(mesh.vertices.max(axis=0), (0.5, 1.0, 2.5))


# Motions


def test_a_motion_is_played_thirty_times_a_second(swinging):
    found = drawing(swinging)
    assert len(found.moments) == 16
    assert found.fps == 30.0
    assert len(drawing(swinging, speed=0.5).moments) == 31
    model = swinging.scene.robot.model
    k = int(np.searchsorted(swinging.t, 0.3 - 1e-9))
    data = model.createData()
    pin.forwardKinematics(model, data, swinging.q[k])
    assert np.allclose(found.moments[9].joints[-1].homogeneous, data.oMi[-1].homogeneous)


def test_what_moves_has_tracks_and_what_rests_has_none(swinging):
    found = drawing(swinging)
    moving = tracks(found.parts, found.moments)
    assert "floor" not in moving
    assert (
        {t["name"] for t in moving["robot/coupler_joint"]} >= {".position", ".quaternion"}
        if ("robot/coupler_joint" in moving)
        else any(p.startswith("robot/") for p in moving)
    )
    arrow = next(p for p in moving if p.startswith("forces/") and not p.endswith("label"))
    assert {t["name"] for t in moving[arrow]} == {".position", ".quaternion", ".scale"}


def test_a_motion_survives_its_file(tmp_path, standing):
    scene, q, v, _ = standing
    run = cp.simulate(scene, q, v, duration=0.05, dt=0.005)
    run.save(tmp_path / "run.npz")
    again = cp.Trajectory.load(tmp_path / "run.npz")
    assert parts(again).keys() == parts(run).keys()  # its meshes too
    assert any(len(p.meshes[0][0].faces) > 1000 for k, p in parts(again).items() if "robot/" in k)


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
    with urllib.request.urlopen(one.url, timeout=10) as answer:
        assert answer.read().decode() == one.html
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(f"{one.url}other", timeout=10)
    refused.value.close()
    with pytest.raises(cp.InvalidArgument, match="a free one is taken"):
        cp.view(cp.pendulum(), browser=False, port=int(two.url.split(":")[2].strip("/")))
    where = one.url
    one.close()
    one.close()
    two.close()
    assert one.url == ""
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(where, timeout=10)


def test_a_program_that_forgets_its_viewer_ends_cleanly():
    code = (
        "import condyn_pin as cp, urllib.request, gc\n"
        "url = cp.view(cp.pendulum(), browser=False).url; gc.collect()\n"
        "assert urllib.request.urlopen(url, timeout=10).read(15) == b'<!DOCTYPE html>'\n"
    )
    words = [sys.executable, "-W", "error", "-W", "ignore:Please update:DeprecationWarning"]
    done = subprocess.run([*words, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")


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
    done = subprocess.run([*words, file.as_uri()], capture_output=True, text=True, timeout=120)
    answer = json.loads(re.search(r'<pre id="answer">(.*?)</pre>', done.stdout)[1])
    assert answer["errors"] == []
    assert answer["duration"] == pytest.approx(0.5, abs=1e-6)
    assert answer["actions"] == len(tracks(found.parts, found.moments))
    for part in found.parts:
        if part.path in paths:
            seen = np.array(answer[part.path]).reshape(4, 4).T
            assert np.allclose(seen, part.place(found.moments[9]), atol=1e-5), part.path


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
    assert grey.mean() > 0.03  # the robot, and not only its outlines
    hue, saturation, _ = np.moveaxis(np.asarray(picture.convert("HSV"), float)[170:], 2, 0)

    def seen(colour):
        import colorsys

        wanted = 255.0 * colorsys.rgb_to_hsv(*colour)[0]
        near = np.abs((hue - wanted + 127.5) % 255.0 - 127.5) < 5.0
        return int((near & (saturation > 130)).sum())

    for name in ("ACTUATED", "FORCE", "OPEN", "CLOSED"):
        assert seen(getattr(palette, name)) > 60, name
    assert seen((0.6, 0.0, 1.0)) < 20  # violet is nowhere
