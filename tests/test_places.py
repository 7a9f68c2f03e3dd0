"""Frames as pairs (joint, pin.SE3) and pin.Frames: what named frames at the same places answer."""

from __future__ import annotations

import dataclasses
import pickle
import sys

import numpy as np
import pinocchio as pin
import pytest
from shared import each_row, robot
from urdf_texts import joint, link

import condyn_pin as cp
from condyn_pin.constraints.places import frame_text
from condyn_pin.control import FrameTask, Orientation
from condyn_pin.model import SpringDamper

TURNED = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 0.02, -0.3]))
AHEAD = pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.0]))


def solo() -> tuple[cp.Robot, int]:
    """The quadruped, and the number of its knee; `foot` is TURNED there, `hip` AHEAD of another."""
    legged = robot("solo12")
    knee = legged.joints[2]
    named = legged.with_frame("foot", knee, TURNED).with_frame("hip", legged.joints[4], AHEAD)
    return named, named.model.getJointId(knee)


def forms(knee: int, name: str) -> dict[str, object]:
    """The frame `foot` in all forms."""
    return {
        "by number": (knee, TURNED),
        "by name": (name, TURNED),
        "as a list": [np.int64(knee), TURNED],
        "pin.Frame": pin.Frame("sole", knee, 0, TURNED, pin.FrameType.OP_FRAME),
        "as a text": frame_text("frame", (name, TURNED)),
    }


FORMS = list(forms(1, "knee"))


@each_row("form", FORMS)
def test_a_frame_in_any_form_is_the_named_one(form):
    named, knee = solo()
    given = forms(knee, named.joints[2])[form]
    joint, placement = named.frame(given)
    assert joint == knee
    assert placement.isApprox(TURNED, 1e-15)
    q = named.postures["standing"] if "standing" in named.postures else pin.neutral(named.model)
    assert named.frame_pose(q, given).isApprox(named.frame_pose(q, "foot"), 1e-14)
    one, two = (named.with_frame("new", of, AHEAD).frame("new") for of in (given, "foot"))
    assert one[0] == two[0]
    assert one[1].isApprox(two[1], 1e-14)


def constraints(frame, other):
    return [
        cp.PointContact(frame),
        cp.SurfaceContact(frame),
        cp.constraints.LineContact(frame, "x"),
        cp.constraints.PlanarContact(frame),
        cp.constraints.KnifeEdge(frame),
        cp.constraints.RollingBall(frame, 0.1),
        cp.constraints.RollingWheel(frame, 0.1),
        cp.Loop(frame, other, "ball"),
        cp.Loop(other, frame, "hinge", axis="y"),
        cp.Loop(frame, "world", "rod", length=0.5),
        cp.constraints.Driven(cp.Loop(frame, other, "ball"), lambda t: np.zeros((3, 3))).at(0.0),
    ]


@pytest.mark.values
@pytest.mark.parametrize("kind", range(len(constraints("a", "b"))))
@pytest.mark.parametrize("form", FORMS)
def test_every_constraint_takes_it_and_has_the_same_rows(kind, form):
    named, knee = solo()
    other = named.joints[4]
    frame = forms(knee, named.joints[2])[form]
    wanted = cp.Scene(named, [constraints("foot", "hip")[kind]])
    scene = cp.Scene(named, [constraints(frame, (other, AHEAD))[kind]])
    rng = np.random.default_rng(kind)
    q, v = pin.integrate(named.model, pin.neutral(named.model), rng.normal(size=named.nv)), rng
    v = rng.normal(size=named.nv)
    found, right = (cp.Workspace(each).terms(q, v) for each in (scene, wanted))
    assert np.allclose(found.J, right.J, atol=1e-12)
    assert np.allclose(found.gamma, right.gamma, atol=1e-10)


