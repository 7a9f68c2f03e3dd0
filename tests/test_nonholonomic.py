"""Blades, wheels and balls that roll: closed forms, derivatives, and what they leave alone."""

from __future__ import annotations

import copy
import dataclasses
import functools
import pickle
from dataclasses import replace

import hypothesis.strategies as some
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.integrate import quad
from shared import central, each_exact_solver, each_row, relative, robot, takes

import condyn_pin as cp
from condyn_pin import mechanism
from condyn_pin._core._pin import LOCAL, pin
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.derivatives.kkt import Linearisation
from condyn_pin.dynamics.derivatives.others import BLOCKS
from condyn_pin.dynamics.workspace import unsupported_constraints
from condyn_pin.mechanism.classification import _is_involutive, bracket
from condyn_pin.mechanism.closed_chains import chains_of
from condyn_pin.model.mechanisms.machine import add_rod, disc

GRAVITY = 9.81
CLOSE = 1e-12  # closed forms, relative to gravity; measured: 1e-15 to 1e-13
DERIVATIVES = 1e-8  # of central differences; measured: 1e-11
UP = np.array([0.0, 0.0, 1.0])

each_name = pytest.mark.parametrize("name", ["sleigh", "unicycle", "rolling_disc", "rolling_ball"])


def rolling(name: str) -> cp.Scene:
    return cp.Scene(robot(name), robot(name).contacts)


@functools.cache
def cart() -> cp.Scene:
    """Two driven wheels on one axle and a ball in a socket: one of nine rows is redundant."""
    model = pin.Model()
    model.name = "cart"
    here = pin.SE3.Identity()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, pin.Inertia.FromBox(5.0, 0.6, 0.4, 0.1), pin.SE3.Identity())
    for name, y in (("left", 0.25), ("right", -0.25)):
        at = pin.SE3(np.eye(3), np.array([0.2, y, 0.0]))
        joint = model.addJoint(base, pin.JointModelRY(), at, name)
        model.appendBodyToJoint(joint, disc(0.2, 0.8), here)
        model.addFrame(pin.Frame(f"{name}_wheel", joint, 0, here, pin.FrameType.OP_FRAME))
    at = pin.SE3(np.eye(3), np.array([-0.3, 0.0, -0.15]))
    joint = model.addJoint(base, pin.JointModelSpherical(), at, "socket")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(0.3, 0.05), here)
    model.addFrame(pin.Frame("caster", joint, 0, here, pin.FrameType.OP_FRAME))
    standing = pin.neutral(model)
    standing[2] = 0.2
    made = cp.Robot("cart", model, postures={"standing": standing}, actuated=("left", "right"))
    wheels = [
        cp.constraints.RollingWheel(f"{side}_wheel", 0.2, height=0.0) for side in ("left", "right")
    ]
    return cp.Scene(made, [*wheels, cp.constraints.RollingBall("caster", 0.05, height=0.0)])


@functools.cache
def tumbling() -> cp.Scene:
    """A body with two wheels, everything at odd angles, on two planes, with a rod and a blade."""
    pin.seed(3)
    rng = np.random.default_rng(3)
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, pin.Inertia.Random(), pin.SE3.Identity())
    for name in ("one", "two"):
        axis = rng.normal(size=3)
        kind = pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))
        joint = model.addJoint(base, kind, pin.SE3.Random(), f"{name}_joint")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
        frame = pin.Frame(name, joint, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME)
        model.addFrame(frame)
    return cp.Scene(
        cp.Robot("tumbling", model),
        [
            cp.constraints.RollingWheel("one", 0.3, "x", normal=(0.1, 0.2, 1.0), height=0.2),
            cp.Loop("world", "two", "rod", length=1.0),
            cp.constraints.KnifeEdge("two", "z", offset=(0.1, 0.2, 0.3)),
        ],
    )


def at_its_word(make):
    """A scene whose status doubts no velocity that the rows forbid."""
    scene = make()
    return replace(scene, robot=replace(scene.robot, precision=0.0))


SCENES = {
    "sleigh": functools.partial(rolling, "sleigh"),
    "unicycle": functools.partial(rolling, "unicycle"),
    "disc": functools.partial(rolling, "rolling_disc"),
    "ball": functools.partial(rolling, "rolling_ball"),
    "cart": cart,
    "tumbling": tumbling,
}
SCENES = {label: functools.partial(at_its_word, make) for label, make in SCENES.items()}
each_scene = pytest.mark.parametrize("label", SCENES)

# Off the constraints the redundant rows of the cart contradict each other.
INDEPENDENT = [label for label in SCENES if label != "cart"]
each_independent = pytest.mark.parametrize("label", INDEPENDENT)
each_side = pytest.mark.parametrize(
    ("label", "on"),
    [*((label, True) for label in SCENES), *((label, False) for label in INDEPENDENT)],
    ids=lambda value: {True: "on", False: "off"}.get(value, value),
)


def states(scene: cp.Scene, count: int, *, on: bool = True) -> list[tuple[np.ndarray, ...]]:
    """States under torques everywhere; off the constraints where `on` is False."""
    rng, model = np.random.default_rng(5), scene.robot.model
    made = []
    for _ in range(count):
        q, v = scene.sample(rng, spread=0.3, speed=2.0)
        if not on:
            q = np.array(pin.integrate(model, q, 0.1 * rng.normal(size=model.nv)))
            v = v + rng.normal(size=model.nv)
        made.append((q, v, rng.normal(size=model.nv)))
    return made


def solvers_for(scene: cp.Scene) -> list[cp.dynamics.Solver]:
    return [s() for s in cp.dynamics.SOLVERS.values() if s.exact and takes(s(), scene)]


