"""Forces of constraints and contacts as arrows, each on the body that feels it.

Forces have one scale, moments another: the largest of all moments is a third of the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io import meshes
from condyn_pin.model.robot import Robot
from condyn_pin.viewing.instant import Instant
from condyn_pin.viewing.labels import label
from condyn_pin.viewing.palette import FORCE, MOMENT, REACTION, Colour
from condyn_pin.viewing.part import Part, at_point, span, then

_LARGEST = 0.33  # of the size of the scene
_LEAST = 1e-3  # of the largest arrow: what is smaller is not drawn
_ROUNDING = 1e-9  # of the weight, of moments at the size of the scene: no force of what flies


class Peak(NamedTuple):
    """The largest force and moment of a constraint in a motion."""

    force: float  # [N]
    moment: float  # [N m]


class _Acting(Protocol):
    """A force that knows on whom it acts and where: of a constraint, or of a contact."""

    @property
    def at(self) -> Array: ...

    @property
    def on(self) -> str: ...

    def in_world(self) -> Array: ...

    def on_other(self) -> _Acting: ...


@dataclass(frozen=True, eq=False)
class _Arrow:
    """A vector of a constraint or a contact: the force or the moment on one of its bodies."""

    name: str
    of: Callable[[Instant], _Acting | None]
    part: slice  # of the six numbers
    unit: str
    colour: Colour

    def vector(self, at: Instant) -> tuple[Array, Array] | None:
        """Return where it starts, and itself in the axes of the world."""
        force = self.of(at)
        if force is None:
            return None
        vector = force.in_world()[self.part]
        return (force.at, vector) if len(vector) else None

    def most(self, instants: Sequence[Instant], peaks: Mapping[str, Peak]) -> tuple[float, str]:
        """Return its largest length, and the body that it is on; zero if it is never seen."""
        found = [
            (float(np.linalg.norm(v[1])), self.of(at)) for at in instants if (v := self.vector(at))
        ]
        largest, force = max(found, key=lambda each: each[0], default=(0.0, None))
        if force is None:
            return 0.0, ""
        peak = peaks.get(self.name, Peak(0.0, 0.0))
        return max(largest, peak.moment if self.unit == "N m" else peak.force), force.on


def body_of(robot: Robot, name: str) -> str:
    """Return the body that carries a frame: its own name, or that of the link it is fixed to.

    Frames of an MJCF name no link; then it is the first body of the joint.
    """
    frames = robot.model.frames
    named = found = next((frame for frame in frames if frame.name == name), None)
    while found is not None and found.parentFrame:
        if found.type == pin.FrameType.BODY:
            return str(found.name)
        found = frames[found.parentFrame]
    if named is None or not named.parentJoint:
        return name
    bodies = (f for f in frames if f.type == pin.FrameType.BODY)
    return next((str(f.name) for f in bodies if f.parentJoint == named.parentJoint), name)


def arrow_parts(
    scene: Scene, instants: Sequence[Instant], size: float, peaks: Mapping[str, Peak]
) -> Iterator[Part]:
    """Return the arrows of every constraint and contact of a scene, with labels.

    Arrows follow a motion, and labels do not: these say the largest of it, and that they do.

    Parameters
    ----------
    scene : Scene
    instants : sequence of Instant
    size : float
        Of the scene [m].
    peaks : mapping of str to Peak
        Of a motion: the largest force and moment of each constraint and contact, drawn or not.
    """
    arrows = [arrow for c in scene.constraints if c.frames
              for arrow in _arrows(c.name, between=len(c.frames) == 2)]  # fmt: skip
    arrows += [arrow for bound in scene.contact_bounds for name, ground in bound.cones
               for arrow in _touch_arrows(name, between=ground != 0)]  # fmt: skip
    most = {arrow: arrow.most(instants, peaks) for arrow in arrows}
    weight = scene.robot.mass * tolerances.GRAVITY  # [N]
    moves = len(instants) > 1
    for unit, least in (("N", _ROUNDING * weight), ("N m", _ROUNDING * weight * size)):
        same = [arrow for arrow in arrows if arrow.unit == unit]
        largest = max((most[arrow][0] for arrow in same), default=0.0)
        for arrow in same:
            length, on = most[arrow]
            if length > _LEAST * largest and largest > least:
                body = body_of(scene.robot, on)
                words = f"{length:.3g} {unit} {'at most ' if moves else ''}on {body}"
                yield from _drawn(arrow, words, body, _LARGEST * size / largest, size)


def _arrows(name: str, *, between: bool) -> Iterator[_Arrow]:
    def first(at: Instant) -> _Acting | None:
        return at.forces.get(name)

    linear, angular = slice(0, 3), slice(3, 6)
    yield _Arrow(name, first, linear, "N", FORCE)
    yield _Arrow(name, first, angular, "N m", MOMENT)
    if between:
        yield _Arrow(name, _other(first), linear, "N", REACTION)


def _touch_arrows(name: str, *, between: bool) -> Iterator[_Arrow]:
    def first(at: Instant) -> _Acting | None:
        return at.touching.get(name)

    yield _Arrow(name, first, slice(0, 3), "N", FORCE)
    if between:
        yield _Arrow(name, _other(first), slice(0, 3), "N", REACTION)


def _other(first: Callable[[Instant], _Acting | None]) -> Callable[[Instant], _Acting | None]:
    def other(at: Instant) -> _Acting | None:
        force = first(at)
        return None if force is None else force.on_other()

    return other


def _drawn(arrow: _Arrow, words: str, on: str, scale: float, size: float) -> Iterator[Part]:
    def ends(at: Instant) -> tuple[Array, Array] | None:
        found = arrow.vector(at)
        if found is None or np.linalg.norm(found[1]) * scale < _LEAST * size:
            return None
        return found[0], found[0] + scale * found[1]

    kind = "moments" if arrow.unit == "N m" else "forces"
    path = f"{kind}/{arrow.name}/on {on.replace('/', ' ')}"
    pose, tip = then(ends, lambda both: span(*both)), then(ends, lambda both: at_point(both[1]))
    yield Part(path, pose, ((_unit_arrow(0.007 * size), arrow.colour),), on_top=True)
    yield label(f"{path} label", words, arrow.colour, tip, 0.024 * size)


def _unit_arrow(radius: float) -> meshes.Mesh:
    """Return an arrow along z from 0 to 1."""
    head = 2.2 * radius
    profile = [(0.0, 0.0), (radius, 0.0), (radius, 0.8), (head, 0.8), (0.0, 1.0)]
    return meshes.turned(profile, 16)
