"""The SDF reader: worlds, models in models, included files, and what is not modelled."""

from __future__ import annotations

import os

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from sdf_texts import AB, INERTIAL, ROUNDING, T, frame_poses, joint, link, pose
from shared import each_row

import condyn_pin as cp
from condyn_pin.errors import InvalidArgument, InvalidModel, UnknownName, UnmodelledWarning
from condyn_pin.io.sdf import read_sdf
from condyn_pin.io.sdf_parts import links_in
from condyn_pin.io.shapes import shapes_of

ARM = AB + joint("j", "a", "b")
GROUND = '<model name="ground"><static>true</static><link name="a"/></model>'


def model(name: str, inside: str = ARM, **attributes: str) -> str:
    said = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<model name="{name}"{said}>{inside}</model>'


def world(inside: str, gravity: str = "<gravity>0 0 -1.62</gravity>") -> str:
    return f'<world name="w">{gravity}{inside}</world>'


@pytest.fixture
def file(tmp_path):
    """Write an SDF file, and return its path."""

    def write(inside: str, version: str = "1.9", name: str = "robot.sdf"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'<sdf version="{version}">{inside}</sdf>')
        return path

    return write


# Gravity ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inside", "version", "gravity"),
    [
        (world(model("m")), "1.10", (0, 0, -1.62)),
        (world(model("m"), "<physics><gravity>1 2 3</gravity></physics>"), "1.5", (1, 2, 3)),
        (world(model("m"), "<physics><gravity>1 2 3</gravity></physics>"), "1.6", (0, 0, -9.8)),
        (world("") + model("m"), "1.9", (0, 0, -1.62)),
        (world(model("m"), ""), "1.9", (0, 0, -9.8)),
        (model("m"), "1.9", (0, 0, -9.81)),
    ],
)
def test_gravity_is_that_of_the_world(file, inside, version, gravity):
    robot = read_sdf(file(inside, version))
    assert tuple(robot.model.gravity.linear) == gravity
    assert any("gravity is left out" in said for said in robot.unused) == (gravity[2] == -9.8)


def test_links_that_do_not_weigh_are_modelled_if_all_of_them_do_not(file):
    light = INERTIAL + "<gravity>0</gravity>"
    body = link("a") + link("b", light) + joint("ab", "a", "b")
    robot = read_sdf(file(world(model("m", body))))
    assert not robot.model.gravity.vector.any()  # a stands still
    assert robot.unmodelled == ()
    body += link("c") + joint("bc", "b", "c")
    path = file(world(model("m", body)))
    robot = read_sdf(path)
    assert robot.model.gravity.linear[2] == -1.62
    assert robot.unmodelled == ("links without gravity: 'b'; here they weigh",)
    with pytest.warns(UnmodelledWarning, match="without gravity: 'b'"):
        assert cp.load_robot(path).unmodelled == robot.unmodelled


# Which model ------------------------------------------------------------------------------------


@pytest.mark.long
def test_the_only_model_of_a_world_that_moves_is_the_robot(file):
    sun = "<include><uri>model://sun</uri></include>"
    robot = read_sdf(file(world(GROUND + sun + "<light/>" + model("m"))))
    assert robot.name == robot.model.name == "m"
    assert robot.unused == (
        "static models, which stand around: 'ground'",
        "includes without a model, or not in the folder of the file: 'model://sun'",
        "elements that are not read: 1 <light>",
    )


@pytest.mark.long
def test_one_of_several_models_is_chosen_by_name(file):
    path = file(world(GROUND + model("m") + model("n", pose("1 0 0 0 0 0") + ARM)))
    with pytest.raises(InvalidModel, match=r"models 'm', 'n', which can move.*model='m'"):
        cp.load_robot(path)
    robot = cp.load_robot(path, model="n")
    assert robot.name == "n"
    assert robot.frame_pose(np.zeros(1), "a").translation[0] == 1
    assert "other models: 'm'" in robot.unused
    with pytest.raises(UnknownName, match="no model named 'o'"):
        cp.load_robot(path, model="o")
    with pytest.raises(InvalidModel, match=r"<static> models do not move: 'ground'; take"):
        cp.load_robot(path, model="ground")
    with pytest.raises(InvalidArgument, match="model = 3: the name of a <model>"):
        cp.load_robot(path, model=3)
    with pytest.raises(InvalidArgument, match=r"model = 'm'.*'solo12' is none"):
        cp.load_robot("solo12", model="m")


