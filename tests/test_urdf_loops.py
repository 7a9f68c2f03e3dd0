"""URDF beyond the tree of hinges: loops as people write them, planes, names and texts."""

from __future__ import annotations

import sys

import numpy as np
import pinocchio as pin
import pytest
from shared import each_row

import condyn_pin as cp
from condyn_pin.errors import UnmodelledWarning

BODY = (
    '<link name="{}"><inertial><origin xyz="0.02 0.01 0.1"/><mass value="1.2"/><inertia ixx="0.02" '
    'iyy="0.025" izz="0.01" ixy="0.001" ixz="0" iyz="0.002"/></inertial></link>'
)
HINGE = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{0}"/>'
    '<origin xyz="{2}"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/>'
    "</joint>"
)
# a four-bar in x-z that is closed as it is drawn; the pin is the tip of its coupler
TIP, END = "0.35 0 0.05", "-0.05 0 0.35"
BARS = (
    '<link name="base"/><link name="pin"/>'
    + "".join(map(BODY.format, ("crank", "coupler", "rocker")))
    + HINGE.format("crank", "base", "0 0 0")
    + HINGE.format("coupler", "crank", "0.1 0 0.3")
    + HINGE.format("rocker", "base", "0.5 0 0")
    + '<joint name="to pin" type="fixed"><parent link="coupler"/><child link="pin"/>'
    f'<origin xyz="{TIP}"/></joint>'
)
CLOSED = {
    "one more parent": (
        '<joint name="c" type="revolute"><parent link="rocker"/><child link="pin"/>'
        f'<origin xyz="{END}"/><axis xyz="0 1 0"/></joint>'
    ),
    "an axis in the parent": (
        '<loop_joint name="c" type="revolute"><parent link="coupler"/><child link="rocker"/>'
        f'<parent_origin xyz="{TIP}" rpy="0 0 1.2"/><child_origin xyz="{END}"/>'
        '<axis xyz="0 1 0" frame="parent"/></loop_joint>'
    ),
    "an axis on each side": (
        '<constraint name="c" type="revolute"><parent link="coupler"/><child link="rocker"/>'
        f'<parent_origin xyz="{TIP}" rpy="0 0 1.5707963267948966"/><parent_axis xyz="1 0 0"/>'
        f'<child_origin xyz="{END}"/><child_axis xyz="0 1 0"/></constraint>'
    ),
    "one origin, as it is drawn": (
        '<constraint name="c" type="continuous"><parent link="coupler"/><child link="rocker"/>'
        f'<child_origin xyz="{END}"/><axis xyz="0 1 0"/></constraint>'
    ),
    "in a gazebo element": (
        '<gazebo><joint name="c" type="revolute"><parent>coupler</parent><child>rocker</child>'
        f"<pose>{END} 0 0 0</pose><axis><xyz>0 1 0</xyz></axis></joint></gazebo>"
    ),
}
POINT = (
    '<loop_joint name="c" type="spherical"><link1 link="coupler" rpy="0 0 1" xyz="{}"/>'
    '<{} link="rocker" rpy="1 0 0" xyz="{}"/></loop_joint>'
)


def bars(more: str) -> cp.Robot:
    return cp.load_robot(f'<robot name="bars">{BARS}{more}</robot>')


def by_hand(kind: str, axis: str | None = None) -> cp.Scene:
    robot = bars("").with_frame("end", "rocker", [float(x) for x in END.split()])
    return cp.Scene(robot, [cp.Loop("pin", "end", kind, axis=axis)])


def assert_same_motion(scene: cp.Scene, wanted: cp.Scene) -> None:
    q = wanted.assemble(np.array([0.2, -0.1, 0.0]), fixed=["crank"]).q
    v = cp.mechanism.project_velocity(wanted, q, np.array([1.0, -0.5, 0.3]))
    tau = np.array([0.3, 0.1, -0.2])
    one, two = cp.solve(scene, q, v, tau), cp.solve(wanted, q, v, tau)
    assert one.rank == two.rank
    np.testing.assert_allclose(one.a, two.a, rtol=0, atol=1e-9 * np.abs(two.a).max())


