"""Smaller scenes: exact where they promise it, carried along, and back again."""

from __future__ import annotations

import dataclasses
import functools
import pickle

import numpy as np
import pinocchio as pin
import pytest
from shared import all_scenes, each_row, motor_torque, relative, robot

import condyn_pin as cp
from condyn_pin import mechanism
from condyn_pin._core.models import indices
from condyn_pin.constraints import Terms
from condyn_pin.errors import InvalidArgument, InvalidConstraint, UnknownName
from condyn_pin.model.smaller import smaller_tree

ARMS = tuple(f"arm_{side}_{i}_joint" for side in ("left", "right") for i in range(1, 8))
SPRINGS = tuple(
    f"{side}-{joint}"
    for side in ("left", "right")
    for joint in ("knee-shin-joint", "tarsus-spring-joint")
)
CASES = {
    "talos, arms": ("talos contacts", ARMS),
    "talos, all but the legs": ("talos contacts", (*ARMS, "torso_1_joint", "head_2_joint")),
    "talos, floating base": ("talos contacts", ("root_joint", *ARMS)),
    "talos, corners": ("talos corners", ARMS),
    "talos, hands": ("talos hands to the world and together", ("head_1_joint", "torso_2_joint")),
    "cassie, springs": ("cassie loops + contacts", SPRINGS),
    "cassie, one leg": ("cassie loops", ("left-knee-op", "left-foot-op", *SPRINGS[:2])),
    "four-bar, rocker": ("four_bar loops", ("rocker",)),
}
each_case = pytest.mark.parametrize("case", list(CASES))


@functools.cache
def locked(case: str) -> mechanism.ReducedScene:
    label, joints = CASES[case]
    return all_scenes()[label].lock(joints)


def welded(scene: cp.Scene, joints: tuple[str, ...], q, v, tau):
    """Return a and J^T lam of the full scene with a_i = 0 on some joints: rows of one."""
    terms = cp.Workspace(scene).terms(q, v)
    held = indices(scene.robot.model, joints)[1].tolist()
    E = np.eye(scene.robot.nv)[held]
    more = np.zeros(len(held))
    extended = Terms(
        terms.M, terms.h, np.vstack([terms.J, E]),
        np.concatenate([terms.gamma, more]), np.concatenate([terms.a_ref, more]),
    )  # fmt: skip
    a, lam = cp.dynamics.Reference().solve(extended, tau)
    return a, terms.J.T @ lam[: scene.rows], held


@each_case
def test_the_smaller_scene_moves_as_the_full_one_with_welded_joints(case):
    """Lagrange's way and the tree's way to hold a joint still are the same."""
    small = locked(case)
    rng = np.random.default_rng(3)
    for _ in range(3):
        q, v = small.sample(rng)
        q_full, v_full = small.expand_state(q, v)
        tau = motor_torque(small.full.robot, rng)
        wanted, force, held = welded(small.full, CASES[case][1], q_full, v_full, tau)
        solution = cp.solve(small, q, v, small.reduce_torque(tau), solver=cp.dynamics.Reference())
        rest = np.delete(np.arange(small.full.robot.nv), held)
        assert relative(solution.a, wanted[rest]) < 1e-10
        J = cp.Workspace(small).jacobian(q)
        weight = 9.81 * small.full.robot.mass
        if small.rows == small.full.rows:
            assert np.abs(J.T @ solution.lam - force[rest]).max() < 1e-9 * weight


def assert_the_same_motion(one: cp.Scene, other: cp.Scene) -> None:
    """The accelerations of two scenes of the same joints, at a state of the first."""
    q, v = one.sample(np.random.default_rng(0))
    tau = motor_torque(one.robot, np.random.default_rng(0))
    a, b = (cp.solve(s, q, v, tau, solver=cp.dynamics.Reference()).a for s in (one, other))
    assert relative(b, a) < 1e-10


@pytest.mark.long
@each_case
def test_states_go_there_and_back(case):
    small = locked(case)
    q, v = small.sample(np.random.default_rng(1))
    full = small.expand_state(q, v)
    small.full.check(*full).raise_if_open()
    again = small.reduce_state(*full)
    assert np.allclose(again[0], q, atol=1e-15)
    assert np.array_equal(again[1], v)