@pytest.mark.long
def test_a_robot_toml_chooses_a_model(file, tmp_path):
    file(world(model("m") + model("n")))
    toml = tmp_path / "robot.toml"
    toml.write_text('name = "r"\n[description]\nfile = "robot.sdf"\nmodel = "n"\n')
    assert "other models: 'm'" in cp.load_robot(tmp_path).unused


@pytest.mark.long
def test_models_that_stand_still_are_no_robot(file):
    with pytest.raises(InvalidModel, match=r"<static> models do not move: 'm'; take <static> out"):
        read_sdf(file(model("m", "<static>1</static>" + ARM)))
    with pytest.raises(InvalidModel, match=r"'m', 'm', which can move.*rename those"):
        read_sdf(file(world(model("m") * 2)), model="m")


def test_a_model_without_a_joint_that_moves_may_float(file):
    path = file(model("m", AB + joint("j", "a", "b", "fixed", "")))
    with pytest.raises(InvalidModel, match=r"robot\.sdf: .*no degree of freedom.*floating=True"):
        cp.load_robot(path)
    assert cp.load_robot(path, floating=True).nv == 6


@pytest.mark.long
def test_a_world_of_many_models_is_refused_in_a_few_words(file):
    many = "".join(model(f"m{i}", link("a")) for i in range(1000))
    with pytest.raises(InvalidModel, match=r"'m7', \.\.\., which can move") as error:
        read_sdf(file(world(many)))
    assert len(str(error.value)) < 400


@pytest.mark.long
def test_a_path_that_is_none_is_refused(tmp_path):
    os.symlink("round.sdf", tmp_path / "round.sdf")
    for path in (tmp_path / "round.sdf", tmp_path / "a\0b.sdf", tmp_path / ("x" * 5000 + ".sdf")):
        with pytest.raises(InvalidModel, match="cannot be"):
            read_sdf(path)


# Models in models -------------------------------------------------------------------------------

HAND = (
    link("palm", pose("0 0.1 0 0 0 0.3") + INERTIAL)
    + link("finger", pose("0.2 0 0 0.1 0 0", relative_to="palm") + INERTIAL)
    + '<frame name="tip" attached_to="finger">' + pose("0.1 0 0 0 0.5 0") + "</frame>"
    + joint("knuckle", "palm", "finger", inside=(
        pose("0 0 0.1 0 0 0", relative_to="__model__")
        + '<axis><xyz expressed_in="__model__">1 2 0</xyz></axis>'))
)  # fmt: skip
WRIST = joint("wrist", "a", "hand::palm") + '<frame name="at" attached_to="hand::tip"/>'
HAND_AT, IN_HAND = T(1, 0, 0.5, 0, 0.4, 0), T(0, 0.1, 0, 0, 0, 0.3) @ T(0.2, 0, 0, 0.1, 0, 0)
PLACED = pose("1 0 0.5 0 0.4 0")


def test_a_model_in_the_model_is_a_part_of_it(read):
    robot = read(link("a") + model("hand", PLACED + HAND) + WRIST)
    assert list(robot.model.names)[1:] == ["wrist", "hand::knuckle"]
    at = frame_poses(robot.model, np.zeros(2))
    tip = HAND_AT @ IN_HAND @ T(0.1, 0, 0, 0, 0.5, 0)
    for name, expected in {"hand": HAND_AT, "hand::tip": tip, "at": tip}.items():
        np.testing.assert_allclose(at[name], expected, atol=ROUNDING)
    joint_frame = HAND_AT @ T(0, 0, 0.1, 0, 0, 0)
    np.testing.assert_allclose(at["hand::knuckle"][:3, 3], joint_frame[:3, 3], atol=ROUNDING)
    turned = frame_poses(robot.model, np.array([0, 0.7]))
    axis = HAND_AT[:3, :3] @ [1, 2, 0] / np.sqrt(5)
    R = turned["hand::finger"][:3, :3] @ at["hand::finger"][:3, :3].T
    np.testing.assert_allclose(pin.log3(R), 0.7 * axis, atol=ROUNDING)


