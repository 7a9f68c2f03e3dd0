"""What an answer says: forces by name, axes, signs, and the physics behind them."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from shared import (
    all_scenes,
    each_exact_solver,
    each_row,
    each_scene,
    relative,
    robot,
    states,
    truth,
)
from test_massless import LOCKED, arm

import condyn_pin as cp
from condyn_pin.constraints.rows.special import BoundCoupling, BoundRolling


@each_scene
def test_forces_are_the_rows_of_lam_by_name(label):
    """All of them, and zero where a kind transmits nothing."""
    scene = all_scenes()[label]
    solution = cp.solve(scene, *states(label)[0])
    assert list(solution.forces) == list(scene.names)
    for bound in scene.bounds:
        force, lam = solution.forces[bound.name], solution.lam[bound.rows]
        if isinstance(bound, BoundCoupling):
            assert np.array_equal(force, lam)
        elif isinstance(bound, BoundRolling):
            assert np.array_equal(force, bound.whole(lam))
        elif bound.is_rod:
            assert abs(abs(lam[0]) - np.linalg.norm(force)) <= 1e-14 * abs(lam[0])
        else:
            chosen = list(bound.selection)
            assert np.array_equal(force[chosen], lam)
            assert not np.delete(force, chosen).any()
            assert force.size == (6 if max(chosen) > 2 else 3)


def held_still(scene: cp.Scene) -> cp.dynamics.Solution:
    """Torques in the motors that hold a robot still at its first posture, and the forces then.

    J^T lam = h - S tau has many solutions; the one of least squares is taken.
    """
    q, v = scene.state()
    t = cp.Workspace(scene).terms(q, v)
    model = scene.robot.model
    motors = [model.joints[model.getJointId(name)].idx_v for name in scene.robot.actuated]
    springs = [model.joints[model.getJointId(s.joint)].idx_v for s in scene.robot.springs]
    S = np.eye(scene.robot.nv)[:, motors + springs]
    x = np.linalg.lstsq(np.hstack([S, t.J.T]), t.h, rcond=1e-9)[0]
    return cp.solve(scene, q, v, S @ x[: S.shape[1]])


@pytest.mark.parametrize(
    ("label", "weight"),
    [("talos contacts", 885.5702), ("talos corners", 885.5702), ("solo12 contacts", 24.5250)],
)
def test_contact_forces_carry_the_weight_at_rest(label, weight):
    solution = held_still(all_scenes()[label])
    assert np.abs(solution.a).max() < 1e-8
    total = sum(force[:3] for force in solution.world_forces.values())
    assert np.allclose(total, [0.0, 0.0, weight], atol=2e-4)


@pytest.mark.long
def test_cassies_feet_carry_her_weight_at_rest():
    """But for the spin of two thin rods, which nothing can hold: their gravity is 1e-3 N m."""
    scene = all_scenes()["cassie loops + contacts"]
    solution = held_still(scene)
    contacts = {contact.name for contact in scene.robot.contacts}
    total = sum(f for name, f in solution.world_forces.items() if name in contacts)
    assert np.allclose(total, [0.0, 0.0, 323.1414], atol=0.05)


def test_centre_of_pressure_is_inside_the_soles():
    solution = held_still(all_scenes()["talos contacts"])
    for contact in solution.scene.robot.contacts:
        f = solution.forces[contact.name]
        assert f[2] > 0.0  # the ground pushes the robot up
        x, y = -f[4] / f[2], f[3] / f[2]
        assert abs(x) < contact.half_length
        assert abs(y) < contact.half_width


def test_corners_carry_the_same_wrench_as_the_surface():
    surface = held_still(all_scenes()["talos contacts"])
    scene = all_scenes()["talos corners"]
    q, v = scene.state()
    t = cp.Workspace(surface.scene).terms(q, v)
    tau = t.h - t.J.T @ surface.lam
    corners = cp.solve(scene, q, v, tau)
    for contact in surface.scene.robot.contacts:
        total = np.zeros(6)
        for point in contact.corners():
            f = corners.forces[point.name]
            total += np.concatenate([f, np.cross(point.offset, f)])
        assert np.allclose(total, surface.forces[contact.name], atol=1e-5)


@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0, -1.0])
@pytest.mark.parametrize("rate", [0.0, 3.0])
def test_pendulum_as_a_free_body_on_a_ball(angle, rate):
    """theta'' = -g sin(theta) / l, and the pull m (g cos(theta) + l theta'^2) along the rod."""
    length, mass = 0.7, 1.5
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "float")
    model.appendBodyToJoint(
        joint, pin.Inertia(mass, np.zeros(3), 1e-3 * np.eye(3)), pin.SE3.Identity()
    )
    model.addFrame(
        pin.Frame(
            "end", joint, 0, pin.SE3(np.eye(3), np.array([0, 0, length])), pin.FrameType.OP_FRAME
        )
    )
    free = cp.Robot("free", model)
    R = pin.rpy.rpyToMatrix(0.0, angle, 0.0)
    q = pin.SE3ToXYZQUAT(pin.SE3(R, -R @ np.array([0.0, 0.0, length])))
    v = np.array([-length * rate, 0.0, 0.0, 0.0, rate, 0.0])
    sol = cp.solve(cp.Scene(free, [cp.PointContact("end", anchor=(0, 0, 0))]), q, v, np.zeros(6))
    inertia = mass * length**2 + 1e-3
    assert sol.state_error.position < 1e-12
    assert sol.state_error.velocity < 1e-12
    assert sol.a[4] == pytest.approx(-mass * 9.81 * length * np.sin(angle) / inertia, abs=1e-9)
    pull = sol.forces["end"][2]
    assert pull == pytest.approx(mass * (9.81 * np.cos(angle) + length * rate**2), abs=1e-8)