@pytest.mark.long
def test_what_the_model_knows_of_a_joint_is_carried_along():
    """Every number of the joints that are left, each its own, under both Pinocchios."""
    model = pin.Model(robot("talos").model)
    rng = np.random.default_rng(0)
    names = [
        name
        for name in dir(model)
        if isinstance(getattr(model, name), np.ndarray) and getattr(model, name).ndim == 1
    ]
    names.remove("gravity981")
    for name in names:
        setattr(model, name, rng.random(len(getattr(model, name))))
    talos = cp.Robot("talos", model, actuated=robot("talos").actuated)
    small = cp.Scene(talos).lock(ARMS)
    in_q, in_v = indices(model, small.robot.joints)
    assert len(names) >= 9
    for name in names:
        full, got = np.array(getattr(model, name)), np.array(getattr(small.robot.model, name))
        assert np.array_equal(got, full[in_q if len(full) == model.nq else in_v]), name
    assert small.robot.actuated == tuple(n for n in talos.actuated if n not in ARMS)
    assert np.isclose(small.robot.mass, talos.mass, rtol=1e-14)


@pytest.mark.parametrize("name", ["talos", "cassie", "solo12"])
def test_the_tree_is_pinocchios_own_reduction(name):
    model = robot(name).model
    joints = list(robot(name).joints[2::3])
    q = pin.integrate(model, pin.neutral(model), np.linspace(-0.3, 0.3, model.nv))
    numbers = [model.getJointId(joint) for joint in joints]
    wanted, got = pin.buildReducedModel(model, numbers, q), smaller_tree(model, joints, q)
    assert list(got.names) == list(wanted.names)
    rng = np.random.default_rng(0)
    x = pin.integrate(got, pin.neutral(got), rng.normal(size=got.nv))
    v, a = rng.normal(size=(2, got.nv))
    one, other = (pin.rnea(m, m.createData(), x, v, a) for m in (got, wanted))
    assert relative(one, other) < 1e-12
    for frame in wanted.frames:
        same = got.frames[got.getFrameId(frame.name, frame.type)]
        assert same.parentJoint == frame.parentJoint
        assert same.placement.isApprox(frame.placement, 1e-12)


@pytest.mark.long
def test_postures_springs_loops_and_contacts_are_carried_along():
    small = locked("cassie, springs")
    cassie = robot("cassie")
    assert small.robot.springs == ()
    assert small.robot.loops == cassie.loops
    assert small.robot.contacts == cassie.contacts
    assert small.robot.licence == cassie.licence
    kept = locked("cassie, one leg").robot
    assert [spring.joint for spring in kept.springs] == list(SPRINGS[2:])
    state = locked("cassie, one leg").expand_state(*locked("cassie, one leg").state("standing"))
    assert np.abs(state[0] - cassie.postures["standing"]).max() < 1e-9


@pytest.mark.long
def test_a_loop_whose_sides_become_one_body_is_dropped_and_said():
    cassie = robot("cassie")
    leg = [j for j in cassie.joints if j.startswith("left-") and j not in cassie.actuated[:3]]
    small = cp.Scene(cassie, cassie.loops).lock(leg)
    assert small.names == ("right-achilles-spring-joint", "right-plantar-foot-joint")
    assert any("left-achilles-spring-joint: both of its sides" in text for text in small.dropped)
    assert "left-plantar-foot-joint" in str(small.summary())
    assert small.robot.loops == small.constraints


@pytest.mark.long
def test_contacts_of_a_body_that_is_fixed_to_the_world_are_dropped():
    talos = robot("talos")
    leg = [f"leg_left_{i}_joint" for i in range(1, 7)]
    small = cp.Scene(talos, talos.contacts).lock(["root_joint", *leg])
    assert small.names == ("right_sole_link",)
    assert small.robot.contacts == talos.contacts[1:]
    assert small.robot.mass == pytest.approx(talos.mass)


