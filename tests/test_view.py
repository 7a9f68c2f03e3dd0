"""Pictures: what is drawn, where, and in which colour."""

from __future__ import annotations

import pickle
import re
import sys
from dataclasses import replace
from itertools import pairwise, permutations
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from shared import each_robot, each_row
from viewed import bent, cassie, drawing, held, parts, standing, swinging

import condyn_pin as cp
from condyn_pin.io import meshes
from condyn_pin.io.shapes import shapes_of
from condyn_pin.viewing import bodies, marks, motion
from condyn_pin.viewing import part as palette
from condyn_pin.viewing.motion import drawn_samples, tracks
from condyn_pin.viewing.part import span

# Meshes


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0


@pytest.mark.parametrize(
    ("solid", "wanted", "to"),
    [
        (meshes.box(1.0, 2.0, 3.0), 6.0, 1e-9),
        (meshes.cylinder(0.5, 2.0), 0.5 * np.pi, 0.02),
        (meshes.sphere(0.5), np.pi / 6.0, 0.05),
        (meshes.capsule(0.5, 2.0), 0.5 * np.pi + np.pi / 6.0, 0.06),
        (meshes.rod(0.5, 2.0, 20), 0.5 * np.pi, 0.02),
    ],
)
def test_solids_have_their_volume_and_point_outward(solid, wanted, to):
    assert volume(solid) == pytest.approx(wanted, rel=to)


@pytest.mark.long
def test_a_capsule_stands_on_the_origin_but_for_its_half_ball():
    z = meshes.capsule(0.5, 2.0).vertices[:, 2]
    assert (z.min(), z.max()) == pytest.approx((-0.5, 2.5))


@pytest.mark.long
def test_a_simplified_mesh_keeps_its_form_to_a_cell():
    shape = next(s for s in shapes_of(cassie().description)[0] if s.link == "pelvis")
    fine = meshes.read_mesh(shape.file)
    coarse = fine.simplified(0.02)
    assert len(coarse.faces) < 0.3 * len(fine.faces)
    assert np.abs(coarse.vertices.min(axis=0) - fine.vertices.min(axis=0)).max() < 0.02
    assert np.abs(coarse.vertices.max(axis=0) - fine.vertices.max(axis=0)).max() < 0.02
    assert coarse.faces.max() < len(coarse.vertices)


