"""Rows that follow a path of time: closed forms, every integrator and solver, work, refusals."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from shared import each_exact_solver, each_row, unsupported_constraints
from viewed import parts

import condyn_pin as cp
from condyn_pin.constraints import (
    Coupling,
    Driven,
    HeldJoint,
    KnifeEdge,
    MinimumJerk,
    Path,
    Polynomial,
    RollingBall,
    Sine,
    analytic,
)
from condyn_pin.control import minimum_jerk
from condyn_pin.mechanism import complete_state
from condyn_pin.simulation import INTEGRATORS

GRAVITY = 9.81
PATH = Sine(0.4, 0.7, 0.3)
# those with contacts that open are in test_driven_contacts.py: their forces are of first order
ABLE = [
    name for name, kind in INTEGRATORS.items() if not kind.takes_contacts or kind.locates_events
]


@pytest.fixture(scope="module")
def bar():
    return cp.model.four_bar()


@pytest.fixture(scope="module")
def driven(bar):
    crank = bar.postures["open"][0] - PATH(0.0)[0][0]
    return cp.Scene(bar, [*bar.loops, Driven(HeldJoint("crank", crank), PATH)])


def crank_at(scene, t):
    """Value, rate and its rate of the crank."""
    s = np.ravel(PATH(t))
    s[0] += scene.constraints[-1].constraint.value
    return s


@pytest.mark.parametrize("name", ABLE)
def test_a_driven_four_bar_needs_the_torque_of_inverse_dynamics(driven, bar, name):
    """The motor's force is the u of the free four-bar at the same motion; to 1e-9 with them all."""
    run = cp.simulate(
        driven, *driven.state(), duration=0.2, dt=2e-3, integrator=INTEGRATORS[name]()
    )
    assert run.status.name == "FINISHED"
    free = cp.Scene(bar, bar.loops)
    for k in (0, 30, len(run) - 1):
        inverse = cp.inverse_dynamics(free, run.q[k], run.v[k], run.a[k])
        assert run.forces["crank"][k, 0] == pytest.approx(inverse.u[0], abs=1e-9)
    s = crank_at(driven, run.t[-1])
    assert run.q[-1, 0] == pytest.approx(s[0], abs=1e-6)
    assert run.v[-1, 0] == pytest.approx(s[1], abs=2e-4)  # SHAKE does not project it


def test_what_a_drive_does_is_in_the_balance(driven):
    run = cp.simulate(driven, *driven.state(), duration=1.0, dt=2e-3)
    energy = run.energy
    assert np.ptp(energy.driven) > 1.0
    assert np.abs(energy.error).max() < 1e-9  # of the integration over samples: 1.2e-10
    torque = run.forces["crank"][:, 0]
    power = torque * [crank_at(driven, t)[1] for t in run.t]
    assert energy.driven[-1] == pytest.approx(np.trapezoid(power, run.t), abs=1e-4)
    assert "drives" in str(run)
    assert run.violation.max() < 1e-14


@pytest.mark.long
def test_the_free_four_bar_follows_under_the_torque_that_drove_it(driven, bar):
    """Without the drive, its torque as a motor's: the same motion."""
    q, v = driven.state()
    run = cp.simulate(driven, q, v, duration=0.3, dt=1e-3)
    torque = run.forces["crank"][:, 0]

    def tau(t, q, v):
        return np.array([np.interp(t, run.t, torque), 0.0, 0.0])

    free = cp.simulate(cp.Scene(bar, bar.loops), q, v, tau, duration=0.3, dt=1e-3)
    assert np.abs(free.q[-1] - run.q[-1]).max() < 1e-6  # of the line between samples of the torque


@each_exact_solver
def test_solvers_find_one_answer_at_a_time(driven, solver):
    scene = driven.at(0.37)
    if unsupported_constraints(scene, solver):
        with pytest.raises(cp.errors.UnsupportedConstraint, match="crank"):
            cp.solve(scene, *scene.state(), np.zeros(3), solver=solver)
        return
    q, v = scene.state()
    drift = cp.Baumgarte(3.0, 5.0)
    for gains in (None, drift):
        found = cp.solve(scene, q, v, np.ones(3), solver=solver, drift=gains, throw=False)
        if not found.status.ok:  # one of the rows of a ball is redundant in a plane
            assert found.status is cp.Status.SINGULAR
            continue
        assert found.a[0] == pytest.approx(crank_at(scene, 0.37)[2], abs=1e-9)
    assert q[0] == pytest.approx(crank_at(scene, 0.37)[0], abs=1e-12)
    assert v[0] == pytest.approx(crank_at(scene, 0.37)[1], abs=1e-12)


