"""Bad values, everywhere a user can hand one in: one error, which names the argument and helps."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import crash
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared import HAS_LCABA, each_row, unsupported_constraints

import condyn_pin as cp

GRAVITY = 9.81
Case = tuple[Callable[[], Any], str]


@cache
def robot(name: str) -> cp.Robot:
    return cp.load_robot(name)


@cache
def scene(name: str) -> cp.Scene:
    talos, cassie = robot("talos"), robot("cassie")
    return cp.Scene(
        *{
            "four_bar": (robot("four_bar"), robot("four_bar").loops),
            "talos": (talos, talos.contacts),
            "foot twice": (talos, [*talos.contacts, cp.SurfaceContact("left_sole_link", name="b")]),
            "cassie": (cassie, [*cassie.loops, *cassie.contacts]),
        }[name]
    )


def refused(cases: dict[str, Case]):
    return each_row(("call", "text"), cases)


def assert_refused(call: Callable[[], Any], text: str) -> None:
    with pytest.raises(cp.CondynError, match=text):
        call()


def asked(name: str, verb: str, *args: Any, **options: Any) -> Callable[[], Any]:
    """Call a method of a scene, which is made then and not before."""
    return lambda: getattr(scene(name), verb)(*args, **options)


def made(**options: Any) -> Callable[[], Any]:
    """Make a robot of Talos' model."""
    return lambda: cp.Robot("a", robot("talos").model, **options)


def each(label: str, values: Any, call: Callable[[Any], Any], text: str) -> dict[str, Case]:
    """The same question with several values."""
    return {f"{label} {value!r}": (partial(call, value), text) for value in values}


# --- constraints

NOT_THREE = ["abc", [1, 2], [1, 2, np.nan], [[1, 2, 3]], 3, {"a": 1}, ["a", "b", "c"], [1j, 0, 0],
             [1, [2], 3]]  # fmt: skip
NOT_LENGTHS = [0, -0.1, np.nan, np.inf, "wide", [1.0]]
NOT_NAMES = [3, "", None, ["left_sole_link"]]
NOT_PLACES = ["abc", [0] * 6, [np.nan] * 7, 3, np.eye(4), pin.SE3(np.eye(3), np.full(3, np.nan))]
NO_TEXTS = [3, ["a"], b"a"]
point, surface, loop = cp.PointContact, cp.SurfaceContact, cp.Loop
WITHOUT_END = 10**5000  # Python refuses to write it out

CONSTRAINTS: dict[str, Case] = {
    **each("offset", NOT_THREE, lambda x: point("a", offset=x), "^offset = .*3 finite numbers"),
    **each("anchor", NOT_THREE[:1], lambda x: point("a", anchor=x), "^anchor = .*3 finite numbers"),
    **each("place", NOT_PLACES, lambda x: surface("a", anchor=x), "(?s)^anchor = .*7 finite numb"),
    **each("length", NOT_LENGTHS, lambda x: surface("a", half_length=x), "^half_length = .*length"),
    **each("width", NOT_LENGTHS[:1], lambda x: surface("a", half_width=x), "^half_width = .*posit"),
    **each("point", NOT_NAMES, point, "^frame = .* the name of a frame"),
    **each("surface", NOT_NAMES[:1], surface, "^frame = .* the name of a frame"),
    **each("loop from", NOT_NAMES[:1], lambda x: loop(x, "a"), "^frame_a = .* the name of a frame"),
    **each("loop to", NOT_NAMES[:1], lambda x: loop("a", x), "^frame_b = .* the name of a frame"),
    **each("point called", NO_TEXTS, lambda x: point("a", name=x), "^name = "),
    **each("surface called", NO_TEXTS[:1], lambda x: surface("a", name=x), "^name = "),
    **each("loop called", NO_TEXTS[:1], lambda x: loop("a", "b", name=x), "^name = "),
    **each("kind", ("screw", "Ball", "", 3, None, ["ball"]), lambda x: loop("a", "b", kind=x),
           "kind = .*ball, weld"),
    "zero quaternion": (lambda: surface("a", anchor=[0] * 7), "quaternion .* use 0 0 0 1"),
    "huge anchor": (lambda: point("a", anchor=(0, 1e60, 0)), "anchor = 1e.60: no machine"),
    "huge offset": (
        lambda: cp.constraints.KnifeEdge("a", offset=(0, 0, -1e155)),
        "offset = -1e.155: no machine",
    ),
    "whole offset": (
        lambda: cp.constraints.KnifeEdge("a", offset=(0, 0, 10**400)),
        "offset = .*finite numbers",
    ),
    "whole length": (lambda: loop("a", "b", "rod", length=10**400), "length = 10.* a positive"),
    "huge rod": (lambda: loop("a", "b", "rod", length=1e300), "length = 1e.300: no machine"),
    "huge wheel": (lambda: cp.constraints.RollingBall("a", 1e77), "radius = 1e.77: no machine"),
    "huge ratio": (lambda: cp.constraints.Coupling("a", "b", 1e77), "ratio = 1e.77: no machine"),
    "no corners": (lambda: surface("a").corners(), "half_length=..., half_width=..."),
    "flags": (lambda: point("a", offset=[True, 0, 0]), "offset"),
    "endless offset": (lambda: point("a", offset=[WITHOUT_END, 0, 0]), "^offset = "),
    "endless length": (lambda: surface("a", half_length=WITHOUT_END), "^half_length = "),
    "endless name": (lambda: point(WITHOUT_END), "^frame = a int that cannot be shown"),
}  # fmt: skip


@refused(CONSTRAINTS)
def test_constraints_refuse(call, text):
    assert_refused(call, text)


SHEARED = np.eye(3) + 0.1 * np.eye(3, k=1)
MIRRORED = np.diag([1.0, 1.0, -1.0])


@pytest.mark.parametrize(("text", "R"), [("not orthonormal", SHEARED), ("left-handed", MIRRORED)])
def test_placements_that_are_no_rotation_are_refused(text, R):
    placement = pin.SE3(R, np.zeros(3))
    said = f"^anchor: it has no valid rotation: .*{text}"
    for contact in (cp.SurfaceContact, cp.constraints.LineContact):
        assert_refused(lambda: contact("foot", anchor=placement), said)  # noqa: B023
    model = pin.Model(robot("four_bar").model)
    model.jointPlacements[2] = placement
    assert_refused(lambda: cp.Robot("a", model), f"placement of joint 'coupler' .*{text}")
    framed = pin.Model(robot("four_bar").model)
    framed.addFrame(pin.Frame("tool", 1, 0, placement, pin.FrameType.OP_FRAME))
    assert_refused(lambda: cp.Robot("a", framed), f"placement of frame 'tool' .*{text}")


@each_row("size", [5e-324, 1e-310, 1e-155, 1.0, 1e49])
def test_directions_and_quaternions_of_any_length_are_units(size):
    """Of subnormal numbers math.hypot takes no length."""
    plane = cp.constraints.PlanarContact("a", normal=(size, -size, 0.0))
    turn = cp.SurfaceContact("a", anchor=(1.0, 2.0, 3.0, 0.0, 0.0, size, size))
    assert np.linalg.norm(plane.normal) == pytest.approx(1.0, abs=1e-15)
    assert np.linalg.norm(turn.anchor[3:]) == pytest.approx(1.0, abs=1e-15)


# --- robots


