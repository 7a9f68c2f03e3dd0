"""Softened: the derivatives of compliant contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem, contact_modes
from condyn_pin.dynamics.solvers.soft import (
    DEFAULT_SOLIMP,
    DEFAULT_SOLREF,
    SolImp,
    SolRef,
    check_softness,
)
from condyn_pin.gradients.routes.active_set import margin, polished
from condyn_pin.gradients.routes.route import LawRoute
from condyn_pin.gradients.routes.step_derivatives import ContactLaw
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.stepping.schemes.soft_step import SoftStep


@dataclass(frozen=True)
class Softened(LawRoute):
    """The derivatives of the same step with springs and dampers in its contacts, like MuJoCo's.

    lam = P_K(lam - rho sigma),    sigma = (G + R) lam + g
    dlam = P' (dlam - rho dsigma) + P_mu dmu

    The implicit function of the natural map of a convex problem, that of `SoftStep`: what sticks
    creeps a little, and so it has a slope. Of a step by `SoftStep` they are its own derivatives,
    with its own springs.

    Parameters
    ----------
    solref : (timeconst, dampratio), or (-stiffness, -damping)
    solimp : (d_0, d_width, width, midpoint, power)
        As in `SoftStep`.

    Raises
    ------
    InvalidArgument
        If the numbers of `solref` differ in sign, or one of `solimp` is out of its range.

    Notes
    -----
    Contacts that have not closed play no part: at a gap of zero the end of a step jumps where a
    contact approaches, and `one_sided` is set. Stiff contacts have large derivatives, which near
    the time of an impact are mere noise.

    References
    ----------
    Todorov. Convex and analytically-invertible dynamics with contacts and constraints: theory and
    implementation in MuJoCo. ICRA, 2014.
    """

    title: ClassVar[str] = "softened"
    cost: ClassVar[str] = "as ActiveSet, and one evaluation more for each contact"
    use: ClassVar[str] = "to see the slopes that MuJoCo's contacts have"

    is_smooth: ClassVar[bool] = True

    solref: SolRef = DEFAULT_SOLREF  # [s, 1], or [1/s^2, 1/s]
    solimp: SolImp = DEFAULT_SOLIMP

    def __post_init__(self) -> None:
        solref, solimp = check_softness(self.solref, self.solimp)
        object.__setattr__(self, "solref", solref)
        object.__setattr__(self, "solimp", solimp)

    def scheme(self, scheme: ContactScheme) -> ContactScheme:
        """Return the scheme itself if its contacts are compliant, else the soft one."""
        soft = SoftStep(solref=self.solref, solimp=self.solimp)
        return scheme if isinstance(scheme, SoftStep) else soft

    def law(self, problem: ContactProblem, lam: Array, natural: float, size: float) -> ContactLaw:
        """Return the impulses of a problem, and their natural map linearised."""
        lam = polished(problem, lam, natural).lam
        sets, m = problem.sets, problem.rows
        sigma = problem.velocities(lam)
        rho = 1.0 / problem.scale[0]
        x = lam - rho * sigma
        blocks, free = sets.slopes(x)
        P = np.zeros((m, m))
        for i, block in enumerate(blocks):
            P[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
        rest = np.arange(3 * len(blocks), m)
        P[rest, rest] = free
        by_friction = -_by_friction(x[sets.parts[0]].reshape(-1, 3), problem.friction, m)
        modes = contact_modes(problem, lam)
        return ContactLaw(
            lam, rho * P, np.eye(m) - P, by_friction, margin(problem, lam, sigma, modes)
        )


def _by_friction(X: Array, mu: Array, rows: int) -> Array:
    """Return P_K(x) by the coefficient of each cone (rows, k): where x goes to its surface.

    P_n = (mu |x_t| + x_n) / (1 + mu^2),    P_t = mu P_n x_t / |x_t|
    """
    by_friction = np.zeros((rows, len(mu)))
    for i, (x, m) in enumerate(zip(X, mu.tolist(), strict=True)):
        slip = float(np.hypot(x[0], x[1]))
        if slip <= m * x[2] or m * slip <= -x[2]:
            continue
        normal = (m * slip + x[2]) / (1 + m * m)
        rises = (slip - 2 * m * normal) / (1 + m * m)
        across = (normal + m * rises) * x[:2] / slip
        by_friction[3 * i : 3 * i + 3, i] = *across, rises
    return by_friction
