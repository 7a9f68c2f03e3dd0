"""The SDF reader: what it says about a wrong file or argument."""

from __future__ import annotations

import re

import pinocchio as pin
import pytest
from sdf_texts import AB, AXIS, INERTIAL, LOOP, axis, closures, joint, link, pose
from shared import each_row

from condyn_pin.errors import InvalidModel, UnknownName
from condyn_pin.io.sdf import read_sdf

pytestmark = pytest.mark.once


def moving(inside: str) -> str:
    return link("a") + link("b", inside) + joint("j", "a", "b")


WRONG = {
    "a pose that is relative to itself": (
        link("a", pose("", relative_to="b")) + link("b", pose("", relative_to="a")), "circle",
    ),
    "a frame attached to itself": (link("a") + '<frame name="f" attached_to="f"/>', "circle"),
    "a pose relative to nothing known": (link("arm", pose("", relative_to="amr")), "'amr'"),
    "an axis in an unknown frame": (
        AB + joint("j", "a", "b", inside='<axis><xyz expressed_in="k">0 0 1</xyz></axis>'),
        "<joint> 'j'.*'k'",
    ),
    "an inertial pose in an unknown frame": (
        moving(INERTIAL.replace("<mass>", pose("", relative_to="k") + "<mass>")), "<link> 'b'.*'k'",
    ),
    "a model placed in an unknown frame": (pose("", relative_to="k") + AB, "'k'"),
    "two links of one name": (link("a") * 2, "rename"),
    "a link and a joint of one name": (AB + joint("a", "a", "b"), "rename"),
    "a link without a name": ('<link name=""/>', "name"),
    "a link called world": (link("world"), "'world'"),
    "a link named as a closure's frame": (
        LOOP + joint("cut", "b", "c", "ball") + '<frame name="cut_a"/>', "'cut_a'",
    ),
    "a link named as Pinocchio's universe": (link("universe"), "'universe'"),
    "a joint without a parent": (
        AB + '<joint name="j" type="ball"><child>b</child></joint>', "'j': no <parent>",
    ),
    "a joint without a child": (
        AB + '<joint name="j" type="ball"><parent>b</parent></joint>', "'j': no <child>",
    ),
    "a joint with two children": (
        AB + joint("j", "a", "b", inside="<child>a</child>" + AXIS), "<child> is there 2 times",
    ),
    "a joint with an unknown parent": (AB + joint("j", "aa", "b"), "'j'.*'aa'"),
    "a joint with an unknown child": (AB + joint("j", "a", "bb"), "'j'.*'bb'"),
    "a joint of a link with itself": (AB + joint("j", "a", "a"), "'j'.*another child"),
    "a joint whose child is the world": (AB + joint("j", "a", "world"), "'j'.*another child"),
    "a moving link of mass zero": (moving(INERTIAL.replace(">2<", ">0<")), "'b' moves.*0 kg"),
    "a moving link of negative mass": (moving(INERTIAL.replace(">2<", ">-2<")), "-2 kg"),
    "an inertia that is not positive": (
        moving(INERTIAL.replace("<ixx>0.1", "<ixx>-0.1")), "principal moment -0.1",
    ),
    "a mass that others compute": (moving('<inertial auto="true"/>'), "<inertial auto>"),
    "a mass that is no number": (moving(INERTIAL.replace(">2<", ">two<")), "'b'.*'two'"),
    "a mass that is empty": (moving(INERTIAL.replace(">2<", "><")), "'b'.*mass.*1 number"),
    "a number as only Python reads it": (moving(INERTIAL.replace(">2<", ">1_0<")), "1_0"),
    "a mass that is infinite": (moving(INERTIAL.replace(">2<", ">inf<")), "finite"),
    "a pose that is not a number": (link("a", pose("0 0 nan 0 0 0")), "finite"),
    "a limit that is not a number": (
        AB + joint("j", "a", "b", inside=axis("<lower>nan</lower>")), "finite",
    ),
    "a pose of five numbers": (link("a", pose("0 0 0 0 0")), "'a'.*6 number"),
    "a pose in degrees that are none": (
        link("a", pose("0 0 0 0 0 90", degrees="yes")), "'a': <pose>, degrees, is 'yes'",
    ),
    "a pose in other angles": (
        link("a", pose("0 0 0 0 0 0", rotation_format="euler_zyx")), "'a'.*'euler_zyx'.*quat_xyzw",
    ),
    "a quaternion of six numbers": (
        link("a", pose("0 0 0 0 0 1", rotation_format="quat_xyzw")), "'a'.*7 number",
    ),
    "a quaternion of zeros": (
        link("a", pose("0 0 0 0 0 0 0", rotation_format="quat_xyzw")), "'a'.*length 0; make it 1",
    ),
    "a quaternion in degrees": (
        link("a", pose("0 0 0 0 0 0 1", rotation_format="quat_xyzw", degrees="1")), "one of the",
    ),
    "an axis of two numbers": (
        AB + joint("j", "a", "b", inside="<axis><xyz>0 1</xyz></axis>"), "'j'.*3 number",
    ),
    "an axis of length zero": (
        AB + joint("j", "a", "b", inside="<axis><xyz>0 0 0</xyz></axis>"), "'j'.*direction",
    ),
    "a hinge without axis": (AB + joint("j", "a", "b", inside=""), "'j'.*<axis/xyz>"),
    "a flag that is no flag": (
        AB + joint("j", "a", "b", inside="<axis><xyz>0 0 1</xyz>"
        "<use_parent_model_frame>yes</use_parent_model_frame></axis>"), "'yes'",
    ),
    "limits the wrong way round": (
        AB + joint("j", "a", "b", inside=axis("<lower>1</lower><upper>-1</upper>")),
        "'j'.*exchange",
    ),
    "links that no joint connects": (AB, "no joint leads from 'a' to the links 'b'"),
    "an island of links": (
        LOOP + link("d") + link("e") + joint("de", "d", "e", "ball") + joint("ed", "e", "d"),
        "no joint leads from 'a' to the links 'd', 'e'",
    ),
    "a link beside one fixed to the world": (
        AB + joint("wa", "world", "a", "fixed"), "no joint leads from 'world' to the links 'b'",
    ),
    "a model without links": ("", "no <link>"),
    "a model inside the model without links": (
        link("a") + '<model name="m"/>', "<model> 'm': no <link>",
    ),
    "a model inside the model that stands still": (
        link("a") + f'<model name="m"><static>1</static>{link("a")}</model>',
        "<model> 'm' in the model is <static>: fix its links",
    ),
    "a model inside the model of a taken name": (
        link("a") + f'<model name="a">{link("a")}</model>', "rename",
    ),
    "a part of a model that is not there": (
        AB + f'<model name="m">{link("a")}</model>' + joint("j", "a", "m::b"), "'m::b'",
    ),
    "a part outside of the model that names it": (
        link("out") + f'<model name="m">{link("a", pose("", relative_to="out"))}</model>',
        "'a'.*'m::out'",
    ),
    "a placement frame that is not there": (
        link("a") + f'<model name="m" placement_frame="tip">{link("a")}</model>', "'m::tip'",
    ),
    "an include inside the model": (
        link("a") + "<include><uri>model://arm</uri></include>",
        "<model> 'robot' has <include> 'model://arm'.*write out",
    ),
    "a flag of a link that is none": (link("a", "<gravity>maybe</gravity>"), "'maybe'.*true"),
    "a negative friction": (
        AB + joint("j", "a", "b", inside=axis("", "<friction>-1</friction>")), "'j'.*friction",
    ),
    "a joint without a type": (AB + joint("j", "a", "b", ""), "'j' has the type ''"),
}  # fmt: skip


