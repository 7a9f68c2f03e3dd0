"""One state of a scene, for what is not a solve: terms and their factors, loads, gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import State as Given
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import MinimumNorm, factorise
from condyn_pin._core.threads import Kept
from condyn_pin._core.trees import algorithms
from condyn_pin.constraints import forces as loads
from condyn_pin.constraints.forces import AppliedForce, Load, Loads
from condyn_pin.constraints.rows.bound import (
    ConstraintViolation,
    Terms,
    finite_terms,
    gap_of,
    velocity_of,
)
from condyn_pin.constraints.rows.equations import ROUNDED, Equations
from condyn_pin.dynamics.nominal import digits_of
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.scene_checks import check_bilateral, check_scene, check_time
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.soundness import singular_mass

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.redundancy import LeftOut, Redundancy

# Steps by which loops are closed: from 1e-2 rad three end at rounding.
_STEPS = 8

# Gap that is rounding [m, rad]: beside a dead point the move that closes it is far larger.
_CLOSED = 1e-15

# Their memory takes longer to make than to use.
_equations = Kept[Equations]()


def equations_of(scene: Scene) -> Equations:
    """Return this thread's equations of a scene: earlier ones, or new ones.

    What they return is yours; what they refer to is overwritten by their next use.
    """
    scene.robot.check_unedited()
    return _equations.of(
        scene, None, lambda: told(Equations(scene.robot.unedited, scene.bounds), scene)
    )


def told(equations: Equations, scene: Scene) -> Equations:
    """Equations of a scene that find the redundancy of its rows when it is needed first."""
    equations.redundancy = lambda: (
        scene.nominal.redundancy if scene.nominal.looks_independent else None
    )
    equations.digits = lambda: scene.nominal.rounded_file if scene.robot.precision else None
    return equations


@dataclass(frozen=True, eq=False)
class State:
    """A checked state with M, h, J, gamma, and the factors of M and J; q and v are owned.

    J and gamma are without the combinations of rows that are `left` out where loops are open.
    """

    q: Array
    v: Array
    terms: Terms
    factors: MinimumNorm
    left: LeftOut | None


def at_state(scene: Scene, q: ArrayLike, v: ArrayLike | None = None) -> State:
    """Terms of a scene at a state, at rest by default, with the rows that are kept there.

    O(n^3 + m^2 n)
    """
    check_scene(scene)
    check_bilateral(scene)
    check_time(scene)
    equations = equations_of(scene)
    still = np.zeros(scene.robot.nv)
    q_, v_, _ = scene.robot.arguments.check(q, still if v is None else v, still)
    terms, share = finite_terms(equations, q_, v_), tolerances.RANK
    left = equations.left_out(terms.J, equations.violation(q_)) if equations.redundancy else None
    if left:
        terms, share = terms.kept(left), tolerances.REFERENCE_RANK
    factors = factorise(terms.M, terms.J, share, why=singular_mass(equations.model, q_))
    if left:
        factors = factors.at_most(left.rank)
    return State(q_.copy(), v_.copy(), terms, factors, left)


def left_out_at(scene: Scene, q: Array) -> LeftOut:
    """Combinations of rows that are left out at q; on closed loops those that are redundant."""
    return scene.nominal.redundancy.at(equations_of(scene), q)


def moves_back(scene: Scene, q: Array, v: Array) -> tuple[Array, Array]:
    """The moves dq and dv (nv,) that are undone where the machine is closed and J v is 0."""
    return _closed_state(scene, equations_of(scene), q, v)[:2]


def _closed_state(
    scene: Scene, equations: Equations, q: Array, v: Array
) -> tuple[Array, Array, Array, LeftOut, MinimumNorm]:
    """Moves dq, dv from the closed state to (q, v), its q, and rows and factors there.

    By Gauss and Newton with the rows that are kept, least in the metric of M, until the gaps are
    rounding or fall no more.
    """
    model, closed, gap = equations.model, q, inf
    for _ in range(_STEPS):
        c, J = equations.position_level(closed)
        left = scene.nominal.redundancy.left_out(J, c)
        factors = factorise(equations.mass(closed), left.kept(J), 0.0).at_most(left.rank)
        c = left.kept(c)
        size = float(np.abs(c).max(initial=0.0))
        if size <= _CLOSED or size >= gap:
            break
        closed, gap = pin.integrate(model, closed, factors.closing(c)), size
    dq = -pin.difference(model, q, closed)
    dv = -factors.closing(left.kept(J @ v - equations.wanted[1]))
    return dq, dv, closed, left, factors


def changed_by_closing(
    scene: Scene, equations: Equations, state: Given, a: Array, a_ref: Array
) -> float:
    """Share of a that closing the loops and stopping J v changes, of the larger of |a| and gravity.

    By factors of the closed state; `equations` are of the scene, and written to.
    """
    q, v, tau = state
    _, dv, q, left, factors = _closed_state(scene, equations, q, v)
    terms = equations.terms(q, v - dv)
    closed, _ = factors.solve(tau - terms.h, left.kept(a_ref - terms.gamma))
    size = max(float(np.abs(a).max()), scene.nominal.gravity)
    return float(np.abs(a - closed).max()) / size if size else 0.0


def load_on(scene: Scene, q: Array, forces: Sequence[AppliedForce]) -> Load:
    """Return what forces, all constant, are at a configuration that was checked."""
    equations = equations_of(scene)
    return Loads(scene.robot, equations.model, equations.data).at(q, forces)


def frame_jacobian(scene: Scene, q: Array, frame: str) -> Array:
    """Return the Jacobian (6, nv) of a frame: linear first, in the axes of the world."""
    joint, placement = scene.robot.frame(frame)
    if joint == 0:
        raise InvalidArgument(f"frame = {frame!r}: it belongs to the world, which does not move")
    equations = equations_of(scene)
    model, data = equations.model, equations.data
    algorithms(data).computeJointJacobians(model, data, q)
    return np.array(loads.frame_jacobian(model, data, joint, placement, loads.ALIGNED))


def gaps(scene: Scene, c: Array) -> dict[str, ConstraintViolation]:
    """Return how far each constraint that has a position is open, from c (m,)."""
    model = scene.robot.model
    return {b.name: gap_of(model, b, c[b.rows]) for b in scene.bounds if b.positioned}


def to_close(scene: Scene, q: Array, c: Array) -> Array:
    """Return c (m,) at q without what digits of the file leave open, within its precision."""
    rounded = by_digits(scene)
    return rounded.to_close(equations_of(scene).jacobian(q), c) if rounded else c


def kept_rows(scene: Scene, J: Array, *rows: Array) -> tuple[Array, ...]:
    """Return J (m, nv) and other rows (m,) without what digits of a file make up."""
    rounded = by_digits(scene)
    left = rounded.left_out_by_digits(J) if rounded else None
    return (J, *rows) if left is None else tuple(left.kept(each) for each in (J, *rows))


def by_digits(scene: Scene) -> Redundancy | None:
    """The redundancy of a scene, if digits of its file hide it, as far as that is known."""
    digits = digits_of(scene)
    return digits.redundancy if digits else None


def constraint_velocities(scene: Scene, velocity: Array) -> dict[str, ConstraintViolation]:
    """Return how fast the sides of each constraint move apart, from J v (m,)."""
    return {b.name: velocity_of(scene.robot.model, b, velocity[b.rows]) for b in scene.bounds}


def rounding(scene: Scene, q: Array, x: Array) -> dict[str, float]:
    """Return what rounding of J x leaves of each constraint, where its two sides move together.

    J x is the difference of two velocities: 1e-13 of what the joints bring to either.
    """
    sides = ROUNDED * (equations_of(scene).cancellation(q) @ np.abs(x))
    return {b.name: float(sides[b.rows].max()) for b in scene.bounds}
