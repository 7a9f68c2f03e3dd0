"""Derivatives of steps with contacts: against differences, and against closed forms."""

from __future__ import annotations

import functools
import pickle
from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from motions import body
from shared import robot

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin.contact import ContactProblem
from condyn_pin.gradients import (
    ROUTES,
    ActiveSet,
    EventLocated,
    Kappa,
    Randomised,
    Softened,
    trajectory_derivatives,
)
from condyn_pin.gradients.routes.route import linear_steps

DT = 1e-3
DEEP = 9e-5  # of feet in the floor, less than a motion is refused at [m]
NEWTON = cp.contact.SemismoothNewton()
HARD = (cp.StewartTrinkle(contact=NEWTON), cp.Moreau(contact=NEWTON))
CONVEX = (cp.stepping.Anitescu(contact=NEWTON), cp.stepping.SoftStep(contact=NEWTON))
STATES = {
    "stick": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "slide": (0.4, 0.15, 0.0, 0.1, 0.2, 0.3),
    "turn": (0.3, 0.0, 0.0, 0.0, 0.0, 2.0),
    "air": (0.0, 0.0, 3.0, 1.0, 2.0, -1.0),
}


def touching(name: str, *, shape=None, friction=0.7, **variant) -> cp.Scene:
    """A robot whose feet may let go."""
    machine = cp.load_robot(name, **variant) if variant else robot(name)
    shape = shape or cp.constraints.Point()
    feet = [
        cp.FrictionalContact(c.frame, shape, offset=c.offset, friction=friction, name=c.name)
        for c in machine.contacts
    ]
    return cp.Scene(machine, machine.loops, contacts=feet)


def lowered(scene: cp.Scene, q: np.ndarray) -> np.ndarray:
    """The same posture, its highest foot in the floor: away from the kink at zero."""
    q = q.copy()
    q[2] -= max(cp.dynamics.contact_gaps(scene, q).values()) + DEEP
    return q


@functools.cache
def solo() -> tuple[cp.Scene, np.ndarray]:
    scene = touching("solo12", shape=cp.constraints.Ball(0.01))
    return scene, lowered(scene, scene.state()[0])


@functools.cache
def cassie() -> tuple[cp.Scene, np.ndarray]:
    scene = touching("cassie", variant={"feet": "points"})
    q = scene.state()[0]
    rng = np.random.default_rng(5)
    q = closed(scene, pin.integrate(scene.robot.model, q, 3e-3 * rng.normal(size=scene.robot.nv)))
    return scene, lowered(scene, q)


@functools.cache
def equations(scene: cp.Scene):
    return cp.Workspace(scene.bilateral).equations


def closed(scene: cp.Scene, q: np.ndarray) -> np.ndarray:
    """The nearest configuration whose loops are closed to rounding."""
    if not scene.rows:
        return q
    for _ in range(8):
        c, J = equations(scene).violation(q), equations(scene).jacobian(q)
        q = pin.integrate(scene.robot.model, q, -np.linalg.lstsq(J, c, rcond=1e-9)[0])
    return q


