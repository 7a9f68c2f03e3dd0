"""Bodies on bodies: gaps, points and rows of balls, capsules and boxes near each other."""

from __future__ import annotations

import json
import pickle
from itertools import product

import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box, Capsule, Convex, FrictionalContact, Plane, Point
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics import contact_gaps
from condyn_pin.errors import InvalidArgument, UnsupportedConstraint
from condyn_pin.simulation.files import decode, encode

SHAPES = {
    "point": Point(),
    "ball": Ball(0.1),
    "capsule": Capsule(0.05, 0.3),
    "box": Box(0.2, 0.15, 0.1),
    "plank": Box(0.5, 0.08, 0.05),
}
COMBINATIONS = [pair for pair in product(SHAPES, repeat=2) if pair != ("point", "point")]


def two_bodies() -> cp.Robot:
    return cp.model.together({"upper": cp.model.free_box(), "lower": cp.model.free_box()})


BODIES = two_bodies()


def scene_of(upper, lower, **fields) -> cp.Scene:
    contact = FrictionalContact(
        "upper/box", upper, on="lower/box", on_shape=lower, friction=0.5, name="pair", **fields
    )
    return cp.Scene(BODIES, contacts=[contact])


class At:
    """The candidates of a scene at a configuration."""

    def __init__(self, scene: cp.Scene, q: np.ndarray) -> None:
        model = scene.robot.model
        self.data, self.q = model.createData(), q
        pin.computeJointJacobians(model, self.data, q)
        self.candidates = Candidates(model, scene.contact_bounds)
        self.gaps = self.candidates.gaps(self.data, q)
        self.points = self.candidates.points(self.data, q)
        self.axes = self.candidates.axes(self.data, q)

    def rows(self) -> np.ndarray:
        return self.candidates.evaluate(self.data, self.q)[1]


def placed(upper: pin.SE3, lower: pin.SE3 | None = None) -> np.ndarray:
    lower = pin.SE3.Identity() if lower is None else lower
    return np.concatenate([pin.SE3ToXYZQUAT(upper), pin.SE3ToXYZQUAT(lower)])


def above(z: float, rpy=(0.0, 0.0, 0.0), x: float = 0.0, y: float = 0.0) -> pin.SE3:
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array([x, y, z]))


def near(one, two, rng, gap: float) -> np.ndarray:
    """Return a random placement of two shapes, moved until their distance is about `gap`."""
    upper, lower = pin.SE3.Random(), pin.SE3.Identity()
    upper.rotation = pin.exp3(2 * rng.normal(size=3))
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    candidates = Candidates(BODIES.model, scene_of(one, two).contact_bounds)
    data = BODIES.model.createData()
    inside, outside = 0.0, 1.5
    for _ in range(24):  # to 1e-7 m
        upper.translation = (inside + outside) / 2 * direction
        q = placed(upper, lower)
        pin.forwardKinematics(BODIES.model, data, q)
        if candidates.gaps(data, q).min() > gap:
            outside = (inside + outside) / 2
        else:
            inside = (inside + outside) / 2
    return placed(upper, lower)


@pytest.mark.parametrize(("one", "two"), COMBINATIONS)
def test_rows_are_the_rates_of_the_gaps(one, two):
    scene, model = scene_of(SHAPES[one], SHAPES[two]), BODIES.model
    rng = np.random.default_rng(COMBINATIONS.index((one, two)))
    compared = 0
    for gap in (5e-3, 0.05, -0.01, -0.06):
        q, v = near(SHAPES[one], SHAPES[two], rng, gap), rng.normal(size=model.nv)
        here, h = At(scene, q), 1e-6
        if here.gaps.min() != pytest.approx(gap, abs=1e-6):
            continue  # nothing gets that deep into a point
        after, before = (At(scene, pin.integrate(model, q, s * v)) for s in (h, -h))
        there = np.isfinite(here.gaps) & np.isfinite(after.gaps) & np.isfinite(before.gaps)
        rate = (after.gaps[there] - before.gaps[there]) / (2 * h)
        np.testing.assert_allclose((here.rows()[2::3] @ v)[there], rate, atol=1e-7)
        compared += np.count_nonzero(there)
    assert compared >= 2


