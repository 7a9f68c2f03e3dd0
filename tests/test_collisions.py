"""Collision shapes of a file as contacts, and the shapes that only these have."""

from __future__ import annotations

import pickle
from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box, Capsule, Convex, Cylinder, Ellipsoid, Plane
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics import contact_gaps
from condyn_pin.errors import (
    InvalidArgument,
    InvalidConstraint,
    InvalidModel,
    UnknownName,
    UnsupportedConstraint,
)

TILTED = Plane((0.2, -0.1, 1.0), 0.05)
CLOUD = np.random.default_rng(4).normal(size=(300, 3)) * (0.06, 0.05, 0.04)
STONE = Convex.hull(CLOUD / np.linalg.norm(CLOUD / (0.1, 0.08, 0.05), axis=1)[:, None])
SHAPES = {"cylinder": Cylinder(0.05, 0.1), "ellipsoid": Ellipsoid(0.1, 0.07, 0.05), "stone": STONE}


def of_coal(shape):
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, 2 * shape.half_length)
    if isinstance(shape, Ellipsoid):
        return coal.Ellipsoid(shape.x, shape.y, shape.z)
    corners = coal.StdVec_Vec3s()
    corners.extend(np.array(shape.vertices))
    return coal.Convex.convexHull(corners, True, "Qt")


def body_with(shape, friction=0.5, on=TILTED) -> cp.Scene:
    body = cp.model.free_box(mass=1.0, size=(0.2, 0.16, 0.1))
    return cp.Scene(body, contacts=[cp.FrictionalContact("box", shape, on=on, friction=friction)])


def turned(rng, height) -> np.ndarray:
    return pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(2 * rng.normal(size=3)), np.array([0.1, 0.2, height])))


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_the_gap_over_a_plane_is_the_distance(shape):
    scene, rng = body_with(shape), np.random.default_rng(1)
    solid, floor = of_coal(shape), coal.Halfspace(np.array(TILTED.normal), TILTED.height)
    for height in (-0.02, 0.05, 0.1, 0.5, 3.0):
        q = turned(rng, height)
        at = pin.XYZQUATToSE3(q)
        request, found = coal.DistanceRequest(), coal.DistanceResult()
        request.gjk_tolerance = request.epa_tolerance = 1e-12
        place = coal.Transform3s(at.rotation, at.translation)
        right = coal.distance(solid, place, floor, coal.Transform3s(), request, found)
        assert min(contact_gaps(scene, q).values()) == pytest.approx(right, abs=1e-10)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_the_rows_are_the_rates_of_the_gaps(shape):
    scene, rng, h = body_with(shape), np.random.default_rng(2), 1e-6
    model, data = scene.robot.model, scene.robot.model.createData()
    candidates = Candidates(model, scene.contact_bounds)

    def at(q):
        pin.computeJointJacobians(model, data, q)
        gaps, rows = candidates.evaluate(data, q)
        return gaps.copy(), rows[2::3]

    for height in (-0.02, 0.05, 0.15):
        q, v = turned(rng, height), rng.normal(size=6)
        (_, rows), (after, _), (before, _) = (
            at(pin.integrate(model, q, s * v)) for s in (0, h, -h)
        )
        is_there = np.isfinite(after) & np.isfinite(before)
        rates = (after[is_there] - before[is_there]) / (2 * h)
        assert len(rates)
        np.testing.assert_allclose((rows @ v)[is_there], rates, atol=1e-8)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_a_shape_that_tumbles_stays_above_the_ground_and_gains_no_energy(shape):
    scene, rng = body_with(shape, on=Plane()), np.random.default_rng(3)
    v = np.concatenate([np.zeros(3), rng.normal(size=3)])
    run = cp.simulate(scene, turned(rng, 0.2), v, duration=0.5, dt=1e-3)
    assert np.nanmin([*run.gaps.values()]) > -2.5e-5
    assert min(min(gap) for gap in run.gaps.values()) < 1e-6  # it has landed
    energy = run.energy.kinetic + run.energy.potential
    assert np.diff(energy).max() < 5e-5  # of 2 J


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_the_derivatives_of_a_step_are_its_differences(shape):
    scene, v, h = body_with(shape, on=Plane()), np.array([0.2, 0.1, -0.2, 0.3, 0.1, 0.2]), 1e-7
    model, q = scene.robot.model, turned(np.random.default_rng(5), 0.2)
    q[2] += 5e-5 - min(contact_gaps(scene, q).values())
    at = pin.XYZQUATToSE3(q)
    v[:3] = at.rotation.T @ v[:3]
    now = cp.step(scene, q, v, dt=1e-3)
    assert {*now.modes.values()} - {"open"}

    def after(e):
        return cp.step(scene, pin.integrate(model, q, e), v, dt=1e-3).v

    by_differences = np.array([(after(h * e) - after(-h * e)) / (2 * h) for e in np.eye(6)]).T
    error = np.abs(now.derivatives().dv_dq - by_differences).max()
    assert error < 1e-6 * np.abs(by_differences).max()


