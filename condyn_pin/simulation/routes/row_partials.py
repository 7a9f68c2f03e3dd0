"""How the rows of contacts in a step change with its start, and how far their paths bend.

Where contacts are taken where the equations of a step are, in closed form:

    (J_c v+)' = (J_c v+)_q dq,    (J_c^T lam)' = (J_c^T lam)_q dq,
    s' = J_e dq_e - J_n dq - dt ((J_n v)_q dq + J_n dv),    dq_e = d(q (+) dt v)

Where they are taken at the end of a path along u, which is rare: by differences of
`PathEnds.there`, with s = gap_e - gap - dt J_e u.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms
from condyn_pin.dynamics.derivatives.carried import slope
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
    model, dt, chosen, columns = steps.system.model, steps.dt, posed.chosen, steps.columns
    m, k = len(lam), len(posed.near.bends)

    def rows(moved: Array) -> Array:
        at, u = pin.integrate(model, posed.at, moved[: len(path)]), path + moved[len(path) :] / dt
        gaps, J = steps.steps.ends.there(at, u)
        J_c = J[chosen.rows]
        bent = gaps[chosen.gaps] - dt * J_c.dot(u)[chosen.normals]
        return np.concatenate((J_c.dot(v1), lam.dot(J_c), bent))

    moves = np.concatenate((steps.itself, dt * along))
    changes = np.zeros((m + len(v1) + k, moves.shape[1]))
    for i in np.flatnonzero(moves.any(axis=0)):
        size = float(np.abs(moves[:, i]).max())
        changes[:, i] = size * slope(rows, moves[:, i] / size)
    bends = changes[m + len(v1) :]
    bends[:, columns.q] -= posed.J_n
    if posed.kept is not None:
        its = posed.kept.gaps[chosen.near]
        begun = _at_the_beginning(steps, posed, lam, v1).bends
        bends[its], bends[its, : begun.shape[1]] = 0.0, begun[its]
    return RowPartials(changes[:m], changes[m : m + len(v1)], bends)