def test_a_scene_names_joints_that_were_numbered_and_keeps_short_names():
    named, knee = solo()
    name = named.joints[2]
    scene = cp.Scene(named, [cp.PointContact((knee, AHEAD)), cp.Loop((0, TURNED), (9, AHEAD))])
    point, loop = scene.constraints
    assert (point.frame, point.name) == (f"{name} + [0.1 0 0]", f"{name} + [0.1 0 0]")
    assert loop.frame_b == f"{named.joints[8]} + [0.1 0 0]"
    assert loop.name.startswith("world + [0.1 0.02 -0.3 0.1476 -0.09842 0.2461 0.9529]~")
    sole = pin.Frame("sole", knee, 0, TURNED, pin.FrameType.OP_FRAME)
    (held,) = cp.Scene(named, [cp.PointContact(sole)]).constraints
    assert held.name == "sole"
    assert held.frame.startswith(f"{name} + [0.1 0.02 -0.3 0.14")
    foot = named.model.frames[named.model.getFrameId("foot")]
    (held,) = cp.Scene(named, [cp.PointContact(foot)]).constraints
    assert (held.name, held.frame) == ("foot", "foot")
    assert cp.Scene(named, [cp.PointContact((knee, AHEAD), name="mine")]).names == ("mine",)


def test_robots_and_smaller_scenes_and_robots_side_by_side_keep_the_place():
    named, knee = solo()
    legged = named.with_loops(cp.Loop((knee, TURNED), (0, AHEAD)))
    assert legged.loops[0].frame_b == "world + [0.1 0 0]"
    both = cp.model.together({"a": named, "b": legged})
    (loop,) = both.loops
    assert (both.frame(loop.frame_a)[0], both.frame(loop.frame_b)[0]) == (knee + 13, 0)
    q = pin.neutral(named.model)
    scene = cp.Scene(legged, legged.loops)
    smaller = scene.lock(named.joints[1:3], q)
    assert smaller.robot.nv == named.nv - 2
    there, here = (
        s.robot.frame_pose(pin.neutral(s.robot.model), s.constraints[0].frame_a)
        for s in (smaller, scene)
    )
    assert there.isApprox(here, 1e-12)


def test_forces_springs_contacts_and_tasks_take_it():
    named, knee = solo()
    q, v, tau = pin.neutral(named.model), np.zeros(named.nv), np.zeros(named.nv)
    scene, here = cp.Scene(named), (knee, TURNED)
    push = [cp.AppliedForce(frame, [1.0, 2.0, 3.0]) for frame in (here, "foot")]
    one, two = (cp.solve(scene, q, v, tau, forces=[each]).a for each in push)
    assert np.allclose(one, two, rtol=1e-12, atol=1e-12)
    pulled = [
        dataclasses.replace(named, spring_dampers=[SpringDamper(frame, "world", 100.0)])
        for frame in (here, "foot")
    ]
    one, two = (each.passive_torque(q, v) for each in pulled)
    assert np.allclose(one, two, rtol=1e-12, atol=1e-12)
    assert pulled[0].spring_dampers[0].frame_a.startswith(named.joints[2])
    touching = [
        cp.Scene(named, contacts=[cp.FrictionalContact(frame, friction=0.7, name="c")])
        for frame in (here, "foot")
    ]
    one, two = (cp.dynamics.contact_gaps(each, q) for each in touching)
    assert one == pytest.approx(two)
    pair = cp.FrictionalContact(
        here, cp.constraints.Ball(0.1), on=(5, AHEAD), on_shape=cp.constraints.Ball(0.1),
        friction=0.5,
    )  # fmt: skip
    (bound,) = cp.Scene(named, contacts=[pair]).contact_bounds[0].pairs
    assert (bound.joint, bound.ground) == (knee, 5)
    one, two = (cp.control.operational_space(scene, q, frame) for frame in (here, "foot"))
    assert np.allclose(one.J, two.J, atol=1e-14)
    assert one.frame.startswith(f"#{knee} + [")
    for task in (FrameTask, Orientation):
        answers = [
            cp.Controller(scene, [task(frame, name="task")], cones={}).solve(q, v).a
            for frame in (here, "foot")
        ]
        assert np.allclose(*answers, atol=1e-6)


