"""The MJCF reader against MuJoCo's own reading of the same file."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from fuzz import assert_survived
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from referee import MujocoReferee
from shared import axis_of, each_row
from shared import robot as shared_robot

import condyn_pin as cp

AGREES = 1e-12
INERTIAL = '<inertial pos="0.1 0.02 -0.03" mass="2" diaginertia="0.02 0.03 0.04"/>'


@pytest.fixture
def read(tmp_path: Path):
    """Read a model given as text."""

    def read_text(text: str) -> cp.Robot:
        path = tmp_path / "robot.xml"
        path.write_text(text)
        return cp.load_robot(path)

    return read_text


GEOM_OF_MESH = '<geom type="mesh" mesh="m"/>'


def body(inside: str, joint: str = '<joint name="j"/>') -> str:
    return f'<worldbody><body name="b">{joint}{inside}</body></worldbody>'


def relative(x: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(x - reference).max() / np.abs(reference).max())


def random_state(robot: cp.Robot, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    step, v = rng.normal(size=(2, robot.nv))
    return pin.integrate(robot.model, robot.postures["qpos0"], step), v


def pinocchio_terms(robot: cp.Robot, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    data = robot.model.createData()
    M = np.array(pin.crba(robot.model, data, q))
    M = np.triu(M) + np.triu(M, 1).T
    return M, np.array(pin.nonLinearEffects(robot.model, data, q, v))


EVERYTHING = f"""<mujoco model="everything"><compiler eulerseq="xYz"/>
<option gravity="1 2 -9"/>
<default><joint damping="0.1"/><default class="geared"><joint armature="0.2"/></default></default>
<worldbody>
  <site name="ceiling" pos="0 0 2" zaxis="1 1 0"/>
  <body name="base" pos="0.1 0.2 0.3" axisangle="1 2 3 40"><freejoint name="float"/>{INERTIAL}
    <body name="arm" pos="0.3 0 0" euler="10 20 -30" childclass="geared">{INERTIAL}
      <joint name="turn" axis="1 1 0" pos="0.1 -0.2 0.3" ref="20" range="-90 90"/>
      <joint name="push" type="slide" axis="0 1 2" pos="0.3 0 0" ref="0.2"/>
      <joint name="twist" axis="0 0 -3" pos="0 0.1 0" stiffness="5" springref="10"/>
      <site name="hand" pos="0 0 0.5" xyaxes="0 1 0 1 1 0"/>
      <body name="plate" pos="0 0.2 0" quat="1 0.2 0.3 0.4">
        <inertial pos="0 0 0.1" mass="0.5" fullinertia="0.01 0.02 0.025 0.001 0.002 0.003"/>
        <body name="wrist"><joint name="ball" type="ball" pos="0.05 0 0.1"/>{INERTIAL}</body>
      </body>
    </body>
  </body>
  <body name="post" pos="1 0 0"><body name="door" pos="0 1 0" euler="0 0 90">
    <joint name="hinge"/>{INERTIAL}</body></body>
</worldbody></mujoco>"""


BODIES = ("world", "base", "arm", "plate", "wrist", "post", "door")


@pytest.mark.parametrize("seed", range(3))
def test_every_joint_moves_as_in_mujoco(read, seed):
    robot = read(EVERYTHING)
    original = MujocoReferee(robot, EVERYTHING)
    q, v = random_state(robot, seed)
    M, h = pinocchio_terms(robot, q, v)
    # MuJoCo keeps principal axes of a full inertia, found to 1e-7
    assert relative(M, original.mass_matrix(q)) < 1e-7
    assert relative(h, original.bias(q, v)) < 1e-7
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    for kind, names in (("body", BODIES), ("site", ("ceiling", "hand"))):
        for k in names:
            at = getattr(original.data, kind)(k)
            joint, placement = robot.frame(at.name)
            oMf = data.oMi[joint] * placement
            assert np.abs(oMf.translation - at.xpos).max() < AGREES
            assert np.abs(np.array(oMf.rotation).ravel() - at.xmat).max() < AGREES


# Loops --------------------------------------------------------------------------------------------

TWO_ARMS = f"""<mujoco><compiler angle="radian"/><worldbody><site name="wall" pos="0.3 0.4 0.5"/>
<body pos="1 0 0" euler="0.3 0 0"><site name="at_sa" pos="0.1 0.2 0.3" euler="0.3 0.2 0.1"/></body>
<body name="a" pos="1 0 0" euler="0.3 0 0">{INERTIAL}<joint name="ja" ref="0.5" pos="0.1 0.2 0.3"/>
  <site name="sa" pos="0.1 0.2 0.3" euler="0.3 0.2 0.1"/>
  <body name="c" pos="0 0 1"><joint name="jc" type="ball"/>{INERTIAL}</body></body>
