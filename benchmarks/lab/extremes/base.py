"""The registry of hard questions, and how to write a family of them.

1. Write one function marked with `extreme` in the file of its noun (`bodies`, `loops`, `motion`).
   It takes a severity and a random generator, and returns a `Case`. The first line of its docstring
   says what severity is. The tables that
   `make stress` writes are committed with it.
2. The severities go from tame to absurd. The same severity and the same seed give the same case.
   Those that take gigabytes are `heavy`: a run with a limit on its time leaves them out.
3. A family that any robot can be put through takes a closed scene as its third argument, `scene`.
4. The truth goes into `Case.right`, if there is a closed form. Without one it is what `Reference`
   says; the tests hold that against an implementation in 50 digits.
5. A case with a `Motion` asks for a short run in place of one solve, and one with a `Flight` for a
   run whose end is known (`verdicts.py`).
6. A case that cannot be made may raise a `CondynError`: then every method has refused it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from inspect import signature
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import register
from condyn_pin._core.arrays import Array
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene, check_bilateral
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.mechanisms.machine import rod
from condyn_pin.model.mechanisms.planar import chain
from condyn_pin.model.robot import Robot
from lab.extremes.contacts import CONTACT_EXTREMES, ContactExtreme

if TYPE_CHECKING:
    from condyn_pin.simulation.integrators.integrator import Integrator
    from condyn_pin.simulation.torques import Torque


Rng = np.random.Generator

EXTREMES: dict[str, Extreme] = {}


@dataclass(frozen=True)
class Motion:
    """A short run from rest, by semi-implicit Euler, without weight and torques."""

    dt: float  # [s]
    steps: int = 50


@dataclass(frozen=True, eq=False)
class Flight:
    """A run whose end is known."""

    duration: float  # [s]
    dt: float  # [s]
    integrator: Integrator
    end: Array  # the right configuration (nq,)
    within: float  # what the run may miss it by [rad, m]
    tau: Torque | None = None  # as `simulate` takes it; that of the case by default


@dataclass(frozen=True, eq=False)
class Case:
    """One question, and its answer where that is known."""

    scene: Scene
    q: Array
    v: Array
    tau: Array
    right: tuple[Array, ...] = ()  # a in closed form; empty where `Reference` has to say it
    within: float = SOLVED  # error of a that counts as right, relative; more where q and v have one
    parameters: Mapping[str, float | int] = field(default_factory=dict)  # of solvers that have them
    drift: Baumgarte | None = None
    motion: Motion | None = None  # where the question is one of many steps
    flight: Flight | None = None  # where it is where a motion ends


@dataclass(frozen=True)
class Extreme:
    """A family of hard questions, by severity."""

    name: str
    title: str  # what the severity is
    severities: tuple[float, ...]  # from tame to absurd
    heavy: tuple[float, ...]  # those of them that take gigabytes
    any_scene: bool  # whether the family is made of a scene that is handed in
    make: Callable[..., Case]

    def case(self, severity: float, seed: int = 0, scene: Scene | None = None) -> Case:
        """Return the case of a severity and a seed.

        Raises
        ------
        CondynError
            If the library refuses to make it.
        """
        rng = np.random.default_rng(seed)
        if not self.any_scene:
            return self.make(severity, rng)
        if scene is None:
            raise InvalidArgument(f"scene: {self.name} needs one, such as Scene(robot, loops)")
        return self.make(severity, rng, scene)


def extreme(
    *severities: float, heavy: Sequence[float] = ()
) -> Callable[[Callable[..., Case]], Callable[..., Case]]:
    """Register a function in `EXTREMES`."""

    def decorate(make: Callable[..., Case]) -> Callable[..., Case]:
        name, large = make.__name__, tuple(map(float, heavy))
        title = (make.__doc__ or "").split("\n", 1)[0].rstrip(".")
        any_scene = "scene" in signature(make).parameters
        made = Extreme(name, title, (*map(float, severities), *large), large, any_scene, make)
        register(EXTREMES, name, made, f"an extreme named {name}")
        return make

    return decorate


def families() -> dict[str, Extreme | ContactExtreme]:
    """Return what `EXTREMES` and `CONTACT_EXTREMES` have; a severity is one of each."""
    return {**EXTREMES, **CONTACT_EXTREMES}


def powers(first: int, last: int, step: int = 1) -> tuple[float, ...]:
    """Return powers of ten from 10^first to 10^last."""
    return tuple(10.0**k for k in range(first, last + (1 if step > 0 else -1), step))


# States


def torques(scene: Scene, rng: Rng) -> Array:
    """Return torques that alone would accelerate every joint by about 1 rad/s^2 or 1 m/s^2."""
    M = scene.nominal.terms.M
    return np.asarray(M @ rng.normal(size=scene.robot.nv))


def moving(scene: Scene, rng: Rng) -> tuple[Array, Array, Array]:
    """Return a closed state that moves along the constraints, under random torques."""
    q, v = scene.sample(rng)
    return q, v, torques(scene, rng)


def ajar(scene: Scene, q: Array, rng: Rng) -> Array:
    """Return a configuration near q whose loops are open by about 1e-7."""
    model = scene.robot.model
    return np.asarray(pin.integrate(model, q, 1e-7 * rng.normal(size=model.nv)))


def sized(x: Array, size: float) -> Array:
    """Return a multiple of x whose largest entry is `size`; nothing stays nothing."""
    largest = float(np.abs(x).max(initial=0.0))
    return np.asarray(size * (x / largest)) if largest else x


def unit(rng: Rng) -> Array:
    """Return a random direction (3,)."""
    axis = rng.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def alternating(n: int) -> Array:
    """Return 1, -1, 1, ... (n,): how the joints of parallelograms turn together."""
    return np.asarray((-1.0) ** np.arange(n))


# Right answers


def by_reference(scene: Scene, q: Array, v: Array, tau: Array) -> Array:
    """Return the acceleration by `Reference`: for a scene that is easier than that of the case."""
    return Workspace(scene, Reference()).solve(q, v, tau, throw=False).a


def near(severity: float, held: Array, free: Array, least: float = 1e-6) -> tuple[Array, ...]:
    """Return what is right where two constraints differ by `severity`: both, below what they show.

    `held` by both of them, and `free` by one, which they are at zero.
    """
    return (free,) if severity == 0.0 else (held,) if severity > least else (held, free)


# Machines


def closed(robot: Robot) -> Scene:
    """Return the scene of a robot and its loops."""
    return Scene(robot, robot.loops)


def frame_at(robot: Robot, q: Array, frame: str) -> Any:
    """Return the placement of a frame in the world."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.model.getFrameId(frame)]


