"""The SDF reader: Cassie, kinematics and inertia by hand, and what it says about a wrong file."""

from __future__ import annotations

import pickle
import re
from copy import deepcopy
from importlib.metadata import distribution
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from condyn_pin.errors import CondynError, InvalidModel, UnknownName
from condyn_pin.io.sdf import Closure, SdfRobot, read_sdf

NO_LIMIT = np.finfo(float).max
ROUNDING = 1e-14  # a handful of products of numbers of size 1
SIDES = ("left", "right")
CASSIE_KINDS = {f"{side}-achilles-spring-joint": "ball" for side in SIDES}


def cassie_folder() -> Path:
    robots = "cmeel.prefix/share/example-robot-data/robots"
    return Path(str(distribution("example-robot-data").locate_file(f"{robots}/cassie_description")))


def cassie_file() -> Path:
    return cassie_folder() / "robots" / "cassie_wo_gearbox_spring.sdf"


@pytest.fixture(scope="module")
def cassie() -> SdfRobot:
    return read_sdf(
        cassie_file(),
        root="pelvis",
        root_joint=pin.JointModelFreeFlyer(),
        kinds=CASSIE_KINDS,
        drop=("static",),
    )


@pytest.fixture
def read(tmp_path):
    """Read a model given as text."""

    def read_text(body: str, version: str = "1.9", **options) -> SdfRobot:
        path = tmp_path / "robot.sdf"
        path.write_text(f'<sdf version="{version}"><model name="robot">{body}</model></sdf>')
        return read_sdf(path, **options)

    return read_text


INERTIAL = (
    "<inertial><mass>2</mass>"
    "<inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial>"
)


def link(name: str, inside: str = INERTIAL) -> str:
    return f'<link name="{name}">{inside}</link>'


def joint(
    name: str, parent: str, child: str, kind: str = "revolute", inside: str | None = None
) -> str:
    axis = "<axis><xyz>0 0 1</xyz></axis>" if inside is None else inside
    return (
        f'<joint name="{name}" type="{kind}"><parent>{parent}</parent>'
        f"<child>{child}</child>{axis}</joint>"
    )


def pose(numbers: str, **attributes: str) -> str:
    said = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f"<pose{said}>{numbers}</pose>"


def frame_poses(model: pin.Model, q: np.ndarray) -> dict[str, np.ndarray]:
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return {f.name: data.oMf[i].homogeneous for i, f in enumerate(model.frames)}


def gaps(robot: SdfRobot, q: np.ndarray) -> np.ndarray:
    """Distance between the two frames of each closure."""
    at = frame_poses(robot.model, q)
    return np.array(
        [np.linalg.norm((at[c.frame_a] - at[c.frame_b])[:3, 3]) for c in robot.closures]
    )


# Cassie ---------------------------------------------------------------------------------------


def test_cassie_has_32_dofs_and_the_mass_of_its_links(cassie):
    assert (cassie.model.nq, cassie.model.nv) == (35, 32)
    masses = re.findall(r"<mass>(.*?)</mass>", cassie_file().read_text())
    assert len(masses) == 23
    assert pin.computeTotalMass(cassie.model) == pytest.approx(sum(map(float, masses)), rel=1e-14)
    assert pin.computeTotalMass(cassie.model) == pytest.approx(32.94, abs=5e-3)


def test_cassie_is_cut_at_two_balls_a_leg(cassie):
    names = [c.name for c in cassie.closures]
    assert sorted(names) == sorted(
        f"{side}-{loop}"
        for side in SIDES
        for loop in ("achilles-spring-joint", "plantar-foot-joint")
    )
    for closure in cassie.closures:
        assert closure.kind == "ball"
        links = [
            cassie.model.frames[cassie.model.frames[cassie.model.getFrameId(f)].parentFrame].name
            for f in (closure.frame_a, closure.frame_b)
        ]
        side, loop = closure.name.split("-", 1)
        expected = {
            "achilles-spring-joint": ["achilles-rod", "heel-spring"],
            "plantar-foot-joint": ["plantar-rod", "foot"],
        }[loop]
        assert links == [f"{side}-{name}" for name in expected]


def test_cassie_loops_are_closed_as_drawn(cassie):
    at = frame_poses(cassie.model, pin.neutral(cassie.model))
    for closure in cassie.closures:
        assert np.abs(at[closure.frame_a] - at[closure.frame_b]).max() < ROUNDING


