"""Joints that close loops, whole: every answer is that of the machine, whichever joint is cut."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from sdf_texts import cassie_file

import condyn_pin as cp
from condyn_pin.constraints import Driven, HeldJoint, JointFriction, JointLimit, Polynomial
from condyn_pin.errors import InvalidArgument, InvalidModel, UnknownName
from condyn_pin.io.sdf import read_sdf
from condyn_pin.simulation import DormandPrince
from condyn_pin.stepping import EventDriven

SAME = 1e-10  # of answers by different cuts, relative
MODEL = "expressed_in='__model__'"


def link(name: str, at: str, mass: float = 1.0) -> str:
    return (
        f"<link name='{name}'><pose>{at} 0.1 0.2 0.3</pose><inertial><pose>0.05 0.02 -0.03 0 0 0"
        f"</pose><mass>{mass}</mass><inertia><ixx>0.02</ixx><iyy>0.03</iyy><izz>0.025</izz>"
        "<ixy>0.001</ixy><ixz>0</ixz><iyz>0.002</iyz></inertia></inertial></link>"
    )


def joint(name: str, kind: str, ends: str, at: str, axis: str = "", inside: str = "") -> str:
    parent, child = ends.split()
    turns = f"<axis><xyz {MODEL}>{axis}</xyz>{inside}</axis>" if axis else ""
    return (
        f"<joint name='{name}' type='{kind}'><pose relative_to='__model__'>{at} 0 0 0</pose>"
        f"<parent>{parent}</parent><child>{child}</child>{turns}</joint>"
    )


def settings(stiffness: float, damping: float, friction: float, reference: float) -> str:
    return (
        "<limit><lower>-2</lower><upper>2</upper></limit><dynamics>"
        f"<damping>{damping}</damping><friction>{friction}</friction><spring_stiffness>{stiffness}"
        f"</spring_stiffness><spring_reference>{reference}</spring_reference></dynamics>"
    )


# Joints that a loop in space and one in a plane are made of, each with all that acts in a joint.
IN_SPACE = (
    link("one", "0.05 0 0.2") + link("two", "0.4 0.1 0.5") + link("three", "0.8 0.1 0.4")
    + link("four", "0.9 0.05 0.1", 0.5)
    + joint("A", "revolute", "world one", "0 0 0", "0 1 0.2", settings(3, 0.2, 0.3, 0.1))
    + joint("B", "revolute", "one two", "0.1 0.05 0.4", "0.1 1 0", settings(2, 0.1, 0.2, -0.1))
    + joint("S", "ball", "two three", "0.7 0.2 0.6")
    + joint("P", "prismatic", "four three", "0.9 0 0.1", "0 0.1 1", settings(40, 2, 0.5, 0.05))
    + joint("R", "revolute", "world four", "0.9 0 0.1", "0.2 1 0.1", settings(1, 0.05, 0.1, 0.2))
)  # fmt: skip
IN_PLANE = (
    link("one", "0.05 0 0.2") + link("two", "0.4 0 0.5") + link("three", "0.8 0 0.3")
    + joint("A", "revolute", "world one", "0 0 0", "0 1 0", settings(3, 0.2, 0.3, 0.1))
    + joint("B", "revolute", "one two", "0.1 0 0.4", "0 1 0", settings(2, 0.1, 0.2, -0.1))
    + joint("C", "revolute", "two three", "0.7 0 0.6", "0 1 0", settings(4, 0.3, 0.2, 0.3))
    + joint("R", "revolute", "world three", "0.9 0 0", "0 1 0", settings(1, 0.05, 0.1, 0.2))
)  # fmt: skip
ROTORS = {"A": 0.05, "B": 0.02, "C": 0.01, "P": 0.7, "R": 0.03}  # [kg m^2, kg]


class Cut(NamedTuple):
    """A machine, cut at one of its joints."""

    robot: cp.Robot
    reversed: tuple[str, ...]

    @property
    def scene(self) -> cp.Scene:
        return cp.Scene(self.robot, self.robot.loops)


def cut_at(folder: Path, body: str, *joints: str) -> Cut:
    path = folder / "machine.sdf"
    path.write_text(f"<sdf version='1.9'><model name='machine'>{body}</model></sdf>")
    description = read_sdf(path, cut=joints)
    robot = description.robot(name="machine", precision=0.0)
    return Cut(with_rotors(robot, ROTORS), description.reversed)


def with_rotors(robot: cp.Robot, rotors: dict[str, float]) -> cp.Robot:
    model = pin.Model(robot.model)
    for name in set(rotors) & set(robot.joints):
        model.armature[robot.index_v(name)] = rotors[name]
    return replace(robot, model=model)


def bodies(robot: cp.Robot) -> list[str]:
    return [f.name for f in robot.model.frames if f.type == pin.FrameType.BODY and f.parentJoint]


def twists(robot: cp.Robot, q: np.ndarray, v: np.ndarray, a: np.ndarray, of: str) -> np.ndarray:
    """Velocities, or accelerations, of all bodies, in their own axes."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q, v, a)
    pin.updateFramePlacements(robot.model, data)
    found = getattr(pin, f"getFrame{of}")
    numbers = [robot.model.getFrameId(name) for name in bodies(robot)]
    order = np.argsort(bodies(robot))
    return np.array([found(robot.model, data, i).vector for i in numbers])[order]


