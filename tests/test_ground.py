"""Shapes on grounds of boxes, stairs, fields and meshes; shapes of one robot on each other."""

from __future__ import annotations

import pickle

import coal
import numpy as np
import pinocchio as pin
import pytest

import condyn_pin as cp
from condyn_pin.constraints import (
    Ball,
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    Facets,
    FrictionalContact,
    Ground,
    Plane,
)
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics import contact_gaps
from condyn_pin.dynamics.compiled import why_not_contacts
from condyn_pin.errors import (
    InvalidArgument,
    InvalidModel,
    UnknownName,
    UnsupportedConstraint,
)
from condyn_pin.mechanism import place_on_ground

CLOUD = np.random.default_rng(0).normal(size=(60, 3))
SHAPES = {
    "ball": Ball(0.05),
    "capsule": Capsule(0.03, 0.1),
    "box": Box(0.1, 0.06, 0.04),
    "stone": Convex.hull(CLOUD / np.linalg.norm(CLOUD, axis=1)[:, None] * (0.1, 0.07, 0.05)),
    "cylinder": Cylinder(0.05, 0.1),
}
EDGES, HALF = (0.2, 0.12, 0.08), (0.1, 0.06, 0.04)
LEANING = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.2, 0.1), np.array([-0.3, 0.0, 0.0]))
WORLD = Ground.stairs(4, 0.12, 0.28, 1.0) + Ground.boxes([((0.1, 0.1, 0.1), LEANING)])


def on(ground: Ground, shape, friction: float = 0.5, mass: float = 1.0) -> cp.Scene:
    body = cp.model.free_box(mass=mass, size=EDGES)
    return cp.Scene(body, contacts=[FrictionalContact("box", shape, on=ground, friction=friction)])


def state(x, y, z, rpy=(0.0, 0.0, 0.0), v=(0.0, 0.0, 0.0), w=(0.0, 0.0, 0.0)):
    """A state of a body; its velocity v is in the world's axes."""
    R = pin.rpy.rpyToMatrix(*rpy)
    return pin.SE3ToXYZQUAT(pin.SE3(R, np.array([x, y, z]))), np.concatenate([R.T @ v, w])


def of_coal(shape):
    if isinstance(shape, Ball):
        return coal.Sphere(shape.radius)
    if isinstance(shape, Capsule):
        return coal.Capsule(shape.radius, 2 * shape.half_length)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, 2 * shape.half_length)
    if isinstance(shape, Box):
        return coal.Box(2 * shape.x, 2 * shape.y, 2 * shape.z)
    corners = coal.StdVec_Vec3s()
    corners.extend(np.array(shape.vertices))
    return coal.Convex.convexHull(corners, True, "Qt")


def distance(one, at, other) -> float:
    request = coal.DistanceRequest()
    request.gjk_tolerance = request.epa_tolerance = 1e-12
    here = coal.Transform3s(at.rotation, at.translation)
    return coal.distance(one, here, other, coal.Transform3s(), request, coal.DistanceResult())


def total(run: cp.Trajectory) -> np.ndarray:
    return run.energy.kinetic + run.energy.potential


def deepest(run: cp.Trajectory) -> float:
    return -min(gap.min() for gap in run.gaps.values())


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_gaps_are_distances_and_rows_their_rates(shape):
    scene, rng, h = on(WORLD, shape), np.random.default_rng(1), 1e-6
    model = scene.robot.model
    data, candidates = model.createData(), Candidates(model, scene.contact_bounds)
    parts = [of_coal(part) for part in WORLD.parts]
    solid, seen = of_coal(shape), 0

    def at(q):
        pin.computeJointJacobians(model, data, q)
        gaps, rows = candidates.evaluate(data, q)
        return gaps.copy(), rows[2::3].copy()

    for _ in range(80):
        place = pin.SE3(
            pin.exp3(2 * rng.normal(size=3)), rng.uniform((-0.5, -0.7, 0), (1.2, 0.7, 0.6))
        )
        right = min(distance(solid, place, part) for part in parts)
        if right < 0.0:
            continue
        q, v = pin.SE3ToXYZQUAT(place), rng.normal(size=6)
        assert min(contact_gaps(scene, q).values()) == pytest.approx(right, abs=1e-8)
        at(q)  # then 1 cm from what is nearest
        first = int(candidates.exact.gaps(data, q).argmin())
        q[:3] -= (right - 0.01) * candidates.exact.axes(data, q)[first, :, 2]
        (_, rows), (after, _), (before, _) = (
            at(pin.integrate(model, q, s * v)) for s in (0, h, -h)
        )
        there = np.isfinite(after) & np.isfinite(before)
        rates = (after[there] - before[there]) / (2 * h)
        np.testing.assert_allclose((rows @ v)[there], rates, atol=1e-7)
        seen += there.sum()
    assert seen > 5


