"""Analytical mechanics: what kind of system, growth vectors, Chaplygin, vakonomic motion, cars."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from shared import each_row, robot

import condyn_pin as cp
from condyn_pin.constraints import Coupling, Driven, HeldJoint, Sine
from condyn_pin.mechanism import (
    controllability,
    curvature,
    growth_vector,
    is_integrable,
    lie_bracket,
)
from condyn_pin.nonholonomic import vakonomic

GRAVITY = 9.81


def on_contacts(made: cp.Robot) -> cp.Scene:
    return cp.Scene(made, made.contacts)


# Of Murray, Li and Sastry, chapter 7 and 8, and of the free rolling of a disc.
GROWTH = {
    "sleigh": (2, 3),
    "unicycle": (2, 3, 4),
    "rolling_ball": (3, 5),
    "rolling_disc": (3, 4, 5),
}


@pytest.mark.parametrize("name", GROWTH)
def test_growth_vectors_of_the_literature(name):
    scene = on_contacts(robot(name))
    for seed in range(2):
        q, _ = scene.sample(np.random.default_rng(seed))
        assert growth_vector(scene, q) == GROWTH[name]


@pytest.mark.parametrize("trailers", [0, 1, 2])
def test_a_car_with_trailers_gets_everywhere(trailers):
    scene = on_contacts(cp.model.car(trailers=trailers))
    q = np.random.default_rng(0).uniform(-0.4, 0.4, scene.robot.nq)
    for place in (None, q):
        assert growth_vector(scene, place, deepest=6) == tuple(range(2, 5 + trailers))


def test_a_jackknifed_trailer_takes_one_bracket_more():
    """SymPy has (2, 3, 4, 5, 5, 6) of the formulas of `car` there, and 2 to 6 elsewhere."""
    scene = on_contacts(cp.model.car(trailers=2))
    q = np.zeros(6)
    assert growth_vector(scene, q, deepest=6) == (2, 3, 4, 5, 6)
    q[4] = np.pi / 2  # the car across its first trailer
    assert growth_vector(scene, q, deepest=6) == (2, 3, 4, 5, 5, 6)
    assert growth_vector(scene, q, deepest=5) == (2, 3, 4, 5)  # as far as it has looked


def test_brackets_of_a_unicycle_are_those_of_its_two_fields():
    """[turn, roll] = (-sin, cos, 0, 0) radius: the direction that the wheel forbids."""
    scene, radius = on_contacts(robot("unicycle")), 0.3

    def roll(q):
        return np.array([radius * np.cos(q[2]), radius * np.sin(q[2]), 0.0, 1.0])

    def turn(q):
        return np.array([0.0, 0.0, 1.0, 0.0])

    q = np.array([0.4, -0.1, 0.7, 0.2])
    across = radius * np.array([-np.sin(0.7), np.cos(0.7), 0.0, 0.0])
    assert lie_bracket(scene, turn, roll, q) == pytest.approx(across, abs=1e-8)
    assert lie_bracket(scene, roll, turn, q) == pytest.approx(-across, abs=1e-8)


def test_a_verdict_by_chow():
    for name, growth in GROWTH.items():
        found = controllability(on_contacts(robot(name)))
        assert found.growth == growth
        assert found.controllable
    short = controllability(on_contacts(cp.model.car(trailers=1)), deepest=3)
    assert (short.controllable, short.growth, short.dimension) == (False, (2, 3, 4), 5)
    assert "3 levels" in str(short)


def body_on_a_plane():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "plane")
    inertia = pin.Inertia(1.3, np.zeros(3), 0.2 * np.eye(3))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return cp.Scene(cp.Robot("body", model)), np.array([0.0, 0.0, 1.0, 0.0])


# A force on a planar body at a point h ahead of its centre (Lewis and Murray 1997): along the line
# to the centre it moves on that line alone, across it gets everywhere.
FORCES = {
    "along": ([[1.0, 0.0, 0.0]], 1, False),
    "across": ([[0.0, 1.0, 0.4]], 3, None),
    "both": ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.4]], 3, None),
    "a torque": ([[0.0, 0.0, 1.0]], 1, False),
    "all": (np.eye(3), 3, True),
}


@pytest.mark.parametrize(("inputs", "reached", "verdict"), FORCES.values(), ids=list(FORCES))
def test_a_body_with_a_thruster_is_accessible_where_lewis_and_murray_have_it(
    inputs, reached, verdict
):
    scene, q = body_on_a_plane()
    found = controllability(scene, q, torques=np.transpose(inputs), deepest=3)
    assert found.growth[-1] == reached
    assert found.controllable is verdict
    assert found.driven == len(inputs)


def test_motors_of_a_unicycle_drive_all_that_it_may():
    scene = on_contacts(robot("unicycle"))
    both = controllability(scene, torques=np.eye(4)[:, 2:])
    assert both.controllable
    assert both.growth == GROWTH["unicycle"]
    assert controllability(scene, torques=np.eye(4)[:, 3]).growth == (1,)
    with pytest.raises(cp.InvalidArgument, match="torques"):
        controllability(scene, torques=np.ones(3))
    pendulum = cp.Scene(cp.model.pendulum())
    q = np.full(pendulum.robot.nq, 0.5)
    with pytest.raises(cp.InvalidArgument, match="gravity moves"):
        controllability(pendulum, q, torques=np.eye(pendulum.robot.nv))


@pytest.mark.long
def test_integrable_rows_do_not_grow():
    for made in (cp.model.four_bar(), cp.model.n_four_bar(2)):
        scene = cp.Scene(made, made.loops)
        assert growth_vector(scene) == (1,)
        assert is_integrable(scene)
    solo = cp.load_robot("solo12")
    assert growth_vector(cp.Scene(solo, solo.contacts[:2])) == (12,)
    with pytest.raises(cp.InvalidArgument, match="deepest"):
        growth_vector(cp.Scene(solo), deepest=0)
    bar = cp.model.four_bar()
    with pytest.raises(cp.errors.NotAssembled):
        growth_vector(cp.Scene(bar, bar.loops), bar.postures["open"] + 0.1)


def test_what_kind_of_system():
    bar = cp.model.four_bar()
    loop, crank = bar.loops, HeldJoint("crank", bar.postures["open"][0])
    kinds = {
        "no constraints: an ODE": cp.Scene(bar),
        "holonomic, scleronomic, bilateral, rank 2 of 3 rows, DAE of index 3": cp.Scene(bar, loop),
        "holonomic, rheonomic, bilateral, rank 3 of 4 rows, DAE of index 3": cp.Scene(
            bar, [*loop, Driven(crank, Sine(0.1))]
        ),
        "nonholonomic, scleronomic, bilateral, independent rows (LICQ), DAE of index 2":
            on_contacts(cp.model.sleigh()),
        "nonholonomic, scleronomic, bilateral, independent rows (LICQ), DAE of index 3":
            on_contacts(cp.model.rolling_ball()),
    }  # fmt: skip
    for text, scene in kinds.items():
        assert str(scene.summary().classification) == text
        assert f"classification   {text}" in str(scene.summary())
    solo = cp.load_robot("solo12")
    open_ended = cp.Scene(solo, contacts=solo.frictional_contacts(0.7))
    assert open_ended.summary().classification.unilateral
    assert "unilateral" in str(open_ended.summary())
    # a wheel that only rolls straight on is held by the rate of a function of q
    straight = cp.Scene(cp.model.unicycle(), [*cp.model.unicycle().contacts, HeldJoint("heading")])
    kind = straight.summary().classification
    assert (kind.holonomic, kind.velocity_rows, kind.index) == (True, 2, 3)
    open_loop = cp.Scene(bar, [*loop, Coupling("crank", "rocker", 7.0, 3.0)])
    assert open_loop.summary().classification.holonomic


# --- vakonomic ---------------------------------------------------------------------------------


def test_curvature_is_zero_where_rows_are_integrable():
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.sample(np.random.default_rng(1))
    other = cp.mechanism.project_velocity(scene, q, np.ones(3))
    assert np.abs(curvature(scene, q, v) @ other).max() < 1e-12
    # d(v, w) = -omega_v u_w + u_v omega_w of a blade
    K = curvature(on_contacts(cp.model.sleigh()), [0, 0, 1, 0], [0.7, 0, 1.3])
    assert pytest.approx(np.array([[-1.3, 0.0, 0.7]]), abs=1e-12) == K


def test_a_vakonomic_sleigh_is_that_of_eulers_and_poincares_equations():
    """p' = ad*_xi p with p = dl/dxi + mu e_2: u and omega, and the momentum across."""
    arm, m, inertia = 0.2, 1.0, 0.1
    scene = on_contacts(cp.model.sleigh(arm=arm, mass=m, inertia=inertia))
    q, v, mu = np.array([0.0, 0.0, 1.0, 0.0]), np.array([1.0, 0.0, 2.0]), np.array([0.3])
    motion = vakonomic(scene, q, v, mu, duration=0.5, dt=1e-2)
    moved, at_end = motion.v[-1], motion.mu[-1]
    J = inertia + m * arm**2

    def slope(t, y):
        u, omega, across = y  # across = m arm omega + mu
        p = np.array([m * u, across, J * omega])
        return [omega * p[1] / m, (-u * p[1]) / J, -omega * p[0]]

    start = [v[0], v[2], m * arm * v[2] + mu[0]]
    exact = solve_ivp(slope, (0, 0.5), start, rtol=1e-12, atol=1e-12).y[:, -1]
    assert moved[[0, 2]] == pytest.approx(exact[:2], abs=1e-7)
    assert m * arm * moved[2] + at_end[0] == pytest.approx(exact[2], abs=1e-7)
    # d'Alembert's is another motion, also from mu = 0
    machine = cp.simulate(scene, q, v, duration=0.5, dt=1e-3)
    other = vakonomic(scene, q, v, duration=0.5, dt=1e-2).v[-1]
    assert abs(machine.v[-1] - other).max() > 0.05


