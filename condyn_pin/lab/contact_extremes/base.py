"""The registry of hard contact problems, and how to write a family of them.

1. Add one file to this folder with one function marked with `contact_extreme`. It takes a severity
   and a random generator, and returns a `ContactProblem`: the first line of its docstring says what
   severity is.
2. The severities go from tame to absurd. The same severity and seed give the same problem.
3. The truth is a natural residual of at most 1e-8, in 50 digits. An answer that is ok and misses it
   is wrong.
4. A problem that cannot be posed may raise a `CondynError`: then every solver has refused it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import enter
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
from condyn_pin.constraints.contacts.shapes import Box, Plane
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.dynamics.scene import Scene
from condyn_pin.model.mechanisms.free_bodies import free_box
from condyn_pin.stepping.single_step import contact_problem

Rng = np.random.Generator
Make = Callable[[float, Rng], ContactProblem]

CONTACT_EXTREMES: dict[str, ContactExtreme] = {}

DT = 1e-3  # [s] of the steps that pose the problems
HALF = (0.1, 0.06, 0.04)  # half of the edges of the boxes [m]


@dataclass(frozen=True)
class ContactExtreme:
    """A family of hard contact problems, by severity."""

    name: str
    title: str  # what the severity is
    severities: tuple[float, ...]  # from tame to absurd
    make: Make
    heavy: tuple[float, ...] = ()  # none takes gigabytes
    any_scene: bool = False  # each makes its own

    def problem(self, severity: float, seed: int = 0) -> ContactProblem:
        """Return the problem of a severity and a seed.

        Raises
        ------
        CondynError
            If the library refuses to pose it.
        """
        return self.make(severity, np.random.default_rng(seed))


def contact_extreme(*severities: float) -> Callable[[Make], Make]:
    """Enter a function into `CONTACT_EXTREMES`."""

    def register(make: Make) -> Make:
        name = make.__name__
        title = (make.__doc__ or "").split("\n", 1)[0].rstrip(".")
        made = ContactExtreme(name, title, tuple(map(float, severities)), make)
        enter(CONTACT_EXTREMES, name, made, f"a contact extreme named {name}")
        return make

    return register


# Boxes


def box_on(*planes: Plane, friction: float) -> Scene:
    """Return the scene of a box of 1 kg that may touch planes, which are all the world's."""
    x, y, z = (2 * edge for edge in HALF)
    contacts = [
        FrictionalContact("box", Box(*HALF), on=plane, friction=friction, name=f"plane {i}")
        for i, plane in enumerate(planes, start=1)
    ]
    return Scene(free_box(size=(x, y, z)), contacts=contacts)


def posed(scene: Scene, q: Array, v: Array) -> ContactProblem:
    """Return the contact problem of one step without torques."""
    return contact_problem(scene, q, v, dt=DT)


def falling(scene: Scene, rng: Rng, speed: float = 1.0) -> tuple[Array, Array]:
    """Return the first posture, turned by some 1e-3 rad, with a random velocity [m/s, rad/s]."""
    q, _ = scene.state()
    turned = pin.integrate(scene.robot.model, q, 1e-3 * rng.normal(size=scene.robot.nv))
    return np.asarray(turned), speed * rng.normal(size=scene.robot.nv)


def with_rows(problem: ContactProblem, G: Array, g: Array) -> ContactProblem:
    """Return a problem with other numbers, checked like any."""
    return ContactProblem(
        G=G, g=g, friction=problem.friction, half_lines=problem.half_lines,
        limits=problem.limits, R=problem.R, law=problem.law, names=problem.names,
    )  # fmt: skip


def columns(numbers: Sequence[float]) -> Array:
    """Return numbers, three times each: one a row of cones."""
    return np.repeat(np.asarray(numbers, dtype=float), 3)