FLOORS = {
    "boxes": Ground.boxes([((0.5, 1.0, 0.1), (0.5 * i, 0.0, -0.05)) for i in range(-1, 3)]),
    "bricks": Ground.boxes(
        [
            ((0.13, 0.11, 0.1), (0.13 * i, 0.11 * j, -0.05))
            for i in range(-4, 5)
            for j in range(-3, 4)
        ]
    ),
    "field": Ground.heightfield(np.zeros((41, 41)), (2.0, 2.0)),
}


@pytest.mark.parametrize("name", ["ball", "capsule", "box", "cylinder"])
@pytest.mark.parametrize("floor", FLOORS)
def test_nothing_catches_at_seams(floor, name):
    heights = {"ball": 0.05, "capsule": 0.03, "box": 0.04, "cylinder": 0.05}
    lies = (0.0, np.pi / 2, 0.3) if name in ("capsule", "cylinder") else (0.0, 0.0, 0.3)
    q, v = state(-0.1, 0.013, heights[name], lies, v=(1.0, 0.0, 0.0))
    run = cp.simulate(on(FLOORS[floor], SHAPES[name], friction=0.0), q, v, duration=0.2, dt=2e-3)
    speed = pin.XYZQUATToSE3(run.q[-1]).rotation @ run.v[-1, :3]
    np.testing.assert_allclose(speed, [1.0, 0.0, 0.0], atol=1e-6)
    assert np.abs(run.v[-1, 3:]).max() < 1e-6
    np.testing.assert_allclose(run.q[:, 2], heights[name], atol=1e-9)


def test_a_wall_on_its_floor_stops_a_box_which_still_stands_on_the_floor():
    room = Ground.boxes([((2.0, 2.0, 0.1), (0, 0, -0.05)), ((0.1, 2.0, 0.5), (0.35, 0, 0.25))])
    q, v = state(0.1, 0.0, 0.04, v=(1.0, 0.0, 0.0))
    run = cp.simulate(on(room, Box(*HALF), friction=0.0), q, v, duration=0.3, dt=1e-3)
    np.testing.assert_allclose(run.q[-1, :3], [0.2, 0.0, 0.04], atol=1e-6)
    assert deepest(run) < 1e-5


def test_a_box_on_a_step_tips_when_its_middle_is_beyond_the_edge():
    ledge = Ground.boxes([((1.0, 1.0, 0.2), (-0.5, 0.0, -0.1))])  # its edge is x = z = 0
    stands, falls = (
        cp.simulate(on(ledge, Box(*HALF)), *state(x, 0.0, 0.04), duration=0.2, dt=1e-3)
        for x in (-0.005, 0.005)
    )
    assert np.abs(stands.v[-1]).max() < 1e-9
    # about the edge with r^2 = 0.005^2 + 0.04^2 and I of the box: a = m g 0.005 / (I + m r^2)
    inertia = falls.scene.robot.model.inertias[1].inertia[1, 1]
    a = 9.81 * 0.005 / (inertia + 0.005**2 + 0.04**2)
    assert falls.v[10, 4] == pytest.approx(0.01 * a, rel=2e-2)


def test_a_plate_across_an_edge_is_held_at_both_ends_of_it():
    ledge = Ground.boxes([((0.2, 1.0, 0.2), (0.0, -0.5, -0.1))])  # its edge y = z = 0, 0.2 long
    scene, tilt = on(ledge, Box(0.08, 0.1, 0.005)), 1e-3
    model = scene.robot.model
    data, candidates = model.createData(), Candidates(model, scene.contact_bounds)
    R = pin.rpy.rpyToMatrix(-0.5, 0.0, 0.0) @ pin.rpy.rpyToMatrix(0.0, tilt, 0.0)
    pin.computeJointJacobians(model, data, pin.SE3ToXYZQUAT(pin.SE3(R, 0.00508 * R[:, 2])))
    gaps = np.sort(candidates.gaps(data, pin.neutral(model)))
    assert np.isfinite(gaps).sum() == 2
    assert gaps[1] - gaps[0] == pytest.approx(0.16 * tilt, rel=1e-3)
    assert 0.5 * (gaps[0] + gaps[1]) == pytest.approx(8e-5, rel=1e-2)