@pytest.mark.parametrize("how", CLOSED)
def test_hinges_of_loops(how):
    robot = bars(CLOSED[how])
    (loop,) = robot.loops
    assert (loop.name, loop.kind) == ("c", "hinge")
    drawn = cp.Scene(robot, robot.loops).check(np.zeros(3), np.zeros(3)).violation["c"]
    assert drawn.size < 1e-12
    assert_same_motion(cp.Scene(robot, robot.loops), by_hand("hinge", "y"))


@pytest.mark.parametrize("second", ["link1", "link2"])
def test_points_of_loops(second):
    robot = bars(POINT.format(TIP, second, END))
    assert_same_motion(cp.Scene(robot, robot.loops), by_hand("ball"))


@pytest.mark.long
@pytest.mark.parametrize(("kind", "rows"), [("fixed", 6), ("prismatic", 5)])
def test_other_kinds_of_loops(kind, rows):
    robot = bars(CLOSED["one more parent"].replace('"revolute"', f'"{kind}"', 1))
    assert cp.Scene(robot, robot.loops).rows == rows


@pytest.mark.long
def test_a_cylindrical_loop():
    robot = bars(CLOSED["an axis in the parent"].replace("revolute", "cylindrical"))
    (loop,) = robot.loops
    assert (loop.kind, loop.axis, loop.rows) == ("cylindrical", "z", 4)


@pytest.mark.long
def test_a_file_with_one_loop_in_two_ways_has_both():
    robot = bars(
        CLOSED["in a gazebo element"] + POINT.format(TIP, "link2", END).replace("c", "d", 1)
    )
    assert len(robot.loops) == 2


LOST = {
    "type of a loop named 'screw'": CLOSED["an axis in the parent"].replace("revolute", "screw"),
    "type of a loop named 'planar'": CLOSED["one more parent"].replace("revolute", "planar"),
    "no link named 'rokker'": CLOSED["an axis in the parent"].replace('"rocker"', '"rokker"'),
    "no origin": '<loop_joint name="c" type="fixed"><parent link="pin"/>'
    '<child link="rocker"/></loop_joint>',
    "has no name": CLOSED["in a gazebo element"].replace('name="c"', ""),
    "<axis xyz> is zero": CLOSED["one more parent"].replace('axis xyz="0 1 0"', 'axis xyz="0 0 0"'),
    "cannot mimic": CLOSED["one more parent"].replace("<axis", '<mimic joint="crank"/><axis'),
    "frame 'c_a' already": CLOSED["one more parent"] + '<link name="c_a"/>'
    '<joint name="f" type="fixed"><parent link="base"/><child link="c_a"/></joint>',
    "exchange parent and child": '<joint name="c" type="fixed"><parent link="pin"/>'
    '<child link="base"/></joint>',
}  # fmt: skip


@each_row("sentence", LOST)
def test_what_is_wrong_with_a_loop_is_said(sentence):
    with pytest.raises(cp.errors.CondynError, match=sentence):
        bars(LOST[sentence])


OF_A_URDF = '<dynamics damping="0.3" friction="0.1"/><limit upper="1" effort="8"/>'
OF_AN_SDF = (
    "<dynamics><damping>0.3</damping><friction>0.1</friction></dynamics>"
    "<limit><lower>0</lower><upper>1</upper><effort>8</effort></limit></axis>"
)


@pytest.mark.parametrize("how", CLOSED)
def test_a_joint_that_is_cut_keeps_its_settings(how):
    text = CLOSED[how].replace("continuous", "revolute")
    if how == "in a gazebo element":
        text = text.replace("</axis>", OF_AN_SDF)
    else:
        text = text.replace("<axis", f"{OF_A_URDF}<axis").replace(
            "<parent_axis", f"{OF_A_URDF}<parent_axis"
        )
    robot = bars(text)
    model, i = robot.model, robot.index_v("c")
    assert [loop.name for loop in robot.loops] == ["c_weld"]
    assert (model.damping[i], model.effortLimit[i]) == (0.3, 8.0)
    assert (model.lowerPositionLimit[i], model.upperPositionLimit[i]) == (0.0, 1.0)
    assert [each.joint for each in robot.frictions()] == ["c"]
    assert_same_motion_but_c(robot)