@pytest.mark.long
def test_lock_holds_the_joints_where_it_is_told():
    scene = all_scenes()["four_bar loops"]
    q, _ = scene.sample(np.random.default_rng(5))
    small = scene.lock(["rocker"], q)
    assert next(iter(small.robot.postures)) == "locked"
    full, _ = small.expand_state(*small.state())
    assert full[2] == q[2]
    assert np.abs(full - q).max() < 1e-9


def test_a_smaller_scene_prints_what_it_leaves_out():
    text = str(
        mechanism.without(all_scenes()["cassie loops + contacts"].lock(SPRINGS), ["left-foot/toe"])
    )
    assert text.splitlines()[0] == "cassie: nv 32 -> 28, rows 24 -> 21"
    assert "joints locked: left-knee-shin-joint, " in text
    assert "constraint left-foot/toe: left out" in text
    assert "array(" not in text


@pytest.mark.long
def test_lock_twice_is_lock_once():
    scene = all_scenes()["talos contacts"]
    twice, once = scene.lock(ARMS[:7]).lock(ARMS[7:]), scene.lock(ARMS)
    assert twice.full == once.full == scene
    assert twice.robot.joints == once.robot.joints
    q, v = once.sample(np.random.default_rng(0))
    for one, other in zip(twice.expand_state(q, v), once.expand_state(q, v), strict=True):
        assert np.array_equal(one, other)
    tau = np.zeros(once.robot.nv)
    assert relative(cp.solve(twice, q, v, tau).a, cp.solve(once, q, v, tau).a) < 1e-12


@pytest.mark.long
def test_keep_locks_the_others_and_floats():
    scene = all_scenes()["talos contacts"]
    legs = [f"leg_{side}_{i}_joint" for side in ("left", "right") for i in range(1, 7)]
    assert mechanism.keep(scene, legs).robot.joints == ("root_joint", *legs)


@pytest.mark.long
def test_without_leaves_constraints_out():
    scene = all_scenes()["cassie loops + contacts"]
    small = mechanism.without(scene, ["left-foot/toe", "left-foot/heel"])
    assert set(scene.names) - set(small.names) == {"left-foot/toe", "left-foot/heel"}
    assert small.robot == scene.robot
    state = small.sample(np.random.default_rng(0))
    q, v = small.expand_state(*state)
    assert np.allclose(q, state[0], atol=1e-15)
    assert np.array_equal(v, state[1])


def test_bodies_are_cut_off_with_all_that_is_on_them():
    scene = all_scenes()["cassie loops + contacts"]
    small = mechanism.without_bodies(scene, ["left-pitch-rod-joint"])
    assert small.robot.nv == scene.robot.nv - 3
    assert small.robot.mass == pytest.approx(scene.robot.mass - 0.1567)
    assert "left-achilles-spring-joint" not in small.names
    assert "left-achilles-rod" not in small.robot.frames
    whole_leg = mechanism.without_bodies(scene, ["left-roll-op"])
    assert {name.split("-")[0] for name in whole_leg.robot.joints} == {"root_joint", "right"}
    assert {name.split("-")[0] for name in whole_leg.names} == {"right"}
    talos = mechanism.without_bodies(all_scenes()["talos contacts"], ["arm_left_1_joint"])
    assert talos.robot.nv == 38 - 8  # seven joints of the arm, and its gripper


@pytest.mark.long
def test_what_was_cut_off_is_found_again():
    """Position and velocity of the rod follow from its loop."""
    scene = all_scenes()["cassie loops"]
    small = mechanism.without_bodies(scene, ["left-pitch-rod-joint"])
    q, v = scene.sample(np.random.default_rng(2), spread=0.1)
    found = small.expand_state(*small.reduce_state(q, v))
    scene.check(*found).raise_if_open()
    others = indices(scene.robot.model, small.robot.joints)[1]
    assert np.array_equal(found[1][others], v[others])


