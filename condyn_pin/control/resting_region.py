"""The verb support_polygon: where a robot can stand, on one plane or on uneven ground.

On one plane it is the convex hull of what touches: pressure has its centre in it. On uneven ground
it is where the centre of mass can rest,

    { (x, y) :  G lam = -(m g, c x m g),    A lam <= 0,    c = (x, y, .) },

the shadow of a polytope: its corners are found by linear programs, one a direction.

References
----------
Bretl, Lall. Testing static equilibrium for legged robots. IEEE Transactions on Robotics, 2008.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.cones import Cones
from condyn_pin.control.contact_cones import ContactCones
from condyn_pin.control.contact_wrenches import grasp, placements
from condyn_pin.control.support import (
    SupportPlane,
    SupportPolygon,
    axes_of,
    check_touching,
    convex_hull,
    hull,
    plane_of,
    touching_points,
)
from condyn_pin.dynamics.scene import Scene, check_bilateral, check_scene
from condyn_pin.dynamics.solution import Sites, upward
from condyn_pin.errors import InvalidArgument

_MOST_CORNERS = 200  # of a region on uneven ground; round cones have more
_FARTHEST = 100.0  # [m]: contacts that press against each other can hold the mass anywhere


def support_polygon(scene: Scene, q: ArrayLike, cones: Cones | None = None) -> SupportPolygon:
    """Return where a robot can stand on its contacts.

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        Configuration [rad, m]; quaternions x y z w.
    cones : Cone or dict of str to Cone, optional
        Without, the contacts have to be on one plane, and the polygon is their hull: the centre of
        pressure is in it. With cones it is where the centre of mass can rest, on any ground, with
        two directions that are horizontal.

    Returns
    -------
    SupportPolygon

    Raises
    ------
    InvalidArgument
        If nothing presses on a floor, a contact does not say its size, or, without cones, contacts
        are not on one plane.
    UnsupportedConstraint
        If contacts may open: `scene.closed()` has those that count.

    Notes
    -----
    Costs 0.2 ms, and with cones two milliseconds a corner.

    References
    ----------
    Bretl, Lall. Testing static equilibrium for legged robots. IEEE Transactions on Robotics, 2008.
    """
    check_scene(scene)
    check_bilateral(scene)
    at = Sites(scene, scene.robot.arguments.configuration("q", q))
    points = touching_points(at)
    check_touching(points)
    if cones is not None:
        return _resting_region(at, cones, points.mean(axis=0))
    plane = plane_of(points, upward(scene))
    if plane is None:
        raise InvalidArgument(
            "the contacts are not on one plane: support_polygon(scene, q, cones) finds where the "
            "centre of mass can rest"
        )
    return hull(plane, points)


def _resting_region(at: Sites, cones: Cones, origin: Array) -> SupportPolygon:
    """Return where the centre of mass can rest."""
    # imported here: scipy.optimize takes as long to import as Pinocchio
    from scipy.optimize import linprog

    bound = ContactCones(at.scene, cones)
    up = upward(at.scene)
    plane = SupportPlane(origin, axes_of(up))
    A, G = bound.rows(placements(at)), grasp(at, bound)
    # unknowns: lam over the weight, and where c is along the two directions
    moments = np.column_stack([np.cross(axis, -up) for axis in plane.axes[:2]])
    rows = np.block([[G, np.vstack((np.zeros((3, 2)), moments))]])
    wanted = np.concatenate((up, np.cross(origin, up)))
    limits = np.hstack((A, np.zeros((len(A), 2))))

    within = [(None, None)] * G.shape[1] + [(-_FARTHEST, _FARTHEST)] * 2

    def farthest(direction: Array) -> Array | None:
        cost = np.concatenate((np.zeros(G.shape[1]), -direction))
        found = linprog(cost, limits, np.zeros(len(A)), rows, wanted, bounds=within, method="highs")
        return np.array(found.x[-2:]) if found.status == 0 else None

    return SupportPolygon(plane, _shadow(farthest))


def _shadow(farthest: Callable[[Array], Array | None]) -> Array:
    """Return the corners of a convex polygon that is asked for its farthest point, by direction."""
    corners: list[Array] = []
    for angle in np.arange(3) * 2.0 * np.pi / 3.0:
        found = farthest(np.array([np.cos(angle), np.sin(angle)]))
        if found is None:
            return np.zeros((0, 2))
        corners.append(found)
    polygon = convex_hull(np.array(corners))
    checked: set[tuple[float, ...]] = set()
    while len(polygon) < _MOST_CORNERS:
        for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            edge = (*np.round(a, 9).tolist(), *np.round(b, 9).tolist())
            if edge in checked:
                continue
            checked.add(edge)
            outward = np.array([b[1] - a[1], a[0] - b[0]])
            size = float(np.linalg.norm(outward))
            beyond = farthest(outward / size) if size > tolerances.COPLANAR * 1e-3 else None
            if beyond is not None and (beyond - a) @ outward > 1e-6 * size:
                polygon = convex_hull(np.vstack((polygon, beyond)))
                break
        else:
            return polygon
    return polygon
