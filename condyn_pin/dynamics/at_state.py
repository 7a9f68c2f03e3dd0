"""A scene at one state: terms, gaps of contacts, arrays by name.

One state of a scene, for what is not a solve: terms and their factors, loads, gaps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import _pin, tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import State as Given
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import MinimumNorm, factorise
from condyn_pin._core.models import algorithms, data_of
from condyn_pin._core.threads import ThreadCache
from condyn_pin.constraints import forces as loads
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.forces import AppliedForce, Load, Loads
from condyn_pin.constraints.places import FrameLike, frame_text
from condyn_pin.constraints.rows.bound import (
    ConstraintViolation,
    PinocchioConstraint,
    Terms,
    finite_terms,
    gap_of,
)
from condyn_pin.constraints.rows.equations import ROUNDED, Equations
from condyn_pin.dynamics.nominal import digits_of
from condyn_pin.dynamics.scene import Scene, check_bilateral, check_scene, check_time
from condyn_pin.errors import InvalidArgument, StaleModel
from condyn_pin.model.soundness import singular_mass

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.redundancy import Redundancy, RedundantRows


# Steps by which loops are closed: from 1e-2 rad three end at rounding.
_STEPS = 8

# Gap that is rounding [m, rad]: beside a dead point the move that closes it is far larger.
_CLOSED = 1e-15

# Their memory takes longer to make than to use.
_equations = ThreadCache[Equations]()


def equations_of(scene: Scene) -> Equations:
    """Return this thread's equations of a scene: earlier ones, or new ones."""
    # What they return is yours; what they refer to is overwritten by their next use.
    scene.robot.check_unedited()
    return _equations.of(
        scene, None, lambda: with_redundancy(Equations(scene.robot.unedited, scene.bounds), scene)
    )


def with_redundancy(equations: Equations, scene: Scene) -> Equations:
    """Equations that know the redundancy of the scene's rows, computed on first use."""
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
    left: RedundantRows | None


def at_state(scene: Scene, q: ArrayLike, v: ArrayLike | None = None) -> State:
    """Terms of a scene at a state, at rest by default, with the rows that are kept there."""
    # O(n^3 + m^2 n)
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


def left_out_at(scene: Scene, q: Array) -> RedundantRows:
    """Combinations of rows that are left out at q; on closed loops those that are redundant."""
    return scene.nominal.redundancy.at(equations_of(scene), q)


def moves_back(scene: Scene, q: Array, v: Array) -> tuple[Array, Array]:
    """Moves dq and dv (nv,) from the closed state with J v = 0 to (q, v)."""
    return _closed_state(scene, equations_of(scene), q, v)[:2]


def _closed_state(
    scene: Scene, equations: Equations, q: Array, v: Array
) -> tuple[Array, Array, Array, RedundantRows, MinimumNorm]:
    """Moves dq, dv from the closed state to (q, v), its q, and rows and factors there."""
    # By Gauss and Newton with the rows that are kept, least in the metric of M, until the gaps are
    # rounding or fall no more.
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
    """Return the load of forces with constant components, at a configuration that was checked."""
    equations = equations_of(scene)
    return Loads(scene.robot, equations.model, equations.data).at(q, forces)


def frame_jacobian(scene: Scene, q: Array, frame: FrameLike) -> Array:
    """Return the Jacobian (6, nv) of a frame: linear first, in the axes of the world."""
    name = frame_text("frame", frame)
    joint, placement = scene.robot.frame(name)
    if joint == 0:
        raise InvalidArgument(f"frame = {name!r}: it belongs to the world, which does not move")
    equations = equations_of(scene)
    model, data = equations.model, equations.data
    algorithms(data).computeJointJacobians(model, data, q)
    return np.array(loads.frame_jacobian(model, data, joint, placement, loads.ALIGNED))


def gaps(scene: Scene, c: Array) -> dict[str, ConstraintViolation]:
    """Return the gap of each constraint that has a position, from c (m,)."""
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
    """Return the relative velocity of the two sides of each constraint, from J v (m,)."""
    rates = {b.name: b.rates(scene.robot.model, velocity[b.rows]) for b in scene.bounds}
    return {name: ConstraintViolation(*each) for name, each in rates.items()}