def test_cassie_loops_are_closed_at_the_posture_of_the_srdf(cassie):
    model = cassie.model.copy()
    pin.loadReferenceConfigurations(model, str(cassie_folder() / "srdf" / "cassie_v2.srdf"), False)
    q = pin.normalize(model, model.referenceConfigurations["standing"].copy())
    # The posture is written with eight digits; it was found with the joints of the file.
    assert gaps(cassie, q).max() < 1e-8


def test_cassie_loops_leave_22_freedoms(cassie):
    model, data = cassie.model, cassie.model.createData()
    q = pin.neutral(model)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    J = np.vstack(
        [
            pin.getFrameJacobian(model, data, model.getFrameId(c.frame_a), world)[:3]
            - pin.getFrameJacobian(model, data, model.getFrameId(c.frame_b), world)[:3]
            for c in cassie.closures
        ]
    )
    assert J.shape == (12, 32)
    assert model.nv - np.linalg.matrix_rank(J, tol=1e-6) == 22


def test_cassie_springs(cassie):
    assert cassie.springs == {
        f"{side}-{name}": (stiffness, 0.0)
        for side in SIDES
        for name, stiffness in (("knee-shin-joint", 1500.0), ("tarsus-spring-joint", 1250.0))
    }


def test_cassie_says_what_is_not_used(cassie):
    told = "\n".join(cassie.unused)
    for thing in ("9 <collision>", "23 <visual>", "1 <plugin>", "'static'", "(revolute as ball)"):
        assert thing in told


def test_cassie_joints_are_in_depth_first_order(cassie):
    assert cassie.model.check(cassie.model.createData())


def test_cassie_as_written_names_the_hinge_that_cannot_be_cut():
    with pytest.raises(InvalidModel, match=r"'right-achilles-spring-joint'.*kinds"):
        read_sdf(cassie_file(), root_joint=pin.JointModelFreeFlyer(), drop=("static",))


def test_cassie_with_its_lift_and_a_floating_base_is_refused():
    with pytest.raises(InvalidModel, match="'static' attach the model to the world"):
        read_sdf(cassie_file(), root_joint=pin.JointModelFreeFlyer(), kinds=CASSIE_KINDS)


def test_cassie_on_its_lift_has_27_dofs():
    robot = read_sdf(cassie_file(), kinds=CASSIE_KINDS)
    assert robot.model.nv == 27
    assert frame_poses(robot.model, pin.neutral(robot.model))["pelvis"][2, 3] == 1.01


# Kinematics, by the product of exponentials -----------------------------------------------------

ARM = (
    pose("0.1 -0.2 0.3 0.4 0.5 -0.6")
    + link("base", pose("0.2 0 0.1 0 0.3 0"))
    + link("upper", pose("0 0.1 0.5 0.1 0.2 0.3", relative_to="base") + INERTIAL)
    + '<frame name="tool" attached_to="upper">'
    + pose("0.1 0.1 0 1.2 -0.3 0.4")
    + "</frame>"
    + joint(
        "shoulder",
        "base",
        "upper",
        inside=pose("0.05 0 -0.1 0 0.7 0.2") + "<axis><xyz>1 -2 3</xyz></axis>",
    )
    + link("carriage", pose("0.3 0 0 0 0 0.8", relative_to="shoulder") + INERTIAL)
    + joint(
        "rail",
        "upper",
        "carriage",
        "prismatic",
        '<axis><xyz expressed_in="tool">0 1 1</xyz></axis>',
    )
    + link("lump", pose("0.4 0.5 0.6 0.1 0 0") + INERTIAL)
    + joint("bolts", "carriage", "lump", "fixed", "")
    + link("wrist", pose("0 0.2 0 0 0 0.5", relative_to="tool") + INERTIAL)
    + joint("socket", "lump", "wrist", "ball", pose("0.1 0 0.1 0.3 0.2 0.1", relative_to="lump"))
    + link("finger", pose("0.7 0.1 0.2 0.3 0 -0.2", relative_to="__model__") + INERTIAL)
    + joint(
        "knuckle",
        "wrist",
        "finger",
        "continuous",
        pose("0 0.1 0 0.2 0.4 0")
        + "<axis><xyz>0 2 0</xyz><use_parent_model_frame>1</use_parent_model_frame></axis>",
    )
)


