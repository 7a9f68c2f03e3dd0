"""Forces from outside: what they do, how that changes with the state, and that the proof has them.

M a + h = tau + J^T lam + sum_f J_f^T f
"""

from __future__ import annotations

import functools
import pickle
from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from shared import BLOCKS, SOLVERS, all_scenes, central, each_row, robot, states

import condyn_pin as cp
from condyn_pin.constraints.forces import Loads
from condyn_pin.dynamics import DenseKKT

FORCE, WRENCH = (11.0, -23.0, 37.0), (11.0, -23.0, 37.0, 3.0, -5.0, 7.0)


def joints() -> dict[str, pin.JointModel]:
    """Every kind of joint that a force may have to go through."""
    slanted = np.array([1.0, 2.0, 2.0]) / 3
    across = np.array([0.0, 1.0, -1.0]) / 2**0.5
    helical = pin.JointModelHelicalUnaligned(slanted, 0.2)
    inner, outer = pin.JointModelComposite(), pin.JointModelComposite()
    shifted = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array([0.2, 0.1, -0.3]))
    inner.addJoint(pin.JointModelRX(), pin.SE3.Identity())
    inner.addJoint(pin.JointModelPY(), shifted)
    outer.addJoint(pin.JointModelRZ(), shifted)
    outer.addJoint(inner, shifted)
    outer.addJoint(pin.JointModelUniversal(slanted, across), shifted)
    found = {
        "revolute": pin.JointModelRevoluteUnaligned(slanted),
        "prismatic": pin.JointModelPrismaticUnaligned(slanted),
        "unbounded": pin.JointModelRUBY(),
        "helical": helical,
        "universal": pin.JointModelUniversal(slanted, across),
        "zyx": pin.JointModelSphericalZYX(),
        "spherical": pin.JointModelSpherical(),
        "planar": pin.JointModelPlanar(),
        "translation": pin.JointModelTranslation(),
        "free_flyer": pin.JointModelFreeFlyer(),
        "composite": outer,
    }
    if hasattr(pin, "JointModelEllipsoid"):
        found["ellipsoid"] = pin.JointModelEllipsoid(0.3, 0.4, 0.5)
    return found


