"""Kappa: contacts seen from within their cones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import Grid, quoted
from condyn_pin._core.arrays import Array, finite
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.integrators.contact_scheme import AskedBy, ContactScheme, Near
from condyn_pin.simulation.integrators.moreau import Moreau
from condyn_pin.simulation.routes.active_set import ActiveSet
from condyn_pin.simulation.routes.barrier import Barrier
from condyn_pin.simulation.routes.base import LawRoute
from condyn_pin.simulation.routes.law import Law

# How far above the floor contacts of `Moreau` take part, in kappa g dt^2. What rests on one contact
# hovers at one of these, on n of them at n; at a hundred a contact has 1 % of the weight to push.
_HOVERS: Final = 100.0

_G: Final = 9.81  # [m/s^2]


@dataclass(frozen=True)
class _Hovering(Moreau):
    """Moreau's steps of contacts that push before they touch.

    sigma_n = J_n v+ + e J_n v + gap / dt
    """

    reach: float = 0.0  # [m/s^2], times dt^2

    def near(self, gaps: Array, v: Array, dt: float) -> NDArray[np.bool_]:
        """Return which contacts push in the middle of the step."""
        return np.asarray(super().near(gaps - self.reach * dt * dt, v, dt))

    def asked(self, near: Near) -> tuple[Array, Array | None]:
        """Return g (m,) [m/s] of contacts that are `near`; nothing gives way."""
        g, _ = super().asked(near)
        g[near.normals] += np.maximum(near.gaps, 0.0) / near.dt
        return g, None

    def asked_by(self, near: Near) -> AskedBy:
        """Return how `asked` changes with what is `near`."""
        opens = (near.gaps > 0) / near.dt
        return super().asked_by(near)._replace(gaps=opens)


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
    result are its own end. It needs no modes, and has no kinks of its own. That of a scheme stays:
    `StewartTrinkle` closes a gap in one step and pushes a penetration out in five, so that at a gap
    of zero derivatives hold on one side, and `one_sided` is set. What rests is
    kappa g dt^2 above the floor; `Moreau`, whose contacts take part at a gap of zero, has them take
    part up to a hundred times that, and sigma_n is gap / dt more.

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
            return _Hovering(scheme.contact, scheme.restitution_law, _HOVERS * self.kappa * _G)
        return scheme

    def law(self, problem: ContactProblem, lam: Array, natural: float, size: float) -> Law:
        """Return the impulses of the smooth law, and the law linearised at them."""
        if not problem.limits.all():
            dry = problem.names[len(problem.names) - len(problem.limits) :]
            names = [name for name, most in zip(dry, problem.limits, strict=True) if not most]
            raise InvalidArgument(
                f"route = {self!r}: {quoted(names)} can give no force, and has no inside to go "
                "through; leave it out of the scene, where it does nothing"
            )
        barrier = Barrier(problem, self.kappa, size)
        return barrier.law(barrier.solve())

    def path(self, problem: ContactProblem, lam: Array, natural: float, size: float) -> Law:
        """Return the law of the scheme itself, which knows nothing of kappa."""
        return ActiveSet().law(problem, lam, natural, size)