def T(x, y, z, roll, pitch, yaw) -> np.ndarray:
    placement = np.eye(4)
    for axis, angle in zip(np.eye(3), (roll, pitch, yaw), strict=True):  # about fixed axes
        placement[:3, :3] = Rotation.from_rotvec(angle * axis).as_matrix() @ placement[:3, :3]
    placement[:3, 3] = x, y, z
    return placement


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


def test_a_pose_relative_to_the_world_does_not_move_with_the_model(read):
    body = pose("1 2 3 0.1 0.2 0.3") + link("a", pose("4 5 6 0.3 0 0", relative_to="world"))
    at = frame_poses(read(body).model, np.zeros(0))
    np.testing.assert_allclose(at["a"], T(4, 5, 6, 0.3, 0, 0), atol=ROUNDING)


def test_links_joints_and_frames_have_the_frame_types_of_pinocchio(read):
    model = read(ARM).model
    types = {f.name: f.type for f in model.frames}
    assert types["base"] == types["lump"] == pin.FrameType.BODY
    assert types["shoulder"] == types["socket"] == pin.FrameType.JOINT
    assert types["bolts"] == pin.FrameType.FIXED_JOINT
    assert types["tool"] == pin.FrameType.OP_FRAME


def test_a_joint_may_name_a_frame_as_its_end(read):
    body = (
        link("a") + link("b") + '<frame name="f" attached_to="b"><pose>1 0 0 0 0 0</pose></frame>'
    )
    at = frame_poses(read(body + joint("j", "a", "f")).model, np.zeros(1))
    assert at["j"][:3, 3].tolist() == [1, 0, 0]  # drawn at the frame,
    assert at["b"][:3, 3].tolist() == [0, 0, 0]  # and moving the link that carries it


def test_a_floating_root_is_where_its_joint_says_and_not_where_the_file_does(read):
    robot = read(link("a", pose("1 2 3 0 0 1") + INERTIAL), root_joint=pin.JointModelFreeFlyer())
    at = frame_poses(robot.model, pin.neutral(robot.model))
    assert np.array_equal(at["a"], np.eye(4))
    assert any("pose of the root link" in sentence for sentence in robot.unused)


def assert_orthonormal(model: pin.Model) -> None:
    frames = [frame.placement for frame in model.frames]
    for placement in (*model.jointPlacements, *frames):
        R = placement.rotation
        np.testing.assert_allclose(R.T @ R, np.eye(3), rtol=0, atol=4 * np.finfo(float).eps)


def test_the_rotations_of_cassie_are_orthonormal_to_rounding(cassie):
    assert_orthonormal(cassie.model)


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


# Inertia, limits, damping -----------------------------------------------------------------------


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


def test_an_inertial_pose_may_be_relative_to_another_frame(read):
    inertial = INERTIAL.replace("<mass>", pose("0 0 1 0 0 0", relative_to="__model__") + "<mass>")
    robot = read(link("a", pose("0 0 3 0 0 0") + inertial), root_joint=pin.JointModelFreeFlyer())
    np.testing.assert_allclose(robot.model.inertias[1].lever, [0, 0, -2], atol=ROUNDING)


def test_the_mass_of_a_welded_link_is_carried_by_the_joint_before_it(read):
    body = link("a") + link("b") + link("c", pose("1 0 0 0 0 0") + INERTIAL)
    model = read(body + joint("j", "a", "b") + joint("w", "b", "c", "fixed", "")).model
    assert model.inertias[1].mass == 4
    np.testing.assert_allclose(model.inertias[1].lever, [0.5, 0, 0], atol=ROUNDING)


def axis(limit: str = "", dynamics: str = "") -> str:
    return f"<axis><xyz>0 0 1</xyz><limit>{limit}</limit><dynamics>{dynamics}</dynamics></axis>"


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_limits_are_kept(read, kind):
    limits = "<lower>-1</lower><upper>2</upper><effort>30</effort><velocity>4</velocity>"
    model = read(link("a") + link("b") + joint("j", "a", "b", kind, axis(limits))).model
    assert model.lowerPositionLimit.tolist() == [-1]
    assert model.upperPositionLimit.tolist() == [2]
    assert model.effortLimit.tolist() == [30]
    assert model.velocityLimit.tolist() == [4]


