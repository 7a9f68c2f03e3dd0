"""Weights: the proximal weight that suits a scene, and smaller ones where it does not do.

An eigenvalue sigma of G = J M^-1 J^T converges like mu / (sigma + mu). A small mu is quick, and
follows sigma far down towards a singular posture. What forbids one are redundant rows: lam along
them is noise of the size eps |a| / mu, and where loops are open by a gap they come to life with a
sigma of about gap^2, and ask for what no row of a closed loop asks for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.refinement import Refinement

if TYPE_CHECKING:
    from condyn_pin.audit import Audit
    from condyn_pin.workspace import Workspace

# Shares of the largest eigenvalue of G, and of the smallest nonzero one. The first of each are for
# redundant rows, the others for rows of which none depends on others, wherever the loops are.
_LARGEST, _SMALLEST, _LEAST = 1e-6, 1e-2, 1e-10
_LARGEST_FREE, _SMALLEST_FREE, _LEAST_FREE = 1e-10, 1e-4, 1e-14

# What is tried where that does not converge: rows that have all but lost their grip are followed
# down to rounding of G, or else let go.
_OTHERS = (1e-14, 1e-17, 1e-6)

# A correction of a that is less, relative to a, changes nothing.
_STILL = tolerances.SOLVED / 1000


def default_mu(audit: Audit) -> float:
    """Return a proximal weight with which every part of lam converges in a few iterations."""
    largest = audit.delassus_norm
    smallest = float(audit.singular_values[audit.rank - 1]) ** 2 if audit.rank else largest
    if audit.independent:
        return max(min(_LARGEST_FREE * largest, _SMALLEST_FREE * smallest), _LEAST_FREE * largest)
    return max(min(_LARGEST * largest, _SMALLEST * smallest), _LEAST * largest)


class OtherWeights:
    """Other weights, tried in turn where an iteration has not converged.

    If a much smaller one converges, its answer is taken. If not, then of all answers that which its
    own residuals move the least, and moved so: J a + gamma - a_ref alone would prefer what holds a
    row by a force without bounds.

    Parameters
    ----------
    workspace : Workspace
    max_iterations : int
    accuracy : float
        As `Proximal.relative_accuracy` [N].

    Attributes
    ----------
    lam : (m,) array
        Forces of the rows that Pinocchio has, of the last answer.
    iterations : int
        Of all that was tried for it.
    """

    def __init__(self, workspace: Workspace, max_iterations: int, accuracy: float) -> None:
        audit = workspace.scene.audit
        self._workspace, self._limit = workspace, max_iterations
        self._gravity = audit.yardstick.gravity
        self._settings: list[Any] = [
            pin.ProximalSettings(0.0, accuracy, share * audit.delassus_norm, max_iterations)
            for share in _OTHERS
        ]
        self._correction = Refinement(workspace)
        self.lam: Array = np.zeros(0)
        self.iterations = 0

    def answer(self, run: Callable[..., Array], q: Array, v: Array, tau: Array) -> Array:
        """Return the best a (nv,).

        Parameters
        ----------
        run : callable
            Returns a for q, v, tau and the settings that it is given.
        q, v, tau : (nq,), (nv,), (nv,) array
        """
        small, *others = self._settings
        a = run(q, v, tau, small)
        self.iterations = self._limit + int(small.iter)
        if small.iter < self._limit:
            self.lam = np.array(self._workspace.data.lambda_c)
            return a
        with np.errstate(all="ignore"):  # what is not finite is found by whoever asked
            moved, best, self.lam = self._corrected(q, v, tau, a)
            for settings in others:
                if not moved > _STILL:
                    break
                again, a, lam = self._corrected(q, v, tau, run(q, v, tau, settings))
                self.iterations += int(settings.iter)
                if again < moved:
                    moved, best, self.lam = again, a, lam
        return best

    def _corrected(self, q: Array, v: Array, tau: Array, a: Array) -> tuple[float, Array, Array]:
        """Return how far its residuals move an answer, relative to its size; a and lam moved."""
        lam = np.array(self._workspace.data.lambda_c)
        better = self._correction.correct(q, v, tau, a, lam)
        size = max(float(np.abs(a).max()), self._gravity)
        moved = float(np.abs(better - a).max()) / size if size else 0.0
        return moved, better, self._correction.lam
