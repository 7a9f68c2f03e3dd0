"""Contacts: the points, edges and patches on which a robot stands, and how far they have left."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraints import Constraint, Coupling, Loop
from condyn_pin.constraints.contacts import LineContact, PlanarContact, SurfaceContact
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.dynamics.scene import Scene
from condyn_pin.viewing import meshes
from condyn_pin.viewing.closures import gap_part
from condyn_pin.viewing.moment import Moment
from condyn_pin.viewing.palette import CONTACT
from condyn_pin.viewing.part import Part, Pose, at_point, span

_THIN = 0.004  # of the size of the scene


def contact_parts(scene: Scene, size: float) -> Iterator[Part]:
    """Return the patch of every contact, and the segment from it to its anchor."""
    for constraint, bound in zip(scene.constraints, scene.bounds, strict=True):
        if isinstance(constraint, Loop | Coupling):
            continue
        name = constraint.name
        shape = ((_patch(constraint, size), CONTACT),)
        pose = _pose(constraint)
        yield Part(f"contacts/{name}/patch", pose, shape, opacity=0.8, on_top=True)
        if isinstance(bound, Bound) and bound.anchored:
            yield gap_part(f"contacts/{name}/gap", name, size)


def _patch(constraint: Constraint, size: float) -> meshes.Mesh:
    """Return the shape of a contact; one that says no size gets a twentieth of the scene's."""
    usual = 0.025 * size
    if isinstance(constraint, SurfaceContact):
        x, y = constraint.half_length or usual, constraint.half_width or usual
        return meshes.box(2.0 * x, 2.0 * y, _THIN * size)
    if isinstance(constraint, LineContact):
        half = constraint.half_length or usual
        axis = np.eye(3)["xyz".index(constraint.axis)]
        return meshes.cylinder(0.006 * size, 2.0 * half).moved(span(np.zeros(3), axis))
    if isinstance(constraint, PlanarContact):
        disc = meshes.cylinder(usual, _THIN * size)
        return disc.moved(span(np.zeros(3), np.array(constraint.normal)))
    return meshes.sphere(0.012 * size)


def _pose(constraint: Constraint) -> Pose:
    name = constraint.name

    def pose(at: Moment) -> Array | None:
        end = at.robot_end(name)
        if end is None:
            return None
        if isinstance(constraint, PlanarContact):  # its normal is one of the world
            return at_point(end.translation)
        return np.asarray(end.homogeneous)

    return pose