@pytest.mark.long
def test_a_cylinder_rolls_as_a_wheel_and_stands_as_a_tin():
    rolls, v = body_with(Cylinder(0.05, 0.1), on=Plane()), np.zeros(6)
    lying = pin.SE3(pin.rpy.rpyToMatrix(np.pi / 2, 0, 0), np.array([0, 0, 0.05]))
    v[0], v[5] = 0.5, -10.0  # its axis z lies along -y
    run = cp.simulate(rolls, pin.SE3ToXYZQUAT(lying), v, duration=0.3, dt=1e-3)
    np.testing.assert_allclose(run.q[-1, :3], [0.15, 0, 0.05], atol=1e-5)
    slope = body_with(Cylinder(0.05, 0.1), friction=1.0, on=Plane((0.3, 0.0, 1.0)))
    upright = pin.SE3(pin.rpy.rpyToMatrix(0, np.arctan(0.3), 0), np.zeros(3))
    upright.translation = upright.rotation[:, 2] * 0.1
    stands = cp.simulate(slope, pin.SE3ToXYZQUAT(upright), np.zeros(6), duration=0.2, dt=1e-3)
    assert np.abs(stands.v[-1]).max() < 1e-9  # tan = 0.3 < radius over half length, 0.5
    steep = body_with(Cylinder(0.05, 0.1), friction=1.0, on=Plane((0.6, 0.0, 1.0)))
    upright = pin.SE3(pin.rpy.rpyToMatrix(0, np.arctan(0.6), 0), np.zeros(3))
    upright.translation = upright.rotation[:, 2] * 0.1
    tips = cp.simulate(steep, pin.SE3ToXYZQUAT(upright), np.zeros(6), duration=0.2, dt=1e-3)
    assert np.abs(tips.v[-1, 4]) > 0.1


def test_round_shapes_touch_planes_alone():
    for fields in (
        {"shape": Cylinder(0.1, 0.1), "on_shape": Ball(0.1)},
        {"shape": Ball(0.1), "on_shape": Ellipsoid(0.1, 0.1, 0.1)},
    ):
        with pytest.raises(InvalidArgument, match="it touches planes alone; a Capsule, a Box"):
            cp.FrictionalContact("a", on="b", friction=0.5, **fields)
    for bad in (lambda: Cylinder(0.0, 1.0), lambda: Ellipsoid(1.0, 1.0, -1.0)):
        with pytest.raises(InvalidArgument, match="a positive"):
            bad()
    with pytest.raises(UnsupportedConstraint, match="touches in other points as it turns"):
        body_with(Cylinder(0.1, 0.1)).closed()