@pytest.mark.long
@each_case
def test_reduced_scenes_pickle_and_compare(case):
    small = locked(case)
    copy = pickle.loads(pickle.dumps(small))
    assert copy == small
    assert hash(copy) == hash(small)
    assert copy.dropped == small.dropped
    state = small.state()
    assert all(map(np.array_equal, copy.expand_state(*state), small.expand_state(*state)))


def test_a_lock_that_leaves_loops_open_is_refused():
    scene = all_scenes()["four_bar loops"]
    q = scene.state()[0]
    q[0] += np.pi  # the coupler does not reach the rocker's end from there, held as it is
    with pytest.raises(cp.errors.NotAssembled, match=r"with crank, coupler locked, .* is open by"):
        scene.lock(["crank", "coupler"], q)


def test_a_state_with_the_locked_joint_elsewhere_is_refused():
    small = locked("talos, arms")
    q, v = small.expand_state(*small.state())
    elsewhere = pin.integrate(small.full.robot.model, q, np.eye(38)[-10] * 0.1)
    with pytest.raises(cp.InvalidArgument, match=r"away from where it is locked by 0\.1"):
        small.reduce_state(elsewhere, v)
    with pytest.raises(cp.InvalidArgument, match=r"moving by 0\.2"):
        small.reduce_state(q, v + 0.2)


ACHILLES = "left-achilles-spring-joint"
RODS = ["left-pitch-rod-joint", "right-pitch-rod-joint"]
PLANTAR = tuple(f"{side}-plantar-foot-joint" for side in ("left", "right"))
CRANKS = tuple(
    f"{side}-{joint}"
    for side in ("left", "right")
    for joint in ("tarsus-crank-joint", "crank-rod-joint")
)


def pantograph(rod_mass: float) -> cp.Scene:
    """A four-bar whose coupler is a rod of some mass, on a hinge."""
    bar = cp.model.four_bar()
    model = pin.Model(bar.model)
    inertia = model.inertias[model.getJointId("coupler")]
    share = rod_mass / inertia.mass
    model.inertias[model.getJointId("coupler")] = pin.Inertia(
        rod_mass, inertia.lever, share * inertia.inertia
    )
    heavy = cp.Robot("bar", model, postures=bar.postures, loops=bar.loops, actuated=("crank",))
    return cp.Scene(heavy, heavy.loops)


def error_of_rod(scene: cp.Scene, mass: str) -> float:
    small = mechanism.rods_as_distances(scene, ["coupler"], mass=mass)
    worst = 0.0
    rng = np.random.default_rng(4)
    for _ in range(3):
        q, v = scene.sample(rng)
        tau = np.array([0.3, 0.0, 0.0])
        a = cp.solve(scene, q, v, tau, solver=cp.dynamics.Reference()).a
        state = small.reduce_state(q, v)
        b = cp.solve(small, *state, small.reduce_torque(tau), solver=cp.dynamics.Reference()).a
        worst = max(worst, relative(b, a[[0, 2]]))
    return worst


