"""simulate: known motions, energy, events, and runs that break down."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from shared import robot

import condyn_pin as cp
from condyn_pin._core._pin import HAS_LCABA, pin
from condyn_pin.constraints.kinds import named
from condyn_pin.simulation.drift.post_stabilization import PostStabilization
from condyn_pin.simulation.drift.projection import Projection
from condyn_pin.simulation.integrators import INTEGRATORS, dormand_prince
from condyn_pin.simulation.integrators.generalised_alpha import GeneralisedAlpha
from condyn_pin.simulation.measures import work
from condyn_pin.simulation.stability_limit import growth, is_beyond, stability_limit
from condyn_pin.simulation.system import System

G = 9.81

# Corrections after a step: what they solve, the next step need not.
KEEPERS = [PostStabilization(), PostStabilization(every=2), Projection()]


def body(joint, *, inertia=0.01, mass=1.0, centre=(0.0, 0.0, 0.0), name="body") -> cp.Robot:
    """One body on one joint."""
    model = pin.Model()
    j = model.addJoint(0, joint, pin.SE3.Identity(), "joint")
    moments = inertia * np.diag([1.0, 2.0, 2.5])
    model.appendBodyToJoint(j, pin.Inertia(mass, np.array(centre), moments), pin.SE3.Identity())
    model.addFrame(pin.Frame("origin", j, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return cp.Robot(name, model)


@pytest.mark.parametrize("samples", [2, 3, 21, 64, 65, 400])
def test_work_is_the_integral_of_a_spline_through_the_power(samples):
    t = np.sort(np.random.default_rng(0).uniform(0.0, 2.0, samples))
    power = np.cos(3 * t)
    spline = CubicSpline(t, power)
    for _ in range(2):  # the second time the matrix of few samples is there already
        found = work(t, power)
        wanted = [spline.integrate(t[0], each) for each in t]
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-14)


def top() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """A free body whose origin is held: it spins about a point."""
    free = body(pin.JointModelFreeFlyer(), centre=(0.0, 0.0, 0.3), inertia=0.02)
    scene = cp.Scene(free, [cp.PointContact("origin")])
    return scene, pin.neutral(free.model), np.array([0.0, 0.0, 0.0, 0.5, 0.8, 9.0])


def bar() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    scene = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    return scene, *scene.state()


def falling() -> tuple[cp.Scene, cp.Scene]:
    """A ball in the air, and on the floor."""
    ball = body(pin.JointModelPZ())
    return cp.Scene(ball), cp.Scene(ball, [cp.constraints.PlanarContact("origin", height=0.0)])


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
    assert found.status is cp.simulation.RunStatus.FINISHED
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
    slider = body(pin.JointModelPX(), mass=2.0)
    model = pin.Model(slider.model)
    model.damping[:] = 3.0
    sprung = cp.Robot("sprung", model, springs=[cp.model.Spring("joint", 50.0, 0.1)])
    scene = cp.Scene(sprung)
    found = cp.simulate(scene, [0.4], [0.0], duration=1.0, dt=1e-3)
    decay, omega = 3.0 / 4.0, np.sqrt(25.0 - 0.75**2)
    t = found.t
    wanted = 0.1 + 0.3 * np.exp(-decay * t) * (
        np.cos(omega * t) + decay / omega * np.sin(omega * t)
    )
    assert np.abs(found.q[:, 0] - wanted).max() < 1e-11
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
    heavy = cp.simulate(scene, [0.0], [1.0], duration=1.0)
    assert heavy.q[-1] == pytest.approx(1.0 - G / 4 / 2)
    assert cp.simulate(scene, [0.0], [1.0], duration=1.0, armature=False).q[-1] == pytest.approx(
        1.0 - G / 2
    )
    floating = cp.simulate(scene, [0.0], [1.0], duration=1.0, gravity=False)
    assert floating.q[-1] == pytest.approx(1.0)
    assert "on: gravity, armature" in str(heavy)
    assert "off: gravity" in str(floating)
    assert "not in the model: springs, damping" in str(heavy)


# Integrators.


@pytest.fixture(scope="module")
def references():
    tight = cp.DormandPrince(relative_tolerance=1e-13, absolute_tolerance=1e-13)
    made = {}
    for make, duration in ((bar, 0.25), (top, 0.25)):
        scene, q, v = make()
        made[make] = cp.simulate(
            scene, q, v, duration=duration, dt=0.05, integrator=tight, drift=cp.simulation.NoDrift()
        )
    return made


@pytest.mark.parametrize("kind", cp.simulation.INTEGRATORS.values())
def test_samples_are_states_of_the_equations(kind):
    """t, q, v, a and lam of one sample belong together, to the order of the method."""
    scene, q, v = bar()
    found = cp.simulate(scene, q, v, duration=0.01, dt=1e-4, integrator=kind(), record=7)
    assert found.t == pytest.approx([*np.arange(0, 100, 7) * 1e-4, 0.01])
    for i in (0, 5, len(found) - 1):
        solution = cp.solve(found.scene, found.q[i], found.v[i], np.zeros(3), throw=False)
        assert np.abs(found.a[i] - solution.a).max() < 0.05 * np.abs(solution.a).max()
        assert np.abs(found.lam[i] - solution.lam).max() < 0.05 * np.abs(solution.lam).max()
    assert kind.title
    assert kind.use
    assert kind.solves_per_step > 0


@pytest.fixture
def at_end():
    """A method whose accelerations belong to the end of the step, as those of implicit ones do."""

    class AtEnd(cp.simulation.Integrator):
        title, order, use = "at the end", cp.SemiImplicitEuler.order, "here"
        symplectic, solves_per_step, a_at = False, 2, "end"

        def start(self, system, dt):
            inner = cp.SemiImplicitEuler().start(system, dt)

            def step(t, q, v):
                q1, v1, _ = inner.step(t, q, v)
                return q1, v1, system.acceleration(t + dt, q1, v1)

            return type(inner)(step, system.lam)

    yield AtEnd()
    del cp.simulation.INTEGRATORS["atend"]


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


@pytest.mark.parametrize(
    ("integrator", "more"),
    [(cp.simulation.Leapfrog(), 0), (cp.simulation.LinearlyImplicitMidpoint(), 2)],
    ids=repr,
)
def test_one_solve_a_step(monkeypatch, integrator, more):
    calls = []
    solve = System.solve
    monkeypatch.setattr(System, "solve", lambda *given: calls.append(1) or solve(*given))
    scene, q, v = bar()
    cp.simulate(
        scene, q, v, duration=0.1, integrator=integrator, drift=cp.simulation.NoDrift(), record=100
    )  # fmt: skip
    assert len(calls) == 100 + 1 + more  # the last sample, and the first step


def test_averaged_velocities_would_have_order_two(references):
    """What the correction on the manifold is for."""
    reference = references[top].q[-1]
    scene, q0, v0 = top()
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


def test_adaptive_steps_meet_their_tolerance(references):
    scene, q, v = bar()
    for tolerance, most in ((1e-6, 1e-4), (1e-10, 1e-8)):
        for method in (5, 8):
            found = cp.simulate(
                scene, q, v, duration=0.25, dt=0.05, drift=cp.simulation.NoDrift(),
                integrator=cp.DormandPrince(tolerance, tolerance, method),
            )  # fmt: skip
            assert np.abs(found.q[-1] - references[bar].q[-1]).max() < most


def test_substeps_that_just_do_not_fit_are_no_trouble():
    """dt of a hair more than whole substeps: the rest does not set the size of what follows."""
    scene = cp.Scene(cp.model.pendulum())
    calls = []
    for dt in (0.1, 0.1 * (1 + 1e-13), 0.1 / 3):
        called = []

        def tau(t, q, v, called=called):
            called.append(t)
            return np.zeros(1)

        found = cp.simulate(
            scene, [1.0], [0.0], tau, duration=20 * dt, dt=dt,
            integrator=cp.DormandPrince(1e-9, 1e-9),
        )  # fmt: skip
        assert found.status.ok
        calls.append(len(called))
    assert max(calls) < 2000


def test_adaptive_steps_give_up_where_damping_is_stiff(monkeypatch):
    monkeypatch.setattr(dormand_prince, "_MOST", 100)
    damped = body(pin.JointModelRZ())
    damped.model.damping[:] = 2.5e4  # a millionth of a second
    scene = cp.Scene(cp.Robot("damped", damped.model))
    choice = cp.DormandPrince()
    found = cp.simulate(scene, [0.0], [1.0], duration=1e-2, dt=1e-2, integrator=choice)
    assert found.status is cp.simulation.RunStatus.FAILED
    assert re.search(r"more than 100 substeps .* stiff; use SemiImplicit", found.reason)


def test_damping_of_light_rods_asks_for_no_small_dt():
    cassie = robot("cassie")
    scene = cp.Scene(cassie, [*cassie.loops, cp.SurfaceContact("pelvis")])
    q, v = scene.state()
    found = cp.simulate(scene, q, v, duration=0.2, integrator=cp.SemiImplicitEuler())
    assert found.status.ok
    assert found.violation.max() < 1e-5
    with_start = cp.SemiImplicitEuler(implicit=False)
    lost = cp.simulate(scene, q, v, duration=0.2, integrator=with_start)
    assert lost.status is cp.simulation.RunStatus.DIVERGED
    assert np.isfinite(lost.v).all()
    assert "grew without bound" in lost.notices[0]
    exact = cp.simulate(scene, q, v, duration=0.2)
    assert np.abs(exact.energy.error).max() < 1e-4
    assert np.abs(found.q[-1] - exact.q[-1]).max() < 0.02


# Drift.


def rod_pendulum() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """A point mass in a plane at the end of a rod of 1 m, from the horizontal."""
    model = pin.Model()
    x = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    z = model.addJoint(x, pin.JointModelPZ(), pin.SE3.Identity(), "z")
    model.appendBodyToJoint(z, pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
    model.addFrame(pin.Frame("mass", z, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    made = cp.Robot("mass", model, postures={"horizontal": np.array([1.0, 0.0])})
    rod = cp.Loop("world", "mass", "rod", length=1.0)
    return cp.Scene(made, [rod]), np.array([1.0, 0.0]), np.zeros(2)


@pytest.mark.parametrize(
    ("integrator", "dt", "alpha_dt", "gap", "slip", "energy"),
    [
        (cp.RungeKutta4(), 1e-2, 0.03, 5.10e-08, 2.26e-07, 1.80e-06),
        (cp.RungeKutta4(), 1e-2, 0.3, 2.70e-06, 1.39e-04, 1.43e-04),
        (cp.SemiImplicitEuler(), 1e-3, 0.1, 1.96e-04, 9.76e-03, 1.96e-02),
    ],
)
def test_drift_of_a_pendulum(integrator, dt, alpha_dt, gap, slip, energy):
    scene, q, v = rod_pendulum()
    drift = cp.Baumgarte.critical(alpha_dt / dt)
    found = cp.simulate(
        scene, q, v, duration=10.0, dt=dt, integrator=integrator, drift=drift,
        record=round(1e-2 / dt),
    )  # fmt: skip
    measured = (
        found.violation.max(),
        found.constraint_velocity.max(),
        np.abs(found.energy.error).max(),
    )
    assert np.allclose(measured, (gap, slip, energy), rtol=0.2)


@pytest.mark.parametrize(
    ("integrator", "dt", "power"),
    [(cp.RungeKutta4(), 2e-2, 2.0), (cp.simulation.ExplicitEuler(), 4e-3, 1.0)],
)
def test_growth_of_gaps_that_nothing_closes(integrator, dt, power):
    """As t^2 with high orders, as t with Euler's methods."""
    scene, q, v = rod_pendulum()
    found = cp.simulate(
        scene, q, v, duration=8.0, dt=dt, integrator=integrator, drift=cp.simulation.NoDrift(),
        record=round(2e-2 / dt),
    )  # fmt: skip
    half = len(found) // 2
    early, late = found.violation[half], found.violation[-1]
    assert np.log2(late / early) == pytest.approx(power, abs=0.2)


