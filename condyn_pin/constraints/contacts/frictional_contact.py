"""Frictional contact of a body with a plane, or with another body.

gap >= 0,  lam_n >= 0,  gap lam_n = 0,        |lam_t| <= friction lam_n
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import finite, text_of
from condyn_pin.constraints.constraint import (
    Constraint,
    FramedModel,
    MjcfGeomWriter,
    Vector3,
    floats,
    not_negative,
    shifted_placement,
)
from condyn_pin.constraints.contacts.contact import Contact, Mode
from condyn_pin.constraints.contacts.ground import Ground
from condyn_pin.constraints.contacts.shapes import (
    ContactPoint,
    Cylinder,
    Ellipsoid,
    Plane,
    Point,
    Shape,
    ground_core,
    plane_core,
)
from condyn_pin.constraints.contacts.touches import BoundContact, BoundShape, Pair, PlaneContact
from condyn_pin.constraints.places import FrameLike, set_frames
from condyn_pin.constraints.planar_contact import PlanarContact
from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.constraints.rolling_ball import RollingBall
from condyn_pin.errors import InvalidArgument, InvalidModel, UnsupportedConstraint


@dataclass(frozen=True)
class FrictionalContact(Contact):
    """A part of a body that may touch the ground, stick to it, slide on it, and leave it again.

    0 <= gap,    0 <= lam_n,    gap lam_n = 0,    |lam_t| <= friction lam_n

    Where it slides, lam_t = -friction lam_n v_t / |v_t| (Signorini, Coulomb).

    Parameters
    ----------
    frame : str, (joint, pin.SE3) or pin.Frame
        Frame of the robot that carries the shape.
    shape : Shape
        `Point`, `Ball`, `Capsule`, `Box`, `Convex`, `Cylinder` or `Ellipsoid`; a point by default.
    offset : (3,) sequence of float
        The centre of the shape, in the axes of `frame` [m].
    on : Plane, Ground, str, (joint, pin.SE3) or pin.Frame
        What it may touch: a plane of the world, z = 0 by default; a ground of planes, boxes, stairs
        and meshes, in 4 points (a ball), 6 (a capsule) or 8; or a frame of another body, which
        carries `on_shape`.
    on_shape : Plane or Shape, optional
        What `on` carries, in its axes: a plane, or a shape round its origin. Two shapes have 1, 4
        (a capsule and a solid), 5 (capsules) or 8 (solids) points where they meet. Cylinders touch
        planes, in 6 points, and a `Ground`; ellipsoids touch planes alone, in 1.
    friction : float
        Coulomb's coefficient [1], 1000 at most. There is no default: 0 is ice, 0.7 rubber on a dry
        floor.
    restitution : float
        Newton's coefficient [1]: speed of separation over speed of approach.
    name : str, optional
        The frame's name by default.

    Raises
    ------
    InvalidArgument
        If friction is missing, negative or above 1000, restitution is not from 0 to 1, or the shape
        or what it touches is none of these.

    Notes
    -----
    The force is the one on the robot at the contact point, in the axes t1, t2, n of the plane [N];
    n points out of the ground. On a level plane t1 and t2 are the world's x and y.
    """

    frame: FrameLike
    shape: Shape = Point()  # noqa: RUF009  a value
    offset: Vector3 = (0.0, 0.0, 0.0)
    on: Plane | Ground | str = Plane()  # noqa: RUF009  a value
    on_shape: Plane | Shape | None = None
    friction: float = None  # type: ignore[assignment]
    restitution: float = 0.0

    def __post_init__(self) -> None:
        set_frames(self, "frame")
        if not isinstance(self.shape, Shape):
            raise InvalidArgument(
                f"shape = {text_of(self.shape)}: a Point(), Ball(radius), "
                "Capsule(radius, half_length), Box(x, y, z), Convex(vertices), "
                "Cylinder(radius, half_length) or Ellipsoid(x, y, z) is needed"
            )
        object.__setattr__(self, "offset", floats("offset", self.offset, 3))
        self._check_ground()
        if self.friction is None:
            raise InvalidArgument(
                "friction is missing: it has no default; 0 is ice, 0.7 rubber on a dry floor"
            )
        object.__setattr__(self, "friction", not_negative("friction", self.friction))
        if self.friction > tolerances.MOST_FRICTION:
            raise InvalidArgument(
                f"friction = {self.friction:g}: {tolerances.MOST_FRICTION:g} is the most: beyond "
                "that, sliding too slow to measure hides how fast bodies sink in; what never "
                "slides is a PointContact in Scene(robot, constraints)"
            )
        restitution = float(finite("restitution", self.restitution, ()))
        if not 0 <= restitution <= 1:
            raise InvalidArgument(
                f"restitution = {text_of(self.restitution)}: a number from 0 to 1 is needed"
            )
        object.__setattr__(self, "restitution", restitution)
        self._set_name(self.frame)

    def _check_ground(self) -> None:
        if isinstance(self.on, Ground) and isinstance(self.shape, Ellipsoid):
            raise InvalidArgument(
                f"shape = {self.shape!r}: it touches planes alone, on=Plane(...); a Convex also "
                "touches a Ground"
            )
        if isinstance(self.on, Plane | Ground):
            if self.on_shape is not None:
                cure = "it is the shape of a second body: name a frame of that one, on='frame'"
                if isinstance(self.on_shape, Plane):
                    cure = f"a plane of the world is on={self.on_shape!r}; {cure}"
                raise InvalidArgument(f"on_shape = {text_of(self.on_shape)}: {cure}")
            return
        try:
            set_frames(self, "on")
        except InvalidArgument as error:
            raise InvalidArgument(f"{error}, of another body, or a Plane or Ground") from error
        if not isinstance(self.on_shape, Plane | Shape):
            raise InvalidArgument(
                f"on_shape = {text_of(self.on_shape)}: the shape on {self.on!r} is needed: a "
                "Plane, Ball, Capsule, Box or Convex"
            )
        for key, one, other in (
            ("shape", self.shape, self.on_shape),
            ("on_shape", self.on_shape, self.shape),
        ):
            if isinstance(one, Cylinder | Ellipsoid) and isinstance(other, Shape):
                raise InvalidArgument(
                    f"{key} = {one!r}: it touches planes alone; a Capsule, a Box or a Convex also "
                    "touches other shapes"
                )
        if self.shape == self.on_shape == Point():
            raise InvalidArgument("on_shape = Point(): points never meet; make one a Ball")

    def bind(self, machine: FramedModel) -> BoundContact:
        """Return its contact points over the plane, or the pair of shapes."""
        joint, placement = machine.frame(self.frame)
        in_world = isinstance(self.on, Plane | Ground)
        ground, origin = (0, pin.SE3.Identity()) if in_world else machine.frame(str(self.on))
        if joint == ground:
            where = "the world" if joint == 0 else f"joint {machine.model.names[joint]!r}"
            raise InvalidArgument(
                f"{self.name}: frame {self.frame!r} and what it touches both belong to {where}; "
                "name frames on two bodies that move against each other"
            )
        at, law = shifted_placement(placement, self.offset), (self.friction, self.restitution)
        if isinstance(self.on, Ground):
            shape = self.shape.over_plane or self.shape.core
            pair = Pair(
                self.name, joint, at, shape, 0, origin, ground_core(), *law, self.on.surface
            )
            return BoundContact(self.name, pairs=(pair,), solids=_solids((joint, at, self.shape)))
        below = self.on if isinstance(self.on, Plane) else self.on_shape
        if isinstance(below, Shape):
            pair = Pair(self.name, joint, at, self.shape.core, ground, origin, below.core, *law)
            return BoundContact(self.name, pairs=(pair,), solids=_solids(
                (joint, at, self.shape), (ground, origin, below)
            ))  # fmt: skip
        assert below is not None  # checked when it was made
        plane = origin * below.placement
        if (core := self.shape.over_plane) is not None:
            pair = Pair(self.name, joint, at, core, ground, plane, plane_core(), *law)
            return BoundContact(self.name, pairs=(pair,), solids=_solids((joint, at, self.shape)))
        touches = (
            PlaneContact(
                self._called(f), joint, at.act(np.array(f.middle)), f.radius, ground, plane, *law
            )
            for f in self.shape.contact_points
        )
        return BoundContact(
            self.name, touches=tuple(touches), solids=_solids((joint, at, self.shape))
        )

    def held(self, modes: Mapping[str, Mode] | None) -> tuple[Constraint, ...]:
        """Return its contact points as constraints: points and balls that stick or slide."""
        if not isinstance(self.on, Plane) or self.shape.over_plane is not None:
            return self._wandering(modes)
        chosen = {}
        for point in self.shape.contact_points:
            name = self._called(point)
            chosen[name] = "stick" if modes is None else modes.get(name, "open"), point
        return tuple(
            self._holding(name, point, sticks=mode == "stick")
            for name, (mode, point) in chosen.items()
            if mode != "open"
        )

    def write_mjcf(self, to: MjcfGeomWriter) -> None:
        """Write two geoms that touch each other, and nothing else."""
        if self.restitution:
            raise InvalidModel(
                f"contact {self.name!r} has restitution = {self.restitution:g}; MuJoCo has no such "
                "coefficient; dataclasses.replace(contact, restitution=0.0) leaves it out"
            )
        if isinstance(self.on, Ground):
            raise InvalidModel(
                f"contact {self.name!r} is on a Ground, which is not written; on=Plane(...) or a "
                "FrictionalContact(..., on='universe', on_shape=Box(...)) for each box is"
            )
        below = self.on if isinstance(self.on, Plane) else (self.on, self.on_shape)
        to.collide(self.name, (self.frame, self.offset, self.shape), below, self.friction)

    def _holding(self, name: str, point: ContactPoint, *, sticks: bool) -> Constraint:
        assert isinstance(self.on, Plane)
        x, y, z = (a + b for a, b in zip(self.offset, point.middle, strict=True))
        if not sticks:
            return PlanarContact(self.frame, (x, y, z), self.on.normal, name=name)
        if not point.radius:
            return PointContact(self.frame, (x, y, z), name=name)
        if x or y or z:
            raise UnsupportedConstraint(
                f"{name}: its centre has to be the origin of a frame, and is not that of "
                f"{self.frame!r}; Robot.with_frame puts one there"
            )
        return RollingBall(self.frame, point.radius, self.on.normal, name=name)

    def _wandering(self, modes: Mapping[str, Mode] | None) -> tuple[()]:
        """Return nothing if all its candidates are open: they are no points of the body."""
        if modes is None or any(m != "open" for name, m in modes.items() if self.owns(name)):
            cure = (
                "is between two bodies: hold them together with a Loop"
                if not isinstance(self.on, Plane | Ground)
                else f"touches in other points as it turns: hold {self.frame!r} with a PointContact"
            )
            raise UnsupportedConstraint(f"{self.name} {cure}")
        return ()

    def _called(self, point: ContactPoint) -> str:
        return f"{self.name}/{point.called}" if point.called else self.name


def _solids(*placed: tuple[int, Any, Shape]) -> tuple[BoundShape, ...]:
    """Shapes on joints that are drawn."""
    return tuple(
        BoundShape(joint, at, shape.patch) for joint, at, shape in placed if shape.patch is not None
    )
