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
from condyn_pin.arguments import normalised
from condyn_pin.arrays import Array, finite
from condyn_pin.errors import InvalidArgument
from condyn_pin.minimum_norm import MinimumNorm, factorise
from condyn_pin.rows.equations import Equations, Terms

if TYPE_CHECKING:
    from condyn_pin.scene import Scene

Metric = Literal["mass", "euclidean"]


def project_velocity(scene: Scene, q: ArrayLike, v: ArrayLike, metric: Metric) -> Array:
    """Return the nearest velocity with J v = 0; see `Scene.project_velocity`."""
    _, factors = _factors(scene, q, np.zeros(scene.robot.nv), metric)
    return factors.tangent(finite("v", v, scene.robot.nv))


def project_acceleration(
    scene: Scene, q: ArrayLike, v: ArrayLike, a: ArrayLike, metric: Metric
) -> Array:
    """Return the nearest acceleration with J a + gamma = 0; see `Scene.project_acceleration`."""
    nv = scene.robot.nv
    terms, factors = _factors(scene, q, finite("v", v, nv), metric)
    a_ = finite("a", a, nv)
    return a_ + factors.solve(np.zeros(nv), -terms.gamma - terms.J @ a_)[0]


def _factors(scene: Scene, q: ArrayLike, v: Array, metric: Metric) -> tuple[Terms, MinimumNorm]:
    if metric not in get_args(Metric):
        raise InvalidArgument(f"metric = {metric!r}: one of {', '.join(get_args(Metric))}")
    scene.robot.check_unedited()
    model = scene.robot.model
    terms = Equations(model, scene.bounds).terms(normalised(model, "q", q), v)
    W = terms.M if metric == "mass" else np.eye(model.nv)
    factors = factorise(W, terms.J, tolerances.RANK)
    # open loops make redundant rows look independent: they are the smallest, and are left out
    rank = min(factors.rank, scene.chains.rank)
    return terms, replace(factors, V=factors.V[:, :rank], rank=rank)
