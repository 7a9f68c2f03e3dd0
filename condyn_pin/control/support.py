"""Support: polygon, centre of pressure, region of static balance.

SupportPolygon: a convex polygon on a plane, and what of a robot touches the floor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import listed
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.models import z_along
from condyn_pin.contact.cones import FAULTS, Cones
from condyn_pin.control.cones import grasp, placements, pyramids
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.scene import Scene, check_bilateral, check_scene
from condyn_pin.dynamics.solution import Sites, upward
from condyn_pin.errors import InvalidArgument


class SupportPlane(NamedTuple):
    """A plane in the world.

    Attributes
    ----------
    origin : (3,) array
        The mean of the contact points, in the world [m].
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
        The plane of the contacts.
    corners : (k, 2) array
        Counter-clockwise, along the two directions of the plane [m]; two of an edge, one of a
        point, none where nothing is possible.
    """

    plane: SupportPlane
    corners: Array

    def __repr__(self) -> str:
        corners = ", ".join(f"({x:.4g}, {y:.4g}, {z:.4g})" for x, y, z in self.in_world)
        return f"SupportPolygon({corners or 'nothing'}; corners in the world [m])"

    @property
    def in_world(self) -> Array:
        """The corners in the world (k, 3) [m]."""
        return np.asarray(self.plane.origin + self.corners @ self.plane.axes[:2])

    def margin(self, point: ArrayLike) -> float:
        """Return the distance of a point from the nearest edge, negative outside the polygon [m].

        Parameters
        ----------
        point : (3,) array_like
            In the world [m]; along the normal it is moved into the plane.
        """
        p = self.plane.axes[:2] @ (finite("point", point, 3) - self.plane.origin)
        return margin_of(self.corners, p)

    def reach(self, point: ArrayLike, way: ArrayLike) -> float:
        """Return the distance from a point to the far side of the polygon, along a direction [m].

        Parameters
        ----------
        point, way : (3,) array_like
            In the world [m, 1]; along the normal they are moved into the plane. Negative if the
            polygon is behind the point.

        Raises
        ------
        InvalidArgument
            If the direction has nothing along the plane, the contacts span no area, or the line
            misses it.
        """
        axes = self.plane.axes[:2]
        p = axes @ (finite("point", point, 3) - self.plane.origin)
        return reach_of(self.corners, p, along_plane(axes, way))


def margin_within(polygon: SupportPolygon | None, point: Array) -> float:
    """Return the margin of a point (3,) in a polygon [m]; NaN where one of them does not exist."""
    if polygon is None or not np.isfinite(point).all():
        return float("nan")
    return polygon.margin(point)


def along_plane(axes: Array, way: ArrayLike) -> Array:
    """Return a direction (3,) along a plane of two axes (2, 3), as a unit vector (2,) of it."""
    d = finite("way", way, 3)
    largest = float(np.abs(d).max())  # whose square may overflow, or vanish
    along = axes @ (d / largest) if largest > 0 else np.zeros(2)
    size = float(np.linalg.norm(along))
    if not size > tolerances.SOLVED:
        raise InvalidArgument("way: it is across the plane; a direction along it is needed")
    return np.asarray(along / size)


def margin_of(corners: Array, p: Array) -> float:
    """Return the margin of p (2,) in a convex polygon, counter-clockwise; negative outside."""
    if not len(corners):
        return -np.inf
    nexts = np.roll(corners, -1, axis=0)
    along, to = nexts - corners, p - corners
    lengths = np.maximum(np.einsum("ij,ij->i", along, along), np.finfo(float).tiny)
    share = np.clip(np.einsum("ij,ij->i", along, to) / lengths, 0.0, 1.0)
    distance = float(np.linalg.norm(to - share[:, None] * along, axis=1).min())
    left = along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]
    return distance if len(corners) > 2 and (left >= 0).all() else -distance


def reach_of(corners: Array, p: Array, d: Array) -> float:
    """Return the largest t with p + t d (2,) in a convex polygon, counter-clockwise."""
    if len(corners) < 3:
        raise InvalidArgument("the contacts span no area: no direction leads through it")
    sides = np.roll(corners, -1, axis=0) - corners
    out = np.column_stack((sides[:, 1], -sides[:, 0]))
    along, room = out @ d, np.einsum("ij,ij->i", out, corners - p)
    ahead, behind = along > 0, along < 0
    last = float((room[ahead] / along[ahead]).min())
    first = float((room[behind] / along[behind]).max())
    if first > last or (room[along == 0] < 0).any():
        raise InvalidArgument("the line from the point along the direction misses the support")
    return last


def hull(plane: SupportPlane, points: Array) -> SupportPolygon:
    """Return the convex hull of points on a plane."""
    return SupportPolygon(plane, convex_hull((points - plane.origin) @ plane.axes[:2].T))


def touching_points(at: Sites) -> Array:
    """Return the corners of all contacts in the world (k, 3)."""
    found = [np.zeros((0, 3))]
    forces = at.forces(np.zeros(at.scene.rows))
    for contact in at.scene.constraints:
        support = contact.support
        if support is None:
            continue
        x, y, axis = support
        if x is None or y is None:
            raise InvalidArgument(
                f"{contact.name}: half_length or half_width is not set, and its "
                "support is not known without"
            )
        if axis is not None:
            corners = np.outer((-x, x), np.eye(3)[axis])
        elif support.is_point:
            corners = np.zeros((1, 3))
        else:
            corners = np.array([(i * x, j * y, 0.0) for i in (-1, 1) for j in (-1, 1)])
        force = forces[contact.name]
        found.append(force.at + corners @ force.own.rotation.T)
    return np.vstack(found)


def check_touching(points: Array) -> None:
    """Refuse a question about the support of what nothing supports."""
    if not len(points):
        raise InvalidArgument("no contact: nothing in this scene presses on a floor")


def plane_of(points: Array, up: Array) -> SupportPlane | None:
    """Return the plane of points (k, 3), its normal upwards; None if they are on none."""
    # Points on a line, or a single one, are on many planes: the one that is nearest to level
    # counts.
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
    return SupportPlane(origin, axes_of(normal))


def level_floor(at: Sites) -> SupportPlane:
    """Return the floor under what presses on it; it has to be level."""
    points, up = touching_points(at), upward(at.scene)
    check_touching(points)
    if not up.any():
        raise InvalidArgument("scene: without gravity nothing stands")
    floor = plane_of(points, up)
    if floor is None or floor.axes[2] @ up < 1.0 - tolerances.COPLANAR:
        raise InvalidArgument("the contacts are not on one level plane, and balance here needs one")
    return floor


def axes_of(normal: Array) -> Array:
    """Return two directions across a normal and itself, row by row; those of the world if level."""
    return z_along(normal).T


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


# Pressure: where a robot touches a floor, and how it presses on it there.
#
# A contact exerts the force f and the moment m about its point p on the robot. On a floor of normal
# e its centre of pressure is
#
#     p + e x m / (f . e)        if it presses: f . e > 0.


class Pressure(NamedTuple):
    """Corners that touch a floor at one instant, and the pressure and force of each contact."""

    points: Array  # (k, 3) the corners of what touches, in the world [m]
    # (6,) the wrench on the robot about the origin of the world, force first [N, N m]
    exerted: Array
    cops: dict[str, Array]  # centre of pressure of each contact; NaN of those that do not press [m]
    forces: dict[str, Array]  # on the robot, of those that press, in the world [N]


def floor_pressure(at: Sites, lam: Array) -> Pressure:
    """Return the pressure of a scene's contacts on the floor under the forces lam (m,)."""
    exerted, cops, pressing = np.zeros(6), {}, {}
    robot = at.scene.robot
    weight = robot.mass * float(np.linalg.norm(robot.unedited.gravity.linear))
    noise = tolerances.SOLVED * max(weight, float(np.abs(lam).max(initial=0.0)))
    forces, up = at.forces(lam), upward(at.scene)
    for contact in at.scene.constraints:
        if contact.support is None:
            continue
        force = forces[contact.name]
        whole = np.zeros(6)
        whole[: len(force)] = force.in_world()
        f, m, p = whole[:3], whole[3:], force.at
        exerted += np.concatenate((f, m + np.cross(p, f)))
        normal = force.own.rotation[:, 2] if contact.has_normal else up
        load = float(f @ normal)
        if load > noise:
            cops[contact.name] = p + np.cross(normal, m) / load
            pressing[contact.name] = f
        else:
            cops[contact.name] = np.full(3, np.nan)
    return Pressure(touching_points(at), exerted, cops, pressing)