def test_walls_are_those_of_linear_theory():
    assert stability_limit(cp.simulation.ExplicitEuler()) == pytest.approx(2.0, abs=2e-4)
    assert stability_limit(cp.SemiImplicitEuler()) == pytest.approx(2 * np.sqrt(2) - 2, abs=2e-4)
    assert stability_limit(cp.RungeKutta4()) == pytest.approx(2.7853, abs=2e-4)
    assert stability_limit(cp.DormandPrince()) == np.inf
    popular = cp.Baumgarte(1e3, np.sqrt(2) * 1e3)  # Taylor's rule
    assert growth(cp.SemiImplicitEuler(), popular, 1e-3) == pytest.approx(1 + np.sqrt(2))
    assert growth(cp.simulation.ExplicitEuler(), popular, 1e-3) == pytest.approx(1.0)
    for dt in (1e-150, 1e-3, 1e150):  # only the product of gain and step counts
        assert growth(cp.SemiImplicitEuler(), cp.Baumgarte.deadbeat(dt), dt) < 1e-7
    assert growth(cp.RungeKutta4(), cp.Baumgarte(1.0, 1.0), 1e150) == np.inf


@pytest.mark.parametrize(("share", "stable"), [(0.82, True), (0.84, False)])
def test_the_wall_is_where_gaps_grow(share, stable):
    """The run itself, past the check."""
    scene, q, v = rod_pendulum()
    dt, tau = 1e-2, np.zeros(2)
    workspace = cp.Workspace(scene, drift=cp.Baumgarte.critical(share / dt))
    for _ in range(2000):
        v = v + dt * workspace.acceleration(q, v, tau)
        q = q + dt * v
        if not abs(np.hypot(*q) - 1.0) < 1.0:
            break
    assert (abs(np.hypot(*q) - 1.0) < 0.1) == stable


def test_torques_of_a_function_that_are_stiff():
    """Springs and dampers that the integrator does not know of, as its docstring says."""
    middle = cp.simulation.LinearlyImplicitMidpoint()
    assert 2 * stability_limit(middle, beta_per_alpha=0.0) == pytest.approx(1.0, abs=2e-4)
    oscillating = [growth(middle, cp.Baumgarte(0.0, omega), 1.0) for omega in (0.1, 1.4, 1.42)]
    assert 1 - 1e-4 < oscillating[0] < 1.0
    assert oscillating[1] < 1.0 < oscillating[2]


@pytest.mark.parametrize(
    "integrator", [cp.simulation.Leapfrog(), cp.simulation.LinearlyImplicitMidpoint()], ids=repr
)
@pytest.mark.parametrize(("share", "stable"), [(0.95, True), (1.05, False)])
def test_the_wall_of_integrators_that_remember_a_step(integrator, share, stable, monkeypatch):
    monkeypatch.setattr("condyn_pin.simulation.plan.check_stability_limit", lambda *_: None)
    scene, q, v = rod_pendulum()
    dt = 1e-2
    found = cp.simulate(
        scene, q, v, duration=20.0, dt=dt, integrator=integrator,
        drift=cp.Baumgarte.critical(share * stability_limit(integrator) / dt),
    )  # fmt: skip
    assert (found.status.ok and found.violation.max() < 0.1) == stable


def test_gains_with_which_an_iteration_does_not_converge_are_refused():
    scene, q, v = bar()
    with pytest.raises(cp.InvalidArgument, match=r"every gap grows .* is stable below"):
        cp.simulate(
            scene, q, v, duration=1.0, dt=1e-3, integrator=cp.ImplicitMidpoint(),
            drift=cp.Baumgarte.critical(2e3),
        )  # fmt: skip


def test_gains_beyond_the_wall_are_refused():
    scene, q, v = bar()
    popular = cp.Baumgarte(1e3, np.sqrt(2) * 1e3)  # Taylor's rule
    with pytest.raises(cp.InvalidArgument, match=r"2\.41 times a step; .* below 828\.4 / s"):
        cp.simulate(
            scene, q, v, duration=1.0, dt=1e-3, integrator=cp.SemiImplicitEuler(),
            drift=popular,
        )  # fmt: skip
    assert cp.simulate(scene, q, v, duration=0.01, drift=popular).status.ok


