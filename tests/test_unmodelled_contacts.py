"""What a scene leaves out of the robot's file, and a motion reaches: shapes, and stops."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from shared import each_row

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box, JointLimit, Plane
from condyn_pin.io.shapes import shapes_of

INERTIAL = """<inertial><mass value="2"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0"
iyz="0"/></inertial>"""

# A crate that falls, and a probe beside it with the only contact of the scenes below.
FALLING = """<robot name="falling"><link name="base"/>
<link name="crate">{inertial}<collision><origin xyz="0 0 .02" rpy="{turn} 0 0"/><geometry>
{shape}</geometry></collision></link><link name="probe">{inertial}</link>
<joint name="fall" type="prismatic"><parent link="base"/><child link="crate"/><axis xyz="0 0 1"/>
<origin xyz="0 0 0.4"/><limit lower="-2" upper="2" effort="1" velocity="9"/></joint>
<joint name="stand" type="prismatic"><parent link="base"/><child link="probe"/><axis xyz="0 0 1"/>
<origin xyz="1 0 0"/><limit lower="-0.2" upper="2" effort="1" velocity="9"/></joint></robot>"""

BOX = '<box size="0.3 0.2 0.1"/>'


def falling(folder, shape=BOX, turn=0.0):
    path = folder / "falling.urdf"
    path.write_text(FALLING.format(inertial=INERTIAL, shape=shape, turn=turn))
    return cp.load_robot(path)


def dropped(robot, *contacts, duration=0.4, on=None):
    probe = cp.FrictionalContact("probe", on=on or Plane(), friction=0.4)
    scene = cp.Scene(robot, contacts=[probe, *contacts])
    return cp.simulate(scene, np.zeros(2), np.zeros(2), duration=duration, dt=1e-3)


@each_row(
    ("shape", "turn", "lowest"),
    [
        (BOX, 0.0, 0.05),
        (BOX, 0.3, 0.05 * np.cos(0.3) + 0.1 * np.sin(0.3)),
        ('<sphere radius="0.06"/>', 0.0, 0.06),
        ('<cylinder radius="0.05" length="0.16"/>', 0.0, 0.08),
    ],
)
def test_a_body_that_falls_through_the_floor_is_told_with_time_and_depth(
    tmp_path, shape, turn, lowest
):
    run = dropped(falling(tmp_path, shape, turn))
    (said,) = run.notices
    assert said.startswith("crate (a ")
    assert "in the ground z = 0 m from t = " in said
    deepest = -(0.4 + run.q[:, 0].min() + 0.02 - lowest)
    found = re.search(r"([\d.]+) mm deep at t = 0.4 s", said)
    assert float(found[1]) == pytest.approx(1e3 * deepest, rel=6e-3)
    first = float(re.search(r"from t = ([\d.]+) s", said)[1])
    meets = np.sqrt(2 * (0.42 - lowest) / 9.81)
    assert meets - 2e-3 < first < meets + 2 * 0.4 / 100


@pytest.mark.long
def test_the_line_of_the_notice_adds_what_was_missing(tmp_path):
    robot = falling(tmp_path)
    (said,) = dropped(robot).notices
    line = re.search(r"\*(robot\.collisions\(.*?\))\]\) adds its shapes", said)[1]
    (contact,) = eval(line, {"robot": robot})
    assert (contact.friction, contact.shape) == (0.4, Box(0.15, 0.1, 0.05))
    run = dropped(robot, contact)
    (said,) = run.notices  # four corners carry it
    assert said.endswith("the contacts are redundant: lam is one of many")
    assert 0.4 + run.q[-1, 0] - 0.03 == pytest.approx(0.0, abs=1e-6)


@pytest.mark.long
def test_other_planes_are_named_and_what_no_contact_touches_is_no_ground(tmp_path):
    robot = falling(tmp_path)
    assert dropped(robot, duration=0.2).notices == ()  # still above
    level = dropped(robot, on=Plane((0.0, 0.0, 1.0), -0.1), duration=0.4).notices
    (said,) = [each for each in level if each.startswith("crate")]
    assert "in the ground z = -0.1 m" in said
    assert 'friction=0.4, ground=Plane(height=-0.1), shapes=["crate"])' in said
    tilted = Plane((0.0, 0.6, 0.8), -0.2)
    (said,) = [each for each in dropped(robot, on=tilted).notices if each.startswith("crate")]
    assert "(0, 0.6, 0.8) . x = -0.2 m" in said
    assert 'friction=0.4, ground=Plane((0, 0.6, 0.8), -0.2), shapes=["crate"])' in said
    bare = cp.Scene(robot, contacts=[JointLimit("stand")])
    assert cp.simulate(bare, np.zeros(2), np.zeros(2), duration=0.4).notices == ()


@each_row("name", ["go2", "solo12", "cassie", "talos", "anymal_c"])
def test_robots_on_their_feet_have_nothing_in_the_ground(name):
    robot = cp.load_robot(name)
    scene = cp.Scene(robot, robot.loops, contacts=robot.frictional_contacts(0.7))
    run = cp.simulate(scene, *scene.state(), duration=2e-3, dt=1e-3)
    assert not [said for said in run.notices if "in the ground" in said]


def test_a_joint_without_a_stop_is_told_and_the_line_adds_it(tmp_path):
    robot = falling(tmp_path)
    scene = cp.Scene(robot)
    q, v = np.array([1.0, 0.0]), np.zeros(2)
    (said,) = cp.simulate(scene, q, v, duration=0.3).notices
    assert said.startswith("stand is 241 mm beyond its limits, and the scene has no stops there")
    assert "robot.limits()" in said
    stopped = cp.Scene(robot, contacts=robot.limits())
    assert [each.joint for each in robot.limits()] == ["fall", "stand"]
    assert cp.simulate(stopped, q, v, duration=0.3).notices == ()
    one = cp.Scene(robot, contacts=[JointLimit("stand")])
    soft = cp.simulate(one, q, v, duration=0.3, dt=2e-2, integrator=cp.Moreau())
    assert not [said for said in soft.notices if "no stops" in said]


def test_collision_shapes_of_an_sdf_and_an_mjcf_are_read(tmp_path):
    sdf = tmp_path / "one.sdf"
    sdf.write_text(
        """<sdf version="1.7"><model name="m"><link name="a"><visual name="v"><geometry><sphere>
        <radius>1</radius></sphere></geometry></visual><collision name="c"><pose>0 0 1 0 0 0</pose>
        <geometry><box><size>1 2 3</size></box></geometry></collision></link></model></sdf>"""
    )
    (shape,), missing = shapes_of(str(sdf), "collision")
    assert (shape.link, shape.kind, shape.size, missing) == ("a", "box", (1.0, 2.0, 3.0), ())
    mjcf = tmp_path / "one.xml"
    mjcf.write_text(
        """<mujoco><worldbody><body name="a"><freejoint/><geom size="0.1" group="3"/>
        <geom type="box" size="1 1 1" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""
    )
    assert [shape.kind for shape in shapes_of(str(mjcf), "collision")[0]] == ["sphere"]
    assert [shape.kind for shape in shapes_of(str(mjcf))[0]] == ["box"]
    run = cp.simulate(
        cp.Scene(
            cp.load_robot(mjcf),
            contacts=[cp.FrictionalContact("a", Ball(0.01), offset=(0, 0, 0.1), friction=0.5)],
        ),
        np.array([0, 0, 0.2, 0, 0, 0, 1.0]), np.zeros(6), duration=0.3,
    )  # fmt: skip
    assert any(said.startswith("a (a sphere in the file) is in the ground") for said in run.notices)


def test_a_body_that_the_file_lets_through_the_ground_is_not_told(tmp_path):
    robot = falling(tmp_path)
    apart = replace(robot, exclusions=[("universe", "crate")])
    assert dropped(robot).notices
    assert dropped(apart).notices == ()
    assert dropped(replace(robot, exclusions=[("probe", "crate")])).notices