<body name="b" pos="0 2 0" euler="0 0.2 0">{INERTIAL}<joint name="jb" type="slide" ref="-0.1"/>
  <site name="sb" pos="0.1 0 0.3"/></body>
</worldbody><equality>EQUALITY</equality></mujoco>"""


@pytest.mark.parametrize(
    ("equality", "kind", "rows"),
    [
        ('<connect body1="c" body2="b" anchor="0.1 0.2 0.3"/>', "ball", 3),
        ('<connect body1="c" anchor="0.1 0.2 0.3"/>', "ball", 3),
        ('<connect site1="sa" site2="sb"/>', "ball", 3),
        ('<connect site1="wall" site2="sb"/>', "ball", 3),
        ('<weld body1="c" body2="b" anchor="0.01 0.02 0.03"/>', "weld", 6),
        ('<weld body1="c"/>', "weld", 6),
        ('<weld body1="c" body2="b" relpose="0.1 0.2 0.3 0.9 0.1 0 0"/>', "weld", 6),
        ('<weld body1="c" body2="b" relpose="1 2 3 2 0.1 0 1" anchor=".1 .2 .3"/>', "weld", 6),
        ('<weld site1="sa" site2="sb"/>', "weld", 6),
        ('<connect site1="sa" site2="at_sa"/>', "ball", 3),
        ('<weld site1="sa" site2="at_sa"/>', "weld", 6),
        ('<weld site1="sa" site2="sb" torquescale="0"/>', "ball", 3),
    ],
)
def test_loops_hold_what_mujoco_holds(read, equality, kind, rows):
    text = TWO_ARMS.replace("EQUALITY", equality)
    robot = read(text)
    (loop,) = robot.loops
    assert (loop.kind, loop.rows) == (kind, rows)
    original = MujocoReferee(robot, text)
    drawn = robot.postures["qpos0"]
    for q in (drawn, *(random_state(robot, seed)[0] for seed in range(3))):
        gap, _ = original.equality(q)
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, q)
        ends = (robot.frame(name) for name in (loop.frame_a, loop.frame_b))
        oMa, oMb = (data.oMi[joint] * placement for joint, placement in ends)
        assert np.abs(oMa.translation - oMb.translation - gap[:3]).max() < AGREES
        if kind == "weld":
            angle = np.linalg.norm(pin.log3((oMa.inverse() * oMb).rotation))
            assert np.linalg.norm(gap[3:]) == pytest.approx(np.sin(angle / 2), abs=AGREES)
    size = np.abs(original.equality(drawn)[0]).max()
    said = [text for text in robot.unused if "open by" in text]
    assert len(said) == (size > 1e-6)


@pytest.mark.long
def test_a_joint_equality_is_a_coupling(read):
    equality = '<joint name="gear" joint1="ja" joint2="jb" polycoef="0.1 2"/>'
    text = TWO_ARMS.replace("EQUALITY", equality)
    robot = read(text)
    (coupling,) = robot.loops
    assert isinstance(coupling, cp.constraints.Coupling)
    assert (coupling.joint_a, coupling.joint_b, coupling.ratio) == ("ja", "jb", 2.0)
    original = MujocoReferee(robot, text)
    q = robot.postures["qpos0"].copy()
    q[-1] += 0.3
    a, b = (robot.model.joints[robot.model.getJointId(n)].idx_q for n in ("ja", "jb"))
    q[a] = coupling.ratio * q[b] + coupling.offset
    assert np.abs(original.equality(q)[0]).max() < AGREES


# What is read -------------------------------------------------------------------------------------

ALL_EQUALITIES = """
<connect name="one" body1="c" body2="b" anchor="0.1 0.2 0.3" solref="0.01 1"/>
<weld name="two" body1="c" body2="b" relpose="1 2 3 2 0.1 0 1" anchor=".1 .2 .3"/>
<weld name="three" site1="sa" site2="sb"/>
<weld name="four" body1="a"/>
<connect name="off" site1="sa" site2="sb" active="false"/>
<joint name="gear" joint1="ja" joint2="jb" polycoef="0.1 2"/>
<joint name="held" joint1="ja" polycoef="0.1"/>
</equality><actuator><motor name="m" joint="jb"/><motor site="sa" gear="1 0 0 0 0 0"/></actuator>
<keyframe><key name="home" qpos="0.1 2 0 0 0 0.3"/><key/></keyframe><equality>
"""


@pytest.mark.long
def test_what_is_read_and_what_is_not(read):
    robot = read(TWO_ARMS.replace("EQUALITY", ALL_EQUALITIES))
    kinds = [(loop.name, loop.called) for loop in robot.loops]
    assert kinds == [
        ("one", "ball"), ("two", "weld"), ("three", "weld"), ("four", "weld"), ("gear", "Coupling"),
        ("held", "HeldJoint"),
    ]  # fmt: skip
    assert robot.actuated == ("jb",)
    assert list(robot.postures) == ["home", "key1", "qpos0"]
    told = "\n".join(robot.unused)
    for words in (
        "equality 'off' is not active",
        "1 actuators, but for their joints",
        "actuator1 on site 'sa'",
    ):
        assert words in told
    assert read(EVERYTHING).springs == (cp.model.Spring("twist", 5.0, np.deg2rad(10.0)),)


GEOMS = """<mujoco><worldbody><body name="ball"><freejoint/><geom size="0.1" density="500"/>
</body><body name="rod"><joint name="swing" axis="0 1 0" pos="0 0 0.5"/>
<geom type="capsule" fromto="0 0 0 0 0 0.5" size="0.02"/></body></worldbody></mujoco>"""


def test_inertia_may_follow_from_geoms(read):
    robot = read(GEOMS)
    assert robot.joints == ("ball_joint", "swing")
    original = MujocoReferee(robot, GEOMS)
    for seed in range(3):
        q, v = random_state(robot, seed)
        M, h = pinocchio_terms(robot, q, v)
        assert relative(M, original.mass_matrix(q)) < AGREES
        assert relative(h, original.bias(q, v)) < AGREES
    ball, rod = 500 * 4 / 3 * np.pi * 0.1**3, 1000 * np.pi * 0.02**2 * (0.5 + 4 / 3 * 0.02)
    assert robot.mass == pytest.approx(ball + rod, rel=1e-12)
    assert any("2 geoms" in text for text in robot.unused)
    assert robot.name == "robot"  # the file has no name, and MuJoCo makes one up
    drawn = read(GEOMS.replace("<geom ", '<geom contype="0" conaffinity="0" '))
    assert not any("geoms" in text for text in drawn.unused)


@pytest.mark.long
def test_without_mujoco_the_remedy_is_named(read, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    said = r"robot\.xml: MuJoCo's own compiler .* pip install 'condyn_pin\[mjcf\]'"
    with pytest.raises(cp.errors.MissingExtra, match=said):
        read(GEOMS)


@pytest.mark.long
def test_a_mesh_that_is_not_there_and_weighs_nothing_is_left_out(read):
    robot = read(
        '<mujoco><asset><mesh name="m" file="nowhere.stl"/></asset>'
        f"{body(INERTIAL + GEOM_OF_MESH)}</mujoco>"
    )
    assert robot.mass == 2.0
    assert "body 'b' is not drawn whole: no file 'nowhere.stl'" in robot.unused


@pytest.mark.long
def test_quaternions_of_keyframes_are_normalised_as_mujoco_does(read):
    text = """<mujoco><worldbody><body><joint name="j" type="ball"/><inertial pos="0 0 0" mass="1"
    diaginertia="1 1 1"/></body></worldbody><keyframe><key name="zero" qpos="0 0 0 0"/>
    <key name="long" qpos="0 0 3 4"/></keyframe></mujoco>"""
    robot = read(text)
    assert robot.postures["zero"].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert robot.postures["long"] == pytest.approx([0.0, 0.6, 0.8, 0.0])


def test_files_are_included(read, tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "arm.xml").write_text(
        f"""<mujocoinclude><body name="a"><joint name="j" class="stiff" axis="0 1 0"/>{INERTIAL}
        <include file="parts/hand.xml"/></body></mujocoinclude>"""
    )
    (tmp_path / "parts" / "hand.xml").write_text('<x><site name="hand" pos="0 0 1"/></x>')
    (tmp_path / "classes.xml").write_text(
        """<mujoco><default><default class="stiff"><joint stiffness="3"/></default></default>
        <option gravity="0 0 -1"/></mujoco>"""
    )
    text = """<mujoco><include file="classes.xml"/><worldbody><include file="parts/arm.xml"/>
    </worldbody></mujoco>"""
    robot = read(text)
    assert robot.springs == (cp.model.Spring("j", 3.0),)
    assert robot.frame("hand")[1].translation.tolist() == [0.0, 0.0, 1.0]
    with pytest.raises(
        cp.errors.InvalidModel, match=r"robot\.xml: <include>: .*classes\.xml is included twice"
    ):
        read(text.replace("<worldbody>", '<include file="classes.xml"/><worldbody>'))
    said = r"robot\.xml: .*nowhere\.xml: cannot be opened"
    with pytest.raises(cp.errors.InvalidModel, match=said):
        read('<mujoco><include file="nowhere.xml"/></mujoco>')


@pytest.mark.parametrize("range_", ["1 1", "1 -1"])
def test_a_range_without_width_is_no_limit_as_in_mujoco(read, range_):
    joint = f'<joint name="j" range="{range_}"/>'
    robot = read(f"<mujoco><worldbody><body>{joint}{INERTIAL}</body></worldbody></mujoco>")
    assert robot.model.upperPositionLimit[0] > 1e300
    assert "ranges that are no limits to MuJoCo (j)" in robot.unused


@pytest.mark.long
def test_a_keyframe_does_not_take_the_name_of_the_pose_that_is_drawn(read):
    """What MuJoCo starts from is zero, or what each `ref` says; a keyframe is another thing."""
    text = TWO_ARMS.replace("EQUALITY", "").replace(
        "</mujoco>", "<keyframe>KEY</keyframe></mujoco>"
    )
    drawn = read(TWO_ARMS.replace("EQUALITY", "")).postures["qpos0"]
    other = read(text.replace("KEY", '<key name="qpos0" qpos="0.6 1 0 0 0 -0.1"/>'))
    assert np.array_equal(other.postures["qpos0"], drawn)
    (said,) = (line for line in other.unused if "keyframe 'qpos0'" in line)
    assert said.endswith("rename it")
    same = read(text.replace("KEY", '<key name="qpos0" qpos="0.5 1 0 0 0 -0.1"/>'))
    assert not [line for line in same.unused if "keyframe" in line]


@pytest.mark.long
def test_what_is_written_is_drawn_where_it_was(read):
    """With the `ref` of each joint, so that MuJoCo starts from the same pose; again and again."""
    gear = '<joint name="gear" joint1="ja" joint2="jb" polycoef="0.2 3 0 0 0"/>'
    robot = read(TWO_ARMS.replace("EQUALITY", gear))
    text = robot.to_mjcf()
    again = read(text)
    assert 'ref="0.5"' in text
    assert_same(robot, again)
    assert np.allclose(again.postures["qpos0"], robot.postures["qpos0"], rtol=0, atol=1e-15)
    assert again.loops[0].offset == pytest.approx(robot.loops[0].offset, abs=1e-15)
    assert again.unused == read(again.to_mjcf()).unused


CARD = """
name = "two arms"
source = "this test"
licence = "none"
[description]
file = "robot.xml"
"""


def test_a_folder_may_hold_an_mjcf(read, tmp_path):
    alone = read(TWO_ARMS.replace("EQUALITY", ALL_EQUALITIES))
    card = tmp_path / "robot.toml"
    card.write_text(CARD)
    robot = cp.load_robot(tmp_path)
    assert (robot.name, robot.licence) == ("two arms", "none")
    assert (robot.loops, robot.actuated) == (alone.loops, alone.actuated)
    assert list(robot.postures) == ["home", "key1", "qpos0"]
    card.write_text(f'actuated = ["ja"]\n{CARD}[postures.bent]\nja = 0.3\n')
    robot = cp.load_robot(tmp_path)
    assert robot.actuated == ("ja",)
    assert list(robot.postures) == ["bent", "home", "key1", "qpos0"]
    card.write_text(f'{CARD}root_joint = "fixed"\n')
    with pytest.raises(cp.errors.InvalidModel, match=r"robot\.toml: .*root_joint is for others"):
        cp.load_robot(tmp_path)
    card.write_text(f"{CARD}drop = []\n")
    with pytest.raises(cp.errors.InvalidModel, match=r"description\.drop is for an SDF"):
        cp.load_robot(tmp_path)


# The writer ---------------------------------------------------------------------------------------


def assert_same(one: cp.Robot, two: cp.Robot) -> None:
    """Two robots have the same M, h and loops at random states, and the same settings."""
    assert one.joints == two.joints
    assert set(one.frames) <= set(two.frames)
    assert (one.loops, one.actuated, one.springs) == (two.loops, two.actuated, two.springs)
    rng = np.random.default_rng(0)
    first = next(iter(one.postures.values()), pin.neutral(one.model))
    workspaces = [cp.Workspace(cp.Scene(r, r.loops)) for r in (one, two) if one.loops]
    for _ in range(3):
        q = pin.integrate(one.model, first, rng.normal(size=one.nv))
        v = rng.normal(size=one.nv)
        pairs = zip(pinocchio_terms(one, q, v), pinocchio_terms(two, q, v), strict=True)
        assert all(relative(mine, theirs) < AGREES for mine, theirs in pairs)
        if one.loops:
            J, gamma = (
                [getattr(workspace.terms(q, v), key) for workspace in workspaces]
                for key in ("J", "gamma")
            )
            assert np.abs(J[0] - J[1]).max() < AGREES
            assert np.abs(gamma[0] - gamma[1]).max() < AGREES * max(1, np.abs(gamma[0]).max())
    for name, q in one.postures.items():
        assert np.abs(two.postures[name] - q).max() < AGREES
    for key in ("armature", "damping", "lowerPositionLimit", "upperPositionLimit"):
        assert np.allclose(getattr(one.model, key), getattr(two.model, key), rtol=1e-15)


# Sites that share a name with a body, and bodies without a name.
NAMELESS = f"""<mujoco><worldbody><body><joint name="j" axis="0 1 0"/>{INERTIAL}<site name="b"/>
<body name="b" pos="0 0 1"><joint name="k"/><joint name="l" axis="1 0 0"/>{INERTIAL}</body>
</body></worldbody><equality><connect name="b" body1="b" anchor="0 0 1"/></equality></mujoco>"""
FILES = (EVERYTHING, TWO_ARMS.replace("EQUALITY", ALL_EQUALITIES), NAMELESS)


@pytest.mark.parametrize("one", ["talos", "cassie", "solo12", "four_bar", "stewart", *FILES])
def test_what_is_written_reads_back(read, one):
    one = read(one) if one in FILES else shared_robot(one)
    two = read(one.to_mjcf())
    assert_same(one, two)
    again = read(two.to_mjcf())
    assert_same(two, again)
    assert again.frames == two.frames


def spun(robot: cp.Robot) -> cp.Robot:
    """Return a robot with a frame on each side of the four-bar's pin, z along it."""
    R = pin.rpy.rpyToMatrix(np.pi / 2, 0, 0)
    for name in ("coupler", "rocker"):
        robot = robot.with_frame(f"{name}_pin", f"{name}_tip", [0, 0, 0], R)
    return robot