# --- Chaplygin ---------------------------------------------------------------------------------


def chaplygin(L, s, g, of_g):
    """The reduced equations of L(s, s', g') with g'_k = of_g[k](s, s'): a function of s, s', s''.

    d/dt dLc/ds'_a - dLc/ds_a = -sum_k dL/dg'_k sum_b (dA_kb/ds_a - dA_ka/ds_b) s'_b,
    g'_k = sum_a A_ka s'_a
    """
    t = sp.Symbol("t")
    rates, twice = sp.symbols(f"r:{len(s)}"), sp.symbols(f"w:{len(s)}")
    gs = sp.symbols(f"g:{len(g)}")
    energy = L(s, rates, gs)
    A = [[sp.diff(each(s, rates), r) for r in rates] for each in of_g]
    given = dict(zip(gs, (each(s, rates) for each in of_g), strict=True))
    Lc = energy.subs(given)
    p = [sp.diff(energy, each).subs(given) for each in gs]
    found = []
    for a in range(len(s)):
        momentum = sp.diff(Lc, rates[a])
        rate = sum(sp.diff(momentum, s[b]) * rates[b] + sp.diff(momentum, rates[b]) * twice[b]
                   for b in range(len(s)))  # fmt: skip
        # g'_k = A s': the variations do not commute by the curvature of A
        turning = sum(p[k] * (sp.diff(A[k][b], s[a]) - sp.diff(A[k][a], s[b])) * rates[b]
                      for k in range(len(g)) for b in range(len(s)))  # fmt: skip
        found.append(rate - sp.diff(Lc, s[a]) + turning)
    assert t not in Lc.free_symbols
    return sp.lambdify([s, rates, twice], found)


