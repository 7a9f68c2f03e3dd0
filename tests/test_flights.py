"""Bodies that spin: what they fly and roll does not depend on it, and energies keep their order."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import condyn_pin as cp
from condyn_pin.constraints import Ball, Plane
from condyn_pin.simulation import INTEGRATORS
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.stepping import EventDriven

G = 9.81

# Methods on momenta are on a screw, as their discrete Lagrangian is.
STRAIGHT = sorted(set(INTEGRATORS) - {"rattle", "shake"})
SMOOTH = [name for name in STRAIGHT if INTEGRATORS[name]().order.v >= 2]


def world(run: cp.Trajectory, k: int = -1) -> np.ndarray:
    """Velocity of the origin of a body that floats, in the axes of the world."""
    return pin.Quaternion(run.q[k, 3:7]).matrix() @ run.v[k, :3]


def turned(rng: np.random.Generator) -> np.ndarray:
    quaternion = rng.normal(size=4)
    return quaternion / np.linalg.norm(quaternion)


@pytest.mark.parametrize("name", STRAIGHT)
def test_a_ball_flies_as_fast_as_without_spin(name):
    """2 rad in a step, from any attitude."""
    rng = np.random.default_rng(1)
    scene, q = cp.Scene(cp.model.free_ball()), np.concatenate([rng.normal(size=3), turned(rng)])
    v = np.concatenate([rng.normal(size=3), 100.0 * turned(rng)[:3]])
    run = cp.simulate(scene, q, v, duration=1.0, dt=0.02, integrator=INTEGRATORS[name]())
    assert run.status.ok
    start = world(run, 0)
    assert np.abs(world(run) - start - [0, 0, -G]).max() < 1e-10
    off = run.q[-1, :3] - q[:3] - start - [0, 0, -G / 2]
    order = INTEGRATORS[name]().order.q
    assert np.abs(off).max() < (1e-10 if order > 1 else 0.1)


@pytest.mark.parametrize("name", SMOOTH)
def test_a_disc_in_a_plane_flies_as_fast_as_without_spin(name):
    model = pin.Model()
    upright = pin.SE3(pin.rpy.rpyToMatrix(np.pi / 2, 0, 0), np.array([0.3, 0.0, 0.2]))
    joint = model.addJoint(0, pin.JointModelPlanar(), upright, "disc")
    model.appendBodyToJoint(joint, pin.Inertia.FromCylinder(1.0, 0.1, 0.02), pin.SE3.Identity())
    q = np.array([0.1, 0.2, np.cos(0.7), np.sin(0.7)])
    run = cp.simulate(
        cp.Scene(cp.Robot("disc", model)), q, [1.0, -0.5, 90.0], duration=0.6, dt=0.02,
        integrator=INTEGRATORS[name](),
    )  # fmt: skip

    def flies(k: int) -> np.ndarray:
        (c, s), (x, y) = run.q[k, 2:], run.v[k, :2]
        return np.array([c * x - s * y, s * x + c * y])

    start = flies(0)
    assert np.abs(flies(-1) - start - [0, -0.6 * G]).max() < 1e-10
    assert np.abs(run.q[-1, :2] - q[:2] - 0.6 * start - [0, -0.18 * G]).max() < 1e-10


@pytest.mark.long
@pytest.mark.parametrize("name", ["rungekutta4", "stormerverlet", "eventdriven", "moreau"])
@given(spin=st.tuples(*3 * [st.floats(-150, 150)]), dt=st.sampled_from([0.01, 0.005, 0.003]))
@settings(max_examples=15, deadline=None)
def test_any_spin_about_a_principal_axis_leaves_the_flight_alone(name, spin, dt):
    """All axes of a ball are."""
    scene, duration = cp.Scene(cp.model.free_ball(radius=0.2)), 20 * dt
    v = np.concatenate([[3.0, -1.0, 2.0], spin])
    run = cp.simulate(
        scene, pin.neutral(scene.robot.model), v, duration=duration, dt=dt,
        integrator=INTEGRATORS[name](),
    )  # fmt: skip
    assert run.status.ok
    wanted = duration * v[:3] + [0, 0, -G * duration**2 / 2]
    assert np.abs(run.q[-1, :3] - wanted).max() < 1e-10
    assert np.abs(run.v[-1, 3:] - spin).max() < 1e-10


def on_a_ramp(slope: float, radius: float):
    normal = np.array([np.sin(slope), 0.0, np.cos(slope)])
    contact = cp.FrictionalContact("ball", Ball(radius), on=Plane(tuple(normal)), friction=0.5)
    scene = cp.Scene(cp.model.free_ball(radius=radius), contacts=[contact])
    q, v = scene.state()
    q[:3] = radius * normal
    return scene, q, v, np.array([np.cos(slope), 0.0, -np.sin(slope)])


@pytest.mark.parametrize("inner", ["rungekutta4", "stormerverlet"])
def test_a_ball_rolls_down_a_ramp_by_large_steps(inner):
    """It turns by 4.1 rad in its last ones."""
    scene, q, v, down = on_a_ramp(0.3, 0.05)
    run = cp.simulate(
        scene, q, v, duration=5.0, dt=0.02, integrator=EventDriven(INTEGRATORS[inner]())
    )
    wanted = 5 / 7 * G * np.sin(0.3) * 5.0
    assert run.status.ok
    assert world(run) @ down == pytest.approx(wanted, rel=1e-8)
    assert run.q[-1, :3] @ down == pytest.approx(wanted * 2.5, rel=1e-8)
    assert np.abs(run.energy.error).max() < 1e-6
    assert "turns by 4.14 rad in a step of 0.02 s, right for a ball" in "".join(run.notices)


@pytest.mark.long
def test_a_time_stepping_scheme_rolls_on_beyond_half_a_turn():
    scene, q, v, down = on_a_ramp(0.3, 0.05)
    run = cp.simulate(scene, q, v, duration=5.0, dt=0.02)
    assert run.status.ok
    assert world(run) @ down == pytest.approx(5 / 7 * G * np.sin(0.3) * 5.0, rel=1e-6)


@given(spin=st.floats(-60, 60), height=st.floats(0.2, 3.0), dt=st.sampled_from([0.05, 0.02]))
@settings(max_examples=15, deadline=None)
def test_a_spinning_ball_hits_when_it_falls(spin, height, dt):
    contact = cp.FrictionalContact("ball", Ball(0.05), friction=0.2, restitution=0.8)
    scene = cp.Scene(cp.model.free_ball(radius=0.05), contacts=[contact])
    q, v = scene.state()
    q[2], v[0], v[4] = 0.05 + height, 2.0, spin
    wanted = np.sqrt(2 * height / G)
    run = cp.simulate(scene, q, v, duration=wanted + 0.05, dt=dt, integrator=EventDriven())
    assert run.run.happened[0].t == pytest.approx(wanted, rel=1e-12)


@pytest.mark.long
def test_friction_of_a_ball_that_spins_fast_takes_what_the_ball_loses():
    """4 rad in a step: work over each is that of the way the ball takes, not of the short one."""
    scene, q, v, _ = on_a_ramp(0.0, 0.05)
    v[4] = 200.0
    run = cp.simulate(scene, q, v, duration=0.4, dt=0.02, integrator=EventDriven())
    kinetic = run.energy.kinetic
    assert kinetic[-1] < 0.9 * kinetic[0]
    assert run.energy.contact[-1] == pytest.approx(kinetic[-1] - kinetic[0], rel=1e-6)


# a box that tumbles ---------------------------------------------------------------------------


@cache
def hung() -> cp.Scene:
    """A box on a spring between one of its corners and the world."""
    box = cp.model.free_box(size=(0.3, 0.2, 0.1))
    box = box.with_frame("corner", "box", [0.15, 0.1, 0.05])
    box = box.with_frame("anchor", "world", [0.0, 0.0, 0.0])
    spring = cp.model.SpringDamper("corner", "anchor", stiffness=40.0, rest_length=0.1)
    return cp.Scene(replace(box, spring_dampers=[spring]))


def ends(integrator, dt: float) -> np.ndarray:
    """Place, attitude and velocities in the world after half a second."""
    scene = hung()
    q, v = pin.neutral(scene.robot.model), np.array([1.0, 0.3, 0, 3.0, 8.0, -2.0])
    run = cp.simulate(scene, q, v, duration=0.5, dt=dt, integrator=integrator)
    R = pin.Quaternion(run.q[-1, 3:]).matrix()
    return np.concatenate([run.q[-1, :3], R.ravel(), R @ run.v[-1, :3], R @ run.v[-1, 3:]])


@cache
def truth() -> np.ndarray:
    return ends(cp.simulation.DormandPrince(1e-12, 1e-13), 0.01)


@pytest.mark.parametrize("name", [n for n in SMOOTH if n not in ("dormandprince", "moreau")])
def test_a_box_that_tumbles_keeps_the_order_of_its_method(name):
    integrator = INTEGRATORS[name]()
    order = min(integrator.order[:2])
    dt = 1e-2 if order > 2 else 2e-3
    errors = [np.abs(ends(integrator, each) - truth()).max() for each in (dt, dt / 2)]
    assert np.log2(errors[0] / errors[1]) > order - 0.3


@pytest.mark.long
@pytest.mark.parametrize("name", ["expliciteuler", "semiimpliciteuler"])
def test_a_box_that_tumbles_keeps_order_one(name):
    errors = [np.abs(ends(INTEGRATORS[name](), dt) - truth()).max() for dt in (5e-4, 2.5e-4)]
    assert np.log2(errors[0] / errors[1]) > 0.8


@pytest.mark.long
@pytest.mark.parametrize(("name", "kept"), [("rungekutta4", 2e-5), ("implicitmidpoint", 2e-3)])
def test_a_long_tumble_keeps_its_energy(name, kept):
    """20 s, some 60 turns, without weight and with it."""
    scene = cp.Scene(cp.model.free_box(size=(0.3, 0.2, 0.1)))
    q, v = pin.neutral(scene.robot.model), np.array([1.0, 0.3, 0, 3.0, 18.0, -2.0])
    for gravity in (True, False):
        run = cp.simulate(
            scene, q, v, duration=20.0, dt=5e-3, integrator=INTEGRATORS[name](), gravity=gravity
        )
        assert np.abs(run.energy.error).max() < kept * run.energy.kinetic.max()
        moved = run.q[-1, :3] - 20.0 * v[:3] + [0, 0, gravity * G * 200.0]
        assert np.abs(moved).max() < 1e-8


@pytest.mark.long
def test_a_rigid_damper_stops_the_velocity_that_a_step_ends_with():
    """Of a base that spins: the damper's row is that of velocities in axes that stand still."""
    box = cp.model.free_box(size=(0.3, 0.2, 0.1))
    box = box.with_frame("corner", "box", [0.15, 0.1, 0.05])
    box = box.with_frame("anchor", "world", [1.0, 0.2, 0.4])
    damper = cp.model.SpringDamper("corner", "anchor", damping=1e8, stiffness=0.0)
    scene = cp.Scene(replace(box, spring_dampers=[damper]))
    model, dt = scene.robot.model, 1e-2
    q, v = pin.neutral(model), np.array([4.0, 3.0, 0.5, 5.0, -12.0, 9.0])
    run = cp.simulate(scene, q, v, duration=dt, dt=dt, integrator=cp.SemiImplicitEuler())
    y = np.array(pin.difference(model, q, run.q[-1]))
    V = Manifold(model).of_start(y, run.v[-1])
    arm = np.array([0.15, 0.1, 0.05])
    line = np.array([1.0, 0.2, 0.4]) - arm
    rate = (V[:3] + np.cross(V[3:], arm)) @ line / np.linalg.norm(line)
    assert abs(rate) < 1e-4  # 0.3 m/s in axes that turn