@pytest.mark.parametrize(
    ("integrator", "alpha", "beta"),
    [
        (cp.simulation.ExplicitEuler(), 2.0, 2.0),
        (cp.simulation.ExplicitEuler(), 1.0, 0.0),
        (cp.simulation.ExplicitEuler(), 0.5, 1.0),  # two conjugate eigenvalues on the circle
        (cp.simulation.ExplicitEuler(), 1.0, np.sqrt(2)),
        (cp.SemiImplicitEuler(), 1.0, 0.0),
        (cp.SemiImplicitEuler(), 0.0, 2.0),
        (cp.SemiImplicitEuler(), 2 * np.sqrt(2) - 2, 2 * np.sqrt(2) - 2),
        (cp.simulation.StormerVerlet(), 1.0, 1.0),
        (cp.simulation.StormerVerlet(), 0.0, 2.0),
        (cp.simulation.Leapfrog(), 0.0, 2.0),
        (cp.RungeKutta4(), 2.785293563405282 / 2, 0.0),
        (cp.simulation.LinearlyImplicitMidpoint(), 0.5, 0.0),
    ],
    ids=lambda each: f"{each:.3g}" if isinstance(each, float) else each.title,
)  # fmt: skip
def test_gains_at_the_wall_are_refused(integrator, alpha, beta):
    """There no gap shrinks, and a hundredth below it each does."""
    scene, q, v = rod_pendulum()
    dt = 1e-3
    options = {"duration": 0.01, "dt": dt, "integrator": integrator}
    with pytest.raises(cp.InvalidArgument, match=r"no gap shrinks; .* is stable below"):
        cp.simulate(scene, q, v, drift=cp.Baumgarte(alpha / dt, beta / dt), **options)
    below = cp.Baumgarte(0.99 * alpha / dt, 0.99 * beta / dt)
    assert cp.simulate(scene, q, v, drift=below, **options).status.ok


@pytest.mark.parametrize(
    "name",
    sorted(
        name
        for name, kind in cp.simulation.INTEGRATORS.items()
        if not (kind.keeps_constraints or kind.is_adaptive)
    ),
)
def test_the_walls_of_all_integrators_are_open(name):
    """What is refused begins at the wall that is told, whatever it is."""
    integrator = cp.simulation.INTEGRATORS[name]()
    limit = stability_limit(integrator)
    assert is_beyond(integrator, cp.Baumgarte.critical(limit + 2e-4), 1.0)
    assert not is_beyond(integrator, cp.Baumgarte.critical(limit - 2e-4), 1.0)
    for slow in (1e-9, 1e-6, 1e-3):  # gains that hardly do anything are no walls
        for alpha, beta in ((slow, slow), (slow, 0.0), (0.0, 0.0)):
            assert not is_beyond(integrator, cp.Baumgarte(alpha, beta), 1.0)


def test_gains_by_other_names():
    settling = cp.Baumgarte.from_settling_time(0.1)
    x = 0.1 * settling.alpha
    assert (1 + x) * np.exp(-x) == pytest.approx(0.02, abs=1e-5)
    assert settling.alpha == settling.beta
    assert cp.Baumgarte.from_solref(0.02, 1.0) == cp.Baumgarte.critical(50.0)
    assert cp.Baumgarte.from_solref(0.02, 0.5).to_solref() == pytest.approx((0.02, 0.5))
    for wrong in (
        lambda: cp.Baumgarte.from_solref(0.0, 1.0),
        lambda: cp.Baumgarte.deadbeat(-1.0),
        lambda: cp.Baumgarte.from_settling_time(0),
    ):
        with pytest.raises(cp.InvalidArgument):
            wrong()


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
    scene, q, v = bar()
    assert (
        cp.simulate(scene, q, v, duration=0.01, solver=cp.dynamics.Soft()).run.drift
        == cp.simulation.NoDrift()
    )
    if HAS_LCABA:
        with pytest.raises(cp.errors.UnsupportedConstraint, match="ignores drift control"):
            cp.simulate(
                scene, q, v, duration=0.01, solver=cp.LCABA(), drift=cp.Baumgarte.critical(9.0)
            )
        found = cp.simulate(scene, q, v, duration=0.1, solver=cp.LCABA())
        assert found.status.ok
        assert found.violation[1:].max() < 1e-12


# Torques and work.


def test_rounding_of_what_rests_is_no_energy():
    """A ball held where all its energies are zero."""
    held = cp.Scene(body(pin.JointModelFreeFlyer(), inertia=1 / 600), [cp.SurfaceContact("origin")])
    found = cp.simulate(held, *held.state(), duration=0.2)
    assert 0 < np.abs(found.energy.error).max() < 1e-20
    assert found.notices == ()


def test_energy_changes_by_the_work_of_the_torques():
    scene, q, v = bar()

    def tau(t, q, v):
        return np.array([3.0 * np.sin(7.0 * t) - 0.5 * v[0], 0.0, 0.0])

    found = cp.simulate(scene, q, v, tau, duration=1.0)
    assert np.ptp(found.energy.work) > 0.5
    assert np.abs(found.energy.error).max() < 1e-6
    assert np.array_equal(found.tau[400], tau(0.4, found.q[400], found.v[400]))
    constant = cp.simulate(scene, q, v, [2.0, 0, 0], duration=0.5)
    swept = found.scene.robot.nv and constant.q[-1, 0] - q[0]
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


def test_a_function_that_returns_its_own_buffer():
    buffer = np.zeros(3)
    scene, q, v = bar()

    def tau(t, q, v):
        buffer[0] = np.cos(t)
        return buffer

    found = cp.simulate(scene, q, v, tau, duration=0.1)
    assert np.allclose(found.tau[:, 0], np.cos(found.t))


@pytest.mark.parametrize("drift", KEEPERS, ids=repr)
@pytest.mark.parametrize("integrator", INTEGRATORS.values(), ids=lambda kind: kind.__name__)
def test_torques_belong_to_their_sample(integrator, drift):
    """Also where two steps share a solve, and where a function returns a buffer of its own."""
    scene, q, v = bar()
    buffer = np.zeros(3)

    def tau(t, q, v):
        buffer[:] = np.cos(40 * t) - 0.1 * v
        return buffer

    found = cp.simulate(
        scene, q, v, tau, duration=0.03, dt=5e-3, integrator=integrator(), drift=drift
    )
    wanted = np.cos(40 * found.t)[:, None] - 0.1 * found.v
    assert np.abs(found.tau - wanted).max() < 1e-14


# Events.


def test_landing_is_found_and_stays():
    air, floor = falling()
    touch = cp.Event(name="land", when=lambda m: m.position("origin")[2], scene=floor)
    found = cp.simulate(air, [1.0], [0.0], duration=1.0, dt=7e-3, events=[touch])
    (landed,) = found.run.happened
    assert landed.t == pytest.approx(np.sqrt(2 / G), abs=1e-11)
    assert landed.energy_lost == pytest.approx(G)
    assert landed.added == ("origin",)
    assert found.t[landed.sample - 1] == found.t[landed.sample] == landed.t
    assert np.abs(found.q[landed.sample :]).max() < 1e-10
    assert found.forces["origin"][-1] == pytest.approx([0.0, 0.0, G])
    assert not found.forces["origin"][: landed.sample].any()
    assert np.abs(found.energy.error).max() < 1e-9
    assert found.row_names == ("origin.z",)
    assert found.t[-1] == 1.0


def test_rebounds_until_they_pile_up():
    air, floor = falling()
    bounce = cp.Event(
        name="bounce", when=lambda m: m.position("origin")[2], met=floor, restitution=0.5
    )
    found = cp.simulate(air, [1.0], [0.0], duration=5.0, dt=1e-2, events=[bounce])
    first = np.sqrt(2 / G)
    times = [first * (1 + 2 * sum(0.5**i for i in range(1, k + 1))) for k in range(4)]
    assert [event.t for event in found.run.happened[:4]] == pytest.approx(times, abs=1e-10)
    assert found.status is cp.simulation.RunStatus.PILED_UP
    assert "shorter than a step" in found.reason
    assert found.q.min() > -1e-9
    assert found.t[-1] < 3 * first


# the last is behind the end of a step, by less than is worth one
@pytest.mark.parametrize("at", [0.055, 0.06, 0.01 + 0.05])
def test_a_blow_at_a_time_happens_once(at):
    air, _ = falling()
    wall = cp.Scene(air.robot, [cp.constraints.PlanarContact("origin")])
    blow = cp.Event(name="blow", at=at, met=wall, restitution=0.5)
    found = cp.simulate(air, [1.0], [-1.0], duration=0.2, dt=1e-2, events=[blow])
    assert found.status is cp.simulation.RunStatus.FINISHED
    assert [(e.name, e.t) for e in found.run.happened] == [("blow", pytest.approx(at))]
    assert found.v[-1, 0] == pytest.approx(0.5 * (1.0 + G * at) - G * (0.2 - at))