@pytest.mark.long
def test_the_hull_of_a_mesh_has_its_outer_corners():
    cube = np.array(np.meshgrid((0, 1), (0, 1), (0, 1))).reshape(3, -1).T
    hull = Convex.hull([*cube.tolist(), (0.5, 0.5, 0.5)])
    assert sorted(hull.vertices) == sorted(map(tuple, cube.astype(float).tolist()))
    for points in ([(0, 0, 0)], cube * (1, 1, 0)):
        with pytest.raises(InvalidArgument, match="a solid is needed"):
            Convex.hull(points)


# ---- shapes of files ----------------------------------------------------------

INERTIAL = """<inertial><mass value="2"/><inertia ixx=".02" iyy=".02" izz=".02" ixy="0" ixz="0"
iyz="0"/></inertial>"""


def urdf(folder, *shapes: str):
    """A body of collision shapes that floats."""
    collisions = "".join(f"<collision>{shape}</collision>" for shape in shapes)
    path = folder / "body.urdf"
    path.write_text(f'<robot name="body"><link name="base">{INERTIAL}{collisions}</link></robot>')
    return path


def geometry(shape: str, rpy: str = "0 0 0", xyz: str = "0 0 .1") -> str:
    return f'<origin xyz="{xyz}" rpy="{rpy}"/><geometry>{shape}</geometry>'


TETRAHEDRON = "solid t\n" + "".join(
    "facet normal 0 0 0\nouter loop\n"
    + "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners)
    + "endloop\nendfacet\n"
    for corners in (
        ((0, 0, 0), (0, 1, 0), (1, 0, 0)), ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
        ((0, 0, 0), (0, 0, 1), (0, 1, 0)), ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    )
) + "endsolid t\n"  # fmt: skip


@pytest.mark.parametrize(
    ("shape", "rpy", "kind", "height"),
    [
        ('<sphere radius=".07"/>', "0 0 0", Ball, 0.07),
        ('<box size=".2 .1 .06"/>', "0 0 0", Box, 0.03),
        ('<box size=".2 .1 .06"/>', "1.5707963267948966 0 0", Box, 0.05),
        ('<capsule radius=".04" length=".1"/>', "0 1.5707963267948966 0", Capsule, 0.04),
        ('<cylinder radius=".04" length=".1"/>', "0 0 0", Cylinder, 0.05),
        ('<cylinder radius=".04" length=".1"/>', "0 1.5707963267948966 0", Cylinder, 0.04),
        ('<mesh filename="t.stl" scale=".2 .2 .2"/>', "0 0 0", Convex, 0.0),
    ],
)
def test_a_file_s_shape_comes_to_rest_on_the_ground(tmp_path, shape, rpy, kind, height):
    (tmp_path / "t.stl").write_text(TETRAHEDRON)
    robot = cp.load_robot(urdf(tmp_path, geometry(shape, rpy)), floating=True)
    (contact,) = robot.collisions(0.6, ground=Plane(height=0.3))
    assert isinstance(contact.shape, kind)
    q = np.array([0, 0, 0.3 - 0.1 + height + 0.01, 0, 0, 0, 1.0])
    run = cp.simulate(cp.Scene(robot, contacts=[contact]), q, np.zeros(6), duration=0.15, dt=1e-3)
    gaps = [each[-1] for each in run.gaps.values() if np.isfinite(each[-1])]
    assert min(gaps) == pytest.approx(0.0, abs=1e-8)
    assert run.q[-1, 2] == pytest.approx(0.2 + height, abs=2e-3)  # a mesh is off its centre


@pytest.mark.long
def test_shapes_are_named_after_link_and_kind_and_chosen_by_either(tmp_path):
    ball = geometry('<sphere radius=".05"/>')
    robot = cp.load_robot(
        urdf(tmp_path, ball, geometry('<box size="1 1 1"/>'), ball), floating=True
    )
    found = robot.collisions(0.5)
    assert [each.name for each in found] == ["base sphere 1", "base box", "base sphere 2"]
    assert robot.collisions(0.5, shapes=["base box"]) == found[1:2]
    assert robot.collisions(0.5, shapes=["base"]) == found
    with pytest.raises(UnknownName, match=r"'base bax'.*base box"):
        robot.collisions(0.5, shapes=["base bax"])
    apart = replace(robot, exclusions=[("universe", "base")])
    assert apart.collisions(0.5) == ()


