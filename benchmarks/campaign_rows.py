"""The rows of every kind of constraint, for the campaign's oracle, from what it keeps.

Written from the definitions in the docstrings of `condyn_pin.Loop`, the contacts, and what rolls;
no code of the library is called.
"""

from __future__ import annotations

import numpy as np
from campaign_jets import (
    ONE,
    REAL,
    Array,
    Jet,
    Place,
    apply,
    constant,
    cross,
    dot,
    exact,
    times,
    transposed,
    unit,
    vee,
)
from campaign_oracle import Oracle

import condyn_pin as cp


def rows(oracle: Oracle, scene: cp.Scene) -> tuple[Array, Array]:
    """Return J (m, nv) and gamma (m,)."""
    n = oracle.model.nv
    J, gamma = [np.zeros((0, n), REAL)], [np.zeros(0, REAL)]
    for constraint in scene.constraints:
        if isinstance(constraint, cp.constraints.Coupling):
            row = np.zeros((1, n), REAL)
            for joint, weight in constraint.weights.items():
                row[0, oracle.model.joints[oracle.model.getJointId(joint)].idx_v] = exact(weight)
            J.append(row)
            gamma.append(np.zeros(1, REAL))
            continue
        rate, rate_of_rate = _slips(oracle, constraint)
        J.append(rate[:n].T)
        gamma.append(rate_of_rate[n])
    return np.vstack(J), np.concatenate(gamma)


def _slips(oracle: Oracle, c: cp.constraints.Constraint) -> tuple[Array, Array]:
    """Return what stays zero, a rate (D, rows), and its derivative."""
    if isinstance(c, cp.Loop):
        kept = _loop(c, oracle.frame(c.frame_a), oracle.frame(c.frame_b))
    elif isinstance(c, cp.PointContact):
        kept = [_point(oracle.frame(c.frame), c.offset)]
    elif isinstance(c, cp.SurfaceContact):
        kept = _together(oracle.frame(c.frame), _standing(oracle.frame(c.frame)), None)
    elif isinstance(c, cp.constraints.LineContact):
        here = oracle.frame(c.frame)
        kept = _together(here, _standing(here), "xyz".index(c.axis))
    elif isinstance(c, cp.constraints.PlanarContact):
        kept = [dot(constant(c.normal), _point(oracle.frame(c.frame), c.offset))]
    elif isinstance(c, cp.constraints.KnifeEdge):
        return _knife(c, oracle.frame(c.frame))
    else:
        return _rolling(c, oracle.frame(c.frame))
    rates = [np.broadcast_to(part.d, (oracle.model.nv + 1, part.d.shape[-1])) for part in kept]
    bent = [np.broadcast_to(part.dd, (oracle.model.nv + 1, part.dd.shape[-1])) for part in kept]
    return np.hstack(rates), np.hstack(bent)


def _point(place: Place, offset: tuple[float, float, float]) -> Jet:
    return apply(place.R, constant(offset)) + place.p


def _standing(place: Place) -> Place:
    """Return the same place, held by the world."""
    return Place(constant(place.R.x.reshape(3, 3)), constant(place.p.x.reshape(3)))


def _turned(a: Place, b: Place) -> Jet:
    return times(transposed(a.R), b.R)


def _shifted(a: Place, b: Place) -> Jet:
    return apply(transposed(a.R), b.p - a.p)


def _together(a: Place, b: Place, axis: int | None) -> list[Jet]:
    """Return what keeps two frames together, but for a turn about an axis."""
    if axis is None:
        # at a state where they are together, the skew part is the turn
        return [b.p - a.p, _turned(a, b).map(vee)]
    others = [i for i in range(3) if i != axis]
    return [b.p - a.p, _turned(a, b).map(lambda R: R[..., others, axis])]


def _loop(c: cp.Loop, a: Place, b: Place) -> list[Jet]:
    axis = "xyz".index(c.axis or "z")
    others = [i for i in range(3) if i != axis]
    if c.kind == "ball":
        return [b.p - a.p]
    if c.kind == "weld":
        return _together(a, b, None)
    if c.kind == "hinge":
        return _together(a, b, axis)
    if c.kind == "slider":
        return [_shifted(a, b).map(lambda r: r[..., others]), _turned(a, b).map(vee)]
    if c.kind == "planar":
        return [_shifted(a, b).map(lambda r: r[..., others])]
    apart = b.p - a.p
    return [dot(apart, apart).root()]


def _rates(x: Jet) -> Jet:
    """Return the rate of a function; its second derivative is not known, and not used."""
    return Jet(x.d, x.dd, np.zeros_like(x.dd))


def _knife(c: cp.constraints.KnifeEdge, place: Place) -> tuple[Array, Array]:
    across = apply(place.R, constant(ONE["xyz".index(c.axis)]))
    slip = dot(across, _rates(_point(place, c.offset)))
    return slip.x, slip.d


def _rolling(
    c: cp.constraints.RollingWheel | cp.constraints.RollingBall, place: Place
) -> tuple[Array, Array]:
    normal = constant(exact(c.normal) / np.sqrt((exact(c.normal) ** 2).sum()))
    w = Jet(*place.w, np.zeros_like(place.p.dd))
    if isinstance(c, cp.constraints.RollingWheel):
        axle = apply(place.R, constant(ONE["xyz".index(c.axis)]))
        ahead = unit(cross(axle, normal))
        down = cross(axle, ahead)
        names = [d for d in ("rolling", "lateral", "normal") if d in c.holds]
    else:
        ahead = unit(cross(constant(_any_across(normal.x)), normal))
        down = constant(-normal.x)
        names = ["rolling", "lateral", "normal"]
    slip = _rates(place.p) + cross(w, down.map(lambda x: exact(c.radius) * x))
    axes = {"rolling": ahead, "lateral": cross(normal, ahead), "normal": normal}
    found = [dot(axes[name], slip) for name in names]
    return np.hstack([f.x for f in found]), np.hstack([f.d for f in found])


def _any_across(normal: Array) -> Array:
    return ONE[int(np.abs(normal).argmin())]
