"""Machine: a mechanism while it is drawn, body by body, and the solids it is made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, inf, sin
from typing import Any, Final, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import register
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.loop import Loop
from condyn_pin.model.robot import Robot
from condyn_pin.model.tree import DrawnJoint, DrawnTree

X, Y, Z = np.eye(3)
_ROUNDING: Final = 1e-15  # [m, rad, kg m^2] of a number that should be zero


class Machine:
    """A mechanism while it is drawn: bodies by their frames in the world, joints at their origins.

    Everything stands on a body ``base`` that is fixed to the world.
    """

    def __init__(self, name: str) -> None:
        self._tree = DrawnTree(name)
        self._tree.add_body("base", "world", pin.SE3.Identity())
        self._given = {"base": pin.SE3.Identity()}  # oMb without what is rounded on the way
        self._balls: dict[str, tuple[str, str, Any]] = {}

    def body(
        self, name: str, parent: str, p: ArrayLike, R: ArrayLike, joint: DrawnJoint, solid: Any
    ) -> None:
        """Add a body with origin p and axes R in the world."""
        oMb = self._given[name] = pin.SE3(np.asarray(R), np.asarray(p))
        self._tree.add_body(
            name, parent, _rounded_placement(self._given[parent].actInv(oMb)), [joint], solid
        )

    def mark(self, name: str, body: str, point: ArrayLike) -> None:
        """Add a frame on a body, at a point of the world."""
        self._tree.mark(name, body, self._at(body, point))

    def connect(self, name: str, first: str, second: str, point: Array) -> None:
        """Hold two bodies together by a ball at a point of the world."""
        self._balls[name] = first, second, self._at(first, point)

    def robot(self, postures: Mapping[str, Mapping[str, ArrayLike]], *actuated: str) -> Robot:
        """Return the robot: postures by the coordinates that are not as drawn, and its motors."""
        loops = tuple(self._close(name, *ball) for name, ball in self._balls.items())
        model, drawn = self._tree.model, self._tree.configuration()
        limited = sum(joint.upper < inf for joint in self._tree.joints.values())
        configurations = {}
        for posture, moved in postures.items():
            q = configurations[posture] = drawn.copy()
            for name, value in moved.items():
                joint = model.joints[model.getJointId(name)]
                q[joint.idx_q : joint.idx_q + joint.nq] = rounded_as_drawn(value)
        return Robot(
            model.name,
            model,
            postures=configurations | {"qpos0": drawn},
            loops=loops,
            actuated=actuated,
            unused=(f"limits of position ({limited} joints)",) if limited else (),
            source=SOURCE,
            licence=LICENCE,
        )

    def _close(self, name: str, first: str, second: str, at_first: Any) -> Loop:
        """Mark both ends of a ball, in the axes of their bodies, and return its loop."""
        oMx, drawn = self._tree.drawn[first] * at_first, self._tree.drawn
        for suffix, body in (("a", first), ("b", second)):
            bMx = pin.SE3(np.eye(3), drawn[body].actInv(oMx).translation)
            self._tree.mark(f"{name}_{suffix}", body, bMx)
        return Loop(f"{name}_a", f"{name}_b", name=name)

    def _at(self, body: str, point: ArrayLike) -> Any:
        return pin.SE3(np.eye(3), rounded_as_drawn(self._given[body].actInv(np.asarray(point))))


def rounded_as_drawn(values: ArrayLike) -> Array:
    """Return numbers as a drawing has them: zero where rounding is all, and with 15 digits."""
    # Axes that are meant to be parallel are so to the last bit.
    x = np.asarray(values, dtype=float)
    short = np.array([float(f"{value:.15g}") for value in x.ravel()]).reshape(x.shape)
    x = np.where(np.abs(short - x) < _ROUNDING / 100, short, x)
    return np.where(np.abs(x) < _ROUNDING, 0.0, x)


def _rounded_placement(M: Any) -> Any:
    xyzw = rounded_as_drawn(pin.Quaternion(M.rotation).coeffs())
    xyzw = xyzw / np.abs(xyzw).max()
    x, y, z, w = xyzw / np.linalg.norm(np.roll(xyzw, 1))
    return pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), rounded_as_drawn(M.translation))


def hinge(name: str, axis: Array, reference: float = 0.0) -> DrawnJoint:
    """Return a hinge; `reference` is its angle as drawn [rad]."""
    return DrawnJoint(
        name, "hinge", rounded_as_drawn(axis), reference=float(rounded_as_drawn(reference))
    )


def solid(mass: float, centre: ArrayLike, moments: ArrayLike) -> Any:
    """Return an inertia with its principal axes along those of the body."""
    return pin.Inertia(mass, rounded_as_drawn(centre), np.diag(rounded_as_drawn(moments)))


def round_rod(length: float, mass: float, radius: float) -> Any:
    """Return the inertia of a round rod that lies along x from the origin."""
    across = mass * (3 * radius**2 + length**2) / 12
    return solid(mass, (length / 2, 0, 0), (mass * radius**2 / 2, across, across))


def square_rod(length: float, mass: float, side: float) -> Any:
    """Return the inertia of a rod of square section that lies along x from the origin."""
    across = mass * (length**2 + side**2) / 12
    return solid(mass, (length / 2, 0, 0), (mass * side**2 / 6, across, across))


def plate(radius: float, height: float, mass: float, centre: ArrayLike) -> Any:
    """Return the inertia of a disc across z."""
    across = mass * (3 * radius**2 + height**2) / 12
    return solid(mass, centre, (across, across, mass * radius**2 / 2))


def lump(radius: float, mass: float) -> Any:
    """Return the inertia of a solid ball about the origin."""
    return solid(mass, (0, 0, 0), [0.4 * mass * radius**2] * 3)


def axes_along(x: Array, y: Array) -> Array:
    """Return axes with x along the first direction and y as near the second as can be."""
    z = np.cross(x, y)
    columns = x, np.cross(z, x), z
    return np.column_stack([c / np.linalg.norm(c) for c in columns])


def in_plane(angle: float) -> Array:
    """Return axes in the x-z plane; the angle counts from x towards z, about -y [rad]."""
    return axes_along(np.array([cos(angle), 0, sin(angle)]), Y)


def quaternion_about(axis: Array, angle: float) -> Array:
    """Return the quaternion x y z w of a turn about a unit vector."""
    return np.array([*(sin(angle / 2) * axis), cos(angle / 2)])


def on_circle(angle: float) -> Array:
    """Return a point of the unit circle in the x-y plane."""
    return np.array([cos(angle), sin(angle), 0.0])


SOURCE: Final = "built in condyn_pin/model/mechanisms"
LICENCE: Final = "BSD-2-Clause (this project)"

MECHANISMS: dict[str, Callable[[], Robot]] = {}

Builder = TypeVar("Builder", bound=Callable[..., Robot])


def mechanism(build: Builder) -> Builder:
    """Enter a function into `MECHANISMS`; each of its parameters needs a default."""
    name, by_default = build.__name__, cast(Callable[[], Robot], build)
    register(MECHANISMS, name, by_default, f"a mechanism named {name}")
    return build


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
