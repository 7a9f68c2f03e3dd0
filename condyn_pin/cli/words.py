"""Parsing of command-line arguments into robots, scenes, solvers, postures and forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from math import inf
from typing import Any, Final, TypeVar, cast

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import read_call
from condyn_pin._core.arrays import Array
from condyn_pin.cli.arguments import Source
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.constraints.kinds import kinds_by_word
from condyn_pin.contact.cones import Cone, FrictionCone, WrenchCone
from condyn_pin.control.answer import ControlAnswer
from condyn_pin.control.controller import Controller
from condyn_pin.control.qp import QPS
from condyn_pin.control.tasks.center_of_mass import CenterOfMass
from condyn_pin.control.tasks.frame_task import FrameTask
from condyn_pin.control.tasks.orientation import Orientation
from condyn_pin.control.tasks.posture import Posture
from condyn_pin.control.tasks.task import Task
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers import SOLVERS
from condyn_pin.dynamics.solvers.solver import Solver, parameter_fields
from condyn_pin.errors import CondynError, InvalidArgument, NotAssembled, unknown_name
from condyn_pin.io.load import available_robots, load_robot
from condyn_pin.mechanism.reduction import without
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.drift import DRIFTS, Drift
from condyn_pin.simulation.integrators import INTEGRATORS
from condyn_pin.simulation.integrators.integrator import Integrator
from condyn_pin.study.measures.measure import Measure, as_measure
from condyn_pin.study.measures.motions import SCHEMES
from condyn_pin.study.study import sweep
from condyn_pin.study.tables import Method

_Kind = TypeVar("_Kind")

_GAIN = 30.0  # [1/s] of Baumgarte's method, if none is given


def names_in(text: str) -> list[str]:
    """Return the names of a list with commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def scene_of(source: Source, contacts: str, loops: bool) -> Scene:
    """Return the scene of a robot with the listed contacts, and its loops if `loops`."""
    robot = robot_of(source)
    chosen = [_contact(robot, text) for text in names_in(contacts)]
    return Scene(robot, (*(robot.loops if loops else ()), *chosen))


def robot_of(source: Source) -> Robot:
    """Return the robot of a command line's arguments."""
    said = pairs_in("--variant", source.variant, "OPTION=VALUE is needed, such as springs=locked")
    if source.floating and source.robot in available_robots():
        raise InvalidArgument(
            f"--floating: it is for the path of a URDF or an SDF; {source.robot} says itself "
            "whether its base floats"
        )
    models = source.model or ()
    for name in models:
        if "," in name:
            each = " ".join(f"--model {part}" for part in names_in(name))
            raise InvalidArgument(f"--model {name}: one name is needed; repeat it, {each}")
    return load_robot(
        source.robot,
        floating=source.floating or None,
        model=models if len(models) > 1 else next(iter(models), None),
        variant=said or None,
        actuated=None if source.actuated is None else names_in(source.actuated),
        package_dirs=source.package_dirs or (),
    )


def pairs_in(option: str, texts: Sequence[str] | None, needed: str) -> dict[str, str]:
    """Return texts NAME=VALUE of an option as a mapping."""
    found = {}
    for text in texts or ():
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise InvalidArgument(f"{option} {text}: {needed}")
        if "=" in value:
            raise InvalidArgument(
                f"{option} {text}: one name is needed; repeat {option} for others"
            )
        if name in found:
            raise InvalidArgument(f"{option} {text}: {name} is given twice; give it once")
        found[name] = value
    return found


def feet_of(robot: Robot, friction: float | None) -> tuple[FrictionalContact, ...]:
    """Return the feet of a robot as unilateral contacts; none if no friction is given."""
    feet = () if friction is None else robot.frictional_contacts(friction)
    if friction is not None and not feet:
        raise InvalidArgument(
            f"--friction {friction:g}: {robot.name} has no ready-made contacts; name some in a "
            "robot.toml"
        )
    return feet