def test_lift_off_when_the_force_ends():
    """Pulled up harder and harder: the ground lets go at its weight."""
    air, floor = falling()

    def pull(t, q, v):
        return np.array([20.0 * t])

    off = cp.Event(name="off", when=lambda m: m.forces["origin"][2], scene=air)
    found = cp.simulate(floor, [0.0], [0.0], pull, duration=1.0, dt=1e-2, events=[off])
    (event,) = found.run.happened
    assert event.t == pytest.approx(G / 20.0, abs=1e-10)
    assert (event.energy_lost, event.dropped) == (0.0, ("origin",))
    s = 1.0 - event.t
    assert found.q[-1, 0] == pytest.approx(20.0 * s**3 / 6, abs=1e-9)


@pytest.mark.parametrize(
    ("contact", "words"),
    [
        (cp.constraints.PlanarContact("origin"), ""),
        (cp.PointContact("origin"), " (the vertical is its normal)"),
    ],
)
def test_a_contact_that_pulls_is_told(contact, words):
    """Pulled up harder and harder, and nothing lets go; a contact that is gone pulls no more."""
    ball = body(pin.JointModelTranslation())
    held, free = cp.Scene(ball, [contact]), cp.Scene(ball)

    def pull(t, q, v):
        return np.array([0.0, 0.0, 20.0 * t])

    run = {"tau": pull, "duration": 1.0, "dt": 1e-2}
    start = held, [0.0, 0.0, 1.0], np.zeros(3)
    found = cp.simulate(*start, **run)
    assert found.notices == (
        f"origin: the contact pulls with {20.0 - G:.4g} N at t = 1 s{words}; the ground would let "
        "go; an Event takes it off",
    )
    off = cp.Event(name="off", when=lambda m: m.forces["origin"].in_world()[2], scene=free)
    assert cp.simulate(*start, **run, events=[off]).notices == ()


@pytest.mark.parametrize("height", np.linspace(0.1, 1.3, 5))  # rounded up, or down
def test_what_lets_go_of_the_ground_lands_again(height):
    """The floor lets a ball go that has no way but down: it is on the floor at once."""
    air, _ = falling()
    floor = cp.Scene(air.robot, [cp.constraints.PlanarContact("origin", height=height)])
    events = [
        cp.Event(name="off", at=0.1, scene=air),
        cp.Event(name="on", when=lambda m: m.q[0] - height, scene=floor),
    ]
    start = floor.assemble([height], fixed=[]).q
    found = cp.simulate(floor, start, [0.0], duration=0.3, dt=1e-2, events=events)
    assert [event.name for event in found.run.happened] == ["off", "on"]
    assert np.abs(found.q[:, 0] - height).max() < 1e-8


def test_scenes_with_the_same_constraints_are_one():
    """Neither the start nor an event has to be the same object: a foot that is off has no force."""
    air, floor = falling()
    touch = cp.Event(name="touch", when=lambda m: m.q[0], scene=floor)
    lift = cp.Event(name="lift", when=lambda m: m.forces["origin"][2], scene=cp.Scene(air.robot))
    found = cp.simulate(air, [0.1], [0.0], duration=0.3, events=[touch, lift])
    assert [event.name for event in found.run.happened] == ["touch"]


def test_a_condition_on_a_contact_that_is_off_is_named():
    air, _ = falling()
    other = cp.Scene(
        air.robot, [cp.constraints.PlanarContact("origin", height=-1.0, name="cellar")]
    )
    event = cp.Event(name="lift", when=lambda m: m.forces["origin"][2], scene=other)
    with pytest.raises(cp.InvalidArgument, match=r"'lift'.*asks for 'origin'.*has no constraint"):
        cp.simulate(air, [0.1], [0.0], duration=0.3, events=[event])
    misspelt = replace(event, when=lambda m: m.position("orgin")[2])
    with pytest.raises(cp.errors.UnknownName, match="orgin"):
        cp.simulate(air, [0.1], [0.0], duration=0.3, events=[misspelt])


def test_what_an_event_brings_is_kept_closed():
    """The first scene has nothing to close; that of the event has."""
    air, floor = falling()
    land = cp.Event(name="land", when=lambda m: m.q[0], scene=floor)
    found = cp.simulate(air, [1.0], [0.0], duration=0.1, events=[land])
    assert found.run.drift == cp.PostStabilization()
    assert cp.simulate(air, [1.0], [0.0], duration=0.1).run.drift == cp.simulation.NoDrift()


def test_events_at_a_time_and_the_end():
    air, floor = falling()
    floor = cp.Scene(air.robot, [cp.constraints.PlanarContact("origin")])
    events = [cp.Event(name="stop", at=0.25, scene=floor), cp.Event(name="end", at=0.5)]
    found = cp.simulate(air, [0.0], [0.0], duration=1.0, dt=4e-3, events=events)
    assert [(e.name, e.t) for e in found.run.happened] == [("stop", 0.25), ("end", 0.5)]
    assert found.status is cp.simulation.RunStatus.ENDED
    assert found.status.ok
    assert found.t[-1] == 0.5
    held = -G * 0.25**2 / 2
    assert found.q[-1, 0] == pytest.approx(held)
    assert found.phases[1].scene.constraints[0].height == pytest.approx(held)
    assert len(found.phases) == 2


def test_events_of_one_instant_all_happen():
    scene, q, v = bar()
    loose = cp.Scene(scene.robot)
    let_go, end = cp.Event(name="let go", at=0.05, scene=loose), cp.Event(name="end", at=0.05)
    for integrator in (cp.RungeKutta4(), cp.simulation.GeneralisedAlpha()):
        for at in (0.05, 0.0503):
            events = [replace(let_go, at=at), replace(end, at=at)]
            found = cp.simulate(scene, q, v, duration=0.1, events=events, integrator=integrator)
            assert [event.name for event in found.run.happened] == ["let go", "end"]
            assert found.status is cp.simulation.RunStatus.ENDED
            assert found.t[-1] == at