def tangent(scene: cp.Scene, q: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The part of a motion that keeps the loops closed."""
    if not scene.rows:
        return x
    J = equations(scene).jacobian(q)
    return x - np.linalg.lstsq(J, J @ x, rcond=1e-9)[0]


def between(model, end, start) -> np.ndarray:
    return np.concatenate([pin.difference(model, start[0], end[0]), end[1] - start[1]])


def slope(model, f, h: float) -> np.ndarray:
    """(8 (f(h) - f(-h)) - (f(2h) - f(-2h))) / 12 h, of a state (q, v)."""
    near, far = between(model, f(h), f(-h)), between(model, f(2 * h), f(-2 * h))
    return (8 * near - far) / (12 * h)


def misses(scene, q, v, tau, scheme, route, steps, seed=0) -> list[float]:
    """Relative errors of `jvp` along q, v and tau: against differences of the route's own step."""
    model, n = scene.robot.model, scene.robot.nv
    rng, found = np.random.default_rng(seed), []

    def end(q_, v_, tau_):
        now = cp.step(scene, q_, v_, tau_, dt=DT, integrator=scheme)
        if isinstance(route, ActiveSet):  # the step itself, not what the route makes of it
            return now.q, now.v
        d = now.derivatives(route=route)
        return d.q, d.v

    of = cp.step(scene, q, v, tau, dt=DT, integrator=scheme).derivatives(route=route)
    assert not of.one_sided
    x, zero = tangent(scene, q, rng.normal(size=n)), np.zeros(n)
    w, u = rng.normal(size=n), rng.normal(size=n)
    for moved, along, h in (
        (lambda s: end(closed(scene, pin.integrate(model, q, s * x)), v, tau), (x, zero, zero), 0),
        (lambda s: end(q, v + s * w, tau), (zero, w, zero), 1),
        (lambda s: end(q, v, tau + s * u), (zero, zero, u), 2),
    ):
        expected = slope(model, moved, steps[h])
        found.append(
            np.abs(np.concatenate(of.jvp(*along)) - expected).max() / np.abs(expected).max()
        )
    return found


@pytest.mark.parametrize("scheme", [*HARD, *CONVEX], ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("state", STATES)
def test_a_free_robot_in_each_mode(state, scheme):
    scene, q = solo()
    rng = np.random.default_rng(1)
    v = np.concatenate([STATES[state], np.zeros(12)]) + 0.01 * rng.normal(size=18)
    tau = np.concatenate([np.zeros(6), 0.5 * rng.normal(size=12)])
    by_q, by_v, by_tau = misses(scene, q, v, tau, scheme, ActiveSet(), (1e-6, 1e-4, 1e-3))
    assert by_q < 1e-9
    assert by_v < 3e-9  # differences of gaps / dt have that much rounding
    assert by_tau < 1e-10


@pytest.mark.long
@pytest.mark.parametrize("scheme", HARD, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("speed", [0.05, 1.0])
def test_loops_and_springs(scheme, speed):
    scene, q = cassie()
    n = scene.robot.nv
    v = tangent(scene, q, speed * np.random.default_rng(2).normal(size=n))
    by_q, by_v, by_tau = misses(scene, q, v, np.zeros(n), scheme, ActiveSet(), (3e-6, 1e-4, 1e-2))
    assert by_q < 1e-8
    assert by_v < 1e-8  # what closes the loops leaves 1e-13 / h, and gaps / dt
    assert by_tau < 1e-10
    of = cp.step(scene, q, v, dt=DT, integrator=scheme).derivatives()
    J = equations(scene).jacobian(of.q)
    assert np.abs(J @ of.dq_dtau).max() < 1e-12  # loops stay closed, whatever acts


@pytest.mark.long
@pytest.mark.parametrize("scheme", HARD, ids=lambda s: type(s).__name__)
def test_what_belongs_wherever_it_is_is_not_pulled_back(scheme):
    """Feet without an anchor, by states that move them: the step leaves them where they are."""
    made, rng = robot("solo12"), np.random.default_rng(3)
    scene, model, n = cp.Scene(made, made.contacts), made.model, made.model.nv
    q, v = scene.sample(rng)
    v, tau, x, w = 0.3 * v, np.zeros(n), rng.normal(size=n), rng.normal(size=n)

    def end(s):
        now = cp.step(
            scene, pin.integrate(model, q, s * x), v + s * w, tau, dt=DT, integrator=scheme
        )
        return now.q, now.v

    found = cp.step(scene, q, v, tau, dt=DT, integrator=scheme).derivatives().jvp(x, w, tau)
    expected = slope(model, end, 1e-5)
    for mine, wanted in zip(found, np.split(expected, 2), strict=True):
        assert np.abs(mine - wanted).max() < 1e-8 * np.abs(wanted).max()


@pytest.mark.parametrize("route", [Softened(), Kappa(1e-2), Kappa(1e-4), Kappa(1e-6)], ids=repr)
@pytest.mark.parametrize("state", ["stick", "slide"])
def test_smooth_routes_are_the_slopes_of_their_own_steps(route, state):
    scene, q = solo()
    v = np.concatenate([STATES[state], np.zeros(12)])
    v += 0.01 * np.random.default_rng(1).normal(size=18)
    by_q, by_v, by_tau = misses(scene, q, v, np.zeros(18), HARD[0], route, (1e-7, 1e-5, 1e-5))
    assert max(by_q, by_v, by_tau) < (1e-9 if isinstance(route, Softened) else 1e-8)


def test_kappa_goes_to_the_active_set():
    scene, q = solo()
    v = np.concatenate([STATES["slide"], np.zeros(12)])
    v += 0.01 * np.random.default_rng(1).normal(size=18)
    now = cp.step(scene, q, v, dt=DT)
    exact = now.derivatives().dv_dv
    off = [
        np.abs(now.derivatives(route=Kappa(10.0**-k)).dv_dv - exact).max() for k in (4, 6, 8, 10)
    ]
    assert off[1] < 0.1 * off[0]
    assert off[2] < 0.1 * off[1]
    assert off[3] < 0.2 * off[2]
    assert off[3] < 1e-5 * np.abs(exact).max()


def test_a_motion_is_differentiated_by_what_it_was_given():
    """Without its torques it would be another motion."""
    scene, q = solo()
    v, damping = 0.1 + np.zeros(18), lambda t, q, v: -0.1 * v
    push = cp.AppliedForce("base_link", [0.0, 1.0, 0.0])
    run = cp.simulate(scene, q, v, damping, duration=5e-3, dt=1e-3, forces=[push])
    given = trajectory_derivatives(run, damping, forces=[push])
    assert np.abs(given.q - run.q[-1]).max() < 1e-12
    for tau, forces in ((0.0, [push]), (damping, []), (lambda t, q, v: -0.2 * v, [push])):
        with pytest.raises(cp.InvalidArgument, match="pass what simulate was given"):
            trajectory_derivatives(run, tau, forces=forces)
    with pytest.raises(cp.InvalidArgument, match=r"wrt has none; .*names it"):
        given.by("friction")
    batch = cp.simulate_batch(scene, [q], [v], duration=2e-3, dt=1e-3, record=1)
    with pytest.raises(cp.InvalidArgument, match=r"of a batch, one: batch\[i\]"):
        trajectory_derivatives(batch)


def test_a_motion_that_a_drift_scheme_moves_is_not_that_of_a_route():
    """Its end was that of other steps, 1e-4 m off, and nothing said so."""
    bar = robot("four_bar")
    scene = cp.Scene(bar, bar.loops)
    start = scene.sample(np.random.default_rng(0))

    def motion(**more):
        return cp.simulate(scene, *start, duration=0.05, dt=5e-3, integrator=HARD[0], **more)

    assert np.abs(trajectory_derivatives(motion()).q - motion().q[-1]).max() < 1e-12
    for drift in (cp.simulation.PostStabilization(), cp.simulation.Projection()):
        with pytest.raises(cp.InvalidArgument, match="leave drift out, for Stewart-Trinkle closes"):
            trajectory_derivatives(motion(drift=drift))


@pytest.mark.long
def test_kappa_has_an_answer_where_feet_hit_the_floor_fast():
    """Solo12 at 10 rad/s: a path that ends short of an answer begins again further out."""
    scene, q = solo()
    smooth, hard = (cp.layers.Action(scene, 0.01, route=r) for r in (Kappa(1e-8), ActiveSet()))
    for seed in (2, 12, 17, 22, 32):
        rng = np.random.default_rng(seed)
        _, v = scene.sample(rng, speed=10.0)
        down = cp.mechanism.place_on_ground(scene, q)
        down[2] -= 1e-3 * rng.random()
        x, u = np.concatenate([down, v]), rng.normal(size=12)
        assert np.abs(smooth.step(x, u) - hard.step(x, u)).max() < 1e-3 * np.abs(v).max()


def pushed(force: float, route, **contact) -> cp.gradients.StepDerivatives:
    """A point mass of 1 kg on a floor with mu 0.5, pushed: it slips at 4.905 N."""
    ball = cp.model.free_ball(mass=1.0, radius=0.05)
    floor = cp.FrictionalContact("ball", cp.constraints.Point(), friction=0.5, **contact)
    scene = cp.Scene(ball, contacts=[floor])
    q, v = scene.state()
    q = q.copy()
    q[2] = -1e-6
    tau = np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0])
    return cp.step(scene, q, v, tau, dt=1e-2).derivatives(route=route)


def test_stick_and_slip_in_closed_form():
    assert abs(pushed(3.0, ActiveSet()).dv_dtau[0, 0]) < 1e-15
    slides = pushed(8.0, ActiveSet())
    assert slides.modes == {"ball": "slide"}
    assert slides.dv_dtau[0, 0] == pytest.approx(1e-2, rel=1e-12)
    # the push out of 1e-6 m lasts one step: its impulse is m (g dt + 0.2 gap / dt)
    impulse = 9.81e-2 + 0.2 * 1e-6 / 1e-2
    assert slides.dv_dfriction[0, 0] == pytest.approx(-impulse, rel=1e-12)
    # between the two, and rising: 1e-2 rounds the kink at 4.905 N over half a newton or so
    near = [pushed(f, Kappa(1e-4)).dv_dtau[0, 0] for f in (3.0, 4.8, 5.0, 8.0)]
    assert near == sorted(near)
    assert 1e-3 < near[1] < near[2] < 9e-3
    assert near[3] == pytest.approx(1e-2, rel=0.1)


@pytest.mark.parametrize("route", [ActiveSet(), cp.gradients.EventLocated()])
def test_corners_that_strike_at_once_have_slopes_of_one_way_and_a_sentence(route):
    half = cp.constraints.Box(0.1, 0.1, 0.05)
    floor = cp.constraints.FrictionalContact("box", half, friction=0.3, restitution=0.5)
    scene = cp.Scene(cp.model.free_box(size=(0.2, 0.2, 0.1)), contacts=[floor])
    q, v = np.array([0, 0, 0.0505, 0, 0, 0, 1.0]), np.array([0.5, 0, -1.0, 0, 0, 0])
    q[2] -= 0.0005 * isinstance(route, ActiveSet)  # it does not look for the landing
    of = cp.step(scene, q, v, dt=1e-3, integrator=cp.Moreau()).derivatives(route=route)
    assert of.one_sided
    assert [note.kind for note in of.notes] == ["strike"]
    assert "strike at once" in of.notices[0]


@pytest.mark.long
def test_what_is_about_to_slip_is_one_sided():
    assert pushed(0.5 * (9.81 + 0.2 * 1e-6 / 1e-4), ActiveSet()).one_sided
    assert not pushed(3.0, ActiveSet()).one_sided
    scene, q = solo()
    q = q.copy()
    q[2] += DEEP + 9.81 * DT**2  # in the step its feet come down to the floor, and no further
    assert cp.step(scene, q, np.zeros(18), dt=DT).derivatives().one_sided
    q[2] -= 9.81 * DT**2  # what rests at a gap of zero presses: it is in no other mode beside it
    for scheme in HARD:
        rests = cp.step(scene, q, np.zeros(18), dt=DT, integrator=scheme).derivatives()
        assert set(rests.modes.values()) == {"stick"}
        assert not rests.one_sided
    at_zero = [
        cp.step(scene, q + h * np.eye(19)[2], np.zeros(18), dt=DT).derivatives().dv_dq
        for h in (1e-12, -1e-12, -5e-10)
    ]
    for each in at_zero[1:]:  # those of the open side, whatever rounding makes of the gap
        np.testing.assert_allclose(each, at_zero[0], rtol=0, atol=1e-6 * np.abs(at_zero[0]).max())
    falls, at, v = bounce()  # it comes to the floor in the middle of the step, or just not
    v[2] = -1.0
    for off, sided in ((5e-9, True), (1e-7, False)):
        at[2] = 0.05 + 0.5 * DT + 1e-9 + off * DT
        of = cp.step(falls, at, v, dt=DT, integrator=cp.Moreau()).derivatives()
        assert of.modes == {"ball": "open"}
        assert of.one_sided == sided


def test_a_smooth_problem_without_an_answer_is_named():
    """A contact that jams along a line; on the way Newton's matrix is singular."""
    rng = np.random.default_rng(0)
    for _ in range(149):
        along = rng.normal(size=3)
        g, mu = along * rng.normal() * 3, rng.choice([0.3, 0.8, 1.5])
    problem = ContactProblem(np.outer(along, along), g, np.array([mu]))
    with pytest.raises(cp.errors.SolveFailed, match="another kappa may have an answer"):
        Kappa(1e-3).law(problem, np.zeros(3), 1.0, 1.0)


@pytest.mark.long
@pytest.mark.parametrize("kappa", [1e-2, 1e-4])
def test_what_rests_keeps_resting_by_a_smooth_law(kappa):
    """A box by Moreau's steps: above the floor by kappa g dt^2, and never in free fall."""
    box = cp.model.free_box(mass=1.0, size=(0.2, 0.12, 0.08))
    floor = cp.FrictionalContact("box", cp.constraints.Box(0.1, 0.06, 0.04), friction=0.5)
    scene, dt = cp.Scene(box, contacts=[floor]), 1e-2
    q, v = scene.state()
    q[2] = 0.04
    for _ in range(20):
        of = cp.step(scene, q, v, dt=dt, integrator=cp.Moreau()).derivatives(route=Kappa(kappa))
        q, v = of.q, of.v
        assert np.abs(v).max() < 4.1 * kappa * 9.81 * dt  # a quarter of the weight on each corner
    assert 0.0 < q[2] - 0.04 == pytest.approx(4 * kappa * 9.81 * dt**2, rel=1e-2)


@pytest.mark.long
def test_redundant_contacts_change_by_the_least():
    box = cp.model.free_box(mass=1.0, size=(0.2, 0.2, 0.1))
    floor = cp.FrictionalContact("box", cp.constraints.Box(0.1, 0.1, 0.05), friction=0.5)
    scene = cp.Scene(box, contacts=[floor])
    q, _ = scene.state()
    q = q.copy()
    q[2] = 0.05 - 1e-5
    at_rest = cp.step(scene, q, np.zeros(6), dt=DT).derivatives()
    assert np.abs(at_rest.dv_dtau[:3, :3]).max() < 1e-12  # it stays, whatever pushes a little
    v = np.array([1.0, 0.3, 0.0, 0.0, 0.0, 0.0])
    slides = cp.step(scene, q, v, dt=DT).derivatives()
    s = v[:2] / np.hypot(*v[:2])
    push = np.zeros(6)
    push[:2] = s
    _, faster = slides.jvp(np.zeros(6), np.zeros(6), push)
    assert faster[:2] == pytest.approx(DT * s, rel=1e-9)
    # across the slip friction turns with it: d v_t = (1 - mu g dt / |v|) across
    across = np.array([-s[1], s[0], 0.0, 0.0, 0.0, 0.0])
    _, turned = slides.jvp(np.zeros(6), across, np.zeros(6))
    impulse = 9.81 * DT + 0.2 * 1e-5 / DT
    assert turned[:2] == pytest.approx(
        across[:2] * (1 - 0.5 * impulse / np.hypot(*v[:2])), rel=1e-9
    )


def bounce() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """A ball half a metre above the floor."""
    ball = cp.model.free_ball(mass=1.0, radius=0.05)
    floor = cp.FrictionalContact("ball", cp.constraints.Ball(0.05), friction=0.2, restitution=0.8)
    scene = cp.Scene(ball, contacts=[floor])
    q, v = scene.state()
    q = q.copy()
    q[2] = 0.55
    return scene, q, v


def height(t: float, h: float, e: float = 0.8, g: float = 9.81) -> float:
    """Of the ball that is let go at h, after at most two bounces."""
    first = sqrt(2 * h / g)
    up, second = e * g * first, first + 2 * e * first
    if t < first:
        return h - g * t**2 / 2
    if t < second:
        return up * (t - first) - g * (t - first) ** 2 / 2
    return e * up * (t - second) - g * (t - second) ** 2 / 2


@pytest.mark.parametrize(("dt", "duration"), [(1e-1, 0.6), (1e-2, 0.6), (1.0, 1.0)])
def test_the_time_of_an_impact(dt, duration):
    scene, q, v = bounce()
    motion = cp.simulate(scene, q, v, duration=duration, dt=dt, integrator=cp.Moreau())
    of = trajectory_derivatives(motion, route=EventLocated(), wrt=["restitution"])
    by = 1e-5
    exact = (height(duration, 0.5 + by) - height(duration, 0.5 - by)) / (2 * by)
    by_e = (height(duration, 0.5, 0.8 + by) - height(duration, 0.5, 0.8 - by)) / (2 * by)
    assert of.q[2] - 0.05 == pytest.approx(height(duration, 0.5), abs=1e-9)
    assert of.dx_dx[2, 2] == pytest.approx(exact, abs=1e-7)
    assert of.by("restitution")[2, 0] == pytest.approx(by_e, abs=1e-7)
    if duration == 0.6:
        assert of.dx_dx[2, 2] == pytest.approx(0.7827, abs=1e-4)
        # the artefact of every step of fixed length
        assert trajectory_derivatives(motion).dx_dx[2, 2] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("dt", [1e-3, 5e-3])
def test_feet_on_their_way_out_of_the_ground(dt):
    """0.1 mm inside and not out within 1 ms: times at which they would close were 1e-33 s apart."""
    scene = touching("solo12")
    q, v = scene.state()[0].copy(), np.full(scene.robot.nv, 0.1)
    q[2] -= min(cp.dynamics.contact_gaps(scene, q).values()) + 1e-4
    rng, model = np.random.default_rng(3), scene.robot.model

    def end(q_, v_):
        of = cp.step(scene, q_, v_, dt=dt, throw=False).derivatives(route=EventLocated())
        return of.q, of.v

    of = cp.step(scene, q, v, dt=dt).derivatives(route=EventLocated())
    assert dt > 1e-3 or set(of.modes.values()) == {"open"}
    x, zero = rng.normal(size=model.nv), np.zeros(model.nv)
    for moved, along in (
        (lambda s: end(pin.integrate(model, q, s * x), v), (x, zero, zero)),
        (lambda s: end(q, v + s * x), (zero, x, zero)),
    ):
        expected = slope(model, moved, 1e-6)
        off = np.concatenate(of.jvp(*along)) - expected
        assert np.abs(off).max() < 1e-7 * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("speed", [0.0, 1e-6, 1e-2, -1e-2, -1.0])
@pytest.mark.parametrize("depth", [-1e-3, 0.0, 5e-10, 1e-6, 1e-3])
def test_events_come_to_an_end_wherever_a_step_begins(depth, speed):
    """A ball beside the floor, just in it or deep: no more than eight cuts, and none goes in."""
    scene, q, v = bounce()
    q[2], v[2] = 0.05 - depth, speed
    for dt in (1e-4, 1e-2):
        of = cp.step(scene, q, v, dt=dt, integrator=cp.Moreau(), throw=False)
        of = of.derivatives(route=EventLocated())
        assert np.isfinite(of.dv_dq).all()
        assert np.isfinite(of.dv_dv).all()
        assert of.q[2] - 0.05 > min(-depth, 0.0) - 1e-6


def test_a_located_impact_with_spin_and_friction():
    scene, q, _ = bounce()
    q[2] = 0.06
    v = np.array([0.3, 0.2, -1.0, 2.0, 1.0, 0.5])
    rng = np.random.default_rng(4)

    def end(q_, v_, tau_):
        of = cp.step(scene, q_, v_, tau_, dt=0.1, integrator=cp.Moreau())
        of = of.derivatives(route=EventLocated())
        return of.q, of.v

    of = cp.step(scene, q, v, dt=0.1, integrator=cp.Moreau()).derivatives(route=EventLocated())
    x, zero, model = rng.normal(size=6), np.zeros(6), scene.robot.model
    for moved, along in (
        (lambda s: end(pin.integrate(model, q, s * x), v, zero), (x, zero, zero)),
        (lambda s: end(q, v + s * x, zero), (zero, x, zero)),
        (lambda s: end(q, v, s * x), (zero, zero, x)),
    ):
        expected = slope(model, moved, 1e-5)
        off = np.concatenate(of.jvp(*along)) - expected
        assert np.abs(off).max() < 1e-7 * max(1.0, np.abs(expected).max())


@functools.cache
def plate() -> cp.Scene:
    """A body that moves in a plane, above a floor there."""
    model, still = pin.Model(), pin.SE3.Identity()
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    joint = model.addJoint(0, pin.JointModelPlanar(), still, "plate")
    inertia = pin.Inertia(1.0, np.array([0.1, 0.05, 0.0]), 0.02 * np.eye(3))
    model.appendBodyToJoint(joint, inertia, still)
    corner = pin.SE3(np.eye(3), np.array([0.2, 0.0, 0.0]))
    model.addFrame(pin.Frame("corner", joint, 0, corner, pin.FrameType.OP_FRAME))
    floor = cp.constraints.Plane(normal=(0.0, 1.0, 0.0), height=-0.5)
    contact = cp.FrictionalContact("corner", on=floor, friction=0.4)
    return cp.Scene(cp.Robot("plate", model), contacts=[contact])


def above_the_floor(gap: float, seed: int) -> np.ndarray:
    """The plate, turned by up to a radian, its corner at a height."""
    scene, q = plate(), pin.neutral(plate().robot.model)
    q = pin.integrate(scene.robot.model, q, np.array([0, 0, np.random.default_rng(seed).random()]))
    q[1] += gap - min(cp.dynamics.contact_gaps(scene, q).values())
    return q


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_noise_however_small_finds_how_a_plane_body_turns(seed):
    """Of turns of 1e-8 rad, as small noise makes them in a step, Pinocchio's difference loses."""
    now = cp.step(plate(), above_the_floor(0.1, seed), [0.5, 0.3, 0.7], dt=DT)
    of, noisy = now.derivatives(), now.derivatives(route=Randomised(20, 1e-5))
    for name in ("dq_dq", "dq_dv", "dq_dtau"):
        right = getattr(of, name)
        assert np.abs(getattr(noisy, name) - right).max() < 1e-5 * np.abs(right).max()


@pytest.mark.parametrize("seed", range(4))
def test_the_time_of_an_impact_of_a_plane_body_that_turns_slowly(seed):
    """Against differences of the ends, whose angle is that of their (cos, sin)."""
    scene, q, h = plate(), above_the_floor(5e-4, seed), 1e-5
    v = np.append(q[2] * np.array([0.1, -1.0]) + q[3] * np.array([-1.0, -0.1]), 0.1)

    def end(x):
        at = pin.integrate(scene.robot.model, q, x[:3])
        now = cp.step(scene, at, v + x[3:], dt=DT, integrator=HARD[1])
        return now.derivatives(route=EventLocated())

    of, by = end(np.zeros(6)), []
    assert of.modes["corner"] != "open"
    for x in h * np.eye(6):
        (c0, s0), (c1, s1) = end(-x).q[2:], end(x).q[2:]
        by.append(np.arctan2(c0 * s1 - s0 * c1, c0 * c1 + s0 * s1) / (2 * h))
    assert np.abs(np.hstack([of.dq_dq, of.dq_dv])[2] - by).max() < 1e-6


@pytest.mark.long
def test_noise_finds_the_slope_where_the_step_is_smooth():
    scene, q = solo()
    v = np.concatenate([STATES["slide"], np.zeros(12)])
    v += 0.01 * np.random.default_rng(1).normal(size=18)
    now = cp.step(scene, q, v, dt=DT, integrator=HARD[0])
    exact = now.derivatives()
    few, more = (
        now.derivatives(route=Randomised(30, sigma, seed=3)).dv_dv for sigma in (1e-4, 1e-5)
    )
    assert np.abs(few - exact.dv_dv).max() < 1e-2 * np.abs(exact.dv_dv).max()
    assert np.abs(more - exact.dv_dv).max() < 0.1 * np.abs(few - exact.dv_dv).max()
    again = now.derivatives(route=Randomised(30, 1e-4, seed=3)).dv_dv
    assert (again == few).all()


@pytest.mark.parametrize(
    ("scheme", "parameter", "samples"),
    [
        (HARD[0], "friction", 10), (HARD[1], "friction", 10), (HARD[1], "restitution", 10),
        (CONVEX[1], "solref", 10), (HARD[0], "inertias", 140),
    ],
    ids=lambda x: x if isinstance(x, str) else type(x).__name__,
)  # fmt: skip
def test_noise_finds_the_slope_by_parameters(scheme, parameter, samples):
    scene, q = solo()
    v = np.concatenate([STATES["slide"], np.zeros(12)])
    v += 0.01 * np.random.default_rng(1).normal(size=18)
    if parameter == "restitution":  # it counts where a foot comes down, and jumps at zero
        v[2] -= 0.2
        feet = [replace(foot, restitution=0.3) for foot in scene.contacts]
        scene = cp.Scene(scene.robot, contacts=feet)
    now = cp.step(scene, q, v, dt=DT, integrator=scheme)
    exact = now.derivatives(wrt=[parameter], route=Softened() if parameter == "solref" else None)
    route = Randomised(max(samples, 18), 1e-4, seed=3)
    noisy = now.derivatives(route=route, wrt=[parameter])
    wanted, found = exact.by(parameter), noisy.by(parameter)
    assert np.abs(wanted).max() > 0
    sizes = np.abs(wanted).max(axis=0)
    assert (np.abs(found - wanted) <= 1e-2 * np.maximum(sizes, 1e-3 * sizes.max())).all()


def test_noise_in_parameters_is_there_when_asked_for():
    """What else is varied is what it is without."""
    scene, q = solo()
    now = cp.step(scene, q, 0.1 * np.ones(18), dt=DT)
    plain = now.derivatives(route=Randomised(18, 1e-4))
    with pytest.raises(cp.InvalidArgument, match="friction"):
        plain.by("friction")
    more = now.derivatives(route=Randomised(18, 1e-4), wrt=["friction"])
    assert (more.dv_dv == plain.dv_dv).all()
    assert more.by("friction").shape == (36, 4)


def test_noise_takes_no_friction_below_zero():
    scene = touching("solo12", friction=1e-3)
    q = lowered(scene, scene.state()[0])
    now = cp.step(scene, q, np.zeros(18), dt=DT)
    with pytest.raises(cp.InvalidArgument, match="smaller sigma"):
        now.derivatives(route=Randomised(20, 1e-2), wrt=["friction"])


@pytest.mark.long
def test_noise_smooths_the_kink_between_stick_and_slip():
    # E[slope] over a normal force: half of 1e-2 at the kink itself
    ball = cp.model.free_ball(mass=1.0, radius=0.05)
    floor = cp.FrictionalContact("ball", cp.constraints.Point(), friction=0.5)
    scene = cp.Scene(ball, contacts=[floor])
    q, v = scene.state()
    q = q.copy()
    q[2] = -1e-6
    kink = 0.5 * (9.81 + 0.2 * 1e-6 / 1e-4)
    now = cp.step(scene, q, v, np.array([kink, 0, 0, 0, 0, 0.0]), dt=1e-2)
    of = now.derivatives(route=Randomised(300, 1e-3, seed=1))
    assert of.dv_dtau[0, 0] == pytest.approx(5e-3, rel=0.15)


@pytest.mark.parametrize("scheme", HARD, ids=lambda s: type(s).__name__)
def test_through_a_motion(scheme):
    scene, q = solo()
    n, model, home = 18, scene.robot.model, q[7:].copy()
    v = np.concatenate([STATES["slide"], np.zeros(12)])
    K, D = np.zeros((n, n)), np.zeros((n, n))
    K[6:, 6:], D[6:, 6:] = -2.0 * np.eye(12), -0.05 * np.eye(12)

    def hold(t, q, v):
        return K[:, 6:] @ (q[7:] - home) + D @ v

    def motion(q_, v_, of=scene):
        return cp.simulate(of, q_, v_, hold, duration=0.01, dt=DT, integrator=scheme)

    of = trajectory_derivatives(
        motion(q, v), hold, jacobian=lambda t, q, v: (K, D), wrt=["tau", "friction"]
    )
    rng = np.random.default_rng(8)
    x, y = rng.normal(size=2 * n), rng.normal(size=2 * n)

    def end(s):
        run = motion(pin.integrate(model, q, s * x[:n]), v + s * x[n:])
        return run.q[-1], run.v[-1]

    expected = slope(model, end, 3e-8)
    assert np.abs(of.dx_dx @ x - expected).max() < 1e-6 * np.abs(expected).max()
    assert np.concatenate(of.jvp(x[:n], x[n:])) == pytest.approx(of.dx_dx @ x, rel=1e-9, abs=1e-9)
    back = of.vjp(y[:n], y[n:])
    assert np.concatenate([back.q, back.v]) == pytest.approx(y @ of.dx_dx, rel=1e-9, abs=1e-9)
    assert back.tau.shape == (10, n)
    assert back.tau.sum(axis=0) == pytest.approx(y @ of.by("tau"), rel=1e-9, abs=1e-12)
    assert back.friction == pytest.approx(y @ of.by("friction"), rel=1e-9, abs=1e-12)
    shares = rng.normal(size=4)

    def end_of(s):
        contacts = [
            replace(c, friction=c.friction + s * x)
            for c, x in zip(scene.contacts, shares, strict=True)
        ]
        run = motion(q, v, cp.Scene(scene.robot, contacts=contacts))
        return run.q[-1], run.v[-1]

    expected = slope(model, end_of, 1e-3)
    assert np.abs(of.by("friction") @ shares - expected).max() < 1e-8 * np.abs(expected).max()


@pytest.mark.long
def test_what_sticks_has_no_slope_by_friction():
    box = cp.model.free_box(mass=1.0, size=(0.2, 0.12, 0.08))
    floor = cp.FrictionalContact("box", cp.constraints.Box(0.1, 0.06, 0.04), friction=0.5)
    scene = cp.Scene(box, contacts=[floor])
    q, v = scene.state()
    v[0] = 0.5  # it stops after 0.1019 s, v^2 / (2 mu g) further on
    by = {}
    for duration in (0.1, 0.125, 0.15):
        run = cp.simulate(scene, q, v, duration=duration, dt=1e-3, integrator=HARD[1])
        by[duration] = trajectory_derivatives(run, wrt=["friction"]).by("friction").sum(axis=1)
    assert by[0.1][0] == pytest.approx(-9.81 * 0.1**2 / 2, rel=1e-9)  # x = v t - mu g t^2 / 2
    assert by[0.125][0] == pytest.approx(-(0.5**2) / (2 * 0.5**2 * 9.81), rel=1e-2)  # its stop
    assert by[0.15] == pytest.approx(by[0.125], abs=1e-12)  # and rest adds nothing to it
    assert abs(by[0.15][6:]).max() < 1e-12
    tau = np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # less than mu m g
    run = cp.simulate(scene, q, 0 * v, tau, duration=0.02, dt=1e-3, integrator=HARD[1])
    assert abs(trajectory_derivatives(run, tau, wrt=["friction"]).by("friction")).max() < 1e-12


@pytest.mark.parametrize("ground", ["pair", "moving plane"])
def test_contacts_between_bodies(ground):
    low = cp.model.free_box(mass=2.0, size=(0.4, 0.4, 0.1))
    high = cp.model.free_ball(mass=1.0, radius=0.05)
    both = cp.model.together({"low": low, "high": high})
    names = [f.name for f in both.model.frames if f.name.endswith(("ball", "box"))]
    ball, box = next(n for n in names if "ball" in n), next(n for n in names if "box" in n)
    on = cp.constraints.Plane(height=0.05)
    if ground == "pair":
        on = cp.constraints.Box(0.2, 0.2, 0.05)
    contact = cp.FrictionalContact(
        ball, cp.constraints.Ball(0.05), on=box, on_shape=on, friction=0.4, name="between"
    )
    scene = cp.Scene(both, contacts=[contact])
    q, n = pin.neutral(both.model), both.model.nv
    bodies = [both.model.frames[both.model.getFrameId(f)].parentJoint for f in (box, ball)]
    low_z, high_z = (both.model.joints[joint].idx_q for joint in bodies)
    q[low_z + 2], q[high_z + 2] = 0.5, 0.5 + 0.05 + 0.05 - 1e-4
    q[high_z] = 0.03
    q = pin.integrate(both.model, q, 1e-3 * np.random.default_rng(0).normal(size=n))
    v = np.zeros(n)
    high_v = both.model.joints[bodies[1]].idx_v
    v[high_v : high_v + 3] = 0.5, 0.1, -0.2
    now = cp.step(scene, q, v, dt=DT, integrator=HARD[0])
    assert "open" not in now.modes.values()
    by_q, by_v, by_tau = misses(scene, q, v, np.zeros(n), HARD[0], ActiveSet(), (1e-6, 1e-4, 1e-3))
    assert max(by_q, by_v, by_tau) < 1e-7


@pytest.mark.long
def test_derivatives_of_a_step_solve_no_contact_problem_again(monkeypatch):
    """The step keeps what it has found, whatever steps come after it: the same bits."""
    scene, q = solo()
    v = np.random.default_rng(3).normal(size=18)
    now = cp.step(scene, q, 0.1 * v, dt=DT)
    first = now.derivatives()
    for speed in (0.2, 0.3):
        cp.step(scene, q, speed * v, dt=DT, throw=False)
    monkeypatch.setattr(cp.contact.ADMM, "attempt", None)
    monkeypatch.setattr(cp.contact.ADMM, "at_once", None)
    for again in (now, pickle.loads(pickle.dumps(now))):
        found = again.derivatives()
        assert all(map(np.array_equal, found.matrices, first.matrices))
        assert found.modes == first.modes
    with pytest.raises(TypeError):
        cp.step(scene, q, 0.1 * v, dt=DT)


@pytest.mark.long
def test_routes_in_turns_do_not_disturb_each_other():
    scene, q = solo()
    now = cp.step(scene, q, 0.1 * np.ones(18), dt=DT)
    routes = ActiveSet(), Softened(), Kappa(1e-2), Kappa(1e-4), ActiveSet()
    alone = [now.derivatives(route=route).matrices for route in routes]
    for _ in range(2):
        for route, wanted in zip(routes, alone, strict=True):
            assert all(map(np.array_equal, now.derivatives(route=route).matrices, wanted))


def test_what_a_step_does_not_depend_on_is_refused():
    of = pushed(8.0, ActiveSet())
    with pytest.raises(cp.InvalidArgument, match="restitution"):
        _ = of.dv_drestitution
    with pytest.raises(cp.InvalidArgument, match="solref"):
        _ = of.dv_dsolref
    with pytest.raises(cp.InvalidArgument, match="ActiveSet"):
        pushed(8.0, "active set")
    with pytest.raises(cp.InvalidArgument, match="kappa"):
        Kappa(0.0)
    with pytest.raises(cp.InvalidArgument, match="sigma"):
        Randomised(sigma=-1.0)
    with pytest.raises(cp.InvalidArgument, match="samples = 0: a whole number of at least 1"):
        Randomised(0, 1e-3)
    with pytest.raises(cp.InvalidArgument, match="seed = -1: a whole number of at least 0"):
        Randomised(seed=-1)
    with pytest.raises(cp.InvalidArgument, match="samples"):
        pushed(8.0, Randomised(samples=2))
    scene, q, v = bounce()
    falls = cp.simulate(scene, q, v, duration=0.01, dt=1e-3, integrator=cp.Moreau())
    soft = cp.stepping.SoftStep()
    scene = cp.Scene(scene.robot, contacts=[replace(scene.contacts[0], restitution=0.0)])
    with pytest.raises(cp.InvalidArgument, match="mass"):
        trajectory_derivatives(falls, wrt=["mass"])
    with pytest.raises(cp.InvalidArgument, match="convex"):
        cp.step(scene, q, v, dt=1e-3, integrator=soft).derivatives(route=EventLocated())


def test_soft_contacts_by_their_springs():
    scene, q = solo()
    v = np.concatenate([STATES["slide"], np.zeros(12)])

    def end(one: float, two: float) -> np.ndarray:
        now = cp.step(scene, q, v, dt=DT, integrator=HARD[0])
        return now.derivatives(route=Softened((0.02 + one, 1.0 + two))).v

    of = cp.step(scene, q, v, dt=DT, integrator=HARD[0]).derivatives(route=Softened((0.02, 1.0)))
    by_time = (end(1e-6, 0) - end(-1e-6, 0)) / 2e-6
    by_ratio = (end(0, 1e-5) - end(0, -1e-5)) / 2e-5
    assert of.dv_dsolref[:, 0] == pytest.approx(by_time, abs=1e-6)
    assert of.dv_dsolref[:, 1] == pytest.approx(by_ratio, abs=1e-9)


@pytest.mark.parametrize("name", ROUTES)
def test_forward_and_backward_are_one(name):
    scene, q, v = bounce()
    route = ROUTES[name]()
    of = cp.step(scene, q, v, dt=DT, integrator=cp.Moreau()).derivatives(route=route)
    rng = np.random.default_rng(6)
    dq, dv, dtau, q1, v1 = rng.normal(size=(5, 6))
    forward, (by_q, by_v, by_tau) = of.jvp(dq, dv, dtau), of.vjp(q1, v1)
    assert q1 @ forward[0] + v1 @ forward[1] == pytest.approx(by_q @ dq + by_v @ dv + by_tau @ dtau)
    # a ball in the air: it falls, whatever the route makes of contacts
    assert of.dv_dv == pytest.approx(np.eye(6), abs=2 * 9.81 * DT**2)
    assert of.dq_dtau[:3, :3] == pytest.approx(DT**2 / 2 * np.eye(3), abs=1e-6)


def test_springs_between_frames_and_a_planar_body():
    """Tension rods: their torques, and what they add to M, change with q."""
    model, still = pin.Model(), pin.SE3.Identity()
    base, arm = pin.Inertia(1.0, np.zeros(3), 0.02 * np.eye(3)), np.array([0.1, 0.0, 0.0])
    joint = model.addJoint(0, pin.JointModelPlanar(), still, "base")
    model.appendBodyToJoint(joint, base, still)
    shoulder = pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.1]))
    turns = model.addJoint(joint, pin.JointModelRY(), shoulder, "arm")
    model.appendBodyToJoint(turns, pin.Inertia(0.5, arm, 0.01 * np.eye(3)), still)
    for name, j, at in (("hip", joint, (0.0, 0.0, 0.3)), ("tip", turns, (0.2, 0.0, 0.0))):
        place = pin.SE3(np.eye(3), np.array(at))
        model.addFrame(pin.Frame(name, j, 0, place, pin.FrameType.OP_FRAME))
    spring = cp.model.SpringDamper("hip", "tip", stiffness=300.0, damping=2.0, rest_length=0.2)
    machine = cp.Robot("crane", model, spring_dampers=(spring,))
    touch = cp.FrictionalContact("tip", on=cp.constraints.Plane(height=0.02), friction=0.4)
    scene = cp.Scene(machine, contacts=[touch])
    q = pin.integrate(model, pin.neutral(model), np.array([0.1, -0.2, 0.4, np.arcsin(0.4005)]))
    v = np.array([0.5, 0.3, 0.7, 1.0])
    for scheme in HARD:
        for turn in (0.0, -0.6):  # on the floor, and in the air
            at = pin.integrate(model, q, np.array([0.0, 0.0, 0.0, turn]))
            off = misses(scene, at, v, np.zeros(4), scheme, ActiveSet(), (1e-6, 1e-4, 1e-3))
            assert max(off) < 3e-9
    assert cp.step(scene, q, v, dt=DT).modes["tip"] == "slide"