@pytest.mark.parametrize(
    ("along", "speed"),
    [((0.5, 0.0, 0.0), -10.0), ((0.5, 0.0, 0.0), -5.0)],
    ids=["bricks", "slower"],
)
def test_a_ball_rolls_over_seams_as_on_a_plane(along, speed):
    q, v = state(-0.3, 0.01, 0.05, v=along, w=(0.0, -speed, 0.0))
    over, flat = (
        cp.simulate(
            cp.Scene(
                cp.model.free_ball(mass=1.0, radius=0.05),
                contacts=[FrictionalContact("ball", Ball(0.05), on=each, friction=0.5)],
            ),
            q, v, duration=0.4, dt=2e-3,
        )
        for each in (FLOORS["bricks"], Plane())
    )  # fmt: skip
    np.testing.assert_allclose(over.q[:, :3], flat.q[:, :3], atol=1e-6)


@pytest.mark.parametrize("name", SHAPES)
def test_what_falls_on_stairs_stays_above_them_and_gains_nothing(name):
    stairs = Ground.stairs(6, 0.06, 0.25, 1.0)
    q, v = state(0.5, 0.02, 0.34, (0.3, 0.4, 0.5), v=(-0.5, 0, -1.0), w=(0, 2.0, 1.0))
    for dt, most in ((1e-3, 2.5e-4), (5e-4, 1e-4))[: 1 + (name == "box")]:
        run = cp.simulate(on(stairs, SHAPES[name]), q, v, duration=0.2, dt=dt)
        assert deepest(run) < most
        assert min(np.min(gap) for gap in run.gaps.values()) < 1e-6  # it has landed
        assert np.diff(total(run)).max() < 10.0 * dt**2  # of 5 J


def test_a_box_on_a_rough_field_is_not_in_it():
    z = 0.05 * np.random.default_rng(1).random((41, 41))
    q, v = state(0.01, 0.02, 0.2, (0.3, 0.4, 0.5), v=(0.3, 0.1, 0), w=(1.0, 2.0, 3.0))
    scene = on(Ground.heightfield(z, (2.0, 2.0)), Box(*HALF), friction=0.3)
    run = cp.simulate(scene, q, v, duration=0.35, dt=1e-3)
    assert deepest(run) < 2.5e-4
    assert np.diff(total(run)).max() < 1e-4