def _contact(robot: Robot, text: str) -> Constraint:
    ready = {contact.name: contact for contact in robot.contacts}
    if text in ready:
        return ready[text]
    frame, _, kind = text.rpartition(":")
    known: dict[str, Any] = dict(kinds_by_word(closes=False))
    if frame and kind in known:
        contact: Constraint = known[kind](frame=frame)
        return contact
    wanted = ", ".join(f"FRAME:{kind}" for kind in known)
    raise unknown_name(f"ready-made contact (or {wanted})", text, ready)


def _registry_entry(kind: str, name: str, registry: Mapping[str, _Kind]) -> _Kind:
    """Entry of a registry by name; an error lists the nearest names."""
    if name.lower() not in registry:
        raise unknown_name(kind, name, registry)
    return registry[name.lower()]


def solver_of(name: str, parameters: Mapping[str, Any] | None = None) -> Solver:
    """Return the solver of a name, with the parameters that are not None."""
    chosen = _registry_entry("solver", name, SOLVERS)
    given = {key: value for key, value in (parameters or {}).items() if value is not None}
    known = {parameter.name for parameter in parameter_fields(chosen)}
    for key in given.keys() - known:
        raise InvalidArgument(
            f"{key}: {chosen.__name__} has no such parameter; it has {sorted(known)}"
        )
    return chosen(**given)


def solvers_of(names: str) -> tuple[Solver, ...]:
    """Return the solvers of a list, with their defaults; none if it is empty.

    ``all`` are the installed ones without Reference, with which the others are compared.
    """
    if names.lower() != "all":
        return tuple(solver_of(name) for name in names_in(names))
    return tuple(
        solver() for name, solver in SOLVERS.items() if name != "reference" and not solver.missing()
    )


# Names by which everybody knows them.
ALIASES: Final = {"rk4": "RungeKutta4", "euler": "SemiImplicitEuler"}


def integrator_of(text: str | None) -> Integrator | None:
    """Return the integrator of a name, or of a call: ``Moreau(contact=ADMM(tolerance=1e-6))``."""
    if text is None:
        return None
    name = text.partition("(")[0].strip()
    made = _registry_entry("integrator", ALIASES.get(name.lower(), name), INTEGRATORS)
    try:
        return made(**read_call(text).parameters_made(SCHEMES))
    except KeyError as error:
        raise unknown_name(f"value of {made.__name__}", str(error.args[0]), SCHEMES) from error
    except (ValueError, TypeError) as error:
        if isinstance(error, CondynError):
            raise
        known = ", ".join(f.name for f in fields(cast(Any, made)))
        raise InvalidArgument(f"{text}: {made.__name__} has the parameters {known}") from error


def measures_of(
    name: str, dt: str | None, integrator: str | None, drift: str | None
) -> tuple[Measure, ...]:
    """Return the measures of a name, one for each step of a list, with the given parameters.

    Raises
    ------
    UnknownName
        If there is no such measure.
    InvalidArgument
        If it has no such parameter, or cannot use a value.
    """
    measure = as_measure(name)
    given = {"integrator": integrator_of(integrator), "drift": drift_of(drift, None)}
    chosen: dict[str, list[Any]] = {key: [x] for key, x in given.items() if x is not None}
    if dt is not None:
        chosen["dt"] = [_number("--dt", each) for each in names_in(dt)]
    known = {f.name for f in fields(measure)}  # type: ignore[arg-type]
    for key in chosen.keys() - known:
        raise InvalidArgument(
            f"--{key} has no effect on {name}; it is for trajectory, contact or gradients"
        )
    return sweep(measure, **chosen) if chosen else (measure,)