@pytest.mark.long
@pytest.mark.parametrize("deep", [False, True])
def test_a_placement_frame_is_where_the_pose_puts_it(read, deep):
    hand = model("hand", PLACED + HAND, placement_frame="tip")
    frame = "hand::tip"
    if deep:
        hand, frame = model("arm", hand + PLACED, placement_frame="hand::palm"), "arm::hand::palm"
    body = link("a") + hand + joint("w", "a", frame)
    robot = read(body, root="a")
    at = frame_poses(robot.model, np.zeros(2))
    np.testing.assert_allclose(at[frame], HAND_AT, atol=ROUNDING)
    if deep:
        inner = np.linalg.inv(at["arm"]) @ at["arm::hand::tip"]
        np.testing.assert_allclose(inner, HAND_AT, atol=ROUNDING)


@pytest.mark.long
def test_a_placement_frame_of_the_model_itself(file):
    robot = read_sdf(file(model("m", PLACED + HAND, placement_frame="tip")))
    at = frame_poses(robot.model, np.zeros(1))
    np.testing.assert_allclose(at["tip"], HAND_AT, atol=ROUNDING)


@pytest.mark.long
def test_the_parts_of_models_stand_in_the_order_of_the_file(read):
    body = link("a") + "".join(model(name, link("l")) for name in ("x", "y", "z"))
    robot = read(body + "".join(joint(f"j{n}", "a", f"{n}::l") for n in ("x", "y", "z")))
    bodies = [f.name for f in robot.model.frames if f.type == pin.FrameType.BODY]
    assert bodies == ["a", "x::l", "y::l", "z::l"]


@pytest.mark.long
def test_more_models_in_each_other_than_any_file_has_are_refused(read):
    body = link("a")
    for _ in range(40):
        body = model("m", body)
    with pytest.raises(InvalidModel, match="more than 30 models, each in another"):
        read(body)


# Included files ---------------------------------------------------------------------------------


def include(uri: str, *said: str) -> str:
    return f"<include><uri>{uri}</uri>{''.join(said)}</include>"


@pytest.mark.parametrize("uri", ["model://hand", "hand", "hand/model.sdf"])
def test_an_included_model_is_read_from_the_folder_of_the_file(file, read, uri):
    file(model("gripper", HAND), name="hand/model.sdf")
    included = include(uri, "<name>hand</name>", PLACED)
    robot = read_sdf(file(model("robot", link("a") + included + WRIST)))
    written = read(link("a") + model("hand", PLACED + HAND) + WRIST)
    assert robot.model == written.model


@pytest.mark.long
def test_an_include_may_pose_a_frame_and_be_the_robot_of_a_world(file):
    file(model("gripper", HAND), name="hand/model.sdf")
    said = "<placement_frame>tip</placement_frame>", PLACED
    robot = read_sdf(file(world(include("model://hand", *said))))
    at = frame_poses(robot.model, np.zeros(1))
    np.testing.assert_allclose(at["tip"], HAND_AT, atol=ROUNDING)
    still = include("model://hand", "<static>true</static>")
    with pytest.raises(InvalidModel, match="do not move: 'gripper'"):
        read_sdf(file(world(still)))


@pytest.mark.long
def test_an_included_file_may_include_one_beside_itself(file):
    file(model("b", link("b")), name="parts/b/model.sdf")
    file(
        model("a", AB + include("model://b", "<name>c</name>") + joint("j", "a", "b")),
        name="parts/a/model.sdf",
    )
    robot = read_sdf(file(model("r", link("o") + include("parts/a") + joint("w", "o", "a::a")
                                + joint("x", "o", "a::c::b"))))  # fmt: skip
    assert set(list(robot.model.names)[1:]) == {"w", "a::j", "x"}


def test_nothing_outside_of_the_folder_of_the_file_is_read(file, tmp_path):
    outside = file(model("b", link("b")), name="outside/model.sdf")
    os.symlink(outside.parent, (tmp_path / "in").mkdir() or tmp_path / "in" / "link")
    os.symlink("round", tmp_path / "in" / "round")
    for uri in (
        "round",
        "x" * 5000,
        "model://../outside",
        str(outside),
        f"file://{outside}",
        "model://link",
        "",
        ".",
    ):
        path = file(model("m", link("a") + include(uri)), name="in/robot.sdf")
        with pytest.raises(InvalidModel, match="brings no model from the folder of the file"):
            read_sdf(path)