def one_body(inertia: pin.Inertia) -> pin.Model:
    model = pin.Model()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "j")
    model.appendBodyToJoint(1, inertia, pin.SE3.Identity())
    return model


@each_row(
    ("edit", "said"),
    [
        (lambda m: m.damping.__setitem__(1, -0.5), r"damping of joint 'coupler' is -0\.5"),
        (lambda m: m.damping.__setitem__(0, np.inf), "damping of joint 'crank' is inf"),
        (lambda m: m.armature.__setitem__(0, 1e300), r"armature of joint 'crank' is 1e\+300"),
        (lambda m: m.armature.__setitem__(0, -1e-4), "armature of joint 'crank' is -0.0001"),
        (lambda m: m.gravity.linear.__setitem__(0, np.inf), "gravity = .*inf"),
        (lambda m: m.gravity.angular.__setitem__(1, 3.0), "an angular part of"),
    ],
)
def test_damping_that_drives_and_gravity_that_turns_are_refused(edit, said):
    model = pin.Model(cp.model.four_bar().model)
    edit(model)
    with pytest.raises(cp.errors.InvalidModel, match=said):
        cp.Robot("bar", model)


@each_row(
    ("moments", "mass", "text"),
    [
        ([1.0, -1.0, 1.0], 1.0, "'j' has the principal moment -1 kg m.2, which is negative"),
        ([-1.0, 1.0, 1.0], 1.0, "'j' has the principal moment -1 kg m.2, which is negative"),
        ([1.0, 1.0, 1.0], 0.0, "'j' has a moment of inertia, 1 kg m.2, and no mass"),
        ([1.0, 1.0, 1.0], -1.0, "the mass on j is negative, -1 kg"),
        ([1e-17, 1e-17, 1e-17], 1e-17, "'j' has a mass of 1e-17 kg, and Pinocchio loses"),
        ([1.0, 1.0, 1.0], 1e60, "'j' has a mass or a centre beyond 1e.50"),
        ([1e160, 1e160, 1e160], 1.0, "an inertia beyond 1e.150"),
        ([1e-160, 1e-160, 1e-160], 1.0, "no inertia moves with j"),
        ([1.0, 1.0, -1e-9], 1.0, ""),  # rounding
    ],
)
def test_bodies_that_no_solid_is_are_refused(moments, mass, text):
    inertia = pin.Inertia.Identity()  # the constructor refuses some of these, a URDF does not
    inertia.mass, inertia.inertia = mass, np.diag(moments)
    if not text:
        assert cp.Robot("a", one_body(inertia)).nv == 1
        return
    with pytest.raises(cp.errors.InvalidModel, match=text):
        cp.Robot("a", one_body(inertia))


@pytest.mark.long
def test_a_chain_whose_data_does_not_fit_is_refused_with_its_size(monkeypatch):
    def no_memory(model: pin.Model) -> None:
        raise MemoryError

    monkeypatch.setattr(pin.Model, "createData", no_memory)
    model = one_body(pin.Inertia.Random())
    text = r"1 degrees of freedom.* GB, more than this machine"
    with pytest.raises(cp.errors.InvalidModel, match=text):
        cp.Robot("a", model)


@pytest.mark.long
def test_a_robot_costs_one_data(monkeypatch):
    made, create = [], pin.Model.createData
    monkeypatch.setattr(pin.Model, "createData", lambda m: made.append(m) or create(m))
    cp.Robot("a", one_body(pin.Inertia.Identity()))
    assert len(made) == 1


TALOS_SIZE = 39


def posture(value: Any) -> Callable[[], Any]:
    return made(postures={"home": value})


def sprung(joint: str) -> Callable[[], Any]:
    return lambda: made(springs=[cp.model.Spring(joint, 1.0)])()


ROBOTS: dict[str, Case] = {
    **each("model", (None, 3, "talos", pin.Model), lambda x: cp.Robot("a", x), "model = .*Model"),
    "empty model": (lambda: cp.Robot("a", pin.Model()), "no degree of freedom"),
    "name": (lambda: cp.Robot(3, robot("talos").model), "name = 3"),
    **{
        f"{key} {value!r}": (made(**{key: value}), f"^{key}")
        for key in ("loops", "contacts", "actuated", "springs", "unused", "postures")
        for value in (3, None, "abc", [3])
    },
    "motor named twice": (
        made(actuated=["torso_1_joint"] * 2), "^actuated: 'torso_1_joint' is named twice",
    ),
    "motor of no joint": (
        made(actuated=["leg_left_7_joint"]),
        "no joint named 'leg_left_7_joint'; did you mean .*leg_left_6_joint",
    ),
    "motor of the world": (made(actuated=["universe"]), "no joint named 'universe'"),
    "spring on the world": (sprung("universe"), "no joint named 'universe'"),
    "spring on no joint": (sprung("knee"), "no joint named 'knee'"),
    "spring on a free-flyer": (
        sprung("root_joint"), "'root_joint': a joint with one degree of freedom"
    ),
    "posture short": (posture([1.0]), r"posture 'home'.*shape \(1,\): an array of shape \(39,\)"),
    "posture word": (posture("up"), "posture 'home'.*could not convert"),
    "posture none": (posture(None), "posture 'home'.*is needed"),
    "posture NaN": (posture(np.full(TALOS_SIZE, np.nan)), r"posture 'home'.*\[0\] = nan"),
    "posture zero quaternion": (posture(np.zeros(TALOS_SIZE)), "posture 'home'.*use 0 0 0 1"),
    "posture without a name": (
        made(postures={3: np.zeros(TALOS_SIZE)}), "3 is not the name of a posture",
    ),
    "frame": (lambda: robot("talos").frame("sole"), "no frame named 'sole'"),
    "frame 3": (lambda: robot("talos").frame(3), "frame = 3"),
    "passive_torque q": (
        lambda: robot("cassie").passive_torque([0.0], np.zeros(32)), r"q has shape \(1,\)",
    ),
    "passive_torque v": (
        lambda: robot("cassie").passive_torque(robot("cassie").postures["standing"], "fast"), "v: ",
    ),
    **each("spring", [(3, 1.0), ("", 1.0), ("a", np.nan), ("a", "stiff"), ("a", 1.0, np.inf)],
           lambda spring: cp.model.Spring(*spring), r"^(joint|stiffness|reference)\b"),
    "bars that cannot meet": (
        lambda: cp.model.four_bar(crank=5), "a bar of 5 m cannot be closed by bars of",
    ),
    "links without end": (lambda: cp.model.chain(WITHOUT_END), "^n = a int .*2000 is the largest"),
    "bars without end": (
        lambda: cp.model.n_four_bar(WITHOUT_END), "^n = a int .*2000 is the largest"
    ),
    "workers without end": (
        lambda: cp.Processes(WITHOUT_END), "^workers = a int .*1000 is the largest"
    ),
}  # fmt: skip


@refused(ROBOTS)
def test_robots_refuse(call, text):
    assert_refused(call, text)


def framed(name="new", parent="world", translation=(0, 0, 0), rotation=None) -> Callable[[], Any]:
    return lambda: robot("talos").with_frame(name, parent, translation, rotation)


NO_TURNS = {"word": "up", "2 x 2": np.eye(2), "NaN": np.full((3, 3), np.nan),
            "scaled": 2 * np.eye(3), "mirrored": MIRRORED,
            "skewed": np.eye(3) + 1e-6 * np.eye(3, k=1)}  # fmt: skip