@pytest.mark.parametrize("route", [ActiveSet(), Kappa(1e-2), Softened()], ids=repr)
def test_stops_and_dry_friction_of_joints(route):
    scene, q = solo()
    machine = scene.robot
    joints = list(machine.model.names)[2:8]
    rubs = [cp.constraints.JointFriction(joint, torque=0.3) for joint in joints]
    stop = cp.constraints.JointLimit(joints[1])
    scene = cp.Scene(machine, contacts=[*scene.contacts, *rubs, stop])
    at, q = machine.model.joints[machine.model.getJointId(joints[1])].idx_q, q.copy()
    q[at] = machine.model.upperPositionLimit[at] - 1e-5
    v = np.concatenate([STATES["slide"], np.zeros(12)])
    v += 0.01 * np.random.default_rng(1).normal(size=18)
    tau = np.concatenate([np.zeros(6), np.random.default_rng(2).normal(size=12)])
    tau[at - 1] = 5.0
    modes = cp.step(scene, q, v, tau, dt=DT).modes
    assert modes[f"{joints[1]}/upper"] == "stick"
    assert {"stick", "slide"} <= {modes[f"{joint}/friction"] for joint in joints}
    off = misses(scene, q, v, tau, HARD[0], route, (1e-7, 1e-5, 1e-5))
    assert max(off) < 3e-8


