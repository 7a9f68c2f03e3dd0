"""Configurations as arrays of nq numbers, and as points of a manifold of nv dimensions.

A step t of the tangent moves the numbers of q by D(q) t:

    plain joints           q' = t
    quaternion x           x' = (w t + x_xyz x t, -x_xyz . t) / 2
    pair (cos, sin)        x' = (-sin, cos) t
    position before these  p' = R(x) t

What programs do to q leaves the unit numbers at any length, so a layer is that of q with these
normalised. With N their lengths (one elsewhere) and W = (D^T D)^-1, four for quaternions and one
elsewhere, numbers dq step along, and a gradient g of the tangent has for each number,

    t = W D^T N^-1 dq,        g_q = N^-1 D W g.
"""

from __future__ import annotations

from math import hypot
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot

# A unit part that is shorter than this has no direction.
_SHORTEST: Final = 1e-100

# What rounding leaves of a length of one: to divide by it would move the last bits again and again.
_ROUNDED: Final = 4 * float(np.finfo(float).eps)


class Configurations:
    """The configurations of one robot."""

    def __init__(self, robot: Robot) -> None:
        model = robot.model
        self.nq, self.nv = model.nq, model.nv
        joints = [j for j in model.joints if j.idx_q >= 0]
        curved = [j for j in joints if j.nq != j.nv]
        # of each curved joint: its numbers, its tangent, and where its unit part begins
        self._curved = [
            (slice(j.idx_q, j.idx_q + j.nq), slice(j.idx_v, j.idx_v + j.nv), part.start - j.idx_q)
            for j, part in zip(curved, robot.arguments.units, strict=True)
        ]
        self._units = robot.arguments.units
        self._plain = np.zeros((self.nq, self.nv))
        for j in joints:
            if j.nq == j.nv:
                at = np.arange(j.nq)
                self._plain[j.idx_q + at, j.idx_v + at] = 1.0

    def unit(self, q: Array) -> tuple[Array, Array]:
        """Return q with its unit parts normalised, and their lengths, one for all other numbers.

        Raises
        ------
        InvalidArgument
            If a unit part is zero.
        """
        lengths = np.ones(self.nq)
        for part in self._units:
            length = hypot(*q[part])
            if abs(length - 1.0) > _ROUNDED:
                lengths[part] = length
            if not length > _SHORTEST:
                raise InvalidArgument(
                    f"q[{part.start}:{part.stop}] = {q[part]}: a unit quaternion (x y z w) or "
                    "(cos, sin) is needed, and zero has no direction; pin.neutral(robot.model) "
                    "is a start"
                )
        return q / lengths, lengths

    def rates(self, q: Array) -> Array:
        """Return D (nq, nv) at a normalised q: what its numbers do along a tangent step."""
        if not self._curved:
            return self._plain
        D = self._plain.copy()
        for numbers, tangent, head in self._curved:
            D[numbers, tangent] = _of_joint(q[numbers], head)
        return D

    def steps(self, q: Array, lengths: Array) -> Array:
        """Return T (nv, nq): the tangent step that numbers dq make, T dq; its transpose pulls back.

        `q` and `lengths` are those that `unit` has found.
        """
        D = self.rates(q)
        if not self._curved:
            return D.T
        W = 1.0 / np.einsum("ij,ij->j", D, D)  # the columns of D are orthogonal
        return np.asarray((D * W).T / lengths)


def tangent_gradient(robot: Robot, q: ArrayLike, gradient: ArrayLike) -> Array:
    """Convert a gradient with respect to the numbers of q into the tangent space.

    g_v = D(q)^T g_q,    q' = D(q) v

    Parameters
    ----------
    robot : Robot
    q : (nq,) array_like
        Configuration; quaternions x y z w.
    gradient : (nq,) array_like
        Of any quantity by the numbers of q [1 / unit of q].

    Returns
    -------
    (nv,) array
        The gradient in the tangent [1/m, 1/rad]: slopes along ``pin.integrate(model, q, t e_i)``.
        A step downhill is ``pin.integrate(model, q, -rate * g_v)``.

    Raises
    ------
    InvalidArgument
        If a size is wrong, a number is not finite, or a quaternion is zero.

    Notes
    -----
    Takes about 10 us.
    """
    space = Configurations(robot)
    unit, lengths = space.unit(finite("q", q, space.nq))
    return np.asarray((finite("gradient", gradient, space.nq) * lengths) @ space.rates(unit))


def _of_joint(x: Array, head: int) -> Array:
    """Return D of one joint: `head` numbers of a position, and then a quaternion or a pair."""
    unit = x[head:]
    if len(unit) == 4:
        turn = np.vstack([unit[3] * np.eye(3) + pin.skew(unit[:3]), -unit[:3]]) / 2
        R: Any = pin.Quaternion(unit[3], *unit[:3]).toRotationMatrix() if head else None
    else:
        cos, sin = unit
        turn = np.array([[-sin], [cos]])
        R = np.array([[cos, -sin], [sin, cos]])
    D = np.zeros((len(x), head + turn.shape[1]))
    if head:
        D[:head, :head] = R
    D[head:, head:] = turn
    return D
