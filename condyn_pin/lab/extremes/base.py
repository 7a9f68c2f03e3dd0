"""The registry of hard questions, and how to write a family of them.

1. Add one file to this folder with one function marked with `extreme`. It takes a severity and a
   random generator, and returns a `Case`. The first line of its docstring says what its dial is.
2. The severities go from tame to absurd. The same severity and the same seed give the same case.
   Those that take gigabytes are `heavy`: a run with a limit on its time leaves them out.
3. A family that any robot can be put through sets `any_scene=True`, and takes a closed scene as its
   third argument.
4. The truth goes into `Case.right`, if there is a closed form. Without one it is what `Reference`
   says; the tests hold that against an implementation in 50 digits.
5. A case with a `Motion` asks for a short run in place of one solve (`run_verdict.py`), and one
   with a `Flight` for a run whose end is known (`flight_verdict.py`).
6. A case that cannot be made may raise a `CondynError`: then every method has refused it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.registry import enter
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from condyn_pin.simulation.integrators.base import Integrator
    from condyn_pin.simulation.torques import Torque

EXTREMES: dict[str, Extreme] = {}


@dataclass(frozen=True)
class Motion:
    """A short run from rest, by semi-implicit Euler, without weight and torques.

    Attributes
    ----------
    dt : float
        [s]
    steps : int
    """

    dt: float  # [s]
    steps: int = 50


@dataclass(frozen=True, eq=False)
class Flight:
    """A run whose end is known.

    Attributes
    ----------
    duration, dt : float
        [s]
    integrator : Integrator
    end : (nq,) array
        The configuration that is right.
    within : float
        What the run may miss it by [rad, m].
    tau : callable, optional
        Torques as `simulate` takes them; those of the case by default.
    """

    duration: float  # [s]
    dt: float  # [s]
    integrator: Integrator
    end: Array
    within: float
    tau: Torque | None = None


@dataclass(frozen=True, eq=False)
class Case:
    """One question, and its answer where that is known.

    Attributes
    ----------
    scene : Scene
    q, v, tau : (nq,), (nv,), (nv,) array
    right : tuple of (nv,) array
        The acceleration, in closed form; empty where `Reference` has to say it.
    parameters : mapping of str to number
        Parameters that are turned on every solver that has them.
    drift : Baumgarte, optional
    motion : Motion, optional
        Where the question is one of many steps.
    flight : Flight, optional
        Where it is where a motion ends.
    """

    scene: Scene
    q: Array
    v: Array
    tau: Array
    right: tuple[Array, ...] = ()
    parameters: Mapping[str, float | int] = field(default_factory=dict)
    drift: Baumgarte | None = None
    motion: Motion | None = None
    flight: Flight | None = None


@dataclass(frozen=True)
class Extreme:
    """A family of hard questions with a dial.

    Attributes
    ----------
    name : str
    title : str
        What the dial is.
    severities : tuple of float
        Values of the dial, from tame to absurd.
    heavy : tuple of float
        Those of them that take gigabytes.
    any_scene : bool
        Whether the family is made of a scene that is handed in.
    make : callable
    """

    name: str
    title: str
    severities: tuple[float, ...]
    heavy: tuple[float, ...]
    any_scene: bool
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
    *, severities: Sequence[float], heavy: Sequence[float] = (), any_scene: bool = False
) -> Callable[[Callable[..., Case]], Callable[..., Case]]:
    """Enter a function into `EXTREMES`."""

    def register(make: Callable[..., Case]) -> Callable[..., Case]:
        name = make.__name__
        title = (make.__doc__ or "").split("\n", 1)[0].rstrip(".")
        large = tuple(float(severity) for severity in heavy)
        dial = (*(float(severity) for severity in severities), *large)
        made = Extreme(name, title, dial, large, any_scene, make)
        enter(EXTREMES, name, made, f"an extreme named {name}")
        return make

    return register


def powers(first: int, last: int, step: int = 1) -> tuple[float, ...]:
    """Return powers of ten from 10^first to 10^last."""
    return tuple(10.0**k for k in range(first, last + (1 if step > 0 else -1), step))


def torques(scene: Scene, rng: np.random.Generator) -> Array:
    """Return torques that alone would accelerate every joint by about 1 rad/s^2 or 1 m/s^2."""
    M = scene.nominal.terms.M
    return np.asarray(M @ rng.normal(size=scene.robot.nv))


def moving(scene: Scene, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return a closed state that moves along the constraints, under random torques."""
    q, v = scene.sample(rng)
    return q, v, torques(scene, rng)


def ajar(scene: Scene, q: Array, rng: np.random.Generator) -> Array:
    """Return a configuration near q whose loops are open by about 1e-7."""
    model = scene.robot.model
    return np.asarray(pin.integrate(model, q, 1e-7 * rng.normal(size=model.nv)))


def by_reference(scene: Scene, q: Array, v: Array, tau: Array) -> Array:
    """Return the acceleration by `Reference`: for a scene that is easier than that of the case."""
    return Workspace(scene, Reference()).solve(q, v, tau, throw=False).a


def near(severity: float, held: Array, free: Array) -> tuple[Array, ...]:
    """Return what is right where two constraints differ by `severity`: both, below what they show.

    `held` by both of them, and `free` by one, which they are at zero.
    """
    return (free,) if severity == 0.0 else (held,) if severity > 1e-6 else (held, free)


def sized(x: Array, size: float) -> Array:
    """Return a multiple of x whose largest entry is `size`; nothing stays nothing."""
    largest = float(np.abs(x).max(initial=0.0))
    return np.asarray(size * (x / largest)) if largest else x


def unit(rng: np.random.Generator) -> Array:
    """Return a random direction (3,)."""
    axis = rng.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def whole(value: float) -> int:
    """Return a severity that counts something."""
    return round(value)


def with_inertias(model: Any, inertias: Sequence[Any]) -> Any:
    """Return a copy of a model with other bodies."""
    copy = pin.Model(model)
    for joint, inertia in enumerate(inertias):
        copy.inertias[joint] = inertia
    return copy
