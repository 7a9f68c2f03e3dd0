"""Impacts: closed forms, energy, momentum, derivatives, and changes of constraints."""

from __future__ import annotations

import functools
import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shared import all_scenes, axis_of, central, each_row, each_scene, robot, states
from test_derivatives import CONSTRAINTS, ROOTS, two_arms
from test_traps import two_boxes

import condyn_pin as cp
from condyn_pin._core import _pin


def body(mass: float, inertia: np.ndarray) -> cp.Robot:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "float")
    model.addJointFrame(joint)
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.zeros(3), inertia), pin.SE3.Identity())
    return cp.Robot("body", model)


@pytest.mark.parametrize("e", [0.0, 0.3, 1.0])
def test_a_ball_bounces(e):
    """v+ = -e v-, impulse m (1 + e) v, energy (1 - e^2) m v^2 / 2 lost; it slides on."""
    ball = body(2.0, 0.1 * np.eye(3))
    floor = cp.Scene(ball, [cp.constraints.PlanarContact("float", name="floor")])
    met = cp.impact(floor, pin.neutral(ball.model), [0.7, 0.0, -3.0, 0.0, 0.0, 0.0], restitution=e)
    assert np.allclose(met.v, [0.7, 0.0, 3.0 * e, 0.0, 0.0, 0.0], atol=1e-14)
    assert np.allclose(met.impulses["floor"].in_world(), [0.0, 0.0, 6.0 * (1 + e)], rtol=1e-14)
    assert met.energy_lost == pytest.approx((1 - e**2) * 9.0, abs=1e-13)
    assert met.notices == ()


def test_a_falling_rod_lands_on_one_end():
    """A level rod that stops at one end: impulse m v / 4, and it turns at 3 v / (2 L)."""
    m, L, v = 1.2, 0.8, 2.0
    across = m * L**2 / 12
    rod = body(m, np.diag([1e-6, across, across])).with_frame("end", "float", [L / 2, 0.0, 0.0])
    met = cp.impact(
        cp.Scene(rod, [cp.PointContact("end")]), pin.neutral(rod.model), [0, 0, -v, 0, 0, 0]
    )
    assert np.allclose(met.impulses["end"], [0.0, 0.0, m * v / 4], atol=1e-13)
    assert met.v[2] == pytest.approx(-0.75 * v, rel=1e-13)
    assert abs(met.v[4]) == pytest.approx(1.5 * v / L, rel=1e-13)
    assert met.energy_lost == pytest.approx(m * v**2 / 8, rel=1e-12)


def test_a_rope_that_pulls_shows_in_the_notices():
    ball = body(2.0, 0.1 * np.eye(3))
    met = cp.impact(
        cp.Scene(ball, [cp.SurfaceContact("float")]), pin.neutral(ball.model), [0, 0, 3, 0, 0, 0]
    )
    assert met.notices == ("float: the contact pulls with 6 N s; on real ground it would open",)
    assert met.notices[0] in str(met)


@pytest.mark.values
@pytest.mark.parametrize("e", [0.0, 0.5])
@each_scene
def test_impacts_of_every_scene(label, e):
    """Rows rebound, momentum is that of the impulses, and the energy is what the formula says."""
    scene, (q, _, _) = all_scenes()[label], states(label)[0]
    v = np.random.default_rng(0).normal(size=scene.robot.nv)
    met = cp.impact(scene, q, v, restitution=e)
    terms = cp.Workspace(scene).terms(q, np.zeros(scene.robot.nv))
    w = terms.J @ v
    speed = max(np.abs(met.v).max(), 1.0)
    assert np.abs(terms.J @ met.v + e * w).max(initial=0.0) < 1e-9 * speed
    change = terms.M @ (met.v - v)
    total = sum((i.generalized() for i in met.impulses.values()), np.zeros(scene.robot.nv))
    assert np.abs(change - total).max() < 1e-9 * max(np.abs(change).max(), 1.0)
    assert met.energy_before == pytest.approx(v @ terms.M @ v / 2)
    lost = -(1 - e) / 2 * w @ met.lam
    assert met.energy_lost == pytest.approx(lost, rel=1e-7, abs=1e-9 * met.energy_before)
    assert met.energy_lost >= -1e-12 * met.energy_before


@functools.cache
def many(label: str) -> tuple[cp.Scene, np.ndarray]:
    return all_scenes()[label], states(label)[0][0]


MANY = (
    "cassie loops + contacts",
    "talos corners",
    "four_bar loops",
    "talos hands on a rod",
    "four_bar geared",
)


