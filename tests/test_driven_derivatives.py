"""Derivatives of steps and motions whose rows follow a path of time, against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq
from test_driven_contacts import BOX, FRICTION, GRAVITY, SLIDE, driven_bar, pushing

import condyn_pin as cp
from condyn_pin.constraints import FrictionalContact, Plane, Polynomial, Sine
from condyn_pin.contact import ADMM
from condyn_pin.gradients import (
    ActiveSet,
    EventLocated,
    Kappa,
    Randomised,
    Softened,
    step_derivatives_batch,
    trajectory_derivatives,
)
from condyn_pin.gradients.routes.route import linear_steps
from condyn_pin.stepping import SoftStep

T, DT = 0.1, 1e-3
TO_ROUNDING = ADMM(polish=True)
SCHEMES = [cp.StewartTrinkle(TO_ROUNDING), cp.Moreau(TO_ROUNDING), SoftStep()]
LAWS = [ActiveSet(), Kappa(1e-4), Softened()]
PATHS = [Polynomial((0.0, 0.0, 1.5)), Sine(0.3, 2.0, 0.3)]


def by_differences(route, scheme, scene, q, v, dt, size=1e-6):
    """The end of a step of a route by q, v and tau, (2 nv, 3 nv)."""
    model, n = scene.robot.model, len(v)
    steps = linear_steps(scene, route.scheme(scheme), dt)

    def end(move):
        dq, dv, dtau = move.reshape(3, n)
        steps.system.applied.hold(dtau, ())
        return route.step(steps, scene.constraints[-1].time, pin.integrate(model, q, dq), v + dv)

    centre, columns = end(np.zeros(3 * n))[0], []
    for move in size * np.eye(3 * n):
        (q1, v1), (q0, v0) = end(move), end(-move)
        moved = pin.difference(model, centre, q1) - pin.difference(model, centre, q0)
        columns.append(np.concatenate((moved, v1 - v0)) / (2 * size))
    return np.array(columns).T


def check(route, scheme, scene, q, v, dt=DT, columns=slice(None), within=1e-5):
    """The derivatives of a step agree with differences of steps."""
    q, v = np.array(q, dtype=float), np.array(v, dtype=float)
    of = cp.step(scene, q, v, dt=dt, integrator=scheme, throw=False).derivatives(route=route)
    expected = by_differences(route, scheme, scene, q, v, dt)[:, columns]
    found = np.vstack(of.matrices)[:, : 3 * len(v)][:, columns]
    assert np.abs(found - expected).max() < within * max(np.abs(expected).max(), 1.0)
    return of, found


@pytest.mark.pairs
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("route", LAWS, ids=lambda each: each.title)
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda each: each.title)
def test_a_step_of_a_plate_and_its_box(scheme, route, path):
    """It pushes, it meets what comes, and what flies it leaves alone."""
    s, rate, _ = np.ravel(path(T))
    scene = pushing(path).at(T)
    for q, v in (
        ([s, s - 1e-4, -1e-4], [rate, rate - 0.01, 0.0]),
        ([s, s + 1e-4, 2e-4], [rate, rate - 0.5, -0.7]),
        ([s, s + 0.1, 1.0], [rate, 0.0, 0.2]),
    ):
        of, found = check(route, scheme, scene, q, v)
        assert np.abs(found[[0, 3]]).max() < 1e-12  # the plate is where its path is
        assert found[4, 4] > 0.5 or "open" not in of.modes.values()


@pytest.mark.parametrize("route", LAWS, ids=lambda each: each.title)
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda each: each.title)
def test_a_step_of_a_driven_four_bar(scheme, route):
    """By itself, where h is that of the mean velocity, and with dry friction in its rocker."""
    rubs = driven_bar(Sine(0.4, 0.7)).at(T)
    tip = list(rubs.robot.frames)[-1]
    away = FrictionalContact(tip, on=Plane(height=-9.0), friction=0.5, name="away")
    for scene in (rubs, replace(rubs, contacts=[away])):
        of, _ = check(route, scheme, scene, *scene.state())
        assert list(of.modes.values()) == ["slide" if scene is rubs else "open"]


@pytest.mark.parametrize("dt", [1e-2, 2.5e-3])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("path", [Polynomial((0.0, 1.0, 1.5)), Sine(0.1, 1.0)])
def test_the_time_of_an_impact_by_a_driven_body(path, restitution, dt):
    """The box meets the plate within the step: later, the plate is elsewhere, and has other s'.

    v = (1 + e) s'(t) - e v-(t) - f (T - t),  t by the start of the box  -1 / (v-(t) - s'(t))
    """
    s, rate, _ = np.ravel(path(T))
    floor = FrictionalContact("box_frame", friction=FRICTION, name="floor")
    side = FrictionalContact(
        "box_frame", on="plate_frame", on_shape=Plane(normal=(1, 0, 0)), friction=0.0,
        restitution=restitution, name="side",
    )  # fmt: skip
    scene = pushing(path, floor, side).at(T)
    along = [1, 4, 7]  # of the box along x: it may not be pushed into the floor
    ahead, speed = 0.3 * dt, rate - 0.6
    q, v = [s, s + ahead, 0.0], [rate, speed, 0.0]
    _, found = check(EventLocated(), cp.Moreau(TO_ROUNDING), scene, q, v, dt, along, 1e-7)
    if not restitution:
        return  # the plate takes it along
    f = FRICTION * GRAVITY * BOX / (BOX + SLIDE) * np.sign(speed)
    t = brentq(lambda t: s + ahead + speed * t - f * t * t / 2 - path(T + t)[0][0], 0, dt)
    _, (rate,), (bend,) = path(T + t)
    before = speed - f * t
    after = (1 + restitution) * rate - restitution * before
    change = (1 + restitution) * bend + restitution * f + np.copysign(f, after)
    share = 1e-7 if isinstance(path, Polynomial) else 2.5 * dt  # Moreau is of first order in s'''
    assert found[4, 0] == pytest.approx(-change / (before - rate), rel=share)


def test_noise_around_a_driven_step_has_its_slope():
    s, rate, _ = np.ravel(PATHS[1](T))
    scene = pushing(PATHS[1]).at(T)
    step = cp.step(scene, [s, s + 0.1, 1.0], [rate, 0.0, 0.2], dt=DT)
    exact, found = step.derivatives(), step.derivatives(route=Randomised(samples=64))
    assert np.abs(found.dv_dv - exact.dv_dv).max() < 1e-9
    assert np.abs(found.dq_dtau - exact.dq_dtau).max() < 1e-9


@pytest.mark.parametrize(
    "route", [ActiveSet(), Kappa(1e-4), EventLocated()], ids=lambda each: each.title
)
def test_a_motion_with_a_driven_plate(route):
    """Its torques are functions of time as well."""
    path, scheme, dt = Sine(0.3, 2.0, 0.3), cp.Moreau(TO_ROUNDING), 2e-3
    scene = pushing(path)
    s, rate, _ = np.ravel(path(0.0))
    start, steps, size = np.array([0.05, -0.1]), 40, 1e-6

    def tau(t, q, v):
        return np.array([0.0, 2.0 * np.sin(30 * t), 0.0])

    def motion(dq, dv):
        q, v = [s, s + start[0] + dq, 0.0], [rate, start[1] + dv, 0.0]
        return cp.simulate(scene, q, v, tau, duration=steps * dt, dt=dt, integrator=scheme)

    def end(*move):
        of = trajectory_derivatives(motion(*move), tau, route=route)
        return np.concatenate((of.q, of.v))

    found = trajectory_derivatives(motion(0.0, 0.0), tau, route=route)
    by_q = (end(size, 0.0) - end(-size, 0.0)) / (2 * size)
    by_v = (end(0.0, size) - end(0.0, -size)) / (2 * size)
    assert found.dx_dx[:, 1] == pytest.approx(by_q, abs=1e-5)
    assert found.dx_dx[:, 4] == pytest.approx(by_v, abs=1e-5)
    y = np.array([0.3, -1.0, 0.2])
    back = found.vjp(y, y)
    assert back.q == pytest.approx(np.concatenate((y, y)) @ found.dx_dx[:, :3], abs=1e-12)


@pytest.mark.long
def test_steps_of_a_batch_have_the_derivatives_of_one():
    s, rate, _ = np.ravel(PATHS[0](T))
    scene = pushing(PATHS[0]).at(T)
    q, v = np.array([[s, s - 1e-4, -1e-4]]), np.array([[rate, rate - 0.01, 0.0]])
    one = cp.step(scene, q[0], v[0], dt=DT).derivatives()
    batch = step_derivatives_batch(scene, q, v, dt=DT)
    assert np.array_equal(batch.dq[0], one.matrices[0])
    assert np.array_equal(batch.dv[0], one.matrices[1])


@pytest.mark.long
def test_layers_take_driven_scenes_from_their_time_on():
    torch = pytest.importorskip("torch")
    from condyn_pin.layers import torch_simulate, torch_step

    scene = pushing(PATHS[1])
    with pytest.raises(cp.errors.UnsupportedConstraint, match=r"plate.*scene\.at\(t\)"):
        torch_step(scene, dt=DT)
    s, rate, _ = np.ravel(PATHS[1](T))
    q, v = np.array([s, s - 1e-4, 0.0]), np.array([rate, rate, 0.0])
    start = [torch.tensor(each, requires_grad=True) for each in (q, v, np.zeros(3))]
    q1, v1 = torch_step(scene.at(T), dt=DT)(*start)
    # a step ends where its solver does, derivatives and layers where its answer is polished
    one = cp.step(scene.at(T), q, v, dt=DT).derivatives()
    assert q1.detach().numpy() == pytest.approx(one.q, abs=1e-14)
    v1[1].backward()
    assert start[1].grad.numpy() == pytest.approx(one.dv_dv[1], abs=1e-12)
    two = cp.step(scene.at(T + DT), one.q, one.v, dt=DT).derivatives()
    run = torch_simulate(scene.at(T), dt=DT)
    q2, v2 = run(*start[:2], torch.zeros((2, 3), dtype=torch.float64))
    assert q2.detach().numpy() == pytest.approx(two.q, abs=1e-12)
    assert v2.detach().numpy() == pytest.approx(two.v, abs=1e-10)
