"""The SDF reader: which joints make the tree, and which are cut."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from sdf_texts import INERTIAL, ROUNDING, T, closures, frame_poses, joint, link, pose, springs
from shared import each_row

from condyn_pin.errors import InvalidModel, UnknownName
from condyn_pin.io.description import Description


def cuts(robot) -> list[tuple[str, str]]:
    return [(closure.name, closure.kind) for closure in closures(robot)]


RING = [("ab", "a", "b"), ("ac", "a", "c"), ("bc", "b", "c")]


def ring(*kinds: str) -> str:
    """Three links in a ring of three joints."""
    sides = (joint(*side, kind) for side, kind in zip(RING, kinds, strict=True))
    return "".join(map(link, "abc")) + "".join(sides)


@pytest.mark.parametrize(
    ("kinds", "cut"),
    [
        (("revolute", "revolute", "revolute"), ("bc", "hinge")),  # among equals the last
        (("prismatic", "prismatic", "prismatic"), ("bc", "slider")),
        (("continuous", "prismatic", "continuous"), ("bc", "hinge")),
        (("revolute", "ball", "revolute"), ("ac", "ball")),
        (("ball", "revolute", "ball"), ("bc", "ball")),
        (("revolute", "revolute", "fixed"), ("ac", "hinge")),
        (("fixed", "ball", "prismatic"), ("ac", "ball")),
        (("revolute", "fixed", "universal"), ("ab", "hinge")),
    ],
)
def test_a_loop_is_cut_at_its_joint_of_most_freedom(read, kinds, cut):
    body = ring(*kinds)
    if "universal" in kinds:
        body = body.replace(
            "<child>c</child><axis><xyz>0 0 1</xyz></axis></joint>",
            "<child>c</child><axis><xyz>0 0 1</xyz></axis><axis2><xyz>1 0 0</xyz></axis2></joint>",
        )
    assert cuts(read(body)) == [cut]


@each_row("kind", ["fixed", "revolute", "prismatic", "ball"])
def test_a_joint_between_links_that_are_fixed_to_each_other_closes_nothing(read, kind):
    body = ring("fixed", "fixed", kind) + link("d") + joint("ad", "a", "d")
    robot = read(body)
    assert closures(robot) == ()
    assert robot.model.nv == 1
    assert "joints between links that cannot move against each other: 'bc'" in robot.unused


@pytest.mark.long
def test_a_joint_with_a_spring_is_kept_before_one_without(read):
    spring = (
        "<axis><xyz>0 0 1</xyz><dynamics><spring_stiffness>3</spring_stiffness></dynamics></axis>"
    )
    body = "".join(map(link, "abc")) + joint("ab", "a", "b") + joint("ac", "a", "c")
    robot = read(body + joint("bc", "b", "c", inside=spring))
    assert cuts(robot) == [("ac", "hinge")]
    assert springs(robot) == {"bc": (3.0, 0.0)}


def test_a_joint_with_a_motor_is_cut_last_and_whole(read):
    body = ring("revolute", "ball", "revolute")
    assert cuts(read(body, actuated=["ac"])) == [("bc", "hinge")]
    assert cuts(read(body, actuated=["ac", "bc"])) == [("ab", "hinge")]
    assert cuts(read(ring("fixed", "revolute", "revolute"), actuated=["ac", "bc"])) == [
        ("ab", "weld")
    ]
    motors = ["ab", "ac", "bc"]
    driven = read(body, actuated=motors).robot(name="driven", actuated=motors)
    assert {*motors} <= {*driven.joints}


@pytest.mark.long
def test_a_joint_to_cut_may_be_named(read):
    body = ring("revolute", "ball", "revolute")
    assert cuts(read(body, cut=["ab"])) == [("ab", "hinge")]
    with pytest.raises(UnknownName, match="no joint named 'ba'; known: ab, ac, bc"):
        read(body, cut=["ba"])
    assert cuts(read(body, cut=["ab"], actuated=["ab"])) == [("ab", "hinge")]
    with pytest.raises(InvalidModel, match="'ab' cannot be cut: it is in no loop, or"):
        read(body, cut=["ab", "ac"])


ABC = "".join(map(link, "abc")) + joint("ab", "a", "b")


@pytest.mark.parametrize(
    ("body", "root", "cut", "tree", "backwards"),
    [
        (joint("ac", "a", "c", "ball") + joint("bc", "b", "c"), None, "ac", "bc", ()),
        (joint("cb", "c", "b") + joint("ac", "a", "c", "ball"), None, "ac", "cb", ("cb",)),
        # a first parent that hangs below its child
        (joint("cb", "c", "b", "ball", "") + joint("bc", "b", "c"), None, "cb", "bc", ()),
        # a ring without a root
        (joint("bc", "b", "c") + joint("ca", "c", "a", "ball", ""), "a", "ca", "bc", ()),
    ],
)
def test_the_direction_of_a_joint_does_not_matter(read, body, root, cut, tree, backwards):
    robot = read(ABC + body, root=root)
    assert cuts(robot) == [(cut, "ball")]
    assert list(robot.model.names) == ["universe", "ab", tree]
    assert robot.reversed == backwards


# A tree that runs against its joints ------------------------------------------------------------

TWISTED = (
    link("a")
    + link("b", pose("0.3 0.1 0 0.2 0 0") + INERTIAL)
    + link("c", pose("0.6 0 0.2 0 0.4 0") + INERTIAL)
    + joint("ab", "a", "b", inside=pose("0.1 0 0 0.3 0 0") + "<axis><xyz>1 2 3</xyz></axis>")
    + joint("bc", "b", "c", "prismatic", pose("0 0.2 0 0 0 0.5") + "<axis><xyz>0 1 1</xyz></axis>")
)


def pose_between(robot: Description, q: np.ndarray, first: str, second: str) -> np.ndarray:
    at = frame_poses(robot.model, q)
    return np.linalg.inv(at[first]) @ at[second]


def test_a_tree_that_is_read_from_its_other_end_has_the_same_coordinates(read):
    limits = "<limit><lower>-1</lower><upper>2</upper><effort>3</effort></limit>"
    dynamics = "<dynamics><damping>0.5</damping><spring_stiffness>7</spring_stiffness></dynamics>"
    body = TWISTED.replace("3</xyz></axis>", f"3</xyz>{limits}{dynamics}</axis>")
    forth, back = read(body), read(body, root="c")
    assert (forth.reversed, back.reversed) == ((), ("bc", "ab"))
    assert list(back.model.names) == ["universe", "bc", "ab"]
    q = {"ab": 0.7, "bc": -0.4}
    for first, second in (("a", "b"), ("a", "c"), ("c", "b")):
        np.testing.assert_allclose(
            pose_between(back, np.array([q["bc"], q["ab"]]), first, second),
            pose_between(forth, np.array([q["ab"], q["bc"]]), first, second),
            atol=ROUNDING,
        )
    assert springs(back) == springs(forth) == {"ab": (7.0, 0.0)}
    assert back.model.lowerPositionLimit[1] == forth.model.lowerPositionLimit[0] == -1
    assert back.model.upperPositionLimit[1] == forth.model.upperPositionLimit[0] == 2
    assert back.model.effortLimit[1] == forth.model.effortLimit[0] == 3
    assert back.model.damping[1] == forth.model.damping[0] == 0.5


@pytest.mark.long
def test_the_quaternion_of_a_reversed_ball_is_the_inverse(read):
    body = TWISTED.replace('"prismatic"', '"ball"')
    forth, back = read(body), read(body, root="c")
    quaternion = Rotation.from_rotvec([0.3, -0.5, 0.2])
    q = np.concatenate([[0.7], quaternion.as_quat()])
    inverse = np.concatenate([quaternion.inv().as_quat(), [0.7]])
    np.testing.assert_allclose(
        pose_between(back, inverse, "a", "c"), pose_between(forth, q, "a", "c"), atol=ROUNDING
    )


@pytest.mark.long
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_the_frames_of_a_cut_hinge_or_slider_have_z_along_the_axis(read, kind):
    body = "".join(map(link, "abc")) + joint("ab", "a", "b") + joint("ac", "a", "c")
    inside = pose("0.1 0.2 0.3 0.4 0.5 0.6") + "<axis><xyz>1 -2 2</xyz></axis>"
    robot = read(body + joint("bc", "b", "c", kind, inside))
    (closure,) = closures(robot)
    at = frame_poses(robot.model, pin.neutral(robot.model))
    for frame in (closure.frame_a, closure.frame_b):
        drawn = T(0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
        np.testing.assert_allclose(at[frame][:3, 3], drawn[:3, 3], atol=ROUNDING)
        axis = drawn[:3, :3] @ np.array([1, -2, 2]) / 3
        np.testing.assert_allclose(at[frame][:3, 2], axis, atol=ROUNDING)
    np.testing.assert_allclose(at[closure.frame_a], at[closure.frame_b], atol=ROUNDING)


@pytest.mark.long
def test_closure_frames_move_with_their_links(read):
    body = link("a") + link("b", pose("1 0 0 0 0 0") + INERTIAL)
    body += link("c", pose("0 1 0 0 0 0") + INERTIAL)
    body += joint("ab", "a", "b") + joint("ac", "a", "c")
    robot = read(body + joint("bc", "b", "c", "ball", pose("1 0 0 0 0 0")))  # drawn at (1, 1, 0)
    (closure,) = closures(robot)
    at = frame_poses(robot.model, np.array([np.pi / 2, 0.0]))  # b turns in place, c stays
    np.testing.assert_allclose(at[closure.frame_a][:3, 3], [0, 0, 0], atol=ROUNDING)
    np.testing.assert_allclose(at[closure.frame_b][:3, 3], [1, 1, 0], atol=ROUNDING)


@pytest.mark.long
def test_a_loop_through_the_world_is_closed_at_neutral(read):
    body = pose("1 2 3 0.1 0.2 0.3") + "".join(map(link, "ab"))
    body += joint("wa", "world", "a") + joint("ab", "a", "b")
    robot = read(body + joint("wb", "world", "b", "ball", pose("1 0 0 0 0 0")))
    at = frame_poses(robot.model, pin.neutral(robot.model))
    closure = closures(robot)[0]
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
