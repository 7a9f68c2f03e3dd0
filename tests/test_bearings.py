"""Forces in bearings: closed forms, MuJoCo's cfrc_int, balance, and what is not determined."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import condyn_pin as cp


def test_pendulum_hangs_on_its_weight_and_its_centrifugal_force() -> None:
    m, length, inertia, q, v = 2.0, 0.5, 0.1, 0.7, 1.3
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "hinge")
    body = pin.Inertia(m, np.array([0.0, 0.0, -length]), inertia * np.eye(3))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    answer = cp.solve(cp.Scene(cp.Robot("pendulum", model)), [q], [v], [0.3])
    hinge = answer.bearings()["hinge"]
    k = m * length**2
    a = (0.3 - m * 9.81 * length * np.sin(q)) / (inertia + k)
    expected = [
        m * (9.81 * np.sin(q) + length * a) * -1.0, 0.0,
        m * (9.81 * np.cos(q) + length * v**2), 0.0, 0.3, 0.0,
    ]  # fmt: skip
    np.testing.assert_allclose(hinge.wrench, expected, atol=1e-12)
    np.testing.assert_allclose(hinge.drive, [0.3], atol=1e-12)
    np.testing.assert_allclose(hinge.carried[4], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(hinge.in_world()), np.linalg.norm(hinge.wrench))
    assert hinge.determined.all()


MACHINE = """<mujoco><compiler angle="radian"/><option gravity="0.3 -0.2 -9.81">
<flag contact="disable"/></option><worldbody>
<body name="a" pos="0 0 1"><joint name="ja" axis="0 1 0" armature="0.02"/>
 <inertial pos=".15 .01 .02" mass="1" diaginertia=".01 .02 .03"/>
 <body name="b" pos=".3 0 0"><joint name="jb" type="ball"/>
  <inertial pos=".2 .02 0" mass="1.5" diaginertia=".02 .03 .03"/><site name="t" pos=".4 0 .1"/>
  <body name="e" pos=".4 0 0"><joint name="je" axis="1 0 1"/>
   <inertial pos=".05 0 .03" mass=".4" diaginertia=".002 .003 .004"/></body></body></body>
<body name="c" pos=".5 .1 1"><joint name="jc" axis="0.2 1 0"/>
 <inertial pos=".1 0 .1" mass=".7" diaginertia=".01 .02 .02"/>
 <body name="d" pos=".2 0 .1"><joint name="jd" type="slide" axis="1 0 .3"/>
  <inertial pos=".1 .02 0" mass=".6" diaginertia=".004 .006 .005"/><site name="u" pos=".1 0 .1"/>
 </body></body></worldbody>