@pytest.mark.long
def test_it_is_a_value_that_files_keep(tmp_path):
    named, knee = solo()
    contact = cp.SurfaceContact((knee, TURNED), axes="world")
    assert contact == cp.SurfaceContact((knee, TURNED), axes="world")
    assert contact != cp.SurfaceContact((knee, AHEAD), axes="world")
    scene = cp.Scene(named, [contact])
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert hash(pickle.loads(pickle.dumps(scene))) == hash(scene)
    q, v = pin.neutral(named.model), np.zeros(named.nv)
    there = (0, named.frame_pose(q, (knee, TURNED)))
    loop = cp.Loop((knee, TURNED), there, "weld", axes="world", drift=cp.Baumgarte(3.0, 2.0))
    scene = cp.Scene(named, [loop])
    motion = cp.simulate(scene, q, v, 0.0, duration=0.002, dt=1e-3)
    motion.save(tmp_path / "motion.npz")
    again = cp.Trajectory.load(tmp_path / "motion.npz").scene
    assert again.constraints == scene.constraints
    assert again.bounds[0].placement1 == scene.bounds[0].placement1
    text = named.with_loops(cp.Loop((knee, TURNED), "world", name="tie")).to_mjcf()
    assert 'site1="tie_a"' in text


def turned(R):
    return pin.SE3(np.array(R, dtype=float), np.zeros(3))


WRONG = {
    "no SE3": (
        (3, "knee"),
        r"the name of a frame is needed, or .joint, pin.SE3., or a pin",
    ),
    "no joint": ((None, TURNED), "joint None: its name or number is needed"),
    "a flag": ((True, TURNED), "joint True: its name or number"),
    "negative": ((-1, TURNED), "joint -1: its name or number"),
    "NaN": ((3, pin.SE3(np.eye(3), np.array([0, np.nan, 0]))), "placement is at .*nan.*finite"),
    "a rotation of NaN": ((3, turned(np.full((3, 3), np.nan))), "rotation: it is not finite"),
    "left-handed": ((3, turned(np.diag([1, 1, -1]))), "no valid rotation: it is left-handed"),
}


@each_row("case", WRONG)
def test_what_is_no_frame_is_refused_by_name(case):
    value, words = WRONG[case]
    with pytest.raises(cp.InvalidArgument, match="^frame.*" + words):
        cp.PointContact(value)


@each_row(
    ("frame", "words"),
    [
        ((40, TURNED), "joint 40: solo12 has joints 1 to 13, and the world, 0"),
        (("kne", TURNED), "no frame named 'kne'"),
        ("foot + [1 2]", r"x y z \[m\] are needed in brackets"),
        ("foot + [1 2 3 0 0 0 0]", "x y z and a quaternion"),
        ("foot + [one 2 3]", "no frame named 'foot . .one 2 3.'"),
    ],
)
def test_a_place_that_the_robot_lacks_is_refused_by_name(frame, words):
    named, _ = solo()
    with pytest.raises(cp.CondynError, match=words):
        cp.Scene(named, [cp.PointContact(frame)])


