"""A floating robot on the ground."""

from __future__ import annotations

import numpy as np
import pytest

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box, Plane
from condyn_pin.dynamics import contact_gaps
from condyn_pin.mechanism import place_on_ground


@pytest.mark.parametrize("name", ["solo12", "go2", "talos", "cassie"])
def test_the_lowest_foot_just_touches(name):
    robot = cp.load_robot(name)
    scene = cp.Scene(robot, robot.loops, robot.frictional_contacts(0.7))
    q, _ = scene.sample(np.random.default_rng(0))
    placed = place_on_ground(scene, q)
    assert min(contact_gaps(scene, placed).values()) == pytest.approx(0.0, abs=1e-10)
    assert np.array_equal(placed[3:], q[3:])  # only the place changes
    assert np.array_equal(placed[:2], q[:2])  # over a level floor


def test_a_ball_comes_to_rest_in_a_groove():
    walls = [Plane((1.0, 0.0, 1.0), -0.3), Plane((-1.0, 0.0, 1.0), -0.1)]
    scene = cp.Scene(cp.model.free_ball(radius=0.1), contacts=[
        cp.FrictionalContact("ball", Ball(0.1), on=wall, friction=0.5, name=f"wall {i}")
        for i, wall in enumerate(walls)
    ])  # fmt: skip
    q, _ = scene.state()
    q[2] = -3.0
    gaps = list(contact_gaps(scene, place_on_ground(scene, q)).values())
    assert min(gaps) == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize("seed", range(8))
def test_a_rail_on_the_floor_lifts_the_leg_that_stands_in_it(seed):
    """From above, and from within: the first foot touches, and none is in the rail."""
    solo, rng = cp.load_robot("solo12"), np.random.default_rng(seed)
    half = rng.uniform(0.01, 0.06), 1.0, rng.uniform(0.02, 0.06)
    robot = solo.with_frame("rail", "world", [rng.uniform(-0.3, 0.3), 0.0, 0.5 * half[2]])
    feet = robot.frictional_contacts(0.7)
    rails = [
        cp.FrictionalContact(
            foot.frame, foot.shape, foot.offset, on="rail", on_shape=Box(*half), friction=0.7,
            name=f"{foot.name} rail",
        )
        for foot in feet
    ]  # fmt: skip
    scene = cp.Scene(robot, contacts=[*feet, *rails])
    q = robot.postures["standing"].copy()
    q[2] += (seed % 2) * rng.uniform(-0.1, 0.5)
    placed = place_on_ground(scene, q)
    assert min(contact_gaps(scene, placed).values()) == pytest.approx(0.0, abs=1e-9)
    assert np.array_equal(placed[:2], q[:2])


@pytest.mark.long
def test_what_does_not_float_or_touch_stays():
    arm = cp.model.pendulum()
    q = np.array([0.3])
    assert np.array_equal(place_on_ground(cp.Scene(arm), q), q)
    ball = cp.model.free_ball()
    q = ball.postures["resting"]
    assert np.array_equal(place_on_ground(cp.Scene(ball), q), q)


@pytest.mark.long
def test_q_is_checked_and_kept():
    scene = cp.Scene(cp.model.free_ball(), contacts=[cp.FrictionalContact("ball", friction=0.5)])
    q, _ = scene.state()
    before = q.copy()
    assert place_on_ground(scene, q)[2] == pytest.approx(0.0)
    assert np.array_equal(q, before)
    with pytest.raises(cp.InvalidArgument, match="q"):
        place_on_ground(scene, q[:3])


@pytest.mark.long
def test_contacts_that_never_let_go_have_no_floor_to_be_put_on():
    solo = cp.load_robot("solo12")
    scene = cp.Scene(solo, solo.contacts)
    with pytest.raises(cp.InvalidArgument, match=r"contacts=robot.frictional_contacts"):
        place_on_ground(scene, scene.state()[0])


