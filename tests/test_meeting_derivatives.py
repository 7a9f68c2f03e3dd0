"""How points where shapes meet move with their bodies: derivatives of steps against differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from test_contact_pairs import COMBINATIONS, SHAPES, above, near, placed, scene_of

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box
from condyn_pin.constraints.contacts.shapes import box_core, points_core
from condyn_pin.constraints.partials.contacts import (
    CORNER,
    EDGE,
    FACE,
    NONE,
    MeetingTurning,
    feature,
    sliding,
)
from condyn_pin.contact import SemismoothNewton
from condyn_pin.gradients import step_derivatives_batch
from condyn_pin.stepping import step_batch

ABOUT = {"dt": 1e-3, "integrator": cp.StewartTrinkle(contact=SemismoothNewton())}
H = 3e-8  # [rad, m, rad/s, m/s]: slips of 1 mm/s turn soon; rounding leaves 3e-9 of dv+


def differenced(scene: cp.Scene, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The velocity after a step by q and v (nv, 2 nv)."""
    model, n = scene.robot.model, len(v)
    moves = np.kron(np.eye(2 * n), [[H], [-H]])
    Q = np.array([pin.integrate(model, q, move[:n]) for move in moves])
    ends = step_batch(scene, Q, v + moves[:, n:], **ABOUT).v
    return (ends[::2] - ends[1::2]).T / (2 * H)


def assert_differences(scene: cp.Scene, Q: np.ndarray, V: np.ndarray, **where: object) -> int:
    """The number of states that touch and are not about to do something else."""
    found, touch = step_derivatives_batch(scene, Q, V, **ABOUT, **where), 0
    for q, v, codes, margin, dv in zip(Q, V, found.codes, found.margins, found.dv, strict=True):
        if not codes.any() or margin < 1e-3:
            continue
        wanted = differenced(scene, q, v)
        off = np.abs(dv[:, : 2 * len(v)] - wanted).max()
        assert off <= 1e-7 * np.abs(wanted).max()
        touch += 1
    return touch


@pytest.mark.once
@pytest.mark.parametrize(("one", "two"), COMBINATIONS)
def test_steps_of_two_bodies_at_any_angle(one: str, two: str) -> None:
    scene, rng = scene_of(SHAPES[one], SHAPES[two]), np.random.default_rng(4)
    pin.seed(6)
    Q = [near(SHAPES[one], SHAPES[two], rng, gap) for gap in (2e-4, 5e-5, -2e-4)]
    V = rng.normal(size=(3, 12))
    assert assert_differences(scene, np.repeat(Q, 2, axis=0), np.concatenate((V, -V))) >= 2


@pytest.mark.parametrize("off", [-5e-5, 5e-5])
def test_a_ball_that_is_about_to_leave_a_face(off: float, engine) -> None:
    """Differences over more than that saw both the face and the edge."""
    scene = scene_of(Ball(0.1), Box(0.2, 0.15, 0.1))
    q = placed(above(0.2 - 1e-5, x=0.2 + off, y=0.03))
    v = np.array([0.3, -0.2, -0.1, 1.0, 2.0, -1.0, *np.zeros(6)])
    assert assert_differences(scene, q[None], v[None], **engine.batches) == 1


def almost_flush() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    """Corners of one box leave the face of the other, and edges cross in their place."""
    half = Box(0.1, 0.1, 0.05)
    scene = scene_of(half, half)
    turns = [(2e-4, 3e-4, 4e-4), (-3e-4, 1e-4, -2e-4)]
    Q = np.array([placed(above(0.1, rpy, 1e-4, -2e-4)) for rpy in turns])
    return scene, Q, np.array([[0.3, -0.2, -0.5, 0.1, 0.2, 0.3, *np.zeros(6)]] * 2)


def test_boxes_that_are_almost_flush(engine) -> None:
    assert assert_differences(*almost_flush(), **engine.batches) == 2


def test_features_of_a_box() -> None:
    box = box_core(0.2, 0.1, 0.05)
    places = {CORNER: (0.2, 0.1, -0.05), EDGE: (0.2, 0.03, 0.05), FACE: (0.1, 0.02, 0.05)}
    for kind, place in places.items():
        assert feature(box, np.array(place)).kind == kind
    assert feature(box, np.array([0.1, 0.02, 0.04])).kind == NONE
    np.testing.assert_array_equal(np.abs(feature(box, np.array(places[EDGE])).along), (0, 1, 0))


def test_what_is_on_the_rim_of_a_face_is_on_the_face() -> None:
    """And what is nowhere, or touches where a normal may turn at once, is in doubt."""
    box, up = box_core(0.2, 0.1, 0.05), np.array([0.0, 0.0, 1.0])
    other = box.placed(pin.SE3(np.eye(3), 0.1 * up))
    rim = np.array([0.2, 0.1, 0.05])
    of = sliding(other, box, rim, up, 0.0)
    assert of is not None
    assert not of.U.any()
    assert not of.R.any()
    point = points_core((0.0, 0.0, 0.0), radius=0.1)
    assert sliding(point, point, np.zeros(3), up, 0.0) is None
    assert sliding(other, box, rim, np.array([0.6, 0.0, 0.8]), -1e-2) is None


def test_points_in_doubt_are_differenced(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, rng = scene_of(SHAPES["capsule"], SHAPES["box"]), np.random.default_rng(1)
    pin.seed(2)
    Q = np.array([near(SHAPES["capsule"], SHAPES["box"], rng, gap) for gap in (1e-4, -1e-4)])
    V = rng.normal(size=(2, 12))
    wanted = step_derivatives_batch(scene, Q, V, **ABOUT)
    assert wanted.codes.any()
    monkeypatch.setattr(MeetingTurning, "go", lambda self, data: False)
    found = step_derivatives_batch(scene, Q, V, **ABOUT)
    np.testing.assert_allclose(found.dv, wanted.dv, rtol=0, atol=1e-10 * np.abs(wanted.dv).max())
