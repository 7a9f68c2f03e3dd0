"""Projection of velocities and accelerations to the constraints, nearest in a metric W.

    min |v' - v|_W   with  J v' = 0,            min |a' - a|_W   with  J a' + gamma = 0,

W being the mass matrix, as in Gauss's principle, or the identity.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin import tolerances
from condyn_pin.algebra.minimum_norm import MinimumNorm, factorise
from condyn_pin.arguments import normalised
from condyn_pin.arrays import Array, check_overflow, finite
from condyn_pin.blas_threads import one_blas_thread
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.rows.equations import Equations
from condyn_pin.rows.terms import Terms
from condyn_pin.states.check import check
from condyn_pin.states.gaps import slips, worst

if TYPE_CHECKING:
    from condyn_pin.scene import Scene

Metric = Literal["mass", "euclidean"]


@one_blas_thread
def project_velocity(scene: Scene, q: ArrayLike, v: ArrayLike, metric: Metric) -> Array:
    """Return the nearest velocity with J v = 0; see `Scene.project_velocity`."""
    nv = scene.robot.nv
    v_ = finite("v", v, nv)
    q_, terms, factors = _factors(scene, q, np.zeros(nv), metric)
    projected = factors.tangent(v_)
    _check_rows(scene, q_, terms.J @ projected, float(np.abs(v_).max()), "/s")
    return projected


@one_blas_thread
def project_acceleration(
    scene: Scene, q: ArrayLike, v: ArrayLike, a: ArrayLike, metric: Metric
) -> Array:
    """Return the nearest acceleration with J a + gamma = 0; see `Scene.project_acceleration`."""
    nv = scene.robot.nv
    v_, a_ = finite("v", v, nv), finite("a", a, nv)
    with np.errstate(all="ignore"):  # what overflows is refused
        q_, terms, factors = _factors(scene, q, v_, metric)
        missing = -terms.gamma - terms.J @ a_
        projected = a_ + factors.solve(np.zeros(nv), missing)[0]
    check_overflow("v", v_, terms.gamma)
    check_overflow("a", a_, projected)
    size = max(float(np.abs(x).max(initial=0.0)) for x in (a_, projected, terms.gamma))
    _check_rows(scene, q_, terms.J @ projected + terms.gamma, size, "/s^2")
    return projected


def _factors(
    scene: Scene, q: ArrayLike, v: Array, metric: Metric
) -> tuple[Array, Terms, MinimumNorm]:
    if metric not in get_args(Metric):
        raise InvalidArgument(
            f"metric = {metric!r}: one of {', '.join(get_args(Metric))} is needed"
        )
    check(scene, q, None).raise_if_open(gap=tolerances.NEARLY_CLOSED)
    model = scene.robot.model
    q_ = normalised(model, "q", q)
    terms = Equations(model, scene.bounds).terms(q_, v)
    W = terms.M if metric == "mass" else np.eye(model.nv)
    factors = factorise(W, terms.J, tolerances.RANK, at=(model, q_))
    # open loops make redundant rows look independent: they are the smallest, and are left out
    rank = min(factors.rank, scene.chains.rank)
    return q_, terms, replace(factors, V=factors.V[:, :rank], rank=rank)


def _check_rows(scene: Scene, q: Array, left: Array, size: float, per: str) -> None:
    """Refuse a projection that leaves the constraints, because their rows contradict each other."""
    slip = slips(scene, left)
    if slip and worst(slip)[1].size > tolerances.CONSISTENT * max(1.0, size):
        name, by = worst(slip)
        open_by = check(scene, q, None)
        raise NotAssembled(
            f"{name} keeps {by.text(per)}: its rows cannot all be satisfied at this q "
            f"({open_by}); Scene.assemble closes loops, Scene.rank tells about rows"
        )