def test_two_feet_that_land_together_both_stay():
    """Two balls fall side by side, each with an event of its own; none takes the other's off."""
    model = pin.Model(body(pin.JointModelPZ()).model)
    j = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "second")
    model.appendBodyToJoint(j, pin.Inertia.FromSphere(2.0, 0.1), pin.SE3.Identity())
    model.addFrame(pin.Frame("other", j, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    balls = cp.Robot("balls", model)
    one = cp.constraints.PlanarContact("origin", height=0.0)
    both = [one, cp.constraints.PlanarContact("other", height=0.0)]
    events = [
        cp.Event(name="one", when=lambda m: m.q[0], scene=cp.Scene(balls, [one])),
        cp.Event(name="both", when=lambda m: m.q[1], scene=cp.Scene(balls, both)),
    ]
    for height in np.linspace(0.5, 1.0, 6):  # the root is found above zero, or below
        start = cp.Scene(balls), [height, height], [0.0, 0.0]
        found = cp.simulate(*start, duration=0.6, events=events)
        assert [event.name for event in found.run.happened] == ["one", "both"]
        assert found.run.happened[1].t == pytest.approx(np.sqrt(2 * height / G))
        assert np.abs(found.q[-1]).max() < 1e-9


def test_contacts_that_stay_keep_their_place():
    solo = robot("solo12")
    feet = solo.contacts
    four, three = cp.Scene(solo, feet), cp.Scene(solo, feet[1:])
    q, v = four.state()
    lift = cp.Event(name="lift", at=0.05, scene=three)
    found = cp.simulate(four, q, v, duration=0.1, dt=1e-3, events=[lift])
    before, after = (phase.scene.constraints for phase in found.phases)
    assert before[1:] == after
    assert found.lam.shape == (len(found.t), 12)
    assert not found.forces[feet[0].name][found.run.happened[0].sample :].any()
    assert found.violation.max() < 1e-6


def test_a_contact_that_lands_again_has_another_place():
    """A ball is let go, falls by 12 mm, and is held again where it is then."""
    ball = body(pin.JointModelTranslation())
    free, held = cp.Scene(ball), cp.Scene(ball, [cp.PointContact("origin")])
    events = [
        cp.Event(name="let go", at=0.05, scene=free),
        cp.Event(name="hold", at=0.1, scene=held),
    ]
    found = cp.simulate(held, [0.0, 0.0, 1.0], np.zeros(3), duration=0.2, events=events)
    assert found.status is cp.simulation.RunStatus.FINISHED
    assert found.q[-1] == pytest.approx([0.0, 0.0, 1.0 - 0.5 * G * 0.05**2], abs=1e-9)


def test_a_scene_that_does_not_fit_ends_the_run():
    air, floor = falling()
    early = cp.Event(name="floor", at=0.1, scene=floor)
    found = cp.simulate(air, [1.0], [0.0], duration=1.0, events=[early])
    assert found.status is cp.simulation.RunStatus.FAILED
    assert (
        "event 'floor': its scene does not fit the state: origin is open by 951 mm" in found.reason
    )
    assert found.t[-1] == pytest.approx(0.1)


def test_a_moment_knows_where_frames_are_and_how_fast():
    scene = cp.Scene(cp.model.pendulum(length=2.0))
    seen = []

    def look(moment):
        seen.append((moment.q[0], moment.v[0], moment.a[0], *moment.position("tip"),
                     *moment.velocity("tip")))  # fmt: skip
        return 1.0

    cp.simulate(scene, [0.4], [0.7], duration=0.01, events=[cp.Event(name="look", when=look)])
    assert len(seen) == 11
    for theta, speed, a, x, y, z, vx, vy, vz in seen:
        s, c = np.sin(theta), np.cos(theta)
        assert (x, y, z) == pytest.approx((-2 * s, 0, -2 * c))
        assert (vx, vy, vz) == pytest.approx((-2 * c * speed, 0, 2 * s * speed))
        assert a == pytest.approx(-G / 2 * s)


@pytest.mark.parametrize("turned", [False, True])
def test_a_contact_of_another_kind_may_keep_its_name(turned):
    """A heel, and then the whole foot: the force is as wide as the widest."""
    ball = body(pin.JointModelFreeFlyer())
    kinds = [cp.PointContact("origin"), cp.SurfaceContact("origin")]
    heel, flat = (cp.Scene(ball, [kind]) for kind in (kinds[::-1] if turned else kinds))
    event = cp.Event(name="flat", at=0.02, scene=flat)
    found = cp.simulate(heel, *heel.state(), duration=0.04, dt=1e-2, events=[event])
    weight = G * ball.mass * np.eye(6)[2]
    assert np.abs(found.forces["origin"] - weight).max() < 1e-9


def test_a_rod_and_a_ball_of_one_name_are_refused():
    scene, q, v = bar()
    rod = cp.Loop("crank_tip", "rocker_tip", "rod", length=0.5, name=scene.names[0])
    event = cp.Event(name="loose", at=0.02, scene=cp.Scene(scene.robot, [rod]))
    with pytest.raises(cp.InvalidArgument, match=r"'loose': .* one number in one scene"):
        cp.simulate(scene, q, v, duration=0.04, events=[event])


def test_a_condition_cannot_write_to_the_state():
    air, _ = falling()

    def moves(moment):
        moment.q[0] = 5.0
        return 1.0

    with pytest.raises(ValueError, match="read-only"):
        cp.simulate(air, [0.0], [0.0], duration=0.01, events=[cp.Event(name="push", when=moves)])


def test_springs_do_not_change_on_the_way():
    """The energy of the springs is that of one robot."""
    scene, q, v = bar()
    sprung = replace(scene.robot, springs=[cp.model.Spring(scene.robot.joints[0], 50.0, 0.3)])
    event = cp.Event(name="sprung", at=0.05, scene=cp.Scene(sprung, scene.constraints))
    with pytest.raises(cp.InvalidArgument, match="'sprung': its scene has other springs"):
        cp.simulate(scene, q, v, duration=0.1, events=[event])


def test_an_event_that_another_of_its_instant_undoes_is_told():
    air, floor = falling()
    events = [cp.Event(name="on", at=0.1, scene=floor), cp.Event(name="off", at=0.1, scene=air)]
    floor = cp.Scene(air.robot, [cp.constraints.PlanarContact("origin")])
    events[0] = replace(events[0], scene=floor)
    found = cp.simulate(air, [0.0], [0.0], duration=0.2, dt=1e-2, events=events)
    assert [event.name for event in found.run.happened] == ["on"]
    (said,) = found.run.missed
    assert "off did not happen: its scene went on at t = 0.1 s" in said


def test_joints_that_leave_their_limits_are_told():
    model = pin.Model(body(pin.JointModelPZ()).model)
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -0.1, 0.1
    scene = cp.Scene(cp.Robot("limited", model))
    found = cp.simulate(scene, [0.0], [0.0], duration=0.2)
    assert "joint is 96.2 mm beyond its limits; the dynamics know no limits" in str(found)
    assert cp.simulate(scene, [0.0], [0.0], duration=0.1).notices == ()


def test_events_are_refused():
    air, floor = falling()
    other = cp.Scene(robot("solo12"))
    good = cp.Event(name="a", at=0.1, scene=floor)
    for events, words in (
        ([cp.Event(name="a", at=0.1, scene=other)], "another model"),
        ([good, good], "two events are named 'a'"),
        (good, "a list is needed"),
        (None, "a list is needed"),
        ([cp.Event(name="a", when=lambda m: None)], "event 'a': its condition returns None"),
        ([cp.Event(name="a", when=lambda m: m.q[[0, 0]])], "event 'a': its condition returns"),
        ([3], "is not an Event"),
        ([cp.Event(name="a", at=-1.0)], "after the start"),
    ):
        with pytest.raises(cp.InvalidArgument, match=words):
            cp.simulate(air, [1.0], [0.0], duration=1.0, events=events)
    for arguments in (
        {"name": "a"}, {"name": "", "at": 1.0}, {"name": "a", "at": np.nan},
        {"name": "a", "when": 3.0}, {"name": "a", "at": 1.0, "scene": 3},
        {"name": "a", "at": 1.0, "scene": floor, "restitution": 3.0},
        {"name": "a", "at": 1.0, "scene": floor, "restitution": "hard"},
    ):  # fmt: skip
        with pytest.raises(cp.InvalidArgument):
            cp.Event(**arguments)
    with pytest.raises(cp.errors.UnknownName, match="no constraint named 'ceiling'"):
        cp.Event(name="a", at=1.0, scene=floor, restitution={"ceiling": 0.5})


def test_no_energy_is_missed_where_none_is_exchanged():
    """What rounding makes of a constant energy is no notice; what a bad method does, is."""
    spinning = cp.Scene(body(pin.JointModelFreeFlyer(), inertia=1.0))
    start = spinning, pin.neutral(spinning.robot.model), [1.0, 0.0, 0.0, 0.1, 3.0, 0.1]
    assert cp.simulate(*start, duration=0.2, gravity=False).notices == ()
    sleigh = cp.Scene(cp.model.sleigh(), cp.model.sleigh().contacts)
    state = sleigh.sample(np.random.default_rng(0))
    assert cp.simulate(sleigh, *state, duration=0.1).notices == ()
    crude = cp.simulate(
        *start, duration=1.0, dt=0.1, gravity=False, integrator=cp.simulation.ExplicitEuler()
    )
    assert "energy came or went without work" in " ".join(crude.notices)


def test_a_limit_that_is_met_to_rounding_is_not_left():
    model = pin.Model(body(pin.JointModelPZ()).model)
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = 0.0, 1.0
    scene = cp.Scene(cp.Robot("resting", model))
    weight = np.array([G * (1.0 - 1e-9)])
    assert cp.simulate(scene, [0.0], [0.0], weight, duration=0.1).notices == ()


# Runs that break down, or are not what they seem.


@pytest.mark.parametrize(
    ("solver", "words"),
    [
        (cp.DenseKKT(mu=1e-2), "accelerations may be off by .* give Dense KKT more iterations"),
        (cp.dynamics.ConjugateGradient(max_iterations=1), "accelerations may be off"),
        (cp.Proximal(mu=1e-2, max_iterations=1), "accelerations may be off"),
        (cp.dynamics.Soft(), "Soft lets them give way; use a stiffer solref"),
        (cp.dynamics.NullSpace(), ""),
        (None, ""),
    ],
)
def test_what_a_projection_hides_is_told(solver, words):
    scene, q, v = bar()
    found = cp.simulate(scene, q, v, duration=0.5, solver=solver)
    assert found.status is cp.simulation.RunStatus.FINISHED
    assert re.search(words, " ".join(found.notices)) if words else found.notices == ()


def test_each_phase_has_its_own_default_solver():
    air, floor = falling()
    land = cp.Event(name="land", when=lambda m: m.q[0], scene=floor)
    found = cp.simulate(air, [0.1], [0.0], duration=0.3, events=[land])
    assert found.notices == ()
    lifted = [land, cp.Event(name="lift", at=0.25, scene=air)]
    assert cp.simulate(air, [0.1], [0.0], duration=0.3, events=lifted).notices == ()


@pytest.mark.parametrize("drift", [cp.Baumgarte.critical(30.0), cp.simulation.NoDrift()], ids=repr)
def test_iterations_that_move_nothing_are_left_out(drift):
    """Rows that are redundant come to life where loops are a little open."""
    cassie = cp.Scene(robot("cassie"), robot("cassie").loops)
    q, _ = cassie.state()
    v = cp.mechanism.project_velocity(cassie, q, 0.3 * np.random.default_rng(0).normal(size=32))
    options = {"duration": 0.1, "drift": drift}
    found = cp.simulate(cassie, q, v, **options)
    assert found.run.solver == cp.Proximal(max_iterations=4)
    for other in (cp.Proximal(), cp.dynamics.NullSpace()):
        whole = cp.simulate(cassie, q, v, solver=other, **options)
        assert whole.violation.max() > 1e-8
        np.testing.assert_allclose(found.q[-1], whole.q[-1], rtol=0, atol=1e-12)
        np.testing.assert_allclose(found.v[-1], whole.v[-1], rtol=0, atol=1e-10)
    scene, q, v = bar()
    assert cp.simulate(scene, q, v, duration=0.01).run.solver == cp.Proximal()


def test_torques_that_become_nan_end_the_run():
    scene, q, v = bar()
    found = cp.simulate(
        scene, q, v, lambda t, q, v: np.full(3, np.nan if t > 0.1 else 0.0), duration=1.0
    )
    assert found.status is cp.simulation.RunStatus.FAILED
    assert "tau" in found.reason
    assert 0.09 < found.t[-1] < 0.11
    for array in (found.q, found.v, found.a, found.lam):
        assert np.isfinite(array).all()


@pytest.mark.parametrize("kind", [cp.ImplicitMidpoint, cp.simulation.Rattle, cp.simulation.Shake])
def test_a_first_step_that_cannot_be_taken_leaves_the_first_state(kind):
    """A spring of 20 kHz in steps of 1 ms."""
    scene, q, v = bar()
    sprung = replace(scene.robot, springs=[cp.model.Spring("crank", 5e6, 1.0)])
    stiff = cp.Scene(sprung, sprung.loops)
    found = cp.simulate(stiff, q, v, duration=0.01, integrator=kind())
    assert found.status is cp.simulation.RunStatus.FAILED
    assert f"{kind.title} at t = 0 s" in found.reason
    assert "take a smaller dt than 0.001 s" in found.reason
    assert np.array_equal(found.q, [q])
    assert np.isfinite(found.a).all()


@pytest.mark.parametrize("drift", [cp.simulation.NoDrift(), cp.PostStabilization()])
def test_the_last_state_that_was_reached_is_a_sample(drift):
    scene, q, v = bar()

    def tau(t, q, v):
        return np.full(3, np.nan if t > 0.0105 else 2.0)

    found = cp.simulate(scene, q, v, tau, duration=0.1, drift=drift)
    whole = cp.simulate(scene, q, v, [2.0, 2.0, 2.0], duration=0.01, drift=drift)
    assert found.status is cp.simulation.RunStatus.FAILED
    for name in ("t", "q", "v", "a", "lam", "tau"):
        assert np.allclose(getattr(found, name), getattr(whole, name), rtol=1e-12, atol=1e-12), name


@pytest.mark.parametrize("record", [1, 5])
@pytest.mark.parametrize("integrator", [cp.RungeKutta4(), GeneralisedAlpha()], ids=repr)
def test_a_run_that_fails_goes_to_the_last_state_that_could_be_solved(integrator, record):
    def tau(t, q, v):
        return np.array([np.nan if t > 0.0731 else 1.0])

    air, _ = falling()
    found = cp.simulate(
        air, [1.0], [0.0], tau, duration=0.2, dt=1e-2, integrator=integrator, record=record
    )
    assert found.status is cp.simulation.RunStatus.FAILED
    assert found.t[-1] == pytest.approx(0.07)
    assert (np.diff(found.t) > 0).all()
    assert found.q[-1, 0] == pytest.approx(1.0 - (G - 1.0) * 0.07**2 / 2)


def test_a_first_state_that_cannot_be_solved_is_an_error():
    scene, q, v = bar()
    with pytest.raises(cp.InvalidArgument, match="tau"):
        cp.simulate(scene, q, v, lambda t, q, v: np.full(3, np.nan), duration=1.0)
    with pytest.raises(cp.InvalidArgument, match=r"tau\(0, q, v\) has shape \(2,\)"):
        cp.simulate(scene, q, v, lambda t, q, v: np.zeros(2), duration=1.0)
    with pytest.raises(ZeroDivisionError):
        cp.simulate(scene, q, v, lambda t, q, v: 1 / 0, duration=1.0)


def test_numbers_that_grow_stop_the_run():
    """Negative damping by a torque."""
    ball, _ = falling()
    found = cp.simulate(ball, [0.0], [1.0], lambda t, q, v: 900.0 * v, duration=10.0, dt=1e-2)
    assert found.status is cp.simulation.RunStatus.DIVERGED
    assert np.isfinite(found.q).all()
    assert not found.status.ok


def test_a_run_that_ends_before_its_numbers_overflow_has_grown_all_the_same():
    damped = body(pin.JointModelRZ())
    damped.model.damping[:] = 2.5e4  # a millionth of a second
    scene = cp.Scene(cp.Robot("damped", damped.model))
    found = cp.simulate(scene, [0.0], [1.0], duration=4e-3, dt=1e-3)
    assert found.status is cp.simulation.RunStatus.DIVERGED
    assert re.search(
        r"LinearlyImplicitMidpoint\(\), or dt below .* it moves at 2.97e\+42", found.reason
    )


def test_an_open_state_is_an_error_that_names_the_gap():
    scene, q, v = bar()
    with pytest.raises(cp.NotAssembled, match=r"is open by .* mm; Scene.assemble"):
        cp.simulate(scene, q + 0.01, v, duration=1.0)
    with pytest.raises(cp.NotAssembled, match=r"slips at .*mechanism.project_velocity"):
        cp.simulate(scene, q, v + 0.1, duration=1.0)


def test_an_interrupt_keeps_what_was_measured():
    scene, q, v = bar()

    def progress(share):
        if share > 0.5:
            raise KeyboardInterrupt

    found = cp.simulate(scene, q, v, duration=0.1, progress=progress)
    assert found.status is cp.simulation.RunStatus.INTERRUPTED
    assert 0.04 < found.t[-1] < 0.06


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"duration": 0.0}, "duration"),
        ({"duration": np.inf}, "duration"),
        ({"dt": -1e-3}, "dt"),
        ({"dt": np.nan}, "dt"),
        ({"dt": 1e-300}, "steps"),
        ({"dt": 5e-324, "duration": 5e-323}, "its square is no number"),
        ({"dt": 1e155, "duration": 1e156}, "its square is no number"),
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
        ({"solver": cp.dynamics.Soft(), "drift": cp.Projection()}, "closes what Soft lets open"),
        (
            {"solver": cp.dynamics.Soft(), "drift": cp.PostStabilization()},
            "closes what Soft lets open",
        ),
        ({"tau": np.zeros(4)}, "tau"),
        ({"tau": "none"}, "tau"),
        ({"tau": True}, "tau"),
        ({"q": np.zeros(2)}, "q"),
        ({"v": [np.nan, 0, 0]}, "v"),
        ({"scene": None}, "scene"),
    ],
)
def test_bad_input_is_refused(arguments, words):
    scene, q, v = bar()
    given = {"scene": scene, "q": q, "v": v, "duration": 0.01} | arguments
    with pytest.raises(cp.InvalidArgument, match=words):
        cp.simulate(**given)