def test_a_massless_rod_is_a_distance():
    """The lighter the rod, the smaller the price, in proportion."""
    errors = [error_of_rod(pantograph(mass), "drop") for mass in (1e-2, 1e-4, 1e-6)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-5
    assert errors[1] == pytest.approx(100 * errors[2], rel=0.1)


@pytest.mark.long
def test_mass_at_the_ends_is_nearer_than_no_mass():
    assert error_of_rod(pantograph(0.1), "ends") < 0.5 * error_of_rod(pantograph(0.1), "drop")


def test_rods_of_cassie():
    scene = all_scenes()["cassie loops"]
    small = mechanism.rods_as_distances(scene, RODS)
    assert (small.robot.nv, small.rows) == (26, 8)
    assert small.robot.mass == pytest.approx(scene.robot.mass, rel=1e-12)
    assert [c.kind for c in small.constraints] == ["rod", "ball", "rod", "ball"]
    assert set(small.names) == set(scene.names)
    assert set(small.constraints) == set(small.robot.loops)
    com = [
        pin.centerOfMass(s.robot.model, s.robot.model.createData(), s.state()[0])
        for s in (scene, small)
    ]
    assert np.abs(com[0] - com[1]).max() < 1e-4
    dropped = mechanism.rods_as_distances(scene, RODS, mass="drop")
    assert dropped.robot.mass == pytest.approx(scene.robot.mass - 2 * 0.1567, rel=1e-12)
    scene.check(*small.expand_state(*small.sample(np.random.default_rng(0)))).raise_if_open()


def test_a_linkage_that_follows_becomes_reflected_inertia():
    scene = all_scenes()["cassie loops"]
    small = mechanism.without_linkage(scene, PLANTAR, CRANKS)
    assert (small.robot.nv, small.rows, small.nominal.mobility) == (28, 6, 22)
    assert small.robot.mass == pytest.approx(scene.robot.mass, rel=1e-12)
    foot = indices(small.robot.model, ["left-foot-op"])[1][0]
    armature, damping = small.robot.model.armature, small.robot.model.damping
    assert 1e-4 < armature[foot] < 1e-2
    assert damping[foot] == pytest.approx(2.0, rel=1e-2)  # its own, and the crank's at ratio 1
    assert np.count_nonzero(np.abs(armature) > 1e-8) == 2
    scene.check(*small.expand_state(*small.sample(np.random.default_rng(0)))).raise_if_open()
    # a torque on the left foot alone: what it feels of the linkage is what was reflected
    links_welded = mechanism.without(scene, PLANTAR).lock(CRANKS)
    found = []
    for one in (scene, small, links_welded):
        q, v = one.state()
        i = indices(one.robot.model, ["left-foot-op"])[1][0]
        push = np.eye(one.robot.nv)[i]
        pushed, alone = (
            cp.solve(one, q, v, t, solver=cp.dynamics.Reference()).a for t in (push, 0 * push)
        )
        found.append((pushed - alone)[i])
    full, reflected, welded_only = found
    assert abs(reflected - full) < 0.1 * abs(full)
    assert abs(welded_only - full) > 3 * abs(reflected - full)


@pytest.mark.long
def test_points_are_merged_exactly():
    for label, kinds in (
        ("talos corners", (cp.SurfaceContact, cp.SurfaceContact)),
        (
            "cassie loops + contacts",
            (*[cp.Loop] * 4, cp.constraints.LineContact, cp.constraints.LineContact),
        ),
    ):
        scene = all_scenes()[label]
        small = mechanism.merge_points(scene)
        assert tuple(map(type, small.constraints)) == kinds
        assert small.nominal.rank == scene.nominal.rank
        assert_the_same_motion(scene, small)
    kept = cp.mechanism.merge_points(all_scenes()["cassie loops + contacts"], edges=False)
    assert kept.constraints == all_scenes()["cassie loops + contacts"].constraints


def pair_of_points(along: tuple[float, float, float], middle: tuple[float, float, float]):
    """Two points of Solo's front left foot."""
    ends = [tuple(np.add(middle, np.multiply(sign, along))) for sign in (1, -1)]
    return [cp.PointContact("FL_FOOT", end, name=f"p{i}") for i, end in enumerate(ends)]


def test_an_edge_is_where_its_own_points_are():
    """A frame that an earlier merge has left is used again only if it is the same one."""
    first = cp.Scene(robot("solo12"), pair_of_points((0.1, 0, 0), (0, 0, 0)))
    merged = mechanism.merge_points(first)
    again = mechanism.merge_points(cp.Scene(merged.robot, first.constraints))
    assert again.constraints == merged.constraints
    assert again.robot == merged.robot
    other = cp.Scene(merged.robot, pair_of_points((0, 0.1, 0), (0, 0, 0.3)))
    small = mechanism.merge_points(other)
    assert small.names == ("FL_FOOT/edge 2",)
    assert_the_same_motion(other, small)


@pytest.mark.long
def test_a_merged_contact_takes_a_name_that_is_free():
    points = pair_of_points((0.1, 0, 0), (0, 0, 0))
    other = cp.PointContact("HR_FOOT", name="FL_FOOT/edge")
    small = mechanism.merge_points(cp.Scene(robot("solo12"), [*points, other]))
    assert small.names == ("FL_FOOT/edge 2", "FL_FOOT/edge")
    points.append(cp.PointContact("FL_FOOT", (0.0, 0.1, 0.0), name="p2"))
    other = cp.PointContact("HR_FOOT", name="FL_FOOT")
    small = mechanism.merge_points(cp.Scene(robot("solo12"), [*points, other]))
    assert small.names == ("FL_FOOT 2", "FL_FOOT")


@pytest.mark.long
def test_points_with_an_anchor_are_not_merged():
    solo = robot("solo12")
    points = [
        cp.PointContact("FL_FOOT", (0.01 * i, 0, 0), anchor=(0.2, 0.1, 0.0), name=f"p{i}")
        for i in range(2)
    ]
    assert mechanism.merge_points(cp.Scene(solo, points)).constraints == tuple(points)


@pytest.mark.parametrize("label", ["four_bar loops", "four_bar backwards", "cassie loops"])
def test_a_ball_in_a_plane_becomes_a_planar_pin_with_full_rank(label):
    scene = all_scenes()[label]
    name = next(r for r in scene.nominal.redundant).rsplit(".", 1)[0]
    small = mechanism.as_planar(scene, name)
    assert small.rows == scene.rows - 1
    assert small.nominal.rank == scene.nominal.rank
    assert_the_same_motion(scene, small)
    with pytest.raises(cp.errors.InvalidConstraint, match="ball is needed"):
        mechanism.as_planar(small, name)


@pytest.mark.parametrize("ends", [("coupler_tip", "ground"), ("ground", "coupler_tip")])
def test_a_planar_pin_reports_the_force_of_the_ball_it_replaces(ends):
    """On the body that is named first, the world among them, in the same axes of the world."""
    bar = robot("four_bar")
    data = bar.model.createData()
    pin.framesForwardKinematics(bar.model, data, next(iter(bar.postures.values())))
    at = data.oMf[bar.model.getFrameId("coupler_tip")].translation
    pinned = bar.with_frame("ground", "world", at, pin.rpy.rpyToMatrix(0.3, 0.2, 0.1))
    scene = cp.Scene(pinned, [cp.Loop(*ends, name="L")])
    small = mechanism.as_planar(scene, "L")
    rng = np.random.default_rng(0)
    q, v = scene.sample(rng)
    tau = motor_torque(pinned, rng)
    ball, planar = (
        cp.solve(s, q, v, tau, solver=cp.dynamics.Reference()).world_forces["L"]
        for s in (scene, small)
    )
    assert np.abs(ball).max() > 0.1
    assert np.allclose(planar[:3], ball, atol=1e-9 * np.abs(ball).max())


@pytest.mark.long
def test_a_ball_on_a_robot_of_two_joints_becomes_a_planar_pin():
    """Two hinges, the tip held by a ball on the world."""
    model = pin.Model()
    joint, seat = 0, pin.SE3.Identity()
    for name in ("a", "b"):
        joint = model.addJoint(joint, pin.JointModelRZ(), seat, name)
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
        seat = pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0]))
    model.addFrame(pin.Frame("tip", joint, 0, seat, pin.FrameType.OP_FRAME))
    two = cp.Robot("two", model, postures={"met": np.array([0.0, np.pi / 2])})
    two = two.with_frame("post", "world", [1.0, 1.0, 0.0])
    scene = cp.Scene(two, [cp.Loop("tip", "post", name="L")])
    small = cp.mechanism.as_planar(scene, "L")
    assert (small.rows, small.nominal.rank) == (2, scene.nominal.rank)