<equality><connect name="k" site1="t" site2="u"/></equality></mujoco>"""


def test_wrenches_are_those_that_mujoco_finds_for_the_same_motion(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    path = tmp_path / "machine.xml"
    path.write_text(MACHINE)
    robot = cp.load_robot(path)
    scene, model = cp.Scene(robot, robot.loops), robot.model
    mj = mujoco.MjModel.from_xml_string(MACHINE)
    data, rng = mujoco.MjData(mj), np.random.default_rng(0)
    for _ in range(4):
        q, v = scene.sample(rng)
        answer = cp.solve(scene, q, v, rng.normal(size=robot.nv))
        # MuJoCo's recursion at this motion and these forces, not at those of its soft loops
        _set(mj, data, model, q, v, answer.a)
        mujoco.mj_fwdPosition(mj, data)
        mujoco.mj_fwdVelocity(mj, data)
        force = answer.forces["k"]
        _push(data, mj, force)
        mujoco.mj_rnePostConstraint(mj, data)
        found = answer.bearings()
        for name in ("ja", "jb", "je", "jc", "jd"):
            body = mj.joint(name).bodyid[0]
            moment, push = data.cfrc_int[body][:3], data.cfrc_int[body][3:]
            com = data.subtree_com[mj.body_rootid[body]]
            bearing = found[name]
            moment = moment + np.cross(com - bearing.at, push)
            np.testing.assert_allclose(bearing.in_world(), np.r_[push, moment], atol=1e-9)


def _set(mj: Any, data: Any, model: Any, q: Any, v: Any, a: Any) -> None:
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        at, x = mj.joint(name), q[joint.idx_q : joint.idx_q + joint.nq]
        i, k = at.qposadr[0], at.dofadr[0]
        data.qpos[i : i + joint.nq] = x if joint.nq == 1 else x[[3, 0, 1, 2]]
        data.qvel[k : k + joint.nv] = v[joint.idx_v : joint.idx_v + joint.nv]
        data.qacc[k : k + joint.nv] = a[joint.idx_v : joint.idx_v + joint.nv]


def _push(data: Any, mj: Any, force: Any) -> None:
    """The force of the loop on both bodies, as forces from outside."""
    data.xfrc_applied[:] = 0.0
    for felt, body in ((force, "b"), (force.on_other(), "d")):
        push, i = felt.in_world()[:3], mj.body(body).id
        data.xfrc_applied[i] = np.r_[push, np.cross(felt.at - data.xipos[i], push)]
    data.efc_force[:] = 0.0


def test_ground_carries_a_linkage_and_accelerates_its_centre_of_mass() -> None:
    bar = cp.model.four_bar(crank=0.2)
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.sample(np.random.default_rng(0))
    wind = cp.AppliedForce("coupler", [0.0, 3.0, 1.0])
    answer = cp.solve(scene, q, v, [1.0, 0.0, 0.0], forces=[wind])
    found = answer.bearings()
    data = bar.model.createData()
    pin.centerOfMass(bar.model, data, q, v, answer.a)
    ground = found["crank"].in_world()[:3] + found["rocker"].in_world()[:3] + wind.numbers
    weight = bar.mass * (data.acom[0] - bar.model.gravity.linear)
    np.testing.assert_allclose(ground, weight, atol=1e-10)
    np.testing.assert_allclose(found["crank"].drive, [1.0], atol=1e-10)


def test_loop_carries_what_its_joint_in_the_tree_would() -> None:
    """A chain that is cut at a hinge in its middle, or is not: the same wrench."""
    model = pin.Model()
    body = pin.Inertia(1.0, np.array([0.2, 0.1, 0.0]), 0.01 * np.eye(3))
    at = pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0]))
    first = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "first")
    model.appendBodyToJoint(first, body, pin.SE3.Identity())
    model.addFrame(pin.Frame("end", first, at, pin.FrameType.OP_FRAME))
    cut = model.copy()
    second = model.addJoint(first, pin.JointModelRZ(), at, "second")
    model.appendBodyToJoint(second, body, pin.SE3.Identity())
    free = cut.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "second")
    cut.appendBodyToJoint(free, body, pin.SE3.Identity())
    cut.addFrame(pin.Frame("start", free, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    whole = cp.solve(cp.Scene(cp.Robot("whole", model)), [0.3, 0.4], [0.5, 0.6], [0.1, 0.0])
    about_z = np.array([0.0, 0.0, 1.0])
    pose = pin.SE3(pin.exp3(0.7 * about_z), pin.exp3(0.3 * about_z) @ at.translation)
    v = np.r_[pose.rotation.T @ np.cross(0.5 * about_z, pose.translation), 0.0, 0.0, 1.1]
    scene = cp.Scene(cp.Robot("cut", cut), [cp.Loop("end", "start", "hinge", axis="z")])
    q = np.r_[0.3, pin.SE3ToXYZQUAT(pose)]
    parts = cp.solve(scene, q, np.r_[0.5, v], np.r_[0.1, np.zeros(6)])
    (loop,) = (each for name, each in parts.bearings().items() if name not in ("first", "second"))
    of_tree = whole.bearings()["second"].in_world()
    np.testing.assert_allclose(loop.in_world(), of_tree, atol=1e-9)
    assert loop.determined.all()
    np.testing.assert_allclose(parts.bearings()["second"].wrench, 0.0, atol=1e-9)


def test_what_redundant_rows_share_is_not_determined() -> None:
    """A planar linkage closed by a hinge in space: what bends it out of its plane is shared."""
    bar = cp.model.four_bar()
    (loop,) = bar.loops
    hinge = cp.Loop(loop.frame_a, loop.frame_b, "hinge", axis="y")
    scene = cp.Scene(bar, [hinge])
    q, v = scene.sample(np.random.default_rng(1))
    for name, bearing in cp.solve(scene, q, v, [1.0, 0.0, 0.0]).bearings().items():
        axis = bearing._rotation.T @ np.array([0.0, 1.0, 0.0])
        along = np.abs(axis).argmax()
        known = np.full(6, False)
        known[[i for i in range(3) if i != along]] = True  # forces in the plane
        known[3 + along] = True  # the moment about the axis
        np.testing.assert_array_equal(bearing.determined, known, err_msg=name)
        assert "not determined" in repr(bearing)


@pytest.mark.long
def test_nothing_holds_a_free_base() -> None:
    robot = cp.load_robot("cassie")
    scene = cp.Scene(robot, robot.loops)
    q, v = scene.sample(np.random.default_rng(2))
    found = cp.solve(scene, q, v, np.zeros(robot.nv)).bearings()
    np.testing.assert_allclose(found["root_joint"].wrench, 0.0, atol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize("name", ["cassie", "bricard"])
def test_noise_of_sensors_leaves_what_is_determined(name: str) -> None:
    robot = cp.load_robot("cassie") if name == "cassie" else cp.model.bricard()
    scene, rng = cp.Scene(robot, robot.loops), np.random.default_rng(3)
    q, v = scene.sample(rng)
    tau = np.zeros(robot.nv)
    closed = cp.solve(scene, q, v, tau).bearings()
    q = pin.integrate(robot.model, q, 1e-4 * rng.normal(size=robot.nv))
    v = v + 1e-4 * rng.normal(size=robot.nv)
    for joint, bearing in cp.solve(scene, q, v, tau).bearings().items():
        known = closed[joint].determined
        np.testing.assert_array_equal(bearing.determined, known, err_msg=joint)