def test_it_comes_to_rest_where_mujoco_has_it():
    mujoco = pytest.importorskip("mujoco")
    edges, places = (0.25, 1.0, 0.06), [(0.25 * k, 0.0, 0.06 * k - 0.03) for k in range(3)]
    geoms = "".join(
        f'<geom type="box" size=".125 .5 .03" pos="{x} {y} {z}"/>' for x, y, z in places
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="1e-3" cone="elliptic"/><default><geom solref=".004 1" '
        f'friction="1 0 0"/></default><worldbody>{geoms}<body><freejoint/><geom type="box" '
        'size=".1 .06 .04" mass="1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    # flat on the lower step, and leaning against the edge of the upper one
    leaning = (0.0, -0.35, 0.0)
    for at, rpy in (((0.0, 0.0, 0.05), (0.0,) * 3), ((0.1, 0.0, 0.11), leaning)):
        q, v = state(*at, rpy)
        data.qpos[:3], data.qpos[3:] = q[:3], q[[6, 3, 4, 5]]
        data.qvel[:] = 0.0
        for _ in range(1200):
            mujoco.mj_step(model, data)
        ground = Ground.boxes([(edges, place) for place in places])
        run = cp.simulate(on(ground, Box(*HALF), friction=1.0), q, v, duration=0.6, dt=2e-3)
        assert np.abs(run.v[-1]).max() < 1e-6
        np.testing.assert_allclose(run.q[-1, :3], data.qpos[:3], atol=2e-3)
        turned = pin.XYZQUATToSE3(run.q[-1]).rotation[:, 2]
        theirs = np.zeros(9)
        mujoco.mju_quat2Mat(theirs, data.qpos[3:])
        np.testing.assert_allclose(turned, theirs.reshape(3, 3)[:, 2], atol=2e-2)


def test_a_mesh_is_the_boxes_that_it_is_made_of(tmp_path):
    corners = np.array(np.meshgrid((-0.5, 0.5), (-0.5, 0.5), (-0.1, 0.0))).reshape(3, -1).T
    faces = [
        (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2),
        (1, 3, 7), (1, 7, 5), (0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6),
    ]  # fmt: skip
    box = Ground.boxes([((1.0, 1.0, 0.1), (0.0, 0.0, -0.05))])
    text = "solid t\n" + "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*(2.0 * corners[i])) for i in face)
        + "endloop\nendfacet\n"
        for face in faces
    )
    (tmp_path / "box.stl").write_text(text + "endsolid t\n")
    read = Ground.mesh(tmp_path / "box.stl", scale=0.5)
    rng = np.random.default_rng(3)
    for ground in (Ground.mesh((corners, faces)), read):
        for _ in range(20):
            place = pin.SE3(
                pin.exp3(rng.normal(size=3)), rng.uniform((-0.7, -0.7, 0.05), (0.7, 0.7, 0.3))
            )
            q = pin.SE3ToXYZQUAT(place)
            one, other = (min(contact_gaps(on(g, Box(*HALF)), q).values()) for g in (ground, box))
            if other > 0.0:
                assert one == pytest.approx(other, abs=1e-9)
    turned = Ground.mesh((corners, np.array(faces)[:, ::-1]))  # inside out
    assert turned.parts[0].surface.normals[0] == pytest.approx(read.parts[0].surface.normals[0])


def test_robots_are_put_down_on_a_ground_along_gravity():
    solo = cp.load_robot("solo12")
    stairs = Ground.stairs(4, 0.05, 0.2, 1.0, at=(-0.3, 0.0, 0.0)) + Ground.plane()
    scene = cp.Scene(solo, contacts=solo.collisions(0.7, ground=stairs))
    for start in ((0.1, 0.02, -0.5), (0.1, 0.02, 3.0)):  # from inside, and from far above
        q = scene.state()[0]
        q[:3] = start
        placed = place_on_ground(scene, q)
        np.testing.assert_array_equal(placed[[0, 1, *range(3, 19)]], q[[0, 1, *range(3, 19)]])
        assert min(contact_gaps(scene, placed).values()) == pytest.approx(0.0, abs=1e-9)
    q[:3] = (50.0, 0.0, 0.3)
    alone = cp.Scene(solo, contacts=solo.collisions(0.7, ground=Ground.stairs(4, 0.05, 0.2, 1.0)))
    np.testing.assert_array_equal(place_on_ground(alone, q), q)  # nothing is below


def test_go2_lands_on_stairs():
    go2 = cp.load_robot("go2")
    stairs = Ground.stairs(8, 0.06, 0.3, 3.0, at=(-1.2, 0.0, 0.0))
    scene = cp.Scene(go2, contacts=go2.collisions(0.7, ground=stairs))
    stand, v = scene.state()
    q = stand.copy()
    q[2] += 0.005

    def motors(t, q, v):
        return np.append(np.zeros(6), 100.0 * (stand[7:] - q[7:]) - 3.0 * v[6:])

    run = cp.simulate(scene, q, v, motors, duration=0.06, dt=1e-3)
    assert deepest(run) < 2.5e-4
    assert run.q[-1, 2] > stand[2] - 0.1
    loaded = {name.split("/")[0] for name, gap in run.gaps.items() if gap[-1] < 1e-5}
    assert len(loaded) >= 2


def test_bodies_that_pass_through_a_ground_are_named_with_the_cure():
    solo = cp.load_robot("solo12")
    steps = Ground.stairs(4, 0.05, 0.4, 1.0, at=(-0.4, 0.0, 0.0)) + Ground.plane(height=-0.5)
    feet = ["FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"]
    scene = cp.Scene(solo, contacts=solo.collisions(0.7, ground=steps, shapes=feet))
    run = cp.simulate(scene, *scene.state(), duration=0.35, dt=5e-3)
    said = [each for each in run.notices if "is in the ground of the scene" in each]
    assert said, run.notices
    assert "robot.collisions(friction=0.7, ground=..., shapes=[" in said[0]