@pytest.mark.long
def test_a_wall_attracts_nothing_and_lets_nothing_in():
    ball = cp.model.free_ball(radius=0.1)
    on = {"floor": Plane(), "wall": Plane((1.0, 0.0, 0.0), 0.0)}
    scene = cp.Scene(ball, contacts=[
        cp.FrictionalContact("ball", Ball(0.1), on=plane, friction=0.5, name=name)
        for name, plane in on.items()
    ])  # fmt: skip
    q, _ = scene.state(on_ground=False)
    q[:3] = (0.2, 0.0, 1.0)
    assert place_on_ground(scene, q)[:3] == pytest.approx([0.2, 0.0, 0.1])
    q[:3] = (0.04, 0.0, 1.0)
    assert place_on_ground(scene, q)[:3] == pytest.approx([0.1, 0.0, 0.1])
    beside = cp.Scene(ball, contacts=scene.contacts[1:])
    q[:3] = (0.7, 0.0, 1.0)
    assert np.array_equal(place_on_ground(beside, q), q)


@pytest.mark.long
def test_another_body_in_the_air_does_not_move_the_base():
    two = cp.model.together({"a": cp.model.free_ball(), "b": cp.model.free_ball()})
    scene = cp.Scene(two, contacts=[
        cp.FrictionalContact(f"{name}/ball", Ball(0.05), friction=0.5) for name in "ab"
    ])  # fmt: skip
    q, _ = scene.state(on_ground=False)
    q[2], q[9] = 0.4, 0.2
    placed = place_on_ground(scene, q)
    assert placed[2] == pytest.approx(0.05)
    assert np.array_equal(placed[7:], q[7:])


def test_a_state_without_a_name_is_on_the_ground_and_a_named_one_as_described():
    solo = cp.load_robot("solo12")
    scene = cp.Scene(solo, contacts=solo.frictional_contacts(0.7))
    q, v = scene.state()
    assert min(contact_gaps(scene, q).values()) == pytest.approx(0.0, abs=1e-10)
    assert np.array_equal(q, scene.state("standing", on_ground=True)[0])
    for described in (scene.state("standing"), scene.state(on_ground=False)):
        assert np.array_equal(described[0], solo.postures["standing"])
    assert not v.any()
    held = cp.Scene(solo, solo.contacts)
    assert np.array_equal(held.state()[0], solo.postures["standing"])
    with pytest.raises(cp.InvalidArgument, match=r"contacts=robot.frictional_contacts"):
        held.state(on_ground=True)


def test_a_base_that_is_tied_to_a_place_stays_there():
    ball = cp.model.free_ball(radius=0.05).with_frame("hook", "world", [0.0, 0.0, 1.0])
    hung = cp.Scene(
        ball,
        [cp.Loop("ball", "hook", "rod", length=0.3)],
        contacts=[cp.FrictionalContact("ball", Ball(0.05), friction=0.5, name="floor")],
    )
    q, _ = hung.state()
    assert hung.check(q).closed
    assert contact_gaps(hung, q)["floor"] > 0.1
    with pytest.raises(cp.InvalidArgument, match="ball~hook ties the base to a place"):
        place_on_ground(hung, q)
    with pytest.raises(cp.InvalidArgument, match="ball~hook ties"):
        hung.state(on_ground=True)
    with pytest.raises(cp.InvalidArgument, match="on_ground = 'yes': True, False or None"):
        hung.state(on_ground="yes")


@pytest.mark.long
def test_walls_too_near_each_other_do_not_move_it():
    """A ball of 20 cm in a slot of 10 cm: out of either wall it is in the other."""
    walls = {"left": Plane((1.0, 0.0, 0.0), -0.05), "right": Plane((-1.0, 0.0, 0.0), -0.05)}
    touches = [
        cp.FrictionalContact("ball", Ball(0.1), on=on, friction=0.5, name=name)
        for name, on in (walls | {"floor": Plane()}).items()
    ]
    scene = cp.Scene(cp.model.free_ball(radius=0.1), contacts=touches)
    q, _ = scene.state()
    assert q[:3] == pytest.approx([0.0, 0.0, 0.1], abs=1e-12)