def with_inertias(model: Any, inertias: Sequence[Any]) -> Any:
    """Return a copy of a model with other bodies."""
    copy = pin.Model(model)
    for joint, inertia in enumerate(inertias):
        copy.inertias[joint] = inertia
    return copy


def rods(masses: Sequence[float]) -> Robot:
    """Return a chain of rods of 1 m and some masses [kg], hung up at one end."""
    links = chain(len(masses))
    inertias = [links.model.inertias[0], *(rod(1.0, mass) for mass in masses)]
    return replace(links, model=with_inertias(links.model, inertias))


def hooked(links: Robot, q: Array, kind: Literal["ball", "planar"] = "ball") -> Scene:
    """Return a chain whose tip is held where it is at q, which becomes its posture.

    By a ball, or in the plane of the chain.
    """
    turns = np.cumsum(q)
    tip = [np.cos(turns).sum(), 0.0, np.sin(turns).sum()]
    held = replace(links.with_frame("hook", "world", tip), postures={"held": q})
    axis: Literal["y"] | None = "y" if kind == "planar" else None
    return Scene(held, [Loop(f"joint{len(q) - 1}_tip", "hook", kind, axis=axis)])


def one_joint(name: str, joint: Any, inertia: Any) -> Any:
    """Return the model of one body on one joint of the world."""
    model = pin.Model()
    model.appendBodyToJoint(
        model.addJoint(0, joint, pin.SE3.Identity(), name), inertia, pin.SE3.Identity()
    )
    return model


def posed(robot: Robot, q: Array, platform: Any, place: Any) -> Array:
    """Return q with a frame of the body ``platform``, given in it, at a place in the world."""
    robot = robot.with_frame("there", "world", place.translation, place.rotation)
    robot = robot.with_frame("centre", "platform", platform.translation, platform.rotation)
    scene = Scene(robot, [*robot.loops, Loop("there", "centre", "weld", name="pose")])
    return scene.assemble(q, within_limits=False, branch={}).q


# The same machine in other units of length, mass and time: every answer scales exactly.
#
# With lengths times l, masses times m and times times t,
#
#     angles   1      their v   1 / t      their a   1 / t^2      torques   m l^2 / t^2
#     shifts   l      their v   l / t      their a   l / t^2      forces    m l / t^2
#
# and gravity is an acceleration, inertia m l^2 at a turn, stiffness a torque over an angle, and
# damping that times t.


_SIZES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e1, 1e2, 1e3, 1e4, 1e6)


@extreme(*_SIZES)
def other_length(severity: float, rng: Rng, scene: Scene) -> Case:
    """How large the machine is, times its own size; gravity grows with it."""
    return _case(scene, rng, Units(length=severity))


