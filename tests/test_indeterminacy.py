"""Contacts whose velocities Coulomb's law leaves open: what is said, and the rule that chooses."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box, Plane
from condyn_pin.contact import (
    ADMM,
    PGS,
    ContactProblem,
    SemismoothNewton,
    natural_residual,
    solve_contact,
)
from condyn_pin.gradients import Softened, trajectory_derivatives
from condyn_pin.stepping import EventDriven, contact_problem, contact_steps

GRAVITY, CUBE = 9.81, Box(0.1, 0.1, 0.1)
SOLVERS = [ADMM(), ADMM(polish=True), SemismoothNewton(), PGS()]
SAID = "not determined by Coulomb's law"


def slot(turn=0.0, play=0.0, speed=1.0, friction=0.2, overlap=0.0):
    """A box on a floor between two walls, turned about the vertical, that slides along them."""
    normal = np.array([np.cos(turn), np.sin(turn), 0.0])
    sides = ((1, "left"), (-1, "right"))
    walls = [
        cp.FrictionalContact(
            "box", CUBE, on=Plane(tuple(s * normal), -0.1 - play + overlap),
            friction=friction, name=name,
        )
        for s, name in sides
    ]  # fmt: skip
    floor = cp.FrictionalContact("box", CUBE, friction=friction, name="floor")
    scene = cp.Scene(cp.model.free_box(), contacts=[*walls, floor])
    q, v = scene.state()
    q[:3], q[5:7], v[1] = (0, 0, 0.1), (np.sin(turn / 2), np.cos(turn / 2)), speed
    return scene, q, v


def block(height=0.0, speed=1.0):
    """A point on two sliders between a floor and a roof."""
    model = pin.Model()
    j = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    j = model.addJoint(j, pin.JointModelPZ(), pin.SE3.Identity(), "z")
    model.appendBodyToJoint(j, pin.Inertia.FromSphere(1.0, 0.05), pin.SE3.Identity())
    model.addFrame(pin.Frame("p", j, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    roof = Plane((0, 0, -1), -height)
    contacts = [
        cp.FrictionalContact("p", friction=0.5, name="floor"),
        cp.FrictionalContact("p", on=roof, friction=0.5, name="roof"),
    ]
    return cp.Scene(cp.Robot("block", model), contacts=contacts), np.zeros(2), np.array([speed, 0])


def spinning(spin=2.0, mu=0.5):
    scene = cp.Scene(cp.model.free_box(), contacts=[cp.FrictionalContact("box", CUBE, friction=mu)])
    q, v = scene.state()
    v[0], v[5] = 1.0, spin
    return scene, q, v


def painleve(spin):
    """A rod in Painlevé's region whose tip slides with -1 m/s."""
    rod = cp.model.painleve_rod(length=2.0, mass=1.0)
    q = rod.postures["paradox"]
    frame = rod.model.getFrameId("tip")
    J = pin.computeFrameJacobian(
        rod.model, rod.model.createData(), q, frame, pin.LOCAL_WORLD_ALIGNED
    )
    v = np.array([0.0, np.cos(q[2]) * spin, spin])
    v[0] = -1 - J[0] @ v
    return cp.Scene(rod, contacts=[cp.FrictionalContact("tip", friction=1.5)]), q, v


PROBLEMS = {
    "slot": lambda: contact_problem(*slot(), dt=1e-3),
    "slot, turned": lambda: contact_problem(*slot(0.3), dt=5e-4),
    "floor and roof": lambda: contact_problem(*block(), dt=1e-3),
    "spins": lambda: contact_problem(*spinning(), dt=1e-3),
    "painleve": lambda: contact_problem(*painleve(5.0), dt=1e-5),
}