def test_a_hinge_is_two_points_of_its_axis(read):
    bar = spun(shared_robot("four_bar"))
    one = replace(bar, loops=[cp.Loop("coupler_pin", "rocker_pin", "hinge", "z", name="pin")])
    two = read(one.to_mjcf())
    assert [(loop.kind, loop.name) for loop in two.loops] == [("ball", "pin"), ("ball", "pin_axis")]
    scenes = [cp.Scene(robot, robot.loops) for robot in (one, two)]
    q, v = scenes[0].sample(np.random.default_rng(0))
    J = [cp.Workspace(scene).jacobian(q) for scene in scenes]
    assert [scene.nominal.rank for scene in scenes] == [2, 2]
    assert np.linalg.matrix_rank(np.vstack(J), tol=1e-9) == 2
    a = [cp.solve(scene, q, v, np.zeros(3)).a for scene in scenes]
    assert np.abs(a[0] - a[1]).max() < 1e-10


@pytest.mark.long
def test_a_coupling_is_a_joint_equality(read):
    loops = [cp.constraints.Coupling("crank", "rocker", ratio=-2.0, offset=0.3, name="gear")]
    one = replace(shared_robot("four_bar"), loops=loops)
    assert_same(one, read(one.to_mjcf()))
    gap, J = MujocoReferee(one).equality(np.array([0.1, 0.2, 0.4]))
    assert gap == pytest.approx([0.1 + 2 * 0.4 - 0.3])
    assert J.ravel() == pytest.approx([1.0, 0.0, 2.0])


