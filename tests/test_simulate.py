"""simulate: known motions, energy, samples, and runs that break down."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from motions import G, bar, body, falling, hanging_cassie, top
from scipy.interpolate import CubicSpline
from shared import HAS_LCABA, each_row, robot

import condyn_pin as cp
from condyn_pin.simulation.integrators import dormand_prince
from condyn_pin.simulation.measures import work
from condyn_pin.simulation.system import System

RunStatus = cp.simulation.RunStatus
INTEGRATORS = cp.simulation.INTEGRATORS
each_integrator = pytest.mark.parametrize(
    "integrator", [kind() for kind in INTEGRATORS.values()], ids=list(INTEGRATORS)
)

# Corrections after a step: what they solve, the next step need not.
KEEPERS = [
    cp.simulation.PostStabilization(),
    cp.simulation.PostStabilization(every=2),
    cp.simulation.Projection(),
]


def on_bar(tau=0.0, duration=0.1, **options) -> cp.Trajectory:
    """The motion of a four-bar."""
    return cp.simulate(*bar(), tau, duration=duration, **options)


@pytest.mark.parametrize("samples", [2, 3, 21, 64, 65, 400])
def test_work_is_the_integral_of_a_spline_through_the_power(samples):
    t = np.sort(np.random.default_rng(0).uniform(0.0, 2.0, samples))
    power = np.cos(3 * t)
    spline = CubicSpline(t, power)
    wanted = [spline.integrate(t[0], each) for each in t]
    for _ in range(2):  # the second time the matrix of few samples is there already
        np.testing.assert_allclose(work(t, power), wanted, rtol=1e-12, atol=1e-14)


# Known motions.


@pytest.mark.parametrize(
    ("t", "x", "z"),
    [
        (1, 0.986291751131875319, -0.16501085312554116),
        (5, -0.94230543504375733, -0.33475433841400058),
        (10, -0.27508746257611686, -0.96141920509912506),
    ],
)
def test_pendulum_by_elliptic_functions(t, x, z):
    scene = cp.Scene(cp.model.pendulum())
    found = cp.simulate(scene, [np.pi / 2], [0.0], duration=t, dt=1e-3)
    theta = found.q[-1, 0]
    assert found.status is RunStatus.FINISHED
    assert np.hypot(-np.sin(theta) - x, -np.cos(theta) - z) < 1e-10
    assert np.abs(found.energy.error).max() < 1e-10


def test_free_fall_and_projectile():
    scene = cp.Scene(robot("solo12"))
    q, _ = scene.state()
    v = np.random.default_rng(0).normal(size=scene.robot.nv)
    v[:6] *= 0.3
    found = cp.simulate(scene, q, v, duration=0.5, dt=1e-3)
    model, data = scene.robot.model, scene.robot.model.createData()
    start = pin.centerOfMass(model, data, q, v).copy()
    speed = data.vcom[0].copy()
    for i in (100, 500):
        t = found.t[i]
        wanted = start + speed * t - np.array([0, 0, G * t**2 / 2])
        assert np.abs(pin.centerOfMass(model, data, found.q[i]) - wanted).max() < 1e-9
    momentum = found.momentum - found.momentum[0]
    momentum[:, 2] += scene.robot.mass * G * found.t
    assert np.abs(momentum).max() < 1e-9
    assert np.abs(found.energy.error).max() < 1e-7


def test_a_spring_swings_as_it_should():
    slider = body(pin.JointModelPX(), mass=2.0, damping=3.0)
    scene = cp.Scene(replace(slider, springs=[cp.model.Spring("joint", 50.0, 0.1)]))
    found = cp.simulate(scene, [0.4], [0.0], duration=1.0, dt=1e-3)
    decay, omega = 3.0 / 4.0, np.sqrt(25.0 - 0.75**2)
    t = found.t
    swing = np.cos(omega * t) + decay / omega * np.sin(omega * t)
    assert np.abs(found.q[:, 0] - 0.1 - 0.3 * np.exp(-decay * t) * swing).max() < 1e-11
    assert np.abs(found.energy.error).max() < 1e-9
    assert found.energy.damping[-1] < -0.1
    free = cp.simulate(scene, [0.4], [0.0], duration=1.0, damping=False)
    assert np.abs(free.q[:, 0] - 0.1 - 0.3 * np.cos(5.0 * t)).max() < 1e-10
    assert free.energy.damping[-1] == 0.0
    slack = cp.simulate(scene, [0.4], [0.7], duration=1.0, springs=False, damping=False)
    assert np.abs(slack.q[:, 0] - 0.4 - 0.7 * t).max() < 1e-12
    assert not slack.energy.springs.any()


def test_gravity_and_armature_can_be_off():
    model = pin.Model(body(pin.JointModelPZ()).model)
    model.armature[:] = 3.0
    scene = cp.Scene(cp.Robot("geared", model))
    heavy, bare, floating = (
        cp.simulate(scene, [0.0], [1.0], duration=1.0, **off)
        for off in ({}, {"armature": False}, {"gravity": False})
    )
    ends = [run.q[-1, 0] for run in (heavy, bare, floating)]
    assert ends == pytest.approx([1.0 - G / 4 / 2, 1.0 - G / 2, 1.0])
    assert "on: gravity, armature" in str(heavy)
    assert "not in the model: springs, damping" in str(heavy)
    assert "off: gravity" in str(floating)


@pytest.mark.long
def test_feet_stay_where_they_are():
    talos = robot("talos")
    scene = cp.Scene(talos, talos.contacts)
    q, v = scene.state()
    found = cp.simulate(scene, q, v, duration=0.1)
    assert found.violation.max() < 1e-6
    assert found.scene.constraints[0].anchor is not None
    assert found.forces["left_sole_link"].shape == (101, 6)
    first = cp.solve(found.scene, q, v, np.zeros(talos.nv))
    assert np.allclose(found.forces["left_sole_link"][0], first.forces["left_sole_link"], rtol=1e-7)
    assert np.allclose(found.a[0], first.a)


def test_soft_constraints_and_lcaba_take_no_gains():
    soft = on_bar(duration=0.01, solver=cp.dynamics.Soft())
    assert soft.run.drift == cp.simulation.NoDrift()
    if HAS_LCABA:
        with pytest.raises(cp.errors.UnsupportedConstraint, match="ignores drift control"):
            on_bar(solver=cp.LCABA(), drift=cp.Baumgarte.critical(9.0))
        found = on_bar(solver=cp.LCABA())
        assert found.status.ok
        assert found.violation[1:].max() < 1e-12


# Integrators.


@each_integrator
def test_samples_are_states_of_the_equations(integrator):
    """t, q, v, a and lam of one sample belong together, to the order of the method."""
    found = on_bar(duration=0.01, dt=1e-4, integrator=integrator, record=7)
    assert found.t == pytest.approx([*np.arange(0, 100, 7) * 1e-4, 0.01])
    for i in (0, 5, len(found) - 1):
        solution = cp.solve(found.scene, found.q[i], found.v[i], np.zeros(3), throw=False)
        assert np.abs(found.a[i] - solution.a).max() < 0.05 * np.abs(solution.a).max()
        assert np.abs(found.lam[i] - solution.lam).max() < 0.05 * np.abs(solution.lam).max()
    assert integrator.title
    assert integrator.use
    assert integrator.solves_per_step > 0


@pytest.fixture
def at_end():
    """A method whose accelerations belong to the end of the step, as those of implicit ones do."""

    class AtEnd(cp.simulation.Integrator):
        title, order, use = "at the end", cp.SemiImplicitEuler.order, "here"
        solves_per_step, a_at = 2, "end"

        def start(self, system, dt):
            inner = cp.SemiImplicitEuler().start(system, dt)

            def step(t, q, v):
                q1, v1, _ = inner.step(t, q, v)
                return q1, v1, system.acceleration(t + dt, q1, v1)

            return type(inner)(step, system.lam)

    yield AtEnd()
    del INTEGRATORS["atend"]


@pytest.mark.long
def test_accelerations_at_the_end_are_put_where_they_belong(at_end):
    def push(t, q, v):
        return np.array([10.0 * t])

    air, floor = falling()
    touch = cp.Event(name="land", when=lambda m: m.position("origin")[2], scene=floor)
    runs = [
        cp.simulate(air, [0.1], [0.0], push, duration=0.3, events=[touch], integrator=i, record=k)
        for i in (at_end, cp.SemiImplicitEuler())
        for k in (1, 10)
    ]
    for found in runs:
        landed = found.run.happened[0].sample
        assert found.a[:landed, 0] == pytest.approx(10.0 * found.t[:landed] - G)
        assert found.tau[:, 0] == pytest.approx(10.0 * found.t)
        assert found.forces["origin"][landed:, 2] == pytest.approx(G - 10.0 * found.t[landed:])
        assert (np.diff(found.t) > 1e-9).sum() == len(found) - 2  # but for the two at the event
    for one, other in ((0, 2), (1, 3)):
        assert np.allclose(runs[one].t, runs[other].t, rtol=0, atol=1e-14)
        assert np.allclose(runs[one].q, runs[other].q, rtol=0, atol=1e-14)
    assert 25 < len(runs[1]) < 40


@pytest.mark.parametrize(("omega_dt", "stable"), [(1.95, True), (2.05, False)])
def test_leapfrog_keeps_an_oscillation_up_to_its_limit(omega_dt, stable):
    scene = cp.Scene(body(pin.JointModelPX()))
    found = cp.simulate(
        scene, [1.0], [0.0], lambda t, q, v: -(omega_dt**2) * q, duration=2000.0, dt=1.0,
        integrator=cp.simulation.Leapfrog(), gravity=False,
    )  # fmt: skip
    assert (np.abs(found.q).max() < 10.0) == stable


@pytest.mark.long
@pytest.mark.parametrize(
    ("integrator", "more"),
    [(cp.simulation.Leapfrog(), 0), (cp.simulation.LinearlyImplicitMidpoint(), 2)],
    ids=repr,
)
def test_one_solve_a_step(monkeypatch, integrator, more):
    calls = []
    solve = System.solve
    monkeypatch.setattr(System, "solve", lambda *given: calls.append(1) or solve(*given))
    on_bar(integrator=integrator, drift=cp.simulation.NoDrift(), record=100)
    assert len(calls) == 100 + 1 + more  # the last sample, and the first step


def tightly(start, duration: float) -> cp.Trajectory:
    """The motion to 1e-13."""
    tight = cp.simulation.DormandPrince(relative_tolerance=1e-13, absolute_tolerance=1e-13)
    return cp.simulate(
        *start, duration=duration, dt=0.05, integrator=tight, drift=cp.simulation.NoDrift()
    )


@pytest.mark.long
def test_averaged_velocities_would_have_order_two():
    """What the correction on the manifold is for."""
    scene, q0, v0 = top()
    reference = tightly(top(), 0.25).q[-1]
    workspace = cp.Workspace(scene)
    model, tau = scene.robot.model, np.zeros(6)

    def end(n):
        q, v, h = q0, v0, 0.25 / n
        for _ in range(n):
            k1, a1 = v, workspace.acceleration(q, v, tau)
            k2 = v + h / 2 * a1
            a2 = workspace.acceleration(pin.integrate(model, q, h / 2 * k1), k2, tau)
            k3 = v + h / 2 * a2
            a3 = workspace.acceleration(pin.integrate(model, q, h / 2 * k2), k3, tau)
            k4 = v + h * a3
            a4 = workspace.acceleration(pin.integrate(model, q, h * k3), k4, tau)
            q = pin.integrate(model, q, h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
            v = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        return np.abs(pin.difference(model, reference, q)).max()

    assert 1.8 < np.log2(end(50) / end(100)) < 3.2


def test_adaptive_steps_meet_their_tolerance():
    wanted = tightly(bar(), 0.25).q[-1]
    for tolerance, most in ((1e-6, 1e-4), (1e-10, 1e-8)):
        for method in (5, 8):
            choice = cp.simulation.DormandPrince(tolerance, tolerance, method)
            drift = cp.simulation.NoDrift()
            found = on_bar(duration=0.25, dt=0.05, drift=drift, integrator=choice)
            assert np.abs(found.q[-1] - wanted).max() < most


@pytest.mark.long
def test_substeps_that_just_do_not_fit_are_no_trouble():
    """dt of a hair more than whole substeps: the rest does not set the size of what follows."""
    called = []

    def tau(t, q, v):
        called.append(t)
        return np.zeros(1)

    for dt in (0.1, 0.1 * (1 + 1e-13), 0.1 / 3):
        called.clear()
        found = cp.simulate(
            cp.Scene(cp.model.pendulum()), [1.0], [0.0], tau, duration=20 * dt, dt=dt,
            integrator=cp.simulation.DormandPrince(1e-9, 1e-9),
        )  # fmt: skip
        assert found.status.ok
        assert len(called) < 2000


def test_adaptive_steps_give_up_where_damping_is_stiff(monkeypatch):
    monkeypatch.setattr(dormand_prince, "_MOST", 100)
    scene = cp.Scene(body(pin.JointModelRZ(), damping=2.5e4))  # a millionth of a second
    choice = cp.simulation.DormandPrince()
    found = cp.simulate(scene, [0.0], [1.0], duration=1e-2, dt=1e-2, integrator=choice)
    assert found.status is RunStatus.FAILED
    assert re.search(r"more than 100 substeps .* stiff; use RadauIIA", found.reason)


@pytest.mark.long
def test_damping_of_light_rods_asks_for_no_small_dt():
    start = hanging_cassie()
    found = cp.simulate(*start, duration=0.2, integrator=cp.SemiImplicitEuler())
    assert found.status.ok
    assert found.violation.max() < 1e-5
    with_start = cp.SemiImplicitEuler(implicit=False)
    lost = cp.simulate(*start, duration=0.2, integrator=with_start)
    assert lost.status is RunStatus.DIVERGED
    assert np.isfinite(lost.v).all()
    assert "grew without bound" in lost.notices[0]
    exact = cp.simulate(*start, duration=0.2)
    assert np.abs(exact.energy.error).max() < 1e-4
    assert np.abs(found.q[-1] - exact.q[-1]).max() < 0.02


# Torques and work.


def test_energy_changes_by_the_work_of_the_torques():
    def tau(t, q, v):
        return np.array([3.0 * np.sin(7.0 * t) - 0.5 * v[0], 0.0, 0.0])

    found = on_bar(tau, 1.0)
    assert np.ptp(found.energy.work) > 0.5
    assert np.abs(found.energy.error).max() < 1e-6
    assert np.array_equal(found.tau[400], tau(0.4, found.q[400], found.v[400]))
    constant = on_bar([2.0, 0, 0], 0.5)
    swept = constant.q[-1, 0] - constant.q[0, 0]
    assert constant.energy.work[-1] == pytest.approx(2.0 * swept, rel=1e-8)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8)])
def test_the_rotor_of_a_joint_has_kinetic_energy(axis):
    """Pinocchio leaves it out where the axis is slanted."""
    joint = pin.JointModelRevoluteUnaligned(*axis)
    model = pin.Model(body(joint, centre=(0.1, 0.2, 0.0), inertia=0.3).model)
    model.armature[:] = 0.7
    scene = cp.Scene(cp.Robot("geared", model))
    found = cp.simulate(scene, [0.3], [2.0], duration=0.1)
    M = cp.Workspace(scene).terms(found.q[-1], found.v[-1]).M
    assert found.energy.kinetic[-1] == pytest.approx(found.v[-1] @ M @ found.v[-1] / 2, rel=1e-14)
    assert np.abs(found.energy.error).max() < 1e-10


@pytest.mark.values
@pytest.mark.parametrize("drift", KEEPERS, ids=repr)
@each_integrator
def test_torques_belong_to_their_sample(integrator, drift):
    """Also where two steps share a solve, and where a function returns a buffer of its own."""
    buffer = np.zeros(3)

    def tau(t, q, v):
        buffer[:] = np.cos(40 * t) - 0.1 * v
        return buffer

    found = on_bar(tau, 0.03, dt=5e-3, integrator=integrator, drift=drift)
    wanted = np.cos(40 * found.t)[:, None] - 0.1 * found.v
    assert np.abs(found.tau - wanted).max() < 1e-14


@pytest.mark.long
@pytest.mark.values
@pytest.mark.parametrize("written", [1, 2])
@each_integrator
def test_a_function_cannot_write_to_the_state(integrator, written):
    def tau(*arguments):
        arguments[written][:] = 0.0
        return np.zeros(3)

    with pytest.raises(ValueError, match="read-only"):
        on_bar(tau, 0.01, integrator=integrator)


# Notices: of what deserves attention, and of nothing else.


def held_at_zero() -> cp.Trajectory:
    """A ball held where all its energies are zero: rounding is no energy."""
    held = cp.Scene(body(pin.JointModelFreeFlyer(), inertia=1 / 600), [cp.SurfaceContact("origin")])
    found = cp.simulate(held, *held.state(), duration=0.2)
    assert 0 < np.abs(found.energy.error).max() < 1e-20
    return found


def spinning(**options) -> cp.Trajectory:
    scene = cp.Scene(body(pin.JointModelFreeFlyer(), inertia=1.0))
    q, v = pin.neutral(scene.robot.model), [1.0, 0.0, 0.0, 0.1, 3.0, 0.1]
    return cp.simulate(scene, q, v, gravity=False, **options)


def gliding() -> cp.Trajectory:
    sleigh = cp.Scene(cp.model.sleigh(), cp.model.sleigh().contacts)
    return cp.simulate(sleigh, *sleigh.sample(np.random.default_rng(0)), duration=0.1)


def rolling() -> cp.Trajectory:
    """A motion that exchanges nothing: what is left over is small beside the energy itself."""
    made = cp.model.rolling_ball()
    scene = cp.Scene(made, made.contacts)
    found = cp.simulate(scene, *scene.sample(np.random.default_rng(3)), duration=0.05)
    assert found.energy.scale < 1e-10 < found.energy.kinetic[0]
    return found


def limited(lower: float, upper: float, tau: float, duration: float) -> cp.Trajectory:
    model = pin.Model(body(pin.JointModelPZ()).model)
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = lower, upper
    scene = cp.Scene(cp.Robot("limited", model))
    return cp.simulate(scene, [0.0], [0.0], np.array([tau]), duration=duration)


@pytest.mark.long
@pytest.mark.parametrize(
    "motion",
    [
        held_at_zero, lambda: spinning(duration=0.2), gliding, rolling,
        lambda: limited(-0.1, 0.1, 0.0, 0.1),
        lambda: limited(0.0, 1.0, G * (1.0 - 1e-9), 0.1),  # met to rounding
    ],
)  # fmt: skip
def test_motions_without_a_notice(motion):
    assert motion().notices == ()


@pytest.mark.long
def test_what_deserves_attention_is_told():
    crude = spinning(duration=1.0, dt=0.1, integrator=cp.simulation.ExplicitEuler())
    assert "energy appeared or vanished without work" in " ".join(crude.notices)
    found = rolling()
    pushed = replace(found, tau=np.ones_like(found.tau))
    assert "without work" in "".join(pushed.notices)
    beyond = "joint is 96.2 mm beyond its limits, and the scene has no stops there"
    assert beyond in str(limited(-0.1, 0.1, 0.0, 0.2))


@pytest.mark.parametrize(
    ("solver", "words"),
    [
        (cp.DenseKKT(mu=1e-2), "accelerations may be off by .* give Dense KKT more iterations"),
        (cp.dynamics.ConjugateGradient(max_iterations=1), "accelerations may be off"),
        (cp.Proximal(mu=1e-2, max_iterations=1), "accelerations may be off"),
        (cp.dynamics.Soft(), "Soft has compliant constraints; use a stiffer solref"),
        (cp.dynamics.NullSpace(), ""),
        (None, ""),
    ],
)
def test_what_a_projection_hides_is_told(solver, words):
    found = on_bar(duration=0.5, solver=solver)
    assert found.status is RunStatus.FINISHED
    assert re.search(words, " ".join(found.notices)) if words else found.notices == ()


@pytest.mark.long
@pytest.mark.parametrize("drift", [cp.Baumgarte.critical(30.0), cp.simulation.NoDrift()], ids=repr)
def test_iterations_that_move_nothing_are_left_out(drift):
    """Rows that are redundant come to life where loops are a little open."""
    cassie = cp.Scene(robot("cassie"), robot("cassie").loops)
    q, _ = cassie.state()
    v = cp.mechanism.project_velocity(cassie, q, 0.3 * np.random.default_rng(0).normal(size=32))
    found, *others = (
        cp.simulate(cassie, q, v, duration=0.1, drift=drift, solver=solver)
        for solver in (None, cp.Proximal(), cp.dynamics.NullSpace())
    )
    assert found.run.solver == cp.Proximal(max_iterations=4)
    for whole in others:
        assert whole.violation.max() > 1e-8
        np.testing.assert_allclose(found.q[-1], whole.q[-1], rtol=0, atol=1e-12)
        np.testing.assert_allclose(found.v[-1], whole.v[-1], rtol=0, atol=1e-10)
    assert on_bar(duration=0.01).run.solver == cp.Proximal()


# Runs that break down.


@pytest.mark.long
@each_row("kind", [cp.simulation.ImplicitMidpoint, cp.simulation.Rattle, cp.simulation.Shake])
def test_a_first_step_that_cannot_be_taken_leaves_the_first_state(kind):
    """A spring of 20 kHz in steps of 1 ms."""
    scene, q, v = bar()
    sprung = replace(scene.robot, springs=[cp.model.Spring("crank", 5e6, 1.0)])
    stiff = cp.Scene(sprung, sprung.loops)
    found = cp.simulate(stiff, q, v, duration=0.01, integrator=kind())
    assert found.status is RunStatus.FAILED
    assert f"{kind.title} at t = 0 s" in found.reason
    assert "take a smaller dt than 0.001 s" in found.reason
    assert np.array_equal(found.q, [q])
    assert np.isfinite(found.a).all()


@pytest.mark.long
@pytest.mark.parametrize("drift", [cp.simulation.NoDrift(), cp.simulation.PostStabilization()])
def test_the_last_state_that_was_reached_is_a_sample(drift):
    found = on_bar(lambda t, q, v: np.full(3, np.nan if t > 0.0105 else 2.0), drift=drift)
    whole = on_bar([2.0, 2.0, 2.0], 0.01, drift=drift)
    assert found.status is RunStatus.FAILED
    assert "tau" in found.reason
    for name in ("t", "q", "v", "a", "lam", "tau"):
        assert np.allclose(getattr(found, name), getattr(whole, name), rtol=1e-12, atol=1e-12), name


@pytest.mark.parametrize("record", [1, 5])
@pytest.mark.parametrize(
    "integrator", [cp.RungeKutta4(), cp.simulation.GeneralisedAlpha()], ids=repr
)
def test_a_run_that_fails_goes_to_the_last_state_that_could_be_solved(integrator, record):
    found = cp.simulate(
        falling()[0], [1.0], [0.0], lambda t, q, v: np.array([np.nan if t > 0.0731 else 1.0]),
        duration=0.2, dt=1e-2, integrator=integrator, record=record,
    )  # fmt: skip
    assert found.status is RunStatus.FAILED
    assert found.t[-1] == pytest.approx(0.07)
    assert (np.diff(found.t) > 0).all()
    assert found.q[-1, 0] == pytest.approx(1.0 - (G - 1.0) * 0.07**2 / 2)
    for array in (found.q, found.v, found.a, found.lam):
        assert np.isfinite(array).all()


@pytest.mark.long
@each_row(
    ("tau", "error", "words"),
    [
        (lambda t, q, v: np.full(3, np.nan), cp.InvalidArgument, "tau"),
        (lambda t, q, v: np.zeros(2), cp.InvalidArgument, r"tau\(0, q, v\) has shape \(2,\)"),
        (lambda t, q, v: 1 / 0, ZeroDivisionError, "division"),
    ],
)
def test_a_first_state_that_cannot_be_solved_is_an_error(tau, error, words):
    with pytest.raises(error, match=words):
        on_bar(tau)


@pytest.mark.long
def test_numbers_that_grow_stop_the_run():
    """Negative damping by a torque; and damping that ends before its numbers overflow."""
    ball, _ = falling()
    found = cp.simulate(ball, [0.0], [1.0], lambda t, q, v: 900.0 * v, duration=10.0, dt=1e-2)
    assert found.status is RunStatus.DIVERGED
    assert np.isfinite(found.q).all()
    assert not found.status.ok
    scene = cp.Scene(body(pin.JointModelRZ(), damping=2.5e4))  # a millionth of a second
    found = cp.simulate(scene, [0.0], [1.0], duration=4e-3, dt=1e-3)
    assert found.status is RunStatus.DIVERGED
    said = r"LinearlyImplicitMidpoint\(\), or dt below .* it moves at 2.97e\+42"
    assert re.search(said, found.reason)


def test_an_interrupt_keeps_what_was_measured():
    def progress(share):
        if share > 0.5:
            raise KeyboardInterrupt

    found = on_bar(progress=progress)
    assert found.status is RunStatus.INTERRUPTED
    assert 0.04 < found.t[-1] < 0.06


@pytest.mark.long
def test_an_open_state_is_an_error_that_names_the_gap():
    scene, q, v = bar()
    with pytest.raises(cp.errors.NotAssembled, match=r"is open by .* mm; Scene.assemble"):
        cp.simulate(scene, q + 0.01, v, duration=1.0)
    with pytest.raises(cp.errors.NotAssembled, match=r"has \|J v\| = .*mechanism.project_velocity"):
        cp.simulate(scene, q, v + 0.1, duration=1.0)


@each_row(
    ("arguments", "words"),
    [
        ({"duration": 0.0}, "duration"),
        ({"duration": np.inf}, "duration"),
        ({"dt": -1e-3}, "dt"),
        ({"dt": np.nan}, "dt"),
        ({"dt": 1e-300}, "steps"),
        ({"dt": 5e-324, "duration": 5e-323}, "its square under- or overflows"),
        ({"dt": 1e155, "duration": 1e156}, "its square under- or overflows"),
        ({"record": 0}, "record"),
        ({"record": True}, "record"),
        ({"integrator": "rk4"}, "integrator"),
        ({"integrator": cp.RungeKutta4}, "integrator"),
        ({"drift": 10.0}, "drift"),
        ({"gravity": 1}, "gravity"),
        ({"solver": "proximal"}, "solver = 'proximal'"),
        (
            {"solver": cp.dynamics.Soft(), "integrator": cp.simulation.Rattle()},
            "RATTLE keeps hard constraints",
        ),
        (
            {"solver": cp.dynamics.Soft(), "drift": cp.simulation.Projection()},
            "closes what Soft lets open",
        ),
        (
            {"solver": cp.dynamics.Soft(), "drift": cp.simulation.PostStabilization()},
            "closes what Soft lets open",
        ),
        ({"tau": np.zeros(4)}, "tau"),
        ({"tau": "none"}, "tau"),
        ({"tau": True}, "tau"),
        ({"q": np.zeros(2)}, "q"),
        ({"v": [np.nan, 0, 0]}, "v"),
        ({"scene": None}, "scene"),
        ({"close_start": 1}, "close_start = 1: True or False"),
    ],
)
def test_bad_input_is_refused(arguments, words):
    scene, q, v = bar()
    given = {"scene": scene, "q": q, "v": v, "duration": 0.01} | arguments
    with pytest.raises(cp.InvalidArgument, match=words):
        cp.simulate(**given)


@pytest.mark.values
@each_integrator
@pytest.mark.parametrize("dt", [1.1e-150, 1e-100, 1e30, 9e149])
def test_steps_of_any_size_end_in_a_run_or_in_an_error(integrator, dt):
    """Warnings are errors here: what overflows on the way may not come out as one."""
    scene, q, _ = bar()
    v = cp.mechanism.project_velocity(scene, q, [1.0, 2.0, 3.0])
    for drift in (None,) if integrator.keeps_constraints else (None, cp.Baumgarte(1.0, 1.0)):
        try:
            run = cp.simulate(
                scene, q, v, duration=3 * dt, dt=dt, integrator=integrator, drift=drift
            )
        except cp.CondynError:
            continue
        if run.status.ok:
            assert np.isfinite(run.q).all()
            assert dt < 1.0


# Samples.


@pytest.mark.long
def test_every_tenth_sample_is_the_same_motion():
    shares = []
    every = on_bar(duration=0.105)
    tenth = on_bar(duration=0.105, record=10, progress=shares.append)
    assert np.array_equal(tenth.q[:-1], every.q[::10])
    assert np.array_equal(tenth.a[:-1], every.a[::10])
    assert np.array_equal(tenth.lam[-1], every.lam[-1])
    assert tenth.t[-1] == every.t[-1] == pytest.approx(0.105)
    assert shares[-1] == 1.0
    assert shares == sorted(shares)


@pytest.mark.long
def test_a_duration_that_is_no_whole_number_of_steps():
    found = on_bar(duration=0.01, dt=3e-3)
    assert len(found) == 5
    assert found.t[-1] == pytest.approx(0.01)
    assert found.run.dt == pytest.approx(2.5e-3)


@pytest.mark.long
def test_the_arguments_are_not_written_to():
    scene, q, v = bar()
    q0, v0 = q.copy(), v.copy()
    found = cp.simulate(scene, q, v, duration=0.01)
    found.q[0] += 1.0
    assert np.array_equal(q, q0)
    assert np.array_equal(v, v0)


def test_what_is_printed():
    found = on_bar(duration=0.01)
    assert "RungeKutta4(), PostStabilization(), Proximal()" in str(found)
    assert repr(found) == "Trajectory(four_bar: 11 samples to t = 0.01 s, finished)"
    assert found.notices == ()


# Starts that are open.


def test_baumgarte_closes_an_open_start_at_its_rate():
    """c'' + 2 alpha c' + alpha^2 c = 0 along the motion, whatever the mechanism does."""
    run = {"duration": 0.5, "drift": cp.Baumgarte.critical(50.0)}
    with pytest.raises(cp.errors.NotAssembled):
        cp.simulate(*bar(0.02), **run)
    found = cp.simulate(*bar(0.02), **run, close_start=False)
    assert found.status is RunStatus.FINISHED
    assert found.violation[0] > 1e-3
    x = 50.0 * found.t
    rate = (1 + x) * np.exp(-x) * found.violation[0]
    # lam turns with its loop: the gap is measured in axes that move
    assert np.abs(found.violation - rate).max() < 0.02 * found.violation[0]
    assert found.violation[-1] < 1e-8
    assert f"open by {found.violation[0]:.2g} m or rad at the start" in "".join(found.notices)


