"""The registry of mechanisms, and the slender rods that most of them are made of.

A mechanism that needs no file is a function in a file of this folder, and its name stands in
`condyn_pin/model/__init__.pyi`. Marked with `mechanism` it is a robot by name too, with its default
values: every contract test has it, the table of `tests/test_robots.py` its figures, and the list of
robots and `benchmarks/trade.py cheapest` measure it. Where it is easier to place bodies in the
world than to chain them, use `Machine`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import register
from condyn_pin.model.robot import Robot

LICENCE: Final = "BSD-2-Clause (this project)"

MECHANISMS: dict[str, Callable[[], Robot]] = {}

Builder = TypeVar("Builder", bound=Callable[..., Robot])


def mechanism(build: Builder) -> Builder:
    """Enter a function into `MECHANISMS`; each of its parameters needs a default."""
    name, by_default = build.__name__, cast(Callable[[], Robot], build)
    register(MECHANISMS, name, by_default, f"a mechanism named {name}")
    return build


def source(name: str) -> str:
    """Return the source of a mechanism, as its robot names it."""
    return f"built in condyn_pin/model/mechanisms/{name}.py"


def add_rod(model: Any, name: str, parent: int, at: float, length: float, mass: float) -> int:
    """Add a slender rod that turns about -y, and a frame ``<name>_tip`` at its end.

    Its angle counts from the x axis of the parent towards z.

    Parameters
    ----------
    model : pin.Model
        Written to.
    name : str
        Name of the joint.
    parent : int
        Joint that carries it; 0 for the world.
    at : float
        Its pivot, along x of the parent [m].
    length : float
        Length of the rod [m].
    mass : float
        Mass [kg].

    Returns
    -------
    int
        The joint.
    """
    axis = np.array([0.0, -1.0, 0.0])
    joint = int(model.addJoint(parent, pin.JointModelRevoluteUnaligned(axis), along_x(at), name))
    model.appendBodyToJoint(joint, rod(length, mass), pin.SE3.Identity())
    model.addFrame(pin.Frame(f"{name}_tip", joint, 0, along_x(length), pin.FrameType.OP_FRAME))
    return joint


def along_x(x: float) -> Any:
    """Return the placement of a frame that is shifted along x [m]."""
    return pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))


def rod(length: float, mass: float) -> Any:
    """Return the inertia of a slender rod that lies along x from the origin: m L^2 / 12 across.

    It is a thousandth of its length thick, so that no inertia is zero.
    """
    across = mass * length**2 / 12
    return pin.Inertia(
        mass, np.array([length / 2, 0.0, 0.0]), np.diag([1e-6 * across, across, across])
    )


def disc(radius: float, mass: float) -> Any:
    """Return the inertia of a thin disc with its axle along y: m r^2 / 2, and half of it across."""
    across = mass * radius**2 / 4
    return pin.Inertia(mass, np.zeros(3), np.diag([across, 2 * across, across]))