def test_baumgarte_pulls_at_the_difference_to_the_path(driven):
    scene, gains = driven.at(0.2), cp.Baumgarte(3.0, 5.0)
    q, v = scene.state()
    free = cp.Scene(scene.robot, scene.constraints[:1])
    off = free.assemble(q + np.array([0.01, 0, 0]), fixed=["crank"]).q
    c, slip = 0.01, 0.3
    v = cp.mechanism.project_velocity(free, off, v * (1 + slip / v[0]))
    slip = v[0] - crank_at(scene, 0.2)[1]
    a = cp.solve(scene, off, v, np.zeros(3), drift=gains, throw=False).a
    wanted = crank_at(scene, 0.2)[2] - gains.Kd * slip - gains.Kp * c
    assert a[0] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("drift", [None, cp.Baumgarte(3.0, 5.0)])
def test_derivatives_agree_with_differences(driven, drift):
    scene = driven.at(0.37)
    cp.derivatives(scene, *scene.state(), np.ones(3), drift=drift, check=True)


def test_a_pendulum_on_a_shaken_pivot():
    """theta'' = -(g + s'') sin(theta) / L, s the height of the pivot."""
    model = pin.Model()
    pivot = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "pivot")
    swing = model.addJoint(pivot, pin.JointModelRY(), pin.SE3.Identity(), "swing")
    model.appendBodyToJoint(swing, pin.Inertia(1.0, np.array([0, 0, -1.0]), np.zeros((3, 3))),
                            pin.SE3.Identity())  # fmt: skip
    path = Sine(0.1, 3.0)
    scene = cp.Scene(cp.Robot("shaken", model), [Driven(HeldJoint("pivot"), path)])
    q, v = scene.at(0.0).assemble([0.0, 0.3]).q, [path(0.0)[1][0], 0.0]
    run = cp.simulate(scene, q, v, duration=1.0, dt=1e-3)

    def slope(t, y):
        return y[1], -(GRAVITY + path(t)[2][0]) * np.sin(y[0])

    exact = solve_ivp(slope, (0, 1), [0.3, 0.0], rtol=1e-12, atol=1e-12).y[:, -1]
    assert run.q[-1, 1] == pytest.approx(exact[0], abs=1e-9)
    assert run.v[-1, 1] == pytest.approx(exact[1], abs=1e-8)


def floating_box():
    model = pin.Model()
    body = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(body, pin.Inertia.FromBox(2.0, 0.3, 0.2, 0.1), pin.SE3.Identity())
    place = pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.05]))
    model.addFrame(pin.Frame("tool", body, 0, place, pin.FrameType.OP_FRAME))
    return cp.Robot("box", model)


@pytest.mark.long
def test_a_point_is_moved_in_the_axes_of_the_second_frame():
    """By a ball loop: at s from it, and the force is on the first one."""
    path = Sine((0.2, 0.1, 0.3), (1.0, 2.0, 0.5), (0.0, 1.0, 2.0))
    scene = cp.Scene(floating_box(), [Driven(cp.Loop("tool", "world"), path)])
    rng = np.random.default_rng(3)
    q, v = scene.sample(rng)
    run = cp.simulate(scene, q, v, duration=0.5, dt=1e-3)
    at, model = scene.at(0.5), scene.robot.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, run.q[-1])
    place = np.array(data.oMf[model.getFrameId("tool")].translation)
    assert place == pytest.approx(path(0.5)[0], abs=1e-12)
    answer = cp.solve(at, run.q[-1], run.v[-1], np.zeros(6), accuracy=1e-6)
    force = answer.forces["tool~world"]
    pin.centerOfMass(model, data, run.q[-1], run.v[-1], answer.a)
    weight = np.array([0, 0, GRAVITY])
    assert (force.on, force.by) == ("tool", "world")
    assert force.in_world()[:3] == pytest.approx(2.0 * (np.array(data.acom[0]) + weight), abs=1e-9)
    assert np.array(force.at) == pytest.approx(place, abs=1e-12)
    assert np.abs(run.energy.error).max() < 1e-7


