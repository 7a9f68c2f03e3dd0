"""Balance: where a robot presses on the floor, and where it is about to fall.

With m cddot = f + m g and L the angular momentum about the centre of mass c, the contacts exert

    f = m (cddot - g),    n_O = Ldot + c x f          about the origin of the world.

On one plane with normal e through a point p of it, the moment M_p = n_O - p x f leaves

    ZMP = p + e x M_p / (f . e),    a moment along e alone,

which is where the pressure of all contacts has its centre, as long as none pulls. On a plane
below c, at a distance h,

    omega = sqrt(g / h),    DCM = c + cdot / omega,    capture point = its foot on the plane:

where the linear inverted pendulum of constant h comes to rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import Arguments
from condyn_pin._core.arrays import Array, check_overflow, finite
from condyn_pin._core.trees import whole_data
from condyn_pin.contact.cones import Cones
from condyn_pin.control.contact_wrenches import wrench_margin
from condyn_pin.control.pressure import Pressure, pressed
from condyn_pin.control.support import (
    SupportPlane,
    SupportPolygon,
    check_touching,
    hull,
    margin_within,
    plane_of,
)
from condyn_pin.dynamics.scene import Scene, check_bilateral, check_scene
from condyn_pin.dynamics.solution import Sites, upward


@dataclass(frozen=True, eq=False, repr=False)
class Balance:
    """Centre of mass, centre of pressure and capture point of a robot, in the axes of the world.

    Quantities that are not defined are NaN: `zmp`, `cop`, `capture_point`, `dcm` and both margins
    if the contacts do not lie in one plane; `zmp` and its margin in the air, where nothing presses;
    the centre of pressure of a contact that carries no load.

    Attributes
    ----------
    com, com_velocity, com_acceleration : (3,) array
        Centre of mass [m], and how it moves [m/s, m/s^2].
    force, moment : (3,) array
        What the motion needs from outside beside gravity, f and n_O [N, N m], about the origin of
        the world.
    missing : (6,) array
        What of these the contacts do not exert [N, N m]: what else acts on the robot. Zero for
        forces that belong to a, where nothing does.
    zmp : (3,) array
        Zero-moment point, from q, v and a alone [m]; on one plane only.
    cop : (3,) array
        Centre of pressure of all contacts, from their forces alone [m]; on one plane only.
    cops : dict of str to (3,) array
        Centre of pressure of each contact by name [m]; valid on any ground.
    dcm : (3,) array
        Divergent component of motion, c + cdot / omega [m]; as long as the height stays.
    capture_point : (3,) array
        Its foot on the plane [m].
    polygon : SupportPolygon or None
        The hull of the contacts, where they are on one plane.
    zmp_margin, capture_margin : float
        How far either point is within the polygon [m]; negative outside.
    wrench_margin : float
        With cones: the largest margin to the cones that forces with this wrench can have [N];
        negative if none has one, and valid on any ground. NaN without cones.
    """

    com: Array
    com_velocity: Array
    com_acceleration: Array
    force: Array
    moment: Array
    missing: Array
    zmp: Array
    cop: Array
    cops: dict[str, Array]
    dcm: Array
    capture_point: Array
    polygon: SupportPolygon | None
    zmp_margin: float  # [m]
    capture_margin: float  # [m]
    wrench_margin: float  # [N]

    def __repr__(self) -> str:
        ground = "one plane" if self.polygon else "uneven ground"
        return (
            f"Balance(on {ground}: ZMP {self.zmp_margin:.4g} m and capture point "
            f"{self.capture_margin:.4g} m within the support)"
        )


def balance(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    lam: ArrayLike,
    *,
    cones: Cones | None = None,
) -> Balance:
    """Return centre of pressure, capture point and stability margins of a robot on the floor.

    zmp = p + e x M_p / (f . e),    dcm = c + cdot / omega,    omega = sqrt(g / h)

    with e the normal of the plane of the contacts, p a point of it, f and M_p what they exert.

    Parameters
    ----------
    scene : Scene
        With contacts that press on a floor.
    q, v, a : (nq,), (nv,), (nv,) array_like
        Configuration, velocity [rad/s, m/s] and acceleration [rad/s^2, m/s^2].
    lam : (m,) array_like
        Constraint forces that belong to a, such as those of a `Solution` or a `ControlAnswer`.
    cones : Cone or dict of str to Cone, optional
        To know how far the wrench is within the contact wrench cone.

    Returns
    -------
    Balance

    Raises
    ------
    InvalidArgument
        If an argument has a wrong size, is not finite or so large that forces overflow, nothing
        presses on a floor, or a contact does not say its size.
    UnsupportedConstraint
        If contacts may open: `scene.closed()` has those that count, `motion_balance` asks a run.

    Notes
    -----
    Costs half a millisecond, and with cones two more for a linear program.

    References
    ----------
    Sardain, Bessonnet. Forces acting on a biped robot: center of pressure, zero moment point. IEEE
    Transactions on Systems, Man, and Cybernetics, 2004. Pratt, Carff, Drakunov, Goswami. Capture
    point: a step toward humanoid push recovery. Humanoids, 2006.
    """
    check_scene(scene)
    check_bilateral(scene)
    model = scene.robot.unedited
    q_, v_, _ = Arguments(model).check(q, v, np.zeros(scene.robot.nv))
    a_ = finite("a", a, scene.robot.nv)
    forces = finite("lam", lam, scene.rows)
    at = Sites(scene, q_)
    with np.errstate(all="ignore"):  # what overflows is refused
        pressure = pressed(at, forces)
        check_touching(pressure.points)
        found = balanced(scene, q_, v_, a_, pressure)
        check_overflow("v", v_, found.com_velocity, found.com_velocity**2)
        check_overflow("a", a_, found.force, found.moment)
        check_overflow("lam", forces, found.missing)
    if cones is None:
        return found
    return replace(found, wrench_margin=wrench_margin(at, cones, found.force, found.moment))


def balanced(scene: Scene, q: Array, v: Array, a: Array, pressure: Pressure) -> Balance:
    """Return the balance of a robot that moves with a and presses on a floor as is said."""
    model = scene.robot.unedited
    data = whole_data(model)
    rate = pin.computeCentroidalMomentumTimeVariation(model, data, q, v, a)
    c, velocity = np.array(data.com[0]), np.array(data.vcom[0])
    gravity = np.array(model.gravity.linear)
    f = np.array(rate.linear) - scene.robot.mass * gravity
    n = np.array(rate.angular) + np.cross(c, f)
    points = pressure.points
    plane = plane_of(points, upward(scene)) if len(points) else None
    zmp = cop = dcm = foot = np.full(3, np.nan)
    polygon = None
    if plane is not None:
        polygon = hull(plane, points)
        size = scene.robot.mass * float(np.linalg.norm(gravity)) + float(
            np.linalg.norm(rate.linear)
        )
        zmp = _zero_moment_point(plane, f, n, tolerances.SOLVED * size)
        cop = _middle(plane, pressure.cops, pressure.forces)
        dcm, foot = _captured(plane, c, velocity, float(np.linalg.norm(gravity)))
    return Balance(
        com=c,
        com_velocity=velocity,
        com_acceleration=np.array(rate.linear) / scene.robot.mass,
        force=f,
        moment=n,
        missing=np.concatenate((f, n)) - pressure.exerted,
        zmp=zmp,
        cop=cop,
        cops=pressure.cops,
        dcm=dcm,
        capture_point=foot,
        polygon=polygon,
        zmp_margin=margin_within(polygon, zmp),
        capture_margin=margin_within(polygon, foot),
        wrench_margin=np.nan,
    )


def _middle(plane: SupportPlane, cops: dict[str, Array], pressing: dict[str, Array]) -> Array:
    """Return the centre of pressure of all contacts on one plane."""
    loads = {name: float(f @ plane.axes[2]) for name, f in pressing.items()}
    whole = sum(loads.values())
    if not whole > 0:
        return np.full(3, np.nan)
    return np.asarray(sum(load * cops[name] for name, load in loads.items()) / whole)


def _zero_moment_point(plane: SupportPlane, f: Array, n: Array, noise: float) -> Array:
    """Return the point of the plane about which f and n leave a moment along the normal alone.

    NaN where the load is no more than `noise` [N]: in the air it is what rounding leaves.
    """
    p, normal = plane.origin, plane.axes[2]
    load = float(f @ normal)
    if not load > noise:
        return np.full(3, np.nan)
    return np.asarray(p + np.cross(normal, n - np.cross(p, f)) / load)


def _captured(plane: SupportPlane, c: Array, velocity: Array, g: float) -> tuple[Array, Array]:
    """Return the divergent component of motion, and its foot on the plane."""
    normal = plane.axes[2]
    height = float((c - plane.origin) @ normal)
    if not (height > 0 and g > 0):
        return np.full(3, np.nan), np.full(3, np.nan)
    dcm = c + velocity / np.sqrt(g / height)
    return dcm, dcm - normal * float((dcm - plane.origin) @ normal)