def own_gains(gains: cp.Baumgarte) -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """The open four-bar, whose loop has gains of its own."""
    scene, q, v = bar(1e-3)
    own = [replace(each, drift=gains) for each in scene.constraints]
    return replace(scene, constraints=own), q, v


@pytest.mark.long
def test_gains_of_the_constraints_close_an_open_start_alone():
    gains = cp.Baumgarte.critical(50.0)
    run = {"duration": 0.1, "close_start": False}
    alone = cp.simulate(*own_gains(gains), **run, drift=cp.simulation.NoDrift())
    assert np.array_equal(alone.q, cp.simulate(*bar(1e-3), **run, drift=gains).q)
    with pytest.raises(cp.InvalidArgument, match=r"coupler_rocker has a drift of its own.*0\.0\)"):
        cp.simulate(*own_gains(cp.Baumgarte(50.0, 0.0)), **run, drift=gains)


@pytest.mark.long
def test_a_constraint_without_gains_is_named_where_others_close_their_own():
    scene, q, v = own_gains(cp.Baumgarte.critical(50.0))
    held = cp.constraints.HeldJoint("crank", name="brake")
    scene = replace(scene, constraints=[*scene.constraints, held])
    with pytest.raises(cp.InvalidArgument, match=r"NoDrift\(\) closes no gap of brake"):
        cp.simulate(scene, q, v, close_start=False, duration=0.1, drift=cp.simulation.NoDrift())