@pytest.mark.parametrize(("one", "two"), COMBINATIONS[::3])
def test_rows_are_the_slip_of_the_material_points(one, two):
    scene, rng = scene_of(SHAPES[one], SHAPES[two]), np.random.default_rng(12)
    q, v = near(SHAPES[one], SHAPES[two], rng, 2e-3), rng.normal(size=12)
    at = At(scene, q)
    for p, E, found in zip(at.points, at.axes, (at.rows() @ v).reshape(-1, 3), strict=True):
        of_body = [
            at.data.oMi[i].rotation @ v[k : k + 3]
            + np.cross(at.data.oMi[i].rotation @ v[k + 3 : k + 6], p - at.data.oMi[i].translation)
            for i, k in ((1, 0), (2, 6))
        ]
        np.testing.assert_allclose(found, E.T @ (of_body[0] - of_body[1]), atol=1e-13)


@pytest.mark.parametrize(("one", "two"), COMBINATIONS)
def test_the_least_gap_is_the_distance(one, two):
    rng = np.random.default_rng(COMBINATIONS.index((one, two)))
    scene = scene_of(SHAPES[one], SHAPES[two])
    for gap in (2e-2, 4e-3):
        q = near(SHAPES[one], SHAPES[two], rng, gap)
        least, exact = At(scene, q).gaps.min(), distance(SHAPES[one], SHAPES[two], q)
        assert least == pytest.approx(exact, abs=1e-5)  # coal's own tolerance