def test_two_coordinates_of_a_planar_pin_and_a_rod_that_is_a_cylinder():
    box = floating_box()
    pinned = cp.Loop("tool", "world", "planar", axis="y", name="slide")
    scene = cp.Scene(box, [Driven(pinned, Polynomial(((0.1, 0.2), (0.3, -0.1))))])
    q = scene.at(2.0).state()[0]
    place = pin.XYZQUATToSE3(q) * box.frame("tool")[1]
    assert place.translation[[0, 2]] == pytest.approx([0.5, 0.1], abs=1e-12)
    rod = Driven(cp.Loop("tool", "world", "rod", length=1.0), Polynomial((0.0, -0.5)))
    away = np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    q = cp.Scene(box, [rod]).at(1.0).assemble(away).q
    place = pin.XYZQUATToSE3(q) * box.frame("tool")[1]
    assert np.linalg.norm(place.translation) == pytest.approx(1.5, abs=1e-12)


def test_a_gear_whose_offset_is_turned():
    """q_a = ratio q_b + s: of two equal wheels each takes half of s''."""
    model = pin.Model()
    for name in ("a", "b"):
        joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), 0.5 * np.eye(3)),
                                pin.SE3.Identity())  # fmt: skip
    scene = cp.Scene(cp.Robot("gear", model), [Driven(Coupling("a", "b", 1.0), Sine(0.2))])
    t = 0.3
    scene = scene.at(t)
    answer = cp.solve(scene, *scene.state(), np.zeros(2))
    assert answer.a == pytest.approx(np.array([0.5, -0.5]) * Sine(0.2)(t)[2], abs=1e-12)


@pytest.mark.long
def test_a_ball_on_a_belt_keeps_two_sevenths_of_its_speed():
    """From rest: (7/5) p'' = (2/5) u', u the speed of the belt."""
    ball = cp.model.rolling_ball(radius=0.1, mass=0.5)
    floor = RollingBall("centre", 0.1, height=0.0, name="skin")
    belt = Driven(floor, Polynomial(((0, 0, 0, 1), (0, 0, 0, 0), (0, 0, 0, 0))))
    scene = cp.Scene(ball, [belt])
    run = cp.simulate(scene, *scene.state(), duration=1.0, dt=1e-3)
    speed = pin.XYZQUATToSE3(run.q[-1]).rotation @ run.v[-1, :3]
    assert speed == pytest.approx([2 / 7 * 3.0, 0, 0], abs=1e-9)
    assert run.violation.max() < 1e-12


def test_a_blade_that_is_pushed_sideways():
    sleigh = cp.model.sleigh()
    pushed = Driven(KnifeEdge("blade"), Polynomial((0.0, 0.3)), name="pushed")
    scene = cp.Scene(sleigh, [pushed])
    q, v = scene.state()
    assert v[1] == pytest.approx(0.3)
    run = cp.simulate(scene, q, v, duration=0.3, dt=1e-3)
    assert run.v[-1, 1] == pytest.approx(0.3, abs=1e-12)
    assert not cp.mechanism.is_integrable(scene)


def test_paths():
    for path in (Sine((0.1, 0.2), 3.0), Polynomial((1.0, 2.0, 3.0, 4.0)), PATH,
                 MinimumJerk((0.0,), (1.0,), 0.5)):  # fmt: skip
        h = 1e-5
        for t in (0.1, 0.3):
            ends = [np.array(path(t + k * h)) for k in (-1, 1)]
            rates = (ends[1] - ends[0]) / (2 * h)
            assert np.array(path(t))[1:] == pytest.approx(rates[:2], rel=1e-6, abs=1e-7)
        assert pickle.loads(pickle.dumps(path)) == path
        assert isinstance(path, Path)
    found = np.array(analytic(lambda t: 0.4 * np.sin(20 * t))(0.3)).T[0]
    exact = np.array([0.4 * np.sin(6.0), 8.0 * np.cos(6.0), -160.0 * np.sin(6.0)])
    assert found == pytest.approx(exact, abs=1e-10)  # measured: 3e-12
    assert minimum_jerk([0.0], [1.0], 0.5) == MinimumJerk((0.0,), (1.0,), 0.5)


