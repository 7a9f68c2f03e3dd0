"""The SDF reader: universal joints as two hinges, gearboxes as couplings."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from sdf_texts import (
    AB,
    INERTIAL,
    ROUNDING,
    T,
    closures,
    couplings,
    frame_poses,
    joint,
    link,
    pose,
    springs,
)
from shared import each_row

import condyn_pin as cp
from condyn_pin.constraints import Coupling
from condyn_pin.errors import InvalidModel
from condyn_pin.model import Robot

AXES = "<axis><xyz>0 0 1</xyz></axis><axis2><xyz>1 0 0</xyz></axis2>"


@pytest.mark.parametrize("kind", ["universal", "revolute2"])
@pytest.mark.parametrize("root", ["a", "b"])
def test_a_universal_joint_turns_about_the_parent_s_axis_and_then_the_child_s(read, kind, root):
    axes = "<axis><xyz>0 1 2</xyz></axis><axis2><xyz>3 1 0</xyz></axis2>"
    drawn = pose("0.1 0.2 0.3 0.4 0.5 0.6")
    body = link("a") + link("b", pose("0.5 0 0.1 0 0 1") + INERTIAL)
    robot = read(body + joint("u", "a", "b", kind, drawn + axes), root=root)
    first, second = 0.7, -0.3
    q = [first, second] if root == "a" else [second, first]
    names = ["u_axis", "u_axis2"] if root == "a" else ["u_axis2", "u_axis"]
    assert list(robot.model.names)[1:] == names

    b = T(0.5, 0, 0.1, 0, 0, 1)
    at_joint = b @ T(0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    turn = np.eye(4)
    turn[:3, :3] = (
        Rotation.from_rotvec(first * np.array([0, 1, 2]) / np.sqrt(5))
        * Rotation.from_rotvec(second * np.array([3, 1, 0]) / np.sqrt(10))
    ).as_matrix()
    at = frame_poses(robot.model, np.array(q))
    np.testing.assert_allclose(
        np.linalg.inv(at["a"]) @ at["b"],
        at_joint @ turn @ np.linalg.inv(at_joint) @ b,
        atol=ROUNDING,
    )


@pytest.mark.long
def test_a_universal_joint_has_a_regular_mass_matrix_although_its_cross_is_massless(read):
    robot = read(AB + joint("u", "a", "b", "universal", AXES))
    assert robot.model.inertias[1].mass == 0
    Robot("u", robot.model)  # which looks at M
    # A body of inertia 0.1 about its centre, turned about z and then its own x: M = 0.1 * 1.
    M = pin.crba(robot.model, robot.model.createData(), np.array([0.3, 0.8]))
    np.testing.assert_allclose(np.triu(M), 0.1 * np.eye(2), atol=ROUNDING)


@pytest.mark.long
def test_each_axis_of_a_universal_joint_has_its_own_settings(read):
    def said(axis: str, damping: float, stiffness: float, upper: float) -> str:
        return (
            f"<limit><upper>{upper}</upper></limit><dynamics><damping>{damping}</damping>"
            f"<spring_stiffness>{stiffness}</spring_stiffness></dynamics></{axis}>"
        )

    inside = AXES.replace("</axis>", said("axis", 0.1, 5, 1))
    robot = read(
        AB + joint("u", "a", "b", "universal", inside.replace("</axis2>", said("axis2", 0.2, 6, 2)))
    )
    assert robot.model.damping.tolist() == [0.1, 0.2]
    assert robot.model.upperPositionLimit.tolist() == [1, 2]
    assert springs(robot) == {"u_axis": (5.0, 0.0), "u_axis2": (6.0, 0.0)}


UNIVERSAL_WRONG = {
    "without its second axis": (joint("u", "a", "b", "universal"), "'u' is universal.*<axis2/xyz>"),
    "with parallel axes": (
        joint("u", "a", "b", "universal", AXES.replace("1 0 0", "0 0 -2")),
        "'u' is universal and its <axis> and <axis2> are parallel",
    ),
    "whose hinge has a taken name": (
        joint("u", "a", "b", "universal", AXES) + link("u_axis2"),
        "'u' is universal and needs the name 'u_axis2'",
    ),
}  # fmt: skip


@each_row(("body", "says"), UNIVERSAL_WRONG)
def test_a_wrong_universal_joint_is_refused_with_the_reason(read, body, says):
    with pytest.raises(InvalidModel, match=says):
        read(AB + body)


@pytest.mark.long
def test_a_universal_joint_is_not_cut(read):
    links = "".join(map(link, "abc")) + joint("ab", "a", "b") + joint("ac", "a", "c")
    assert [c.name for c in closures(read(links + joint("u", "b", "c", "universal", AXES)))] == [
        "ac"
    ]
    pair = joint("u", "a", "b", "universal", AXES) + joint("w", "a", "b", "universal", AXES)
    with pytest.raises(InvalidModel, match=r"'w_axis2' is half of a universal joint.*kinds"):
        read(AB + pair)
    assert closures(read(AB + pair, kinds={"w": "ball"}))[0].kind == "ball"
    with pytest.raises(InvalidModel, match="'u_axis' cannot be cut: it is half of a universal"):
        read(links + joint("u", "b", "c", "universal", AXES), cut=["u_axis"])


# Gearboxes --------------------------------------------------------------------------------------


def gears(rotor: str, output: str, box: str, reference: str = "a", ratio: str = "0.04") -> str:
    """Return a rotor b and an output c on a link a, and the gearbox between them."""
    said = (
        f"<gearbox_ratio>{ratio}</gearbox_ratio>"
        f"<gearbox_reference_body>{reference}</gearbox_reference_body>"
    )
    return "".join(map(link, "abc")) + rotor + output + joint("g", "b", "c", "gearbox", said + box)


def box(axis: str = "0 0 1", axis2: str = "0 0 1") -> str:
    return f"<axis><xyz>{axis}</xyz></axis><axis2><xyz>{axis2}</xyz></axis2>"


UP, DOWN = "<axis><xyz>0 0 1</xyz></axis>", "<axis><xyz>0 0 -1</xyz></axis>"
ROTOR, OUTPUT = joint("ip", "a", "b"), joint("op", "a", "c")


def angle_about(at: dict[str, np.ndarray], link_name: str, axis: np.ndarray) -> float:
    """Return the angle from link a to another about an axis of a."""
    R = at["a"][:3, :3].T @ at[link_name][:3, :3]
    return float(Rotation.from_matrix(R).as_rotvec() @ axis)


@pytest.mark.pairs
@pytest.mark.parametrize(
    "rotor", [ROTOR, joint("ip", "a", "b", inside=DOWN), joint("ip", "b", "a")]
)
@pytest.mark.parametrize("output", [OUTPUT, joint("op", "a", "c", inside=DOWN)])
@pytest.mark.parametrize("axis", ["0 0 1", "0 0 -1"])
@pytest.mark.parametrize("axis2", ["0 0 1", "0 0 -1"])
def test_a_gearbox_couples_the_angles_that_the_format_defines(read, rotor, output, axis, axis2):
    robot = read(gears(rotor, output, box(axis, axis2)), root="a")
    (coupling,) = couplings(robot)
    assert (coupling.name, coupling.joint_a, coupling.joint_b) == ("g", "op", "ip")
    assert abs(coupling.ratio) == 0.04
    model = robot.model
    q = np.zeros(2)
    q[model.joints[model.getJointId("ip")].idx_q] = 2.0
    q[model.joints[model.getJointId("op")].idx_q] = coupling.ratio * 2.0 + coupling.offset
    at = frame_poses(model, q)
    theta_1 = angle_about(at, "b", np.array([float(x) for x in axis.split()]))
    theta_2 = angle_about(at, "c", np.array([float(x) for x in axis2.split()]))
    assert abs(theta_1) == pytest.approx(2.0, rel=1e-14)
    assert theta_2 == pytest.approx(-0.04 * theta_1, rel=1e-13)


@pytest.mark.long
def test_a_gearbox_is_no_loop_and_no_joint(read):
    robot = read(gears(ROTOR, OUTPUT, box()))
    assert closures(robot) == ()
    assert couplings(robot) == (Coupling("op", "ip", -0.04, name="g"),)
    assert list(robot.model.names) == ["universe", "ip", "op"]


@pytest.mark.long
def test_a_rotor_behind_a_gearbox_is_felt_with_the_square_of_the_ratio(read):
    # Both bodies turn about an axis through their centres, inertia I = 0.1 each:
    # (I + I / ratio²) a_op = tau_op, and a_ip = a_op / -ratio.
    said = read(gears(ROTOR, OUTPUT, box()))
    geared = Robot("geared", said.model, loops=couplings(said))
    v = np.array([25.0, -1.0])  # J v = 0
    solution = cp.solve(cp.Scene(geared, geared.loops), np.zeros(2), v, np.array([0.0, 3.0]))
    a_op = 3.0 / (0.1 + 0.1 / 0.04**2)
    np.testing.assert_allclose(solution.a, [-a_op / 0.04, a_op], rtol=1e-9)


@pytest.mark.long
def test_the_hinges_of_a_gearbox_are_not_cut(read):
    body = gears(ROTOR, OUTPUT, box()) + link("d") + joint("ad", "a", "d")
    robot = read(body + joint("cd", "c", "d", "fixed", ""))
    assert [c.name for c in closures(robot)] == ["ad"]
    with pytest.raises(InvalidModel, match="'op' cannot be cut: it is a hinge of the gearbox 'g'"):
        read(gears(ROTOR, OUTPUT, box()), cut=["op"])


@pytest.mark.long
def test_a_gearbox_may_be_read_as_a_hinge(read):
    robot = read(gears(ROTOR, OUTPUT, box()), kinds={"g": "revolute"})
    assert couplings(robot) == ()
    assert [(c.name, c.kind) for c in closures(robot)] == [("g", "hinge")]
    assert "joint types of the file: 'g' (gearbox as revolute)" in robot.unused


GEARBOX_WRONG = {
    "a ratio of zero": (gears(ROTOR, OUTPUT, box(), ratio="0"), "'g'.*<gearbox_ratio> is 0"),
    "a ratio that is no number": (gears(ROTOR, OUTPUT, box(), ratio="nan"), "'g'.*finite"),
    "an unknown reference": (
        gears(ROTOR, OUTPUT, box(), reference="aa"), "'g': <gearbox_reference_body>.*'aa'",
    ),
    "no reference": (
        gears(ROTOR, OUTPUT, box()).replace("<gearbox_reference_body>a</gearbox_reference_body>",
        ""), "'g' is a gearbox and has no <gearbox_reference_body>",
    ),
    "no second axis": (gears(ROTOR, OUTPUT, UP), "'g' is gearbox and has no <axis2/xyz>"),
    "an axis across its hinge": (
        gears(ROTOR, OUTPUT, box(axis="1 0 0")),
        "'g' is a gearbox, and its axis for 'b' is not that of the hinge 'ip'",
    ),
    "a reference that is no neighbour": (
        gears(ROTOR, joint("op", "b", "c"), box()),
        "'g' is a gearbox, and no revolute joint connects 'c' to its reference body 'a'",
    ),
}  # fmt: skip


@each_row(("body", "says"), GEARBOX_WRONG)
def test_a_wrong_gearbox_is_refused_with_the_reason(read, body, says):
    with pytest.raises(InvalidModel, match=rf"robot\.sdf: .*{says}"):
        read(body)


@pytest.mark.long
def test_a_second_axis_that_the_type_has_not_is_reported(read):
    assert "second axis: 'j'" in read(AB + joint("j", "a", "b", inside=AXES)).unused


# Mimics and screws ------------------------------------------------------------------------------


def mimic(leader: str, multiplier: str = "2", axis: str = "") -> str:
    at = f' axis="{axis}"' if axis else ""
    return (
        f'<axis><xyz>0 0 1</xyz><mimic joint="{leader}"{at}><multiplier>{multiplier}</multiplier>'
        "<offset>0.3</offset><reference>0.1</reference></mimic></axis>"
    )


ABC = AB + link("c")


@pytest.mark.long
def test_a_mimic_is_a_coupling_with_an_offset(read):
    robot = read(ABC + joint("lead", "a", "b") + joint("follow", "a", "c", inside=mimic("lead")))
    assert couplings(robot) == (Coupling("follow", "lead", 2.0, 0.3 - 2 * 0.1),)
    said = Robot("geared", robot.model, loops=robot.loops)
    values = said.joint_values(cp.Scene(said, said.loops).sample(np.random.default_rng(0))[0])
    assert values["follow"] == pytest.approx(2 * (values["lead"] - 0.1) + 0.3, abs=1e-9)


@pytest.mark.long
def test_both_axes_of_a_universal_joint_lead_and_follow(read):
    hooke = AXES.replace("</axis2>", mimic("h")[len("<axis><xyz>0 0 1</xyz>") : -7] + "</axis2>")
    body = ABC + joint("h", "a", "b") + joint("u", "b", "c", "universal", hooke)
    body += link("d") + joint("e", "c", "d", inside=mimic("u", "3", "axis2"))
    found = {(c.joint_a, c.joint_b, c.ratio) for c in couplings(read(body))}
    assert found == {("u_axis2", "h", 2.0), ("e", "u_axis2", 3.0)}


@pytest.mark.long
def test_joints_of_a_mimic_are_not_cut(read):
    ends = joint("lead", "a", "b") + joint("follow", "a", "c", inside=mimic("lead"))
    loop = ABC + ends + joint("bc", "b", "c")
    assert [c.name for c in closures(read(loop))] == ["bc"]
    with pytest.raises(InvalidModel, match="'lead' cannot be cut: it is in the <mimic> 'follow~"):
        read(loop, cut=["lead"])


MIMIC_WRONG = {
    "of no joint": (mimic("leed"), "", "'f' mimics 'leed', and 'leed' by its 'axis' is no hinge"),
    "of a ball": (mimic("b"), joint("b", "a", "b", "ball", ""), "'b' by its 'axis' is no hinge"),
    "of an axis that is not there": (
        mimic("b", axis="axis2"), joint("b", "a", "b"), "'b' by its 'axis2' is no hinge",
    ),
    "of itself": (mimic("f"), "", "'f' mimic each other in a circle"),
    "of each other": (mimic("b"), joint("b", "a", "b", inside=mimic("f")), "in a circle"),
    "by nothing": (mimic("b", "0"), joint("b", "a", "b"), "'f'.*<multiplier> 0.*make it fixed"),
}  # fmt: skip


@each_row(("inside", "other", "says"), MIMIC_WRONG)
def test_a_wrong_mimic_is_refused_with_the_reason(read, inside, other, says):
    body = link("a") + link("b_") + link("c") + joint("f", "a", "c", inside=inside)
    with pytest.raises(InvalidModel, match=says):
        read(body + other.replace("<child>b<", "<child>b_<"))


@pytest.mark.parametrize("root", ["a", "b"])
@pytest.mark.parametrize(
    ("thread", "per_turn"),
    [
        ("<screw_thread_pitch>0.02</screw_thread_pitch>", 0.02),
        ("<thread_pitch>-100</thread_pitch>", 2 * np.pi / 100),
        ("<thread_pitch>5</thread_pitch><screw_thread_pitch>-3</screw_thread_pitch>", -3),
    ],
)
def test_a_screw_goes_its_pitch_in_a_turn(read, thread, per_turn, root):
    axis = thread + "<axis><xyz>0 3 4</xyz></axis>"
    robot = read(AB + joint("s", "a", "b", "screw", axis), root=root)
    at = frame_poses(robot.model, np.array([0.5]))
    M = np.linalg.inv(at["a"]) @ at["b"]
    along = np.array([0, 0.6, 0.8])
    np.testing.assert_allclose(pin.log3(M[:3, :3]), 0.5 * along, atol=ROUNDING)
    np.testing.assert_allclose(M[:3, 3], per_turn * 0.5 / (2 * np.pi) * along, atol=ROUNDING)


@pytest.mark.long
def test_a_screw_needs_a_thread_and_a_place_in_the_tree(read):
    with pytest.raises(InvalidModel, match="'s' is a screw and has no <screw_thread_pitch>"):
        read(AB + joint("s", "a", "b", "screw"))
    thread = "<screw_thread_pitch>1</screw_thread_pitch><axis><xyz>0 0 1</xyz></axis>"
    loop = ABC + joint("ab", "a", "b") + joint("s", "b", "c", "screw", thread)
    robot = read(loop + joint("ac", "a", "c"))
    assert [c.name for c in closures(robot)] == ["ac"]
    said = Robot("vice", robot.model, loops=robot.loops)
    assert cp.Scene(said, said.loops).summary().rows == 5
    with pytest.raises(InvalidModel, match="'s' cannot be cut: it is a screw"):
        read(loop + joint("ac", "a", "c"), cut=["s"])