@pytest.mark.parametrize("kind", INTEGRATORS.values())
@pytest.mark.parametrize("dt", [1.1e-150, 1e-100, 1e30, 9e149])
def test_steps_of_any_size_end_in_a_run_or_in_an_error(kind, dt):
    """Warnings are errors here: what overflows on the way may not come out as one."""
    scene, q, v = bar()
    v = cp.mechanism.project_velocity(scene, q, [1.0, 2.0, 3.0])
    drifts = [None] if kind.keeps_constraints else [None, cp.Baumgarte(1.0, 1.0)]
    for drift in drifts:
        try:
            run = cp.simulate(
                scene, q, v, duration=3 * dt, dt=dt, integrator=kind(), drift=drift
            )  # fmt: skip
        except cp.CondynError:
            continue
        if run.status.ok:
            assert np.isfinite(run.q).all()
            assert dt < 1.0


# Samples and files.


@pytest.mark.parametrize("written", [1, 2])
@pytest.mark.parametrize("kind", cp.simulation.INTEGRATORS.values())
def test_a_function_cannot_write_to_the_state(kind, written):
    scene, q, v = bar()

    def tau(*arguments):
        arguments[written][:] = 0.0
        return np.zeros(3)

    with pytest.raises(ValueError, match="read-only"):
        cp.simulate(scene, q, v, tau, duration=0.01, integrator=kind())