def test_a_joint_named_as_a_number_is_not_guessed():
    model = pin.Model()
    for i in (2, 1):
        joint = model.addJoint(model.njoints - 1, pin.JointModelRZ(), pin.SE3.Identity(), f"#{i}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    with pytest.raises(cp.errors.InvalidModel, match="joint '#2' of odd is named as a number"):
        cp.Scene(cp.Robot("odd", model), [cp.PointContact((2, AHEAD))])


@each_row("text", ["#1 + [0.1 0 0]", "j1 + [0.1 0 0]", "sole (#1 + [0.1 0 0])"])
def test_a_frame_with_the_text_of_another_place_is_refused(text):
    sole = pin.Frame("sole", 1, 0, AHEAD, pin.FrameType.OP_FRAME)
    frame = {"#": (1, AHEAD), "j": ("j1", AHEAD), "s": sole}[text[0]]
    here, there = (
        cp.Robot("chain", framed(chain("j1", "j2"), text, 1, p))
        for p in (AHEAD, pin.SE3(np.eye(3), np.array([0.0, 0.0, 5.0])))
    )
    assert here.frame(frame)[1].isApprox(AHEAD)
    with pytest.raises(cp.errors.InvalidModel, match="has the text of a place and is elsewhere"):
        there.frame(frame)
    with pytest.raises(cp.errors.InvalidModel, match="has the text of a place and is elsewhere"):
        cp.Scene(there, [cp.PointContact(frame)])


def chain(*names):
    model = pin.Model()
    for name in names:
        joint = model.addJoint(model.njoints - 1, pin.JointModelRZ(), AHEAD, name)
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), AHEAD)
    return model


def framed(model, name, joint, placement):
    model.addFrame(pin.Frame(name, joint, 0, placement, pin.FrameType.OP_FRAME))
    return model


def test_a_frame_with_brackets_that_are_no_place_has_its_name():
    for name in ("sole + [1 2]", "sole + [1 2 3]", "j1 + [1 2]"):
        bracketed = cp.Robot("chain", framed(chain("j1"), name, 1, AHEAD))
        assert bracketed.frame(name)[1].isApprox(AHEAD)


@pytest.mark.parametrize("name", ["world", "universe"])
def test_a_joint_with_the_name_of_the_world_is_not_the_world(name):
    odd = cp.Robot("odd", chain("j1", name))
    for frame in ((name, AHEAD), name):
        with pytest.raises(cp.errors.InvalidModel, match="has the world's name and is elsewhere"):
            odd.frame(frame)
    assert odd.frame((2, AHEAD))[0] == 2
    if name == "world":  # as the text of joint 0 has it
        with pytest.raises(cp.errors.InvalidModel, match="has the world's name"):
            odd.frame((0, AHEAD))
    else:
        assert odd.frame((0, AHEAD))[0] == 0


@pytest.mark.long
def test_names_of_joints_may_have_brackets_and_lines():
    odd = cp.Robot("odd", chain("a + [1 2 3]", "b (#1)", "c\nd", "e + [1"))
    for number, name in enumerate(odd.joints, start=1):
        sole = pin.Frame(f"sole\n{number}", number, 0, TURNED, pin.FrameType.OP_FRAME)
        for frame in ((number, TURNED), (name, TURNED), sole):
            (contact,) = cp.Scene(odd, [cp.PointContact(frame)]).constraints
            assert odd.frame(contact.frame)[0] == number
            assert odd.frame(contact.frame)[1].isApprox(TURNED)


@each_row(
    "numbers", ["1e999 0 0", "1e60 0 0", "0 0 0 0 0 1e999 1", "-1e999 0 0 0 0 0 1", " ", "1 2 3 4"]
)
def test_a_text_without_a_placement_is_refused(numbers):
    named, _ = solo()
    with pytest.raises(cp.InvalidArgument, match="are needed in brackets"):
        named.frame(f"foot + [{numbers}]")


def test_places_on_places_have_an_end():
    named, _ = solo()
    joint, step = named.joints[0], " + [1 0 0]"
    assert named.frame(joint + 4 * step)[1].translation[0] == pytest.approx(4.0)
    with pytest.raises(cp.InvalidArgument, match="a place on a place"):
        named.frame(joint + 1500 * step)


@pytest.mark.long
def test_a_quaternion_of_any_size_is_a_rotation():
    named, _ = solo()
    for size in ("1e-320", "1e-200", "1E200", "1e308"):
        R = named.frame(f"{named.joints[0]} + [0 0 0 {size} 0 0 {size}]")[1].rotation
        assert np.allclose(R, pin.utils.rotate("x", np.pi / 2), atol=1e-15)