@pytest.mark.parametrize(
    "limits",
    [
        "",
        "<lower>-1e16</lower><upper>1e16</upper><effort>-1</effort><velocity>-1</velocity>",
        "<lower>-inf</lower><upper>inf</upper><effort>inf</effort><velocity>inf</velocity>",
    ],
)
def test_no_limit_in_any_of_the_format_s_spellings_is_no_limit_of_pinocchio(read, limits):
    model = read(link("a") + link("b") + joint("j", "a", "b", inside=axis(limits))).model
    bounds = [model.upperPositionLimit, model.effortLimit, model.velocityLimit]
    assert np.concatenate(bounds).tolist() == [NO_LIMIT] * 3
    assert model.lowerPositionLimit.tolist() == [-NO_LIMIT]


def test_a_continuous_joint_ignores_the_limits_and_says_so(read):
    limits = axis("<lower>-1</lower><upper>2</upper>")
    robot = read(link("a") + link("b") + joint("j", "a", "b", "continuous", limits))
    assert robot.model.nq == 1
    assert robot.model.upperPositionLimit.tolist() == [NO_LIMIT]
    assert "joint limits: 'j'" in robot.unused


def test_damping_springs_and_friction_go_where_they_belong(read):
    body = "".join(map(link, "abcd"))
    body += joint("one", "a", "b", inside=axis("", "<damping>0.5</damping><friction>7</friction>"))
    body += joint("two", "b", "c", "ball", axis("", "<damping>0.25</damping>"))
    spring = "<spring_stiffness>9</spring_stiffness><spring_reference>-1</spring_reference>"
    body += joint("three", "c", "d", "prismatic", axis("", spring))
    robot = read(body)
    assert robot.model.damping.tolist() == [0.5, 0.25, 0.25, 0.25, 0]
    assert robot.springs == {"three": (9.0, -1.0)}
    assert robot.unused == ("joint friction: 'one'",)


def test_what_a_cut_joint_cannot_do_is_reported(read):
    lost = "<damping>1</damping><friction>2</friction><spring_stiffness>3</spring_stiffness>"
    robot = read(
        "".join(map(link, "abc"))
        + joint("ab", "a", "b")
        + joint("ac", "a", "c")
        + joint("cut", "b", "c", "ball", axis("<upper>1</upper>", lost))
    )
    assert robot.springs == {}
    assert robot.unused == tuple(
        f"joint {setting}: 'cut'" for setting in ("friction", "damping", "spring", "limits")
    )


# The tree and its loops --------------------------------------------------------------------------


def test_the_first_parent_in_the_file_makes_the_tree(read):
    two = joint("ab", "a", "b"), joint("ac", "a", "c")
    links = "".join(map(link, "abc"))
    robot = read(links + "".join(two) + joint("loop", "b", "c", "fixed", ""))
    assert robot.closures == (Closure("loop", "weld", "loop_a", "loop_b"),)
    robot = read(links + joint("loop", "b", "c") + joint("ac", "a", "c", "ball", "") + two[0])
    assert robot.closures == (Closure("ac", "ball", "ac_a", "ac_b"),)
    assert list(robot.model.names) == ["universe", "ab", "loop"]


def test_a_first_parent_that_hangs_below_its_child_is_cut_instead(read):
    body = "".join(map(link, "abc"))
    body += joint("cb", "c", "b", "ball", "") + joint("ab", "a", "b") + joint("bc", "b", "c")
    robot = read(body)
    assert [c.name for c in robot.closures] == ["cb"]
    assert list(robot.model.names) == ["universe", "ab", "bc"]


def test_a_ring_is_opened_at_the_root_that_is_named(read):
    ring = "".join(map(link, "abc")) + joint("ab", "a", "b") + joint("bc", "b", "c")
    robot = read(ring + joint("ca", "c", "a", "ball", ""), root="a")
    assert [c.name for c in robot.closures] == ["ca"]


def test_closure_frames_move_with_their_links(read):
    body = link("a") + link("b", pose("1 0 0 0 0 0") + INERTIAL)
    body += link("c", pose("0 1 0 0 0 0") + INERTIAL)
    body += joint("ab", "a", "b") + joint("ac", "a", "c")
    robot = read(body + joint("bc", "b", "c", "ball", pose("1 0 0 0 0 0")))  # drawn at (1, 1, 0)
    (closure,) = robot.closures
    at = frame_poses(robot.model, np.array([np.pi / 2, 0.0]))  # b turns in place, c stays
    np.testing.assert_allclose(at[closure.frame_a][:3, 3], [0, 0, 0], atol=ROUNDING)
    np.testing.assert_allclose(at[closure.frame_b][:3, 3], [1, 1, 0], atol=ROUNDING)


