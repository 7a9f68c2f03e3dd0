"""Drive: what motors and constraints can give together.

    B u + J^T lam = f

With M = L L^T and V an orthonormal basis of what the constraints block, L^-1 J^T = V S U^T, the
forces lam drop out of

    (I - V V^T) L^-1 B u = (I - V V^T) L^-1 f,

which has many solutions where motors work against each other, and none where too few of them are
there. Taken is, among all u that come nearest in the metric of M^-1, the smallest; lam follows from
it, the smallest again where rows are redundant. What is then missing, r, leaves J M^-1 r = 0: the
robot moves with a - M^-1 r, of all accelerations that the motors can give the nearest in the metric
of M, and with the same lam.
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import MinimumNorm

# The second round takes out what rounding left in the first: on Cassie, Talos and Stewart's
# platform a factor of 5 to 30. A third gains nothing.
_ROUNDS = 2


class Drive:
    """The factors of [B J^T], from those of M and J.

    `rank` is that of (I - V V^T) L^-1 B, and `weakest` its smallest singular value within that
    rank, both relative to the size of L^-1 B.
    """

    def __init__(self, factors: MinimumNorm, J: Array, B: Array) -> None:
        # imported here: scipy.linalg takes as long to import as Pinocchio
        from scipy.linalg import solve_triangular

        self._of, self._J, self._B = factors, J, B
        self._Bw = solve_triangular(factors.L, B, lower=True)
        V = factors.V
        self._X, self._S, Yt = np.linalg.svd(self._Bw - V @ (V.T @ self._Bw))
        strengths = self._S / float(np.linalg.norm(self._Bw, 2))
        self.rank = int(np.count_nonzero(strengths > tolerances.RANK))
        self.weakest = float(strengths[self.rank - 1]) if self.rank else 1.0
        self._Y = Yt.T

    def share(self, required: Array) -> tuple[Array, Array, Array]:
        """Return u, lam, and what is missing of a generalised force (nv,)."""
        from scipy.linalg import solve_triangular

        X, S, Y = self._X[:, : self.rank], self._S[: self.rank], self._Y[:, : self.rank]
        u, lam = np.zeros(self._B.shape[1]), np.zeros(len(self._J))
        missing = required
        for _ in range(_ROUNDS):
            y = solve_triangular(self._of.L, missing, lower=True)
            du = Y @ ((X.T @ y) / S)
            u += du
            lam += self._through(y - self._Bw @ du)
            missing = required - self._B @ u - self._J.T @ lam
        return u, lam, missing

    def null_space(self) -> Array:
        """Return a basis (k + m, d) of the (u, lam) with B u + J^T lam = 0."""
        N = self._Y[:, self.rank :]
        redundant = self._of.U[:, self._of.rank :]
        zero = np.zeros((len(N), redundant.shape[1]))
        return np.block([[N, zero], [-self._through(self._Bw @ N), redundant]])

    def _through(self, y: Array) -> Array:
        """Return the smallest lam with V V^T y = L^-1 J^T lam, for one or many y."""
        of = self._of
        U, S = of.U[:, : of.rank], of.S[: of.rank]
        return np.asarray(U @ ((of.V.T @ y).T / S).T)
