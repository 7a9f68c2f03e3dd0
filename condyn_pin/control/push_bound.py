"""The verb push_bound: how hard a robot may be pushed and yet stop without a step, with its motors.

The mass is moved by s along a direction of the floor, at constant height h over it. The pressure is
as far ahead as motors and floor let it be at that posture,

    p(s) = max p   with   M (x a + Y y) + h = B u + J^T lam,    a = omega^2 (s - p),
                          A lam <= 0,    |u| <= u_max,

one linear program a posture. x is the motion of the joints that moves the mass along and nothing
else: J x = 0, no angular momentum about horizontal axes, and of these the least kinetic energy.
Braked like that, the mass comes to rest where the pressure is no longer ahead of it, from

    v^2 = 2 omega^2 int_0^s* (p(s) - s) ds,    p(s*) = s*.

With motors of any strength it is the inverted pendulum of `capturable_speed`, p = min(d, s + mu h).

References
----------
Orsolino, Focchi, Caron, Raiola, Barasuol, Caldwell, Semini. Feasible region: an actuation-aware
extension of the support region. IEEE Transactions on Robotics, 2020.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.contact.cones import Cones
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.braking import Brake
from condyn_pin.control.support import along_plane, level_floor
from condyn_pin.dynamics.scene import Scene, check_bilateral, check_not_driven, check_scene
from condyn_pin.dynamics.solution import Sites
from condyn_pin.errors import InvalidArgument
from condyn_pin.mechanism.closing import anchored


@dataclass(frozen=True, eq=False, repr=False)
class PushBound:
    """The largest push that a robot stands without a step, along one direction.

    v^2 = 2 omega^2 int_0^s* (p(s) - s) ds,    omega^2 = gravity / height

    Attributes
    ----------
    way : (3,) array
        The direction of the push, along the floor [1].
    travel : (k,) array
        How far the mass has moved along it, to where it comes to rest at last: s [m].
    pressure : (k,) array
        How far ahead of where the mass was the centre of pressure can be then: p [m].
    motors : tuple of str
        The motors that hold the pressure back somewhere on the way, by name.
    height : float
        Of the centre of mass over the floor, h [m].
    mass : float
        Of the robot [kg].
    gravity : float
        Acceleration of gravity [m/s^2].
    """

    way: Array
    travel: Array
    pressure: Array
    motors: tuple[str, ...]
    height: float  # [m]
    mass: float  # [kg]
    gravity: float  # [m/s^2]

    @property
    def speed(self) -> float:
        """The largest speed of the centre of mass from which it stops [m/s]."""
        return self.speed_at(0.0)

    @property
    def impulse(self) -> float:
        """The largest impulse through the centre of mass [N s]."""
        return self.mass * self.speed

    def speed_at(self, s: float) -> float:
        """Return the largest speed from which it stops where its mass has moved by s [m/s].

        Parameters
        ----------
        s : float
            Along the way, from where it was at rest [m]; zero beyond its end.

        Raises
        ------
        InvalidArgument
            If s is negative: postures on that side have another bound.
        """
        s = float(finite("s", s, ()))
        if s < 0:
            raise InvalidArgument(f"s = {s:g} m: behind the start; the way back has its own bound")
        rest = np.append(s, self.travel[self.travel > s])
        ahead = np.interp(rest, self.travel, self.pressure) - rest
        return float(np.sqrt(2.0 * self.gravity / self.height * max(_area(rest, ahead), 0.0)))

    def __repr__(self) -> str:
        held = f", held back by {', '.join(self.motors)}" if self.motors else ""
        return f"PushBound({self.impulse:.4g} N s through the centre of mass{held})"


@one_blas_thread
def push_bound(
    scene: Scene,
    q: ArrayLike,
    way: ArrayLike,
    *,
    cones: Cones,
    actuation: Actuation | None = None,
    torque: bool = True,
    rigid: Sequence[str] = (),
) -> PushBound:
    """Return the largest push that a robot at rest stands without a step, with its motors.

    v^2 = 2 omega^2 int_0^s* (p(s) - s) ds,    p the farthest pressure that motors and floor allow

    A bound for robots that keep the height of their centre of mass and use no angular momentum: by
    swinging arms and trunk one may stand a little more.

    Parameters
    ----------
    scene : Scene
        With contacts that press on a level floor. They are held where they are at q.
    q : (nq,) array_like
        Where the robot stands [rad, m]; quaternions x y z w.
    way : (3,) array_like
        Direction of the push in the world [1]; what it has across the floor is left out.
    cones : Cone or dict of str to Cone
        Of the floor: one for all contacts that press on it, or one each by name.
    actuation : Actuation, optional
        The motors; those of the robot by default.
    torque : bool
        Whether motors keep to the effort limits of their joints.
    rigid : sequence of str
        Joints without a motor that are taken for rigid, such as stiff springs.

    Returns
    -------
    PushBound

    Raises
    ------
    InvalidArgument
        If nothing presses on a floor, it is not level, there is no gravity, or the centre of mass
        cannot move along the floor while the contacts hold.
    Infeasible
        If motors and floor cannot even hold the robot at rest.
    UnsupportedConstraint
        If contacts may open: `scene.closed()` has those that count. If constraints are driven.

    Notes
    -----
    Costs 0.1 s: twenty postures and as many linear programs. Velocity products along the way are
    neglected. It ends where a leg is stretched: contacts hold even if they would have to open
    there. Springs in `rigid` may throw a lightly loaded foot off the floor; the bound holds if it
    lands where it stood.

    References
    ----------
    Orsolino, Focchi, Caron, Raiola, Barasuol, Caldwell, Semini. Feasible region: an actuation-aware
    extension of the support region. IEEE Transactions on Robotics, 2020. Koolen, de Boer, Rebula,
    Goswami, Pratt. Capturability-based analysis and control of legged locomotion, part 1.
    International Journal of Robotics Research, 2012.
    """
    check_scene(scene)
    check_bilateral(scene)
    check_not_driven(scene, "push_bound")
    if not isinstance(torque, bool):
        raise InvalidArgument(f"torque = {torque!r}: True or False is needed")
    q_ = scene.robot.arguments.configuration("q", q)
    floor = level_floor(Sites(scene, q_))
    along = floor.axes[:2].T @ along_plane(floor.axes[:2], way)
    brake = Brake(anchored(scene, q_), q_, floor, along, cones, actuation, torque, rigid)
    travel, pressure, motors = brake.stop(q_)
    return PushBound(along, travel, pressure, motors, brake.height, scene.robot.mass, brake.gravity)


def _area(x: Array, y: Array) -> float:
    """Return the integral of y over x by trapezia."""
    return float((np.diff(x) * (y[1:] + y[:-1])).sum() / 2.0)
