"""Weights: the proximal weight that suits a scene, and another at states where it does not do.

An eigenvalue sigma of G = J M^-1 J^T converges like mu / (sigma + mu). So mu has to be below the
smallest sigma that is more than rounding. But not far below: rows that depend on others have a
sigma of zero; where they contradict the others by c, as those of open loops do, lam grows along
them by c / mu an iteration, and rounding of G, eps |G| / mu, mixes it into the rest.

The smallest sigma is that of the nominal state, nearly always. It is another near singular
postures, and where loops are open by a gap: redundant rows come to life there, with a sigma of
about gap^2. What does not converge in a few iterations is at such a state; then the smallest sigma
is read off the factor that is there already, and mu is the largest that gains fourteen digits in
the iterations k that are left:

    (mu / (sigma + mu))^k = 1e-14.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from condyn_pin import _pin, tolerances
from condyn_pin._pin import pin
from condyn_pin.arrays import Array

if TYPE_CHECKING:
    from condyn_pin.audit import Audit
    from condyn_pin.workspace import Workspace

# Shares of the largest eigenvalue of G, and of the smallest nonzero one. The first of each are for
# redundant rows, the others for rows of which none depends on others, wherever the loops are. Rows
# that are zero but for rounding are of the first kind: lam grows along them as well.
_LARGEST, _SMALLEST, _LEAST = 1e-6, 1e-2, 1e-12
_LARGEST_FREE, _SMALLEST_FREE, _LEAST_FREE = 1e-12, 1e-4, 1e-14

# Iterations after which the default weight does not do: machines take up to six with it.
FEW = 8

# Iterations with the weight for a state, of those that are left: more would only take time. They
# stop at a smaller step than those of the default weight, since each gains less.
_MORE, _STEP = 20, 0.01

# What those leave of an error. The last digits are not worth a smaller mu: it adds noise.
_LEFT = 1e-14

_EPS = 2.0**-53


def default_mu(audit: Audit) -> float:
    """Return a proximal weight with which every part of lam converges in a few iterations."""
    largest = audit.delassus_norm
    smallest = float(audit.singular_values[audit.rank - 1]) ** 2 if audit.rank else largest
    if audit.independent and not audit.rounded:
        return max(min(_LARGEST_FREE * largest, _SMALLEST_FREE * smallest), _LEAST_FREE * largest)
    return max(min(_LARGEST * largest, _SMALLEST * smallest), _LEAST * largest)


class WeightAtState:
    """The weight for a state at which an iteration has just not converged.

    With pivots on the diagonal, P^T G P = R^T R, the squares of the diagonal of R fall as the
    eigenvalues of G do, and the last is close to the smallest. LAPACK stops where what is left is
    rounding, m eps |G|.

    Parameters
    ----------
    workspace : Workspace
    settings : pin.ProximalSettings
        Of the iteration.
    accuracy : float
        As `Proximal.relative_accuracy` [N].
    left : int
        Iterations that may be made.

    Attributes
    ----------
    iterations : int
        How many more were taken.
    """

    def __init__(self, workspace: Workspace, settings: Any, accuracy: float, left: int) -> None:
        # imported here: scipy.linalg takes as long to import as Pinocchio
        from scipy.linalg.lapack import dpstrf

        self._workspace, self._settings, self._mu = workspace, settings, float(settings.mu)
        self._accuracy, self._limit = _STEP * accuracy, min(left, _MORE)
        self._share = 1.0 / (_LEFT ** (-1.0 / self._limit) - 1.0)
        self._cholesky, self._factorise = _pin.constraint_cholesky(workspace.data), dpstrf
        # a row that is rounding has sigma < m eps |G|: a force f along it moves a by w sigma^1/2 f
        audit, rows = workspace.scene.audit, sum(c.size for c in workspace.natives.constraints)
        moved = audit.yardstick.largest_weight * (rows * _EPS * audit.delassus_norm) ** 0.5
        self._harmless = (
            tolerances.SOLVED * audit.yardstick.gravity / (FEW * moved) if rows else 0.0
        )
        self._damping = self._mu * np.eye(rows)
        self.iterations = 0

    def answer(self, run: Callable[..., Array], q: Array, v: Array, tau: Array, a: Array) -> Array:
        """Return a better a (nv,), or the same where nothing but rounding has not converged.

        Parameters
        ----------
        run : callable
            Returns a for q, v, tau and the settings that it is given.
        q, v, tau : (nq,), (nv,), (nv,) array
        a : (nv,) array
            Of the iteration.
        """
        self.iterations = 0
        G = self._cholesky.getInverseOperationalSpaceInertiaMatrix() - self._damping
        R, _, rank, _ = self._factorise(G)
        mu = self._share * R.item(rank - 1, rank - 1) ** 2 if rank else 0.0
        if not 0.0 < mu < inf:
            return a
        if self._mu <= mu and self._settings.relative_residual < self._harmless:
            return a
        settings = pin.ProximalSettings(0.0, self._accuracy, mu, self._limit)
        self._workspace.proximal_settings = settings
        a = run(q, v, tau, settings)
        self.iterations = int(settings.iter)
        return a
