"""How the rows of contacts in a step change with its start, and how far their paths bend.

Where contacts are taken where the equations of a step are, in closed form:

    (J_c v+)' = (J_c v+)_q dq,    (J_c^T lam)' = (J_c^T lam)_q dq,
    s' = J_e dq_e - J_n dq - dt ((J_n v)_q dq + J_n dv),    dq_e = d(q (+) dt v)

Where they are taken at the end q_e of a path along u, whose axes T turns to those of the beginning,
J_c = J_e T, with s = gap_e - gap - dt J_c u,

    (J_c v+)' = (J_e T v+)_q dq_e + J_e T' v+,
    (J_c^T lam)' = T^T (J_e^T lam)_q dq_e + T'^T J_e^T lam,
    s' = J_e dq_e - J_n dq - dt ((J_c u)' + J_c du),    dq_e = d(q (+) dt u)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms
from condyn_pin.dynamics.derivatives.base import slope
from condyn_pin.simulation.integrators.posed import Posed

if TYPE_CHECKING:
    from condyn_pin.simulation.routes.linear_steps import LinearSteps


class RowPartials(NamedTuple):
    """At fixed v+ and impulses, by q alone, and bends by q and v; or by all columns."""

    slips: Array  # (m, columns), J_c v+
    pulls: Array  # (nv, columns), J_c^T lam
    bends: Array  # (k, columns)
    before: Array | None = None  # (m, nv), J_c v by q; not where they are taken at the end


def row_partials(
    steps: LinearSteps, posed: Posed, lam: Array, v1: Array, along: Array | None
) -> RowPartials:
    """Return how rows and bends change; `along` (nv, columns) is how the path of contacts does."""
    if posed.path is not None:
        assert along is not None  # where a step goes along a path, one has led to it
        return _at_the_end(steps, posed, posed.path, lam, v1, along)
    return _at_the_beginning(steps, posed, lam, v1)


def _at_the_beginning(steps: LinearSteps, posed: Posed, lam: Array, v1: Array) -> RowPartials:
    rows = posed.chosen.rows
    all_lam = np.zeros(len(posed.J))
    all_lam[rows] = lam
    steps.turning.go(posed.at, posed.J)
    turned, pulled = steps.turning.by_q((v1, posed.v), all_lam)
    before = turned[1, rows]
    return RowPartials(turned[0, rows], pulled, _bends(steps, posed, before), before)


def _bends(steps: LinearSteps, posed: Posed, before: Array) -> Array:
    """Return how the bends along the velocity before change."""
    dt, system, chosen, v = steps.dt, steps.system, posed.chosen, posed.v
    bends, there = np.zeros((len(posed.near.bends), 2 * len(v))), posed.straight
    if there is None:
        return bends
    k, data = chosen.contact_points, system.equations.data
    normals = slice(2, 3 * k, 3)
    algorithms(data).computeJointJacobians(system.model, data, there)
    J_end = system.contacts.normals_over_planes(data)[chosen.over_planes]
    J_n = posed.J_n[:k]
    by_at, by_move = steps.partials.integrate(posed.at, dt * v)
    bends[:k, : len(v)] = J_end.dot(by_at) - J_n - dt * before[normals]
    bends[:k, len(v) :] = dt * (J_end.dot(by_move) - J_n)
    return bends


def _at_the_end(
    steps: LinearSteps, posed: Posed, path: Array, lam: Array, v1: Array, along: Array
) -> RowPartials:
    dt, chosen, columns = steps.dt, posed.chosen, steps.columns
    floating, rows, n = steps.floating, chosen.rows, len(v1)
    one, moved = np.eye(n), dt * along

    def turn(y: Array) -> Array:
        return floating.rows_before(one, path + y / dt, dt)

    T = turn(np.zeros(n))
    J_e = steps.steps.ends.there(posed.at, path).J.dot(T.T)
    by_at, by_move = steps.partials.integrate(posed.at, dt * path)
    dq_e = by_at.dot(steps.itself) + by_move.dot(moved)
    all_lam = np.zeros(len(J_e))
    all_lam[rows] = lam
    steps.turning.go(floating.integrate(posed.at, dt * path), J_e)
    turned, pulled = steps.turning.by_q((T.dot(v1), T.dot(path)), all_lam)
    J_c, pull = J_e[rows], lam.dot(J_e[rows])
    slips, slips_along = turned[0, rows].dot(dq_e), turned[1, rows].dot(dq_e)
    slips_along += J_c.dot(T.dot(along))
    pulls = T.T.dot(pulled.dot(dq_e))
    for i in np.flatnonzero(moved.any(axis=0)) if floating.floats else ():
        size = float(np.abs(moved[:, i]).max())
        dT = size * slope(turn, moved[:, i] / size)
        slips[:, i] += J_c.dot(dT.dot(v1))
        slips_along[:, i] += J_c.dot(dT.dot(path))
        pulls[:, i] += pull.dot(dT)
    normals = chosen.normals
    bends = J_c[normals].dot(dq_e) - dt * slips_along[normals]
    bends[:, columns.q] -= posed.J_n
    if posed.kept is not None:
        its = posed.kept.gaps[chosen.near]
        begun = _at_the_beginning(steps, posed, lam, v1).bends
        bends[its], bends[its, : begun.shape[1]] = 0.0, begun[its]
    return RowPartials(slips, pulls, bends)