@pytest.mark.parametrize("speed", [0.0, 0.1])
def test_dry_friction_of_zero_holds_nothing(speed):
    """At rest it was taken to stick: v+ had no slope by torques, though v+ = v + dt tau / m."""
    machine = body(pin.JointModelPX(), mass=2.0)
    nothing = cp.constraints.JointFriction("joint", torque=0.0)
    now = cp.step(cp.Scene(machine, contacts=[nothing]), [0.0], [speed], dt=DT)
    of = now.derivatives()
    assert of.dv_dtau == pytest.approx(np.full((1, 1), DT / 2.0))
    assert of.dv_dv == pytest.approx(np.ones((1, 1)))
    assert not of.one_sided
    with pytest.raises(cp.InvalidArgument, match=r"'joint/friction' can give no force.*leave it"):
        now.derivatives(route=Kappa())


@pytest.mark.long
def test_forces_from_outside_turn_with_the_body():
    scene, q = solo()
    model, push = scene.robot.model, cp.AppliedForce("base_link", (3.0, 2.0, 1.0))
    v = np.concatenate([STATES["slide"], np.zeros(12)])
    x, zero = np.random.default_rng(3).normal(size=18), np.zeros(18)

    def end(s: float):
        now = cp.step(
            scene, pin.integrate(model, q, s * x), v, dt=DT, integrator=HARD[0], forces=[push]
        )
        return now.q, now.v

    of = cp.step(scene, q, v, dt=DT, integrator=HARD[0], forces=[push]).derivatives()
    expected = slope(model, end, 1e-6)
    off = np.abs(np.concatenate(of.jvp(x, zero, zero)) - expected).max()
    assert off < 1e-9 * np.abs(expected).max()


