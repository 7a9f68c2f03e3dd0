"""Derivatives by central differences on the manifold: slow, independent, for checking.

    f'(0) ~ (8 (f(h) - f(-h)) - (f(2h) - f(-2h))) / (12 h)

along ``pin.integrate(model, q, t e_i)`` and its like for v, and max(M_ii) t e_i for tau, which
also the heaviest joint feels: (a, lam) is linear in tau, no step is too large. One step h serves
all, that of a sweep at which the result changes least. Where rows are redundant q is closed again
after each step from closed loops, and the derivatives by q are those along the constraints: zero
across. At states off the constraints all columns are those of the answer there.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import null_space
from condyn_pin._core.threads import of_workspace
from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import DerivativesDisagree

# Rounding of f is divided by h, the remainder of the stencil goes with h^4.
STEPS = (1e-3, 3e-4, 1e-4, 3e-5)

# Impedance bends within a gap of a millimetre.
_SOFT_STEPS = (1e-5, 3e-6, 1e-6, 3e-7)

# What refinement gains is lost in the differences.
_PLAIN = Reference(refinements=0)

# A step of 1e-3 opens a loop by 1e-6, one Newton step leaves 1e-12, two leave rounding.
_CLOSINGS = 2

BLOCKS = ("da_dq", "da_dv", "da_dtau", "dlam_dq", "dlam_dv", "dlam_dtau")


class DifferenceDerivatives(Derivatives):
    """Central differences of `Reference`, or of a solver of soft constraints itself."""

    def __init__(self, workspace: Workspace, solution: Solution, v: Array, tau: Array) -> None:
        super().__init__(solution)
        self._v, self._tau = v, tau
        self._workspace, self._loads = workspace, workspace.loads
        self._model, self._equations = workspace.model, workspace.equations
        scene = solution.scene
        terms = self._equations.terms(solution.q, v)
        self._bound = None if workspace.solver.exact else workspace.bound
        redundant = scene.nominal.dependent and workspace.solver.exact
        # (k, nv) orthonormal directions in which q was moved
        self.along = directions(terms.J, redundant and solution._missed is None)
        self._heaviest = float(np.diag(terms.M).max(initial=0.0))
        self.step = 0.0  # the step that was chosen [rad, m, and so on]

    @of_workspace
    def _form(self) -> tuple[Array, Array, Array]:
        steps = STEPS if self._bound is None else _SOFT_STEPS
        tables = [self._table(h) for h in steps]
        changes = [np.abs(a - b).max() for a, b in pairwise(tables)]
        best = int(np.argmin(changes)) + 1
        self.step = steps[best]
        by_q, by_v, by_tau = np.hsplit(tables[best], 3)
        return by_q, by_v, by_tau

    def _table(self, h: float) -> Array:
        """Return the derivatives of (a, lam) by (q, v, tau) with one step."""
        q, v, tau = self.solution.q, self._v, self._tau
        answer, unit, size = self._answer, np.eye(self._n), self._n + self._m
        still = np.zeros_like(tau)

        def moved(step: Array) -> Array:
            there = self._moved(step)
            return answer(there, v, self._pushed(there, tau))

        by_q = _central(moved, self.along, h, size)
        # (a, lam) is linear in the torques, and how it changes with v does not depend on them:
        # without them there is less to lose in the differences
        by_v = _central(lambda step: answer(q, v + step, still), unit, h, size)
        by_tau = _central(lambda step: answer(q, v, self._heaviest * step), unit, h, size)
        return np.hstack([by_q @ self.along, by_v, by_tau / self._heaviest])

    def _answer(self, q: Array, v: Array, tau: Array) -> Array:
        if self._bound is not None:
            return np.concatenate((self._bound.acceleration(q, v, tau), self._bound.lam()))
        terms = self._equations.terms(q, v)
        left = self._equations.left_out(terms.J, self._equations.violation(q))
        return np.concatenate(_PLAIN.solve(terms.kept(left) if left else terms, tau))

    def _pushed(self, q: Array, tau: Array) -> Array:
        """Return the torques together with those of the forces from outside."""
        applied = self.solution.applied
        return tau + self._loads.at(q, applied).torque if applied else tau

    def _moved(self, step: Array) -> Array:
        q = np.array(pin.integrate(self._model, self.solution.q, step))
        if len(self.along) == self._n:
            return q
        for _ in range(_CLOSINGS):
            c, J = self._equations.violation(q), self._equations.jacobian(q)
            back = np.linalg.lstsq(J, c, rcond=tolerances.RANK)[0]
            q = np.array(pin.integrate(self._model, q, -back))
        return q


def directions(J: Array, redundant: bool) -> Array:
    """Return the directions in which q is moved: all, or those along the constraints."""
    return null_space(J) if redundant else np.eye(J.shape[1])


def _central(f: Callable[[Array], Array], directions: Array, h: float, size: int) -> Array:
    """Return the derivative of f (size,) along each of the directions, a column each."""
    columns = [
        (8 * (f(h * d) - f(-h * d)) - (f(2 * h * d) - f(-2 * h * d))) / (12 * h) for d in directions
    ]
    return np.column_stack(columns) if columns else np.zeros((size, 0))


def check_derivatives(found: Derivatives, differences: DifferenceDerivatives) -> None:
    """Raise `DerivativesDisagree` where derivatives differ from central differences."""
    # By q, where rows are redundant and loops closed, only along the constraints. The largest
    # difference is kept as the `disagreement` of what was `found`.
    worst = 0.0
    for name in BLOCKS:
        wanted: Array = getattr(differences, name)
        had: Array = getattr(found, name)
        if name.endswith("_dq"):
            had = had @ differences.along.T @ differences.along
        error = np.abs(had - wanted)
        size = max(float(np.abs(wanted).max(initial=0.0)), 1.0)
        if error.size and not error.max() <= tolerances.DERIVATIVES * size:
            row, column = np.unravel_index(int(np.argmax(error)), error.shape)
            raise DerivativesDisagree(
                f"{name}[{row}, {column}] = {had[row, column]:.9g}, and differences with a step of "
                f"{differences.step:g} give {wanted[row, column]:.9g}; the largest entry is "
                f"{size:.3g}. Near a singular state or at an open loop neither is reliable"
            )
        worst = max(worst, float(error.max(initial=0.0)) / size)
    found.disagreement = worst
