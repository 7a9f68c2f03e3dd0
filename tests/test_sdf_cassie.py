"""The SDF reader on Cassie: her files in every way that they can be read."""

from __future__ import annotations

import pickle
import re

import numpy as np
import pinocchio as pin
import pytest
from sdf_texts import (
    ROUNDING,
    SIDES,
    assert_orthonormal,
    cassie_file,
    cassie_folder,
    frame_poses,
)

from condyn_pin.errors import InvalidModel
from condyn_pin.io.sdf import SdfRobot, read_sdf

CASSIE_KINDS = {f"{side}-achilles-spring-joint": "ball" for side in SIDES}


@pytest.fixture(scope="module")
def cassie() -> SdfRobot:
    return read_sdf(
        cassie_file(),
        root="pelvis",
        root_joint=pin.JointModelFreeFlyer(),
        kinds=CASSIE_KINDS,
        drop=("static",),
    )


def gaps(robot: SdfRobot, q: np.ndarray) -> np.ndarray:
    """Distance between the two frames of each closure."""
    at = frame_poses(robot.model, q)
    return np.array(
        [np.linalg.norm((at[c.frame_a] - at[c.frame_b])[:3, 3]) for c in robot.closures]
    )


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


def test_cassie_with_its_lift_and_a_floating_base_is_refused():
    with pytest.raises(InvalidModel, match="'static' attach the model to the world"):
        read_sdf(cassie_file(), root_joint=pin.JointModelFreeFlyer(), kinds=CASSIE_KINDS)


def test_cassie_on_its_lift_has_27_dofs():
    robot = read_sdf(cassie_file(), kinds=CASSIE_KINDS)
    assert robot.model.nv == 27
    assert frame_poses(robot.model, pin.neutral(robot.model))["pelvis"][2, 3] == 1.01


def test_the_rotations_of_cassie_are_orthonormal_to_rounding(cassie):
    assert_orthonormal(cassie.model)


def test_the_result_can_be_sent_to_another_process(cassie):
    again = pickle.loads(pickle.dumps(cassie))
    assert again.closures == cassie.closures
    assert again.springs == cassie.springs
    assert again.model == cassie.model