@functools.cache
def chain_on(kind: str) -> cp.Robot:
    """A chain: a hinge, the joint, another of its kind, a hinge; and a branch beside it."""
    model, rng = pin.Model(), np.random.default_rng(3)
    parent = 0
    for i, joint in enumerate((pin.JointModelRY(), joints()[kind], joints()[kind], None)):
        placed = pin.SE3(pin.rpy.rpyToMatrix(*rng.uniform(-1, 1, 3)), rng.uniform(-0.4, 0.4, 3))
        parent = model.addJoint(parent, joint or pin.JointModelRX(), placed, f"j{i}")
        box = pin.SE3(pin.rpy.rpyToMatrix(*rng.uniform(-1, 1, 3)), rng.uniform(-0.1, 0.1, 3))
        model.appendBodyToJoint(parent, pin.Inertia.FromBox(2.0, 0.3, 0.4, 0.2), box)
    tip = pin.SE3(pin.rpy.rpyToMatrix(*rng.uniform(-1, 1, 3)), rng.uniform(-0.3, 0.3, 3))
    model.addFrame(pin.Frame("tip", parent, 0, tip, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("middle", 2, 0, tip, pin.FrameType.OP_FRAME))
    branch = model.addJoint(1, pin.JointModelRZ(), tip, "branch")
    model.appendBodyToJoint(branch, pin.Inertia.FromBox(1.0, 0.3, 0.4, 0.2), tip)
    model.addFrame(pin.Frame("side", branch, 0, tip, pin.FrameType.OP_FRAME))
    return cp.Robot(f"chain_on_{kind}", model)


def state_of(made: cp.Robot, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = np.array(pin.integrate(made.model, pin.neutral(made.model), rng.uniform(-1, 1, made.nv)))
    return q, rng.uniform(-1, 1, made.nv), rng.uniform(-5, 5, made.nv)


PUSHED = (
    cp.AppliedForce("tip", WRENCH),
    cp.AppliedForce("tip", WRENCH[::-1], "body"),
    cp.AppliedForce("middle", FORCE),
    cp.AppliedForce("middle", FORCE[::-1], "body"),
    cp.AppliedForce("side", WRENCH, "body"),
)


def torque_of(made: cp.Robot, q: np.ndarray, forces: tuple[cp.AppliedForce, ...]) -> np.ndarray:
    """sum J_f^T f from the work of a small step of each coordinate: no Jacobian, no Newton-Euler.

    By central differences of the frame's placement, of order eight.
    """
    data, stencil, h = made.model.createData(), (4 / 5, -1 / 5, 4 / 105, -1 / 280), 0.02
    torque = np.zeros(made.nv)

    def placed(force: cp.AppliedForce, q: np.ndarray) -> pin.SE3:
        pin.forwardKinematics(made.model, data, q)
        joint, placement = made.frame(force.frame)
        return data.oMi[joint] * placement

    for force in forces:
        here = placed(force, q)
        R = np.eye(3) if force.frame_of == "world" else here.rotation
        F, T = (R @ part for part in np.resize([*force.force, 0.0, 0.0, 0.0], 6).reshape(2, 3))
        for i in range(made.nv):
            for k, weight in enumerate(stencil, 1):
                for sign in (1, -1):
                    step = sign * k * h * np.eye(made.nv)[i]
                    there = placed(force, np.array(pin.integrate(made.model, q, step)))
                    turn = pin.log3(there.rotation @ here.rotation.T)
                    work = F @ (there.translation - here.translation) + T @ turn
                    torque[i] += sign * weight / h * work
    return torque


@pytest.mark.parametrize("kind", list(joints()))
def test_a_force_does_the_work_of_its_frame(kind):
    made = chain_on(kind)
    q, v, tau = state_of(made)
    pushed = cp.solve(cp.Scene(made), q, v, tau, forces=PUSHED)
    same = cp.solve(cp.Scene(made), q, v, tau + torque_of(made, q, PUSHED))
    assert np.abs(pushed.a - same.a).max() <= 1e-9 * np.abs(same.a).max()
    assert pushed.applied == PUSHED


@pytest.mark.values
@pytest.mark.parametrize("axes", ["world", "body"])
@pytest.mark.parametrize("kind", list(joints()))
def test_torques_change_with_q_as_differences_say(kind, axes):
    """The partial of sum J_f^T f alone, of joints whose axes turn with their own q too."""
    from condyn_pin.dynamics.derivatives.solution_derivatives import load_partial

    made = chain_on(kind)
    q, _, _ = state_of(made, 1)
    forces = [each for each in PUSHED if each.frame_of == axes]
    loads = Loads(made, made.model, made.model.createData())
    found = load_partial(loads, q, forces)

    def torque(step: np.ndarray) -> np.ndarray:
        return loads.at(np.array(pin.integrate(made.model, q, step)), forces).torque

    wanted = [central(lambda t, e=e: torque(t * e)) for e in np.eye(made.nv)]
    wanted = np.column_stack(wanted)
    assert np.abs(found - wanted).max() <= 1e-8 * max(np.abs(wanted).max(), 1.0)


CLOSED = [
    "talos hands hinged",
    "talos hands on a rod",
    "talos foot held twice",
    "talos on edges and planes",
    "cassie on lines",
]


def pushes(made: cp.Robot) -> tuple[cp.AppliedForce, ...]:
    talos = made.name == "talos"
    hand, foot = (
        ("gripper_left_base_link", "left_sole_link") if talos else ("left-foot", "right-tarsus")
    )
    return cp.AppliedForce(hand, WRENCH), cp.AppliedForce(foot, FORCE, "body")


@pytest.mark.parametrize("label", CLOSED)
def test_derivatives_agree_with_differences(label):
    scene = all_scenes()[label]
    for q, v, tau in states(label, 2):
        found = cp.derivatives(scene, q, v, tau, forces=pushes(scene.robot), check=True)
        plain = cp.derivatives(scene, q, v, tau)
        assert np.abs(found.da_dq - plain.da_dq).max() > 1e-3


def test_derivatives_of_pinocchio_agree():
    scene = cp.Scene(robot("talos"), robot("talos").contacts)
    rng = np.random.default_rng(5)
    for _ in range(2):
        q, v = scene.sample(rng)
        tau = rng.uniform(-10, 10, scene.robot.nv)
        one, two = (
            cp.derivatives(scene, q, v, tau, forces=pushes(scene.robot), method=method)
            for method in ("kkt", "pinocchio")
        )
        for block in BLOCKS:
            ours, theirs = getattr(one, block), getattr(two, block)
            assert np.abs(ours - theirs).max() <= 1e-8 * max(np.abs(ours).max(), 1.0)


@pytest.mark.parametrize("label", CLOSED)
def test_weights_as_forces_are_gravity(label):
    """A robot without gravity whose links hang on forces m g: the same a, lam and derivatives."""
    scene = all_scenes()[label]
    made, g = scene.robot, np.array(scene.robot.model.gravity.linear)
    floating = pin.Model(made.model)
    floating.gravity = pin.Motion.Zero()
    forces = []
    for i, inertia in enumerate(made.model.inertias):
        if i and inertia.mass:
            at = pin.SE3(np.eye(3), inertia.lever)
            floating.addFrame(pin.Frame(f"centre {i}", i, 0, at, pin.FrameType.OP_FRAME))
            forces.append(cp.AppliedForce(f"centre {i}", inertia.mass * g))
    light = cp.Scene(cp.Robot(made.name, floating, made.postures), scene.constraints)
    for q, v, tau in states(label, 2):
        heavy = cp.derivatives(scene, q, v, tau)
        pulled = cp.derivatives(light, q, v, tau, forces=forces)
        assert pulled.solution.status.ok
        for one, two in ((heavy.solution.a, pulled.solution.a), (heavy.da_dq, pulled.da_dq)):
            assert np.abs(one - two).max() <= 1e-9 * max(np.abs(one).max(), 1.0)


@pytest.mark.parametrize("name", [name for name, each in SOLVERS.items() if each.exact])
def test_every_solver_takes_forces(name):
    solver = SOLVERS[name]()
    scene = cp.Scene(robot("talos"), robot("talos").contacts)
    q, v = scene.sample(np.random.default_rng(1))
    tau, forces = np.zeros(scene.robot.nv), pushes(scene.robot)
    found = cp.solve(scene, q, v, tau, solver=solver, forces=forces)
    truth = cp.solve(
        scene, q, v, tau + torque_of(scene.robot, q, forces), solver=cp.dynamics.Reference()
    )
    assert np.abs(found.a - truth.a).max() <= 1e-8 * max(np.abs(truth.a).max(), 9.81)
    workspace = cp.Workspace(scene, solver)
    assert np.array_equal(workspace.acceleration(q, v, tau, forces=forces), found.a)
    assert np.array_equal(workspace.lam(), found.lam)


@pytest.mark.parametrize("axes", ["world", "body"])
def test_the_proof_takes_forces_another_way(axes, monkeypatch):
    """A wrong J_f^T f is no answer that is called ok: the proof sees the wrench on the body."""
    scene = cp.Scene(robot("talos"), robot("talos").contacts)
    q, v = scene.sample(np.random.default_rng(1))
    forces = [cp.AppliedForce("gripper_left_base_link", FORCE, axes)]
    at = Loads.at

    def wrong(self, q, forces):
        load = at(self, q, forces)
        return load._replace(torque=load.torque * (1 + 1e-6))

    workspace = cp.Workspace(scene)
    tau = np.zeros(scene.robot.nv)
    assert workspace.solve(q, v, tau, forces=forces).dynamics_error < 1e-9
    monkeypatch.setattr(Loads, "at", wrong)
    found = workspace.solve(q, v, tau, forces=forces, throw=False)
    assert not found.status.ok
    assert found.dynamics_error > 1e-6


@pytest.mark.long
def test_forces_that_balance_are_ok():
    """A force of a million newton and its opposite: what rounding leaves is not held against a."""
    made = chain_on("free_flyer")
    scene = cp.Scene(made)
    q, v, tau = state_of(made)
    pair = [cp.AppliedForce("tip", s * 1e6 * np.array(WRENCH)) for s in (1.0, -1.0)]
    found = cp.solve(scene, q, v, tau, forces=pair)
    assert np.abs(found.a - cp.solve(scene, q, v, tau).a).max() < 1e-6


@pytest.mark.long
def test_a_force_that_torques_balance_without_gravity_is_ok():
    """Only rounding of the force moves the robot: it is compared with the force, not with a."""
    model = pin.Model(chain_on("free_flyer").model)
    model.gravity = pin.Motion.Zero()
    made = cp.Robot("in orbit", model)
    q, v, _ = state_of(made)
    forces = (cp.AppliedForce("tip", WRENCH),)
    found = cp.solve(cp.Scene(made), q, 0 * v, -torque_of(made, q, forces), forces=forces)
    assert np.abs(found.a).max() < 1e-9


@pytest.mark.long
@pytest.mark.parametrize("gap", [0.0, 1e-3])
def test_a_force_is_proved_as_its_torques_are(gap):
    """Also where closing a loop near its singular posture may change a."""
    bar = cp.model.four_bar(ground=0.6, crank=0.3, coupler=0.6, rocker=0.3)
    scene, forces = cp.Scene(bar, bar.loops), (cp.AppliedForce("coupler_tip", [3.0, 0.0, -20.0]),)
    q, still = np.array([0.1, -0.1, 0.1 + gap]), np.zeros(3)
    pushed = cp.solve(scene, q, still, still, forces=forces)
    turned = cp.solve(scene, q, still, torque_of(bar, q, forces))
    np.testing.assert_allclose(pushed.a, turned.a, rtol=1e-9)


@pytest.mark.long
def test_a_free_body_is_pushed_and_turned():
    """F = m a and T = I alpha about the centre of mass, in closed form."""
    model = pin.Model()
    body = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    inertia = np.diag([0.2, 0.3, 0.4])
    model.appendBodyToJoint(body, pin.Inertia(2.0, np.zeros(3), inertia), pin.SE3.Identity())
    model.gravity = pin.Motion.Zero()
    lever = np.array([0.1, 0.2, 0.3])
    at = pin.SE3(np.eye(3), lever)
    model.addFrame(pin.Frame("handle", body, 0, at, pin.FrameType.OP_FRAME))
    scene = cp.Scene(cp.Robot("body", model))
    R = pin.rpy.rpyToMatrix(0.3, 0.5, -0.7)
    q = np.concatenate([[1.0, 2.0, 3.0], pin.Quaternion(R).coeffs()])
    still, F = np.zeros(6), np.array(FORCE)
    for axes, local in (("body", F), ("world", R.T @ F)):
        a = cp.solve(scene, q, still, still, forces=[cp.AppliedForce("handle", F, axes)]).a
        turn = np.linalg.solve(inertia, np.cross(lever, local))
        assert np.allclose(a, np.concatenate([local / 2.0, turn]), rtol=1e-12, atol=1e-12)


def test_errors_name_the_force():
    scene = cp.Scene(robot("talos"))
    made = scene.robot
    q, still = made.postures[next(iter(made.postures))], np.zeros(made.nv)

    def solved(*forces, **options):
        for call in (cp.solve, cp.derivatives, cp.Workspace(scene).acceleration):
            with pytest.raises(cp.CondynError) as error:
                call(
                    *((scene,) if call in (cp.solve, cp.derivatives) else ()),
                    q, still, still, forces=forces, **options,
                )  # fmt: skip
        return str(error.value)

    push = cp.AppliedForce("left_sole_link", FORCE)
    assert "no frame named 'left_sole'" in solved(cp.AppliedForce("left_sole", FORCE))
    assert "belongs to the world" in solved(cp.AppliedForce("world", FORCE))
    assert "shape (2, 3)" in solved(cp.AppliedForce("left_sole_link", [FORCE, FORCE]))
    assert "a function of (t, q, v)" in solved(
        cp.AppliedForce("left_sole_link", lambda t, q, v: FORCE)
    )
    assert "forces[1] = (1, 2, 3): an AppliedForce" in solved(push, (1, 2, 3))
    with pytest.raises(cp.InvalidArgument, match="a list is needed, also for a single"):
        cp.solve(scene, q, still, still, forces=push)
    workspace = cp.Workspace(scene)
    for call in (workspace.solve, workspace.acceleration):
        for wrong, said in ((3, "forces = 3"), (None, "forces = None"), (np.ones(3), "forces.0.")):
            with pytest.raises(cp.InvalidArgument, match=said):
                call(q, still, still, forces=wrong)


@each_row(
    ("arguments", "said"),
    [
        (("", FORCE), "frame = ''"),
        ((3, FORCE), "frame = 3"),
        (("tip", (1.0, 2.0)), "'tip' has shape (2,): (3,), a force, or (6,)"),
        (("tip", 1.0), "'tip' has shape (): (3,)"),
        (("tip", np.zeros((2, 2, 3))), "has shape (2, 2, 3)"),
        (("tip", [(1.0, 2.0), (1.0,)]), "'tip'"),
        (("tip", (1.0, np.nan, 0.0)), "'tip'[1] = nan"),
        (("tip", ("a", "b", "c")), "'tip'"),
        (("tip", (1e200, 0.0, 0.0)), "no machine has that"),
        (("tip", lambda t: FORCE), "'tip' takes (t): it is called with (t, q, v)"),
        (("tip", FORCE, "local"), "frame_of = 'local': 'world' or 'body' is needed"),
    ],
)
def test_what_is_no_force_is_refused(arguments, said):
    with pytest.raises(cp.InvalidArgument) as error:
        cp.AppliedForce(*arguments)
    assert said in str(error.value)


def test_it_is_a_value():
    force = cp.AppliedForce("tip", np.array(FORCE), "body")
    assert force == pickle.loads(pickle.dumps(force)) == cp.AppliedForce("tip", FORCE, "body")
    assert hash(force) == hash(cp.AppliedForce("tip", FORCE, "body"))
    assert force != cp.AppliedForce("tip", FORCE)
    assert force != cp.AppliedForce("tip", WRENCH, "body")
    with pytest.raises(ValueError, match="read-only"):
        force.force[0] = 1.0


@pytest.mark.long
def test_no_force_changes_no_bit():
    label = "talos hands hinged"
    scene = all_scenes()[label]
    q, v, tau = states(label)[0]
    for solver in (None, DenseKKT()):
        one = cp.solve(scene, q, v, tau, solver=solver, forces=[])
        two = cp.solve(scene, q, v, tau, solver=solver)
        assert np.array_equal(one.a, two.a)
        assert one.residuals == two.residuals


def test_inverse_dynamics_counts_forces():
    scene = cp.Scene(robot("talos"), robot("talos").contacts)
    q, v = scene.sample(np.random.default_rng(2))
    forces = pushes(scene.robot)
    a = cp.solve(scene, q, v, np.zeros(scene.robot.nv)).a
    asked = cp.inverse_dynamics(scene, q, v, a, forces=forces)
    assert asked.applied == forces
    again = cp.solve(scene, q, v, asked.tau, forces=forces)
    assert np.abs(again.a - asked.a).max() <= 1e-8 * max(np.abs(a).max(), 9.81)
    extra = torque_of(scene.robot, q, forces)
    same = cp.inverse_dynamics(scene, q, v, a, passive=extra)
    assert np.abs(same.u - asked.u).max() <= 1e-7 * np.abs(same.u).max()
    held = cp.control.gravity_compensation(scene, q, forces=forces)
    still = cp.solve(scene, q, 0 * v, held.tau, forces=forces)
    assert np.abs(still.a - held.a).max() <= 1e-8 * 9.81


def batch_of(count: int = 5) -> tuple[cp.Scene, *tuple[np.ndarray, ...]]:
    scene = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    rng = np.random.default_rng(4)
    q, v = map(np.array, zip(*(scene.sample(rng) for _ in range(count)), strict=True))
    return scene, q, v, rng.uniform(-1, 1, v.shape), rng.uniform(-5, 5, (count, 3))


def test_batches_have_a_force_a_row():
    scene, q, v, tau, rows = batch_of()
    forces = [
        cp.AppliedForce("coupler_tip", rows),
        cp.AppliedForce("rocker_tip", WRENCH, "body"),
    ]
    for executor in (None, cp.Processes(1)):
        solved = cp.solve_batch(scene, q, v, tau, forces=forces, executor=executor, chunk=2)
        found = cp.simulation.derivatives_batch(
            scene, q, v, tau, forces=forces, executor=executor, chunk=2
        )
        for i in range(len(q)):
            own = [cp.AppliedForce("coupler_tip", rows[i]), forces[1]]
            wanted = cp.derivatives(scene, q[i], v[i], tau[i], forces=own)
            assert np.array_equal(solved.a[i], wanted.solution.a)
            assert np.array_equal(found.da_dq[i], wanted.da_dq)
            assert solved[i].applied == found.solution[i].applied == tuple(own)
        assert solved[2:4].applied[0] == cp.AppliedForce("coupler_tip", rows[2:4])
    empty = cp.solve_batch(scene, q[:0], v[:0], tau[:0], forces=[forces[1]])
    assert len(empty) == 0
    with pytest.raises(cp.InvalidArgument, match="5 rows, and there are 4 states"):
        cp.solve_batch(scene, q[:4], v[:4], tau[:4], forces=forces)
    with pytest.raises(cp.errors.UnknownName, match="no frame named 'tip'"):
        cp.solve_batch(scene, q, v, tau, forces=[cp.AppliedForce("tip", FORCE)])


def wind(t, q, v):
    return (3.0 * np.cos(5.0 * t), 1.0 - v[0], q[0])


def test_motions_of_a_batch_have_forces_of_their_own():
    scene, q, v, tau, rows = batch_of()
    forces = [cp.AppliedForce("coupler_tip", rows), cp.AppliedForce("rocker_tip", wind)]
    with cp.Processes(1) as processes:
        for torques, executor in product((tau, 0.0), (None, processes)):
            batch = cp.simulate_batch(
                scene, q, v, torques, forces=forces, duration=0.02, record=1,
                executor=executor, chunk=2,
            )  # fmt: skip
            for i in range(len(q)):
                own = [cp.AppliedForce("coupler_tip", rows[i]), forces[1]]
                its = tau[i] if torques is tau else 0.0
                alone = cp.simulate(scene, q[i], v[i], its, forces=own, duration=0.02)
                assert np.array_equal(batch.q[i], alone.q[-1])
                assert np.array_equal(batch[i].tau, alone.tau)


@pytest.mark.parametrize("kind", ["universal", "zyx", "spherical", "free_flyer", "composite"])
def test_work_of_forces_explains_the_energy(kind):
    made = chain_on(kind)
    q, v, tau = state_of(made)
    forces = [
        cp.AppliedForce("tip", (3.0, -2.0, 5.0)),
        cp.AppliedForce("middle", lambda t, q, v: (np.cos(9 * t), 0.0, 2.0, 0.0, t, 0.3), "body"),
    ]
    found = cp.simulate(cp.Scene(made), q, v, tau, forces=forces, duration=0.2, dt=5e-4)
    assert found.status.ok
    free = cp.simulate(cp.Scene(made), q, v, tau, duration=0.2, dt=5e-4)
    assert np.abs(found.energy.work - free.energy.work).max() > 1e-2
    assert np.abs(found.energy.error).max() < 1e-7 * found.energy.scale
    middle = len(found) // 2
    at = found.q[middle], found.v[middle]
    again = cp.solve(cp.Scene(made), *at, found.tau[middle])
    assert np.abs(again.a - found.a[middle]).max() <= 1e-9 * np.abs(again.a).max()
    now = [each.at(found.t[middle], *at) for each in forces]
    pushed = cp.solve(cp.Scene(made), *at, tau, forces=now)
    assert np.abs(pushed.a - found.a[middle]).max() <= 1e-9 * np.abs(again.a).max()


def test_a_mass_hangs_on_a_force():
    """A free body under its own weight turned round: it moves as if there were none."""
    model = pin.Model()
    body = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    lever = np.array([0.3, 0.1, 0.2])
    model.appendBodyToJoint(
        body, pin.Inertia(2.0, lever, np.diag([0.2, 0.3, 0.4])), pin.SE3.Identity()
    )
    at = pin.SE3(np.eye(3), lever)
    model.addFrame(pin.Frame("centre", body, 0, at, pin.FrameType.OP_FRAME))
    scene = cp.Scene(cp.Robot("body", model))
    lift = cp.AppliedForce("centre", -2.0 * np.array(model.gravity.linear))
    q, v = pin.neutral(model), np.array([1.0, -2.0, 0.5, 0.3, 1.0, -0.7])
    found = cp.simulate(scene, q, v, forces=[lift], duration=0.5)
    momentum = found.momentum
    assert np.abs(momentum - momentum[0]).max() < 1e-9


def test_forces_of_a_run_are_checked_before_it():
    scene, q, v, _, _ = batch_of(1)

    def run(*forces):
        return cp.simulate(scene, q[0], v[0], forces=forces, duration=0.01)

    with pytest.raises(cp.errors.UnknownName, match="no frame named 'tip'"):
        run(cp.AppliedForce("tip", FORCE))
    with pytest.raises(cp.InvalidArgument, match="belongs to the world"):
        run(cp.AppliedForce("world", wind))
    with pytest.raises(cp.InvalidArgument, match=r"\(0, q, v\) has shape \(2,\)"):
        run(cp.AppliedForce("rocker_tip", lambda t, q, v: (1.0, 2.0)))
    with pytest.raises(cp.InvalidArgument, match=r"\(0, q, v\) has shape \(1, 3\)"):
        run(cp.AppliedForce("rocker_tip", lambda t, q, v: [FORCE]))


@pytest.mark.long
def test_a_check_is_not_blinded_by_large_torques():
    """How a changes with v depends on no torque: differences have none to lose digits to."""
    model, rng, parent = pin.Model(), np.random.default_rng(0), 0
    for i, joint in enumerate((pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ) * 2):
        placed = pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3]))
        parent = model.addJoint(parent, joint(), placed, f"j{i}")
        model.appendBodyToJoint(parent, pin.Inertia.FromBox(2.0, 0.3, 0.4, 0.2), placed)
    model.addFrame(pin.Frame("tip", parent, 0, placed, pin.FrameType.OP_FRAME))
    scene = cp.Scene(cp.Robot("arm", model))
    q, v, tau = rng.uniform(-1, 1, (3, 6))
    cp.derivatives(scene, q, v, 1e7 * tau, check=True)
    push = cp.AppliedForce("tip", 1e7 * np.array(FORCE))
    by_v = cp.derivatives(scene, q, v, tau, forces=[push], method="differences").da_dv
    assert np.abs(by_v - cp.derivatives(scene, q, v, tau).da_dv).max() < 1e-8


