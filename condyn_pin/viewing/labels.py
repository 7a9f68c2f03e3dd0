"""Labels: words that face the camera."""

from __future__ import annotations

import io
from functools import lru_cache

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.viewing.palette import Colour
from condyn_pin.viewing.part import Part, Pose

_PIXELS = 30  # of the font's height
_MARGIN = 6  # [px]


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

    def above(at: object) -> Array | None:
        T = pose(at)  # type: ignore[arg-type]
        if T is None:
            return None
        placed = np.diag([width * height, height, height, 1.0])
        placed[:3, 3] = T[:3, 3] + (0.0, 0.0, 0.9 * height)
        return placed

    return Part(path, above, picture=png, on_top=True)


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