def assert_same_motion_but_c(robot: cp.Robot) -> None:
    scene, plain = cp.Scene(robot, robot.loops), by_hand("hinge", "y")
    own = [robot.index_v(joint) for joint in plain.robot.joints]
    start = robot.configuration({"crank": 0.2})
    q = scene.assemble(start, fixed=["crank"], within_limits=False).q
    v = cp.mechanism.project_velocity(scene, q, robot.joint_vector({"crank": 1.0}))
    tau = robot.joint_vector({"crank": 0.3})
    a, wanted = cp.solve(scene, q, v, tau).a[own], cp.solve(plain, q[own], v[own], tau[own]).a
    np.testing.assert_allclose(a, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


def test_settings_of_a_joint_with_two_axes_are_not_modelled():
    text = CLOSED["an axis in the parent"].replace("revolute", "cylindrical")
    with pytest.warns(UnmodelledWarning, match="bars: .*settings of the joint 'c'"):
        robot = bars(text.replace("<axis", f"{OF_A_URDF}<axis"))
    (said,) = robot.unmodelled
    assert said in str(cp.Scene(robot, robot.loops).summary())
    assert "changes the motion, and is not modelled" in robot._repr_html_()


GAZEBO = (
    '<gazebo reference="crank"><turnGravityOff>true</turnGravityOff><mu1>0.3</mu1></gazebo>'
    '<gazebo reference="rocker"><springStiffness>3</springStiffness></gazebo>'
)


@pytest.mark.long
def test_what_gazebo_adds_to_the_motion_is_not_modelled():
    with pytest.warns(UnmodelledWarning, match="turnGravityOff"):
        robot = bars(GAZEBO)
    assert robot.unmodelled == (
        "<turnGravityOff> of <gazebo> (crank)", "<springStiffness> of <gazebo> (rocker)",
    )  # fmt: skip
    assert bars(GAZEBO.replace("true", "false").replace(">3<", ">0<")).unmodelled == ()


# Planes -------------------------------------------------------------------------------------------

PLANE = (
    '<robot name="puck"><link name="base"/>' + BODY.format("puck") + BODY.format("arm")
    + '<joint name="plane" type="planar"><parent link="base"/><child link="puck"/>'
    '<origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/>{}</joint>'
    + HINGE.format("arm", "puck", "0.1 0.2 0") + "</robot>"
)  # fmt: skip


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 1, 0), (1, 0, 0), (1, -2, 0.5), (0, 0, -1), None])
def test_a_planar_joint_moves_across_its_axis(axis):
    """Without one it is x, by the format. Where it is drawn does not hang on it."""
    text = "" if axis is None else f'<axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>'
    robot, plain = cp.load_robot(PLANE.format(text)), pin.buildModelFromXML(PLANE.format(""))
    normal = np.array((1, 0, 0) if axis is None else axis, float)
    data = plain.createData()
    pin.framesForwardKinematics(plain, data, pin.neutral(plain))
    q = pin.neutral(robot.model)
    for name in ("puck", "arm"):
        drawn = data.oMf[plain.getFrameId(name, pin.FrameType.BODY)]
        assert np.allclose(robot.frame_pose(q, name), drawn, rtol=0, atol=1e-12)
    start, rng = robot.frame_pose(q, "puck"), np.random.default_rng(0)
    across = start.rotation @ normal / np.linalg.norm(normal)
    for _ in range(5):
        v = rng.normal(size=robot.nv)
        there = robot.frame_pose(pin.integrate(robot.model, q, v), "puck")
        assert abs(across @ (there.translation - start.translation)) < 1e-12
        assert np.allclose(there.rotation @ start.rotation.T @ across, across, rtol=0, atol=1e-12)
    # and it falls as its plane lets it: the pull of gravity across the normal, without the arm's
    alone = cp.load_robot(PLANE.format(text).replace(BODY.format("arm"), '<link name="arm"/>')
                          .replace('type="revolute"', 'type="fixed"'))  # fmt: skip
    a = cp.solve(cp.Scene(alone), pin.neutral(alone.model), np.zeros(3), np.zeros(3)).a
    world = alone.frame_pose(pin.neutral(alone.model), "plane").rotation @ [*a[:2], 0.0]
    spun = alone.frame_pose(pin.neutral(alone.model), "plane").rotation @ [0.0, 0.0, a[2]]
    lever = alone.center_of_mass(pin.neutral(alone.model)) - start.translation
    g = np.array([0.0, 0.0, -9.81])
    assert np.allclose(world + np.cross(spun, lever), g - (g @ across) * across, atol=1e-9)