FRAMES: dict[str, Case] = {
    "taken": (framed(name="left_sole_link"), "name = 'left_sole_link': talos has a frame"),
    "the world's": (framed(name="world"), "name = 'world'"),
    "no name": (framed(name=""), "name = ''"),
    "a number for a name": (framed(name=3), "name = 3"),
    "no parent": (framed(parent="left_sole"), "no frame named 'left_sole'; did you mean"),
    "a number for a parent": (framed(parent=3), "frame = 3"),
    **{f"to {x!r}": (framed(translation=x), "^translation") for x in (NOT_THREE[0], None)},
    "translation huge": (framed(translation=(0, 0, 1e60)), "^translation = 1e.60: no machine"),
    **{f"rotation {label}": (framed(rotation=R), "^rotation") for label, R in NO_TURNS.items()},
}


@refused(FRAMES)
def test_with_frame_refuses(call, text):
    assert_refused(call, text)


@pytest.mark.parametrize("value", [1e60, 1e155, 1e300])
@pytest.mark.parametrize("argument", ["length", "mass"])
@pytest.mark.parametrize("make", [cp.model.chain, cp.model.n_four_bar])
def test_mechanisms_refuse_what_is_larger_than_any_machine(make, argument, value):
    assert_refused(lambda: make(2, **{argument: value}), rf"^{argument} = .*no machine")


@pytest.mark.long
@each_row("value", [0, -1.0, np.nan, np.inf, "long", None, [1.0]])
def test_mechanisms_refuse_what_is_not_a_length(value):
    for make, arguments in (
        (cp.model.pendulum, ("length", "mass")),
        (cp.model.four_bar, ("ground", "crank", "coupler", "rocker", "density")),
    ):
        for argument in arguments:
            with pytest.raises(cp.InvalidArgument, match=rf"^{argument} = .*a positive number"):
                make(**{argument: value})


# --- files

NAMES: dict[Any, str] = {
    **dict.fromkeys([3, None, b"talos", 1.5], "^name = .*a name or a path"),
    "cassi": "no robot named 'cassi'; did you mean 'cassie'",
    "Talos": "'talos'",
    "nobody": "no robot named 'nobody'; known: anymal_c, ",
    "/nowhere/arm.urdf": r"/nowhere/arm\.urdf: cannot be opened",
    "/nowhere/arm.sdf": r"/nowhere/arm\.sdf: cannot be opened: No such file",
    "/nowhere/arm.stl": "a .urdf, an .sdf or an .xml with an MJCF is needed",
    "/nowhere/arm": "no robot named '/nowhere/arm'",
    "": "a .urdf, an .sdf or an .xml with an MJCF is needed",
    "a" * 5000: r"^name = 'a{80}': no name and no path: .*too long",
    "~no_such_user/arm.urdf": "^name = '~no_such_user/arm.urdf': no name and no path: .*home",
}


@each_row(("name", "text"), [*NAMES.items(), (["talos"], "^name = .*a name or a path")])
def test_load_robot_refuses_names_and_paths(name, text):
    assert_refused(lambda: cp.load_robot(name), text)


@pytest.mark.long
@pytest.mark.parametrize("root_joint", ["fixed", "free_flyer"])
def test_load_robot_refuses_a_root_joint_for_what_says_it_itself(root_joint):
    assert_refused(
        lambda: cp.load_robot("talos", root_joint=root_joint), "it is for a URDF or an SDF"
    )


@pytest.mark.parametrize("root_joint", ["flying", "", 3], ids=repr)
@pytest.mark.parametrize("name", ["talos", "/nowhere/arm.urdf"])
def test_load_robot_refuses_an_unknown_root_joint(name, root_joint):
    with pytest.raises(cp.InvalidArgument, match=r"^root_joint = .*fixed, free_flyer"):
        cp.load_robot(name, root_joint=root_joint)


LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def link(name: str, mass: str = "1", ixx: str = "1") -> str:
    inertia = f'<inertia ixx="{ixx}" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    return f'<link name="{name}"><inertial><mass value="{mass}"/>{inertia}</inertial></link>'


def joint(inside: str, name: str = "j", parent: str = "a", child: str = "b") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="revolute">{ends}{inside}{LIMIT}</joint>'


AXIS = '<axis xyz="0 0 1"/>'
A, B, J = link("a"), link("b"), joint(AXIS)


def urdf(*parts: str) -> str:
    return f"<robot name='r'>{''.join(parts)}</robot>"


ASIDE = '<origin xyz="1 0 0"/><axis xyz="0 1 0"/>'


def hinge(axis: str, more: str = "") -> str:
    return joint(f'{more}<axis xyz="{axis}"/>')


URDFS = {
    "empty": "",
    "words": "hello",
    "bytes": "\x00\x01",
    "cut short": f"<robot name='r'>{A}",
    "another format": "<sdf version='1.9'/>",
    "no links": urdf(),
    "nothing moves": urdf(A),
    "no name": f"<robot>{A}{B}{J}</robot>",
    "no child": urdf(A, J),
    "no parent": urdf(B, J),
    "two roots": urdf(A, B),
    "a circle": urdf(A, B, J, joint(AXIS, "k", "b", "a")),
    "a link twice": urdf(A, A, B, J),
    "a joint twice": urdf(A, B, link("c"), J, joint(AXIS, "j", "b", "c")),
    "unknown joint": urdf(A, B, J.replace("revolute", "wobbly")),
    "short axis": urdf(A, B, hinge("0 1")),
    "zero axis": urdf(A, B, hinge("0 0 0")),
    "NaN axis": urdf(A, B, hinge("nan 0 0")),
    "NaN origin": urdf(A, B, hinge("0 0 1", '<origin xyz="nan 0 0"/>')),
    "massless": urdf(A, "<link name='b'/>", J),
    "mass is a word": urdf(A, link("b", mass="heavy"), J),
    "mass is NaN": urdf(A, link("b", mass="nan"), J),
    "mass below zero": urdf(A, link("b", mass="-1"), J),
    "inertia below zero": urdf(A, link("b", ixx="-5"), hinge("1 0 0")),
    "mass is a word on the way": urdf(
        A, link("b", mass="heavy"), link("c"), J, joint(ASIDE, "k", "b", "c")
    ),
    "massless between two joints of one axis": urdf(
        A, "<link name='b'/>", link("c"), J, joint(AXIS, "k", "b", "c")
    ),
}

CARD = 'name = "x"\nsource = "s"\nlicence = "l"\n'
ARM = '[description]\nfile = "arm.urdf"\n'
FRAME = '[[frames]]\nname = "tool"\nparent = "b"\ntranslation = [0, 0, 1]\n'
CASSIE = '[description]\nfile = "cassie_description/robots/cassie_wo_gearbox_spring.sdf"\n'

