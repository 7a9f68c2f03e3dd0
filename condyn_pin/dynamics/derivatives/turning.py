"""How the combinations of rows that are left out turn with the rows.

Off the constraints an answer satisfies its rows but for a remainder s that no acceleration meets,

    P (J a + gamma - a_ref) = 0,    lam = P lam,    s = J a + gamma - a_ref,    P = 1 - N N^T,

where N spans R U_n, and U_n are the left singular vectors of the scaled rows A = R J D that do not
count (`condyn_pin.constraints.rows.redundancy`). So an answer changes with P as well:

    P J da = -P (s_q dq + s_v dv + dP s),        N^T dlam = N^T dP lam.

With A = U S V^T, E = R dJ D, i kept and j left out (Golub, Pereyra)

    dU_n = U_r X,    X_ij = (s_j u_i^T E v_j + s_i u_j^T E v_i) / (s_j^2 - s_i^2),
    dP = -(Z + Z^T),    Z = P R U_r X B^+,    B = R U_n,

of which P s = 0 and B^+ lam = 0 leave dP s = -Z s and dP lam = -Z^T lam. The partials of J w at a
fixed w and of J^T z at a fixed z have all of E that this needs. All j with s_j = 0, each of them on
closed loops, are served by one of either; an s_j that the gap has made, by one more.

References
----------
Golub, Pereyra. The differentiation of pseudo-inverses and nonlinear least squares problems whose
variables separate. SIAM J. Numer. Anal. 10, 1973.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import lapack
from condyn_pin.constraints.rows.redundancy import Redundancy
from condyn_pin.dynamics.derivatives.linearised import Linearisation

# Of a vector to a matrix with one column for each direction in which the rows turn.
Partial = Callable[[Array], Array]


class TurningRows:
    """The rows that are kept at one state, and how they turn.

    Parameters
    ----------
    redundancy : Redundancy
    J : (m, nv) array
    rank : int
        Rows that are kept, less than m.
    rest : (m,) array
        What is left in the rows, s.
    """

    def __init__(self, redundancy: Redundancy, J: Array, rank: int, rest: Array) -> None:
        self.R, self.D, self.rank, self.rest = redundancy.R, redundancy.D, rank, rest
        A = self.R[:, None] * J * self.D
        self._U, self._S, self._Vt, _ = lapack().dgesdd(A, full_matrices=len(J) > J.shape[1])
        self.N, self._T = np.linalg.qr(self.R[:, None] * self._U[:, rank:])  # B
        alive = tolerances.REFERENCE_RANK * self._S[0] < self._S
        self._live = range(rank, max(int(np.count_nonzero(alive)), rank))

    def kept(self, s: Array) -> Array:
        """P s: rows (m,) or (m, k) without what is left out."""
        return np.asarray(s - self.N.dot(self.N.T.dot(s)))

    def turned(self, lam: Array, turning: Partial, pulling: Partial) -> tuple[Array, Array]:
        """P dP s and N N^T dP lam (m, k) along k directions in which the rows turn.

        Parameters
        ----------
        lam : (m,) array
            The forces, N^T lam = 0.
        turning, pulling : callable
            How J w and J^T z change: (m, k) for a fixed w (nv,), and (nv, k) for a fixed z (m,).
        """
        r, R, D, dead = self.rank, self.R[:, None], self.D[:, None], self._live.stop
        U_r, V_r, values = self._U[:, :r], self._Vt[:r], self._S[:r]
        along = np.linalg.solve(self._T, self.N.T.dot(self.rest))
        held = U_r.T.dot(self.R * lam)
        # of all j with s_j = 0, whose X_ij = -u_j^T E v_i / s_i
        z = self.R * self._U[:, dead:].dot(along[dead - r :])
        w = self.D * V_r.T.dot(held / values)
        X_s = V_r.dot(D * pulling(z)) / -values[:, None]
        lam_X = [-self._U[:, dead:].T.dot(R * turning(w))]
        for j in reversed(self._live):
            s_j, u_j, v_j = self._S[j], self._U[:, j], self._Vt[j]
            X_j = s_j * U_r.T.dot(R * turning(self.D * v_j))
            X_j += values[:, None] * V_r.dot(D * pulling(self.R * u_j))
            X_j /= (s_j**2 - values**2)[:, None]
            X_s += along[j - r] * X_j
            lam_X.insert(0, held.dot(X_j)[None])
        by_lam = self.N.dot(np.linalg.solve(self._T.T, np.vstack(lam_X)))
        return -self.kept(R * U_r.dot(X_s)), -by_lam


def turning_null_space(linearisation: Linearisation, q: Array, w: Array, N: Array) -> Array:
    """Return N N^T (dJ w) (m, nv): what keeps lam = J w the smallest as the rows turn.

    On the constraints, where N (m, k) is an orthonormal basis of the left null space of J.
    """
    return np.asarray(N @ (N.T @ linearisation.turning(q, w)))
