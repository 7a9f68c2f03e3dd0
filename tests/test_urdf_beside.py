"""Beside a URDF: loops by the names of links, and files that say what a URDF cannot."""

from __future__ import annotations

import pickle
import sys
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from shared import each_row
from urdf_texts import SWING, link, tip

import condyn_pin as cp

ENDS = "0.5 0 0", "0 0 -0.5"  # on c and on b
OPEN = SWING[:-2]


def swing(folder, first, second, *more, name="robot"):
    """The four-bar, its two free ends with these names."""
    parts = (*OPEN, tip(first, "c", ENDS[0]), tip(second, "b", ENDS[1]), *more)
    path = folder / f"{name}.urdf"
    path.write_text(f'<robot name="r">{"".join(parts)}</robot>')
    return path


# Names


@each_row(
    ("first", "second", "name", "kind"),
    [
        ("closedloop1_A", "closedloop1_B", "closedloop1", "weld"),
        ("closedLoop_A", "closedLoop_B", "closedLoop", "weld"),
        ("left_closedloop12_A", "left_closedloop12_B", "left_closedloop12", "weld"),
        ("closedloop_knee_A", "closedloop_knee_B", "closedloop_knee", "weld"),
        ("closedloop13_A_3D", "closedloop13_B_3D", "closedloop13", "ball"),
        ("closedloop13_A_6D", "closedloop13_B_6D", "closedloop13", "weld"),
        ("closedloop3D_1A", "closedloop3D_1B", "closedloop3D_1", "ball"),
        ("closedloop6D_1A", "closedloop6D_1B", "closedloop6D_1", "weld"),
    ],
)
def test_two_names_close_a_loop(tmp_path, first, second, name, kind):
    robot = cp.load_robot(swing(tmp_path, first, second))
    assert robot.loops == (cp.Loop(first, second, kind, name=name),)
    assert any(f"joints cut at {name}: {kind}s here" in text for text in robot.unused)


@pytest.mark.long
def test_the_other_order_is_the_same_loop(tmp_path):
    robot = cp.load_robot(swing(tmp_path, "closedloop1_B", "closedloop1_A"))
    assert robot.loops == (cp.Loop("closedloop1_A", "closedloop1_B", "weld", name="closedloop1"),)


@pytest.mark.long
def test_joints_have_such_names_too(tmp_path):
    path = swing(tmp_path, "one", "two")
    text = (
        path.read_text().replace("one_frame", "closedloop1_A").replace("two_frame", "closedloop1_B")
    )
    path.write_text(text)
    (loop,) = cp.load_robot(path).loops
    assert (loop.frame_a, loop.frame_b) == ("closedloop1_A", "closedloop1_B")


@pytest.mark.long
@each_row(
    "names",
    [
        ("closedloop1_A", "closedloop2_B"),
        ("closedloop1_A", "closedloop1A"),
        ("closedloop_knob", "closedloop_crab"),
        ("closedloop", "closedloops"),
    ],
)
def test_what_is_no_pair_closes_nothing(tmp_path, names):
    robot = cp.load_robot(swing(tmp_path, *names))
    assert robot.loops == ()
    halves = [name for name in names if name[-1] in "AB"]
    assert sum("closes nothing" in text for text in robot.unused) == len(halves)


def test_a_third_half_makes_it_doubtful(tmp_path):
    more = tip("closedloop1_A_3D", "a", "0 0 -0.1")
    robot = cp.load_robot(swing(tmp_path, "closedloop1_A", "closedloop1_B", more))
    assert robot.loops == ()
    assert sum("closes nothing" in text for text in robot.unused) == 3


# Files

BALLS = "joint_name: [bottom]\njoint_type: [SPHERICAL]\n"
PAIR = "closed_loop: [['end_c', 'end_b']]\n"


@pytest.fixture
def ends(tmp_path):
    return swing(tmp_path, "end_c", "end_b")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("robot.yaml", f"{PAIR}type: ['3d']\nname_mot: ['left']\n"),
        ("robot.yml", f"{PAIR}type: 3D\nname_mot: left\n"),
        ("robot.yaml", f"\ufeff# a comment\n{PAIR}type:\n  - 3D\nname_mot:\n  - left\n"),
        ("robot.toml", 'closed_loop = [["end_c", "end_b"]]\ntype = ["3D"]\nname_mot = ["left"]\n'),
    ],
)
def test_a_file_names_loops_and_motors(ends, name, text):
    ends.with_name(name).write_text(text, encoding="utf-8")
    robot = cp.load_robot(ends)
    (loop,) = robot.loops
    assert (loop.frame_a, loop.frame_b, loop.kind) == ("end_c", "end_b", "ball")
    assert robot.actuated == ("left",)
    scene = cp.Scene(robot, robot.loops)
    q, v = scene.sample(np.random.default_rng(0))
    assert cp.solve(scene, q, v, np.zeros(3)).status.ok


