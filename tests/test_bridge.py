"""States beside MuJoCo's, and what is said where the two engines differ.

The referee's own way from q to qpos, and MuJoCo's integrator, judge the bridge: neither shares code
with it.
"""

from __future__ import annotations

import copy
import functools
import json
import pickle
import re
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from referee import MujocoReferee
from shared import axis_of, each_row
from shell import condyn

import condyn_pin as cp
from condyn_pin.io.description import example_robot_data

ROUNDING = 1e-13


def add(model: pin.Model, parent: int, joint: pin.JointModel, name: str) -> int:
    """Hang a box, askew in its joint, askew on its parent."""
    askew = pin.exp6(np.array([0.1, -0.2, 0.3, 0.4, 0.5, -0.6]))
    index = model.addJoint(parent, joint, askew, name)
    model.appendBodyToJoint(index, pin.Inertia.FromBox(2.0, 0.1, 0.2, 0.3), askew)
    return index


def every_joint(*, fixed: bool = False) -> cp.Robot:
    """A trunk, free in an askew placement or fixed, with two limbs of all joints MuJoCo has."""
    model, oblique = pin.Model(), np.array([0.0, 0.6, 0.8])
    trunk = 0 if fixed else add(model, 0, pin.JointModelFreeFlyer(), "free")
    thigh = add(model, trunk, pin.JointModelSpherical(), "ball")
    shank = add(model, thigh, pin.JointModelRX(), "hinge")
    add(model, shank, pin.JointModelPrismaticUnaligned(oblique), "oblique slide")
    arm = add(model, trunk, pin.JointModelRevoluteUnaligned(oblique), "oblique hinge")
    hand = add(model, arm, pin.JointModelRUBY(), "unbounded")
    first = model.addJoint(hand, pin.JointModelRX(), pin.SE3.Identity(), "universal x")
    second = add(model, first, pin.JointModelRY(), "universal y")  # both move one body of MuJoCo
    add(model, second, pin.JointModelPZ(), "slide")
    armature = np.zeros(model.nv)
    armature[model.joints[shank].idx_v] = 0.1
    model.armature = armature
    return cp.Robot("every joint", model)


@functools.cache
def compiled(robot: cp.Robot) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(robot.to_mjcf())


def mujoco_of(robot: cp.Robot) -> mujoco.MjModel:
    """The robot in MuJoCo, a model of one's own to change."""
    return copy.copy(compiled(robot))


@functools.cache
def cassie_and_state() -> tuple[cp.Robot, np.ndarray, np.ndarray]:
    robot = cp.load_robot("cassie")
    return robot, *cp.Scene(robot, robot.loops).sample(np.random.default_rng(0))


def states(robot: cp.Robot, n: int = 4) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    neutral = pin.neutral(robot.model)
    Q = [pin.integrate(robot.model, neutral, rng.normal(size=robot.nv)) for _ in range(n)]
    return np.array(Q), rng.normal(size=(n, robot.nv))


@pytest.fixture(
    scope="module", params=["every joint", "fixed", "cassie", "talos", "solo12", "four_bar"]
)
def both(request: pytest.FixtureRequest) -> tuple[cp.Robot, cp.study.MujocoBridge]:
    made = {"every joint": every_joint, "fixed": lambda: every_joint(fixed=True)}
    robot = made[request.param]() if request.param in made else cp.load_robot(request.param)
    return robot, cp.study.MujocoBridge(robot, mujoco_of(robot))


# States


def test_states_are_those_of_the_referee(both):
    robot, bridge = both
    referee = MujocoReferee(robot)
    for q, v in zip(*states(robot), strict=True):
        X, turning = referee._place(q, v)
        qpos, qvel = bridge.to_mujoco(q, v)
        assert np.abs(qvel - X @ v).max() < ROUNDING
        assert np.abs(bridge.velocity_map(q) - X).max() < ROUNDING
        assert np.abs(bridge.acceleration_to_mujoco(q, v, 0 * v) - turning).max() < ROUNDING
        data = mujoco.MjData(bridge.model)
        data.qpos[:] = qpos
        mujoco.mj_kinematics(bridge.model, data)
        assert np.abs(data.xpos - referee.data.xpos).max() < ROUNDING
        assert np.abs(data.xmat - referee.data.xmat).max() < ROUNDING


