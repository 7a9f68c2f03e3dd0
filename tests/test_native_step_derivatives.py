"""Derivatives of steps by the compiled core are those of Python.

Without the core these tests are left out; where CI=true they fail.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from shared import HEADERS, robot
from test_native_contact import DT, EXACT, along, at_stops, boxes, cassie, on_feet

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.work import Arrays
from condyn_pin.constraints import Ball, FrictionalContact, Plane
from condyn_pin.dynamics import Workspace
from condyn_pin.errors import UnsupportedBackend
from condyn_pin.gradients import BatchStepDerivatives, Kappa, step_derivatives_batch
from condyn_pin.gradients.routes import batch

# The core has Pinocchio's headers in it; that scenes cross from either version: test_native.py.
pytestmark = [pytest.mark.native, pytest.mark.once]

CORE = {"executor": cp.Native(threads=1)} if HEADERS else {}
ROUNDED = 1e-9  # relative to the largest entry of a matrix


def both(
    scene: cp.Scene, *states: np.ndarray, dt: float = DT
) -> tuple[BatchStepDerivatives, BatchStepDerivatives]:
    """The derivatives by the core and by Python."""
    about = {"dt": dt, "integrator": EXACT}
    found = step_derivatives_batch(scene, *states, **about, **CORE)
    return found, step_derivatives_batch(scene, *states, **about)


def assert_same(
    found: BatchStepDerivatives, wanted: BatchStepDerivatives, rounded: float = ROUNDED
) -> None:
    assert_array_equal(found.codes, wanted.codes)
    assert_array_equal(found.one_sided, wanted.one_sided)
    assert_allclose(found.margins, wanted.margins, rtol=1e-6, atol=1e-12)
    assert found.parameters == wanted.parameters
    for name in ("dq", "dv"):
        for one, two in zip(getattr(found, name), getattr(wanted, name), strict=True):
            for part in (found.columns.q, found.columns.v, found.columns.tau):
                size = np.abs(two[:, part]).max()
                assert_allclose(one[:, part], two[:, part], rtol=0, atol=rounded * size)
            friction = two[:, found.columns.friction]
            size = np.abs(friction).max(initial=0.0) + np.abs(two[:, found.columns.tau]).max()
            assert_allclose(one[:, found.columns.friction], friction, rtol=0, atol=rounded * size)
            assert not one[:, found.columns.restitution].any()
            assert not one[:, found.columns.solref].any()


@pytest.fixture
def only_the_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python takes no step of a batch."""

    def none(self: object, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> str:
        raise AssertionError("a step was left to Python")

    monkeypatch.setattr(batch.DifferentiatedRows, "row", none)


@pytest.mark.parametrize(("how", "duration"), [("stands", 0.05), ("slides", 0.1), ("falls", 0.3)])
def test_they_are_those_of_python(how: str, duration: float) -> None:
    scene, q, v, tau = along(how, duration)
    q = q.copy()
    q[:, 2] -= 1e-4  # a gap of zero is a kink: rounding says on which side of it
    found, wanted = both(scene, q, v, tau)
    assert wanted.ok
    assert_same(found, wanted)
    modes = {"stands": {1}, "slides": {2}, "falls": {0, 1, 2}}[how]
    assert modes <= set(np.unique(found.codes).tolist())


@pytest.mark.parametrize("how", ["stands", "slides"])
def test_the_core_leaves_nothing_that_stands_or_slides(how: str, only_the_core: None) -> None:
    scene, q, v, tau = along(how, 0.05)
    for integrator in (cp.StewartTrinkle(), EXACT):
        found = step_derivatives_batch(scene, q, v, tau, dt=DT, integrator=integrator, **CORE)
        assert found.ok


def test_balls_capsules_and_boxes_over_planes() -> None:
    scene, rng = boxes(0.4), np.random.default_rng(1)
    Q = np.tile(pin.neutral(scene.robot.model), (20, 1))
    for place in range(3):
        Q[:, 7 * place] += place
        Q[:, 7 * place + 2] += rng.uniform(0.05, 0.15, size=20)
        turn = rng.normal(size=(20, 4))
        Q[:, 7 * place + 3 : 7 * place + 7] = turn / np.linalg.norm(turn, axis=1)[:, None]
    V = rng.normal(size=(20, 18))
    found, wanted = both(scene, Q, V, np.zeros((20, 18)), dt=2e-3)
    assert wanted.ok
    assert_same(found, wanted)
    assert {0, 1, 2} <= set(np.unique(found.codes).tolist())


def test_stops_dry_friction_springs_and_damping() -> None:
    scene, q, _, tau = on_feet("solo12", friction=0.5)
    held = at_stops(scene, q)
    model = pin.Model(held.robot.model)
    model.damping[6:] = 0.01
    joints = list(model.names)[2:6]
    springs = [cp.model.Spring(joint, stiffness=3.0, reference=0.1) for joint in joints]
    held = replace(held, robot=replace(held.robot, model=model, springs=springs))
    V = np.random.default_rng(2).normal(scale=0.5, size=(15, held.robot.nv))
    Q = np.tile(q, (15, 1))
    Q[:, 2] -= 1e-4
    found, wanted = both(held, Q, V, tau)
    assert wanted.ok
    assert_same(found, wanted)


def test_a_leg_that_stands_on_another_one() -> None:
    """Contacts between legs tie what the tree of joints does not."""
    scene, q, _, tau = on_feet("solo12", friction=0.7)
    q[2] -= 1e-4
    model, frames = scene.robot.model, ("FL_FOOT", "HR_LOWER_LEG")
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    foot, leg = (data.oMf[model.getFrameId(frame)] for frame in frames)
    above = float(leg.actInv(foot).translation[1])  # of the foot over the plane of the leg [m]
    plate = Plane((0.0, 1.0, 0.0), height=above - 0.01 + 1e-4)
    on_leg = FrictionalContact(
        frames[0], Ball(0.01), on=frames[1], on_shape=plate, friction=0.5, name="on leg"
    )
    both_ways = cp.Scene(scene.robot, contacts=(*scene.contacts, on_leg))
    V = np.random.default_rng(7).normal(scale=0.1, size=(6, model.nv))
    found, wanted = both(both_ways, np.tile(q, (6, 1)), V, np.tile(tau, (6, 1)))
    assert wanted.ok
    assert found.codes[:, -1].any()
    assert_same(found, wanted)


def beginning_to_fall(
    scene: cp.Scene, q: np.ndarray, v: np.ndarray, tau: np.ndarray, times: int
) -> tuple[np.ndarray, np.ndarray]:
    """Where robots are that stand, and then fall under some torques, a little into the floor."""
    rng, states = np.random.default_rng(3), [(q, v)]
    for _ in range(times):
        moved = cp.simulate(
            scene, q, v, tau + 5.0 * rng.normal(size=len(tau)), duration=0.02, dt=DT
        )
        states += [*zip(moved.q[10:], moved.v[10:], strict=True)]
    Q, V = (np.array(x) for x in zip(*states, strict=True))
    Q[1:, 2] -= 1e-4
    return Q, V


def test_loops_are_condensed_and_closed() -> None:
    scene, q, v, tau = cassie()
    Q, V = beginning_to_fall(scene, q, v, tau, times=3)
    found, wanted = both(scene, Q, V, np.tile(tau, (len(Q), 1)))
    assert wanted.ok
    assert_same(found, wanted, rounded=1e-8)  # loops as they are there: 1 / 1.3e-5


def test_loops_in_the_air() -> None:
    scene, q, v, tau = cassie()
    q = q.copy()
    q[2] += 0.5
    V = np.random.default_rng(4).normal(scale=0.5, size=(4, len(v)))
    bilateral = cp.Scene(scene.robot, scene.robot.loops)
    V = np.array([cp.mechanism.project_velocity(bilateral, q, each) for each in V])
    found, wanted = both(scene, np.tile(q, (4, 1)), V, np.tile(tau, (4, 1)))
    assert not found.codes.any()
    assert_same(found, wanted, rounded=1e-8)


def test_a_robot_in_the_air(only_the_core: None) -> None:
    scene, q, _, tau = on_feet("solo12", friction=0.7)
    q[2] += 0.5
    V = np.random.default_rng(5).normal(scale=1.0, size=(5, scene.robot.nv))
    state = np.tile(q, (5, 1)), V, np.tile(tau, (5, 1))
    found = step_derivatives_batch(scene, *state, dt=DT, **CORE)
    for one, q0, v0, tau0 in zip(found, *state, strict=True):
        wanted = cp.step(scene, q0, v0, tau0, dt=DT).derivatives()
        assert_allclose(one.matrices[0], wanted.matrices[0], rtol=0, atol=1e-12)
        assert_allclose(one.matrices[1], wanted.matrices[1], rtol=0, atol=1e-9)


def test_soles_whose_corners_share_the_load() -> None:
    scene, q, _, tau = on_feet("talos", friction=0.7)
    q[2] -= 1e-4
    V = np.zeros((3, scene.robot.nv))
    V[1:] = np.random.default_rng(6).normal(scale=1e-3, size=V[1:].shape)
    found, wanted = both(scene, np.tile(q, (3, 1)), V, np.tile(tau, (3, 1)))
    assert wanted.ok
    assert (found.codes == 1).any()
    assert_same(found, wanted, rounded=1e-8)


def test_threads_return_the_same_bits() -> None:
    scene, q, v, tau = along("falls", 0.1)
    one = step_derivatives_batch(scene, q, v, tau, dt=DT, **CORE)
    two = step_derivatives_batch(scene, q, v, tau, dt=DT, executor=cp.Native(threads=3), chunk=7)
    for name in ("q", "v", "dq", "dv", "codes", "margins"):
        assert_array_equal(getattr(one, name), getattr(two, name))


def test_long_steps_are_left_to_python() -> None:
    """One that is taken again, with contacts as they are where its path ends."""
    its = robot("solo12")
    scene = cp.Scene(its, contacts=its.frictional_contacts(0.7))
    q = scene.state()[0].copy()
    v = np.zeros(its.nv)
    q[2] -= min(cp.dynamics.contact_gaps(scene, q).values()) - 1e-3
    v[:6] = 0.0, 0.0, -2.0, 3.0, 3.0, 0.0
    found, wanted = both(scene, q[None], v[None], np.zeros((1, its.nv)), dt=2e-2)
    assert_array_equal(found.dv, wanted.dv)


def test_what_it_does_not_take_is_refused_by_name() -> None:
    scene, q, v, tau = on_feet("solo12", friction=0.7)
    state = q[None], v[None], tau
    for about, words in (
        ({"route": Kappa(1e-6)}, "ActiveSet"),
        ({"wrt": ["inertias"]}, "inertias"),
        ({"integrator": cp.Moreau()}, "StewartTrinkle alone"),
    ):
        with pytest.raises(UnsupportedBackend, match=words):
            step_derivatives_batch(scene, *state, dt=DT, **about, **CORE)
        where = cp.Native(threads=1, where_possible=True)
        found = step_derivatives_batch(scene, *state, dt=DT, **about, executor=where)
        wanted = step_derivatives_batch(scene, *state, dt=DT, **about)
        assert_array_equal(found.dv, wanted.dv)


@pytest.mark.parametrize("speed", [0.0, 0.1])
def test_dry_friction_of_zero_holds_nothing(speed: float) -> None:
    """At rest it was taken to stick: v+ had no slope by torques."""
    its = robot("four_bar")
    scene = cp.Scene(its, contacts=[cp.constraints.JointFriction("crank", torque=0.0)])
    state = np.zeros((1, 3)), np.full((1, 3), speed)
    found = step_derivatives_batch(scene, *state, dt=DT, **CORE)
    wanted = step_derivatives_batch(scene, *state, dt=DT)
    assert np.abs(wanted.dv_dtau).max() > DT
    for name in ("dv_dq", "dv_dv", "dv_dtau"):
        assert_allclose(getattr(found, name), getattr(wanted, name), rtol=1e-9, atol=1e-12)
    assert_array_equal(found.one_sided, wanted.one_sided)