@given(
    label=st.sampled_from(MANY),
    seed=st.integers(0, 2**32 - 1),
    e=st.floats(0.0, 1.0),
    log_speed=st.floats(-6.0, 3.0),
)
def test_energy_never_grows(label, seed, e, log_speed):
    scene, q = many(label)
    v = 10.0**log_speed * np.random.default_rng(seed).normal(size=scene.robot.nv)
    met = cp.impact(scene, q, v, restitution=e)
    assert met.energy_after <= met.energy_before * (1 + 1e-12)
    if e == 1.0:
        assert met.energy_after == pytest.approx(met.energy_before, rel=1e-9)


@pytest.mark.long
@given(
    seed=st.integers(0, 2**32 - 1),
    each=st.tuples(*4 * [st.floats(0.0, 1.0)]),
)
def test_energy_never_grows_with_different_restitutions(seed, each):
    """Where Newton's rule would add energy it is refused, and the text says how much."""
    scene, q = many("solo12 contacts")
    v = np.random.default_rng(seed).normal(size=scene.robot.nv)
    try:
        met = cp.impact(scene, q, v, restitution=dict(zip(scene.names, each, strict=True)))
    except cp.InvalidArgument as error:
        assert "would add" in str(error)  # noqa: PT017
    else:
        assert met.energy_after <= met.energy_before * (1 + 1e-8)


def test_restitutions_that_would_add_energy_are_refused():
    """Two feet of a seesaw that is let fall on one of them while the other is lifted."""
    board = body(1.0, np.diag([1.0, 1e-3, 1.0]))
    board = board.with_frame("a", "float", [1.0, 0.0, 0.0]).with_frame("b", "float", [-0.1, 0, 0])
    scene = cp.Scene(board, [cp.constraints.PlanarContact("a"), cp.constraints.PlanarContact("b")])
    q, v = pin.neutral(board.model), np.array([0.0, 0.0, -1.0, 0.0, 20.0, 0.0])
    for e in (0.0, 0.5, 1.0):
        assert cp.impact(scene, q, v, restitution=e).energy_lost >= -1e-14
    with pytest.raises(cp.InvalidArgument, match=r"would add 1\.3 J"):
        cp.impact(scene, q, v, restitution={"a": 1.0})


def test_redundant_rows_cannot_rebound_differently():
    scene, q = many("talos corners")
    v = np.random.default_rng(0).normal(size=scene.robot.nv)
    with pytest.raises(cp.InvalidArgument, match="redundant rows rebound differently"):
        cp.impact(scene, q, v, restitution={scene.names[0]: 0.5})


@pytest.mark.long
@each_row("seed", range(3))
def test_what_is_at_rest_already_has_nothing_to_rebound(seed):
    """Its rounding was taken for rows that rebound differently."""
    scene, q = many("talos corners")
    v = cp.impact(scene, q, np.random.default_rng(seed).normal(size=scene.robot.nv)).v
    met = cp.impact(scene, q, v, restitution={scene.names[0]: 0.5})
    assert np.abs(met.v - v).max() < 1e-12


def test_driven_rows_that_contradict_each_other_are_refused():
    """Of 1 m/s and 2 m/s along one slide, 1.5 were returned without a word."""
    slide = body_on_a_slide()
    held = cp.constraints.HeldJoint("slide")

    def pulled(*speeds: float) -> cp.Scene:
        paths = [cp.constraints.Polynomial((0.0, speed)) for speed in speeds]
        names = "one", "two"
        drives = [
            cp.constraints.Driven(held, path, name=name)
            for path, name in zip(paths, names, strict=False)
        ]
        return cp.Scene(slide, drives).at(0.0)

    still = np.zeros(1)
    assert cp.impact(pulled(2.0, 2.0), still, still).v == pytest.approx([2.0])
    with pytest.raises(cp.InvalidArgument, match=r"driven rows differ, 0\.5 m/s"):
        cp.impact(pulled(1.0, 2.0), still, still)


@pytest.mark.long
@pytest.mark.parametrize("size", [1e160, 1e200])
def test_a_velocity_whose_energy_is_no_number_is_refused(size):
    slide = body_on_a_slide()
    scene = cp.Scene(slide, [cp.constraints.HeldJoint("slide")])
    with pytest.raises(cp.InvalidArgument, match="v has numbers up to"):
        cp.impact(scene, np.zeros(1), np.array([size]))


def body_on_a_slide() -> cp.Robot:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    return cp.Robot("slide", model)


