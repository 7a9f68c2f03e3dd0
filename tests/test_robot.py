"""Robots: what is loaded, from where, and that they are values."""

from __future__ import annotations

import dataclasses
import pickle
import re

import numpy as np
import pinocchio as pin
import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.io.description import example_robot_data
from condyn_pin.model import CoupledMotor
from condyn_pin.model.smaller import lock_joints


@pytest.mark.long
def test_postures_cannot_be_written():
    posture = robot("talos").postures["half_sitting"]
    with pytest.raises(ValueError, match="read-only"):
        posture[0] = 1.0
    with pytest.raises(TypeError):
        robot("talos").postures["new"] = posture


@pytest.mark.parametrize("name", ["talos", "cassie"])
def test_postures_keep_their_last_digits(name):
    """Normalising a unit quaternion again would move them, and a copy would not be equal."""
    q = next(iter(robot(name).postures.values())).copy()
    q[3:7] = [0.1, 0.2, 0.3, 0.5]
    once = dataclasses.replace(robot(name), postures={"home": q})
    for _ in range(5):
        copy = pickle.loads(pickle.dumps(once))
        assert copy == once
        once = copy
    assert np.linalg.norm(once.postures["home"][3:7]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.long
def test_talos_carries_rotor_inertia():
    talos = robot("talos")
    joint = talos.model.joints[talos.model.getJointId("leg_left_4_joint")]
    assert talos.model.armature[joint.idx_v] == pytest.approx(0.1)
    assert len(talos.actuated) == talos.nv - 6


@pytest.mark.long
def test_talos_counts_only_joints_that_move_as_unused():
    assert any("limits" in text and "32 joints" in text for text in robot("talos").unused)


def test_passive_torque_is_that_of_springs_and_dampers():
    cassie = robot("cassie")
    q, v = cassie.postures["standing"].copy(), np.zeros(cassie.nv)
    assert not cassie.passive_torque(q, v).any()
    for spring in cassie.springs:
        joint = cassie.model.joints[cassie.model.getJointId(spring.joint)]
        bent = q.copy()
        bent[joint.idx_q] += 0.01
        tau = cassie.passive_torque(bent, v)
        assert tau[joint.idx_v] == pytest.approx(-0.01 * spring.stiffness)
        assert np.count_nonzero(tau) == 1
    knee = cassie.model.joints[cassie.model.getJointId("left-knee-op")].idx_v
    v[knee] = 2.0
    assert cassie.passive_torque(q, v)[knee] == pytest.approx(-2.0)
    assert {s.stiffness for s in cassie.springs} == {1500.0, 1250.0}


def test_with_frame_adds_one_and_leaves_the_robot_alone():
    talos = robot("talos")
    R = pin.rpy.rpyToMatrix(0.1, 0.2, 0.3)
    more = talos.with_frame("toe", "left_sole_link", [0.1, 0.0, 0.0], R)
    assert "toe" not in talos.frames
    joint, placement = more.frame("toe")
    parent, base = talos.frame("left_sole_link")
    assert joint == parent
    assert placement.isApprox(base * pin.SE3(R, np.array([0.1, 0.0, 0.0])), 1e-14)
    q = talos.postures["half_sitting"]
    one = cp.solve(cp.Scene(more, [cp.PointContact("toe")]), q, 0 * q[1:], 0 * q[1:])
    same = cp.PointContact("left_sole_link", offset=(0.1, 0, 0))
    two = cp.solve(cp.Scene(talos, [same]), q, 0 * q[1:], 0 * q[1:])
    assert np.abs(one.a - two.a).max() < 1e-9
    assert np.abs(one.forces["toe"] - R.T @ two.forces["left_sole_link"]).max() < 1e-9


@pytest.mark.long
def test_frames_of_the_world():
    bar = robot("four_bar").with_frame("wall", "world", [0.4, 0.0, 0.5])
    joint, placement = bar.frame("wall")
    assert joint == 0
    assert placement.translation.tolist() == [0.4, 0.0, 0.5]


@pytest.mark.long
def test_an_edited_model_is_made_a_robot_by_replace():
    talos = cp.load_robot("talos")
    model = pin.Model(talos.model)
    model.gravity.linear = np.zeros(3)
    floating = dataclasses.replace(talos, model=model)
    assert floating != talos
    q = talos.postures["half_sitting"]
    assert np.abs(cp.solve(cp.Scene(floating), q, 0 * q[1:], 0 * q[1:]).a).max() < 1e-12


@pytest.mark.long
def test_a_folder_is_a_robot(tmp_path):
    """A URDF with a loop: two rods that hang from a beam, joined at the ends by a bar."""
    (tmp_path / "swing.urdf").write_text(SWING)
    (tmp_path / "robot.toml").write_text(CARD)
    swing = cp.load_robot(tmp_path)
    assert [loop.name for loop in swing.loops] == ["close"]
    assert swing.actuated == ("left",)
    scene = cp.Scene(swing, swing.loops)
    assert (scene.rows, scene.nominal.rank, scene.nominal.mobility) == (3, 2, 1)
    q, v = scene.state("hanging")
    assert cp.solve(scene, q, v, np.zeros(3)).status.ok
    assert any("damping (left)" in text for text in swing.unused)
    (tmp_path / "robot.toml").rename(tmp_path / "swing.toml")
    assert cp.load_robot(tmp_path / "swing.toml").loops == swing.loops
    assert any("friction (left)" in text for text in swing.unused)


PAIR = (
    CoupledMotor("sum", {"left": 1.0, "right": 1.0}, (0.0, 30.0)),
    CoupledMotor("apart", {"left": 0.5, "right": -0.5, "bottom": 0.1}),
)


def swing_of(tmp_path, card: str) -> cp.Robot:
    (tmp_path / "swing.urdf").write_text(SWING)
    (tmp_path / "robot.toml").write_text(card)
    return cp.load_robot(tmp_path)


@pytest.mark.long
def test_a_card_has_motors_on_several_joints(tmp_path):
    tables = (
        '[[coupled_motors]]\nname = "sum"\njoints = { left = 1, right = 1 }\nlimits = [0, 30]\n'
        '[[coupled_motors]]\nname = "apart"\n'
        "joints = { left = 0.5, right = -0.5, bottom = 0.1 }\n"
    )
    swing = swing_of(tmp_path, CARD + tables)
    assert (swing.actuated, swing.coupled_motors) == (("left",), PAIR)
    assert swing.motor_joints == ("left", "right", "bottom")
    alone = swing_of(tmp_path, CARD.replace('actuated = ["left"]', "") + tables)
    assert (alone.actuated, alone.coupled_motors) == ((), PAIR)
    few = cp.load_robot(tmp_path / "robot.toml", actuated=["bottom"])
    assert (few.actuated, few.coupled_motors) == (("bottom",), ())
    for wrong, said in (
        ('joints = { top = 1 }\nname = "m"', "no joint named 'top'"),
        ("joints = { left = 1 }", r"coupled_motors\[0\]: the entry 'name' is missing"),
        ('joints = { left = 0 }\nname = "m"', r"coupled_motors\[0\].*'left' is 0"),
        ('joints = { left = 1 }\nname = "m"\ngear = 2', "no entry named 'gear'"),
    ):
        with pytest.raises(cp.errors.CondynError, match=said):
            swing_of(tmp_path, f"{CARD}[[coupled_motors]]\n{wrong}\n")


@pytest.mark.long
def test_motors_on_several_joints_are_of_the_robot(tmp_path):
    swing = swing_of(tmp_path, CARD).with_motors("bottom", *PAIR)
    assert (swing.actuated, swing.coupled_motors) == (("bottom",), PAIR)
    assert swing.with_motors("left").coupled_motors == ()
    arm = cp.model.chain(2).with_motors(CoupledMotor("belt", {"joint0": 1.0, "joint1": -1.0}))
    copy = pickle.loads(pickle.dumps(arm))
    assert copy == arm
    assert copy.coupled_motors == arm.coupled_motors
    assert swing != swing.with_motors("bottom", PAIR[0])
    assert "motor, apart" in swing._repr_html_()
    scene = cp.Scene(swing, swing.loops)
    q, v = scene.state("hanging")
    cp.simulate(scene, q, v, dt=0.01, duration=0.02).save(tmp_path / "run.npz")
    assert cp.simulation.Trajectory.load(tmp_path / "run.npz").scene.robot == swing


def test_locked_joints_leave_motors_on_the_others(tmp_path):
    swing = dataclasses.replace(swing_of(tmp_path, CARD).with_motors(*PAIR), loops=())
    one = cp.Scene(swing).lock(["bottom"]).robot
    assert one.coupled_motors == (PAIR[0], CoupledMotor("apart", {"left": 0.5, "right": -0.5}))
    two = cp.Scene(swing).lock(["left", "right"]).robot
    assert two.coupled_motors == (CoupledMotor("apart", {"bottom": 0.1}),)
    pair = cp.model.together({"a": one, "b": two})
    assert [motor.name for motor in pair.coupled_motors] == ["a/sum", "a/apart", "b/apart"]
    assert pair.coupled_motors[0].weights == {"a/left": 1.0, "a/right": 1.0}


def test_frames_of_a_card_carry_contacts(tmp_path):
    (tmp_path / "swing.urdf").write_text(SWING)
    tool = '[[frames]]\nname = "tool"\nparent = "a"\ntranslation = [0.1, 0.0, -0.2]\n'
    held = '[[contacts]]\nkind = "point"\nframe = "tool"\n'
    (tmp_path / "robot.toml").write_text(CARD + tool + held)
    swing = cp.load_robot(tmp_path)
    joint, placement = swing.frame("tool")
    assert swing.model.names[joint] == "left"
    assert placement.translation.tolist() == [0.1, 0.0, -0.2]
    assert cp.Scene(swing, swing.contacts).rows == 3


@pytest.mark.long
def test_a_urdf_alone_is_a_robot(tmp_path):
    path = tmp_path / "swing.urdf"
    path.write_text(SWING)
    assert cp.load_robot(path).nv == 3
    floating = cp.load_robot(str(path), root_joint="free_flyer")
    assert (floating.nq, floating.nv) == (7 + 3 * 2, 6 + 3)


def test_postures_of_continuous_joints_are_angles_or_cos_and_sin(tmp_path):
    (tmp_path / "swing.urdf").write_text(SWING)
    (tmp_path / "robot.toml").write_text(
        'name = "s"\n[description]\nfile = "swing.urdf"\n'
        "[postures.a]\nleft = 0.5\n[postures.b]\nleft = [0.6, 0.8]\n"
    )
    postures = cp.load_robot(tmp_path).postures
    np.testing.assert_allclose(postures["a"][:2], [np.cos(0.5), np.sin(0.5)], atol=1e-15)
    np.testing.assert_allclose(postures["b"][:2], [0.6, 0.8], atol=1e-15)


@pytest.mark.parametrize(
    ("kind", "match"),
    [
        ("hinge", r"loops\[0\]: axis: a hinge needs the axis of 'c_end'.*axis=\"x\""),
        ('ball"\naxis = "y', r"loops\[0\]: axis = 'y' for a ball, which has no axis: leave it"),
    ],
)
def test_an_axis_of_a_loop_is_there_where_its_kind_has_one(tmp_path, kind, match):
    (tmp_path / "swing.urdf").write_text(SWING)
    card = CARD.replace("[[loops]]", f'[[loops]]\nkind = "{kind}"')
    (tmp_path / "robot.toml").write_text(card)
    with pytest.raises(cp.errors.CondynError, match=match):
        cp.load_robot(tmp_path)


@pytest.mark.long
def test_a_loop_that_is_open_where_a_posture_puts_it_is_told(tmp_path):
    (tmp_path / "swing.urdf").write_text(SWING)
    (tmp_path / "robot.toml").write_text(CARD)
    assert not any("is open by" in text for text in cp.load_robot(tmp_path).unused)
    bent = CARD.replace("[postures.hanging]", "[postures.bent]\nleft = 0.1\n[postures.hanging]")
    (tmp_path / "robot.toml").write_text(bent)
    assert any(
        re.search(r"'close' is open by .* mm", t) and "'bent'" in t
        for t in cp.load_robot(tmp_path).unused
    )
    as_file = cp.load_robot("cassie", variant={"achilles": "as_file"})
    told = [text for text in as_file.unused if "is open by 1.04 deg" in text]
    assert told
    assert all("at the posture 'standing'" in text for text in told)
    assert not any("is open by" in text for text in robot("cassie").unused)


def test_an_sdf_alone_is_a_robot():
    path = example_robot_data() / "cassie_description/robots/cassie_wo_gearbox_spring.sdf"
    cassie = cp.load_robot(path)
    # balls with damping are cut where its loops open, and have their three coordinates
    assert (cassie.nv, len(cassie.loops)) == (23 + 6, 4)
    assert (cassie.model.damping[-3:] == 0.01).all()
    scene = cp.Scene(cassie, cassie.loops)
    assert scene.check(cp.dynamics.described_posture(scene)).ok
    with pytest.raises(cp.errors.InvalidModel, match="'static' attach the model to the world"):
        cp.load_robot(path, root_joint="free_flyer")


def rod(name: str, rpy: str = "0 0 0") -> str:
    return f"""<link name="{name}"><inertial><origin xyz="0 0 -0.25" rpy="{rpy}"/><mass value="1"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def hinge(name: str, parent: str, child: str, xyz: str, extra: str = "") -> str:
    return f"""<joint name="{name}" type="continuous">
    <parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{xyz}"/><axis xyz="0 1 0"/>{extra}</joint>"""


SWING = f"""<robot name="swing"><link name="beam"/>{rod("a")}{rod("b")}{rod("c")}
{hinge("left", "beam", "a", "0 0 0", '<dynamics damping="0.1" friction="0.2"/>')}
{hinge("right", "beam", "b", "0.5 0 0")}
{hinge("bottom", "a", "c", "0 0 -0.5")}
<link name="c_end"/><joint name="c_tip" type="fixed"><parent link="c"/><child link="c_end"/>
<origin xyz="0.5 0 0"/></joint>
<link name="b_end"/><joint name="b_tip" type="fixed"><parent link="b"/><child link="b_end"/>
<origin xyz="0 0 -0.5"/></joint></robot>"""

CARD = """
name = "swing"
source = "this test"
licence = "none"
actuated = ["left"]
[description]
file = "swing.urdf"
[[loops]]
frame_a = "c_end"
frame_b = "b_end"
name = "close"
[postures.hanging]
left = [1.0, 0.0]
"""


CONTINUOUS = """<robot name="wheel"><link name="base"/><link name="rim"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="rim"/>
<axis xyz="0.6 0.8 0"/></joint></robot>"""


def test_limits_that_are_infinite_are_pickled():
    """Pinocchio 3.9 alone reads none back."""
    wheel = cp.load_robot(CONTINUOUS)
    assert np.isinf(wheel.model.effortLimit).all()
    for once in (wheel, wheel.with_motors("turn")):
        copy = pickle.loads(pickle.dumps(once))
        assert copy == once
        assert np.isinf(copy.model.velocityLimit).all()
        assert np.isinf(once.model.velocityLimit).all()


@pytest.mark.long
def test_bodies_that_do_not_touch_are_kept():
    bar = robot("four_bar")
    crank, rocker, *_ = bar.joints
    apart = dataclasses.replace(bar, exclusions=[(rocker, crank), {crank, rocker}])
    assert apart.exclusions == {frozenset({crank, rocker})}
    assert apart != bar
    for copy in (pickle.loads(pickle.dumps(apart)), apart.with_motors(apart.joints[0])):
        assert copy.exclusions == apart.exclusions
    pair = cp.model.together({"one": apart, "two": bar})
    assert pair.exclusions == {frozenset({f"one/{crank}", f"one/{rocker}"})}
    for wrong, error in (([crank], cp.InvalidArgument), ([[crank]], cp.InvalidArgument),
                         ([[crank, "crnak"]], cp.errors.UnknownName)):  # fmt: skip
        with pytest.raises(error, match=r"exclusions|crnak"):
            dataclasses.replace(bar, exclusions=wrong)
    locked = lock_joints(dataclasses.replace(apart, loops=()), [rocker])
    assert locked.exclusions == apart.exclusions  # the body of a locked joint is a frame
