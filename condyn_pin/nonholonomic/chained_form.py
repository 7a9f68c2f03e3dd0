"""Chained form: coordinates in which a wheeled vehicle is a chain of integrators.

    z_1' = u_1,    z_2' = u_2,    z_(j+1)' = z_j u_1,    j = 2 ... n - 1

With (x, y) the place of the last axle, y is a function of x along the path of a vehicle, and

    z_1 = x,    z_n = y,    z_(n-1) = dy/dx,    ...,    z_2 = d^(n-2) y / dx^(n-2).

Everything is in these derivatives. With theta the heading of an axle, kappa the curvature of its
path and s its length, an axle that is drawn by the one ahead, at the distance L, has

    tan(theta) = dy/dx,    kappa = dtheta/ds,    tan(delta) = L kappa,    ds / ds_ahead = cos(delta)

where delta is the angle from its own heading to that of the axle ahead; for the front axle of a car
it is the angle of steering. So each axle ahead takes one derivative more: Taylor's series in x say
all at once. A unicycle is an axle alone, a car has one distance, its wheelbase, and each trailer
one more. The form is singular where an axle is across x or across the one ahead of it.

References
----------
Murray, Sastry. Nonholonomic motion planning: steering using sinusoids. IEEE Transactions on
Automatic Control 38, 1993.
Sørdalen. Conversion of the kinematics of a car with n trailers into a chained form. IEEE
International Conference on Robotics and Automation, 1993.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised, quoted_names
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.models import indices
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.scene import Scene, check_not_driven, check_scene
from condyn_pin.errors import InvalidArgument

# Numbers that may be complex: their imaginary parts are derivatives, of steps that are as small as
# one likes (Lyness, Moler 1967).
Numbers = NDArray[Any]

_BASE: Final = ("x", "y", "heading")

# Cosine below which an axle counts as across another: tan of it has no digits left.
_ACROSS: Final = 1e-6

# Derivatives of the path at which the rows of a scene are compared with those of the form.
_LOOKS: Final = (0.0, 0.3, -0.2)


@dataclass(frozen=True)
class ChainedForm:
    """Chained form of a unicycle, a car, or a car with trailers.

    z_1' = u_1,    z_2' = u_2,    z_(j+1)' = z_j u_1

    Parameters
    ----------
    scene : Scene
        A vehicle seen from above: sliders ``x`` and ``y``, a hinge ``heading``; a car has a hinge
        ``steering`` too, and trailers ``hitch_1``, ``hitch_2``, ... with frames ``axle_1``, ...,
        as in `condyn_pin.model.car`. Other joints, such as wheels that roll, follow by the rows.

    Raises
    ------
    InvalidArgument
        If joints are missing, or the rows are not those of such a vehicle.
    UnsupportedConstraint
        If constraints are driven.

    Notes
    -----
    Headings and angles between axles are below 90 degrees: turn the axes of the world for others.
    A conversion costs 0.1 ms.
    """

    scene: Scene

    def __post_init__(self) -> None:
        check_scene(self.scene)
        check_not_driven(self.scene, "ChainedForm")
        names = self.scene.robot.joints
        if missing := [name for name in _BASE if name not in names]:
            raise InvalidArgument(
                f"scene: no joint {quoted_names(missing)}; a vehicle has sliders x and y and a "
                "hinge heading, as condyn_pin.model.unicycle() and car() have"
            )
        left = self.scene.robot.nv - self.scene.nominal.rank
        if left != 2:
            raise InvalidArgument(
                f"scene: its rows leave {left} velocities, where a vehicle has two, ahead and by "
                "its steering: no axle slips sideways, and wheels that turn roll"
            )
        for look in _LOOKS:
            self._check(self.to_joints(np.full(self.size, look)))

    def _check(self, q: Array) -> None:
        """Refuse a scene with other velocities than those of the form."""
        A = equations_of(self.scene).jacobian(q)
        for u in np.eye(2):
            left = A @ self.velocity(q, u)
            if np.abs(left).max(initial=0.0) > tolerances.CONSISTENT * np.abs(A).max(initial=1.0):
                raise InvalidArgument(
                    "scene: its rows leave other velocities than those of a unicycle or a car with "
                    "trailers, each hitched to the middle of the axle ahead"
                )

    @cached_property
    def lengths(self) -> tuple[float, ...]:
        """Distances L from axles to those ahead, the last axle first [m]; of a unicycle none."""
        model, names = self.scene.robot.model, self.scene.robot.joints
        if "steering" not in names:
            return ()
        hitches = (
            -float(model.frames[model.getFrameId(f"axle_{i}")].placement.translation[0])
            for i in range(len(self.joints) - len(_BASE) - 1, 0, -1)
        )
        ahead = model.jointPlacements[model.getJointId("steering")].translation[0]
        return (*hitches, float(ahead))

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Joints of the form, those of the base first."""
        names = self.scene.robot.joints
        if "steering" not in names:
            return _BASE
        found = [*_BASE, "steering"]
        for i in count(1):
            if (name := f"hitch_{i}") not in names:
                break
            found.append(name)
        return tuple(found)

    @property
    def size(self) -> int:
        """Number of coordinates z, n."""
        return len(self.joints)

    def to_chained(self, q: ArrayLike) -> Array:
        """Return z (n,) of a configuration q (nq,).

        Raises
        ------
        InvalidArgument
            If `q` has a wrong size, or an axle is across x or across the one ahead of it.
        """
        pose = normalised(self.scene.robot.model, "q", q)[self._at[0]]
        angles = self._angles(pose)
        x, y = pose[:2]
        heading = np.cumsum(angles[: len(self.lengths)])
        for theta, length in zip(heading[-2::-1], self.lengths[-2::-1], strict=False):
            x, y = x - length * np.cos(theta), y - length * np.sin(theta)
        # tan(delta) of each axle is affine in the derivative that it takes more
        found = [np.tan(angles[0])]
        for angle in angles[1:]:
            low, high = (_tangents([*found, trial], self.lengths)[-1] for trial in (0.0, 1.0))
            found.append((np.tan(angle) - low) / (high - low))
        return np.array([x, *found[::-1], y])

    def to_joints(self, z: ArrayLike, q: ArrayLike | None = None) -> Array:
        """Return q (nq,) of chained coordinates z (n,).

        Joints that are not of the form are where `q` (nq,) has them, in neutral position without.
        """
        model = self.scene.robot.model
        full = pin.neutral(model) if q is None else normalised(model, "q", q)
        found = np.array(full)
        found[self._at[0]] = self.pose(finite("z", z, self.size))
        return found

    def velocity(self, q: ArrayLike, u: ArrayLike) -> Array:
        """Return v (nv,) at q (nq,) under the inputs u (2,)."""
        q_, model = normalised(self.scene.robot.model, "q", q), self.scene.robot.model
        found = np.zeros(model.nv)
        found[self._at[1]] = self.pose_rate(self.to_chained(q_), finite("u", u, 2))
        others = np.setdiff1d(np.arange(model.nv), self._at[1])
        if len(others):
            A = equations_of(self.scene).jacobian(q_)
            found[others] = np.linalg.lstsq(A[:, others], -A @ found)[0]
        return found

    def inputs(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return u (2,) of a state with velocity v (nv,): what drives the chain so."""
        z, rate = self.to_chained(q), finite("v", v, self.scene.robot.nv)[self._at[1]]
        last = 3 if self.lengths else 2  # the angle that is steered
        one, two = (self.pose_rate(z, u) for u in np.eye(2))
        return np.linalg.solve([[one[0], two[0]], [one[last], two[last]]], [rate[0], rate[last]])

    def pose(self, z: Numbers) -> Numbers:
        """Return the values of the joints of the form (n,) at z (n,); complex z will do."""
        angles = [series[0] for series in _series(z[-2:0:-1], self.lengths)]
        x, y, theta = z[0], z[-1], angles[0]
        for length, angle in zip(self.lengths[:-1], angles[1:], strict=False):
            x, y = x + length * np.cos(theta), y + length * np.sin(theta)
            theta = theta + angle
        hitches = [-angle for angle in angles[-2:0:-1]]  # theta_i - theta_(i-1), the first first
        return np.array([x, y, theta, *angles[len(angles) : 0 : -1][:1], *hitches])

    def pose_rate(self, z: Numbers, u: Numbers) -> Numbers:
        """Return the rates of the joints of the form (n,) at z (n,) under the inputs u (2,)."""
        d = z[-2:0:-1]
        still, more = (_series([*d, e], self.lengths) for e in (0.0, 1.0))
        # along x each angle moves as its series says; the last one also as u_2 bends the path
        rates = [u[0] * series[1] for series in still]
        rates[-1] = rates[-1] + u[1] * (more[-1][1] - still[-1][1])
        angles = [series[0] for series in still]
        theta, turn = angles[0], rates[0]
        dx, dy = u[0], z[-2] * u[0]
        for length, angle, rate in zip(self.lengths[:-1], angles[1:], rates[1:], strict=False):
            dx, dy = dx - length * np.sin(theta) * turn, dy + length * np.cos(theta) * turn
            theta, turn = theta + angle, turn + rate
        hitches = [-rate for rate in rates[-2:0:-1]]
        return np.array([dx, dy, turn, *rates[len(rates) : 0 : -1][:1], *hitches])

    def __reduce__(self) -> tuple[Any, ...]:
        return ChainedForm, (self.scene,)

    @cached_property
    def _at(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Where q and v have the joints of the form."""
        return indices(self.scene.robot.model, self.joints)

    def _angles(self, pose: Array) -> Array:
        """Heading of the last axle, and the angle from each axle to the one ahead."""
        heading, steering, hitches = pose[2], pose[3:4], pose[4:]
        angles = np.array([heading + hitches.sum(), *(-hitches[::-1]), *steering])
        if np.cos(angles).min() < _ACROSS or np.abs(angles).max() > np.pi:
            raise InvalidArgument(
                f"q: the heading of the last axle and the angles between axles are "
                f"{np.degrees(angles).round(3)} deg: below 90 are needed; turn the axes of the "
                "world, or begin elsewhere"
            )
        return angles


# Angles of all axles as series in x, from the derivatives of y(x).


def _series(derivatives: Sequence[Any] | Numbers, lengths: Sequence[float]) -> list[Numbers]:
    """Taylor coefficients in x of theta of the last axle, and of each delta to the axle ahead."""
    slope = np.array(derivatives)  # y', y'', ...
    slope = slope / np.cumprod([1.0, *range(1, len(slope))])
    theta = _atan(slope)
    along = _power(_one_and_square(slope), -0.5)  # dx/ds
    found = [theta]
    for length in lengths:
        tangent = length * _times(along, _rate(theta))
        delta = _atan(tangent)
        found.append(delta)
        theta = theta[: len(delta)] + delta
        along = _times(along, _power(_one_and_square(tangent), -0.5))
    return found


def _tangents(derivatives: Sequence[Any], lengths: Sequence[float]) -> list[Any]:
    """Tangents at x of theta and of each delta, as many as the derivatives decide."""
    return [np.tan(each[0]) for each in _series(derivatives, lengths[: len(derivatives) - 1])]


def _times(a: Numbers, b: Numbers) -> Numbers:
    """Product of two series, as long as the shorter one."""
    n = min(len(a), len(b))
    return np.convolve(a[:n], b[:n])[:n]


def _rate(a: Numbers) -> Numbers:
    """Derivative of a series."""
    return a[1:] * np.arange(1, len(a))


def _one_and_square(a: Numbers) -> Numbers:
    """Series 1 + a^2."""
    found = _times(a, a)
    found[0] += 1.0
    return found


def _power(a: Numbers, exponent: float) -> Numbers:
    """Series a^exponent, a_0 > 0, by a b' = exponent a' b."""
    b = np.zeros_like(a)
    b[0] = a[0] ** exponent
    for k in range(1, len(a)):
        j = np.arange(1, k + 1)
        b[k] = ((exponent * j - (k - j)) * a[1 : k + 1]) @ b[k - 1 :: -1][:k] / (k * a[0])
    return b


def _atan(a: Numbers) -> Numbers:
    """Series of the arc tangent, by atan(a)' = a' / (1 + a^2)."""
    found = np.zeros_like(a)
    found[0] = np.arctan(a[0])
    if len(a) > 1:
        found[1:] = _times(_rate(a), _power(_one_and_square(a), -1.0)) / np.arange(1, len(a))
    return found