@pytest.mark.long
def test_loops_stay_closed_while_feet_land():
    """Pinocchio's own impulse dynamics leaves the loops open: it ignores their second body."""
    scene = all_scenes()["cassie loops + contacts"]
    cassie = scene.robot
    q, v = cp.Scene(cassie, cassie.loops).sample(np.random.default_rng(0))
    q = scene.assemble(q).q
    v = cp.impact(cp.Scene(cassie, cassie.loops), q, v).v
    loops = slice(0, 12)
    J = cp.Workspace(scene).jacobian(q)
    assert np.abs(J[loops] @ v).max() < 1e-10
    assert np.abs(J[12:] @ v).max() > 0.1
    met = cp.impact(scene, q, v)
    assert np.abs(J @ met.v).max() < 1e-10
    assert 0.0 < met.energy_lost < met.energy_before
    assert np.abs(met.lam[loops]).max() > 1e-3


def test_contacts_with_the_world_agree_with_pinocchios_own():
    scene = all_scenes()["talos contacts"]
    q, v = states("talos contacts")[0][0], np.random.default_rng(1).normal(size=38)
    workspace = cp.Workspace(scene)
    _pin.init_constraint_dynamics(
        workspace.model,
        workspace.data,
        workspace.constraint_models,
        workspace.constraint_datas,
    )
    settings = pin.ProximalSettings(1e-12, 1e-12, 10)
    theirs = pin.impulseDynamics(
        workspace.model, workspace.data, q, v, workspace.constraint_models,
        workspace.constraint_datas, 0.4, settings,
    )  # fmt: skip
    ours = cp.impact(scene, q, v, restitution=0.4)
    assert np.abs(theirs - ours.v).max() < 1e-8 * np.abs(ours.v).max()


@pytest.mark.parametrize("kind", ["ball", "weld", "hinge", "rod"])
def test_a_loop_that_snaps_shut_keeps_the_momentum(kind):
    """Two bodies in space: linear and angular momentum of both together stay."""
    boxes = two_boxes()
    length = 0.8 if kind == "rod" else None
    scene = cp.Scene(boxes, [cp.Loop("one_corner", "two_corner", kind, axis_of(kind), length)])
    rng = np.random.default_rng(0)
    q, _ = scene.sample(rng, spread=0.5)
    v = rng.normal(size=12)
    met = cp.impact(scene, q, v, restitution=0.3)
    model, data = boxes.model, boxes.model.createData()
    before, after = (
        pin.computeCentroidalMomentum(model, data, q, x).vector.copy() for x in (v, met.v)
    )
    assert np.abs(met.v - v).max() > 0.1
    assert np.allclose(before, after, atol=1e-12)


@pytest.mark.values
@pytest.mark.parametrize("e", [0.0, 0.6])
@pytest.mark.parametrize("kind", list(CONSTRAINTS))
@pytest.mark.parametrize("root", list(ROOTS))
def test_derivatives_of_every_kind(root, kind, e):
    """To 1e-8 of the largest entry; moved in any direction, also off the constraints."""
    scene = cp.Scene(two_arms(root), [CONSTRAINTS[kind]])
    rng = np.random.default_rng(1)
    q, _ = scene.sample(rng)
    v = rng.normal(size=scene.robot.nv)
    assert_derivatives(scene, q, v, e, rng.normal(size=(2, scene.robot.nv)), close=False)


@pytest.mark.parametrize("label", ["cassie loops + contacts", "talos corners", "four_bar loops"])
def test_derivatives_with_redundant_rows_are_those_along_the_constraints(label):
    scene, (q, _, _) = all_scenes()[label], states(label)[0]
    rng = np.random.default_rng(1)
    v, dv = rng.normal(size=(2, scene.robot.nv))
    J = cp.Workspace(scene).jacobian(q)
    dq = rng.normal(size=scene.robot.nv)
    dq -= np.linalg.lstsq(J, J @ dq, rcond=1e-9)[0]
    assert_derivatives(scene, q, v, 0.3, (dq, dv), close=True)


