"""Balance: closed forms, two routes to one point, regions of support, and where none is valid."""

from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin
import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.contact import FrictionCone, WrenchCone
from condyn_pin.control import SupportPolygon, balance, support_polygon
from condyn_pin.mechanism import project_velocity, without

G, MASS = 9.81, 2.0
X, Y, HEIGHT = 0.3, 0.2, 0.5  # half the size of the block, and how high its centre is [m]


@functools.cache
def block(x: float = 0.0, y: float = 0.0) -> cp.Robot:
    """A free block with its centre of mass above x, y [m] of its sole, by default the middle."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "float")
    model.addJointFrame(joint)
    inertia = pin.Inertia(MASS, np.array([x, y, HEIGHT]), 0.05 * np.eye(3))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return cp.Robot("block", model)


SOLE = cp.SurfaceContact("float", X, Y, name="sole")
CORNERS = ((-X, -Y), (X, -Y), (X, Y), (-X, Y))
Q = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
STILL = np.zeros(6)


def solved(scene: cp.Scene, q: np.ndarray, tau: np.ndarray) -> cp.dynamics.Solution:
    return cp.solve(scene, q, np.zeros(scene.robot.nv), tau)


def test_a_block_that_is_pushed_presses_where_levers_say():
    """A push F at the height H moves the pressure by F H / (m g)."""
    scene = cp.Scene(block(), [SOLE])
    push = cp.AppliedForce("float", [3.0, -2.0, 0.0, 0.0, 0.0, 0.0])  # at the sole: no lever
    moment = cp.AppliedForce("float", [0.0, 0.0, 0.0, 1.2, 2.5, 0.0])
    now = cp.solve(scene, Q, STILL, STILL, forces=[push, moment])
    found = balance(scene, Q, STILL, now.a, now.lam)
    assert np.allclose(found.cops["sole"], [2.5 / (MASS * G), -1.2 / (MASS * G), 0.0], atol=1e-12)
    assert np.allclose(found.cop, found.cops["sole"])
    assert np.allclose(found.zmp, [0.0, 0.0, 0.0], atol=1e-12)  # the motion is rest
    assert np.allclose(found.missing, [3.0, -2.0, 0.0, 1.2, 2.5, 0.0], atol=1e-12)
    assert np.allclose(found.force, [0.0, 0.0, MASS * G])


def test_capture_point_and_dcm_of_a_pendulum():
    """c + v sqrt(h / g); it is captured where that is within the sole."""
    scene = cp.Scene(block(), [SOLE])
    v = np.array([0.4, -0.3, 0.1, 0.0, 0.0, 0.0])
    found = balance(scene, Q, v, STILL, np.zeros(6))
    reach = np.sqrt(HEIGHT / G)
    assert np.allclose(found.dcm, [0.4 * reach, -0.3 * reach, HEIGHT + 0.1 * reach])
    assert np.allclose(found.capture_point, [0.4 * reach, -0.3 * reach, 0.0])
    assert found.capture_margin == pytest.approx(min(X - 0.4 * reach, Y - 0.3 * reach))
    assert np.isnan(found.cop).all()  # nothing presses
    assert np.isnan(found.cops["sole"]).all()
    fast = balance(scene, Q, 10 * v, STILL, np.zeros(6))
    assert fast.capture_margin < -0.3


@pytest.mark.long
def test_zmp_of_an_acceleration():
    """-h a / g for a mass at the height h that is not turned."""
    scene = cp.Scene(block(), [SOLE])
    a = np.array([1.5, -0.5, 0.0, 0.0, 0.0, 0.0])
    found = balance(scene, Q, STILL, a, np.zeros(6))
    assert np.allclose(found.zmp, [-HEIGHT * 1.5 / G, HEIGHT * 0.5 / G, 0.0], atol=1e-12)
    inside = HEIGHT * 1.5 / G
    assert found.zmp_margin == pytest.approx(min(X - inside, Y - HEIGHT * 0.5 / G))
    tips = balance(scene, Q, STILL, 10 * a, np.zeros(6))
    assert tips.zmp_margin < 0


@pytest.mark.long
@pytest.mark.parametrize("name", ["solo12", "talos", "hyq"])
@pytest.mark.parametrize("up", [0.0, 1e-9, -2.0])
def test_in_the_air_no_point_is_the_centre_of_pressure(name, up):
    """A fall that is free, to rounding, or faster: f is zero, or pulls, and 0 / 0 is no point."""
    made = robot(name)
    scene = cp.Scene(made, made.contacts)
    q, v = scene.state()
    rng = np.random.default_rng(0)
    for turning in (0.0 * v, np.concatenate((np.zeros(3), rng.normal(size=3), v[6:]))):
        tau = np.concatenate((np.zeros(6), rng.normal(size=made.nv - 6)))
        a = cp.solve(cp.Scene(made), q, turning, tau).a  # nothing touches
        a[2] += up  # the base is level
        found = balance(scene, q, turning, a, 1e-14 * rng.normal(size=scene.rows))
        assert np.isnan(found.zmp).all()
        assert np.isnan(found.zmp_margin)
        assert np.isnan(found.cop).all()


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.3, -0.2, 0.0])])
def test_zmp_is_the_centre_of_pressure_on_any_plane(turn):
    """By the motion and by the forces; the plane may lean."""
    model, R = block().model, pin.exp3(turn)
    q = pin.SE3ToXYZQUAT(pin.SE3(R, np.array([0.1, 0.2, 0.3])))
    scene = cp.Scene(block(), [SOLE])
    rng = np.random.default_rng(0)
    for _ in range(5):
        tau = np.concatenate((R.T @ [0, 0, 30.0], rng.normal(size=3)))
        now = solved(scene, q, np.zeros(6))
        # what acts beside the floor is put into the motion: it needs this much more from it
        whole = balance(scene, q, np.zeros(6), now.a, now.lam)
        assert np.abs(whole.missing).max() < 1e-10
        assert np.abs(whole.zmp - whole.cop).max() < 1e-10
        assert tau.shape == (model.nv,)
    assert np.abs((whole.zmp - q[:3]) @ R[:, 2]) < 1e-12  # on the plane


@pytest.mark.long
@pytest.mark.parametrize("name", ["solo12", "talos"])
def test_zmp_is_the_centre_of_pressure_of_robots_in_motion(name):
    made = robot(name)
    contacts = made.contacts[:1] if name == "talos" else made.contacts
    scene = cp.Scene(made, contacts)
    q, _ = scene.state()
    rng = np.random.default_rng(1)
    for _ in range(5):
        v = project_velocity(scene, q, 0.3 * rng.normal(size=made.nv))
        tau = np.concatenate((np.zeros(6), rng.normal(size=made.nv - 6)))
        now = cp.solve(scene, q, v, tau)
        found = balance(scene, q, v, now.a, now.lam)
        size = np.abs(found.force).max()
        assert np.abs(found.missing).max() < 1e-9 * size
        if found.force[2] > 0.2 * made.mass * G and np.isfinite(found.cop).all():
            pressing = min(force.in_world()[2] for force in now.forces.values())
            if pressing > 0:
                assert np.abs(found.zmp - found.cop).max() < 1e-9
        assert np.isfinite(found.zmp).all() == (found.force @ found.polygon.plane.axes[2] > 0)


def test_a_polygon_by_hand():
    scene = cp.Scene(block(), [SOLE])
    polygon = support_polygon(scene, Q)
    assert isinstance(polygon, SupportPolygon)
    assert np.allclose(np.sort(polygon.corners, axis=0), np.sort(CORNERS, axis=0))
    assert np.allclose(polygon.in_world[:, 2], 0.0)
    assert polygon.margin([0.0, 0.0, 7.0]) == pytest.approx(Y)
    assert polygon.margin([X, 0.0, 0.0]) == pytest.approx(0.0, abs=1e-12)
    assert polygon.margin([X + 0.3, Y + 0.4, 0.0]) == pytest.approx(-0.5)
    edge = cp.Scene(block(), [cp.constraints.LineContact("float", half_length=X)])
    assert len(support_polygon(edge, Q).corners) == 2
    assert support_polygon(edge, Q).margin([0.0, 0.1, 0.0]) == pytest.approx(-0.1)
    point = cp.Scene(block(), [cp.PointContact("float")])
    assert support_polygon(point, Q).margin([0.3, 0.4, 0.0]) == pytest.approx(-0.5)


def test_on_level_ground_the_two_polygons_are_one():
    """The resting region of much friction is the hull."""
    made = robot("solo12")
    scene = cp.Scene(made, made.contacts)
    for chosen in (scene, without(scene, ["FL_FOOT"])):
        q, _ = scene.state()
        hull = support_polygon(chosen, q)
        rest = support_polygon(chosen, q, FrictionCone(0.6, sides=8))
        assert len(hull.corners) == len(rest.corners)
        for corner in rest.in_world:
            assert abs(hull.margin(corner)) < 1e-9
    sole = cp.Scene(block(), [SOLE])
    rest = support_polygon(sole, Q, WrenchCone(0.5))
    assert np.allclose(np.sort(rest.corners, axis=0), np.sort(CORNERS, axis=0), atol=1e-9)


def step_between(height: float) -> cp.Scene:
    """The block on four points, one of them higher than the others."""
    points = [cp.PointContact("float", offset=(*xy, 0.0), name=str(i)) for i, xy in
              enumerate(CORNERS[:3])]  # fmt: skip
    high = cp.PointContact("float", offset=(*CORNERS[3], height), name="high")
    return cp.Scene(block(), [*points, high])


@pytest.mark.long
def test_uneven_ground_has_a_region_where_the_mass_can_rest():
    """Without friction, and with normals that are level: the hull, whatever the heights."""
    rest = support_polygon(step_between(0.2), Q, FrictionCone(0.0))
    assert np.allclose(np.sort(rest.in_world[:, :2], axis=0), np.sort(CORNERS, axis=0), atol=1e-9)
    assert rest.plane.axes[2] == pytest.approx([0.0, 0.0, 1.0])


def on_floors(left: float, right: float, friction: float) -> SupportPolygon:
    """Two points at x = -X and X, on floors whose normals are turned by angles about y."""
    names = ("left", "right")
    sides = [
        cp.PointContact("float", offset=(x, 0.0, 0.0), name=name)
        for name, x in zip(names, (-X, X), strict=True)
    ]
    cones = {
        name: FrictionCone(friction, normal=(np.sin(turn), 0.0, np.cos(turn)), pyramid="outer")
        for name, turn in zip(names, (left, right), strict=True)
    }
    return support_polygon(cp.Scene(block(), sides), Q, cones)


def test_leaning_floors_by_hand():
    """Two floors that lean against each other press alike: without friction, the mass is halfway.

    With friction it can be elsewhere; and where friction is more than 90 deg less the lean, points
    press against each other and hold the mass anywhere. On a slope there is friction or nothing.
    """
    for sign in (1.0, -1.0):
        middle = on_floors(sign * 0.4, -sign * 0.4, 0.0)
        assert np.allclose(middle.in_world, 0.0, atol=1e-9)
        assert len(middle.corners) == 1
        # one presses along an edge of its cone at 0.5 rad, the other at 0.3
        rough = on_floors(sign * 0.4, -sign * 0.4, np.tan(0.1))
        share = X * (np.tan(0.5) - np.tan(0.3)) / (np.tan(0.5) + np.tan(0.3))
        assert np.abs(rough.corners[:, 0]).max() == pytest.approx(share)
    assert np.ptp(on_floors(1.0, -1.0, 1.0).corners[:, 0]) > 100.0
    assert len(on_floors(0.4, 0.4, 0.99 * np.tan(0.4)).corners) == 0
    assert np.isneginf(on_floors(0.4, 0.4, 0.0).margin([0.0, 0.0, 0.0]))
    assert np.ptp(on_floors(0.4, 0.4, 1.01 * np.tan(0.4)).corners[:, 0]) == pytest.approx(2 * X)


def test_a_corner_of_the_resting_region_is_where_forces_end():
    """Beside it equilibrium has no forces: the wrench is outside of the contact wrench cone."""
    scene, cone = step_between(0.15), FrictionCone(0.5, sides=6)
    region = support_polygon(scene, Q, cone)
    middle = region.in_world.mean(axis=0)
    for corner in region.in_world:
        for share, sign in ((0.99, 1.0), (1.01, -1.0)):
            at = middle + share * (corner - middle)
            moved = block(*at[:2])
            placed = cp.Scene(moved, scene.constraints)
            found = balance(placed, Q, STILL, STILL, np.zeros(12), cones=cone)
            assert np.sign(found.wrench_margin) == sign, (corner, share)


def test_on_uneven_ground_zmp_does_not_exist():
    scene = step_between(0.2)
    found = balance(scene, Q, STILL, STILL, np.zeros(12), cones=FrictionCone(0.5))
    assert found.polygon is None
    for nothing in (found.zmp, found.cop, found.dcm, found.capture_point, found.zmp_margin):
        assert np.isnan(nothing).all()
    assert np.isfinite(found.wrench_margin)
    assert "uneven ground" in repr(found)
    with pytest.raises(cp.InvalidArgument, match=r"not on one plane: support_polygon\(scene, q, "):
        support_polygon(scene, Q)


def test_the_wrench_margin_by_hand():
    """At rest on a sole of four corners: a quarter of the weight each, times what is left."""
    scene = cp.Scene(block(), [SOLE])
    cone = WrenchCone(0.5)
    now = solved(scene, Q, STILL)
    found = balance(scene, Q, STILL, now.a, now.lam, cones=cone)
    rows = cp.contact.cone_rows(scene, Q, cone)
    assert found.wrench_margin == pytest.approx(float(-(rows.A @ now.lam).max()), rel=1e-9)
    falling = balance(scene, Q, STILL, np.array([0, 0, -11.0, 0, 0, 0]), now.lam, cones=cone)
    assert falling.wrench_margin < 0


@pytest.mark.parametrize("pyramid", ["inner", "outer"])
def test_a_wrench_cone_holds_what_forces_at_its_corners_can_give(pyramid):
    """By linear programs over the wrench, and over four pyramids."""
    sole = cp.Scene(block(), [SOLE])
    corners = cp.Scene(block(), SOLE.corners())
    rng = np.random.default_rng(0)
    seen = {True: 0, False: 0}
    for _ in range(60):
        a = rng.normal(size=6) * (1.5, 1.5, 4.0, 8.0, 8.0, 20.0)
        one = balance(sole, Q, STILL, a, np.zeros(6), cones=WrenchCone(0.5, pyramid=pyramid))
        cone = FrictionCone(0.5, sides=4, pyramid=pyramid)
        four = balance(corners, Q, STILL, a, np.zeros(12), cones=cone)
        assert np.allclose(one.force, four.force)
        if abs(one.wrench_margin) < 1e-6:
            continue
        seen[bool(one.wrench_margin > 0)] += 1
        assert (one.wrench_margin > 0) == (four.wrench_margin > 0)
    assert min(seen.values()) > 8


def test_what_is_wrong_is_named():
    scene = cp.Scene(block(), [SOLE])
    with pytest.raises(cp.InvalidArgument, match="lam has shape"):
        balance(scene, Q, STILL, STILL, np.zeros(5))
    with pytest.raises(cp.InvalidArgument, match="finite numbers"):
        balance(scene, Q, STILL, np.full(6, np.nan), np.zeros(6))
    with pytest.raises(cp.InvalidArgument, match="nothing in this scene presses on a floor"):
        balance(cp.Scene(block()), Q, STILL, STILL, np.zeros(0))
    unsized = cp.Scene(block(), [cp.SurfaceContact("float", name="sole")])
    with pytest.raises(cp.InvalidArgument, match="half_length or half_width is not set"):
        support_polygon(unsized, Q)
    with pytest.raises(cp.InvalidArgument, match=r"v has numbers up to 1e\+200"):
        balance(scene, Q, STILL + 1e200, STILL, np.zeros(6))
    with pytest.raises(cp.InvalidArgument, match=r"a has numbers up to 1e\+308"):
        balance(scene, Q, STILL, STILL + 1e308, np.zeros(6))


def test_contacts_that_may_open_are_not_left_out_in_silence():
    made = block()
    foot = cp.FrictionalContact("float", friction=0.5)
    for scene in (cp.Scene(made, contacts=[foot]), cp.Scene(made, [SOLE], contacts=[foot])):
        with pytest.raises(cp.errors.UnsupportedConstraint, match="1 contact may open"):
            balance(scene, Q, STILL, STILL, np.zeros(scene.rows))
        with pytest.raises(cp.errors.UnsupportedConstraint, match="1 contact may open"):
            support_polygon(scene, Q)


# Capturability


def stops(v: float, d: float, h: float, mu: float) -> bool:
    """Whether the inverted pendulum, braked as well as it can be, turns back before the edge."""
    c, dt = 0.0, 1e-5
    while v > 0 and c < d:
        a = G / h * (c - min(d, c + mu * h))
        c, v = c + dt * v + a * dt**2 / 2, v + dt * a
    return c < d


@pytest.mark.parametrize(("d", "h", "mu"), [(0.1, 0.9, np.inf), (0.1, 0.9, 0.05), (0.25, 0.2, 0.7)])
def test_a_pendulum_stops_from_speeds_below_the_capturable_one(d, h, mu):
    speed = cp.control.capturable_speed(d, h, friction=mu)
    assert stops(0.998 * speed, d, h, mu)
    assert not stops(1.002 * speed, d, h, mu)


def test_what_no_friction_and_no_reach_leave_is_nothing():
    assert cp.control.capturable_speed(0.1, 1.0, friction=0.0) == 0.0
    assert cp.control.capturable_speed(-0.1, 1.0) == 0.0
    assert cp.control.capturable_speed(0.1, 0.9) == pytest.approx(0.1 * np.sqrt(G / 0.9))
    wrongs = ({"height": 0.0}, {"reach": np.nan}, {"friction": -0.1}, {"friction": np.nan})
    for wrong in (*wrongs, {"reach": 1e308, "height": 1e-300}):
        with pytest.raises(cp.InvalidArgument, match=next(iter(wrong))):
            cp.control.capturable_speed(**{"reach": 0.1, "height": 1.0, **wrong})
