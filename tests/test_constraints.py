"""Constraints as values, and how they are bound to a robot."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from shared import robot

import condyn_pin as cp


@pytest.mark.long
def test_names_and_rows():
    assert (cp.PointContact("a").name, cp.PointContact("a").rows) == ("a", 3)
    assert (cp.SurfaceContact("a", name="b").name, cp.SurfaceContact("a").rows) == ("b", 6)
    assert (cp.Loop("a", "b").name, cp.Loop("a", "b").rows) == ("a~b", 3)
    assert cp.Loop("a", "b", "weld").rows == 6


@pytest.mark.parametrize(
    "constraint",
    [
        cp.PointContact("a", offset=[1, 2, 3], anchor=np.zeros(3)),
        cp.SurfaceContact("a", half_length=0.1, half_width=0.2, anchor=pin.SE3.Identity()),
        cp.Loop("a", "b", "weld", name="c"),
    ],
)
def test_constraints_are_values(constraint):
    copy = pickle.loads(pickle.dumps(constraint))
    assert copy == constraint
    assert hash(copy) == hash(constraint)
    with pytest.raises(AttributeError):
        constraint.name = "other"


@pytest.mark.long
def test_anchor_of_a_surface_is_normalised():
    anchor = cp.SurfaceContact("a", anchor=(1, 2, 3, 0, 0, 0, 2)).anchor
    assert anchor == (1, 2, 3, 0, 0, 0, 1)


@pytest.mark.long
def test_corners_are_on_the_edge_of_the_surface():
    left = robot("talos").contacts[0]
    corners = left.corners()
    assert {corner.name.split("/")[1] for corner in corners} == {
        "front_left", "front_right", "back_left", "back_right",
    }  # fmt: skip
    for corner in corners:
        assert corner.frame == left.frame
        assert np.abs(corner.offset).tolist() == [left.half_length, left.half_width, 0.0]


@pytest.mark.parametrize("distance", [0.0, 0.03])
def test_an_anchored_contact_reports_its_distance(distance):
    """The one without an anchor belongs where it is."""
    solo = replace(robot("solo12"), precision=0.0)  # what is far from closed is not doubted
    q, v = solo.postures["standing"], np.zeros(solo.nv)
    joint, placement = solo.frame("FL_FOOT")
    data = solo.model.createData()
    pin.forwardKinematics(solo.model, data, q)
    here = data.oMi[joint] * placement
    anchor = here.translation + np.array([0.0, 0.0, distance])
    held = cp.solve(cp.Scene(solo, [cp.PointContact("FL_FOOT", anchor=anchor)]), q, v, v)
    free = cp.solve(cp.Scene(solo, [cp.PointContact("FL_FOOT")]), q, v, v)
    gap = cp.Workspace(held.scene).violation(q)
    assert np.linalg.norm(gap) == pytest.approx(distance, abs=1e-12)
    assert held.state_error.position == np.abs(gap).max()
    assert free.state_error.position == 0.0
    assert np.abs(held.a - free.a).max() < 1e-9  # not pulled: there is no drift control here
    there = pin.SE3(here.rotation, anchor)
    surface = cp.solve(cp.Scene(solo, [cp.SurfaceContact("FL_FOOT", anchor=there)]), q, v, v)
    gap = cp.Workspace(surface.scene).violation(q)
    assert np.linalg.norm(gap) == pytest.approx(distance, abs=1e-12)


def test_an_anchored_contact_is_assembled_to_its_anchor():
    solo = robot("solo12")
    scene = cp.Scene(solo, [cp.PointContact("FL_FOOT", anchor=(0.2, 0.15, 0.01))])
    q, v = scene.state("standing")
    assert cp.solve(scene, q, v, v).state_error.position < 1e-10
    joint, placement = solo.frame("FL_FOOT")
    data = solo.model.createData()
    pin.forwardKinematics(solo.model, data, q)
    assert np.allclose((data.oMi[joint] * placement).translation, (0.2, 0.15, 0.01), atol=1e-10)


def test_corners_of_an_anchored_surface_are_anchored_at_its_corners():
    pose = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([1.0, 2.0, 3.0]))
    surface = cp.SurfaceContact("a", half_length=0.1, half_width=0.05, anchor=pose)
    for corner in surface.corners():
        assert np.allclose(corner.anchor, pose.act(np.array(corner.offset)), atol=1e-15)