def test_files_that_include_each_other_are_refused(file):
    path = file(model("m", link("a") + include("robot.sdf")))
    with pytest.raises(InvalidModel, match="more than 30 models, each in another"):
        read_sdf(path)
    twice = include("robot.sdf", "<name>x</name>") + include("robot.sdf", "<name>y</name>")
    with pytest.raises(InvalidModel, match=r"more than 1000 files|more than 30 models"):
        read_sdf(file(model("m", link("a") + twice)))
    file('<model name="p"/><model name="q"/>', name="two.sdf")
    with pytest.raises(InvalidModel, match=r"two\.sdf: 2 <model> in an included file"):
        read_sdf(file(model("m", link("a") + include("two.sdf"))))


def test_a_merged_model_has_its_parts_in_the_one_around_it(file, read):
    file(model("gripper", HAND), name="hand/model.sdf")
    merged = include("hand", "<name>hand</name>", PLACED).replace(
        "<include", '<include merge="true"'
    )
    robot = read_sdf(file(model("robot", link("a") + merged + joint("wrist", "a", "palm"))))
    apart = read(link("a") + model("hand", PLACED + HAND) + WRIST)
    assert [*robot.model.names] == [name.removeprefix("hand::") for name in apart.model.names]
    q = np.full(robot.model.nq, 0.3)
    poses, others = (frame_poses(each.model, q) for each in (robot, apart))
    for name in ("palm", "tip"):
        np.testing.assert_allclose(poses[name], others[f"hand::{name}"], atol=ROUNDING)
    assert "_merged__hand__model__" in poses


def test_the_newest_file_of_a_model_config_is_included(file, tmp_path):
    for name in ("old", "new"):
        file(model("m", link(name)), name=f"hand/{name}.sdf")
    files = '<sdf version="1.10">new.sdf</sdf><sdf version="1.9">old.sdf</sdf>'
    (tmp_path / "hand" / "model.config").write_text(f"<model>{files}</model>")
    robot = read_sdf(file(model("r", link("a") + include("hand") + joint("j", "a", "m::new"))))
    assert robot.model.existFrame("m::new")


LENIENT = {
    "a comment with dashes": "<!-- gz topic --msgtype a -- b -->",
    "a prefix that nothing declares": "<gz:system_priority>3</gz:system_priority>",
    "an attribute of one": '<frame name="f" gz:expressed_in="x"/>',
}


def test_a_macro_whose_prefix_nothing_declares_is_refused():
    text = '<robot name="r"><link name="a"/><xacro:arm side="left"/></robot>'
    with pytest.raises(InvalidModel, match="<xacro:arm>: a macro; expand it"):
        cp.load_robot(text)


@pytest.mark.parametrize("case", LENIENT)
def test_what_simulators_read_as_xml_is_read(tmp_path, case):
    path = tmp_path / "robot.sdf"
    path.write_text(
        f'\n<?xml version="1.0"?>\n<sdf version="1.9">{model("m", LENIENT[case] + ARM)}</sdf>'
    )
    assert read_sdf(path).model.nv == 1


@pytest.mark.long
def test_what_drake_adds_is_named(tmp_path, read):
    rotor = "<drake:rotor_inertia>0.1</drake:rotor_inertia></joint>"
    bushing = '<x:linear_bushing_rpy xmlns:x="drake.mit.edu"><a/></x:linear_bushing_rpy>'
    robot = read(ARM.replace("</joint>", rotor) + bushing)
    assert robot.unmodelled == (
        "Drake's bushings: 'robot'",
        "Drake's rotors behind the joints: 'j'",
    )
    assert not any("rotor" in said or "bushing" in said for said in robot.unused)
    inertia = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    text = (
        f'<robot name="r"><link name="a"><inertial>{inertia}</inertial></link><transmission>'
        '<actuator name="m"><drake:rotor_inertia value="0.1"/></actuator></transmission></robot>'
    )
    with pytest.warns(UnmodelledWarning, match=r"<rotor_inertia> \(1\)"):
        cp.load_robot(text, floating=True)


def test_a_joint_of_an_old_file_may_have_the_name_of_a_link(file):
    body = AB + joint("b", "a", "b")
    robot = read_sdf(file(model("m", body), version="1.6"))
    assert robot.model.existJointName("b_joint")
    with pytest.raises(InvalidModel, match="<link> 'b' and <joint> 'b': rename one of them"):
        read_sdf(file(model("m", body), version="1.7"))