@pytest.mark.long
def test_an_answer_prints_itself_with_units_and_pickles():
    solution = held_still(all_scenes()["talos contacts"])
    text = str(solution)
    for said in ("ok in", "iterations", "dynamics error", "m/s^2", "left_sole_link"):
        assert said in text
    assert repr(solution).startswith("Solution(talos, 12 rows: ok, error bound ")
    copy = pickle.loads(pickle.dumps(solution))
    assert np.array_equal(copy.a, solution.a)
    assert copy.scene == solution.scene


def test_a_scene_without_rows_leaves_none_out():
    scene = cp.Scene(cp.model.chain(2))
    q, v = scene.state()
    found = cp.solve(scene, q, v, 0 * v)
    assert found.doubt == 0.0
    assert found.left_out == found.notices == ()


@pytest.mark.long
def test_every_status_is_advice():
    for status in cp.Status:
        assert len(status.value) > 20
        assert str(status).startswith(status.name.lower())
        assert status.ok == (status is cp.Status.OK)


def test_a_workspace_says_which_weight_it_found():
    scene = all_scenes()["talos contacts"]
    assert ", mu 9.43e-12 1/kg)" in repr(cp.Workspace(scene))
    assert repr(cp.Workspace(scene, cp.DenseKKT(mu=1e-9))).endswith("12 rows: DenseKKT(mu=1e-09))")


@pytest.mark.parametrize("label", ["talos contacts", "cassie loops", "four_bar loops"])
def test_a_coarser_accuracy_makes_a_cheaper_answer_ok(label):
    """One iteration instead of three: refused at 1e-8, good enough where it is good enough."""
    scene, state, right = all_scenes()[label], states(label)[0], truth(label)[0]
    quick = cp.Proximal(mu=1e-4 * scene.nominal.delassus_norm, max_iterations=1)
    with pytest.raises(cp.SolveFailed, match="requested accuracy") as failed:
        cp.solve(scene, *state, solver=quick)
    bound = failed.value.solution.error_bound
    solution = cp.solve(scene, *state, solver=quick, accuracy=2 * bound)
    assert solution.status.ok
    assert np.array_equal(solution.a, failed.value.solution.a)
    assert 1e-8 < relative(solution.a, right.a) < bound
    assert not cp.solve(scene, *state, solver=quick, accuracy=bound / 2, throw=False).status.ok


@each_exact_solver
def test_an_error_advises_nothing_that_was_tried_and_an_accuracy_that_passes(solver):
    scene, still = arm("yaw", "pitch", "roll"), np.zeros(4)
    state = LOCKED - [0.0, 0.01, 0.0, 0.0], still, still + 1.0  # M is not well-conditioned
    finer = cp.solve(scene, *state, solver=solver, throw=False).error_bound / 3
    with pytest.raises(cp.SolveFailed, match=r"accuracy=(\S+) would pass") as failed:
        cp.solve(scene, *state, solver=solver, accuracy=finer)
    said = str(failed.value).partition(" on leg: ")[2]
    assert f"{type(solver).__name__}()" not in said
    assert ("allow more iterations" in said) == hasattr(solver, "max_iterations")
    assert ("another mu" in said) == hasattr(solver, "mu")
    enough = float(re.search(r"accuracy=(\S+) would", said)[1])
    found = cp.solve(scene, *state, solver=solver, accuracy=enough)
    assert found.error_bound <= enough


