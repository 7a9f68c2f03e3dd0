"""Functions of time with their first and second derivatives, along many directions at once.

What `campaign_oracle` builds robots of: turns, shifts, and motions that are constant in the axes of
the body, in 64 bits of mantissa.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = np.ndarray
REAL = np.longdouble
ONE = np.eye(3, dtype=REAL)


def exact(x: Any) -> Array:
    """Return numbers in extended precision."""
    return np.asarray(x, dtype=REAL)


def skew(w: Array) -> Array:
    """Return the matrices of w x."""
    K = np.zeros((*w.shape[:-1], 3, 3), dtype=REAL)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        K[..., j, i], K[..., i, j] = w[..., k], -w[..., k]
    return K


def vee(K: Array) -> Array:
    """Return the vectors of the skew parts of matrices."""
    D = (K - np.swapaxes(K, -1, -2)) / 2
    return np.stack([D[..., 2, 1], D[..., 0, 2], D[..., 1, 0]], axis=-1)


@dataclass(frozen=True)
class Jet:
    """A function of time along many directions: its value, its rate and the rate of that."""

    x: Array
    d: Array
    dd: Array

    def __add__(self, other: Jet) -> Jet:
        return Jet(self.x + other.x, self.d + other.d, self.dd + other.dd)

    def __sub__(self, other: Jet) -> Jet:
        return Jet(self.x - other.x, self.d - other.d, self.dd - other.dd)

    def map(self, linear: Callable[[Array], Array]) -> Jet:
        """Return a linear function of this."""
        return Jet(linear(self.x), linear(self.d), linear(self.dd))

    def over(self, other: Jet) -> Jet:
        """Return the quotient by a scalar."""
        x = self.x / other.x
        d = (self.d - x * other.d) / other.x
        return Jet(x, d, (self.dd - 2 * d * other.d - x * other.dd) / other.x)

    def root(self) -> Jet:
        """Return the square root."""
        x = np.sqrt(self.x)
        d = self.d / (2 * x)
        return Jet(x, d, (self.dd - 2 * d * d) / (2 * x))


def product(f: Callable[[Array, Array], Array], a: Jet, b: Jet) -> Jet:
    """Return what is linear in both."""
    return Jet(
        f(a.x, b.x), f(a.d, b.x) + f(a.x, b.d), f(a.dd, b.x) + 2 * f(a.d, b.d) + f(a.x, b.dd)
    )


def times(A: Jet, B: Jet) -> Jet:
    """Return A B."""
    return product(np.matmul, A, B)


def apply(A: Jet, b: Jet) -> Jet:
    """Return A b."""
    return product(lambda R, p: (R @ p[..., None])[..., 0], A, b)


def dot(a: Jet, b: Jet) -> Jet:
    """Return a . b, as (..., 1)."""
    return product(lambda x, y: (x * y).sum(axis=-1, keepdims=True), a, b)


def cross(a: Jet, b: Jet) -> Jet:
    """Return a x b."""
    return product(lambda x, y: np.cross(*np.broadcast_arrays(x, y)), a, b)


def unit(a: Jet) -> Jet:
    """Return a / |a|."""
    return a.over(dot(a, a).root())


def constant(x: Any) -> Jet:
    """Return what does not move."""
    x = exact(x)
    return Jet(x, np.zeros_like(x), np.zeros_like(x))


def transposed(A: Jet) -> Jet:
    """Return A^T."""
    return A.map(lambda R: np.swapaxes(R, -1, -2))


@dataclass(frozen=True)
class Place:
    """Axes and origin in the world, or in another place."""

    R: Jet
    p: Jet

    def __mul__(self, other: Place) -> Place:
        return Place(times(self.R, other.R), apply(self.R, other.p) + self.p)

    @property
    def w(self) -> tuple[Array, Array]:
        """Angular velocity and acceleration."""
        back = np.swapaxes(self.R.x, -1, -2)
        return vee(self.R.d @ back), vee(self.R.dd @ back)


def fixed(placement: Any) -> Place:
    """Return a placement that does not move."""
    return Place(constant(placement.rotation), constant(placement.translation))


def turn(axis: Array, angle: Jet) -> Place:
    """Return a turn, by Rodrigues; angle.x is an angle or (cos, sin)."""
    K, x, w = skew(axis), angle.x, angle.d
    c, s = (x[:1], x[1:]) if len(x) == 2 else (np.cos(x), np.sin(x))
    zero = np.zeros(3, dtype=REAL)

    def of(c: Array, s: Array) -> Array:
        return s[:, None, None] * K - c[:, None, None] * (K @ K)

    R = Jet(ONE + K @ K + of(c, s)[0], of(-s * w, c * w), of(-c * w * w, -s * w * w))
    return Place(R, Jet(zero, np.zeros((len(w), 3), REAL), np.zeros((len(w), 3), REAL)))


def shift(axis: Array, length: Jet) -> Place:
    """Return a shift along an axis."""
    return Place(constant(ONE), length.map(lambda x: x[..., None] * axis))


def body_motion(R: Array, p: Array, v: Array, w: Array) -> Place:
    """Return a motion with a velocity that is constant in its own axes."""
    K = skew(w)
    along = (R @ v[..., None])[..., 0]
    bent = (R @ K @ v[..., None])[..., 0]
    return Place(Jet(R, R @ K, R @ K @ K), Jet(p, along, bent))


def of_quaternion(quaternion: Array) -> Array:
    """Return the rotation of x y z w."""
    x, y, z, w = quaternion / np.sqrt((quaternion**2).sum())
    K = skew(np.array([x, y, z]))
    return ONE + 2 * w * K + 2 * K @ K