@pytest.mark.long
@each_row("kind", ["slider", "planar", "rod"])
def test_kinds_that_mujoco_has_not_are_refused_or_left_out(kind):
    length = 0.5 if kind == "rod" else None
    loops = [cp.Loop("coupler_tip", "rocker_tip", kind, axis_of(kind), length, name="odd")]
    bar = replace(shared_robot("four_bar"), loops=loops)
    advice = "a ball does the same.*" if kind == "planar" else ""
    with pytest.raises(cp.errors.InvalidModel, match=f"'odd' is a {kind}.*{advice}without="):
        bar.to_mjcf()
    assert "equality" not in bar.to_mjcf(without=["odd"])
    with pytest.raises(cp.errors.UnknownName, match="no loop named 'od'"):
        bar.to_mjcf(without=["od"])
    with pytest.raises(cp.InvalidArgument, match="without = 'odd'"):
        bar.to_mjcf(without="odd")


@pytest.mark.long
def test_flat_bodies_are_written_as_mujoco_takes_them():
    """Of a disc A + B = C, but for rounding, and MuJoCo compares to the last bit."""
    rng = np.random.default_rng(0)
    for _ in range(30):
        model = pin.Model()
        joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "j")
        A, B = rng.uniform(0.1, 1.0, 2)
        R = pin.exp3(rng.normal(size=3))
        disc = pin.Inertia(1.0, rng.normal(size=3), R @ np.diag([A, B, A + B]) @ R.T)
        model.appendBodyToJoint(joint, disc, pin.SE3.Identity())
        robot = cp.Robot("disc", model)
        M, _ = pinocchio_terms(robot, np.zeros(1), np.zeros(1))
        assert relative(MujocoReferee(robot).mass_matrix(np.zeros(1)), M) < AGREES