def test_the_curved_paths_of_two_balls():
    """On links that turn by 0.05 rad in the step in which they meet."""
    model = pin.Model()
    for k, x in enumerate((0.0, 0.3)):
        hinge = pin.SE3(np.eye(3), np.array([x, 0, 0]))
        joint = model.addJoint(0, pin.JointModelRY(), hinge, f"hinge {k}")
        tip = pin.SE3(np.eye(3), np.array([0, 0, -0.2]))
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(0.5, 0.02), tip)
        model.addFrame(pin.Frame(f"tip {k}", joint, 0, tip, pin.FrameType.OP_FRAME))
    ball = cp.constraints.Ball(0.02)
    balls = cp.FrictionalContact("tip 0", ball, on="tip 1", on_shape=ball, friction=0.0)
    scene, v = cp.Scene(cp.Robot("arms", model), contacts=[balls]), np.array([-50.0, 50.0])
    run = cp.simulate(scene, [-0.2, 0.2], v, duration=0.02, dt=DT)
    first = int(np.flatnonzero(run.forces["tip 0"][:, 2] > 0)[0])
    q, v = run.q[first - 1], run.v[first - 1]
    assert DT * np.abs(v).max() > 1e-2
    assert cp.step(scene, q, v, dt=DT).forces["tip 0"][2] > 0
    errors = misses(scene, q, v, np.zeros(2), HARD[0], ActiveSet(), (1e-6, 1e-4, 1e-2))
    assert max(errors) < 1e-6