@pytest.mark.parametrize("kind", list(joints()))
def test_derivatives_of_every_kind_of_joint(kind):
    made = chain_on(kind)
    q, v, tau = state_of(made, 4)
    found = cp.derivatives(cp.Scene(made), q, v, tau, forces=PUSHED, check=True)
    plain = cp.derivatives(cp.Scene(made), q, v, tau)
    assert np.abs(found.da_dq - plain.da_dq).max() > 1e-3


IMPLICIT = ("SemiImplicitEuler", "ImplicitMidpoint", "LinearlyImplicitMidpoint",
            "GeneralisedAlpha", "RadauIIA", "GearGuptaLeimkuhler")  # fmt: skip


@pytest.mark.parametrize("name", IMPLICIT)
def test_forces_go_with_a_stiff_torque_and_its_derivatives(name):
    """A joint spring of 8e5 N m/rad as a torque, its jacobian, and a force on the tip."""
    made, k, c = chain_on("universal"), 8e5, 4e4
    q, _, _ = state_of(made)
    pull = cp.AppliedForce("tip", lambda t, q, v: (30.0 * np.cos(20 * t), 0.0, -20.0))

    def tau(t, there, v):
        return -k * (there - q) - c * v

    def jacobian(t, there, v):
        return -k * np.eye(made.nv), -c * np.eye(made.nv)

    run = cp.simulate(
        cp.Scene(made), q, np.zeros(made.nv), tau, forces=[pull], jacobian=jacobian,
        duration=0.05, dt=1e-3, integrator=getattr(cp.simulation, name)(),
    )  # fmt: skip
    assert run.status.ok
    # so stiff a joint creeps: c q' + k (q - q0) = what the forces do, the rest is nothing beside it
    assert np.abs(run.q[-1] - q).max() < 5e-4
    assert np.abs(run.q[-1] - q).max() > 1e-6


