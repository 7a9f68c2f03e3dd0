"""Projection of velocities and accelerations to the constraints, nearest in a metric W.

    min |v' - v|_W   with  J v' = 0,            min |a' - a|_W   with  J a' + gamma = 0,

W being the mass matrix, as in Gauss's principle, or the identity. With W = L L^T and the singular
values of J L^-T = U S V^T, both are

    x' = x - L^-T V S^+ U^T (J x + gamma),

taken twice: what rounding leaves of the first, most where bodies are light, the second takes away.

As many singular values count as rows are kept at the state (`condyn_pin.constraints.rows.
redundancy`): where loops are open by a gap, redundant rows look independent by as much, and what
such combinations miss is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array, check_overflow, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.linalg import factorise
from condyn_pin.constraints.rows.bound import worst
from condyn_pin.dynamics.at_state import (
    constraint_velocities,
    equations_of,
    kept_rows,
    left_out_at,
    rounding,
)
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.mechanism.check import check
from condyn_pin.model.soundness import singular_mass

Metric = Literal["mass", "euclidean"]

_PASSES = 2


@one_blas_thread
def project_velocity(scene: Scene, q: ArrayLike, v: ArrayLike, *, metric: Metric = "mass") -> Array:
    """Return the velocity nearest to v with J v = 0, or J v = s' where rows are driven.

    min over x of |x - v|_W    with  J x = s'

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        A closed configuration [rad, m].
    v : (nv,) array_like
        Velocity [rad/s, m/s].
    metric : {"mass", "euclidean"}
        What near means: kinetic energy of the difference, or its squares in rad/s and m/s.

    Returns
    -------
    v : (nv,) array
        The nearest velocity that the constraints allow [rad/s, m/s].

    Raises
    ------
    NotAssembled
        If a loop is open by more than 1e-4 m or rad, or by less but no velocity satisfies its
        rows there; the text names it.
    """
    v_ = finite("v", v, scene.robot.nv)
    q_, closed = _checked(scene, q, metric)
    equations = equations_of(scene)
    W = equations.mass(q_) if metric == "mass" else np.eye(len(v_))
    J, rate = kept_rows(scene, equations.jacobian(q_), -equations.wanted[1])
    return nearest(scene, q_, "v", v_, (W, J, rate), closed)


@one_blas_thread
def project_acceleration(
    scene: Scene, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, metric: Metric = "mass"
) -> Array:
    """Return the acceleration nearest to a with J a + gamma(q, v) = 0.

    min over x of |x - a|_W    with  J x + gamma = s''

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        A closed configuration [rad, m].
    v : (nv,) array_like
        A velocity with J v = 0 [rad/s, m/s].
    a : (nv,) array_like
        Acceleration [rad/s^2, m/s^2].
    metric : {"mass", "euclidean"}
        With "mass", and a the unconstrained acceleration, this is Gauss's principle.

    Returns
    -------
    a : (nv,) array
        The nearest acceleration that the constraints allow [rad/s^2, m/s^2].

    Raises
    ------
    NotAssembled
        As `project_velocity`; also if v does not fit and no acceleration satisfies its rows.
    """
    nv = scene.robot.nv
    v_, a_ = finite("v", v, nv), finite("a", a, nv)
    q_, closed = _checked(scene, q, metric)
    with np.errstate(all="ignore"):  # what overflows is refused
        terms = equations_of(scene).terms(q_, v_)
        check_overflow("v", v_, terms.gamma)
    W = terms.M if metric == "mass" else np.eye(nv)
    J, gamma = kept_rows(scene, terms.J, terms.gamma)
    return nearest(scene, q_, "a", a_, (W, J, gamma), closed)


def _checked(scene: Scene, q: ArrayLike, metric: Metric) -> tuple[Array, bool]:
    """Return q, and whether it is closed, if it is nearly; raises what is wrong otherwise."""
    if metric not in get_args(Metric):
        raise InvalidArgument(
            f"metric = {metric!r}: one of {', '.join(get_args(Metric))} is needed"
        )
    state = check(scene, q, None)
    state.raise_if_open(violation=tolerances.NEARLY_CLOSED)
    return normalised(scene.robot.model, "q", q), state.closed


def nearest(
    scene: Scene,
    q: Array,
    name: Literal["v", "a"],
    x: Array,
    terms: tuple[Array, Array, Array],
    closed: bool,
) -> Array:
    """Return the velocity or acceleration nearest to x with J x' + gamma = 0, for W, J and gamma.

    Refuse numbers that overflow, and rows that contradict each other.
    """
    W, J, gamma = terms
    nothing, why = np.zeros(len(x)), singular_mass(scene.robot.model, q)
    if not len(J):
        return x + factorise(W, J, 0.0, why=why).solve(nothing, gamma)[0]
    with np.errstate(all="ignore"):  # what overflows is refused
        kept = left_out_at(scene, q)
        factors = factorise(W, kept.kept(J), 0.0, why=why).at_most(kept.rank)
        found = x
        for _ in range(_PASSES):
            found = found - factors.solve(nothing, J @ found + gamma)[0]
        left = J @ found + gamma if closed else kept.kept(J @ found + gamma)
        check_overflow(name, x, found, left)
    _check_rows(scene, q, left, (x, found, gamma), "/s" if name == "v" else "/s^2")
    return found


def _meets(left: Array, sizes: Sequence[Array]) -> bool:
    """Whether rows are met as well as can be asked for, whatever rounding is."""
    size = max(float(np.abs(each).max(initial=0.0)) for each in sizes)
    length = float(np.linalg.norm(left))
    return length <= tolerances.CONSISTENT * max(1.0, size)


def _check_rows(scene: Scene, q: Array, left: Array, sizes: Sequence[Array], per: str) -> None:
    """Refuse a projection that leaves the constraints, because their rows contradict each other."""
    if _meets(left, sizes):
        return
    excused, off = rounding(scene, q, sizes[1]), constraint_velocities(scene, left)
    least = tolerances.CONSISTENT * max(1.0, *(float(np.abs(x).max(initial=0.0)) for x in sizes))
    beyond = {name: by for name, by in off.items() if by.size > max(least, excused[name])}
    if beyond:
        name, by = worst(beyond)
        raise NotAssembled(
            f"{name} is left with {by.text(per)}: its rows cannot all be satisfied at this q "
            f"({check(scene, q, None)}); Scene.assemble closes loops, and "
            "Scene.rank names redundant rows"
        )
