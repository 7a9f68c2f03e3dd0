"""Numbers of printed answers: rounded, no -0, and lines of at most 100 columns."""

from __future__ import annotations

import re

import numpy as np
import pytest

import condyn_pin as cp
from condyn_pin._core.arrays import in_column, rounded
from condyn_pin.contact import FrictionCone
from condyn_pin.control import CenterOfMass, Controller, Posture

pytestmark = pytest.mark.once

NEGATIVE_ZERO = re.compile(r"-0(\.0*)?(?![\d.e])")


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ([-1e-17, 2.0, -0.0], "[0. 2. 0.]"),
        ([1e-12, -3e-13], "[0. 0.]"),
        ([-0.00033051, 5e-9], "[-0.0003305  0.       ]"),
        ([12.345678, -9.81], "[12.3457 -9.81  ]"),
        ([np.nan, 1.0], "[nan  1.]"),
        ([], "[]"),
    ],
)
def test_arrays_are_rounded_without_a_negative_zero(numbers, text):
    assert rounded(numbers) == text


def test_a_column_is_aligned_at_the_point():
    texts = [text for _, text in in_column({"a": -1e-9, "b": 12.5})]
    assert texts == ["    0.0000", "   12.5000"]


def answers():
    """What people print."""
    legs = cp.load_robot("cassie")
    scene = cp.Scene(legs, legs.loops)
    q, v = scene.state("standing")
    tau = legs.passive_torque(q, v)
    yield scene.summary()
    yield cp.solve(scene, q, v, tau)
    yield cp.derivatives(scene, q, v, tau)
    yield cp.Workspace(scene)
    yield cp.simulate(scene, q, v, duration=0.01, dt=5e-4)
    yield scene.assemble(q)
    solo = cp.load_robot("solo12")
    stance = cp.Scene(solo, solo.contacts)
    q, v = stance.state()
    yield cp.control.gravity_compensation(stance, q)
    tasks = [CenterOfMass(weight=100), Posture("standing", weight=0.1)]
    controller = Controller(stance, tasks, cones=FrictionCone(0.6))
    yield controller
    yield controller.solve(q, v)
    floor = cp.Scene(solo, contacts=solo.frictional_contacts(friction=0.7))
    step = cp.step(floor, *floor.state(), dt=1e-3)
    yield step
    yield step.contact
    yield cp.simulate(floor, *floor.state(), duration=0.01, dt=1e-3)
    yield cp.impact(stance, q, v - 0.1)


def test_prints_are_narrow_and_have_no_negative_zero():
    for answer in answers():
        lines = [each for each in str(answer).split("\n") if not each.startswith("note: ")]
        assert max(map(len, lines)) <= 100, lines
        assert not NEGATIVE_ZERO.search("\n".join(lines)), lines


def test_integrators_have_the_names_that_everybody_uses():
    from condyn_pin.cli.words import integrator_of

    assert integrator_of("rk4") == cp.RungeKutta4()
    assert integrator_of("euler") == cp.SemiImplicitEuler()