def in_other_axes(problem, seed):
    """The same problem in another order of contacts and other tangents; and the way back."""
    rng, k = np.random.default_rng(seed), len(problem.friction)
    order, Q = rng.permutation(k), np.zeros(2 * (3 * k,))
    for i, o in enumerate(order):
        c, s = np.cos(a := rng.uniform(0, 2 * np.pi)), np.sin(a)
        Q[3 * i : 3 * i + 3, 3 * o : 3 * o + 3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    G = Q @ problem.G @ Q.T
    return ContactProblem((G + G.T) / 2, Q @ problem.g, problem.friction[order]), Q


@pytest.mark.parametrize("name", PROBLEMS)
def test_one_motion_by_every_solver_and_in_all_axes(name):
    problem = PROBLEMS[name]()
    speed = np.abs(problem.g).max()
    first = solve_contact(problem)
    assert first.unique_motion is False
    assert any(SAID in notice for notice in first.notices)
    for solver in SOLVERS:
        found = solve_contact(problem, solver)
        assert np.abs(found.sigma - first.sigma).max() <= 1e-9 * speed
        assert [each.kind for each in found.several] == [each.kind for each in first.several]
    for seed in range(3):
        turned, Q = in_other_axes(problem, seed)
        found = solve_contact(turned, SemismoothNewton())
        assert np.abs(Q.T @ found.sigma - first.sigma).max() <= 1e-9 * speed
        assert natural_residual(turned, found.lam) <= 1e-11


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), k=st.integers(2, 4), rank=st.integers(1, 4))
def test_random_problems_of_low_rank_have_one_motion_in_all_axes(seed, k, rank):
    """Friction of few velocities among many rows wedges, jams and slides."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(rank, 3 * k))
    problem = ContactProblem(X.T @ X, X.T @ rng.normal(size=rank), rng.uniform(0.1, 1.5, k))
    found = solve_contact(problem, SemismoothNewton(), throw=False)
    turned, Q = in_other_axes(problem, seed)
    other = solve_contact(turned, ADMM(), throw=False)
    chosen = [each.by_rule for each in (*found.several, *other.several)]
    if found.could_hold and other.could_hold and all(chosen):
        assert np.abs(Q.T @ other.sigma - found.sigma).max() <= 1e-6 * np.abs(problem.g).max()


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6))
def test_what_could_hold_does_under_some_load(seed):
    """A wedge is proved by another answer: all of the contacts that could hold stick."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(2, 6))
    problem = ContactProblem(X.T @ X, X.T @ rng.normal(size=2), rng.uniform(0.2, 2.0, 2))
    found = solve_contact(problem, SemismoothNewton(), throw=False)
    if len(found.could_hold) < 2:
        return
    # the least load with which both stick, by a large multiple of any stress in the cones
    Z = np.linalg.svd(X)[2][2:].T
    rest = -np.linalg.pinv(problem.G, rcond=1e-10) @ problem.g
    angles = 2 * np.pi * np.arange(64) / 64
    rows = [
        mu * Z[3 * i + 2] - np.cos(a) * Z[3 * i] - np.sin(a) * Z[3 * i + 1]
        for i, mu in enumerate(problem.friction)
        for a in angles
    ]
    from scipy.optimize import linprog

    A = np.column_stack((-np.array(rows), np.ones(len(rows))))
    best = linprog(np.r_[np.zeros(Z.shape[1]), -1.0], A_ub=A, b_ub=np.zeros(len(rows)),
                   bounds=[(-1, 1)] * Z.shape[1] + [(None, 1)])  # fmt: skip
    assert best.x[-1] > 0  # a stress inside both cones
    held = rest + Z @ best.x[:-1] * (10 * np.abs(rest).max() / best.x[-1])
    assert natural_residual(problem, held) <= 1e-8
    assert np.abs(problem.velocities(held)).max() <= 1e-8 * np.abs(problem.g).max()


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6))
def test_one_contact_that_is_proved_has_one_answer(seed):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(3, 3)) * [1, 1, rng.choice([1.0, 0.5])]
    problem = ContactProblem(X.T @ X, rng.normal(size=3), rng.uniform(0, 1.5, 1))
    found = solve_contact(problem, SemismoothNewton(), throw=False)
    if not found.unique_motion:
        return
    for _ in range(5):
        guess = rng.normal(size=3) * 3
        other = solve_contact(problem, SemismoothNewton(), guess=guess, throw=False)
        if other.status.ok:
            assert np.allclose(other.sigma, found.sigma, atol=1e-7 * np.abs(problem.g).max())


def test_both_answers_of_painleve_are_counted():
    problem = contact_problem(*painleve(5.0), dt=1e-5)
    found = solve_contact(problem)
    (case,) = found.several
    rows = [0, 2]
    stop = np.zeros(3)
    stop[rows] = np.linalg.solve(problem.G[np.ix_(rows, rows)], -problem.g[rows])
    assert natural_residual(problem, stop) <= 1e-12
    assert not found.lam.any()
    assert case.kind == "painleve"
    assert case.other > 0
    assert solve_contact(contact_problem(*painleve(0.0), dt=1e-5)).several == ()


