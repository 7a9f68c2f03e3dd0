"""Only what a scene requires: rows, rank, redundant rows by name, closed states."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from shared import CLOSED, all_scenes, axis_of, each_scene, robot

import condyn_pin as cp
from condyn_pin.dynamics.nominal import pinocchio_constraints_of
from condyn_pin.mechanism.closed_chains import chains_of
from condyn_pin.mechanism.closing import LoopCloser
from lab.extremes import EXTREMES

# rows, rank, mobility: counted by hand or taken from an independent engine
COUNTS = {
    "talos contacts": (12, 12, 26),
    "talos corners": (24, 12, 26),
    "cassie loops": (12, 10, 22),
    "cassie loops + contacts": (24, 20, 12),
    "solo12 contacts": (12, 12, 6),
    "four_bar loops": (3, 2, 1),
    "pendulum free": (0, 0, 1),
    "talos foot held twice": (18, 12, 26),
}


@pytest.mark.parametrize("label", COUNTS)
def test_rows_rank_and_mobility(label):
    summary = all_scenes()[label].summary()
    assert (summary.rows, summary.rank, summary.mobility) == COUNTS[label]
    assert len(summary.redundant) == summary.rows - summary.rank


@each_scene
def test_redundant_rows_are_those_that_can_go(label):
    """Without them the rank is the same, and every row that is left counts."""
    scene = all_scenes()[label]
    kept = [name not in scene.nominal.redundant for name in scene.row_names]
    J = cp.Workspace(scene).jacobian(scene.nominal.q)
    if scene.rows:
        assert np.linalg.matrix_rank(J[kept], tol=1e-9) == scene.nominal.rank == sum(kept)


@pytest.mark.long
def test_summary_of_cassie_names_the_planar_loops():
    summary = all_scenes()["cassie loops"].summary()
    assert {name.rsplit(".", 1)[0] for name in summary.redundant} == {
        "left-plantar-foot-joint",
        "right-plantar-foot-joint",
    }
    text = str(summary)
    for said in ("12, rank 10, mobility 22", "springs", "static", "ISC", "DenseKKT needs mu"):
        assert said in text


@pytest.mark.long
def test_summary_says_what_is_left_out():
    cassie = robot("cassie")
    text = str(cp.Scene(cassie, cassie.loops[1:]).summary())
    assert f"loops that are not in this scene ({cassie.loops[0].name})" in text
    assert "mobility 0" in str(locked().summary())


@pytest.mark.long
def test_motors_are_counted_by_a_robot_and_named_by_a_summary():
    differential = [cp.model.CoupledMotor(n, {"joint0": 1.0, "joint1": w})
                    for n, w in (("left", 1.0), ("right", -1.0))]  # fmt: skip
    arm = cp.model.chain(3).with_motors("joint2", *differential)
    assert "0 loops, 3 motors" in repr(arm)
    summary = cp.Scene(arm).summary()
    assert summary.facts()["motors"] == "joint2, left (joint0, joint1), right (joint0, joint1)"
    assert "motors           joint2, left" in str(summary)
    assert cp.Scene(arm.with_motors()).summary().facts()["motors"] == "none"


def locked() -> cp.Scene:
    """A weld where the four-bar has a hinge: nothing can move."""
    bar = cp.model.four_bar()
    q = cp.Scene(bar, bar.loops).state()[0]
    turn = -q[0] - q[1] + q[2]
    R = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    bar = bar.with_frame("turned", "coupler_tip", [0, 0, 0], R)
    return cp.Scene(bar, [cp.Loop("turned", "rocker_tip", "weld")])


@pytest.mark.long
def test_a_weld_in_place_of_a_hinge_locks_it_and_is_still_solved():
    scene = locked()
    assert scene.nominal.closed
    assert (scene.rows, scene.nominal.mobility) == (6, 0)
    q, v = scene.state()
    solution = cp.solve(scene, q, v, np.zeros(3))
    assert np.abs(solution.a).max() < 1e-9


@pytest.mark.long
def test_a_kind_that_costs_the_fast_solvers_is_told():
    bar = robot("four_bar")
    for kind, slow in (("slider", True), ("planar", False), ("ball", False)):
        pin_ = cp.Loop("coupler_tip", "rocker_tip", kind, axis=axis_of(kind, "y"), name="pin")
        notes = cp.Scene(bar, [pin_]).summary().notes
        assert any(note.startswith("pin: Pinocchio has no such rows") for note in notes) == slow


@pytest.mark.long
def test_a_scene_that_cannot_be_closed_says_so():
    long = robot("four_bar").with_frame("far", "coupler_tip", [3.0, 0, 0])
    scene = cp.Scene(long, [cp.Loop("far", "rocker_tip", name="reach")])
    assert any("cannot be closed" in note for note in scene.summary().notes)
    with pytest.raises(cp.errors.NotAssembled, match="reach is open by"):
        scene.state()


@each_scene
def test_state_is_closed_and_at_rest(label):
    scene = all_scenes()[label]
    for posture in (None, *scene.robot.postures):
        q, v = scene.state(posture)
        violation = cp.Workspace(scene).violation(q)
        assert np.abs(violation).max(initial=0.0) <= CLOSED
        assert not v.any()


@each_scene
def test_samples_are_closed_moving_and_reproducible(label):
    scene = all_scenes()[label]
    workspace = cp.Workspace(scene)
    q, v = scene.sample(np.random.default_rng(11))
    again = scene.sample(np.random.default_rng(11))
    other = scene.sample(np.random.default_rng(12))
    assert np.array_equal(q, again[0])
    assert np.array_equal(v, again[1])
    assert not np.array_equal(q, other[0])
    assert np.abs(workspace.violation(q)).max(initial=0.0) <= CLOSED
    assert np.abs(workspace.jacobian(q) @ v).max(initial=0.0) < 1e-10
    assert np.abs(v).max() > 0.1


@pytest.mark.long
def test_as_many_guesses_are_sampled_as_are_asked_for(monkeypatch):
    """Loops that leave no motion are closed by none at random, and the error is of the last."""
    scene, guesses, ends = EXTREMES["near_loops"].case(1e-7).scene, [], LoopCloser.ends
    assert chains_of(scene).assembly_mode is not None
    monkeypatch.setattr(LoopCloser, "ends", lambda *args: guesses.append(args) or ends(*args))
    with pytest.raises(cp.errors.NotAssembled, match=r"none of 2 random .* is open by") as error:
        scene.sample(np.random.default_rng(0), tries=2)
    assert len(guesses) == 2
    assert np.array_equal(error.value.assembly.start, guesses[-1][1])
    for tries in (0, 1.5, True, "many"):
        with pytest.raises(cp.InvalidArgument, match=r"^tries = .* whole number of at least 1"):
            scene.sample(np.random.default_rng(0), tries=tries)


@each_scene
def test_scenes_pickle_and_compare(label):
    scene = all_scenes()[label]
    copy = pickle.loads(pickle.dumps(scene))
    assert copy == scene
    assert hash(copy) == hash(scene)
    assert copy.robot == scene.robot
    state = scene.state()
    tau = np.zeros(scene.robot.nv)
    assert np.array_equal(cp.solve(copy, *state, tau).a, cp.solve(scene, *state, tau).a)


@pytest.mark.long
def test_scenes_that_differ_are_not_equal():
    talos = robot("talos")
    one = cp.Scene(talos, talos.contacts[:1])
    assert one != cp.Scene(talos, talos.contacts[1:])
    assert one != cp.Scene(robot("solo12"))
    assert one == cp.Scene(
        cp.load_robot("talos"),
        [cp.SurfaceContact("left_sole_link", half_length=0.0965, half_width=0.062)],
    )


@pytest.mark.long
def test_cassies_postures_from_file_and_figures():
    """Standing: springs at rest, feet flat, the line of each foot 20 mm above the ground."""
    cassie = robot("cassie")
    scene = all_scenes()["cassie loops + contacts"]
    q, _ = scene.state("standing")
    assert np.abs(q - cassie.postures["standing"]).max() < 1e-9
    placements = cp.Workspace(scene).equations.placements(q)[4:]
    heights = [oMc1.translation[2] for oMc1, _ in placements]
    assert np.allclose(heights, 0.02, atol=1e-9)
    com = pin.centerOfMass(cassie.model, cassie.model.createData(), q)
    assert np.allclose(com, (-0.0176, 0.0001, 0.8803), atol=1e-4)


@pytest.mark.long
def test_what_a_scene_keeps_cannot_be_written_to():
    scene = cp.Scene(robot("cassie"), robot("cassie").loops)
    nominal, chains = scene.nominal, chains_of(scene)
    kept = (nominal.q, nominal.terms.J, nominal.states[1].v, chains.rows, chains.clusters[0].basis)
    for array in (*kept, nominal.singular_values, nominal.estimator.weights, chains.limits.upper):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    for q in (scene.state()[0], scene.rank().q):
        q[:] = 0.0  # what is handed out is the caller's own
    cp.solve(
        scene, nominal.q, nominal.states[1].v, nominal.states[1].tau, solver=cp.dynamics.Reference()
    )


@pytest.mark.long
def test_a_model_of_ones_own_says_what_is_not_used():
    """A reader of files says it of its file; around a pin.Model nobody else would."""
    model = pin.Model(cp.model.four_bar().model)
    model.damping[0], model.friction[1] = 0.2, 0.3
    said = cp.Scene(cp.Robot("bar", model)).summary().unused
    assert said == (
        "joint damping (crank): add Robot.passive_torque to tau",
        "joint friction (coupler)",
    )
    told = replace(cp.Robot("bar", model), unused=["damping and friction of the file"])
    assert cp.Scene(told).summary().unused == ("damping and friction of the file",)


def test_a_frame_with_the_worlds_name_is_not_taken_for_the_world():
    model = pin.Model(cp.model.four_bar().model)
    model.addFrame(pin.Frame("world", 2, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    with pytest.raises(cp.errors.InvalidModel, match="'world' of bar has the world's name"):
        cp.Scene(cp.Robot("bar", model), [cp.Loop("coupler_tip", "world")])


@pytest.mark.parametrize("leaves", [1, 2])
def test_what_says_nothing_holds_nothing(leaves):
    """The second hinge of a door: all rows are rounding, and the largest of them held the door."""
    model, askew = pin.Model(), pin.exp6(np.array([0.3, -0.2, 0.5, 0.4, 0.7, -1.1]))
    for leaf in range(leaves):
        model.addJoint(leaf, pin.JointModelRZ(), askew, f"hinge {leaf}")
        body = pin.Inertia.FromBox(20.0, 0.8, 0.05, 2.0)
        model.appendBodyToJoint(leaf + 1, body, askew)
    up = pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.2]))
    for name, joint, place in (("door", leaves, up), ("post", leaves - 1, askew * up)):
        model.addFrame(pin.Frame(name, joint, 0, place, pin.FrameType.OP_FRAME))
    door = cp.Scene(cp.Robot("door", model), [cp.Loop("door", "post", "hinge", axis="z")])
    q, v = np.full(model.nq, 0.7), np.ones(model.nv)
    free = pin.aba(model, model.createData(), q, v, v)
    assert door.rank(q).mobility == model.nv
    np.testing.assert_allclose(cp.mechanism.project_velocity(door, q, v), v, rtol=1e-12)
    np.testing.assert_allclose(cp.impact(door, q, v).v, v, rtol=1e-12)
    for solver in (
        None,
        cp.dynamics.Reference(),
        cp.dynamics.NullSpace(),
        cp.dynamics.GaussPrinciple(),
    ):
        np.testing.assert_allclose(cp.solve(door, q, v, v, solver=solver).a, free, rtol=1e-9)
    found = cp.derivatives(door, q, v, v, check=True)
    np.testing.assert_allclose(found.da_dtau, pin.computeMinverse(model, model.createData(), q))


@pytest.mark.long
def test_scenes_that_differ_by_anchors_have_their_own_rows():
    """A run anchors its contacts and keeps the analysis: gains act on gaps of its own scene."""
    solo = robot("solo12")
    scene = cp.Scene(solo, solo.contacts)
    q, v = scene.state()
    run = cp.simulate(scene, q, v, duration=2e-3, drift=cp.Baumgarte(30.0, 30.0))
    assert run.scene.nominal is scene.nominal
    for which, anchored in ((scene, False), (run.scene, True)):
        rows = pinocchio_constraints_of(which).constraints
        assert {row.anchored for row in rows} == {anchored}


def test_former_members_warn_and_forward():
    scene = all_scenes()["four_bar loops"]
    with pytest.warns(DeprecationWarning, match="Scene.project_velocity is mechanism"):
        v = scene.project_velocity(scene.nominal.q, np.ones(3))
    assert np.array_equal(v, cp.mechanism.project_velocity(scene, scene.nominal.q, np.ones(3)))
    with pytest.warns(DeprecationWarning, match="dynamics.nominal.pinocchio_constraints_of now"):
        assert scene.natives is pinocchio_constraints_of(scene)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = scene.nonsense
    workspace, state = cp.Workspace(scene), (*scene.state(), np.ones(3))
    with pytest.warns(DeprecationWarning, match=r"Workspace\.acceleration"):
        assert (workspace.next_acceleration(*state) == workspace.acceleration(*state)).all()