def test_a_loop_through_the_world_is_closed_at_neutral(read):
    body = pose("1 2 3 0.1 0.2 0.3") + "".join(map(link, "ab"))
    body += joint("wa", "world", "a") + joint("ab", "a", "b")
    robot = read(body + joint("wb", "world", "b", "ball", pose("1 0 0 0 0 0")))
    at = frame_poses(robot.model, pin.neutral(robot.model))
    closure = robot.closures[0]
    np.testing.assert_allclose(at[closure.frame_a], at[closure.frame_b], atol=ROUNDING)
    np.testing.assert_allclose(at["a"], T(1, 2, 3, 0.1, 0.2, 0.3), atol=ROUNDING)
    assert robot.model.frames[robot.model.getFrameId(closure.frame_a)].parentJoint == 0


def test_joints_mixed_in_the_file_are_added_depth_first_so_that_crba_is_right(read):
    # Two chains that take turns in the file; M column by column from the independent rnea.
    names = [f"{side}{i}" for i in range(3) for side in "lr"]
    body = link("base") + "".join(
        link(n, pose("0.1 0.2 0.3 0.4 0.5 0.6", relative_to=before) + INERTIAL)
        + joint(f"j{n}", before, n)
        for n, before in zip(names, ["base", "base", *names], strict=False)
    )
    model = read(body).model
    data = model.createData()
    assert model.check(data)
    assert list(model.names)[1:] == ["jl0", "jl1", "jl2", "jr0", "jr1", "jr2"]
    model.gravity.setZero()
    q, zero = np.linspace(-1, 1, 6), np.zeros(6)
    M = np.triu(pin.crba(model, data, q))
    columns = np.column_stack([pin.rnea(model, data, q, zero, e) for e in np.eye(6)])
    np.testing.assert_allclose(M, np.triu(columns), atol=1e-13)


def test_a_chain_longer_than_python_s_recursion_limit_is_read(read):
    count = 1200
    body = link("l0") + "".join(
        link(f"l{i}", pose("0 0 0.01 0 0 0", relative_to=f"l{i - 1}") + INERTIAL)
        + joint(f"j{i}", f"l{i - 1}", f"l{i}")
        for i in range(count, 0, -1)  # backwards, so that the first pose asks for all others
    )
    model = read(body).model
    assert model.nv == count
    # No kinematics here: the memory of pin.Data grows with the cube of the number of joints.
    steps = np.array([placement.translation for placement in model.jointPlacements])
    np.testing.assert_allclose(steps[2:], np.tile([0, 0, 0.01], (count - 1, 1)), atol=1e-12)
    assert list(model.parents)[1:] == list(range(count))


def test_the_result_can_be_sent_to_another_process(cassie):
    again = pickle.loads(pickle.dumps(cassie))
    assert again.closures == cassie.closures
    assert again.springs == cassie.springs
    assert again.model == cassie.model


# What is wrong with a file ----------------------------------------------------------------------

AB = link("a") + link("b")
AXIS = "<axis><xyz>0 0 1</xyz></axis>"
LOOP = AB + link("c") + joint("ab", "a", "b") + joint("ac", "a", "c")


def moving(inside: str) -> str:
    return link("a") + link("b", inside) + joint("j", "a", "b")


