"""Couplings of joints: pairs, weighted sums of many, and curves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from referee import MujocoReferee
from shared import each_row, relative

import condyn_pin as cp
from condyn_pin.constraints import Coupling, Driven, HeldJoint, Sine

EPICYCLIC = {"sun": 30.0, "ring": 70.0, "carrier": -100.0}  # by teeth
CAM = Coupling("ring", "sun", 0.5, 0.1, (0.2, -0.3, 0.1), name="cam")
MOMENTS = {"sun": 0.2, "ring": 0.7, "carrier": 1.1}


def wheels() -> cp.Robot:
    """Three wheels about one axis."""
    model = pin.Model()
    for name, moment in MOMENTS.items():
        i = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), name)
        wheel = pin.Inertia(1.0, np.zeros(3), moment * np.eye(3))
        model.appendBodyToJoint(i, wheel, pin.SE3.Identity())
    return cp.Robot("wheels", model)


def swinging() -> cp.Robot:
    """Three uneven pendulums of one axis each."""
    model = pin.Model()
    for k, name in enumerate(EPICYCLIC):
        i = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), name)
        off = pin.SE3(np.eye(3), np.array([0.1 * k, 0.2, -0.3]))
        model.appendBodyToJoint(i, pin.Inertia.FromBox(1.0 + k, 0.1, 0.2, 0.3), off)
    return cp.Robot("pendulums", model)


def violation(scene: cp.Scene, q: np.ndarray) -> np.ndarray:
    """c(q) of a scene."""
    return cp.Workspace(scene).violation(q)


def test_an_epicyclic_gear_has_its_closed_form():
    """With w the weights and I the moments, lam = -(w . I^-1 tau) / (w . I^-1 w)."""
    scene = cp.Scene(wheels(), [Coupling(EPICYCLIC)])
    moments, w = np.array([*MOMENTS.values()]), np.array([*EPICYCLIC.values()])
    tau = np.array([1.0, -2.0, 0.7])
    lam = -(w @ (tau / moments)) / (w @ (w / moments))
    for solver in (None, cp.DenseKKT(), cp.dynamics.Reference()):
        answer = cp.solve(scene, np.zeros(3), np.zeros(3), tau, solver=solver)
        assert answer.status.ok
        assert answer.a == pytest.approx((tau + w * lam) / moments, rel=1e-12)
        force = answer.forces["sun~ring~carrier"]
        assert force.generalized() == pytest.approx(w * lam, rel=1e-12)
        assert force.components == pytest.approx([w[0] * lam], rel=1e-12)
        assert (force.on, force.by) == ("sun", "ring, carrier")
        with pytest.raises(cp.InvalidArgument, match="3 joints, by ratios of their own; general"):
            force.on_other()


@pytest.mark.long
def test_two_weights_are_a_ratio():
    scenes = [
        cp.Scene(swinging(), [coupling])
        for coupling in (
            Coupling("sun", "ring", -2.0, 0.3),
            Coupling({"sun": 1, "ring": 2}, offset=0.3),
        )
    ]
    q, v = scenes[0].sample(np.random.default_rng(0))
    one, two = (cp.solve(scene, q, v, np.zeros(3)) for scene in scenes)
    assert np.array_equal(one.a, two.a)
    assert np.array_equal(one.lam, two.lam)


@pytest.mark.parametrize("drift", [None, cp.Baumgarte(3.0, 5.0)])
def test_a_cam_is_differentiated_on_and_off_its_curve(drift):
    scene = cp.Scene(swinging(), [CAM])
    rng = np.random.default_rng(1)
    q, v = scene.sample(rng)
    assert q[1] == pytest.approx(
        0.1 + 0.5 * q[0] + 0.2 * q[0] ** 2 - 0.3 * q[0] ** 3 + 0.1 * q[0] ** 4
    )
    tau = rng.normal(size=3)
    for state in ((q, v), (q + 1e-7, v + 1e-7)):
        found = cp.derivatives(scene, *state, tau, drift=drift)
        differences = cp.derivatives(scene, *state, tau, drift=drift, method="differences")
        for name in ("da_dq", "da_dv", "dlam_dq", "dlam_dv"):
            assert relative(getattr(found, name), getattr(differences, name)) < 1e-6, name


@pytest.mark.long
def test_a_cam_keeps_its_energy_and_its_curve():
    scene = cp.Scene(swinging(), [CAM, Coupling(EPICYCLIC, offset=0.2)])
    q, v = scene.sample(np.random.default_rng(2))
    run = cp.simulate(scene, q, v, duration=2.0)
    assert run.status.ok
    energy = run.energy.total
    assert np.ptp(energy) < 1e-6 * np.abs(energy).max()
    assert np.abs(run.violation).max() < 1e-8


def test_a_sum_of_joints_follows_a_path():
    scene = cp.Scene(wheels(), [Driven(Coupling(EPICYCLIC), Sine(0.2, 1.0))])
    q, v = scene.state()
    run = cp.simulate(scene, q, v, duration=1.0)
    assert run.status.ok
    weights = np.array([*EPICYCLIC.values()])
    assert weights @ run.q[-1] == pytest.approx(0.2 * np.sin(2 * np.pi * run.t[-1]), abs=1e-7)


@pytest.mark.parametrize("coupling", [Coupling(EPICYCLIC, offset=0.4, name="gear"), CAM])
def test_mujoco_has_the_same_rows(coupling, tmp_path):
    q0 = np.array([0.3, -0.2, 0.7])
    robot = (
        swinging().with_loops(coupling).with_posture("qpos0", dict(zip(EPICYCLIC, q0, strict=True)))
    )
    referee = MujocoReferee(robot)
    rng = np.random.default_rng(3)
    scene = cp.Scene(robot, robot.loops)
    for q in (q0, *rng.normal(size=(5, 3))):
        gap, J = referee.equality(q)
        assert gap == pytest.approx(violation(scene, q), abs=1e-12)
        assert pytest.approx(cp.Workspace(scene).jacobian(q), abs=1e-12) == J
    path = tmp_path / "robot.xml"
    path.write_text(robot.to_mjcf())
    (again,) = cp.load_robot(path).loops
    assert again.weights == pytest.approx(coupling.weights)
    assert (again.offset, *again.higher) == pytest.approx((coupling.offset, *coupling.higher))


def test_files_keep_weights_and_curves(tmp_path):
    scene = cp.Scene(swinging(), [CAM, Coupling(EPICYCLIC)])
    q, v = scene.sample(np.random.default_rng(4))
    cp.simulate(scene, q, v, duration=0.01).save(tmp_path / "run.npz")
    assert cp.Trajectory.load(tmp_path / "run.npz").scene.constraints == scene.constraints
    renamed = Coupling(EPICYCLIC).renamed(lambda name: f"left/{name}")
    assert renamed.joints == ("left/sun", "left/ring", "left/carrier")


@pytest.mark.long
def test_a_robot_toml_lists_them(tmp_path: Path):
    names = [*cp.load_robot("four_bar").joints]
    (tmp_path / "bar.xml").write_text(cp.load_robot("four_bar").to_mjcf(without=["coupler_rocker"]))
    weights = ", ".join(f"{name} = {k}" for k, name in enumerate(names, 1))
    (tmp_path / "robot.toml").write_text(
        f'name = "bar"\n[description]\nfile = "bar.xml"\n[[loops]]\nkind = "coupling"\n'
        f"joint_a = {{{weights}}}\noffset = 0.5\n"
    )
    (loop,) = cp.load_robot(tmp_path).loops
    assert loop == Coupling({name: k for k, name in enumerate(names, 1)}, offset=0.5)


def test_the_others_stay_coupled_where_one_is_locked():
    scene = cp.Scene(swinging(), [Coupling(EPICYCLIC, offset=0.2)])
    q, v = scene.sample(np.random.default_rng(5))
    held = cp.Scene(swinging(), [*scene.constraints, HeldJoint("sun", q[0])])
    v = np.array([0.0, 1.0, 0.7])
    small = scene.lock(["sun"], q=q)
    assert small.robot.joints == ("ring", "carrier")
    a = cp.solve(held, q, v, np.zeros(3)).a
    assert cp.solve(small, q[1:], v[1:], np.zeros(2)).a == pytest.approx(a[1:], rel=1e-9)
    with pytest.raises(cp.InvalidArgument, match="with all of them locked nothing moves"):
        scene.lock(["sun", "ring"])  # they hold the carrier


def test_a_massive_wheel_of_many_units():
    """In other units of the joints the same machine."""
    units = {"sun": 2.0, "ring": 0.5, "carrier": 1.0}
    for coupling in (Coupling(EPICYCLIC, offset=0.2), CAM):
        other = coupling.in_units(3.0, units.__getitem__)
        robot, q = swinging(), np.array([0.3, -0.2, 0.7])
        c, c2 = (
            violation(cp.Scene(robot, [each]), at)[0]
            for each, at in ((coupling, q), (other, q * [*units.values()]))
        )
        assert c2 == pytest.approx(units[coupling.joints[0]] * c)


BAD = {
    "a weight of zero": ({"a": 1.0, "b": 0.0}, {}, "the weight of 'b' is 0; leave it out"),
    "one joint": ({"a": 1.0}, {}, "two different joints are needed or more"),
    "a text": ({"a": "1", "b": 2.0}, {}, "joint_a"),
    "a number": (3.0, {}, "the name of a joint, or a weight by joint, is needed"),
    "both": ({"a": 1.0, "b": 2.0}, {"joint_b": "c"}, "are for two joints"),
    "a curve of many": ({"a": 1.0, "b": 2.0}, {"higher": [1.0]}, "are for two joints"),
    "nan": ("a", {"joint_b": "b", "higher": [np.nan]}, "higher"),
    "a curve that is a number": ("a", {"joint_b": "b", "higher": 1.0}, "higher"),
}


@each_row("case", BAD)
def test_mistakes_are_named(case):
    joint_a, more, words = BAD[case]
    with pytest.raises(cp.InvalidArgument, match=words):
        Coupling(joint_a, **more)


def test_a_curve_of_a_high_degree_is_not_in_mjcf():
    robot = swinging().with_loops(Coupling("sun", "ring", 1.0, 0.0, (0.1,) * 4, name="odd"))
    with pytest.raises(cp.errors.InvalidModel, match="'odd' is a Coupling, for which MuJoCo has"):
        robot.to_mjcf()
