"""Contacts that may open: gaps, rows, what is refused, and what scenes, files and locks do."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from shared import each_row, robot

import condyn_pin as cp
from condyn_pin.constraints import (
    Ball,
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    FrictionalContact,
    JointFriction,
    JointLimit,
    PlanarContact,
    Plane,
    Point,
    PointContact,
    RollingBall,
)
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics import contact_gaps
from condyn_pin.errors import (
    CondynError,
    InvalidArgument,
    InvalidConstraint,
    UnknownName,
    UnsupportedConstraint,
)
from condyn_pin.mechanism import minimal
from condyn_pin.simulation.files import decode, encode, scene_of

TILTED = Plane((1.0, -2.0, 4.0), 0.3)
SHAPES = (Point(), Ball(0.05), Capsule(0.03, 0.2), Box(0.1, 0.05, 0.02))


def on_solo(*contacts, **fields) -> cp.Scene:
    return cp.Scene(robot("solo12"), contacts=contacts, **fields)


def evaluated(scene: cp.Scene, q: np.ndarray):
    """Return candidates, and data with placements and Jacobians at q."""
    data = scene.robot.model.createData()
    pin.computeJointJacobians(scene.robot.model, data, q)
    return Candidates(scene.robot.model, scene.contact_bounds), data


def a_state(scene: cp.Scene, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    model = scene.robot.model
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    return q, rng.normal(size=model.nv)


# ---- geometry ---------------------------------------------------------------


def test_the_gap_of_each_shape_is_its_lowest_point():
    rng = np.random.default_rng(1)
    for shape in SHAPES:
        scene = on_solo(FrictionalContact("FL_FOOT", shape, (0.01, 0.02, 0.03), TILTED, friction=1))
        q, _ = a_state(scene)
        candidates, data = evaluated(scene, q)
        joint, placement = scene.robot.frame("FL_FOOT")
        at = data.oMi[joint] * placement * pin.SE3(np.eye(3), np.array([0.01, 0.02, 0.03]))
        inside = [_a_point_of(shape, rng) for _ in range(4000)]
        heights = np.array([at.act(p) @ np.array(TILTED.normal) for p in inside]) - TILTED.height
        least = candidates.gaps(data, q).min()
        assert least <= heights.min() + 1e-12
        assert least == pytest.approx(heights.min(), abs=5e-3)


def _a_point_of(shape, rng) -> np.ndarray:
    """Return a point of the skin of a shape, and now and then a corner."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    if isinstance(shape, Point):
        return np.zeros(3)
    if isinstance(shape, Ball):
        return shape.radius * direction
    if isinstance(shape, Capsule):
        end = np.array([0.0, 0.0, rng.choice([-1.0, 1.0]) * shape.half_length])
        return end + shape.radius * direction
    half = np.array([shape.x, shape.y, shape.z])
    return half * rng.choice([-1.0, 1.0], size=3)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("moving_ground", [False, True])
