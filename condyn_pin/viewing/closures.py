"""Constraints: both frames of every loop, the patches of contacts, and gaps coloured by length."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from operator import methodcaller
from typing import Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import ConstraintViolation
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io import meshes
from condyn_pin.viewing.instant import Instant
from condyn_pin.viewing.labels import label
from condyn_pin.viewing.palette import AXES, CONTACT, Colour, gap_colour
from condyn_pin.viewing.part import Part, Pose, Tint, at_point, span, then
from condyn_pin.viewing.patches import patch_mesh


def closure_parts(
    scene: Scene, worst: Mapping[str, ConstraintViolation], size: float
) -> Iterator[Part]:
    """Yield the parts of every loop.

    Parameters
    ----------
    scene : Scene
    worst : mapping of str to ConstraintViolation
        What the labels say: the largest gap of all instants.
    size : float
        Of the scene [m].
    """
    for constraint in scene.constraints:
        if len(constraint.frames) == 2:
            name = constraint.name
            yield _frame(f"closures/{name}/frame_a", name, 0, 0.045 * size, 0.003 * size)
            yield _frame(f"closures/{name}/frame_b", name, 1, 0.032 * size, 0.005 * size)
            yield _gap(f"closures/{name}/gap", name, size)
            middle = _of_ends(name, lambda a, b: at_point(0.5 * (a.translation + b.translation)))
            # a ball in the middle of the gap, which also a closed loop shows
            ball = ((meshes.sphere(0.016 * size), gap_colour(0.0)),)
            yield Part(f"closures/{name}/state", middle, ball, on_top=True, tint=_tint(name))
            gap = worst.get(name)
            if gap is not None:
                text, colour = f"{name}: {_said(gap)}", gap_colour(gap.length)
                yield label(f"closures/{name}/label", text, colour, middle, 0.024 * size)


def contact_parts(scene: Scene, size: float) -> Iterator[Part]:
    """Yield the patch of every contact, and the segment from it to its anchor."""
    for constraint, bound in zip(scene.constraints, scene.bounds, strict=True):
        patch = constraint.patch(size)
        if patch is None:
            continue
        name = constraint.name
        pose = then(methodcaller("robot_end", name), _turned if patch.turns else _there)
        shape = ((patch_mesh(patch), CONTACT),)
        yield Part(f"contacts/{name}/patch", pose, shape, opacity=0.8, on_top=True)
        if bound.meets:
            yield _gap(f"contacts/{name}/gap", name, size)


def _turned(end: Any) -> Array:
    return np.asarray(end.homogeneous)


def _there(end: Any) -> Array:
    return at_point(end.translation)


def _gap(path: str, name: str, size: float) -> Part:
    """Return the segment from c1 to c2 of a constraint."""
    pose = _of_ends(name, lambda a, b: span(a.translation, b.translation))
    shape = ((meshes.rod(0.006 * size, 1.0, 12), gap_colour(0.0)),)
    return Part(path, pose, shape, on_top=True, tint=_tint(name))


def _frame(path: str, name: str, which: int, length: float, radius: float) -> Part:
    """Return the axes of frame c1 or c2: red, green, blue are x, y, z."""
    T = [span(np.zeros(3), axis) for axis in np.eye(3)]
    rod = meshes.rod(radius, length, 8)
    axes = tuple((rod.moved(t), colour) for t, colour in zip(T, AXES, strict=True))
    return Part(path, _of_ends(name, lambda *ends: _turned(ends[which])), axes, on_top=True)


def _of_ends(name: str, place: Callable[[Any, Any], Array]) -> Pose:
    """Return a pose that follows from the frames c1 and c2 of a constraint."""
    return then(lambda at: at.ends.get(name), lambda ends: place(*ends))


def _tint(name: str) -> Tint:
    def colour(at: Instant) -> Colour:
        return gap_colour(at.gaps[name].length if name in at.gaps else 0.0)

    return colour


def _said(gap: ConstraintViolation) -> str:
    return str(gap) if gap.size > tolerances.CLOSED else "closed"
