"""Closures: both frames of every loop, and the gap between them, coloured by its length."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.violation import ConstraintViolation
from condyn_pin.dynamics.scene import Scene
from condyn_pin.viewing import meshes
from condyn_pin.viewing.labels import label
from condyn_pin.viewing.moment import Moment
from condyn_pin.viewing.palette import AXES, Colour, gap_colour
from condyn_pin.viewing.part import Part, Pose, Tint, at_point, span


def closure_parts(
    scene: Scene, worst: Mapping[str, ConstraintViolation], size: float
) -> Iterator[Part]:
    """Return the parts of every loop.

    Parameters
    ----------
    scene : Scene
    worst : mapping of str to ConstraintViolation
        What the labels say: the largest gap of all moments.
    size : float
        Of the scene [m].
    """
    for constraint in scene.constraints:
        if len(constraint.frames) == 2:
            name = constraint.name
            yield _frame(f"closures/{name}/frame_a", name, 0, 0.045 * size, 0.003 * size)
            yield _frame(f"closures/{name}/frame_b", name, 1, 0.032 * size, 0.005 * size)
            yield gap_part(f"closures/{name}/gap", name, size)
            yield _knob(f"closures/{name}/state", name, size)
            gap = worst.get(name)
            if gap is not None:
                yield _label(f"closures/{name}/label", name, gap, 0.024 * size)


def gap_part(path: str, name: str, size: float) -> Part:
    """Return the segment from c1 to c2 of a constraint."""

    def pose(at: Moment) -> Array | None:
        ends = at.ends.get(name)
        return None if ends is None else span(ends[0].translation, ends[1].translation)

    radius = 0.006 * size
    rod = meshes.turned([(0.0, 0.0), (radius, 0.0), (radius, 1.0), (0.0, 1.0)], 12)
    tint = _tint(name)
    return Part(path, pose, ((rod, gap_colour(0.0)),), on_top=True, tint=tint)


def _frame(path: str, name: str, which: int, length: float, radius: float) -> Part:
    """Return the axes of frame c1 or c2: red, green, blue are x, y, z."""
    T = [span(np.zeros(3), axis) for axis in np.eye(3)]
    rod = meshes.turned([(0.0, 0.0), (radius, 0.0), (radius, length), (0.0, length)], 8)
    axes = tuple((rod.moved(t), colour) for t, colour in zip(T, AXES, strict=True))

    def pose(at: Moment) -> Array | None:
        ends = at.ends.get(name)
        return None if ends is None else np.asarray(ends[which].homogeneous)

    return Part(path, pose, axes, on_top=True)


def _knob(path: str, name: str, size: float) -> Part:
    """Return a ball in the middle of the gap, which also a closed loop shows."""
    ball = meshes.sphere(0.016 * size)
    return Part(path, middle(name), ((ball, gap_colour(0.0)),), on_top=True, tint=_tint(name))


def _label(path: str, name: str, gap: ConstraintViolation, height: float) -> Part:
    said = str(gap) if gap.size > tolerances.CLOSED else f"{1e3 * gap.length:.1g} mm"
    return label(path, f"{name}: {said}", gap_colour(gap.length), middle(name), height)


def middle(name: str) -> Pose:
    """Return the middle between c1 and c2 as a function of the moment."""

    def pose(at: Moment) -> Array | None:
        ends = at.ends.get(name)
        if ends is None:
            return None
        return at_point(0.5 * (ends[0].translation + ends[1].translation))

    return pose


def _tint(name: str) -> Tint:
    def colour(at: Moment) -> Colour:
        return gap_colour(at.gaps[name].length if name in at.gaps else 0.0)

    return colour