@pytest.mark.long
def test_a_loop_is_a_weld_unless_the_file_says_otherwise(ends):
    ends.with_name("robot.yaml").write_text(PAIR)
    assert cp.load_robot(ends).loops[0].kind == "weld"
    ends.with_name("robot.yaml").write_text(f"{PAIR}type: [6D]\n")
    assert cp.load_robot(ends).loops[0].kind == "weld"


@each_row(
    ("text", "loop"),
    [
        ("planar y", {"kind": "planar", "axis": "y"}),
        ("Hinge Y", {"kind": "hinge", "axis": "y"}),
        ("slider x", {"kind": "slider", "axis": "x"}),
        ("Universal XZ", {"kind": "universal", "axis": "xz"}),
        ("cylindrical z", {"kind": "cylindrical", "axis": "z"}),
        ("rod 0.25", {"kind": "rod", "length": 0.25}),
        ("ball", {"kind": "ball"}),
        ("weld", {"kind": "weld"}),
    ],
)
def test_a_type_may_be_any_kind_of_loop(ends, text, loop):
    ends.with_suffix(".yaml").write_text(f"{PAIR}type: [{text}]\n")
    assert cp.load_robot(ends).loops == (cp.Loop("end_c", "end_b", **loop),)


@pytest.mark.long
def test_a_loop_of_a_file_is_called_as_its_frames_are(tmp_path):
    path = swing(tmp_path, "closedloop1_A", "closedloop1_B")
    path.with_suffix(".yaml").write_text(
        "closed_loop: [[closedloop1_B, closedloop1_A]]\ntype: [3D]"
    )
    assert cp.load_robot(path).loops == (
        cp.Loop("closedloop1_B", "closedloop1_A", "ball", name="closedloop1"),
    )
    path.with_suffix(".yaml").write_text("closed_loop: []\n")
    assert cp.load_robot(path).loops == ()
    path.with_suffix(".yaml").write_text("name_mot: [left]\n")  # names count where no file counts
    assert cp.load_robot(path).loops[0].kind == "weld"


def by_hand(kinds):
    """SWING's tree with joints of Pinocchio, in the order in which it reads the file."""
    model = pin.Model()
    inertia = pin.Inertia(1.0, np.array([0.0, 0.0, -0.25]), np.diag([0.02, 0.02, 0.001]))
    hinge = pin.JointModelRY
    at = {"left": (0, [0, 0, 0]), "bottom": ("left", [0, 0, -0.5]), "right": (0, [0.5, 0, 0])}
    last = {0: 0}  # Pinocchio's joint of each
    for name, (parent, place) in at.items():
        i = last[parent]
        placement = pin.SE3(np.eye(3), np.array(place, dtype=float))
        for suffix, made in kinds.get(name, {"": hinge}).items():
            i = model.addJoint(i, made(), placement, f"{name}{suffix}")
            placement = pin.SE3.Identity()
        model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
        last[name] = i
    return model


KINDS = {
    "SPHERICAL": {"": pin.JointModelSpherical},
    "UJOINT_XY": {"_X": pin.JointModelRX, "_Y": pin.JointModelRY},
    "UJOINT_ZX": {"_Z": pin.JointModelRZ, "_X": pin.JointModelRX},
}


