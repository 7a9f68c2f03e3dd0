"""SupportPolygon: where a robot can stand, on one plane or on uneven ground.

On one plane it is the convex hull of what touches: pressure has its centre in it. On uneven ground
it is where the centre of mass can rest,

    { (x, y) :  grasp(lam) = -(m g, c x m g),    A lam <= 0,    c = (x, y, .) },

the shadow of a polytope: its corners are found by linear programs, one a direction.

References
----------
Bretl, Lall. Testing static equilibrium for legged robots. IEEE Transactions on Robotics, 2008.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin.contact.scene_cones import Cones
from condyn_pin.control.contact_cones import ContactCones
from condyn_pin.dynamics.force import Sites, upward
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.errors import InvalidArgument

_MOST_CORNERS = 200  # of a region on uneven ground; round cones have more
_FARTHEST = 100.0  # [m]: contacts that press against each other can hold the mass anywhere


class SupportPlane(NamedTuple):
    """A plane in the world.

    Attributes
    ----------
    origin : (3,) array
        Middle of what touches [m].
    axes : (3, 3) array
        Two directions in the plane, and its normal, row by row [1].
    """

    origin: Array
    axes: Array


@dataclass(frozen=True, eq=False)
class SupportPolygon:
    """A convex polygon on a plane.

    Attributes
    ----------
    plane : SupportPlane
    corners : (k, 2) array
        Counter-clockwise, along the two directions of the plane [m]; two of an edge, one of a
        point, none where nothing is possible.
    """

    plane: SupportPlane
    corners: Array

    @property
    def in_world(self) -> Array:
        """The corners in the world (k, 3) [m]."""
        return np.asarray(self.plane.origin + self.corners @ self.plane.axes[:2])

    def margin(self, point: ArrayLike) -> float:
        """Return how far a point is within the polygon, negative if it is outside [m].

        Parameters
        ----------
        point : (3,) array_like
            In the world [m]; along the normal it is moved into the plane.
        """
        p = self.plane.axes[:2] @ (finite("point", point, 3) - self.plane.origin)
        return margin_of(self.corners, p)


def margin_of(corners: Array, p: Array) -> float:
    """Return how far p (2,) is within a convex polygon, counter-clockwise; negative outside."""
    if not len(corners):
        return -np.inf
    nexts = np.roll(corners, -1, axis=0)
    along, to = nexts - corners, p - corners
    lengths = np.maximum(np.einsum("ij,ij->i", along, along), np.finfo(float).tiny)
    share = np.clip(np.einsum("ij,ij->i", along, to) / lengths, 0.0, 1.0)
    distance = float(np.linalg.norm(to - share[:, None] * along, axis=1).min())
    left = along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]
    return distance if len(corners) > 2 and (left >= 0).all() else -distance


def support_polygon(scene: Scene, q: ArrayLike, cones: Cones | None = None) -> SupportPolygon:
    """Return where a robot can stand on its contacts.

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
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

    Notes
    -----
    Costs 0.2 ms, and with cones two milliseconds a corner.

    References
    ----------
    Bretl, Lall. Testing static equilibrium for legged robots. IEEE Transactions on Robotics, 2008.
    """
    check_scene(scene)
    at = Sites(scene, normalised(scene.robot.model, "q", q))
    points = np.vstack(list(touching_points(at).values()))
    if cones is not None:
        return _resting_region(at, cones, points.mean(axis=0))
    plane = plane_of(points, upward(scene))
    if plane is None:
        raise InvalidArgument(
            "the contacts are not on one plane: support_polygon(scene, q, cones) finds where the "
            "centre of mass can rest"
        )
    return hull(plane, points)


def hull(plane: SupportPlane, points: Array) -> SupportPolygon:
    """Return the convex hull of points on a plane."""
    return SupportPolygon(plane, convex_hull((points - plane.origin) @ plane.axes[:2].T))


def touching_points(at: Sites) -> dict[str, Array]:
    """Return the corners of each contact in the world (k, 3), by name."""
    found = {}
    forces = at.forces(np.zeros(at.scene.rows))
    for contact in at.scene.constraints:
        support = contact.support
        if support is None:
            continue
        x, y, axis = support
        if x is None or y is None:
            raise InvalidArgument(
                f"{contact.name}: half_length or half_width is not set, so that nobody knows where "
                "it touches"
            )
        if axis is not None:
            corners = np.outer((-x, x), np.eye(3)[axis])
        elif support.is_point:
            corners = np.zeros((1, 3))
        else:
            corners = np.array([(i * x, j * y, 0.0) for i in (-1, 1) for j in (-1, 1)])
        force = forces[contact.name]
        found[contact.name] = force.at + corners @ force.rotation.T
    if not found:
        raise InvalidArgument("no contact: nothing here presses on a floor")
    return found


def plane_of(points: Array, up: Array) -> SupportPlane | None:
    """Return the plane of points (k, 3), its normal upwards; None if they are on none.

    Points on a line, or a single one, are on many planes: the one that is nearest to level counts.
    """
    origin = points.mean(axis=0)
    _, S, Vt = np.linalg.svd(points - origin, full_matrices=True)
    spread = np.zeros(3)
    spread[: len(S)] = S / np.sqrt(len(points))
    flat = int(np.count_nonzero(spread > tolerances.COPLANAR))
    if flat == 3:
        return None
    if flat == 2:
        normal = Vt[2] * (1.0 if Vt[2] @ up >= 0 else -1.0)
    else:
        normal = up - Vt[:flat].T @ (Vt[:flat] @ up)
        if not normal.any():
            return None
        normal /= np.linalg.norm(normal)
    return SupportPlane(origin, _axes(normal))


def _axes(normal: Array) -> Array:
    """Return two directions across a normal and itself, row by row; those of the world if level."""
    return np.array(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), normal).matrix().T)


def convex_hull(points: Array) -> Array:
    """Return the corners of the convex hull of points (k, 2), counter-clockwise (Andrew 1979)."""
    size = max(float(np.abs(points).max(initial=0.0)), np.finfo(float).tiny)
    order = np.unique(np.round(points / size, 12), axis=0) * size

    def chain(sequence: Array) -> list[Array]:
        kept: list[Array] = []
        for p in sequence:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], p) <= 1e-12 * size**2:
                kept.pop()
            kept.append(p)
        return kept

    if len(order) == 1:
        return np.asarray(order)
    return np.array(chain(order)[:-1] + chain(order[::-1])[:-1])


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def grasp(at: Sites, cones: ContactCones) -> Array:
    """Return G (6, m_c) of contacts with cones: G lam is their wrench about the world's origin."""
    scene, forces = at.scene, at.forces(np.zeros(at.scene.rows))
    columns = []
    for bound in scene.bounds:
        if bound.rows.start not in cones.touching:
            continue
        force = forces[bound.name]
        whole = np.array([bound.whole(row) for row in np.eye(bound.size)])
        f = force.rotation @ whole[:, :3].T
        moment = force.rotation @ whole[:, 3:].T if whole.shape[1] == 6 else 0.0
        columns.append(np.vstack((f, np.cross(force.at, f, axisb=0, axisc=0) + moment)))
    return np.hstack(columns)


def placements(at: Sites) -> Any:
    """Return the placements of the joints in the world."""
    model = at.scene.robot.unedited
    data = model.createData()
    pin.forwardKinematics(model, data, at.q)
    return data.oMi


def _resting_region(at: Sites, cones: Cones, origin: Array) -> SupportPolygon:
    """Return where the centre of mass can rest."""
    # imported here: scipy.optimize takes as long to import as Pinocchio
    from scipy.optimize import linprog

    bound = ContactCones(at.scene, cones)
    up = upward(at.scene)
    plane = SupportPlane(origin, _axes(up))
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