# Closed forms


def test_sleigh_accelerates_as_chaplygin_says():
    arm, mass, inertia = 0.3, 2.0, 0.7
    made = cp.model.sleigh(arm=arm, mass=mass, inertia=inertia)
    scene = cp.Scene(made, made.contacts)
    J = inertia + mass * arm**2
    for q, v, _ in states(scene, 5):
        u, w = v[0], v[2]
        turn = -mass * arm * u * w / J
        for solver in solvers_for(scene):
            found = cp.solve(scene, q, v, np.zeros(3), solver=solver)
            assert relative(found.a, np.array([arm * w**2, 0.0, turn])) < CLOSE
            assert found.forces["blade"][1] == pytest.approx(mass * (u * w + arm * turn), rel=1e-11)


def test_unicycle_obeys_its_motors():
    radius, mass = 0.4, 3.0
    made = cp.model.unicycle(radius=radius, mass=mass)
    scene = cp.Scene(made, made.contacts)
    for q, v, tau in states(scene, 5):
        tau[:2] = 0.0
        heading, roll = v[2:]
        steer, drive = 4 * tau[2] / (mass * radius**2), tau[3] / (1.5 * mass * radius**2)
        along = np.array([np.cos(q[2]), np.sin(q[2])])
        across = np.array([-along[1], along[0]])
        level = radius * drive * along + radius * roll * heading * across
        for solver in solvers_for(scene):
            found = cp.solve(scene, q, v, tau, solver=solver)
            assert relative(found.a, np.array([*level, steer, drive])) < CLOSE
            push = mass * radius * np.array([drive, roll * heading, 0.0])
            assert np.allclose(found.forces["wheel"], push, atol=1e-12)


