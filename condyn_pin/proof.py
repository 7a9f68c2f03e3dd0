"""What two residuals say about the error of a.

Let a be an answer with r = M a + h - tau - J^T lam and s = J a + gamma - a_ref. The exact answer
differs by e with

    M e = J^T dlam - r,     J e = -s.

In the metric of M, the part of e that comes from r is a projection of M^-1 r, and the part from s
is at most |s| / sigma, with sigma the smallest nonzero singular value of J L^-T (M = L L^T):

    |e|_M <= |r|_(M^-1) + |s| / sigma <= sum_j w_j |r_j| + |s| / sigma,    w_j^2 = (M^-1)_jj
    |e_i| <= w_i |e|_M.

w and sigma are taken once, at the nominal state of the scene, so this is a bound there and an
estimate elsewhere; the tests hold every solver to it at random states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from condyn_pin.robot import Vector


@dataclass(frozen=True)
class Yardstick:
    """What turns residuals of a scene into an error of its accelerations.

    Attributes
    ----------
    weights : (nv,) array
        w: square roots of the diagonal of M^-1.
    sigma : float
        Smallest nonzero singular value of J L^-T; infinite without constraints.
    gravity : float
        |g| [m/s^2].
    """

    weights: Vector
    sigma: float
    gravity: float

    def bound(self, dynamics: Vector, constraint: Vector, a: Vector, tau: Vector) -> float:
        """Return the bound on |e|_inf relative to max(|a|_inf, |g|).

        Parameters
        ----------
        dynamics, constraint : (nv,) and (m,) array
            Absolute values of the residuals r and s.
        a, tau : (nv,) array
            Only their size matters.
        """
        energy = float(self.weights.dot(dynamics)) + float(np.sqrt(constraint.dot(constraint))) / self.sigma
        error = float(self.weights.max()) * energy
        scale = max(float(np.abs(a).max()), self.gravity)
        # Forces that balance to the last bit leave a = 0, and a relative error means nothing:
        # what rounding of tau alone does to a is not held against the answer.
        rounding = float(self.weights.max() * self.weights.dot(np.abs(tau))) * np.finfo(float).eps
        return max(error - rounding, 0.0) / scale if scale else (0.0 if error <= rounding else np.inf)