def test_what_mujoco_has_not_is_refused_by_name():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "table")
    model.appendBodyToJoint(joint, pin.Inertia.FromBox(1.0, 0.2, 0.3, 0.4), pin.SE3.Identity())
    with pytest.raises(cp.errors.InvalidModel, match="'table' is a JointModelPlanar"):
        cp.Robot("puck", model).to_mjcf()
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "odd")
    odd = pin.Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 2.1]))
    model.appendBodyToJoint(joint, odd, pin.SE3.Identity())
    with pytest.raises(cp.errors.InvalidModel, match=r"'odd' carries .* moments 1, 1 and 2\.1"):
        cp.Robot("odd", model).to_mjcf()
    model = pin.Model(shared_robot("solo12").model)
    model.armature[:6] = 0.1
    with pytest.raises(cp.errors.InvalidModel, match="'root_joint': armature"):
        replace(shared_robot("solo12"), model=model).to_mjcf()


# What is wrong with a file ------------------------------------------------------------------------


EQUALITY = body(INERTIAL) + "<equality>{}</equality>"
NO_MASS = '<inertial pos="0 0 0" mass="{}" diaginertia="{}"/>'
# What is in a file, and what is said of it; most of it by MuJoCo, with the element and its line.
WRONG = {
    "mass -1": (body(NO_MASS.format(-1, "1 1 1")), "mass and inertia .* name 'b'"),
    "mass nan": (body(NO_MASS.format("nan", "1 1 1")), "mass and inertia .* name 'b'"),
    "no solid": (body(NO_MASS.format(1, "3 1 1")), "A . B >= C.* name 'b'"),
    "no inertia": (body(""), "mass and inertia .* name 'b'"),
    "a joint of no type": (body(INERTIAL, '<joint type="cyl"/>'), "invalid keyword: 'cyl'"),
    "an axis of zero": (body(INERTIAL, '<joint axis="0 0 0"/>'), "axis too small in joint"),
    "armature": (body(INERTIAL, '<joint name="j" armature="-1"/>'), "armature of joint 'j' is -1"),
    "a free joint and another": (body(INERTIAL, "<joint/><freejoint/>"), "more than 6 dofs .* 'b'"),
    "two of one name": (body(INERTIAL + 2 * '<site name="s"/>'), "repeated name 's'"),
    "a name of nobody": (
        body(INERTIAL + '<body name="body3"/><body/>'), "two frames would be named 'body3'",
    ),
    "world": (body(INERTIAL + '<site name="world"/>'), "the name 'world' is the world's"),
    "gravity": (f'<option gravity="0 0"/>{body(INERTIAL)}', "'gravity' does not have enough data"),
    "gravity nan": (f'<option gravity="0 0 nan"/>{body(INERTIAL)}', "NaN|gravity"),
    "no such body": (EQUALITY.format('<connect body1="c" anchor="0 0 0"/>'), "element 'c'"),
    "no such joint": (EQUALITY.format('<joint joint1="k"/>'), "element 'k'"),
    "a joint equality with words": (
        EQUALITY.format('<joint joint1="j" joint2="j" polycoef="0 1 x"/>'), "'polycoef'",
    ),
    "qpos": (f'{body(INERTIAL)}<keyframe><key qpos="1 2"/></keyframe>', "qpos size"),
    "a lost mesh": (
        '<asset><mesh name="m" file="nowhere.stl"/></asset>' + body(GEOM_OF_MESH), r"nowhere\.stl",
    ),
    "a lost mesh that weighs": (
        '<asset><mesh name="m" file="nowhere.stl"/></asset>' + body(INERTIAL +
        f"<body>{GEOM_OF_MESH}</body>"), r"nowhere\.stl",
    ),
    "nothing": ("", "no degree of freedom"),
    "without end": (f"<worldbody>{'<body>' * 4000}{'</body>' * 4000}</worldbody>", "nesting"),
}  # fmt: skip