def steady_disc(
    scene: cp.Scene, lean: float, precession: float, yaw: float, roll: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the state of a coin that turns steadily, and its acceleration by hand."""
    (wheel,) = scene.constraints
    R, m = wheel.radius, scene.robot.mass
    A, C = m * R**2 / 4, m * R**2 / 2
    Q = pin.rpy.rpyToMatrix(0, 0, yaw) @ pin.rpy.rpyToMatrix(lean, 0, 0)
    Q = Q @ pin.rpy.rpyToMatrix(0, roll, 0)
    e = Q[:, 1]
    theta = np.arccos(e @ UP)
    sine, cosine = np.sin(theta), np.cos(theta)
    w3 = (A * precession**2 * sine * cosine - m * GRAVITY * R * cosine) / (
        (C + m * R**2) * precession * sine
    )
    spin = (w3 - precession * cosine) * e
    w = precession * UP + spin
    t = np.cross(e, UP) / sine
    r = R * np.cross(e, t)
    v = -np.cross(w, r)
    q = np.concatenate([-r, pin.Quaternion(Q).coeffs()])
    # everything turns with the precession; components are those of the body
    linear = np.cross(precession * UP, v) - np.cross(w, v)
    angular = np.cross(precession * UP, spin)
    return q, np.concatenate([Q.T @ v, Q.T @ w]), np.concatenate([Q.T @ linear, Q.T @ angular])


@pytest.mark.parametrize("lean", [0.3, -0.7, 1.2])
@pytest.mark.parametrize("precession", [4.0, -20.0])
def test_a_coin_turns_steadily_where_the_relation_holds(lean, precession):
    made = cp.model.rolling_disc(radius=0.2, mass=1.5)
    scene = cp.Scene(made, made.contacts)
    q, v, a = steady_disc(scene, lean, precession, yaw=0.4, roll=0.9)
    assert scene.check(q, v).ok
    for solver in solvers_for(scene):
        found = cp.solve(scene, q, v, np.zeros(6), solver=solver)
        assert relative(found.a, a) < CLOSE
        force = found.forces["rim"]
        assert force[2] == pytest.approx(1.5 * GRAVITY, rel=1e-11)
        assert force[0] == pytest.approx(0.0, abs=1e-11)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.3, -0.5, 1.0)])
def test_a_ball_under_a_torque_and_on_a_slope(normal):
    """On a slope without torque it comes down with 5/7 g sin(s)."""
    radius, mass = 0.3, 2.0
    made = cp.model.rolling_ball(radius=radius, mass=mass)
    scene = cp.Scene(
        made, [cp.constraints.RollingBall("centre", radius, normal=normal, height=0.1)]
    )
    n = np.array(normal) / np.linalg.norm(normal)
    J = 0.4 * mass * radius**2
    weight = mass * np.array([0.0, 0.0, -GRAVITY])
    for q, v, tau in states(scene, 5):
        R = pin.Quaternion(q[3:]).matrix()
        for torque in (np.zeros(3), R @ tau[3:]):
            pushed = np.concatenate([np.zeros(3), R.T @ torque])
            slope = weight - (weight @ n) * n
            p = (radius * np.cross(torque, n) + radius**2 * slope) / (J + mass * radius**2)
            for solver in solvers_for(scene):
                a = cp.solve(scene, q, v, pushed, solver=solver).a
                assert relative(R @ (a[:3] + np.cross(v[3:], v[:3])), p) < CLOSE
                assert n @ R @ a[3:] == pytest.approx(n @ torque / J, abs=1e-9)
            if not torque.any():
                sine = np.linalg.norm(n[:2])
                assert np.linalg.norm(p) == pytest.approx(5 / 7 * GRAVITY * sine, rel=1e-12)


def test_a_spinning_ball_keeps_two_sevenths_of_its_spin_when_it_lands():
    """It drops upright with omega_y: v_x = (2/7) radius omega_y, m v_x = its share of impulse."""
    scene = rolling("rolling_ball")
    q, _ = scene.state()
    found = cp.impact(scene, q, np.array([0.0, 0.0, -1.0, 0.0, 6.0, 0.0]))
    assert found.v[0] == pytest.approx(2 / 7 * 0.1 * 6.0, rel=1e-12)
    assert found.v[4] == pytest.approx(2 / 7 * 6.0, rel=1e-12)
    assert found.energy_lost > 0


# The rows, against kinematics that know nothing of them


@each_scene
def test_rows_are_the_velocity_of_the_point_that_touches(label):
    """Found by Pinocchio at a frame put there, on and off the constraints."""
    scene = SCENES[label]()
    model = scene.robot.model
    for q, v, _ in states(scene, 3, on=False):
        equations = Equations(model, scene.bounds)
        J = equations.jacobian(q)
        data = model.createData()
        pin.forwardKinematics(model, data, q, v)
        for constraint, bound, ends in zip(
            scene.constraints, scene.bounds, equations.placements(q), strict=True
        ):
            if isinstance(constraint, cp.Loop):
                continue
            at = data.oMi[bound.joint1].actInv(ends[0])
            velocity = pin.getFrameVelocity(model, data, bound.joint1, at, LOCAL).linear
            assert np.allclose(J[bound.rows] @ v, velocity[list(bound.selection)], atol=1e-13)


@each_scene
def test_the_lowest_point_is_the_lowest(label):
    scene = SCENES[label]()
    equations = Equations(scene.robot.model, scene.bounds)
    for q, _, _ in states(scene, 3, on=False):
        c = equations.violation(q)
        for constraint, bound, ends in zip(
            scene.constraints, scene.bounds, equations.placements(q), strict=True
        ):
            if not isinstance(constraint, cp.constraints.RollingWheel | cp.constraints.RollingBall):
                continue
            joint, placement = scene.robot.frame(constraint.frame)
            middle = equations.data.oMi[joint] * placement
            n = np.array(constraint.normal)
            around = np.random.default_rng(0).normal(size=(500, 3))
            if isinstance(constraint, cp.constraints.RollingWheel):
                around[:, "xyz".index(constraint.axis)] = 0.0
            around *= constraint.radius / np.linalg.norm(around, axis=1)[:, None]
            lowest = float(n @ ends[0].translation)
            rim = (middle.translation + around @ middle.rotation.T) @ n
            assert lowest <= rim.min() + 1e-12
            assert rim.min() - lowest < 0.01 * constraint.radius
            if constraint.height is not None:
                assert c[bound.positioned[0]] == pytest.approx(lowest - constraint.height)


@each_scene
def test_gamma_is_the_rate_of_the_rows_and_j_that_of_the_gap(label):
    scene = SCENES[label]()
    equations, model, h = Equations(scene.robot.model, scene.bounds), scene.robot.model, 1e-5
    for q, v, _ in states(scene, 3, on=False):
        ahead, behind = (np.array(pin.integrate(model, q, s * h * v)) for s in (1, -1))
        rate = (equations.jacobian(ahead) - equations.jacobian(behind)) @ v / (2 * h)
        assert np.allclose(equations.terms(q, v).gamma, rate, rtol=1e-7, atol=1e-6)
        rows = chains_of(scene).rows
        opened = (equations.violation(ahead) - equations.violation(behind)) / (2 * h)
        assert np.allclose((equations.jacobian(q) @ v)[rows], opened[rows], rtol=1e-8, atol=1e-8)
        others = np.setdiff1d(np.arange(scene.rows), rows)
        assert not equations.violation(q)[others].any()


@settings(max_examples=25)
@given(seed=some.integers(0, 2**32 - 1), axis=some.sampled_from("xyz"))
def test_a_frame_may_sit_anywhere_on_the_wheel(seed, axis):
    """Another frame in the same middle with the axle along another axis changes nothing."""
    rng = np.random.default_rng(seed)
    made = replace(robot("rolling_disc"), precision=0.0)
    turn = np.roll(np.eye(3), "xyz".index(axis) - 1, axis=1)  # its `axis` is y of the disc
    angle = rng.uniform(0, 2 * np.pi)
    R = pin.rpy.rpyToMatrix(0.0, angle, 0.0) @ turn
    normal, height = rng.normal(size=3), rng.normal()
    plain = cp.constraints.RollingWheel("centre", 0.1, normal=normal, height=height)
    moved = cp.constraints.RollingWheel("other", 0.1, axis, normal=normal, height=height)
    q = np.array(pin.integrate(made.model, pin.neutral(made.model), rng.normal(size=6)))
    v, tau = rng.normal(size=(2, 6))
    one = cp.solve(cp.Scene(made, [plain]), q, v, tau, solver=cp.dynamics.Reference())
    other = made.with_frame("other", "centre", np.zeros(3), R)
    two = cp.solve(cp.Scene(other, [moved]), q, v, tau, solver=cp.dynamics.Reference())
    assert relative(two.a, one.a) < 1e-10
    force, same = one.forces["centre"].in_world(), two.forces["other"].in_world()
    assert np.allclose(force, same, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(force).max()))
    assert np.allclose(one.forces["centre"].at, two.forces["other"].at, atol=1e-13)


# Solvers


@pytest.mark.pairs
@each_side
@each_exact_solver
def test_every_solver_agrees_with_reference_or_refuses_by_name(label, on, solver):
    scene = SCENES[label]()
    if unsupported_constraints(scene, solver):
        names = ", ".join(unsupported_constraints(scene, solver))
        with pytest.raises(
            cp.errors.UnsupportedConstraint, match=f"{names} cannot be made of those"
        ):
            cp.Workspace(scene, solver)
        return
    workspace, truth = cp.Workspace(scene, solver), cp.Workspace(scene, cp.dynamics.Reference())
    for state in states(scene, 3, on=on):
        found = workspace.solve(*state, throw=False)
        if not takes(solver, scene):
            assert found.status is cp.Status.SINGULAR
            continue
        assert found.status.ok
        assert relative(found.a, truth.solve(*state).a) < 1e-8


def test_pinocchios_own_methods_refuse_by_name():
    for name in ("sleigh", "unicycle", "rolling_disc", "rolling_ball"):
        scene = rolling(name)
        (constraint,) = scene.names
        for solver in (cp.Proximal(), cp.dynamics.SparseKKT()):
            with pytest.raises(
                cp.errors.UnsupportedConstraint, match=f"{constraint} cannot be made of"
            ):
                cp.Workspace(scene, solver)
        assert isinstance(cp.Workspace(scene).solver, cp.DenseKKT)
        q, v = scene.state()
        with pytest.raises(cp.InvalidArgument, match="it differentiates Proximal"):
            cp.derivatives(scene, q, v, np.zeros(scene.robot.nv), method="pinocchio")
    assert isinstance(cp.Workspace(cart()).solver, cp.dynamics.NullSpace)


@each_scene
def test_the_forces_do_no_work(label):
    scene = SCENES[label]()
    workspace = cp.Workspace(scene, cp.dynamics.Reference())
    for q, v, tau in states(scene, 3):
        found = workspace.solve(q, v, tau)
        for force in found.forces.values():
            pushed = force.generalized()
            assert abs(pushed @ v) < 1e-12 * max(1.0, np.abs(pushed).max() * np.abs(v).max())
        whole = sum(force.generalized() for force in found.forces.values())
        assert np.allclose(whole, workspace.jacobian(q).T @ found.lam, atol=1e-10)


@pytest.mark.long
def test_a_force_knows_where_it_acts():
    scene = rolling("rolling_disc")
    q, v, _ = steady_disc(scene, 0.3, 5.0, 0.2, 0.1)
    found = cp.solve(scene, q, v, np.zeros(6))
    force = found.forces["rim"]
    assert (force.on, force.by, force.frame) == ("centre", "world", "rim/touching")
    assert force.at == pytest.approx(np.zeros(3), abs=1e-12)
    assert force.in_world()[2] == pytest.approx(0.5 * GRAVITY)
    assert force.on_other().on == "world"
    assert np.allclose(force.on_other(), -force)
    # the wrench at the lowest point, by hand
    data = scene.robot.model.createData()
    pin.computeJointJacobians(scene.robot.model, data, q)
    there = pin.SE3(data.oMi[1].rotation, data.oMi[1].translation)
    J = pin.getFrameJacobian(
        scene.robot.model, data, 1, there.actInv(pin.SE3(np.eye(3), force.at)), LOCAL
    )
    assert np.allclose(J[:3].T @ force.in_world(), force.generalized(), atol=1e-12)
    assert found.notices == ()
    pulled = cp.solve(scene, q, v, np.concatenate([[0.0, 0.0, 50.0], np.zeros(3)]))
    assert any("rim: the contact pulls" in notice for notice in pulled.notices)


@each_independent
@pytest.mark.parametrize(("alpha", "beta"), [(3.0, 5.0), (0.0, 4.0)])
def test_baumgarte_damps_the_slip_and_pulls_back_heights_only(label, alpha, beta):
    scene = SCENES[label]()
    drift = cp.Baumgarte(alpha, beta)
    for q, v, tau in states(scene, 2, on=False):
        workspace = cp.Workspace(scene, cp.dynamics.Reference(), drift=drift)
        terms, found = workspace.terms(q, v), workspace.solve(q, v, tau)
        c = workspace.violation(q)
        velocity_rows = np.setdiff1d(np.arange(scene.rows), chains_of(scene).rows)
        assert not c[velocity_rows].any()
        wanted = -2 * alpha * terms.J @ v - beta**2 * c
        assert np.allclose(terms.J @ found.a + terms.gamma, wanted, atol=1e-9)


# Derivatives


@each_side
@pytest.mark.parametrize("drift", [None, cp.Baumgarte(3.0, 5.0)], ids=["plain", "baumgarte"])
def test_derivatives_are_those_of_differences(label, on, drift):
    scene = SCENES[label]()
    workspace = cp.Workspace(scene, cp.dynamics.Reference(), drift=drift)
    for q, v, tau in states(scene, 2, on=on):
        found = workspace.derivatives(q, v, tau)
        truth = workspace.derivatives(q, v, tau, method="differences")
        for block in BLOCKS:
            had, wanted = getattr(found, block), getattr(truth, block)
            if block.endswith("_dq"):
                had = had @ truth.along.T @ truth.along
            size = max(1.0, float(np.abs(wanted).max()))
            assert np.abs(had - wanted).max() < DERIVATIVES * size, block


@pytest.mark.parametrize("label", ["disc", "ball", "tumbling"])
@pytest.mark.parametrize("drift", [None, cp.Baumgarte(3.0, 5.0)], ids=["plain", "baumgarte"])
def test_derivatives_by_where_the_wheel_is_on_its_body(label, drift):
    scene = SCENES[label]()
    (q, v, tau), *_ = states(scene, 1, on=False)
    name = scene.names[0]
    frame = scene.constraints[0].frame
    found = cp.Workspace(scene, cp.dynamics.Reference(), drift=drift).derivatives(q, v, tau)
    assert isinstance(found.da_dq, np.ndarray)
    joint, placement = scene.robot.frame(frame)

    def answer(twist: np.ndarray) -> np.ndarray:
        model = pin.Model(scene.robot.model)
        there = placement * pin.exp6(twist)
        model.addFrame(pin.Frame("moved", joint, 0, there, pin.FrameType.OP_FRAME))
        moved = cp.Robot("moved", model, precision=0.0)
        constraints = [
            dataclasses.replace(c, frame="moved") if c.name == name else c
            for c in scene.constraints
        ]
        workspace = cp.Workspace(cp.Scene(moved, constraints), cp.dynamics.Reference(), drift=drift)
        solution = workspace.solve(q, v, tau)
        return np.concatenate([solution.a, solution.lam])

    wanted = np.column_stack([central(lambda t, e=e: answer(t * e)) for e in np.eye(6)])
    had = np.vstack(found.by_placement(name))
    assert np.abs(had - wanted).max() < DERIVATIVES * max(1.0, float(np.abs(wanted).max()))
    with pytest.raises(cp.InvalidArgument, match="rolls on a plane of the world"):
        found.by_placement(name, "second")


@pytest.mark.parametrize("label", ["disc", "ball", "cart"])
def test_impacts_have_derivatives_too(label):
    scene, h = SCENES[label](), 1e-6
    (q, v, _), *_ = states(scene, 1)
    nv, rng = scene.robot.nv, np.random.default_rng(2)
    v = v + rng.normal(size=nv)
    found = cp.impact(scene, q, v)
    step = np.array(
        mechanism.project_velocity(cp.Scene(scene.robot, scene.constraints), q, np.ones(nv))
    )
    sides = [
        cp.impact(scene, np.array(pin.integrate(scene.robot.model, q, s * h * step)), v).v
        for s in (1, -1)
    ]
    assert np.allclose(found.dv_dq @ step, (sides[0] - sides[1]) / (2 * h), rtol=1e-6, atol=1e-6)


# Motions


def test_the_sleigh_glides_as_chaplygin_says():
    """u = U tanh(k t), omega = W / cosh(k t); where it is, by quadrature. No energy is lost."""
    arm, mass, inertia, W, T = 0.3, 2.0, 0.5, 2.0, 2.0
    made = cp.model.sleigh(arm=arm, mass=mass, inertia=inertia)
    J = inertia + mass * arm**2
    U = W * np.sqrt(J / mass)
    k = mass * arm * U / J
    ran = cp.simulate(cp.Scene(made, made.contacts), [0, 0, 1, 0], [0, 0, W], duration=T, dt=1e-2)
    assert ran.status.ok
    assert np.abs(ran.v[:, 0] - U * np.tanh(k * ran.t)).max() < 1e-9
    assert np.abs(ran.v[:, 2] - W / np.cosh(k * ran.t)).max() < 1e-9
    assert ran.constraint_velocity.max() < 1e-12
    assert np.ptp(ran.energy.total) < 1e-9

    def heading(t: float) -> float:
        return float(W / k * 2 * np.arctan(np.tanh(k * t / 2)))

    for i, of in enumerate((np.cos, np.sin)):
        there = quad(lambda t, of=of: U * np.tanh(k * t) * of(heading(t)), 0, T, epsabs=1e-12)[0]
        assert ran.q[-1, i] == pytest.approx(there, abs=1e-9)


def test_a_coin_runs_its_circle():
    """The middle and the axle turn about the vertical through the centre of the circle."""
    made = cp.model.rolling_disc(radius=0.2, mass=1.5)
    scene, precession, T = cp.Scene(made, made.contacts), 3.0, 1.0
    q, v, _ = steady_disc(scene, 0.3, precession, yaw=0.2, roll=0.0)
    ran = cp.simulate(scene, q, v, duration=T, dt=5e-3)
    assert ran.status.ok
    Q, turn = pin.Quaternion(q[3:]).matrix(), pin.rpy.rpyToMatrix(0.0, 0.0, precession * T)
    from_centre = -np.cross(UP, Q @ v[:3]) / precession
    assert np.allclose(ran.q[-1, :3], q[:3] + (turn - np.eye(3)) @ from_centre, atol=1e-7)
    assert np.allclose(pin.Quaternion(ran.q[-1, 3:]).matrix()[:, 1], turn @ Q[:, 1], atol=1e-6)
    assert ran.violation.max() < 1e-8
    assert ran.constraint_velocity.max() < 1e-6
    assert np.ptp(ran.energy.total) < 1e-7 * abs(ran.energy.total[0])
    assert np.allclose(ran.forces["rim"][:, 2], 1.5 * GRAVITY, rtol=1e-6)


@pytest.mark.parametrize(("share", "falls"), [(0.9, True), (1.1, False)])
def test_a_coin_stays_upright_above_its_critical_speed(share, falls):
    """w3^2 > g / (3 radius), from a lean of 1e-4."""
    scene, lean = rolling("rolling_disc"), 1e-4
    spin = share * np.sqrt(GRAVITY / (3 * 0.1))
    q = np.array([0.0, 0.0, 0.1 * np.cos(lean), np.sin(lean / 2), 0.0, 0.0, np.cos(lean / 2)])
    v = mechanism.project_velocity(scene, q, [0.1 * spin, 0.0, 0.0, 0.0, spin, 0.0])
    ran = cp.simulate(scene, q, v, duration=1.5, dt=1e-2)
    leans = [abs(pin.Quaternion(each[3:]).matrix()[2, 1]) for each in ran.q]
    assert (max(leans) > 0.02) == falls
    assert (max(leans) > 20 * lean) == falls


def test_a_wheel_is_held_at_the_height_where_a_run_begins():
    """Without a height a simulation takes the one at the start; a blade has none to take."""
    made = robot("rolling_disc")
    scene = cp.Scene(made, [cp.constraints.RollingWheel("centre", 0.1)])
    q, v, _ = steady_disc(rolling("rolling_disc"), 0.3, 5.0, yaw=0.0, roll=0.0)
    q[2] += 1.25
    ran = cp.simulate(scene, q, v, duration=0.2, dt=1e-2)
    assert ran.scene.constraints[0].height == pytest.approx(1.25)
    assert ran.violation.max() < 1e-6
    sleigh = rolling("sleigh")
    ran = cp.simulate(sleigh, *sleigh.state(), duration=0.1, dt=1e-2)
    assert ran.scene.constraints == sleigh.constraints


# States


@each_name
def test_assembly_closes_heights_and_leaves_the_rest(name):
    scene = rolling(name)
    model, rng = scene.robot.model, np.random.default_rng(1)
    for _ in range(5):
        q0 = np.array(
            pin.integrate(model, cp.dynamics.described_posture(scene), rng.normal(size=model.nv))
        )
        q = scene.assemble(q0).q
        assert scene.check(q).closed
        if name in ("sleigh", "unicycle"):
            assert np.array_equal(q, q0)
        else:  # the shortest way is up or down, or over
            assert np.abs(q[:2] - q0[:2]).max() < 1.0
            assert np.abs(q[2] - q0[2]) > 1e-3
        v = mechanism.project_velocity(scene, q, rng.normal(size=model.nv))
        assert scene.check(q, v).ok
        assert np.linalg.norm(v) > 0.01
        slipping = v + cp.Workspace(scene).jacobian(q)[0]
        assert not scene.check(q, slipping).consistent
        state_error = cp.solve(scene, q, slipping, np.zeros(model.nv), throw=False).state_error
        assert state_error.position < 1e-10
        assert state_error.velocity > 0.5


@pytest.mark.long
def test_mobility_counts_directions_of_motion():
    for name, rows, mobility in (
        ("sleigh", 1, 2), ("unicycle", 2, 2), ("rolling_disc", 3, 3), ("rolling_ball", 3, 3),
    ):  # fmt: skip
        found = rolling(name).rank()
        assert (found.rows, found.rank, found.mobility) == (rows, rows, mobility)
        assert found.licq
        assert not found.singular
    redundant = cart().rank()
    assert (redundant.rows, redundant.rank, redundant.mobility) == (9, 8, 3)
    assert redundant.redundant == ("right_wheel.lateral",)


def test_the_summary_lists_them_and_says_what_they_are():
    text = str(rolling("unicycle").summary())
    assert "wheel: RollingWheel (rolling, lateral), 2 rows" in text
    assert "wheel: rows on the velocity; mobility counts directions of motion" in text
    assert "blade: KnifeEdge, 1 row" in str(rolling("sleigh").summary())
    assert rolling("unicycle").row_names == ("wheel.rolling", "wheel.lateral")
    assert rolling("rolling_disc").row_names == ("rim.rolling", "rim.lateral", "rim.normal")
    assert "on the velocity" not in str(
        cp.Scene(robot("four_bar"), robot("four_bar").loops).summary()
    )


@pytest.mark.long
def test_a_wheel_without_a_height_stands_where_it_is():
    disc = replace(robot("rolling_disc"), precision=0.0)
    scene = cp.Scene(disc, [cp.constraints.RollingWheel("centre", 0.1)])
    q = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.4])
    q[3:] /= np.linalg.norm(q[3:])
    assert np.array_equal(scene.assemble(q).q, q)
    assert scene.check(q).violation == {}
    low = cp.Scene(disc, [cp.constraints.RollingWheel("centre", 0.1, height=2.0)])
    v = np.arange(6.0)
    one, two = (cp.solve(s, q, v, np.zeros(6)) for s in (scene, low))
    assert np.array_equal(one.a, two.a)
    assert low.check(q).violation["centre"].length > 0.5


def test_a_wheel_that_lies_flat_is_singular_and_said_to_be():
    scene = rolling("rolling_disc")
    flat = np.array([0.0, 0.0, 0.0, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    found = scene.rank(flat)
    assert found.singular
    assert (found.rank, found.generic_rank) == (1, 3)
    assert set(found.only_here) == {"rim.rolling", "rim.lateral"}
    v = np.array([1.0, 0.5, 0.0, 0.3, 0.2, 0.1])
    plain = cp.solve(scene, flat, v, np.zeros(6), solver=cp.DenseKKT(), throw=False)
    assert plain.status is cp.Status.SINGULAR
    reference = cp.solve(scene, flat, v, np.zeros(6), solver=cp.dynamics.Reference(), throw=False)
    assert np.isfinite(reference.a).all()


# Frobenius


def test_a_unicycle_is_not_integrable_and_a_pendulum_is():
    for label in ("sleigh", "unicycle", "disc", "ball", "cart", "tumbling"):
        assert not mechanism.is_integrable(SCENES[label]()), label
    pendulum = robot("pendulum")
    assert mechanism.is_integrable(cp.Scene(pendulum))
    floating = robot("rolling_ball").with_frame("hook", "centre", (0.0, 0.0, 0.5))
    for loop in (
        cp.Loop("world", "hook"),
        cp.Loop("hook", "world", "rod", length=0.7),
        cp.Loop("hook", "world", "hinge", axis="x"),
        cp.Loop("hook", "world", "slider", axis="y"),
        cp.Loop("hook", "world", "planar", axis="y"),
        cp.PointContact("hook"),
        cp.constraints.LineContact("hook"),
        cp.SurfaceContact("hook"),
        cp.constraints.PlanarContact("hook", normal=(1.0, 2.0, 3.0)),
    ):
        assert mechanism.is_integrable(cp.Scene(floating, [loop])), loop


@pytest.mark.parametrize("name", ["cassie", "stewart", "bricard", "andrews", "four_bar", "talos"])
def test_loops_and_contacts_are_integrable(name):
    made = robot(name)
    scene = cp.Scene(made, (*made.loops, *made.contacts))
    rng = np.random.default_rng(3)
    assert mechanism.is_integrable(scene)
    assert mechanism.is_integrable(scene, scene.sample(rng)[0])


@pytest.mark.long
def test_a_height_alone_is_integrable_and_so_is_a_wheel_that_cannot_steer():
    disc_ = robot("rolling_disc")
    assert mechanism.is_integrable(
        cp.Scene(disc_, [cp.constraints.RollingWheel("centre", 0.1, holds=["normal"])])
    )
    on_rails = [cp.constraints.RollingWheel("wheel", 0.3, holds=("rolling", "lateral"))]
    lock = cp.constraints.Coupling("heading", "roll", 1e-3)  # it steers, if only a little
    unicycle = robot("unicycle")
    assert not mechanism.is_integrable(cp.Scene(unicycle, on_rails))
    # one direction of motion is left: lines of a single field are always integrable
    assert mechanism.is_integrable(cp.Scene(unicycle, [*on_rails, lock]))


@pytest.mark.long
def test_an_open_loop_is_not_judged():
    bar = robot("four_bar")
    scene = cp.Scene(bar, bar.loops)
    with pytest.raises(cp.errors.NotAssembled, match="coupler_rocker is open"):
        mechanism.is_integrable(scene, [0.1, 0.2, 0.3])
    with pytest.raises(cp.InvalidArgument, match="q has"):
        mechanism.is_integrable(scene, [0.1])


@pytest.mark.long
def test_a_bracket_that_vanishes_by_accident_does_not_decide():
    """A blade on the rocker of a four-bar that travels: where it turns back, it cannot steer."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    base = model.addJoint(base, pin.JointModelPZ(), pin.SE3.Identity(), "z")
    crank = add_rod(model, "crank", base, 0.0, 0.3, 1.0)
    add_rod(model, "coupler", crank, 0.3, 0.8, 1.0)
    add_rod(model, "rocker", base, 0.7, 0.6, 1.0)
    blade = cp.constraints.KnifeEdge("rocker_tip", "z", offset=(-0.6, 0.0, 0.0))  # at its pivot
    loop = cp.Loop("coupler_tip", "rocker_tip")
    scene = cp.Scene(cp.Robot("skater", model), [loop, blade])
    # crank and coupler in line: a triangle of 1.1, 0.7 and 0.6
    first = np.arccos((1.1**2 + 0.7**2 - 0.6**2) / (2 * 1.1 * 0.7))
    tip = 1.1 * np.array([np.cos(first), np.sin(first)])
    q = np.array([0.2, -0.1, first, 0.0, np.arctan2(tip[1], tip[0] - 0.7)])
    assert scene.check(q).closed
    linearisation = Linearisation(model, scene.bounds)
    assert _is_involutive(model, scene.rows, linearisation, q)
    assert not mechanism.is_integrable(scene, q)
    assert mechanism.is_integrable(cp.Scene(scene.robot, [loop]), q)


@pytest.mark.parametrize(
    "joint",
    ["FreeFlyer", "Spherical", "Planar", "Translation", "SphericalZYX", "Unbounded", "Composite"],
)
def test_brackets_are_those_of_moving_back_and_forth(joint):
    """exp(hx) exp(hy) exp(-hx) exp(-hy) = exp(h^2 [x, y] + O(h^3))."""
    model = pin.Model()
    if joint == "Composite":
        kind = pin.JointModelComposite(3)
        for part in (pin.JointModelRX(), pin.JointModelSpherical(), pin.JointModelPlanar()):
            kind.addJoint(part)
    elif joint == "Unbounded":
        kind = pin.JointModelRUBX()
    else:
        kind = getattr(pin, f"JointModel{joint}")()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "first")
    model.addJoint(1, kind, pin.SE3.Identity(), "second")
    rng, h = np.random.default_rng(4), 1e-3
    x, y = rng.normal(size=(2, model.nv))
    ends = []
    for step in (h, -h):
        q = start = pin.neutral(model)
        for part in (x, y, -x, -y):
            q = pin.integrate(model, q, step * part)
        ends.append(np.array(pin.difference(model, start, q)))
    assert np.allclose(bracket(model, x, y), sum(ends) / (2 * h**2), atol=1e-5)
    assert np.allclose(bracket(model, x, y), -bracket(model, y, x))