@pytest.mark.long
def test_of_several_roots_the_canonical_link_carries_the_tree(read):
    robot = read(AB + link("c") + joint("j", "a", "b") + joint("k", "c", "b"))
    assert robot.model.nv == 2
    assert robot.reversed == ("k",)


# Older files, and what is left out --------------------------------------------------------------


@pytest.mark.long
def test_before_1_5_an_axis_is_in_the_axes_of_the_model(read):
    body = link("a") + link("b", pose("0 0 0 0.3 0.4 0.5") + INERTIAL) + joint("j", "a", "b")
    for version, frame in (("1.4", np.eye(3)), ("1.5", T(0, 0, 0, 0.3, 0.4, 0.5)[:3, :3])):
        at = [frame_poses(read(body, version).model, np.array([q]))["b"] for q in (0.0, 0.7)]
        R = at[1][:3, :3] @ at[0][:3, :3].T
        np.testing.assert_allclose(pin.log3(R), 0.7 * frame[:, 2], atol=ROUNDING)


@pytest.mark.long
def test_the_format_fills_in_inertias(read):
    inertial = "<inertial>" + pose("0.5 0 0 0 0 0") + "<mass>2</mass></inertial>"
    body = link("a", "") + link("b", inertial) + link("c", "")
    robot = read(body + joint("ab", "a", "b") + joint("bc", "b", "c", "fixed", ""))
    M = pin.crba(robot.model, robot.model.createData(), np.zeros(1))
    np.testing.assert_allclose(M, [[1 + 2 * 0.25 + 1]], atol=ROUNDING)
    assert robot.unused == (
        "left out of <inertial>, and 1 kg here, as the format has it: 'c'",
        "left out of <inertial>, and 1 kg m^2 about each axis here, as the format has it: 'b', 'c'",
    )


CHANGES = {
    "<link><enable_wind>": (
        ARM.replace("</link>", "<enable_wind>true</enable_wind></link>", 1),
        "wind on the links: 'a'",
    ),
    "<link><kinematic>": (
        ARM.replace("</link>", "<kinematic>1</kinematic></link>", 1), "links that others move.*'a'",
    ),
    "<velocity_decay>": (
        ARM.replace(
            "</link>", "<velocity_decay><linear>0</linear><angular>0.1</angular></velocity_decay>"
            "</link>", 1,
        ), "decay of the turning of the links: 'a'",
    ),
    "<fluid_added_mass>": (
        ARM.replace(
            "</inertial>", "<fluid_added_mass><xx>0</xx><yy>3</yy></fluid_added_mass></inertial>"
        ), "added mass of the fluid around the links: 'a', 'b'",
    ),
    "<joint><physics>": (
        ARM.replace("</joint>", "<physics><ode><max_force>3</max_force></ode></physics></joint>"),
        "motors in <physics> of the joints: 'j'",
    ),
    "a plugin that drives": (
        ARM + '<plugin name="JointController" filename="x"/>',
        "plugins that may drive it or push: 'JointController'",
    ),
    "a plugin of the world": (
        ARM + "</model><plugin name='B' filename='gz-sim-buoyancy-system'/><model name='s'>"
        "<static>1</static>", "plugins that may drive it or push: 'B'",
    ),
    "wind of the world": (
        ARM + "</model><wind><linear_velocity>0 1 0</linear_velocity></wind><model name='s'>"
        "<static>1</static>", "wind: 'w'",
    ),
    "a joint of the world": (
        ARM + "</model><joint name='x'><parent>m</parent></joint><model name='s'>"
        "<static>1</static>", "joints of the world: 'w'",
    ),
}  # fmt: skip


@each_row(("body", "says"), CHANGES)
def test_what_changes_the_motion_and_is_not_modelled_is_named(file, body, says):
    path = file(world(model("m", body)))
    with pytest.warns(UnmodelledWarning, match=says):
        robot = cp.load_robot(path)
    assert len(robot.unmodelled) == 1
    assert not any("not read" in said for said in robot.unused)


@pytest.mark.long
def test_what_changes_nothing_is_not_said_to(file):
    body = ARM.replace(
        "</link>", "<enable_wind>false</enable_wind><kinematic>0</kinematic>"
        "<velocity_decay><linear>0.0</linear></velocity_decay></link>",
    )  # fmt: skip
    body = body.replace(
        "</joint>", "<physics><ode><max_force>0</max_force></ode></physics></joint>"
    )
    plugins = "<plugin name='P' filename='gz-sim-joint-state-publisher-system'/>"
    plugins += "<plugin name='F' filename='gz-sim-forcetorque-system'/>"
    robot = read_sdf(file(world("<wind><linear_velocity>0 0 0</linear_velocity></wind>"
                                + model("m", body + plugins))))  # fmt: skip
    assert robot.unmodelled == ()
    assert robot.unused[-1] == "plugins: 'P', 'F'"


