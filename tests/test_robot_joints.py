"""Joints and frames by their names: where q and v hold them, values, poses."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from shared import each_row

import condyn_pin as cp


@pytest.fixture(scope="module")
def cassie():
    return cp.load_robot("cassie")


@pytest.mark.long
def test_indices_are_those_of_the_model(cassie):
    knee = cassie.model.joints[cassie.model.getJointId("left-knee-op")]
    assert cassie.index_q("left-knee-op") == knee.idx_q
    assert cassie.index_v("left-knee-op") == knee.idx_v
    assert cassie.index_q("left-knee-op") != cassie.index_v("left-knee-op")  # it floats


@pytest.mark.long
def test_a_joint_with_several_numbers_has_no_index(cassie):
    with pytest.raises(cp.InvalidArgument, match=r"7 numbers in q, q\[0:7\].*configuration"):
        cassie.index_q("root_joint")
    with pytest.raises(cp.InvalidArgument, match=r"6 numbers in v, v\[0:6\].*joint_vector"):
        cassie.index_v("root_joint")


@pytest.mark.long
@pytest.mark.parametrize("ask", ["index_q", "index_v"])
def test_a_wrong_name_brings_near_ones(cassie, ask):
    with pytest.raises(cp.errors.UnknownName, match="'left-knee-op'"):
        getattr(cassie, ask)("left-knee")
    with pytest.raises(cp.InvalidArgument, match="name of a joint"):
        getattr(cassie, ask)(3)
    with pytest.raises(cp.errors.UnknownName):
        getattr(cassie, ask)("universe")


def test_a_configuration_sets_what_it_names_and_keeps_the_rest(cassie):
    start = np.array(cassie.postures["standing"])
    q = cassie.configuration({"left-knee-op": -0.9, "root_joint": [0, 0, 2, 0, 0, 0, 1]})
    moved = cassie.index_q("left-knee-op")
    assert q[moved] == -0.9
    assert q[2] == 2.0
    rest = np.ones(cassie.nq, dtype=bool)
    rest[[*range(7), moved]] = False
    assert np.array_equal(q[rest], start[rest])
    assert np.array_equal(cassie.configuration({}, start=q), q)


@pytest.mark.long
def test_values_and_configuration_are_inverse(cassie):
    q = pin.randomConfiguration(cassie.model, -np.ones(cassie.nq), np.ones(cassie.nq))
    again = cassie.configuration(cassie.joint_values(q))
    assert np.allclose(again, q, rtol=0, atol=1e-15)


def test_a_joint_without_limits_takes_and_gives_its_angle():
    model = pin.Model()
    model.addJoint(0, pin.JointModelRUBZ(), pin.SE3.Identity(), "wheel")
    model.appendBodyToJoint(1, pin.Inertia.Random(), pin.SE3.Identity())
    robot = cp.Robot("wheel", model)
    q = robot.configuration({"wheel": 2.5})
    assert np.allclose(q, [np.cos(2.5), np.sin(2.5)])
    assert robot.joint_values(q) == {"wheel": pytest.approx(2.5)}
    assert robot.index_v("wheel") == 0
    with pytest.raises(cp.InvalidArgument, match="2 numbers in q"):
        robot.index_q("wheel")


@pytest.mark.parametrize(
    ("values", "what"),
    [
        ({"left-knee-op": [1.0, 2.0]}, "left-knee-op"),
        ({"left-knee-op": "far"}, "left-knee-op"),
        ({"left-knee-op": np.nan}, "left-knee-op"),
        ({"root_joint": [0, 0, 0, 0, 0, 0, 2]}, "norm 2"),
        ([1.0], "values by joint"),
    ],
)
def test_values_that_cannot_be_are_refused(cassie, values, what):
    with pytest.raises(cp.InvalidArgument, match=what):
        cassie.configuration(values)


@pytest.mark.long
def test_a_start_of_another_size_is_refused(cassie):
    with pytest.raises(cp.InvalidArgument, match="start"):
        cassie.configuration({}, start=np.zeros(3))


def test_a_joint_vector_is_a_torque_by_name(cassie):
    tau = cassie.joint_vector({"left-knee-op": 60.0, "root_joint": np.arange(6.0)})
    assert tau[cassie.index_v("left-knee-op")] == 60.0
    assert np.array_equal(tau[:6], np.arange(6.0))
    assert np.count_nonzero(tau) == 6
    with pytest.raises(cp.errors.UnknownName, match="left-knee-op"):
        cassie.joint_vector({"left-knee": 1.0})


def test_frame_pose_is_pinocchios(cassie):
    q = pin.randomConfiguration(cassie.model, -np.ones(cassie.nq), np.ones(cassie.nq))
    data = cassie.model.createData()
    pin.framesForwardKinematics(cassie.model, data, q)
    for name in ("pelvis", "left-foot", "right-knee-op"):
        there = data.oMf[cassie.model.getFrameId(name)]
        assert cassie.frame_pose(q, name).isApprox(there, 1e-14)
    assert np.allclose(cassie.center_of_mass(q), pin.centerOfMass(cassie.model, data, q))
    assert cassie.frame_pose(q, "world") == pin.SE3.Identity()
    with pytest.raises(cp.errors.UnknownName, match="pelvis"):
        cassie.frame_pose(q, "pelvi")


@pytest.mark.long
def test_another_mass_has_the_same_centre_and_an_inertia_in_proportion(cassie):
    joint = "left-knee-op"
    index = cassie.model.getJointId(joint)
    old = cassie.model.inertias[index]
    heavy = cassie.with_masses({joint: 3.0 * old.mass})
    new = heavy.model.inertias[index]
    assert new.mass == pytest.approx(3.0 * old.mass)
    assert np.allclose(new.lever, old.lever)
    assert np.allclose(new.matrix(), 3.0 * old.matrix())
    assert heavy.mass == pytest.approx(cassie.mass + 2.0 * old.mass)
    assert cassie.model.inertias[index] == old
    assert heavy.loops == cassie.loops
    q, v = cp.Scene(heavy, heavy.loops).state()
    assert cp.solve(cp.Scene(heavy, heavy.loops), q, v, heavy.passive_torque(q, v)).status.ok


@each_row(
    ("masses", "text"),
    [
        ({"left-knee": 1.0}, "did you mean 'left-knee-op'"),
        ({"left-knee-op": 0.0}, "mass of left-knee-op = 0: a positive mass"),
        ({"left-knee-op": np.nan}, "mass of left-knee-op = nan"),
        ({"left-knee-op": "heavy"}, "mass of left-knee-op"),
        ([1.0], "values by joint"),
    ],
)
def test_a_wrong_mass_is_named(cassie, masses, text):
    with pytest.raises(cp.CondynError, match=text):
        cassie.with_masses(masses)


def test_a_body_without_mass_has_no_inertia_to_grow():
    model = pin.Model(cp.model.four_bar().model)
    first = model.names[1]
    model.inertias[1] = pin.Inertia.Zero()
    model.armature = np.full(model.nv, 0.1)
    with pytest.raises(cp.InvalidArgument, match="moves a body without mass"):
        cp.Robot("light", model).with_masses({first: 1.0})


@pytest.mark.long
def test_a_link_in_the_place_of_a_joint_is_told_its_joint(cassie):
    with pytest.raises(cp.errors.UnknownName, match="that 'root_joint' moves; did you mean"):
        cassie.with_masses({"pelvis": 3.0})