@pytest.mark.parametrize("name", ["ball", "capsule", "box", "stone"])
def test_derivatives_of_a_step_on_an_edge_are_its_differences(name):
    ledge, h = Ground.boxes([((1.0, 1.0, 0.2), (-0.5, 0.0, -0.1))]), 1e-7
    scene, rng = on(ledge, SHAPES[name]), np.random.default_rng(4)
    model, done = scene.robot.model, 0
    for _ in range(6):
        rpy = 0.4 * rng.normal(size=3)
        q, v = state(0.01, 0.02, 0.2, rpy, v=(0.1, 0.05, -0.3), w=0.3 * rng.normal(size=3))
        q = place_on_ground(scene, q)
        q[2] += 5e-5
        now = cp.step(scene, q, v, dt=1e-3)
        if not {*now.modes.values()} - {"open"}:
            continue

        def after(e, q=q, v=v):
            return cp.step(scene, pin.integrate(model, q, e), v, dt=1e-3).v

        right = np.array([(after(h * e) - after(-h * e)) / (2 * h) for e in np.eye(6)]).T
        error = np.abs(now.derivatives().dv_dq - right).max()
        assert error < 1e-5 * np.abs(right).max()
        done += 1
    assert done >= 3


def test_sharp_corners_on_sharp_edges_have_no_derivatives():
    ledge = Ground.boxes([((1.0, 1.0, 0.2), (-0.5, 0.0, -0.1))])
    tip = Convex(((0, 0, 0), (0.05, 0.05, 0.1), (-0.05, 0.05, 0.1), (0.0, -0.05, 0.1)))
    q, v = state(3e-8, 0.0, 3e-8, v=(-0.1, 0.0, -0.1))
    with pytest.raises(UnsupportedConstraint, match=r"box: a sharp corner is .* Ball or a Capsule"):
        cp.step(on(ledge, tip), q, v, dt=1e-3).derivatives()


def test_what_is_no_ground_is_refused():
    corners, size = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], (1.0, 1.0)
    for wrong, make in (
        ("a list of parts", lambda: Ground("stairs.stl")),
        ("none; Ground.plane", lambda: Ground(())),
        ("no Plane and no Facets", lambda: Ground((Box(1, 1, 1),))),
        ("a positive edge", lambda: Ground.boxes([((1.0, 0.0, 1.0), (0, 0, 0))])),
        ("1 or more are needed", lambda: Ground.stairs(0, 0.1, 0.2, 1.0)),
        ("each 2 or more", lambda: Ground.heightfield([1.0, 2.0], size)),
        ("z", lambda: Ground.heightfield([[0.0, np.nan], [0.0, 0.0]], size)),
        (r"faces\[1\] has no area", lambda: Facets(corners, [(0, 1, 2), (0, 1, 1)])),
        (r"faces\[0\]: three or four", lambda: Facets(corners, [(0, 1, 9)])),
        (
            "faces 0 and 1 and 2 share one edge",
            lambda: Facets(corners, [(0, 1, 2), (1, 0, 3), (0, 1, 4)]),
        ),
        ("faces 0 and 1 lie side by side", lambda: Facets(corners, [(0, 1, 2), (0, 1, 3)])),
    ):
        with pytest.raises(InvalidArgument, match=wrong):
            make()
    for fields, wrong in (
        ({"shape": Ellipsoid(1, 1, 1)}, "it touches planes alone"),
        ({"shape": Ball(1), "on_shape": Box(1, 1, 1)}, "it is the shape of a second body"),
    ):
        with pytest.raises(InvalidArgument, match=wrong):
            FrictionalContact("box", on=Ground.plane(), friction=0.5, **fields)
    with pytest.raises(UnsupportedConstraint, match="touches in other points as it"):
        on(WORLD, Ball(0.1)).closed()


