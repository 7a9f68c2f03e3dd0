"""Chained forms, and plans in them: what they say of a vehicle is what its equations do."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.nonholonomic import ChainedForm, steer_by_polynomials, steer_by_sinusoids

VEHICLES = {
    "unicycle": cp.model.unicycle,
    "car": cp.model.car,
    "car, a trailer": lambda: cp.model.car(trailers=1, wheelbase=2.1, hitch=1.3),
    "car, three trailers": lambda: cp.model.car(trailers=3, hitch=1.7),
}
each_vehicle = pytest.mark.parametrize("made", VEHICLES.values(), ids=list(VEHICLES))
EXACT = cp.simulation.DormandPrince(1e-9, 1e-10)


def form_of(made) -> ChainedForm:
    made = made()
    return ChainedForm(cp.Scene(made, made.contacts))


@each_vehicle
def test_the_chain_is_driven_by_what_the_rows_allow(made):
    """z' = (u_1, u_2, z_2 u_1, ...) along velocities of the scene, by differences of z."""
    form, rng = form_of(made), np.random.default_rng(3)
    for _ in range(4):
        q = rng.uniform(-0.5, 0.5, form.scene.robot.nq)
        z, u = form.to_chained(q), rng.normal(size=2)
        assert form.to_joints(z, q) == pytest.approx(q, abs=1e-12)
        v = form.velocity(q, u)
        assert form.scene.check(q, v).consistent
        assert form.inputs(q, v) == pytest.approx(u, abs=1e-10)
        wanted = np.array([*u, *(z[1:-1] * u[0])])
        h = 1e-5
        found = (form.to_chained(q + h * v) - form.to_chained(q - h * v)) / (2 * h)
        assert np.abs(found - wanted).max() < 1e-6 * np.abs([wanted, z]).max()


def test_a_car_in_chained_form_is_that_of_the_literature():
    """z = (x, tan(steering) / (l cos^3(heading)), tan(heading), y) (Murray and Sastry)."""
    form, q = form_of(lambda: cp.model.car(wheelbase=2.0)), np.array([0.3, -0.2, 0.4, 0.25])
    wanted = [0.3, np.tan(0.25) / (2.0 * np.cos(0.4) ** 3), np.tan(0.4), -0.2]
    assert form.to_chained(q) == pytest.approx(wanted, rel=1e-14)


@each_vehicle
def test_a_period_moves_one_coordinate_and_those_behind_it(made):
    form = form_of(made)
    start, goal = np.random.default_rng(1).uniform(-0.1, 0.1, (2, form.scene.robot.nq))
    plan = steer_by_sinusoids(form, start, goal, ahead=9.0, period=2.0)
    assert len(plan.stages) == form.size - 1
    for k in range(1, form.size):
        now = plan.z(2.0 * k)
        assert now[: k + 1] == pytest.approx(plan.goal[: k + 1], abs=1e-11)
    assert plan.z(plan.duration) == pytest.approx(form.to_chained(goal), abs=1e-11)


@pytest.mark.parametrize(
    ("made", "ahead"), [(cp.model.unicycle, 2.0), (cp.model.car, -6.0)], ids=["unicycle", "car"]
)
def test_sinusoids_park_a_vehicle_that_is_simulated(made, ahead):
    form = form_of(made)
    goal = np.zeros(form.scene.robot.nq)
    goal[1] = 1.0
    plan = steer_by_sinusoids(form, np.zeros(form.scene.robot.nq), goal, ahead=ahead)
    run = cp.simulate(
        plan.driven(), *plan.state(), duration=plan.duration, dt=0.25, integrator=EXACT
    )
    assert run.status.ok
    assert run.q[-1] == pytest.approx(goal, abs=1e-8)  # its roll too, no part of z
    n = form.size
    for t, q in zip(run.t[::4], run.q[::4], strict=True):
        assert q[:n] == pytest.approx(plan.pose(t), abs=1e-8)
    # of a unicycle u_2 of the period is 4 y / ahead, its slope at most y / (pi / 2 ahead)
    if n == 3:
        assert np.tan(run.q[:, 2]).max() == pytest.approx(4 / (2 * np.pi * ahead), rel=1e-2)


def test_polynomials_bring_a_car_with_a_trailer_to_the_goal():
    form = form_of(lambda: cp.model.car(trailers=1))
    goal = np.array([9.0, 1.5, 0.1, 0.0, 0.05])
    plan = steer_by_polynomials(form, np.zeros(5), goal, duration=4.0)
    run = cp.simulate(plan.driven(), *plan.state(), duration=4.0, dt=0.5, integrator=EXACT)
    assert run.q[-1] == pytest.approx(goal, abs=1e-8)
    back = steer_by_polynomials(form, goal, np.zeros(5))
    assert (plan + back).z(14.0) == pytest.approx(plan.start, abs=1e-12)


def test_a_unicycle_by_polynomials_follows_hermites_cubic():
    form = form_of(cp.model.unicycle)
    plan = steer_by_polynomials(form, np.zeros(4), [2.0, 1.0, 0.0, 0.0], duration=3.0)
    for t in (0.4, 1.5, 2.2):
        x, slope, y = plan.z(t)
        s = x / 2.0
        assert y == pytest.approx(s**2 * (3 - 2 * s), abs=1e-14)
        assert slope == pytest.approx(3 * s * (1 - s), abs=1e-14)
    assert plan.z(1.5)[0] == pytest.approx(1.0)  # halfway at half the time


def test_a_plan_is_pickled_and_its_joints_move_as_their_rates_say():
    form = form_of(lambda: cp.model.car(trailers=1))
    goal = [0.5, 1.0, 0.0, 0.1, 0.0]
    plan = steer_by_sinusoids(form, np.zeros(5), goal, ahead=8.0)
    again = pickle.loads(pickle.dumps(plan))
    h = 1e-4
    for t in (0.7, 6.0, 13.0):
        before, (_, rate, bend), after = plan.path(t - h), again.path(t), plan.path(t + h)
        for found, low, high in ((rate, before[0], after[0]), (bend, before[1], after[1])):
            assert found == pytest.approx((high - low) / (2 * h), abs=1e-6)


def test_what_is_no_vehicle_or_no_place_is_refused():
    sleigh, form, car = robot("sleigh"), form_of(cp.model.car), cp.model.car()
    refused = [
        ("no joint", lambda: ChainedForm(cp.Scene(sleigh, sleigh.contacts))),
        ("leave 3 velocities", lambda: ChainedForm(cp.Scene(car, car.contacts[:1]))),
        ("below 90", lambda: form.to_chained([0.0, 0.0, 1.6, 0.0])),
        ("ahead = 0", lambda: steer_by_sinusoids(form, np.zeros(4), np.ones(4), ahead=0.0)),
        ("period", lambda: steer_by_sinusoids(form, np.zeros(4), np.ones(4), ahead=1, period=0)),
        ("same|both ends", lambda: steer_by_polynomials(form, np.zeros(4), [0, 1, 0, 0])),
    ]  # fmt: skip
    for text, call in refused:
        with pytest.raises(cp.InvalidArgument, match=text):
            call()
    plan = steer_by_polynomials(form, np.zeros(4), [4, 1, 0, 0])
    with pytest.raises(cp.InvalidArgument, match="begins at"):
        plan + plan
    with pytest.raises(cp.InvalidArgument, match="the form has"):
        plan.driven(["roll", "x"])