WRONG = {
    "a pose that is relative to itself": (
        link("a", pose("", relative_to="b")) + link("b", pose("", relative_to="a")),
        "circle",
    ),
    "a frame attached to itself": (link("a") + '<frame name="f" attached_to="f"/>', "circle"),
    "a pose relative to nothing known": (link("arm", pose("", relative_to="amr")), "'amr'"),
    "an axis in an unknown frame": (
        AB + joint("j", "a", "b", inside='<axis><xyz expressed_in="k">0 0 1</xyz></axis>'),
        "<joint> 'j'.*'k'",
    ),
    "an inertial pose in an unknown frame": (
        moving(INERTIAL.replace("<mass>", pose("", relative_to="k") + "<mass>")),
        "<link> 'b'.*'k'",
    ),
    "a model placed in an unknown frame": (pose("", relative_to="k") + AB, "'k'"),
    "two links of one name": (link("a") * 2, "rename"),
    "a link and a joint of one name": (AB + joint("a", "a", "b"), "rename"),
    "a link without a name": ('<link name=""/>', "name"),
    "a link called world": (link("world"), "'world'"),
    "a link named as a closure's frame": (
        LOOP + joint("cut", "b", "c", "ball") + '<frame name="cut_a"/>',
        "'cut_a'",
    ),
    "a link named as Pinocchio's universe": (link("universe"), "'universe'"),
    "a joint without a parent": (
        AB + '<joint name="j" type="ball"><child>b</child></joint>',
        "'j': no <parent>",
    ),
    "a joint without a child": (
        AB + '<joint name="j" type="ball"><parent>b</parent></joint>',
        "'j': no <child>",
    ),
    "a joint with two children": (
        AB + joint("j", "a", "b", inside="<child>a</child>" + AXIS),
        "<child> is there 2 times",
    ),
    "a joint with an unknown parent": (AB + joint("j", "aa", "b"), "'j'.*'aa'"),
    "a joint with an unknown child": (AB + joint("j", "a", "bb"), "'j'.*'bb'"),
    "a joint of a link with itself": (AB + joint("j", "a", "a"), "'j'.*another child"),
    "a joint whose child is the world": (AB + joint("j", "a", "world"), "'j'.*another child"),
    "a moving link without inertial": (moving(""), "'b' moves and has no <inertial>"),
    "a moving link without mass": (
        moving(INERTIAL.replace("<mass>2</mass>", "")),
        "'b': no <inertial/mass>",
    ),
    "a moving link of mass zero": (moving(INERTIAL.replace(">2<", ">0<")), "'b' moves.*0 kg"),
    "a moving link of negative mass": (moving(INERTIAL.replace(">2<", ">-2<")), "-2 kg"),
    "a moving link without inertia": (
        moving("<inertial><mass>2</mass></inertial>"),
        "'b': no <inertial/inertia/ixx>",
    ),
    "an inertia that is not positive": (
        moving(INERTIAL.replace("<ixx>0.1", "<ixx>-0.1")),
        "principal moment -0.1",
    ),
    "a mass that others compute": (
        moving('<inertial auto="true"/>'),
        "<inertial auto>",
    ),
    "a mass that is no number": (moving(INERTIAL.replace(">2<", ">two<")), "'b'.*'two'"),
    "a mass that is empty": (moving(INERTIAL.replace(">2<", "><")), "'b'.*mass.*1 number"),
    "a number as only Python reads it": (moving(INERTIAL.replace(">2<", ">1_0<")), "1_0"),
    "a mass that is infinite": (moving(INERTIAL.replace(">2<", ">inf<")), "finite"),
    "a pose that is not a number": (link("a", pose("0 0 nan 0 0 0")), "finite"),
    "a limit that is not a number": (
        AB + joint("j", "a", "b", inside=axis("<lower>nan</lower>")),
        "finite",
    ),
    "a pose of five numbers": (link("a", pose("0 0 0 0 0")), "'a'.*6 number"),
    "a pose in degrees": (link("a", pose("0 0 0 0 0 90", degrees="true")), "'a'.*rad"),
    "a pose with a quaternion": (
        link("a", pose("0 0 0 0 0 0 1", rotation_format="quat_xyzw")),
        "'a'.*roll",
    ),
    "an axis of two numbers": (
        AB + joint("j", "a", "b", inside="<axis><xyz>0 1</xyz></axis>"),
        "'j'.*3 number",
    ),
    "an axis of length zero": (
        AB + joint("j", "a", "b", inside="<axis><xyz>0 0 0</xyz></axis>"),
        "'j'.*direction",
    ),
    "a hinge without axis": (AB + joint("j", "a", "b", inside=""), "'j'.*<axis/xyz>"),
    "a flag that is no flag": (
        AB
        + joint(
            "j",
            "a",
            "b",
            inside="<axis><xyz>0 0 1</xyz>"
            "<use_parent_model_frame>yes</use_parent_model_frame></axis>",
        ),
        "'yes'",
    ),
    "limits the wrong way round": (
        AB + joint("j", "a", "b", inside=axis("<lower>1</lower><upper>-1</upper>")),
        "'j'.*exchange",
    ),
    "links that no joint connects": (AB, "one root.*'a', 'b'"),
    "a link that two trees would share": (
        link("a") + link("b") + link("c") + joint("ac", "a", "c") + joint("bc", "b", "c", "ball"),
        "one root.*'a', 'b'",
    ),
    "an island of links": (
        LOOP + link("d") + link("e") + joint("de", "d", "e", "ball") + joint("ed", "e", "d"),
        "no joint leads from 'a' to the links 'd', 'e'",
    ),
    "a ring without a root": (AB + joint("ab", "a", "b") + joint("ba", "b", "a"), "root="),
    "a link beside one fixed to the world": (
        AB + joint("wa", "world", "a", "fixed"),
        "no joint leads from 'world' to the links 'b'",
    ),
    "a model without links": ("", "no <link>"),
    "a model inside the model": (link("a") + '<model name="m"/>', "<model>"),
    "an include inside the model": (link("a") + "<include/>", "<include>"),
    "a joint without a type": (AB + joint("j", "a", "b", ""), "'j' has the type ''"),
}


