"""Laws of restitution: energy, momentum and what is left of approach, against closed forms."""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box, Driven, HeldJoint, Plane, Polynomial
from condyn_pin.contact import ContactProblem, Energetic, Newton, Poisson, RestitutionLaw
from condyn_pin.contact.normal_path import normal_path
from condyn_pin.model import Spring, free_ball, free_box, together
from condyn_pin.stepping import EventDriven

LEAN = 0.6  # [rad]


def leaning_rod(friction: float = 0.5) -> ContactProblem:
    """A rod of 1 kg and 1 m whose foot strikes the floor: G and sigma by hand."""
    inertia, (x, z) = (1.0 + 0.02**2) / 12, (-0.5 * sin(LEAN), -0.5 * cos(LEAN))
    G = np.diag([1 + z * z / inertia, 1.0, 1 + x * x / inertia])
    G[0, 2] = G[2, 0] = -x * z / inertia
    return ContactProblem(G, (-1 - 4 * z, 0, -1 + 4 * x), [friction])


def gained(problem: ContactProblem, lam: np.ndarray) -> float:
    return 0.5 * float(lam @ (problem.g + problem.velocities(lam)))


@pytest.mark.parametrize(
    ("e", "friction", "speed", "change"),
    [(1.0, 0.5, 1.854197708, -0.036261857), (0.5, 0.5, 0.927098854, -1.017276604),
     (1.0, 1.2, 1.844210877, None)],
)  # fmt: skip
def test_a_leaning_rod_rebounds(e: float, friction: float, speed: float, change: float) -> None:
    problem = leaning_rod(friction)
    found = Energetic().strike(problem, np.array([e]))
    assert found.apart.all()
    assert_allclose(problem.velocities(found.lam)[2], speed, atol=1e-9)
    if change is not None:
        assert_allclose(gained(problem, found.lam), change, atol=1e-9)


@pytest.mark.long
def test_slip_that_turns_ends_where_the_work_is_given_back() -> None:
    """A box of 1 kg on one corner; the path in space against steps of its normal impulse."""
    R, r = pin.rpy.rpyToMatrix(0.5, 0.3, 0.2), np.array([-0.1, -0.06, -0.04])
    sides = np.array([0.2, 0.12, 0.08])
    inertia = np.diag((sides @ sides - sides**2) / 12)
    lever = pin.skew(R @ r)
    G = np.eye(3) - lever @ R @ np.linalg.inv(inertia) @ R.T @ lever
    before = np.array([1.0, 0.5, -1.0]) + R @ np.cross([2.0, -1.0, 3.0], r)
    lam = normal_path((G + G.T) / 2, before, 0.4, 0.8)
    assert_allclose((before + G @ lam)[2], 1.068160531, atol=1e-8)
    assert_allclose(lam @ (before + G @ lam / 2), -0.232808365, atol=1e-8)
    s, p, taken, by, dp = before.copy(), np.zeros(3), 0.0, 0.0, 1e-5
    while s[2] < 0 or by < 0.64 * taken:
        d = np.append(-0.4 * s[:2] / np.hypot(*s[:2]), 1.0)
        if s[2] < 0:
            taken -= s[2] * dp
        else:
            by += s[2] * dp
        s, p = s + dp * G @ d, p + dp * d
    assert_allclose(lam, p, atol=1e-3)


one = st.floats(-1, 1)


@given(st.lists(one, min_size=15, max_size=15), st.floats(0, 1.5), st.floats(0, 1), st.booleans())
@settings(max_examples=60, deadline=None)
def test_one_contact_never_gains(numbers: list[float], mu: float, e: float, in_plane: bool) -> None:
    X = np.reshape(numbers[:12], (4, 3)) + np.eye(4, 3)
    if in_plane:
        X[:, 1] = 0.0
    G, v = X.T @ X, np.append(numbers[12:], 1.0)
    before = X.T @ v
    for end in ("stronge", "poisson"):
        lam = normal_path(G, before, mu, e, end)  # type: ignore[arg-type]
        after = before + G @ lam
        assert lam @ (before + after) <= 1e-9 * (v @ v)
        assert after[2] >= -1e-9
        assert np.hypot(*lam[:2]) <= mu * lam[2] + 1e-9


LAWS = (Energetic(), Energetic(pieces=4), Energetic(chain=True), Poisson())


