"""The SDF reader: kinematics, inertia, limits and springs, against figures by hand."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from sdf_texts import (
    AB,
    ARM,
    INERTIAL,
    ROUNDING,
    T,
    assert_orthonormal,
    axis,
    frame_poses,
    joint,
    link,
    pose,
    springs,
)
from shared import each_row

from condyn_pin.constraints import JointFriction
from condyn_pin.model import Robot

NO_LIMIT = np.finfo(float).max


def turn(point, axis, angle) -> np.ndarray:
    """Rotation of space about the line through a point."""
    axis = np.asarray(axis) / np.linalg.norm(axis)
    twist = np.zeros((4, 4))
    twist[:3, :3] = [[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]]
    twist[:3, 3] = -np.cross(axis, point)
    return expm(angle * twist)


def arm_by_hand(shoulder, rail, socket, knuckle) -> dict[str, np.ndarray]:
    world = T(0.1, -0.2, 0.3, 0.4, 0.5, -0.6)
    base = world @ T(0.2, 0, 0.1, 0, 0.3, 0)
    upper = base @ T(0, 0.1, 0.5, 0.1, 0.2, 0.3)
    tool = upper @ T(0.1, 0.1, 0, 1.2, -0.3, 0.4)
    at_shoulder = upper @ T(0.05, 0, -0.1, 0, 0.7, 0.2)
    carriage = at_shoulder @ T(0.3, 0, 0, 0, 0, 0.8)
    lump = world @ T(0.4, 0.5, 0.6, 0.1, 0, 0)
    wrist = tool @ T(0, 0.2, 0, 0, 0, 0.5)
    at_socket = lump @ T(0.1, 0, 0.1, 0.3, 0.2, 0.1)
    finger = world @ T(0.7, 0.1, 0.2, 0.3, 0, -0.2)
    at_knuckle = finger @ T(0, 0.1, 0, 0.2, 0.4, 0)

    first = turn(at_shoulder[:3, 3], at_shoulder[:3, :3] @ [1, -2, 3], shoulder)
    second = np.eye(4)
    second[:3, 3] = rail * tool[:3, :3] @ [0, 1, 1] / np.sqrt(2)
    rotation = np.eye(4)
    rotation[:3, :3] = socket.as_matrix()
    third = at_socket @ rotation @ np.linalg.inv(at_socket)
    fourth = turn(at_knuckle[:3, 3], world[:3, :3] @ [0, 1, 0], knuckle)
    return {
        "base": base,
        "upper": first @ upper,
        "tool": first @ tool,
        "shoulder": turn(at_shoulder[:3, 3], at_shoulder[:3, :3] @ [1, -2, 3], shoulder)
        @ at_shoulder,
        "carriage": first @ second @ carriage,
        "lump": first @ second @ lump,
        "bolts": first @ second @ lump,
        "wrist": first @ second @ third @ wrist,
        "finger": first @ second @ third @ fourth @ finger,
    }


@pytest.mark.parametrize("seed", range(5))
def test_every_frame_is_where_the_product_of_exponentials_puts_it(read, seed):
    model = read(ARM).model
    assert model.nv == 6
    rng = np.random.default_rng(seed)
    shoulder, rail, knuckle = rng.uniform(-2, 2, 3)
    socket = Rotation.from_quat(rng.normal(size=4))
    q = np.zeros(model.nq)
    values = {"shoulder": shoulder, "rail": rail, "socket": socket.as_quat(), "knuckle": knuckle}
    for name, value in values.items():
        moved = model.joints[model.getJointId(name)]
        q[moved.idx_q : moved.idx_q + moved.nq] = value
    found = frame_poses(model, q)
    for name, expected in arm_by_hand(shoulder, rail, socket, knuckle).items():
        np.testing.assert_allclose(found[name], expected, atol=ROUNDING, err_msg=name)


@pytest.mark.long
def test_a_pose_relative_to_the_world_does_not_move_with_the_model(read):
    body = pose("1 2 3 0.1 0.2 0.3") + link("a", pose("4 5 6 0.3 0 0", relative_to="world"))
    at = frame_poses(read(body).model, np.zeros(0))
    np.testing.assert_allclose(at["a"], T(4, 5, 6, 0.3, 0, 0), atol=ROUNDING)


@pytest.mark.long
def test_links_joints_and_frames_have_the_frame_types_of_pinocchio(read):
    model = read(ARM).model
    types = {f.name: f.type for f in model.frames}
    assert types["base"] == types["lump"] == pin.FrameType.BODY
    assert types["shoulder"] == types["socket"] == pin.FrameType.JOINT
    assert types["bolts"] == pin.FrameType.FIXED_JOINT
    assert types["tool"] == pin.FrameType.OP_FRAME


@pytest.mark.long
def test_a_joint_may_name_a_frame_as_its_end(read):
    body = (
        link("a") + link("b") + '<frame name="f" attached_to="b"><pose>1 0 0 0 0 0</pose></frame>'
    )
    at = frame_poses(read(body + joint("j", "a", "f")).model, np.zeros(1))
    assert at["j"][:3, 3].tolist() == [1, 0, 0]  # drawn at the frame,
    assert at["b"][:3, 3].tolist() == [0, 0, 0]  # and moving the link that carries it


@pytest.mark.long
def test_a_floating_root_is_where_its_joint_says_and_not_where_the_file_does(read):
    robot = read(link("a", pose("1 2 3 0 0 1") + INERTIAL), root_joint=pin.JointModelFreeFlyer())
    at = frame_poses(robot.model, pin.neutral(robot.model))
    assert np.array_equal(at["a"], np.eye(4))
    assert any("pose of the root link" in sentence for sentence in robot.unused)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["revolute", "fixed"])
def test_rotations_are_orthonormal_to_rounding_at_the_end_of_a_long_chain_of_poses(read, kind):
    # Without a last correction the product of 300 poses is off by 1e-13.
    body = link("l0") + "".join(
        link(f"l{i}", pose("0.1 0.2 0.3 1.1 -0.7 2.3", relative_to=f"l{i - 1}") + INERTIAL)
        + joint(f"j{i}", f"l{i - 1}", f"l{i}", kind)
        for i in range(1, 300)
    )
    frame = '<frame name="tip" attached_to="l299">' + pose("0 0 0 0.4 0.5 0.6") + "</frame>"
    assert_orthonormal(read(body + frame).model)


@pytest.mark.parametrize("direction", ["1 0 0", "0 1 0", "0 0 1", "0 0 -1"])
def test_hinges_and_sliders_move_along_their_axis(read, direction):
    along = np.array(direction.split(), dtype=float)
    inside = f"<axis><xyz>{direction}</xyz></axis>"
    turned = frame_poses(read(AB + joint("j", "a", "b", inside=inside)).model, np.array([0.5]))
    expected = Rotation.from_rotvec(0.5 * along).as_matrix()
    np.testing.assert_allclose(turned["b"][:3, :3], expected, atol=ROUNDING)
    slider = read(AB + joint("j", "a", "b", "prismatic", inside)).model
    moved = frame_poses(slider, np.array([0.5]))
    np.testing.assert_allclose(moved["b"][:3, 3], 0.5 * along, atol=ROUNDING)


@pytest.mark.long
def test_an_axis_is_normalised_whatever_its_size(read):
    for size in ("1e-200", "1", "1e15"):
        inside = f"<axis><xyz>0 {size} {size}</xyz></axis>"
        model = read(AB + joint("j", "a", "b", inside=inside)).model
        at = frame_poses(model, np.array([0.5]))
        expected = Rotation.from_rotvec(0.5 * np.array([0, 1, 1]) / np.sqrt(2)).as_matrix()
        np.testing.assert_allclose(at["b"][:3, :3], expected, atol=ROUNDING)


def test_a_rotated_inertial_pose_turns_the_inertia_and_moves_the_centre(read):
    # About the axis a through p: aᵀ R I Rᵀ a + m |a × (c - p)|².
    inertial = (
        "<inertial>" + pose("0.1 0.2 0.3 0.4 0.5 0.6") + "<mass>3</mass><inertia><ixx>0.2</ixx>"
        "<iyy>0.3</iyy><izz>0.4</izz><ixy>0.01</ixy><ixz>-0.02</ixz><iyz>0.03</iyz></inertia>"
        "</inertial>"
    )
    at_joint = pose("0.5 -0.1 0.2 0.3 0 0.1") + "<axis><xyz>1 2 2</xyz></axis>"
    body = link("base", "") + link("arm", inertial) + joint("hinge", "base", "arm", inside=at_joint)
    model = read(body).model

    com, hinge = T(0.1, 0.2, 0.3, 0.4, 0.5, 0.6), T(0.5, -0.1, 0.2, 0.3, 0, 0.1)
    tensor = np.array([[0.2, 0.01, -0.02], [0.01, 0.3, 0.03], [-0.02, 0.03, 0.4]])
    a = hinge[:3, :3] @ [1 / 3, 2 / 3, 2 / 3]
    turned = com[:3, :3] @ tensor @ com[:3, :3].T
    expected = a @ turned @ a + 3 * np.sum(np.cross(a, com[:3, 3] - hinge[:3, 3]) ** 2)
    M = pin.crba(model, model.createData(), np.zeros(1))
    assert M[0, 0] == pytest.approx(expected, rel=1e-14)


@pytest.mark.long
def test_an_inertial_pose_may_be_relative_to_another_frame(read):
    inertial = INERTIAL.replace("<mass>", pose("0 0 1 0 0 0", relative_to="__model__") + "<mass>")
    robot = read(link("a", pose("0 0 3 0 0 0") + inertial), root_joint=pin.JointModelFreeFlyer())
    np.testing.assert_allclose(robot.model.inertias[1].lever, [0, 0, -2], atol=ROUNDING)


@pytest.mark.long
def test_the_mass_of_a_welded_link_is_carried_by_the_joint_before_it(read):
    body = link("a") + link("b") + link("c", pose("1 0 0 0 0 0") + INERTIAL)
    model = read(body + joint("j", "a", "b") + joint("w", "b", "c", "fixed", "")).model
    assert model.inertias[1].mass == 4
    np.testing.assert_allclose(model.inertias[1].lever, [0.5, 0, 0], atol=ROUNDING)


LIMITS = "<lower>-1</lower><upper>2</upper><effort>30</effort><velocity>4</velocity>"
NONE = (-NO_LIMIT, NO_LIMIT, NO_LIMIT, NO_LIMIT)


@each_row(("kind", "limits", "expected"), [
        ("revolute", LIMITS, (-1, 2, 30, 4)),
        ("prismatic", LIMITS, (-1, 2, 30, 4)),
        ("revolute", "", NONE),
        ("revolute", LIMITS.replace("-1", "-1e16").replace(">2<", ">1e16<").replace("30", "-1")
         .replace("4", "-1"), NONE),
        ("revolute", LIMITS.replace("-1", "-inf").replace(">2<", ">inf<").replace("30", "inf")
         .replace("4", "inf"), NONE),
        ("continuous", "<lower>-1</lower><upper>2</upper>", NONE),
    ])  # fmt: skip
def test_limits_in_any_of_the_format_s_spellings(read, kind, limits, expected):
    robot = read(AB + joint("j", "a", "b", kind, axis(limits)))
    model = robot.model
    keys = ("lowerPositionLimit", "upperPositionLimit", "effortLimit", "velocityLimit")
    assert tuple(getattr(model, key).item() for key in keys) == expected
    assert model.nq == 1
    assert ("joint limits that the type has not: 'j'" in robot.unused) == (kind == "continuous")


def test_damping_springs_and_friction_go_where_they_belong(read):
    body = "".join(map(link, "abcd"))
    body += joint("one", "a", "b", inside=axis("", "<damping>0.5</damping><friction>7</friction>"))
    body += joint("two", "b", "c", "ball", axis("", "<damping>0.25</damping>"))
    spring = "<spring_stiffness>9</spring_stiffness><spring_reference>-1</spring_reference>"
    body += joint("three", "c", "d", "prismatic", axis("", spring))
    robot = read(body)
    assert robot.model.damping.tolist() == [0.5, 0.25, 0.25, 0.25, 0]
    assert springs(robot) == {"three": (9.0, -1.0)}
    assert robot.unused == (
        "joint friction, which robot.frictions() adds to the contacts of a scene: 'one'",
    )
    assert robot.unmodelled == ()
    machine = Robot("machine", robot.model)
    (friction,) = machine.frictions()  # of the one joint that has any
    assert friction == JointFriction("one")
    (row,) = friction.bind(machine).dry
    assert row.limit == 7


@pytest.mark.parametrize("kind", ["ball", "revolute", "prismatic"])
def test_a_cut_joint_keeps_its_settings(read, kind):
    kept = "<damping>1</damping><friction>2</friction><spring_stiffness>3</spring_stiffness>"
    description = read(
        "".join(map(link, "abc"))
        + joint("ab", "a", "b")
        + joint("ac", "a", "c")
        + joint("cut", "b", "c", kind, axis("<upper>1</upper><effort>9</effort>", kept)),
        cut=["cut"],
    )
    robot, scalar = description.robot(name="abc"), kind != "ball"
    (weld,) = robot.loops
    joint_, model = robot.model.joints[robot.model.getJointId("cut")], robot.model
    rows = slice(joint_.idx_v, joint_.idx_v + joint_.nv)
    assert (weld.name, weld.kind, joint_.nv) == ("cut_weld", "weld", 1 if scalar else 3)
    assert (model.damping[rows] == 1).all()
    assert JointFriction("cut") in robot.frictions()
    assert springs(robot) == ({"cut": (3.0, 0.0)} if scalar else {})
    assert ([limit.joint for limit in robot.limits()] == ["cut"]) == scalar
    assert not scalar or model.effortLimit[rows] == 9
    assert robot.unmodelled == (() if scalar else ("joint spring: 'cut'",))
    assert robot.unused[1:] == (() if scalar else ("joint limits that the type has not: 'cut'",))


def test_settings_of_a_fixed_joint_change_nothing(read):
    dynamics = "<damping>1</damping><friction>2</friction><spring_stiffness>3</spring_stiffness>"
    robot = read(AB + joint("j", "a", "b", "fixed", axis("<upper>1</upper>", dynamics)))
    assert robot.unused == ("settings of fixed joints: 'j'",)
    assert robot.unmodelled == ()