@pytest.mark.parametrize(("body", "says"), WRONG.values(), ids=WRONG)
def test_a_wrong_model_is_refused_with_the_reason(read, body, says):
    with pytest.raises(InvalidModel, match=rf"robot\.sdf: .*{says}"):
        read(body)


@pytest.mark.parametrize("kind", ["gearbox", "screw", "universal", "revolute2", "spring"])
def test_a_joint_of_an_unsupported_type_is_named_with_what_would_do(read, kind):
    with pytest.raises(InvalidModel, match=f"'j' has the type '{kind}'.*kinds.*drop"):
        read(AB + joint("j", "a", "b", kind))
    assert read(AB + joint("j", "a", "b", kind), kinds={"j": "revolute"}).model.nv == 1


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
def test_a_hinge_or_slider_that_closes_a_loop_is_named_with_what_would_do(read, kind):
    with pytest.raises(InvalidModel, match=rf"'bc' closes a loop and is {kind}.*kinds.*elsewhere"):
        read(LOOP + joint("bc", "b", "c", kind))
    assert read(LOOP + joint("bc", "b", "c", kind), kinds={"bc": "ball"}).closures[0].kind == "ball"


def test_a_joint_that_is_left_out_may_be_of_any_type(read):
    robot = read(LOOP + joint("bc", "b", "c", "screw", ""), drop=["bc"])
    assert robot.closures == ()
    assert robot.unused == ("joints left out: 'bc'",)


def test_two_things_named_like_the_root_joint_are_refused(read):
    body = AB + joint("root_joint", "a", "b")
    with pytest.raises(InvalidModel, match="'root_joint'"):
        read(body, root_joint=pin.JointModelFreeFlyer())
    assert read(body).model.nv == 1


def test_a_root_that_is_not_the_one_on_the_world_is_refused(read):
    with pytest.raises(InvalidModel, match="root 'b' is not"):
        read(AB + joint("wa", "world", "a") + joint("ab", "a", "b"), root="b")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"root": "aa"}, "no link named 'aa'"),
        ({"drop": ["jj"]}, "no joint named 'jj'; did you mean 'j'"),
        ({"kinds": {"jj": "ball"}}, "no joint named 'jj'; did you mean 'j'"),
        ({"kinds": {"j": "bal"}}, "no joint type named 'bal'; did you mean 'ball'"),
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
    "an old version": ('<sdf version="1.4"/>', "'1.4'; 1.5 or later"),
    "a version that is none": ('<sdf version="new"/>', "'new'; 1.5 or later"),
    "no model": ('<sdf version="1.7"><world name="w"/></sdf>', "no <model>"),
    "two models": ('<sdf version="1.7"><model name="m"/><model name="n"/></sdf>', "'m', 'n'"),
}


@pytest.mark.parametrize(("text", "says"), FILES.values(), ids=FILES)
def test_a_file_that_is_not_one_sdf_model_is_refused_with_the_reason(tmp_path, text, says):
    path = tmp_path / "robot.sdf"
    path.write_text(text)
    with pytest.raises(InvalidModel, match=rf"robot\.sdf: .*{says}"):
        read_sdf(path)


def test_a_file_that_does_not_exist_is_refused_by_name(tmp_path):
    with pytest.raises(InvalidModel, match=r"nowhere\.sdf"):
        read_sdf(tmp_path / "nowhere.sdf")


