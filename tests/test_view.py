"""Pictures: what is drawn, where, and in which colour."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import combinations, pairwise, permutations

import numpy as np
import pinocchio as pin
import pytest
from viewed import bent_cassie, drawing, falling_bar, parts

import condyn_pin as cp
from condyn_pin.viewing import meshes, palette, placing
from condyn_pin.viewing.descriptions import shapes_of
from condyn_pin.viewing.motion import tracks
from condyn_pin.viewing.part import span
from condyn_pin.viewing.skeleton import skeleton


@pytest.fixture(scope="module")
def standing():
    return bent_cassie()


@pytest.fixture(scope="module")
def cassie(standing):
    return standing[0].robot


@pytest.fixture(scope="module")
def swinging():
    return falling_bar()


# Meshes


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0


def test_solids_have_their_volume_and_point_outward():
    assert volume(meshes.box(1.0, 2.0, 3.0)) == pytest.approx(6.0)
    assert volume(meshes.cylinder(0.5, 2.0)) == pytest.approx(0.5 * np.pi, rel=0.02)
    assert volume(meshes.sphere(0.5)) == pytest.approx(np.pi / 6.0, rel=0.05)
    whole = meshes.capsule(0.5, 2.0)
    assert volume(whole) == pytest.approx(0.5 * np.pi + np.pi / 6.0, rel=0.06)
    assert whole.vertices[:, 2].min() == pytest.approx(-0.5)
    assert whole.vertices[:, 2].max() == pytest.approx(2.5)


def test_a_simplified_mesh_keeps_its_form_to_a_cell(cassie):
    shape = next(s for s in shapes_of(cassie.description)[0] if s.link == "pelvis")
    fine = meshes.read_mesh(shape.file)
    coarse = fine.simplified(0.02)
    assert len(coarse.faces) < 0.3 * len(fine.faces)
    assert np.abs(coarse.vertices.min(axis=0) - fine.vertices.min(axis=0)).max() < 0.02
    assert np.abs(coarse.vertices.max(axis=0) - fine.vertices.max(axis=0)).max() < 0.02
    assert coarse.faces.max() < len(coarse.vertices)


@pytest.mark.parametrize("edges", [(0.01, 0.01, 1.0), (0.01, 1.0, 1.0), (1.0, 1.0, 1.0)])
def test_a_simplified_rod_or_plate_stays_one(edges):
    fine = meshes.box(*edges)
    for _ in range(4):  # 3072 triangles
        fine = halved(fine)
    coarse = fine.simplified(0.2)
    assert len(coarse.faces) < 0.3 * len(fine.faces)
    assert volume(coarse) == pytest.approx(np.prod(edges), rel=0.6)
    assert (np.ptp(coarse.vertices, axis=0) > 0.6 * np.array(edges)).all()
    flat = meshes.Mesh(fine.vertices * (1.0, 1.0, 0.0), fine.faces).simplified(0.2)
    assert np.isfinite(flat.vertices).all()


def halved(mesh):
    """Every triangle in four."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    corners = np.vstack(
        [np.hstack(t) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    )
    return meshes._used(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


@pytest.mark.parametrize("name", ["cassie", "talos"])
def test_what_moves_has_few_triangles_and_the_same_extent(name):
    found = drawing(cp.load_robot(name))
    bodies = [part for part in found.parts if part.path.startswith("robot/")]
    assert sum(len(few.faces) for part in bodies for few in part.coarse) <= 10_000
    placed = [(part.place(found.moments[0]), whole, few) for part in bodies
              for (whole, _), few in zip(part.meshes, part.coarse, strict=True)]  # fmt: skip
    assert all(len(few.faces) for _, _, few in placed)
    whole = np.vstack([mesh.moved(T).vertices for T, mesh, _ in placed])
    few = np.vstack([mesh.moved(T).vertices for T, _, mesh in placed])
    assert np.abs(whole.min(axis=0) - few.min(axis=0)).max() < 0.04  # [m]
    assert np.abs(whole.max(axis=0) - few.max(axis=0)).max() < 0.04
    light = {part.path: part for part in drawing(cp.load_robot(name), light=True).parts}
    assert all(light[part.path].coarse for part in bodies)
    assert not any(
        part.coarse for part in drawing(cp.model.four_bar()).parts
    )  # it has few as it is


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
    assert all(a > b for a, b in pairwise(greens))


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
    bar = cp.model.four_bar()
    mark = parts(bar)[f"joints/actuated/{bar.actuated[0]}"].meshes[0][0]
    spread = np.ptp(mark.vertices, axis=0)
    assert int(spread.argmax()) == 1  # its bars move in the plane of x and z


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


def test_a_force_is_on_a_body_and_not_on_a_mere_frame():
    stewart = cp.load_robot("stewart")
    scene = cp.Scene(stewart, stewart.loops)
    found = parts(cp.control.gravity_compensation(scene, scene.state()[0]))
    bodies = {frame.name for frame in stewart.model.frames if frame.type == pin.FrameType.BODY}
    on = {p.split("/on ")[1] for p in found if p.startswith("forces/") and "label" not in p}
    assert on <= bodies
    assert "platform" in on


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


def test_an_inertia_that_would_hide_the_rods_is_clear():
    """Andrews' squeezer is given in the plane: its inertias are those of large balls."""
    found = parts(cp.load_robot("andrews"))
    inertias = [part for path, part in found.items() if path.startswith("inertia/")]
    assert len(inertias) == 7
    assert all(part.opacity < 0.3 for part in inertias)
    rods = [part for path, part in found.items() if path.startswith("robot/")]
    assert all(part.opacity == 1.0 for part in rods)
    assert {f"inertia/{path.split('/')[1]}" for path in found if path.startswith("robot/")} >= {
        part.path for part in inertias
    }
    assert not [path for path in parts(cp.model.four_bar()) if path.startswith("inertia/")]


@pytest.mark.parametrize(
    "names", [("arm", "arm/tip"), ("arm", "arm/0"), ("arm", "arm/"), ("a//b", "a/b")]
)
def test_a_name_with_a_slash_hangs_on_no_other_part(names):
    """meshcat's tree is made of paths: what is below another part would move with it as well."""
    model = pin.Model()
    inertia = pin.Inertia.FromEllipsoid(2.0, 0.3, 0.2, 0.1)
    i = 0
    for name in names:
        i = model.addJoint(i, pin.JointModelRX(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
    found = drawing(cp.Robot("r", model))
    nodes = [tuple(word for word in part.path.split("/") if word) for part in found.parts]
    assert len([node for node in nodes if node[0] == "robot"]) == 2
    for one, other in permutations(nodes, 2):
        assert one != other[: len(one)]


HANGING = """<robot name="arm"><link name="ground"/>
<link name="upper"><inertial><origin xyz="0 0 -0.2"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
<link name="lower"><inertial><origin xyz="0 0 -0.2"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="ground"/><child link="upper"/>
<axis xyz="0 1 0"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
<origin xyz="0 0 -0.4"/><axis xyz="0 1 0"/></joint></robot>"""


def test_a_robot_that_is_drawn_in_part_is_seen_whole_and_above_the_floor(tmp_path):
    (tmp_path / "arm.urdf").write_text(HANGING)
    found = parts(cp.load_robot(tmp_path / "arm.urdf"))
    boxes = {path: part.meshes[0][0] for path, part in found.items() if path.startswith("robot/")}
    assert set(boxes) == {"robot/shoulder", "robot/elbow"}
    assert np.allclose(np.ptp(boxes["robot/shoulder"].vertices, axis=0), 0.1)  # as the file has it
    (floor,) = {float(z) for z in found["floor"].meshes[0][0].vertices[:, 2]}
    assert floor < -0.6
    (floor,) = {float(z) for z in parts(cp.model.four_bar())["floor"].meshes[0][0].vertices[:, 2]}
    assert floor == 0.0


def held(name, posture=None):
    """A robot that its motors hold still."""
    robot = cp.load_robot(name)
    scene = cp.Scene(robot, (*robot.loops, *robot.contacts))
    return cp.control.gravity_compensation(scene, scene.state(posture)[0])


@pytest.mark.parametrize("name", ["cassie", "talos", "stewart", "delta", "five_bar"])
def test_labels_do_not_cover_one_another(name):
    found = drawing(held(name))
    at, eye = found.moments[0], placing.Eye(np.array([1.0, 0.0, 0.0]), np.zeros(3))
    assert np.allclose(eye.axes, [[0, 1, 0], [0, 0, 1], [1, 0, 0]])  # right, up, backward
    eye = found.eye
    labels = {p.path: eye.box(p.place(at), np.zeros(2)) for p in found.parts if p.picture}
    assert len(labels) > 3
    for one, other in combinations(labels, 2):
        assert not placing._overlap(labels[one], labels[other]), (one, other)


def test_a_label_that_had_to_move_is_led_back_to_its_point():
    found = drawing(held("delta"))
    picture, at = {part.path: part for part in found.parts}, found.moments[0]
    lines = [path for path in picture if path.endswith(" line")]
    assert lines
    for path in lines:
        T, sign = picture[path].place(at), picture[path.removesuffix(" line")].place(at)
        assert np.allclose(T @ [0, 0, 1, 1], sign[:, 3])
        assert np.linalg.norm(T[:3, 2]) < 8.0 * sign[1, 1]  # near its point


@pytest.mark.parametrize("name", ["cassie", "talos", "stewart", "delta"])
def test_marks_are_solids_that_are_seen_from_outside(name):
    """Marks show their front only: one that is wound inward, or mirrored, would be seen through."""
    found = drawing(held(name))
    marks = [part for part in found.parts if part.on_top and part.meshes]
    assert len(marks) > 5
    for part in marks:
        assert np.linalg.det(part.place(found.moments[0])[:3, :3]) > 0.0, part.path
        assert all(volume(mesh) > 0.0 for mesh, _ in part.meshes), part.path


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
    assert picture["before/robot/left-knee-op"].opacity < 0.5
    assert picture["robot/left-knee-op"].opacity == 1.0
    assert np.linalg.norm(before.place(at)[:3, 2]) > 0.1
    assert np.linalg.norm(after.place(at)[:3, 2]) < 1e-8


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
      <inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
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


_MJCF = """<mujoco>
  <default><default class="thin"><geom size="0.02" rgba="0 0 1 1"/></default></default>
  <asset><mesh name="lost" file="nowhere.stl"/>
    <mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/></asset>
  <worldbody>
    <geom type="plane" size="1 1 1"/><geom type="box" size="0.1 0.2 0.3" pos="0 0 -0.3"/>
    <body name="arm" pos="0 0 1"><joint name="hinge" axis="0 1 0"/>
      <inertial pos="0 0 -0.5" mass="1" diaginertia="0.1 0.1 0.01"/>
      <geom class="thin" type="capsule" fromto="0 0 0  0 0 -1"/>
      <geom type="ellipsoid" size="0.1 0.2 0.3" rgba="1 0 0 1"/>
      <geom type="mesh" mesh="wedge" rgba="0 1 0 1"/><geom type="mesh" mesh="lost"/>
      <geom type="sphere" size="9" group="3"/>
    </body>
  </worldbody>
</mujoco>"""


def test_geoms_of_an_mjcf_are_drawn(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(_MJCF)
    robot = cp.load_robot(path)
    found = drawing(robot)
    assert found.notes == ("body 'arm' is not drawn whole: no file 'nowhere.stl'",)
    picture = {part.path: part for part in found.parts}
    ((ground, _),) = picture["robot/universe"].meshes
    assert np.allclose(np.ptp(ground.vertices, axis=0), (0.2, 0.4, 0.6))
    at = {colour: mesh for mesh, colour in picture["robot/hinge"].meshes}
    assert np.allclose(at[0.0, 0.0, 1.0].vertices[:, 2].min(), -1.02)
    assert np.allclose(at[0.0, 0.0, 1.0].vertices[:, 2].max(), 0.02)
    assert np.allclose(np.ptp(at[1.0, 0.0, 0.0].vertices, axis=0)[2], 0.6)
    assert np.allclose(np.ptp(at[0.0, 1.0, 0.0].vertices, axis=0), (1.0, 1.0, 1.0), atol=1e-6)
    assert np.allclose(at[0.0, 1.0, 0.0].vertices.min(axis=0), 0.0, atol=1e-6)
    assert volume(at[0.0, 1.0, 0.0]) == pytest.approx(1.0 / 6.0)
    assert len(at) == 3  # what MuJoCo's viewer hides is not seen


def test_geoms_need_mujoco_and_mechanisms_do_not(tmp_path, monkeypatch):
    path = tmp_path / "arm.xml"
    path.write_text(_MJCF)
    robot = cp.load_robot(path)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert drawing(cp.load_robot("stewart")).notes == ()
    (note,) = drawing(robot).notes
    assert "condyn_pin[mjcf]" in note


def test_an_ellipsoid_of_an_sdf_has_its_half_axes(tmp_path):
    path = tmp_path / "egg.sdf"
    path.write_text(
        "<sdf version='1.9'><model name='m'><link name='egg'><visual name='v'><geometry>"
        "<ellipsoid><radii>1 2 3</radii></ellipsoid></geometry></visual></link></model></sdf>"
    )
    ((shape,), missing) = shapes_of(str(path))
    assert missing == ()
    assert np.allclose(np.ptp(shape.mesh().vertices, axis=0), (2.0, 4.0, 6.0))


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


@pytest.mark.parametrize("speed", [1.0, 0.37])
def test_a_motion_is_shown_as_closed_as_it_was_computed(speed):
    """Between samples nothing was computed: halfway between closed configurations is open."""
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    run = cp.simulate(scene, *scene.state(), duration=0.5, dt=0.007)
    assert run.violation.max() < 1e-12
    found = drawing(run, speed=speed)
    (loop,) = bar.loops
    for at in found.moments:
        assert at.gaps[loop.name].length < 1e-12
    times = found.frames / 30.0 * speed
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(run.t[-1])
    data = bar.model.createData()
    for at, time in zip(found.moments, times, strict=True):
        k = int(np.abs(run.t - time).argmin())
        assert run.t[k] == pytest.approx(time, abs=1e-12)
        pin.forwardKinematics(bar.model, data, run.q[k])
        assert np.allclose(at.joints[-1].homogeneous, data.oMi[-1].homogeneous, atol=1e-14)


def test_a_label_says_the_largest_gap_of_the_run_and_not_of_what_is_shown(swinging, monkeypatch):
    from condyn_pin.viewing import closures

    q = swinging.q.copy()
    q[3, 0] += 0.01  # [rad], at 15 ms, between two pictures
    run = replace(swinging, q=q)
    labels = []

    def label(path, name, gap, height, written=closures._label):
        labels.append(gap)
        return written(path, name, gap, height)

    monkeypatch.setattr(closures, "_label", label)
    found = drawing(run)
    (loop,) = run.scene.robot.loops
    assert max(at.gaps[loop.name].length for at in found.moments) < 1e-9
    (gap,) = labels
    assert gap.length == pytest.approx(run.violation.max(), rel=0.5)  # a norm, and an entry
    assert gap.length > 1e-3


def test_an_arrow_says_the_largest_force_of_the_run(swinging, monkeypatch):
    from condyn_pin.viewing import arrows

    lam = swinging.lam.copy()
    lam[3] *= 50.0  # at 15 ms, between two pictures
    run = replace(swinging, lam=lam)
    said = []

    def label(path, text, *rest, written=arrows.label):
        said.append(text)
        return written(path, text, *rest)

    monkeypatch.setattr(arrows, "label", label)
    drawing(run)
    (force,) = run.forces.values()
    largest = np.linalg.norm(force[:, :3], axis=1).max()
    assert (
        largest > 10.0 * np.linalg.norm(swinging.forces[next(iter(run.forces))][:, :3], axis=1)[0]
    )
    assert said
    assert all(text.startswith(f"{largest:.3g} N on ") for text in said)


def test_an_event_is_shown_before_and_after():
    """Two samples have one time; a sparse motion shows both, and never one out of order."""
    from condyn_pin.viewing.motion import shown

    class Two:
        t = np.array([0.0, 0.1, 0.1, 0.2])

    assert shown(Two, 30.0).tolist() == [0, 1, 2, 3]
    assert shown(Two, 1.0).tolist() == [0, 3]


def test_what_moves_has_tracks_and_what_rests_has_none(swinging):
    found = drawing(swinging)
    moving = tracks(found.parts, found.moments, found.frames)
    assert "floor" not in moving
    bodies = [path for path in moving if path.startswith("robot/")]
    assert len(bodies) == 3
    for path in bodies:
        assert {t["name"] for t in moving[path]} == {".position", ".quaternion"}
    arrow = next(p for p in moving if p.startswith("forces/") and not p.endswith("label"))
    assert {t["name"] for t in moving[arrow]} == {".position", ".quaternion", ".scale"}


def test_a_motion_survives_its_file(tmp_path, standing):
    scene, q, v, _ = standing
    run = cp.simulate(scene, q, v, duration=0.05, dt=0.005)
    run.save(tmp_path / "run.npz")
    again = cp.Trajectory.load(tmp_path / "run.npz")
    assert parts(again).keys() == parts(run).keys()  # its meshes too
    assert any(len(p.meshes[0][0].faces) > 1000 for k, p in parts(again).items() if "robot/" in k)
