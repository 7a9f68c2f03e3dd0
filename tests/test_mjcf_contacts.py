"""Contacts and shapes in an MJCF: what MuJoCo does with them is what they say."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import condyn_pin as cp
from condyn_pin.constraints import (
    Ball,
    Box,
    Capsule,
    Contact,
    Convex,
    Cylinder,
    Ellipsoid,
    JointFriction,
    JointLimit,
    Plane,
)

CORNERS = tuple(product((-0.1, 0.1), (-0.1, 0.1), (-0.1, 0.1)))


def made(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def after(text: str, seconds: float, q=None) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model, data = made(text)
    if q is not None:
        data.qpos[:] = q
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return model, data


def on_the_floor(shape, friction: float = 0.5, **more) -> str:
    robot = cp.model.free_ball(radius=0.1)
    contact = cp.FrictionalContact("ball", shape, friction=friction, **more)
    return robot.to_mjcf(contacts=[contact])


@pytest.mark.parametrize(
    ("shape", "height"),
    [
        (Ball(0.1), 0.1),
        (Box(0.1, 0.1, 0.2), 0.2),
        (Capsule(0.1, 0.2), 0.1),
        (Convex(CORNERS), 0.1),
        (Cylinder(0.2, 0.1), 0.1),
        (Ellipsoid(0.3, 0.3, 0.1), 0.1),
    ],
)
def test_a_shape_comes_to_rest_at_its_height(shape, height):
    start = [0.0, 0.0, height + 0.05, 1.0, 0.0, 0.0, 0.0]
    if isinstance(shape, Capsule):
        start[3:] = [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]  # it lies
    model, data = after(on_the_floor(shape), 1.0, start)
    assert data.qpos[2] == pytest.approx(height, abs=2e-3)  # MuJoCo's floor is soft
    force = np.zeros(6)
    total = 0.0
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, force)
        total += force[0]
    assert total == pytest.approx(9.81 * model.body_mass.sum(), rel=1e-2)


@pytest.mark.parametrize(("friction", "moves"), [(0.7, False), (0.3, True), (0.0, True)])
def test_friction_is_that_of_the_contact(friction, moves):
    """A slope of 25 degrees: tan is 0.466."""
    tilt = np.deg2rad(25.0)
    slope = Plane((np.sin(tilt), 0.0, np.cos(tilt)))
    start = np.zeros(7)
    start[[0, 2]] = 0.1 * np.sin(tilt), 0.1 * np.cos(tilt)
    start[3:] = np.cos(tilt / 2), 0.0, np.sin(tilt / 2), 0.0
    text = on_the_floor(Box(0.1, 0.1, 0.1), friction, on=slope)
    _, data = after(text, 1.0, start)
    slid = np.hypot(*(data.qpos[[0, 2]] - start[[0, 2]]))
    if moves:
        exact = 0.5 * 9.81 * (np.sin(tilt) - friction * np.cos(tilt))
        assert slid == pytest.approx(exact, rel=0.02)
    else:
        assert slid < 5e-3


@pytest.mark.long
def test_nothing_else_collides():
    """Two balls in one place, each with a contact with the floor alone."""
    contacts = [cp.FrictionalContact(f"{n}/ball", Ball(0.1), friction=0.5) for n in "ab"]
    two = cp.model.together(dict.fromkeys("ab", cp.model.free_ball(radius=0.1)))
    model, data = made(two.to_mjcf(contacts=contacts))
    data.qpos[:] = [0.0, 0.0, 0.099, 1.0, 0.0, 0.0, 0.0] * 2
    mujoco.mj_forward(model, data)
    assert data.ncon == len(contacts) > 1


@pytest.mark.long
def test_solo_stands_on_its_feet():
    solo = cp.load_robot("solo12")
    feet = solo.frictional_contacts(friction=0.7)
    scene = cp.Scene(solo, contacts=feet)
    q = cp.mechanism.place_on_ground(scene, scene.state()[0])
    model, data = made(solo.to_mjcf(contacts=feet, shapes=True))
    assert model.npair == 4
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[2] = q[2] + 1e-4  # points are balls of 0.1 mm
    stand = data.qpos[7:].copy()
    for _ in range(500):
        motors = 20.0 * (stand - data.qpos[7:]) - 0.5 * data.qvel[6:]
        data.ctrl[:] = motors[[model.joint(name).dofadr[0] - 6 for name in solo.actuated]]
        mujoco.mj_step(model, data)
    assert data.qpos[2] > 0.8 * q[2]
    assert data.ncon == 4


def test_bodies_touch_each_other():
    """A ball rests on another, which is held by the floor's friction and the ball's own weight."""
    two = cp.model.together(dict.fromkeys("ab", cp.model.free_ball(radius=0.1)))
    contacts = [
        cp.FrictionalContact("a/ball", Ball(0.1), friction=0.5),
        cp.FrictionalContact("b/ball", Ball(0.1), on="a/ball", on_shape=Ball(0.1), friction=0.5),
    ]
    start = [0.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]
    _, data = after(two.to_mjcf(contacts=contacts), 0.2, start)
    assert data.qpos[9] == pytest.approx(0.3, abs=3e-3)


def test_dry_friction_and_limits_are_those_of_joints():
    bar = cp.load_robot("panda")
    joint = bar.joints[0]
    model, _ = made(bar.to_mjcf(contacts=[JointFriction(joint, 1.5), JointLimit(joint)]))
    assert model.joint(joint).frictionloss[0] == 1.5
    assert model.joint(joint).limited[0]


@pytest.mark.long
def test_shapes_are_drawn_and_weigh_nothing():
    solo = cp.load_robot("solo12")
    plain, _ = made(solo.to_mjcf())
    drawn, _ = made(solo.to_mjcf(shapes=True))
    assert plain.ngeom == 0
    assert drawn.ngeom == 17
    assert not drawn.geom_contype.any()
    assert np.allclose(drawn.body_mass, plain.body_mass, rtol=1e-12)
    assert np.allclose(drawn.body_inertia, plain.body_inertia, rtol=1e-9)
    assert drawn.nmesh < drawn.ngeom  # a mesh is in the file once


@pytest.mark.long
def test_drawn_shapes_are_where_the_description_has_them():
    """The corners of a mesh, in the world, in both."""
    from condyn_pin.io.shapes import shapes_of

    solo = cp.load_robot("solo12")
    model, data = made(solo.to_mjcf(shapes=True))
    q = np.array(pin.neutral(solo.model))
    mujoco.mj_forward(model, data)
    shapes, _ = shapes_of(solo.description)
    boxes = []
    for shape in shapes:
        T = solo.frame_pose(q, shape.link).homogeneous
        points = shape.mesh().moved(T).vertices
        boxes.append([points.min(axis=0), points.max(axis=0)])
    found = []
    for g in range(model.ngeom):
        m = model.geom_dataid[g]
        first, count = model.mesh_vertadr[m], model.mesh_vertnum[m]
        R = data.geom_xmat[g].reshape(3, 3)
        points = model.mesh_vert[first : first + count] @ R.T + data.geom_xpos[g]
        found.append([points.min(axis=0), points.max(axis=0)])
    key = lambda b: tuple(np.round(np.ravel(b), 4))  # noqa: E731
    assert np.allclose(sorted(boxes, key=key), sorted(found, key=key), atol=1e-5)


@pytest.mark.long
def test_such_a_file_reads_back(tmp_path):
    cassie = cp.load_robot("cassie")
    path = tmp_path / "cassie.xml"
    feet = cassie.frictional_contacts(friction=0.7)
    path.write_text(cassie.to_mjcf(contacts=feet, shapes=True), encoding="utf-8")
    again = cp.load_robot(path)
    assert again.loops == cassie.loops
    assert again.nv == cassie.nv
    assert np.isclose(again.mass, cassie.mass, rtol=1e-12)


@dataclass(frozen=True)
class Glue(Contact):
    """A kind that MuJoCo knows nothing of."""

    def bind(self, machine):
        return cp.FrictionalContact("ball", friction=1.0).bind(machine)

    def held(self, modes):
        return ()


def test_what_mujoco_has_not_is_named():
    ball = cp.model.free_ball(radius=0.1)
    bouncing = cp.FrictionalContact("ball", Ball(0.1), friction=0.5, restitution=0.8)
    with pytest.raises(cp.errors.InvalidModel, match=r"'ball' has restitution = 0.8.*replace"):
        ball.to_mjcf(contacts=[bouncing])
    assert "pair" in ball.to_mjcf(contacts=[replace(bouncing, restitution=0.0)])
    with pytest.raises(cp.errors.InvalidModel, match="'glue' is a Glue"):
        ball.to_mjcf(contacts=[Glue(name="glue")])
    with pytest.raises(cp.InvalidArgument, match="contacts = "):
        ball.to_mjcf(contacts=3)
    with pytest.raises(cp.errors.InvalidConstraint, match="is needed"):
        ball.to_mjcf(contacts=[cp.PointContact("ball")])
    with pytest.raises(cp.errors.UnknownName, match="bal"):
        ball.to_mjcf(contacts=[cp.FrictionalContact("bal", friction=0.5)])


def test_a_plane_that_moves_is_refused():
    two = cp.model.together(dict.fromkeys("ab", cp.model.free_ball(radius=0.1)))
    floor = {"on": "b/ball", "on_shape": Plane()}
    carried = cp.FrictionalContact("a/ball", Ball(0.1), **floor, friction=0.5)
    with pytest.raises(cp.errors.InvalidModel, match=r"plane on a moving body.*Box"):
        two.to_mjcf(contacts=[carried])


def test_a_mesh_that_is_missing_is_named(tmp_path):
    robot = cp.load_robot("solo12")
    path = tmp_path / "lost.urdf"
    with open(robot.description, encoding="utf-8") as file:
        path.write_text(file.read())
    lost = cp.load_robot(path)
    assert lost.to_mjcf()
    with pytest.raises(cp.errors.InvalidModel, match=r"no file .*shapes=False"):
        lost.to_mjcf(shapes=True)