@each_row(("body", "says"), WRONG)
def test_a_wrong_model_is_refused_with_the_reason(read, body, says):
    with pytest.raises(InvalidModel, match=rf"robot\.sdf: .*{says}"):
        read(body)


@pytest.mark.long
@each_row("kind", ["planar", "spring", "floating", "Revolute"])
def test_a_joint_of_an_unsupported_type_is_named_with_what_would_do(read, kind):
    with pytest.raises(InvalidModel, match=f"'j' has the type '{kind}'.*kinds.*drop"):
        read(AB + joint("j", "a", "b", kind))
    assert read(AB + joint("j", "a", "b", kind), kinds={"j": "revolute"}).model.nv == 1


@pytest.mark.long
def test_a_joint_that_is_left_out_may_be_of_any_type(read):
    robot = read(LOOP + joint("bc", "b", "c", "screw", ""), drop=["bc"])
    assert closures(robot) == ()
    assert robot.unused == ("joints left out: 'bc'",)


@pytest.mark.long
def test_two_things_named_like_the_root_joint_are_refused(read):
    body = AB + joint("root_joint", "a", "b")
    with pytest.raises(InvalidModel, match="'root_joint'"):
        read(body, root_joint=pin.JointModelFreeFlyer())
    assert read(body).model.nv == 1