CARDS = {
    "empty": "",
    "not TOML": "name =",
    "no description": CARD,
    "description is a number": CARD + "description = 3",
    "no file": CARD + "[description]",
    "file is a number": CARD + "[description]\nfile = 3",
    "file is empty": CARD + '[description]\nfile = ""',
    "no such file": CARD + '[description]\nfile = "nowhere.urdf"',
    "no such SDF": CARD + '[description]\nfile = "nowhere.sdf"',
    "a mesh": CARD + '[description]\nfile = "arm.stl"',
    "empty URDF": CARD + '[description]\nfile = "empty.urdf"',
    "empty SDF": CARD + '[description]\nfile = "empty.sdf"',
    "unknown entry": CARD + "weight = 3\n" + ARM,
    "an SDF's entry for a URDF": CARD + ARM + 'drop = ["j"]',
    "unknown entry of the description": CARD + ARM + "rotor = true",
    "no name": ARM,
    "unknown root joint": CARD + ARM + 'root_joint = "flying"',
    "unknown root joint of an SDF": (
        CARD + CASSIE + 'root = "pelvis"\ndrop = ["static"]\nroot_joint = "flying"\n'
        '[description.kinds]\nleft-achilles-spring-joint = "ball"\n'
        'right-achilles-spring-joint = "ball"'
    ),
    "kinds is a number": CARD + CASSIE + "kinds = 3",
    "drop is a number": CARD + CASSIE + "drop = 3",
    "postures is a number": CARD + "postures = 3\n" + ARM,
    "a posture is a number": CARD + ARM + "[postures]\nhome = 3",
    "posture of no joint": CARD + ARM + "[postures.home]\nknee = 3",
    "posture of two values": CARD + ARM + "[postures.home]\nj = [1, 2]",
    "posture is a word": CARD + ARM + '[postures.home]\nj = "up"',
    "posture is NaN": CARD + ARM + "[postures.home]\nj = nan",
    "loops is a number": CARD + "loops = 3\n" + ARM,
    "a loop is a number": CARD + "loops = [3]\n" + ARM,
    "unknown key of a loop": CARD + ARM + '[[loops]]\nframe_a = "a"\nframe_c = "b"',
    "unknown kind of loop": CARD + ARM + '[[loops]]\nframe_a = "a"\nframe_b = "b"\nkind = "rope"',
    "unknown contact": CARD + ARM + '[[contacts]]\nkind = "wheel"\nframe = "b"',
    "contact without kind": CARD + ARM + '[[contacts]]\nframe = "b"',
    "contact of kind 3": CARD + ARM + '[[contacts]]\nkind = 3\nframe = "b"',
    "offset is a word": CARD + ARM + '[[contacts]]\nkind = "point"\nframe = "b"\noffset = "x"',
    "frames is a number": CARD + "frames = 3\n" + ARM,
    "a frame is a number": CARD + "frames = [3]\n" + ARM,
    "frame on nothing": CARD + ARM + FRAME.replace('"b"', '"c"'),
    "frame without a place": CARD + ARM + '[[frames]]\nname = "tool"\nparent = "b"',
    "frame of a known name": CARD + ARM + FRAME.replace('"tool"', '"b"'),
    "frame with two numbers": CARD + ARM + FRAME.replace("0, 0, 1", "0, 1"),
    "unknown key of a frame": CARD + ARM + FRAME + "rpy = [0, 0, 0]",
    "actuated is a number": CARD + "actuated = 3\n" + ARM,
    "motor of no joint": CARD + 'actuated = ["knee"]\n' + ARM,
    "no such SRDF": CARD + ARM + 'srdf = "nowhere.srdf"',
    "empty SRDF": CARD + ARM + 'srdf = "empty.srdf"',
}


LOOP = '[[loops]]\nframe_a = "a"\nframe_b = "b"\n'
POINT = '[[contacts]]\nkind = "point"\nframe = "b"\n'
SAID = {
    "framea": (ARM + LOOP.replace("_a", "a"), r"loops\[0\]: no entry named 'framea'; did you mean"),
    "no frame_b": (ARM + '[[loops]]\nframe_a = "a"', r"loops\[0\]: the entry 'frame_b' is missing"),
    "loop on no frame": (
        ARM + LOOP + LOOP.replace('"b"', '"tool"'), r"loops\[1\]: no frame named 'tool'",
    ),
    "loop on one body": (ARM + LOOP.replace('"a"', '"b"'), r"loops\[0\]: b~b: both sides belong"),
    "loop twice": (ARM + LOOP + LOOP, r"loops\[1\]: two constraints are named 'a~b'"),
    "a rod without length": (ARM + LOOP + 'kind = "rod"', r"loops\[0\]: length = None for a rod"),
    "coupling of no joint": (
        ARM + '[[loops]]\nkind = "coupling"\njoint_a = "j"\njoint_b = "knee"',
        r"loops\[0\]: no joint named 'knee'",
    ),
    "contact on no frame": (
        ARM + POINT.replace('"b"', '"sole"'), r"contacts\[0\]: no frame named 'sole'",
    ),
    "contact twice": (ARM + POINT + POINT, r"contacts\[1\]: two constraints are named 'b'"),
    "ofset": (ARM + POINT + "ofset = 1", r"contacts\[0\]: no entry named 'ofset'"),
    "motors below a table": (
        ARM + '\nactuated = ["j"]', r"named 'description.actuated'; actuated goes to the top",
    ),
    "motors below a loop": (
        ARM + LOOP + 'actuated = ["j"]', r"loops\[0\]: no entry named 'actuated'; actuated goes to",
    ),
    "a number without its zero": (
        ARM + "[postures.up]\nj = -.5", r"at line \d+.*: 'j = -.5'; numbers have digits on both",
    ),
    "a text without quotes": (ARM + "[postures.up]\nj = bent", r"at line \d+.*: 'j = bent'$"),
    "motors in one text": ('actuated = "j"\n' + ARM, "entry actuated = 'j': a list of texts"),
    "motor twice": ('actuated = ["j", "j"]\n' + ARM, "actuated: 'j' is named twice"),
    "description in one text": ('description = "arm.urdf"', "description = 'arm.urdf': a table"),
    "posture in one number": (ARM + "[postures]\nup = 3", r"postures\.up = 3: a table is needed"),
    "posture of two values": (ARM + "[postures.up]\nj = [1, 2]", r"postures\.up: j has shape \(2,"),
    "posture of uneven lists": (
        ARM + "[postures.up]\nj = [[1, 2], [3]]", r"postures\.up: j: an array of shape \(1,\)",
    ),
    "rotors of no SRDF": (ARM + "rotors = true", r"description\.rotors is for .*description\.srdf"),
    "posture of the world": (
        ARM + "[postures.up]\nuniverse = 1.0", r"postures\.up: no joint named 'universe'",
    ),
    "one value for a free joint": (
        ARM + 'root_joint = "free_flyer"\n[postures.up]\nroot_joint = 1.0',
        r"postures\.up: root_joint has shape",
    ),
    "frame": (ARM + FRAME.replace('"b"', '"c"'), r"frames\[0\]: no frame named 'c'"),
    "file": (ARM.replace("arm.", "leg."), "no file 'leg.urdf': neither .*leg.urdf nor .*leg.urdf"),
    "long": (ARM.replace("arm.", "a" * 5000 + "."), "file 'a{80}': .*too long"),
}  # fmt: skip


@each_row(("card", "text"), SAID)
def test_a_wrong_card_is_refused_in_the_words_of_the_file(tmp_path, card, text):
    (tmp_path / "arm.urdf").write_text(f"<robot name='arm'>{A}{B}{J}</robot>")
    (tmp_path / "robot.toml").write_text('name = "x"\n' + card)
    assert_refused(lambda: cp.load_robot(tmp_path), rf"robot\.toml: .*{text}")


