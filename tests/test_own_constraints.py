"""Pinocchio's own constraints in a scene: a and forces are those of pin.constraintDynamics."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pinocchio as pin
import pytest
from shared import each_row, robot

import condyn_pin as cp
from condyn_pin._core._pin import VERSION, init_constraint_dynamics, set_baumgarte
from condyn_pin.dynamics.compiled import why_not

POINT, FRAME = pin.ContactType.CONTACT_3D, pin.ContactType.CONTACT_6D
LOCAL, ALIGNED = pin.ReferenceFrame.LOCAL, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


WORLD = (0, pin.SE3.Identity())


def constraint(model, kind, one, two=WORLD, axes=LOCAL, gains=(0.0, 0.0)):
    made = pin.RigidConstraintModel(kind, model, *one, *two, axes)
    set_baumgarte(made, *gains)
    return made


def humanoid(seed: int, *, opened: float = 0.0, speed: float = 0.0):
    """A random humanoid with one to three constraints of independent rows, and a state.

    They are open by about `opened` [m, rad], and J v is `speed` of that of a random v.
    """
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    model = pin.buildSampleModelHumanoidRandom()
    model.lowerPositionLimit[:3], model.upperPositionLimit[:3] = -1.0, 1.0
    data, q = model.createData(), pin.randomConfiguration(model)
    v, tau = rng.normal(size=model.nv), rng.normal(size=model.nv)
    pin.forwardKinematics(model, data, q)
    made = []
    for i in range(rng.integers(1, 4)):
        joints = rng.permutation(np.arange(1, model.njoints))[:2]
        joints = [int(j) for j in joints]
        if rng.random() < 0.4:
            joints[1] = 0
        placed = pin.SE3.Random()
        ends = [(joints[0], placed)]
        other = data.oMi[joints[1]].actInv(data.oMi[joints[0]]) * placed
        ends.append((joints[1], other * pin.exp6(pin.Motion(opened * rng.normal(size=6)))))
        if joints[1] == 0 and rng.random() < 0.4:
            ends.reverse()
        kind, axes = (POINT, FRAME)[rng.integers(2)], (LOCAL, ALIGNED)[rng.integers(2)]
        gains = (rng.uniform(0, 50), rng.uniform(0, 10)) if rng.random() < 0.7 else (0.0, 0.0)
        made.append(constraint(model, kind, *ends, axes, gains))
        made[-1].name = f"number {i}" if rng.random() < 0.5 else ""
    J = jacobian(model, made, q)
    if np.linalg.svd(J, compute_uv=False).min() < 1e-3:
        return None
    return model, made, q, v - (1 - speed) * np.linalg.pinv(J) @ (J @ v), tau


def jacobian(model, constraints, q):
    scene = cp.Scene.from_pinocchio(model, constraints)
    return cp.Workspace(scene).jacobian(q)


def raw(model, constraints, q, v, tau):
    """a and lambda_c of pin.constraintDynamics."""
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for each in constraints:
        models.append(each)
        datas.append(each.createData())
    data = model.createData()
    init_constraint_dynamics(model, data, models, datas)
    settings = pin.ProximalSettings(1e-14, 1e-14, 1e-10, 30)
    a = pin.constraintDynamics(model, data, q, v, tau, models, datas, settings).copy()
    return a, data.lambda_c.copy()


def forces(solution):
    return np.concatenate([np.asarray(force) for force in solution.forces.values()])


def off(found, right) -> float:
    return float(np.abs(found - right).max() / max(1.0, np.abs(right).max()))


@pytest.mark.parametrize("opened", [0.0, 0.05])
def test_accelerations_and_forces_are_those_of_pinocchio(opened):
    seen = 0
    for seed in range(24):
        if (case := humanoid(seed, opened=opened)) is None:
            continue
        model, own, q, v, tau = case
        scene = cp.Scene.from_pinocchio(model, own)
        solution = cp.solve(scene, q, v, tau, throw=False)
        a, lam = raw(model, own, q, v, tau)
        assert off(solution.a, a) < 1e-9, seed
        of_open_world = opened and any(c.type == FRAME and c.joint1_id == 0 for c in own)
        if not of_open_world:  # whose moment is about the frame of the body
            assert off(forces(solution), lam) < 1e-8, seed
            seen += 1
    assert seen > 8


@pytest.mark.long
def test_with_a_velocity_that_opens_all_agree_but_6d_aligned_ones():
    """Pinocchio leaves out a term of these: its rows are not the rate of their velocities."""
    seen = 0
    for seed in range(24):
        if (case := humanoid(seed, speed=0.3)) is None:
            continue
        model, own, q, v, tau = case
        if any(c.type == FRAME and c.reference_frame == ALIGNED and c.joint2_id for c in own):
            continue
        a, lam = raw(model, own, q, v, tau)
        solution = cp.solve(cp.Scene.from_pinocchio(model, own), q, v, tau, throw=False)
        assert off(solution.a, a) < 1e-9, seed
        assert off(forces(solution), lam) < 1e-8, seed
        seen += 1
    assert seen > 4


def arm():
    """A planar arm of three hinges that Pinocchio built, without any frame."""
    model = pin.Model()
    for i in range(3):
        at = pin.SE3(np.eye(3), np.array([0.5 if i else 0.0, 0.0, 0.0]))
        joint = model.addJoint(i, pin.JointModelRY(), at, f"hinge {i}")
        body = pin.Inertia(1.0, np.array([0.25, 0, 0]), np.diag([0.01, 0.02, 0.02]))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    return model


TIP = pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0]))
Q, V = np.array([0.3, 0.5, 0.4]), np.zeros(3)


def tip_of(model, q=Q):
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return data.oMi[3] * TIP


@pytest.mark.long
def test_without_a_place_in_the_world_it_belongs_where_it_is():
    model = arm()
    for kind, wanted in ((POINT, cp.PointContact), (FRAME, cp.SurfaceContact)):
        own = pin.RigidConstraintModel(kind, model, 3, TIP, LOCAL)
        scene = cp.Scene.from_pinocchio(model, [own])
        (made,) = scene.constraints
        assert type(made) is wanted
        assert (made.frame, made.anchor, made.name) == ("hinge 2 + [0.5 0 0]", None, "constraint 0")
    placed = constraint(model, POINT, (3, TIP), (0, tip_of(model)))
    (made,) = cp.Scene.from_pinocchio(model, [placed]).constraints
    assert np.allclose(made.anchor, tip_of(model).translation, atol=1e-15)
    pulled = constraint(model, POINT, (3, TIP), gains=(4.0, 2.0))  # to the origin of the world
    (made,) = cp.Scene.from_pinocchio(model, [pulled]).constraints
    assert (made.anchor, made.drift) == ((0.0, 0.0, 0.0), cp.Baumgarte(1.0, 2.0))


@pytest.mark.long
def test_a_list_of_both_kinds_and_a_vector_of_pinocchio():
    model = arm()
    robot = cp.Robot("arm", model)
    own = constraint(model, POINT, (3, TIP), (0, tip_of(model)), ALIGNED)
    own.name = "tip"
    held = cp.constraints.HeldJoint("hinge 0", 0.3)
    both = cp.Scene(robot, [held, own])
    assert both.names == ("hinge 0", "tip")
    vector = pin.StdVec_RigidConstraintModel()
    vector.append(own)
    scene = cp.Scene(robot, vector)
    assert scene.constraints == both.constraints[1:]
    force = cp.solve(scene, Q, V, np.zeros(3)).forces["tip"]
    assert force.frame == "world"
    assert np.allclose(force, force.own.in_world())
    assert np.allclose(force.on_other(), -np.asarray(force))
    assert np.allclose(force.own.on_other().own, force.on_other().own)
    assert np.allclose(force.in_world(), force)


def desired(model):
    own = constraint(model, POINT, (3, TIP))
    own.desired_contact_acceleration = pin.Motion(np.arange(6.0))
    return own


def beyond(model):
    big = pin.buildSampleModelHumanoidRandom()
    return constraint(big, POINT, (20, TIP))


def in_world(model):
    own = constraint(model, POINT, (3, TIP))
    own.reference_frame = pin.ReferenceFrame.WORLD
    return own


REFUSED = {
    "desired acceleration": (desired, "desired_contact_acceleration is set.*ignores it"),
    "another model": (beyond, "joint1_id = 20, and the model has joints 0 to 3"),
    "axes": (in_world, "reference_frame = WORLD; LOCAL or LOCAL_WORLD_ALIGNED"),
    "negative": (lambda m: constraint(m, POINT, (3, TIP), gains=(-1.0, 0.0)), r"Kp = .*-1.* >= 0"),
    "NaN": (lambda m: constraint(m, POINT, (3, TIP), gains=(0.0, np.nan)), "Kd = .*nan.* >= 0"),
    "placement": (
        lambda m: constraint(m, POINT, (3, pin.SE3(np.eye(3), np.array([np.nan, 0, 0])))),
        "joint 1: its placement is at .* finite",
    ),
    "one body": (
        lambda m: constraint(m, POINT, (3, TIP), (3, pin.SE3.Identity())),
        "both sides belong to joint 'hinge 2'",
    ),
}


@each_row("case", REFUSED)
def test_what_it_has_beside_is_refused_by_name(case):
    make, words = REFUSED[case]
    model = arm()
    with pytest.raises(cp.errors.InvalidConstraint, match=words) as refused:
        cp.Scene.from_pinocchio(model, [make(model)])
    assert "constraint 0" in str(refused.value)


@pytest.mark.long
def test_a_joint_that_was_changed_counts_unless_pinocchio_keeps_the_old_one():
    model = arm()
    own = constraint(model, POINT, (3, TIP))
    own.joint1_id = 2
    if VERSION >= (4, 0):
        assert cp.Scene.from_pinocchio(model, [own]).constraints[0].frame == "hinge 1 + [0.5 0 0]"
        return
    with pytest.raises(cp.errors.InvalidConstraint, match="made for other joints"):
        cp.Scene.from_pinocchio(model, [own])
    own = constraint(model, POINT, (3, TIP))
    own.corrector.Kp[:] = [1.0, 2.0, 3.0]
    with pytest.raises(cp.errors.InvalidConstraint, match=r"Kp = \[1.0, 2.0, 3.0\]; one number"):
        cp.Scene.from_pinocchio(model, [own])


def held_arm():
    """The arm with its tip on a point of the world, with gains."""
    model = arm()
    own = constraint(model, POINT, (3, TIP), (0, tip_of(model)), ALIGNED, (100.0, 20.0))
    own.name = "tip"
    return cp.Scene.from_pinocchio(model, [own])


def test_derivatives_are_those_of_differences():
    for seed in (3, 4, 6, 7):
        case = humanoid(seed)
        if case is None:
            continue
        model, own, q, v, tau = case
        scene = cp.Scene.from_pinocchio(model, own)
        d, right = (
            cp.derivatives(scene, q, v, tau, method=method) for method in ("kkt", "differences")
        )
        for name in ("da_dq", "da_dv", "dlam_dq", "dlam_dv"):
            one, two = getattr(d, name), getattr(right, name)
            assert np.abs(one - two).max() < 1e-5 * max(1.0, np.abs(two).max()), (seed, name)


def test_it_moves_is_written_and_is_kept(tmp_path):
    scene = held_arm()
    motion = cp.simulate(scene, Q, V, 0.0, duration=0.1, dt=1e-3)
    assert motion.status.ok
    assert scene.check(motion.q[-1]).violation["tip"].size < 1e-9
    motion.save(tmp_path / "motion.npz")
    again = cp.simulation.Trajectory.load(tmp_path / "motion.npz")
    assert again.scene.constraints == scene.constraints
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert hash(pickle.loads(pickle.dumps(scene))) == hash(scene)
    with pytest.raises(cp.errors.InvalidArgument, match=r"tip: its drift = .*keeps"):
        cp.simulate(scene, Q, V, 0.0, duration=0.1, integrator=cp.simulation.Rattle())


def test_a_loop_is_written_for_mujoco_with_its_gains():
    model = arm()
    own = constraint(model, POINT, (3, TIP), (1, pin.SE3.Identity()), gains=(100.0, 20.0))
    (loop,) = cp.Scene.from_pinocchio(model, [own]).constraints
    text = cp.Robot("arm", model).with_loops(loop).to_mjcf()
    assert '<connect name="constraint 0"' in text
    assert 'solref="0.1 1"' in text


def test_welded_joints_of_smaller_scenes_keep_its_frames():
    model = arm()
    own = constraint(model, POINT, (3, TIP), (0, tip_of(model)))
    scene = cp.Scene.from_pinocchio(model, [own])
    smaller = scene.lock(["hinge 2"], Q)
    assert smaller.names == scene.names
    at = smaller.robot.frame(smaller.constraints[0].frame)
    q = smaller.robot.configuration({"hinge 0": Q[0], "hinge 1": Q[1]})
    data = smaller.robot.model.createData()
    pin.forwardKinematics(smaller.robot.model, data, q)
    assert np.allclose((data.oMi[at[0]] * at[1]).translation, tip_of(model).translation)


def test_gains_of_one_constraint_are_those_of_its_rows():
    model = arm()
    rows = [
        constraint(model, POINT, (2, TIP), (0, tip_of(model)), gains=(9.0, 4.0)),
        constraint(model, POINT, (3, TIP), (0, tip_of(model))),
    ]
    scene = cp.Scene.from_pinocchio(model, rows)
    q, v = Q + 0.1, np.array([0.2, -0.3, 0.1])
    workspace = cp.Workspace(scene, drift=cp.Baumgarte(1.0, 3.0))
    terms, c = workspace.terms(q, v), workspace.equations.violation(q)
    Kp, Kd = np.repeat([9.0, 9.0], 3), np.repeat([4.0, 2.0], 3)
    assert np.allclose(terms.a_ref, -Kd * (terms.J @ v) - Kp * c, atol=1e-12)
    plain = cp.Workspace(scene).terms(q, v).a_ref
    assert np.allclose(plain[:3], terms.a_ref[:3])
    assert not plain[3:].any()
    bare = dataclasses.replace(
        scene, constraints=[dataclasses.replace(c, drift=None) for c in scene.constraints]
    )
    assert cp.solve(bare, Q, V, np.zeros(3), throw=False).question.drift is None


SOLVERS = [cp.Proximal(), cp.dynamics.DenseKKT(mu=1e-9), cp.dynamics.NullSpace()]


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
def test_every_method_takes_gains_of_one_constraint(solver):
    scene, v = held_arm(), np.array([0.2, -0.3, 0.1])
    found = cp.solve(scene, Q, v, np.zeros(3), solver=solver, throw=False)
    (loop,) = scene.constraints
    bare = cp.Scene(scene.robot, [dataclasses.replace(loop, drift=None)])
    right = cp.solve(bare, Q, v, np.zeros(3), drift=loop.drift, throw=False)
    assert np.allclose(found.a, right.a, rtol=1e-7, atol=1e-9)
    if hasattr(pin, "lcaba"):
        with pytest.raises(cp.errors.UnsupportedConstraint, match="drift"):
            cp.solve(scene, Q, v, np.zeros(3), solver=cp.LCABA())


def test_the_compiled_core_refuses_gains_of_one_constraint_by_name():
    workspace = cp.Workspace(held_arm())
    assert any("'tip': it has drift control" in why for why in why_not(workspace))


def test_a_controller_takes_gains_of_one_constraint_and_steps_refuse_them():
    solo, drift = robot("solo12"), cp.Baumgarte(3.0, 5.0)
    plain = cp.Scene(solo, solo.contacts)
    own = [dataclasses.replace(each, drift=drift, axes="world") for each in solo.contacts]
    q, v = plain.sample(np.random.default_rng(0))
    cone = cp.contact.FrictionCone(0.6)
    one, two = (
        cp.Controller(scene, [cp.control.CenterOfMass()], cones=cone, drift=given).solve(q, v)
        for scene, given in ((plain, drift), (cp.Scene(solo, own), None))
    )
    assert np.allclose(one.a, two.a, atol=1e-7)
    for name, force in one.forces.items():
        assert np.allclose(force.in_world(), two.forces[name], atol=1e-5)
        slips = (cone.margin(each.forces[name]).slips for each in (one, two))
        assert next(slips) == pytest.approx(next(slips), abs=1e-4)
    with pytest.raises(cp.InvalidArgument, match=r"FL_FOOT: its drift = .*keeps the constraints"):
        cp.step(cp.Scene(solo, own), q, v, dt=1e-3)