# Names, texts and motors --------------------------------------------------------------------------


def test_a_robot_has_the_name_in_its_file(tmp_path):
    path = tmp_path / "other.urdf"
    path.write_text(f'<robot name="bars">{BARS}</robot>')
    assert cp.load_robot(path).name == "bars"
    assert cp.load_robot(path).description == str(path)
    assert cp.load_robot(path, actuated=["crank"]).actuated == ("crank",)
    assert bars("").description == ""


@pytest.mark.long
def test_macros_are_named_with_what_expands_them(tmp_path):
    text = (
        '<robot xmlns:xacro="http://ros.org/wiki/xacro" name="leg"><xacro:macro name="m"/></robot>'
    )
    for name in ("leg.urdf.xacro", "leg.xacro", "leg.urdf"):
        (tmp_path / name).write_text(text)
        with pytest.raises(cp.errors.InvalidModel, match=r"xacro .* > robot.urdf"):
            cp.load_robot(tmp_path / name)
    with pytest.raises(cp.errors.InvalidModel, match="<xacro:macro>"):
        cp.load_robot(text)
    with pytest.raises(cp.errors.InvalidModel, match="the text of a URDF: its root element"):
        cp.load_robot("<sdf/>")


def test_names_of_robot_descriptions(tmp_path, monkeypatch):
    (tmp_path / "robot_descriptions").mkdir()
    path = tmp_path / "bars.urdf"
    path.write_text(f'<robot name="bars">{BARS}</robot>')
    (tmp_path / "robot_descriptions" / "__init__.py").write_text("")
    (tmp_path / "robot_descriptions" / "bars_description.py").write_text(
        f"URDF_PATH = {str(path)!r}"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in [name for name in sys.modules if name.startswith("robot_descriptions")]:
        monkeypatch.delitem(sys.modules, name)
    assert cp.load_robot("bars_description", floating=True).nv == 9
    with pytest.raises(cp.errors.UnknownName, match="no_such_description"):
        cp.load_robot("no_such_description")


@pytest.mark.long
def test_a_robot_is_changed_by_methods():
    robot = bars("").with_frame("end", "rocker", [float(x) for x in END.split()])
    loop, foot = cp.Loop("pin", "end", "ball", name="c"), cp.PointContact("pin", name="foot")
    made = (
        robot.with_motors("crank").with_loops(loop).with_contacts(foot)
        .with_posture("up", {"crank": 0.3}).with_limits({"rocker": (-1.0, np.inf)})
    )  # fmt: skip
    assert made.actuated == ("crank",)
    assert made.loops == (loop,)
    assert made.contacts == (foot,)
    assert np.array_equal(made.postures["up"], made.configuration({"crank": 0.3}))
    assert robot.loops == robot.actuated == ()
    with pytest.raises(cp.errors.InvalidArgument, match="limits of crank"):
        robot.with_limits({"crank": (1.0, -1.0)})


@pytest.mark.long
def test_joints_of_a_model_without_frames_are_frames():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "b")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    robot = cp.Robot("own", model).with_frame("tip", "b", [0.2, 0, 0])
    assert np.allclose(robot.frame_pose(np.zeros(1), "tip").translation, [0.2, 0, 0])
    assert cp.Scene(robot, [cp.PointContact("b")]).rows == 3