def test_every_tenth_sample_is_the_same_motion():
    scene, q, v = bar()
    shares = []
    every = cp.simulate(scene, q, v, duration=0.105)
    tenth = cp.simulate(scene, q, v, duration=0.105, record=10, progress=shares.append)
    assert np.array_equal(tenth.q[:-1], every.q[::10])
    assert np.array_equal(tenth.a[:-1], every.a[::10])
    assert np.array_equal(tenth.lam[-1], every.lam[-1])
    assert tenth.t[-1] == every.t[-1] == pytest.approx(0.105)
    assert shares[-1] == 1.0
    assert shares == sorted(shares)


def test_a_duration_that_is_no_whole_number_of_steps():
    scene, q, v = bar()
    found = cp.simulate(scene, q, v, duration=0.01, dt=3e-3)
    assert len(found) == 5
    assert found.t[-1] == pytest.approx(0.01)
    assert found.run.dt == pytest.approx(2.5e-3)


def test_the_arguments_are_not_written_to():
    scene, q, v = bar()
    q0, v0 = q.copy(), v.copy()
    found = cp.simulate(scene, q, v, duration=0.01)
    found.q[0] += 1.0
    assert np.array_equal(q, q0)
    assert np.array_equal(v, v0)


def test_save_and_load(tmp_path):
    air, floor = falling()
    floor = cp.Scene(air.robot, [cp.constraints.PlanarContact("origin")])
    cassie = robot("cassie")
    hanging = cp.Scene(cassie, [*cassie.loops, cp.SurfaceContact("pelvis")])
    for scene, state, events in (
        (air, ([0.0], [0.0]), [cp.Event(name="stop", at=0.01, scene=floor)]),
        (hanging, hanging.state(), []),
    ):
        found = cp.simulate(scene, *state, duration=0.02, events=events)
        path = tmp_path / "run.npz"
        found.save(path)
        again = cp.Trajectory.load(path)
        for name in ("t", "q", "v", "a", "lam", "tau", "violation"):
            assert np.array_equal(getattr(found, name), getattr(again, name))
        assert again.run == found.run
        assert again.scene == found.scene
        assert [p.scene for p in again.phases] == [p.scene for p in found.phases]
        assert str(again) == str(found)


def test_files_that_are_none(tmp_path):
    text = tmp_path / "text.npz"
    text.write_text("no archive")
    other = tmp_path / "other.npz"
    np.savez(other, x=np.zeros(3))
    for path in (text, other, tmp_path / "missing.npz"):
        with pytest.raises(cp.InvalidArgument, match=path.name):
            cp.Trajectory.load(path)


def kinds_below(kind: type) -> set[type]:
    return {kind}.union(*(kinds_below(each) for each in kind.__subclasses__()))