def distance(one, two, q: np.ndarray) -> float:
    """Return what coal says."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    at = [pin.XYZQUATToSE3(x) for x in (q[:7], q[7:])]
    placements = [coal.Transform3s(x.rotation, x.translation) for x in at]
    first, second = solid(one), solid(two)
    return coal.distance(first, placements[0], second, placements[1], request, result)


def solid(shape):
    if isinstance(shape, Box):
        return coal.Box(2 * shape.x, 2 * shape.y, 2 * shape.z)
    if isinstance(shape, Capsule):
        return coal.Capsule(shape.radius, 2 * shape.half_length)
    return coal.Sphere(shape.radius if isinstance(shape, Ball) else 0.0)


@pytest.mark.long
def test_two_balls_meet_between_their_middles():
    at = At(scene_of(Ball(0.1), Ball(0.2)), placed(above(0.31)))
    np.testing.assert_allclose(at.gaps, [0.01], atol=1e-15)
    np.testing.assert_allclose(at.points, [[0, 0, 0.21]], atol=1e-15)
    np.testing.assert_array_equal(at.axes, [np.eye(3)])
    deep = At(scene_of(Ball(0.1), Ball(0.2)), placed(above(0.0)))
    np.testing.assert_allclose(deep.gaps, [-0.3])  # one in the middle of the other: no NaN
    assert np.isfinite(deep.rows()).all()


@pytest.mark.long
@pytest.mark.parametrize("tilt", [0.0, 5e-3, -0.02])
def test_each_corner_of_a_box_on_a_box_has_its_own_gap(tilt):
    on = Box(0.5, 0.5, 0.1)
    R = pin.rpy.rpyToMatrix(0.0, tilt, 0.3)
    at = At(scene_of(Box(0.1, 0.06, 0.02), on), placed(above(0.13, (0.0, tilt, 0.3))))
    below = np.array([0.1, 0.06, 0.02]) * np.array([*product((1, -1), (1, -1), (-1,))])
    heights = (R @ below.T)[2] + 0.03
    found = np.sort(at.gaps[np.isfinite(at.gaps)])
    np.testing.assert_allclose(found, np.sort(heights), atol=1e-14)
    assert at.candidates.names[:2] == ("pair/point 1", "pair/point 2")


@pytest.mark.long
def test_boxes_of_one_size_stand_on_four_corners():
    box = Box(0.1, 0.1, 0.1)
    for turn in (0.0, np.pi / 2):
        at = At(scene_of(box, box), placed(above(0.2, (0.0, 0.0, turn))))
        there = np.isfinite(at.gaps)
        np.testing.assert_allclose(at.gaps[there], 0.0, atol=1e-15)
        assert np.count_nonzero(there) == 4
        np.testing.assert_allclose(np.abs(at.points[there]), 0.1, atol=1e-15)


@pytest.mark.long
def test_squares_across_each_other_meet_in_an_octagon():
    box = Box(0.1, 0.1, 0.1)
    at = At(scene_of(box, box), placed(above(0.201, (0.0, 0.0, np.pi / 4))))
    np.testing.assert_allclose(at.gaps, 1e-3, atol=1e-14)
    radii = np.hypot(*at.points[:, :2].T)
    np.testing.assert_allclose(radii, 0.1 / np.cos(np.pi / 8), atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (1e-4, 0.0), (1e-4, 2e-4)])
def test_planks_across_each_other_meet_where_their_edges_cross(tilt):
    plank = Box(0.5, 0.08, 0.05)
    at = At(scene_of(plank, plank), placed(above(0.1, (*tilt, np.pi / 2))))
    there = np.isfinite(at.gaps)
    assert np.count_nonzero(there) == 4
    np.testing.assert_allclose(np.abs(at.points[there][:, :2]), 0.08, atol=1e-4)
    np.testing.assert_allclose(at.gaps[there], 0.0, atol=1e-4)


def test_a_box_on_its_edge_stands_on_two_corners_and_edge_on_edge_on_one():
    box = Box(0.1, 0.1, 0.1)
    up = 0.1 + 0.1 * np.sqrt(2)
    on_edge = At(scene_of(box, Box(1.0, 1.0, 0.1)), placed(above(up + 1e-3, (np.pi / 4, 0, 0))))
    low = on_edge.gaps < 0.01
    assert np.count_nonzero(low) == 2
    np.testing.assert_allclose(on_edge.gaps[low], 1e-3, atol=1e-14)
    lower = above(0.0, (0.0, np.pi / 4, 0.0))
    crossed = At(
        scene_of(box, box), placed(above(0.2 * np.sqrt(2) - 1e-3, (np.pi / 4, 0, 0)), lower)
    )
    first = int(crossed.gaps.argmin())
    assert crossed.gaps[first] == pytest.approx(-1e-3, abs=1e-13)
    np.testing.assert_allclose(crossed.axes[first][:, 2], [0, 0, 1], atol=1e-12)


def test_a_capsule_lies_on_its_ends_or_across_an_edge():
    lying = (0.0, np.pi / 2, 0.0)
    flat = At(scene_of(Capsule(0.05, 0.3), Box(1, 1, 0.1)), placed(above(0.152, lying)))
    np.testing.assert_allclose(np.sort(flat.gaps)[:2], 2e-3, atol=1e-14)
    assert np.count_nonzero(flat.gaps < 0.01) == 2
    bridge = At(scene_of(Capsule(0.05, 0.3), Box(0.1, 1, 0.1)), placed(above(0.152, lying)))
    low = bridge.gaps < 0.01
    assert np.count_nonzero(low) == 2
    np.testing.assert_allclose(np.abs(bridge.points[low][:, 0]), 0.1, atol=1e-12)
    cross = At(
        scene_of(Capsule(0.05, 0.3), Capsule(0.02, 0.3)),
        placed(above(0.08, lying), above(0.0, (np.pi / 2, 0, 0))),
    )
    assert np.sort(cross.gaps)[0] == pytest.approx(0.01, abs=1e-14)


@pytest.mark.long
def test_an_obstacle_of_the_world_and_a_moving_floor():
    ball = cp.model.free_ball(radius=0.05)
    step = FrictionalContact("ball", Ball(0.05), on="world", on_shape=Box(1, 1, 0.2), friction=1)
    scene = cp.Scene(ball, contacts=[step])
    at = At(scene, np.array([0, 0, 0.26, 0, 0, 0, 1.0]))
    np.testing.assert_allclose(at.gaps, [0.01], atol=1e-15)
    floor = At(scene_of(Box(0.1, 0.1, 0.1), Plane(height=0.05)), placed(above(0.2)))
    np.testing.assert_allclose(np.sort(floor.gaps)[:4], 0.05, atol=1e-15)
    far = At(scene, np.array([0, 0, 50.0, 0, 0, 0, 1.0]))
    assert 40 < far.gaps[0] <= 49.75


@pytest.mark.long
def test_the_same_place_gives_the_same_points():
    scene = scene_of(SHAPES["box"], SHAPES["plank"])
    rng = np.random.default_rng(7)
    one, other = (near(SHAPES["box"], SHAPES["plank"], rng, 1e-3) for _ in range(2))
    fresh, used = At(scene, one), At(scene, other)
    pin.computeJointJacobians(BODIES.model, used.data, one)
    np.testing.assert_array_equal(used.candidates.gaps(used.data, one), fresh.gaps)
    np.testing.assert_array_equal(used.candidates.points(used.data, one), fresh.points)


def test_pairs_are_held_by_no_constraint():
    scene = scene_of(Ball(0.1), Ball(0.1))
    with pytest.raises(UnsupportedConstraint, match="pair is between two bodies"):
        scene.closed()
    with pytest.raises(UnsupportedConstraint, match="pair is between two bodies"):
        scene.closed({"pair": "stick"})
    assert scene.closed({"pair": "open"}).constraints == ()


@pytest.mark.parametrize("mesh", [coal.Box(1, 1, 1), "box", None, 0.1])
def test_other_shapes_are_refused(mesh):
    with pytest.raises(InvalidArgument, match="points never meet"):
        scene_of(Point(), Point())
    with pytest.raises(InvalidArgument, match="on_shape"):
        scene_of(Ball(0.1), mesh)


# ---- depth and distance -------------------------------------------------------


def least_shift(one, two, q: np.ndarray) -> float:
    """Return the signed distance of two solids: the faces of the set of differences of corners."""
    clouds = []
    for shape, at in zip((one, two), (q[:7], q[7:]), strict=True):
        corners = np.array([point.middle for point in shape.contact_points])
        clouds.append([pin.XYZQUATToSE3(at).act(corner) for corner in corners])
    upper, lower = map(np.array, clouds)
    differences = (upper[:, None] - lower).reshape(-1, 3)
    return ConvexHull(differences).equations[:, 3].max()


@pytest.mark.values
@pytest.mark.parametrize("turn", [2.0, 0.1, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("names", [("box", "box"), ("box", "prism"), ("plank", "prism")])
def test_the_depth_is_the_least_shift_that_takes_them_apart(names, turn):
    shapes = SHAPES | {"prism": Convex(PRISM)}
    one, two = (shapes[name] for name in names)
    scene, rng = scene_of(one, two), np.random.default_rng(3)
    compared = 0
    for _ in range(20):
        turned = pin.exp3(turn * rng.normal(size=3))
        q = placed(pin.SE3(turned, 0.1 * rng.normal(size=3)))
        right = least_shift(one, two, q)
        if right < -1e-3:
            assert min(contact_gaps(scene, q).values()) == pytest.approx(right, abs=1e-12)
            assert At(scene, q).gaps.min() == pytest.approx(right, abs=1e-12)
            compared += 1
    assert compared >= 5


CUBE = Box(0.2, 0.2, 0.2)


def test_edges_that_are_nearly_parallel_keep_their_distance():
    turned = pin.rpy.rpyToMatrix(0.0, 0.0, 5e-4)
    on_edge = pin.rpy.rpyToMatrix(np.pi / 4, 0.0, 0.0)
    high = 0.4 * np.sqrt(2)
    for gap in (1e-3, -1e-5):  # two cubes, edge over edge, crossing in the middle
        upper = pin.SE3(turned @ on_edge, np.array([0.0, 0.0, high + gap]))
        at = At(scene_of(CUBE, CUBE), placed(upper, pin.SE3(on_edge, np.zeros(3))))
        assert at.gaps.min() == pytest.approx(gap, abs=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("off", [0.3, 3.0, 300.0])
def test_a_gap_is_a_distance_also_far_away(off):
    """Of a ball, of a capsule and of a box from a box along its axes."""
    rng, half = np.random.default_rng(4), np.array([0.05, 0.08, 0.12])
    box = Box(*half)
    for _ in range(5):
        away = rng.normal(size=3)
        away *= off / np.linalg.norm(away)
        q = placed(pin.SE3(np.eye(3), away))
        beyond = np.maximum(np.abs(away) - half, 0.0)
        along = np.maximum(np.abs(away) - half - (0.0, 0.0, 0.1), 0.0)
        both = np.maximum(np.abs(away) - 2 * half, 0.0)
        for shape, distance in ((Ball(0.04), beyond), (Capsule(0.04, 0.1), along), (box, both)):
            right = np.linalg.norm(distance) - (0.0 if shape is box else 0.04)
            scene = scene_of(shape, box)
            if right > 0.0:
                assert min(contact_gaps(scene, q).values()) == pytest.approx(right, abs=1e-9)
                assert At(scene, q).gaps.min() <= right + 1e-12  # a step does with a bound


@pytest.mark.long
def test_a_motion_and_its_events_know_the_distance_of_what_is_far():
    scene, half = scene_of(Ball(0.04), Box(0.1, 0.1, 0.1)), 0.1
    q, v = placed(above(2.0)), np.zeros(12)
    v[2] = v[8] = 1.0
    v[2] -= 1.0
    seen = []
    run = cp.simulate(
        scene, q, v, duration=0.05, dt=0.01, integrator=cp.StewartTrinkle(),
        events=[cp.Event(when=lambda at: seen.append(at.gaps["pair"]) or 1.0, name="near")],
    )  # fmt: skip
    right = run.q[:, 2] - run.q[:, 9] - half - 0.04
    np.testing.assert_allclose(run.gaps["pair"], right, atol=1e-9)
    assert seen
    assert seen[0] == pytest.approx(right[0], abs=1e-9)
    after = cp.step(scene, q, v, dt=0.01)
    assert after.gaps["pair"] == pytest.approx(after.q[2] - after.q[9] - half - 0.04, abs=1e-9)


# ---- pieces side by side ------------------------------------------------------


def floor_of_two(body: cp.Robot, shape, friction: float, higher: float = 0.0) -> cp.Scene:
    """Return a body over two boxes of the world that share a face at x = 0.25 m."""
    robot = body.with_frame("left", "universe", (0.0, 0.0, -0.05))
    robot = robot.with_frame("right", "universe", (0.5, 0.0, higher - 0.05))
    frame = body.model.frames[-1].name
    contacts = [
        FrictionalContact(
            frame, shape, on=side, on_shape=Box(0.25, 0.5, 0.05), friction=friction, name=side
        )
        for side in ("left", "right")
    ]
    return cp.Scene(robot, contacts=contacts)


@pytest.mark.parametrize(("higher", "off"), [(0.0, 1e-8), (1e-5, 2e-4), (-1e-5, 2e-4)])
def test_a_box_slides_over_the_seam_of_two_flush_boxes(higher, off):
    box = cp.model.free_box(size=(0.2, 0.12, 0.08))
    scene, turn = floor_of_two(box, Box(0.1, 0.06, 0.04), 0.0, higher), above(0, (0, 0, 0.3))
    turn.translation = np.array([0.05, 0.013, 0.04])
    v = np.zeros(6)
    v[:3] = turn.rotation.T @ [1.0, 0.0, 0.0]
    run = cp.simulate(scene, pin.SE3ToXYZQUAT(turn), v, duration=0.4, dt=2e-3)
    assert run.q[-1, 0] > 0.4
    assert np.linalg.norm(run.v[-1, :3]) == pytest.approx(1.0, abs=off)
    assert np.abs(run.v[-1, 3:]).max() < 10 * off
    assert np.abs(run.q[:, 2] - 0.04).max() < 1.1 * abs(higher) + 1e-8


def test_a_ball_rolls_over_the_seam_of_two_flush_boxes():
    ball = cp.model.free_ball(mass=1.0, radius=0.05)
    scene = floor_of_two(ball, Ball(0.05), 0.5)
    q, v = np.array([0.2, 0.01, 0.05, 0, 0, 0, 1.0]), np.array([1.0, 0, 0, 0, 20.0, 0])
    run = cp.simulate(scene, q, v, duration=0.1, dt=1e-3)
    np.testing.assert_allclose(run.q[-1, :3], [0.3, 0.01, 0.05], atol=1e-12)
    there = pin.Quaternion(run.q[-1, 3:]).matrix()
    np.testing.assert_allclose(there @ run.v[-1, :3], v[:3], atol=1e-12)
    np.testing.assert_allclose(run.v[-1, 3:], v[3:], atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("high", [0.03, 0.09])
def test_a_box_in_the_corner_of_a_stair_touches_tread_and_riser(high):
    """The riser goes on above the tread: nothing of it is hidden, on top of the box or below."""
    box = cp.model.free_box(size=(0.2, 0.12, 2 * high))
    scene = floor_of_two(box, Box(0.1, 0.06, high), 0.0, higher=0.1)
    q = np.array([0.15, 0.0, high, 0, 0, 0, 1.0])
    gaps = At(scene, q).gaps.reshape(2, -1)
    assert [np.count_nonzero(np.abs(each) < 1e-12) for each in gaps] == [4, 4]
    run = cp.simulate(scene, q, np.array([0.5, 0, 0, 0, 0, 0]), duration=0.02, dt=1e-3)
    np.testing.assert_allclose(run.v[-1], 0.0, atol=1e-8)


@pytest.mark.long
def test_feet_of_two_pieces_slide_off_an_edge():
    """What a body wears is a piece of it too: a sole of two halves over the edge of a table."""
    halves = cp.model.free_box(size=(0.2, 0.12, 0.08))
    for x, name in ((0.05, "front"), (-0.05, "back")):
        halves = halves.with_frame(name, "box", (x, 0.0, 0.0))
    halves = halves.with_frame("table", "universe", (0.0, 0.0, -0.05))
    contacts = [
        FrictionalContact(
            half, Box(0.05, 0.06, 0.04), on="table", on_shape=Box(0.06, 0.5, 0.05),
            friction=0.0, name=half,
        )
        for half in ("front", "back")
    ]  # fmt: skip
    scene = cp.Scene(halves, contacts=contacts)
    q, v = np.array([-0.03, 0.0, 0.04, 0, 0, 0, 1.0]), np.array([0.5, 0, 0, 0, 0, 0.0])
    exact = cp.StewartTrinkle(contact=cp.contact.SemismoothNewton())  # ADMM leaves 1e-8 of it
    run = cp.simulate(scene, q, v, duration=0.1, dt=1e-3, integrator=exact)
    np.testing.assert_allclose(run.v[-1], v, atol=1e-8)


@pytest.mark.long
def test_a_gap_to_a_hidden_face_is_still_the_distance_of_its_shape():
    box = cp.model.free_box(size=(0.2, 0.12, 0.08))
    scene = floor_of_two(box, Box(0.1, 0.06, 0.04), 0.0)
    gaps = contact_gaps(scene, np.array([0.13, 0.0, 0.04, 0, 0, 0, 1.0]))
    nearest = min(gap for name, gap in gaps.items() if name.startswith("right"))
    assert nearest == pytest.approx(0.02, abs=1e-12)


# ---- solids by their corners ------------------------------------------------

CORNERS = tuple(product((0.2, -0.2), (0.15, -0.15), (0.1, -0.1)))
PRISM = tuple((x, y, z) for z in (0.1, -0.1) for x, y in ((0.2, 0), (-0.1, 0.2), (-0.1, -0.2)))


@pytest.mark.parametrize("other", SHAPES)
def test_a_box_by_its_corners_is_the_box(other):
    rng = np.random.default_rng(8)
    for gap in (2e-3, -2e-3):
        q = near(Box(0.2, 0.15, 0.1), SHAPES[other], rng, gap)
        box, hull = (At(scene_of(s, SHAPES[other]), q) for s in (SHAPES["box"], Convex(CORNERS)))
        order, others = np.argsort(box.gaps.round(9)), np.argsort(hull.gaps.round(9))
        np.testing.assert_allclose(hull.gaps[others], box.gaps[order], atol=1e-12)
    flat = At(scene_of(Convex(CORNERS), Plane()), placed(above(0.25)))
    np.testing.assert_allclose(np.sort(flat.gaps)[:4], 0.15, atol=1e-15)


@pytest.mark.parametrize("other", SHAPES)
def test_rows_of_a_prism_are_the_rates_of_its_gaps(other):
    scene, rng = scene_of(SHAPES[other], Convex(PRISM)), np.random.default_rng(9)
    for gap in (5e-3, -5e-3):
        q, v, h = near(SHAPES[other], Convex(PRISM), rng, gap), rng.normal(size=12), 1e-6
        here = At(scene, q)
        after, before = (At(scene, pin.integrate(BODIES.model, q, s * v)) for s in (h, -h))
        there = np.isfinite(here.gaps) & np.isfinite(after.gaps) & np.isfinite(before.gaps)
        rate = (after.gaps[there] - before.gaps[there]) / (2 * h)
        np.testing.assert_allclose((here.rows()[2::3] @ v)[there], rate, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("drop", [6e-5, 6e-4, 1e-6])
def test_faces_that_meet_flatly_are_two(drop):
    """A roof whose eaves are far lower than rounding: its faces meet at an angle of any size."""
    half = 0.15
    eaves = [(x, y, z) for y in (-0.1, 0.1) for x in (-half, half) for z in (-drop, -0.1)]
    roof = Convex([*eaves, (0.0, -0.1, 0.0), (0.0, 0.1, 0.0)])
    scene, length = scene_of(Ball(0.02), roof), np.hypot(drop, half)
    for side in (-1.0, 1.0):
        foot = np.array([side * 0.13, 0.0, -drop * 0.13 / half])
        normal = np.array([side * drop, 0.0, half]) / length
        q = placed(pin.SE3(np.eye(3), foot + 0.021 * normal))
        assert min(contact_gaps(scene, q).values()) == pytest.approx(1e-3, abs=1e-12)


@pytest.mark.long
def test_corners_with_six_digits_make_the_faces_of_their_solid():
    """Twelve faces of a prism, each of several triangles, whose corners are written in a file."""
    angles = np.pi / 5 * np.arange(10) + 0.1
    rim = 0.1 * np.column_stack((np.cos(angles), np.sin(angles)))
    corners = np.array([(x, y, z) for z in (0.05, -0.05) for x, y in rim])
    corners = corners @ pin.rpy.rpyToMatrix(0.3, 0.4, 0.5).T
    core = Convex([tuple(corner) for corner in np.round(corners, 7)]).core
    assert len(core.normals) == 12
    assert sorted(len(loop) for loop in core.loops) == 10 * [4] + [10, 10]


@pytest.mark.parametrize(
    ("vertices", "words"),
    [
        ((*CORNERS, (0.0, 0.0, 0.05)), r"vertices\[8\] = \(0.0, 0.0, 0.05\): it is not a corner"),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], "in a plane"),
        (CORNERS[:3], "3 of them"),
        ("mesh", "a list of points"),
        ([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1e-7)], "in a plane"),
        ([(0, 0)] * 4, r"vertices\[0\]"),
    ],
)
def test_what_is_not_convex_is_refused(vertices, words):
    with pytest.raises(InvalidArgument, match=words):
        Convex(vertices)


@pytest.mark.long
def test_a_solid_comes_back_from_a_file():
    contact = FrictionalContact("a", Convex(PRISM), friction=0.5)
    assert decode(json.loads(json.dumps(encode(contact)))) == contact
    assert pickle.loads(pickle.dumps(contact)) == contact
