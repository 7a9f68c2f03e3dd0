"""How the end of a step changes with its start, once v+ does: moved, and loops closed behind it.

q+ = at (+) h v+, and back to c(q+) = 0 along M^-1 J_b^T;    v+ in the axes of there
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg.lapack import dtrtrs

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.closings import Closing
from condyn_pin.simulation.integrators.posed import Posed

if TYPE_CHECKING:
    from condyn_pin.simulation.routes.linear_steps import LinearSteps


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
        for part in [part for part in way if part.end is not part.begin] or way:
            of_step = part.factors is posed.condensed.factors
            at, d_at = (posed.at, steps.itself) if of_step else (part.begin, dq)
            dq = _closed(steps, part, dq, at, d_at)
    turned = partials.turned(v1, rest, by_move).dot(dv1)
    return way[-1].end, steps.floating.turned(v1, rest), dq, turned


def _closed(steps: LinearSteps, part: Closing, dq: Array, at: Array, d_at: Array) -> Array:
    """Return dq behind a move x = M^-1 J_b^T y, M and J_b of `at`, with c(end) = 0.

    Of moves that others follow that leaves out squares of gaps. c of a row without a place is 0
    anywhere: the moves leave it where the step has led.
    """
    factors, model = part.factors, steps.system.model
    x = np.asarray(pin.difference(model, part.begin, part.end))
    U, S, r = factors.U, factors.S, factors.rank
    y = U[:, :r] @ ((factors.V.T @ (factors.L.T @ x)) / S[:r])
    of = steps.weightless.at(at, np.zeros(len(x)), x, y)
    left = of.rhs[: len(x), : len(x)] @ d_at
    if steps.inertias:
        left[:, steps.columns.inertias] -= steps.inertias.momenta(at, x)
    turned = factors.solve_mass(left)
    by_q, by_x = pin.dIntegrate(model, part.begin, x)
    dq = by_q @ dq + by_x @ turned
    J1 = steps.system.equations.jacobian(part.end)
    Z = by_x @ np.asarray(dtrtrs(factors.L.T, factors.V)[0])  # (nv, rank)
    opened = np.zeros((len(J1), dq.shape[1]))
    opened[steps.placed] = J1[steps.placed] @ dq
    back = np.linalg.lstsq(J1 @ Z, opened, rcond=tolerances.RANK)[0]
    return np.asarray(dq - Z @ back)