def _number(option: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise InvalidArgument(f"{option} {text}: a number is needed") from error


def drift_of(name: str | None, gain: float | None) -> Drift | None:
    """Return the drift scheme of a name; `gain` is alpha and beta of Baumgarte's [1/s]."""
    kind = None if name is None else _registry_entry("drift scheme", name, DRIFTS)
    if kind is Baumgarte:
        gain = _GAIN if gain is None else gain
        return Baumgarte(gain, gain)
    if gain is not None:
        raise InvalidArgument(f"--gain {gain:g} is for Baumgarte's method; add --drift baumgarte")
    return kind() if kind else None


def swept_solvers_of(names: str, measure: Measure) -> tuple[Method, ...] | None:
    """Return the methods of a list over their parameters, for a measure; None if it is empty."""
    if measure.asks is Solver:
        chosen: Sequence[Method] = solvers_of(names)
    else:
        kind = f"solver of {measure.name}"
        chosen = [_registry_entry(kind, name, measure.methods)() for name in names_in(names)]
    return tuple(one for method in chosen for one in sweep(method)) or None


# What a line gives by name: values of joints, and forces on frames.


Texts = Sequence[str] | None


def values_in(option: str, texts: Texts) -> dict[str, list[float]]:
    """Return the numbers of texts NAME=NUMBER or NAME=NUMBER,NUMBER,... by name."""
    example = {"--q": "knee=0.3", "--tau": "knee=60"}.get(option, "foot=0,0,100")
    pairs = pairs_in(option, texts, f"NAME=NUMBER is needed, such as {example}")
    return {name: _numbers(f"{option} {name}", value) for name, value in pairs.items()}


def posture_of(scene: Scene, posture: str | None, q: Texts) -> tuple[Array, list[str]]:
    """Return a posture with the joints of `--q` set, loops as they are, and those joints."""
    values = values_in("--q", q)
    start = described_posture(scene, posture)
    return scene.robot.configuration(_by_joint(values), start=start), list(values)


def state_of(scene: Scene, posture: str | None, q: Texts) -> tuple[Array, Array]:
    """Return (q, v) at a posture with the joints of `--q` set: closed, and at rest."""
    if not q:
        return scene.state(posture)
    start, fixed = posture_of(scene, posture, q)
    try:
        closed = scene.assemble(start, fixed=fixed)
    except NotAssembled as error:
        raise NotAssembled(f"--q {' '.join(q)}: {error}", error.assembly) from error
    return closed.q, np.zeros(scene.robot.nv)


def torque_of(scene: Scene, tau: Texts) -> Array:
    """Return the torques of `--tau`, zero for the other joints."""
    return scene.robot.joint_vector(_by_joint(values_in("--tau", tau)))


def forces_of(scene: Scene, forces: Texts) -> list[AppliedForce]:
    """Return the forces of `--force`, in the axes of the world."""
    values = values_in("--force", forces)
    for frame in values:
        scene.robot.frame(frame)  # a name that is unknown is said with those that are near
    return [AppliedForce(frame, numbers) for frame, numbers in values.items()]


def _by_joint(values: dict[str, list[float]]) -> dict[str, float | list[float]]:
    return {name: x[0] if len(x) == 1 else x for name, x in values.items()}


def _numbers(where: str, text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError as error:
        raise InvalidArgument(f"{where}={text}: numbers with commas between are needed") from error


# A robot that stands, or lifts a foot: the program of `condyn control`.


def ready_contacts(robot: Robot) -> str:
    """Return the names of all contacts of a robot that stands; none of one that is bolted down."""
    return ",".join(contact.name for contact in robot.contacts) if _trunk(robot) else ""


def pressing(scene: Scene) -> list[Constraint]:
    """Return the contacts that press on a floor."""
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
    wanted, program = (
        _tasks(scene, q, com),
        _registry_entry("solver of quadratic programs", qp, QPS)(),
    )
    first = Controller(scene, _tasks(scene, q, None) if lift else wanted, cones=cones, qp=program)
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
    """Control tasks: posture, on a floating base trunk and centre of mass, and a demanded `com`."""
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
    """Name of the floating base; empty if the robot is bolted down."""
    model = robot.model
    if model.njoints < 2 or model.joints[1].nv != 6:
        return ""
    at_trunk = [each for each in model.frames if each.parentJoint == 1]
    bodies = [each for each in at_trunk if each.type == pin.FrameType.BODY]
    return str((bodies or at_trunk)[0].name)