@each_row(("text", "said"), WRONG)
def test_what_is_wrong_is_said(read, text, said):
    with pytest.raises(cp.errors.InvalidModel, match=rf"robot\.xml: .*{said}"):
        read(f"<mujoco>{text}</mujoco>")


@pytest.mark.long
@each_row("text", ["", "words", "<mujoco>", "<robot/>", "<mujoco>\x00</mujoco>"])
def test_what_is_no_mjcf_is_refused(read, text):
    with pytest.raises(cp.errors.InvalidModel, match=r"robot\.xml: "):
        read(text)


@pytest.mark.long
def test_there_is_no_such_file():
    with pytest.raises(cp.errors.InvalidModel, match=r"nowhere\.xml: cannot be opened"):
        cp.load_robot("nowhere.xml")


@pytest.mark.once  # MuJoCo's compiler reads it
@given(seed=st.integers(0, 2**32))
@settings(max_examples=3, suppress_health_check=list(HealthCheck))
def test_a_spoilt_mjcf_is_refused_or_read(tmp_path, seed):
    assert_survived(tmp_path, "robot.xml", TWO_ARMS.replace("EQUALITY", ALL_EQUALITIES), seed)
    assert_survived(tmp_path, "robot.xml", EVERYTHING, seed)


@pytest.mark.long
def test_excluded_bodies_are_kept_and_written(read):
    text = TWO_ARMS.replace("EQUALITY", "").replace(
        "</mujoco>",
        '<contact><exclude body1="c" body2="a"/><exclude body1="world" body2="b"/>'
        '<exclude body1="b" body2="b"/></contact></mujoco>',
    )
    robot = read(text)
    assert robot.exclusions == {frozenset("ca"), frozenset({"world", "b"})}
    written = read(robot.to_mjcf())  # bodies have other names there, on the same joints
    on = [
        {frozenset(r.frame(n)[0] for n in each) for each in r.exclusions} for r in (robot, written)
    ]
    assert on[0] == on[1]
