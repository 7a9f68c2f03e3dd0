"""Cables: lengths of lines over points of bodies, and how they change.

With points x_0 .. x_k on bodies or the world, d = x_{i+1} - x_i, n = |d|, u = d / n, and the slack

    c = l + sum r_j q_j - sum n            l the length; joint j pays out r_j [m/rad, 1]
    J = sum e_p . J_p + r,                 e_p = u_p - u_{p-1}, the pull on the point p at tension 1
    J' v = -sum [ u . (a_{i+1} - a_i) + (|d'|^2 - (u . d')^2) / n ]

a the classical accelerations at v' = 0. The points are pulleys without radius, over which the cable
slips without friction. Where the axes of joints stay, column i of J turns with q_j by

    K_ij = sum e_p . dJ_p,i/dq_j - sum (J_{i+1} - J_i)^T (1 - u u^T) (J_{i+1} - J_i) / n,
    dJ_p,i/dq_j = w_j x u_i    if i belongs to the joint of j or to one below it, else w_i x u_j

with w and u the angular velocity, and that of the point, of a unit of a coordinate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin, placements_view
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import joints_with_turning_axes, whole_data
from condyn_pin.constraints.rows.functions import BoundFunctions


class Line(NamedTuple):
    """A line over points of a model, and by how much joints lengthen the cable along it."""

    joints: tuple[int, ...]  # that carry the points; 0 is the world
    points: tuple[tuple[float, float, float], ...]  # on them [m]
    length: float  # [m]
    reels: tuple[tuple[int, int, float], ...] = ()  # places in q and v, and r_j [m/rad, 1]
    sign: float = 1.0  # 1 of a longest length, -1 of a shortest one


class Lines:
    """Lines of one model, evaluated together; not to be shared between threads.

    Attributes
    ----------
    size : int
        Number of lines, k.
    """

    def __init__(self, model: Any, lines: Sequence[Line]) -> None:
        self.size, self._model = len(lines), model
        joints = [j for line in lines for j in line.joints]
        self._joints, nodes = np.array(joints, dtype=np.int_), len(joints)
        # four rows a joint, for its axes and its origin
        self._local = np.zeros((4 * model.njoints, nodes))
        points = [x for line in lines for x in line.points]
        for i, (j, x) in enumerate(zip(joints, points, strict=True)):
            self._local[4 * j : 4 * j + 4, i] = (*x, 1.0)
        ends = [*pairwise(np.cumsum([0, *(len(line.joints) for line in lines)]).tolist())]
        first = [i for a, b in ends for i in range(a, b - 1)]
        self._span = np.zeros((len(first), nodes))  # d = x_{i+1} - x_i of each span
        self._span[np.arange(len(first)), first] = -1.0
        self._span[np.arange(len(first)), np.add(first, 1)] = 1.0
        self._of_nodes = np.zeros((self.size, nodes))
        for k, (a, b) in enumerate(ends):
            self._of_nodes[k, a:b] = 1.0
        self._of_spans = self._of_nodes @ (self._span > 0.0).T
        self._sign = np.array([line.sign for line in lines])
        self._length = np.array([line.length for line in lines])
        self._paid, self._reels = np.zeros((self.size, model.nq)), np.zeros((self.size, model.nv))
        for k, line in enumerate(lines):
            for iq, iv, r in line.reels:
                self._paid[k, iq] += r
                self._reels[k, iv] += r
        moving = np.zeros((model.njoints, model.nv))
        for j in range(1, model.njoints):
            for i in list(model.supports[j])[1:]:
                moving[j, model.idx_vs[i] : model.idx_vs[i] + model.nvs[i]] = 1.0
        self._moves = moving[self._joints]  # which columns move a point
        self._below = np.repeat(moving[1:], list(model.nvs)[1:], axis=0) > 0
        self._of: Any = None
        self._now = np.zeros((3, 0))

    def gaps(self, data: Any, q: Array) -> Array:
        """Return the slack of each line, of shortest ones less than nothing (k,) [m]."""
        _, n, _ = self._spans(self._points(data))
        return np.asarray(self._sign * (self._length + self._paid @ q - self._of_spans @ n))

    def points(self, data: Any) -> list[Array]:
        """Return the points of each line in the world (3, points) [m]."""
        x = self._points(data)
        return [x[:, its != 0.0] for its in self._of_nodes]

    def forces(self, data: Any, lam: Array) -> tuple[list[tuple[int, Array, Array]], Array]:
        """Forces lam (k,) [N] on bodies and on reels.

        Returns the joint, point and force of each point of a line in the world [m, N], and the
        torque on each coordinate of a reel (nv,) [N m, N].
        """
        x = self._points(data)
        pulls = -(self._spans(x)[2] @ self._span) * ((self._sign * lam) @ self._of_nodes)
        each = zip(self._joints.tolist(), x.T, pulls.T, strict=True)
        return [*each], (self._sign * lam) @ self._reels

    def rows(self, data: Any) -> Array:
        """Return J (k, nv); reads data.oMi and data.J."""
        x = self._points(data)
        pull = -self._spans(x)[2] @ self._span
        twist = np.vstack((pull, np.cross(x, pull, axis=0)))
        each = (twist.T @ data.J.reshape(6, -1)) * self._moves  # of one column: a vector
        return np.asarray(self._sign[:, None] * (self._of_nodes @ each + self._reels))

    def drift(self, data: Any) -> Array:
        """Return J' v (k,) [m/s^2]; reads what forward kinematics with v and a = 0 leaves."""
        x = self._points(data)
        fields = {0: np.zeros(12)}  # the world stands still
        for j in {*self._joints.tolist()} - {0}:
            at = data.oMi[j]
            fields[j] = np.concatenate((at.act(data.v[j]).vector, at.act(data.a[j]).vector))
        v, w, dv, dw = np.transpose([fields[j] for j in self._joints.tolist()]).reshape(4, 3, -1)
        rate = v + np.cross(w, x, axis=0)
        bent = dv + np.cross(dw, x, axis=0) + np.cross(w, rate, axis=0)
        _, n, u = self._spans(x)
        apart = rate @ self._span.T
        along = (u * apart).sum(axis=0)
        across = ((apart * apart).sum(axis=0) - along**2) * _inverse(n)
        longer = (u * (bent @ self._span.T)).sum(axis=0) + across
        return np.asarray(-self._sign * (self._of_spans @ longer))

    def bend(self, data: Any) -> Array:
        """Return K (k, nv, nv): how J turns with q, where the axes of joints stay.

        Reads data.oMi and data.J.
        """
        x, J = self._points(data), data.J.reshape(6, -1)
        _, n, u = self._spans(x)
        pull = -u @ self._span
        w = J[3:, None, :] * self._moves  # (3, points, nv)
        moved = (J[:3, None, :] + np.cross(J[3:, None, :], x[:, :, None], axis=0)) * self._moves
        across = np.cross(moved, pull[:, :, None], axis=0)
        turned = np.einsum("kp,api,apj->kij", self._of_nodes, across, w)
        K = np.where(self._below, turned, turned.transpose(0, 2, 1))
        apart = np.einsum("sp,api->asi", self._span, moved)
        apart_across = apart - u[:, :, None] * (u[:, :, None] * apart).sum(axis=0)
        K -= np.einsum("ks,asi,asj->kij", self._of_spans * _inverse(n), apart_across, apart_across)
        return np.asarray(self._sign[:, None, None] * K)

    def _points(self, data: Any) -> Array:
        """Points of all lines in the world (3, points) [m]."""
        if self._of is not data:  # a view into the memory of data
            self._of, self._now = data, placements_view(data.oMi, 0, self._model.njoints)
        return np.asarray(self._now.dot(self._local))

    def _spans(self, x: Array) -> tuple[Array, Array, Array]:
        """Return d, n and u of all spans; one that is shorter than rounding has no direction."""
        d = x @ self._span.T
        n = np.sqrt((d * d).sum(axis=0))
        return d, n, d * _inverse(n)