@pytest.mark.parametrize("dt", [2e-3, 5e-4])
@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_a_box_in_a_slot_goes_as_far_as_without_walls(turn, dt):
    """Walls that do not approach carry no pressure: v t - mu g t (t + dt) / 2."""
    run = cp.simulate(*slot(turn), duration=0.05, dt=dt)
    way, mu, t = np.hypot(*run.q[-1, :2]), 0.2, 0.05
    assert way == pytest.approx(t - mu * GRAVITY * t * (t + dt) / 2, abs=1e-8)
    (notice,) = [each for each in run.notices if SAID in each]
    assert "left, right, floor" in notice
    assert "model a preload" in notice
    assert notice.startswith("from t = 0 s, in ")


@pytest.mark.long
@pytest.mark.parametrize("integrator", [cp.StewartTrinkle(), cp.Moreau(), EventDriven()], ids=str)
def test_a_point_between_floor_and_roof(integrator):
    """It slides by v^2 / (2 mu g), as on the floor alone, whatever the scheme."""
    run = cp.simulate(*block(), duration=0.25, dt=1e-3, integrator=integrator)
    assert run.q[-1, 0] == pytest.approx(1 / GRAVITY, abs=1e-3)
    assert any(SAID in each for each in run.notices)


@pytest.mark.long
def test_what_does_not_move_is_not_spoken_of():
    """Wedged at rest, or with play: one motion, and no word."""
    for scene, q, v in (slot(0.3, speed=0.0), slot(0.3, play=1e-4), block(height=1e-4)):
        after = cp.step(scene, q, v, dt=1e-3)
        assert not any(SAID in each for each in after.notices)
        assert after.contact.several == ()
        assert after.contact.could_hold == ()


@pytest.mark.long
def test_a_floor_alone_is_determined_without_a_word():
    for spin in (0.0, 2.0):
        after = cp.step(*spinning(spin), dt=1e-3)
        assert (SAID in " ".join(after.notices)) == (spin > 0)
    ball = cp.model.free_ball(mass=1.0, radius=0.1)
    scene = cp.Scene(ball, contacts=[cp.FrictionalContact("ball", Ball(0.1), friction=0.5)])
    q, v = scene.state()
    q[2], v[0] = 0.1, 1.0
    assert cp.step(scene, q, v, dt=1e-3).contact.unique_motion is True


@pytest.mark.long
def test_a_row_that_nothing_moves_has_no_force():
    """One tip of a plane rod is no redundant contact; four corners of a box are."""
    rod = cp.model.painleve_rod(length=1.0, mass=1.0)
    scene = cp.Scene(rod, contacts=[cp.FrictionalContact("tip", friction=0.3)])
    after = cp.step(scene, *scene.state(), dt=1e-3)
    assert after.contact.unique_forces
    assert after.notices == ()
    resting = cp.step(*spinning(0.0), dt=1e-3)
    assert not resting.contact.unique_forces
    assert any("redundant" in each for each in resting.notices)


@pytest.mark.long
def test_one_body_is_judged_the_same_beside_any_other():
    """A microgramme beside a kilogramme: status and velocity are those of it alone."""
    light = cp.model.free_box(mass=1e-9, size=(0.2, 0.2, 0.2))
    heavy = cp.model.free_ball(mass=1.0, radius=0.05)
    box = cp.FrictionalContact("a/box", CUBE, friction=0.5, name="a")
    ball = cp.FrictionalContact("b/ball", Ball(0.05), friction=0.5, name="b")
    scene = cp.Scene(cp.model.together({"a": light, "b": heavy}), contacts=[box, ball])
    q, v = scene.state()
    q[:3], q[7:10], v[0], v[6] = (0, 0, 0.1), (2, 0, 0.05), 0.5, 3.0
    after = cp.step(scene, q, v, dt=1e-3)
    alone = cp.Scene(light, contacts=[cp.FrictionalContact("box", CUBE, friction=0.5)])
    lone = cp.step(alone, q[:7], v[:6], dt=1e-3)
    assert after.status.ok
    assert lone.status.ok
    assert np.allclose(after.v[:6], lone.v, rtol=0, atol=1e-8)


def test_slopes_of_what_is_left_open_are_flagged():
    scene, q, v = spinning()
    step = cp.step(scene, q, v, dt=1e-3)
    of = step.derivatives()
    assert of.one_sided
    assert [note.kind for note in of.notes] == [each.kind for each in step.contact.several]
    assert SAID in of.notices[0]
    run = cp.simulate(scene, q, v, duration=5e-3, dt=1e-3)
    chain = trajectory_derivatives(run, wrt=["friction"])
    assert chain.one_sided == tuple(range(5))
    assert any(SAID in each for each in chain.notices)