@pytest.mark.long
@pytest.mark.parametrize("angle", ["inf", "1" + 400 * "0"])
def test_an_angle_of_a_posture_is_a_number(tmp_path, angle):
    joint = J.replace("revolute", "continuous")
    (tmp_path / "arm.urdf").write_text(f"<robot name='arm'>{A}{B}{joint}</robot>")
    (tmp_path / "robot.toml").write_text(CARD + ARM + f"[postures.up]\nj = {angle}")
    assert_refused(lambda: cp.load_robot(tmp_path), r"robot\.toml: postures\.up: j")


@pytest.mark.long
def test_a_card_needs_a_name_and_a_file_and_no_more(tmp_path):
    (tmp_path / "arm.urdf").write_text(f"<robot name='arm'>{A}{B}{J}</robot>")
    (tmp_path / "robot.toml").write_text('name = "x"\n' + ARM)
    arm = cp.load_robot(tmp_path)
    assert (arm.source, arm.licence) == ("unknown", "unknown")


def loaded(folder: Path) -> dict[str, str]:
    """Load every broken file, all in one interpreter; a crash ends the list at its file."""
    paths = {}
    for i, (label, text) in enumerate(URDFS.items()):
        paths[f"urdf {label}"] = folder / f"{i}.urdf"
        paths[f"urdf {label}"].write_text(text)
    for i, (label, text) in enumerate(CARDS.items()):
        home = paths[f"card {label}"] = folder / str(i)
        home.mkdir()
        (home / "robot.toml").write_text(text)
        (home / "arm.urdf").write_text(f"<robot name='arm'>{A}{B}{J}</robot>")
        (home / "arm.stl").write_text("solid")
        for empty in ("empty.urdf", "empty.sdf", "empty.srdf"):
            (home / empty).write_text("")
    (folder / "good").mkdir()
    (folder / "good" / "robot.toml").write_text(CARD + ARM)
    (folder / "good" / "arm.urdf").write_text(f"<robot name='arm'>{A}{B}{J}</robot>")
    paths["card good"] = folder / "good"
    (folder / "folder.urdf").mkdir()
    paths["urdf is a folder"] = folder / "folder.urdf"
    answers = folder / "answers.txt"
    outcome = crash.run(
        f"""
        import condyn_pin as cp
        with open({str(answers)!r}, "w", buffering=1) as out:
            for label, path in { ({k: str(v) for k, v in paths.items()})!r}.items():
                print(end=label + chr(9), file=out)
                try:
                    robot = cp.load_robot(path)
                    cp.Scene(robot, robot.loops).summary()
                    answer = "loaded"
                except cp.CondynError as error:
                    answer = "refused " + str(error)
                except BaseException as error:
                    answer = type(error).__name__ + " " + str(error)
                print(answer.replace(chr(10), " "), file=out)
        """
    )
    lines = answers.read_text().splitlines()
    assert outcome.kind == "ok", (outcome, lines[-1])
    return dict(line.split("\t") for line in lines)


def test_every_broken_file_is_refused_with_a_sentence(tmp_path):
    answers = loaded(tmp_path)
    assert answers.pop("card good") == "loaded"
    assert len(answers) == len(URDFS) + len(CARDS) + 1
    assert {x: said for x, said in answers.items() if not re.match("refused .{20}", said)} == {}


@pytest.mark.long
def test_bytes_that_are_no_text_are_refused_with_the_path(tmp_path: Path):
    (tmp_path / "robot.toml").write_bytes(b"\xff\xfe\x00")
    assert_refused(lambda: cp.load_robot(tmp_path), r"robot\.toml: .*utf-8")
    (tmp_path / "arm.urdf").write_bytes(b"\xff\xfe\x00")
    assert_refused(
        lambda: cp.load_robot(tmp_path / "arm.urdf"), r"arm\.urdf: cannot be read as XML"
    )


# --- scenes

SCENES: dict[str, Case] = {
    **each("robot", (None, 3, "talos"), cp.Scene, "robot = .*load_robot"),
    "a model": (lambda: cp.Scene(robot("talos").model), r"robot = Model: .*Robot\(name, model\)"),
    **each("constraints", (3, None, "abc", cp.PointContact("left_sole_link")),
           lambda x: cp.Scene(robot("talos"), x), "constraints.*a list"),
    **each("a constraint", (3, None, "left_sole_link", cp.PointContact),
           lambda x: cp.Scene(robot("talos"), [x]), "a Loop, a Coupling or a TautCable is needed"),
    "the same twice": (
        lambda: cp.Scene(robot("talos"), 2 * robot("talos").contacts),
        "two constraints are named 'left_sole_link'; give one of them a name",
    ),
    "posture": (asked("talos", "state", "half_siting"), "did you mean 'half_sitting'"),
    "a part of a name": (
        lambda: robot("talos").frame_pose(robot("talos").postures["half_sitting"], "torso"),
        "no frame named 'torso'; did you mean 'torso_1_joint' or",
    ),
    **each("posture", (3, ["half_sitting"], {}), lambda x: scene("talos").state(x), "posture = "),
    "posture by joints": (
        asked("four_bar", "state", {"crank": 0.3}), r"scene.assemble\(robot.configuration\(",
    ),
    "q by joints": (
        asked("four_bar", "assemble", {"crank": 0.3}), r"^q: .*robot.configuration\(\{joint: value",
    ),
    "q by posture": (
        lambda: cp.solve(scene("talos"), "half_sitting", np.zeros(38), np.zeros(38)),
        r"^q: .*not 'half_sitting'; .*robot.postures\[name\] is one",
    ),
    "start by posture": (
        lambda: robot("talos").configuration({"head_1_joint": 0.1}, start="half_sitting"),
        r"^start: .*not 'half_sitting'; .*robot.postures\[name\]",
    ),
    "tau by joints": (
        lambda: cp.solve(scene("four_bar"), np.zeros(3), np.zeros(3), {"crank": 1.0}),
        r"^tau: .*robot.joint_vector\(\{joint: value",
    ),
    "assemble size": (asked("four_bar", "assemble", [0.0]), r"q has shape \(1,\)"),
    "assemble word": (asked("four_bar", "assemble", "closed"), "^q: "),
    "assemble complex": (asked("four_bar", "assemble", [1, 2, 3j]), "^q: .*complex"),
    "assemble NaN": (asked("four_bar", "assemble", [0, np.nan, 0]), r"q\[1\] = nan"),
    "assemble zero quaternion": (
        asked("talos", "assemble", np.zeros(TALOS_SIZE)), "q: a quaternion of it is zero",
    ),
    **{
        f"fixed {value!r}": (asked("four_bar", "assemble", np.ones(3), fixed=value), text)
        for value, text in (
            (3, "fixed = 3"),
            (None, "fixed = None"),
            ("crank", "fixed = 'crank': a list"),
            ([3], "fixed: 3 is not the name"),
            (["cranks"], "no joint named 'cranks'; did you mean 'crank'"),
            (["crank", "coupler", "rocker"], "coupler_rocker is open by .* fix fewer joints"),
        )
    },
    **each("rng", (None, 3), lambda x: scene("four_bar").sample(x), "rng = .*default_rng"),
    **{
        f"{key} {value!r}": (
            asked("four_bar", "sample", np.random.default_rng(0), **{key: value}), f"^{key}",
        )
        for key in ("spread", "speed")
        for value in (-1.0, np.nan, np.inf, "much", None, [1.0, 2.0])
    },
}  # fmt: skip


@refused(SCENES)
def test_scenes_refuse(call, text):
    assert_refused(call, text)


# --- solvers and workspaces

