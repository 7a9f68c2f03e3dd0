"""How the rows of points where shapes meet change with q.

A point P of body A on body B has the rows E^T (V_l + V_a x P), E = (t1, t2, n) and V = (V_l, V_a)
the twist of A past B. With S the column of a coordinate that moves one of them, m = 1 for A and -1
for B, and V_0 the twist of what carries its joint,

    V' = m (V_0 - V_A) x S,    P' = m (a' - r n'),    E' = m (n x n') x E,    seen from what B does
    (J w)' = E^T (V_l' + V_a' x P + V_a x P' - (n x n') x (V_l + V_a x P))

a' and n' are those of `features`, r the skin of A. Turning around n is left out of E': friction is
the same along every tangent. Wrenches F = (f, P x f) of the rows turn with P and E, and the
columns S_i that feel them with the joints that carry theirs, S_i' = S_j x S_i.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.bound import Pair
from condyn_pin.constraints.contacts.pairs import Pairs
from condyn_pin.constraints.contacts.touches import columns
from condyn_pin.constraints.partials.features import Sliding, of_balls, sliding
from condyn_pin.constraints.rows.rolling import skews


class MeetingTurning:
    """The partials of the rows of all pairs of one model; not to be shared between threads.

    Attributes
    ----------
    size : int
        Number of rows.
    """

    def __init__(self, model: Any, pairs: Sequence[Pair]) -> None:
        self._pairs, self._places = tuple(pairs), Pairs(model, pairs)
        self.size = 3 * self._places.size
        self._first = np.cumsum([0, *(pair.points for pair in pairs)])[:-1]  # place of each pair
        each = [pair for pair in pairs for _ in range(pair.points)]
        self._bodies = np.array([pair.joint for pair in each])
        self._of_grounds = np.array([pair.ground for pair in each])
        supports = np.array([columns(model, joint) for joint in range(model.njoints)])
        self._supports = supports  # [joint, j]: whether column j moves it
        of_column = np.repeat(np.arange(model.njoints), list(model.nvs))
        self._carriers = np.array(list(model.parents))[of_column]
        self._below = supports[of_column]  # [i, j]: column i belongs to the joint of j, or below it
        self._grounds = supports[self._of_grounds][:, None]
        self._moves = supports[self._bodies][:, None] - self._grounds  # m (k, 1, nv)

    def go(self, data: Any) -> bool:
        """Go to where data.oMi and data.J are, and return whether all points have derivatives."""
        self._S = S = data.J.reshape(6, -1).copy()
        self._P, self._E = self._places.points(data), self._places.axes(data)
        gaps, n = self._places.gaps(data), self._E[:, :, 2]
        places = (np.split(x, self._first[1:]) for x in (gaps, self._P, n))
        parts = zip(self._pairs, self._places.are_balls(data).tolist(), *places, strict=True)
        found = [of for part in parts for of in _slidings(data, *part)]
        ways = [of for of, _ in found if of is not None]
        if len(ways) < len(found):
            return False
        U, R, G = (np.array(part) for part in zip(*ways, strict=True))
        r = np.array([skin for _, skin in found])
        G, r, a = G[:, None, None], r[:, None, None], self._P + r[:, None] * n
        v_a = S[:3] - skews(a) @ S[3:]
        turned = R @ v_a - U @ skews(n) @ S[3:]  # n'
        self._P_moved = v_a - U.transpose(0, 2, 1) @ (v_a - G * turned) - r * turned
        self._E_turned = skews(n) @ turned
        self._has_point = np.isfinite(gaps)
        return True

    def slips(self, W: Array) -> Array:
        """Return J w by q for all w in the rows of W (count, rows, nv)."""
        return np.array([self._slip(w) for w in W])

    def _slip(self, w: Array) -> Array:
        S, P, E = self._S, self._P, self._E
        twists = (S * w).dot(self._supports.T)  # of all joints (6, count)
        of_body, of_ground = twists.T[self._bodies], twists.T[self._of_grounds]
        V = of_body - of_ground
        off = twists[:, self._carriers] - of_body[:, :, None]  # V_0 - V_A (k, 6, nv)
        linear = _cross(off[:, 3:], S[:3]) + _cross(off[:, :3], S[3:])
        angular = _cross(off[:, 3:], S[3:])
        u = V[:, :3] + np.cross(V[:, 3:], P)
        by_q = linear - skews(P) @ angular + skews(V[:, 3:]) @ self._P_moved
        by_q += skews(u) @ self._E_turned
        by_q = E.transpose(0, 2, 1) @ (self._moves * by_q)
        by_q[~self._has_point] = 0.0
        return np.asarray(by_q.reshape(self.size, -1))

    def pulls(self, lam: Array) -> Array:
        """Return J^T lam by q (nv, nv)."""
        S, P, m = self._S, self._P, self._moves
        f = (self._E @ lam.reshape(-1, 3, 1))[:, :, 0]
        P_moved = self._grounds * (S[:3] - skews(P) @ S[3:]) + m * self._P_moved
        f_turned = -skews(f) @ (self._grounds * S[3:] + m * self._E_turned)
        moment_turned = skews(P) @ f_turned - skews(f) @ P_moved
        by_q = np.einsum("ki,ai,kaj->ij", m[:, 0], S[:3], f_turned)
        by_q += np.einsum("ki,ai,kaj->ij", m[:, 0], S[3:], moment_turned)
        force, moment = m[:, 0].T.dot(f), m[:, 0].T.dot(np.cross(P, f))  # that columns feel
        across = np.cross(S[:3].T, force) + np.cross(S[3:].T, moment)
        felt = np.cross(S[3:].T, force).dot(S[:3]) + across.dot(S[3:])
        return np.asarray(by_q + self._below * felt)


_NOWHERE: Final = Sliding(np.zeros((3, 3)), np.zeros((3, 3)), 0.0)


def _slidings(
    data: Any, pair: Pair, are_balls: bool, gaps: Array, points: Array, normals: Array
) -> Iterator[tuple[Sliding | None, float]]:
    """Yield how each place of a pair moves, None where that is in doubt, and the skin of A [m]."""
    A = pair.shape.placed(data.oMi[pair.joint] * pair.placement)
    B = pair.ground_shape.placed(data.oMi[pair.ground] * pair.ground_placement)
    r, other = (A.reach, B.reach) if are_balls else (A.radius, B.radius)
    for gap, point, n in zip(gaps, points, normals, strict=True):
        between = float(gap) + r + other
        if gap == np.inf:
            yield _NOWHERE, r
        elif are_balls:
            yield of_balls(n, between), r
        else:
            yield sliding(A, B, point + r * n, n, between), r


def _cross(a: Array, b: Array) -> Array:
    """Return a x b of (k, 3, nv) and (3, nv)."""
    return np.cross(a, b, axisa=1, axisb=0, axisc=1)