@each_row(
    ("along", "said"),
    [
        (3.0, "a Path is needed"),
        (lambda t: (np.sin(t), np.cos(t)), "three arrays are needed"),
        (lambda t: ([1.0, 2.0], [0.0, 0.0], [0.0, 0.0]), "1 number each"),
        (lambda t: (np.sin(t), np.sin(t), -np.sin(t)), "second value is not the rate"),
        (lambda t: (t**3 + t, 3 * t**2 + 1, 1.0), "third value is not the rate"),
        (lambda t: (np.nan, 0.0, 0.0), "not finite"),
    ],
)
def test_what_is_no_path_is_refused(along, said):
    with pytest.raises(cp.InvalidArgument, match=said):
        Driven(HeldJoint("crank"), along)


@each_row(
    "constraint",
    [
        cp.Loop("tool", "world", "weld"),
        cp.Loop("tool", "world", "hinge", axis="z"),
        cp.Loop("tool", "world", "slider", axis="z"),
        cp.PointContact("tool"),
        cp.SurfaceContact("tool", 0.1, 0.1),
    ],
)
def test_rows_that_are_no_rates_are_refused_by_name(constraint):
    path = Polynomial([[0.0]] * constraint.rows)
    with pytest.raises(cp.errors.InvalidConstraint, match=f"{constraint.name}: J v"):
        cp.Scene(floating_box(), [Driven(constraint, path)])


def test_a_path_has_a_number_for_each_row():
    pinned = cp.Loop("tool", "world", "planar", axis="y")
    with pytest.raises(cp.InvalidArgument, match="2 numbers each"):
        Driven(pinned, Sine(0.1))
    assert Driven(pinned, Sine((0.1, 0.1))).along.frequency == (1.0, 1.0)
    with pytest.raises(cp.InvalidArgument, match=r"amplitude = .* 3 numbers"):
        Sine((0.1, 0.2), (1.0, 2.0, 3.0))
    with pytest.raises(cp.InvalidArgument, match="coefficients"):
        Polynomial((0.0, np.inf))


def test_rates_that_are_wrong_later_on_are_found_by_a_motion(driven):
    """At the start all is zero; a kink is no fault."""

    def wrong(t):
        late = max(t - 0.05, 0.0)
        return 1.2 + late**3, 3 * late**2, 0.0

    scene = cp.Scene(driven.robot, [*driven.constraints[:1], Driven(HeldJoint("crank"), wrong)])
    q, v = scene.state()
    with pytest.raises(cp.InvalidArgument, match=r"crank: of along.* third value"):
        cp.simulate(scene, q, v, duration=1.0)

    def trapezoid(t):
        return (1.2 + t**2, 2 * t, 2.0) if t < 0.05 else (1.195 + 0.1 * t + 0.0025, 0.1, 0.0)

    kinked = Driven(HeldJoint("crank"), trapezoid)
    scene = cp.Scene(driven.robot, [*driven.constraints[:1], kinked])
    assert cp.simulate(scene, *scene.state(), duration=0.05 / 0.21).status.ok


def test_what_takes_no_path_says_so(driven, bar):
    q, v = driven.state()
    unsupported = cp.errors.UnsupportedConstraint
    still = np.zeros(3)
    for call in (
        lambda: cp.solve(driven, q, v, still),
        lambda: cp.Workspace(driven),
        lambda: cp.inverse_dynamics(driven, q, v, still),
        lambda: cp.derivatives(driven, q, v, still),
        lambda: cp.impact(driven, q, v),
        lambda: cp.step(driven, q, v, still, dt=1e-3),
        lambda: complete_state(driven, [0.1]),
        lambda: driven.minimal(error=0.01),
        lambda: cp.solve(driven.at(0.0), q, v, still, solver=cp.Proximal()),
    ):
        with pytest.raises(unsupported, match="crank"):
            call()
    with pytest.raises(cp.InvalidArgument, match="motion begins at t = 0"):
        cp.simulate(driven.at(0.1), q, v, duration=0.1)
    with pytest.raises(cp.errors.NotAssembled, match=r"crank has \|J v\| ="):
        cp.simulate(driven, q, still, duration=0.1)
    with pytest.raises(cp.InvalidArgument, match="driven, such as"):
        Driven(driven.constraints[-1], PATH)
    with pytest.raises(cp.InvalidArgument, match="what unit its path has"):
        driven.constraints[-1].in_units(2.0, float)
    assert cp.Scene(bar, bar.loops).at(0.3) == cp.Scene(bar, bar.loops)