def test_rotors_that_are_not_in_the_inertia_are_said():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "j")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    model.rotorInertia[:], model.rotorGearRatio[:] = 1e-4, 100.0
    (said,) = cp.Scene(cp.Robot("motor", model)).summary().unmodelled
    assert "rotors (j)" in said
    model.armature = np.array([1.0])
    assert cp.Scene(cp.Robot("motor", model)).summary().unmodelled == ()


def test_models_in_any_order_are_put_in_order():
    """Two arms, joint by joint in turn, with frames, limits and a reference configuration."""
    rng, mixed = np.random.default_rng(0), pin.Model()
    ends = [0, 0]
    for k in range(6):
        place = pin.SE3(pin.rpy.rpyToMatrix(*rng.normal(size=3)), rng.normal(size=3))
        made = (pin.JointModelRX(), pin.JointModelSpherical(), pin.JointModelPZ())[k % 3]
        ends[k % 2] = mixed.addJoint(ends[k % 2], made, place, f"joint {k}")
        body = pin.Inertia.Random()
        mixed.appendBodyToJoint(ends[k % 2], body, pin.SE3.Identity())
        mixed.addFrame(pin.Frame(f"f{k}", ends[k % 2], 0, place, pin.FrameType.OP_FRAME))
    mixed.armature = rng.uniform(0.1, 1.0, size=mixed.nv)
    mixed.referenceConfigurations["posed"] = pin.randomConfiguration(
        mixed, -np.ones(mixed.nq), np.ones(mixed.nq)
    )
    with pytest.raises(cp.errors.InvalidModel, match="depth_first"):
        cp.Robot("mixed", mixed)
    ordered, of_q, of_v = cp.model.depth_first(mixed)
    robot = cp.Robot("ordered", ordered)
    q = mixed.referenceConfigurations["posed"]
    assert np.array_equal(ordered.referenceConfigurations["posed"], q[of_q])
    assert np.array_equal(ordered.armature, np.array(mixed.armature)[of_v])
    data = mixed.createData()
    pin.framesForwardKinematics(mixed, data, q)
    for k in range(6):
        wanted = data.oMf[mixed.getFrameId(f"f{k}")]
        assert np.allclose(robot.frame_pose(q[of_q], f"f{k}"), wanted, rtol=0, atol=1e-12)
    v, a = rng.normal(size=(2, mixed.nv))
    torque = pin.rnea(mixed, data, q, v, a)  # which does not need the order
    assert np.allclose(
        pin.rnea(ordered, ordered.createData(), q[of_q], v[of_v], a[of_v]), torque[of_v], atol=1e-9
    )
    with pytest.raises(cp.errors.InvalidArgument, match="a pinocchio"):
        cp.model.depth_first("mixed")


def with_gazebo(said: str) -> str:
    return f'<robot name="bars">{BARS}{said}</robot>'


ACTING = {
    "a plugin that mimics": (
        '<plugin name="p" filename="lib_mimic_joint_plugin.so"><joint>crank</joint></plugin>',
        r"plugins that may drive it or push \(p\)",
    ),
    "decay": (
        "<velocity_decay><linear>0.1</linear></velocity_decay>",
        r"<velocity_decay> of <gazebo> \(the robot\)",
    ),
}


@pytest.mark.parametrize("case", ACTING)
def test_what_gazebo_adds_to_the_motion_is_named(case):
    inside, words = ACTING[case]
    with pytest.warns(cp.errors.UnmodelledWarning, match=words):
        cp.load_robot(with_gazebo(f"<gazebo>{inside}</gazebo>"))


def test_what_gazebo_does_on_demand_or_changes_of_a_joint_is_told_apart():
    quiet = '<plugin name="p" filename="libgazebo_ros_control.so"/>'
    still = "<velocity_decay><linear>0</linear><angular>0.0</angular></velocity_decay>"
    text = with_gazebo(f"<gazebo>{quiet}{still}</gazebo>")
    assert cp.load_robot(text).unmodelled == ()
    inside = "<joint><axis><dynamics><damping>3</damping></dynamics></axis></joint>"
    with pytest.warns(cp.errors.UnmodelledWarning, match=r"changes a joint \(crank\)"):
        cp.load_robot(with_gazebo(f'<gazebo reference="crank">{inside}</gazebo>'))