def carried(of: Cut, q: np.ndarray, v: np.ndarray, to: Cut) -> tuple[np.ndarray, np.ndarray]:
    """The same positions and velocities of all bodies, in the coordinates of another cut."""
    values = {}
    for name, value in of.robot.joint_values(q).items():
        if np.ndim(value) and (name in of.reversed) != (name in to.reversed):
            value = value * [-1, -1, -1, 1]
        values[name] = value
    start = np.array(pin.neutral(to.robot.model))
    q_to = to.robot.configuration(
        {name: values[name] for name in to.robot.joints if name in values}, start=start
    )
    still = np.zeros(to.robot.nv)
    columns = [twists(to.robot, q_to, e, still, "Velocity").ravel() for e in np.eye(to.robot.nv)]
    rows = np.vstack([np.transpose(columns), cp.Workspace(to.scene).jacobian(q_to)])
    wanted = np.zeros(len(rows))
    wanted[: 6 * len(bodies(to.robot))] = twists(of.robot, q, v, 0 * v, "Velocity").ravel()
    v_to, *_ = np.linalg.lstsq(rows, wanted)
    np.testing.assert_allclose(rows @ v_to, wanted, atol=1e-12)
    return q_to, v_to


def bearings(cut: Cut, answer: cp.Solution, names: list[str]) -> np.ndarray:
    """Wrenches in joints about the origin of the world, on the child of the file."""
    found = []
    for name in names:
        bearing = answer.bearings()[name]
        force, moment = bearing.in_world().reshape(2, 3)
        sign = -1.0 if name in cut.reversed else 1.0
        found.append(sign * np.concatenate((force, moment + np.cross(bearing.at, force))))
    return np.array(found)


def assert_same(found: np.ndarray, wanted: np.ndarray, atol: float = SAME) -> None:
    np.testing.assert_allclose(found, wanted, rtol=0, atol=atol * max(1, np.abs(wanted).max()))


def moved(cut: Cut, joints: dict[str, float], rates: dict[str, float]) -> tuple:
    """State of a cut with all joints in its tree, some joints moved and with rates."""
    scene, robot = cut.scene, cut.robot
    q = scene.assemble(robot.configuration(joints, start=scene.state()[0]), fixed=[*joints]).q
    return q, cp.mechanism.project_velocity(scene, q, robot.joint_vector(rates))


@pytest.mark.parametrize(
    ("body", "cuts", "rows"),
    [(IN_SPACE, "ABPRS", [0, 1, 2, 3, 4, 5]), (IN_PLANE, "ABCR", [0, 2, 4])],
    ids=["in space", "in the plane"],
)
def test_an_instant_is_that_of_the_machine(tmp_path, body, cuts, rows):
    first = cut_at(tmp_path, body, cuts[0])
    q0, v0 = moved(first, {"A": 0.4}, {"A": 1.5})
    names = [name for name in cuts if name in first.robot.joints]
    wanted: list[np.ndarray] = []
    for name in cuts:
        cut = cut_at(tmp_path, body, name)
        robot = cut.robot
        q, v = carried(first, q0, v0, cut)
        tau = robot.passive_torque(q, v) + robot.joint_vector({"B": 2.0})
        answer = cp.solve(cut.scene, q, v, tau)
        assert answer.status.ok
        found = [
            twists(robot, q, v, answer.a, "Acceleration"),
            bearings(cut, answer, names)[:, rows],
            np.array([answer.a[robot.index_v(each)] for each in names if each != "S"]),
            np.array([answer.bearings()[each].drive for each in names if each != "S"]),
        ]
        wanted = wanted or found
        for one, other in zip(found, wanted, strict=True):
            assert_same(one, other)


@pytest.mark.parametrize(("body", "cuts"), [(IN_SPACE, "ABPRS"), (IN_PLANE, "ABCR")])
def test_a_motion_is_that_of_the_machine(tmp_path, body, cuts):
    tolerances = DormandPrince(relative_tolerance=1e-13, absolute_tolerance=1e-13)
    first = cut_at(tmp_path, body, cuts[0])
    q0, v0 = moved(first, {"A": 0.2}, {"A": 1.0})
    ends = []
    for name in cuts:
        cut = cut_at(tmp_path, body, name)
        q, v = carried(first, q0, v0, cut)
        run = cp.simulate(cut.scene, q, v, duration=0.5, dt=2e-3, integrator=tolerances)
        assert np.abs(run.energy.error).max() < 1e-9  # springs, dampers and rotors in all joints
        ends.append(twists(cut.robot, run.q[-1], run.v[-1], 0 * v, "Velocity"))
    for end in ends[1:]:
        assert_same(end, ends[0])


def test_stops_and_dry_friction_are_those_of_the_machine(tmp_path):
    first = cut_at(tmp_path, IN_SPACE, "A")
    q0, v0 = moved(first, {"A": 0.2}, {"A": 1.0})
    for name in "ABPRS":
        cut = cut_at(tmp_path, IN_SPACE, name)
        robot = cut.robot.with_limits({"P": (-0.02, 0.45)})
        contacts = [JointLimit("P"), JointFriction("R", torque=0.3)]
        scene = cp.Scene(robot, robot.loops, contacts=contacts)
        q, v = carried(first, q0, v0, cut)
        run = cp.simulate(scene, q, v, duration=0.6, dt=1e-3, integrator=EventDriven())
        happened = [(each.name, each.t) for each in run.run.happened]
        end = np.concatenate([run.joint_values(-1)]) if False else run.v[-1]
        print(name, happened, end)