def test_numbers_of_joints_that_no_model_has_are_refused():
    named, _ = solo()
    with pytest.raises(cp.errors.UnknownName, match="no frame named '#999"):
        named.frame("#" + "9" * 5000 + " + [0 0 0]")
    with pytest.raises(cp.InvalidArgument, match="its name or number is needed"):
        named.frame((10**5000, AHEAD))
    with pytest.raises(cp.errors.UnknownName):
        named.frame(f"{named.joints[0]} + [\u0661 0 0]")


def test_axes_of_a_force_are_those_of_any_frame():
    named, _ = solo()
    q, v, tau = pin.neutral(named.model), np.zeros(named.nv), np.zeros(named.nv)
    contact = cp.SurfaceContact("foot", axes=(5, TURNED), name="c")
    force = cp.solve(cp.Scene(named, [contact]), q, v, tau).forces["c"]
    R = named.frame_pose(q, (5, TURNED)).rotation
    plain = cp.solve(cp.Scene(named, [cp.SurfaceContact("foot")]), q, v, tau).forces["foot"]
    assert np.allclose(np.asarray(force).reshape(2, 3) @ R.T, plain.in_world().reshape(2, 3))
    assert np.allclose(force.own, plain)
    assert np.allclose(force.rotation, R)
    assert force.frame.startswith(named.joints[4])
    with pytest.raises(cp.errors.UnknownName, match="no frame named 'fot'"):
        cp.Scene(named, [cp.PointContact("foot", axes="fot")])
    held = cp.constraints.HeldJoint(named.joints[2], 0.0, axes="world")
    with pytest.raises(cp.errors.InvalidConstraint, match=r"axes = 'world'.*along joints"):
        cp.Scene(named, [held])
    with pytest.raises(cp.InvalidArgument, match=r"drift = 3\.0: Baumgarte"):
        cp.PointContact("foot", drift=3.0)


def test_forces_of_a_motion_are_in_the_axes_that_are_wanted():
    named, _ = solo()
    q, v, tau = pin.neutral(named.model), np.zeros(named.nv), np.zeros(named.nv)
    spot = cp.PointContact("hip")
    motion, plain = (
        cp.simulate(cp.Scene(named, [spot, contact]), q, v, tau, duration=0.003, dt=1e-3)
        for contact in (
            cp.SurfaceContact("foot", axes=(5, AHEAD), name="c"),
            cp.SurfaceContact("foot", name="c"),
        )
    )
    assert np.array_equal(motion.forces["hip"], plain.forces["hip"])
    for q, found, own in zip(motion.q, motion.forces["c"], plain.forces["c"], strict=True):
        wanted, foot = (named.frame_pose(q, at).rotation for at in ((5, AHEAD), "foot"))
        assert np.allclose(found.reshape(2, 3) @ wanted.T, own.reshape(2, 3) @ foot.T)
        assert not np.allclose(found, own, rtol=1e-3)


