"""Contacts at their own times: events located, and what an integrator keeps of its order."""

from __future__ import annotations

from itertools import pairwise
from math import atan2, cos, hypot, pi, sin, sqrt
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import condyn_pin as cp
from condyn_pin.constraints import (
    Ball,
    Box,
    Capsule,
    FrictionalContact,
    JointFriction,
    JointLimit,
    Plane,
    Point,
)
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact import Lemke
from condyn_pin.dynamics import contact_gaps
from condyn_pin.model import free_ball, free_box, painleve_rod
from condyn_pin.simulation.events import EventRecord
from condyn_pin.stepping import EventDriven

G = 9.81
LOCATED = EventDriven()


def bouncing(restitution: float = 0.8) -> tuple[cp.Scene, np.ndarray]:
    ball = free_ball(mass=1.0, radius=0.05)
    touch = FrictionalContact("ball", Ball(0.05), friction=0.2, restitution=restitution)
    return cp.Scene(ball, contacts=[touch]), np.array([0, 0, 0.55, 0, 0, 0, 1.0])


def box_scene(friction: float, slope: float = 0.0) -> tuple[cp.Scene, np.ndarray]:
    """A box of 1 kg on four points, on a plane through the origin that rises along x."""
    box = free_box(mass=1.0, size=(0.2, 0.2, 0.1))
    plane, R = Plane(normal=(-sin(slope), 0, cos(slope))), pin.utils.rotate("y", -slope)
    touch = FrictionalContact("box", Box(0.1, 0.1, 0.05), friction=friction, on=plane)
    # its upper corners are further away than any motion here
    return cp.Scene(box, contacts=[touch]), np.r_[R @ (0, 0, 0.05), pin.Quaternion(R).coeffs()]


