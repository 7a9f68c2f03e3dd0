"""Operational space: inertia at a frame, free and constrained, and what a task does not see."""

from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest
from shared import all_scenes, robot, states

import condyn_pin as cp
from condyn_pin.control import operational_space

FRAMES = {
    "talos contacts": "gripper_left_base_link",
    "talos corners": "gripper_right_base_link",
    "cassie loops": "left-foot",
    "cassie loops + contacts": "pelvis",
    "four_bar loops": "coupler_tip",
    "four_bar hinge": "crank_tip",
    "solo12 contacts": "base_link",
    "solo12 alone": "base_link",
    "talos hands on a rod": "gripper_left_base_link",
}


def test_a_pendulum_by_hand():
    """The tip of mass m feels m across the rod, and nothing along it."""
    pendulum = cp.model.pendulum(length=0.5, mass=2.0)
    space = operational_space(cp.Scene(pendulum), [0.4], "tip", task="position")
    across = np.array([-np.cos(0.4), 0.0, np.sin(0.4)])
    assert np.allclose(space.Lambda, 2.0 * np.outer(across, across), atol=1e-13)
    assert np.allclose(space.Lambda_inverse, 0.5 * np.outer(across, across), atol=1e-13)
    assert space.rank == 1
    assert np.allclose(space.N, 0.0, atol=1e-13)