# What is drawn ----------------------------------------------------------------------------------


def test_only_the_robot_is_drawn_and_what_it_includes(file):
    drawn = "<visual name='v'>" + pose("1 2 3 0 0 90", degrees="true") + (
        "<geometry><box><size>1 1 1</size></box></geometry></visual>")  # fmt: skip
    file(model("hand", link("palm", drawn + INERTIAL)), name="hand/model.sdf")
    body = link("a", drawn) + include("hand") + joint("w", "a", "hand::palm")
    ground = GROUND.replace('<link name="a"/>', link("a", drawn))
    path = file(world(ground + model("m", body)))
    shapes, missing = shapes_of(str(path))
    assert [shape.link for shape in shapes] == ["a", "hand::palm"]
    np.testing.assert_allclose(shapes[0].placement.homogeneous, T(1, 2, 3, 0, 0, np.pi / 2),
                               atol=ROUNDING)  # fmt: skip
    assert missing == ()
    shapes, missing = shapes_of(str(file(world(model("m", body) + model("n", body)))))
    assert shapes == ()
    assert "choose one" in missing[0]


# Several models as one robot --------------------------------------------------------------------

INERTIA = "<inertia><ixx>0.1</ixx><iyy>0.2</iyy><izz>0.15</izz></inertia>"
BODY = f"<inertial><pose>0 0.1 0.2 0 0 0</pose><mass>2</mass>{INERTIA}</inertial>"
TURNTABLE = model(
    "table",
    link("base") + link("top", pose("0 0 0.5 0 0 0") + BODY)
    + joint("turn", "base", "top") + pose("1 2 0 0 0 0.3"),
)  # fmt: skip
LIFT = model(
    "arm",
    link("base", BODY) + link("tool", pose("0 0 0.4 0 0.2 0") + BODY)
    + joint("swing", "base", "tool", inside="<axis><xyz>0 1 0</xyz></axis>")
    + pose("1 2 0.7 0 0 0.3"),
)  # fmt: skip
SLIDE = joint("slide", "table::top", "arm::base", "prismatic")
# The same, by hand: the arm slides on the table.
BY_HAND = """<mujoco><compiler angle="radian" eulerseq="XYZ"/><option gravity="0 0 -1.62"/>
<worldbody>
<body name="top" pos="1 2 0.5" euler="0 0 0.3"><joint name="turn" axis="0 0 1"/>
<inertial pos="0 0.1 0.2" mass="2" diaginertia="0.1 0.2 0.15"/>
<body name="arm::base" pos="0 0 0.2"><joint name="slide" type="slide" axis="0 0 1"/>
<inertial pos="0 0.1 0.2" mass="2" diaginertia="0.1 0.2 0.15"/>
<body name="tool" pos="0 0 0.4" euler="0 0.2 0"><joint name="swing" axis="0 1 0"/>
<inertial pos="0 0.1 0.2" mass="2" diaginertia="0.1 0.2 0.15"/>
</body></body></body></worldbody></mujoco>"""


def test_two_models_of_a_world_are_one_machine(file, tmp_path):
    robot = cp.load_robot(file(world(TURNTABLE + LIFT + SLIDE)), model=["arm", "table"])
    assert robot.name == "arm + table"
    assert robot.joints == ("turn", "slide", "swing")
    links = {f.name for f in robot.model.frames if f.type == pin.FrameType.BODY}
    assert links == {"table::base", "top", "arm::base", "tool"}
    assert robot.loops == robot.unmodelled == ()
    (tmp_path / "same.xml").write_text(BY_HAND)
    mj = mujoco.MjModel.from_xml_path(str(tmp_path / "same.xml"))
    state, M = mujoco.MjData(mj), np.zeros((3, 3))
    rng = np.random.default_rng(0)
    for _ in range(5):
        state.qpos, state.qvel = q, v = rng.uniform(-1, 1, (2, 3))
        mujoco.mj_forward(mj, state)
        for column, row in zip(np.eye(3), M, strict=True):
            mujoco.mj_mulM(mj, state, row, column)
        data = robot.model.createData()
        np.testing.assert_allclose(pin.crba(robot.model, data, q), M, atol=1e-13)
        h = pin.nonLinearEffects(robot.model, data, q, v)
        np.testing.assert_allclose(h, state.qfrc_bias, atol=1e-13)
        placed = robot.frame_pose(q, "tool").translation
        np.testing.assert_allclose(placed, state.body("tool").xpos, atol=1e-13)