def test_the_sleigh_obeys_chaplygins_reduced_equations():
    """Base (x, theta), fibre y: y' = x' tan(theta)."""
    arm, m, inertia = 0.2, 1.3, 0.1
    _, theta = s = sp.symbols("x theta")

    def L(s, r, g):
        # the centre of mass is arm ahead of the blade
        vx = r[0] - arm * r[1] * sp.sin(theta)
        vy = g[0] + arm * r[1] * sp.cos(theta)
        return (m * (vx**2 + vy**2) + inertia * r[1] ** 2) / 2

    residual = chaplygin(L, s, ["y"], [lambda s, r: r[0] * sp.tan(theta)])
    scene = on_contacts(cp.model.sleigh(arm=arm, mass=m, inertia=inertia))
    rng = np.random.default_rng(0)
    for _ in range(5):
        angle, u, omega = rng.normal(size=3)
        q = [0.3, 0.1, np.cos(angle), np.sin(angle)]
        a = cp.solve(scene, q, [u, 0.0, omega], np.zeros(3)).a
        # x' = u cos - w sin, and its rate with w = 0
        rates = [u * np.cos(angle), omega]
        twice = [a[0] * np.cos(angle) - a[1] * np.sin(angle) - u * omega * np.sin(angle), a[2]]
        assert np.abs(residual([0.3, angle], rates, twice)).max() < 1e-12


