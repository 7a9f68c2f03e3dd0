"""Condense: Delassus operator of the contacts, loops eliminated.

    M (v+ - v) = p + J_b^T l_b + J_c^T lam,    J_b v+ = s

with p the impulse of all other forces. With M = L L^T, and V an orthonormal basis of what the
constraints block, L^-1 J_b^T = V S U^T,

    X = (1 - V V^T) L^-1 J_c^T,    G = X^T X,
    v_free = L^-T ((1 - V V^T) (L^T v + L^-1 p) + V S^-1 U^T s),
    v+ = v_free + L^-T X lam,      J_c v+ = G lam + J_c v_free,
    l_b = U S^-1 (S^-1 U^T s - V^T (L^T v + L^-1 p + L^-1 J_c^T lam)).

A row that the constraints hold is theirs alone: it is zero here, not what rounding leaves of it.
Where they move it along a path, G is zero and the velocity stays: it is the slip of dry friction.
A contact solver sees a pure cone problem: constraints of any kind, redundant ones too, are in G and
v_free, and J_b v+ = s holds to rounding whatever it answers.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.lapack import dtrtrs

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.linalg import MinimumNorm
from condyn_pin.dynamics.solvers.soft import (
    DEFAULT_SOLIMP,
    DEFAULT_SOLREF,
    SolImp,
    SolRef,
    check_softness,
    impedance,
    reference,
)
from condyn_pin.errors import InvalidArgument


class Condensed(NamedTuple):
    """The contacts of a robot at a state, its constraints eliminated."""

    factors: MinimumNorm  # of M and J_b
    X: Array  # (nv, m) L^-1 J_c^T without what the constraints block
    blocked: Array  # (rank, m) V^T L^-1 J_c^T, what they block of it
    held: Array  # (rank,) S^-1 U^T s
    momentum: Array  # (rank,) V^T (L^T v + L^-1 p)
    free: Array  # (nv,) L^T v_free
    path: Array | None = None  # (rank,) or (k, rank) S^-1 U^T s' of constraints that follow a path

    @property
    def G(self) -> Array:
        """J_c M^-1 J_c^T along the constraints (m, m) [1/kg], symmetric to the bit."""
        return np.asarray(self.X.T.dot(self.X))

    @property
    def contact_velocities(self) -> Array:
        """J_c v_free (m,) [m/s]."""
        moved = np.asarray(self.free.dot(self.X))
        return moved + self.held.dot(self.blocked) if self.factors.rank else moved

    @property
    def free_velocity(self) -> Array:
        """v_free (nv,): the velocity after the step without contact forces."""
        return np.asarray(dtrtrs(self.factors.L.T, self.free)[0])

    def changed(self, f: Array, s: Array) -> tuple[Array, Array]:
        """Return changes of L^T v_free and J_c v_free with p and s, for columns of both (., k)."""
        factors, y = self.factors, self.factors.mass.L_inv.dot(f)
        if not factors.rank:
            return y, self.X.T.dot(y)
        held = (factors.U[:, : factors.rank] / factors.S[: factors.rank]).T.dot(s)
        y += factors.V.dot(held - factors.V.T.dot(y))
        return y, self.X.T.dot(y) + self.blocked.T.dot(held)

    def with_contacts(self, J_c: Array) -> Condensed:
        """Return this step with other rows of contacts (m, nv)."""
        X, blocked = _unblocked_rows(self.factors, J_c, self.path)
        return self._replace(X=X, blocked=blocked)

    def velocity(self, lam: Array) -> Array:
        """Return v+ (nv,) of impulses (m,) of the contacts."""
        return np.asarray(dtrtrs(self.factors.L.T, self.X.dot(lam) + self.free)[0])

    def constraint_impulses(self, lam: Array) -> Array:
        """Return l_b (rows,) of impulses (m,) of the contacts, the smallest ones [N s]."""
        factors, rank = self.factors, self.factors.rank
        if not rank:
            return np.zeros(len(factors.U))
        missing = self.held - self.momentum - self.blocked.dot(lam)
        return np.asarray(factors.U[:, :rank].dot(missing / factors.S[:rank]))


def condense(
    factors: MinimumNorm, J_c: Array, v: Array, p: Array, s: Array, rates: Array | None = None
) -> Condensed:
    """Return the contacts of a robot with its constraints eliminated, at O(nv^2 m)."""
    # The `factors` are those of M and J_b: L L^T = M, L^-1 J_b^T = V S U^T. J_c (m, nv) are the
    # rows of the contacts, v (nv,) is the velocity before the step, p (nv,) the impulses of all
    # other forces [N s, N m s], and s = J_b v+ (rows,), of which `rates` is the part that is the
    # rate s' of a path; where s are accelerations, s' and s'', for a path that does either moves.
    V, rank = factors.V, factors.rank
    w = v.dot(factors.L) + dtrtrs(factors.L.T, p, trans=1)[0]
    path = None if rates is None or not rank else _constraint_part(factors, rates)
    X, blocked = _unblocked_rows(factors, J_c, path)
    if not rank:
        return Condensed(factors, X, blocked, _NOTHING, _NOTHING, w)
    momentum, held = V.T.dot(w), _constraint_part(factors, s)
    return Condensed(factors, X, blocked, held, momentum, w + V.dot(held - momentum), path)


def _constraint_part(factors: MinimumNorm, s: Array) -> Array:
    """Return S^-1 U^T s."""
    rank = factors.rank
    return np.asarray(s.dot(factors.U[:, :rank]) / factors.S[:rank])


def _unblocked_rows(factors: MinimumNorm, J_c: Array, path: Array | None) -> tuple[Array, Array]:
    """Return X, rows of contacts without what the constraints block, and what they block."""
    X = dtrtrs(factors.L.T, J_c.T, trans=1)[0]
    if not factors.rank:
        return X, X[:0]
    blocked = factors.V.T.dot(X)
    X -= factors.V.dot(blocked)
    # squares: einsum takes a pass, and no square root
    held = np.einsum("ij,ij->j", X, X) <= _HELD * np.einsum("ij,ij->j", blocked, blocked)
    if held.any():
        X[:, held] = 0.0
        if path is not None:
            held &= (np.abs(np.atleast_2d(path.dot(blocked))) <= tolerances.NOT_DRIVEN).all(axis=0)
        blocked[:, held] = 0.0
    return X, blocked


# What is left of a row that constraints hold is rounding: impulses of 1e29 N s would move it.
_HELD: Final = tolerances.REFERENCE_RANK**2

_NOTHING: Final = np.zeros(0)


# Soft contacts: MuJoCo's compliance and reference acceleration, for the rows of cones.


class SoftContact(NamedTuple):
    """Compliance and reference acceleration of soft contacts, in the rows (t1, t2, n) of a ccp.

    Attributes
    ----------
    R : (3 k,) array
        Compliance [1/kg].
    a_ref : (3 k,) array
        Reference acceleration [m/s^2].
    """

    R: Array  # (3 k,) [1/kg]
    a_ref: Array  # (3 k,) [m/s^2]


def soft_contact(
    gaps: ArrayLike,
    velocities: ArrayLike,
    diagonal: ArrayLike,
    *,
    solref: SolRef = DEFAULT_SOLREF,
    solimp: SolImp = DEFAULT_SOLIMP,
    impratio: float = 1.0,
) -> SoftContact:
    """Return compliance and reference acceleration of contacts as in MuJoCo.

    R_n = (1 - d) / d G_nn,    R_t = R_n / impratio,    a_ref = -b J v - (0, 0, k gap)

    With them, at the level of accelerations, the forces are those of the ccp

    ContactProblem(G, J a_free + gamma - a_ref, friction, R=R, law="ccp", level="acceleration")

    Parameters
    ----------
    gaps : (k,) array_like
        Distance of each contact, negative where bodies overlap [m].
    velocities : (3 k,) array_like
        J v, in the rows (t1, t2, n) [m/s].
    diagonal : (k,) array_like
        G_nn of each contact, or what MuJoCo takes for it, the sum of `body_invweight0` [1/kg].
    solref, solimp : tuple
        As in `condyn_pin.dynamics.Soft`. MuJoCo itself goes no faster than a timeconst of two
        steps.
    impratio : float
        How much stiffer friction is than the normal [1].

    Returns
    -------
    SoftContact

    Raises
    ------
    InvalidArgument
        If sizes do not fit, or a number cannot be used.

    References
    ----------
    MuJoCo documentation: Computation, "Constraint model"; Modeling, "Solver parameters".
    """
    solref, solimp = check_softness(solref, solimp)
    c = finite("gaps", gaps, (np.size(gaps),))
    v = finite("velocities", velocities, (3 * len(c),)).reshape(-1, 3)
    w = finite("diagonal", diagonal, (len(c),))
    if not finite("impratio", impratio, ()) > 0:
        raise InvalidArgument(f"impratio = {impratio!r}: a number > 0 is needed")
    d = impedance(np.abs(c), solimp)
    R = np.repeat((1 - d) / d * w, 3).reshape(-1, 3)
    R[:, :2] /= impratio
    # friction has no gap to close
    gap = np.zeros_like(v)
    gap[:, 2] = c
    a_ref = reference(gap, v, d[:, None], solref, solimp)
    return SoftContact(R.ravel(), a_ref.ravel())
