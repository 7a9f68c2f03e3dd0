"""A robot that stands: the question that `condyn control` asks a controller."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.cli.words import qp_of
from condyn_pin.constraints.base import Constraint
from condyn_pin.contact.cones import Cone, FrictionCone, WrenchCone
from condyn_pin.control.answer import ControlAnswer
from condyn_pin.control.controller import Controller
from condyn_pin.control.tasks.base import Task
from condyn_pin.control.tasks.center_of_mass import CenterOfMass
from condyn_pin.control.tasks.frame_task import FrameTask
from condyn_pin.control.tasks.orientation import Orientation
from condyn_pin.control.tasks.posture import Posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import unknown_name
from condyn_pin.mechanism.reduction import without
from condyn_pin.model.robot import Robot


def ready_contacts(robot: Robot) -> str:
    """Return the names of all contacts of a robot that stands; none of one that is bolted down."""
    return ",".join(contact.name for contact in robot.contacts) if _trunk(robot) else ""


def pressing(scene: Scene) -> list[Constraint]:
    """Return the contacts with a floor."""
    return [each for each in scene.constraints if each.presses]


def stand_and_lift(
    scene: Scene,
    posture: str | None,
    lift: Sequence[str],
    up: float,
    com: tuple[float, ...] | None,
    friction: float,
    qp: str,
) -> tuple[ControlAnswer, ControlAnswer | None]:
    """Return the answer on all contacts, and that after some of them were lifted."""
    q, v = scene.state(posture)
    passive = scene.robot.passive_torque(q, v)
    names, frames = _lifted(scene, lift)
    cones = {each.name: _cone(each, friction) for each in pressing(scene)}
    wanted = _tasks(scene, q, com)
    first = Controller(scene, _tasks(scene, q, None) if lift else wanted, cones=cones, qp=qp_of(qp))
    before = first.solve(q, v, passive=passive)
    if not lift:
        return before, None
    rising = [FrameTask(frame, a=(0.0, 0.0, up), weight=20.0) for frame in frames]
    second = first.use(without(scene, names), [*wanted, *rising])
    return before, second.solve(q, v, passive=passive)


def _lifted(scene: Scene, lift: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the contacts of names or frames, and their frames."""
    found: dict[str, str] = {}
    for name in lift:
        its = {c.name: c.frames[0] for c in pressing(scene) if name in (c.name, c.frames[0])}
        if not its:
            raise unknown_name("contact", name, [each.name for each in pressing(scene)])
        found |= its
    return list(found), list(dict.fromkeys(found.values()))


def _cone(contact: Constraint, friction: float) -> Cone:
    """Return the cone of a point, or that of a sole or an edge."""
    support = contact.support
    is_point = support is not None and support.is_point
    return FrictionCone(friction, sides=8) if is_point else WrenchCone(friction)


def _tasks(scene: Scene, q: Array, com: tuple[float, ...] | None) -> list[Task]:
    """Return what a robot that stands is to do; one that is bolted down has its posture alone."""
    tasks: list[Task] = [Posture(tuple(q), weight=0.1)]
    trunk = _trunk(scene.robot)
    if trunk:
        tasks.append(Orientation(trunk, a=(0.0, 0.0, 0.0), weight=50.0))
    if com is not None:
        tasks.append(CenterOfMass(a=com, weight=inf))
    elif trunk:
        tasks.append(CenterOfMass(a=(0.0, 0.0, 0.0), weight=100.0))
    return tasks


def _trunk(robot: Robot) -> str:
    """Return the body that floats; empty where the robot is bolted down."""
    model = robot.model
    if model.njoints < 2 or model.joints[1].nv != 6:
        return ""
    at_trunk = [each for each in model.frames if each.parentJoint == 1]
    bodies = [each for each in at_trunk if each.type == pin.FrameType.BODY]
    return str((bodies or at_trunk)[0].name)