@pytest.mark.parametrize("law", LAWS)
def test_several_contacts_never_gain(law: RestitutionLaw) -> None:
    rng = np.random.default_rng(3)
    for _ in range(4):
        X, v = rng.normal(size=(9, 6)) + 2 * np.eye(9, 6), rng.normal(size=9)
        problem = ContactProblem(X.T @ X, X.T @ v, rng.uniform(0, 0.8, 2))
        if not (problem.g[2::3] < 0).any():
            continue
        found = law.strike(problem, rng.uniform(0.1, 1, 2))
        assert found.natural < 1e-7
        assert gained(problem, found.lam) <= 1e-12
        if found.apart.all():
            assert problem.velocities(found.lam)[2::3].min() > -1e-8


def cradle(masses: tuple[float, ...]) -> tuple[ContactProblem, np.ndarray, np.ndarray]:
    J, v = np.zeros((3 * (len(masses) - 1), len(masses))), np.zeros(len(masses))
    for i in range(len(masses) - 1):
        J[3 * i + 2, i : i + 2] = -1, 1
    v[0] = 1.0
    return ContactProblem(J / masses @ J.T, J @ v, np.zeros(len(masses) - 1)), J, v


@pytest.mark.parametrize(
    ("masses", "ends"),
    [((1, 1, 1), (0, 0, 1)), ((1,) * 5, (0, 0, 0, 0, 1)), ((1, 2, 1), (-1 / 3, 2 / 9, 8 / 9))],
)
def test_a_chain_of_impacts_passes_on(masses: tuple[float, ...], ends: tuple[float, ...]) -> None:
    problem, J, v = cradle(masses)
    found = Energetic(chain=True).strike(problem, np.ones(len(masses) - 1))
    assert_allclose(v + J.T @ found.lam / masses, ends, atol=1e-12)


@pytest.mark.long
def test_contacts_at_once_are_said() -> None:
    problem, J, v = cradle((1, 1, 1))
    found = Energetic().strike(problem, np.ones(2), always=True)
    assert_allclose(v + J.T @ found.lam, (-1 / 3, 2 / 3, 2 / 3), atol=1e-12)
    assert "at once" in found.notes[0][2]


def falling_rod(restitution: float = 1.0) -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    foot = cp.FrictionalContact(
        "box", offset=(0, 0, -0.5), friction=0.5, restitution=restitution, name="foot"
    )
    scene = cp.Scene(free_box(mass=1.0, size=(0.02, 0.02, 1.0)), contacts=[foot])
    q = np.array([0, 0, 0.5 * cos(LEAN) + 1e-9, 0, sin(LEAN / 2), 0, cos(LEAN / 2)])
    R = pin.Quaternion(q[3:]).matrix()
    return scene, q, np.concatenate((R.T @ [-1.0, 0, -1.0], [0, -4.0, 0]))


def kinetic(scene: cp.Scene, q: np.ndarray, v: np.ndarray) -> float:
    model = scene.robot.model
    return float(pin.computeKineticEnergy(model, model.createData(), q, v))


@pytest.mark.long
def test_steps_and_events_do_not_gain() -> None:
    scene, q, v = falling_rod()
    before = kinetic(scene, q, v)
    now = cp.step(scene, q, v, dt=1e-7, integrator=cp.Moreau())
    assert_allclose(kinetic(scene, now.q, now.v) - before, -0.036261857, atol=1e-5)
    run = cp.simulate(scene, q, v, duration=1e-4, dt=1e-4, integrator=EventDriven())
    assert_allclose(run.energy.contact[-1], -0.036261857, atol=1e-5)


def test_newtons_law_says_what_it_adds() -> None:
    scene, q, v = falling_rod()
    law = Newton()
    now = cp.step(scene, q, v, dt=1e-7, integrator=cp.Moreau(restitution_law=law))
    assert any("adds 0.381 J at foot" in notice for notice in now.notices)
    run = cp.simulate(
        scene, q, v, duration=1e-4, dt=1e-4, integrator=EventDriven(restitution_law=law)
    )
    assert any("adds 0.381 J at foot" in notice for notice in run.notices)


def test_a_ball_rebounds_as_by_newtons_law_to_the_bit() -> None:
    touch = cp.FrictionalContact("ball", Ball(0.05), friction=0.2, restitution=0.8)
    scene = cp.Scene(free_ball(mass=1.0, radius=0.05), contacts=[touch])
    q, v = np.array([0, 0, 0.05 - 1e-4, 0, 0, 0, 1.0]), np.array([1.0, 0, -2.0, 0, -20.0, 0])
    ends = [
        cp.step(scene, q, v, dt=1e-3, integrator=cp.Moreau(restitution_law=law)).v
        for law in (Energetic(), Newton())
    ]
    assert (ends[0] == ends[1]).all()
    assert_allclose(ends[0][2] * 1.0, 1.6, atol=0.1)


