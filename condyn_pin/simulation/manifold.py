"""The manifold of configurations: R^3 x SO(3) of each floating body, R^2 x SO(2) of each plane.

Pinocchio has the linear velocity u of a free-flyer in the axes of its body, which turn with w.
Within a step from (q0, v0) coordinates y = (x, theta) and velocities V = (U, w) have U, and all
that is linear, in the axes that bodies have where the step begins. With E = exp(theta),

    q = (p0 + R0 x, R0 E),    v = (E^T U, w),
    x' = U,    theta' = Jr(theta)^-1 w,    U' = E (a_u + w x u),    w' = a_w,    a = (a_u, a_w)

and of all other joints q = integrate(q0, y), v = V; the theta of balls is that of bodies. What is
not pushed then flies straight, whatever it spins, and a ball rolls as fast as it did. In axes that
turn, explicit Euler makes u longer by (dt w)^2 / 2 of it in each step: a ball of 5 cm that rolls at
3 m/s would be twice as fast after 0.4 s in steps of 1 ms.

The tangent spaces of both groups have the same coordinates: `pin.difference`, derivatives and files
mean what they do in SE(3). Only paths of a finite length differ.

A step may turn a body by half a turn: what turns further is elsewhere for most of the step than
its stages are. A ball that nothing holds off its centre moves the same however it is turned, and
may turn by nearly a whole turn, where Jr has no inverse.

References
----------
Munthe-Kaas. High order Runge-Kutta methods on manifolds. Applied Numerical Mathematics 29, 1999.
"""

from __future__ import annotations

from collections.abc import Callable, Container
from functools import cached_property, partial
from math import cos, hypot, inf, isfinite, nan, pi, sin
from typing import Any, Final, TypeAlias

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import difference, unbounded

# Joints whose velocities do not commute, and which of their coordinates turn.
_CURVED = {
    "JointModelFreeFlyer": (3, 4, 5),
    "JointModelSpherical": (0, 1, 2),
    "JointModelPlanar": (2,),
}

# (t, q, v) -> a, of joints in their own axes.
Acceleration: TypeAlias = Callable[[float, Array, Array], Array]

# Of a body within a step: the index of its velocity, E as a quaternion, u and w.
_Flight: TypeAlias = tuple[
    int, tuple[float, float, float, float], tuple[float, float, float], tuple[float, float, float]
]

# How far a body may turn in a step [rad], and one that moves the same however it is turned: what is
# across theta counts 20 times in theta' there.
HALF_TURN: Final = pi
_NEARLY_A_TURN = 1.9 * pi

_SKEW = np.array([[0.0, -1.0], [1.0, 0.0]])  # S x is x turned by a quarter

# Squares of angles below which two terms of a series are exact [rad^2].
_SMALL = 1e-4


