"""Projection of velocities and accelerations to the constraints, nearest in a metric W.

    min |v' - v|_W   with  J v' = 0,            min |a' - a|_W   with  J a' + gamma = 0,

W being the mass matrix, as in Gauss's principle, or the identity. With W = L L^T and the singular
values of J L^-T = U S V^T, both are

    x' = x - L^-T V S^+ U^T (J x + gamma),

taken twice: what rounding leaves of the first, most where bodies are light, the second takes away.

As many singular values count as rows do nearly everywhere. Near a singular configuration some of
these are small, and others may be more than rounding: the next smaller ones are taken in one by one
until the rows are met, if the loops are closed. Where they are open by a gap, redundant rows look
independent by as much.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin import tolerances
from condyn_pin.algebra.minimum_norm import MinimumNorm, factorise
from condyn_pin.algebra.numerical_rank import rank_of
from condyn_pin.arguments import normalised
from condyn_pin.arrays import Array, check_overflow, finite
from condyn_pin.blas_threads import one_blas_thread
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.rows.equations import Equations
from condyn_pin.rows.reach import reach
from condyn_pin.states.check import check
from condyn_pin.states.gaps import rounding, slips, worst

if TYPE_CHECKING:
    from condyn_pin.scene import Scene

Metric = Literal["mass", "euclidean"]

_PASSES = 2


@one_blas_thread
def project_velocity(scene: Scene, q: ArrayLike, v: ArrayLike, metric: Metric) -> Array:
    """Return the nearest velocity with J v = 0; see `Scene.project_velocity`."""
    v_ = finite("v", v, scene.robot.nv)
    return _project(scene, q, None, v_, metric)


@one_blas_thread
def project_acceleration(
    scene: Scene, q: ArrayLike, v: ArrayLike, a: ArrayLike, metric: Metric
) -> Array:
    """Return the nearest acceleration with J a + gamma = 0; see `Scene.project_acceleration`."""
    nv = scene.robot.nv
    return _project(scene, q, finite("v", v, nv), finite("a", a, nv), metric)


def _project(scene: Scene, q: ArrayLike, v: Array | None, x: Array, metric: Metric) -> Array:
    """Return the nearest velocity, or the nearest acceleration at a velocity v."""
    if metric not in get_args(Metric):
        raise InvalidArgument(
            f"metric = {metric!r}: one of {', '.join(get_args(Metric))} is needed"
        )
    state = check(scene, q, None)
    state.raise_if_open(gap=tolerances.NEARLY_CLOSED)
    model = scene.robot.model
    q_ = normalised(model, "q", q)
    equations = Equations(model, scene.bounds)
    with np.errstate(all="ignore"):  # what overflows is refused
        terms = equations.terms(q_, np.zeros(model.nv) if v is None else v)
        J, gamma = terms.J, np.zeros(scene.rows) if v is None else terms.gamma
        if v is not None:
            check_overflow("v", v, gamma)
        W = terms.M if metric == "mass" else np.eye(model.nv)
        factors = factorise(W, J, 0.0, at=(model, q_))
        left, nearest = gamma, x
        for some in _ranks(scene, equations, q_, factors, state.closed):
            nearest = _nearest(some, J, gamma, x)
            left = J @ nearest + gamma
            check_overflow("v" if v is None else "a", x, left)
            size = max(float(np.abs(each).max(initial=0.0)) for each in (x, nearest, gamma))
            slip = slips(scene, left)
            if not slip or worst(slip)[1].size <= tolerances.CONSISTENT * max(1.0, size):
                return nearest
    excused = rounding(scene, q_, nearest)
    name, by = max(slip.items(), key=lambda item: item[1].size - excused[item[0]])
    if by.size <= excused[name]:
        return nearest
    raise NotAssembled(
        f"{name} keeps {by.text('/s' if v is None else '/s^2')}: its rows cannot all be satisfied "
        f"at this q ({state}); Scene.assemble closes loops, Scene.rank tells about rows"
    )


def _ranks(
    scene: Scene, equations: Equations, q: Array, factors: MinimumNorm, closed: bool
) -> Iterator[MinimumNorm]:
    """Return the factors with as many singular values as usual, and then with one more each."""
    usual = min(rank_of(factors.S), scene.chains.rank)
    yield factors.at_most(usual)
    if closed:
        most = factors.above_rounding(reach(equations, q)).rank
        yield from (factors.at_most(rank) for rank in range(usual + 1, most + 1))


def _nearest(factors: MinimumNorm, J: Array, gamma: Array, x: Array) -> Array:
    """Return the x nearest to the given one with J x + gamma = 0."""
    nothing = np.zeros(len(x))
    for _ in range(_PASSES):
        x = x - factors.solve(nothing, J @ x + gamma)[0]
    return x