@pytest.mark.parametrize(
    "drift", [None, cp.simulation.PostStabilization(), cp.simulation.Projection()], ids=repr
)
def test_schemes_that_correct_close_an_open_start_too(drift):
    found = cp.simulate(*bar(1e-3), duration=0.02, drift=drift, close_start=False)
    assert found.status is RunStatus.FINISHED
    assert found.violation[-1] < 1e-8


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"drift": cp.simulation.NoDrift()}, r"drift = NoDrift\(\) closes no gap"),
        ({"drift": cp.Baumgarte(30.0, 0.0)}, r"drift = Baumgarte\(.*\) closes no gap"),
        ({"drift": cp.Baumgarte(0.0, 30.0)}, r"drift = Baumgarte\(.*\) closes no gap"),
        ({"drift": cp.simulation.Projection(position=False)}, r"closes no gap"),
        (
            {"integrator": cp.simulation.Rattle()},
            "RATTLE would close the start within one step",
        ),
        ({"solver": cp.dynamics.Soft()}, r"drift = NoDrift\(\) closes no gap"),
    ],
    ids=["nothing", "no beta", "no alpha", "velocities", "RATTLE", "soft"],
)
def test_an_open_start_that_nothing_closes_is_refused(options, match):
    with pytest.raises(cp.InvalidArgument, match=match):
        cp.simulate(*bar(1e-3), duration=0.02, close_start=False, **options)
