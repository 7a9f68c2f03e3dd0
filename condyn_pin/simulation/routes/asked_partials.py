"""How what a scheme adds to the velocities of contacts changes with the start of a step.

    sigma = G lam + J_c v_free + (s + gap) / dt,  + e J_n v,  + R lam, ...

at fixed impulses and v_free: gaps by where the step begins, bends s by `row_partials`, R by gaps
and by G_nn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.contact_scheme import AskedBy
from condyn_pin.simulation.integrators.posed import Posed
from condyn_pin.simulation.routes.balance_partials import stiffness_partial
from condyn_pin.simulation.routes.law import Law
from condyn_pin.simulation.routes.row_partials import RowPartials

if TYPE_CHECKING:
    from condyn_pin.simulation.routes.linear_steps import LinearSteps


def add_asked(added: Array, steps: LinearSteps, posed: Posed, law: Law, rows: RowPartials) -> None:
    """Add what a scheme adds to sigma by all columns (m, columns), at fixed impulses."""
    near, columns, J_c = posed.near, steps.columns, posed.J_c
    by = steps.scheme.asked_by(near)
    if by.bends is not None:
        added[near.normals, : rows.bends.shape[1]] += by.bends[:, None] * rows.bends
    if by.gaps is not None:
        added[near.normals, columns.q] += by.gaps[:, None] * posed.J_n
    if by.before is not None:
        assert rows.before is not None  # a scheme that lets rebound closes no gaps
        added[:, columns.q] += by.before[:, None] * rows.before
        added[:, columns.v] += by.before[:, None] * J_c
    if by.restitution is not None:
        cones, approach = len(posed.chosen.friction), by.restitution
        if posed.strike is not None:
            approach = np.where(posed.strike.apart, 0.0, approach)
        added[2 : 3 * cones : 3, steps.restitution(posed)] += np.diag(approach[:cones])
    if by.solref is not None:
        added[:, columns.solref] += by.solref
    if posed.problem.R is not None:
        added += law.lam[:, None] * _softer(steps, posed, by)


def _softer(steps: LinearSteps, posed: Posed, by: AskedBy) -> Array:
    """Return R by all columns (m, columns): by gaps, and by G_nn of each contact."""
    near, columns = posed.near, steps.columns
    J_c, blocks, lines = posed.J_c, near.blocks, len(near.gaps)
    # the row that each contact, and each row of dry friction, has its stiffness of
    of_row = np.arange(len(J_c))
    if lines:
        normals = of_row[near.normals]
        of_row = np.where(blocks < lines, normals[np.minimum(blocks, lines - 1)], of_row)
    rows = np.unique(of_row)
    stiffer = columns.empty(len(J_c))
    y, l_b = posed.condensed.factors.solve(
        J_c[rows].T, np.zeros((steps.system.equations.m, len(rows)))
    )
    for i, row in enumerate(rows):
        stiffer[row, columns.q] = _compliance_by(steps, posed, y[:, i], l_b[:, i], row)
        if steps.inertias:
            lighter = steps.inertias.momenta(posed.at, y[:, i])
            stiffer[row, columns.inertias] -= y[:, i] @ lighter
    assert by.R_stiffness is not None  # of a scheme with R
    changed = by.R_stiffness[:, None] * stiffer[of_row]
    if lines and by.R_gaps is not None:
        of_gaps = np.where(blocks < lines, by.R_gaps, 0.0)
        changed[:, columns.q] += of_gaps[:, None] * posed.J_n[np.minimum(blocks, lines - 1)]
    return changed


def _compliance_by(steps: LinearSteps, posed: Posed, y: Array, l_b: Array, row: int) -> Array:
    """Return G_nn by q (nv,): 2 y . (J_n^T)' - y . (M y - J_b^T l_b)' + l_b . (J_b y)'."""
    n = len(y)
    of = steps.weightless.at(posed.at, np.zeros(n), y, l_b)
    turned = steps.turning.velocity_by_q(y)
    by_q = 2 * turned[posed.chosen.rows][row] + y @ of.rhs[:n, :n] - l_b @ of.rhs[n:, :n]
    if steps.system.passive.between is not None:
        by_q = by_q - y @ stiffness_partial(steps, posed, posed.at, y)
    return np.asarray(by_q)