def tumbling(seed: int, friction: float) -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """A box that tumbles at 100 rad/s lands on a corner, or on two: such steps are taken again."""
    box = cp.model.free_box(mass=1.0, size=(0.2, 0.3, 0.1))
    shape = cp.constraints.Box(0.2, 0.3, 0.1)
    scene = cp.Scene(box, contacts=[cp.FrictionalContact("box", shape, friction=friction)])
    rng, q = np.random.default_rng(seed), scene.state()[0]
    q = pin.integrate(box.model, q, np.concatenate([np.zeros(3), rng.normal(size=3)]))
    q[2] += 1e-3 - min(cp.dynamics.contact_gaps(scene, q).values())
    v = np.concatenate([rng.normal(size=3), 80 * rng.normal(size=3)])
    return scene, q, v


@pytest.mark.long
@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("seed", [4, 5])
def test_a_step_whose_contacts_are_taken_at_its_end(seed, friction):
    scene, q, v = tumbling(seed, friction)
    now = cp.step(scene, q, v, dt=DT)
    assert set(now.modes.values()) > {"open"}
    assert now.dynamics_error < 1e-14
    errors = misses(scene, q, v, np.zeros(6), HARD[0], ActiveSet(), (1e-6, 1e-4, 1e-2))
    assert max(errors) < 1e-8


@pytest.mark.parametrize(
    ("scheme", "seed", "friction", "kappa"),
    [(HARD[0], 25, 0.5, 1.0), (CONVEX[0], 18, 0.05, 1e-2), (CONVEX[0], 24, 0.1, 1e-4)],
)
def test_smooth_routes_go_along_the_paths_of_the_scheme(scheme, seed, friction, kappa):
    """The law of the scheme has found the path along which a step is taken again."""
    scene, q, v = tumbling(seed, friction)
    assert len(attempts(scene, q, v, scheme)) > 1
    errors = misses(scene, q, v, np.zeros(6), scheme, Kappa(kappa), (1e-6, 1e-4, 1e-2))
    assert max(errors) < 1e-7


def attempts(scene, q, v, scheme):
    """The attempts of a step."""
    steps = linear_steps(scene, scheme, DT)
    steps.steps.attempt(0.0, q, v)
    return steps.steps.last.tried


def weighing(scene: cp.Scene, change: np.ndarray) -> cp.Scene:
    """The scene with other inertial parameters, ten a joint."""
    model = pin.Model(scene.robot.model)
    for i, by in enumerate(change.reshape(-1, 10), start=1):
        pi = model.inertias[i].toDynamicParameters()
        model.inertias[i] = pin.Inertia.FromDynamicParameters(pi + by)
    return replace(scene, robot=replace(scene.robot, model=model))


def heavier(scene: cp.Scene) -> np.ndarray:
    """A direction in which bodies weigh more, their centres move, and they turn harder."""
    rng, pi = np.random.default_rng(7), []
    for inertia in list(scene.robot.model.inertias)[1:]:
        least = np.linalg.eigvalsh(inertia.inertia)[0]  # no solid has a negative one
        sizes = inertia.mass, np.sqrt(inertia.mass * least), least
        pi.append(np.repeat(sizes, (1, 3, 6)) * rng.normal(size=10))
    return np.concatenate(pi)


def by_weights(scene, q, v, tau, scheme, route, h) -> float:
    """The relative error of derivatives by inertias: against differences of the route's step."""
    x, model = heavier(scene), scene.robot.model
    dt = 0.1 if isinstance(route, EventLocated) else DT

    def end(s):
        now = cp.step(weighing(scene, s * x), q, v, tau, dt=dt, integrator=scheme)
        if isinstance(route, ActiveSet):
            return now.q, now.v
        d = now.derivatives(route=route)
        return d.q, d.v

    of = cp.step(scene, q, v, tau, dt=dt, integrator=scheme)
    of = of.derivatives(route=route, wrt=["inertias"])
    expected = slope(model, end, h)
    assert (of.by("inertias")[scene.robot.nv :] == of.dv_dinertias).all()
    return float(np.abs(of.by("inertias") @ x - expected).max() / np.abs(expected).max())