def test_a_model_inside_a_world_of_version_1_10_is_read(tmp_path):
    path = tmp_path / "robot.sdf"
    path.write_text(
        '<sdf version="1.10"><world name="w"><light/>'
        f'<model name="m">{link("a")}</model></world></sdf>'
    )
    robot = read_sdf(path)
    assert robot.model.name == "m"
    assert robot.unused == ("elements that are not read: 1 <light>",)


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


def test_an_axis_is_normalised_whatever_its_size(read):
    for size in ("1e-200", "1", "1e15"):
        inside = f"<axis><xyz>0 {size} {size}</xyz></axis>"
        model = read(AB + joint("j", "a", "b", inside=inside)).model
        at = frame_poses(model, np.array([0.5]))
        expected = Rotation.from_rotvec(0.5 * np.array([0, 1, 1]) / np.sqrt(2)).as_matrix()
        np.testing.assert_allclose(at["b"][:3, :3], expected, atol=ROUNDING)


# Anything at all --------------------------------------------------------------------------------

VALID = (
    '<sdf version="1.9"><model name="m">'
    + ARM
    + joint("loop", "base", "finger", "ball")
    + "</model></sdf>"
)
# Cut so that every second piece is a value: a text or an attribute. XML stays well-formed.
PIECES = re.split(r'(?<=[>"])([^<>"=]+)(?=[<"])', VALID)
VALUES = PIECES[1::2]
WORDS = ("", "nan", "-inf", "1e999", "1e-320", "1e300", "-1", "0", "\x00", "<", "&x;")
NAMES = ("world", "universe", "__model__", "base", "link", "joint", "model", "fixed", "universal")
STRANGE = st.one_of(st.sampled_from(WORDS + NAMES), st.sampled_from(VALUES), st.text(max_size=5))


def only_a_model_or_a_condyn_error(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        robot = read_sdf(path)
    except CondynError:
        return
    at = frame_poses(robot.model, pin.neutral(robot.model))
    for placement in at.values():
        assert np.isfinite(placement).all()
    for closure in robot.closures:
        np.testing.assert_allclose(at[closure.frame_a], at[closure.frame_b], rtol=1e-12, atol=1e-12)


@pytest.fixture(scope="module")
def fuzz_file(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz") / "fuzz.sdf"


def test_the_file_that_is_mutated_below_is_a_valid_one(fuzz_file):
    fuzz_file.write_text(VALID)
    assert [c.name for c in read_sdf(fuzz_file).closures] == ["loop"]


@settings(max_examples=50, deadline=None)
@given(end=st.integers(0, len(VALID) - 1), closed=st.booleans())
def test_a_truncated_file_gives_a_condyn_error(fuzz_file, end, closed):
    tail = "</model></sdf>" if closed else ""
    only_a_model_or_a_condyn_error(fuzz_file, (VALID[:end] + tail).encode())


@settings(max_examples=300, deadline=None)
@given(edits=st.lists(st.tuples(st.integers(0, len(VALUES) - 1), STRANGE), min_size=1, max_size=3))
def test_a_file_with_strange_values_gives_a_model_or_a_condyn_error(fuzz_file, edits):
    pieces = list(PIECES)
    for at, value in edits:
        pieces[2 * at + 1] = value
    text = "".join(pieces)
    only_a_model_or_a_condyn_error(fuzz_file, text.encode("utf-8", "surrogatepass"))


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_a_file_with_elements_lost_or_moved_gives_a_model_or_a_condyn_error(fuzz_file, data):
    sdf = ElementTree.fromstring(VALID)
    for _ in range(data.draw(st.integers(1, 3))):
        places = [(owner, element) for owner in sdf.iter() for element in owner]
        if not places:
            break
        owner, element = data.draw(st.sampled_from(places))
        if data.draw(st.booleans(), label="keep the element"):
            to = data.draw(st.sampled_from([sdf, *(place[1] for place in places)]))
            to.append(deepcopy(element))
        else:
            owner.remove(element)
    only_a_model_or_a_condyn_error(fuzz_file, ElementTree.tostring(sdf))


@settings(max_examples=50, deadline=None)
@given(at=st.integers(0, len(VALID) - 1), byte=st.integers(0, 255))
def test_a_file_with_a_wrong_byte_gives_a_model_or_a_condyn_error(fuzz_file, at, byte):
    content = bytearray(VALID.encode())
    content[at] = byte
    only_a_model_or_a_condyn_error(fuzz_file, bytes(content))
