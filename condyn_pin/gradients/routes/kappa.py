"""Kappa: contacts seen from within their cones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import Grid, quoted_names
from condyn_pin._core.arrays import Array, finite
from condyn_pin.contact.problem import ContactProblem, normalised
from condyn_pin.errors import InvalidArgument, SolveFailed
from condyn_pin.gradients.routes.active_set import ActiveSet
from condyn_pin.gradients.routes.route import LawRoute
from condyn_pin.gradients.routes.step_derivatives import ContactLaw
from condyn_pin.simulation.integrators.contact_scheme import (
    ActiveContacts,
    BiasPartials,
    ContactScheme,
)
from condyn_pin.stepping.schemes.moreau import Moreau

# How far above the floor contacts of `Moreau` are active, in kappa g dt^2. What rests on one
# contact hovers at one of these, on n of them at n; at a hundred a contact has 1 % of the weight to
# push.
_HOVERS: Final = 100.0

_G: Final = 9.81  # [m/s^2]


@dataclass(frozen=True)
class _InteriorMoreau(Moreau):
    """Moreau's steps of contacts that push before they touch.

    sigma_n = J_n v+ + e J_n v + gap / dt
    """

    reach: float = 0.0  # [m/s^2], times dt^2

    def near(self, gaps: Array, v: Array, dt: float) -> NDArray[np.bool_]:
        """Flags of contacts that push in the middle of the step."""
        return np.asarray(super().near(gaps - self.reach * dt * dt, v, dt))

    def bias(self, near: ActiveContacts) -> tuple[Array, Array | None]:
        """Return g (m,) [m/s] of contacts that are `near`; they are rigid."""
        g, _ = super().bias(near)
        g[near.normals] += np.maximum(near.gaps, 0.0) / near.dt
        return g, None

    def bias_partials(self, near: ActiveContacts) -> BiasPartials:
        """Partial derivatives of `bias` by `near`."""
        opens = (near.gaps > 0) / near.dt
        return super().bias_partials(near)._replace(gaps=opens)


@dataclass(frozen=True)
class Kappa(LawRoute):
    """The derivatives of a step with a smooth contact law, near to Coulomb's by kappa.

    lam_n sigma_n = k,    mu lam_n eta + lam_t . sigma_t = k,    mu lam_n sigma_t + eta lam_t = 0
    k = kappa (m g dt) (g dt)

    with eta > 0 and lam within its cone: the central path of interior-point methods for Coulomb's
    law, which ends at k = 0. Contacts push a little before they touch, and creep before they slip;
    where the step has a kink, the derivative changes smoothly from one side to the other.

    Parameters
    ----------
    kappa : float
        Smoothness, relative to the weight of the robot and the velocity that gravity gives in the
        step [1]. 1e-2 rounds a kink over a tenth of the weight, 1e-6 over a thousandth.

    Raises
    ------
    InvalidArgument
        If `kappa` is not from 1e-12 to 1e3.

    Notes
    -----
    The differentiated step has different impulses from the step that was taken: `q` and `v` of the
    result are its own end. The smooth law has no modes and no kinks. A kink of the scheme remains:
    `StewartTrinkle` closes a gap in one step and pushes a penetration out in five, so that at a gap
    of zero derivatives hold on one side, and `one_sided` is set. What rests is
    kappa g dt^2 above the floor; `Moreau`, whose contacts become active at a gap of zero, has them
    active up to a hundred times that, and sigma_n is gap / dt more.

    References
    ----------
    Howell, Le Cleac'h, Bruedigam, Kolter, Schwager, Manchester. Dojo: a differentiable physics
    engine for robotics. arXiv:2203.00806, 2022.
    """

    title: ClassVar[str] = "kappa"
    cost: ClassVar[str] = "as ActiveSet, and 10 to 40 steps of Newton's method"
    use: ClassVar[str] = "in optimisers that begin far away: smooth, and with a slope in stick"

    sweeps: ClassVar[tuple[Grid, ...]] = ({"kappa": (1e-2, 1e-4, 1e-6)},)

    is_smooth: ClassVar[bool] = True

    kappa: float = 1e-4

    def __post_init__(self) -> None:
        kappa = float(finite("kappa", self.kappa, ()))
        if not 1e-12 <= kappa <= 1e3:
            raise InvalidArgument(
                f"kappa = {self.kappa!r}: a number from 1e-12 to 1e3; ActiveSet() has none"
            )
        object.__setattr__(self, "kappa", kappa)

    def scheme(self, scheme: ContactScheme) -> ContactScheme:
        """Return the scheme, with contacts that hover where it would let them drop."""
        if type(scheme) is Moreau:
            return _InteriorMoreau(
                scheme.contact, scheme.restitution_law, _HOVERS * self.kappa * _G
            )
        return scheme

    def law(self, problem: ContactProblem, lam: Array, natural: float, size: float) -> ContactLaw:
        """Return the impulses of the smooth law, and the law linearised at them."""
        if not problem.limits.all():
            dry = problem.names[len(problem.names) - len(problem.limits) :]
            names = [name for name, most in zip(dry, problem.limits, strict=True) if not most]
            raise InvalidArgument(
                f"route = {self!r}: {quoted_names(names)} can give no force, and has no inside to "
                "go through; leave it out of the scene, where it does nothing"
            )
        barrier = Barrier(problem, self.kappa, size)
        return barrier.law(barrier.solve())

    def path(self, problem: ContactProblem, lam: Array, natural: float, size: float) -> ContactLaw:
        """Return the law of the scheme itself, which knows nothing of kappa."""
        return ActiveSet().law(problem, lam, natural, size)


# Barrier: a contact problem whose complementarity is k, by Newton's method from within.
#
#     cones       lam_n s = k,  mu lam_n eta + lam_t . sigma_t = k,  mu lam_n sigma_t + eta lam_t =
#     0
#     half-lines  lam s = k
#     intervals   sigma = q - p,  (L - lam) p = k,  (L + lam) q = k
#
# s = sigma_n, and lam_n, s, eta, p, q > 0. The path begins at a large k, which falls by ten: what
# is inside stays inside. Without friction lam_t = 0.


_TOPS: Final = (1.0, 1e2, 1e4, 1e6)  # where a path begins; the next, if there is none from there
_FALLS: Final = 0.1  # k from one problem to the next
_INSIDE: Final = 0.99  # the share of the way to the wall that a step goes at most
_STEPS: Final = 60  # of Newton's method, for one k
_ROUNDING: Final = 1e-13  # what is left of the equations at the end, relative to their terms
_SMALLEST: Final = 1e-14  # what rounding of sigma leaves of them


class Barrier:
    """The smooth law of one contact problem, for k = kappa size [J]."""

    def __init__(self, problem: ContactProblem, kappa: float, size: float) -> None:
        self._asked, self._size, k = problem, size, kappa * size
        self._problem, unit = normalised(problem)
        self._unit = np.broadcast_to(np.asarray(unit, dtype=np.float64), (problem.rows,))
        # one unit of lam' sigma' is so much energy, the same for all contacts
        small, large = self._problem, problem
        ratio = np.abs(small.g) > 0
        i = int(np.argmax(np.abs(small.g))) if ratio.any() else 0
        speed = large.g[i] / small.g[i] if ratio.any() else 1.0
        self._k = k / float(self._unit[i] * speed) if problem.rows else k
        self._speed = 1.0 / self._unit * float(self._unit[i] * speed) if problem.rows else unit
        sets = small.sets
        cones, self._lines, self._dry = sets.parts
        self._n = np.arange(2, cones.stop, 3)
        self._t = np.column_stack((self._n - 2, self._n - 1))
        # rows along a normal: of cones, and half-lines
        self._pushes = np.concatenate((self._n, np.arange(self._lines.start, self._lines.stop)))
        self._rows, self._mu = problem.rows, problem.friction
        self._limits = small.limits

    def solve(self) -> Array:
        """Return (lam, s, eta, p, q) of the normalised problem; SolveFailed if there is none."""
        if not self._rows:
            return np.zeros(0)
        for top in _TOPS[:-1]:
            try:
                return self._along_path(max(top, self._k))
            except SolveFailed:  # Newton's method is caught where the equations are least
                continue
        return self._along_path(max(_TOPS[-1], self._k))

    def _along_path(self, k: float) -> Array:
        """Return the point of the path that begins at k."""
        x = self._start(k)
        while True:
            x = self._newton(x, k)
            if k <= self._k:
                return x
            k = max(k * _FALLS, self._k)

    def law(self, x: Array) -> ContactLaw:
        """Return impulses, and their law linearised, in the units of the problem asked."""
        m, k = self._rows, self._k
        lam, s, eta, p, q = self._parts(x)
        by_sigma, by_lam = np.zeros((m, m)), np.zeros((m, m))
        by_friction, by_k = np.zeros((m, len(self._mu))), np.zeros(m)
        pushes = self._pushes
        by_sigma[pushes, pushes], by_lam[pushes, pushes], by_k[pushes] = lam[pushes], s, -1.0
        for i, (n, t, mu) in enumerate(zip(self._n, self._t, self._mu.tolist(), strict=True)):
            if not mu:
                by_lam[t, t] = 1.0
                continue
            b, most = lam[t], mu * lam[n]
            u = b / (float(np.hypot(*b)) or 1.0)
            along, block = np.outer(u, u) if b.any() else np.zeros((2, 2)), np.ix_(t, t)
            by_sigma[block] = most * (np.eye(2) - along) + k / eta[i] * along
            by_lam[block] = eta[i] * (np.eye(2) + np.outer(b, b) / most**2)
            by_lam[t, n] = -2 * eta[i] * b / lam[n]
            by_friction[t, i] = -2 * eta[i] * b / mu
            by_k[t] = b / most
        dry = np.arange(self._dry.start, self._dry.stop)
        by_sigma[dry, dry] = 1.0
        below, above = self._limits - lam[dry], self._limits + lam[dry]
        by_lam[dry, dry], by_k[dry] = p / below + q / above, 1 / below - 1 / above
        margin = float(np.sqrt(k))  # no mode to be near to
        return ContactLaw(
            lam * self._unit, by_sigma / self._speed, by_lam / self._unit, by_friction, margin,
            by_k * k / self._size,
        )  # fmt: skip

    def _parts(self, x: Array) -> tuple[Array, Array, Array, Array, Array]:
        m, c, d = self._rows, len(self._pushes), len(self._limits)
        ends = np.cumsum((m, c, len(self._mu), d))
        lam, s, eta, p, q = np.split(x, ends)
        return lam, s, eta, p, q

    def _start(self, k: float) -> Array:
        lam = np.zeros(self._rows)
        lam[self._pushes] = np.sqrt(k)
        others = len(self._pushes) + len(self._mu) + 2 * len(self._limits)
        return np.concatenate((lam, np.full(others, np.sqrt(k))))

    def _residual(self, x: Array, k: float) -> tuple[Array, Array]:
        """Residuals of all equations, and the velocities sigma of the contacts."""
        lam, s, eta, p, q = self._parts(x)
        sigma = self._problem.velocities(lam)
        most, T, S = self._mu * lam[self._n], lam[self._t], sigma[self._t]
        tangent = np.where(self._mu[:, None] > 0, most[:, None] * S + eta[:, None] * T, T)
        cone = np.where(self._mu > 0, most * eta + (T * S).sum(axis=1) - k, eta - 1.0)
        dry = lam[self._dry]
        left = np.concatenate((
            sigma[self._pushes] - s, lam[self._pushes] * s - k, tangent.reshape(-1), cone,
            sigma[self._dry] - q + p, (self._limits - dry) * p - k, (self._limits + dry) * q - k,
        ))  # fmt: skip
        return left, sigma

    def _derivative(self, x: Array, sigma: Array) -> Array:
        lam, s, eta, p, q = self._parts(x)
        m, c, k, d = self._rows, len(self._pushes), len(self._mu), len(self._limits)
        G, size = self._problem.G, len(x)
        D = np.zeros((size, size))
        at_s, at_eta, at_p, at_q = m, m + c, m + c + k, m + c + k + d
        rows = np.arange(c)
        D[rows, :m], D[rows, at_s + rows] = G[self._pushes], -1.0
        D[c + rows, self._pushes], D[c + rows, at_s + rows] = s, lam[self._pushes]
        for i, (n, t, mu) in enumerate(zip(self._n, self._t, self._mu.tolist(), strict=True)):
            across, cone = 2 * c + 2 * i + np.arange(2), 2 * c + 2 * k + i
            if not mu:
                D[across, t], D[cone, at_eta + i] = 1.0, 1.0
                continue
            D[across, :m] = mu * lam[n] * G[t]
            D[across, n] += mu * sigma[t]
            D[across, t] += eta[i]
            D[across, at_eta + i] = lam[t]
            D[cone, :m] = lam[t] @ G[t]
            D[cone, t] += sigma[t]
            D[cone, n] += mu * eta[i]
            D[cone, at_eta + i] = mu * lam[n]
        dry, first = np.arange(self._dry.start, self._dry.stop), 2 * c + 3 * k
        its = np.arange(d)
        D[first + its, :m] = G[dry]
        D[first + its, at_q + its], D[first + its, at_p + its] = -1.0, 1.0
        D[first + d + its, dry], D[first + d + its, at_p + its] = -p, self._limits - lam[dry]
        D[first + 2 * d + its, dry] = q
        D[first + 2 * d + its, at_q + its] = self._limits + lam[dry]
        return D

    def _newton(self, x: Array, k: float) -> Array:
        """Return the point of the path at k."""
        last = k <= self._k
        left, sigma = self._residual(x, k)
        least = float(np.abs(left).max())
        for _ in range(_STEPS):
            if least <= (_ROUNDING * min(1.0, k) if last else 1e-2 * k):
                return x
            try:
                step = np.asarray(np.linalg.solve(self._derivative(x, sigma), -left))
            except np.linalg.LinAlgError:  # no way goes on from here
                break
            share = min(1.0, _INSIDE * self._way(x, step))
            for _ in range(30):
                there = x + share * step
                new, new_sigma = self._residual(there, k)
                if float(np.linalg.norm(new)) < (1 - 1e-4 * share) * float(np.linalg.norm(left)):
                    break
                share /= 2
            else:
                break
            x, left, sigma = there, new, new_sigma
            least = float(np.abs(left).max())
        if least <= max(1e-6 * k, _SMALLEST):  # rounding
            return x
        raise SolveFailed(
            f"Kappa: the smooth contact problem is left with {least:.1e} at k = {k:.1e}; another "
            "kappa may have an answer, and ActiveSet() needs none",
            None,
        )

    def _way(self, x: Array, step: Array) -> float:
        """Distance to the nearest wall of the barrier along a step, in such steps [1]."""
        lam, s, eta, p, q = self._parts(x)
        d_lam, d_s, d_eta, d_p, d_q = self._parts(step)
        values = np.concatenate((
            lam[self._pushes], s, eta, p, q,
            self._limits - lam[self._dry], self._limits + lam[self._dry],
        ))  # fmt: skip
        moves = np.concatenate((
            d_lam[self._pushes], d_s, d_eta, d_p, d_q, -d_lam[self._dry], d_lam[self._dry],
        ))  # fmt: skip
        falls = moves < 0
        return float((values[falls] / -moves[falls]).min(initial=np.inf))
