"""URDF: its loops, what is wrong with a file, and files spoilt at random."""

from __future__ import annotations

import re
from pathlib import Path
from textwrap import dedent
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from fuzz import assert_survived
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shared import each_row
from urdf_texts import INERTIA, SWING, joint, link, tip

import condyn_pin as cp
from condyn_pin.io.description import example_robot_data
from condyn_pin.io.urdf import read_urdf


@pytest.fixture
def read(tmp_path: Path):
    def read_text(*parts: str) -> cp.Robot:
        path = tmp_path / "robot.urdf"
        path.write_text(f'<robot name="r">{"".join(parts)}</robot>')
        return cp.load_robot(path)

    return read_text


# Motors -------------------------------------------------------------------------------------------


def transmission(name: str, *joints: str, kind: str = "Simple", ratio: str = "1") -> str:
    ends = "".join(f'<joint name="{each}"/>' for each in joints)
    motor = f'<actuator name="m"><mechanicalReduction>{ratio}</mechanicalReduction></actuator>'
    kind = f"<type>transmission_interface/{kind}Transmission</type>"
    return f'<transmission name="{name}">{kind}{ends}{motor}</transmission>'


def test_simple_transmissions_name_the_motors(read):
    robot = read(
        *SWING,
        transmission("t1", "right", ratio="50"),
        transmission("t2", "left", "bottom", kind="Differential"),
        transmission("t3", "closing_bar_1_frame"),
        transmission("t4", "nothing"),
        transmission("t5", "left"),
    )
    assert robot.actuated == ("right", "left")
    geared, others = (text for text in robot.unused if "transmissions" in text)
    assert "(right)" in geared
    assert "ratios" in geared
    assert others.endswith(": t2, t3, t4")
    assert not [text for text in robot.unused if "not read" in text]


