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

from collections.abc import Iterator, Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array, check_overflow, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.linalg.minimum_norm import MinimumNorm, factorise
from condyn_pin._core.linalg.numerical_rank import rank_of
from condyn_pin.constraints.rows.cancellation import cancellation_scale
from condyn_pin.constraints.violation import worst
from condyn_pin.dynamics.gaps import rounding, slips
from condyn_pin.dynamics.kept import equations_of
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.mechanism.check import Check, check
from condyn_pin.model.soundness import singular_mass

Metric = Literal["mass", "euclidean"]

_PASSES = 2


@one_blas_thread
def project_velocity(scene: Scene, q: ArrayLike, v: ArrayLike, metric: Metric) -> Array:
    """Return the nearest velocity with J v = 0; see `Scene.project_velocity`."""
    v_ = finite("v", v, scene.robot.nv)
    state = _checked(scene, q, metric)
    q_ = normalised(scene.robot.model, "q", q)
    equations = equations_of(scene)
    W = equations.mass(q_) if metric == "mass" else np.eye(len(v_))
    nearest, left = nearest_velocity(scene, q_, v_, W, equations.jacobian(q_), state.closed)
    check_rows(scene, q_, left, (v_, nearest), "/s")
    return nearest


@one_blas_thread
def project_acceleration(
    scene: Scene, q: ArrayLike, v: ArrayLike, a: ArrayLike, metric: Metric
) -> Array:
    """Return the nearest acceleration with J a + gamma = 0; see `Scene.project_acceleration`."""
    nv = scene.robot.nv
    v_, a_ = finite("v", v, nv), finite("a", a, nv)
    state = _checked(scene, q, metric)
    q_ = normalised(scene.robot.model, "q", q)
    with np.errstate(all="ignore"):  # what overflows is refused
        terms = equations_of(scene).terms(q_, v_)
        check_overflow("v", v_, terms.gamma)
        W = terms.M if metric == "mass" else np.eye(nv)
        nearest, left = _nearest(scene, q_, (W, terms.J, terms.gamma), a_, state.closed)
        check_overflow("a", a_, nearest, left)
    check_rows(scene, q_, left, (a_, nearest, terms.gamma), "/s^2")
    return nearest


def nearest_velocity(
    scene: Scene, q: Array, v: Array, W: Array, J: Array, closed: bool
) -> tuple[Array, Array]:
    """Return the nearest velocity, and J v of it, at a configuration that was checked."""
    with np.errstate(all="ignore"):  # what overflows is refused
        nearest, left = _nearest(scene, q, (W, J, np.zeros(scene.rows)), v, closed)
    check_overflow("v", v, nearest, left)
    return nearest, left


def _checked(scene: Scene, q: ArrayLike, metric: Metric) -> Check:
    """Return what q leaves open, if that is little; raises what is wrong with the arguments."""
    if metric not in get_args(Metric):
        raise InvalidArgument(
            f"metric = {metric!r}: one of {', '.join(get_args(Metric))} is needed"
        )
    state = check(scene, q, None)
    state.raise_if_open(violation=tolerances.NEARLY_CLOSED)
    return state


def _nearest(
    scene: Scene, q: Array, terms: tuple[Array, Array, Array], x: Array, closed: bool
) -> tuple[Array, Array]:
    """Return the x nearest to the given one, and what it leaves of J x + gamma, for W, J, gamma."""
    W, J, gamma = terms
    factors, nothing = (
        factorise(W, J, 0.0, why=singular_mass(scene.robot.model, q)),
        np.zeros(len(x)),
    )
    nearest, left = x, J @ x + gamma
    for some in _ranks(scene, q, factors, closed):
        nearest, left = x, J @ x + gamma
        for _ in range(_PASSES):
            nearest = nearest - some.solve(nothing, left)[0]
            left = J @ nearest + gamma
        if _meets(left, (x, nearest, gamma)):
            break
    return nearest, left


def _meets(left: Array, sizes: Sequence[Array]) -> bool:
    """Whether rows are met as well as can be asked for, whatever rounding is."""
    size = max(float(np.abs(each).max(initial=0.0)) for each in sizes)
    length = float(np.linalg.norm(left))
    return length <= tolerances.CONSISTENT * max(1.0, size)


def check_rows(scene: Scene, q: Array, left: Array, sizes: Sequence[Array], per: str) -> None:
    """Refuse a projection that leaves the constraints, because their rows contradict each other."""
    if _meets(left, sizes):
        return
    excused, slip = rounding(scene, q, sizes[1]), slips(scene, left)
    least = tolerances.CONSISTENT * max(1.0, *(float(np.abs(x).max(initial=0.0)) for x in sizes))
    beyond = {name: by for name, by in slip.items() if by.size > max(least, excused[name])}
    if beyond:
        name, by = worst(beyond)
        raise NotAssembled(
            f"{name} keeps {by.text(per)}: its rows cannot all be satisfied at this q "
            f"({check(scene, q, None)}); Scene.assemble closes loops, Scene.rank tells about rows"
        )


def _ranks(scene: Scene, q: Array, factors: MinimumNorm, closed: bool) -> Iterator[MinimumNorm]:
    """Return the factors with as many singular values as usual, and then with one more each."""
    usual = min(rank_of(factors.S), scene.chains.rank)
    yield factors.at_most(usual)
    if closed:
        most = factors.above_rounding(cancellation_scale(equations_of(scene), q)).rank
        yield from (factors.at_most(rank) for rank in range(usual + 1, most + 1))
