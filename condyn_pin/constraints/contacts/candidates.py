"""All candidates of a scene for contact, evaluated together: gaps, contact points and rows.

Cones come first, three rows (t1, t2, n) each, with n from the ground to the robot: those on planes,
and then those of pairs of bodies. Then come half-lines,
the ends of the ranges of joints, +1 at a lower end and -1 at an upper one; then intervals, the dry
friction of joints. For each cone and half-line d gap/dt is its row of J v along the normal.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array, read_only
from condyn_pin.constraints.contacts.bound import BoundContact, Pair, Touch
from condyn_pin.constraints.contacts.pairs import Pairs
from condyn_pin.constraints.contacts.touches import Touches
from condyn_pin.constraints.contacts.world_touches import WorldTouches


class Candidates:
    """Contact candidates of one model; not to be shared between threads.

    Parameters
    ----------
    model : pin.Model
    bounds : sequence of BoundContact
    exact : bool
        Whether gaps of pairs of shapes are distances wherever they are, as a reader of gaps wants
        them. Steps do with bounds where shapes are far apart, and without what seams hide.

    Attributes
    ----------
    names : tuple of str
        Of cones, half-lines and intervals.
    cones, half_lines, intervals : int
        How many there are.
    contact_points : int
        How many of the cones, the first ones, are on planes.
    several : tuple of slice
        The cones of each pair of shapes that meet in more points than one.
    friction, restitution : (cones,) array
        Coefficients [1].
    limits : (intervals,) array
        The largest dry friction [N m, N].
    is_length : (cones + half_lines,) bool array
        Which gaps are lengths [m]; the others are angles [rad].
    blocks : (rows,) array of int
        Which candidate each row belongs to.
    row_names : tuple of str
        ``name.t1``, ``name.t2``, ``name.n`` of a cone, the name of the others.

    Notes
    -----
    Gaps and rows of four points on planes of the world take 8 us, two boxes on each other 0.3 ms.
    """

    def __init__(self, model: Any, bounds: Sequence[BoundContact], *, exact: bool = False) -> None:
        self._made_of = model, bounds
        touches = [touch for bound in bounds for touch in bound.touches]
        pairs = [pair for bound in bounds for pair in bound.pairs]
        stops = [stop for bound in bounds for stop in bound.stops]
        dry = [each for bound in bounds for each in bound.dry]
        # a pair has several cones
        cones: list[Touch | Pair] = [*touches]
        cones += [pair for pair in pairs for _ in range(pair.points)]
        self.cones, self.half_lines, self.intervals = len(cones), len(stops), len(dry)
        of_cones = (*(touch.name for touch in touches),
                    *(name for pair in pairs for name in pair.candidates))  # fmt: skip
        others = (*(stop.name for stop in stops), *(each.name for each in dry))
        self.names = (*of_cones, *others)
        self.row_names = (*(f"{name}.{axis}" for name in of_cones for axis in _AXES), *others)
        self.several = tuple(_several(pairs, len(touches)))
        self.friction = read_only(np.array([each.friction for each in cones]))
        self.restitution = read_only(np.array([each.restitution for each in cones]))
        self.limits = read_only(np.array([each.limit for each in dry]))
        of_stops = [stop.is_length for stop in stops]
        self.is_length = read_only(np.array([True] * len(cones) + of_stops, dtype=bool))
        kind = Touches if any(touch.ground for touch in touches) else WorldTouches
        self._touches, self._pairs = kind(model, touches), Pairs(model, pairs, exact=exact)
        self.contact_points = len(touches)
        self._iq = np.array([stop.iq for stop in stops], dtype=np.int_)
        self._sign = np.array([stop.sign for stop in stops])
        self._limit = np.array([stop.limit for stop in stops])
        self._coordinates = np.zeros((len(stops) + len(dry), model.nv))
        for row, stop in enumerate(stops):
            self._coordinates[row, stop.iv] = stop.sign
        for row, each in enumerate(dry, start=len(stops)):
            self._coordinates[row, each.iv] = 1.0
        self._sizes = np.repeat((3, 1), (self.cones, len(others)))
        self.blocks = read_only(np.repeat(np.arange(len(self.names)), self._sizes))

    def with_coefficients(self, friction: Array, restitution: Array) -> Candidates:
        """Return the same candidates with others, one a cone; they share what they evaluate in."""
        other = copy(self)
        other.friction, other.restitution = read_only((friction, restitution))
        return other

    @cached_property
    def exact(self) -> Candidates:
        """The same candidates, with the distances of pairs for their gaps."""
        return Candidates(*self._made_of, exact=True)

    @property
    def rows(self) -> int:
        """Number of rows of all candidates."""
        return len(self.row_names)

    def gaps(self, data: Any, q: Array) -> Array:
        """Return the gaps of cones and half-lines [m, rad]; reads data.oMi at q."""
        gaps = self._touches.gaps(data)
        if self._pairs.size:
            gaps = np.concatenate((gaps, self._pairs.gaps(data)))
        return self._with_stops(gaps, q)

    def gaps_over_planes(self, data: Any) -> Array:
        """Return the signed distances of the first cones, those on planes [m]; reads data.oMi."""
        return self._touches.gaps(data)

    def normals_over_planes(self, data: Any) -> Array:
        """Return the rows n of the first cones, those on planes (k, nv); reads data.J too."""
        return self._touches.rows(data)[2::3]

    def evaluate(self, data: Any, q: Array) -> tuple[Array, Array]:
        """Return gaps as `gaps` does, and the rows of all candidates (rows, nv).

        Parameters
        ----------
        data : pin.Data
            With data.oMi and data.J at q: after `pin.computeJointJacobians`.
        q : (nq,) array
            Configuration [rad, m].
        """
        gaps, J = self._touches.evaluate(data)
        if self._pairs.size:
            gaps = np.concatenate((gaps, self._pairs.gaps(data)))
            J = np.concatenate((J, self._pairs.jacobian(data)))
        if len(self._coordinates):
            J = np.concatenate((J, self._coordinates))
        return self._with_stops(gaps, q), J

    def drift(self, data: Any) -> Array:
        """Return Jdot v of all rows (rows,) [m/s^2], where no shapes of two bodies meet.

        Reads what forward kinematics with a = 0 leaves in data.
        """
        assert not self.pairs, "the points where shapes meet have no closed form"
        of_cones = self._touches.drift(data)
        return np.concatenate((of_cones, np.zeros(len(self._coordinates))))

    @property
    def pairs(self) -> int:
        """How many of the cones, the last ones, are where shapes of two bodies meet."""
        return self.cones - self.contact_points

    def _with_stops(self, gaps: Array, q: Array) -> Array:
        if not self.half_lines:
            return gaps
        return np.concatenate((gaps, self._sign * (q[self._iq] - self._limit)))

    @property
    def normals(self) -> NDArray[np.int_]:
        """The rows along which gaps change, of cones and half-lines."""
        lines = 3 * self.cones + np.arange(self.half_lines)
        return np.concatenate((np.arange(2, 3 * self.cones, 3), lines))

    def rows_of(self, active: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return a flag for each row: whether its candidate is active."""
        return np.repeat(active, self._sizes)

    def points(self, data: Any, q: Array) -> Array:
        """Return the contact point of each cone in the world (cones, 3) [m]."""
        points = self._touches.points(data)
        return np.concatenate((points, self._pairs.points(data))) if self._pairs.size else points

    def axes(self, data: Any, q: Array) -> Array:
        """Return t1, t2 and n of each cone in the world, as columns (cones, 3, 3)."""
        axes = self._touches.axes(data)
        return np.concatenate((axes, self._pairs.axes(data))) if self._pairs.size else axes


def _several(pairs: Sequence[Pair], first: int) -> Iterator[slice]:
    """Yield the cones of pairs that meet in several points; `first` is the first of all pairs."""
    for pair in pairs:
        if pair.points > 1:
            yield slice(first, first + pair.points)
        first += pair.points


_AXES = ("t1", "t2", "n")
