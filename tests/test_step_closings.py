"""Loops that a step leaves open are closed behind it, and what rolls is moved along its rows alone.

By differences, off the loops and the floor too: a step takes any start as closed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import condyn_pin as cp
from condyn_pin.constraints import Ball, FrictionalContact, JointFriction, Plane
from condyn_pin.gradients import step_derivatives_batch
from condyn_pin.mechanism import project_velocity
from condyn_pin.stepping import step_batch

Array = NDArray[np.float64]
Start = tuple[cp.Scene, Array, Array]


def disc(speed: float) -> Start:
    """A disc that leans and rolls, far from a wall: two of its three rows have no place."""
    robot = cp.model.rolling_disc()
    away = Plane(normal=(-1.0, 0.0, 0.0), height=-10.0)
    wall = FrictionalContact("centre", Ball(0.1), on=away, friction=0.5)
    scene = cp.Scene(robot, robot.contacts, contacts=[wall])
    q = robot.postures["leaning"]
    wish = speed * np.array([0.0, 0.0, 0.0, 0.1, -1.0, 0.3])
    return scene, q, project_velocity(scene, q, wish)


def bar(speed: float) -> Start:
    robot = cp.model.four_bar()
    friction = JointFriction(robot.joints[-1], 0.5)
    scene = cp.Scene(robot, robot.loops, contacts=[friction])
    q, _ = scene.state()
    return scene, q, project_velocity(scene, q, np.full(robot.nv, speed))


def sprung(speed: float) -> Start:
    """The four-bar with a spring across it, which is part of M in a step and turns with it."""
    scene, q, v = bar(speed)
    spring = cp.model.SpringDamper(
        "crank_tip", "rocker_tip", stiffness=2e3, damping=5.0, rest_length=0.5
    )
    tied = replace(scene.robot, spring_dampers=(spring,))
    return replace(scene, robot=tied), q, v


def differences(start: Start, dt: float, h: float, *, by_q: bool) -> Array:
    """q+ by q or by v, of order 4."""
    scene, q, v = start
    model, n = scene.robot.model, scene.robot.nv
    moves = h * np.multiply.outer((1, -1, 2, -2), np.eye(n)).reshape(-1, n)
    Q = np.array([pin.integrate(model, q, move if by_q else 0 * move) for move in moves])
    ends = step_batch(scene, Q, v + (0 if by_q else 1) * moves, dt=dt)
    assert ends.ok
    here = step_batch(scene, q[None], v[None], dt=dt).q[0]
    off = np.array([pin.difference(model, here, end) for end in ends.q]).reshape(4, n, n)
    return (8 * (off[0] - off[1]) - (off[2] - off[3])).T / (12 * h)


@pytest.mark.pairs
@pytest.mark.parametrize("dt", [1e-3, 1e-2])
@pytest.mark.parametrize(
    ("make", "speed"), [(disc, 1.0), (disc, 30.0), (bar, 2.0), (bar, 50.0)],
    ids=["disc", "fast disc", "bar", "fast bar"],
)  # fmt: skip
def test_what_is_closed_behind_a_step_is_in_its_derivatives(make, speed, dt, engine):
    """Moves of Newton's method that others follow too, at half a radian a step."""
    scene, q, v = start = make(speed)
    of = step_derivatives_batch(scene, q[None], v[None], dt=dt, **engine.batches)
    assert of.ok
    # a start that is open by more than 1e-6 is closed by other factors
    for at, h, right in ((of.columns.q, 1e-7, 1e-6), (of.columns.v, 1e-5, 1e-7)):
        found = of.dq[0][:, at]
        by = differences(start, dt, h, by_q=at == of.columns.q)
        assert np.abs(found - by).max() < right * np.abs(by).max()


@pytest.mark.parametrize("speed", [2.0, 20.0])
def test_loops_are_closed_along_springs_that_are_part_of_M(speed):
    """How those turn was left out of the way back: dq was off by 2e-4."""
    scene, q, v = start = sprung(speed)
    of = step_derivatives_batch(scene, q[None], v[None], dt=1e-2)
    for at, h, right in ((of.columns.q, 1e-7, 1e-6), (of.columns.v, 1e-5, 1e-7)):
        by = differences(start, 1e-2, h, by_q=at == of.columns.q)
        assert np.abs(of.dq[0][:, at] - by).max() < right * np.abs(by).max()


def test_a_step_that_leaves_loops_open_is_not_ok(engine):
    """Five radians in a step: no motion along M^-1 J_b^T closes the four-bar from there."""
    scene, q, v = bar(50.0)
    with pytest.raises(cp.errors.SolveFailed, match="loops are open by") as error:
        cp.step(scene, q, v, dt=0.1)
    assert error.value.solution.violation > 1e-2
    Q, V = np.tile(q, (2, 1)), np.array([v, 0.01 * v])
    assert list(step_batch(scene, Q, V, dt=0.1, **engine.batches).statuses) == [1, 0]
    of = step_derivatives_batch(scene, Q, V, dt=0.1, **engine.batches)
    assert list(of.failed) == [0]
    assert "inaccurate" in of.reasons[0]