@pytest.mark.long
def test_a_ball_of_rank_one_has_no_plane():
    """The tip of a slider moves on a line, which lies in many planes."""
    model = pin.Model()
    for name in "ab":
        joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    scene = cp.Scene(cp.Robot("two", model), [cp.Loop("tip", "world", name="L")])
    with pytest.raises(cp.errors.InvalidConstraint, match="rank 1"):
        mechanism.as_planar(scene, "L")


@pytest.mark.parametrize("backwards", [False, True])
def test_a_distance_reports_the_force_of_the_loop_that_it_replaces(backwards):
    """On the body that is named first, the nearer the lighter the rod is."""
    whole = pantograph(1e-7)
    (loop,) = whole.constraints
    if backwards:
        loop = cp.Loop(loop.frame_b, loop.frame_a, name=loop.name)
        whole = cp.Scene(whole.robot, [loop])
    small = mechanism.rods_as_distances(whole, ["coupler"], mass="drop")
    q, v = whole.sample(np.random.default_rng(0))
    tau = np.array([0.3, 0.0, 0.0])
    ball = cp.solve(whole, q, v, tau, solver=cp.dynamics.Reference()).world_forces[loop.name]
    state = (*small.reduce_state(q, v), small.reduce_torque(tau))
    rod = cp.solve(small, *state, solver=cp.dynamics.Reference()).world_forces[loop.name]
    assert np.abs(ball).max() > 0.1
    assert np.allclose(rod, ball, atol=1e-4 * np.abs(ball).max())