def slider(*, limits: tuple[float, float] = (-1.0, 1.0)) -> cp.Robot:
    """A mass of 1 kg on a rail."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "rail")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = limits
    return cp.Robot("slider", model)


def named(run: cp.Trajectory, what: str) -> list[EventRecord]:
    return [event for event in run.run.happened if event.name.startswith(what)]


@pytest.mark.parametrize("dt", [0.1, 7e-3])
def test_a_ball_bounces_at_its_own_times(dt: float) -> None:
    scene, q = bouncing()
    run = cp.simulate(scene, q, np.zeros(6), duration=0.6, dt=dt, integrator=LOCATED)
    t0 = sqrt(2 * 0.5 / G)
    (hit,) = run.run.happened
    assert_allclose(hit.t, t0, atol=1e-12)
    assert_allclose(hit.t, 0.319275, atol=5e-7)
    assert_allclose(hit.impulses[0][1:], (0, 0, 1.8 * G * t0), atol=1e-12)
    assert_allclose(hit.energy_lost, 0.36 * G * 0.5, rtol=1e-12)
    s = 0.6 - t0
    height = 0.8 * G * t0 * s - G * s**2 / 2
    assert_allclose(run.q[-1, 2] - 0.05, height, atol=1e-12)
    assert_allclose(height, 0.316859, atol=5e-7)
    assert_allclose(run.energy.contact[-1], -0.36 * G * 0.5, rtol=1e-12)
    assert np.abs(run.energy.error).max() < 1e-12
    # both samples of the instant
    assert run.t[hit.sample] == run.t[hit.sample - 1] == hit.t
    assert_allclose(run.v[hit.sample, 2], -0.8 * run.v[hit.sample - 1, 2], rtol=1e-12)


@pytest.mark.parametrize("off", [-1e-14, 0.0, 1e-15, 1e-13, 1e-10])
def test_an_event_at_the_end_of_a_step_is_one_event(off: float) -> None:
    scene, q = bouncing()
    t0 = sqrt(2 * 0.5 / G)
    dt = t0 / 8 * (1 + off)
    run = cp.simulate(scene, q, np.zeros(6), duration=12 * dt, dt=dt, integrator=LOCATED)
    assert len(run.run.happened) == 1
    assert_allclose(run.energy.contact[-1], -0.36 * G * 0.5, rtol=1e-12)
    assert np.abs(run.energy.error).max() < 1e-12
    assert (np.diff(run.t) >= 0).all()
    hit = run.run.happened[0]
    assert run.t[hit.sample] == run.t[hit.sample - 1]
    for phase in run.phases:
        assert (np.diff(run.t[phase.samples]) > 0).all()


def test_bounces_without_end_come_to_rest() -> None:
    scene, q = bouncing()
    run = cp.simulate(scene, q, np.zeros(6), duration=3.0, dt=1e-2, integrator=LOCATED)
    hits = run.run.happened
    peaks = [G * (b.t - a.t) ** 2 / 8 for a, b in pairwise(hits[:3])]
    assert_allclose(peaks, (0.32, 0.2048), atol=1e-12)
    assert_allclose(hits[-1].t, 9 * sqrt(1 / G), atol=4.5e-7)  # the last 1e-7 s of a bounce
    assert_allclose(hits[-1].t, 2.873479, atol=1e-6)
    assert hits[-1].modes == (("ball", "open", "stick"),)
    assert not run.v[-1].any()
    assert abs(run.q[-1, 2] - 0.05) < 1e-12
    # another limit, another number of bounces
    coarse = EventDriven(shortest_bounce=1e-2)
    short = cp.simulate(scene, q, np.zeros(6), duration=3.0, dt=1e-2, integrator=coarse)
    assert 10 < len(short.run.happened) < 25 < len(hits)


@pytest.mark.parametrize("dt", [1e-2, 3e-3])
def test_a_box_slides_and_stops(dt: float) -> None:
    scene, q = box_scene(0.5)
    v = np.array([cos(0.3), sin(0.3), 0, 0, 0, 0])
    run = cp.simulate(scene, q, v, duration=0.25, dt=dt, integrator=LOCATED)
    x, y = run.q[-1, :2]
    assert_allclose((hypot(x, y), atan2(y, x)), (0.101937, 0.3), atol=5e-7)
    assert_allclose((hypot(x, y), atan2(y, x)), (1 / G, 0.3), atol=1e-12)
    (stop,) = run.run.happened
    assert_allclose(stop.t, 2 / G, atol=1e-12)
    assert len(stop.modes) == 4
    assert {mode[1:] for mode in stop.modes} == {("slide", "stick")}
    assert_allclose(run.energy.contact[-1], -0.5, atol=1e-12)
    assert np.abs(run.energy.error).max() < 1e-12


@pytest.mark.parametrize("friction", [0.3, 0.5773, 0.57736, 0.8])
def test_a_box_on_a_slope(friction: float) -> None:
    """At 0.5773 it begins to slide so slowly that its direction is stiff."""
    scene, q = box_scene(friction, pi / 6)
    run = cp.simulate(scene, q, np.zeros(6), duration=0.1, dt=1e-2, integrator=LOCATED)
    a = max(G * (sin(pi / 6) - friction * cos(pi / 6)), 0.0)
    assert_allclose(run.v[-1], (-0.1 * a, 0, 0, 0, 0, 0), atol=1e-10)
    below = [str(modes[-1]) for modes in run.modes.values() if modes[-1] != "open"]
    assert below == ["slide" if a else "stick"] * 4
    if friction == 0.3:
        assert_allclose(a, 2.35629, atol=5e-6)


@pytest.mark.long
def test_a_box_goes_up_a_slope_and_comes_back() -> None:
    scene, q = box_scene(0.3, pi / 6)
    v = np.array([1.0, 0, 0, 0, 0, 0])
    run = cp.simulate(scene, q, v, duration=0.4, dt=1e-2, integrator=LOCATED)
    up, down = (G * (sin(pi / 6) + s * 0.3 * cos(pi / 6)) for s in (1, -1))
    way = 0.5 / up - down * (0.4 - 1 / up) ** 2 / 2
    assert_allclose((run.q[-1, :3] - q[:3]) @ (cos(pi / 6), 0, sin(pi / 6)), way, atol=1e-12)


def pushed(dt: float, inner: cp.simulation.Integrator) -> tuple[float, float, float, float]:
    """A box under a force that grows and falls: it sticks, slips, and sticks again.

    Returns where it is, the times of its events, and the error of the energy balance.
    """
    scene, q = box_scene(0.5)

    def tau(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([8 * sin(5 * t), 0, 0, 0, 0, 0])

    run = cp.simulate(
        scene, q, np.zeros(6), tau, duration=0.72, dt=dt, integrator=EventDriven(inner)
    )
    assert run.status.ok, run.reason
    names = [event.name.split()[0] for event in run.run.happened]
    assert names == ["slip", "stick"]
    times = (event.t for event in run.run.happened)
    return run.q[-1, 0], *times, np.abs(run.energy.error).max()


def test_the_order_is_kept_between_events_and_across_them() -> None:
    slip = float(np.arcsin(0.5 * G / 8) / 5)

    def speed(t: float) -> float:
        return 8 / 5 * (cos(5 * slip) - cos(5 * t)) - 0.5 * G * (t - slip)

    stick = brentq(speed, 0.4, 0.72, xtol=1e-15)
    s = stick - slip
    way = 8 / 5 * (cos(5 * slip) * s - (sin(5 * stick) - sin(5 * slip)) / 5) - G * s**2 / 4
    errors = []
    for dt in (0.04, 0.02):
        x, begins, ends, energy = pushed(dt, cp.RungeKutta4())
        assert_allclose(begins, slip, atol=1e-12)  # nothing moves before
        errors.append((abs(x - way), abs(ends - stick), energy))
    orders = np.log2(np.divide(*errors))
    assert (orders > 3.7).all(), (errors, orders)
    assert max(errors[1][:2]) < 1e-7
    fine = cp.simulation.DormandPrince(relative_tolerance=1e-12, absolute_tolerance=1e-13)
    assert_allclose(pushed(0.06, fine)[:3], (way, slip, stick), atol=1e-10)


def test_a_ball_slides_until_it_rolls() -> None:
    ball = free_ball(radius=0.05)
    scene = cp.Scene(ball, contacts=[FrictionalContact("ball", Ball(0.05), friction=0.2)])
    q, v = scene.state("resting")
    v[0] = 1.0
    rolls = 2 / (7 * 0.2 * G)
    way = rolls - 0.1 * G * rolls**2 + 5 / 7 * (0.4 - rolls)
    for dt in (1e-2, 5e-3):  # it goes straight ahead, exactly
        run = cp.simulate(scene, q, v, duration=0.4, dt=dt, integrator=LOCATED)
        assert abs(run.q[-1, 0] - way) < 1e-13
        assert_allclose(named(run, "stick")[0].t, rolls, atol=1e-7)


@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_slip_that_turns_comes_to_its_end(slope: float) -> None:
    """Its direction turns the faster the slower it is; by an adaptive method as by steps."""
    scene, q = box_scene(0.5, slope)
    v = np.array([0.3, 0.1, 0, 0, 0, 3.0]) if not slope else np.array([0, 0.5, 0, 0, 0, 0])
    fine = EventDriven(
        cp.simulation.DormandPrince(relative_tolerance=1e-11, absolute_tolerance=1e-12)
    )
    runs = [
        cp.simulate(scene, q, v, duration=0.2, dt=dt, integrator=integrator)
        for dt, integrator in ((1e-2, fine), (1e-2, LOCATED), (2.5e-3, LOCATED))
    ]
    assert [event.name.split()[0] for event in runs[0].run.happened] == ["stick"]
    coarse, near = (np.abs(run.q[-1] - runs[0].q[-1]).max() for run in runs[1:])
    assert coarse < 1e-6
    assert near < coarse / 10
    for run in runs:
        assert not np.abs(run.v[-1]).max() > 1e-12
        assert np.abs(run.energy.error).max() < 1e-5


@pytest.mark.long
def test_a_cradle_obeys_newtons_law_of_impact() -> None:
    model = pin.Model()
    for i in range(3):
        joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), f"slide {i}")
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.05), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"ball {i}", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    contacts = [
        FrictionalContact(
            f"ball {i}", Ball(0.05), on=f"ball {i + 1}", name=f"hit {i}", friction=0.0,
            on_shape=Plane(normal=(-1, 0, 0), height=0.05), restitution=1.0,
        )
        for i in range(2)
    ]  # fmt: skip
    scene = cp.Scene(cp.Robot("cradle", model), contacts=contacts)
    run = cp.simulate(
        scene, (-0.1, 0.1, 0.2), (1.0, 0, 0), duration=0.2, dt=0.03, integrator=LOCATED
    )
    assert_allclose(run.v[-1], (-1 / 3, 2 / 3, 2 / 3), atol=1e-12)
    assert_allclose(run.run.happened[0].t, 0.1, atol=1e-12)


def test_painleves_rod_is_stopped_by_a_shock() -> None:
    rod = painleve_rod()
    scene = cp.Scene(rod, contacts=[FrictionalContact("tip", Point(), friction=1.5)])
    run = cp.simulate(
        scene, rod.postures["paradox"], (-1.0, 0, 0), duration=0.05, dt=1e-3, integrator=LOCATED
    )
    (shock,) = run.run.happened
    assert shock.name == "shock of tip"
    assert_allclose(shock.impulses[0][1:], (0.4, 0.0, 0.3), atol=1e-10)
    assert run.modes["tip"][-1] == "stick"
    assert any("shock of tip" in notice for notice in run.notices)
    assert np.abs(run.energy.error).max() < 1e-10


def test_stops_and_dry_friction_of_a_joint() -> None:
    scene = cp.Scene(
        slider(limits=(-1.0, 0.5)),
        contacts=[JointLimit("rail"), JointFriction("rail", torque=0.5)],
    )
    run = cp.simulate(scene, [0.0], [1.0], duration=1.0, dt=0.03, integrator=LOCATED)
    (hit,) = named(run, "impact")
    assert_allclose(hit.t, (1 - sqrt(0.5)) / 0.5, atol=1e-12)
    assert hit.impulses[0][0] == "rail/upper"
    assert_allclose(hit.impulses[0][1], sqrt(0.5), atol=1e-12)
    assert_allclose(run.q[-1], 0.5, atol=1e-12)
    # without the stop it comes to rest by friction alone
    free = cp.Scene(slider(), contacts=[JointFriction("rail", torque=0.5)])
    run = cp.simulate(free, [-1.0], [1.0], duration=2.5, dt=0.03, integrator=LOCATED)
    assert_allclose((run.run.happened[0].t, run.q[-1, 0]), (2.0, 0.0), atol=1e-12)
    assert np.abs(run.energy.error).max() < 1e-12


def test_cassie_falls_as_with_small_steps() -> None:
    robot = cp.load_robot("cassie", variant={"feet": "points"})
    scene = cp.Scene(robot, robot.loops, contacts=robot.frictional_contacts(0.7))
    q, v = scene.state()
    q[2] -= min(contact_gaps(scene, q).values()) - 0.001
    located = cp.simulate(scene, q, v, duration=0.03, dt=1e-3, integrator=LOCATED)
    assert located.violation.max() < 1e-13
    assert min(gap.min() for gap in located.gaps.values()) > -1e-12
    assert np.abs(located.energy.error).max() < 1e-4
    apart = [
        np.abs(cp.simulate(scene, q, v, duration=0.03, dt=dt).q[-1] - located.q[-1]).max()
        for dt in (4e-4, 1e-4)
    ]
    assert 3 < apart[0] / apart[1] < 5.5, apart  # they come nearer with dt
    assert apart[1] < 1e-3


def test_robots_that_fall_slip_and_leave_the_floor() -> None:
    robot = cp.load_robot("solo12")
    scene = cp.Scene(robot, contacts=robot.frictional_contacts(0.7))
    q, v = scene.state()
    q[2] -= min(contact_gaps(scene, q).values()) - 0.02
    runs = [
        cp.simulate(scene, q, v, duration=0.16, dt=dt, integrator=LOCATED) for dt in (4e-3, 1e-3)
    ]
    for run in runs:
        assert [len(named(run, what)) for what in ("impact", "slip")] == [1, 4]
        assert np.abs(run.energy.error).max() < 1e-5
        assert min(gap.min() for gap in run.gaps.values()) > -1e-12
    first, second = ([event.t for event in run.run.happened] for run in runs)
    assert_allclose(first, second, atol=1e-7)
    assert_allclose(runs[0].q[-1], runs[1].q[-1], atol=2e-6)


@pytest.mark.long
def test_a_box_tumbles_to_rest() -> None:
    box = free_box(size=(0.2, 0.12, 0.08))
    scene = cp.Scene(box, contacts=[FrictionalContact("box", Box(0.1, 0.06, 0.04), friction=0.5)])
    R = pin.exp3(np.array([0.2, 0.3, 0.1]))
    q = np.r_[0, 0, 0.2, pin.Quaternion(R).coeffs()]
    run = cp.simulate(scene, q, np.zeros(6), duration=0.6, dt=1e-2, integrator=LOCATED)
    assert run.status.ok, run.reason
    assert np.abs(run.v[-1]).max() < 1e-10
    assert_allclose(run.q[-1, 2], 0.04, atol=1e-10)
    assert min(gap.min() for gap in run.gaps.values()) > -1e-11
    assert np.abs(run.energy.error).max() < 1e-6


@pytest.mark.long
def test_events_of_the_user_and_of_contacts() -> None:
    scene, q = bouncing()

    def falls(moment: cp.simulation.Snapshot) -> float:
        return moment.v[2] + 0.5 if moment.t > 0.4 else 1.0

    run = cp.simulate(
        scene, q, np.zeros(6), duration=2.0, dt=0.05, integrator=LOCATED, record=7,
        events=[cp.Event(name="falls", when=falls)],
    )  # fmt: skip
    t0 = sqrt(1 / G)
    assert [event.name for event in run.run.happened] == ["impact of ball", "falls"]
    assert_allclose(run.t[-1], 1.8 * t0 + 0.5 / G, atol=1e-10)
    assert run.status.name == "ENDED"
    assert_allclose(run.energy.contact[-1], -0.36 * G * 0.5, rtol=1e-12)


@pytest.mark.long
def test_files_and_batches_keep_them(tmp_path: Path) -> None:
    scene, q = bouncing()
    run = cp.simulate(scene, q, np.zeros(6), duration=1.0, dt=0.02, integrator=LOCATED)
    run.save(tmp_path / "ball.npz")
    again = cp.Trajectory.load(tmp_path / "ball.npz")
    assert again.run.happened == run.run.happened
    assert again.run.integrator == LOCATED
    assert_allclose(again.energy.error, run.energy.error, atol=0)
    batch = cp.simulate_batch(
        scene, np.stack([q, q]), np.zeros((2, 6)), duration=1.0, dt=0.02, integrator=LOCATED,
        record=5,
    )  # fmt: skip
    assert_allclose(batch.q, [run.q[-1]] * 2, atol=1e-13)


@pytest.mark.long
def test_rows_of_contacts_change_as_their_drift_says() -> None:
    robot, rng = cp.load_robot("solo12"), np.random.default_rng(0)
    tilted, h = Plane((0.3, 0.2, 1.0), 0.05), 1e-3
    contacts = [
        FrictionalContact("FL_FOOT", Ball(0.02), on="HR_FOOT", on_shape=tilted, friction=0.5),
        FrictionalContact("FR_FOOT", Capsule(0.02, 0.03), on=tilted, friction=0.5),
    ]
    for some in (contacts, contacts[1:]):
        scene = cp.Scene(robot, contacts=some)
        candidates = Candidates(robot.model, scene.contact_bounds)
        data = robot.model.createData()
        v = rng.normal(size=robot.nv)
        q = pin.integrate(robot.model, scene.state()[0], 0.5 * rng.normal(size=robot.nv))

        def slip(
            s: float, q: np.ndarray = q, v: np.ndarray = v, data: object = data,
            candidates: Candidates = candidates,
        ) -> np.ndarray:  # fmt: skip
            there = pin.integrate(robot.model, q, s * v)
            pin.computeJointJacobians(robot.model, data, there)
            return candidates.evaluate(data, there)[1] @ v

        change = (8 * (slip(h) - slip(-h)) - slip(2 * h) + slip(-2 * h)) / (12 * h)
        pin.forwardKinematics(robot.model, data, q, v, np.zeros(robot.nv))
        assert_allclose(candidates.drift(data), change, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_what_is_not_finite_ends_the_run(bad: float) -> None:
    scene, q = bouncing()

    def tau(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.full(6, bad if t > 0.35 else 0.0)

    run = cp.simulate(scene, q, np.zeros(6), tau, duration=0.6, dt=0.02, integrator=LOCATED)
    assert not run.status.ok
    assert len(run.run.happened) == 1
    assert np.isfinite(run.q).all()


def test_damping_that_is_too_stiff_is_named() -> None:
    robot = slider(limits=(-1e300, 1e300))
    robot.model.damping[:] = 1e5
    scene = cp.Scene(cp.Robot("slider", robot.model), contacts=[JointLimit("rail")])
    run = cp.simulate(scene, [0.0], [1.0], duration=1.0, dt=1e-2, integrator=LOCATED)
    assert not run.status.ok
    assert "the damping of joint 'rail'" in run.reason


def test_what_is_refused() -> None:
    scene, q = bouncing()
    still = np.zeros(6)
    with pytest.raises(cp.errors.UnsupportedConstraint, match=r"EventDriven\(RungeKutta4\(\)\)"):
        cp.simulate(scene, q, still, duration=0.1, integrator=cp.RungeKutta4())
    for inner in (cp.Moreau(), cp.simulation.RadauIIA(), cp.SemiImplicitEuler(), 4, LOCATED):
        with pytest.raises(cp.InvalidArgument, match="inner"):
            EventDriven(inner)  # type: ignore[arg-type]
    for bounce in (0.0, -1.0, float("nan")):
        with pytest.raises(cp.InvalidArgument, match="shortest_bounce"):
            EventDriven(shortest_bounce=bounce)
    for contact in (Lemke(), "ADMM"):
        with pytest.raises(cp.InvalidArgument, match="contact"):
            EventDriven(contact=contact)  # type: ignore[arg-type]
    robot = cp.load_robot("solo12")
    feet = FrictionalContact("FL_FOOT", Ball(0.02), on="FR_FOOT", on_shape=Ball(0.02), friction=0.5)
    pair = cp.Scene(robot, contacts=[feet])
    with pytest.raises(cp.errors.UnsupportedConstraint, match="shapes of two bodies"):
        cp.simulate(pair, *pair.state(), duration=0.1, integrator=LOCATED)
    with pytest.raises(cp.InvalidArgument, match="simulate takes the others"):
        cp.step(scene, q, still, dt=1e-3, integrator=LOCATED)  # type: ignore[arg-type]


@pytest.mark.parametrize("integrator", [LOCATED, cp.StewartTrinkle()], ids=["located", "steps"])
def test_contacts_come_and_go_with_scenes(integrator) -> None:
    """The work of contacts is counted through phases that have none, before and behind."""
    on_floor, q = box_scene(0.5)
    free = cp.Scene(on_floor.robot)
    v = np.array([0.9, 0.3, 0, 0, 0, 0])
    lifts = cp.Event(name="lift", at=0.03, scene=free)
    run = cp.simulate(on_floor, q, v, duration=0.06, dt=2e-3, integrator=integrator, events=[lifts])
    assert run.contact is not None
    left, after = (p.samples for p in run.phases)
    taken = run.contact.work[left][-1]
    assert taken < -0.05
    np.testing.assert_array_equal(run.contact.work[after], taken)
    assert set(run.contact.codes[after].ravel()) == {0}

    drop = q + np.array([0, 0, 0.006, 0, 0, 0, 0])
    lands = cp.Event(name="floor", at=0.0301, scene=on_floor)
    run = cp.simulate(
        free, drop, 0.0 * v, duration=0.06, dt=2e-3, integrator=integrator, events=[lands]
    )
    assert run.status.ok, run.reason
    assert run.contact is not None
    assert not run.contact.work[run.phases[0].samples].any()
    assert run.contact.work[-1] < 0