def rounding(scene: Scene, q: Array, x: Array) -> dict[str, float]:
    """Return the rounding error of J x by constraint, where its two sides move together."""
    # J x is the difference of two velocities: 1e-13 of what the joints bring to either.
    sides = ROUNDED * (equations_of(scene).cancellation(q) @ np.abs(x))
    return {b.name: float(sides[b.rows].max()) for b in scene.bounds}


# How far the contacts of a scene are from touching.


def contact_gaps(scene: Scene, q: ArrayLike) -> dict[str, float]:
    """Return the signed distances of contacts and stops at q, by the names of candidates [m, rad].

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        Configuration [rad, m]; quaternions x y z w.

    Returns
    -------
    dict of str to float
        Negative where a body is in another, or a joint beyond its stop.

    Raises
    ------
    InvalidArgument
        If q has a wrong size, is not finite, or has an unnormalised quaternion.
    """
    check_scene(scene)
    q_ = scene.robot.arguments.configuration("q", q)
    candidates, gaps = gaps_at(scene, q_)
    return dict(zip(candidates.names, gaps.tolist(), strict=False))  # intervals have none


def penetration(scene: Scene, q: ArrayLike) -> dict[str, ConstraintViolation]:
    """Return the contacts and stops that are passed at q, and how far."""
    if not scene.contacts:
        return {}
    candidates, gaps = gaps_at(scene, scene.robot.arguments.configuration("q", q))
    return {
        candidates.names[i]: gap_of_kind(-gaps[i], is_length=candidates.is_length[i])
        for i in np.flatnonzero(gaps < -tolerances.CLOSED)
    }


def gap_of_kind(gap: float, *, is_length: bool) -> ConstraintViolation:
    """Return the size of a gap as a length or as an angle."""
    size = abs(float(gap))
    return ConstraintViolation(size, 0.0) if is_length else ConstraintViolation(0.0, size)


def gap_text(gap: float, *, is_length: bool) -> str:
    """Return a gap in words, in mm or degrees: open by, closed, or penetrates by."""
    if abs(gap) <= tolerances.CLOSED:
        return "closed"
    size = gap_of_kind(gap, is_length=is_length)
    return f"open by {size}" if gap > 0.0 else f"penetrates by {size}"


def gaps_at(scene: Scene, q: Array) -> tuple[Candidates, Array]:
    """Return the candidates of a scene and their gaps at a configuration that was checked."""
    scene.robot.check_unedited()
    model = scene.robot.model
    candidates, data = Candidates(model, scene.contact_bounds, exact=True), data_of(model)
    algorithms(data).forwardKinematics(model, data, q)
    return candidates, np.array(candidates.gaps(data, q))


# Pinocchio's lists of constraints, which may be read but not resized.
#
# `pin.constraintDynamics` and `pin.lcaba` size their memory once. Called with more constraints than
# that, Pinocchio 4 answers wrong numbers and corrupts the heap; with fewer, wrong numbers.


def _refuse(*_: Any) -> NoReturn:
    raise StaleModel(
        "the raw lists of a workspace keep their length: Pinocchio's memory is sized for it; "
        "workspace.use(scene) changes the constraints"
    )


class ConstraintModels(pin.StdVec_RigidConstraintModel):  # type: ignore[misc]
    """The RigidConstraintModels of a workspace."""

    append = extend = insert = __setitem__ = __delitem__ = _refuse


class ConstraintDatas(pin.StdVec_RigidConstraintData):  # type: ignore[misc]
    """The RigidConstraintDatas of a workspace."""

    append = extend = insert = __setitem__ = __delitem__ = _refuse


def raw_constraints(
    model: Any, constraints: Sequence[PinocchioConstraint], drift: Baumgarte | None
) -> tuple[ConstraintModels, ConstraintDatas]:
    """Return Pinocchio's objects of the constraints."""
    models, datas = ConstraintModels(), ConstraintDatas()
    for constraint in constraints:
        made = constraint.to_pinocchio(model)
        if drift:
            its = constraint.drift or drift
            _pin.set_baumgarte(made, its.Kp if constraint.anchored else 0.0, its.Kd)
        pin.StdVec_RigidConstraintModel.append(models, made)
        pin.StdVec_RigidConstraintData.append(datas, made.createData())
    return models, datas


def without_gravity(model: Any) -> Any:
    """Return a copy of a model without gravity."""
    copy = pin.Model(model)
    copy.gravity = pin.Motion.Zero()
    return copy