@pytest.mark.long
def test_slopes_of_the_rule_are_those_of_its_motion():
    """By differences of the step itself, by friction of all corners."""
    h = 1e-4
    ends = [cp.step(*spinning(mu=mu), dt=1e-3).v for mu in (0.5 + h, 0.5 - h)]
    slope = (ends[0] - ends[1]) / (2 * h)
    found = cp.step(*spinning(), dt=1e-3).derivatives().dv_dfriction.sum(axis=1)
    assert np.abs(found - slope).max() <= 1e-3 * np.abs(slope).max()


def test_remarks_of_a_run_are_saved_with_it(tmp_path):
    run = cp.simulate(*spinning(), duration=5e-3, dt=1e-3)
    run.save(tmp_path / "run.npz")
    assert cp.Trajectory.load(tmp_path / "run.npz").run.remarks == run.run.remarks != ()


# ------------------------------------------------------------------------------------------------
# Push-out.


def ball_between(left, right, friction=0.0, height=1.0):
    """A ball between two walls, so deep in each [m]."""
    walls = [
        cp.FrictionalContact(
            "ball", Ball(0.05), on=Plane((s, 0, 0), -0.05 + deep), friction=friction, name=name
        )
        for s, deep, name in ((1, left, "left"), (-1, right, "right"))
    ]
    scene = cp.Scene(cp.model.free_ball(mass=1.0, radius=0.05), contacts=walls)
    q, v = scene.state()
    q[:3] = 0, 0, height
    return scene, q, v


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("deep", [(5e-9, 5e-9), (2e-3, 1e-3), (2e-3, 0.0)])
def test_walls_that_overlap_by_more_than_a_body_leave_it_where_it_is(deep, friction):
    scene, q, v = ball_between(*deep, friction=friction)
    run = cp.simulate(scene, q, v, duration=0.02, dt=1e-3, close_start=False)
    assert run.status.ok
    assert np.abs(run.q[-1, :2]).max() <= 1e-6
    assert run.v[-1, 2] == pytest.approx(-GRAVITY * 0.02, abs=1e-9)
    assert any("contradict" in each for each in run.notices) == (max(deep) > 1e-6)