@pytest.mark.long
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
    return meshes.cleaned(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


@pytest.mark.long
@pytest.mark.parametrize("name", ["cassie", "talos"])
def test_what_moves_has_few_triangles_and_the_same_extent(name):
    found = drawing(cp.load_robot(name))
    drawn = [part for part in found.parts if part.path.startswith("robot/")]
    assert sum(len(few.faces) for part in drawn for few in part.coarse) <= 10_000
    placed = [(part.place(found.instants[0]), whole, few) for part in drawn
              for (whole, _), few in zip(part.meshes, part.coarse, strict=True)]  # fmt: skip
    assert all(len(few.faces) for _, _, few in placed)
    whole = np.vstack([mesh.moved(T).vertices for T, mesh, _ in placed])
    few = np.vstack([mesh.moved(T).vertices for T, _, mesh in placed])
    assert np.abs(whole.min(axis=0) - few.min(axis=0)).max() < 0.04  # [m]
    assert np.abs(whole.max(axis=0) - few.max(axis=0)).max() < 0.04
    light = parts(cp.load_robot(name), light=True)
    assert all(light[part.path].coarse for part in drawn)
    assert not any(part.coarse for part in drawing(cp.model.four_bar()).parts)  # few as it is


@pytest.mark.long
def test_a_span_takes_the_unit_length_to_a_segment():
    rng = np.random.default_rng(0)
    for _ in range(20):
        start, end = rng.normal(size=(2, 3))
        T = span(start, end)
        assert np.allclose(T @ [0, 0, 1, 1], [*end, 1])
        assert np.allclose(T @ [0, 0, 0, 1], [*start, 1])
        assert np.linalg.det(T[:3, :3]) == pytest.approx(np.linalg.norm(end - start))
    assert np.isfinite(span(start, start)).all()


@pytest.mark.long
def test_gaps_are_coloured_by_their_length():
    assert palette.gap_colour(0.0) == palette.CLOSED
    assert palette.gap_colour(1.0) == pytest.approx(palette.OPEN)
    greens = [palette.gap_colour(x)[1] for x in np.logspace(-9, -2, 8)]
    assert all(a > b for a, b in pairwise(greens))


# What is drawn


@each_robot
def test_every_robot_can_be_seen(name):
    robot = cp.load_robot(name)
    found = drawing(robot, robot.postures.get("standing", pin.neutral(robot.model)))
    at, seen = found.instants[0], []
    assert found.notes == ()
    for part in found.parts:
        T = part.place(at)
        assert np.isfinite(T).all(), part.path
        for mesh, _ in part.meshes:
            assert np.isfinite(mesh.vertices).all()
            assert mesh.faces.max() < len(mesh.vertices)
            if part.path.startswith("robot/"):
                seen.append(mesh.moved(T))
    assert sum(len(mesh.faces) for mesh in seen) > 50
    reach = max(np.abs(mesh.vertices - found.middle).max() for mesh in seen)
    assert reach < 2.0 * found.size  # a mesh in millimetres would be far outside


@pytest.mark.long
def test_joints_are_marked_along_their_axes_and_motors_told_apart():
    found = parts(cassie())
    motors = {p.split("/", 2)[2] for p in found if p.startswith("joints/actuated/")}
    passive = {p.split("/", 2)[2] for p in found if p.startswith("joints/passive/")}
    assert motors == set(cassie().actuated)
    assert motors | passive == set(cassie().joints) - {"root_joint"}
    (_, colour), *_ = found["joints/actuated/left-knee-op"].meshes
    assert colour == palette.ACTUATED
    bar = cp.model.four_bar()
    mark = parts(bar)[f"joints/actuated/{bar.actuated[0]}"].meshes[0][0]
    assert int(np.ptp(mark.vertices, axis=0).argmax()) == 1  # bars move in the plane of x and z


def test_both_frames_of_a_closure_and_its_gap():
    found = drawing(standing(), bent())
    at, name = found.instants[0], "left-achilles-spring-joint"
    picture = {part.path: part for part in found.parts}
    data = cassie().model.createData()
    pin.forwardKinematics(cassie().model, data, bent())
    loop = next(loop for loop in cassie().loops if loop.name == name)
    ends = []
    for frame, path in ((loop.frame_a, "frame_a"), (loop.frame_b, "frame_b")):
        joint, placement = cassie().frame(frame)
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


def test_forces_are_arrows_where_and_how_they_act():
    q, v = standing().state("standing")
    sol = cp.solve(standing(), q, v, cassie().passive_torque(q, v))
    found = drawing(sol)
    at = found.instants[0]
    drawn = {p.path: p for p in found.parts if p.path.startswith("forces/") and not p.picture}
    scales = []
    for name, force in sol.forces.items():
        path = next(p for p in drawn if p.startswith(f"forces/{name}/on "))
        T = drawn[path].place(at)
        vector = force.in_world()[:3]
        assert np.allclose(T[:3, 3], force.at)
        scales.append(np.linalg.norm(T[:3, 2]) / np.linalg.norm(vector))
        assert np.allclose(T[:3, 2], scales[-1] * vector)
    assert np.allclose(scales, scales[0])  # one scale for all
    assert "forces/left-foot/toe/on left-foot" in drawn
    both = [p for p in drawn if p.startswith("forces/left-achilles-spring-joint/on ")]
    assert len(both) == 2  # on the rod, and on the heel spring
    a, b = (drawn[p].place(at)[:3, 2] for p in both)
    assert np.allclose(a, -b)
    assert not [p for p in parts(sol, forces=False) if p.startswith("forces/")]


@pytest.mark.long
def test_a_force_is_on_a_body_and_not_on_a_mere_frame():
    found = parts(held("stewart"))
    frames = held("stewart").scene.robot.model.frames
    named = {frame.name for frame in frames if frame.type == pin.FrameType.BODY}
    on = {p.split("/on ")[1] for p in found if p.startswith("forces/") and "label" not in p}
    assert on <= named
    assert "platform" in on


def test_a_contact_patch_has_its_size_and_the_centre_of_mass_its_place():
    talos = cp.load_robot("talos")
    foot = cp.SurfaceContact("left_sole_link", half_length=0.1, half_width=0.06)
    q = talos.postures["half_sitting"]
    found = drawing(cp.Scene(talos, [foot]), q)
    picture = {part.path: part for part in found.parts}
    mesh, _ = picture["contacts/left_sole_link/patch"].meshes[0]
    assert np.allclose(np.ptp(mesh.vertices, axis=0)[:2], (0.2, 0.12))
    com = pin.centerOfMass(talos.model, talos.model.createData(), q)
    assert np.allclose(picture["mass/centre"].place(found.instants[0])[:3, 3], com)


def tree(names, name="r"):
    """Hinges in a row, with an egg on each."""
    model, i = pin.Model(), 0
    for each in names:
        i = model.addJoint(i, pin.JointModelRX(), pin.SE3.Identity(), each)
        inertia = pin.Inertia.FromEllipsoid(2.0, 0.3, 0.2, 0.1)
        model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
    return cp.Robot(name, model)


@pytest.mark.long
def test_what_nobody_drew_has_its_inertia():
    (part,) = bodies.skeleton(tree(["hinge"]), 0.1)
    half = 0.5 * np.ptp(part.meshes[-1][0].vertices, axis=0)
    assert np.allclose(np.sort(half), (0.1, 0.2, 0.3), rtol=0.06)


@pytest.mark.long
def test_an_inertia_that_would_hide_the_rods_is_clear():
    """Andrews' squeezer is given in the plane: its inertias are those of large balls."""
    found = parts(cp.load_robot("andrews"))
    inertias = [part for path, part in found.items() if path.startswith("inertia/")]
    assert len(inertias) == 7
    assert all(part.opacity < 0.3 for part in inertias)
    rods = {path: part for path, part in found.items() if path.startswith("robot/")}
    assert all(part.opacity == 1.0 for part in rods.values())
    assert {path.replace("robot/", "inertia/") for path in rods} >= {p.path for p in inertias}
    assert not [path for path in parts(cp.model.four_bar()) if path.startswith("inertia/")]


@pytest.mark.parametrize(
    "names", [("arm", "arm/tip"), ("arm", "arm/0"), ("arm", "arm/"), ("a//b", "a/b")]
)
def test_a_name_with_a_slash_hangs_on_no_other_part(names):
    """meshcat's tree is made of paths: what is below another part would move with it as well."""
    found = drawing(tree(names))
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


@pytest.mark.long
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


@pytest.mark.parametrize("name", ["cassie", "talos", "stewart", "solo12", "five_bar", "andrews"])
def test_a_picture_is_filled_by_the_robot_and_cuts_nothing(name):
    found = drawing(cp.load_robot(name))
    at, eye = found.instants[0], found.eye
    points = np.concatenate([
        mesh.vertices @ T[:3, :3].T + T[:3, 3]
        for part in found.parts
        if part.path.startswith(("robot/", "closures/")) and not part.picture
        for T in [part.place(at)]
        for mesh, _ in part.meshes
    ])  # fmt: skip
    x, y, z = eye.axes @ (points - eye.at).T
    seen = np.abs([x / -z / motion.ASPECT, y / -z]) / np.tan(np.deg2rad(0.5 * motion.FIELD))
    assert (z < 0.0).all()
    assert 0.6 < seen.max() < 0.9


def test_a_body_under_the_ground_is_named_in_the_title():
    solo = cp.load_robot("solo12")
    scene = cp.Scene(solo, contacts=solo.frictional_contacts(0.7))
    q = scene.state()[0].copy()
    assert "warning" not in drawing(scene, q).title
    q[2] -= 0.1
    assert re.search(r"\(warning: \w+ is 1\d cm under the ground\)$", drawing(scene, q).title)


def test_a_floor_hides_what_is_below_and_is_there_for_what_stands():
    found = parts(cassie())
    assert found["sheet"].opacity == 1.0
    assert "sheet" not in parts(cp.model.four_bar())  # which may hang from its base


@pytest.mark.parametrize("name", ["cassie", "talos", "stewart", "delta"])
def test_marks_are_solids_that_are_seen_from_outside(name):
    """Marks show their front only: one that is wound inward, or mirrored, would be seen through."""
    found = drawing(held(name))
    marks = [part for part in found.parts if part.on_top and part.meshes]
    assert len(marks) > 5
    for part in marks:
        assert np.linalg.det(part.place(found.instants[0])[:3, :3]) > 0.0, part.path
        assert all(volume(mesh) > 0.0 for mesh, _ in part.meshes), part.path


@pytest.mark.long
def test_an_assembly_is_seen_before_and_after():
    loops = cp.Scene(cassie(), cassie().loops)
    found = drawing(loops.assemble(bent(), fixed=["left-knee-op"]))
    picture, at = {p.path: p for p in found.parts}, found.instants[0]
    before = picture["before/closures/left-achilles-spring-joint/gap"]
    after = picture["closures/left-achilles-spring-joint/gap"]
    assert before.tint(at) == pytest.approx(palette.OPEN)
    assert after.tint(at) == palette.CLOSED
    assert picture["before/robot/left-knee-op"].opacity < 0.5
    assert picture["robot/left-knee-op"].opacity == 1.0
    assert np.linalg.norm(before.place(at)[:3, 2]) > 0.1
    assert np.linalg.norm(after.place(at)[:3, 2]) < 1e-8


@pytest.mark.long
def test_a_smaller_robot_keeps_its_shapes():
    locked = cp.Scene(cassie(), cassie().loops).lock(["left-knee-op"])
    assert locked.robot.description == cassie().description
    whole = parts(cassie(), cassie().postures["standing"])
    small = parts(locked.robot, pin.neutral(locked.robot.model))
    assert len([p for p in small if p.startswith("robot/")]) > 0
    assert "robot/left-knee-op" in whole
    assert "robot/left-knee-op" not in small


# Files

_TRIANGLE = np.float32([0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0]).tobytes() + bytes(2)
_URDF = """<robot name="r"><link name="base"/><link name="arm">
  <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><mesh filename="package://nowhere/arm.stl"/></geometry></visual>
  <visual><origin xyz="0 0 1"/><geometry><box size="1 2 3"/></geometry>
    <material name="m"><color rgba="1 0 0 1"/></material></visual></link>
  <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
  </joint></robot>"""


@pytest.mark.long
def test_a_mesh_that_is_missing_is_said(tmp_path):
    path = tmp_path / "r.urdf"
    path.write_text(_URDF)
    found = drawing(cp.load_robot(path))
    assert found.notes == ("link 'arm' is not drawn whole: no file 'package://nowhere/arm.stl'",)
    ((mesh, colour),) = next(p for p in found.parts if p.path == "robot/j").meshes
    assert colour == (1.0, 0.0, 0.0)
    assert np.allclose(mesh.vertices.max(axis=0), (0.5, 1.0, 2.5))


def test_meshes_are_looked_for_in_the_package_folders(tmp_path):
    path, folder = tmp_path / "r.urdf", tmp_path / "elsewhere" / "nowhere"
    path.write_text(_URDF)
    folder.mkdir(parents=True)
    (folder / "arm.stl").write_bytes(bytes(80) + np.uint32(1).tobytes() + _TRIANGLE)
    robot = cp.load_robot(path, package_dirs=[folder.parent])
    assert robot.package_dirs == (str(folder.parent),)
    assert drawing(robot).notes == ()
    bar = replace(cp.load_robot("four_bar"), package_dirs=robot.package_dirs)
    assert pickle.loads(pickle.dumps(bar)).package_dirs == robot.package_dirs
    for wrong in (str(folder), [tmp_path / "none"]):
        with pytest.raises(cp.InvalidArgument, match=r"package_dirs = .*: a list of folders"):
            cp.load_robot(path, package_dirs=wrong)


@each_row("shape", ["<cylinder/>", '<box size="1 2"/>', "<sphere/>", "<cone/>"])
def test_a_shape_without_its_sizes_is_said(tmp_path, shape):
    path = tmp_path / "r.urdf"
    path.write_text(_URDF.replace('<box size="1 2 3"/>', shape))
    shapes, missing = shapes_of(str(path))
    assert shapes == ()
    assert [text.split(": ")[0] for text in missing] == 2 * ["link 'arm' is not drawn whole"]


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
    blue, red, green = (at[tuple(colour)] for colour in np.eye(3)[[2, 0, 1]].tolist())
    assert np.allclose(blue.vertices[:, 2].min(), -1.02)
    assert np.allclose(blue.vertices[:, 2].max(), 0.02)
    assert np.allclose(np.ptp(red.vertices, axis=0)[2], 0.6)
    assert np.allclose(np.ptp(green.vertices, axis=0), (1.0, 1.0, 1.0), atol=1e-6)
    assert np.allclose(green.vertices.min(axis=0), 0.0, atol=1e-6)
    assert volume(green) == pytest.approx(1.0 / 6.0)
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


@pytest.mark.long
def test_a_motion_is_played_thirty_times_a_second():
    found = drawing(swinging())
    assert len(found.instants) == 16
    assert found.fps == 30.0
    assert len(drawing(swinging(), speed=0.5).instants) == 31
    model = swinging().scene.robot.model
    k = int(np.searchsorted(swinging().t, 0.3 - 1e-9))
    data = model.createData()
    pin.forwardKinematics(model, data, swinging().q[k])
    assert np.allclose(found.instants[9].joints[-1].homogeneous, data.oMi[-1].homogeneous)


@pytest.mark.long
@pytest.mark.parametrize("speed", [1.0, 0.37])
def test_a_motion_is_shown_as_closed_as_it_was_computed(speed):
    """Between samples nothing was computed: halfway between closed configurations is open."""
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    run = cp.simulate(scene, *scene.state(), duration=0.5, dt=0.007)
    assert run.violation.max() < 1e-12
    found = drawing(run, speed=speed)
    (loop,) = bar.loops
    times = found.frames / 30.0 * speed
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(run.t[-1])
    data = bar.model.createData()
    for at, time in zip(found.instants, times, strict=True):
        assert at.gaps[loop.name].length < 1e-12
        k = int(np.abs(run.t - time).argmin())
        assert run.t[k] == pytest.approx(time, abs=1e-12)
        pin.forwardKinematics(bar.model, data, run.q[k])
        assert np.allclose(at.joints[-1].homogeneous, data.oMi[-1].homogeneous, atol=1e-14)


def said_of(kind, monkeypatch, run):
    """Draw a motion; return the drawing, and the labels of its closures or of its forces."""
    said = []

    def label(path, text, *rest, written=marks.label):
        if path.startswith(kind):
            said.append(text)
        return written(path, text, *rest)

    monkeypatch.setattr(marks, "label", label)
    return drawing(run), said


@pytest.mark.long
def test_a_label_says_the_largest_gap_of_the_run_and_not_of_what_is_shown(monkeypatch):
    q = swinging().q.copy()
    q[3, 0] += 0.01  # [rad], at 15 ms, between two pictures
    run = replace(swinging(), q=q)
    found, (text,) = said_of("closures", monkeypatch, run)
    (loop,) = run.scene.robot.loops
    assert max(at.gaps[loop.name].length for at in found.instants) < 1e-9
    millimetres = float(text.removeprefix(f"{loop.name}: ").split(" mm")[0])
    assert millimetres == pytest.approx(1e3 * run.violation.max(), rel=0.5)  # a norm, an entry
    assert millimetres > 1.0


@pytest.mark.long
def test_an_arrow_says_the_largest_force_of_the_run(monkeypatch):
    lam = swinging().lam.copy()
    lam[3] *= 50.0  # at 15 ms, between two pictures
    run = replace(swinging(), lam=lam)
    _, said = said_of("forces", monkeypatch, run)
    ((name, force),) = run.forces.items()
    largest = np.linalg.norm(force[:, :3], axis=1).max()
    assert largest > 10.0 * np.linalg.norm(swinging().forces[name][:, :3], axis=1)[0]
    assert said
    assert said[0].startswith(f"{name}: {largest:.3g} N at most on ")
    assert all(text.startswith((f"{name}: ", "on ")) for text in said)
    said.clear()
    drawing(run, t=0.0)
    assert said
    assert not any("at most" in text for text in said)


def test_one_moment_of_a_motion_is_a_still_picture_with_its_own_forces():
    run = swinging()
    found = drawing(run, t=0.0151)
    assert len(found.instants) == 1
    assert (found.instants[0].com == run.scene.robot.center_of_mass(run.q[3])).all()
    assert found.title.endswith(f" at {run.t[3]:.4g} s")
    for t in (-1.0, run.t[-1] + 0.1):
        with pytest.raises(cp.InvalidArgument, match=f"t = {t}: the motion goes from 0 s to "):
            drawing(run, t=t)
    with pytest.raises(cp.InvalidArgument, match="t: a Scene is not a motion"):
        drawing(run.scene, t=0.0)


@pytest.mark.long
def test_a_name_or_a_path_is_read_first():
    with pytest.raises(cp.InvalidArgument, match=r"load_robot makes a Robot.*Trajectory.load"):
        cp.view("four_bar")


@pytest.mark.long
def test_a_loop_that_is_closed_says_so(monkeypatch):
    _, (text,) = said_of("closures", monkeypatch, swinging())
    assert text.endswith(": closed")


@pytest.mark.long
def test_an_event_is_shown_before_and_after():
    """Two samples have one time; a sparse motion shows both, and never one out of order."""
    two = SimpleNamespace(t=np.array([0.0, 0.1, 0.1, 0.2]))
    assert drawn_samples(two, 30.0).tolist() == [0, 1, 2, 3]
    assert drawn_samples(two, 1.0).tolist() == [0, 3]


def test_what_moves_has_tracks_and_what_rests_has_none():
    found = drawing(swinging())
    moving = tracks(found.parts, found.instants, found.frames)
    assert "floor" not in moving
    drawn = [path for path in moving if path.startswith("robot/")]
    assert len(drawn) == 3
    for path in drawn:
        assert {t["name"] for t in moving[path]} == {".position", ".quaternion"}
    arrow = next(p for p in moving if p.startswith("forces/") and not p.endswith("label"))
    assert {t["name"] for t in moving[arrow]} == {".position", ".quaternion", ".scale"}


@pytest.mark.long
def test_a_motion_survives_its_file(tmp_path):
    run = cp.simulate(standing(), *standing().state("standing"), duration=0.05, dt=0.005)
    run.save(tmp_path / "run.npz")
    again = cp.Trajectory.load(tmp_path / "run.npz")
    assert parts(again).keys() == parts(run).keys()  # its meshes too
    assert any(len(p.meshes[0][0].faces) > 1000 for k, p in parts(again).items() if "robot/" in k)


# The camera


@pytest.mark.long
@pytest.mark.parametrize("name", ["four_bar", "five_bar", "parallelogram", "andrews", "n_four_bar"])
def test_a_linkage_in_a_plane_is_seen_across_it(name):
    found = drawing(cp.load_robot(name))
    back = found.eye.axes[2]
    robot = cp.load_robot(name)
    joint = robot.model.joints[1]
    data = joint.createData()
    joint.calc(data, pin.neutral(robot.model)[: joint.nq])
    axis = np.array(data.S).ravel()[3:]
    assert abs(back @ axis) > 0.9  # the plane is open to the eye
    right = found.eye.axes[0]
    assert right.sum() > 0.0  # x goes to the right


@pytest.mark.long
def test_what_moves_in_space_is_seen_from_a_corner():
    for name in ("cassie", "stewart", "delta", "panda"):
        back = drawing(cp.load_robot(name)).eye.axes[2]
        assert np.abs(back).max() < 0.9


@pytest.mark.long
def test_a_linkage_that_lies_flat_is_seen_from_above():
    model = pin.Model()
    place = pin.SE3.Identity()
    for i in range(2):
        model.addJoint(i, pin.JointModelRZ(), place, f"joint {i}")
        place = pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0]))
        inertia = pin.Inertia(1.0, np.array([0.25, 0.0, 0.0]), 0.01 * np.eye(3))
        model.appendBodyToJoint(i + 1, inertia, pin.SE3.Identity())
    eye = drawing(cp.Robot("scara", model)).eye
    assert eye.axes[2][2] > 0.9
    assert np.isfinite(eye.axes).all()
