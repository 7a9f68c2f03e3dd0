"""The judge of published files finds what is right, what is wrong, and what is not there."""

from __future__ import annotations

import argparse
from dataclasses import replace

import pinocchio as pin
import published_files
import pytest
from judges.files import compared
from shared import each_row

import condyn_pin as cp

INERTIA = '<inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0.01" ixz="0" iyz="0.02"/>'
LINK = f'<inertial><origin xyz="0.1 0 0.2" rpy="1 2 3"/><mass value="2"/>{INERTIA}</inertial>'
URDF = (
    f'<robot name="r"><link name="a"/><link name="b">{LINK}</link><link name="c">{LINK}</link>'
    '<joint name="j" type="revolute"><origin xyz="0 1 0" rpy="0.3 0 0"/><parent link="a"/>'
    '<child link="b"/><axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="1" velocity="1"/>'
    '<dynamics damping="0.5" friction="0.1"/></joint><joint name="k" type="prismatic"><parent '
    'link="b"/><child link="c"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
    '<mimic joint="j" multiplier="0.2"/></joint></robot>'
)
MOMENTS = "<ixx>0.1</ixx><iyy>0.2</iyy><izz>0.15</izz><ixy>0.01</ixy>"
BODY = f"<inertial><mass>2</mass><pose>0 0 .1 1 0 0</pose><inertia>{MOMENTS}</inertia></inertial>"
HINGE = "<axis><xyz>0 1 1</xyz><dynamics><damping>2</damping></dynamics>MIMIC</axis>"
SDF = (
    f'<sdf version="1.11"><model name="m"><pose>1 2 3 .1 .2 .3</pose><link name="a">{BODY}</link>'
    f'<link name="b"><pose degrees="true">0 1 0 30 20 10</pose>{BODY}</link><model name="n"><pose '
    f'relative_to="b">0 0 1 0 1 0</pose><link name="c">{BODY}</link></model><joint name="j" '
    f'type="revolute"><parent>a</parent><child>b</child>{HINGE}</joint><joint name="k" '
    'type="revolute"><pose>0 .1 0 1 0 0</pose><parent>b</parent><child>n::c</child>'
    f"{HINGE}</joint></model></sdf>"
)
SDF = SDF.replace("MIMIC", "", 1).replace(
    "MIMIC", '<mimic joint="j"><multiplier>2</multiplier><offset>1</offset></mimic>'
)
MJCF = (
    '<mujoco><worldbody><body><joint name="j" axis="0 1 0" damping="1"/><geom size="0.1" '
    'pos="1 0 0"/><body><joint name="k" axis="1 0 0"/><geom size="0.2" pos="0 1 0"/></body></body>'
    '</worldbody><equality><joint joint1="k" joint2="j" polycoef="0 2 0 0 0"/></equality></mujoco>'
)
TEXTS = {"r.urdf": URDF, "m.sdf": SDF, "m.xml": MJCF}


@pytest.mark.parametrize("name", TEXTS)
def test_what_a_file_says_agrees(tmp_path, name):
    path = tmp_path / name
    path.write_text(TEXTS[name])
    found = published_files.judged(path, None)
    assert (found.verdict, found.size) == ("agrees", (2, 1)), found
    assert found.worst is not None
    assert found.worst < 1e-10


@each_row("name", TEXTS)
def test_a_wrong_robot_is_found(tmp_path, name):
    path = tmp_path / name
    path.write_text(TEXTS[name])
    robot = cp.load_robot(path)
    model = robot.model.copy()
    model.inertias[2] = pin.Inertia(2.001, model.inertias[2].lever, model.inertias[2].inertia)
    assert compared(replace(robot, model=model), path, None)[2]
    assert any(said.startswith("J") for said in compared(replace(robot, loops=()), path, None)[2])


def test_what_is_not_there_is_missing_and_what_is_wrong_is_refused(tmp_path):
    first, *_ = published_files.sources()
    path = first.within(tmp_path)
    path.parent.mkdir(parents=True)
    path.write_text("<robot/>")
    rows = published_files.measure(argparse.Namespace(folder=tmp_path, only=""))["files"]
    assert rows[0]["verdict"] == "refused"
    assert {row["verdict"] for row in rows[1:]} == {"missing"}
    assert len(rows) >= 60