@extreme(*_SIZES)
def other_mass(severity: float, rng: Rng, scene: Scene) -> Case:
    """How heavy the machine is, times its own mass."""
    return _case(scene, rng, Units(mass=severity))


@extreme(*(2.0**k for k in (0, -4, -10, -20, 4, 10, 20)))
def other_time(severity: float, rng: Rng, scene: Scene) -> Case:
    """How slow the machine is, times its own time; gravity falls with the square."""
    return _case(scene, rng, Units(time=severity))


def _case(scene: Scene, rng: Rng, units: Units) -> Case:
    model, state = scene.robot.model, moving(scene, rng)
    right = units.acceleration(model, by_reference(scene, *state))
    return Case(units.scene(scene), *units.state(model, *state), (right,))


@dataclass(frozen=True)
class Units:
    """What every length, mass and time is multiplied by.

    Attributes
    ----------
    length, mass, time : float
    """

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    def state(self, model: Any, q: Array, v: Array, tau: Array) -> tuple[Array, Array, Array]:
        """Return q, v and tau in these units."""
        along_q, along_v = self._along(model)
        return along_q * q, along_v / self.time * v, self._torque(along_v) * tau

    def acceleration(self, model: Any, a: Array) -> Array:
        """Return an acceleration in these units."""
        return np.asarray(self._along(model)[1] / self.time**2 * a)

    def scene(self, scene: Scene) -> Scene:
        """Return a scene in these units."""
        check_bilateral(scene)
        robot = scene.robot
        along_q, along_v = self._along(robot.model)
        torque = self._torque(along_v)
        model = self._bodies(robot.model)
        model.armature = torque / along_v * self.time**2 * model.armature
        model.damping = torque / along_v * self.time * model.damping
        for limit in ("lowerPositionLimit", "upperPositionLimit"):
            with np.errstate(over="ignore"):  # no limit at all stays none
                setattr(model, limit, along_q * getattr(model, limit))
        postures = {name: along_q * q for name, q in robot.postures.items()}
        springs = []
        for spring in robot.springs:
            i = model.joints[model.getJointId(spring.joint)].idx_v
            stiffness = float(torque[i] / along_v[i]) * spring.stiffness
            relaxed = float(along_v[i]) * spring.reference
            springs.append(replace(spring, stiffness=stiffness, reference=relaxed))
        name = f"{robot.name} in other units"
        in_units = Robot(
            name, model, postures, actuated=robot.actuated, springs=springs,
            precision=robot.precision,
        )  # fmt: skip
        return Scene(
            in_units,
            [self._constraint(constraint, robot.model) for constraint in scene.constraints],
        )

    def _constraint(self, constraint: Constraint, model: Any) -> Constraint:
        """Return a constraint with its lengths in these units."""
        along_q = self._along(model)[0]

        def of_joint(name: str) -> float:
            return float(along_q[model.joints[model.getJointId(name)].idx_q])

        return constraint.in_units(self.length, of_joint)

    def _along(self, model: Any) -> tuple[Array, Array]:
        """Return what each entry of q and of a shift or turn in v is multiplied by."""
        of_q, of_v = shifts(model)
        return np.where(of_q, self.length, 1.0), np.where(of_v, self.length, 1.0)

    def _torque(self, along_v: Array) -> Array:
        """Return what each entry of tau is multiplied by: energy over shift or turn."""
        return np.asarray(self.mass * (self.length / self.time) ** 2 / along_v)

    def _bodies(self, model: Any) -> Any:
        """Return a copy of a model with gravity, placements and inertias in these units."""
        model, length = pin.Model(model), self.length
        model.gravity.linear = length / self.time**2 * model.gravity.linear
        for i in range(model.njoints):
            model.jointPlacements[i].translation *= length
            body = model.inertias[i]
            model.inertias[i] = pin.Inertia(
                self.mass * body.mass, length * body.lever, self.mass * length**2 * body.inertia
            )
        for frame in model.frames:
            frame.placement.translation *= length
        return model


def shifts(model: Any) -> tuple[Array, Array]:
    """Return where q and v hold lengths: (nq,) and (nv,), one or zero."""
    of_q, of_v = np.zeros(model.nq), np.zeros(model.nv)
    for joint in model.joints:
        kind = joint.shortname().removeprefix("JointModel")
        if joint.idx_q < 0 or kind.startswith(("R", "Spherical")):
            continue
        if kind not in ("FreeFlyer", "Translation", "PX", "PY", "PZ", "PrismaticUnaligned"):
            raise InvalidArgument(f"a joint of the kind {kind} mixes angles and lengths")
        size = min(joint.nv, 3)
        of_q[joint.idx_q : joint.idx_q + size] = of_v[joint.idx_v : joint.idx_v + size] = 1.0
    return of_q, of_v