@pytest.mark.parametrize(
    ("stiff", "slip", "turns"),
    [
        ((3.5, 3.5), (0.6, 0.8), False),  # a ball
        ((3.5, 2.0), (1.0, 0.0), False),
        ((3.5, 2.0), (0.0, 1.0), False),
        ((3.5, 2.0), (0.6, 0.8), True),
    ],
)
def test_newtons_law_answers_where_slip_keeps_its_direction(
    stiff: tuple[float, float], slip: tuple[float, float], turns: bool
) -> None:
    problem = ContactProblem(np.diag([*stiff, 1.0]), (*slip, -1.0), [0.2])
    assert Energetic().strike(problem, np.array([0.8])).apart.tolist() == [turns]


@pytest.mark.parametrize("law", [Energetic(), Poisson()])
@pytest.mark.parametrize("angle", [0.4, 1.5, 3.0])
def test_impulses_turn_with_the_axes_of_the_contact(law: RestitutionLaw, angle: float) -> None:
    rod, e = leaning_rod(), np.array([0.7])
    Q = pin.rpy.rpyToMatrix(0.0, 0.0, angle)
    turned = ContactProblem(Q @ rod.G @ Q.T, Q @ rod.g, rod.friction)
    lam = law.strike(rod, e).lam
    assert lam[2] > 0
    assert_allclose(law.strike(turned, e).lam, Q @ lam, atol=1e-9)