PROXIMAL = [cp.Proximal, cp.LCABA]
PARAMETERS: dict[str, Case] = {
    f"{kind.__name__} {parameter} = {value!r}": (
        partial(kind, **{parameter: value}),
        f"^{parameter} = .*(number|between)",
    )
    for kind, parameter, values in (
        *((kind, "mu", (-1.0, np.nan, np.inf, "small", [1.0], 1j)) for kind in PROXIMAL),
        (cp.DenseKKT, "mu", (-1.0, np.nan, np.inf, "small", [1.0], 1j, None)),
        (cp.LCABA, "mu", (0.0, 1e-310)),
        *(
            (kind, "max_iterations", (0, -1, 1.5, np.nan, np.inf, "many", None, True, [1], 2**40))
            for kind in PROXIMAL
        ),
        *((kind, "absolute_accuracy", (-1.0, np.nan, np.inf, "fine")) for kind in PROXIMAL),
        (cp.Proximal, "absolute_accuracy", (None,)),
        (cp.Proximal, "relative_accuracy", (-1.0, np.nan, np.inf, "fine")),
        (cp.dynamics.Reference, "rank_tolerance", (0.0, 1.0, -1.0, np.nan, "tight", None)),
        (cp.dynamics.Reference, "refinements", (-1, 1.5, np.nan, "some", None)),
    )
    for value in values
} | {
    "mu without end": (lambda: cp.Proximal(mu=WITHOUT_END), "^mu = "),
    "iterations": (lambda: cp.Proximal(max_iterations=WITHOUT_END), "^max_iterations = "),
}


@refused(PARAMETERS)
def test_parameters_refuse(call, text):
    assert_refused(call, text)


def bar_state() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (*scene("four_bar").state(), np.zeros(3))


def used(make: Callable[[], Any]) -> Callable[[], Any]:
    return lambda: cp.Workspace(scene("four_bar")).use(make())


WORKSPACES: dict[str, Case] = {
    **each("scene", (None, 3, "talos"), cp.Workspace, "scene = .* a Scene is needed"),
    "a robot": (lambda: cp.Workspace(robot("talos")), "scene = Robot: a Scene"),
    **each("solver", (3, "proximal", cp.Proximal),
           lambda x: cp.Workspace(scene("four_bar"), x), r"solver = .* such as Proximal\(\)"),
    "use None": (used(lambda: None), "scene = NoneType: a Scene"),
    "use a robot": (used(lambda: robot("four_bar")), "scene = Robot: a Scene"),
    "use another robot's": (used(lambda: scene("talos")), "'talos' .* make a new Workspace"),
    "solve without a scene": (lambda: cp.solve(None, *bar_state()), "scene = NoneType"),
    "solve with a word": (
        lambda: cp.solve(scene("four_bar"), *bar_state(), solver="proximal"),
        "solver = 'proximal'",
    ),
}  # fmt: skip


@refused(WORKSPACES)
def test_workspaces_refuse(call, text):
    assert_refused(call, text)


NO_NUMBERS = ["abc", None, [[1], [1, 2]], {"a": 1}, np.full(3, 1j), [None] * 3, object()]


@pytest.mark.values
@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda x: repr(x)[:12])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_states_that_are_no_numbers_are_refused_by_name(place, value):
    workspace = cp.Workspace(scene("four_bar"))
    state = list(bar_state())
    state[place] = value
    name = ("q", "v", "tau")[place]
    for call in (
        workspace.acceleration,
        workspace.solve,
        partial(cp.solve, scene("four_bar")),
    ):
        with pytest.raises(cp.InvalidArgument, match=rf"^{name}\b"):
            call(*state)
    if place == 0:
        for call in (workspace.jacobian, workspace.violation):
            with pytest.raises(cp.InvalidArgument, match=r"^q\b"):
                call(value)
    if place < 2:
        with pytest.raises(cp.InvalidArgument, match=rf"^{name}\b"):
            workspace.terms(*state[:2])


SOLVERS = [s() for s in cp.dynamics.SOLVERS.values() if s.exact and not s.missing()]
each_solver = pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.title)


@each_solver
def test_numbers_that_overflow_end_in_a_status(solver):
    """v of 1e200 is finite, its square is not; numpy's warnings are no answer."""
    q, v = scene("talos").state()
    workspace = cp.Workspace(scene("talos"), solver)
    with pytest.raises(cp.SolveFailed, match=r"not_finite|singular") as caught:
        workspace.solve(q, v + 1e200, v)
    with pytest.raises(cp.SolveFailed, match=r"not_finite|singular"):
        workspace.acceleration(q, v + 1e200, v)
    for solution in (caught.value.solution, workspace.solve(q, v + 1e200, v, throw=False)):
        assert solution.status in (cp.Status.NOT_FINITE, cp.Status.SINGULAR)
    assert workspace.solve(q, v, v).status.ok  # it is of use again


# --- the promise of a status

SCENES_OF_PROMISE = ["four_bar", "foot twice", "cassie"]
ADVICE = {
    cp.Status.INACCURATE: "more iterations",
    cp.Status.SINGULAR: "use Proximal",
    cp.Status.NOT_FINITE: "mu is too small",
}


@cache
def known(name: str) -> list[tuple[tuple[np.ndarray, ...], np.ndarray]]:
    """Return the state at rest and moving ones, each with the right accelerations."""
    rng = np.random.default_rng(11)
    here, nv = scene(name), scene(name).robot.nv
    states = [(*here.state(), np.zeros(nv))]
    states += [(*here.sample(rng), rng.normal(size=nv)) for _ in range(4)]
    reference = cp.Workspace(here, cp.dynamics.Reference())
    return [(state, reference.solve(*state, throw=False).a) for state in states]


def assert_keeps_its_promise(name: str, solver: cp.dynamics.Solver) -> None:
    """Solve at every known state: what says ok is right, what does not says why."""
    workspace = cp.Workspace(scene(name), solver)
    for state, right in known(name):
        with np.errstate(all="ignore"):
            solution = workspace.solve(*state, throw=False)
        if solution.status.ok:
            error = np.abs(solution.a - right).max() / max(np.abs(right).max(), GRAVITY)
            assert error < 1e-8, (solution.error_bound, error)
            assert np.isfinite(solution.lam).all()
        else:
            assert ADVICE[solution.status] in str(solution.status)
            # of a; or a is right, and it is the forces that are not
            assert not solution.error_bound <= 1e-8 or "forces are not" in str(solution.notices)