def _inverse(n: Array) -> Array:
    """Return 1 / n, and zero of lengths that are rounding."""
    return np.divide(1.0, n, out=np.zeros_like(n), where=n > tolerances.CLOSED)


# A cable that never goes slack.


@dataclass(frozen=True, kw_only=True)
class BoundCable(BoundFunctions):
    """A cable that stays taut, bound; memory for it comes with `at_work`."""

    line: Line
    of: tuple[Lines, Any] | None = field(default=None, compare=False, repr=False)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of the constraint and the row's."""
        return (f"{self.name}.length",)

    def at_work(self) -> BoundCable:
        """The cable with memory of its own."""
        return replace(self, of=(Lines(self.model, [self.line]), whole_data(self.model)))

    def c(self, q: Array, t: float) -> Array:
        """Slack (1,) [m]."""
        lines, data = self._of
        pin.forwardKinematics(self.model, data, q)
        return lines.gaps(data, q)

    def J(self, q: Array, t: float) -> Array:
        """Jacobian J (1, nv)."""
        lines, data = self._of
        pin.computeJointJacobians(self.model, data, q)
        return lines.rows(data)

    def drift_of(self, q: Array, v: Array, t: float) -> Array:
        """Rate J' v (1,)."""
        lines, data = self._of
        pin.forwardKinematics(self.model, data, q, v, np.zeros(len(v)))
        return lines.drift(data)

    def bend(self, q: Array, t: float) -> Array:
        """Partials K (1, nv, nv) of J by q."""
        if joints_with_turning_axes(self.model):
            return super().bend(q, t)
        lines, data = self._of
        pin.computeJointJacobians(self.model, data, q)
        return lines.bend(data)

    @property
    def _of(self) -> tuple[Lines, Any]:
        assert self.of is not None  # groups work with what `at_work` returns
        return self.of

    def turns(self, model: Any) -> NDArray[np.bool_]:
        """Flag of the row: a length."""
        return np.zeros(1, dtype=bool)