def test_a_free_box_off_its_centre():
    """Delassus of a point at r from the centre: 1/m - [r] I^-1 [r]."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "float")
    inertia = np.diag([0.1, 0.2, 0.3])
    model.appendBodyToJoint(joint, pin.Inertia(2.0, np.zeros(3), inertia), pin.SE3.Identity())
    model.addJointFrame(joint)
    r = np.array([0.3, -0.2, 0.4])
    box = cp.Robot("box", model).with_frame("corner", "float", r)
    space = operational_space(cp.Scene(box), pin.neutral(model), "corner", task="position")
    wanted = np.eye(3) / 2.0 - pin.skew(r) @ np.linalg.inv(inertia) @ pin.skew(r)
    assert np.allclose(space.Lambda_inverse, wanted, atol=1e-13)
    assert np.allclose(space.Lambda, np.linalg.inv(wanted), atol=1e-12)
    centre = operational_space(cp.Scene(box), pin.neutral(model), "float")
    assert np.allclose(centre.Lambda, np.diag([2.0, 2.0, 2.0, 0.1, 0.2, 0.3]), atol=1e-12)


@pytest.mark.long
def test_held_fast_it_has_no_inertia_that_moves():
    talos = robot("talos")
    stance = cp.Scene(talos, talos.contacts)
    space = operational_space(stance, stance.state()[0], "left_sole_link")
    assert space.rank == 0
    for nothing in (space.Lambda_inverse, space.Lambda, space.J_bar):
        assert np.abs(nothing).max() == 0.0
    assert np.array_equal(space.N, np.eye(38))


@pytest.mark.values
@pytest.mark.parametrize("task", ["pose", "position"])
@pytest.mark.parametrize("label", list(FRAMES))
def test_a_force_at_the_frame_accelerates_it_as_the_matrix_says(label, task):
    """Two solves of the constrained robot, with and without the force."""
    scene, (q, v, tau) = all_scenes()[label], states(label)[0]
    space = operational_space(scene, q, FRAMES[label], task=task)
    f = np.random.default_rng(0).normal(size=len(space.J))
    workspace = cp.Workspace(scene, cp.dynamics.Reference())
    with_force = workspace.solve(q, v, tau + space.J.T @ f).a
    more = with_force - workspace.solve(q, v, tau).a
    size = max(np.abs(more).max(), np.abs(with_force).max() * 1e-3)
    assert np.abs(space.J @ more - space.Lambda_inverse @ f).max() < 1e-9 * size
    # the same motion of the frame from the least kinetic energy is the very same motion
    assert np.abs(space.J_bar @ (space.J @ more) - more).max() < 1e-8 * size


@pytest.mark.values
@pytest.mark.parametrize("task", ["pose", "position"])
@pytest.mark.parametrize("label", list(FRAMES))
def test_the_null_space_is_not_seen(label, task):
    scene, (q, v, tau) = all_scenes()[label], states(label)[0]
    space = operational_space(scene, q, FRAMES[label], task=task)
    rng = np.random.default_rng(1)
    J_c = cp.Workspace(scene).jacobian(q)
    x = rng.normal(size=scene.robot.nv)
    x -= np.linalg.lstsq(J_c, J_c @ x, rcond=1e-9)[0] if scene.rows else 0.0
    seen, size = space.J @ (space.N @ x), np.abs(space.J_bar).max() * np.abs(space.J).max() ** 2
    assert np.abs(seen).max() < 1e-9 * max(size, 1.0)
    assert np.abs(J_c @ space.N @ x).max(initial=0.0) < 1e-9 * max(size, 1.0)
    assert np.abs(space.N @ space.N - space.N).max() < 1e-9 * max(size, 1.0)
    # joint torques through N^T give the frame no acceleration
    workspace = cp.Workspace(scene, cp.dynamics.Reference())
    more = workspace.solve(q, v, tau + space.N.T @ x).a - workspace.solve(q, v, tau).a
    assert np.abs(space.J @ more).max() < 1e-9 * max(np.abs(more).max(), size, 1.0)
    # Lambda is the pseudo-inverse, and J_bar keeps the constraints
    D, Lambda = space.Lambda_inverse, space.Lambda
    assert np.abs(D @ Lambda @ D - D).max() < 1e-9 * np.abs(D).max()
    assert np.linalg.matrix_rank(D, tol=1e-9 * np.abs(D).max()) <= space.rank
    assert np.abs(J_c @ space.J_bar).max(initial=0.0) < 1e-9 * max(np.abs(space.J_bar).max(), 1.0)


@pytest.mark.parametrize("label", list(FRAMES))
def test_delassus_of_the_constraints_is_what_stops_them(label):
    """J M^-1 J^T; its inverse gives the impulses that stop a velocity."""
    scene, (q, _, _) = all_scenes()[label], states(label)[0]
    space = operational_space(scene, q, FRAMES[label])
    terms = cp.Workspace(scene).terms(q, np.zeros(scene.robot.nv))
    wanted = terms.J @ np.linalg.solve(terms.M, terms.J.T)
    size = np.abs(wanted).max(initial=1.0)
    assert np.abs(space.delassus - wanted).max(initial=0.0) < 1e-10 * size
    v = np.random.default_rng(0).normal(size=scene.robot.nv)
    met = cp.impact(scene, q, v)
    stopping = -space.delassus_inverse @ (terms.J @ v)
    assert np.abs(stopping - met.lam).max(initial=0.0) < 1e-8 * np.abs(met.lam).max(initial=1.0)


def test_answers_pickle_and_refuse():
    scene = all_scenes()["four_bar loops"]
    q, _ = scene.state()
    space = operational_space(scene, q, "coupler_tip")
    assert np.array_equal(pickle.loads(pickle.dumps(space)).Lambda, space.Lambda)
    assert repr(space) == "OperationalSpace(four_bar, coupler_tip: 1 of 6 directions free)"
    for call, error, said in (
        (lambda: operational_space(scene, q, "copler_tip"), cp.errors.UnknownName, "'coupler_tip'"),
        (lambda: operational_space(scene, q, "world"), cp.InvalidArgument, "does not move"),
        (lambda: operational_space(scene, q, 3), cp.InvalidArgument, "the name of a frame"),
        (
            lambda: operational_space(scene, q, "coupler_tip", task="6d"),
            cp.InvalidArgument,
            "one of pose, position",
        ),
        (lambda: operational_space(scene, q[1:], "coupler_tip"), cp.InvalidArgument, "q has"),
        (lambda: operational_space(robot("talos"), q, "world"), cp.InvalidArgument, "Robot"),
    ):
        with pytest.raises(error, match=said):
            call()