def test_a_body_is_pushed_until_the_other_wall_touches():
    run = cp.simulate(*ball_between(2e-3, -1e-3), duration=0.05, dt=1e-3, close_start=False)
    assert run.gaps["left"][-1] == pytest.approx(-1e-3, abs=1e-6)
    assert run.gaps["right"][-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.long
def test_a_body_far_in_the_ground_is_pushed_out_slowly():
    """20 mm deep: at 0.2 m/s, whatever dt is, and thrown up by no more than that brings."""
    ball = cp.model.free_ball(mass=1.0, radius=0.05)
    scene = cp.Scene(ball, contacts=[cp.FrictionalContact("ball", Ball(0.05), friction=0.5)])
    q, v = scene.state()
    q[2] = 0.03
    for dt in (1e-3, 1e-4):
        run = cp.simulate(scene, q, v, duration=0.15, dt=dt, close_start=False)
        assert run.v[:, 2].max() <= 0.2 + 1e-9
        assert -1e-4 <= run.gaps["ball"].max() <= 0.2**2 / (2 * GRAVITY) + 1e-4


def test_a_refusal_has_an_advice_that_leads_out():
    """Two balls joined by a rod, 2 mm in the floor, their loop closed."""
    ball = cp.model.free_ball(mass=1.0, radius=0.05)
    robot = cp.model.together({"a": ball, "b": ball})
    robot = robot.with_frame("pa", "a/ball", [0, 0, 0]).with_frame("pb", "b/ball", [0, 0, 0])
    contacts = [cp.FrictionalContact(f"{x}/ball", Ball(0.05), friction=0.5, name=x) for x in "ab"]
    scene = cp.Scene(robot, [cp.Loop("pa", "pb", "rod", length=0.3)], contacts=contacts)
    q, v = scene.state()
    q[:3], q[7:10] = (0, 0, 0.048), (0.3, 0, 0.048)
    with pytest.raises(cp.errors.NotAssembled, match="close_start=False the steps push it out"):
        cp.simulate(scene, q, v, duration=0.01)
    run = cp.simulate(scene, q, v, duration=0.03, close_start=False)
    assert run.status.ok
    assert min(gap[-1] for gap in run.gaps.values()) > -2e-5
    with pytest.raises(cp.errors.NotAssembled, match=r"steps of StewartTrinkle\(\) push"):
        cp.simulate(scene, q, v, duration=0.01, integrator=cp.Moreau())
    q[7] = 0.31  # and an open loop is refused as before
    with pytest.raises(cp.errors.InvalidArgument, match="would close the start within one step"):
        cp.simulate(scene, q, v, duration=0.01, close_start=False)


# ------------------------------------------------------------------------------------------------
# Paths that bend: each body by itself.


def striking_rod(*, beside=(), held=False, dt=5e-3):
    """A rod that hits the floor with 60 rad/s, alone or beside others: the end of its step."""
    model, contacts = pin.Model(), []
    one, box = pin.SE3.Identity(), pin.Inertia.FromBox(1.0, 0.4, 0.02, 0.02)

    def add(name, spin):
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), one, name)
        model.appendBodyToJoint(joint, box, one)
        model.addFrame(pin.Frame(name, joint, 0, one, pin.FrameType.BODY))
        contacts.extend(
            cp.FrictionalContact(name, offset=(x, 0, 0), friction=0.5, name=f"{name}{i}")
            for i, x in enumerate((0.2, -0.2))
        )

    spins = (60.0, *beside)
    for i, spin in enumerate(spins):
        add(f"rod {i}", spin)
    constraints = []
    if held:
        k = model.addJoint(0, pin.JointModelPZ(), one, "post")
        model.appendBodyToJoint(k, pin.Inertia.FromSphere(1.0, 0.05), one)
        model.addFrame(pin.Frame("post", k, 0, one, pin.FrameType.BODY))
        contacts.append(cp.FrictionalContact("post", Ball(0.05), friction=0.5, name="post"))
        constraints.append(cp.constraints.HeldJoint("post", 0.048, name="hold"))
    scene = cp.Scene(cp.Robot("rods", model), constraints, contacts=contacts)
    q = np.concatenate([np.array([1.0 + i, 0, 0.06, 0, 0, 0, 1]) for i in range(len(spins))])
    v = np.concatenate([np.array([0, 0, -3.0, 0, spin, 0]) for spin in spins])
    if held:
        q, v = np.append(q, 0.048), np.append(v, 0.0)
    return cp.step(scene, q, v, dt=dt)


@pytest.mark.parametrize("around", [{"held": True}, {"beside": (25.0,)}, {"beside": (0.0, -45.0)}])
def test_a_step_along_bent_paths_is_that_of_each_body_alone(around):
    alone, among = striking_rod(), striking_rod(**around)
    assert len(alone._taken.tried) > 1  # it was tried again, along its path
    assert np.abs(alone.v - among.v[:6]).max() <= 1e-9
    first, chained = (step.derivatives() for step in (alone, among))
    assert np.abs(chained.dv_dv[:6, :6] - first.dv_dv).max() <= 1e-6
    assert np.abs(chained.dv_dq[:6, :6] - first.dv_dq).max() <= 1e-5 * np.abs(first.dv_dq).max()


@pytest.mark.long
def test_softened_jumps_are_flagged_where_contacts_touch():
    ball = cp.model.free_ball(mass=1.0, radius=0.05)
    scene = cp.Scene(ball, contacts=[cp.FrictionalContact("ball", Ball(0.05), friction=0.5)])
    q, v = scene.state()
    v[2] = -0.1
    for height, flagged in ((0.05 + 1e-9, True), (0.05 - 1e-9, True), (0.05 - 1e-4, False)):
        q[2] = height
        of = cp.step(scene, q, v, dt=1e-3, throw=False).derivatives(route=Softened())
        assert of.one_sided == flagged


@pytest.mark.long
@pytest.mark.parametrize("beside", [(), (0.0,)])
def test_a_step_that_ends_elsewhere_than_it_should_is_noted(monkeypatch, beside):
    """If it may not be tried again, a rod that turns by 0.3 rad ends beside where its step says."""
    assert not any("bend too far" in notice for notice in striking_rod(beside=beside).notices)
    monkeypatch.setattr(contact_steps, "_AGAIN", 0)
    (notice,) = [each for each in striking_rod(beside=beside).notices if "bend too far" in each]
    assert notice.startswith("rod 00 ends")
    assert "take a smaller dt" in notice