@pytest.mark.long
@pytest.mark.parametrize("route", [ActiveSet(), EventLocated(), Kappa(1e-6), Softened()], ids=repr)
def test_one_slider_by_its_mass(route):
    """Far from its stop v+ = v + dt (tau / m - g); a regressor of one row is a vector elsewhere."""
    model = pin.Model(body(pin.JointModelPZ(), mass=2.0).model)
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -1.0, 1.0
    slider = cp.Robot("slider", model)
    for friction in (False, True):
        contacts = [cp.constraints.JointLimit("joint")]
        contacts += [cp.constraints.JointFriction("joint", 0.5)] if friction else []
        scene = cp.Scene(slider, contacts=contacts)
        step = cp.step(scene, [0.1], [0.3], [5.0], dt=DT)
        by_mass = step.derivatives(route=route, wrt=["inertias"]).dv_dinertias[0, 0]
        assert by_mass == pytest.approx(-DT * (5.0 - 0.5 * friction) / 2.0**2, rel=1e-3)


@pytest.mark.parametrize("scheme", [*HARD, *CONVEX], ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("state", STATES)
def test_by_what_a_free_robot_weighs(state, scheme):
    scene, q = solo()
    v = np.concatenate([STATES[state], np.zeros(12)])
    v += 0.01 * np.random.default_rng(1).normal(size=18)
    tau = np.concatenate([np.zeros(6), 0.5 * np.random.default_rng(2).normal(size=12)])
    assert by_weights(scene, q, v, tau, scheme, ActiveSet(), 1e-3) < 1e-8


@pytest.mark.parametrize("scheme", HARD, ids=lambda s: type(s).__name__)
def test_by_what_weighs_with_loops_and_springs(scheme):
    scene, q = cassie()
    v = tangent(scene, q, 0.3 * np.random.default_rng(2).normal(size=scene.robot.nv))
    assert by_weights(scene, q, v, np.zeros(len(v)), scheme, ActiveSet(), 1e-3) < 1e-8


@pytest.mark.parametrize("route", [Softened(), Kappa(1e-2), Kappa(1e-6), EventLocated()], ids=repr)
def test_by_what_weighs_along_other_routes(route):
    scene, q = solo()
    v = np.concatenate([STATES["slide"], np.zeros(12)])
    v += 0.01 * np.random.default_rng(1).normal(size=18)
    if isinstance(route, EventLocated):  # the feet come down within the step
        scene, q, _ = bounce()
        q[2], v = 0.06, np.array([0.3, 0.2, -1.0, 2.0, 1.0, 0.5])
    assert by_weights(scene, q, v, np.zeros(len(v)), HARD[1], route, 1e-3) < 1e-7


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("law", [cp.contact.Energetic(), cp.contact.Poisson()], ids=repr)
def test_an_impact_by_what_a_box_weighs(law, seed):
    """A corner comes down and slips: where it is thrown depends on how the box turns."""
    box = cp.model.free_box(mass=1.0, size=(0.2, 0.12, 0.08))
    shape = cp.constraints.Box(0.1, 0.06, 0.04)
    floor = cp.FrictionalContact("box", shape, friction=0.3, restitution=0.5)
    scene, rng = cp.Scene(box, contacts=[floor]), np.random.default_rng(seed)
    q = pin.integrate(box.model, scene.state()[0], np.append(np.zeros(3), rng.normal(size=3)))
    q[2] -= min(cp.dynamics.contact_gaps(scene, q).values()) + 1e-5
    v = np.concatenate([rng.normal(size=2), [-1.0], rng.normal(size=3)])
    scheme = cp.Moreau(contact=NEWTON, restitution_law=law)
    assert by_weights(scene, q, v, np.zeros(6), scheme, ActiveSet(), 1e-3) < 1e-7


@pytest.mark.parametrize(
    ("scheme", "route", "parameter"),
    [
        (HARD[0], ActiveSet(), "friction"), (HARD[1], ActiveSet(), "friction"),
        (HARD[1], ActiveSet(), "restitution"), (HARD[1], Kappa(1e-3), "restitution"),
        pytest.param(HARD[1], Kappa(1e-3), "friction", marks=pytest.mark.long),
        (CONVEX[0], ActiveSet(), "friction"),
        (CONVEX[1], ActiveSet(), "friction"), (CONVEX[1], ActiveSet(), "solref"),
        (CONVEX[1], Kappa(1e-3), "solref"), (HARD[0], Softened(), "friction"),
        (HARD[0], Softened(), "solref"),
    ],
    ids=lambda x: x if isinstance(x, str) else type(x).__name__,
)  # fmt: skip
def test_by_what_contacts_are_made_of(scheme, route, parameter):
    """Against differences of the step itself, sliding on four feet."""
    scene, q = solo()
    v = np.concatenate([STATES["slide"], np.zeros(12)])
    v += 0.01 * np.random.default_rng(1).normal(size=18)
    shares = np.random.default_rng(9).normal(size=2 if parameter == "solref" else 4)

    def at(s):
        made, how, through = scene, scheme, route
        if parameter == "solref":
            solref = {"solref": (0.02 + 0.01 * s * shares[0], 1.0 + s * shares[1])}
            how = replace(how, **solref) if how is CONVEX[1] else how
            through = replace(route, **solref) if isinstance(route, Softened) else route
        else:
            was = {"friction": 0.7, "restitution": 0.0 if scheme is not HARD[1] else 0.3}
            law = [{**was, parameter: was[parameter] + s * x} for x in shares]
            contacts = [replace(c, **p) for c, p in zip(scene.contacts, law, strict=True)]
            made = cp.Scene(scene.robot, contacts=contacts)
        return cp.step(made, q, v, dt=DT, integrator=how), through

    def end(s):
        now, through = at(s)
        if isinstance(through, ActiveSet):
            return now.q, now.v
        d = now.derivatives(route=through)
        return d.q, d.v

    now, _ = at(0.0)
    by = now.derivatives(route=route, wrt=[parameter]).by(parameter)
    along = by @ (shares * (0.01, 1.0) if parameter == "solref" else shares)
    expected = slope(scene.robot.model, end, 1e-4)
    assert np.abs(expected).max() > 1e-4
    assert np.abs(along - expected).max() < 1e-8 * np.abs(expected).max()


def rolling_ball(restitution: float) -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """A ball that slides and spins on the floor, and comes down on it."""
    ball = cp.model.free_ball(mass=1.0, radius=0.05)
    floor = cp.FrictionalContact(
        "ball", cp.constraints.Ball(0.05), friction=0.2, restitution=restitution
    )
    scene = cp.Scene(ball, contacts=[floor])
    q, v = scene.state()[0].copy(), np.array([0.9, 0.3, -0.4, 2.0, 1.0, 0.5])
    q[2] = 0.05 - 1e-5
    return scene, q, v


def changed(scene, scheme, route, parameter: str, s: np.ndarray):
    """The same with a parameter changed by s."""
    if parameter == "inertias":
        return weighing(scene, s), scheme, route
    if parameter == "solref":
        solref = (0.02 + s[0], 1.0 + s[1])
        if isinstance(scheme, cp.stepping.SoftStep):
            return scene, replace(scheme, solref=solref), route
        return scene, scheme, replace(route, solref=solref)
    (contact,) = scene.contacts
    moved = replace(contact, **{parameter: getattr(contact, parameter) + s[0]})
    return cp.Scene(scene.robot, contacts=[moved]), scheme, route


@pytest.mark.pairs
@pytest.mark.parametrize("parameter", ["friction", "restitution", "solref", "inertias"])
@pytest.mark.parametrize("scheme", [*HARD, *CONVEX], ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("name", ROUTES)
def test_every_route_by_every_parameter(name, scheme, parameter):
    """Either those of differences of the route's own step, or refused with the reason."""
    route = Randomised(12, 1e-5, seed=1) if name == "randomised" else ROUTES[name]()
    convex = not isinstance(scheme, (cp.StewartTrinkle, cp.Moreau))
    scene, q, v = rolling_ball(0.3 if isinstance(scheme, cp.Moreau) else 0.0)
    now = cp.step(scene, q, v, dt=5e-3, integrator=scheme)
    if convex and name == "eventlocated":
        with pytest.raises(cp.InvalidArgument, match=r"EventLocated\(\).*convex"):
            now.derivatives(route=route, wrt=[parameter])
        return
    has = {
        "friction": True,
        "restitution": name == "eventlocated"
        or (isinstance(scheme, cp.Moreau) and name != "softened"),
        "solref": isinstance(scheme, cp.stepping.SoftStep) or name == "softened",
        "inertias": True,
    }
    if not has[parameter]:
        why = "impacts have none" if parameter == "restitution" else "contacts are rigid"
        refused = rf"'{parameter}'.*{type(route).__name__}.*{why}"
        with pytest.raises(cp.InvalidArgument, match=refused):
            now.derivatives(route=route, wrt=[parameter])
        return
    by = now.derivatives(route=route, wrt=[parameter]).by(parameter)
    if parameter == "restitution" and not scene.contacts[0].restitution:
        # none is less, and located events are those of any scheme: of Moreau too
        assert np.abs(by).max() > 1e-2
        at_moreau = cp.step(scene, q, v, dt=5e-3, integrator=HARD[1]).derivatives(route=route)
        assert (by == at_moreau.by(parameter)).all()
        return
    x = heavier(scene) if parameter == "inertias" else 0.1 * np.array([0.1, 1.0])[: by.shape[1]]

    def end(s):
        made, how, through = changed(scene, scheme, route, parameter, s * x)
        after = cp.step(made, q, v, dt=5e-3, integrator=how)
        if isinstance(through, (ActiveSet, Randomised)):
            return after.q, after.v
        d = after.derivatives(route=through)
        return d.q, d.v

    wanted = slope(scene.robot.model, end, 1e-4)
    assert np.abs(wanted).max() > 1e-6
    share = 1e-2 if name == "randomised" else 1e-6
    assert np.abs(by @ x - wanted).max() < share * np.abs(wanted).max()


MOREAU = cp.Moreau()


def located(scene, q, v, dt, scheme=MOREAU):
    """The step with located impacts, and its derivatives."""
    now = cp.step(scene, q, v, dt=dt, integrator=scheme, throw=False)
    return now.derivatives(route=EventLocated())


@pytest.mark.parametrize("e", [0.0, 0.8])
def test_a_ball_that_lands_as_a_step_begins(e):
    """z+ = z - e u dt from below, where it is struck at once; from above it lands dz / u later.

    z+ = e (u + g s) (dt - s) - g (dt - s)^2 / 2 then, with s = dz / u.
    """
    scene, q, v = rolling_ball(e)
    q[2], v[:] = 0.05, np.eye(6)[2] * -1.0
    g, dt, h, model = 9.81, 1e-2, 1e-6, scene.robot.model

    def end(dz):
        return located(scene, pin.integrate(model, q, np.eye(6)[2] * dz), v, dt)

    of, above, below = end(0.0), end(h), end(-h)
    assert of.one_sided
    assert of.dq_dq[2, 2] == pytest.approx(1.0, abs=1e-9)
    assert (of.q[2] - below.q[2]) / h == pytest.approx(1.0, abs=1e-6)
    exact = -e + (1 + e) * g * dt if e else 0.0
    assert (above.q[2] - of.q[2]) / h == pytest.approx(exact, abs=1e-4)
    assert above.dq_dq[2, 2] == pytest.approx(exact, abs=1e-4)
    assert not end(1e-6).one_sided
    assert not end(-1e-6).one_sided


@pytest.mark.long
@pytest.mark.parametrize("away", [1e-12, -1e-12])
def test_a_ball_that_lands_as_a_step_ends(away):
    """The end rebounds or does not."""
    scene, q, v = bounce()
    dt = 1e-2
    v[2] = -1.0
    q[2] = 0.05 + dt + 9.81 * dt**2 / 2 + away
    of = located(scene, q, v, dt)
    assert (of.v[2] > 0) == (away < 0)
    assert of.one_sided
    q[2] += 1e-3
    assert not located(scene, q, v, dt).one_sided


@pytest.mark.parametrize("e", [0.0, 0.8])
def test_what_rests_goes_no_further_than_the_square_of_its_velocity(e):
    """It is back after v / g and less; Moreau's flow has it go on for half a step."""
    scene, q, _ = rolling_ball(e)
    q[2] = 0.05
    of = located(scene, q, np.zeros(6), 1e-2)
    assert np.abs(of.dq_dv[2]).max() < 1e-12
    assert np.abs(of.dv_dv[2]).max() < 1e-12
    assert of.dq_dv[0, 0] == pytest.approx(6e-2 / 7)  # friction takes its time: (1 + 5/7) dt / 2
    for speed in (1e-3, -1e-3):
        moved = located(scene, q, speed * np.eye(6)[2], 1e-2)
        assert abs(moved.q[2] - of.q[2]) < 2e-3 * abs(speed) * 1e-2 + speed**2 / 9.81
        assert abs(moved.v[2]) < 1e-12


@pytest.mark.long
@pytest.mark.parametrize("slip", [1e-3, 0.1])
def test_what_lands_slides_until_friction_stops_it(slip):
    """The slip of a landing ends in the flow behind it, or does not: it is no velocity of rest."""
    body = cp.model.free_ball(mass=1.0, radius=0.05)
    floor = cp.FrictionalContact("ball", cp.constraints.Point(), friction=0.9)
    scene, u, gap, dt = cp.Scene(body, contacts=[floor]), 0.4, 1e-3, 5e-3
    q, v = scene.state()[0].copy(), np.zeros(6)
    q[2] = gap
    v[[0, 2]] = 0.9 * sqrt(u**2 + 2 * 9.81 * gap) + slip, -u
    of = located(scene, q, v, dt)
    assert of.modes == {"ball": "stick" if slip < 0.01 else "slide"}
    for along in np.eye(6)[[0, 2]]:
        by_q = slope(body.model, lambda s, x=along: at_end(scene, q + s * np.r_[x, 0], v, dt), 1e-6)
        by_v = slope(body.model, lambda s, x=along: at_end(scene, q, v + s * x, dt), 1e-6)
        zero = np.zeros(6)
        assert np.abs(np.concatenate(of.jvp(along, zero, zero)) - by_q).max() < 1e-6
        assert np.abs(np.concatenate(of.jvp(zero, along, zero)) - by_v).max() < 1e-6


def at_end(scene, q, v, dt):
    of = located(scene, q, v, dt)
    return of.q, of.v


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.9])
def test_one_foot_stays_and_the_other_rebounds(friction):
    """A small restitution of what stays ends at once, and moves what rebounds by the way.

    A box lands flat on its corners A and B, and e_A = 0: with G = J M^-1 J^T of their normals the
    impact gives M^-1 J^T G^-1 (u, 0) by e_A, and A's return takes M^-1 J_A^T u / G_AA back.
    Compared with the same motion by `EventDriven`, both by Newton's law of restitution.
    """
    law = cp.contact.Newton()
    box, u, dt = cp.model.free_box(mass=1.0, size=(0.2, 0.12, 0.08)), 0.5, 3e-3
    q = np.array([0.0, 0.0, 0.041, 0.0, 0.0, 0.0, 1.0])
    v = np.array([0.02 if friction > 0.5 else 0.3, 0.0, -u, 0.0, 0.0, 0.0])

    def on_corners(e):
        return cp.Scene(box, contacts=[
            cp.FrictionalContact("box", cp.constraints.Point(), offset=(x, 0.0, -0.04),
                                 friction=friction, restitution=r, name=name)
            for name, x, r in (("A", -0.1, e), ("B", 0.1, 0.5))
        ])  # fmt: skip

    def moved(e):
        driven = cp.stepping.EventDriven(cp.RungeKutta4(), restitution_law=law)
        motion = cp.simulate(on_corners(e), q, v, duration=dt, dt=dt / 10, integrator=driven)
        return motion.q[-1], motion.v[-1]

    scheme = cp.Moreau(restitution_law=law)
    by = located(on_corners(0.0), q, v, dt, scheme).by("restitution")[:, 0]
    wanted = between(box.model, moved(1e-3), moved(0.0)) / 1e-3
    assert by[8] > 0.01 * u
    assert np.abs(by - wanted)[:6].max() < 1e-2 * np.abs(wanted[:6]).max()
    assert np.abs(by - wanted)[6:].max() < 1e-3 * np.abs(wanted[6:]).max()