def assert_derivatives(scene, q, v, e, directions, *, close):
    model, (dq, dv) = scene.robot.model, directions
    workspace = cp.Workspace(scene)

    def moved(step):
        there = pin.integrate(model, q, step * dq)
        for _ in range(2 if close else 0):
            c, J = workspace.violation(there), workspace.jacobian(there)
            there = pin.integrate(model, there, -np.linalg.lstsq(J, c, rcond=1e-7)[0])
        return there

    met = cp.impact(scene, q, v, restitution=e)

    def answer(found):
        return np.concatenate([found.v, found.lam])

    for had, numeric in (
        (
            np.concatenate([met.dv_dq @ dq, met.dlam_dq @ dq]),
            lambda t: answer(cp.impact(scene, moved(t), v, restitution=e)),
        ),
        (
            np.concatenate([met.dv_dv @ dv, met.dlam_dv @ dv]),
            lambda t: answer(cp.impact(scene, q, v + t * dv, restitution=e)),
        ),
    ):
        n = scene.robot.nv
        tries = [central(numeric, h) for h in (1e-3, 3e-4, 1e-4)]
        for part in (slice(0, n), slice(n, None)):
            size = max(np.abs(had[part]).max(), 1.0)
            assert min(np.abs(had[part] - t[part]).max() for t in tries) < 1e-8 * size


def test_touch_down_and_lift_off():
    talos = robot("talos")
    left, right = talos.contacts
    one, two = cp.Scene(talos, [left]), cp.Scene(talos, [left, right])
    q, _ = two.state()
    v = cp.impact(one, q, np.random.default_rng(0).normal(size=talos.nv)).v
    down = cp.simulation.switch(one, two, q, v)
    assert (down.added, down.dropped, down.kept) == ((right.name,), (), (left.name,))
    J = cp.Workspace(two).jacobian(q)
    assert np.abs(J @ v).max() > 0.1
    assert np.abs(J @ down.v).max() < 1e-12
    assert down.impact.energy_lost > 0.0
    up = cp.simulation.switch(two, one, q, down.v)
    assert (up.added, up.dropped, up.kept) == ((), (right.name,), (left.name,))
    assert up.impact is None
    assert up.notices == ()
    assert np.array_equal(up.v, down.v)
    step = cp.simulation.switch(one, cp.Scene(talos, [right]), q, v)
    assert (step.added, step.dropped, step.kept) == ((right.name,), (left.name,), ())
    bounced = cp.simulation.switch(one, two, q, v, restitution=0.5)
    assert np.allclose(J @ bounced.v, np.r_[np.zeros(6), -0.5 * (J @ v)[6:]], atol=1e-12)
    moved = cp.Scene(talos, [cp.SurfaceContact(left.frame, anchor=(0, 0, 0, 0, 0, 0, 1))])
    changed = cp.simulation.switch(one, moved, q, v)
    assert (changed.added, changed.dropped) == ((left.name,), (left.name,))
    assert "open by" in changed.notices[0]
    assert repr(up) == "Switch(talos: added nothing, dropped right_sole_link)"
    assert "J lost" in repr(down)


def test_answers_pickle_and_refuse():
    scene, q = many("talos contacts")
    v = np.ones(38)
    met = cp.impact(scene, q, v)
    copy = pickle.loads(pickle.dumps(met))
    assert np.array_equal(copy.v, met.v)
    assert np.array_equal(copy.dv_dq, met.dv_dq)
    other = all_scenes()["solo12 contacts"]
    for call, error, said in (
        (lambda: cp.impact(scene, q, v, restitution=1.5), cp.InvalidArgument, "between 0 and 1"),
        (lambda: cp.impact(scene, q, v, restitution=np.nan), cp.InvalidArgument, "finite"),
        (lambda: cp.impact(scene, q, v, restitution=[0.5]), cp.InvalidArgument, "restitution"),
        (lambda: cp.impact(cp.Scene(scene.robot), q, v, restitution=-1), cp.InvalidArgument, "-1"),
        (
            lambda: cp.impact(scene, q, v, restitution={"left_sole": 0.5}),
            cp.errors.UnknownName,
            "'left_sole_link'",
        ),
        (lambda: cp.impact(scene, q, v[1:]), cp.InvalidArgument, "v has shape"),
        (lambda: cp.impact("talos", q, v), cp.InvalidArgument, "scene = str"),
        (lambda: cp.simulation.switch(scene, other, q, v), cp.InvalidArgument, "another model"),
        (
            lambda: cp.simulation.switch(None, scene, q, v),
            cp.InvalidArgument,
            "scene_before = NoneType",
        ),
    ):
        with pytest.raises(error, match=said):
            call()


@pytest.mark.long
def test_without_constraints_nothing_happens():
    talos = robot("talos")
    v = np.random.default_rng(0).normal(size=38)
    met = cp.impact(cp.Scene(talos), talos.postures["half_sitting"], v, restitution=1.0)
    assert np.allclose(met.v, v, rtol=1e-12, atol=1e-12)
    assert met.impulses == {}
    assert np.allclose(met.dv_dv, np.eye(38), atol=1e-10)
