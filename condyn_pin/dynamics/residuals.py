"""Residuals: what two residuals say about the error of a.

Let a be an answer with r = M a + h - tau - J^T lam and s = J a + gamma - a_ref. The exact answer
differs by e with

    M e = J^T dlam - r,     J e = -s.

In the metric of M, the part of e that comes from r is a projection of M^-1 r, and the part from s
is at most |s| / sigma, with sigma the smallest nonzero singular value of J L^-T (M = L L^T):

    |e|_M <= |r|_(M^-1) + |s| / sigma <= sum_j w_j |r_j| + |s| / sigma,    w_j^2 = (M^-1)_jj
    |e_i| <= w_i |e|_M.

To this comes what rounding of M itself does, eps cond(D M D) with D = diag(M_jj^-1/2).

w and sigma are taken once, at the nominal state of the scene, so this is a bound there and an
estimate elsewhere: sigma falls to zero at a singular configuration, and w grows where M nearly is.
So unless what s does to a is a thousand times smaller than SOLVED, as it is for a converged answer,
and a and lam are of a size that the robot can have, both are computed anew at the state. What s
does is asked of all of J^+ = L^-T (J L^-T)^+, |J^+ s|_inf <= |J^+|_inf |s|_inf: joints that are
lighter than all others, such as the spin of a rod, are seldom those that the weakest row moves.
With w and sigma at the state comes e itself, the solution of the two equations above. What rounding
leaves open of it is bounded in the metric of M,

    |e_i| <= (e_i computed^2 + (|L^-T V| S^-1 |U^T ds|)_i^2)^1/2 + w_i eps (nv + m) kappa |e|_M,

with kappa = cond(D M D) + sigma_1 / sigma of the factors J L^-T = U S V^T that it comes from, and
ds what rounding of J a and of gamma does to s. Their terms are of the sizes P_ij a_j and P_ij v_j
|v|_inf, each is rounded by eps / 2, and independently of the others.
Rows whose singular value is below REFERENCE_RANK count as redundant there, and rounding of J^T lam
is added as an independent part: eps |N| |lam| P, with P what the two bodies of a row bring to J
before they cancel, and N = L^-T (1 - V V^T) L^-1 what torques do to a: light bodies do not feel
what they do not touch, nor what rows hold. A row of which rounding is all that is left takes a lam
of 1e17, and is found by that.
What rounding of tau alone does, eps |N| |tau|, is not held against an answer whose bound is larger
than SOLVED: forces that balance to the last bit leave a = 0.

Residuals know nothing of directions that are off, for they are made with the same: that of a rod
turns by eps |p| / length. That is in P, too, and at the nominal state in `leaning_rounding`.

Forces may be off where a is not, along what the rows hold: J^T dlam = r + M e, so that r is held
against the largest torque in the equation of a joint as well (`Verifier`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import MinimumNorm

_EPS = float(np.finfo(np.float64).eps)
_UNIT = _EPS / 2  # of one rounding

# Relative errors below this need no account of what rounding of tau does.
_NEAR_ROUNDING = tolerances.SOLVED

# Where sigma is not so many times the rounding of J, rows may count or not: state by state.
_CLEAR = 100.0

# Forces, as a multiple of the weight where a is of the size of gravity, that machines do not have
# away from singular configurations.
_HEAVY = 100.0


class Residuals(NamedTuple):
    """Sizes of the residuals of an answer, and the bound that they imply for the error of a.

    Attributes
    ----------
    dynamics : float
        |M a + h - tau - J^T lam - sum J_f^T f|_inf [N, N m].
    constraint : float
        |J a + gamma - a_ref|_inf [m/s^2, rad/s^2].
    violation : float
        |c(q)|_inf of the state [m, rad].
    velocity : float
        |J v|_inf of the state [m/s, rad/s].
    bound : float
        Bound on the error of a, relative to the larger of |a|_inf and gravity [1].
    """

    dynamics: float  # |M a + h - tau - J^T lam|_inf [N, N m]
    constraint: float  # |J a + gamma - a_ref|_inf [m/s^2, rad/s^2]
    violation: float  # |c(q)|_inf [m, rad]
    velocity: float  # |J v|_inf [m/s, rad/s]
    bound: float  # on the error of a, relative to the larger of |a|_inf and gravity


@dataclass(frozen=True, eq=False)
class ErrorEstimator:
    """Estimator of the error of a scene's accelerations from residuals."""

    factors: MinimumNorm  # of M and J at a state, nominal or not
    # (m, nv) P: what J is a difference of, and what directions that it is along are off by, over
    # eps
    cancellation: Array
    # gravity, weight: |g| [m/s^2]; mass times gravity [N]
    gravity: float
    weight: float
    leaning: Sequence[int] = ()  # the rows along directions that are computed

    @cached_property
    def weights(self) -> Array:
        """W (nv,): square roots of the diagonal of M^-1."""
        return self.factors.weights

    @cached_property
    def sigma(self) -> float:
        """Smallest nonzero singular value of J L^-T; infinite without constraints."""
        rank = self.factors.rank
        return float(self.factors.S[rank - 1]) if rank else inf

    @property
    def rounding(self) -> float:
        """The error that no answer can be below: eps cond(D M D) [1]."""
        return self.factors.mass.rounding

    @cached_property
    def blur(self) -> float:
        """Bound on the change of sigma by rounding of J."""
        return self.factors.blur(self.cancellation)

    @cached_property
    def constraint_rounding(self) -> float:
        """Rounding of J a, relative to the largest of a [1]."""
        return _EPS * float(self.cancellation.sum(axis=1).max())

    @cached_property
    def force_rounding(self) -> float:
        """Error of a by rounding of J^T lam, relative to gravity, where a row has the weight."""
        felt = float(self.weights.max() * self.weights.dot(self.cancellation.max(0, initial=0.0)))
        return _EPS * felt * self.weight / (self.gravity or 1.0)

    @cached_property
    def leaning_rounding(self) -> tuple[float, float]:
        """Error of a by directions that are off by eps, per a and per lam."""
        # Twice as much, for it is that at the nominal state.
        P, leaning = np.zeros_like(self.cancellation), list(self.leaning)
        P[leaning] = 2.0 * _EPS * self.cancellation[leaning]
        moved, pushed = self.factors.moved(P.sum(axis=1)), self.factors.pushed(P.sum(axis=0))
        return float(moved.max()), float(pushed.max())

    def missing(self, r: Array, s: Array, v: Array, a: Array) -> float:
        """Return a bound on |e|_inf at the state of the factors, for the residuals of a there."""
        factors, P, rows = self.factors, self.cancellation, len(s)
        with np.errstate(all="ignore"):  # what overflows is no finite bound
            e, _ = factors.solve(r, s)
            e_M = float(np.linalg.norm(factors.L.T @ e))
            lost = self.rounding + (_EPS * float(factors.S[0]) / self.sigma if rows else 0.0)
            # of J a, and of gamma, which grows with the square of v
            sizes = np.hypot(a, v * np.abs(v).max())
            unit = float(sizes.max()) or 1.0  # whose square overflows
            rounded = unit * factors.moved(_UNIT * np.linalg.norm(P * (sizes / unit), axis=1))
            open_by = (len(r) + rows) * lost * e_M
            computed = float((np.hypot(e, rounded) + self.weights * open_by).max())
            # factors of a badly conditioned M may know less of e than the residuals do
            whole = self.weights.dot(np.abs(r)) + self.per_row * np.abs(s).max(initial=0.0)
            return min(computed, float(np.hypot(self.weights * whole, rounded).max()))

    def prove(
        self,
        dynamics: Array,
        largest: list[float],
        tau: Array,
        e: float | None = None,
        lean: float = 0.0,
    ) -> tuple[Residuals, bool]:
        """Return the sizes of the residuals, and whether w and sigma have to be computed anew."""
        # `dynamics` and `largest` are those of `Equations.errors`; `e` bounds |e|_inf, where it was
        # computed; where it was not, `lean` is how many eps directions are off, at most.
        # ``native/src/core/verdict.hpp`` is the same.
        max_dynamics, max_a, violation, velocity, constraint, max_lam = largest
        e_M = self.weights.dot(dynamics) + self.per_row * constraint
        error = float(self.largest_weight * e_M)
        scale = max_a if max_a > self.gravity else self.gravity
        if e is not None:  # relative to the exact a, which may be smaller by as much
            error = e / (1 - min(e / scale, 0.5)) if scale else e
            if not error <= _NEAR_ROUNDING * scale:
                error -= self.rounding_of(np.abs(tau))
        bound = max(error, 0.0) / scale if scale else (0.0 if error <= 0.0 else inf)
        leaning = 0.0
        if lean:
            of_a, of_lam = self.leaning_rounding
            leaning = lean * (of_a + of_lam * max_lam / scale if scale else inf)
        bound += self.rounding + leaning
        doubtful = e is None and (
            constraint > self.negligible_constraint_error * scale
            or bound > tolerances.SOLVED
            or not leaning <= tolerances.SOLVED / 1000
            or max_a > self.plausible_acceleration
            or max_lam > self.plausible_force * scale
        )
        return Residuals(max_dynamics, constraint, violation, velocity, bound), doubtful

    def rounding_of(self, torques: Array) -> float:
        """Return the error of a by rounding of some torques (nv,), all positive: eps |N| tau."""
        # Forces that balance to the last bit leave a = 0, and a relative error means nothing there.
        return _EPS * float(self.factors.pushed(torques).max())

    @cached_property
    def plausible_acceleration(self) -> float:
        """The largest that needs no nearly singular M to explain it [m/s^2, rad/s^2]."""
        # Ten times what the robot's weight, at a lever of one metre, gives to its lightest joint.
        return 10.0 * self.largest_weight**2 * self.weight

    @cached_property
    def plausible_force(self) -> float:
        """The largest multiplier that is not rounding, relative to the size of a [N s^2/m]."""
        # A hundred times what the robot weighs: near a singular configuration lam grows as 1 /
        # sigma, and a row that is rounding takes 1e17. Less where light joints are shaken by less.
        rounding = self.force_rounding
        most = min(_HEAVY, tolerances.SOLVED / rounding) if rounding else _HEAVY
        return most * self.weight / (self.gravity or 1.0)

    @cached_property
    def negligible_constraint_error(self) -> float:
        """The |s|_inf, relative to the size of a, that is never in doubt [1]."""
        # Everything is where all rows are rounding, also a residual of nothing, and where joints
        # are so light that rounding of J^T lam shakes them.
        if not len(self.cancellation):
            return inf
        scale = self.largest_weight * self.per_row
        if (
            self.force_rounding > tolerances.SOLVED
            or not _CLEAR * self.blur < self.sigma < inf
            or scale * self.constraint_rounding > tolerances.SOLVED / 10  # s = 0 says nothing
        ):
            return -1.0
        return tolerances.SOLVED / 1000 / self.gain

    @cached_property
    def gain(self) -> float:
        """|J^+|_inf: how far a joint is moved at most by a |J a + gamma - a_ref|_inf of one [1]."""
        m, n = self.cancellation.shape
        moved, _ = self.factors.solve(np.zeros((n, m)), np.eye(m))
        return float(np.abs(moved).sum(axis=1).max())

    @property
    def tolerated_constraint_error(self) -> float:
        """The largest |s|_inf that the tolerance allows at gravity's scale [m/s^2]."""
        scale = self.largest_weight * self.per_row
        return tolerances.SOLVED * (self.gravity or 1.0) / scale if scale else 1.0

    @cached_property
    def negligible_dynamics_error(self) -> float:
        """The |r|_inf, relative to the size of a, that is no error of forces [kg, kg m^2]."""
        # A hundredth of FORCES, where one would do at the nominal state: no joint feels less
        # inertia than 1 / w^2, whatever the others do.
        return tolerances.FORCES / 100.0 / float(self.weights.min()) ** 2

    @cached_property
    def per_row(self) -> float:
        """Norm of the weighted error per |s|_inf: sqrt(m) / sigma, since |s| <= sqrt(m) |s|_inf."""
        return sqrt(len(self.cancellation)) / self.sigma

    @cached_property
    def largest_weight(self) -> float:
        """The largest of the weights."""
        return float(self.weights.max())