def test_the_compiled_core_refuses_grounds_and_fine_pairs_by_name():
    assert [*why_not_contacts(on(WORLD, Ball(0.1)))] == ["box: shapes on a Ground"]
    go2 = cp.load_robot("go2")
    pairs = go2.self_collisions(0.3, shapes=["FL_foot", "FR_foot"])
    (why,) = why_not_contacts(cp.Scene(go2, contacts=pairs))
    assert why.startswith("FL_foot - FR_foot: shapes of many edges")


def test_grounds_are_values(tmp_path):
    z = np.random.default_rng(0).random((4, 5))
    ground = WORLD + Ground.heightfield(z, (1.0, 2.0)) + Ground.plane(height=-0.3)
    again = pickle.loads(pickle.dumps(ground))
    assert again == ground
    assert hash(again) == hash(ground)
    assert ground != WORLD
    assert repr(ground) == "Ground(7 parts: 1 planes, 54 faces)"
    scene = on(ground, Ball(0.05))
    assert pickle.loads(pickle.dumps(scene)) == scene
    run = cp.simulate(scene, *state(0.0, 0.0, 2.0), duration=2e-3, dt=1e-3)
    run.save(tmp_path / "run.npz")
    assert cp.Trajectory.load(tmp_path / "run.npz").scene == scene


# ---- shapes of one robot on each other ---------------------------------------


def test_pairs_of_shapes_leave_out_neighbours_and_exclusions():
    go2 = cp.load_robot("go2")
    pairs = go2.self_collisions(0.3)
    names = {contact.name for contact in pairs}
    assert "base mesh - FL_foot" in names
    assert not any("FL_thigh mesh - FL_calf" in name for name in names)  # neighbours
    for one, other in map(tuple, go2.exclusions):
        assert not any(
            {one, other} == {*(part.split(" mesh")[0] for part in name.split(" - "))}
            for name in names
        )
    fewer = go2.self_collisions(
        0.3, shapes=["base", "FL_foot", "FR_foot"], without=[("base", "FL_foot")]
    )
    assert [each.name for each in fewer] == ["base mesh - FR_foot", "FL_foot - FR_foot"]
    with pytest.raises(UnknownName, match="'bass'"):
        go2.self_collisions(0.3, without=[("bass", "FL_foot")])


def test_shapes_that_overlap_from_the_start_are_named_with_the_cure():
    solo = cp.load_robot("solo12")
    with pytest.raises(
        InvalidModel, match=r"without=\[\('base_link mesh', 'FL_UPPER_LEG"
    ) as raised:
        solo.self_collisions(0.3)
    cure = eval(str(raised.value).split("without=")[1].split(" leaves")[0])
    assert len(solo.self_collisions(0.3, without=cure)) > 50


def test_legs_stop_at_the_trunk():
    go2 = cp.load_robot("go2")
    calves = [f"{leg}_calf" for leg in ("FL", "FR", "RL", "RR")]
    scene = cp.Scene(go2, contacts=go2.self_collisions(0.3, shapes=["base", *calves]))
    q, v = scene.state()
    hips = np.repeat([-8.0, 8.0, -8.0, 8.0], 3) * np.tile([1.0, 0.0, 0.0], 4)
    run = cp.simulate(scene, q, v, np.append(np.zeros(6), hips), duration=0.1, dt=1e-3)
    assert -2.5e-4 < -deepest(run) < 1e-6  # they have met


def test_fine_shapes_meet_as_coal_has_them():
    rng = np.random.default_rng(5)
    cloud = rng.normal(size=(300, 3))
    stone = Convex.hull(cloud / np.linalg.norm(cloud, axis=1)[:, None] * (0.1, 0.08, 0.05))
    bodies = cp.model.together({"a": cp.model.free_box(), "b": cp.model.free_box()})
    pair = FrictionalContact("a/box", stone, on="b/box", on_shape=stone, friction=0.5)
    scene, solid = cp.Scene(bodies, contacts=[pair]), of_coal(stone)
    for _ in range(20):
        place = pin.SE3(pin.exp3(2 * rng.normal(size=3)), 0.07 * rng.normal(size=3))
        q = np.concatenate([pin.SE3ToXYZQUAT(place), pin.SE3ToXYZQUAT(pin.SE3.Identity())])
        right = distance(solid, place, solid)
        if abs(right) < 0.05:
            assert min(contact_gaps(scene, q).values()) == pytest.approx(right, abs=1e-6)
