"""Where the paths of a step end: contacts as they are there, for steps in which bodies turn far.

    gap(q (+) dt v+)  ~  gap_e + dt J_e (v+ - u),    gap_e and J_e at q (+) dt u

with u the velocity that the attempt before has found. Impulses act along J_e^T, against what goes
through at the end of the step: without friction it is the projection

    min |v+ - v_free|_M^2 / 2    with    gap(q (+) dt v+) >= 0,

by problems that are linear in the gaps. Those along J^T of the beginning may turn a limb further
into the floor, the more of them the further, and lift what bends into the floor at the cost of
nobody: a fall of Go2 has won 130 J so, and went 2.7 mm deep. From the second attempt on u goes half
of the way, for limbs swing to and fro over the answer.

Shapes that meet in several points meet in others at the end of a long step. They count as they meet
there, and may penetrate by as much as the deepest of them did at the beginning.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrtrs

from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms
from condyn_pin.contact.problem import components
from condyn_pin.simulation.integrators.contact_scheme import allowed_gaps, are_slower
from condyn_pin.simulation.integrators.posed import Posed
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.system import System

# A step in which joints turn less bends the path of a limb of a metre by 0.05 mm at most [rad, m].
STRAIGHT = 1e-2

# How far from where it should a step may end [m, rad].
MISSED = 1e-4


class There(NamedTuple):
    """All candidates where a path ends."""

    gaps: Array  # of cones and half-lines [m, rad]
    J: Array  # (rows, nv), for velocities in the axes of where the path begins


class PathEnds:
    """The ends of the paths of one system in steps of one size."""

    def __init__(self, system: System, floating: Manifold, dt: float) -> None:
        self._system, self._floating, self._dt = system, floating, dt
        self._contacts, self._data = system.contacts, system.equations.data
        self._run = algorithms(self._data)
        self._pairs = self._contacts.several

    def off(self, posed: Posed, lam: Array, v1: Array) -> Array | None:
        """Return how far from where they should contacts end (k,) [m, rad]; None if near enough.

        Too deep, or pressed on before it touches; or pressed on along J at the beginning where its
        path bends into the ground from there.
        """
        dt, near = self._dt, posed.near
        bent = max(map(abs, near.bends.tolist()), default=0.0)
        if posed.path is None and bent < MISSED and are_slower(v1, STRAIGHT / dt):
            return None
        q1 = self._floating.integrate(posed.at, dt * v1)
        self._run.forwardKinematics(self._system.model, self._data, q1)
        start, _ = self.begun(posed)
        allowed, its = allowed_gaps(start, dt), posed.chosen.gaps
        allowed[its] = np.where(near.pressed, near.allowed, allowed[its])
        above = self._contacts.gaps(self._data, q1) - (start - allowed)
        for places in self._pairs:  # they have other points there
            above[places] = above[places].min()
        off = np.maximum(-above, 0.0)
        if len(lam):
            n = near.normals
            speeds = posed.problem.velocities(lam)[n]  # those that the law leaves
            presses = lam[n] * posed.problem.scale[0] > np.abs(speeds)
            early = np.where(presses, above[its] - dt * speeds, 0.0)
            lifted = np.where(presses, -near.bends, 0.0)
            if posed.path is not None:
                lifted[slice(None) if posed.kept is None else ~posed.kept.gaps[its]] = 0.0
            off[its] = np.maximum(off[its], np.maximum(early, lifted))
        return off if off.max(initial=0.0) > MISSED else None

    def alone(self, posed: Posed) -> tuple[Array, Array]:
        """Return to which group each gap and each velocity belongs that feel each other.

        Gaps that nothing moves, and velocities that move none, are in no group: -1.
        """
        contacts, condensed = self._contacts, posed.condensed.with_contacts(posed.J)
        X, L = condensed.X, condensed.factors.L
        starts = np.searchsorted(contacts.blocks, np.arange(len(contacts.names)))
        moves, pulls = (
            np.logical_or.reduceat(rows.T != 0.0, starts, axis=0) for rows in (dtrtrs(L.T, X)[0], X)
        )
        gaps, velocities = np.full(len(posed.gaps), -1), np.full(len(X), -1)
        for i, group in enumerate(components(pulls.astype(float) @ pulls.T != 0.0)):
            velocities[moves[group].any(axis=0)] = i
            gaps[group[: len(gaps)]] = i
        gaps[(X[:, contacts.normals] == 0.0).all(axis=0)] = -1
        return gaps, velocities

    def begun(self, posed: Posed) -> tuple[Array, Array]:
        """Return gaps at the beginning, and their rates, for the places of candidates at the end.

        Of two shapes that meet in several points: the deepest in all places, or zero.
        """
        gaps, J_n = posed.gaps, posed.J[self._contacts.normals]
        if not self._contacts.pairs:
            return gaps, J_n
        gaps, J_n = np.where(gaps == np.inf, 0.0, gaps), J_n.copy()  # a seam hides what has no gap
        for places in self._pairs:
            deepest = places.start + int(gaps[places].argmin())
            into = float(gaps[deepest]) < 0.0
            gaps[places] = gaps[deepest] if into else 0.0
            J_n[places] = J_n[deepest] if into else 0.0
        return gaps, J_n

    def there(self, at: Array, u: Array) -> There:
        """Return all candidates at the end of a path along u (nv,)."""
        q1 = self._floating.integrate(at, self._dt * u)
        self._run.computeJointJacobians(self._system.model, self._data, q1)
        gaps, J = self._contacts.evaluate(self._data, q1)
        return There(gaps, self._floating.rows_before(J, u, self._dt))

    def takes_part(self, posed: Posed, there: There, near: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which gaps take part: those that did, those that go through, pairs as they meet.

        `near` says which are near at the end.
        """
        active = posed.chosen.near | (there.gaps < 0)
        for places in self._pairs:
            active[places] = near[places]
        return active


def next_path(posed: Posed, path: Array, v1: Array) -> Array:
    """Return the path after one that has led to v+: for velocities, and how they change.

    The first of them is along v, and with an impact nothing goes on as it did.
    """
    return v1 if posed.path is None else 0.5 * (path + v1)


def kept_paths(of: NDArray[np.int_], paths: Sequence[Array], after: Array) -> Array:
    """Return velocities of a path, or how they change: those of attempts before, or `after` them.

    That of the first attempt is zero: its contacts are taken where they begin.
    """
    path = after.copy()
    for i, before in enumerate(paths):
        path[of == i] = before[of == i] if i else 0.0
    return path