@pytest.mark.long
def test_a_singular_matrix_is_not_answered_with_the_method_that_met_it():
    bar = cp.Scene(robot("four_bar"), robot("four_bar").loops)
    q, v = bar.state()
    with pytest.raises(cp.SolveFailed, match=r"try another mu, or solve with Proximal") as failed:
        cp.solve(bar, q, v, 0 * v, solver=cp.DenseKKT())
    assert "DenseKKT" not in str(failed.value).partition(" on four_bar: ")[2]


@pytest.mark.long
@each_row("accuracy", [0.0, -1.0, 1e-20, np.nan, np.inf, "fine", [1e-8, 1e-8]])
def test_an_accuracy_beyond_doubles_is_refused(accuracy):
    scene, state = all_scenes()["four_bar loops"], states("four_bar loops")[0]
    with pytest.raises(cp.InvalidArgument, match="accuracy = "):
        cp.solve(scene, *state, accuracy=accuracy)


@pytest.mark.long
def test_a_failed_solve_travels_between_processes():
    """A process pool pickles what a worker raises."""
    bar = all_scenes()["four_bar loops"]
    with pytest.raises(cp.SolveFailed) as failed:
        cp.solve(bar, *states("four_bar loops")[0], solver=cp.DenseKKT())
    copy = pickle.loads(pickle.dumps(failed.value))
    assert str(copy) == str(failed.value)
    assert copy.solution.status is cp.Status.SINGULAR


@pytest.mark.long
def test_an_open_loop_shows_in_the_state_error():
    bar = robot("four_bar")
    q = bar.postures["open"] + [0.0, 0.0, 0.1]
    scene = cp.Scene(bar, bar.loops)
    solution = cp.solve(scene, q, np.ones(3), np.zeros(3), throw=False)
    assert solution.state_error.position > 0.01
    assert solution.state_error.velocity > 0.01
    assert solution.doubt > 0.1
    assert solution.status is cp.Status.INACCURATE  # no a belongs to that state
    assert any("singular posture" in notice for notice in solution.notices)
    with pytest.raises(cp.SolveFailed, match="inaccurate: closing the loops") as failed:
        cp.solve(scene, q, np.ones(3), np.zeros(3))
    assert "would pass" not in str(failed.value)
    word = cp.Scene(replace(bar, precision=0.0), bar.loops)
    assert cp.solve(word, q, np.ones(3), np.zeros(3)).status.ok


@pytest.mark.long
@pytest.mark.parametrize("held", [False, True])
def test_at_rest_without_gravity_zero_is_the_answer(held):
    """An error relative to nothing is none."""
    bar = cp.model.four_bar()
    model = pin.Model(bar.model)
    model.gravity = pin.Motion.Zero()
    scene = cp.Scene(replace(bar, model=model), bar.loops if held else ())
    q, v = scene.state()
    solution = cp.solve(scene, q, 0 * v, 0 * v)
    assert not solution.a.any()
    assert solution.error_bound < 1e-13


@pytest.mark.long
def test_the_bound_does_not_depend_on_the_accuracy_asked_for():
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, [cp.PointContact("coupler_tip")])
    q, v, tau = np.array([1.0, 1.5e-6, 1.0]), np.zeros(3), np.array([100.0, -200.0, 50.0])
    bounds, solver = set(), cp.Proximal(mu=1e-6 * scene.nominal.delassus_norm)
    for accuracy in (1e-8, 1e-5, 1e-2):
        solution = cp.solve(scene, q, v, tau, solver=solver, accuracy=accuracy, throw=False)
        assert not solution.status.ok  # a stretched arm: the exact answer is far away
        bounds.add(solution.error_bound)
    assert len(bounds) == 1


@pytest.mark.long
def test_a_singular_answer_still_says_what_the_state_is():
    scene = all_scenes()["four_bar loops"]
    q, v, tau = states("four_bar loops")[0]
    failed = cp.solve(scene, q, v + 0.1, tau, solver=cp.DenseKKT(), throw=False)
    fine = cp.solve(scene, q, v + 0.1, tau, throw=False)
    assert failed.status is cp.Status.SINGULAR
    assert failed.state_error == pytest.approx(fine.state_error)
    with pytest.raises(
        cp.SolveFailed, match=r"error bound inf; the state is open by .*, with \|J v\| = [1-9]"
    ):
        cp.solve(scene, q, v + 0.1, tau, solver=cp.DenseKKT())