def test_files_that_were_damaged(tmp_path):
    scene, q, v = bar()
    good, bad = tmp_path / "good.npz", tmp_path / "bad.npz"
    cp.simulate(scene, q, v, duration=0.01).save(good)
    with np.load(good) as file:
        content = dict(file)
    for name, array in (
        ("q", content["q"][:-1]), ("t", content["t"][:-1]), ("lam", content["lam"][:, :1]),
        ("v", np.nan * content["v"]), ("a", content["a"].astype(str)), ("tau", np.zeros(3)),
    ):  # fmt: skip
        np.savez(bad, **{**content, name: array})
        with pytest.raises(cp.InvalidArgument, match=f"no file of a trajectory.*{name}"):
            cp.Trajectory.load(bad)
    np.save(tmp_path / "array.npy", q)
    with pytest.raises(cp.InvalidArgument, match="no file of a trajectory"):
        cp.Trajectory.load(tmp_path / "array.npy")
    whole = good.read_bytes()
    refused = 0
    for i in range(0, len(whole), len(whole) // 60):
        bad.write_bytes(whole[:i] + bytes([whole[i] ^ 0xFF]) + whole[i + 1 :])
        try:
            cp.Trajectory.load(bad)  # a byte that says nothing, such as a date, may be any
        except cp.InvalidArgument:
            refused += 1
    assert refused > 30


def test_numbers_of_numpy_can_be_in_a_file(tmp_path):
    scene, q, v = bar()
    drift = cp.Projection(every=np.int64(2), tolerance=np.float32(1e-6))
    found = cp.simulate(scene, q, v, duration=np.float32(0.01), drift=drift)
    found.save(tmp_path / "run.npz")
    assert cp.Trajectory.load(tmp_path / "run.npz").run.drift == drift


def test_a_solver_of_ones_own_can_be_in_a_file(tmp_path):
    @dataclass(frozen=True)
    class Mine(cp.dynamics.NullSpace):
        pass

    scene, q, v = bar()
    try:
        cp.simulate(scene, q, v, duration=0.01, solver=Mine()).save(tmp_path / "run.npz")
        assert cp.Trajectory.load(tmp_path / "run.npz").run.solver == Mine()
    finally:
        del cp.dynamics.SOLVERS["mine"]
    with pytest.raises(cp.InvalidArgument, match="Mine is not known here: import the module"):
        cp.Trajectory.load(tmp_path / "run.npz")


def test_headers_that_do_not_fit(tmp_path):
    """What is in a file follows one another, and is of its kind: else it breaks later on."""
    scene, q, v = bar()
    path = tmp_path / "run.npz"
    let_go = cp.Event(name="let go", at=0.005, scene=cp.Scene(scene.robot))
    cp.simulate(scene, q, v, duration=0.01, events=[let_go]).save(path)
    with np.load(path) as file:
        content = dict(file)
    header = json.loads(str(content["header"]))

    def edited(*, t=content["t"], phase=(), run=()):
        changed = json.loads(str(content["header"]))
        changed["phases"][0].update(phase)
        changed["run"].update(run)
        np.savez(path, **{**content, "t": t, "header": np.array(json.dumps(changed))})
        return path

    happened = header["run"]["happened"][0]
    for changes, words in (
        ({"t": content["t"][::-1]}, "t goes back"),
        ({"phase": {"samples": [0, 3]}}, "do not follow 3"),
        ({"phase": {"samples": [0.5, 6]}}, "do not follow 0"),
        ({"phase": {"samples": [0, 0]}}, "do not follow 0"),
        ({"phase": {"columns": [0, 0, 1]}}, "3 different ones"),
        ({"phase": {"columns": [-1, 0, 1]}}, "3 different ones"),
        ({"run": {"dt": "fast"}}, "dt = 'fast'"),
        ({"run": {"wall_time": None}}, "wall_time"),
        ({"run": {"integrator": header["run"]["drift"]}}, "integrator = "),
        ({"run": {"happened": [{**happened, "sample": 99}]}}, "of 12 samples"),
        ({"run": {"happened": [{**happened, "sample": "a"}]}}, "of 12 samples"),
        ({"run": {"happened": [header["run"]["drift"]]}}, "of 12 samples"),
    ):
        with pytest.raises(cp.InvalidArgument, match=f"no file of a trajectory.*{words}"):
            cp.Trajectory.load(edited(**changes))
    assert len(cp.Trajectory.load(edited())) == 12


def test_a_file_with_a_loose_quaternion_is_refused(tmp_path):
    scene = cp.Scene(body(pin.JointModelFreeFlyer()))
    path = tmp_path / "run.npz"
    cp.simulate(scene, *scene.state(), duration=0.003).save(path)
    with np.load(path) as file:
        content = dict(file)
    content["q"][2, 3:] *= 2
    np.savez(path, **content)
    with pytest.raises(cp.InvalidArgument, match=r"q\[2\] has a quaternion"):
        cp.Trajectory.load(path)


def test_every_kind_of_constraint_can_be_in_a_file():
    kinds = {k for k in kinds_below(cp.constraints.Constraint) if not k.__abstractmethods__}
    ours = {k for k in kinds if k.__module__.startswith("condyn_pin")}
    assert {named(kind.__name__) for kind in ours} == ours


def test_csv(tmp_path):
    scene, q, v = bar()
    found = cp.simulate(scene, q, v, duration=0.01)
    found.to_csv(tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found)
    assert float(rows[5]["q1"]) == found.q[5, 1]
    assert float(rows[5]["kinetic [J]"]) == found.energy.kinetic[5]


def test_next_to_nothing_is_no_lost_energy():
    """A motion that exchanges nothing: what is left over is small beside the energy itself."""
    made = cp.model.rolling_ball()
    scene = cp.Scene(made, made.contacts)
    q, v = scene.sample(np.random.default_rng(3))
    found = cp.simulate(scene, q, v, duration=0.05)
    assert found.energy.scale < 1e-10 < found.energy.kinetic[0]
    assert found.notices == ()
    pushed = replace(found, tau=np.ones_like(found.tau))
    assert "without work" in "".join(pushed.notices)


def test_what_is_printed():
    scene, q, v = bar()
    found = cp.simulate(scene, q, v, duration=0.01)
    assert "RungeKutta4(), PostStabilization(), Proximal()" in str(found)
    assert repr(found) == "Trajectory(four_bar: 11 samples to t = 0.01 s, finished)"
    assert found.notices == ()


def test_events_that_do_not_happen_are_told(tmp_path):
    scene, q, v = bar()
    events = [
        cp.Event(name="late", at=3.0),
        cp.Event(name="floor", when=lambda moment: 1.0 + moment.t),
        cp.Event(name="below", when=lambda moment: -1.0),
        cp.Event(name="on time", at=0.01, scene=cp.Scene(scene.robot, scene.constraints[:0])),
    ]
    found = cp.simulate(scene, q, v, duration=0.02, events=events)
    late, floor, below = found.run.missed
    assert late == "late did not happen: the run ends before t = 3 s"
    assert floor.startswith("floor did not happen: its condition is 1.02 at the end")
    assert "below did not happen: its condition is -1 at the end, and has not been above" in below
    assert all(text in str(found) for text in found.run.missed)
    found.save(tmp_path / "run.npz")
    assert cp.Trajectory.load(tmp_path / "run.npz").run.missed == found.run.missed


def test_a_rebound_off_the_scene_that_goes_on_is_one():
    """A ball that falls through no floor: its scene is the one that runs, written out."""
    air, floor = falling()
    told = {"when": lambda m: m.position("origin")[2], "met": floor, "restitution": 0.5}
    again = cp.Scene(air.robot, air.constraints)
    runs = [
        cp.simulate(
            air, [1.0], [0.0], duration=0.7, dt=1e-2,
            events=[cp.Event(name="bounce", scene=scene, **told)],
        )
        for scene in (None, air, again)
    ]  # fmt: skip
    wanted, *found = runs
    assert len(wanted.run.happened) == 1
    for each in found:
        assert [e.t for e in each.run.happened] == [e.t for e in wanted.run.happened]
        assert np.array_equal(each.q, wanted.q)
        assert each.status is cp.simulation.RunStatus.FINISHED
    long = cp.simulate(
        air, [1.0], [0.0], duration=5.0, dt=1e-2,
        events=[cp.Event(name="bounce", scene=again, **told)],
    )  # fmt: skip
    assert long.status is cp.simulation.RunStatus.PILED_UP
    assert "shorter than a step" in long.reason
    assert long.q.min() > -1e-9


def test_a_blow_at_a_time_into_the_scene_that_goes_on():
    air, floor = falling()
    blow = cp.Event(name="blow", at=0.05, met=cp.Scene(air.robot, floor.constraints), scene=air)
    found = cp.simulate(air, [0.5 * G * 0.05**2], [0.0], duration=0.1, dt=1e-2, events=[blow])
    (event,) = found.run.happened
    assert event.t == 0.05
    assert event.energy_lost == pytest.approx(0.5 * (G * 0.05) ** 2)


def test_what_an_event_with_the_scene_of_another_does():
    """Nothing while its scene goes on, which is told, and its part once it does not."""
    air, floor = falling()
    again = cp.Scene(air.robot, floor.constraints)
    events = [
        cp.Event(name="land", when=lambda m: m.position("origin")[2], scene=floor),
        cp.Event(name="late", at=0.6, scene=again),
        cp.Event(name="up", at=0.7, scene=air),
        cp.Event(
            name="down",
            at=0.75,
            scene=cp.Scene(air.robot, [cp.constraints.PlanarContact("origin")]),
        ),
    ]
    found = cp.simulate(
        air, [1.0], [0.0], lambda t, q, v: np.array([2 * G * (t > 0.65)]), duration=0.8, dt=1e-2,
        events=events,
    )  # fmt: skip
    assert [event.name for event in found.run.happened] == ["land", "up", "down"]
    (said,) = found.run.missed
    assert said.startswith("late did not happen: its scene went on at t = 0.6 s")
    short = cp.simulate(air, [1.0], [0.0], duration=0.65, dt=1e-2, events=events[:2])
    assert short.run.missed == (
        "late did not happen: its scene is on already, and it brings no impact",
    )


def test_an_impact_that_tears_apart_what_goes_on_is_refused():
    """A bob on a hinge, struck by a floor that does not know of its loop."""
    scene, q, v = bar()
    floor = cp.Scene(scene.robot, [cp.PointContact("crank_tip")])
    event = cp.Event(name="struck", at=0.05, met=floor)
    found = cp.simulate(scene, q, v, duration=0.1, events=[event])
    assert found.status is cp.simulation.RunStatus.FAILED
    assert "'struck': its impact tears apart" in found.reason
    whole = cp.Scene(scene.robot, (*scene.constraints, cp.PointContact("crank_tip")))
    found = cp.simulate(scene, q, v, duration=0.1, events=[replace(event, met=whole)])
    assert found.status is cp.simulation.RunStatus.FINISHED


def open_bar(gap: float) -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """A four-bar whose loop is open."""
    scene, q, v = bar()
    return scene, q + np.array([gap, 0.0, 0.0]), v


def test_baumgarte_closes_an_open_start_at_its_rate():
    """c'' + 2 alpha c' + alpha^2 c = 0 along the motion, whatever the mechanism does."""
    scene, q, v = open_bar(0.02)
    with pytest.raises(cp.NotAssembled):
        cp.simulate(scene, q, v, duration=0.1, drift=cp.Baumgarte.critical(50.0))
    found = cp.simulate(
        scene, q, v, duration=0.5, drift=cp.Baumgarte.critical(50.0), close_start=False
    )
    assert found.status is cp.simulation.RunStatus.FINISHED
    assert found.violation[0] > 1e-3
    x = 50.0 * found.t
    rate = (1 + x) * np.exp(-x) * found.violation[0]
    # lam turns with its loop: the gap is measured in axes that move
    assert np.abs(found.violation - rate).max() < 0.02 * found.violation[0]
    assert found.violation[-1] < 1e-8
    assert f"open by {found.violation[0]:.2g} m or rad at the start" in "".join(found.notices)


@pytest.mark.parametrize("drift", [None, cp.PostStabilization(), cp.Projection()], ids=repr)
def test_schemes_that_correct_close_an_open_start_too(drift):
    scene, q, v = open_bar(1e-3)
    found = cp.simulate(scene, q, v, duration=0.02, drift=drift, close_start=False)
    assert found.status is cp.simulation.RunStatus.FINISHED
    assert found.violation[-1] < 1e-8


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"drift": cp.simulation.NoDrift()}, r"drift = NoDrift\(\) closes no gap"),
        ({"drift": cp.Baumgarte(30.0, 0.0)}, r"drift = Baumgarte\(.*\) closes no gap"),
        ({"drift": cp.Baumgarte(0.0, 30.0)}, r"drift = Baumgarte\(.*\) closes no gap"),
        ({"drift": cp.Projection(position=False)}, r"closes no gap"),
        ({"integrator": cp.simulation.Rattle()}, "RATTLE would close the start within one step"),
        ({"solver": cp.dynamics.Soft()}, r"drift = NoDrift\(\) closes no gap"),
    ],
    ids=["nothing", "no beta", "no alpha", "velocities", "RATTLE", "soft"],
)
def test_an_open_start_that_nothing_closes_is_refused(options, match):
    scene, q, v = open_bar(1e-3)
    with pytest.raises(cp.InvalidArgument, match=match):
        cp.simulate(scene, q, v, duration=0.02, close_start=False, **options)
    with pytest.raises(cp.InvalidArgument, match="close_start = 1: True or False"):
        cp.simulate(scene, q, v, duration=0.02, close_start=1)