def test_there_and_back(both):
    robot, bridge = both
    Q, V = states(robot)
    rng = np.random.default_rng(1)
    A, tau = rng.normal(size=(2, *V.shape))
    qpos, qvel = bridge.to_mujoco(Q, V)
    assert qpos.shape == (len(Q), bridge.model.nq)
    back = bridge.from_mujoco(qpos, qvel)
    assert np.abs(back[0] - Q).max() < ROUNDING
    assert np.abs(back[1] - V).max() < ROUNDING
    qacc = bridge.acceleration_to_mujoco(Q, V, A)
    assert np.abs(bridge.acceleration_from_mujoco(Q, V, qacc) - A).max() < ROUNDING
    qfrc = bridge.torque_to_mujoco(Q, tau)
    assert np.abs(bridge.torque_from_mujoco(Q, qfrc) - tau).max() < ROUNDING
    # the power of a force is the same in both
    assert np.allclose((qfrc * qvel).sum(axis=1), (tau * V).sum(axis=1), atol=1e-12)


@pytest.mark.long
def test_many_states_are_one_after_the_other(both):
    robot, bridge = both
    Q, V = states(robot, 6)
    grid = Q.reshape(2, 3, -1), V.reshape(2, 3, -1)
    for many, one in zip(bridge.to_mujoco(*grid), bridge.to_mujoco(Q[4], V[4]), strict=True):
        assert np.array_equal(many[1, 1], one)
    assert np.array_equal(bridge.from_mujoco(*bridge.to_mujoco(*grid))[0][1, 1],
                          bridge.from_mujoco(*bridge.to_mujoco(Q[4], V[4]))[0])  # fmt: skip


def test_an_acceleration_is_the_derivative_of_qvel(both):
    """Along q(t) = q + t v + ..., v(t) = v + t a: qvel moves by qacc, as differences see it."""
    robot, bridge = both
    (q,), (v,) = states(robot, 1)
    a = np.random.default_rng(2).normal(size=robot.nv)
    t = 1e-5

    def qvel_at(time: float) -> np.ndarray:
        there = pin.integrate(robot.model, q, time * v + 0.5 * time**2 * a)
        return bridge.to_mujoco(there, v + time * a)[1]

    difference = (qvel_at(t) - qvel_at(-t)) / (2 * t)
    assert np.abs(bridge.acceleration_to_mujoco(q, v, a) - difference).max() < 1e-8


def test_both_engines_step_to_the_same_state(both):
    """One small step of MuJoCo's from our state is q + dt v, seen from ours."""
    robot, bridge = both
    (q,), (v,) = states(robot, 1)
    dt = 1e-6
    qpos, qvel = bridge.to_mujoco(q, v)
    mujoco.mj_integratePos(bridge.model, qpos, qvel, dt)
    there = bridge.from_mujoco(qpos, qvel)[0]
    moved = pin.difference(robot.model, q, there) / dt
    assert np.abs(moved - v).max() < 1e-4