@pytest.mark.parametrize("friction", [0.2, 0.9])
def test_what_lands_and_stays_has_no_slope_by_a_restitution_of_zero(friction):
    """A rebound by e v is back soon, and the end differs by e^2 alone."""
    scene, q, v = rolling_ball(0.0)
    (floor,) = scene.contacts
    q[2], v[2] = 0.051, -0.4  # down after 2.5 of 5 ms

    def end(e):
        made = cp.Scene(scene.robot, contacts=[replace(floor, friction=friction, restitution=e)])
        now = cp.step(made, q, v, dt=5e-3, integrator=HARD[1])
        return now.derivatives(route=EventLocated())

    model, landed = scene.robot.model, end(0.0)
    assert landed.modes == {"ball": "slide" if friction < 0.5 else "stick"}
    assert np.abs(landed.by("restitution")).max() < 1e-12
    off = [
        np.abs(between(model, (of.q, of.v), (landed.q, landed.v))).max()
        for of in (end(1e-3), end(1e-2))
    ]
    assert off[0] < 1e-6  # e^2
    assert off[1] < 1e-4
    assert np.abs(end(0.3).by("restitution")).max() > 0.1


@pytest.mark.long
def test_soft_steps_of_dry_friction_alone():
    """Where no contact is near, and joints rub, on a loop: `Softened` has an answer too."""
    bar = robot("four_bar")
    rubs = [cp.constraints.JointFriction("crank", torque=0.2)]
    scene = cp.Scene(bar, bar.loops, contacts=rubs)
    q, v = scene.sample(np.random.default_rng(3))
    assert max(misses(scene, q, v, np.ones(3), HARD[0], Softened(), (1e-5, 1e-4, 1e-3))) < 1e-7
