"""The registry of hard questions, and how to write a family of them.

1. Add one file to this folder with one function marked with `extreme`. It takes a severity and a
   random generator, and returns a `Case`. The first line of its docstring says what severity is.
   `condyn lab stress`, `make stress` and the tests find it in `EXTREMES`; the tables that `make
   stress` writes are committed with it.
2. The severities go from tame to absurd. The same severity and the same seed give the same case.
   Those that take gigabytes are `heavy`: a run with a limit on its time leaves them out.
3. A family that any robot can be put through takes a closed scene as its third argument, `scene`.
4. The truth goes into `Case.right`, if there is a closed form. Without one it is what `Reference`
   says; the tests hold that against an implementation in 50 digits.
5. A case with a `Motion` asks for a short run in place of one solve, and one with a `Flight` for a
   run whose end is known (`motion_verdict.py`).
6. A case that cannot be made may raise a `CondynError`: then every method has refused it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from inspect import signature
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import enter
from condyn_pin._core.arrays import Array
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.mechanisms.base import rod
from condyn_pin.model.mechanisms.chain import chain
from condyn_pin.model.robot import Robot

if TYPE_CHECKING:
    from condyn_pin.simulation.integrators.base import Integrator
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
    """Enter a function into `EXTREMES`."""

    def register(make: Callable[..., Case]) -> Callable[..., Case]:
        name, large = make.__name__, tuple(map(float, heavy))
        title = (make.__doc__ or "").split("\n", 1)[0].rstrip(".")
        any_scene = "scene" in signature(make).parameters
        made = Extreme(name, title, (*map(float, severities), *large), large, any_scene, make)
        enter(EXTREMES, name, made, f"an extreme named {name}")
        return make

    return register


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
