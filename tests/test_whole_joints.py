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
    fine = DormandPrince(relative_tolerance=1e-12, absolute_tolerance=1e-12)
    first = cut_at(tmp_path, IN_SPACE, "A")
    q0, v0 = moved(first, {"A": 0.2}, {"A": 1.0})
    found = []
    for name in "APRS":
        cut = cut_at(tmp_path, IN_SPACE, name)
        robot = cut.robot.with_limits({"P": (0.1, 0.45)})
        contacts = [JointLimit("P"), JointFriction("R", torque=0.05)]
        scene = cp.Scene(robot, robot.loops, contacts=contacts)
        q, v = carried(first, q0, v0, cut)
        run = cp.simulate(scene, q, v, duration=0.24, dt=0.02, integrator=EventDriven(fine))
        slid, struck = run.run.happened
        assert (slid.name, struck.name) == ("reversal of R/friction", "impact of P/lower")
        ends = [run.q[-1, robot.index_q(each)] for each in "APR"]
        found.append([slid.t, struck.t, *ends, dict(struck.impulses)["P/lower"]])
    assert found[0][3] == pytest.approx(0.1, abs=1e-12)  # P is on its stop
    for other in found[1:]:
        assert_same(np.array(other), np.array(found[0]))


def stewart() -> str:
    """A platform on six legs: universal joints, sliders with springs, and balls."""
    body = link("platform", "0 0 0.6", 5.0)
    for k in range(6):
        third, side = 2 * math.pi / 3 * (k // 2), (-1) ** (k + 1)
        foot = 0.5 * np.array([math.cos(third + 0.25 * side), math.sin(third + 0.25 * side), 0])
        angle = third + side * (math.pi / 3 - 0.25)
        head = np.array([0.3 * math.cos(angle), 0.3 * math.sin(angle), 0.6])
        along = (head - foot) / np.linalg.norm(head - foot)
        level = np.cross([0, 0, 1], along)
        at = [" ".join(f"{x!r}" for x in y.tolist()) for y in (foot, head, along, level)]
        other = " ".join(f"{x!r}" for x in np.cross(along, level).tolist())
        body += link(f"cylinder{k}", at[0]) + link(f"piston{k}", at[1], 0.5)
        body += joint(f"swing{k}", "universal", f"world cylinder{k}", at[0], at[3]).replace(
            "</joint>", f"<axis2><xyz {MODEL}>{other}</xyz></axis2></joint>"
        )
        pushed = settings(300.0 + 20 * k, 5.0, 1.0, 0.3)
        body += joint(f"leg{k}", "prismatic", f"cylinder{k} piston{k}", at[0], at[2], pushed)
        body += joint(f"ball{k}", "ball", f"piston{k} platform", at[1])
    return body


LEGS = [
    ["ball1", "ball2", "ball3", "ball4", "ball5"],
    ["leg1", "leg2", "leg3", "leg4", "leg5"],
    ["leg0", "ball1", "leg3", "ball4", "leg5"],
]


def test_a_stewart_platform_cut_at_balls_and_at_its_sprung_legs(tmp_path):
    ends = []
    for cuts in LEGS:
        cut = cut_at(tmp_path, stewart(), *cuts)
        robot, scene = cut.robot, cut.scene
        q, v = scene.state()
        tau = robot.passive_torque(q, v) + robot.joint_vector({"leg0": 30.0, "leg3": -20.0})
        answer = cp.solve(scene, q, v, tau)
        legs = [f"leg{k}" for k in range(6)]
        drives = np.array([answer.bearings()[leg].drive for leg in legs])
        assert_same(drives, np.array([[tau[robot.index_v(leg)]] for leg in legs]))
        fine = DormandPrince(relative_tolerance=1e-12, absolute_tolerance=1e-12)
        run = cp.simulate(scene, q, v, tau=tau, duration=0.1, dt=0.05, integrator=fine)
        ends.append([
            twists(robot, q, v, answer.a, "Acceleration"),
            bearings(cut, answer, [*legs, "ball0", "ball1"]),
            twists(robot, run.q[-1], run.v[-1], 0 * v, "Velocity"),
        ])  # fmt: skip
    for end in ends[1:]:
        for one, other in zip(end, ends[0], strict=True):
            assert_same(one, other)


ROD = {f"{side}-achilles-spring-joint": "ball" for side in ("left", "right")}
RODS = ["left-pitch-rod-joint", "left-achilles-spring-joint", "left-tarsus-spring-joint",
        "left-shin-tarsus-joint", "left-knee-shin-joint"]  # fmt: skip


def test_the_rods_of_cassie_cut_anywhere():
    rotors, wanted = {"left-shin-tarsus-joint": 0.01, "left-knee-shin-joint": 0.02}, []
    drives = ["left-tarsus-spring-joint", *rotors]
    for name in RODS:
        description = read_sdf(
            cassie_file(), root="pelvis", root_joint=pin.JointModelFreeFlyer(), drop=["static"],
            kinds=ROD, cut=[name],
        )  # fmt: skip
        robot = with_rotors(description.robot(name="cassie", precision=0.0), rotors)
        cut = Cut(robot, description.reversed)
        if name == RODS[0]:
            rng, first = np.random.default_rng(3), cut
            shift = 0.1 * rng.normal(size=robot.nv)
            q0 = cut.scene.assemble(pin.integrate(robot.model, cut.scene.state()[0], shift)).q
            v0 = cp.mechanism.project_velocity(cut.scene, q0, rng.normal(size=robot.nv))
        q, v = carried(first, q0, v0, cut)
        tau = robot.passive_torque(q, v) + robot.joint_vector({"left-knee-op": 20.0})
        answer = cp.solve(cut.scene, q, v, tau)
        assert answer.status.ok
        found = [
            twists(robot, q, v, answer.a, "Acceleration"),
            bearings(cut, answer, [*RODS, "left-knee-op"]),
            np.array([answer.bearings()[each].drive for each in drives]),
        ]
        wanted = wanted or found
        for one, other in zip(found, wanted, strict=True):
            assert_same(one, other)


# Coordinates, and the placement of frame b in frame a that they are.


def turn(axis: int, angle: float) -> pin.SE3:
    return pin.SE3(pin.exp3(angle * np.eye(3)[axis]), np.zeros(3))


def shift(axis: int, by: float) -> pin.SE3:
    return pin.SE3(np.eye(3), by * np.eye(3)[axis])


KINDS = {
    "hinge": ("y", {"j": 2.6}, turn(1, 2.6)),
    "slider": ("x", {"j": -0.4}, shift(0, -0.4)),
    "cylindrical": ("z", {"j_slide": 0.3, "j_turn": -2.2}, shift(2, 0.3) * turn(2, -2.2)),
    "universal": ("zx", {"j_axis": 2.1, "j_axis2": -0.8}, turn(2, 2.1) * turn(0, -0.8)),
    "ball": (None, {"j": [0.1, 0.5, -0.1, math.sqrt(0.73)]}, None),
}


@pytest.mark.parametrize("side", ["b", "a", "between"])
@pytest.mark.parametrize("kind", KINDS)
def test_coordinates_and_motion_of_each_kind(kind, side):
    """On a free body at either frame, and between two of them, for a state of the loop alone."""
    axis, values, placed = KINDS[kind]
    one = pin.SE3(pin.exp3(np.array([0.3, -0.5, 0.9])), np.array([0.1, 0.2, -0.3]))
    two = pin.SE3(pin.exp3(np.array([-1.1, 0.4, 0.2])), np.array([-0.2, 0.1, 0.1]))
    boxes = {"one": cp.model.free_box(), "two": cp.model.free_box()}
    if side != "between":
        del boxes["one" if side == "b" else "two"]
    plain = cp.model.together(boxes)
    for name, box, at in (("e1", "one", one), ("e2", "two", two)):
        joints = [joint for joint in plain.joints if joint.startswith(box)]
        plain = plain.with_frame(name, joints[-1] if joints else "world", at)
    loop = cp.Loop("e1", "e2", kind, axis=axis, name="j")
    whole = plain.with_whole_joints(loop)
    scene = cp.Scene(whole, whole.loops)
    q = scene.assemble(whole.configuration(values), fixed=[*values]).q
    M = whole.frame_pose(q, "e1").actInv(whole.frame_pose(q, "e2"))
    if placed is None:  # of a ball on the world the coordinate is that of the body in the world
        placed = pin.XYZQUATToSE3(np.array([0, 0, 0, *values["j"]]))
        placed = placed.inverse() if side == "a" else placed
    np.testing.assert_allclose(M.homogeneous, placed.homogeneous, atol=1e-10)

    rng, own = np.random.default_rng(5), [whole.index_q(each) for each in values if kind != "ball"]
    held = {name: whole.joint_values(q)[name] for name in plain.joints}
    of_plain = plain.configuration(held)
    again = replace(plain, postures={"there": of_plain}).with_whole_joints(loop)
    np.testing.assert_allclose(again.postures["there"][own], q[own], atol=1e-10)

    v = cp.mechanism.project_velocity(scene, q, rng.normal(size=whole.nv))
    found = cp.solve(scene, q, v, whole.joint_vector({plain.joints[0]: np.ones(6)}))
    tau = plain.joint_vector({plain.joints[0]: np.ones(6)})
    loops = cp.Scene(plain, [loop])
    wanted = cp.solve(loops, of_plain, of_joints(whole, v, plain.joints), tau)
    assert found.status.ok
    assert wanted.status.ok
    assert_same(of_joints(whole, found.a, plain.joints), wanted.a)
    last = {"cylindrical": "j_turn", "universal": "j_axis2"}.get(kind, "j")
    first = {"cylindrical": "j_slide", "universal": "j_axis"}.get(kind, "j")
    inside = found.bearings()[first if side == "a" else last].in_world()[:3]
    assert_same(-inside if side == "a" else inside, wanted.bearings()["j"].in_world()[:3])


def of_joints(robot: cp.Robot, v: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    joints = [robot.model.joints[robot.model.getJointId(name)] for name in names]
    return np.concatenate([v[joint.idx_v : joint.idx_v + joint.nv] for joint in joints])


def test_turns_are_counted(tmp_path):
    """A crank that is cut where it turns, driven round three times; and cut elsewhere."""
    crank = IN_PLANE.replace("0.1 0 0.4", "0 0 0.2").replace("0.7 0 0.6", "0.7 0 0.5")
    crank = crank.replace("0.9 0 0 0 0 0", "0.8 0 0 0 0 0").replace("<upper>2<", "<upper>99<")
    crank = crank.replace("<lower>-2<", "<lower>-99<")
    path, ends = Polynomial((0.0, 6 * math.pi)), []
    for name in "AC":
        cut = cut_at(tmp_path, crank, name)
        robot, scene = (
            cut.robot,
            cp.Scene(cut.robot, [*cut.robot.loops, Driven(HeldJoint("A"), path)]),
        )
        run = cp.simulate(scene, *scene.state(), duration=1.0, dt=5e-3)
        ends.append([*(run.q[-1, robot.index_q(each)] for each in "ABCR"), run.forces["A"][-1, 0]])
    assert ends[0][0] == pytest.approx(6 * math.pi, abs=1e-9)
    assert ends[0][1] == pytest.approx(-6 * math.pi, abs=1e-6)  # the coupler does not turn
    np.testing.assert_allclose(ends[0][:4], ends[1][:4], atol=1e-9)
    np.testing.assert_allclose(ends[0][4], ends[1][4], rtol=1e-6)  # steps of 5 ms: 2e-8


def test_derivatives_along_the_motion(tmp_path):
    """da/dq against differences between closed configurations, the cut joint in q."""
    cut = cut_at(tmp_path, IN_SPACE, "R")
    scene, robot = cut.scene, cut.robot
    q, z = moved(cut, {"A": 0.3}, {"A": 1.0})
    still, step = np.zeros(robot.nv), 1e-4

    def acceleration(by: float) -> np.ndarray:
        there = pin.integrate(robot.model, q, by * z)
        there = scene.assemble(there, fixed=["A"]).q
        return cp.solve(scene, there, still, robot.joint_vector({"R": 3.0})).a

    by = cp.derivatives(scene, q, still, robot.joint_vector({"R": 3.0}))
    differences = (acceleration(step) - acceleration(-step)) / (2 * step * 1.0)
    assert_same(by.da_dq @ z, differences, 1e-6)


def test_a_motor_at_the_cut_joint(tmp_path):
    """Inverse dynamics by the motor of R, with R in the tree and cut."""
    torques = []
    for name in "AR":
        cut = cut_at(tmp_path, IN_SPACE, name)
        robot = cut.robot.with_motors("R")
        scene = cp.Scene(robot, robot.loops)
        q, v = moved(Cut(robot, ()), {"A": 0.3}, {"A": 1.0})
        a = cp.solve(scene, q, v, robot.joint_vector({"R": 7.0})).a
        torques.append(float(cp.inverse_dynamics(scene, q, v, a).u[0]))
    np.testing.assert_allclose(torques, 7.0, atol=1e-9)


def test_mujoco_gets_a_whole_joint(tmp_path):
    robot = cut_at(tmp_path, IN_PLANE, "R").robot
    (tmp_path / "written.xml").write_text(robot.to_mjcf())
    again = cp.load_robot(tmp_path / "written.xml")
    for numbers in ("armature", "damping", "lowerPositionLimit", "upperPositionLimit"):
        np.testing.assert_allclose(getattr(again.model, numbers), getattr(robot.model, numbers))
    assert {spring.joint for spring in again.springs} == {*"ABCR"}
    assert [loop.kind for loop in again.loops] == ["weld"]


def test_what_is_no_joint_is_refused():
    bar = cp.model.four_bar()
    pin_ = cp.Loop("coupler_tip", "rocker_tip", "hinge", axis="y", name="elbow")
    with pytest.raises(UnknownName, match="no loop named 'elbo'"):
        bar.with_loops(pin_).with_whole_joints("elbo")
    for kind, more in (("weld", {}), ("planar", {"axis": "y"}), ("rod", {"length": 0.1})):
        with pytest.raises(InvalidArgument, match="no coordinate of its own"):
            bar.with_whole_joints(cp.Loop("coupler_tip", "rocker_tip", kind, **more))
    with pytest.raises(InvalidModel, match=r"named 'crank'.*another name"):
        bar.with_whole_joints(replace(pin_, name="crank"))
    with pytest.raises(InvalidModel, match="on one body"):
        bar.with_whole_joints(cp.Loop("rocker", "rocker_tip", "ball"))
    plain = bar.with_loops(pin_)
    for needs in (
        lambda: plain.with_motors("elbow"),
        lambda: replace(plain, springs=[cp.model.Spring("elbow", 3.0)]),
        lambda: cp.Scene(plain, contacts=[JointLimit("elbow")]),
        lambda: cp.Scene(plain, contacts=[JointFriction("elbow", torque=1.0)]),
        lambda: cp.Scene(plain, [HeldJoint("elbow")]),
    ):
        with pytest.raises(UnknownName, match=r"with_whole_joints\('elbow'\)"):
            needs()


def test_a_body_without_inertia_is_not_cut():
    """A thin rod along the axis has nothing for the joint to turn: the other body is cut."""
    model = pin.Model()
    rod = pin.Inertia(1.0, np.zeros(3), np.diag([1e-2, 1e-2, 0.0]))  # along z
    for name, body in (("arm", pin.Inertia.FromBox(1.0, 0.1, 0.2, 0.3)), ("rod", rod)):
        j = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(j, body, pin.SE3.Identity())
    hinge = cp.Loop("arm", "rod", "hinge", axis="z", name="turn")
    whole = cp.Robot("two", model).with_whole_joints(hinge)
    masses = dict(zip(whole.joints, [Y.mass for Y in list(whole.model.inertias)[1:]], strict=True))
    assert masses == {"arm": 0.5, "rod": 1.0, "turn": 0.5}
    model.inertias[1] = rod
    with pytest.raises(InvalidModel, match="neither of its bodies"):
        cp.Robot("two", model).with_whole_joints(hinge)
