"""Whole-body control in closed loop: a robot that stands on contacts which may open and slide."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from shared import robot

import condyn_pin as cp
from condyn_pin.contact import FrictionCone
from condyn_pin.control import CenterOfMass, Controller, Orientation, Posture, balance
from condyn_pin.mechanism import put_down

pytest.importorskip("proxsuite")

Array = NDArray[np.float64]


class Standing:
    """Solo12 on four feet under a controller, and the worst of what its answers leave."""

    def __init__(self) -> None:
        solo = robot("solo12")
        held = cp.Scene(solo, solo.contacts)
        self.floor = cp.Scene(solo, contacts=solo.frictional_contacts(friction=0.7))
        q, self.v = held.state()
        self.q = put_down(self.floor, q)
        com = balance(held, self.q, self.v, 0 * self.v, np.zeros(held.rows)).com
        tasks = [
            CenterOfMass(reference=com, kp=100, weight=100),
            Orientation("base_link", kp=100, weight=50),
            Posture(weight=0.1),
        ]
        # within the cones of the floor: what the model asks for, the floor can give
        self.controller = Controller(held, tasks, cones=FrictionCone(0.6, sides=8))
        self.kkt, self.margin = 0.0, np.inf

    def torque(self, t: float, q: Array, v: Array) -> Array:
        out = self.controller.solve(q, v, t)
        assert out.status.ok
        self.kkt = max(self.kkt, out.residuals.kkt)
        self.margin = min(self.margin, *(float(each.least) for each in out.margins.values()))
        return out.tau

    def run(self, duration: float, **options: object) -> cp.Trajectory:
        return cp.simulate(self.floor, self.q, self.v, self.torque, duration=duration, **options)


def test_a_robot_stands_on_contacts_that_may_open() -> None:
    standing = Standing()
    run = standing.run(0.2, dt=1e-3)
    assert run.status.ok
    assert np.abs(run.q[-1] - run.q[0]).max() < 1e-6
    assert standing.kkt < 1e-9
    assert standing.margin > 0
    up = [force[-1, 2] for force in run.forces.values()]
    assert sum(up) == pytest.approx(4 * 6.131, abs=1e-2)


def test_a_push_is_taken_up() -> None:
    """4 N to the side for 0.1 s, a sixth of its weight."""
    standing = Standing()

    def pushed(t: float, q: Array, v: Array) -> tuple[float, float, float]:
        return (0.0, 4.0 if 0.05 <= t < 0.15 else 0.0, 0.0)

    run = standing.run(0.6, dt=1e-3, forces=[cp.AppliedForce("base_link", pushed)])
    assert run.status.ok
    aside = run.q[:, 1] - run.q[0, 1]
    assert 1e-3 < np.abs(aside).max() < 0.05
    assert abs(aside[-1]) < 0.5 * np.abs(aside).max()
    assert standing.kkt < 1e-9
    assert standing.margin > -1e-9
    assert all(set(modes[-1:]) == {"stick"} for modes in run.modes.values())