@pytest.mark.long
def test_motors_of_the_caller_are_before_those_of_the_file(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="r">{"".join(SWING)}{transmission("t", "right")}</robot>')
    assert cp.load_robot(path).actuated == ("right",)
    assert cp.load_robot(path, actuated=["left"]).actuated == ("left",)
    bare = '<transmission name="t" type="SimpleTransmission"><joint name="left"/></transmission>'
    path.write_text(f'<robot name="r">{"".join(SWING)}{bare}</robot>')
    assert cp.load_robot(path).actuated == ("left",)


# Loops --------------------------------------------------------------------------------------------


def test_closing_links_are_a_ball(read):
    swing = read(*SWING)
    assert swing.loops == (cp.Loop("closing_bar_1", "closing_bar_2", "ball", name="closing_bar"),)
    assert any("joints cut at closing_bar: balls here" in text for text in swing.unused)
    scene = cp.Scene(swing, swing.loops)
    assert (scene.rows, scene.nominal.rank, scene.nominal.mobility) == (3, 2, 1)
    q, v = scene.sample(np.random.default_rng(0))
    assert cp.solve(scene, q, v, np.zeros(3)).status.ok


def leg(limit: str, kind: str = "revolute"):
    """The four-bar of SWING, two of its joints with a <limit>."""
    right = joint("right", "beam", "b", f'<origin xyz="0.5 0 0"/>{limit}', kind)
    return (*SWING[:4], joint("left", "beam", "a", limit, kind), right, *SWING[6:])


@pytest.mark.long
def test_limits_without_bounds_are_none_and_said(read):
    """By the format they are 0 to 0: the joint is locked, and nothing assembles."""
    swing = read(*leg('<limit effort="100" velocity="20"/>'))
    (said,) = (text for text in swing.unused if "<limit>" in text)
    assert "left, right" in said
    assert "without bounds" in said
    iq = swing.model.joints[swing.model.getJointId("left")].idx_q
    assert swing.model.upperPositionLimit[iq] == np.finfo(float).max
    assert swing.model.lowerPositionLimit[iq] == -np.finfo(float).max
    assert swing.nq == 3 + 1  # only the continuous one is (cos, sin)
    scene = cp.Scene(swing, swing.loops)
    q, v = scene.sample(np.random.default_rng(0))
    assert abs(q[iq]) > 1e-3
    assert cp.solve(scene, q, v, np.zeros(3)).status.ok


@pytest.mark.long
@pytest.mark.parametrize("limit", ['lower="-1"', 'upper="1"', 'lower="-1" upper="1"'])
def test_one_bound_leaves_the_other_at_zero(read, limit):
    swing = read(*leg(f'<limit {limit} effort="100" velocity="20"/>'))
    iq = swing.model.joints[swing.model.getJointId("left")].idx_q
    lower, upper = swing.model.lowerPositionLimit[iq], swing.model.upperPositionLimit[iq]
    assert (lower, upper) == (-1.0 if "lower" in limit else 0.0, 1.0 if "upper" in limit else 0.0)
    assert not [text for text in swing.unused if "<limit>" in text or "lower limit" in text]


def test_limits_without_width_are_said(read):
    swing = read(*leg('<limit lower="0" upper="0" effort="0" velocity="0"/>'))
    (said,) = (text for text in swing.unused if "lower limit" in text)
    assert "left, right" in said
    assert "within_limits=False" in said


def test_a_half_that_is_alone_closes_nothing(read):
    swing = read(*SWING[:-1])
    assert swing.loops == ()
    assert any("'closing_bar_1': its other half is missing" in text for text in swing.unused)


@pytest.mark.long
def test_robot_toml_says_the_kind_of_a_cut_joint(tmp_path):
    (tmp_path / "swing.urdf").write_text(f'<robot name="swing">{"".join(SWING)}</robot>')
    card = tmp_path / "robot.toml"
    card.write_text(
        dedent("""
        name = "swing"
        source = "this test"
        licence = "none"
        [description]
        file = "swing.urdf"
        [[loops]]
        kind = "hinge"
        axis = "y"
        frame_a = "closing_bar_2"
        frame_b = "closing_bar_1"
        """)
    )
    (loop,) = cp.load_robot(tmp_path).loops
    assert (loop.kind, loop.axis) == ("hinge", "y")
    assert cp.load_robot(card) == cp.load_robot(tmp_path)
    assert cp.load_robot(str(card)).name == "swing"


MIMIC = '<mimic joint="left" multiplier="-2" offset="0.1"/>'


@pytest.mark.parametrize("kind", ["continuous", "revolute", "prismatic"])
def test_mimic_is_a_coupling(read, kind):
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind != "continuous" else ""
    robot = read(*SWING[:5], joint("right", "beam", "b", MIMIC + limit, kind), SWING[6])
    assert robot.loops == (cp.constraints.Coupling("right", "left", ratio=-2.0, offset=0.1),)
    assert any("mimic (right)" in text for text in robot.unused)
    scene = cp.Scene(robot, robot.loops)
    q, v = scene.sample(np.random.default_rng(0))
    left, right = (robot.model.joints[robot.model.getJointId(n)] for n in ("left", "right"))
    assert q[right.idx_q] == pytest.approx(-2 * q[left.idx_q] + 0.1, abs=1e-12)
    a = cp.solve(scene, q, v, np.zeros(3)).a
    assert a[right.idx_v] == pytest.approx(-2 * a[left.idx_v], rel=1e-9)


@pytest.mark.long
def test_robot_toml_may_leave_mimic_joints_alone(tmp_path):
    right = joint("right", "beam", "b", MIMIC)
    text = "".join([*SWING[:5], right, SWING[6]])
    (tmp_path / "swing.urdf").write_text(f'<robot name="swing">{text}</robot>')
    card = 'name = "s"\nsource = "t"\nlicence = "n"\n[description]\nfile = "swing.urdf"\nmimic = '
    (tmp_path / "robot.toml").write_text(card + "false")
    robot = cp.load_robot(tmp_path)
    assert robot.loops == ()
    assert robot.nq == 6  # continuous, as cos and sin
    assert any("mimic (right): these joints move on their own" in text for text in robot.unused)
    (tmp_path / "robot.toml").write_text(card + '"no"')
    with pytest.raises(cp.errors.InvalidModel, match=r"description\.mimic = 'no': true or false"):
        cp.load_robot(tmp_path)


def test_the_gripper_of_talos_is_coupled():
    folder = example_robot_data() / "talos_data" / "robots"
    robot = cp.load_robot(folder / "talos_full_v2.urdf", root_joint="free_flyer")
    assert len(robot.loops) == 12
    assert {loop.joint_b for loop in robot.loops} == {"gripper_left_joint", "gripper_right_joint"}
    scene = cp.Scene(robot, robot.loops)
    assert scene.nominal.mobility == robot.nv - 12


# The copy that Pinocchio reads --------------------------------------------------------------------

OTHERS = {"alex_psyonic_hands.urdf", "ur3.urdf"}  # an unknown joint is mimicked; no name


def without_bounds(path):
    """The wheels of Centauro, for one."""
    for element in ElementTree.parse(path).getroot().findall("joint"):
        limit = element.find("limit")
        if element.get("type") in ("revolute", "prismatic") and not {"lower", "upper"} & set(
            limit.attrib
        ):
            yield element.get("name")


def test_every_urdf_of_example_robot_data_is_read_as_pinocchio_reads_it():
    paths = [p for p in example_robot_data().rglob("*.urdf") if p.name not in OTHERS]
    assert len(paths) > 60
    for path in paths:
        expected = pin.buildModelFromUrdf(str(path))
        for name in without_bounds(path):  # Pinocchio locks them
            iq = expected.joints[expected.getJointId(name)].idx_q
            assert expected.upperPositionLimit[iq] == 0.0
            lower, upper = expected.lowerPositionLimit.copy(), expected.upperPositionLimit.copy()
            lower[iq], upper[iq] = -np.finfo(float).max, np.finfo(float).max
            expected.lowerPositionLimit, expected.upperPositionLimit = lower, upper
        assert read_urdf(path).model == expected, path


@pytest.mark.long
def test_what_is_not_read_does_no_harm(read):
    mesh = '<geometry><mesh filename="package://nowhere/x.stl" scale="nan 1"/></geometry>'
    junk = f"<visual>{mesh}</visual><collision>{mesh}</collision>"
    materials = '<material name="red"/><material name="red"><color rgba="x"/></material>'
    robot = read(*SWING[:3], materials, link("c", SWING[3][15:-7] + junk), *SWING[4:])
    assert robot.model == read(*SWING).model


# What is wrong with a file ------------------------------------------------------------------------

NAN = '<origin xyz="0 nan 0"/>'
LIMIT = '<limit lower="1" upper="-1" effort="1" velocity="1"/>'
WRONG = {
    "no <link>": (),
    "two <link> are named 'a'": (*SWING, link("a")),
    "two <joint> are named 'left'": (*SWING, link("d"), joint("left", "c", "d")),
    "a <link> has no name": (*SWING, link("")),
    "'new': no joint type named 'wobbly'": (
        *SWING, link("d"), joint("new", "c", "d", kind="wobbly"),
    ),
    "did you mean 'revolute'": (*SWING, link("d"), joint("new", "c", "d", kind="revolut")),
    "<parent>: no link named 'q'": (*SWING, link("d"), joint("new", "q", "d")),
    "<child>: no link named 'q'": (*SWING, joint("new", "a", "q")),
    "no <child link=...>": (*SWING, joint("new", "a", "")),
    "the links 'beam', 'd' have no parent joint": (*SWING, link("d")),
    "no link has no parent joint": (link("a"), joint("j", "a", "a")),
    "no joint leads from 'beam' to the links ['d', 'e']": (
        *SWING, link("d"), link("e"), joint("x", "d", "e"), joint("y", "e", "d"),
    ),
    "<origin xyz> is '0 nan 0'": (*SWING, link("d"), joint("new", "a", "d", NAN)),
    "<axis xyz> is zero": (*SWING, link("d"), joint("new", "a", "d", '<axis xyz="0 0 0"/>')),
    "<axis xyz> is '0 1'": (*SWING, link("d"), joint("new", "a", "d", '<axis xyz="0 1"/>')),
    "<axis xyz> is None": (*SWING, link("d"), joint("new", "a", "d", "<axis/>")),
    "needs <limit": (*SWING, link("d"), joint("new", "a", "d", kind="revolute")),
    "limits 1 to 0; the upper one is not there": (
        *SWING, link("d"),
        joint("new", "a", "d", '<limit lower="1" effort="1" velocity="1"/>', "revolute"),
    ),
    "limits 1 to -1; exchange": (*SWING, link("d"), joint("new", "a", "d", LIMIT, "prismatic")),
    "<dynamics damping> is 'much'": (
        *SWING, link("d"), joint("new", "a", "d", '<dynamics damping="much"/>'),
    ),
    "<inertial> has no <mass>": (
        *SWING, link("d", f"<inertial>{INERTIA}</inertial>"), joint("new", "a", "d"),
    ),
    "<inertial> has no <inertia>": (
        *SWING, link("d", '<inertial><mass value="1"/></inertial>'), joint("new", "a", "d"),
    ),
    "<inertia iyz> is None": (
        *SWING,
        link("d", '<inertial><mass value="1"/><inertia ixx="1"/></inertial>'.replace(
            "ixx=", 'ixx="1" ixy="0" ixz="0" iyy="1" izz=')),
        joint("new", "a", "d"),
    ),
    "<mass value=-1>: it must not be negative": (
        *SWING, link("d", f'<inertial><mass value="-1"/>{INERTIA}</inertial>'),
        joint("new", "a", "d"),
    ),
    "no inertia moves with new": (*SWING, link("d", ""), joint("new", "a", "d")),
    "<mimic>: no joint named 'lef'; did you mean 'left'": (
        *SWING, link("d"), joint("new", "a", "d", '<mimic joint="lef"/>'),
    ),
    "<mimic>: joint 'closing_bar_1_frame' is fixed": (
        *SWING, link("d"), joint("new", "a", "d", '<mimic joint="closing_bar_1_frame"/>'),
    ),
    "it mimics itself": (*SWING, link("d"), joint("new", "a", "d", '<mimic joint="new"/>')),
    "<mimic multiplier=0> locks it": (
        *SWING, link("d"), joint("new", "a", "d", '<mimic joint="left" multiplier="0"/>'),
    ),
    "<mimic offset> is 'x'": (
        *SWING, link("d"), joint("new", "a", "d", '<mimic joint="left" offset="x"/>'),
    ),
    "the name 'universe' is the world's": (*SWING, link("universe"), joint("n", "a", "universe")),
    "<origin> is there 2 times": (
        *SWING, link("d"), joint("new", "a", "d", '<origin xyz="1 0 0"/><origin/>'),
    ),
}  # fmt: skip


@each_row("sentence", WRONG)
def test_what_is_wrong_is_said(read, sentence):
    with pytest.raises(cp.errors.InvalidModel, match=re.escape(sentence)):
        read(*WRONG[sentence])


@pytest.mark.long
def test_a_root_link_named_world_stands_still_or_is_refused(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="r">{link("world")}{link("a")}{joint("j", "world", "a")}</robot>')
    assert cp.load_robot(path).frame("world")[0] == 0
    with pytest.raises(cp.errors.InvalidModel, match="the name 'world' is the world's"):
        cp.load_robot(path, root_joint="free_flyer")


@pytest.mark.long
def test_a_negative_moment_is_doubted(read):
    odd = link("d").replace('"0.001"', '"-0.001"')
    robot = read(*SWING, odd, joint("new", "a", "d", kind="fixed"))
    assert any("doubts about the inertia of d" in text for text in robot.unused)


@pytest.mark.long
def test_a_body_that_no_solid_is_is_doubted_where_it_is_fixed_and_refused_where_it_moves(read):
    for old, new, text in (
        ('"0.001"', '"-0.0001"', "the principal moment -0.0001 kg m^2 is negative"),
        ('value="1"', 'value="0"', "there is a moment of inertia and no mass"),
    ):
        odd = link("d").replace(old, new)
        robot = read(*SWING, odd, joint("new", "a", "d", kind="fixed"))
        assert any(f"inertia of d: {text}" in sentence for sentence in robot.unused)
    with pytest.raises(cp.errors.InvalidModel, match=r"'new' has the principal moment -0\.1 kg"):
        read(*SWING, link("d").replace('"0.001"', '"-0.1"'), joint("new", "a", "d"))
    with pytest.raises(
        cp.errors.InvalidModel, match=r"'new' has a moment of inertia, .* and no mass"
    ):
        read(*SWING, link("d").replace('value="1"', 'value="0"'), joint("new", "a", "d"))
    robot = read(*SWING, link("d").replace('"0.001"', '"0.1"'), joint("new", "a", "d"))
    assert any("inertia of d: the principal moments" in text for text in robot.unused)


@pytest.mark.long
def test_all_that_is_not_read_is_listed(read):
    extra = '<safety_controller k_velocity="1"/><calibration rising="0"/>'
    robot = read(
        *SWING,
        link("d").replace("</link>", "<visual/><visual/><collision/></link>"),
        joint("new", "a", "d", f'{extra}<dynamics damping="1" spring_stiffness="3"/>'),
        "<foo/><gazebo/><!-- a comment -->",
    )
    assert (
        "elements that are not read: 1 <calibration>, 1 <collision>, 1 <foo>, 1 <safety_controller>"
    ) in robot.unused
    assert "attributes that are not read: 1 spring_stiffness of <dynamics>" in robot.unused


@pytest.mark.long
def test_mimics_and_halves_that_do_nothing_are_listed(read):
    still = joint("new", "a", "d", '<mimic joint="left"/>', "fixed")
    robot = read(*SWING, link("d"), still, tip("closing_bar_3", "a", "0 0 0"))
    assert "mimic of fixed joints (new)" in robot.unused
    assert any("'closing_bar_3': it does not end in _1 or _2" in text for text in robot.unused)


def test_joints_that_mimic_in_a_circle_are_refused(read):
    right, left = '<mimic joint="right"/>', '<mimic joint="left"/>'
    with pytest.raises(
        cp.errors.InvalidModel, match="'left', 'right' mimic each other in a circle"
    ):
        read(
            link("beam", ""),
            *SWING[1:3],
            joint("left", "beam", "a", right),
            joint("right", "beam", "b", left),
        )


# Files made at random -----------------------------------------------------------------------------


@given(seed=st.integers(0, 2**32))
@settings(max_examples=5, suppress_health_check=list(HealthCheck))
def test_a_spoilt_urdf_is_refused_or_read(tmp_path, seed):
    assert_survived(tmp_path, "robot.urdf", f'<robot name="r">{"".join(SWING)}</robot>', seed)
