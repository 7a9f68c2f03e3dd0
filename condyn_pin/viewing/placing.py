"""Labels that do not cover one another, as the camera sees them at first.

A label stands above its point. One that would cover another moves in the plane of the picture to
the nearest place that is free, and a thin line leads back to its point. Seen from elsewhere, and
later in a motion, labels keep these places beside their points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.viewing import meshes
from condyn_pin.viewing.moment import Moment
from condyn_pin.viewing.palette import GHOST
from condyn_pin.viewing.part import Part, Pose, span

_INK: Final = 0.8  # of the height of a label: what its letters take
_LINE: Final = 0.03  # of the height of a label: the radius of the line to its point
_NEAR: Final = 1.1  # heights by which a label may be moved without a line


@dataclass(frozen=True, eq=False)
class Eye:
    """Where the camera is.

    Attributes
    ----------
    at, target : (3,) array
        Where it is, and what it looks at [m].
    """

    at: Array  # [m]
    target: Array  # [m]

    @property
    def axes(self) -> Array:
        """Return right, up and backward in the world, the rows of (3, 3)."""
        back = (self.at - self.target) / np.linalg.norm(self.at - self.target)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(back, right), back])

    def box(self, T: Array, shift: Array) -> Array:
        """Return left, bottom, right, top of a label at (4, 4) moved by `shift` (2,) [m]."""
        x, y, z = self.axes @ (T[:3, 3] - self.at)
        half = 0.5 * np.array([T[0, 0], _INK * T[1, 1]])
        centre = np.array([x, y]) + shift
        box: Array = np.concatenate([centre - half, centre + half]) / max(-z, 1e-9)
        return box


def spread(parts: Sequence[Part], first: Moment, eye: Eye) -> Iterator[Part]:
    """Return the parts with all labels where they do not cover one another at a moment."""
    taken: list[Array] = []
    for part in parts:
        T = part.pose(first) if part.picture else None
        if T is None:
            yield part
            continue
        here = (np.zeros(2), eye.box(T, np.zeros(2)))
        shift, box = next(_free(eye, T, taken), here)
        taken.append(box)
        if not shift.any():
            yield part
            continue
        moved = shift @ eye.axes[:2]
        yield replace(part, pose=_moved(part.pose, moved))
        if np.linalg.norm(shift) > _NEAR * T[1, 1]:
            yield _leader(part, moved, _LINE * T[1, 1])


def _free(eye: Eye, T: Array, taken: Sequence[Array]) -> Iterator[tuple[Array, Array]]:
    """Yield shifts [m] at which a label covers none, the nearest first, and its box there."""
    width, height = T[0, 0], _INK * T[1, 1]
    sides = np.array([0.0, 0.35, -0.35, 0.7, -0.7]) * width
    steps = range(3 * len(taken) + 1)
    shifts = [np.array([x, s * k * height]) for k in steps for s in (1, -1) for x in sides]
    for shift in sorted(shifts, key=lambda each: float(np.hypot(0.6 * each[0], each[1]))):
        box = eye.box(T, shift)
        if not any(_overlap(box, other) for other in taken):
            yield shift, box


def _overlap(a: Array, b: Array) -> bool:
    return bool((a[:2] < b[2:]).all() and (b[:2] < a[2:]).all())


def _moved(pose: Pose, by: Array) -> Pose:
    def moved(at: Moment) -> Array | None:
        T = pose(at)
        if T is None:
            return None
        T = T.copy()
        T[:3, 3] += by
        return T

    return moved


def _leader(label: Part, by: Array, radius: float) -> Part:
    """Return the line from where a label would stand to where it stands."""
    rod: Any = meshes.turned([(0.0, 0.0), (radius, 0.0), (radius, 1.0), (0.0, 1.0)], 6)

    def pose(at: Moment) -> Array | None:
        T = label.pose(at)
        if T is None:
            return None
        foot = T[:3, 3] - (0.0, 0.0, 0.9 * T[1, 1])
        return span(foot, T[:3, 3] + by)

    return Part(f"{label.path} line", pose, ((rod, GHOST),), on_top=True)
