"""Hard loops: nearly singular postures, redundant and contradictory rows, long chains."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import MinimumNorm, factorise
from condyn_pin._core.models import z_along
from condyn_pin._core.tolerances import REFERENCE_RANK
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.line_contact import LineContact
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.planar_contact import PlanarContact
from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.surface_contact import SurfaceContact
from condyn_pin.dynamics.scene import Scene, motor_torque
from condyn_pin.io.load import load_robot
from condyn_pin.mechanism.projection import project_velocity
from condyn_pin.model.mechanisms.planar import chain, four_bar, n_four_bar
from condyn_pin.model.mechanisms.spatial import bricard, delta, stewart
from condyn_pin.model.robot import Robot
from lab.extremes.base import (
    Case,
    Rng,
    alternating,
    by_reference,
    closed,
    extreme,
    frame_at,
    hooked,
    moving,
    near,
    one_joint,
    posed,
    powers,
    torques,
    unit,
)
from lab.extremes.planar_chain import accelerations

# A parallelogram that is nearly flat.


@extreme(1.0, *powers(-1, -12, -1), 0.0)
def parallelogram(severity: float, rng: Rng) -> Case:
    """Angle of the cranks to the ground [rad].

    As long as they are not flat, all cranks turn as one:

        ((n + 1) / 3 + n) theta'' = -((n + 1) / 2 + n) (g / length) cos(theta) + torques

    Flat, the cell can also leave the parallelogram, and the equations allow what they did not.
    """
    along, tau = alternating(3), rng.normal(size=3)
    right = () if severity <= 10 * REFERENCE_RANK else (cranks_as_one(1, severity, tau),)
    return Case(closed(n_four_bar(1)), severity * along, rng.normal() * along, tau, right)


def cranks_as_one(n: int, theta: float, tau: Array) -> Array:
    """Return the accelerations of n cells of unit rods whose cranks stand at theta [rad].

    Torques tau (2 n + 1,) [N m]; those of the couplers act backwards.
    """
    along, inertia = alternating(2 * n + 1), (n + 1) / 3 + n
    weight = ((n + 1) / 2 + n) * 9.81 * math.cos(theta)
    return np.asarray((along @ tau - weight) / inertia * along)


# N four-bars in a row: many loops, a third of the rows redundant.


@extreme(2, 3, 5, 8, 12, 20, 30, 40)
def many_cells(severity: float, rng: Rng) -> Case:
    """How many cells there are; 40 have 120 rows of rank 80.

    All cranks turn as one (problem A02 of the IFToMM library).
    """
    n = round(severity)
    along = alternating(2 * n + 1)
    theta = rng.uniform(0.5, 2.5)
    q, v, tau = theta * along, rng.normal() * along, rng.normal(size=2 * n + 1)
    return Case(closed(n_four_bar(n)), q, v, tau, (cranks_as_one(n, theta, tau),))


# A four-bar near the end of its rocker's swing.


_GROUND, _CRANK, _COUPLER, _ROCKER = 0.7, 0.6, 0.3, 0.6


@extreme(*powers(-1, -9, -1), 0.0)
def dead_point(severity: float, rng: Rng) -> Case:
    """Angle by which coupler and rocker are not in line [rad].

    There the linkage turns back: the crank stands still whatever the speed of the others. The rank
    does not drop, but accelerations of the crank are of second order.
    """
    linkage = four_bar(ground=_GROUND, crank=_CRANK, coupler=_COUPLER, rocker=_ROCKER)
    # the triangle of the two pivots and the crank's tip, with coupler and rocker as its third side
    reach = math.sqrt(_COUPLER**2 + _ROCKER**2 + 2 * _COUPLER * _ROCKER * math.cos(severity))
    theta = math.acos((_GROUND**2 + _CRANK**2 - reach**2) / (2 * _GROUND * _CRANK))
    B = _CRANK * np.array([math.cos(theta), math.sin(theta)])
    along = math.atan2(-B[1], _GROUND - B[0])
    # in line, B looks at the rocker's pivot; bent, it looks past it
    past = math.atan2(_ROCKER * math.sin(severity), _COUPLER + _ROCKER * math.cos(severity))
    coupler = along + past
    C = B + _COUPLER * np.array([math.cos(coupler), math.sin(coupler)])
    rocker = math.atan2(C[1], C[0] - _GROUND)
    q = np.array([theta, coupler - theta, rocker])
    scene = closed(linkage)
    v = project_velocity(scene, q, rng.normal(size=3))
    return Case(scene, q, v, rng.normal(size=3))


# A leg that is held at both ends, nearly stretched.


@extreme(1.0, *powers(-1, -12, -1), 0.0)
def straight_knee(severity: float, rng: Rng) -> Case:
    """Angle of three links of a leg to the line between its held ends [rad].

    Stretched, the rows along the leg hold less and less, and forces grow without bound before.
    """
    q = severity * np.array([1.0, -2.0, 1.5])
    scene = hooked(chain(3), q, "planar")
    v = project_velocity(scene, q, rng.normal(size=3))
    return Case(scene, q, v, rng.normal(size=3))


# Mechanisms that cannot move.


@extreme(0.0, 1.0, 1e3, 1e6, 1e9, 1e12)
def immobile(severity: float, rng: Rng) -> Case:
    """Torques on a four-bar whose rocker is geared to its crank besides [N m].

    Nothing is left to move: a = 0, whatever the torques.
    """
    linkage = four_bar()
    q, v = closed(linkage).state()
    gear = Coupling("rocker", "crank", -0.5, float(q[2] + 0.5 * q[0]))
    scene = Scene(linkage, [*linkage.loops, gear])
    return Case(scene, q, v, severity * rng.normal(size=3), (np.zeros(3),))


# Bars that are too short to meet.


@extreme(-1.0, -1e-1, -1e-2, -1e-4, -1e-6, -1e-8, 0.0, *powers(-15, 0))
def unreachable(severity: float, rng: Rng) -> Case:
    """How far a hook is beyond the reach of a chain of two rods [m]; negative within it."""
    links = chain(2).with_frame("hook", "world", [2.0 + severity, 0.0, 0.0])
    links = replace(links, postures={"bent": np.array([0.3, -0.6])})
    scene = Scene(links, [Loop("joint1_tip", "hook", "planar", axis="y")])
    q, v = scene.state()
    return Case(scene, q, v, torques(scene, rng))


# States whose loops are open.


@extreme(0.0, *powers(-15, 0))
def open_loops(severity: float, rng: Rng, scene: Scene) -> Case:
    """How far each joint is from where the loops close [rad, m].

    Redundant rows then ask for slightly different accelerations.
    """
    q, v, tau = moving(scene, rng)
    apart = severity * rng.normal(size=len(v))
    return Case(scene, pin.integrate(scene.robot.model, q, apart), v, tau)


# Overconstrained machines at states as sensors measure them.


# An answer may be off by this multiple of what the noise changes a by to first order, and by no
# more than a third of a in any case.
_TIMES: Final = 3.0
_MOST: Final = 1.0 / 3.0

_STEPS: Final = 12


def _by_hinges(robot: Robot) -> Scene:
    pairs = [(ball.name, *ball.frames[:2]) for ball in robot.loops]
    return Scene(robot, [Loop(a, b, "hinge", axis="z", name=name) for name, a, b in pairs])


_MACHINES: Final[tuple[Callable[[], Scene], ...]] = (
    lambda: closed(load_robot("cassie")),
    lambda: closed(bricard()),
    lambda: _by_hinges(delta()),
    lambda: _by_hinges(stewart()),
)


@extreme(0.0, *powers(-12, -2))
def noisy_states(severity: float, rng: Rng) -> Case:
    """Noise of q and of v on loops with redundant rows [rad, m; rad/s, m/s].

    Right is the closed machine beside the state, to first order in the noise.
    """
    scene = _MACHINES[int(rng.integers(len(_MACHINES)))]()
    q, v, tau = moving(scene, rng)
    model, nv, rank = scene.robot.model, scene.robot.nv, scene.nominal.rank
    noisy = pin.integrate(model, q, severity * rng.normal(size=nv))
    v = v + severity * rng.normal(size=nv)
    equations = Equations(model, scene.bounds)

    def factors_at(q: Array) -> MinimumNorm:
        return factorise(equations.mass(q), equations.jacobian(q), 0.0).at_most(rank)

    def answer(q: Array, v: Array) -> Array:
        terms = equations.terms(q, v)
        return factors_at(q).solve(tau - terms.h, -terms.gamma)[0]

    there = noisy
    for _ in range(_STEPS):
        step = factors_at(there).closing(equations.violation(there))
        there = pin.integrate(model, there, step)
    right = answer(there, factors_at(there).tangent(v))
    given = answer(noisy, v)
    size = max(float(np.abs(right).max()), scene.nominal.gravity)
    changed = float(np.abs(given - right).max()) / size
    within = min(_TIMES * changed + tolerances.SOLVED, _MOST)
    return Case(scene, noisy, v, tau, right=(right,), within=within)


# Duplicated constraints: every row is there again and again.


@extreme(1, 2, 3, 5, 8, 12)
def duplicated(severity: float, rng: Rng, scene: Scene) -> Case:
    """How many times every constraint is there.

    The motion is the one of the scene itself; lam is shared between the copies.
    """
    state = moving(scene, rng)
    copies = [
        replace(constraint, name=f"{constraint.name} {k}")
        for k in range(round(severity))
        for constraint in scene.constraints
    ]
    return Case(Scene(scene.robot, copies, scene.contacts), *state)


# Two anchors that ask for two places, and drift control that pulls at both.


@extreme(0.0, *powers(-15, 0))
def contradictory(severity: float, rng: Rng) -> Case:
    """Distance of two anchors of one point, both with drift control [m].

    The rows ask for accelerations that differ by beta^2 times the distance: no answer exists.
    """
    talos, foot = load_robot("talos", precision=tolerances.ROUNDED_GEOMETRY), "left_sole_link"
    q, v = Scene(talos, [PointContact(foot)]).state()
    x, y, z = frame_at(talos, q, foot).translation
    here = PointContact(foot, anchor=(x, y, z), name="here")
    there = PointContact(foot, anchor=(x + severity, y, z), name="there")
    scene = Scene(talos, [here, there])
    return Case(scene, q, v, torques(scene, rng), drift=Baumgarte(20.0, 20.0))


# A row that constrains nothing but for rounding.


@extreme(1.0, *powers(-1, -17, -1), 0.0)
def empty_row(severity: float, rng: Rng) -> Case:
    """Distance of the hub of a rod from the pivot that its tip turns about [m].

    The rod holds its arm still: a = 0 there. At zero it keeps a distance that nothing changes, and
    the arm is free; its row of J is rounding then.
    """
    links = chain(2).with_frame("hub", "world", [0.0, 0.0, severity])
    q = rng.normal(size=2)
    tip = np.array([np.cos(q[0]), 0.0, np.sin(q[0]) - severity])
    scene = Scene(links, [Loop("joint0_tip", "hub", "rod", length=float(np.linalg.norm(tip)))])
    v, tau = np.array([0.0, rng.normal()]), rng.normal(size=2)
    # the outer rod alone: m L^2 / 3 about its end
    alone = float(3.0 * (tau[1] - 9.81 / 2 * np.cos(q[0] + q[1])))
    held, free = np.array([0.0, alone]), accelerations(q, v, tau)
    return Case(scene, q, v, tau, near(severity, held, free, 1e-12))


# Two points of one foot that are held, nearer and nearer to each other.


@extreme(*powers(-1, -16, -1), 0.0)
def near_points(severity: float, rng: Rng) -> Case:
    """Distance of two points of a foot that are both held [m].

    Together they leave the foot one turn less than a single point, however near they are. Below
    1e-11 no arithmetic in double precision can tell them from one.
    """
    foot = "left_sole_link"
    here = PointContact(foot, name="here")
    there = PointContact(foot, (severity, 0.0, 0.0), name="there")
    scene = Scene(load_robot("talos", precision=tolerances.ROUNDED_GEOMETRY), [here, there])
    return Case(scene, *moving(scene, rng))


# A foot that stands on two edges, which are nearly the same one.


@extreme(1.0, *powers(-1, -16, -1), 0.0)
def near_edges(severity: float, rng: Rng) -> Case:
    """Angle between two edges through one point that Cassie's left foot stands on [rad].

    On two edges a foot stands as on a surface, however near they are; on one it can roll.
    """
    feet, edge = {"feet": "lines"}, "left-foot/edge"
    cassie = load_robot("cassie", variant=feet, precision=tolerances.ROUNDED_GEOMETRY)
    cassie = cassie.with_frame("turned", edge, np.zeros(3), pin.rpy.rpyToMatrix(0, 0, severity))
    others = [*cassie.loops, *(foot for foot in cassie.contacts if foot.name != edge)]
    flat = Scene(cassie, [*others, SurfaceContact(edge)])
    state = moving(flat, rng)
    held = by_reference(flat, *state)
    free = by_reference(Scene(cassie, [*others, LineContact(edge)]), *state)
    scene = Scene(cassie, [*others, LineContact(edge), LineContact("turned")])
    return Case(scene, *state, near(severity, held, free))


# A point on two planes that are nearly the same one.


@extreme(1.0, *powers(-1, -16, -1), 0.0)
def near_planes(severity: float, rng: Rng) -> Case:
    """Angle between two planes that a point of the foot slides on [rad]."""
    planes = [
        PlanarContact("left_sole_link", normal=(math.sin(angle), 0.0, math.cos(angle)), name=name)
        for name, angle in (("level", 0.0), ("tilted", severity))
    ]
    scene = Scene(load_robot("talos", precision=tolerances.ROUNDED_GEOMETRY), planes)
    return Case(scene, *moving(scene, rng))


# Cassie's loops closed twice, the second time by balls nearby.


@extreme(1.0, *powers(-1, -16, -1), 0.0)
def near_loops(severity: float, rng: Rng) -> Case:
    """Angle about its joint from each ball that closes a loop of Cassie to a second one [rad].

    Two balls are a hinge about the line through them, however near they are: each loop loses the
    two other turns.
    """
    cassie = load_robot("cassie", precision=tolerances.ROUNDED_GEOMETRY)
    once = closed(cassie)
    q, _ = once.sample(rng)
    tau = torques(once, rng)
    seconds, hinges, model = [], [], pin.Model(cassie.model)
    for ball in cassie.loops:
        _add_frames(model, cassie, ball, severity * unit(rng), q)
        name = ball.name
        seconds.append(Loop(f"{name}/second_a", f"{name}/second_b"))
        hinges.append(Loop(f"{name}/hinge_a", f"{name}/hinge_b", "hinge", axis="z"))
    cassie = replace(cassie, model=model, postures={"closed": q})
    hinged = Scene(cassie, hinges)
    v = project_velocity(hinged, q, rng.normal(size=cassie.nv))
    held, free = by_reference(hinged, q, v, tau), by_reference(once, q, v, tau)
    right = near(severity, held, free)
    return Case(Scene(cassie, [*once.constraints, *seconds]), q, v, tau, right)


def _add_frames(model: Any, robot: Robot, ball: Constraint, turn: Array, q: Array) -> None:
    """Add both frames of a second ball to a model, and of the hinge that two balls are.

    The second ball is the first, turned about the joint that carries it: it moves by 2 sin(angle/2)
    along the chord, which is the axis of the hinge. On the other body it is where it meets at q.
    `turn` is axis times angle [rad]; the model is written to.
    """
    (a, one), (b, two) = (robot.frame(frame) for frame in ball.frames)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle else np.array([0.0, 0.0, 1.0])
    chord = pin.exp3(turn / 2) @ np.cross(axis, one.translation)
    moved = 2 * math.sin(angle / 2) * chord
    turned = pin.exp3(turn) @ one.rotation
    along = z_along(chord)
    there = data.oMi[b].rotation.T @ data.oMi[a].rotation
    for name, joint, place, axes in (
        ("second_a", a, one.translation + moved, turned),
        ("second_b", b, two.translation + there @ moved, there @ turned),
        ("hinge_a", a, one.translation, along),
        ("hinge_b", b, two.translation, there @ along),
    ):
        name, placement = f"{ball.name}/{name}", pin.SE3(axes, place)
        model.addFrame(pin.Frame(name, joint, 0, placement, pin.FrameType.OP_FRAME))


# Delta with locked arms, its rods near to one plane.


# [m]: from the middle to an arm's axis less the radius of the platform, an arm, a rod
_BASE, _ARM, _ROD = 0.2 - 0.06, 0.25, 0.5
_CENTRE = pin.SE3(np.eye(3), np.array([-0.06, 0.05, 0.0]))  # of the platform, in its ball's frame


@extreme(0.1, *powers(-2, -12, -1), 0.0)
def flat_rods(severity: float, rng: Rng) -> Case:
    """Distance of Delta's platform from the plane of its elbows, arms locked [m].

    Three rods that are not in one plane hold the platform still. In one plane they do not: it can
    move across it.
    """
    delta = load_robot("delta")
    scene, (angle, centre) = closed(delta), _flattened(severity)
    q, _ = scene.state()
    q[delta.model.joints[delta.model.getJointId("motor1")].idx_q] = angle
    q = posed(delta, q, _CENTRE, pin.SE3(np.eye(3), centre))
    locked = scene.lock(delta.actuated, q=q)
    q, v = locked.state()
    tau = rng.normal(size=locked.robot.nv)
    right = (np.zeros(locked.robot.nv),) if severity > 1e-7 else ()
    return Case(Scene(locked.robot, locked.constraints), q, v, tau, right)


def _flattened(d: float) -> tuple[float, Array]:
    """Return the angle of the first arm, the others level, and where the platform is then.

    Elbows are counted as if the platform were a point: three rods of length l meet in it, on the
    axis of the circle through the elbows, whose radius is R = (l^2 - d^2)^(1/2). The first elbow is
    nearer than R to the middle of the others, so this arm is folded inwards.
    """
    R = math.sqrt(_ROD**2 - d**2)
    level = _BASE + _ARM
    half = level * math.sqrt(3) / 2  # of the distance between the two level elbows
    high = R - math.sqrt(R**2 - half**2)  # of the first elbow above the line between them
    far = _BASE + level / 2  # from the first arm's axis to that line
    cosine = (high**2 - far**2 - _ARM**2) / (2 * far * _ARM)
    angle = math.acos(cosine)  # positive is down
    middle = np.array([-level / 2, 0.0, 0.0])
    elbow = np.array([_BASE + _ARM * cosine, 0.0, -_ARM * math.sin(angle)])
    along = (middle - elbow) / high
    across = np.array([along[2], 0.0, -along[0]])
    return angle, elbow + R * along + d * across


# Euler angles near their gimbal lock.


@extreme(1.0, *powers(-1, -10, -1), 0.0)
def gimbal(severity: float, rng: Rng) -> Case:
    """How far a top in Euler angles is from the lock of two of them [rad].

    cond(M) grows as 1 / distance^2, and so do the accelerations.
    """
    body = pin.Inertia(1.0, np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.2, 0.25]))
    model = one_joint("turn", pin.JointModelSphericalZYX(), body)
    tip = pin.SE3(np.eye(3), np.array([0.3, 0.1, 0.2]))
    model.addFrame(pin.Frame("tip", 1, 0, tip, pin.FrameType.OP_FRAME))
    q = np.array([0.4, math.pi / 2 - severity, 0.3])
    return Case(
        Scene(Robot("top", model), [PointContact("tip")]), q, np.zeros(3), rng.normal(size=3)
    )


# A foot that is turned by nearly 180 degrees from its anchor.


@extreme(1.0, *powers(-1, -16, -1), 0.0)
def half_turn(severity: float, rng: Rng) -> Case:
    """How much is missing to half a turn between a foot and its anchor [rad].

    Drift control follows the logarithm of that turn, whose axis is lost at 180 degrees.
    """
    talos, foot = load_robot("talos"), "left_sole_link"
    q, v = Scene(talos, [SurfaceContact(foot)]).state()
    axis = rng.normal(size=3)
    axis *= (math.pi - severity) / float(np.linalg.norm(axis))
    anchor = frame_at(talos, q, foot) * pin.SE3(pin.exp3(axis), np.zeros(3))
    scene = Scene(talos, [SurfaceContact(foot, anchor=anchor)])
    return Case(scene, q, v, torques(scene, rng), drift=Baumgarte(5.0, 5.0))


# Stewart's platform with locked legs, near a quarter of a turn.


@extreme(1.0, *powers(-1, -12, -1), 0.0)
def quarter_turn(severity: float, rng: Rng) -> Case:
    """Angle of Stewart's platform from a quarter of a turn about the vertical [rad].

    Six locked legs hold it still. Turned by a right angle, they do not: it can move up and turn on.
    """
    stewart = load_robot("stewart")
    scene, data = closed(stewart), stewart.model.createData()
    q, _ = scene.state()
    pin.forwardKinematics(stewart.model, data, q)
    centre = data.oMi[stewart.model.getJointId("platform_ball")].inverse()
    turn = pin.SE3(pin.rpy.rpyToMatrix(0, 0, np.pi / 2 - severity), np.zeros(3))
    locked = scene.lock(stewart.actuated, q=posed(stewart, q, centre, turn))
    q, v = locked.state()
    tau = rng.normal(size=locked.robot.nv)
    right = (np.zeros(locked.robot.nv),) if severity > 1e-6 else ()
    return Case(Scene(locked.robot, locked.constraints), q, v, tau, right)


# Feet that are held twice, the second time by other frames of the same body.


@extreme(1.0, *powers(-2, -16, -2), 0.0)
def turned_feet(severity: float, rng: Rng) -> Case:
    """Angle about the ankle from the frames that hold Talos's feet to those that do again [rad].

    Who holds a body holds it by any of its frames: the motion is that of feet held once, and every
    row of the copies is a sum of others.
    """
    talos = load_robot("talos")
    once = Scene(talos, talos.contacts)
    state = moving(once, rng)
    right = by_reference(once, *state)
    copies = []
    for foot in once.names:
        joint, placement = talos.frame(foot)
        there = pin.SE3(pin.exp3(severity * unit(rng)), np.zeros(3)) * placement
        name, ankle = f"{foot} again", talos.model.names[joint]
        talos = talos.with_frame(name, ankle, there.translation, there.rotation)
        copies.append(SurfaceContact(name))
    return Case(Scene(talos, [*once.constraints, *copies]), *state, (right,))


# Cassie with rods that spin about themselves, on states further and further from standing.


@extreme(0.0, 1e-3, 1e-2, 5e-2, 1e-1, 2e-1, 3e-1)
def spinning_rods(severity: float, rng: Rng) -> Case:
    """How far each joint of Cassie is from standing, loops as in her file, springs locked [rad, m].

    Her rods have balls at both ends there: each is free to spin, with an inertia of 1e-6 kg m^2.
    """
    cassie = load_robot("cassie", variant={"springs": "locked", "achilles": "as_file"})
    scene = closed(cassie)
    q, v = scene.sample(rng, spread=severity)
    return Case(scene, q, v, motor_torque(cassie, rng))


# A long straight chain.


@extreme(5, 10, 20, 50, 100, 200, heavy=(400,))
def straight_chain(severity: float, rng: Rng) -> Case:
    """How many rods are stretched out; cond(M) = 4 n^4."""
    n = round(severity)
    q, v, tau = np.zeros(n), rng.normal(size=n) / n, rng.normal(size=n)
    return Case(Scene(chain(n)), q, v, tau, (accelerations(q, v, tau),))


# A long chain that is bent everywhere.


@extreme(5, 10, 20, 50, 100, 200, heavy=(400,))
def bent_chain(severity: float, rng: Rng) -> Case:
    """How many rods there are, each at a random angle to the one before."""
    n = round(severity)
    q, v, tau = rng.normal(size=n), rng.normal(size=n) / n, rng.normal(size=n)
    return Case(Scene(chain(n)), q, v, tau, (accelerations(q, v, tau),))
