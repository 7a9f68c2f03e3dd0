"""Hinges with massless links between them, in the place of a ball: where two of their axes meet."""

from __future__ import annotations

import re

import numpy as np
import pytest
from oracle import Oracle
from shared import SOLVERS

import condyn_pin as cp
from condyn_pin._core._pin import pin

AXES = {
    "yaw": pin.JointModelRZ, "pitch": pin.JointModelRY, "roll": pin.JointModelRX,
    "again": pin.JointModelRZ,
}  # fmt: skip
LOCKED = np.array([0.2, 0.5 * np.pi, 0.3, 0.4])
NAMED = re.escape("at q = [0.2") + ".*yaw, roll can move there without moving inertia"


def arm(*names: str) -> cp.Scene:
    """A leg on hinges of these axes at one point, its foot on the ground."""
    model = pin.Model()
    inertia = pin.Inertia(1.0, np.array([0.0, 0.0, -0.3]), np.diag([0.02, 0.03, 0.01]))
    down = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5]))
    i = 0
    for name in names:
        i = model.addJoint(i, AXES[name](), pin.SE3.Identity(), name)
    model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
    i = model.addJoint(i, pin.JointModelRY(), down, "knee")
    model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame("foot", i, 0, down, pin.FrameType.OP_FRAME))
    return cp.Scene(cp.Robot("leg", model), [cp.PointContact("foot")])


@pytest.fixture(scope="module")
def scene():
    return arm("yaw", "pitch", "roll")


METHODS = [made() for made in SOLVERS.values()]


@pytest.mark.parametrize("solver", METHODS, ids=lambda solver: type(solver).__name__)
def test_a_solve_names_the_joints_and_the_configuration(scene, solver):
    still = np.zeros(4)
    with pytest.raises(cp.SolveFailed, match=NAMED) as failed:
        cp.solve(scene, LOCKED, still, still, solver=solver)
    assert "mu is too small" not in str(failed.value)
    assert "redundant" not in str(failed.value)
    found = cp.solve(scene, LOCKED, still, still, solver=solver, throw=False)
    assert not found.status.ok
    (notice,) = found.notices
    assert re.search(NAMED, notice)


@pytest.mark.parametrize("apart", [1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8])
def test_what_is_ok_near_the_lock_is_right(scene, apart):
    """M falls with the square of the angle between the axes, and rounding of it grows in a."""
    accepted, still = 0, np.zeros(4)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        q = LOCKED + apart * (1 + 0.1 * seed) * np.array([0.0, 1.0, 0.0, 0.0])
        q[[0, 2, 3]] += 0.3 * rng.normal(size=3)
        exact, _ = Oracle(scene).solve(q, still, still)
        right = exact.astype(float).ravel()
        size = max(9.81, float(np.abs(right).max()))
        for solver in METHODS:
            if not solver.exact:
                continue
            found = cp.solve(scene, q, still, still, solver=solver, throw=False)
            accepted += found.status.ok
            assert not found.status.ok or np.abs(found.a - right).max() < 1e-8 * size, solver
    assert bool(accepted) == (apart > 1e-4)


def test_pivots_that_no_link_without_inertia_lowers_are_not_watched():
    assert cp.Scene(arm("yaw", "pitch", "roll").robot).nominal.pivots.may_fall
    for name in ("four_bar", "talos", "solo12"):
        assert not cp.Scene(cp.load_robot(name)).nominal.pivots.may_fall


def test_without_constraints_too(scene):
    with pytest.raises(cp.SolveFailed, match=NAMED):
        cp.solve(cp.Scene(scene.robot), LOCKED, np.zeros(4), np.zeros(4))


@pytest.mark.parametrize(
    "ask",
    [
        lambda scene, still: scene.rank(LOCKED),
        lambda scene, still: cp.mechanism.project_velocity(
            scene, LOCKED, still + 1.0, metric="mass"
        ),
        lambda scene, still: cp.derivatives(scene, LOCKED, still, still),
        lambda scene, still: cp.simulate(scene, LOCKED, still, duration=0.01, dt=0.001),
        lambda scene, still: cp.control.operational_space(scene, LOCKED, "foot"),
    ],
    ids=["rank", "project_velocity", "derivatives", "simulate", "operational_space"],
)
def test_whatever_is_asked_names_them(scene, ask):
    with pytest.raises((cp.errors.InvalidModel, cp.SolveFailed), match=NAMED):
        ask(scene, np.zeros(4))


def test_a_scene_whose_nominal_state_is_there():
    """Two yaw hinges with a pitch between them, and that at zero: the robot is sound elsewhere."""
    with pytest.raises(
        cp.errors.InvalidModel, match="yaw, again can move there without moving inertia"
    ):
        arm("yaw", "pitch", "again").rank()


@pytest.mark.parametrize("off", [1e-5, 1e-7])
@pytest.mark.parametrize("solver", METHODS, ids=lambda solver: type(solver).__name__)
def test_nearby_an_answer_that_is_not_ok_says_why(scene, solver, off):
    q, still = LOCKED - [0.0, off, 0.0, 0.0], np.zeros(4)
    found = cp.solve(scene, q, still, still + 1.0, solver=solver, throw=False)
    assert not found.status.ok
    (said,) = (text for text in found.notices if "mass matrix" in text)
    assert re.search("(nearly singular|not positive definite) at q.* yaw, roll can move", said)


def test_elsewhere_nothing_is_said(scene):
    q = LOCKED - [0.0, 0.3, 0.0, 0.0]
    found = cp.solve(scene, q, np.zeros(4), np.zeros(4))
    assert found.status.ok
    assert not [text for text in found.notices if "inertia" in text]
