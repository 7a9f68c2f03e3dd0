"""Friction cones: closed forms, corner forces by a linear program, frames, signs, bad input."""

from __future__ import annotations

import dataclasses
import functools
import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from shared import each_row, robot

import condyn_pin as cp
from condyn_pin.constraints import Constraint, KnifeEdge, LineContact, PlanarContact, RollingBall
from condyn_pin.contact import FrictionCone, WrenchCone, cone_rows, margins
from condyn_pin.dynamics.solution import Sites

G, MASS = 9.81, 2.0
X, Y = 0.3, 0.2  # half the size of the block [m]
PLANE = np.array([0.0, 0.0, 1.0])


@functools.cache
def block(height: float = 0.0) -> cp.Robot:
    """A free block whose centre of mass is `height` [m] above the middle of its sole."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "float")
    model.addJointFrame(joint)
    inertia = pin.Inertia(MASS, np.array([0.0, 0.0, height]), 0.05 * np.eye(3))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return cp.Robot("block", model)


def tilted(about: str, angle: float, yaw: float = 0.0) -> np.ndarray:
    """The configuration of a block that lies on a slope, turned by yaw on it."""
    axis = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0]}[about]
    slope = pin.AngleAxis(angle, np.array(axis)).matrix()
    turn = slope @ pin.rpy.rpyToMatrix(0.0, 0.0, yaw)
    return pin.SE3ToXYZQUAT(pin.SE3(turn, np.zeros(3)))


def normal(q: np.ndarray) -> np.ndarray:
    return pin.XYZQUATToSE3(q).rotation[:, 2]


SOLE = cp.SurfaceContact("float", X, Y, name="sole")


def held(made: cp.Robot, q: np.ndarray, *contacts: Constraint, tau=None) -> cp.dynamics.Solution:
    scene = cp.Scene(made, contacts)
    return cp.solve(scene, q, np.zeros(6), np.zeros(6) if tau is None else tau)


# Closed forms


@settings(max_examples=25)
@given(mu=st.floats(0.05, 3.0), yaw=st.floats(-3.0, 3.0))
def test_a_plate_on_points_slips_at_the_angle_of_friction(mu, yaw):
    for factor, fault in ((0.999, ""), (1.001, "slips")):
        q = tilted("x", np.arctan(mu * factor), yaw)
        cone = FrictionCone(mu, normal=normal(q))
        for margin in margins(held(block(), q, *SOLE.corners()), cone).values():
            assert margin.fault == fault
            wanted = MASS * G / 4 * np.cos(np.arctan(mu * factor)) * mu * (1 - factor)
            assert abs(margin.slips - wanted) < 1e-9 * MASS * G
            assert margin.least == margin.slips


@pytest.mark.parametrize("pyramid", ["inner", "outer"])
@pytest.mark.parametrize("about", ["x", "y"])
def test_a_block_slips_along_a_side_where_its_pyramid_says(pyramid, about):
    edge = 0.5 / np.sqrt(2) if pyramid == "inner" else 0.5
    for factor, fault in ((0.999, ""), (1.001, "slips")):
        answer = held(block(), tilted(about, np.arctan(edge * factor)), SOLE)
        assert margins(answer, WrenchCone(0.5, pyramid=pyramid))["sole"].fault == fault


@pytest.mark.long
@pytest.mark.parametrize(("about", "half"), [("x", Y), ("y", X)])
@pytest.mark.parametrize("side", [1, -1])
def test_a_box_tips_where_its_weight_leaves_the_sole(about, half, side):
    height = 0.5
    for factor, fault in ((0.999, ""), (1.001, "tips")):
        angle = side * np.arctan(half / height * factor)
        answer = held(block(height), tilted(about, angle), SOLE)
        margin = margins(answer, WrenchCone(100.0))["sole"]
        assert margin.fault == fault
        wanted = MASS * G * np.cos(angle) * (1 - factor) / 2  # on the edge that lifts
        assert abs(margin.tips - wanted) < 1e-9 * MASS * G


@pytest.mark.long
def test_what_is_left_on_the_edge_that_tips_is_what_its_two_corners_carry():
    q, height = tilted("y", 0.2), 0.5
    surface = margins(held(block(height), q, SOLE), WrenchCone(100.0))["sole"]
    points = held(block(height), q, *SOLE.corners())
    carried = sorted(m.pulls for m in margins(points, FrictionCone(1.0, normal=normal(q))).values())
    assert abs(surface.tips - sum(carried[:2])) < 1e-9


@pytest.mark.long
@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_a_plate_twists_where_all_corners_slip(turn):
    mu, q = 0.5, tilted("x", 0.0)
    limit = mu * MASS * G * (X + Y)  # each corner at the corner of its pyramid
    for factor, fault in ((0.999, ""), (1.001, "twists")):
        tau = np.array([0.0, 0.0, 0.0, 0.0, 0.0, turn * factor * limit])
        margin = WrenchCone(mu, pyramid="outer").margin(
            held(block(), q, SOLE, tau=tau).forces["sole"]
        )
        assert margin.fault == fault
        assert abs(margin.twists - mu * MASS * G * (1 - factor)) < 1e-9 * MASS * G


def test_what_pulls_is_said_to_pull_and_by_how_much_and_no_force_is_in_every_cone():
    answer = held(block(), tilted("x", 0.0), SOLE, tau=[0.0, 0.0, 3 * MASS * G, 0.0, 0.0, 0.0])
    margin = margins(answer, WrenchCone(0.5))["sole"]
    assert margin.fault == "pulls"
    assert abs(margin.least + 2 * MASS * G) < 1e-9
    assert repr(margin) == "Margin(-39.24 N: pulls)"
    assert FrictionCone(0.5).margin(np.zeros(3)).fault == ""
    assert WrenchCone(0.5, X, Y).margin(np.zeros(6)).least == 0.0


# The corners, found by a linear program


def corners_make(cone: WrenchCone, wrench: np.ndarray) -> bool:
    """Whether forces in pyramids at the corners, or at the ends of an edge, sum to the wrench."""
    mu = cone.friction / (np.sqrt(2) if cone.pyramid == "inner" else 1.0)
    ends = [1.0, -1.0]
    points = [
        np.array([x * cone.half_length, y * cone.half_width, 0.0])
        for x in ends
        for y in (ends if cone.half_width else [0.0])
    ]
    sums = np.hstack([np.vstack([np.eye(3), pin.skew(p)]) for p in points])
    sides = np.array([[1, 0, -mu], [-1, 0, -mu], [0, 1, -mu], [0, -1, -mu]])
    found = linprog(
        np.zeros(sums.shape[1]),
        A_ub=np.kron(np.eye(len(points)), sides),
        b_ub=np.zeros(4 * len(points)),
        A_eq=sums,
        b_eq=wrench,
        bounds=[(None, None), (None, None), (0, None)] * len(points),
    )
    assert found.status in (0, 2)  # found, or shown not to exist
    return found.status == 0


sizes = st.floats(0.05, 1.0)
shares = st.floats(-1.0, 1.0)


@given(
    mu=st.floats(0.1, 2.0), length=sizes, width=st.one_of(st.just(0.0), sizes),
    pyramid=st.sampled_from(["inner", "outer"]), toward=st.tuples(*[shares] * 5),
)  # fmt: skip
def test_a_wrench_is_inside_just_if_corner_forces_make_it(mu, length, width, pyramid, toward):
    """From the middle of the cone in any direction: inside up to its end, and outside beyond."""
    cone = WrenchCone(mu, length, width, pyramid=pyramid)
    fx, fy, mx, my, mz = toward
    way = np.array([mu * fx, mu * fy, 0.0, width * mx, length * my, mu * (length + width) * mz])
    assume(np.abs(way).max() > 0.01)
    middle = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])

    def least(share: float) -> float:
        return cone.margin(middle + share * way).least

    low, high = 0.0, 1e4
    while high - low > 1e-7 * high:
        mean = (low + high) / 2
        low, high = (mean, high) if least(mean) >= 0 else (low, mean)
    assert corners_make(cone, middle + 0.999 * low * way)
    assert not corners_make(cone, middle + 1.001 * high * way)


# Pyramids


@given(
    mu=st.floats(0.05, 2.0), sides=st.integers(3, 12), angle=st.floats(-4.0, 4.0),
    share=st.floats(0.0, 1.5),
)  # fmt: skip
def test_a_pyramid_lies_within_the_cone_or_around_it(mu, sides, angle, share):
    force = np.array([mu * share * np.cos(angle), mu * share * np.sin(angle), 1.0])
    inner, outer = (FrictionCone(mu, sides=sides, pyramid=p) for p in ("inner", "outer"))
    round_ = inner.margin(force).least
    assert round_ == outer.margin(force).least
    for cone in (inner, outer):
        rows = cone.rows()
        assert rows.A.shape == (sides + 1, 3)
        flat = (rows.b - rows.A @ force).min()
        smaller, larger = (flat, round_) if cone is inner else (round_, flat)
        assert smaller < 1e-12 or larger > -1e-12
        if share < 0.999 * np.cos(np.pi / sides) or share > 1.001 / np.cos(np.pi / sides):
            assert (flat >= 0) == (round_ >= 0)


@pytest.mark.long
def test_four_sides_within_have_the_coefficient_over_the_root_of_two():
    A = FrictionCone(0.8).rows().A
    assert np.allclose(A[1], [1.0, 0.0, -0.8 / np.sqrt(2)])
    assert np.allclose(A[2], [0.0, 1.0, -0.8 / np.sqrt(2)])
    assert np.allclose(FrictionCone(0.8, pyramid="outer").rows().A[1], [1.0, 0.0, -0.8])


@pytest.mark.long
def test_rows_count_and_names():
    rows = WrenchCone(0.7, X, Y).rows()
    assert rows.A.shape == (17, 6)
    assert len(set(rows.names)) == 17
    assert WrenchCone(0.7, X, 0.0).rows().A.shape == (11, 6)
    with pytest.raises(ValueError, match="read-only"):
        rows.A[0] = 0.0


# Frames, signs, and scenes


def contacts_of_every_kind() -> dict[str, tuple[Constraint, FrictionCone | WrenchCone]]:
    n = (0.2, -0.1, 0.9)
    round_, flat = FrictionCone(0.5), WrenchCone(0.5, 0.1, 0.05)
    return {
        "point": (cp.PointContact("hook"), round_),
        "point on a slope": (cp.PointContact("hook", (0.1, 0, 0)),
            FrictionCone(0.5, normal=n)),
        "surface": (cp.SurfaceContact("hook"), flat),
        "plane": (PlanarContact("hook", normal=n), round_),
        "wheel": (cp.constraints.RollingWheel("hook", 0.1, axis="y"), round_),
        "omniwheel": (cp.constraints.RollingWheel("hook", 0.1, holds=("rolling", "normal")),
            round_),
        "ball": (RollingBall("hook", 0.1, normal=n),
            FrictionCone(0.5, sides=7)),
        "edge along x": (LineContact("float", "x"), WrenchCone(0.5, 0.1)),
        "edge along y": (LineContact("float", "y", 0.1),
            WrenchCone(0.5, pyramid="outer")),
        "edge along z": (LineContact("upright", "z"),
            WrenchCone(0.5, 0.1, 0.0)),
    }  # fmt: skip


EVERY = contacts_of_every_kind()


def hooked(contact: Constraint) -> tuple[cp.Scene, np.ndarray]:
    """A block with a turned hook, and one with z level, between a loop before and one behind."""
    made = block(0.1).with_frame(
        "hook", "float", [0.1, 0.2, -0.1], pin.rpy.rpyToMatrix(0.3, -0.2, 0.5)
    )
    made = made.with_frame("upright", "float", [0.0] * 3, pin.rpy.rpyToMatrix(0.4, np.pi / 2, 0.0))
    made = made.with_frame("anchor", "world", [0.5, 0.4, 0.3])
    rods = [cp.Loop("float", "anchor", "rod", length=0.6, name=name) for name in ("one", "two")]
    return cp.Scene(made, [rods[0], contact, rods[1]]), tilted("x", 0.0, 0.7)


@pytest.mark.parametrize("label", EVERY)
def test_rows_of_a_scene_are_for_its_lam(label):
    contact, cone = EVERY[label]
    scene, q = hooked(contact)
    rng = np.random.default_rng(0)
    rows = cone_rows(scene, q, cone)
    bound = scene.bounds[1]
    others = np.ones(scene.rows, dtype=bool)
    others[bound.rows] = False
    assert not rows.A[:, others].any()
    assert rows.A.shape == (len(rows.names), scene.rows)
    assert rows.b.shape == (len(rows.names),)
    assert all(name.startswith(f"{contact.name}: ") for name in rows.names)
    for _ in range(20):
        lam = rng.normal(size=scene.rows)
        force = Sites(scene, q).forces(lam)[contact.name]
        margin = cone.margin(force)
        slack = rows.b - rows.A @ lam
        assert abs(slack[0] - margin.pulls) < 1e-12
        if isinstance(cone, WrenchCone):
            assert abs(slack.min() - margin.least) < 1e-12
        other = cone.margin(force.on_other())
        for fault in ("pulls", "slips", "tips", "twists"):
            assert getattr(other, fault) == getattr(margin, fault)


@pytest.mark.parametrize("label", [name for name in EVERY if "edge" not in name])
def test_pull_and_slip_are_those_of_the_force_in_the_world(label):
    contact, cone = EVERY[label]
    scene, q = hooked(contact)
    force = Sites(scene, q).forces(np.random.default_rng(1).normal(size=scene.rows))
    f = force[contact.name].in_world()[:3]
    n = np.array(cone.normal or getattr(contact, "normal", (0.0, 0.0, 1.0)))
    if label == "surface":
        _, placement = scene.robot.frame("hook")
        n = pin.XYZQUATToSE3(q).rotation @ placement.rotation[:, 2]
    n /= np.linalg.norm(n)
    margin = cone.margin(force[contact.name])
    along = n @ f
    assert abs(margin.pulls - along) < 1e-12
    if isinstance(cone, FrictionCone):
        assert abs(margin.slips - 0.5 * along + np.linalg.norm(f - along * n)) < 1e-12
        assert margin.tips == margin.twists == np.inf


@pytest.mark.long
@pytest.mark.parametrize("label", [name for name in EVERY if "edge" in name])
def test_an_edge_is_what_its_two_ends_make(label):
    """Forces at the ends, in the axes of edge and vertical; their wrench in those of the frame."""
    contact, cone = EVERY[label]
    scene, q = hooked(contact)
    _, placement = scene.robot.frame(contact.frame)
    R = pin.XYZQUATToSE3(q).rotation @ placement.rotation
    e = R[:, "xyz".index(contact.axis)]
    floor = np.column_stack([e, np.cross(PLANE, e), PLANE])
    mu = 0.5 if cone.pyramid == "outer" else 0.5 / np.sqrt(2)
    for share, fault in ((0.99, ""), (1.01, "slips")):
        wrench = np.zeros(6)
        for s, pressed in ((1, 1.0), (-1, 0.5)):
            f = pressed * floor @ [mu * share, -mu * share, 1.0]
            wrench += np.concatenate([f, np.cross(s * 0.1 * e, f)])
        components = (wrench.reshape(2, 3) @ R).ravel()
        lam = np.zeros(scene.rows)
        lam[scene.bounds[1].rows] = components[list(scene.bounds[1].selection)]
        margin = cone.margin(Sites(scene, q).forces(lam)[contact.name])
        assert margin.fault == fault
        assert abs(margin.slips - 1.5 * mu * (1 - share)) < 1e-12
        assert abs(margin.tips - 0.5) < 1e-12
        ends = [2 * pressed * mu * (1 - share) for pressed in (1.0, 0.5)]
        assert abs(margin.twists - min(ends)) < 1e-12


def test_an_edge_that_is_off_the_floor_is_refused():
    q = tilted("y", 0.2)
    answer = held(block(), q, LineContact("float", "x", X, name="edge"), cp.PointContact("float"))
    with pytest.raises(cp.InvalidArgument, match=r"edge: the edge is 11\.5 deg off the floor"):
        margins(answer, {"edge": WrenchCone(0.5)})
    margin = margins(answer, {"edge": WrenchCone(0.5, normal=normal(q))})["edge"]
    assert np.isfinite(margin.least)


@pytest.mark.long
def test_turning_everything_about_the_vertical_changes_no_margin():
    talos = robot("talos")
    scene = cp.Scene(talos, talos.contacts)
    q, v = scene.state("half_sitting")
    turned = np.array(q)
    turn = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 1.2), np.array([3.0, -2.0, 0.0]))
    turned[:7] = pin.SE3ToXYZQUAT(turn * pin.XYZQUATToSE3(q[:7]))
    tau = np.random.default_rng(0).normal(size=talos.nv) * 20.0
    tau[:6] = 0.0
    one, two = (margins(cp.solve(scene, at, v, tau), WrenchCone(0.7)) for at in (q, turned))
    assert set(one) == {"left_sole_link", "right_sole_link"}
    for name, margin in one.items():
        assert abs(margin.least - two[name].least) < 1e-6


@pytest.mark.long
def test_loops_are_not_judged_and_contacts_are_judged_by_name():
    scene, cone = on_edges()
    cassie = scene.robot
    q, v = scene.state("standing")
    answer = cp.solve(scene, q, v, cassie.passive_torque(q, v))
    found = margins(answer, cone)
    assert list(found) == [contact.name for contact in cassie.contacts]
    left = cassie.contacts[0].name
    assert list(margins(answer, {left: cone})) == [left]
    rows = cone_rows(scene, q, cone)
    slack = rows.b - rows.A @ answer.lam
    least = min(margin.least for margin in found.values())
    assert abs(slack.min() - least) < 1e-9 * np.abs(answer.lam).max()


# Many states, motions, events


def test_a_batch_is_judged_state_by_state():
    scene, cone = on_points()
    Q, V = cp.simulation.sample_batch(scene, 5, np.random.default_rng(0))
    batch = cp.solve_batch(scene, Q, V, np.zeros(scene.robot.nv))
    found = margins(batch, cone)
    for i, one in enumerate(batch):
        for name, margin in margins(one, cone).items():
            assert found[name].least.shape == (5,)
            assert found[name].least[i] == margin.least
            assert found[name].fault[i] == margin.fault
    assert repr(found["FL_FOOT"]).startswith("Margin(5 forces, ")


def on_points() -> tuple[cp.Scene, FrictionCone]:
    return cp.Scene(robot("solo12"), robot("solo12").contacts), FrictionCone(0.7)


def on_edges() -> tuple[cp.Scene, WrenchCone]:
    cassie = cp.load_robot("cassie", variant={"feet": "lines"})
    return cp.Scene(cassie, [*cassie.loops, *cassie.contacts]), WrenchCone(0.7)


@pytest.mark.long
@pytest.mark.parametrize("standing", [on_points, on_edges])
def test_where_there_is_no_answer_there_is_no_margin(standing):
    scene, cone = standing()
    q, v = scene.state()
    batch = cp.solve_batch(scene, [q, q], [v, v], np.zeros(scene.robot.nv))
    lost = dataclasses.replace(batch, lam=batch.lam * [[1.0], [np.nan]])
    for margin in margins(lost, cone).values():
        assert np.isfinite(margin.least[0])
        assert np.isnan(margin.least[1])
        assert margin.fault[1] == "unknown"
        assert "1 unknown" in repr(margin)


@pytest.mark.long
def test_motions_side_by_side_are_judged_sample_by_sample():
    scene, cone = on_points()
    q, v = scene.state()
    tau, options = np.zeros((2, scene.robot.nv)), {"duration": 0.01, "dt": 1e-3}
    tau[1, 8] = 5.0
    many = cp.simulate_batch(scene, [q, q], [v, v], tau, record=1, **options)
    found = margins(many, cone)
    for i in range(2):
        for name, margin in margins(cp.simulate(scene, q, v, tau[i], **options), cone).items():
            assert found[name].least.shape == (2, len(margin.least))
            assert np.allclose(found[name].least[i], margin.least)
    with pytest.raises(cp.InvalidArgument, match=r"BatchTrajectory: .* keeps them with record="):
        margins(cp.simulate_batch(scene, [q, q], [v, v], tau, **options), cone)


def test_a_block_that_is_pushed_harder_and_harder_slides_at_its_time():
    """mu m g = k t at the event; afterwards the contact is away, and nothing is left to leave."""
    scene = cp.Scene(block(), [SOLE])
    cone, k = WrenchCone(0.5, pyramid="outer"), 40.0
    go = cp.Event(
        name="go",
        when=lambda now: cone.margin(now.forces["sole"]).least,
        scene=cp.Scene(block(), [PlanarContact("float", name="glides")]),
    )
    run = cp.simulate(
        scene, tilted("x", 0.0), np.zeros(6), lambda t, q, v: [k * t, 0.0, 0.0, 0.0, 0.0, 0.0],
        duration=0.4, dt=0.01, events=[go],
    )  # fmt: skip
    assert abs(run.run.happened[0].t - 0.5 * MASS * G / k) < 1e-9
    found = margins(run, {"sole": cone, "glides": FrictionCone(0.0)})
    at = run.phases[1].samples
    assert np.all(np.isinf(found["sole"].least[at]))
    assert np.all(found["sole"].fault == "")
    assert np.all(found["glides"].fault == "")
    assert np.allclose(found["glides"].pulls[at], MASS * G)
    before = run.phases[0].samples
    assert np.allclose(found["sole"].slips[before], 0.5 * MASS * G - k * run.t[before])
    with pytest.raises(
        cp.errors.UnknownName, match="no constraint named 'soul'; did you mean 'sole'"
    ):
        margins(run, {"soul": cone})


def test_a_contact_that_is_away_leaves_no_cone():
    scene = cp.Scene(block(), [SOLE])
    drop = cp.Event(name="drop", at=0.02, scene=cp.Scene(block()))
    run = cp.simulate(
        scene, tilted("x", 0.0), np.zeros(6), duration=0.04, dt=0.01, events=[drop]
    )  # fmt: skip
    margin = margins(run, WrenchCone(0.5))["sole"]
    away = run.phases[1].samples
    assert np.all(margin.least[away] == np.inf)
    assert np.allclose(margin.pulls[run.phases[0].samples], MASS * G)
    assert repr(margin) == f"Margin({len(run)} forces, 6.937 N at least: no faults)"


@pytest.mark.long
def test_no_states_have_no_margins():
    scene = cp.Scene(block(), [SOLE])
    none = cp.solve_batch(scene, np.zeros((0, 7)), np.zeros((0, 6)), np.zeros(6))
    margin = margins(none, WrenchCone(0.5))["sole"]
    assert margin.least.shape == margin.fault.shape == (0,)
    assert repr(margin) == "Margin(0 forces, inf N at least: no faults)"


@pytest.mark.long
def test_impulses_and_inverse_dynamics_are_judged_too():
    talos = robot("talos")
    scene = cp.Scene(talos, talos.contacts)
    q, _ = scene.state("half_sitting")
    cone = WrenchCone(0.7)
    standing = margins(cp.control.gravity_compensation(scene, q), cone)
    assert all(margin.fault == "" for margin in standing.values())
    assert abs(sum(m.pulls for m in standing.values()) - talos.mass * G) < 1e-5 * talos.mass * G
    v = np.zeros(talos.nv)
    v[2] = -1.0
    for margin in margins(cp.impact(scene, q, v), cone).values():
        assert margin.pulls > 0


# Values, and what is refused


@pytest.mark.long
def test_cones_are_values():
    cone = WrenchCone(0.7, X, Y, normal=(0, 0, 2))
    assert cone == pickle.loads(pickle.dumps(cone)) == WrenchCone(0.7, X, Y, normal=(0.0, 0, 1))
    assert len({cone, WrenchCone(0.7, X, Y)}) == 2
    assert FrictionCone(1) == FrictionCone(1.0)
    rounded = WrenchCone(np.float32(0.5), np.float32(0.25), 1)
    assert rounded == WrenchCone(0.5, 0.25, 1.0)
    assert type(rounded.half_length) is type(rounded.half_width) is float


@each_row(
    ("make", "message"),
    [
        (lambda: FrictionCone(-0.1), r"friction = -0\.1: a coefficient is not negative"),
        (lambda: FrictionCone(np.nan), "friction = nan: finite numbers are needed"),
        (lambda: FrictionCone(np.inf), "friction = inf: finite numbers are needed"),
        (lambda: FrictionCone("rough"), "friction = 'rough': one finite number is needed"),
        (lambda: FrictionCone(1e60), "no machine has that"),
        (lambda: FrictionCone(0.5, normal=(0, 0, 0)), "a direction is needed"),
        (lambda: FrictionCone(0.5, normal=(0, 0)), "3 finite numbers are needed"),
        (lambda: FrictionCone(0.5, sides=2), "sides = 2: a whole number of at least 3"),
        (lambda: FrictionCone(0.5, sides=4.0), r"sides = 4\.0: a whole number of at least 3"),
        (lambda: FrictionCone(0.5, sides=10**9), "at most 1000, round to 5e-6"),
        (lambda: FrictionCone(0.5, pyramid="round"), "inner or outer is needed"),
        (lambda: FrictionCone(0.5, pyramid=np.zeros(2)), "inner or outer is needed"),
        (lambda: FrictionCone(0.5).margin([0.0, 0.0, 1e300]), "force = 1e.300: no machine"),
        (lambda: WrenchCone(0.5, X, 1e-320), "1 / half_width = inf: no machine has that"),
        (lambda: WrenchCone(0.5, 0.0, Y), r"half_length = 0\.0: a positive length"),
        (lambda: WrenchCone(0.5, -X, Y), "half_length = -0.3: a positive length"),
        (lambda: WrenchCone(0.5, X, np.nan), "half_width = nan: a positive length"),
        (lambda: WrenchCone(0.5, X).rows(), "half_width = None: neither the cone"),
        (lambda: WrenchCone(0.5, X, Y).margin(np.zeros(3)), r"force has shape \(3,\)"),
        (lambda: WrenchCone(0.5, X, 0).margin(np.ones(6)), "no moment about itself"),
        (lambda: FrictionCone(0.5).margin([0.0, np.nan, 1.0]), r"force\[1\] = nan"),
        (lambda: FrictionCone(0.5).margin(1.0), "force has shape"),
        (lambda: FrictionCone(0.5).margin(None), "force has shape|force: an array"),
        (lambda: FrictionCone(0.5).margin([[1.0, 2.0], [3.0]]), "force: an array of shape"),
    ],
)
def test_bad_numbers_are_refused(make, message):
    with pytest.raises(cp.InvalidArgument, match=message):
        make()


@each_row(
    ("contact", "cone", "message"),
    [
        (
            SOLE,
            FrictionCone(0.5),
            r"can also tip and twist; WrenchCone\(0.5\) takes that",
        ),
        (cp.PointContact("float"), WrenchCone(0.5, X, Y), "presses at a point; use FrictionCone"),
        (cp.SurfaceContact("float"), WrenchCone(0.5), "neither the cone nor its contact"),
        (cp.SurfaceContact("float"), WrenchCone(0.5, X, 0.0), "it is 0 for a LineContact"),
        (LineContact("float"), WrenchCone(0.5, X, Y), "it is 0 for a LineContact"),
        (SOLE, WrenchCone(0.5, normal=(0, 0, 1)), "has its own normal"),
        (PlanarContact("float"), FrictionCone(0.5, normal=(0, 0, 1)), "has its own normal"),
        (
            KnifeEdge("float", name="knife"),
            FrictionCone(0.5),
            "knife: this KnifeEdge does not press",
        ),
        (
            cp.constraints.RollingWheel("float", 0.1, holds=("rolling",), name="wheel"),
            FrictionCone(0.5),
            "wheel: this RollingWheel does not press",
        ),
    ],
)
def test_a_cone_that_is_not_for_a_contact_is_refused(contact, cone, message):
    scene = cp.Scene(block(), [contact])
    q = tilted("x", 0.0)
    with pytest.raises(cp.InvalidArgument, match=message):
        cone_rows(scene, q, {contact.name: cone})
    answer = cp.solve(scene, q, np.zeros(6), np.zeros(6), solver=cp.dynamics.NullSpace())
    with pytest.raises(cp.InvalidArgument, match=message):
        margins(answer, {contact.name: cone})
    with pytest.raises(cp.InvalidArgument, match=message):
        cone.margin(answer.forces[contact.name])


def test_what_has_no_contact_is_refused():
    bar = robot("four_bar")
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    answer = cp.solve(scene, q, v, np.zeros(bar.nv))
    cone = FrictionCone(0.5)
    with pytest.raises(cp.InvalidArgument, match="no contact to judge"):
        margins(answer, cone)
    with pytest.raises(cp.InvalidArgument, match="no contact to judge"):
        cone_rows(scene, q, {})
    name = scene.names[0]
    with pytest.raises(cp.InvalidArgument, match=f"{name}: this Loop does not press on a floor"):
        cone_rows(scene, q, {name: cone})
    with pytest.raises(cp.InvalidArgument, match=r"cones = 0\.5: a FrictionCone or a WrenchCone"):
        margins(answer, 0.5)
    with pytest.raises(cp.InvalidArgument, match="answer = ndarray: it has no contact forces"):
        margins(answer.lam, cone)
    with pytest.raises(cp.InvalidArgument, match="scene = Solution: a Scene is needed"):
        cone_rows(answer, q, cone)
    coupled = cp.Scene(bar, [cp.constraints.Coupling("crank", "coupler", name="gear")])
    with pytest.raises(cp.InvalidArgument, match="gear: this Coupling does not press on a floor"):
        cone_rows(coupled, q, {"gear": cone})


def test_without_gravity_there_is_no_vertical_and_a_normal_says_where_the_floor_is():
    model = block().model.copy()
    model.gravity = pin.Motion.Zero()
    scene = cp.Scene(cp.Robot("adrift", model), [cp.PointContact("float")])
    with pytest.raises(cp.InvalidArgument, match="no gravity, so no vertical"):
        cone_rows(scene, tilted("x", 0.0), FrictionCone(0.5))
    rows = cone_rows(scene, tilted("x", 0.0), FrictionCone(0.5, normal=(0, 1, 0)))
    assert np.allclose(rows.A[0], [0.0, -1.0, 0.0])
    ceiling = cone_rows(scene, tilted("x", 0.0), FrictionCone(0.5, normal=(0, 0, -1)))
    assert np.allclose(ceiling.A[0], [0.0, 0.0, 1.0])
