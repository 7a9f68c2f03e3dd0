"""Contacts that may let go: their shapes and points, the planes they may touch, their cones.

A point is grey while it is open, and told apart by its colour while it sticks and while it slides;
a shape is what the worst of its points is. A cone holds the forces that friction can give,
|lam_t| <= mu lam_n; it is not seen while its contact is open.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.touches import BoundContact, Touch
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io import meshes
from condyn_pin.viewing.instant import Instant
from condyn_pin.viewing.palette import CONE, GROUND, Colour, mode_colour
from condyn_pin.viewing.part import Part, at_point, joint_pose, then
from condyn_pin.viewing.patches import patch_mesh
from condyn_pin.viewing.touching import Touching

_POINT = 0.012  # radius of a contact point, of the size of the scene
_CONE = 0.1  # length of the side of a cone, of the size of the scene
_MARGIN = 0.25  # from the outermost contact point to the edge of a plane, of the size of the scene
_UNDER = 2e-3  # by which a plane is drawn too low, of the size of the scene: a grid may lie in it
_CLEAR = 0.5  # opacity of what would hide the robot
_ORDER = ("slide", "stick", "open")  # the worst first


def touch_parts(
    scene: Scene, instants: Sequence[Instant], size: float, *, cones: bool = False
) -> Iterator[Part]:
    """Yield the parts of all contacts of a scene that may let go.

    Parameters
    ----------
    scene : Scene
    instants : sequence of Instant
        A plane is drawn so large that every contact point is above it at all of them.
    size : float
        Of the scene [m].
    cones : bool
        Draw the friction cones.
    """
    for bound in scene.contact_bounds:
        for i, solid in enumerate(bound.solids):
            shape = patch_mesh(solid.patch).moved(solid.placement.homogeneous)
            path = f"{_folder(bound, instants)}/{bound.name}/shape {i}"
            yield Part(
                path, joint_pose(solid.joint), ((shape, mode_colour("")),), opacity=_CLEAR,
                tint=partial(_shape_colour, bound),
            )  # fmt: skip
        for name, _ in bound.cones:
            path = f"{_folder(bound, instants)}/{name}/point"
            ball = ((meshes.sphere(_POINT * size), mode_colour("")),)
            pose = then(_of(name), lambda here: at_point(here.at))
            yield Part(path, pose, ball, on_top=True, tint=partial(_point_colour, name))
            if cones:
                yield _cone_part(name, size)
    yield from _ground_parts(scene, instants, size)


def _folder(bound: BoundContact, instants: Sequence[Instant]) -> str:
    """Return what the legend knows the parts of a contact by: whether anybody asked its modes."""
    asked = any(mode for at in instants for mode in _modes(bound, at))
    return "touching" if asked else "candidates"


def _modes(bound: BoundContact, at: Instant) -> set[str]:
    return {at.touching[name].mode for name, _ in bound.cones if name in at.touching}


def _of(name: str) -> Callable[[Instant], Touching | None]:
    return lambda at: at.touching.get(name)


def _point_colour(name: str, at: Instant) -> Colour:
    return mode_colour(at.touching[name].mode if name in at.touching else "")


def _shape_colour(bound: BoundContact, at: Instant) -> Colour:
    modes = _modes(bound, at)
    return mode_colour(next((mode for mode in _ORDER if mode in modes), ""))


def _cone_part(name: str, size: float) -> Part:
    """Return the cone of the forces that a contact can give, all sides of one length."""
    unit = ((meshes.turned([(0.0, 0.0), (1.0, 1.0), (0.0, 1.0)]), CONE),)

    def pose(at: Instant) -> Array | None:
        here = at.touching.get(name)
        if here is None or here.mode == "open":
            return None
        height = _CONE * size / np.hypot(1.0, here.friction)
        radius = height * max(here.friction, 0.01)  # a needle on ice
        T = at_point(here.at)
        T[:3, :3] = here.axes * (radius, radius, height)
        return T

    return Part(f"cones/{name}", pose, unit, opacity=_CLEAR)


def _ground_parts(scene: Scene, instants: Sequence[Instant], size: float) -> Iterator[Part]:
    """Yield a square in each plane, below all points that may touch it."""
    above: dict[tuple[int, bytes], list[Touch]] = {}
    for bound in scene.contact_bounds:
        for touch in bound.touches:
            above.setdefault((touch.ground, touch.plane.homogeneous.tobytes()), []).append(touch)
    for (ground, _), touches in above.items():
        plane = touches[0].plane
        points = np.array([
            (at.joints[ground] * plane).actInv(at.touching[touch.name].at)[:2]
            for at in instants for touch in touches if touch.name in at.touching
        ])  # fmt: skip
        low, high = points.min(axis=0) - _MARGIN * size, points.max(axis=0) + _MARGIN * size
        x, y = np.meshgrid((low[0], high[0]), (low[1], high[1]))
        corners = np.column_stack([x.ravel(), y.ravel(), np.full(4, -_UNDER * size)])
        square = meshes.Mesh(corners, np.array([(0, 1, 3), (0, 3, 2)], dtype=np.uint32))
        square = square.moved(plane.homogeneous)
        path = f"grounds/of {touches[0].name}"
        yield Part(path, joint_pose(ground), ((square, GROUND),), opacity=_CLEAR)