# the coordinates of a step --------------------------------------------------------------------


@pytest.mark.long
@given(
    theta=st.tuples(*3 * [st.floats(-3.3, 3.3)]), w=st.tuples(*3 * [st.floats(-5, 5)]),
    x=st.tuples(*3 * [st.floats(-1, 1)]),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_rates_are_those_of_the_place(theta, w, x):
    """y' against differences of the rotation, also beyond half a turn."""
    model = cp.model.free_ball().model
    manifold, q0 = (
        Manifold(model),
        np.concatenate([[0.3, 0.1, -0.2], turned(np.random.default_rng(0))]),
    )
    y, V, h = np.array([*x, *theta]), np.array([0.4, -0.2, 0.7, *w]), 1e-6
    v = manifold.own(y, V)
    rate, _ = manifold.rates(y, V, v, np.zeros(6))
    there, _ = manifold.place(q0, y, V)
    low, high = (manifold.place(q0, y + s * h * rate, V)[0] for s in (-1, 1))
    moved = (pin.difference(model, there, high) - pin.difference(model, there, low)) / (2 * h)
    assert np.abs(moved - v).max() < 1e-7
    a = np.array([0.5, 0.1, -0.3, 1.0, 2.0, 3.0])
    assert np.abs(manifold.of_own(y, v, manifold.carried(y, v, a)) - a).max() < 1e-12


@given(turn=st.floats(-6.2, 6.2), x=st.tuples(*2 * [st.floats(-1, 1)]))
@settings(max_examples=30, deadline=None)
def test_what_leads_from_one_place_to_another_is_found_again(turn, x):
    model, one = pin.Model(), pin.SE3.Identity()
    for name in ("FreeFlyer", "Planar", "Spherical", "RUBY", "RX"):
        joint = model.addJoint(0, getattr(pin, f"JointModel{name}")(), one, name)
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), one)
    manifold, axis = Manifold(model), np.array([0.6, 0.0, 0.8])
    y = np.concatenate([*2 * [[*x, 0.3], turn * axis], [turn, turn]])
    y[6:12] = [*x, turn, *(turn * axis)]
    q0 = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    found = manifold.between(q0, manifold.integrate(q0, y), y + 0.1)
    assert np.abs(found - y).max() < 1e-9