def test_a_root_that_is_not_the_one_on_the_world_is_refused(read):
    with pytest.raises(InvalidModel, match="root 'b' is not"):
        read(AB + joint("wa", "world", "a") + joint("ab", "a", "b"), root="b")


@each_row(
    ("options", "says"),
    [
        ({"root": "aa"}, "no link named 'aa'"),
        ({"drop": ["jj"]}, "no joint named 'jj'; did you mean 'j'"),
        ({"kinds": {"jj": "ball"}}, "no joint named 'jj'; did you mean 'j'"),
        ({"kinds": {"j": "bal"}}, "no joint type named 'bal'; did you mean 'ball'"),
        ({"actuated": ["jj"]}, "no joint named 'jj'; did you mean 'j'"),
        ({"cut": ["jj"]}, "no joint named 'jj'; did you mean 'j'"),
    ],
)
def test_an_unknown_name_in_an_argument_is_answered_with_the_known_ones(read, options, says):
    with pytest.raises(UnknownName, match=re.escape(says)):
        read(AB + joint("j", "a", "b"), **options)


FILES = {
    "no XML": ("this is no XML", "read as XML"),
    "an empty file": ("", "read as XML"),
    "a tag that is not closed": ('<sdf version="1.7"><model name="m">', "read as XML"),
    "another format": ('<robot name="r"/>', "<robot>"),
    "no version": ('<sdf><model name="m"><link name="a"/></model></sdf>', "version ''"),
    "an old version": ('<sdf version="1.3"/>', "'1.3'; 1.4 or later"),
    "a version that is none": ('<sdf version="new"/>', "'new'; 1.4 or later"),
    "only what is included": (
        '<sdf version="1.7"><world name="w"><include><uri>model://arm</uri></include></world></sdf>',
        "no <model>, but <include> 'model://arm', not found in its folder",
    ),
    "no model": ('<sdf version="1.7"><world name="w"/></sdf>', "no <model>"),
    "two models": (
        '<sdf version="1.7"><model name="m"/><model name="n"/></sdf>',
        "'m', 'n', which can move; choose one with model='m'",
    ),
}


@each_row(("text", "says"), FILES)
def test_a_file_that_is_not_one_sdf_model_is_refused_with_the_reason(tmp_path, text, says):
    path = tmp_path / "robot.sdf"
    path.write_text(text)
    with pytest.raises(InvalidModel, match=rf"robot\.sdf: .*{says}"):
        read_sdf(path)


@pytest.mark.long
def test_a_file_that_does_not_exist_is_refused_by_name(tmp_path):
    with pytest.raises(InvalidModel, match=r"nowhere\.sdf: cannot be opened: No such file"):
        read_sdf(tmp_path / "nowhere.sdf")
    with pytest.raises(InvalidModel, match="cannot be opened: Is a directory"):
        read_sdf(tmp_path)