def test_gravity_falls_as_in_mujoco(both):
    """qacc_smooth from qfrc_applied, against aba, is a chain through all verbs."""
    robot, bridge = both
    (q,), (v,) = states(robot, 1)
    tau = np.random.default_rng(3).normal(size=robot.nv) * np.diag(pin.crba(
        robot.model, robot.model.createData(), q))  # fmt: skip
    model = bridge.model
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = bridge.to_mujoco(q, v)
    data.qfrc_applied[:] = bridge.torque_to_mujoco(q, tau)
    mujoco.mj_forward(model, data)
    a = bridge.acceleration_from_mujoco(q, v, data.qacc_smooth)
    passive = robot.passive_torque(q, v)
    expected = pin.aba(robot.model, robot.model.createData(), q, v, tau + passive)
    assert np.abs(a - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.allclose(bridge.torque_from_mujoco(q, data.qfrc_passive), passive, atol=1e-9)


@pytest.mark.long
def test_a_joint_without_limits_counts_no_turns():
    robot = every_joint()
    bridge = cp.study.MujocoBridge(robot, mujoco_of(robot))
    (q,), (v,) = states(robot, 1)
    qpos, qvel = bridge.to_mujoco(q, v)
    at = bridge.model.joint("unbounded").qposadr[0]
    qpos[at] += 4 * np.pi
    assert np.allclose(bridge.from_mujoco(qpos, qvel)[0], q, atol=1e-12)
    assert abs(bridge.to_mujoco(q, v)[0][at]) <= np.pi


def test_a_bridge_is_pickled():
    robot = every_joint()
    (q,), (v,) = states(robot, 1)
    bridge = cp.study.MujocoBridge(robot, mujoco_of(robot))
    again = pickle.loads(pickle.dumps(bridge))
    assert np.array_equal(again.to_mujoco(q, v)[0], bridge.to_mujoco(q, v)[0])
    assert "every joint" in repr(again)


# Joints that have other names, and more of them

TWO = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="crate" pos="3 0 0"><freejoint name="crate"/><geom size="0.1" mass="5"/></body>
  <body name="upper"><joint name="{first}" axis="{axis}"/><geom size="0.1" pos="0 0 -0.2" mass="1"/>
    <body name="lower" pos="0 0 -0.4">
      <joint name="{second}" type="{kind}"/><geom size="0.1" pos="0.1 0 0" mass="2"/>
      <body name="hand" pos="0 0 -0.3"><joint name="finger" axis="1 0 0" ref="0.3"/>
        <geom size="0.05" pos="0 0.1 0" mass="0.3"/></body>
    </body>
  </body>
</worldbody></mujoco>"""
PLAIN = {"first": "shoulder", "second": "elbow", "axis": "0 1 0", "kind": "hinge"}


def two_links() -> cp.Robot:
    """The arm of the text above, the finger held as it is drawn."""
    model = pin.Model()
    ball = pin.Inertia.FromSphere
    one = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "shoulder")
    model.appendBodyToJoint(one, ball(1.0, 0.1), pin.SE3(np.eye(3), np.array([0, 0, -0.2])))
    at = pin.SE3(np.eye(3), np.array([0, 0, -0.4]))
    two = model.addJoint(one, pin.JointModelRZ(), at, "elbow")
    model.appendBodyToJoint(two, ball(2.0, 0.1), pin.SE3(np.eye(3), np.array([0.1, 0, 0])))
    model.appendBodyToJoint(two, ball(0.3, 0.05), pin.SE3(np.eye(3), np.array([0, 0.1, -0.3])))
    return cp.Robot("arm", model)


def arm(**said: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(TWO.format(**PLAIN | said))


def test_joints_that_the_robot_has_not_are_held():
    robot, model = two_links(), arm()
    bridge = cp.study.MujocoBridge(robot, model, without=["crate", "finger"])
    q, v = np.array([0.3, -0.4]), np.array([1.0, 2.0])
    found = bridge.compare(q, v, np.array([0.5, -0.5]))
    assert found.ok, str(found)
    assert not found.causes
    assert "held where they are in MuJoCo: crate, finger" in found.notes
    qpos, qvel = bridge.to_mujoco(q, v)
    assert np.array_equal(qpos, [3, 0, 0, 1, 0, 0, 0, 0.3, -0.4, 0.3])
    data = mujoco.MjData(model)
    data.qpos[:3], data.qvel[-1] = (1, 2, 3), 7.0
    qpos, qvel = bridge.to_mujoco([q, q], [v, v], data=data)
    assert np.array_equal(qpos[1, :3], [1, 2, 3])
    assert qvel[1, -1] == 7.0
    assert np.array_equal(bridge.from_mujoco(qpos, qvel)[1], [v, v])


@pytest.mark.long
def test_a_joint_between_others_can_be_held(tmp_path):
    """The file with its elbow and its crate held is Pinocchio's reduced model."""
    path = tmp_path / "arm.xml"
    path.write_text(TWO.format(**PLAIN), encoding="utf-8")
    whole = cp.load_robot(path)
    drawn = whole.postures["qpos0"]
    held = [whole.model.getJointId(name) for name in ("crate", "elbow")]
    robot = cp.Robot("reduced", pin.buildReducedModel(whole.model, held, drawn))
    assert robot.joints == ("shoulder", "finger")
    found = cp.study.MujocoBridge(robot, arm(), without=["elbow", "crate"]).compare(
        np.array([0.2, 0.5]), np.array([1.0, -2.0]), np.zeros(2)
    )
    assert found.ok, str(found)
    assert not found.causes


def test_joints_of_other_names():
    robot = two_links()
    more = {"names": {"shoulder": "s", "elbow": "lower_joint"}, "without": ["crate", "finger"]}
    bridge = cp.study.MujocoBridge(robot, arm(first="s", second=""), **more)
    assert bridge.compare([0.1, 0.2], [1, 2], [0, 0]).ok


HELD = ["crate", "finger"]
REFUSED = {
    "more joints in MuJoCo": (lambda: (arm(), {"without": ["crate"]}), "lacks: finger; name"),
    "fewer": (lambda: (arm(second="e"), {"without": HELD}), "'elbow' of arm is not in .* has e;"),
    "held and needed": (lambda: (arm(), {"without": [*HELD, "elbow"]}), "'elbow' of arm is not in"),
    "another type": (lambda: (arm(kind="slide"), {"without": HELD}), "'elbow' is a JointModelRZ"),
    "a ball": (lambda: (arm(kind="ball"), {"without": HELD}), "and a ball in MuJoCo"),
    "another axis": (lambda: (arm(axis="1 0 0"), {"without": HELD}), r"axis is \(0, 1, 0\) here"),
    "the axis turned about": (
        lambda: (arm(axis="0 -1 0"), {"without": HELD}),
        r"'shoulder': its axis is \(0, 1, 0\) here and \(0, -1, 0\)",
    ),
    "another order": (
        lambda: (arm(first="elbow", second="shoulder"), {"without": HELD}),
        "'shoulder' hangs on universe here and on elbow in MuJoCo",
    ),
    "names of nothing": (lambda: (arm(), {"names": {"ellbow": "elbow"}}), "did you mean 'elbow'"),
    "names there of nothing": (lambda: (arm(), {"names": {"elbow": "e"}}), "no joint of the Mu"),
    "one joint twice": (lambda: (arm(), {"names": {"elbow": "shoulder"}}), "both 'shoulder'"),
    "names as a list": (lambda: (arm(), {"names": ["elbow"]}), "a mapping of our names"),
    "without as a text": (lambda: (arm(), {"without": "crate"}), "a list of names"),
    "without of nothing": (lambda: (arm(), {"without": ["crete"]}), "did you mean 'crate'"),
    "no model": (lambda: (TWO, {}), "a mujoco.MjModel is needed"),
}  # fmt: skip


@each_row("case", REFUSED)
def test_what_does_not_correspond_is_refused(case):
    make, said = REFUSED[case]
    model, more = make()
    with pytest.raises(cp.CondynError, match=said):
        cp.study.MujocoBridge(two_links(), model, **more)


def test_other_joints_are_refused():
    screw = pin.Model()
    add(screw, 0, pin.JointModelPlanar(), "shoulder")
    with pytest.raises(cp.errors.InvalidModel, match="JointModelPlanar here and a hinge in MuJoCo"):
        cp.study.MujocoBridge(cp.Robot("p", screw), arm(), without=["elbow", *HELD])
    with pytest.raises(cp.InvalidArgument, match="a Robot is needed"):
        cp.study.MujocoBridge(screw, arm())


@pytest.mark.long
def test_a_ball_in_another_frame_is_refused():
    text = every_joint(fixed=True).to_mjcf()
    model = mujoco.MjModel.from_xml_string(text)
    k = model.joint("ball").bodyid[0]
    mujoco.mju_mulQuat(model.body_quat[k], model.body_quat[k].copy(), np.array([0.6, 0.8, 0, 0]))
    with pytest.raises(cp.errors.InvalidModel, match="'ball': its frame has the axes"):
        cp.study.MujocoBridge(every_joint(fixed=True), model)


BAD_STATES = {
    "q too short": (lambda b, q, v: b.to_mujoco(q[1:], v), r"q has shape \(18,\)"),
    "v of one state": (lambda b, q, v: b.to_mujoco([q, q], v), r"v has shape \(16,\)"),
    "rows of unequal length": (lambda b, q, v: b.to_mujoco([q, q[1:]], [v, v]), "q: an array"),
    "NaN": (lambda b, q, v: b.to_mujoco(q, v * np.nan), r"v\[0\] = nan"),
    "a long quaternion": (lambda b, q, v: b.to_mujoco(2 * q, v), r"q\[3:7\] has norm 2"),
    "not a quaternion": (lambda b, q, v: b.from_mujoco(0 * b.model.qpos0, v), r"qpos\[3:7\] has"),
    "qpos too long": (lambda b, q, v: b.from_mujoco([*q, *q], v), "qpos has shape"),
    "qacc too short": (lambda b, q, v: b.acceleration_from_mujoco(q, v, v[1:]), "qacc has shape"),
    "text": (lambda b, q, v: b.torque_to_mujoco(q, "tau"), "tau: an array"),
    "data of what": (lambda b, q, v: b.to_mujoco(q, v, data=b.model), "a mujoco.MjData is needed"),
    "many states": (lambda b, q, v: b.velocity_map([q, q]), "q has shape"),
    "tolerance": (lambda b, q, v: b.compare(q, v, v, tolerance=0.0), "tolerance = 0.0"),
    "compared": (lambda b, q, v: b.compare(q, v, v[1:]), "tau has shape"),
}


@each_row("case", BAD_STATES)
def test_bad_states_are_refused(case):
    robot = every_joint()
    bridge = cp.study.MujocoBridge(robot, mujoco_of(robot))
    (q,), (v,) = states(robot, 1)
    call, said = BAD_STATES[case]
    with pytest.raises(cp.InvalidArgument, match=said):
        call(bridge, q, v)


@pytest.mark.long
def test_without_mujoco_the_line_that_installs_it(monkeypatch):
    robot = two_links()
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(cp.errors.MissingExtra, match=r"pip install 'condyn_pin\[mjcf\]'"):
        cp.study.MujocoBridge(robot, None)


# What is said where the engines differ


def compared(robot: cp.Robot, model: mujoco.MjModel, **more) -> cp.study.CrossCheck:
    rng = np.random.default_rng(0)
    q, v = cp.Scene(robot, robot.loops).sample(rng)
    tau = rng.normal(size=robot.nv) * np.sqrt(np.diag(cp.Workspace(cp.Scene(robot)).terms(q, v).M))
    return cp.study.MujocoBridge(robot, model).compare(q, v, tau, **more)


@pytest.mark.parametrize("name", ["every joint", "cassie", "talos", "solo12", "stewart", "delta"])
def test_robots_agree_with_their_own_file(name, tmp_path):
    """And the other way about: MuJoCo's file is the source, the robot what is read from it."""
    robot = every_joint() if name == "every joint" else cp.load_robot(name)
    found = [compared(robot, mujoco_of(robot), tolerance=1e-10)]
    checked = {term.where for term in found[0].terms if term.term == "J"}
    assert checked == {loop.name for loop in robot.loops}
    if name in ("cassie", "talos"):
        path = tmp_path / "robot.xml"
        path.write_text(robot.to_mjcf(), encoding="utf-8")
        model = mujoco.MjModel.from_xml_path(str(path))
        found.append(compared(cp.load_robot(path), model, tolerance=1e-9))
    for each in found:
        assert each.ok, str(each)
        assert not each.causes
        assert {term.term for term in each.terms} >= {"M", "h", "passive", "a"}


MANY_JOINTS = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="a" pos="0 0 1" quat="0.6 0.8 0 0"><freejoint/><geom size="0.1 0.2 0.3" type="box"/>
    <body name="b" pos="0.3 0.1 0" quat="0.5 0.5 -0.5 0.5">
      <joint name="b1" axis="1 2 3" pos="0.1 0 0" ref="0.4"/>
      <joint name="b2" type="slide" axis="0 1 1" ref="-0.2"/>
      <joint name="b3" ref="0.7" pos="0.1 0.1 0.1" stiffness="3" springref="0.2" damping="0.1"/>
      <joint name="b4" type="ball" pos="0 0.2 0.1"/>
      <geom size="0.1 0.05 0.2" type="box" pos="0.1 0 0"/>
      <body name="c" pos="0 0.3 0"><geom size="0.1 0.05 0.2" type="box" euler="0.3 0.2 0.1"/>
        <body name="d" pos="0.1 0.3 0"><joint type="ball" damping="0.2"/>
          <geom size="0.1 0.05 0.2" type="box" euler="0.3 0.2 0.1"/></body></body>
    </body></body>
</worldbody><equality>
  <connect body1="a" body2="d" anchor="0.1 0.2 0.3"/><weld body1="c" body2="a" anchor="0 0.1 0"/>
  <joint joint1="b1" joint2="b3" polycoef="0 2 0 0 0"/>
</equality></mujoco>"""


@pytest.mark.long
def test_many_joints_on_one_body_read_from_mujocos_file(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(MANY_JOINTS, encoding="utf-8")
    robot = cp.load_robot(path)
    bridge = cp.study.MujocoBridge(robot, mujoco.MjModel.from_xml_path(str(path)))
    (q,), (v,) = states(robot, 1)
    opened = bridge.compare(q, v, 0 * v, tolerance=1e-10)
    drawn = bridge.compare(robot.postures["qpos0"], v, 0 * v, tolerance=1e-10)
    for found in (opened, drawn):
        assert found.ok, str(found)
        assert not found.causes
    assert {each.where for each in drawn.terms if each.term == "J"} == {
        "connect0",
        "weld1",
        "joint2",
    }


@pytest.mark.long
def test_one_urdf_read_by_both():
    """No file of ours between them: MuJoCo reads Talos's URDF by itself, with dry friction.

    Before version 4 it lost the rotation of an inertial frame, and put fixed links that are turned
    together wrongly: google-deepmind/mujoco, issues 3559 and 2982.
    """
    path = example_robot_data() / "talos_data" / "robots" / "talos_reduced.urdf"
    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", path.read_text(), flags=re.DOTALL)
    model = mujoco.MjModel.from_xml_string(text)
    robot = cp.load_robot(path, root_joint="fixed")
    found = compared(robot, model, tolerance=1e-10)
    assert any(note.startswith("dry friction in MuJoCo only") for note in found.notes)
    assert [model.joint(k).name for k in range(model.njnt)] != [*robot.joints]  # another order
    if int(mujoco.__version__.split(".")[0]) >= 4:
        assert found.ok, str(found)
        assert not found.causes
    else:
        assert not found.ok
        for said in ("leg_left_3_link .* in both, about other axes", "arm_left_7_link .* m off"):
            assert any(re.search(said, cause) for cause in found.causes), str(found)


def spoil(model: mujoco.MjModel, field: str, joint: str, change) -> None:
    """Change the entry of a joint in an array of the model, or an option."""
    if hasattr(model.opt, field):
        setattr(model.opt, field, change(getattr(model.opt, field)))
        return
    there, kind = model.joint(joint), field.split("_")[0].rstrip("0")
    at = {"body": there.bodyid, "dof": there.dofadr, "jnt": [there.id], "qpos": there.qposadr}
    k, values = int(at[kind][0]), getattr(model, field)
    values[k] = change(values[k])


ASKEW = pin.Quaternion(pin.exp3(np.array([0.5, 0.0, 0.0]))).coeffs()[[3, 0, 1, 2]]
KNEE, FOOT, SHIN, CRANK = (
    f"left-{joint}" for joint in ("knee-op", "foot-op", "knee-shin-joint", "tarsus-crank-joint")
)
OFF = mujoco.mjtDisableBit
# What is changed in Cassie, the term that has to see it, and the sentence that has to name it.
WRONG = [
    ("dof_armature", "root_joint", lambda x: 0.01,  # a default class gives it to a free joint
     "M", r"^joint root_joint: armature .*0.01"),
    ("body_mass", CRANK, lambda x: 1.04 * x,
     "M", r"^body left-tarsus-crank-joint .*: mass 0.\d+ kg here, 0.1"),
    ("body_ipos", KNEE, lambda x: np.add(x, [0, 0, 0.01]),
     "M", r"^body left-knee-op .*: centre of mass .* 0.01 m off$"),
    ("body_inertia", KNEE, lambda x: 1.1 * x,
     "M", r"^body left-knee-op .*: principal moments .* kg m\^2 here, \("),
    ("body_iquat", KNEE, lambda x: ASKEW,
     "M", r"^body left-knee-op .*: principal moments .* in both, about other axes"),
    ("dof_armature", FOOT, lambda x: 0.1,
     "M", r"^joint left-foot-op: armature 0 kg m\^2 here, 0.1 in MuJoCo"),
    ("dof_damping", KNEE, lambda x: x + 0.5,
     "passive", r"^joint left-knee-op: damping 1 N m s/rad here, 1.5 in MuJoCo"),
    ("jnt_stiffness", SHIN, lambda x: 1600.0,
     "passive", r"^joint left-knee-shin-joint: stiffness 1500 N m/rad here, 1600 in"),
    ("disableflags", "springs", lambda x: x | OFF.mjDSBL_SPRING,
     "passive", r"stiffness 1500 N m/rad here, 0 in MuJoCo"),
    ("qpos_spring", SHIN, lambda x: 0.1,
     "passive", r"^joint left-knee-shin-joint: its spring rests at 0 rad here, 0.1"),
    ("body_pos", KNEE, lambda x: np.add(x, [0.002, 0, 0]),
     "gap", r"^joint left-knee-op: it stands at .* 0.002 m off; places of what"),
    ("qpos0", FOOT, lambda x: 0.2,
     "M", r"^joint left-foot-op: the same coordinate puts it -0.2 rad further in MuJoCo"),
    ("gravity", "", lambda x: [0, 0, -9.8],
     "h", r"^gravity: \(0, 0, -9.81\) m/s\^2 here, \(0, 0, -9.8\) in MuJoCo"),
    ("disableflags", "gravity", lambda x: x | OFF.mjDSBL_GRAVITY,
     "h", r"^gravity: \(0, 0, -9.81\) m/s\^2 here, \(0, 0, -?0\) in MuJoCo"),
]  # fmt: skip


@each_row(("field", "joint", "change", "term", "said"), WRONG)
def test_what_is_wrong_is_seen_and_named(field, joint, change, term, said):
    cassie, q, v = cassie_and_state()
    model = mujoco_of(cassie)
    spoil(model, field, joint, change)
    found = cp.study.MujocoBridge(cassie, model).compare(q, v, 0 * v)
    assert not found.ok
    assert max(each.error for each in found.terms if each.term == term) > found.tolerance
    assert re.search(said, found.causes[0]), str(found)
    # what follows on the other side of a loop, or leg
    several = field == "body_pos" or joint == "springs"
    assert len(found.causes) == 1 or several, str(found)
    assert f"differs: {found.causes[0]}" in str(found)
    assert "Pinocchio and MuJoCo differ" in str(found)


@pytest.mark.long
def test_any_link_of_talos_can_be_the_culprit():
    talos = cp.load_robot("talos")
    q, v = cp.Scene(talos).sample(np.random.default_rng(0))
    original = mujoco_of(talos)
    for name in talos.joints[::3]:
        model = copy.copy(original)
        spoil(model, "body_mass", name, lambda x: 1.001 * x)
        found = cp.study.MujocoBridge(talos, model).compare(q, v, 0 * v)
        assert not found.ok, name
        assert len(found.causes) == 1
        assert f"(joint {name}): mass" in found.causes[0]


def test_an_axis_that_is_a_little_off_is_a_cause():
    talos = cp.load_robot("talos")
    model = mujoco_of(talos)
    axis = model.jnt_axis[model.joint("leg_left_4_joint").id]
    axis[:] = pin.exp3(np.array([1e-4, 0, 0])) @ axis + np.array([1e-4, 0, 0])
    found = compared(talos, model)
    assert not found.ok
    assert found.causes[0].startswith("joint leg_left_4_joint: its axis is")


@pytest.mark.long
def test_rounding_is_no_cause_where_a_body_is_alone():
    """Its centre of mass is its origin, so that nothing had a length but rounding."""
    model = pin.Model()
    free = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
    model.appendBodyToJoint(free, pin.Inertia.FromBox(2.0, 0.1, 0.2, 0.3), pin.SE3.Identity())
    box = cp.Robot("box", model)
    theirs = compiled(box)
    theirs.body_ipos[:] = 1e-18
    state = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.6, 0.8]), np.ones(6), np.ones(6)
    assert cp.study.MujocoBridge(box, theirs).compare(*state).causes == ()
    theirs.body_ipos[1] = 1e-3
    (cause,) = cp.study.MujocoBridge(box, theirs).compare(*state).causes
    assert "centre of mass" in cause


@pytest.mark.long
def test_a_slide_with_another_zero_is_named():
    robot = every_joint()
    model = mujoco_of(robot)
    model.qpos0[model.joint("slide").qposadr[0]] = 0.05
    assert "the same coordinate puts it -0.05 m further" in compared(robot, model).causes[0]


@pytest.mark.long
def test_a_loop_that_only_one_has_is_said():
    bar = cp.load_robot("four_bar")
    without = mujoco.MjModel.from_xml_string(bar.to_mjcf(without=["coupler_rocker"]))
    for robot, model in ((bar, without), (replace(bar, loops=()), mujoco_of(bar))):
        found = cp.study.MujocoBridge(robot, model).compare(
            *cp.Scene(bar, bar.loops).state(), np.zeros(3)
        )
        (term,) = [each for each in found.terms if each.term == "J"]
        assert term.error == pytest.approx(1.0)
        assert "coupler_rocker" in found.notes[0]
        assert not found.ok


@pytest.mark.long
def test_loops_of_other_names_are_compared_together():
    cassie = cp.load_robot("cassie")
    renamed = [replace(loop, name=f"{loop.name}_") for loop in cassie.loops]
    found = compared(replace(cassie, loops=renamed), mujoco_of(cassie))
    assert found.ok, str(found)
    assert [each.where for each in found.terms if each.term == "J"] == ["loops of other names"]


def test_open_loops_are_compared_by_their_gaps():
    """Gaps of balls, welds, hinges and gears are the same where they are open."""
    robot = every_joint()
    model = pin.Model(robot.model)
    for name in ("hinge", "slide"):
        model.addJointFrame(model.getJointId(name))
    robot = replace(robot, model=model)
    for frame, on, at in (("a", "hinge", 0.1), ("b", "slide", 0.2)):
        robot = robot.with_frame(frame, on, (at, 0.0, 0.3), pin.exp3(np.array([at, 0.0, 0.2])))
    kinds = ("ball", "weld", "hinge")
    loops = [cp.Loop("a", "b", kind, axis_of(kind), name=f"the {kind}") for kind in kinds]
    gear = cp.constraints.Coupling("hinge", "oblique hinge", ratio=-2.0, offset=0.1, name="gear")
    robot = replace(robot, loops=[*loops, gear])
    (q,), (v,) = states(robot, 1)
    found = cp.study.MujocoBridge(robot, mujoco_of(robot)).compare(q, v, 0 * v, tolerance=1e-10)
    opened = {each.where: each.here for each in found.terms if each.term == "gap"}
    assert opened.keys() == {"the ball", "the weld", "the hinge", "gear"}
    assert min(opened.values()) > 0.01
    assert found.ok, str(found)
    assert {each.where for each in found.terms if each.term == "J"} == {"gear"}
    assert all(f"J of the {kind} was not compared: it is open" in str(found) for kind in kinds)


@pytest.mark.long
def test_the_answer_is_json():
    bar = cp.load_robot("four_bar")
    found = compared(bar, mujoco_of(bar))
    said = json.loads(json.dumps(found.to_dict()))
    assert said["ok"]
    assert said["robot"] == "four_bar"
    assert [term["term"] for term in said["terms"]] == ["M", "h", "passive", "a", "gap", "J"]
    assert cp.study.TermCheck(**said["terms"][0]) == found.terms[0]


# The command


def test_the_command_compares_a_file(tmp_path):
    path = tmp_path / "cassie.xml"
    text = cp.load_robot("cassie").to_mjcf()
    path.write_text(text, encoding="utf-8")
    result = condyn("compare", "cassie", str(path))
    assert result.exit_code == 0, result.output
    assert "cassie: Pinocchio and MuJoCo agree" in result.output
    assert 'mass="0.577"' in text  # both shins
    path.write_text(text.replace('mass="0.577"', 'mass="0.6"'), encoding="utf-8")
    result = condyn("compare", "cassie", str(path), "--json", "--seed", "3")
    assert result.exit_code == 1
    said = json.loads(result.stdout)
    assert not said["ok"]
    assert "mass 0.577 kg here, 0.6 in MuJoCo" in said["causes"][0]


@pytest.mark.long
def test_the_command_takes_names_and_joints_that_are_held(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(TWO.format(**PLAIN | {"first": "s"}), encoding="utf-8")
    model, other = tmp_path / "held.xml", TWO.format(**PLAIN)
    model.write_text(other, encoding="utf-8")
    assert condyn("compare", str(model), str(model)).exit_code == 0
    named = condyn("compare", str(model), str(path), "--name", "shoulder=s")
    assert named.exit_code == 0, named.output
    for words, said in (
        ((str(path),), "names={'shoulder': ...}"),
        ((str(path), "--name", "shoulder"), "OURS=THEIRS is needed"),
        ((str(path), "--name", "shoulder=s", "--without", "crete"), "did you mean 'crate'"),
        ((str(tmp_path / "no.xml"),), "no.xml: cannot be opened"),
        ((str(path), "--name", "shoulder=s", "--tolerance", "2"), "tolerance = 2"),
    ):
        result = condyn("compare", str(model), *words)
        assert isinstance(result.exception, cp.CondynError), words
        assert said in str(result.exception), words


def test_what_only_mujoco_has_is_noted():
    robot = two_links()
    bridge = cp.study.MujocoBridge(robot, arm(), without=HELD)
    bridge.model.opt.viscosity = 0.1
    bridge.model.body_gravcomp[3] = 0.5
    bridge.model.dof_frictionloss[7] = 0.2
    found = bridge.compare([0.1, 0.2], [1.0, 2.0], [0.0, 0.0])
    assert not found.ok
    assert not found.causes
    assert {term.term for term in found.terms if term.error > found.tolerance} == {"passive", "a"}
    notes = " ".join(found.notes)
    assert "dry friction in MuJoCo only (frictionloss): elbow" in notes
    assert "add to passive forces: gravity compensation, a medium" in notes
    assert "switched off in MuJoCo for this: contacts" in notes
