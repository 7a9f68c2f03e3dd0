"""Labels: text that faces the camera, without overlaps in its initial view.

A label stands above its point. One that would cover another moves in the plane of the picture to
the nearest place that is free, and a thin line leads back to its point. Seen from elsewhere, and
later in a motion, labels keep these places beside their points.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Final

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.io import meshes
from condyn_pin.viewing.instant import Instant
from condyn_pin.viewing.part import GHOST, Colour, Part, Pose, span, then

_PIXELS: Final = 30  # of the font's height
_MARGIN: Final = 6  # [px]
_ABOVE: Final = 0.9  # heights from a point to the middle of its label
_INK: Final = 0.8  # of the height of a label: what its letters take
_LINE: Final = 0.03  # of the height of a label: the radius of the line to its point
_NEAR: Final = 1.1  # heights by which a label may be moved without a line


def label(path: str, text: str, colour: Colour, pose: Pose, height: float) -> Part:
    """Return a line of text above a point.

    Parameters
    ----------
    pose : Pose
        The point; a rotation is ignored.
    height : float
        Of a line [m].
    """
    png, width = _written(text, tuple(round(150 * x) for x in colour))

    def above(T: Array) -> Array:
        placed = np.diag([width * height, height, height, 1.0])
        placed[:3, 3] = T[:3, 3] + (0.0, 0.0, _ABOVE * height)
        return placed

    return Part(path, then(pose, above), picture=png, on_top=True)


@lru_cache(maxsize=256)
def _written(text: str, colour: tuple[int, ...]) -> tuple[bytes, float]:
    """Return a PNG of a text with a white rim, and its width over its height."""
    from PIL import Image, ImageDraw, ImageFont

    font = ImageFont.load_default(size=_PIXELS)
    left, _, right, _ = font.getbbox(text, stroke_width=3)
    size = (round(right - left) + 2 * _MARGIN, _PIXELS + 3 * _MARGIN)
    picture = Image.new("RGBA", size, (255, 255, 255, 0))
    ImageDraw.Draw(picture).text(
        (_MARGIN - left, 0.5 * size[1]), text, fill=(*colour, 255), font=font, anchor="lm",
        stroke_width=3, stroke_fill=(255, 255, 255, 235),
    )  # fmt: skip
    file = io.BytesIO()
    picture.quantize(32).save(file, "PNG")
    return file.getvalue(), size[0] / size[1]


@dataclass(frozen=True, eq=False)
class Camera:
    """Pose of the camera.

    Attributes
    ----------
    at, target : (3,) array
        Its position, and the point that it looks at [m].
    """

    at: Array  # [m]
    target: Array  # [m]

    @property
    def axes(self) -> Array:
        """Axes right, up and backward in the world, the rows of (3, 3)."""
        back = (self.at - self.target) / np.linalg.norm(self.at - self.target)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(back, right), back])

    def box(self, T: Array, shift: Array) -> Array:
        """Return left, bottom, right, top in the picture of a label at T (4, 4) after a shift."""
        x, y, z = self.axes @ (T[:3, 3] - self.at)
        half = 0.5 * np.array([T[0, 0], _INK * T[1, 1]])
        centre = np.array([x, y]) + shift
        box: Array = np.concatenate([centre - half, centre + half]) / max(-z, 1e-9)
        return box


def spread(parts: Sequence[Part], first: Instant, eye: Camera) -> Iterator[Part]:
    """Yield the parts, with labels moved so that none overlaps another at an instant."""
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
        by = shift @ eye.axes[:2]
        yield replace(part, pose=then(part.pose, partial(_moved, by=by)))
        if np.linalg.norm(shift) > _NEAR * T[1, 1]:
            yield _leader(part, by, _LINE * T[1, 1])


def _free(eye: Camera, T: Array, taken: Sequence[Array]) -> Iterator[tuple[Array, Array]]:
    """Shifts (2,) [m] that free a label of overlaps, the nearest first, and its box there."""
    width, height = T[0, 0], _INK * T[1, 1]
    sides = np.array([0.0, 0.35, -0.35, 0.7, -0.7]) * width
    steps = range(3 * len(taken) + 1)
    shifts = [np.array([x, s * k * height]) for k in steps for s in (1, -1) for x in sides]
    for shift in sorted(shifts, key=lambda each: float(np.hypot(0.6 * each[0], each[1]))):
        box = eye.box(T, shift)
        if not any(overlap(box, other) for other in taken):
            yield shift, box


def overlap(a: Array, b: Array) -> bool:
    """True if two boxes of left, bottom, right, top overlap."""
    return bool((a[:2] < b[2:]).all() and (b[:2] < a[2:]).all())


def _moved(T: Array, by: Array) -> Array:
    T = T.copy()
    T[:3, 3] += by
    return T


def _leader(label: Part, by: Array, radius: float) -> Part:
    """Leader line from the original position of a label to the shifted one."""

    def line(T: Array) -> Array:
        return span(T[:3, 3] - (0.0, 0.0, _ABOVE * T[1, 1]), T[:3, 3] + by)

    rod = ((meshes.rod(radius, 1.0, 6), GHOST),)
    return Part(f"{label.path} line", then(label.pose, line), rod, on_top=True)
