"""Lemke: Stewart and Trinkle's linear complementarity problem, with polygons for cones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arguments import Grid, check_count, check_iterations
from condyn_pin._core.arrays import Array
from condyn_pin.contact.complementarity import lemke
from condyn_pin.contact.problem import ContactProblem, Law
from condyn_pin.contact.scaling import normalised
from condyn_pin.contact.solvers.base import PIVOTS, Attempt, ContactSolver
from condyn_pin.errors import InvalidArgument

# Slips below this share of what friction would move things by are none.
_STILL = 1e-9


@dataclass(frozen=True)
class Lemke(ContactSolver):
    """Lemke's pivoting method, with polygons inscribed in the round cones.

    w = A z + b >= 0,  z >= 0,  w . z = 0,    z = (l_n, beta, slip)

    l_t = D beta with `sides` directions D in the ground, sum beta <= mu l_n, and `slip` the speed
    at which a contact slides. A is copositive: the method ends with an answer wherever there is one
    that bodies can have, also where friction locks them.

    Parameters
    ----------
    sides : int
        Of each polygon, even. Friction is right along its corners; between them it is less, by
        1 - cos(pi / sides) at most, and up to pi / sides off the direction of slip.
    max_iterations : int
        Pivots of each of at most three paths; half the number of directions is usual.

    Raises
    ------
    InvalidArgument
        If `sides` is odd or below 4, or `max_iterations` is not positive.

    Notes
    -----
    It solves a different problem from the other solvers: for sliding contacts it is off by the
    difference between polygon and circle, and the status is inaccurate. It provides a starting
    point where other methods fail. If the polygonal problem has no solution, the nearest point is
    returned, and the attempt is not `answered`. Cost O((m sides)^2) per pivot.

    References
    ----------
    Stewart, Trinkle. An implicit time-stepping scheme for rigid body dynamics with inelastic
    collisions and Coulomb friction. Int. J. Numerical Methods in Engineering 39, 1996.
    Anitescu, Potra. Formulating dynamic multi-rigid-body contact problems with friction as solvable
    linear complementarity problems. Nonlinear Dynamics 14, 1997.
    """

    title: ClassVar[str] = "Lemke"
    cost: ClassVar[str] = "O((m sides)^2) a pivot, about m sides of them"
    use: ClassVar[str] = "polygons; the start of Newton where friction locks"
    laws: ClassVar[tuple[Law, ...]] = ("ncp",)
    sweeps: ClassVar[tuple[Grid, ...]] = ({"sides": (4, 8, 16, 32)},)
    exact: ClassVar[bool] = False

    sides: int = 8
    max_iterations: int = 5000

    def __post_init__(self) -> None:
        check_count("sides", self.sides, least=4)
        if self.sides % 2:
            raise InvalidArgument(
                f"sides = {self.sides}: an even number; each side has an opposite"
            )
        check_iterations(self.max_iterations)

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> Attempt:
        """Return the polygon's answer, or the nearest to one; it has no use for a guess."""
        return _pivoted(problem, _regular(problem, self.sides), self.max_iterations)


def turned(problem: ContactProblem, lam: Array, width: float, sides: int) -> Attempt:
    """Return the answer of polygons with more corners where contacts slide at impulses `lam`.

    Along such a corner a polygon has the friction of the circle. Where friction locks bodies or is
    large, regular polygons are off by more than what they slide by.

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    lam : (m,) array
        Of other polygons, most often [N s].
    width : float
        Of the fan of five corners round the direction of slip [rad].
    sides : int
        Of the regular polygon that each has beside them.
    """
    cones = problem.sets.parts[0]
    L, S = (each[cones].reshape(-1, 3) for each in (lam, problem.velocities(lam)))
    # friction points against the slip, and where nothing slides it points anywhere
    moved = np.hypot(L[:, 0], L[:, 1]) * problem.scale[0]
    slides = np.hypot(S[:, 0], S[:, 1]) > moved * _STILL
    t = np.where(slides[:, None], -S[:, :2], L[:, :2])
    first = np.arctan2(t[:, 1], t[:, 0])[:, None]
    fan = width * np.linspace(-0.5, 0.5, 5)
    angles = np.hstack((_regular(problem, sides) + first, fan[fan != 0] + first))
    return _pivoted(problem, angles, Lemke.max_iterations)


def _regular(problem: ContactProblem, sides: int) -> Array:
    """Return the directions of the corners of regular polygons (k, sides) [rad]."""
    return np.tile(2 * np.pi * np.arange(sides) / sides, (len(problem.friction), 1))


def _pivoted(problem: ContactProblem, angles: Array, max_iterations: int) -> Attempt:
    """Return the answer of the polygons with corners at `angles` (k, sides)."""
    small, unit = normalised(problem)
    B, A, b = _linear(small, angles)
    end = lemke(A, b, max_iterations)
    lam = np.asarray(B @ end.z[: B.shape[1]]) * unit
    return Attempt(lam, end.pivots, (Lemke.title,), end.answered, cost=end.pivots / PIVOTS)


def _linear(problem: ContactProblem, angles: Array) -> tuple[Array, Array, Array]:
    """Return B, A and b: lam = B z and w = A z + b, z >= 0 with one slip of each thing that slides.

    Dry friction of a joint is a polygon with two sides, and a load that does not depend on l_n.
    """
    intervals = problem.sets.parts[2]
    (k, sides), n, m = angles.shape, problem.half_lines, len(problem.g)
    directions = np.array([np.cos(angles), np.sin(angles)])
    two = len(problem.limits)
    B = np.zeros((m, k + n + sides * k + 2 * two))
    B[problem.sets.normals, np.arange(k + n)] = 1.0
    E = np.zeros((sides * k + 2 * two, k + two))  # which slip a direction belongs to
    for i in range(k):
        at = slice(k + n + sides * i, k + n + sides * (i + 1))
        B[3 * i : 3 * i + 2, at] = directions[:, i]
        E[sides * i : sides * (i + 1), i] = 1.0
    for j in range(two):
        first = sides * k + 2 * j
        B[intervals.start + j, k + n + first : k + n + first + 2] = 1.0, -1.0
        E[first : first + 2, k + j] = 1.0
    U = np.zeros((k + two, B.shape[1]))
    U[np.arange(k), np.arange(k)] = problem.friction
    U[:, k + n :] = -E.T
    above = np.vstack([np.zeros((k + n, k + two)), E])
    A = np.block([[B.T @ problem.G @ B, above], [U, np.zeros((k + two, k + two))]])
    b = np.concatenate([B.T @ problem.g, np.zeros(k), problem.limits])
    return B, A, b