@pytest.mark.long
def test_events_may_drive_and_let_go(driven, bar):
    free = cp.Scene(bar, bar.loops)
    release = cp.Event(name="release", at=0.1, scene=free)
    run = cp.simulate(driven, *driven.state(), duration=0.2, dt=1e-3, events=[release])
    assert len(run.phases) == 2
    assert np.abs(run.energy.error).max() < 1e-7
    assert run.lam[-1, -1] == 0.0


def test_a_drive_takes_hold_at_its_speed(driven, bar):
    free = cp.Scene(bar, bar.loops)
    q, v = driven.state()
    fast = 1.5 * v
    hit = cp.impact(driven.at(0.0), q, fast, restitution={"crank": 0.5})
    rate = crank_at(driven, 0.0)[1]
    assert hit.v[0] - rate == pytest.approx(-0.5 * (fast[0] - rate), abs=1e-12)
    terms = cp.Workspace(driven.at(0.0)).terms(q, v)
    assert terms.M @ (hit.v - fast) == pytest.approx(terms.J.T @ hit.lam, abs=1e-12)
    # on its way, from where the path is at that time
    t = 0.1
    at_start = free.assemble([crank_at(driven, t)[0], *q[1:]], fixed=["crank"]).q
    still = np.zeros(3)
    weightless = {"gravity": False, "duration": 0.3, "dt": 1e-3}
    grab = cp.Event(name="grab", at=t, scene=driven)
    run = cp.simulate(free, at_start, still, events=[grab], **weightless)
    assert run.v[run.run.happened[0].sample, 0] == pytest.approx(crank_at(driven, t)[1], abs=1e-12)
    assert run.run.happened[0].energy_lost < 0  # the motor brings it
    assert np.abs(run.energy.error).max() < 1e-8
    assert run.q[-1, 0] == pytest.approx(crank_at(driven, run.t[-1])[0], abs=1e-9)


@pytest.mark.long
def test_a_path_out_of_reach_ends_the_run(bar):
    """The rocker swings by less than a radian; the path asks for two."""
    far = Driven(HeldJoint("rocker", bar.postures["open"][2]), Sine(2.0, 0.5))
    scene = cp.Scene(bar, [*bar.loops, far])
    for integrator in (None, cp.simulation.GearGuptaLeimkuhler()):
        run = cp.simulate(scene, *scene.state(), duration=1.0, integrator=integrator)
        assert run.status.name in ("FAILED", "DIVERGED")
        assert 0.1 < run.t[-1] < 0.25
        assert run.violation.max() < 0.02
    run = cp.simulate(scene, *scene.state(), duration=1.0)
    assert "rocker: at t = 0.1" in run.reason
    assert "cannot follow" in run.reason


def test_files_batches_and_pictures_have_it(driven, tmp_path):
    q, v = driven.state()
    run = cp.simulate(driven, q, v, duration=0.05, dt=1e-3)
    run.save(tmp_path / "run.npz")
    again = cp.Trajectory.load(tmp_path / "run.npz")
    assert again.scene.constraints == run.scene.constraints
    assert (again.violation == run.violation).all()
    run.to_csv(tmp_path / "run.csv")
    many = cp.simulate_batch(driven, [q, q], [v, v], duration=0.05, dt=1e-3)
    assert (many.q[1] == run.q[-1]).all()
    assert any("coupler_rocker" in path for path in parts(run))
    assert pickle.loads(pickle.dumps(driven)) == driven
    mine = replace(driven.constraints[-1], along=lambda t: PATH(t))
    run = cp.simulate(cp.Scene(driven.robot, [*driven.constraints[:1], mine]), q, v, duration=0.01)
    with pytest.raises(cp.InvalidArgument, match="along is a function"):
        run.save(tmp_path / "function.npz")


@each_row(
    ("formula", "text"),
    [
        (lambda t: math.sin(t), "numpy's functions take it, math's do not"),
        (lambda t: abs(t - 0.5), r"at t = 0.3 s they are \[0.2\], and \[0.203.*without abs"),
        (lambda t: np.sin(300 * t), "or a smaller radius"),
    ],
)
def test_a_formula_that_is_not_analytic_is_refused(formula, text):
    with pytest.raises(cp.InvalidArgument, match=text):
        analytic(formula)(0.3)


