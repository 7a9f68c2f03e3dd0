"""What the balance of momentum and the constraints leave of a step, at fixed v+ and impulses.

    df = (M (v + dt w x u - v+) + dt (tau - h) + J_b^T l_b)',    w x u as in `Manifold`
    ds = (s' - dt/2 (gamma - J_b w x u) - J_b v+)'

by where the equations are taken, by their v and by tau, in all `Columns`. J_c^T lam belongs to df
too: `row_partials` has it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.derivatives.base import slope
from condyn_pin.dynamics.derivatives.kkt import Linearised
from condyn_pin.simulation.integrators.posed import Posed

if TYPE_CHECKING:
    from condyn_pin.simulation.routes.linear_steps import LinearSteps


def linearised(steps: LinearSteps, posed: Posed, v1: Array, l_b: Array) -> Linearised:
    """Return the linearised equations of a step: of (v+ - v) / dt and of the mean forces."""
    a = (v1 - posed.v) / steps.dt - posed.turning
    return steps.linearisation.at(posed.at, posed.mean, a, l_b / steps.dt)


def left_of_momentum(
    steps: LinearSteps, of: Linearised, posed: Posed, v1: Array, mean: Array | None = None
) -> Array:
    """Return df (nv, columns), what the balance of momentum leaves.

    `mean` (nv, columns) is how the velocity of h changes, if it is not the one before.
    """
    n, dt, columns = len(v1), steps.dt, steps.columns
    M = steps.system.equations.mass(posed.at) if of.M is None else of.M
    f = columns.empty()
    np.multiply(dt, of.rhs[:n], out=f[:, : 2 * n])
    f[:, columns.tau] = steps.unit_impulses
    f[:, columns.v] += dt * M.dot(steps.floating.turning_by(posed.mean))
    if mean is not None:
        by_mean = f[:, columns.v].copy()
        f[:, columns.v] = 0.0
        f += by_mean.dot(mean)
    f[:, columns.v] += posed.condensed.factors.mass.M  # with springs, if those are implicit
    if steps.inertias:
        a = (v1 - posed.v) / dt - posed.turning
        f[:, columns.inertias] -= dt * steps.inertias.forces(posed.at, posed.mean, a)
    if steps.system.passive.between is not None:
        f[:, columns.q] -= stiffness_partial(steps, posed, posed.at, v1 - posed.v)
    return f


def left_of_constraints(steps: LinearSteps, of: Linearised, posed: Posed, v1: Array) -> Array:
    """Return ds (rows, columns), what the constraints leave of a step whose h is that of v.

    J_b (2 v+ / dt - w x u) + gamma = 2 s' / dt,    gamma less s''; s is of time alone
    """
    n, dt, columns = len(v1), steps.dt, steps.columns
    slip = columns.empty(len(of.rhs) - n)
    if not len(slip):
        return slip
    missing = (v1 + posed.v) / dt  # to the acceleration of `of`
    s_q = -of.rhs[n:, :n] + steps.linearisation.turning(posed.at, missing)
    by_v = -of.rhs[n:, n:] - of.J @ steps.floating.turning_by(posed.v)
    slip[:, columns.q], slip[:, columns.v] = -0.5 * dt * s_q, -0.5 * dt * by_v
    return slip


def untouched(steps: LinearSteps, posed: Posed, v1: Array) -> Array:
    """Return v+ by all columns (nv, columns) of a step in which nothing touches.

    Its h is that of the mean of v and of v+ with h at v.
    """
    factors, dt, columns = posed.condensed.factors, steps.dt, steps.columns
    first = 2 * posed.mean - posed.v
    M, h, J_b, gamma = steps.system.equations.parts(posed.at, posed.v)
    w = steps.floating.turning(posed.v)
    L = factors.L
    p = L @ (L.T @ posed.v) + dt * (posed.tau - h + M @ w)
    slip = steps.system.equations.wanted[1] - 0.5 * dt * (gamma - J_b @ w)
    l_b = factors.solve(p, slip)[1]
    at_start = posed._replace(mean=posed.v, turning=w)
    of = linearised(steps, at_start, first, l_b)
    s = left_of_constraints(steps, of, at_start, first)
    mean = 0.5 * factors.solve(left_of_momentum(steps, of, at_start, first), s)[0]
    mean[:, columns.v] += 0.5 * np.eye(len(v1))
    l_b = posed.condensed.constraint_impulses(np.zeros(0))
    again = linearised(steps, posed, v1, l_b)
    f = left_of_momentum(steps, again, posed, v1, mean)
    applied = steps.system.applied
    if steps.scheme.at_midpoint and applied.constant is None:
        # torques at the mean velocity, in place of those at the one before
        (q0, v0), (q1, v1_) = (
            applied.slopes(posed.t, posed.at, each) for each in (posed.v, posed.mean)
        )
        f += dt * v1_.dot(mean)
        f[:, columns.q] += dt * (q1 - q0)
        f[:, columns.v] -= dt * v0
    # rows of constraints with the first h, and this v+
    if len(l_b):
        turned = steps.linearisation.turning(posed.at, 2 / dt * (v1 - first))
        s[:, columns.q] -= 0.5 * dt * turned
    return factors.solve(f, s)[0]


def stiffness_partial(steps: LinearSteps, posed: Posed, q: Array, x: Array) -> Array:
    """Return U^T w U x by q (nv, nv), what springs between frames add to M x in implicit steps."""
    between = steps.system.passive.between
    assert between is not None

    def pull(step: Array) -> Array:
        U, weights = between.inertia_rows(pin.integrate(steps.system.model, q, step), posed.span)
        return np.asarray(U.T @ (weights * (U @ x)))

    return np.column_stack([slope(pull, along) for along in np.eye(len(x))])
