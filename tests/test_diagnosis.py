"""What a scene says of itself: rank, redundant rows, what is open, what slips, what is not used."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from shared import all_scenes, each_row, each_scene, robot
from shell import condyn
from test_assembly import loops_of, parallelogram, with_limits

import condyn_pin as cp
from condyn_pin.io.description import robots_folder

ROCKER = 0.6  # of four_bar() [m]


# --- rank


@each_scene
def test_rank_and_conditions_by_another_route(label):
    """From the Delassus matrix and its eigenvalues."""
    scene = all_scenes()[label]
    q, _ = scene.sample(np.random.default_rng(1))
    terms = cp.Workspace(scene).terms(q, np.zeros(scene.robot.nv))
    rank = scene.rank(q)
    W = terms.J @ np.linalg.solve(terms.M, terms.J.T)
    eigenvalues = np.linalg.eigvalsh(W)[::-1] if scene.rows else np.zeros(0)
    count = int(np.sum(eigenvalues > 1e-10 * eigenvalues.max(initial=0.0)))
    assert (rank.rows, rank.rank) == (scene.rows, count)
    assert rank.mobility == scene.robot.nv - count
    assert rank.gruebler == scene.robot.nv - scene.rows
    assert rank.licq == (count == scene.rows)
    assert rank.closed
    assert len(rank.redundant) == scene.rows - count
    kept = [name not in rank.redundant for name in scene.row_names]
    if count:
        assert np.linalg.matrix_rank(terms.J[kept], tol=1e-9) == count
        ratio = eigenvalues[0] / eigenvalues[count - 1]
        assert rank.delassus_condition == pytest.approx(ratio, rel=1e-4)
    assert rank.condition == pytest.approx(np.linalg.cond(terms.M))
    assert not rank.singular
    assert not rank.isolated


def test_grueblers_count_of_a_planar_loop_is_too_low():
    rank = loops_of("four_bar").rank()
    assert (rank.gruebler, rank.mobility) == (0, 1)
    assert not rank.licq
    bar = robot("four_bar")
    planar = cp.Scene(bar, [cp.Loop("coupler_tip", "rocker_tip", "planar", axis="y")]).rank()
    assert (planar.gruebler, planar.mobility) == (1, 1)
    assert planar.licq


def test_a_singular_posture_is_not_called_redundant():
    """All four bars in line: two rows look redundant, and only the one across the plane is."""
    scene = parallelogram()
    summary = scene.summary()
    assert (summary.rank, summary.mobility, summary.singular) == (1, 2, True)
    assert summary.redundant == scene.rank().redundant == ("coupler_rocker.x", "coupler_rocker.y")
    assert summary.only_here == ("coupler_rocker.x",)
    assert "coupler_rocker.x (only here), coupler_rocker.y" in str(summary)
    (note,) = [note for note in summary.notes if "singular" in note]
    assert "rank 1 here, 2 nearby; coupler_rocker.x redundant only here" in note
    assert not any("a is unique" in note for note in summary.notes)
    away = scene.summary(scene.assemble([0.4, -0.4, 0.4], fixed=["crank"]).q)
    assert (away.rank, away.mobility, away.singular) == (2, 1, False)
    assert away.redundant == ("coupler_rocker.y",)
    assert away.only_here == ()
    assert any("a is unique" in note for note in away.notes)
    assert not any("singular" in note for note in away.notes)


def test_near_a_singular_configuration_it_says_so():
    scene = parallelogram()
    near = scene.rank(scene.assemble([1e-5, -1e-5, 1e-5], fixed=["crank"]).q)
    assert near.rank == 2
    assert any("nearly singular" in note for note in near.notes)


@each_row("start", [[0.0, 0.0, 1.0], [0.05, -0.1, 1.0], [-0.3, 0.7, 1.0]])
def test_bars_that_just_reach_cannot_move_and_it_says_so(start):
    """Crank and coupler, 1.1 m together, tied to a point 1.1 m away."""
    bar = robot("four_bar").with_frame("far", "world", [1.1, 0.0, 0.0])
    bar = dataclasses.replace(bar, postures={"first": np.array(start)})
    summary = cp.Scene(bar, [cp.Loop("coupler_tip", "far", name="far")]).summary()
    assert (summary.rank, summary.singular) == (1, True)
    assert set(summary.redundant) == {"far.x", "far.y"}
    assert any("far closes here and nowhere near: no motion" in note for note in summary.notes)
    shorter = robot("four_bar").with_frame("near", "world", [1.09, 0.0, 0.0])
    rank = cp.Scene(shorter, [cp.Loop("coupler_tip", "near")]).rank()
    assert (rank.rank, rank.singular, rank.isolated) == (2, False, ())
    stuck = with_limits(loops_of("four_bar"), crank=(1.3, 1.3))
    assert stuck.rank().isolated == ()


def held_at_two_points() -> cp.Scene:
    """Two points of one hand on two of the other: their distance is said twice, so rank 5 of 6."""
    talos = robot("talos")
    for hand in ("left", "right"):
        for name, x in (("front", 0.1), ("back", -0.1)):
            talos = talos.with_frame(f"{hand}_{name}", f"gripper_{hand}_base_link", [x, 0.0, 0.0])
    loops = [cp.Loop(f"left_{n}", f"right_{n}", name=n) for n in ("front", "back")]
    return cp.Scene(talos, loops)


@pytest.mark.long
def test_an_open_loop_keeps_the_rank_of_the_closed_one():
    scene = held_at_two_points()
    q, _ = scene.state()
    closed = scene.rank(q)
    assert (closed.rows, closed.rank) == (6, 5)
    rng = np.random.default_rng(0)
    apart = pin.integrate(scene.robot.model, q, 1e-3 * rng.normal(size=38))
    opened = scene.rank(apart)
    assert (opened.rank, opened.generic_rank) == (5, 5)
    assert not opened.closed
    assert any("is open by" in note and "Scene.assemble" in note for note in opened.notes)
    assert not closed.notes
    word = cp.Scene(replace(scene.robot, precision=0.0), scene.constraints).rank(apart)
    assert word.rank == 6  # with every row at its word the gap counts as one
    assert 1e-5 < word.singular_values[-1] / word.singular_values[0] < 1e-2


@pytest.mark.parametrize("spread", [1e-8, 1e-5, 1e-2])
def test_a_projection_meets_the_rows_that_count_at_an_open_loop(spread):
    """The distance of the two points is said twice; opened, no velocity satisfies both."""
    scene = held_at_two_points()
    q, v = scene.state()
    rng = np.random.default_rng(0)
    opened = pin.integrate(scene.robot.model, q, spread * rng.normal(size=38))
    x = rng.normal(size=38)
    closed = cp.mechanism.project_velocity(scene, q, x)
    for project in (
        lambda: cp.mechanism.project_velocity(scene, opened, x),
        lambda: cp.mechanism.project_acceleration(scene, opened, v, x),
    ):
        if spread < 1e-4:
            assert np.abs(project() - closed).max() < 1e2 * spread
            continue
        with pytest.raises(cp.errors.NotAssembled, match=r"(front|back) is open by .* mm"):
            project()


@pytest.mark.long
def test_a_projection_asks_for_loops_that_are_nearly_closed():
    scene = loops_of("four_bar")
    q, v = scene.state()
    for crank, refused in ((1e-5, False), (1e-2, True)):
        at = q + crank * np.eye(3)[0]
        for project in (
            lambda at=at: cp.mechanism.project_velocity(scene, at, np.ones(3)),
            lambda at=at: cp.mechanism.project_acceleration(scene, at, v, np.ones(3)),
        ):
            if refused:
                with pytest.raises(
                    cp.errors.NotAssembled, match=r"coupler_rocker is open by .* mm; "
                ):
                    project()
            else:
                assert np.abs(cp.Workspace(scene).jacobian(at) @ project()).max() < 1e-10


@pytest.mark.long
def test_nothing_moves_and_it_says_so():
    bar = cp.model.four_bar()
    q = loops_of("four_bar").state()[0]
    turn = -q[0] - q[1] + q[2]
    R = pin.rpy.rpyToMatrix(0.0, -turn, 0.0)
    bar = bar.with_frame("turned", "coupler_tip", [0, 0, 0], R)
    summary = cp.Scene(bar, [cp.Loop("turned", "rocker_tip", "weld")]).summary()
    assert (summary.gruebler, summary.mobility) == (-3, 0)
    assert any("mobility 0" in note for note in summary.notes)
    assert not summary.singular


def test_a_joint_with_nothing_but_an_armature_is_named():
    model = pin.Model()
    arm = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "arm")
    model.appendBodyToJoint(arm, pin.Inertia.FromBox(1.0, 0.2, 0.3, 0.4), pin.SE3.Identity())
    model.addJoint(arm, pin.JointModelRZ(), pin.SE3.Identity(), "rotor")
    model.armature = np.array([0.0, 0.1])
    notes = cp.Scene(cp.Robot("arm", model)).summary().notes
    assert [note for note in notes if "nothing beyond rotor has a mass" in note]
    assert not [note for note in loops_of("cassie").summary().notes if "mass" in note]


def test_a_posture_beyond_its_limits_is_named():
    scene = with_limits(loops_of("four_bar"), crank=(0.0, 1.0))
    q, _ = scene.state()
    assert q[0] > 1.0  # a posture is what its author says
    notes = scene.summary().notes
    by = f"crank by {math.degrees(q[0] - 1.0):.3g} deg"
    assert any("beyond joint limits" in n and by in n for n in notes)


@pytest.mark.long
def test_the_summary_of_another_configuration():
    scene = loops_of("cassie")
    q, _ = scene.sample(np.random.default_rng(0))
    here, there = scene.summary(), scene.summary(q)
    assert (here.rows, here.rank, here.redundant) == (there.rows, there.rank, there.redundant)
    assert here.condition != there.condition
    assert here.gruebler == 20
    assert "Gruebler's count 20" in " ".join(str(here).split())


# --- check


@pytest.mark.long
def test_a_gap_is_told_in_millimetres():
    scene = loops_of("four_bar")
    q, v = scene.state()
    q[2] += 0.01
    gap = 2 * ROCKER * math.sin(0.005)
    check = scene.check(q, v)
    assert check.violation["coupler_rocker"].length == pytest.approx(gap, rel=1e-9)
    assert not check.closed
    assert check.consistent
    assert str(check).startswith(f"coupler_rocker is open by {1e3 * gap:.3g} mm")
    with pytest.raises(
        cp.errors.NotAssembled, match=r"open by 6 mm; Scene\.assemble closes the loops$"
    ):
        check.raise_if_open()
    check.raise_if_open(violation=0.01)


def test_a_state_from_the_motors_is_told():
    scene = loops_of("four_bar")
    text = str(cp.mechanism.complete_state(scene, scene.state()[0][:1], [1.0]))
    for said in ("closed: ", "branch of coupler_rocker: +1", "0 directions", "q = [", "v = ["):
        assert said in text
    flat = str(parallelogram().assemble(np.zeros(3)))
    assert "branch of coupler_rocker: in a dead point" in flat


@pytest.mark.long
def test_a_loop_that_cannot_close_is_not_blamed_on_the_spread():
    bar = robot("four_bar").with_frame("far", "world", [5.0, 0.0, 0.0])
    scene = cp.Scene(bar, [cp.Loop("coupler_tip", "far", name="far")])
    with pytest.raises(cp.errors.NotAssembled, match=r"^far is open by 3900 mm .*smallest gap"):
        scene.sample(np.random.default_rng(0))


@pytest.mark.long
def test_figures_have_digits_and_one_unit():
    assert str(cp.constraints.ConstraintViolation(1.9504, 0.0)) == "1950 mm"
    assert str(cp.constraints.ConstraintViolation(0.0123456, 0.0)) == "12.3 mm"
    assert (
        str(cp.constraints.ConstraintViolation(2e-9, math.radians(123.4))) == "2e-06 mm and 123 deg"
    )


@pytest.mark.long
def test_of_a_joint_with_several_limits_the_largest_excess_is_told():
    slider = pin.JointModelComposite(pin.JointModelPX())
    slider.addJoint(pin.JointModelRX())
    model = pin.Model()
    for name, joint in (("arm", slider), ("table", pin.JointModelTranslation())):
        number = model.addJoint(0, joint, pin.SE3.Identity(), name)
        model.appendBodyToJoint(number, pin.Inertia.Random(), pin.SE3.Identity())
    model.lowerPositionLimit, model.upperPositionLimit = -np.ones(5), np.ones(5)
    check = cp.Scene(cp.Robot("two", model)).check([1.5, -1.25, 1.5, 0.0, -1.1])
    assert check.beyond_limits == {"arm": (0.5, 0.25), "table": (0.5, 0.0)}
    assert "arm is 500 mm and 14.3 deg beyond its limits" in str(check)


@pytest.mark.long
def test_a_turn_is_told_in_degrees():
    scene = all_scenes()["talos foot to foot, welded"]
    q, _ = scene.state()
    q[scene.robot.index_q("leg_left_6_joint")] += math.radians(3.0)
    gap = scene.check(q).violation["left_sole_link~right_sole_link"]
    assert gap.angle == pytest.approx(math.radians(3.0), rel=1e-9)
    assert "mm and 3 deg" in str(scene.check(q))
    assert "left_sole_link" not in scene.check(q).violation  # it stands wherever it is


def test_a_velocity_that_does_not_fit_is_named():
    scene = loops_of("cassie")
    q, v = scene.sample(np.random.default_rng(0))
    scene.check(q, v).raise_if_open()
    v[scene.robot.index_v("left-knee-op")] += 1.0
    check = scene.check(q, v)
    assert check.closed
    assert not check.consistent
    wrong = cp.Workspace(scene).jacobian(q) @ v
    rows = scene.names.index("left-achilles-spring-joint") * 3 + np.arange(3)
    slip = check.constraint_velocity["left-achilles-spring-joint"].length
    assert slip == pytest.approx(np.linalg.norm(wrong[rows]))
    with pytest.raises(
        cp.errors.NotAssembled, match=r"^left-achilles-spring-joint has \|J v\| = .* mm/s; "
    ):
        check.raise_if_open()
    check.raise_if_open(constraint_velocity=10.0)


@pytest.mark.long
def test_couplings_are_told_in_their_own_unit():
    bar = robot("four_bar")
    scene = cp.Scene(bar, [cp.constraints.Coupling("rocker", "crank", -0.5, 0.7)])
    q = scene.assemble(np.zeros(3)).q
    q[2] += 0.2
    assert scene.check(q).violation["rocker~crank"] == pytest.approx((0.0, 0.2))


def test_a_check_without_velocity_looks_at_the_configuration_only():
    scene = loops_of("four_bar")
    q, _ = scene.state()
    check = scene.check(q)
    assert check.ok
    assert check.constraint_velocity == {}
    assert str(check) == "every loop is closed"


@pytest.mark.long
def test_limits_are_checked_and_do_not_open_a_loop():
    scene = with_limits(loops_of("four_bar"), crank=(0.0, 1.0))
    q, v = scene.state()
    check = scene.check(q, v)
    assert check.ok
    assert check.beyond_limits == {"crank": cp.constraints.ConstraintViolation(0.0, q[0] - 1.0)}
    assert "crank is" in str(check)


# --- the command line


@pytest.mark.long
def test_show_prints_the_facts_of_a_posture():
    result = condyn("show", "cassie", "--posture", "standing")
    assert result.exit_code == 0, result.output
    for said in ("12, rank 10, mobility 22", "Gruebler's count", "Delassus matrix"):
        assert said in result.output
    assert "left-tarsus-crank-joint" not in result.output
    assert "left-tarsus-crank-joint" in condyn("show", "cassie", "--frames").output


@pytest.mark.long
def test_assemble_prints_a_closed_configuration():
    result = condyn("assemble", "cassie", "--posture", "standing", "--fixed", "left-knee-op")
    assert result.exit_code == 0, result.output
    assert "closed: every loop is closed" in result.output
    assert "left-knee-op" in result.output
    assert "-0.4143" in result.output


@pytest.mark.long
def test_assemble_that_fails_prints_the_gap_and_exits_with_one(tmp_path):
    card = (robots_folder() / "cassie" / "robot.toml").read_text(encoding="utf-8")
    bent = card.replace("left-knee-op = -0.4143", "left-knee-op = -0.6")
    assert bent != card
    (tmp_path / "robot.toml").write_text(bent, encoding="utf-8")
    result = condyn("assemble", str(tmp_path), "--fixed", ",".join(robot("cassie").joints))
    assert result.exit_code == 1
    assert "unreachable: " in result.output
    assert condyn("assemble", str(tmp_path)).exit_code == 0
    assert isinstance(
        condyn("assemble", "cassie", "--fixed", "knee").exception, cp.errors.UnknownName
    )


def two_arms() -> cp.Robot:
    """Two turning arms side by side, an end of each named."""
    model = pin.Model()
    for i, name in enumerate(("one", "two")):
        place = pin.SE3(np.eye(3), np.array([0.0, float(i), 0.0]))
        arm = model.addJoint(0, pin.JointModelRZ(), place, name)
        model.appendBodyToJoint(arm, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name} end", arm, 0, pin.SE3.Identity(), pin.OP_FRAME))
    return cp.Robot("two arms", model)


@pytest.mark.parametrize("angle", [0.0, 0.5, 2.0, 3.0])
@pytest.mark.parametrize("flipped", [False, True])
def test_a_weld_is_open_by_the_distance_of_its_frames_and_the_angle(angle, flipped):
    """The length of log6 is a distance only along a screw: at 2 rad 1.28 m for 1.1 m."""
    robot = two_arms().with_frame("fixed", "world", [1.0, 0.0, 0.0])
    ends = ("fixed", "two end") if flipped else ("two end", "one end")
    apart = math.sqrt(2.0) if flipped else 1.0
    scene = cp.Scene(robot, [cp.Loop(*ends, "weld", name="weld")])
    gap = scene.check([0.0, angle]).violation["weld"]
    assert gap == pytest.approx((apart, angle), rel=1e-12, abs=1e-12)
    contact = cp.SurfaceContact("two end", anchor=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    found = cp.Scene(robot, [contact]).check([0.0, angle]).violation["two end"]
    assert found == pytest.approx((math.sqrt(2.0), angle), rel=1e-12, abs=1e-12)


def test_every_text_on_an_open_weld_tells_distance_and_angle():
    robot = two_arms()
    weld = cp.Loop("two end", "one end", "weld", name="weld")
    scene, q = cp.Scene(robot, [weld]), np.array([0.0, 2.0])
    told = "1000 mm and 115 deg"
    assert told in str(scene.check(q))
    assert told in str(scene.rank(q).notes)
    assert told in cp.impact(scene, q, np.zeros(2)).notices[0]
    with pytest.raises(cp.errors.NotAssembled, match="open by 1000 mm after"):
        scene.sample(np.random.default_rng(0))
    with pytest.raises(cp.SolveFailed, match=told):
        cp.solve(scene, q, q, q, accuracy=1e-14)


# --- what is left free


def told(*constraints: cp.constraints.Constraint) -> str:
    """What the summary of Talos says of its base, in the part that counts."""
    notes = cp.Scene(robot("talos"), constraints).summary().notes
    (note,) = [note for note in notes if "can still" in note]
    assert note.endswith(", as one body with its joints held")
    return note.partition("can still ")[2].partition(", as one body")[0]


def test_a_humanoid_on_two_points_can_turn_about_the_line_through_them():
    left, right = (contact.frame for contact in robot("talos").contacts)
    two = cp.PointContact(left), cp.PointContact(right)
    assert told(*two) == f"turn about the line through {left}, {right}"
    assert told(two[0]) == f"turn any way about {left}"
    hand = cp.PointContact("gripper_left_base_link")
    for enough in ((*two, hand), robot("talos").contacts, ()):
        notes = cp.Scene(robot("talos"), enough).summary().notes
        assert not any("can still" in note for note in notes)


@pytest.mark.long
def test_an_open_loop_of_the_robot_holds_no_base():
    cassie = robot("cassie")
    bent = np.array(next(iter(cassie.postures.values())))
    bent[cassie.index_q("left-knee-op")] -= 0.3  # J of an open loop has columns of the base
    opened = dataclasses.replace(cassie, postures={"open": bent})
    notes = cp.Scene(opened, opened.loops).summary().notes
    assert not any("can still" in note for note in notes)


def test_a_foot_that_glides_shifts_and_turns():
    left, right = (contact.frame for contact in robot("talos").contacts)
    three = [
        cp.constraints.PlanarContact(left, at, name=f"p{at}")
        for at in ((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0))
    ]
    assert told(*three) == "shift in the plane across the world's z and turn about the world's z"
    across = told(cp.constraints.LineContact(left, "x"))
    assert across.startswith("turn about an axis along ")
    assert across.endswith(f"through {left}")
    assert told(cp.PointContact(left), cp.constraints.PlanarContact(right)) == (
        f"turn about two axes about {left}"
    )


@pytest.mark.long
def test_what_is_told_to_be_free_is_free():
    """The twist of the line through two points, as a velocity of the base alone."""
    talos = robot("talos")
    scene = cp.Scene(talos, [cp.PointContact(c.frame) for c in talos.contacts])
    q, v = scene.state()
    data = talos.model.createData()
    pin.framesForwardKinematics(talos.model, data, q)
    one, two = (data.oMf[talos.model.getFrameId(c.frame)].translation for c in talos.contacts)
    omega = (two - one) / np.linalg.norm(two - one)
    v[:6] = data.oMi[1].actInv(pin.Motion(-np.cross(omega, one), omega)).vector
    assert scene.check(q, v).consistent


@pytest.mark.long
def test_a_singular_configuration_is_told_by_the_solution():
    """Every status is ok there, and yet the equations ask for less than the loop."""
    cell = cp.model.n_four_bar(1)
    scene = cp.Scene(cell, cell.loops)
    flat = cp.solve(scene, np.zeros(3), np.zeros(3), np.ones(3))
    assert flat.status.ok
    assert any(note.startswith("singular configuration: rank 1 here") for note in flat.notices)
    assert "singular configuration" in str(flat)
    raised = cp.solve(scene, [0.3, -0.3, 0.3], np.zeros(3), np.ones(3))
    assert raised.notices == ()