def test_a_path_that_jumps_is_said_to(driven):
    jumping = replace(driven.constraints[-1], along=lambda t: (0.3 * (t > 0.02), 0.0, 0.0))
    scene = cp.Scene(driven.robot, [*driven.constraints[:1], jumping])
    run = cp.simulate(scene, *scene.state(), duration=0.05)
    assert "cannot follow, or jumps: they are open by 0.3 m or rad" in run.reason


@pytest.mark.long
def test_an_action_of_a_driven_scene_is_its_step(driven):
    with pytest.raises(cp.errors.UnsupportedConstraint, match=r"crank.*scene\.at\(t\)"):
        cp.layers.Action(driven, 0.01)
    scene = driven.at(0.2)
    q, v = scene.state()
    action = cp.layers.Action(scene, 0.01)
    found = action.step(np.concatenate((q, v)), np.zeros(action.B.shape[1]))
    one = cp.step(scene, q, v, dt=0.01)
    assert found == pytest.approx(np.concatenate((one.q, one.v)), abs=1e-12)


def a_five_bar_with_one_crank_driven(*motors):
    """The scene, the free one, where its cranks are, and q of the path at 0."""
    bar = cp.model.five_bar()
    free = cp.Scene(bar, bar.loops)
    home = free.state()[0][bar.index_q("left_motor")] - PATH(0.0)[0][0]
    some = replace(bar, actuated=list(motors))
    motor = Driven(HeldJoint("left_motor", float(home)), PATH)
    return cp.Scene(some, [*bar.loops, motor]), free, float(home)


@pytest.mark.long
def test_motors_and_paths_make_a_state():
    """c(q) = s(t) and J v = s'(t): as of a free five-bar whose other motor is where the path is."""
    scene, free, home = a_five_bar_with_one_crank_driven("right_motor")
    t, (s, rate, _) = 0.3, np.ravel(PATH(0.3))
    found = complete_state(scene.at(t), [0.1], [0.7])
    expected = complete_state(free, [home + s, 0.1], [rate, 0.7])
    assert found.q == pytest.approx(expected.q, abs=1e-12)
    assert found.v == pytest.approx(expected.v, abs=1e-12)
    assert found.undetermined == found.conflicting == 0


@pytest.mark.long
@pytest.mark.parametrize("t", [0.0, 0.2, 0.45, 0.9])
def test_motors_that_no_path_moves_are_at_rest_by_default(t):
    scene, free, home = a_five_bar_with_one_crank_driven("right_motor")
    s, rate, _ = np.ravel(PATH(t))
    found = complete_state(scene.at(t), [0.1])
    expected = complete_state(free, [home + s, 0.1], [rate, 0.0])
    assert found.v == pytest.approx(expected.v, abs=1e-12)


def test_a_motor_that_is_driven_too_has_the_place_and_the_velocity_of_its_path():
    scene, free, home = a_five_bar_with_one_crank_driven("left_motor", "right_motor")
    t, (s, rate, _) = 0.3, np.ravel(PATH(0.3))
    found = complete_state(scene.at(t), [home + s, 0.1])
    assert found.v == pytest.approx(complete_state(free, [home + s, 0.1], [rate, 0.0]).v, abs=1e-12)
    with pytest.raises(cp.InvalidArgument, match=r"left_motor.* would leave its path"):
        complete_state(scene.at(t), [home + s, 0.1], [0.0, 0.0])
    with pytest.raises(cp.errors.NotAssembled, match="left_motor is open"):
        complete_state(scene.at(t), [home + s + 0.1, 0.1])