# What tau lacks, and what was solved --------------------------------------------------------------


def hung_mass(stiffness: float = 0.0, damping: float = 0.0) -> cp.Robot:
    """2 kg on a vertical slide without a motor, and a driven slide beside it."""
    model = pin.Model()
    for name in ("mass", "driven"):
        j = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(j, pin.Inertia.FromSphere(2.0, 0.1), pin.SE3.Identity())
    model.damping[:] = [damping, 0.0]
    springs = [cp.model.Spring("mass", stiffness, reference=0.1)] if stiffness else []
    return cp.Robot("hung", model, actuated=["driven"], springs=springs)


@each_row(
    ("made", "kinds"),
    [
        ({"stiffness": 50.0}, "springs"),
        ({"damping": 3.0}, "dampers"),
        ({"stiffness": 50.0, "damping": 3.0}, "springs and dampers"),
    ],
)
def test_springs_that_tau_lacks_are_told_with_what_they_would_change(made, kinds):
    hung = hung_mass(**made)
    q, v, tau = np.array([0.3, 0.0]), np.array([-0.5, 0.0]), np.array([0.0, 4.0])
    passive = -made.get("stiffness", 0.0) * 0.2 + made.get("damping", 0.0) * 0.5
    (said,) = cp.solve(cp.Scene(hung), q, v, tau).notices
    assert f"tau lacks the {kinds} of the robot ({abs(passive):.3g} at mass N m or N)" in said
    assert f"up to {abs(passive) / 2.0:.3g} rad/s^2 or m/s^2: pass tau + robot.passive" in said
    with_them = cp.solve(cp.Scene(hung), q, v, tau + hung.passive_torque(q, v))
    assert with_them.notices == ()
    assert with_them.a[0] == pytest.approx(-9.81 + passive / 2.0)


def test_springs_at_rest_or_of_no_weight_are_no_news():
    q, v = np.array([0.1, 0.0]), np.zeros(2)
    assert cp.solve(cp.Scene(hung_mass(50.0)), q, v, 0 * v).notices == ()
    weak = hung_mass(stiffness=0.9)  # 0.18 N of 19.62 N
    assert cp.solve(cp.Scene(weak), q + 0.2, v, 0 * v).notices == ()
    assert cp.solve(cp.Scene(replace(weak, springs=())), q + 0.2, v, 0 * v).notices == ()


def test_spring_dampers_that_tau_lacks_are_told():
    hung = hung_mass().with_frame("hook", "world", [0.0, 0.0, 2.0])
    model = pin.Model(hung.model)
    model.addFrame(pin.Frame("eye", 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    hung = replace(hung, model=model)
    hung = replace(hung, spring_dampers=[cp.model.SpringDamper("hook", "eye", 30.0)])
    q, v = np.zeros(2), np.zeros(2)
    (said,) = cp.solve(cp.Scene(hung), q, v, 0 * v).notices
    assert "tau lacks the springs of the robot (60 at mass N m or N)" in said
    assert cp.solve(cp.Scene(hung), q, v, hung.passive_torque(q, v)).notices == ()


@pytest.mark.long
def test_a_solution_knows_its_question():
    bar = robot("four_bar")
    scene, drift = cp.Scene(bar, bar.loops), cp.Baumgarte(10.0, 30.0)
    push = (cp.AppliedForce("coupler_tip", [1.0, 0.0, 2.0]),)
    q, v = scene.sample(np.random.default_rng(3))
    q = pin.integrate(bar.model, q, np.array([1e-5, 0.0, 0.0]))
    tau = np.array([0.3, 0.0, 0.0])
    found = cp.solve(scene, q, v, tau, forces=push, drift=drift)
    q[0] = 9.0  # the caller's
    asked = found.question
    assert (asked.forces, asked.drift) == (push, drift)
    again = cp.solve(scene, asked.q, asked.v, asked.tau, forces=asked.forces, drift=asked.drift)
    assert np.array_equal(again.a, found.a)
    assert not np.array_equal(again.a, cp.solve(scene, *asked[:3], forces=push).a)
    batch = cp.solve_batch(scene, [asked.q], [asked.v], tau, forces=push, drift=drift)
    assert batch[0].question.drift == drift
    assert pickle.loads(pickle.dumps(found)).question.drift == drift