METHODS: dict[str, Callable[[float, int], cp.dynamics.Solver]] = {
    "proximal": lambda mu, n: cp.Proximal(mu=mu, max_iterations=n),
    "lcaba": lambda mu, n: cp.LCABA(mu=mu, max_iterations=n),
    "dense": lambda mu, _: cp.DenseKKT(mu=mu),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", SCENES_OF_PROMISE)
@settings(max_examples=200)
@given(exponent=st.floats(-16.0, 3.0), iterations=st.integers(1, 20))
def test_what_says_ok_is_right(name, method, exponent, iterations):
    solver = METHODS[method](10.0**exponent, iterations)
    if HAS_LCABA or method != "lcaba":
        assert_keeps_its_promise(name, solver)
    else:
        with pytest.raises(cp.errors.UnsupportedBackend, match="needs Pinocchio 4"):
            cp.Workspace(scene(name), solver)


@each_row("name", SCENES_OF_PROMISE)
def test_no_solver_says_ok_by_default_and_is_wrong(name):
    for solver in SOLVERS:
        if not unsupported_constraints(scene(name), solver):
            assert_keeps_its_promise(name, solver)


def test_a_failed_solve_carries_its_solution():
    q, v = scene("four_bar").state()
    workspace = cp.Workspace(scene("four_bar"), cp.Proximal(mu=1e3, max_iterations=1))
    with pytest.raises(cp.SolveFailed, match=r"inaccurate: .* more iterations") as caught:
        workspace.solve(q, v, v)
    kept = caught.value.solution
    same = workspace.solve(q, v, v, throw=False)
    np.testing.assert_array_equal(kept.a, same.a)
    assert kept.status is cp.Status.INACCURATE
    assert np.isfinite(kept.a).all()
    assert kept.error_bound > 1e-8


@pytest.mark.long
def test_a_status_that_is_not_finite_says_so():
    q, v = scene("four_bar").state()
    solver = cp.Proximal(mu=0.0, max_iterations=1)
    solution = cp.solve(scene("four_bar"), q, v, v, solver=solver, throw=False)
    assert solution.status is cp.Status.NOT_FINITE
    assert not np.isfinite(solution.a).any()
    with pytest.raises(cp.SolveFailed, match="not_finite"):
        cp.Workspace(scene("four_bar"), solver).acceleration(q, v, v)


@pytest.mark.values
@pytest.mark.parametrize("size", [1e160, 1e308])
@pytest.mark.parametrize(
    "verb",
    [
        lambda scene, q, v: cp.impact(scene, q, v),
        lambda scene, q, v: cp.simulation.switch(cp.Scene(scene.robot), scene, q, v),
        lambda scene, q, v: cp.inverse_dynamics(scene, q, v, 0 * v),
        lambda scene, q, v: cp.mechanism.project_acceleration(scene, q, v, 0 * v),
        lambda scene, q, v: cp.Workspace(scene).terms(q, v),
    ],
    ids=["impact", "switch", "inverse_dynamics", "project_acceleration", "terms"],
)
def test_a_velocity_whose_square_is_no_number_is_refused(verb, size):
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    v[0] = size
    assert_refused(lambda: verb(scene, q, v), r"v has numbers up to 1e\+.* overflow")
    assert size / 10 < scene.check(q, v).constraint_velocity[bar.loops[0].name].size < size


@pytest.mark.long
def test_an_acceleration_from_which_torques_overflow_is_refused():
    scene = cp.Scene(cp.model.four_bar())
    q, v = scene.state()
    assert_refused(lambda: cp.inverse_dynamics(scene, q, v, np.full(3, 1.7e308)), "a has numbers")


COUNTS = {
    "refinements": lambda n: cp.dynamics.Reference(refinements=n),
    "max_iterations": lambda n: cp.Proximal(max_iterations=n),
    "every": lambda n: cp.simulation.Projection(every=n),
    "stages": lambda n: cp.simulation.RadauIIA(stages=n),
    "workers": lambda n: cp.Processes(n).shutdown(),
    "n": lambda n: cp.model.chain(n),
    "count": lambda n: cp.study.SampledStates(n),
}


@each_row("name", COUNTS)
def test_a_count_is_a_whole_number_of_python_or_numpy(name):
    COUNTS[name](2)
    COUNTS[name](np.int64(2))
    for bad in (True, -1, 2.0, "2"):
        with pytest.raises(cp.InvalidArgument, match=rf"^{name} = {bad!r}: "):
            COUNTS[name](bad)


# --- numbers that are none

BAR = cp.Scene(cp.model.four_bar(), cp.model.four_bar().loops)
Q, V = BAR.state()
N = BAR.robot.nv
FLAGS = "numbers, not True or False"
MASKED = np.ma.array(np.zeros(N), mask=[False, True, False])


@refused(
    {
        "flags": (lambda: cp.solve(BAR, Q, np.zeros(N, bool), V), f"^v: .*{FLAGS}"),
        "a list of flags": (lambda: cp.solve(BAR, Q, V, [True, 0.0, 0.0]), f"^tau: .*{FLAGS}"),
        "a flag": (lambda: cp.simulate(BAR, Q, V, duration=True), f"^duration = True: .*{FLAGS}"),
        "flags of a batch": (
            lambda: cp.solve_batch(BAR, [Q], [V], np.zeros((1, N), bool)), f"^TAU: .*{FLAGS}"
        ),
        "flags of a function": (
            lambda: cp.simulate(BAR, Q, V, lambda t, q, v: v == 0, duration=0.01),
            rf"^tau\(0, q, v\): .*{FLAGS}",
        ),
        "flags of a posture": (
            lambda: cp.Robot("a", BAR.robot.model, postures={"b": [True, False, True]}), FLAGS
        ),
        "nothing": (lambda: cp.solve(BAR, Q, V, None), "^tau: .*numbers, not None"),
        "one that is missing": (lambda: cp.solve(BAR, Q, V, [0.0, None, 0.0]), "^tau: .*not None"),
        "no duration": (lambda: cp.simulate(BAR, Q, V, duration=None), "^duration = None: .*not"),
        "masked": (lambda: cp.solve(BAR, Q, V, MASKED), r"^tau: .*masked; .filled"),
        "masked batch": (lambda: cp.solve_batch(BAR, [Q], [V], MASKED[None]), "^TAU: .*masked"),
        "a column": (lambda: cp.solve(BAR, Q, V, np.zeros((N, 1))), r"^tau has shape \(3, 1\)"),
        "motors alone": (lambda: cp.solve(BAR, Q, V, [1.0]), r"needed; robot.joint_vector\("),
        "motors in a law": (
            lambda: cp.simulate(BAR, Q, V, lambda t, q, v: [1.0], duration=0.01),
            r"^tau\(0, q, v\) has shape \(1,\).*robot.joint_vector\(",
        ),
        "columns": (
            lambda: cp.solve_batch(BAR, [Q], [V], np.zeros((1, N, 1))),
            r"^TAU has shape \(1, 3, 1\)",
        ),
        "a column of a function": (
            lambda: cp.simulate(BAR, Q, V, lambda t, q, v: np.zeros((N, 1)), duration=0.01),
            r"^tau\(0, q, v\) has shape \(3, 1\)",
        ),
        "a number without an end": (
            lambda: cp.simulate(BAR, Q, V, duration=10**5000),
            "^duration = a int that cannot be shown",
        ),
    }
)  # fmt: skip
def test_what_is_no_number_is_not_taken_for_one(call, text):
    assert_refused(call, text)


VERBS: dict[str, Callable[[Any], Any]] = {
    "solve": lambda tau: cp.solve(BAR, Q, V, tau).a,
    "derivatives": lambda tau: cp.derivatives(BAR, Q, V, tau, check=True).da_dq,
    "Workspace.solve": lambda tau: cp.Workspace(BAR).solve(Q, V, tau).lam,
    "Workspace.acceleration": lambda tau: cp.Workspace(BAR).acceleration(Q, V, tau),
    "Workspace.derivatives": lambda tau: cp.Workspace(BAR).derivatives(Q, V, tau).dlam_dq,
    "solve_batch": lambda tau: cp.solve_batch(BAR, [Q], [V], tau).a,
    "derivatives_batch": lambda tau: cp.simulation.derivatives_batch(BAR, [Q], [V], tau).da_dq,
    "step": lambda tau: cp.step(BAR, Q, V, tau, dt=1e-3).q,
    "simulate": lambda tau: cp.simulate(BAR, Q, V, tau, duration=0.01).q,
    "simulate_batch": lambda tau: cp.simulate_batch(BAR, [Q], [V], tau, duration=0.01).q,
}


@pytest.mark.parametrize("verb", VERBS)
def test_zero_stands_for_no_torques_and_no_other_number_does(verb):
    without = VERBS[verb](np.zeros(N))
    for none in (0, 0.0, np.float64(-0.0)):
        assert (VERBS[verb](none) == without).all()
    for number in (1.0, False):
        with pytest.raises(cp.InvalidArgument, match=r"^(tau|TAU)\b.*array of shape .* is needed"):
            VERBS[verb](number)


@pytest.mark.long
def test_an_array_without_anything_masked_is_an_array():
    assert cp.solve(BAR, np.ma.array(Q), V, np.zeros(N)).status.ok


# --- functions


def study(progress: Any) -> Any:
    return cp.Study([BAR], [cp.DenseKKT()], states=1).run(timed=False, progress=progress)


def moved(**options: Any) -> Any:
    return cp.simulate(BAR, Q, V, **{"duration": 0.01} | options)


@refused(
    {
        "torques": (lambda: moved(tau=lambda t, q: q), r"^tau takes \(t, q\): it is called with"),
        "torques of a batch": (
            lambda: cp.simulate_batch(BAR, [Q], [V], lambda q, v: q, duration=0.01),
            r"^tau takes \(q, v\): it is called with \(t, q, v\)",
        ),
        "condition": (
            lambda: cp.Event(name="e", when=lambda: 1.0),
            r"^event 'e': when takes \(\): it is called",
        ),
        "no condition": (lambda: cp.Event(name="e", when=3), "^event 'e': when = 3: a function"),
        "progress of a run": (lambda: moved(progress=3), r"^progress = 3: a function of \(share\)"),
        "progress of a study": (lambda: study(3), r"^progress = 3: a function of \(what, done"),
        "progress of one argument": (lambda: study(lambda x: None), r"^progress takes \(x\)"),
        "progress of a choice": (
            lambda: cp.study.tune(BAR, progress="x", save=False), "^progress = 'x': a function"
        ),
        "progress of a batch": (
            lambda: cp.solve_batch(BAR, [Q], [V], [V], progress=lambda x: None), "^progress takes"
        ),
    }
)  # fmt: skip
def test_functions_that_cannot_be_called_are_refused_before_the_run(call, text):
    assert_refused(call, text)


# --- states and steps


def free_box() -> cp.Scene:
    contact = cp.FrictionalContact("box", cp.constraints.Box(0.1, 0.1, 0.1), friction=0.5)
    return cp.Scene(cp.model.free_box(), contacts=[contact])


STATE_VERBS = {
    "solve": lambda s, q, v: cp.solve(s.bilateral, q, v, v),
    "solve_batch": lambda s, q, v: cp.solve_batch(s.bilateral, [q], [v], v),
    "derivatives": lambda s, q, v: cp.derivatives(s.bilateral, q, v, v),
    "step": lambda s, q, v: cp.step(s, q, v, dt=1e-3),
    "contact_problem": lambda s, q, v: cp.stepping.contact_problem(s, q, v, dt=1e-3),
    "step_batch": lambda s, q, v: cp.stepping.step_batch(s, [q], [v], dt=1e-3),
    "simulate": lambda s, q, v: cp.simulate(s, q, v, duration=2e-3),
    "simulate_batch": lambda s, q, v: cp.simulate_batch(s, [q], [v], duration=2e-3),
    "action": lambda s, q, v: cp.layers.Action(s, 1e-3, motors=["floating"]).step([*q, *v], v),
    "gaps": lambda s, q, v: cp.dynamics.contact_gaps(s, q),
}


@each_row("verb", STATE_VERBS)
def test_one_rule_for_the_quaternion_of_a_state(verb):
    """Six digits are enough, any other length is refused, a zero and NaN too."""
    scene = free_box()
    q, v = scene.state()
    q[3:7] = np.array([0.2, -0.4, 0.1, 0.8]) / np.linalg.norm([0.2, -0.4, 0.1, 0.8])
    q[2] = 1.0
    for factor in (1.0, 1 + 5e-7, 1 - 5e-7):
        off = q.copy()
        off[3:7] *= factor
        STATE_VERBS[verb](scene, off, v)
    for factor in (3.0, 1 + 5e-6, 0.999, 0.0, np.nan):
        off = q.copy()
        off[3:7] *= factor
        with pytest.raises(cp.InvalidArgument, match=r"norm|finite"):
            STATE_VERBS[verb](scene, off, v)


STEP_VERBS = {
    "step": lambda s, q, v, dt: cp.step(s, q, v, dt=dt),
    "contact_problem": lambda s, q, v, dt: cp.stepping.contact_problem(s, q, v, dt=dt),
    "step_batch": lambda s, q, v, dt: cp.stepping.step_batch(s, [q], [v], dt=dt),
    "derivatives": lambda s, q, v, dt: cp.gradients.step_derivatives_batch(s, [q], [v], dt=dt),
    "simulate": lambda s, q, v, dt: cp.simulate(s, q, v, duration=1.0, dt=dt),
    "a motion as long": lambda s, q, v, dt: cp.simulate(s, q, v, duration=dt, dt=dt),
    "action": lambda s, q, v, dt: cp.layers.Action(s, dt, motors=["floating"]),
    "limits": lambda s, q, v, dt: cp.control.ControlLimits(dt=dt),
    "gains": lambda s, q, v, dt: cp.Baumgarte.deadbeat(dt),
}


@pytest.mark.values
@pytest.mark.parametrize("dt", [1e151, 1e160, 1e300, 1e-151, 5e-324, 0.0, -1.0, np.inf, np.nan])
@pytest.mark.parametrize("verb", STEP_VERBS)
def test_steps_of_an_absurd_size_are_refused_by_name(verb, dt):
    if verb == "simulate" and dt > 1:  # it takes one step
        dt = 1.0 / dt
    scene = free_box()
    with pytest.raises(cp.InvalidArgument, match=r"^(dt|duration) = "):
        STEP_VERBS[verb](scene, *scene.state(), dt)


@pytest.mark.parametrize("dt", [1e-140, 1e100, 1e149])
@pytest.mark.parametrize("scheme", [cp.StewartTrinkle(), cp.Moreau()])
def test_steps_of_any_other_size_have_a_status(scheme, dt):
    scene = free_box()
    q, v = scene.state()
    for speed in (0.0, 1e5):
        taken = cp.step(scene, q, v + speed, dt=dt, integrator=scheme, throw=False)
        assert isinstance(taken.status, cp.contact.ContactStatus)
        assert dt < 1 or not taken.status.ok


# --- files and ports


@each_row("port", [-1, 65536, "x", True, 80.5, None])
def test_ports_that_are_none_are_refused(port):
    pytest.importorskip("meshcat")
    with pytest.raises(cp.InvalidArgument, match=r"^port = .*from 1 to 65535 is needed, or 0"):
        cp.view(cp.model.pendulum(), port=port, browser=False)


@each_row("path", [3, None, "a\0b"])
def test_names_of_files_that_are_none_are_refused(path):
    with pytest.raises(cp.InvalidArgument, match="the name of a file is needed"):
        moved().save(path)
    with pytest.raises(cp.InvalidArgument, match="no file of a trajectory"):
        cp.Trajectory.load(path)