def test_forces_that_are_not_stiff_are_not_called_stiff():
    scene, q, v, _, _ = batch_of(1)
    force = cp.AppliedForce("coupler_tip", FORCE)
    for torque in (0.0, lambda t, q, v: -0.1 * v):
        run = cp.simulate(
            scene, q[0], v[0], torque, forces=[force], duration=0.02,
            integrator=cp.simulation.LinearlyImplicitMidpoint(),
        )  # fmt: skip
        assert run.run.differenced == 0
        assert not any("stiff" in notice for notice in run.notices)


@pytest.mark.long
@pytest.mark.parametrize(
    ("given", "said"),
    [
        (lambda t, q, v: np.zeros((5, 5)), "a pair is needed"),
        (lambda t, q, v: (np.zeros(5), np.zeros((5, 5))), r"\[0\] has shape \(5,\)"),
    ],
)
def test_derivatives_of_torques_are_looked_at_beside_forces_too(given, said):
    made = chain_on("revolute")
    q, v, _ = state_of(made)
    with pytest.raises(cp.InvalidArgument, match=said):
        cp.simulate(
            cp.Scene(made), q, v, lambda t, q, v: -v, jacobian=given, duration=0.01,
            forces=[cp.AppliedForce("tip", FORCE)], integrator=cp.simulation.RadauIIA(),
        )  # fmt: skip