class Manifold:
    """The configurations of one model: flat where no joint turns about several axes, or floats."""

    def __init__(self, model: Any) -> None:
        self._model = model
        self._on_screws: Callable[[Array, Array], Array] = partial(pin.integrate, model)
        joints = [(i, j.shortname(), j.idx_q, j.idx_v) for i, j in enumerate(model.joints) if i]
        self._bodies = [(q, v) for _, name, q, v in joints if name == "JointModelFreeFlyer"]
        self._planar = [(q, v) for _, name, q, v in joints if name == "JointModelPlanar"]
        self.turns = [
            (model.names[i], [v + k for k in _CURVED[name]])
            for i, name, _, v in joints
            if name in _CURVED
        ]
        self._thetas = [at[0] for _, at in self.turns if len(at) == 3]
        self._angles = unbounded(model)
        self.floats = bool(self._bodies or self._planar)
        self.is_flat = not self.turns

    def slope(
        self, acceleration: Acceleration, t: float, q0: Array, y: Array, V: Array
    ) -> tuple[Array, Array]:
        """Return y' and V' (nv,) at coordinates y and velocities V of a step from q0."""
        if self._planar:
            q, v = self.place(q0, y, V)
            return self.rates(y, V, v, acceleration(t, q, v))
        at, of = y.tolist(), V.tolist()
        q, v, flights = self._placed(q0, y, V, at, of)
        a = acceleration(t, q, v)
        A, by = (a.copy(), a.tolist()) if flights else (a, [])
        for i, turn, (ux, uy, uz), (wx, wy, wz) in flights:
            ax = by[i] + (wy * uz - wz * uy)
            ay = by[i + 1] + (wz * ux - wx * uz)
            az = by[i + 2] + (wx * uy - wy * ux)
            A[i], A[i + 1], A[i + 2] = _rotated(*turn, ax, ay, az)
        return self._moving(V, at, of), A

    def place(self, q0: Array, y: Array, V: Array) -> tuple[Array, Array]:
        """Return q and v of coordinates y and velocities V of a step from q0."""
        if not self.floats:
            return self._on_screws(q0, y), V
        if self._planar:
            return self.integrate(q0, y), self.own(y, V)
        q, v, _ = self._placed(q0, y, V, y.tolist(), V.tolist())
        return q, v

    def rates(self, y: Array, V: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Return y' and V' (nv,) where bodies have the velocity v and the acceleration a."""
        return self.rate(y, V), self.carried(y, v, a)

    def rate(self, y: Array, V: Array) -> Array:
        """Return y' (nv,)."""
        return self._moving(V, y.tolist(), V.tolist())

    def _placed(
        self, q0: Array, y: Array, V: Array, at: list[float], of: list[float]
    ) -> tuple[Array, Array, list[_Flight]]:
        """Return q and v of coordinates, which are `at` and `of` too, and each body's flight."""
        q, flights = self._on_screws(q0, y), list[_Flight]()
        if not self._bodies:
            return q, V, flights
        v, begun = V.copy(), q0.tolist()
        for k, i in self._bodies:
            px, py, pz, e, f, g, h = begun[k : k + 7]
            a, b, c = _rotated(e, f, g, h, at[i], at[i + 1], at[i + 2])
            q[k], q[k + 1], q[k + 2] = px + a, py + b, pz + c
            a, b, c, d = turn = _quaternion(at[i + 3], at[i + 4], at[i + 5])
            u = v[i], v[i + 1], v[i + 2] = _rotated(-a, -b, -c, d, of[i], of[i + 1], of[i + 2])
            flights.append((i, turn, u, (of[i + 3], of[i + 4], of[i + 5])))
        return q, v, flights

    def _moving(self, V: Array, at: list[float], of: list[float]) -> Array:
        """Return y' (nv,) at coordinates and velocities, which are `at` and `of`."""
        if not self._thetas:
            return V
        rate = V.copy()
        for i in self._thetas:
            w = _rate(at[i], at[i + 1], at[i + 2], of[i], of[i + 1], of[i + 2])
            rate[i], rate[i + 1], rate[i + 2] = w
        return rate

    def carried(self, y: Array, v: Array, a: Array) -> Array:
        """Return V' (nv,) = E (a + w x u), of an acceleration in the axes of y."""
        return self._turned(y, self.straight(v, a)) if self.floats else a

    def straight(self, v: Array, a: Array) -> Array:
        """Return V' (nv,) where a step begins: a + w x u."""
        if not self.floats:
            return a
        if self._planar:
            return a + self.turning(v)
        A = a.copy()
        for _, i in self._bodies:
            x, y, z, p, q, r = v[i : i + 6].tolist()
            b, c, d = a[i : i + 3].tolist()
            b, c, d = b + (q * z - r * y), c + (r * x - p * z), d + (p * y - q * x)
            A[i], A[i + 1], A[i + 2] = b, c, d
        return A

    def own(self, y: Array, V: Array) -> Array:
        """Return velocities V (nv,), or V', in the axes that bodies have at y: E^T V."""
        return self._turned(y, V, -1.0) if self.floats else V

    def of_start(self, y: Array, v: Array) -> Array:
        """Return V (nv,) of velocities at y: E v."""
        return self._turned(y, v) if self.floats else v

    def of_own(self, y: Array, v: Array, A: Array) -> Array:
        """Return the acceleration (nv,) at y whose V' is A: E^T A - w x u."""
        return self.own(y, A) - self.turning(v) if self.floats else A

    def rows(self, J: Array, y: Array) -> Array:
        """Return rows (m, nv) at y for velocities V."""
        if not self.floats:
            return J
        J = J.copy()
        for _, i in self._bodies:
            J[:, i : i + 3] = J[:, i : i + 3].dot(pin.exp3(-y[i + 3 : i + 6]))
        self._turn_planar_rows(J, y)
        return J

    def integrate(self, q: Array, dq: Array) -> Array:
        """Return q moved along dq (nv,), bodies on straight lines."""
        moved = self._on_screws(q, dq)
        for k, i in self._bodies:
            x, y, z, *turn = q[k : k + 7].tolist()
            a, b, c = _rotated(*turn, *dq[i : i + 3].tolist())
            moved[k], moved[k + 1], moved[k + 2] = x + a, y + b, z + c
        for k, i in self._planar:
            (x, y), (c, s) = dq[i : i + 2].tolist(), q[k + 2 : k + 4].tolist()
            moved[k : k + 2] = q[k] + c * x - s * y, q[k + 1] + s * x + c * y
        return moved

    def between(self, q0: Array, q1: Array, turn: Array) -> Array:
        """Return the y (nv,) that leads from q0 to q1 of all those that do; theta is near `turn`.

        A body that is turned by theta is so by theta less a whole turn, too.
        """
        y = np.array(difference(self._model, q0, q1))
        for i in self._angles:
            y[i] += 2 * pi * round((turn[i] - y[i]).item() / (2 * pi))
        for i in self._thetas:
            theta, angle = y[i : i + 3], hypot(*y[i : i + 3].tolist())
            if angle > 0:
                along = theta.dot(turn[i : i + 3]).item() / angle
                y[i : i + 3] = theta * (1 + 2 * pi * round((along - angle) / (2 * pi)) / angle)
        for k, i in self._bodies:
            a, b, c, d = q0[k + 3 : k + 7].tolist()
            y[i : i + 3] = _rotated(-a, -b, -c, d, *(q1[k : k + 3] - q0[k : k + 3]).tolist())
        for k, i in self._planar:
            (x, z), (c, s) = (q1[k : k + 2] - q0[k : k + 2]).tolist(), q0[k + 2 : k + 4].tolist()
            y[i : i + 2] = c * x + s * z, c * z - s * x
        return y

    def turned(self, v: Array, dt: float) -> Array:
        """Return v in the axes that bodies have after dt."""
        return self._turned(v, v, -dt)

    def turning(self, v: Array) -> Array:
        """Return w x u of each body (nv,), zero elsewhere: how fast u changes by turning axes."""
        turning = np.zeros(len(v))
        for _, i in self._bodies:
            x, y, z, a, b, c = v[i : i + 6].tolist()
            turning[i], turning[i + 1], turning[i + 2] = b * z - c * y, c * x - a * z, a * y - b * x
        for _, i in self._planar:
            x, y, w = v[i : i + 3].tolist()
            turning[i : i + 2] = -w * y, w * x
        return turning

    def turning_by(self, v: Array) -> Array:
        """Return w x u by v (nv, nv)."""
        by_v = np.zeros((len(v), len(v)))
        for _, i in self._bodies:
            by_v[i : i + 3, i : i + 3] = pin.skew(v[i + 3 : i + 6])
            by_v[i : i + 3, i + 3 : i + 6] = -pin.skew(v[i : i + 3])
        for _, i in self._planar:
            by_v[i : i + 2, i : i + 2] = v[i + 2] * _SKEW
            by_v[i : i + 2, i + 2] = _SKEW @ v[i : i + 2]
        return by_v

    def rows_before(self, J: Array, v: Array, dt: float) -> Array:
        """Return rows (m, nv) after dt, for velocities in the axes that bodies have before it."""
        if not self.floats:
            return J
        J = J.copy()
        for _, i in self._bodies:
            turn = pin.exp3(-dt * v[i + 3 : i + 6])
            J[:, i : i + 3] = J[:, i : i + 3].dot(turn)
            J[:, i + 3 : i + 6] = J[:, i + 3 : i + 6].dot(turn)
        self._turn_planar_rows(J, dt * v)
        return J

    def _turned(self, y: Array, V: Array, way: float = 1.0) -> Array:
        """V (nv,), its linear velocities of bodies rotated by `way` times the theta of y."""
        turned = V.copy()
        for _, i in self._bodies:
            a, b, c = y[i + 3 : i + 6].tolist()
            turn = _quaternion(way * a, way * b, way * c)
            turned[i], turned[i + 1], turned[i + 2] = _rotated(*turn, *V[i : i + 3].tolist())
        for _, i in self._planar:
            x, z = V[i : i + 2].tolist()
            angle = _finite(way * float(y[i + 2]))
            c, s = cos(angle), sin(angle)
            turned[i : i + 2] = c * x - s * z, c * z + s * x
        return turned

    def _turn_planar_rows(self, J: Array, y: Array) -> None:
        for _, i in self._planar:
            angle = _finite(float(y[i + 2]))
            c, s = cos(angle), sin(angle)
            x, z = J[:, i].copy(), J[:, i + 1].copy()
            J[:, i], J[:, i + 1] = c * x - s * z, s * x + c * z

    def largest_turn(self, theta: Array) -> tuple[str, float]:
        """Name of the curved joint with the largest rotation in theta, and that angle [rad]."""
        turns = [(hypot(*theta[at[0] : at[-1] + 1].tolist()), name) for name, at in self.turns]
        angle, name = max(turns, default=(0.0, ""))
        return name, angle

    def slow(self, dt: float) -> float | None:
        """Return the v^T v below which no step of dt turns too far; None if there is no end."""
        return None if self.is_flat else (HALF_TURN / dt) ** 2

    def turn_fault(self, v: Array, dt: float, balls: Container[str]) -> str:
        """Message on a joint that turns too far in a step of dt; empty if none does."""
        # `balls` are joints whose bodies move the same however they are turned.
        for name, at in self.turns:
            speed = float(np.linalg.norm(v[at]))
            if not speed * dt > HALF_TURN:
                continue
            if speed * dt == inf:  # no dt would follow it
                return (
                    f"a step of {dt:.3g} s is not finite, the speed of joint {name!r} overflows: "
                    "look at v, tau and masses, or take a smaller dt"
                )
            end, what = HALF_TURN, "half a turn, pi"
            if name in balls:
                end, what = _NEARLY_A_TURN, "1.9 pi, nearly a turn of a ball"
            if speed * dt > end:
                return (
                    f"joint {name!r} turns by {speed * dt:.3g} rad in a step of {dt:.3g} s, and "
                    f"steps follow it up to {what}: take dt below {end / speed:.2g} s, better a "
                    "tenth of that, or DormandPrince(), which takes smaller steps where it must"
                )
        return ""

    @cached_property
    def balls(self) -> frozenset[str]:
        """Joints that move one body alone, whose inertia is the same however it turns."""
        return frozenset(name for name, at in self.turns if _is_ball(self._model, name, at))

    @cached_property
    def reach(self) -> float:
        """Scale of joint distances from the world's origin [m]: sum of all joint offsets."""
        placements = self._model.jointPlacements
        return sum(float(np.abs(p.translation).max()) for p in placements)


def _is_ball(model: Any, name: str, at: list[int]) -> bool:
    """True if a joint moves one body alone, whose inertia is the same however it turns."""
    i = model.getJointId(name)
    if i in list(model.parents):
        return False
    body, joint, is_planar = model.inertias[i], model.joints[i], len(at) == 1
    moments, lever = np.array(body.inertia), np.array(body.lever)
    if is_planar:  # it turns about z alone
        moments, lever = moments[2:, 2:], lever[:2]
    J = float(np.trace(moments)) / len(moments)
    is_round = np.abs(moments - J * np.eye(len(moments))).max() <= tolerances.MOMENT * J
    along, about = np.split(
        model.armature[joint.idx_v : joint.idx_v + joint.nv], [joint.nv - len(at)]
    )  # the first would turn with the body's axes: m (v' + w x v) + A v' = f
    is_centred = body.mass * lever.dot(lever) <= tolerances.MOMENT**2 * J
    return bool(is_round and is_centred and not along.any() and (about == about[0]).all())


# Numbers one by one: Pinocchio's take twice as long, to come into Python and to leave it.


def _rotated(
    qx: float, qy: float, qz: float, qw: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return a vector turned by a unit quaternion: u + w t + r x t, with t = 2 r x u."""
    tx, ty, tz = 2 * (qy * z - qz * y), 2 * (qz * x - qx * z), 2 * (qx * y - qy * x)
    return (
        x + qw * tx + (qy * tz - qz * ty),
        y + qw * ty + (qz * tx - qx * tz),
        z + qw * tz + (qx * ty - qy * tx),
    )


def _quaternion(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the unit quaternion of a rotation vector [rad]."""
    half = _finite(0.5 * hypot(x, y, z))
    share = 0.5 * sin(half) / half if half else 0.5
    return share * x, share * y, share * z, cos(half)


def _rate(x: float, y: float, z: float, a: float, b: float, c: float) -> tuple[float, float, float]:
    """Return Jr(theta)^-1 w = w + theta x w / 2 + k theta x (theta x w), theta' of w [rad/s]."""
    # k = (1 - (t/2) cot(t/2)) / t^2 with t = |theta|, smooth up to a whole turn.
    square = x * x + y * y + z * z
    if square < _SMALL:
        k = 1 / 12 + square / 720
    else:
        half = _finite(0.5 * square**0.5)
        k = (1 - half * cos(half) / sin(half)) / square
    p, q, r = y * c - z * b, z * a - x * c, x * b - y * a
    return (
        a + 0.5 * p + k * (y * r - z * q),
        b + 0.5 * q + k * (z * p - x * r),
        c + 0.5 * r + k * (x * q - y * p),
    )


def _finite(angle: float) -> float:
    """Return an angle, NaN if it is infinite: Python raises for sin and cos of infinity."""
    return angle if isfinite(angle) else nan
