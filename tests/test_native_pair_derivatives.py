"""Derivatives of steps of shapes that meet each other, by the compiled core as by Python.

Without the core these tests are left out; where CI=true they fail.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from native_contacts import Start, along, by_python
from numpy.testing import assert_array_equal
from test_contact_pairs import above, near, placed, scene_of
from test_meeting_derivatives import almost_flush, assert_differences
from test_native_contact import CORE, DT, EXACT
from test_native_pairs import (
    COMBINATIONS,
    SHAPES,
    cradle,
    gripper,
    heap,
    kick,
    shin_on_a_step,
    tower,
)
from test_native_step_derivatives import ROUNDED, assert_same

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin.constraints import Capsule
from condyn_pin.gradients import step_derivatives_batch
from condyn_pin.gradients.routes import batch

# The core has Pinocchio's headers in it; that scenes cross from either version: test_native.py.
pytestmark = [pytest.mark.native, pytest.mark.once]

ABOUT = {"dt": DT, "integrator": EXACT}


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(("one", "two"), COMBINATIONS)
def test_two_bodies_in_the_air(one, two, order, monkeypatch):
    """Near each other, far away, and a little into each other, at any angle."""
    one, two = (SHAPES[name] for name in (one, two)[::order])
    scene, rng = scene_of(one, two), np.random.default_rng(3)
    pin.seed(5)
    Q = np.array([near(one, two, rng, gap) for gap in (5e-4, 1e-4, -1e-5, 0.3) for _ in range(3)])
    V = rng.normal(scale=0.5, size=(len(Q), 12))
    wanted = step_derivatives_batch(scene, Q, V, **ABOUT)
    with by_python(monkeypatch, batch.DifferentiatedRows, "row") as asked:
        found = step_derivatives_batch(scene, Q, V, **ABOUT, **CORE)
    assert len(asked) <= 1  # Newton's method has no answer of one rod that is in a box
    assert_same(found, wanted)
    assert found.codes.any()


# How long each moves [s], and how many of 40 steps are left to Python at most: Newton's method of
# the core answers few in which redundant contacts slide. Which of them hangs on rounding.
SCENES = {
    cradle: (0.2, 0), shin_on_a_step: (0.15, 5), heap: (0.15, 20), kick: (0.05, 30),
    gripper: (0.1, 30), tower: (0.02, 38),
}  # fmt: skip


def beside(make: Callable[[], Start], duration: float) -> Start:
    """States near a motion: in the motion itself gaps of zero are kinks."""
    (group,) = along(make(), duration)
    model, rng = group.scene.robot.model, np.random.default_rng(4)
    moves = rng.normal(scale=2e-4, size=group.v.shape)
    Q = [pin.integrate(model, q, move) for q, move in zip(group.q, moves, strict=True)]
    return group._replace(q=np.array(Q))


@pytest.mark.parametrize("make", SCENES, ids=lambda make: make.__name__)
def test_scenes(make, monkeypatch):
    """Where redundant contacts slide the law has several answers: equal ones are compared."""
    duration, left = SCENES[make]
    group = beside(make, duration)
    wanted = step_derivatives_batch(*group, **ABOUT)
    with by_python(monkeypatch, batch.DifferentiatedRows, "row") as asked:
        found = step_derivatives_batch(*group, **ABOUT, **CORE)
    assert len(asked) <= left
    assert_array_equal(found.failed, wanted.failed)
    off = np.abs(found.step.lam - wanted.step.lam).max(axis=1)
    same = off <= 1e-9 * np.abs(wanted.step.lam).max(axis=1)
    same &= (found.codes == wanted.codes).all(axis=1)  # rounding chooses where a contact is on edge
    same[wanted.failed] = False
    assert np.count_nonzero(same) >= 20
    for name in ("dq", "dv"):
        one, two = getattr(found, name)[same], getattr(wanted, name)[same]
        sizes = np.abs(two).max(axis=(1, 2))
        assert (np.abs(one - two).max(axis=(1, 2)) <= ROUNDED * sizes).all()
    assert np.count_nonzero(found.codes[same].any(axis=1)) >= 10


def test_differences_of_steps_of_python():
    assert assert_differences(*almost_flush(), **CORE) == 2
    scene, Q, V, _ = beside(cradle, 0.2)
    assert assert_differences(scene, Q[::4], V[::4], **CORE) >= 5


def test_points_in_doubt_are_left_to_python(monkeypatch):
    """A point on a wire, whose normal turns by any angle at once."""
    scene = scene_of(SHAPES["point"], Capsule(1e-10, 0.3))
    Q = np.array([placed(above(0.05, x=x)) for x in (1.5e-10, 1e-5)])
    V = np.tile([-0.3, 0.1, -0.4, *np.zeros(9)], (2, 1))
    with by_python(monkeypatch, batch.DifferentiatedRows, "row") as asked:
        found = step_derivatives_batch(scene, Q, V, **ABOUT, **CORE)
    assert found.codes.all()
    assert len(asked) == 1
    wanted = step_derivatives_batch(scene, Q, V, **ABOUT)
    assert_array_equal(found.dv[0], wanted.dv[0])
    assert_same(found, wanted)


def test_threads_return_the_same_bits():
    group = beside(shin_on_a_step, 0.15)
    one, three = (
        step_derivatives_batch(*group, **ABOUT, executor=cp.Native(threads=threads))
        for threads in (1, 3)
    )
    assert one.codes.any()
    assert_array_equal(one.dq, three.dq)
    assert_array_equal(one.dv, three.dv)
