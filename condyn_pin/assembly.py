"""Assembly: a configuration near a guess that closes the loops.

Gauss-Newton on the manifold: with c(q) the violation and J its Jacobian,

    q  <-  q (+) -t J^+ c(q),

(+) being `pin.integrate`, the step t halved until |c| falls, and J^+ cut at singular values that
belong to redundant rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.equations import Equations

_CUT = 1e-9  # of J's singular values; redundant rows of a nearly closed loop lie below
_SHORTEST_STEP = 2.0**-12
_LONGEST_MOVE = 0.5  # of any joint in one iteration [rad, m]


@dataclass(frozen=True, eq=False)
class Assembly:
    """How an assembly ended.

    Attributes
    ----------
    q : (nq,) array
        The configuration with the smallest gap found.
    gap : float
        |c(q)|_inf [m, rad].
    iterations : int
    closed : bool
        Whether the gap is within tolerance.
    """

    q: Array
    gap: float
    iterations: int

    @property
    def closed(self) -> bool:
        """Whether the gap is within tolerance (1e-10)."""
        return self.gap <= tolerances.CLOSED


def assemble(
    equations: Equations,
    q: Array,
    *,
    moving: Sequence[int] | None = None,
    max_iterations: int = 60,
) -> Assembly:
    """Close the loops of a scene.

    Parameters
    ----------
    equations : Equations
    q : (nq,) array
        The guess.
    moving : sequence of int, optional
        Velocity indices that may change; all by default.
    max_iterations : int

    Returns
    -------
    Assembly
        Not closed if the guess is too far, or closing is impossible.
    """
    model = equations.model
    columns = np.arange(model.nv) if moving is None else np.asarray(moving, dtype=int)
    q = np.array(pin.normalize(model, q))
    c = equations.violation(q)
    iterations = 0
    while iterations < max_iterations and _size(c) > 0.0:
        step = np.zeros(model.nv)
        J = equations.jacobian(q)[:, columns]
        step[columns] = -np.linalg.lstsq(J, c, rcond=_CUT)[0]
        step *= min(1.0, _LONGEST_MOVE / max(_size(step), 1e-300))
        t = 1.0
        while True:
            nearer = np.array(pin.integrate(model, q, t * step))
            c_nearer = equations.violation(nearer)
            if _size(c_nearer) < _size(c) or t < _SHORTEST_STEP:
                break
            t /= 2
        if not _size(c_nearer) < _size(c):
            break  # at rounding, or stuck
        q, c = nearer, c_nearer
        iterations += 1
    return Assembly(q, _size(c), iterations)


def _size(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))
