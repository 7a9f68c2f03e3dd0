"""The registry of hard contact problems, and how to write a family of them.

1. Write one function in this file, marked with `contact_extreme`. It takes a severity
   and a random generator, and returns a `ContactProblem`: the first line of its docstring says what
   severity is.
2. The severities go from tame to absurd. The same severity and seed give the same problem.
3. The truth is a natural residual of at most 1e-8, in 50 digits. An answer that is ok and misses it
   is wrong.
4. A problem that cannot be posed may raise a `CondynError`: then every solver has refused it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import register
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
from condyn_pin.constraints.contacts.shapes import Box, Plane
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.dynamics.scene import Scene
from condyn_pin.model.mechanisms.free_bodies import free_box, painleve_rod
from condyn_pin.model.smaller import together
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
    """Register a function in `CONTACT_EXTREMES`."""

    def decorate(make: Make) -> Make:
        name = make.__name__
        title = (make.__doc__ or "").split("\n", 1)[0].rstrip(".")
        made = ContactExtreme(name, title, tuple(map(float, severities)), make)
        register(CONTACT_EXTREMES, name, made, f"a contact extreme named {name}")
        return make

    return decorate


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


# Friction from ice to what locks.


@contact_extreme(0.5, 0.7, 1.0, 0.1, 1e-2, 1e-6, 1e-12, 0.0, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0)
def friction(severity: float, rng: Rng) -> ContactProblem:
    """Friction of a box that falls on its corners."""
    scene = box_on(Plane(), friction=severity)
    return posed(scene, *falling(scene, rng))


# Contacts that give way, less and less: the convex problem of MuJoCo and Drake.


@contact_extreme(1.0, *(10.0**-k for k in (1, 2, 3, 4, 6, 8, 10, 12, 15)))
def compliance(severity: float, rng: Rng) -> ContactProblem:
    """Compliance of the contacts of a falling box over their G; the law is convex."""
    scene = box_on(Plane(), friction=0.5)
    hard = posed(scene, *falling(scene, rng))
    R = severity * float(np.mean(hard.G.diagonal()))
    return ContactProblem(
        G=hard.G, g=hard.g, friction=hard.friction, R=np.full(hard.rows, R), law="ccp",
        names=hard.names,
    )  # fmt: skip


# One foot on many points.


@contact_extreme(3, 4, 6, 8, 12, 16, 32, 64)
def corners(severity: float, rng: Rng) -> ContactProblem:
    """Points round the sole of a box, of which two or three would do."""
    angles = 2 * np.pi * np.arange(severity) / severity
    x, y, z = HALF
    scene = Scene(
        free_box(size=(2 * x, 2 * y, 2 * z)),
        contacts=[
            FrictionalContact(
                "box", offset=(x * np.cos(a), y * np.sin(a), -z), friction=0.5, name=f"point {i}"
            )
            for i, a in enumerate(angles)
        ],
    )
    q, v = scene.state()
    return posed(scene, q, v + 0.02 * rng.normal(size=6))


# A box that only just touches.


@contact_extreme(1.0, 1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 1e-16, 1e-17, 0.0)
def grazing(severity: float, rng: Rng) -> ContactProblem:
    """Share of its weight with which a box presses while it slides at 1 m/s."""
    scene = box_on(Plane(), friction=0.5)
    q, v = scene.state()
    v[:3] = *rng.normal(size=2), 9.81 * DT * (1.0 - severity)
    return posed(scene, q, v)


# A contact of what can hardly move, and of what cannot.


@contact_extreme(1.0, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14, 1e-16, 1e-100, 0.0)
def immovable(severity: float, rng: Rng) -> ContactProblem:
    """Factor of the inverse mass that one contact of a falling box feels; at zero nothing moves it.

    At zero its rows are empty, and it is asked to part: no impulse can.
    """
    scene = box_on(Plane(), friction=0.5)
    problem = posed(scene, *falling(scene, rng))
    share = columns([severity**0.5, *[1.0] * (len(problem.friction) - 1)])
    g = problem.g.copy()
    g[2] = -1.0
    return with_rows(problem, share[:, None] * problem.G * share, g)


@contact_extreme(1.0, *(10.0**k for k in (1, -1, 3, -3, 6, -6, 9, -9, 12, -12, 40, -40)))
def other_units(severity: float, rng: Rng) -> ContactProblem:
    """Factor of G: another unit of mass [1/kg]."""
    scene = box_on(Plane(), friction=0.5)
    problem = posed(scene, *falling(scene, rng))
    return with_rows(problem, severity * problem.G, problem.g)


@contact_extreme(1.0, *(10.0**k for k in (1, -1, 3, -3, 6, -6, 9, -9, 12, -12, 40, -40)))
def other_speed(severity: float, rng: Rng) -> ContactProblem:
    """Factor of g: another unit of length, or of time [m/s]."""
    scene = box_on(Plane(), friction=0.5)
    problem = posed(scene, *falling(scene, rng))
    return with_rows(problem, problem.G, severity * problem.g)


# Painlevé's rod: friction that has no force, and an impulse alone.


@contact_extreme(0.1, 0.5, 1.0, 1.3, 1.333, 4 / 3, 1.334, 1.4, 1.5, 2.0, 3.0, 5.0, 10.0)
def painleve(severity: float, rng: Rng) -> ContactProblem:
    """Friction of a rod whose lower end slides; from 4/3 on no force is right."""
    scene = Scene(painleve_rod(), contacts=[FrictionalContact("tip", friction=severity)])
    q, _ = scene.state("paradox")
    return posed(scene, q, np.array([-rng.uniform(0.5, 2.0), 0.0, 0.0]))


# Boxes on boxes.


def stacked(masses: list[float], friction: float, rng: Rng) -> ContactProblem:
    """Return the problem of boxes on each other, the first on the floor, all pushed a little."""
    size = (2 * HALF[0], 2 * HALF[1], 2 * HALF[2])
    boxes = {f"box {i}": free_box(mass=mass, size=size) for i, mass in enumerate(masses, start=1)}
    robot, names = together(boxes), list(boxes)
    contacts = []
    for below, name in zip([None, *names], names, strict=False):
        on = Plane() if below is None else f"{below}/box"
        top = None if below is None else Plane(height=HALF[2])
        contacts.append(
            FrictionalContact(
                f"{name}/box", Box(*HALF), on=on, on_shape=top, friction=friction, name=name
            )
        )
    scene = Scene(robot, contacts=contacts)
    q, v = scene.state()
    for i in range(len(names)):
        q[7 * i + 2] = (2 * i + 1) * HALF[2]
    return posed(
        scene, q, v + 0.1 * rng.normal(size=len(v)) * np.tile([1, 1, 0, 0, 0, 0], len(names))
    )


@contact_extreme(1, 2, 3, 5, 10, 20)
def stack(severity: float, rng: Rng) -> ContactProblem:
    """How many boxes stand on each other, four corners each."""
    return stacked([1.0] * int(severity), 0.5, rng)


@contact_extreme(1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
def heavy_on_light(severity: float, rng: Rng) -> ContactProblem:
    """Mass of a box over that of the box that it stands on."""
    return stacked([1.0, severity], 0.5, rng)


# A box between two walls, and one that is jammed.


@contact_extreme(45.0, 30.0, 10.0, 3.0, 1.0, 0.1, 1e-2, 1e-4, 1e-6, 0.0)
def wedge(severity: float, rng: Rng) -> ContactProblem:
    """Angle of two walls to the vertical that a box is pressed in between [deg].

    With a friction of 1 it is jammed from 45 degrees on: walls push against each other with forces
    that nothing bounds. At zero they are parallel.
    """
    s, c = math.sin(math.radians(severity)), math.cos(math.radians(severity))
    walls = (Plane((c, 0.0, s), -HALF[0] * c), Plane((-c, 0.0, s), -HALF[0] * c))
    scene = box_on(*walls, friction=1.0)
    q, v = scene.state()
    q[2] = 0.0
    v[:3] = *rng.normal(scale=0.1, size=2), -1.0
    # the walls meet the corners that are lowest
    q[2] = HALF[2] + 1e-5
    return posed(scene, q, v)


# One number of a contact problem that no machine has.


SIZES = (0.0, 5e-324, 1e-310, 1e-155, 1e16, 1e77, 1e155, 1e300, math.inf, math.nan)


@contact_extreme(*SIZES)
def bad_g(severity: float, rng: Rng) -> ContactProblem:
    """One entry of g, from nothing to what is not a number [m/s]."""
    scene = box_on(Plane(), friction=0.5)
    problem = posed(scene, *falling(scene, rng))
    g = problem.g.copy()
    g[rng.integers(len(g))] = severity
    return with_rows(problem, problem.G, g)


@contact_extreme(*SIZES)
def bad_G(severity: float, rng: Rng) -> ContactProblem:
    """One entry on the diagonal of G, from nothing to what is not a number [1/kg]."""
    scene = box_on(Plane(), friction=0.5)
    problem = posed(scene, *falling(scene, rng))
    G, i = problem.G.copy(), rng.integers(len(problem.g))
    G[i, i] = severity
    return with_rows(problem, G, problem.g)
