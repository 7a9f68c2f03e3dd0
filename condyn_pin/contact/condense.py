"""Condense: what contacts feel of a robot whose loops never let go.

    M (v+ - v) = p + J_b^T l_b + J_c^T lam,    J_b v+ = 0

with p the impulse of all other forces. With M = L L^T, and V an orthonormal basis of what the
constraints block, L^-1 J_b^T = V S U^T,

    X = (1 - V V^T) L^-1 J_c^T,    G = X^T X,    v_free = L^-T (1 - V V^T) (L^T v + L^-1 p),
    v+ = v_free + L^-T X lam,      J_c v+ = G lam + J_c v_free,
    l_b = -U S^-1 V^T (L^T v + L^-1 p + L^-1 J_c^T lam).

A contact solver sees a pure cone problem: constraints of any kind, redundant ones too, are in G and
v_free, and J_b v+ = 0 holds to rounding whatever it answers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dtrtrs

from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg.minimum_norm import MinimumNorm


class Condensed(NamedTuple):
    """The contacts of a robot at a state, its constraints eliminated.

    Attributes
    ----------
    factors : MinimumNorm
        Of M and J_b.
    X : (nv, m) array
        L^-1 J_c^T without what the constraints block.
    free : (nv,) array
        L^T v_free.
    blocked : (rank, m + 1) array
        V^T of L^-1 J_c^T, and in the last column of L^T v + L^-1 p.
    """

    factors: MinimumNorm
    X: Array
    free: Array
    blocked: Array

    @property
    def G(self) -> Array:
        """J_c M^-1 J_c^T along the constraints (m, m) [1/kg], symmetric to the bit."""
        return np.asarray(self.X.T.dot(self.X))

    @property
    def contact_velocities(self) -> Array:
        """J_c v_free (m,) [m/s]."""
        return np.asarray(self.free.dot(self.X))

    def velocity(self, lam: Array) -> Array:
        """Return v+ (nv,) of impulses (m,) of the contacts."""
        return np.asarray(dtrtrs(self.factors.L.T, self.X.dot(lam) + self.free)[0])

    def constraint_impulses(self, lam: Array) -> Array:
        """Return l_b (rows,) of impulses (m,) of the contacts, the smallest ones [N s]."""
        factors, rank = self.factors, self.factors.rank
        held = self.blocked[:, :-1].dot(lam) + self.blocked[:, -1]
        return np.asarray(factors.U[:, :rank].dot(held / -factors.S[:rank]))


def condense(factors: MinimumNorm, J_c: Array, v: Array, p: Array) -> Condensed:
    """Return the contacts of a robot with its constraints eliminated.

    Parameters
    ----------
    factors : MinimumNorm
        Of M and J_b: L L^T = M, L^-1 J_b^T = V S U^T.
    J_c : (m, nv) array
        Rows of the contacts.
    v : (nv,) array
        Velocity before.
    p : (nv,) array
        Impulse of all forces but those of constraints and contacts [N s, N m s].

    Notes
    -----
    Cost O(nv^2 m) on top of the factors.
    """
    L, V = factors.L, factors.V
    sides = np.empty((len(J_c) + 1, len(v)))  # its transpose is what LAPACK reads without a copy
    sides[:-1], sides[-1] = J_c, p
    whitened = dtrtrs(L.T, sides.T, trans=1, overwrite_b=1)[0]
    whitened[:, -1] += v.dot(L)
    blocked = V.T.dot(whitened)
    if factors.rank:
        whitened -= V.dot(blocked)
    return Condensed(factors, whitened[:, :-1], whitened[:, -1], blocked)