def test_a_belt_says_nothing_of_where_anything_is():
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("skate", base, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    belt = Driven(KnifeEdge("skate"), Polynomial((0.0, 1.0)))
    scene = cp.Scene(cp.Robot("skate", model, actuated=["base"]), [belt])
    with pytest.raises(cp.errors.UnsupportedConstraint, match="skate: rows on the velocity alone"):
        complete_state(scene.at(0.0), [0.0, 0.0, 1.0, 0.0])


@pytest.mark.long
def test_a_path_of_your_own_is_saved_by_its_name(driven, tmp_path):
    @dataclass(frozen=True)
    class Ramp(Path):
        rate: float = 1.0

        def __call__(self, t):
            return self.rate * t, self.rate, 0.0

    mine = Driven(HeldJoint("crank", driven.robot.postures["open"][0]), Ramp(0.5))
    scene = cp.Scene(driven.robot, [*driven.constraints[:1], mine])
    run = cp.simulate(scene, *scene.state(), duration=0.01)
    run.save(tmp_path / "run.npz")
    assert cp.Trajectory.load(tmp_path / "run.npz").scene.constraints[-1] == mine


def test_a_held_joint_is_a_locked_one(bar):
    """A pendulum whose crank is held: its torque is what holds the weight."""
    q = cp.Scene(bar, bar.loops).state()[0]
    held = cp.Scene(bar, [*bar.loops, HeldJoint("crank", q[0])])
    answer = cp.solve(held, q, np.zeros(3), np.zeros(3))
    balance = cp.control.gravity_compensation(cp.Scene(bar, bar.loops), q)
    assert answer.forces["crank"][0] == pytest.approx(balance.u[0], abs=1e-12)
    assert np.abs(answer.a).max() < 1e-12
    assert answer.forces["crank"].on_other()[0] == -answer.forces["crank"][0]
    cp.derivatives(held, q, np.zeros(3), np.ones(3), check=True)
    with pytest.raises(cp.errors.InvalidConstraint, match="joints with one number"):
        cp.Scene(floating_box(), [HeldJoint("base")])
    with pytest.raises(cp.errors.UnknownName):
        cp.Scene(bar, [HeldJoint("crnk")])


def test_a_scene_at_a_time_is_looked_at_where_it_is_closed_then(driven):
    scene = driven.at(0.37)
    assert scene.rank().closed
    assert "is open by" not in str(scene.summary())
    assert scene.rank().q[0] == pytest.approx(crank_at(driven, 0.37)[0], abs=1e-9)
    assert cp.mechanism.is_integrable(scene)
    with pytest.raises(
        cp.errors.UnsupportedConstraint, match=r"crank.*growth_vector takes J v = 0"
    ):
        cp.mechanism.growth_vector(scene)


def test_an_impact_that_a_drive_gives_to_says_so(driven):
    scene = driven.at(0.37)
    q, _ = scene.state()
    found = cp.impact(scene, q, np.zeros(3))
    assert found.energy_lost < 0
    assert f"{-found.energy_lost:.4g} J more than 0 J" in repr(found)


@pytest.mark.long
def test_a_scene_at_another_time_is_not_measured_again(driven):
    free = replace(driven)
    for t in (0.1, 0.2):
        assert free.at(t).nominal is free.nominal
        assert cp.mechanism.closed_chains.chains_of(free.at(t)).rank == 3
        assert cp.Workspace(free.at(t)).scene.nominal is free.nominal
        touching = replace(free, contacts=[cp.constraints.JointFriction("rocker", 0.1)])
        assert touching.at(t).bilateral.nominal is touching.at(0.0).nominal


@pytest.mark.long
def test_a_path_that_begins_out_of_reach_is_measured_where_it_is_in(bar):
    """At t = 0 the rocker would be 2 rad away; at t = 1 it is where it can be."""
    rocker = float(bar.postures["open"][2])
    motor = Driven(HeldJoint("rocker", rocker), Polynomial((-2.0, 2.0)))
    scene = cp.Scene(bar, [*bar.loops, motor])
    assert not scene.nominal.closed
    now = scene.at(1.0)
    assert now.nominal.closed
    q, v = now.state()
    assert cp.solve(now, q, v, np.zeros(3)).status.ok
    assert v[2] == pytest.approx(2.0, abs=1e-9)


@pytest.mark.long
def test_what_starts_at_the_nominal_state_starts_at_its_time():
    """Where the scene has been measured at t = 0 before, and where it has not."""
    scene, _free, home = a_five_bar_with_one_crank_driven("left_motor", "right_motor")
    for measured in (False, True):
        if measured:
            assert scene.nominal.closed
        s = np.ravel(PATH(0.3))[0]
        found = complete_state(scene.at(0.3), [home + s, 0.1])
        assert found.q[0] == pytest.approx(home + s, abs=1e-12)
        q, _ = scene.at(0.3).sample(np.random.default_rng(0))
        assert q[0] == pytest.approx(home + s, abs=1e-9)