# What is refused


@each_row(
    ("make", "said"),
    [
        (lambda: cp.constraints.KnifeEdge("blade", "w"), "axis = 'w'"),
        (lambda: cp.constraints.KnifeEdge(""), "the name of a frame"),
        (lambda: cp.constraints.KnifeEdge("blade", offset=(0, 0)), "offset = "),
        (lambda: cp.constraints.RollingWheel("centre", None), "radius = None"),
        (lambda: cp.constraints.RollingWheel("centre", 0.0), "radius = 0.0"),
        (lambda: cp.constraints.RollingWheel("centre", np.nan), "radius = nan"),
        (lambda: cp.constraints.RollingWheel("centre", True), "radius = True"),
        (lambda: cp.constraints.RollingWheel("centre", "big"), "radius = 'big'"),
        (lambda: cp.constraints.RollingWheel("centre", 0.1, 1), "axis = 1"),
        (lambda: cp.constraints.RollingWheel("centre", 0.1, holds=()), "holds = "),
        (lambda: cp.constraints.RollingWheel("centre", 0.1, holds="normal"), "holds = 'normal'"),
        (
            lambda: cp.constraints.RollingWheel("centre", 0.1, holds=("normal", "normal")),
            "each once",
        ),
        (
            lambda: cp.constraints.RollingWheel("centre", 0.1, holds=("sideways",)),
            "rolling, lateral, normal",
        ),
        (lambda: cp.constraints.RollingWheel("centre", 0.1, holds=None), "holds = None"),
        (
            lambda: cp.constraints.RollingWheel("centre", 0.1, normal=(0, 0, 0)),
            "a direction is needed",
        ),
        (lambda: cp.constraints.RollingWheel("centre", 0.1, height=np.inf), "height = "),
        (lambda: cp.constraints.RollingBall("centre", -0.1), "radius = -0.1"),
        (lambda: cp.constraints.RollingBall("centre", 0.1, normal="up"), "normal = 'up'"),
        (lambda: cp.constraints.RollingBall(3, 0.1), "the name of a frame"),
    ],
)
def test_nonsense_is_refused_by_name(make, said):
    with pytest.raises(cp.InvalidArgument) as error:
        make()
    assert said in str(error.value)