@pytest.mark.long
def test_models_that_nothing_joins_stand_apart(file):
    path = file(world(TURNTABLE + LIFT + GROUND))
    robot = cp.load_robot(path, model=["table", "arm"])
    assert robot.joints == ("turn", "swing")
    assert "static models, which stand around: 'ground'" in robot.unused
    alone = {name: cp.load_robot(path, model=name) for name in ("table", "arm")}
    pair = cp.model.together(alone)
    q, v = np.array([0.3, -0.4]), np.array([1.0, 2.0])
    for verb in (pin.crba, pin.nonLinearEffects):
        one, two = (
            verb(r.model, r.model.createData(), q, *([v] if verb is pin.nonLinearEffects else []))
            for r in (robot, pair)
        )
        np.testing.assert_allclose(one, two, atol=1e-14)
    floating = cp.load_robot(path, model=["table", "arm"], floating=True)
    assert floating.joints == ("table::base_root_joint", "turn", "arm::base_root_joint", "swing")
    assert [name for name, *_ in links_in(path, robot.name)] == [
        "table::base", "top", "arm::base", "tool",
    ]  # fmt: skip


def test_a_joint_of_the_world_closes_a_loop_or_holds_a_model(file):
    hinge = joint("hinge", "table::top", "arm::tool")
    anchor = joint("anchor", "world", "arm::base", "fixed", "")
    path = file(world(TURNTABLE + LIFT + SLIDE + hinge + anchor))
    robot = cp.load_robot(path, model=["table", "arm"])
    # the table hangs on the arm, which is anchored, and one joint of the loop is cut
    assert [loop.called for loop in robot.loops] == ["hinge"]
    assert robot.nv == 3
    with pytest.warns(UnmodelledWarning, match="joints of the world: 'w'"):
        alone = cp.load_robot(path, model=["table"])
    assert alone.lost_rows == ("joints of the world: 'w'",)
    assert alone.name == "table"
    assert alone.joints == ("turn",)


@each_row(
    ("names", "error", "words"),
    [
        (["m", "o"], UnknownName, "no model named 'o'"),
        (["m", "ground"], InvalidModel, "<static> models do not move: 'ground'"),
        (["m", "m"], InvalidArgument, "one is there twice"),
        (["m", "far"], InvalidModel, "'m', 'far' are in different worlds"),
        ([], InvalidArgument, r"model = \[\]: the name of a <model>"),
        (["m", 3], InvalidArgument, "the name of a <model>"),
    ],
)
def test_models_that_make_no_robot_are_refused_by_name(file, names, error, words):
    other = f'<world name="other">{model("far")}</world>'
    with pytest.raises(error, match=words):
        cp.load_robot(file(world(GROUND + model("m") + model("n")) + other), model=names)


@pytest.mark.long
def test_a_robot_toml_takes_several(file, tmp_path):
    file(world(TURNTABLE + LIFT + SLIDE))
    toml = tmp_path / "robot.toml"
    toml.write_text('name = "cell"\n[description]\nfile = "robot.sdf"\nmodel = ["table", "arm"]\n')
    assert cp.load_robot(tmp_path).joints == ("turn", "slide", "swing")
    toml.write_text('name = "cell"\n[description]\nfile = "robot.sdf"\nmodel = []\n')
    with pytest.raises(InvalidModel, match="a text or a list of texts"):
        cp.load_robot(tmp_path)


def test_links_that_must_not_touch_are_exclusions(file):
    links = "<self_collide>0</self_collide>" + link("a") + link("b") + joint("j", "a", "b")
    links += link("c", INERTIAL + "<self_collide>1</self_collide>") + joint("k", "b", "c")
    robot = read_sdf(file(model("m", links)))
    assert robot.exclusions == {frozenset("ab")}
    assert robot.unused == ()
    assert read_sdf(file(model("m", links.replace(">0<", ">1<")))).exclusions == frozenset()