def test_normal_rows_are_the_rates_of_the_gaps(shape, moving_ground):
    on = {"on": "HR_LOWER_LEG", "on_shape": TILTED} if moving_ground else {"on": TILTED}
    scene = on_solo(FrictionalContact("FL_FOOT", shape, (0.01, 0.02, 0.03), friction=0.5, **on))
    q, v = a_state(scene)
    candidates, data = evaluated(scene, q)
    found, J = candidates.evaluate(data, q)
    np.testing.assert_array_equal(found, candidates.gaps(data, q))
    rows = J @ v
    h, model = 1e-5, scene.robot.model

    def gaps(step: float) -> np.ndarray:
        there = pin.integrate(model, q, step * v)
        candidates, data = evaluated(scene, there)
        return candidates.gaps(data, there)

    rate = (8 * (gaps(h) - gaps(-h)) - (gaps(2 * h) - gaps(-2 * h))) / (12 * h)
    np.testing.assert_allclose(rows[2::3], rate, atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("moving_ground", [False, True])
def test_rows_are_the_velocity_of_the_material_point(shape, moving_ground):
    on = {"on": "HR_LOWER_LEG", "on_shape": TILTED} if moving_ground else {"on": TILTED}
    scene = on_solo(FrictionalContact("FL_FOOT", shape, friction=0.5, **on))
    q, v = a_state(scene, 3)
    candidates, data = evaluated(scene, q)
    rows = (candidates.evaluate(data, q)[1] @ v).reshape(-1, 3)
    body = scene.robot.frame("FL_FOOT")[0]
    ground = scene.robot.frame("HR_LOWER_LEG")[0] if moving_ground else 0
    model = scene.robot.model

    def placed(step: float):
        data = model.createData()
        pin.forwardKinematics(model, data, pin.integrate(model, q, step * v))
        return data.oMi[body].copy(), data.oMi[ground].copy()

    h = 1e-6
    for p, E, found in zip(candidates.points(data, q), candidates.axes(data, q), rows, strict=True):
        fixed = [placement.actInv(p) for placement in placed(0.0)]
        after = [x.act(y) for x, y in zip(placed(h), fixed, strict=True)]
        before = [x.act(y) for x, y in zip(placed(-h), fixed, strict=True)]
        slip = ((after[0] - before[0]) - (after[1] - before[1])) / (2 * h)
        np.testing.assert_allclose(found, E.T @ slip, atol=2e-8)
        np.testing.assert_allclose(E.T @ E, np.eye(3), atol=1e-14)
        assert np.linalg.det(E) == pytest.approx(1.0)


def test_a_rolling_ball_has_no_slip_at_its_lowest_point():
    scene = cp.Scene(
        cp.model.rolling_ball(radius=0.1),
        contacts=[FrictionalContact("centre", Ball(0.1), friction=1)],
    )
    q = np.array([0.3, -0.2, 0.17, *np.array([0.1, 0.5, -0.3, 0.8]) / np.sqrt(0.99)])
    candidates, data = evaluated(scene, q)
    omega, R = np.array([0.4, -1.1, 2.0]), data.oMi[1].rotation
    v = np.concatenate([R.T @ np.cross(omega, [0, 0, 0.1]), R.T @ omega])
    assert candidates.gaps(data, q) == pytest.approx([0.07], abs=1e-15)
    np.testing.assert_allclose(candidates.evaluate(data, q)[1] @ v, 0, atol=1e-15)
    np.testing.assert_allclose(candidates.points(data, q), [[0.3, -0.2, 0.07]], atol=1e-15)
    np.testing.assert_array_equal(candidates.axes(data, q)[0], np.eye(3))


@pytest.mark.long
def test_rows_of_the_active_come_in_order():
    scene = on_solo(
        JointFriction("FL_KFE", 0.3),
        FrictionalContact("FL_FOOT", friction=0.5, name="left"),
        JointLimit("FR_KFE"),
        FrictionalContact("FR_FOOT", Box(0.1, 0.1, 0.1), friction=0.2, restitution=0.4),
    )
    q, _ = a_state(scene)
    candidates, data = evaluated(scene, q)
    corners = tuple(f"FR_FOOT/corner {i}" for i in range(1, 9))
    stops = ("FR_KFE/lower", "FR_KFE/upper")
    assert candidates.names == ("left", *corners, *stops, "FL_KFE/friction")
    assert (candidates.cones, candidates.half_lines, candidates.intervals) == (9, 2, 1)
    assert candidates.rows == 30 == len(candidates.row_names)
    assert candidates.row_names[:4] == ("left.t1", "left.t2", "left.n", "FR_FOOT/corner 1.t1")
    np.testing.assert_array_equal(candidates.friction, [0.5, *8 * [0.2]])
    np.testing.assert_array_equal(candidates.restitution, [0.0, *8 * [0.4]])
    np.testing.assert_array_equal(candidates.limits, [0.3])
    whole = candidates.evaluate(data, q)[1]
    active = np.zeros(12, dtype=bool)
    active[[1, 10, 11]] = True
    part = whole[candidates.rows_of(active)]
    np.testing.assert_array_equal(part, whole[[3, 4, 5, 28, 29]])
    knee = scene.robot.model.joints[scene.robot.model.getJointId("FR_KFE")]
    assert part[3, knee.idx_v] == -1.0
    assert np.count_nonzero(part[3:]) == 2


@pytest.mark.long
def test_the_stops_are_as_far_as_the_limits():
    scene = on_solo(JointLimit("FR_KFE"))
    model = scene.robot.model
    i = model.joints[model.getJointId("FR_KFE")].idx_q
    q, _ = scene.bilateral.state()
    gaps = contact_gaps(scene, q)
    assert gaps["FR_KFE/lower"] == q[i] - model.lowerPositionLimit[i]
    assert gaps["FR_KFE/upper"] == model.upperPositionLimit[i] - q[i]
    text = str(replace(scene, contacts=(*scene.contacts, JointFriction("FR_KFE", 1))).summary(q))
    assert f"FR_KFE/lower: open by {np.degrees(gaps['FR_KFE/lower']):.3g} deg" in text
    assert "FR_KFE/friction: dry friction" in text


@pytest.mark.long
@pytest.mark.parametrize("on", [Plane(height=-1.2), "world"])
def test_a_robot_of_one_joint_has_rows_too(on):
    shape = Box(1.0, 1.0, 1.2) if on == "world" else None
    contact = FrictionalContact("tip", Ball(0.1), on=on, on_shape=shape, friction=0.5)
    scene = cp.Scene(cp.model.pendulum(length=2.0), contacts=[contact])
    q = np.array([0.3])
    candidates, data = evaluated(scene, q)
    rows = candidates.evaluate(data, q)[1]
    assert rows.shape == (3, 1)
    if on != "world":
        np.testing.assert_allclose(candidates.gaps(data, q), [1.1 - 2 * np.cos(0.3)])
        np.testing.assert_allclose(rows[2], [2 * np.sin(0.3)])


@pytest.mark.long
def test_no_contacts_is_a_scene_as_before():
    candidates = Candidates(robot("solo12").model, ())
    data = robot("solo12").model.createData()
    pin.computeJointJacobians(robot("solo12").model, data, pin.neutral(robot("solo12").model))
    assert candidates.gaps(data, pin.neutral(robot("solo12").model)).shape == (0,)
    assert candidates.evaluate(data, pin.neutral(robot("solo12").model))[1].shape == (0, 18)


# ---- what is refused --------------------------------------------------------


@each_row(
    ("make", "words"),
    [
        (lambda: FrictionalContact("FL_FOOT"), "friction is missing"),
        (lambda: FrictionalContact("FL_FOOT", friction=-0.1), "friction = -0.1"),
        (lambda: FrictionalContact("FL_FOOT", friction=1e9), "1000 is the most"),
        (lambda: FrictionalContact("FL_FOOT", friction=math.nan), "friction"),
        (lambda: FrictionalContact("FL_FOOT", friction="ice"), "friction"),
        (lambda: FrictionalContact("FL_FOOT", friction=1, restitution=1.1), "restitution = 1.1"),
        (lambda: FrictionalContact("FL_FOOT", friction=1, restitution=-0.1), "from 0 to 1"),
        (lambda: FrictionalContact("", friction=1), "frame = ''"),
        (lambda: FrictionalContact("FL_FOOT", 0.1, friction=1), "shape = 0.1"),
        (lambda: FrictionalContact("FL_FOOT", offset=(0, 0), friction=1), "offset"),
        (lambda: FrictionalContact("FL_FOOT", on=3, friction=1), "on = 3"),
        (lambda: FrictionalContact("FL_FOOT", on="base_link", friction=1), "on_shape = None"),
        (lambda: FrictionalContact("FL_FOOT", on_shape=Plane(), friction=1), "on_shape"),
        (lambda: FrictionalContact("FL_FOOT", friction=1, name=7), "name = 7"),
        (lambda: Ball(0.0), "radius = 0.0"),
        (lambda: Capsule(0.1, -1.0), "half_length = -1.0"),
        (lambda: Box(0.1, 0.1, 0.0), "z = 0.0"),
        (lambda: Plane((0, 0, 0)), "normal"),
        (lambda: Plane(height=math.inf), "height"),
        (lambda: JointLimit(3), "joint = 3"),
        (lambda: JointFriction("FL_KFE", -1.0), "torque = -1.0"),
    ],
)
def test_bad_fields_are_named(make, words):
    with pytest.raises(InvalidArgument) as error:
        make()
    assert words in str(error.value)


@each_row(
    ("contact", "kind", "words"),
    [
        (FrictionalContact("no_foot", friction=1), UnknownName, "no frame named 'no_foot'"),
        (FrictionalContact("world", friction=1), InvalidArgument, "both belong to the world"),
        (
            FrictionalContact("FL_FOOT", on="FL_LOWER_LEG", on_shape=Plane(), friction=1),
            InvalidArgument,
            "both belong to joint 'FL_KFE'",
        ),
        (JointLimit("no_knee"), UnknownName, "no joint named 'no_knee'"),
        (JointLimit("root_joint"), InvalidArgument, "JointModelFreeFlyer"),
        (JointFriction("no_knee", 1.0), UnknownName, "no joint named 'no_knee'"),
        (JointFriction("FL_KFE"), InvalidArgument, "say torque"),
        (PointContact("FL_FOOT"), InvalidConstraint, "belongs into the constraints"),
    ],
)
def test_contacts_that_do_not_fit_are_named(contact, kind, words):
    with pytest.raises(kind) as error:
        on_solo(contact)
    assert words in str(error.value)


def test_a_joint_without_limits_has_no_stops():
    with pytest.raises(InvalidArgument, match="no finite limit"):
        cp.Scene(cp.model.pendulum(), contacts=[JointLimit("pivot")])


@pytest.mark.long
def test_the_description_says_the_dry_friction():
    model = pin.Model(cp.model.pendulum().model)
    model.friction = np.array([0.25])
    if hasattr(model, "upperDryFrictionLimit"):
        model.upperDryFrictionLimit = np.array([0.25])
        model.lowerDryFrictionLimit = np.array([-0.25])
    scene = cp.Scene(cp.Robot("rusty", model), contacts=[JointFriction("pivot")])
    assert Candidates(model, scene.contact_bounds).limits == [0.25]


def test_names_are_there_once():
    twice = [FrictionalContact("FL_FOOT", friction=1)] * 2
    with pytest.raises(InvalidConstraint, match="two contacts are named 'FL_FOOT'"):
        on_solo(*twice)
    with pytest.raises(InvalidConstraint, match="named 'FL_FOOT'"):
        on_solo(twice[0], constraints=[PointContact("FL_FOOT")])
    with pytest.raises(InvalidArgument, match="a list is needed"):
        cp.Scene(robot("solo12"), contacts=twice[0])
    with pytest.raises(InvalidArgument, match="contacts = 3"):
        cp.Scene(robot("solo12"), contacts=3)


# ---- scenes -----------------------------------------------------------------


def solo_on_feet(friction: float = 0.7) -> cp.Scene:
    solo = robot("solo12")
    return cp.Scene(solo, contacts=solo.frictional_contacts(friction))


@pytest.mark.long
def test_a_scene_with_contacts_is_a_value():
    scene = solo_on_feet()
    assert scene == solo_on_feet()
    assert hash(scene) == hash(solo_on_feet())
    assert scene != solo_on_feet(0.6)
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert "FrictionalContact(name='FL_FOOT'" in repr(scene)
    assert scene.rows == 0
    assert scene.bilateral == cp.Scene(robot("solo12"))
    assert scene.bilateral.bilateral is scene.bilateral
    described = scene.state(on_ground=False)[0]
    np.testing.assert_array_equal(described, scene.bilateral.state()[0])


@pytest.mark.long
def test_nothing_bilateral_takes_contacts():
    scene = solo_on_feet()
    with pytest.raises(UnsupportedConstraint, match="4 contacts may open: step"):
        cp.Workspace(scene)
    workspace = cp.Workspace(scene.bilateral)
    with pytest.raises(UnsupportedConstraint, match=r"scene\.closed\(\)"):
        workspace.use(scene)
    with pytest.raises(UnsupportedConstraint, match="4 contacts may open"):
        minimal(scene, error=0.1)
    q, v = scene.state()
    for ask in (
        lambda: cp.solve(scene, q, v, np.zeros(scene.robot.nv)),
        lambda: cp.impact(scene, q, v),
        lambda: cp.inverse_dynamics(scene, q, v, np.zeros(scene.robot.nv)),
        lambda: cp.Study(scene).run(),
    ):
        with pytest.raises(UnsupportedConstraint, match="4 contacts may open"):
            ask()


def test_closed_contacts_are_constraints_where_they_are():
    scene = solo_on_feet()
    assert scene.closed() == cp.Scene(robot("solo12"), robot("solo12").contacts)
    some = scene.closed({"FL_FOOT": "stick", "HR_FOOT": "slide", "HL_FOOT": "open"})
    assert some.constraints == (PointContact("FL_FOOT"), PlanarContact("HR_FOOT"))
    assert some.contacts == ()
    with pytest.raises(UnknownName, match="no contact named 'paw'"):
        scene.closed({"paw": "stick"})
    with pytest.raises(InvalidArgument, match=r"modes\['FL_FOOT'\] = 'glue'"):
        scene.closed({"FL_FOOT": "glue"})
    free = scene.bilateral
    assert free.closed() is free


def test_round_and_wide_shapes_close_too():
    ball = on_solo(FrictionalContact("FL_FOOT", Ball(0.02), on=TILTED, friction=1))
    assert ball.closed().constraints == (RollingBall("FL_FOOT", 0.02, TILTED.normal),)
    box = on_solo(FrictionalContact("FL_FOOT", Box(0.1, 0.2, 0.3), (1, 1, 1), friction=1))
    (last,) = box.closed({"FL_FOOT/corner 8": "stick"}).constraints
    assert last.offset == pytest.approx((0.9, 0.8, 0.7))
    for contact in (
        FrictionalContact("FL_FOOT", Ball(0.02), (0, 0, 0.1), friction=1),
        FrictionalContact("FL_FOOT", on="base_link", on_shape=Plane(), friction=1),
    ):
        with pytest.raises(UnsupportedConstraint, match="FL_FOOT"):
            on_solo(contact).closed()
    two = on_solo(
        FrictionalContact("FL_FOOT", friction=1, name="foot 2"),
        FrictionalContact("FR_FOOT", on="base_link", on_shape=Plane(), friction=1, name="foot"),
        JointLimit("FL_KFE", name="f"),
    )
    assert two.closed({"foot 2": "stick"}).names == ("foot 2",)
    stops = on_solo(JointLimit("FL_KFE"))
    assert stops.closed().constraints == ()
    with pytest.raises(UnsupportedConstraint, match=r"scene\.lock\(\['FL_KFE'\]"):
        stops.closed({"FL_KFE/lower": "stick"})


def test_summary_and_assembly_say_gaps():
    scene = solo_on_feet()
    q, _ = scene.state(on_ground=False)
    gap = contact_gaps(scene, q)["FL_FOOT"]
    assert f"FL_FOOT: open by {1e3 * gap:.3g} mm" in str(scene.summary())
    low = q.copy()
    low[2] -= gap + 1e-3
    found = scene.assemble(low)
    assert found.penetration.keys() == {"FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"}
    assert found.penetration["HL_FOOT"] == pytest.approx((1e-3, 0.0), abs=1e-12)
    assert "penetrates by 1 mm" in str(found)
    assert "penetrates by 1 mm" in str(scene.summary(low))
    assert scene.bilateral.assemble(low).penetration == {}


def test_a_smaller_scene_keeps_the_contacts_that_it_can():
    scene = replace(solo_on_feet(), contacts=(*solo_on_feet().contacts, JointLimit("FL_KFE")))
    locked = scene.lock(["FL_KFE"])
    assert [c.name for c in locked.contacts] == [c.name for c in scene.contacts[:4]]
    assert any("contact FL_KFE" in text for text in locked.dropped)
    assert locked.full == scene
    q, v = scene.state()
    small, _ = locked.reduce_state(q, v)
    gaps = contact_gaps(scene, q)
    for name, gap in contact_gaps(locked, small).items():
        assert gap == pytest.approx(gaps[name], abs=1e-15)
    assert pickle.loads(pickle.dumps(locked)).contacts == locked.contacts
    assert locked.bilateral.full == scene


@pytest.mark.parametrize(
    ("name", "variant", "count"),
    [
        ("solo12", {}, 4),
        ("go2", {}, 4),
        ("talos", {}, 8),
        ("cassie", {"feet": "points"}, 4),
        ("cassie", {"feet": "lines"}, 4),
    ],
)
def test_robots_know_their_feet(name, variant, count):
    loaded = cp.load_robot(name, variant=variant)
    feet = loaded.frictional_contacts(0.7, on=Plane(height=-0.1))
    assert len(feet) == count
    assert {foot.friction for foot in feet} == {0.7}
    scene = cp.Scene(loaded, loaded.loops, feet)
    gaps = np.array([*contact_gaps(scene, scene.state()[0]).values()])
    assert np.ptp(gaps) < 2e-2  # it stands
    names = {c.name for c in loaded.contacts}
    assert all(foot.name in names or foot.name.rpartition("/")[0] in names for foot in feet)


def test_feet_without_a_size_are_refused():
    with pytest.raises(InvalidArgument, match="half_length"):
        cp.load_robot("panda").frictional_contacts(0.7)
    with pytest.raises(InvalidArgument, match="RollingWheel"):
        cp.model.unicycle().frictional_contacts(0.7)
    (ball,) = cp.model.rolling_ball(radius=0.2).frictional_contacts(0.3)
    assert ball.shape == Ball(0.2)
    with pytest.raises(CondynError, match="friction"):
        cp.model.rolling_ball().frictional_contacts(-1.0)


# ---- files ------------------------------------------------------------------


@pytest.mark.long
@each_row(
    "contact",
    [
        FrictionalContact("a", Capsule(0.1, 0.2), (1, 2, 3), TILTED, friction=0.1, name="b"),
        FrictionalContact("a", Box(1, 2, 3), on="c", on_shape=TILTED, friction=0, restitution=1),
        FrictionalContact("a", Cylinder(0.1, 0.2), friction=0.1),
        FrictionalContact("a", Ellipsoid(1, 2, 3), friction=0.7),
        FrictionalContact("a", friction=0.7),
        JointLimit("knee", name="stop"),
        JointFriction("knee", 0.3),
    ],
)
def test_contacts_come_back_from_words(contact):
    words = json.dumps(encode(contact))
    assert decode(json.loads(words)) == contact


@pytest.mark.long
def test_scenes_come_back_with_their_contacts():
    scene = solo_on_feet()
    words = {"constraints": [], "contacts": [encode(c) for c in scene.contacts]}
    assert scene_of(scene.robot, json.loads(json.dumps(words))) == scene
    assert scene_of(scene.robot, {"constraints": []}) == scene.bilateral  # of before


@pytest.mark.long
def test_a_motion_that_was_saved_has_its_contacts(tmp_path):
    scene = solo_on_feet()
    q, v = scene.state()
    cp.simulate(scene, q, v, duration=2e-3, dt=1e-3).save(tmp_path / "fall.npz")
    assert cp.Trajectory.load(tmp_path / "fall.npz").scene == scene
