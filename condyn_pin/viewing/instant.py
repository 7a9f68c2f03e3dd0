"""Instant: a scene at one configuration as it is drawn, its contact points and its extent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import axes
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.constraints.rows.bound import BoundConstraint, ConstraintViolation
from condyn_pin.constraints.rows.cables import BoundCable, Lines
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.control.balancing import Balance
from condyn_pin.dynamics.at_state import gaps
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import ConstraintForce
from condyn_pin.model.robot import Robot


@dataclass(frozen=True, eq=False)
class Instant:
    """A scene at one instant, as it is drawn.

    joints: every joint in the world; the world itself is the first
    com (3,): centre of mass [m]
    ends: the frames c1 and c2 of each constraint in the world; couplings have none
    gaps: gap of each position-level constraint
    bounds: the constraints that hold now
    forces: on the first-named body; empty where none are known
    touching: points that may touch a plane
    cables: points of each cable in the world (k, 3) [m], and whether it is taut
    balance: its balance on the floor; None if it was not computed
    """

    joints: list[Any]
    com: Array  # [m]
    ends: Mapping[str, tuple[Any, Any]]
    gaps: Mapping[str, ConstraintViolation]
    bounds: Mapping[str, BoundConstraint]
    forces: Mapping[str, ConstraintForce] = field(default_factory=dict)
    touching: Mapping[str, ContactView] = field(default_factory=dict)
    cables: Mapping[str, tuple[Array, bool]] = field(default_factory=dict)
    balance: Balance | None = None

    def robot_end(self, name: str) -> Any | None:
        """Return the frame of a contact on the robot; None while it does not hold."""
        if name not in self.ends:
            return None
        return self.ends[name][self.bounds[name].on_robot]


def instant(
    scene: Scene,
    q: Array,
    forces: Mapping[str, ConstraintForce] | None = None,
    felt: PlottedForce | None = None,
    balance: Balance | None = None,
) -> Instant:
    """Return the instant of a scene at q (nq,): placements, gaps, forces and contact points."""
    equations = Equations(scene.robot.model, scene.bounds)
    opening = gaps(scene, equations.violation(q))
    placed = zip(scene.names, equations.placements(q), strict=True)
    oMi = [pin.SE3(each) for each in equations.data.oMi]
    touching = dict(touching_at(scene, equations.data, q, felt or PlottedForce()))
    com = np.array(pin.centerOfMass(scene.robot.model, equations.data, q))
    return Instant(
        joints=oMi,
        com=com,
        ends={name: (pin.SE3(ends[0]), pin.SE3(ends[1])) for name, ends in placed if ends},
        gaps=opening,
        bounds={bound.name: bound for bound in scene.bounds},
        forces=forces or {},
        touching=touching,
        cables=dict(cables_at(scene, equations.data, q)),
        balance=balance,
    )


# Touching: where a contact that may open is now, how it touches, and its force.


@dataclass(frozen=True, eq=False)
class PlottedForce:
    """Contact forces and modes of an answer, by contact name."""

    # on the robot, in the axes t1, t2, n of each [N]
    forces: Mapping[str, Array] = field(default_factory=dict)
    modes: Mapping[str, str] = field(default_factory=dict)  # open, stick or slide


@dataclass(frozen=True, eq=False)
class ContactView:
    """A point that may touch a plane, at one configuration.

    at (3,): the contact point [m]
    axes (3, 3): t1, t2 and n in the world, column by column
    gap: signed distance [m]
    friction: Coulomb's coefficient [1]
    on, by: the force is on the first, from the second: the contact, and the joint of the other body
    mode: open, stick or slide; empty if it is unknown
    force (3,): in the axes t1, t2, n [N]; zero if it is unknown
    """

    at: Array  # [m]
    axes: Array
    gap: float  # [m]
    friction: float
    on: str
    by: str
    mode: str
    force: Array  # [N]

    def in_world(self) -> Array:
        """Return the force in the axes of the world (3,) [N]."""
        return np.asarray(self.axes @ self.force)

    def on_other(self) -> ContactView:
        """Return the contact with the opposite force, on the other body."""
        return replace(self, on=self.by, by=self.on, force=-self.force)

    def on_plane(self) -> Array:
        """Return the projection of the contact point onto the plane (3,) [m]."""
        return np.asarray(self.at - self.gap * self.axes[:, 2])


def touching_at(
    scene: Scene, data: Any, q: Array, felt: PlottedForce
) -> Iterator[tuple[str, ContactView]]:
    """Yield the contact points of a scene by name; reads data.oMi at q (nq,)."""
    if not scene.contacts:
        return
    model = scene.robot.model
    candidates = Candidates(model, scene.contact_bounds, exact=True)
    grounds = dict(cone for bound in scene.contact_bounds for cone in bound.cones)
    gaps, points = candidates.gaps(data, q), candidates.points(data, q)
    axes = candidates.axes(data, q)
    for i, name in enumerate(candidates.names[: candidates.cones]):
        if not np.isfinite(gaps[i]):  # two bodies may meet in fewer places
            continue
        yield name, ContactView(
            at=points[i].copy(), axes=axes[i].copy(), gap=float(gaps[i]),
            friction=float(candidates.friction[i]), on=name, by=model.names[grounds[name]],
            mode=felt.modes.get(name, ""), force=np.asarray(felt.forces.get(name, np.zeros(3))),
        )  # fmt: skip


_TAUT = 1e-6  # slack of a cable that is drawn as taut [m]


def cables_at(scene: Scene, data: Any, q: Array) -> Iterator[tuple[str, tuple[Array, bool]]]:
    """Yield the points of each cable of a scene, and whether it is taut; reads data.oMi at q."""
    cables = {each.name: each.line for bound in scene.contact_bounds for each in bound.lines}
    cables |= {b.name: b.line for b in scene.bounds if isinstance(b, BoundCable)}
    for name, line in cables.items():
        lines = Lines(scene.robot.model, [line])
        yield name, (lines.points(data)[0].T, bool(lines.gaps(data, q)[0] < _TAUT))


# Extent: where a scene is, and how large, for the camera and for the size of its marks.


_ALONG = 1e-6  # of a unit axis: what it may be off a plane, or off its normal, by
_TINY = 0.05  # [m] a scene is drawn as if it were at least this large


def touched(instants: Sequence[Instant]) -> list[Array]:
    """Return the points of contacts and cables at all instants, and projections on planes [m]."""
    # A fall is seen with the ground, and a sliding body with the place where it comes to rest.
    touching = [each for at in instants for each in at.touching.values()]
    found = [point for each in touching for point in (each.at, each.on_plane())]
    return found + [point for at in instants for line, _ in at.cables.values() for point in line]


def extent(
    robot: Robot, instants: Sequence[Instant], also: Sequence[Array] = ()
) -> tuple[Array, float]:
    """Return the centre and the diagonal of the box around joints, frames, masses and points [m].

    A body reaches as far from its centre of mass as a ball of its mass m and inertia I does:
    r^2 = 5 trace(I) / (6 m).
    """
    points = list(also)
    for at in instants:
        points += [oMi.translation for oMi in at.joints[1:]]
        points += [
            at.joints[frame.parentJoint].act(frame.placement.translation)
            for frame in robot.model.frames
            if frame.parentJoint
        ]
        for oMi, inertia in zip(at.joints[1:], list(robot.model.inertias)[1:], strict=True):
            if inertia.mass > 0.0:
                r = np.sqrt(max(np.trace(inertia.inertia), 0.0) / (1.2 * inertia.mass))
                points += [oMi.act(inertia.lever) + r, oMi.act(inertia.lever) - r]
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    return 0.5 * (low + high), max(float(np.linalg.norm(high - low)), _TINY)


def plane_normal(robot: Robot, at: Instant) -> Array | None:
    """Return the normal of the plane in which all joints move (3,); None if there is none."""
    # Every axis of rotation is along it, and every direction of sliding perpendicular to it.
    still = pin.neutral(robot.model)
    slides, turns = [], []
    for joint, oMi in zip(robot.model.joints[1:], at.joints[1:], strict=True):
        S = axes(joint, still)
        slides += [oMi.rotation @ column for column in S[:3].T if np.linalg.norm(column) > _ALONG]
        turns += [oMi.rotation @ column for column in S[3:].T if np.linalg.norm(column) > _ALONG]
    if not turns:
        return None
    normal: Array = turns[0] / np.linalg.norm(turns[0])
    across = [np.linalg.norm(np.cross(normal, axis)) for axis in turns]
    along = [abs(normal @ direction) for direction in slides]
    return normal if max(across + along) < _ALONG else None