@pytest.mark.parametrize("name", ["bottom", "left"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_joint_becomes_a_ball_or_universal(ends, kind, name):
    hinges = '<limit lower="-1" upper="2" effort="3" velocity="4"/><dynamics damping="0.5"/>'
    text = ends.read_text().replace('type="continuous">', 'type="revolute">' + hinges)
    ends.write_text(text)
    plain = cp.load_robot(ends)
    ends.with_suffix(".yaml").write_text(f"joint_name: [{name}]\njoint_type: ['{kind.lower()}']\n")
    robot, expected = cp.load_robot(ends), by_hand({name: KINDS[kind]})
    assert robot.joints == tuple(expected.names)[1:]
    assert [j.shortname() for j in robot.model.joints] == [j.shortname() for j in expected.joints]
    assert any(f"robot.yaml makes {kind} ({name})" in text for text in robot.unused)
    ours, theirs = robot.model.createData(), expected.createData()
    rng = np.random.default_rng(0)
    for _ in range(3):
        q = pin.integrate(expected, pin.neutral(expected), rng.normal(size=expected.nv))
        v, a = rng.normal(size=(2, expected.nv))
        tau = pin.rnea(robot.model, ours, q, v, a)
        wanted = pin.rnea(expected, theirs, q, v, a)
        assert np.allclose(tau, wanted, rtol=0, atol=1e-7)  # a tip has 1e-9 kg
    for frame in plain.model.frames:
        if frame.type == pin.FrameType.BODY:
            found = robot.model.frames[robot.model.getFrameId(frame.name)]
            assert found.placement == frame.placement
    for other in {"left", "right", "bottom"} - {name}:
        one, two = (r.model.joints[r.model.getJointId(other)] for r in (robot, plain))
        assert robot.model.upperPositionLimit[one.idx_q] == 2.0
        assert robot.model.velocityLimit[one.idx_v] == 4.0
        assert robot.model.damping[one.idx_v] == plain.model.damping[two.idx_v] == 0.5
    changed = [robot.model.joints[robot.model.getJointId(f"{name}{s}")] for s in KINDS[kind]]
    assert all((robot.model.damping[j.idx_v : j.idx_v + j.nv] == 0.0).all() for j in changed)
    assert pickle.loads(pickle.dumps(robot)) == robot
    scene = cp.Scene(robot, [cp.Loop("end_c", "end_b", "ball")])
    q, v = scene.sample(np.random.default_rng(1))
    assert cp.solve(scene, q, v, np.zeros(robot.nv)).status.ok


@pytest.mark.long
def test_a_joint_is_fixed(ends):
    ends.with_suffix(".yaml").write_text("joint_name: [right]\njoint_type: [FIXED]\n")
    assert cp.load_robot(ends).joints == ("left", "bottom")


@pytest.mark.long
def test_a_ball_on_a_base_that_moves(ends):
    ends.with_suffix(".yaml").write_text(BALLS + PAIR)
    text = ends.read_text().replace('<link name="beam"></link>', link("beam"))
    ends.write_text(text)
    robot = cp.load_robot(ends, root_joint="free_flyer")
    assert (robot.nq, robot.nv) == (7 + 2 + 4 + 2, 6 + 1 + 3 + 1)
    scene = cp.Scene(robot, robot.loops)
    q, v = scene.sample(np.random.default_rng(0))
    assert cp.solve(scene, q, v, np.zeros(robot.nv)).status.ok


@pytest.mark.long
def test_a_card_comes_first(ends):
    """A robot.toml of this library beside it: its loops and motors replace those of the file."""
    ends.rename(ends.with_name("swing.urdf"))
    ends.with_name("swing.yaml").write_text(f"{PAIR}name_mot: [left]\n")
    card = ends.with_name("robot.toml")
    text = 'name = "s"\n[description]\nfile = "swing.urdf"\n'
    card.write_text(text)
    robot = cp.load_robot(card)
    assert (robot.loops[0].kind, robot.actuated) == ("weld", ("left",))
    more = '[[loops]]\nframe_a = "end_c"\nframe_b = "end_b"\nkind = "ball"\n'
    card.write_text(f'actuated = ["right"]\n{text}{more}')
    robot = cp.load_robot(card)
    assert (robot.loops[0].kind, robot.actuated) == ("ball", ("right",))
    assert len(robot.loops) == 1


@pytest.mark.long
@each_row(
    "text",
    [
        "",
        "- 1\n",
        "robot: {wheels: 4}\ntype: car\n",
        "{not yaml",
        "\0\1",
        "a: &a [*a]\n",
        "5" * 5000,
    ],
)
def test_a_file_of_somebody_else_is_left_alone(ends, text):
    ends.with_suffix(".yaml").write_text(text)
    robot = cp.load_robot(ends)
    assert robot.loops == ()
    assert robot.nv == 3


WRONG = {
    "no frame named 'end_d'": "closed_loop: [[end_c, end_d]]",
    "a list of pairs of frames": "closed_loop: [end_c, end_b]",
    "a list of pairs": "closed_loop: {a: b}",
    "a list of pairs of": "closed_loop: [[end_c, end_b, end_c]]",
    "closed_loop has 1 pairs and type 2": f"{PAIR}type: [3D, 3D]",
    "no type of loop named '4D'": f"{PAIR}type: [4D]",
    "'hinge': an axis is needed, as in hinge y": f"{PAIR}type: [hinge]",
    "'universal': an axis is needed, as in universal xy": f"{PAIR}type: [universal]",
    "axis = 'q'": f"{PAIR}type: [hinge q]",
    "'rod': a length [m] is needed, as in rod 0.3": f"{PAIR}type: [rod]",
    "'rod long': a length": f"{PAIR}type: [rod long]",
    "'6D y': it stands alone": f"{PAIR}type: [6D y]",
    "did you mean 'hinge'": f"{PAIR}type: [hinges]",
    "type = 3: a list of texts": f"{PAIR}type: 3",
    "no joint named 'lefty'": "name_mot: [lefty]",
    "joint_name: no joint named 'lefty'": "joint_name: [lefty]\njoint_type: [SPHERICAL]",
    "joint_type: no joint type named 'CARDAN'": "joint_name: [left]\njoint_type: [CARDAN]",
    "joint_type has 0": "joint_name: [left]",
    "1 of them different": "joint_name: [left, left]\njoint_type: [FIXED, FIXED]",
    "'end_c_frame' is fixed": "joint_name: [end_c_frame]\njoint_type: [SPHERICAL]",
    "it is not valid YAML": "closed_loop: [[end_c, end_b]",
    "it is not valid YAML:": "closed_loop: " + "[" * 5000,
    "a list of pairs of frames is": "closed_loop: &a [*a, *a]",
    "closed_loop = [[": "closed_loop: [&a [x, x, x, x, x, x, x, x, x]"
    + "".join(f", &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in pairwise("abcdefghijkl"))
    + "]",
    "has more than": "closed_loop: []\n#" + "x" * 2**20,
}


@each_row(("said", "text"), WRONG.items())
def test_what_is_wrong_is_named(ends, said, text):
    ends.with_suffix(".yaml").write_text(text)
    with pytest.raises(cp.CondynError) as caught:
        cp.load_robot(ends)
    assert said in str(caught.value)
    assert str(ends) in str(caught.value)


def test_entries_that_are_not_read_are_said(ends):
    ends.with_suffix(".yaml").write_text("name_mot: [left]\nclosed_lop: []\n3: 4\n")
    unused = cp.load_robot(ends).unused
    assert "entries of robot.yaml that are not read: closed_lop, 3" in unused


def test_a_toml_that_is_wrong_is_named(ends):
    ends.with_suffix(".toml").write_text("closed_loop = [[")
    with pytest.raises(cp.errors.InvalidModel, match=r"robot\.toml: it is not valid TOML"):
        cp.load_robot(ends)


def test_without_pyyaml_the_remedy_is_named(ends, monkeypatch):
    monkeypatch.setitem(sys.modules, "yaml", None)
    ends.with_suffix(".yaml").write_text("wheels: 4")
    assert cp.load_robot(ends).loops == ()  # it is not for this library
    ends.with_suffix(".yaml").write_text(PAIR)
    with pytest.raises(cp.errors.MissingExtra, match=r"pip install 'condyn_pin\[yaml\]'"):
        cp.load_robot(ends)


def test_names_of_links_do_not_clash(ends):
    """The empty link of a universal joint gets a name that is nobody's."""
    text = ends.read_text().replace("</robot>", f"{tip('left_cross', 'a', '0 0 0')}</robot>")
    ends.write_text(text)
    ends.with_suffix(".yaml").write_text("joint_name: [left]\njoint_type: [UJOINT_XY]\n")
    with pytest.raises(cp.errors.InvalidModel, match="needs the name 'left_cross'; rename"):
        cp.load_robot(ends)


def test_a_joint_without_a_child_is_named(ends):
    ends.write_text(ends.read_text().replace('<child link="a"/>', "", 1))
    ends.with_suffix(".yaml").write_text("joint_name: [left]\njoint_type: [UJOINT_XY]\n")
    with pytest.raises(cp.errors.InvalidModel, match="child link"):
        cp.load_robot(ends)
