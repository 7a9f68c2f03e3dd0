"""How the end of a step changes with its start, once v+ does: moved, and loops closed behind it.

q+ = at (+) h v+, and back to c(q+) = 0 along M^-1 J_b^T;    v+ in the axes of there
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.linalg.lapack import dtrtrs

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.closings import Closing
from condyn_pin.simulation.integrators.posed import Posed
from condyn_pin.simulation.routes.balance_partials import stiffness_partial

if TYPE_CHECKING:
    from condyn_pin.simulation.routes.linear_steps import LinearSteps
    from condyn_pin.simulation.system import System

# How far configurations of a difference are apart [rad, m]: right to 1e-10.
_APART: Final = 1e-5


def moved(
    steps: LinearSteps, posed: Posed, v1: Array, dv1: Array
) -> tuple[Array, Array, Array, Array]:
    """Return q+ and v+ in the axes in which a step ends, and both by all columns."""
    rest, partials, columns = steps.share, steps.partials, steps.columns
    move = rest * v1
    by_at, by_move = partials.integrate(posed.at, move)
    dq = (rest * by_move).dot(dv1)
    dq[:, columns.q] += by_at
    there = steps.floating.integrate(posed.at, move)
    way = steps.steps.closings.way(posed.condensed.factors, there)
    if posed.condensed.factors.rank and len(steps.placed):
        parts = [part for part in way if part.end is not part.begin] or way
        for part in parts:
            of_step = part.factors is posed.condensed.factors
            at, d_at = (posed.at, steps.itself) if of_step else (part.begin, dq)
            dq = _closed(steps, posed, part, dq, at, d_at, whole=part is parts[-1])
    turned = partials.turned(v1, rest, by_move).dot(dv1)
    return way[-1].end, steps.floating.turned(v1, rest), dq, turned


def _closed(
    steps: LinearSteps,
    posed: Posed,
    part: Closing,
    dq: Array,
    at: Array,
    d_at: Array,
    *,
    whole: bool,
) -> Array:
    """Return dq behind moves x = M^-1 J_b^T y, M and J_b of `at`; M has implicit springs in it.

    c = 0 at the end of the `whole` way; a move that others follow has J_b x = -c where it begins.
    Rows without a place have J_b x = 0.
    """
    factors, system, placed = part.factors, steps.system, steps.placed
    x = np.asarray(pin.difference(system.model, part.begin, part.end))
    n, r = len(x), factors.rank
    y = factors.U[:, :r] @ ((factors.V.T @ (factors.L.T @ x)) / factors.S[:r])
    of = steps.weightless.at(at, np.zeros(n), x, y)
    left = of.rhs[:, :n] @ d_at
    if system.passive.between is not None:
        left[:n] -= stiffness_partial(steps, posed, at, x) @ d_at
    if steps.inertias:
        left[:n, steps.columns.inertias] -= steps.inertias.momenta(at, x)
    turned, along = factors.solve_mass(left[:n]), np.asarray(dtrtrs(factors.L.T, factors.V)[0])
    by_q, by_x = pin.dIntegrate(system.model, part.begin, x)
    J = system.equations.consistent_jacobian(at)
    opened, closed = J @ turned - left[n:], J @ along
    if whole:
        J = system.equations.jacobian(part.end)[placed]
        opened[placed], closed[placed] = J @ (by_q @ dq + by_x @ turned), J @ (by_x @ along)
    else:
        opened += _violation_by_q(system, part.begin) @ dq
    back = np.linalg.lstsq(closed, opened, rcond=tolerances.RANK)[0]
    return np.asarray(by_q @ dq + by_x @ (turned - along @ back))


def _violation_by_q(system: System, q: Array) -> Array:
    """Return how c changes with q (m, nv): where loops are open J is not that. By differences."""
    moves = _APART * np.eye(system.model.nv)
    ends = [
        [system.equations.violation(system.integrate(q, s * x)) for s in (1, -1)] for x in moves
    ]
    return np.array([(up - down) / (2 * _APART) for up, down in ends]).T