def test_locking_one_side_of_a_coupling_locks_the_other():
    bar = robot("four_bar")
    scene = cp.Scene(
        bar, [cp.constraints.Coupling("rocker", "crank", ratio=2.0, offset=0.1, name="gear")]
    )
    small = scene.lock(["crank"])
    assert small.robot.joints == ("coupler",)
    assert any("rocker: locked with crank, by the coupling gear" in text for text in small.dropped)
    q, _ = small.expand_state(*small.state())
    assert q[2] == pytest.approx(2 * q[0] + 0.1, abs=1e-10)


@pytest.mark.long
def test_a_coupled_joint_is_locked_where_the_coupling_wants_it():
    """Not where it is in q: only the joints that were named are to stay."""
    model = pin.Model()
    for name in "abc":
        joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    gear = cp.constraints.Coupling("a", "b", ratio=2.0)
    small = cp.Scene(cp.Robot("geared", model), [gear]).lock(["a"], np.array([0.5, 0.0, 0.1]))
    assert small.robot.joints == ("c",)
    assert np.allclose(small.held, [0.5, 0.25, 0.1], atol=1e-10)


@pytest.mark.long
def test_the_locked_posture_comes_first_with_and_without_q():
    scene = all_scenes()["talos contacts"]
    before = scene.robot.postures
    for small in (scene.lock(ARMS), scene.lock(ARMS, scene.state()[0])):
        assert tuple(small.robot.postures) == ("locked", *before)
        assert np.array_equal(
            cp.dynamics.described_posture(small), cp.dynamics.described_posture(small, "locked")
        )
        assert np.allclose(small.expand_state(*small.state())[0], scene.state()[0], atol=1e-12)


MISTAKES = {
    "talos contacts": [
        (lambda s: s.lock(["arm_left_1_join"]), UnknownName, "did you mean 'arm_left_1_joint'"),
        (lambda s: s.lock("arm_left_1_joint"), InvalidArgument, "a list of names"),
        (lambda s: s.lock([3]), InvalidArgument, "not the name of a joint"),
        (lambda s: s.lock(s.robot.joints), InvalidArgument, "nothing moves"),
        (lambda s: s.lock(ARMS, np.zeros(3)), InvalidArgument, "shape"),
        (lambda s: s.lock(ARMS, np.full(39, np.nan)), InvalidArgument, "nan"),
        (lambda s: cp.mechanism.keep(s, ["leg_left_9_joint"]), UnknownName, "leg_left"),
        (
            lambda s: cp.mechanism.without(s, ["left_sole"]),
            UnknownName,
            "did you mean 'left_sole_link'",
        ),
        (
            lambda s: cp.mechanism.without_bodies(s, ["root_joint"]),
            InvalidArgument,
            "nothing is left",
        ),
        (lambda s: cp.mechanism.without_bodies(s, ["torso"]), UnknownName, "torso_1_joint"),
    ],
    "cassie loops": [
        (
            lambda s: cp.mechanism.rods_as_distances(s, ["left-pitch-rod"]),
            UnknownName,
            "left-pitch-rod-joint",
        ),
        (
            lambda s: cp.mechanism.rods_as_distances(s, ["left-knee-op"]),
            InvalidArgument,
            "motor acts on it",
        ),
        (
            lambda s: cp.mechanism.rods_as_distances(s, [SPRINGS[1]]),
            InvalidArgument,
            "spring acts on it",
        ),
        (
            lambda s: cp.mechanism.rods_as_distances(s, CRANKS[:1]),
            InvalidArgument,
            "carries further joints",
        ),
        (
            lambda s: cp.mechanism.rods_as_distances(s, RODS, mass="half"),
            InvalidArgument,
            "ends, drop",
        ),
        (
            lambda s: cp.mechanism.without_linkage(s, [ACHILLES], RODS[:1]),
            InvalidConstraint,
            "hold other joints",
        ),
        (
            lambda s: cp.mechanism.without_linkage(s, ["plantar"], CRANKS),
            UnknownName,
            "plantar-foot-joint",
        ),
        (lambda s: cp.mechanism.as_planar(s, "left-achilles"), UnknownName, ACHILLES),
        (lambda s: cp.mechanism.as_planar(s, ACHILLES), InvalidConstraint, "independent"),
    ],
}