@pytest.mark.long
def test_what_does_not_fit_the_robot_is_refused_by_name():
    sleigh = robot("sleigh")
    with pytest.raises(cp.errors.UnknownName, match=r"no frame named 'blades'.*'blade'"):
        cp.Scene(sleigh, [cp.constraints.KnifeEdge("blades")])
    for constraint in (
        cp.constraints.KnifeEdge("world"),
        cp.constraints.RollingWheel("world", 0.1),
        cp.constraints.RollingBall("world", 1),
    ):
        with pytest.raises(cp.errors.InvalidConstraint, match="both sides belong to the world"):
            cp.Scene(sleigh, [constraint])


@pytest.mark.long
def test_they_are_values():
    wheel = cp.constraints.RollingWheel(
        "w", 0.1, holds=["normal", "rolling"], normal=(0, 0, 3), height=1
    )
    assert wheel.holds == ("rolling", "normal")
    assert (wheel.normal, wheel.height, wheel.name, wheel.rows) == ((0.0, 0.0, 1.0), 1.0, "w", 2)
    for value in (
        wheel,
        cp.constraints.RollingBall("b", 2, name="ball"),
        cp.constraints.KnifeEdge("k", "x", (1, 2, 3)),
    ):
        assert pickle.loads(pickle.dumps(value)) == value
        assert hash(value) == hash(copy.deepcopy(value))
    scene = cart()
    again = pickle.loads(pickle.dumps(scene))
    assert again == scene
    (q, v, tau), *_ = states(scene, 1)
    assert np.array_equal(cp.solve(again, q, v, tau).a, cp.solve(scene, q, v, tau).a)