def test_the_ball_obeys_chaplygins_reduced_equations():
    """Base: roll, pitch and yaw; fibre (x, y): x' = r omega_y, y' = -r omega_x."""
    r, m = 0.3, 0.7
    J = 2 / 5 * m * r**2
    angles = yaw, pitch, _ = sp.symbols("yaw pitch roll")

    level = sp.Matrix([sp.cos(yaw), sp.sin(yaw), 0])
    axes = (sp.Matrix([0, 0, 1]), sp.Matrix([-sp.sin(yaw), sp.cos(yaw), 0]),
            sp.cos(pitch) * level - sp.sin(pitch) * sp.Matrix([0, 0, 1]))  # fmt: skip

    def omega(rates):
        """In the axes of the world, of R = Rz(yaw) Ry(pitch) Rx(roll)."""
        return sum((rate * axis for rate, axis in zip(rates, axes, strict=True)), sp.zeros(3, 1))

    def L(s, rates, g):
        return (m * (g[0] ** 2 + g[1] ** 2) + J * omega(rates).dot(omega(rates))) / 2

    of_g = [lambda s, rates: r * omega(rates)[1], lambda s, rates: -r * omega(rates)[0]]
    residual = chaplygin(L, angles, ["x", "y"], of_g)
    rates, twice = sp.symbols("p:3"), sp.symbols("w:3")
    turn = omega(rates)
    rate_of_turn = turn.jacobian(rates) * sp.Matrix(twice) + turn.jacobian(angles) * sp.Matrix(
        rates
    )
    of = sp.lambdify([angles, rates, twice], [turn, rate_of_turn])
    scene = on_contacts(cp.model.rolling_ball(radius=r, mass=m))
    rng = np.random.default_rng(1)
    for _ in range(5):
        s, ds = rng.uniform(-1, 1, 3), rng.normal(size=3)
        R = pin.rpy.rpyToMatrix(s[2], s[1], s[0])
        q = np.array([0.1, 0.2, r, *pin.Quaternion(R).coeffs()])
        w = of(s, ds, np.zeros(3))[0].ravel()
        v = np.concatenate([R.T @ [r * w[1], -r * w[0], 0.0], R.T @ w])
        a = cp.solve(scene, q, v, np.zeros(6)).a
        alpha = R @ a[3:]  # omega x omega is nothing
        bias, M = of(s, ds, np.zeros(3))[1].ravel(), []
        M = [of(s, ds, e)[1].ravel() - bias for e in np.eye(3)]
        dds = np.linalg.solve(np.array(M).T, alpha - bias)
        assert np.abs(residual(s, ds, dds)).max() < 1e-12


# --- cars --------------------------------------------------------------------------------------


def test_a_car_turns_about_the_centre_of_its_axles():
    made = cp.model.car(trailers=1, wheelbase=2.5, hitch=2.0)
    scene = on_contacts(made)
    q = np.array([0.0, 0.0, 0.3, 0.2, -0.1])
    u, heading = 3.0, 0.3
    turn = u * np.tan(0.2) / 2.5
    hitch = u * np.sin(0.1) / 2.0 - turn  # theta_0 - theta_1 = -hitch
    v = np.array([u * np.cos(heading), u * np.sin(heading), turn, 0.7, hitch])
    assert scene.check(q, v).consistent
    assert np.abs(cp.mechanism.project_velocity(scene, q, v) - v).max() < 1e-12


def test_ackermanns_trapezoid_comes_near_his_condition():
    made = cp.model.ackermann(wheelbase=2.5, track=1.4, arm=0.15)
    scene = cp.Scene(made, made.loops)

    def gap(right, left):
        """The length of the tie rod by plane geometry."""
        inwards, ends = np.arctan2(0.7, 2.5), []
        for side, angle in ((1, left), (-1, right)):
            c, s = np.cos(angle), np.sin(angle)
            arm = 0.15 * np.array([-np.cos(inwards), -side * np.sin(inwards)])
            ends.append([0, side * 0.7] + np.array([[c, -s], [s, c]]) @ arm)
        return np.linalg.norm(np.subtract(*ends)) - (1.4 - 2 * 0.15 * np.sin(inwards))

    for left in (0.1, 0.3, 0.5):
        right = scene.assemble([left, left], fixed=["left"]).q[1]
        assert right == pytest.approx(brentq(gap, 0, 0.7, args=(left,), xtol=1e-14), abs=1e-10)
        ideal = np.arctan(1 / (1 / np.tan(left) + 1.4 / 2.5))
        assert ideal < right < left
        assert abs(right - ideal) < 0.1 * left


@pytest.mark.long
@each_row("call", [lambda: cp.model.car(trailers=1.5),
                                  lambda: cp.model.car(wheelbase=0.0),
                                  lambda: cp.model.ackermann(arm=-1.0)])  # fmt: skip
def test_cars_refuse(call):
    with pytest.raises(cp.InvalidArgument):
        call()