def test_shapes_that_cannot_touch_are_refused_by_name(tmp_path):
    lost = geometry('<mesh filename="package://none/lost.stl"/>')
    robot = cp.load_robot(urdf(tmp_path, lost, geometry('<sphere radius=".1"/>')), floating=True)
    with pytest.raises(InvalidModel, match=r"lost\.stl.*package_dirs="):
        robot.collisions(0.5)
    assert [each.name for each in robot.collisions(0.5, shapes=["base sphere"])] == ["base sphere"]
    with pytest.raises(InvalidModel, match="no file with collision shapes"):
        cp.model.free_box().collisions(0.5)
    flat = TETRAHEDRON.replace("0 0 1\n", "0.5 0.5 0\n")
    (tmp_path / "flat.stl").write_text(flat)
    robot = cp.load_robot(urdf(tmp_path, geometry('<mesh filename="flat.stl"/>')), floating=True)
    with pytest.raises(InvalidModel, match="'base mesh' cannot touch: vertices: they lie in a pla"):
        robot.collisions(0.5)


def test_feet_are_not_there_twice_without_a_word():
    solo = cp.load_robot("solo12")
    shapes = solo.collisions(0.7)
    assert {"FL_FOOT", "HR_FOOT", "base_link mesh"} <= {each.name for each in shapes}
    with pytest.raises(InvalidConstraint, match=r"'FL_FOOT'.*robot\.frictional_contacts\(\)"):
        cp.Scene(solo, contacts=[*solo.frictional_contacts(0.7), *shapes])


@pytest.mark.long
def test_a_sole_is_not_there_twice_either():
    talos = cp.load_robot("talos")
    corners = talos.frictional_contacts(0.7)
    on_sole = {each.name for each in corners} & {each.name for each in talos.collisions(0.7)}
    assert len(on_sole) == len(talos.contacts)  # one name of each foot in both


@pytest.mark.long
def test_shapes_stay_through_copies_and_files(tmp_path):
    go2 = cp.load_robot("go2")
    feet = go2.collisions(0.7, shapes=["FL_foot", "FR_foot", "RL_foot", "RR_foot"])
    assert len(feet[0].shape.vertices) == 329
    heavier = go2.with_masses({"FL_calf_joint": 0.3}).with_frame("mark", "base", (0, 0, 0.1))
    for other in (heavier, pickle.loads(pickle.dumps(go2))):
        assert other.collisions(0.7, shapes=["FL_foot"]) == feet[:1]
    scene = cp.Scene(go2, contacts=feet)
    assert pickle.loads(pickle.dumps(scene)) == scene
    run = cp.simulate(scene, *scene.state(), duration=2e-3, dt=1e-3)
    run.save(tmp_path / "run.npz")
    again = cp.Trajectory.load(tmp_path / "run.npz")
    assert again.scene == scene
    assert again.scene.robot.collisions(0.7, shapes=["FL_foot"]) == feet[:1]


@pytest.mark.parametrize(("name", "gains"), [("go2", (60.0, 2.0)), ("solo12", (5.0, 0.05))])
def test_a_quadruped_lands_on_its_own_shapes(name, gains):
    robot = cp.load_robot(name)
    scene = cp.Scene(robot, contacts=robot.collisions(0.7))
    stand, v = scene.state()
    q = stand.copy()
    q[2] += 0.01

    def held(t, q, v):
        return np.concatenate([np.zeros(6), gains[0] * (stand[7:] - q[7:]) - gains[1] * v[6:]])

    run = cp.simulate(scene, q, v, held, duration=0.15, dt=1e-3)
    assert min(each.min() for each in run.gaps.values()) > -2.5e-4
    assert run.q[-1, 2] > 0.8 * stand[2]