@pytest.mark.long
def test_motors_find_their_torques_through_the_wheels():
    scene = cart()
    (q, v, _), *_ = states(scene, 1)
    tau = np.zeros(scene.robot.nv)
    tau[6:8] = 0.4, -0.3
    a = cp.solve(scene, q, v, tau, solver=cp.dynamics.Reference()).a
    found = cp.inverse_dynamics(scene, q, v, a)
    assert np.allclose(found.tau, tau, atol=1e-10)


@pytest.mark.long
def test_a_coin_that_lies_flat_is_sent_to_a_solver_that_takes_it():
    coin = cp.model.rolling_disc(radius=0.1)
    scene = cp.Scene(coin, [cp.constraints.RollingWheel("centre", 0.1)])
    flat = [0.0, 0.0, 0.0, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    with pytest.raises(cp.SolveFailed, match=r"NullSpace\(\)"):
        cp.solve(scene, flat, np.zeros(6), np.zeros(6))
    assert cp.solve(scene, flat, np.zeros(6), np.zeros(6), solver=cp.dynamics.NullSpace()).status.ok


@pytest.mark.parametrize("lean", [1e-3, 1e-6, 1e-9])
def test_bounds_know_that_rounding_turns_a_wheel_that_lies_nearly_flat(lean):
    """Its direction is e x n over its length: eps / lean off, and residuals have the same one."""
    disc = cp.model.rolling_disc(radius=0.1)
    scene = cp.Scene(disc, [cp.constraints.RollingWheel("centre", 0.1)])
    angle = np.pi / 4 - lean / 2
    q = np.array([0.0, 0.0, 0.1 * lean, np.sin(angle), 0.0, 0.0, np.cos(angle)])
    solver = cp.dynamics.NullSpace()
    solution = cp.solve(scene, q, np.zeros(6), np.ones(6), solver=solver, throw=False)
    assert solution.error_bound > 1e-16 / lean
    assert solution.status.ok == (lean > 1e-7)


@pytest.mark.long
def test_integrability_is_one_of_scenes():
    with pytest.raises(cp.InvalidArgument, match="scene = NoneType: a Scene is needed"):
        mechanism.is_integrable(None)


@pytest.mark.long
def test_a_car_may_have_no_trailer_but_not_less():
    assert cp.model.car(trailers=0).nv == cp.model.car().nv
    with pytest.raises(cp.InvalidArgument, match="trailers = -1: a whole number of at least 0"):
        cp.model.car(trailers=-1)
