"""Part: a shape that never changes, with a pose that does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.io.meshes import Mesh
from condyn_pin.viewing import three
from condyn_pin.viewing.instant import Instant
from condyn_pin.viewing.palette import Colour

# A homogeneous matrix (4, 4) in the world, or None where the part is not to be seen.
Pose = Callable[[Instant], Array | None]
Tint = Callable[[Instant], Colour]

_Found = TypeVar("_Found")

_GHOST = 0.25  # opacity of what was
_NOWHERE = np.diag([1e-9, 1e-9, 1e-9, 1.0])  # too small to be seen; zero has no rotation


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a picture.

    Attributes
    ----------
    path : str
        Its name in meshcat's tree, such as ``closures/achilles/gap``.
    pose : Pose
    meshes : tuple of (Mesh, Colour)
    coarse : tuple of Mesh
        What is seen in place of each mesh while it moves, if a processor draws; none: the same.
    picture : bytes
        A PNG that faces the camera, in place of meshes.
    opacity : float
    on_top : bool
        Whether it is seen through what is before it.
    tint : callable, optional
        Its colour, where that changes with the instant.
    """

    path: str
    pose: Pose
    meshes: tuple[tuple[Mesh, Colour], ...] = ()
    coarse: tuple[Mesh, ...] = ()
    picture: bytes = b""
    opacity: float = 1.0
    on_top: bool = False
    tint: Tint | None = None

    def place(self, at: Instant) -> Array:
        """Return its pose (4, 4) at an instant; what is not to be seen is too small for that."""
        T = self.pose(at)
        return _NOWHERE if T is None else T

    def commands(self, at: Instant) -> Iterator[three.Command]:
        """Return the commands that draw it as it is at an instant."""
        for i, (shape, colour) in enumerate(self.meshes):
            chosen = colour if self.tint is None else self.tint(at)
            yield three.mesh(
                f"{self.path}/{i}", shape, chosen, opacity=self.opacity, on_top=self.on_top,
                coarse=self.coarse[i] if self.coarse else None,
            )  # fmt: skip
        if self.picture:
            yield three.label(f"{self.path}/0", self.picture)
        yield three.transform(self.path, self.place(at))

    def ghost(self, at: Instant) -> Part:
        """Return it as it was at an instant, beside what is."""
        T, tint = self.pose(at), self.tint
        colour = None if tint is None else tint(at)
        return replace(
            self,
            path=f"before/{self.path}",
            pose=lambda _: T,
            tint=None if colour is None else lambda _: colour,
            opacity=self.opacity if self.on_top else _GHOST,
        )


def then(found: Callable[[Instant], _Found | None], place: Callable[[_Found], Array]) -> Pose:
    """Return a pose that follows from something else, and is not to be seen where that is not."""

    def pose(at: Instant) -> Array | None:
        known = found(at)
        return None if known is None else place(known)

    return pose


def span(start: Array, end: Array) -> Array:
    """Return the matrix (4, 4) that takes the unit length along z to a segment."""
    along = end - start
    length = float(np.linalg.norm(along))
    z = along / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :4] = np.column_stack([x, np.cross(z, x), max(length, 1e-9) * z, start])
    return T


def joint_pose(i: int) -> Pose:
    """Return the pose of joint i as a function of the instant."""
    return lambda at: np.asarray(at.joints[i].homogeneous)


def at_point(point: Array) -> Array:
    """Return the matrix (4, 4) that moves the origin to a point."""
    T = np.eye(4)
    T[:3, 3] = point
    return T