@pytest.mark.parametrize("offset", [(0.0, 0.0, -0.5), (0.0, 0.0, -0.01)])
def test_derivatives_of_an_impact(offset: tuple[float, float, float]) -> None:
    """Also where Newton's law gives the same at this very state: below the centre of mass."""
    scene, q, v = falling_rod(0.8)
    if offset[2] > -0.1:
        box = free_box(mass=1.0, size=(0.2, 0.12, 0.02))
        foot = cp.FrictionalContact("box", offset=offset, friction=0.3, restitution=0.5)
        scene = cp.Scene(box, contacts=[foot])
        q, v = np.array([0, 0, 0.01 - 1e-9, 0, 0, 0, 1.0]), np.array([0.5, 0.2, -1.0, 0, 0, 0])
    model, h, dt = scene.robot.model, 1e-6, 1e-4

    def end(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return cp.step(scene, q, v, dt=dt, integrator=cp.Moreau()).v

    of = cp.step(scene, q, v, dt=dt, integrator=cp.Moreau()).derivatives()
    by_q = [(end(pin.integrate(model, q, x), v) - end(pin.integrate(model, q, -x), v)) / (2 * h)
            for x in h * np.eye(6)]  # fmt: skip
    by_v = [(end(q, v + x) - end(q, v - x)) / (2 * h) for x in h * np.eye(6)]
    size = np.abs(of.dv_dq).max()
    assert_allclose(of.dv_dq, np.transpose(by_q), atol=1e-6 * max(size, 1))
    assert_allclose(of.dv_dv, np.transpose(by_v), atol=1e-6 * max(size, 1))
    touch = scene.contacts[0]
    assert isinstance(touch, cp.FrictionalContact)
    harder = cp.Scene(scene.robot, contacts=[
        cp.FrictionalContact("box", offset=touch.offset, friction=touch.friction,
                             restitution=touch.restitution + h)
    ])  # fmt: skip
    more = cp.step(harder, q, v, dt=dt, integrator=cp.Moreau()).v
    assert_allclose(of.dv_drestitution[:, 0], (more - end(q, v)) / h, atol=1e-4)


@pytest.mark.long
def test_what_is_no_law_is_refused() -> None:
    with pytest.raises(cp.InvalidArgument, match="restitution_law = 'newton'"):
        cp.Moreau(restitution_law="newton")  # type: ignore[arg-type]
    with pytest.raises(cp.InvalidArgument, match="chain"):
        Energetic(chain=1)  # type: ignore[arg-type]
    with pytest.raises(cp.InvalidArgument, match="pieces"):
        Energetic(pieces=0)


def test_moreau_is_of_second_order_with_springs_and_torques() -> None:
    model = pin.Model()
    j = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    model.appendBodyToJoint(j, pin.Inertia.FromSphere(1.0, 0.05), pin.SE3.Identity())
    model.addFrame(pin.Frame("p", j, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.damping[:] = 2.0
    robot = cp.Robot("mass", model, springs=[Spring("x", 75.0, 0.0)])
    far = cp.FrictionalContact("p", on=Plane((1, 0, 0), -9.0), friction=0.5)
    scene, rate = cp.Scene(robot, contacts=[far]), sqrt(100.0 - 1.0)
    right = 0.1 * np.exp(-1.0) * (cos(rate) + sin(rate) / rate)
    errors = [
        abs(cp.simulate(scene, [0.1], [0.0], lambda t, q, v: -25 * q, duration=1.0, dt=dt,
                        integrator=cp.Moreau()).q[-1, 0] - right)
        for dt in (8e-3, 4e-3)
    ]  # fmt: skip
    assert 3.5 < errors[0] / errors[1] < 4.5


@pytest.mark.long
def test_stiff_dampers_do_not_swing_on_in_moreaus_steps() -> None:
    model = pin.Model()
    j = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    model.appendBodyToJoint(j, pin.Inertia.FromSphere(1.0, 0.05), pin.SE3.Identity())
    model.addFrame(pin.Frame("p", j, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.damping[:] = 1e5
    far = cp.FrictionalContact("p", on=Plane((1, 0, 0), -9.0), friction=0.5)
    now = cp.step(cp.Scene(cp.Robot("m", model), contacts=[far]), [0.0], [1.0], dt=1e-3,
                  integrator=cp.Moreau())  # fmt: skip
    assert 0 < now.v[0] < 0.02


def test_moreau_says_how_deep_a_body_stays() -> None:
    touch = cp.FrictionalContact("ball", Ball(0.05), friction=0.5)
    scene = cp.Scene(free_ball(mass=1.0, radius=0.05), contacts=[touch])
    q, dt = np.array([0, 0, 0.55, 0, 0, 0, 1.0]), 1e-2
    run = cp.simulate(scene, q, np.zeros(6), duration=0.5, dt=dt, integrator=cp.Moreau())
    deep = -float(run.gaps["ball"][-1])
    assert 1e-3 < deep <= dt * sqrt(2 * 9.81 * 0.5)
    assert any(f"ball is {deep:.3g} m" in notice for notice in run.notices)


@pytest.mark.parametrize("beside", [False, True])
def test_shapes_that_pass_through_each_other_are_said(beside: bool) -> None:
    parts = together({"bullet": free_ball(mass=0.01, radius=0.005),
                      "wall": free_box(mass=1e4, size=(0.001, 0.1, 0.1))})  # fmt: skip
    thin = Box(0.0005, 0.05, 0.05)
    touch = cp.FrictionalContact("bullet/ball", Ball(0.005), on="wall/box", on_shape=thin,
                                 friction=0.2, name="hit")  # fmt: skip
    scene = cp.Scene(parts, contacts=[touch])
    q, v = scene.state()
    q[:3], q[7:10], v[0] = (-0.06, 0.06 * beside, 5), (0, 0, 5), 20.0
    run = cp.simulate(scene, q, v, duration=5e-3, dt=1e-3, integrator=cp.Moreau())
    assert any("pass through each other" in notice for notice in run.notices) is not beside


@pytest.mark.long
def test_a_bead_stays_on_a_board_that_tilts() -> None:
    model, still = pin.Model(), pin.SE3.Identity()
    hinge = model.addJoint(0, pin.JointModelRY(), still, "hinge")
    model.appendBodyToJoint(hinge, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), still)
    model.addFrame(pin.Frame("board", hinge, 0, still, pin.FrameType.OP_FRAME))
    j = model.addJoint(0, pin.JointModelPX(), still, "x")
    j = model.addJoint(j, pin.JointModelPZ(), still, "z")
    model.appendBodyToJoint(j, pin.Inertia.FromSphere(1.0, 0.05), still)
    model.addFrame(pin.Frame("bead", j, 0, still, pin.FrameType.OP_FRAME))
    touch = cp.FrictionalContact("bead", on="board", on_shape=Plane(), friction=0.0, name="t")
    tilts = Driven(HeldJoint("hinge"), Polynomial([0.0, 0.8]))
    scene = cp.Scene(cp.Robot("board", model), [tilts], contacts=[touch])
    run = cp.simulate(scene, np.array([0, 0.5, 0.0]), np.array([0.8, 0, -0.4]), duration=0.2,
                      dt=1e-3, integrator=cp.Moreau())  # fmt: skip
    assert (run.modes["t"][1:] != "open").all()
    # s'' = s w^2 + g sin(w t) along the board, from s = 0.5 at rest
    w, t, g = 0.8, 0.2, 9.81
    s = 0.5 * np.cosh(w * t) + g / (2 * w * w) * (np.sinh(w * t) - sin(w * t))
    assert_allclose(np.hypot(run.q[-1, 1], run.q[-1, 2]), s, atol=1e-3)