@pytest.mark.parametrize("scheme", [cp.stepping.StewartTrinkle(), cp.stepping.Moreau()])
def test_forces_of_steps_and_batches_are_in_the_axes_that_are_wanted(scheme):
    named, knee = solo()
    q, tau = pin.neutral(named.model), np.zeros(named.nv)
    v = np.linspace(-0.4, 0.4, named.nv)
    gear = cp.constraints.Coupling(named.joints[3], named.joints[6], name="gear")
    own_scene, scene = (
        cp.Scene(named, [gear, cp.constraints.PlanarContact("foot", axes=axes, name="c")])
        for axes in (None, (knee, TURNED))
    )
    own, step = (cp.step(each, q, v, dt=1e-4, integrator=scheme) for each in (own_scene, scene))
    assert np.array_equal(own.lam, step.lam)
    before = cp.solve(own_scene, q, tau, tau).forces["c"].rotation
    turn = named.frame_pose(q, (knee, TURNED)).rotation.T @ before
    for of in ("forces", "impulses"):
        ours, theirs = getattr(own, of), getattr(step, of)
        turned = (ours["c"].reshape(-1, 3) @ turn.T).ravel()
        largest = np.abs(turned).max()
        assert np.allclose(theirs["c"], turned, rtol=0, atol=1e-3 * largest)
        assert np.abs(theirs["c"] - ours["c"]).max() > 0.1 * largest
        assert np.array_equal(ours["gear"], theirs["gear"])
    Q, V = np.array([q, q]), np.zeros((2, named.nv))
    Q[1] = pin.integrate(named.model, q, np.r_[0.0, 0.0, 0.0, 0.3, -0.2, 0.4, np.zeros(12)])
    batch = cp.solve_batch(scene, Q, V, tau)
    for i, at in enumerate(Q):
        alone = cp.solve(scene, at, V[i], tau)
        for name, force in alone.forces.items():
            assert np.allclose(batch.forces[name][i], force, rtol=1e-9, atol=1e-9)
    assert np.array_equal(batch.lam, cp.solve_batch(own_scene, Q, V, tau).lam)


@pytest.mark.long
def test_what_is_printed_of_a_constraint_has_no_defaults():
    loop = cp.Loop("a", "b", name="l")
    assert repr(loop) == "Loop(name='l', frame_a='a', frame_b='b')"
    assert repr(cp.PointContact("a", axes="world", offset=(0.0, 0.0, 1.0))) == (
        "PointContact(name='a', axes='world', frame='a', offset=(0.0, 0.0, 1.0))"
    )
    contact = cp.FrictionalContact("a", friction=0.5)
    assert repr(contact) == "FrictionalContact(name='a', frame='a', friction=0.5)"
    known = {"Loop": cp.Loop, "FrictionalContact": cp.FrictionalContact}
    assert [eval(repr(each), known) for each in (loop, contact)] == [loop, contact]


@pytest.mark.long
def test_fields_that_take_any_frame_are_annotated_so():
    frame = cp.constraints.FrameLike
    for kind, field in (
        (cp.Loop, "frame_a"),
        (cp.PointContact, "frame"),
        (cp.FrictionalContact, "frame"),
        (cp.AppliedForce, "frame"),
    ):
        annotations = (vars(base).get("__annotations__", {}) for base in kind.__mro__)
        module = vars(sys.modules[kind.__module__])
        assert eval(next(a[field] for a in annotations if field in a), module) == frame


LINKS = link("base", "") + link("arm") + joint("shoulder", "base", "arm")
TOML = """name = "two"
source = "here"
licence = "BSD-2-Clause"
[description]
file = "two.urdf"
[[loops]]
frame_a = "arm + [0.3 0 0]"
frame_b = "world + [0.3 0 0 0 0 1 1]"
kind = "ball"
name = "tip"
"""


@pytest.mark.long
def test_files_of_robots_name_places_too(tmp_path):
    (tmp_path / "two.urdf").write_text(f'<robot name="two">{LINKS}</robot>', encoding="utf-8")
    (tmp_path / "robot.toml").write_text(TOML, encoding="utf-8")
    arm = cp.load_robot(tmp_path)
    bound = cp.Scene(arm, arm.loops).bounds[0]
    assert np.allclose(bound.placement1.translation, [0.3, 0, 0])
    assert arm.frame("world + [0.3 0 0 0 0 1 1]")[1].rotation[1, 0] == pytest.approx(1.0)


def test_lengths_of_a_place_are_not_left_in_other_units():
    with pytest.raises(cp.InvalidArgument, match=r"frame = 'knee . .0\.1 0 0.' has lengths"):
        cp.PointContact(("knee", AHEAD)).in_units(1000.0, float)
    assert cp.PointContact("knee", offset=(1, 0, 0)).in_units(1e3, float).offset[0] == 1000.0
