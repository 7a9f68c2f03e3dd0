"""The SDF reader on Cassie: her files in every way that they can be read."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from sdf_texts import (
    ROUNDING,
    SIDES,
    assert_orthonormal,
    cassie_file,
    cassie_folder,
    closures,
    couplings,
    frame_poses,
)

import condyn_pin as cp
from condyn_pin.io.description import Description
from condyn_pin.io.sdf import read_sdf

CASSIE_KINDS = {f"{side}-achilles-spring-joint": "ball" for side in SIDES}


@pytest.fixture(scope="module")
def cassie() -> Description:
    return read_sdf(
        cassie_file(),
        root="pelvis",
        root_joint=pin.JointModelFreeFlyer(),
        kinds=CASSIE_KINDS,
        drop=("static",),
    )


def gaps(robot: Description, q: np.ndarray) -> np.ndarray:
    """Distance between the two frames of each closure."""
    at = frame_poses(robot.model, q)
    return np.array(
        [np.linalg.norm((at[c.frame_a] - at[c.frame_b])[:3, 3]) for c in closures(robot)]
    )


def test_cassie_is_cut_at_two_balls_a_leg(cassie):
    names = [c.name for c in closures(cassie)]
    assert sorted(names) == sorted(
        f"{side}-{loop}"
        for side in SIDES
        for loop in ("achilles-spring-joint", "plantar-foot-joint")
    )
    for closure in closures(cassie):
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


@pytest.mark.long
def test_cassie_loops_are_closed_at_the_posture_of_the_srdf(cassie):
    model = cassie.model.copy()
    pin.loadReferenceConfigurations(model, str(cassie_folder() / "srdf" / "cassie_v2.srdf"), False)
    q = pin.normalize(model, model.referenceConfigurations["standing"].copy())
    # The posture is written with eight digits; it was found with the joints of the file.
    assert gaps(cassie, q).max() < 1e-8


@pytest.mark.long
def test_cassie_says_what_is_not_used(cassie):
    told = "\n".join(cassie.unused)
    for thing in (
        "9 <collision>",
        "23 <visual>",
        "'CassiePlugin'",
        "'static'",
        "(revolute as ball)",
    ):
        assert thing in told


@pytest.mark.long
def test_cassie_on_its_lift_has_27_dofs():
    robot = read_sdf(cassie_file(), kinds=CASSIE_KINDS)
    assert robot.model.nv == 27
    assert frame_poses(robot.model, pin.neutral(robot.model))["pelvis"][2, 3] == 1.01


@pytest.mark.long
def test_the_rotations_of_cassie_are_orthonormal_to_rounding(cassie):
    assert_orthonormal(cassie.model)


# Every joint in the tree, as Pinocchio's own parser has it ----------------------------------------
# Its figures: src/parsers/sdf of Pinocchio 3.9 with libsdformat 12, compiled and run on the file.


@pytest.fixture(scope="module")
def split() -> Description:
    return read_sdf(
        cassie_folder() / "robots" / "cassie.sdf",
        root="pelvis",
        root_joint=pin.JointModelFreeFlyer(),
        as_file=True,
    )


def standing(robot: Description) -> tuple[pin.Model, np.ndarray]:
    model = robot.model.copy()
    pin.loadReferenceConfigurations(model, str(cassie_folder() / "srdf" / "cassie_v2.srdf"), False)
    return model, pin.normalize(model, model.referenceConfigurations["standing"].copy())


@pytest.mark.long
def test_cassie_as_file_has_every_joint_of_the_file_in_depth_first_order(split):
    assert (split.model.nq, split.model.nv) == (69, 64)
    leg = [
        "roll-ip", "roll-joint", "roll-op", "yaw-ip", "yaw-joint", "yaw-op", "pitch-ip",
        "pitch-joint", "pitch-op", "pitch-rod-joint", "achilles-spring-joint", "knee-ip",
        "knee-joint", "knee-op", "knee-spring-joint", "knee-shin-joint", "shin-tarsus-joint",
        "tarsus-spring-joint", "tarsus-crank-joint", "crank-rod-joint", "plantar-foot-joint",
        "foot-ip", "foot-joint", "foot-op", "shin-spring-joint",
    ]  # fmt: skip
    expected = ["universe", "root_joint", *(f"{side}-{name}" for side in SIDES for name in leg)]
    assert list(split.model.names) == expected
    kinds = {"pitch-rod-joint": "S", "plantar-foot-joint": "S", "shin-spring-joint": "P"}
    for name, moved in zip(expected[2:], list(split.model.joints)[2:], strict=True):
        kind = kinds.get(name.split("-", 1)[1], "R")
        assert moved.shortname().startswith(f"JointModel{kind}"), name


@pytest.mark.long
def test_cassie_as_file_has_16_welds_and_the_residual_of_pinocchio_s_parser(split):
    assert [c.kind for c in closures(split)] == ["weld"] * 16
    model, q = standing(split)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    at = {frame.name: data.oMf[i] for i, frame in enumerate(model.frames)}
    errors = [pin.log6(at[c.frame_a].actInv(at[c.frame_b])).vector for c in closures(split)]
    assert np.linalg.norm(errors) == pytest.approx(2.88699e-8, rel=1e-5)
    M = np.triu(pin.crba(model, data, q))
    assert np.linalg.norm(M + np.triu(M, 1).T) == pytest.approx(61.86434716488305, rel=1e-14)


@pytest.mark.long
def test_cassie_as_file_shares_the_mass_of_a_link_among_its_parents(split):
    model = split.model
    assert pin.computeTotalMass(model) == pytest.approx(34.985552, rel=1e-14)
    foot = model.frames[model.getFrameId("left-foot")].inertia
    for joint_name in ("plantar-foot-joint", "foot-joint"):
        copy = model.frames[model.getFrameId(f"left-foot_left-{joint_name}")].inertia
        assert copy == foot
    assert 3 * foot.mass == pytest.approx(0.1498, abs=1e-4)


@pytest.mark.long
def test_cassie_as_file_says_that_the_gears_have_lost_their_ratio(split):
    assert couplings(split) == ()
    assert any("'left-roll-joint' (gearbox as revolute)" in said for said in split.unused)


# Her other files --------------------------------------------------------------------------------

# joints to drop, size of v, joints that close loops, gears, joints that are reversed
FILES = {
    "cassie.sdf": ((), 40, 6, 10, 2),
    "cassie_v2.sdf": ((), 28, 4, 0, 0),
    "cassie_simple.sdf": (("static",), 28, 4, 0, 0),
    "cassie_reduced.sdf": (("static",), 28, 4, 0, 0),
    "cassie_wo_gearbox_spring.sdf": (("static",), 28, 4, 0, 2),
}


@pytest.mark.long
@pytest.mark.parametrize("name", FILES)
def test_every_file_of_cassie_is_cut_at_its_balls(name):
    drop, nv, loops, gears, backwards = FILES[name]
    robot = read_sdf(
        cassie_folder() / "robots" / name,
        root="pelvis",
        root_joint=pin.JointModelFreeFlyer(),
        drop=drop,
    )
    found = (robot.model.nv, len(closures(robot)), len(couplings(robot)), len(robot.reversed))
    assert found == (nv, loops, gears, backwards)
    kinds = [c.kind for c in closures(robot)]
    assert kinds.count("ball") == 4
    assert kinds.count("slider") == loops - 4
    at = frame_poses(robot.model, pin.neutral(robot.model))
    for closure in closures(robot):
        assert np.abs(at[closure.frame_a] - at[closure.frame_b]).max() < ROUNDING


@pytest.mark.long
def test_the_hinge_of_the_achilles_rod_is_reversed_and_keeps_its_coordinate():
    # The SRDF knows no balls here, so it says the same of the joints that are left.
    robot = read_sdf(cassie_file(), root_joint=pin.JointModelFreeFlyer(), drop=("static",))
    assert robot.reversed == ("left-achilles-spring-joint", "right-achilles-spring-joint")
    _, q = standing(robot)
    assert gaps(robot, q).max() < 1e-8


@pytest.mark.long
def test_cassie_s_rotors_turn_at_the_ratio_of_their_gears_against_the_output():
    robot = read_sdf(
        cassie_folder() / "robots" / "cassie.sdf",
        root="pelvis",
        root_joint=pin.JointModelFreeFlyer(),
    )
    ratios = {c.name.split("-")[1]: (c.joint_a, c.joint_b, c.ratio) for c in couplings(robot)}
    for motor, teeth in {"roll": 25, "yaw": 25, "pitch": 16, "knee": 16, "foot": 50}.items():
        assert ratios[motor] == (f"right-{motor}-op", f"right-{motor}-ip", -1 / teeth)


# One mechanism, opened in three ways ------------------------------------------------------------


def machine(**options) -> tuple[cp.Robot, cp.Scene]:
    """Return Cassie with the hinges of her file, and the scene of her loops."""
    read = read_sdf(
        cassie_file(), root_joint=pin.JointModelFreeFlyer(), drop=("static",), **options
    )
    loops = [cp.Loop(c.frame_a, c.frame_b, c.kind, c.axis, name=c.name) for c in closures(read)]
    cassie = cp.Robot("cassie", read.model)
    return cassie, cp.Scene(cassie, loops)


def columns(robot: cp.Robot, names: list[str], size: str) -> list[int]:
    """Return where q or v has the joints of these names."""
    joints = [robot.model.joints[robot.model.getJointId(name)] for name in names]
    starts = [(getattr(j, f"idx_{size}"), getattr(j, f"n{size}")) for j in joints]
    return [i for start, count in starts for i in range(start, start + count)]


def test_loops_that_are_opened_in_different_ways_give_one_acceleration():
    hinges = tuple(f"{side}-achilles-spring-joint" for side in SIDES)
    machines = [machine(cut=hinges), machine(), machine(as_file=True)]
    assert [scene.rows for _, scene in machines] == [16, 12, 24]
    assert [robot.nv - scene.nominal.rank for robot, scene in machines] == [18, 18, 18]
    shared = [n for n in machines[0][0].joints if all(n in robot.joints for robot, _ in machines)]
    assert len(shared) == 21  # the base, and ten joints a leg

    rng = np.random.default_rng(3)
    first, scene = machines[0]
    q0, v0 = scene.sample(rng)
    tau0 = np.zeros(first.nv)
    moved = columns(first, [name for name in shared if name != "root_joint"], "v")
    tau0[moved] = rng.normal(size=len(moved))
    answers = []
    for robot, scene in machines:
        q = pin.neutral(robot.model)
        q[columns(robot, shared, "q")] = q0[columns(first, shared, "q")]
        q = scene.assemble(q, fixed=shared, within_limits=False).q
        J = cp.Workspace(scene).jacobian(q)
        here = columns(robot, shared, "v")
        v = np.zeros(robot.nv)
        v[here] = v0[columns(first, shared, "v")]
        rest = [i for i in range(robot.nv) if i not in here]
        v[rest] = np.linalg.lstsq(J[:, rest], -J[:, here] @ v[here], rcond=1e-9)[0]
        assert np.abs(J @ v).max() < 1e-10
        tau = np.zeros(robot.nv)
        tau[here] = tau0[columns(first, shared, "v")]
        a = cp.solve(scene, q, v, tau, solver=cp.dynamics.Reference()).a
        answers.append(a[here])
    for other in answers[1:]:
        np.testing.assert_allclose(other, answers[0], rtol=0, atol=1e-7 * np.abs(answers[0]).max())