# Edges: forces on the surface of their cones, and centres on the edge of the support. A contact
# that neither slips nor tips yet has no friction or area left for what was not foreseen.


def edge_notices(scene: Scene, q: Array, lam: Array, active: Sequence[str]) -> tuple[str, ...]:
    """Notices of contacts whose forces are on the edge of their cones, by the active rows."""
    at_edge: dict[str, list[str]] = {}
    for row in active:
        name, _, fault = row.rpartition(": ")
        if fault.startswith(FAULTS) and name in scene.names:
            at_edge.setdefault(name, []).append(fault.partition(",")[0])
    if not at_edge:
        return ()
    faults = {name: tuple(dict.fromkeys(found)) for name, found in at_edge.items()}
    words = [f"{name} {' and '.join(_at_edge(found))}" for name, found in faults.items()]
    notices = [f"forces on the edge of their cones: {listed(words)}"]
    if any(each.startswith(("pulls", "tips")) for found in faults.values() for each in found):
        notices += _centres_on_edge(scene, q, lam)
    return tuple(notices)


def _at_edge(faults: Sequence[str]) -> list[str]:
    """Words of a contact at its edges: without load it is at all of them."""
    return ["carries nothing"] if "pulls" in faults else [f"nearly {fault}" for fault in faults]


def _centres_on_edge(scene: Scene, q: Array, lam: Array) -> Iterator[str]:
    """Yield notices of centres of pressure and mass that the support does not have within it."""
    equations, supports = equations_of(scene), [each.support for each in scene.constraints]
    at = Sites(scene, q, equations)
    if any(s and (s.half_length is None or s.half_width is None) for s in supports):
        return  # of a size that the cone alone knows
    pressure, up = floor_pressure(at, lam), upward(scene)
    plane = plane_of(pressure.points, up) if len(pressure.points) and up.any() else None
    if plane is None:  # on uneven ground edges are those of cones alone
        return
    f, n = pressure.exerted[:3], pressure.exerted[3:]
    e = plane.axes[2]
    centres = {"mass": np.array(pin.centerOfMass(equations.model, equations.data, q))}
    if float(f @ e) > 0.0:
        moment = n - np.cross(plane.origin, f)
        centres = {"pressure (ZMP)": plane.origin + np.cross(e, moment) / float(f @ e), **centres}
    polygon = hull(plane, pressure.points)
    for name, point in centres.items():
        margin = polygon.margin(point)
        if margin <= tolerances.COPLANAR:
            beyond = margin < -tolerances.COPLANAR
            place = f"{-1e3 * margin:.3g} mm beyond" if beyond else "on"
            yield f"the centre of {name} is {place} the edge of the support"


# The verb support_polygon: where a robot can stand, on one plane or on uneven ground.
#
# On one plane it is the convex hull of what touches: pressure has its centre in it. On uneven
# ground it is where the centre of mass can rest,
#
#     { (x, y) :  G lam = -(m g, c x m g),    A lam <= 0,    c = (x, y, .) },
#
# the shadow of a polytope: its corners are found by linear programs, one a direction.
#
# References
# ----------
# Bretl, Lall. Testing static equilibrium for legged robots. IEEE Transactions on Robotics, 2008.


_MOST_CORNERS = 200  # of a region on uneven ground; round cones have more
_FARTHEST = 100.0  # [m]: contacts that press against each other can hold the mass anywhere


def support_polygon(scene: Scene, q: ArrayLike, cones: Cones | None = None) -> SupportPolygon:
    """Return the support polygon of a robot on its contacts.

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
    """Return the region in which the centre of mass can rest."""
    # imported here: scipy.optimize takes as long to import as Pinocchio
    from scipy.optimize import linprog

    bound = pyramids(at.scene, cones)
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