@each_row(
    ("label", "change", "error", "said"),
    [(label, *each) for label, mistakes in MISTAKES.items() for each in mistakes],
)
def test_mistakes_are_named(label, change, error, said):
    with pytest.raises(error, match=said):
        change(all_scenes()[label])


@pytest.mark.long
def test_what_goes_with_the_joint_of_a_rod_is_said():
    scene = all_scenes()["four_bar loops"]
    assert len(mechanism.rods_as_distances(scene, ["coupler"]).dropped) == 1
    model = pin.Model(scene.robot.model)
    joint = model.joints[model.getJointId("coupler")]
    for said in ("damping", "friction", "armature"):
        numbers = np.array(getattr(model, said))
        numbers[joint.idx_v] = 0.1
        setattr(model, said, numbers)
        rough = cp.Scene(dataclasses.replace(scene.robot, model=model), scene.constraints)
        small = mechanism.rods_as_distances(rough, ["coupler"])
        assert any("joint coupler" in text and said in text for text in small.dropped)
        assert said in str(small.summary())


@pytest.mark.parametrize("share", [-0.1, 1.1])
def test_a_body_with_its_mass_beyond_its_ends_is_no_rod(share):
    whole = pantograph(0.1)
    model = pin.Model(whole.robot.model)
    number = model.getJointId("coupler")
    tip = whole.robot.frame("coupler_tip")[1].translation
    inertia = model.inertias[number]
    model.inertias[number] = pin.Inertia(inertia.mass, share * tip, inertia.inertia)
    scene = cp.Scene(dataclasses.replace(whole.robot, model=model), whole.constraints)
    with pytest.raises(cp.InvalidArgument, match=rf"centre of mass .* at {share:g} of its length"):
        mechanism.rods_as_distances(scene, ["coupler"])


def test_a_rod_that_does_more_than_keep_a_distance_is_refused():
    """On a hinge across the plane of its loop, a rod holds its other end sideways too."""
    model = pin.Model()
    arm = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "arm")
    rod = model.addJoint(0, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([1.0, 0, 0])), "rod")
    for joint, x in ((arm, 0.4), (rod, -0.3)):
        tip = pin.SE3(np.eye(3), np.array([2 * x, 0.0, 0.0]))
        inertia = pin.Inertia(1.0, np.array([x, 0.0, 0.0]), 0.1 * np.eye(3))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"tip{joint}", joint, 0, tip, pin.FrameType.OP_FRAME))
    z = np.sin(0.2)
    posture = np.array([0.0, 0.0, z, np.sqrt(1 - z * z), 0.4])
    two = cp.Robot("two", model, postures={"met": posture})
    scene = cp.Scene(two, [cp.Loop("tip1", "tip2")])
    with pytest.raises(cp.errors.InvalidConstraint, match="do more than keep a distance"):
        mechanism.rods_as_distances(scene, ["rod"])
